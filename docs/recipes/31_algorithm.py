# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I choose the algorithm?
#
# Newton's method is the default and has fallbacks; change it for comparisons only. In 2D Lemke's
# method finds a solution for any friction. The others are classical algorithms, such as Uzawa's
# method and Tresca's fixed point; an algorithm that does not converge raises an error with the
# reason. See {doc}`the theory </theory/3_newton>`.

import numpy as np
from common import Block

forces = {}
for name in ("newton", "tresca", "gauss-seidel", "projected-gradient", "lemke"):
    result = Block().problem().solve(algorithm=name)
    forces[name] = result.resultants["contact"]
    print(f"{name:20} {result.iterations:5} iterations, {forces[name].round(6)}")
assert np.allclose(list(forces.values()), forces["newton"], rtol=1e-5)
