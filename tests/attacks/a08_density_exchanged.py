"""A heavy and a light half change sides between a killed motion and its resumption.

The right answer is the motion of the second script, never killed.
"""

import numpy as np
from recorded import compare, pushed, resumed

from dolfinx import fem

from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, heavy):
    body, problem = pushed(comm, (4, 2))
    density = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    density.interpolate(lambda x: 1.0 + 4.0 * (np.abs(x[0] - heavy) < 0.5))
    return NSCD(problem, density, dt=0.02)


def history(case, first, second):
    found = resumed(
        case.comm, lambda: make(case.comm, first), lambda: make(case.comm, second), TIMES
    )
    expected = make(case.comm, second).run(TIMES)
    compare(case, found, expected)
    case.equal("kinetic energy", found.energies.kinetic, expected.energies.kinetic)


def attack(case):
    history(case, 0.0, 1.0)


def honest(case):
    history(case, 0.0, 0.0)
