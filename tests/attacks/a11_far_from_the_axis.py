"""A ring far from its axis, 100 < r < 101, where r hardly varies, in units of 1e-3 and 1e3 too.

With nu = 0 the force is E d / h times pi (b^2 - a^2). No weight, or r alone, must not pass, nor a
weight with the radius in another unit. The twin has the weight.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.materials import circumference


def force(case, weight, unit):
    body = block(case.comm, (2, 2), size=(unit, unit), cell="quadrilateral")
    body.domain.geometry.x[:, 0] += 100.0 * unit
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 * unit + 0 * x[0]]))
    steel = materials.Axisymmetric(materials.LinearElastic.from_young(1000.0, 0.0))
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(
        body.u, body.bottom, obstacle=floor, law=Frictionless(), axisymmetric=True
    )
    energy = steel.energy(body.u) * weight(body.domain) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem.solve().resultants["contact"][1] / unit**2


RIGHT = 10.0 * np.pi * (101.0**2 - 100.0**2)


def attack(case):
    for unit in (1e-3, 1e3):
        for weight in (
            lambda domain: 1.0,
            lambda domain: ufl.SpatialCoordinate(domain)[0],
            lambda domain: ufl.as_ufl(3.0),
        ):
            try:
                found = force(case, weight, unit)
            except ValueError:
                found = RIGHT
            case.equal(f"force, unit {unit}", found, RIGHT)


def honest(case):
    for unit in (1e-3, 1e3):
        case.equal(f"force, unit {unit}", force(case, circumference, unit), RIGHT)
