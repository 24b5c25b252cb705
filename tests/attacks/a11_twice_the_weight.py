"""The weight twice, its root, and its inverse.

With nu = 0 the force is E d pi (2^2 - 1^2): integrals over 2 pi r that vary like r or 1/r where the
material does not are refused; of a constant factor that is missing a warning is
all that can be had.
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


def told(case):
    """How often the package has warned so far, on all ranks."""
    return case.comm.allreduce(len(case.warnings))


def settled(case, name, form):
    """A form whose weight is wrong: refused, or warned of by itself, or the right force."""
    heard = told(case)
    try:
        found = ring(case, form)
    except ValueError:
        found = RIGHT
    if told(case) == heard:
        case.equal(name, found, RIGHT)
    else:
        said = case.comm.bcast(case.warnings[-1] if case.comm.rank == 0 else "")
        case.true("the warning says of what", "2 pi r" in said)


def attack(case):
    forms = {
        "twice": lambda psi, b: psi * circumference(b.domain) ** 2 * ufl.dx,
        "a root": lambda psi, b: psi * ufl.sqrt(circumference(b.domain)) * ufl.dx,
        "the inverse": lambda psi, b: psi / circumference(b.domain) * ufl.dx,
    }
    for name, form in forms.items():
        settled(case, name, form)


def honest(case):
    def written_out(psi, body):
        x = ufl.SpatialCoordinate(body.domain)
        return psi * (x[0] * np.pi + np.pi * x[0]) * ufl.dx

    case.equal("x pi + pi x", ring(case, written_out), RIGHT)
