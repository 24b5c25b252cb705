# SPDX-License-Identifier: LGPL-3.0-or-later
# # Is my solution a unique one, or does another exist?
#
# `problem.uniqueness()` answers "proved", "not proved" or "others exist" for the solution in the
# Functions, with the reason. Certificates exist for linear bodies with nodal or mixed contact.
# `proof_seconds=60` allows a longer search. If there is another solution,
# `problem.restore(found.other)` writes it into the Functions.
# See {doc}`the theory </theory/7_proofs>`.

from common import Block, triangle

problem = Block().problem()
problem.solve()
found = problem.uniqueness()
print(found.verdict, "-", found.reason)
assert found.verdict == "proved"

system = triangle(friction=2.5, n=16)
system.set_parameter(1.0)
system.problem.solve()
found = system.problem.uniqueness(proof_seconds=60)
print(found.verdict, "-", found.reason)
assert found.verdict == "others exist"
