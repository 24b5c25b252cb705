# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I find all solutions, if there are several?
#
# Under the same load there may be multiple solutions. To determine their number, let the problem
# depend on a parameter and call `find_solutions` at one value. For a linear body in 2D with up to
# 128 contact points it proves that no solution is missing. The proof can be saved and checked by
# one file with numpy only. With few contact points, all pieces are enumerated instead: this is also
# a proof (`found.complete`), but `found.proof` is None. Pictures, `system.result_at` (tables) and
# `system.state_at` take each of the solutions found.

from common import triangle

from dolfinx_contact import plot
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.proofs import check

system = triangle(friction=2.5, n=16)
x = system.create_vector()
found = find_solutions(system, [x], 1.0)
for solution in found.found:
    print(system.letters(solution.piece))
print(f"{len(found.found)} solutions, complete: {found.complete}, {found.method}")
if found.proof:
    print(check(found.proof.certificate).verdict)
plot.picture_of_states("solutions.png", system, found.found)
assert found.complete
assert len(found.found) == 3
