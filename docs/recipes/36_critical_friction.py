# SPDX-License-Identifier: LGPL-3.0-or-later
# # How much friction is critical, and up to which coefficient is the solution unique?
#
# How large may the coefficient be before uniqueness is lost? `renard_criterion` gives a coefficient
# up to which the computed solution is certainly unique; `weights=True` comes closer to the
# coefficient at which a second one appears. `critical_friction` gives the coefficient at which
# slips can be added to a sliding solution without additional load; its direction is that of the
# friction on the body. See {doc}`the theory </theory/7_proofs>`.

from common import Block

from dolfinx_contact import Coulomb
from dolfinx_contact.analysis import critical_friction, renard_criterion

problem = Block().problem(Coulomb(0.3))
problem.solve()
certain = renard_criterion(problem)
better = renard_criterion(problem, weights=True)
critical = critical_friction(problem, direction=(-1.0, 0.0))
print(f"only one solution up to F = {certain.friction:.3f}, with weights {better.friction:.3f}")
print(f"continua of sliding solutions at F = {critical.friction:.3f}")
assert certain.unique
assert better.friction >= certain.friction
