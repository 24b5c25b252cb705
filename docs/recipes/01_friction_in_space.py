# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I vary friction in space?
#
# The friction coefficient of a law is a number, a Constant, a Function or any UFL expression of the
# position, so that it varies along the surface. It must not be negative where there is contact.
# Here it grows from 0.1 on the left to 0.5 on the right.

import numpy as np
from common import Block

import ufl

from dolfinx_contact import Coulomb

block = Block()
x = ufl.SpatialCoordinate(block.mesh)
problem = block.problem(Coulomb(0.1 + 0.4 * x[0]))
table = problem.solve().tables["contact"]
print(table.status)  # o open, k stick, + and - slip
assert np.allclose(table.bound, (0.1 + 0.4 * table.x[:, 0]) * table.rn)
