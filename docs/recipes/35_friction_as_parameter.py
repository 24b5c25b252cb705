# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I follow a branch over the friction coefficient instead of the load?
#
# Use a Constant as the friction coefficient of the law and as the parameter of the
# `ParametricContact`: this is continuation in mu. `follow` traces the branch through changes of
# status and around folds. Here a block is dragged, and one point after the other stops slipping as
# friction grows.

from common import Block

from dolfinx import fem

from dolfinx_contact import Coulomb, ParametricContact
from dolfinx_contact.continuation import follow

block = Block()
friction = fem.Constant(block.mesh, 0.05)
system = ParametricContact(block.problem(Coulomb(friction)), friction)
system.problem.solve()
x = system.create_vector()
system.problem.write(x)
branch = follow(system, x, 0.05, gamma_range=(0.05, 1.0))
for point in branch.points:
    print(f"F = {point.gamma:.4f} {system.letters(point.piece)}")
assert branch.points[-1].gamma == 1.0
assert "k" in system.letters(branch.points[-1].piece)
