"""A field of dashpots in a UFL form is mirrored between a killed motion and its resumption.

The right answer is the motion of the second script, never killed.
"""

from recorded import compare, pushed, resumed

import ufl
from dolfinx import fem

from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, left, right):
    body, problem = pushed(comm, (4, 2))
    dashpot = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    dashpot.interpolate(lambda x: left + (right - left) * x[0])
    velocity = fem.Function(body.V)
    damping = dashpot * ufl.dot(velocity, ufl.TestFunction(body.V)) * ufl.dx
    return NSCD(problem, 1.0, dt=0.02, velocity=velocity, damping=damping)


def attack(case):
    found = resumed(
        case.comm, lambda: make(case.comm, 0.0, 80.0), lambda: make(case.comm, 80.0, 0.0), TIMES
    )
    expected = make(case.comm, 80.0, 0.0).run(TIMES)
    compare(case, found, expected)
    case.equal("damped", found.energies.damping, expected.energies.damping)
