# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I cite the package and the theory?
#
# `CITATION.cff` in the repository names the package and the papers whose methods it has;
# [Citing](/citing.md) has them as BibTeX with what to cite for what. For the methods section of a
# paper: what theorems say of your problem is in `problem.theory()`. Where none of them says that
# there is only one solution it may still be the only one: see [recipe 33](33_only_solution.py).

from common import Block

import dolfinx_contact

theory = Block().problem().theory()
print(f"dolfinx_contact {dolfinx_contact.__version__}")
print("a solution exists by a theorem:", theory.exists)
print("it is the only one by a theorem:", theory.unique)
print(theory.reason)
assert theory.reason
