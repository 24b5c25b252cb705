# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I cite the package and the theory?
#
# `CITATION.cff` in the repository names the package and the papers of its methods;
# [Citing](/citing.md) has their BibTeX entries by feature. For the methods section of a paper,
# `problem.theory()` lists the theorems that apply to your problem. If none of them guarantees
# uniqueness, the solution may still be unique: see [recipe 33](33_only_solution.py).

from common import Block

import dolfinx_contact

theory = Block().problem().theory()
print(f"dolfinx_contact {dolfinx_contact.__version__}")
print("a solution exists by a theorem:", theory.exists)
print("it is the only one by a theorem:", theory.unique)
print(theory.reason)
assert theory.reason
