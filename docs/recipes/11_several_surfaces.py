# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I give several contact surfaces different laws?
#
# Make a surface for each part of the boundary, each with a name, an obstacle and a law of its own;
# two parts that differ in friction are two surfaces. Parts that share nodes give a warning, since
# the split of the force between them is not unique there: leave a facet out. Here the bottom has
# Coulomb friction and the right side meets a smooth wall.

import numpy as np
from common import Block

from dolfinx import mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, Frictionless, HalfSpace

block = Block()
obstacle = HalfSpace(point=(1.002, 0.0), normal=(-1.0, 0.0))
side = mesh.locate_entities_boundary(
    block.mesh, 1, lambda x: np.isclose(x[0], 1) & (x[1] > 0.1) & (x[1] < 0.8)
)
floor = block.surface(Coulomb(0.3), name="floor")
wall = ContactSurface(block.u, side, obstacle=obstacle, law=Frictionless(), name="wall")
result = ContactProblem(block.energy, block.u, [floor, wall], bcs=block.bcs).solve()
print(result.resultants["floor"], result.resultants["wall"])
assert result.resultants["wall"][0] < 0
assert np.isclose(result.resultants["wall"][1], 0)
