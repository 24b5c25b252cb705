# SPDX-License-Identifier: LGPL-3.0-or-later
# # Which units does it use?
#
# The units of your input, if they are consistent: with lengths in mm and forces in N, stresses and
# Young's modulus are in MPa and densities in t/mm^3 (7.85e-9 for steel). Convergence is judged by
# physical measures and does not depend on the units. In 2D forces are per thickness. Here the same
# block is solved in metres and in millimetres.

import numpy as np
from common import Block

from dolfinx_contact import Coulomb

found = {}
for name, length in (("m", 1.0), ("mm", 1000.0)):
    block = Block(young=1000.0 / length**2)  # 1000 N/m^2
    block.mesh.geometry.x[:] *= length
    block.moved.value[:] *= length
    problem = block.problem(Coulomb(0.3))
    found[name] = problem.solve()
    print(name, found[name].tables["contact"].status, found[name].resultants["contact"])
assert found["m"].counts == found["mm"].counts
assert np.allclose(1000 * found["mm"].resultants["contact"], found["m"].resultants["contact"])
