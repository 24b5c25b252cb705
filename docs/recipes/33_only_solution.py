# SPDX-License-Identifier: LGPL-3.0-or-later
# # Is my solution the only one (unique)?
#
# Read `result.unique`: "proved", "not proved" or "others exist". It says whether there is another
# solution, for linear bodies with contact at nodes. `result.uniqueness(proof_seconds=60)` tries
# harder and says why; in 2D it gives another solution where there is one.
# See {doc}`the theory </theory/7_proofs>`.

from common import Block, triangle

result = Block().problem().solve()
print(result.unique, "-", result.uniqueness().reason)
assert result.unique == "proved"

system = triangle(friction=2.5, n=16)
system.set_parameter(1.0)
found = system.problem.solve().uniqueness(proof_seconds=60)
print(found.verdict, "-", found.reason)
assert found.verdict == "others exist"
