# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I model a belt that moves under the body?
#
# Use a `RigidBody` with a prescribed motion as the floor, for instance for a conveyor belt: its
# surface drags the body, and friction acts on the relative sliding. (If a plain obstacle is moved
# by Constants, its tangential velocity does not enter the friction law.) Here the belt drags the
# block until all closed points slip.

import numpy as np
from common import Block

from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, RigidBody
from dolfinx_contact.evolution import QuasiStatic

block = Block()
block.moved.value[:] = 0.0, -0.01
way = fem.Constant(block.mesh, 0.0)
floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
belt = RigidBody(floor, about=(0, 0), motion={"x": way}, held=("y", "rz"), name="belt")
contact = ContactSurface(block.u, block.bottom, obstacle=belt, law=Coulomb(0.3))
problem = ContactProblem(block.energy, block.u, [contact], bcs=block.bcs)


def load(t):
    way.value = 0.02 * t


problem.solve()  # pressed on the belt before that moves
run = QuasiStatic(problem, load).run(np.linspace(0, 1, 6))
print([step.status for step in run.steps])
shear, normal = run.steps[-1].result.resultants["contact"]
assert np.isclose(shear, 0.3 * normal)
