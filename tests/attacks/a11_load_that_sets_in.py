"""A load on ds without the weight, whose Constant is zero until after construction.

A ring under the traction q on its lower face carries E d A + q A, A = pi (2^2 - 1^2). The weight of
an integral is not that of its values at construction. In the twin the load has it.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.materials import circumference


def force(case, weight, tagged):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.domain.geometry.x[:, 0] += 1.0
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    steel = materials.Axisymmetric(materials.LinearElastic.from_young(1000.0, 0.0))
    q = fem.Constant(body.domain, (0.0, 0.0))
    pushed = ufl.dot(q, body.u) * weight(body.domain)
    ds = ufl.ds
    if tagged:
        numbers = np.full(len(body.bottom), 3, dtype=np.int32)
        tags = mesh.meshtags(body.domain, 1, np.sort(body.bottom), numbers)
        ds = ufl.ds(3, domain=body.domain, subdomain_data=tags)
    else:
        x = ufl.SpatialCoordinate(body.domain)
        pushed *= ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    energy = steel.energy(body.u) * circumference(body.domain) * ufl.dx
    energy += pushed * ds
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
    try:
        found = force(case, lambda domain: 1.0, True)
    except ValueError:
        found = RIGHT
    case.equal("force, by tags", found, RIGHT)
    # Where the load is depends on the place, so that numbers do not decide what its weight is.
    found = force(case, lambda domain: 1.0, False)
    case.equal("force, by place", found, RIGHT)
    case.warned("exterior facets .* not decided whether it has the weight 2 pi r")


def honest(case):
    for tagged in (True, False):
        case.equal(f"force, {tagged}", force(case, circumference, tagged), RIGHT)
