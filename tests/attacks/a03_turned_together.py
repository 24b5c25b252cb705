"""Two StVenant-Kirchhoff blocks are turned together by 90 degrees, pressed on each other.

The energy does not see the turning, so that the force is that of the blocks that were not turned,
turned by 90 degrees. The twin turns by half a degree, where the cosine is 1 to 4e-5.
"""

import numpy as np
from a03_off_the_edge import doubted
from bodies import two_blocks

import ufl

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials


def force(case, degrees, press):
    both = two_blocks(case.comm, (1, 1), (1, 1))
    rubber = materials.StVenantKirchhoff(0.0, 0.5)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Frictionless())
    problem = ContactProblem(rubber.energy(both.u) * ufl.dx, both.u, [pair], bcs=both.bcs)
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))

    def turned(down):
        def field(x):
            a = x[0]
            b = x[1] - down * (x[1] + 0.5) / 1.5
            return np.stack([c * a - s * b - x[0], s * a + c * b - x[1]])

        return field

    for function in (both.top, both.foot, both.u):
        function.interpolate(turned(press))
    result = problem.solve()
    back = np.array([[c, s], [-s, c]])
    return result, back @ result.resultants["contact"]


def attack(case):
    _, expected = force(case, 0.0, 0.02)
    result, found = force(case, 90.0, 0.02)
    case.equal("force, turned back", found, expected, 1e-3)
    doubted(case, result)


def honest(case):
    _, expected = force(case, 0.0, 0.001)
    result, found = force(case, 0.5, 0.001)
    case.equal("force, turned back", found, expected, 0.02)
    case.true("nothing is said", not case.warnings and not result.doubts)
