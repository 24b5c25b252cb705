# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I use a symmetry plane?
#
# Mesh only half of the symmetric body, and hold the normal displacement on the plane of symmetry by
# a condition on one component. Forces are those of the half. A contact node on the plane remains a
# contact node, since its other component is free; its friction has no component across the plane.
# Gaps, slips and tractions agree with the whole body.

import numpy as np
from common import Block, facets_where

from dolfinx import fem

from dolfinx_contact import ContactProblem, Frictionless

block = Block(n=8)
block.moved.value[:] = 0.0, -0.01
on_plane = fem.locate_dofs_topological(block.V.sub(0), 1, facets_where(block.mesh, 0, 0.0))
symmetry = fem.dirichletbc(0.0, on_plane, block.V.sub(0))
contact = block.surface(Frictionless())
problem = ContactProblem(block.energy, block.u, [contact], bcs=[*block.bcs, symmetry])
result = problem.solve()
print(f"force on the whole body: {2 * result.resultants['contact'][1]:.4f}")
assert np.allclose(block.u.x.array[on_plane], 0.0, atol=1e-12)
