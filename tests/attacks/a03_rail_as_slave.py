"""The small body is the master, against the advice, and is moved along the wide slave.

The force keeps its size; where it acts has to go with the body. The centre of pressure of the table
is compared, at the nodes of the slave, which stay where they are.
"""

import numpy as np
from a03_off_the_edge import doubted
from bodies import two_blocks

import ufl

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials


def attack(case):
    both = two_blocks(case.comm, (4, 1), (16, 1), wide=(0.0, 4.0))
    steel = materials.LinearElastic.from_young(1.0, 0.0)
    both.top.interpolate(lambda x: np.stack([2.0 + 0 * x[0], -0.02 + 0 * x[0]]))
    pair = ContactPair(both.u, both.master, master_facets=both.slave, law=Frictionless())
    energy = steel.energy(both.u) * ufl.dx
    result = ContactProblem(energy, both.u, [pair], bcs=both.bcs).solve()
    table = result.tables["contact"]
    place = table.x[:, 0]
    centre = np.sum(place * table.rn) / np.sum(table.rn)
    case.equal("centre of pressure", centre, 2.5, 0.02)
    doubted(case, result)
