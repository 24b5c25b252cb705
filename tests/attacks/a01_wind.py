"""A damping that is affine in the velocity: the wind c (v - w) carries a body along.

Nothing but the wind acts: rho dv/dt = -c (v - w), which implicit steps of the midpoint follow as
v' = v + (w - v) c dt / (rho + c dt / 2). In the twin w is zero and the body has a velocity.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

RHO = 2.0
C = 3.0
DT = 0.1


def moved(case, wind, start):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0, -1.0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact])
    velocity = fem.Function(body.V)
    velocity.interpolate(lambda x: np.stack([start + 0 * x[0], 0 * x[0]]))
    v = ufl.TestFunction(body.V)
    w = fem.Constant(body.domain, (wind, 0.0))
    drag = C * ufl.dot(velocity - w, v) * ufl.dx
    motion = NSCD(problem, density=RHO, dt=DT, velocity=velocity, damping=drag, mass="consistent")
    history = motion.run([0.0, 4 * DT])
    expected = start
    for _ in range(4):
        expected += (wind - expected) * C * DT / (RHO + C * DT / 2)
    case.equal("kinetic energy", history.energies.kinetic, RHO / 2 * expected**2)


def attack(case):
    moved(case, 1.5, 0.0)


def honest(case):
    moved(case, 0.0, 1.5)
