"""A load that sets in where the body has come down by 2 mm: a step away from u = 0.

The column hangs from its top and touches nothing: E (d - b) = 4 downwards load beyond c makes
b = d + 4 / E. What has no step is the same load from the beginning.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


def lowest(case, factor):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    v = ufl.TestFunction(body.V)
    residual = ufl.derivative(steel.energy(body.u) * ufl.dx, body.u, v)
    residual += lower * 4.0 * factor(body.u) * v[1] * ufl.ds
    floor = HalfSpace(point=(0, -0.1), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(residual, body.u, [contact], bcs=body.bcs)
    return problem.solve().tables["contact"].un


def attack(case):
    found = lowest(case, lambda u: ufl.conditional(ufl.lt(u[1], -0.002), 1.0, 0.0))
    case.equal("gap", found, np.full(3, 0.1 - 0.014), 1e-8)


def honest(case):
    case.equal("gap", lowest(case, lambda u: 1.0), np.full(3, 0.1 - 0.014), 1e-8)
