"""A load q (1 - |gamma - 1|) is followed over its top.

The force on the floor is E d + q (1 - |gamma - 1|); with the load q gamma, the twin, it is affine.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import follow, points_at


def followed(case, load, expected):
    body = block(case.comm, (2, 2))
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    gamma = fem.Constant(body.domain, 0.0)
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    energy = steel.energy(body.u) * ufl.dx + 5.0 * load(gamma) * body.u[1] * lower * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    system = ParametricContact(problem, gamma)
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    branch = follow(system, start, 0.0, gamma_range=(0.0, 2.0))
    case.equal("end", branch.points[-1].gamma, 2.0)
    for at in (0.5, 1.5, 2.0):
        points = points_at(system, branch, at, gamma_range=(0.0, 2.0))
        forces = [system.result_at(p).resultants["contact"][1] for p in points]
        case.equal(f"force at {at}", forces, [10.0 + 5.0 * expected(at)])


def attack(case):
    followed(case, lambda g: 1 - abs(g - 1), lambda g: 1 - abs(g - 1))


def honest(case):
    followed(case, lambda g: g, lambda g: g)
