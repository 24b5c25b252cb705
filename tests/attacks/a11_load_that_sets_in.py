"""A load on ds without the weight, whose Constant is zero until after construction.

A ring under the traction q on its lower face carries E d A + q A, A = pi (2^2 - 1^2). The weight of
an integral is not that of its values at construction. In the twin the load has it.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.materials import circumference


def force(case, weight):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.domain.geometry.x[:, 0] += 1.0
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    steel = materials.Axisymmetric(materials.LinearElastic.from_young(1000.0, 0.0))
    q = fem.Constant(body.domain, (0.0, 0.0))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    energy = steel.energy(body.u) * circumference(body.domain) * ufl.dx
    energy += ufl.dot(q, body.u) * lower * weight(body.domain) * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(
        body.u, body.bottom, obstacle=floor, law=Frictionless(), axisymmetric=True
    )
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    problem.solve()
    q.value[1] = 4.0
    return problem.solve().resultants["contact"][1]


RIGHT = 14.0 * np.pi * (2.0**2 - 1.0**2)


def attack(case):
    case.equal("force", force(case, lambda domain: 1.0), RIGHT)


def honest(case):
    case.equal("force", force(case, circumference), RIGHT)
