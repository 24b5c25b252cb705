"""The weight as a Function: 2 pi r, which is right, r, and r squared; and as Constants beside r.

With nu = 0 the force is E d pi (2^2 - 1^2). A Function shows nothing in its form, so
that a refusal or a warning is all that can be had where it is another one.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

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


def of_function(case, value, degree=1):
    def weighted(psi, body):
        weight = fem.Function(fem.functionspace(body.domain, ("Lagrange", degree)))
        weight.interpolate(lambda x: value(x[0]))
        return psi * weight * ufl.dx

    return ring(case, weighted)


def told(case):
    """How often the package has warned so far, on all ranks."""
    return case.comm.allreduce(len(case.warnings))


def settled(case, name, form):
    """A form whose weight is wrong: refused, or warned of by itself, or the right force."""
    heard = told(case)
    try:
        found = of_function(case, form, 2)
    except ValueError:
        found = RIGHT
    if told(case) == heard:
        case.equal(name, found, RIGHT)
    else:
        said = case.comm.bcast(case.warnings[-1] if case.comm.rank == 0 else "")
        case.true("the warning says of what", "2 pi r" in said)


def attack(case):
    case.equal("2 pi r as a Function", of_function(case, lambda r: 2 * np.pi * r), RIGHT)
    powers = {
        "r": lambda r: r,
        "r squared": lambda r: r**2,
        "2 pi r squared": lambda r: 2 * np.pi * r**2,
        "none": lambda r: 1 + 0 * r,
    }
    for name, value in powers.items():
        settled(case, name, value)


def honest(case):
    def weighted(psi, body):
        return sum(psi * part * circumference(body.domain) * ufl.dx for part in (0.25, 0.75))

    case.equal("force", ring(case, weighted), RIGHT)
