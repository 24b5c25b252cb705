# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get the reaction of one support?
#
# `support` is the sum of the reactions of all supports. The reaction of one of them is the virtual
# work of the body in a unit displacement of its nodes. Here the held top has two halves. If nodes
# of a support are also contact points, subtract their contact forces. In a body of revolution,
# multiply the integrand by 2 pi r.

import numpy as np
from common import Block

import ufl
from dolfinx import fem

block = Block()
result = block.problem().solve()
held = [
    lambda x: np.isclose(x[1], 1.0) & (x[0] < 0.5),
    lambda x: np.isclose(x[1], 1.0) & (x[0] >= 0.5),
]
reactions = np.zeros((2, 2))  # of each half, in x and y
for half, axis in np.ndindex(2, 2):
    unit = fem.Function(block.V)
    nodes = fem.locate_dofs_geometrical(block.V, held[half])
    unit.x.array.reshape(-1, 2)[nodes, axis] = 1.0
    work = fem.assemble_scalar(fem.form(ufl.derivative(block.energy, block.u, unit)))
    reactions[half, axis] = block.mesh.comm.allreduce(work)
print(f"of the left half {reactions[0]}, of the right one {reactions[1]}")
assert np.allclose(reactions.sum(axis=0), result.support)
