# SPDX-License-Identifier: LGPL-3.0-or-later
# # What do I do when a solve fails?
#
# A solve that fails raises `ConvergenceError` and leaves your Functions as they were. Where
# Newton's method diverges or does not converge, and its fallbacks fail too, the message says what
# was tried and which points keep changing; `attempts` has the iterates. Then: check that something
# holds the body; let it touch at the start; go to the load in steps; try `algorithm="lemke"` in 2D.
# Here a block that only its weight holds begins above the floor.

import numpy as np
from common import Block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, ConvergenceError, Coulomb, HalfSpace

block = Block()
place = fem.Constant(block.mesh, (0.0, -0.1))
floor = HalfSpace(place, (0.0, 1.0))
contact = ContactSurface(block.u, block.bottom, obstacle=floor, law=Coulomb(0.3))
problem = ContactProblem(block.energy + 5.0 * block.u[1] * ufl.dx, block.u, [contact])
try:
    problem.solve()
except ConvergenceError as error:
    print(error)
place.value[1] = 0.0
result = problem.solve()
print(result.reason, result.resultants["contact"])
assert np.isclose(result.resultants["contact"][1], 5.0)
