"""Damping forms that jump or kink in the velocity, and a mass that depends on the displacement.

A body that slides freely on frictionless ground with velocity 1 under a dry damping g sign(v) has
lost g t / rho after a time t; it is refused, or right. With the linear damping c v of the twin
each step takes the share c dt / (rho + c dt / 2).
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def kinetic(case, form, density=lambda u: 2.0):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0, -1.0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact])
    velocity = fem.Function(body.V)
    velocity.interpolate(lambda x: np.stack([1.0 + 0 * x[0], 0 * x[0]]))
    drag = form(velocity, ufl.TestFunction(body.V)) * ufl.dx
    motion = NSCD(
        problem,
        density=density(body.u),
        dt=0.05,
        velocity=velocity,
        damping=drag,
        mass="consistent",
    )
    return motion.run([0.0, 0.2]).energies.kinetic


def either(case, what, expected, *given):
    try:
        found = kinetic(case, *given)
    except ValueError:
        found = expected
    case.equal(what, found, expected, 1e-6)


def attack(case):
    dry = (1.0 - 0.5 * 0.2) ** 2
    either(case, "sign", dry, lambda v, w: 1.0 * ufl.sign(v[0]) * w[0])
    either(case, "root", dry, lambda v, w: v[0] / ufl.sqrt(v[0] ** 2) * w[0])
    either(case, "size", dry, lambda v, w: ufl.conditional(ufl.gt(v[0], 0), 1.0, -1.0) * w[0])
    heavier = 1.0**2 * (1 + 0.2**2)
    either(case, "mass", heavier, lambda v, w: 0.0 * v[0] * w[0], lambda u: 2.0 * (1 + u[0] ** 2))


def honest(case):
    found = kinetic(case, lambda v, w: 1.0 * ufl.dot(v, w))
    case.equal("linear", found, (1 - 0.05 / (2 + 0.025)) ** 8)
