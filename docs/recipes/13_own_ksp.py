# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I use my own KSP or preconditioner?
#
# Pass PETSc options without the prefix. With `linear_solver` "direct" any KSP and PC work on the
# assembled Jacobian. "amg" is the multigrid method with a filter on the contact surface, for large
# problems. Options can be changed between two solves.

import numpy as np
from common import Block

forces = []
for options in (
    {"linear_solver": "direct"},  # MUMPS
    {"linear_solver": "direct", "ksp_type": "gmres", "ksp_rtol": 1e-10, "pc_type": "ilu"},
    {"linear_solver": "amg", "amg_pc_type": "gamg"},
):
    result = Block().problem(petsc_options=options).solve()
    forces.append(result.resultants["contact"])
    print(options, forces[-1], result.iterations)
assert np.allclose(forces, forces[0], rtol=1e-5)
