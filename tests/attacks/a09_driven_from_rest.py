"""A body at rest whose top is driven with a constant velocity from the first step on.

The velocity of the top is that of the drive at every step's end. Honest is a drive that begins
smoothly, t^2, by steps of the same length: its velocity at the end to second order.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def drive(case, way, speed):
    body = block(case.comm, (2, 2))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    velocity = fem.Function(body.V)

    def load(t):
        body.moved.interpolate(lambda x: np.stack([way(t) + 0 * x[0], -0.1 * way(t) + 0 * x[0]]))

    dofs = fem.locate_dofs_topological(body.V, 1, body.top)
    off = []

    def look(step):
        top = velocity.x.array.reshape(-1, 2)[dofs, 0]
        off.append(np.max(np.abs(top - speed(step.time)), initial=0.0))

    NSCD(problem, 1.0, dt=0.01, load=load, velocity=velocity).run([0.0, 0.05], observer=look)
    case.warned("velocities turn|another velocity|kink")
    worst = max(part for parts in case.comm.allgather(off) for part in parts)
    case.equal("velocity of the top, off by", worst, 0.0, 1e-9)


def attack(case):
    drive(case, lambda t: 0.2 * t, lambda t: 0.2)


def honest(case):
    drive(case, lambda t: t**2, lambda t: 2 * t)
