# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get contact forces, moments, and the reaction of one support?
#
# `resultants` contains the total contact force on the body by surface, including friction. The
# reaction forces of Dirichlet data are separate, in `support`. Moments, such as the torque on an
# axle, are computed from the table, which lists positions in the mesh and forces of all points; for
# large displacements, add these to the positions. `imbalance` measures the balance of all forces.
#
# `support` is the sum over all supports. The reaction of one of them is the virtual work of the
# body in a unit displacement of its nodes. Here the top is held near its two ends. If nodes of a
# support are also contact points, subtract their contact forces; in a body of revolution, multiply
# the integrand by 2 pi r.

import numpy as np
from common import Block

import ufl
from dolfinx import fem, mesh

block = Block()


def near(x, end):
    return np.isclose(x[1], 1.0) & (abs(x[0] - end) < 0.3)


ends = [mesh.locate_entities_boundary(block.mesh, 1, lambda x, e=e: near(x, e)) for e in (0, 1)]
supports = [fem.locate_dofs_topological(block.V, 1, facets) for facets in ends]
block.bcs = [fem.dirichletbc(block.moved, nodes, block.V) for nodes in supports]
result = block.problem().solve()
force = result.resultants["contact"]
table = result.tables["contact"]
arm = table.x - np.array([0.5, 0.0])  # about the middle of the bottom
moment = np.sum(arm[:, 0] * table.force[:, 1] - arm[:, 1] * table.force[:, 0])
print(f"force {force}, moment {moment:.5f}, support {result.support}")


def reaction(nodes):
    """Force of a support on the body, in x and y; the energy contains all loads."""
    work = []
    for axis in range(2):
        unit = fem.Function(block.V)
        unit.x.array.reshape(-1, 2)[nodes, axis] = 1.0
        form = fem.form(ufl.derivative(block.energy, block.u, unit))
        work.append(block.mesh.comm.allreduce(fem.assemble_scalar(form)))
    return np.array(work)


left, right = map(reaction, supports)
print(f"of the left support {left}, of the right one {right}")
assert np.allclose(left + right, result.support)
assert np.allclose(force + result.support, 0.0, atol=1e-9 * np.linalg.norm(force))
assert result.imbalance < 1e-9
