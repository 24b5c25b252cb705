"""A bulk with a hoop strain beside a plane surface; a plane bulk beside an axisymmetric one.

The force of a body of revolution is E d pi (2^2 - 1^2). A plane body with the plane bulk, the twin,
has E d times 1 for its width and unit thickness.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.materials import circumference


def ring(case, weighted, material=None, axisymmetric=True, **data):
    """Force on a ring, 1 < r < 2, that is pressed by 0.01 of its height."""
    body = block(case.comm, **{"cells": (2, 2), "cell": "quadrilateral", **data})
    body.domain.geometry.x[:, 0] += 1.0
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    steel = materials.Axisymmetric(steel) if material is None else material(steel)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(
        body.u, body.bottom, obstacle=floor, law=Frictionless(), axisymmetric=axisymmetric
    )
    problem = ContactProblem(weighted(steel.energy(body.u), body), body.u, [contact], bcs=body.bcs)
    return problem.solve().resultants["contact"][1]


RIGHT = 10.0 * np.pi * (2.0**2 - 1.0**2)


def attack(case):
    def weight(psi, body):
        return psi * circumference(body.domain) * ufl.dx

    def hoop_of_my_own(psi, body):
        u = body.u
        x = ufl.SpatialCoordinate(body.domain)
        eps = ufl.sym(ufl.grad(u))
        return 500.0 * (ufl.inner(eps, eps) + (u[0] / x[0]) ** 2) * 2 * np.pi * x[0] * ufl.dx

    ways = (
        ("the package's", weight, None, False),
        ("by hand", hoop_of_my_own, None, False),
        ("plane", lambda psi, body: psi * ufl.dx, lambda steel: steel, True),
    )
    for name, form, material, axisymmetric in ways:
        try:
            found = ring(case, form, material, axisymmetric)
        except ValueError:
            found = RIGHT
        case.equal(name, found, RIGHT)
    case.equal("by hand, where it fits", ring(case, hoop_of_my_own), RIGHT)


def honest(case):
    found = ring(case, lambda psi, body: psi * ufl.dx, lambda steel: steel, False)
    case.equal("force of a plane body", found, 10.0)
