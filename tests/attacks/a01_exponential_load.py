"""Loads exp(gamma) and Dirichlet data of gamma^3, by every route.

The force is E d gamma^3 + exp(gamma); pivoting on what is not affine is refused, or right.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import find_solutions, follow


def attack(case):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    gamma = fem.Constant(body.domain, 0.0)
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    energy = steel.energy(body.u) * ufl.dx + ufl.exp(gamma) * body.u[1] * lower * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.2))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    way = ufl.as_vector((0.0 * gamma, -0.01 * gamma**3))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    system.set_parameter(0.5)
    problem.solve()
    start = system.create_vector()
    problem.write(start)

    def force(gamma):
        return 10 * gamma**3 + np.exp(gamma)

    found = find_solutions(system, [start], 1.5, lengths=(0.5,), max_iterations=20)
    forces = [
        system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)
    ]
    case.equal("found", forces, [force(1.5)])
    for route in ("auto", "steps", "pivoting"):
        system.set_parameter(0.5)
        try:
            branch = follow(system, start, 0.5, gamma_range=(0.5, 1.5), route=route)
        except ValueError:
            case.true("pivoting alone is refused", route == "pivoting")
            continue
        end = system.result_at(branch.points[-1]).resultants["contact"][1]
        case.equal(f"followed, {route}", end, force(1.5))
