"""A modulus that varies with the radius, as E / r, and as E r: legal with the weight.

With nu = 0 the force is d times the integral of E(r) 2 pi r: 2 pi E for E / r. Without the
weight the energy of the material E r looks like that of a constant one with r alone. The twin is
E / r and E r with the weight.
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


def graded(case, modulus, weight):
    def material(steel):
        return materials.Axisymmetric(steel)

    def weighted(psi, body):
        young = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
        young.interpolate(lambda x: modulus(x[0]))
        return young * psi * weight(body.domain) * ufl.dx

    return ring(case, weighted, material, cells=(4, 1))


def areas(modulus):
    edges = np.linspace(1.0, 2.0, 5)
    middles = (edges[1:] + edges[:-1]) / 2
    return 10.0 * np.pi * np.sum(np.diff(edges**2) * modulus(middles))


def attack(case):
    found = graded(case, lambda r: r, lambda domain: 1.0)
    case.equal("force", found, areas(lambda r: r))
    case.warned("2 pi|circumference|weight")


def honest(case):
    found = graded(case, lambda r: 1 / r, circumference)
    case.equal("force of E / r", found, areas(lambda r: 1 / r))
    found = graded(case, lambda r: r, circumference)
    case.equal("force of E r", found, areas(lambda r: r))
