# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I change the friction coefficient between two solves?
#
# Numbers of a law have become Constants when the surface is made: set their `value`. Nothing is
# compiled or set up again, and each solve begins with the solution before. The same goes for
# Constants of loads, materials and obstacles.

from common import Block

from dolfinx_contact import Coulomb

problem = Block().problem(Coulomb(0.0))
(surface,) = problem.surfaces
forces = []
for friction in (0.0, 0.1, 0.3):
    surface.law.friction.value = friction
    result = problem.solve()
    forces.append(abs(result.resultants["contact"][0]))
    print(f"F = {friction}: shear force {forces[-1]:.4f}, {result.counts}")
assert forces[0] < 1e-9 < forces[1] < forces[2]
