"""Two bodies of different stiffness, one on the other, by their tags; each stress is the pressure.

Springs in series: 1000 and, of half the height, 3000 carry 60/7 under a way of 0.01. The
inner vertices of one face are none of the other.
"""

import numpy as np
from a13_two_columns import GLASS, STEEL, one_is_refused, written
from bodies import two_blocks

import ufl

from dolfinx_contact import ContactPair, ContactProblem, Frictionless


def attack(case):
    both = two_blocks(case.comm, (3, 1), (2, 2))
    u = both.u
    pair = ContactPair(u, both.slave, master_facets=both.master, law=Frictionless())
    both.top.interpolate(lambda x: np.outer((0.0, -0.01), np.ones_like(x[0])))
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    bulk = STEEL.energy(u) * dx(1) + GLASS.energy(u) * dx(2)
    problem = ContactProblem(bulk, u, [pair], bcs=both.bcs)
    problem.solve()
    stresses = {1: STEEL.full_stress(u), 2: GLASS.full_stress(u)}
    centres, found = written(case.comm, problem, stresses)
    expected = np.zeros_like(found)
    expected[:, :, 1, 1] = -60 / 7
    case.true("cells", len(centres) == 7)
    case.equal("stress", found, expected)
    one_is_refused(case, problem, STEEL.full_stress(u))
