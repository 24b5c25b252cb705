# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I apply a pressure or a traction to a boundary?
#
# Subtract the work of the traction from the energy: $-\int t \cdot u\, ds$. A pressure $p$ on a
# face with the outward normal $n$ is the traction $t = -p n$. `name_groups` gives names to parts of
# the boundary, as gmsh does, and `body.ds("name")` is the measure of such a part. A Constant can be
# changed later without compiling again. In large deformations this is a dead load: its direction
# does not follow the surface.
#
# Here the top of a block is released and loaded by a pressure, while its left side is guided.

import numpy as np
from common import Block, facets_where

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, Coulomb, meshing

block = Block()
pressure = fem.Constant(block.mesh, 10.0)
sides = {"top": block.top, "left": facets_where(block.mesh, 0, 0.0)}
body = meshing.name_groups(block.mesh, sides)
n = ufl.FacetNormal(block.mesh)
energy = block.energy - ufl.dot(-pressure * n, block.u) * body.ds("top")
W = block.V.sub(0)
guided = fem.dirichletbc(0.0, body.dofs(W, "left"), W)
problem = ContactProblem(energy, block.u, [block.surface(Coulomb(0.3))], bcs=[guided])
force = problem.solve().resultants["contact"]
print(f"the floor carries {force[1]:.6f}, the pressure times the length is {10.0:.6f}")
assert np.isclose(force[1], 10.0)
