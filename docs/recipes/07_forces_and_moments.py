# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get contact forces and moments?
#
# `resultants` contains the total contact force on the body by surface, including friction. The
# reaction forces of Dirichlet data are separate, in `support`. Moments, such as the torque on an
# axle, are computed from the table, which lists positions in the mesh and forces of all points; for
# large displacements, add these to the positions. `imbalance` measures the balance of all forces.
#
# The moment from the table is exact with `method="nodal"`, the default for degree 1, and with
# `"integral"`. With `"mixed"`, the default for degree 2, the force of a vertex acts at the centroid
# of its basis function, which is not the vertex at the ends of the face. On coarse meshes the
# moment is then 1 to 3 % off in 2D, and up to a half in 3D; forces are exact. In this case let the
# body touch a `RigidBody` that is held: its `moment` in `result.rigid_bodies` is exact with every
# method. Or use `method="integral"`.

import numpy as np
from common import Block

result = Block().problem().solve()
force = result.resultants["contact"]
table = result.tables["contact"]
arm = table.x - np.array([0.5, 0.0])  # about the middle of the bottom
moment = np.sum(arm[:, 0] * table.force[:, 1] - arm[:, 1] * table.force[:, 0])
print(f"force {force}, moment {moment:.5f}, support {result.support}")
assert np.allclose(force + result.support, 0.0, atol=1e-9 * np.linalg.norm(force))
assert result.imbalance < 1e-9
