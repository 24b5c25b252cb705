# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get contact forces and moments?
#
# `resultants` contains the total contact force on the body by surface, including friction. The
# reaction forces of Dirichlet data are separate, in `support`. Moments, such as the torque on an
# axle, are computed from the table, which lists positions in the mesh and forces of all points; for
# large displacements, add these to the positions. `imbalance` measures the balance of all forces.

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
