"""Dry friction as a term of the residual, 20 sign(u_x), against a pull of 5, in 3D.

A face that is held with 20 and pulled with 5 stays where it is: the slip is zero. The twin has
the sign of the place in the residual, a load of +-2 whose resultant is zero.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


def solved(case, push):
    body = block(case.comm, (2, 1, 1), size=(1.0, 1.0, 1.0))
    body.moved.interpolate(lambda x: np.stack([0 * x[0], 0 * x[0], -0.01 + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[2], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    v = ufl.TestFunction(body.V)
    residual = ufl.derivative(steel.energy(body.u) * ufl.dx, body.u, v)
    residual += lower * ufl.dot(push(body.u, x), v) * ufl.ds
    floor = HalfSpace(point=(0, 0, 0), normal=(0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(residual, body.u, [contact], bcs=body.bcs)
    return problem.solve()


def attack(case):
    result = solved(case, lambda u, x: ufl.as_vector([20 * ufl.sign(u[0]) - 5.0, 0.0, 0.0]))
    case.equal("slip", result.tables["contact"].ut[:, 0], np.zeros(6), 1e-9)


def honest(case):
    result = solved(case, lambda u, x: ufl.as_vector([0.0, 0.0, 2 * ufl.sign(x[0] - 0.5)]))
    case.equal("force", result.resultants["contact"][2], 10.0)
