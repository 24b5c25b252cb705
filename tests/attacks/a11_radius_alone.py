"""The weight is the radius alone, far from the axis and in a mesh with one column of cells.

With nu = 0 the force is E d times pi (2^2 - 1^2), or pi (101^2 - 100^2) far from the axis; the twin
writes 2 pi x[0] out.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


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


def alone(psi, body):
    return psi * ufl.SpatialCoordinate(body.domain)[0] * ufl.dx


def attack(case):
    for cells in ((1, 2), (2, 2)):
        try:
            found = ring(case, alone, cells=cells)
        except ValueError as error:
            case.true("the refusal names x[0]", "x[0]" in str(error) or "2 pi" in str(error))
            continue
        case.equal("force", found, RIGHT)


def honest(case):
    def weighted(psi, body):
        return 2 * np.pi * ufl.SpatialCoordinate(body.domain)[0] * psi * ufl.dx

    case.equal("force", ring(case, weighted), RIGHT)
