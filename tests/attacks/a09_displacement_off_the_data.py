"""A motion begins with a displacement that is not that of the Dirichlet data, which stay.

From there the body must not be thrown: where data are reached in the first step with a velocity of
their own, what moves is no motion under them. A static solution under the data is at rest for
ever: the kinetic energy is zero. Honest is the motion that starts with that solution.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def rest(case, solved):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    floor = HalfSpace(point=(0.0, 0.0), normal=(0.0, 1.0))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    if solved:
        problem.solve()
    history = NSCD(problem, 1.0, dt=0.01).run([0.0, 0.03])
    kinetic = max(step.energies.kinetic for step in history.steps)
    case.equal("kinetic energy", kinetic, 0.0, 1e-12)


def attack(case):
    rest(case, False)


def honest(case):
    rest(case, True)
