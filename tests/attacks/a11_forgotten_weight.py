"""A ring in compression whose energy has no weight at all, as a form and as its derivative.

With nu = 0 the force is E d times the area pi (2^2 - 1^2); the twin has the weight, in its
residual.
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
    case.equal("force", ring(case, lambda psi, body: psi * ufl.dx), RIGHT)


def honest(case):
    def residual(psi, body):
        return ufl.derivative(psi * circumference(body.domain) * ufl.dx, body.u)

    case.equal("force", ring(case, residual), RIGHT)
