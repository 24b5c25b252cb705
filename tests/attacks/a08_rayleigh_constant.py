"""The factor of Rayleigh's damping, a Constant, is another when a killed motion is resumed; honest
is the same value.

The right answer is the motion of the second script, never killed.
"""

from recorded import compare, pushed, resumed

from dolfinx import fem

from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, factor):
    body, problem = pushed(comm, (2, 2))
    return NSCD(problem, 1.0, dt=0.02, damping=(fem.Constant(body.domain, factor), 0.0))


def history(case, first, second):
    found = resumed(
        case.comm, lambda: make(case.comm, first), lambda: make(case.comm, second), TIMES
    )
    expected = make(case.comm, second).run(TIMES)
    compare(case, found, expected)
    case.equal("damped", found.energies.damping, expected.energies.damping)


def attack(case):
    history(case, 5.0, 50.0)


def honest(case):
    history(case, 5.0, 5.0)
