"""A block is moved from the soft half of the lower one to its stiff half.

Nothing leaves the lower face, all normals stay. The right force is that of the block meshed where
it goes. Rows of points are opposite to other facets than they were.
"""

import numpy as np
from a03_off_the_edge import doubted
from bodies import two_blocks

import ufl

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials


def force(case, wide, way):
    """The upper block at 0 to 1, moved by ``way``; the lower is soft up to its middle."""
    both = two_blocks(case.comm, (2, 2), (8, 2), wide=wide)
    x = ufl.SpatialCoordinate(both.domain)
    middle = sum(wide) / 2
    young = ufl.conditional(ufl.And(x[1] < 0, x[0] < middle), 0.1, 10.0)
    energy = materials.LinearElastic.from_young(young, 0.0).energy(both.u) * ufl.dx
    both.top.interpolate(lambda x: np.stack([way + 0 * x[0], -0.02 + 0 * x[0]]))
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Frictionless())
    problem = ContactProblem(energy, both.u, [pair], bcs=both.bcs)
    result = problem.solve()
    return result.resultants["contact"][1], result


def attack(case):
    expected, _ = force(case, (-1.0, 1.0), 0.0)
    found, result = force(case, (0.0, 2.0), 1.0)
    case.equal("force", found, expected, 1e-3)
    doubted(case, result)
