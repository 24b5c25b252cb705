"""Two materials change sides between a killed history and its resumption.

Mean and root mean square of Young's modulus are the same. The right answer is the history of the
second script, never killed.
"""

from recorded import TIMES, compare, dragged, resumed


def soft_left(x):
    return 500.0 + 1500.0 * (x[0] > 0.5)


def soft_right(x):
    return 500.0 + 1500.0 * (x[0] < 0.5)


def history(case, first, second):
    found = resumed(
        case.comm,
        lambda: dragged(case.comm, first).evolution,
        lambda: dragged(case.comm, second).evolution,
        TIMES,
    )
    compare(case, found, dragged(case.comm, second).evolution.run(TIMES))


def attack(case):
    history(case, soft_left, soft_right)


def honest(case):
    history(case, soft_left, soft_left)
