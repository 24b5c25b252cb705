"""A damped ring that moves along its axis: the damping form has no weight.

The density is that of the volume, so that the kinetic energy is rho/2 v^2 A; drag c v dx with the
weight slows all by the share c dt / (rho + c dt / 2) a step. The twin has the weight.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import circumference


def kinetic(case, weight):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    body.domain.geometry.x[:, 0] += 1.0
    steel = materials.Axisymmetric(materials.LinearElastic.from_young(1000.0, 0.0))
    floor = HalfSpace(point=(0, -1.0), normal=(0, 1))
    contact = ContactSurface(
        body.u, body.bottom, obstacle=floor, law=Frictionless(), axisymmetric=True
    )
    energy = steel.energy(body.u) * circumference(body.domain) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact])
    velocity = fem.Function(body.V)
    velocity.interpolate(lambda x: np.stack([0 * x[0], 1.0 + 0 * x[0]]))
    drag = 3.0 * ufl.dot(velocity, ufl.TestFunction(body.V)) * weight(body.domain) * ufl.dx
    motion = NSCD(problem, density=2.0, dt=0.1, velocity=velocity, damping=drag, mass="consistent")
    return motion.run([0.0, 0.2]).energies.kinetic


RIGHT = np.pi * 3.0 * (1 - 0.3 / (2 + 0.15)) ** 4


def attack(case):
    case.equal("kinetic energy", kinetic(case, lambda domain: 1.0), RIGHT)


def honest(case):
    case.equal("kinetic energy", kinetic(case, circumference), RIGHT)
