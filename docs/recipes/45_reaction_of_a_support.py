# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get the reaction of one support?
#
# `supports` contains the reaction of each Dirichlet condition, in the order of `bcs`. Give each
# support its own condition. Here the held top has two halves with a common node in the middle. The
# force at a node in several conditions belongs to the last of them, so the reactions add up to
# `support`.

import numpy as np
from common import Block

from dolfinx import fem

from dolfinx_contact import ContactProblem, Coulomb

block = Block()
left = fem.locate_dofs_geometrical(block.V, lambda x: np.isclose(x[1], 1.0) & (x[0] <= 0.5))
right = fem.locate_dofs_geometrical(block.V, lambda x: np.isclose(x[1], 1.0) & (x[0] >= 0.5))
bcs = [fem.dirichletbc(block.moved, dofs, block.V) for dofs in (left, right)]
problem = ContactProblem(block.energy, block.u, [block.surface(Coulomb(0.3))], bcs=bcs)
result = problem.solve()
print(f"of the left half {result.supports[0]}, of the right one {result.supports[1]}")
assert np.allclose(result.supports.sum(axis=0), result.support)
