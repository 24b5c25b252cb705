# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I change the friction coefficient, or Young's modulus, between two solves?
#
# The numbers of a law are Constants: set their `value`, as in this loop over the friction
# coefficient mu. Nothing is compiled again, and each solve starts from the previous solution.
# Constants in loads, obstacles and materials are changed in the same way; here
# `LinearElastic.from_young` has one.

from common import Block

from dolfinx_contact import Coulomb

block = Block()
problem = block.problem(Coulomb(0.0))
(surface,) = problem.surfaces
forces = []
for friction, young in ((0.0, 1000.0), (0.1, 1000.0), (0.3, 1000.0), (0.3, 2000.0)):
    surface.law.friction.value = friction
    block.young.value = young
    result = problem.solve()
    forces.append(abs(result.resultants["contact"][0]))
    print(f"F = {friction}, E = {young}: shear force {forces[-1]:.4f}, {result.counts}")
assert forces[0] < 1e-9 < forces[1] < forces[2]
assert abs(forces[3] - 2 * forces[2]) < 1e-6 * forces[2]
