"""A field of friction is mirrored between a killed history and its resumption, on triangles.

The right answer is the history of the second script, never killed.
"""

from recorded import TIMES, compare, dragged, resumed


def to_the_right(x):
    return 0.1 + 0.4 * x[0]


def to_the_left(x):
    return 0.5 - 0.4 * x[0]


def history(case, first, second):
    def make(friction):
        return dragged(case.comm, friction=friction, cell="triangle").evolution

    found = resumed(case.comm, lambda: make(first), lambda: make(second), TIMES)
    compare(case, found, make(second).run(TIMES))


def attack(case):
    history(case, to_the_right, to_the_left)


def honest(case):
    history(case, to_the_right, to_the_right)
