# SPDX-License-Identifier: LGPL-3.0-or-later
# # What do I do when a solve fails to converge?
#
# A failed solve raises `ConvergenceError` and leaves the Functions unchanged. If Newton's method
# diverges or does not converge, and its fallbacks fail too, the message lists the attempts and the
# points whose status keeps changing; `attempts` contains the iterates. Then:
#
# - check that supports or friction hold the body;
# - check that the energy grows with every strain (the message names a strain without stiffness);
# - let the body touch at the start;
# - apply the load in increments;
# - try `algorithm="lemke"` in 2D.
#
# Here a block lies on a floor under its weight; without friction nothing holds it sideways.

import numpy as np
from common import Block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, ConvergenceError, Coulomb

block = Block()
friction = fem.Constant(block.mesh, 0.0)
contact = ContactSurface(block.u, block.bottom, obstacle=block.floor, law=Coulomb(friction))
problem = ContactProblem(block.energy + 5.0 * block.u[1] * ufl.dx, block.u, [contact])
try:
    problem.solve()
except ConvergenceError as error:
    print(error)
else:
    raise AssertionError("nothing holds the block")
friction.value = 0.3
result = problem.solve()
print(result.reason, result.resultants["contact"])
assert np.isclose(result.resultants["contact"][1], 5.0)
