"""The top goes down with gamma up to 1, and stays: Dirichlet data of min(gamma, 1).

The force on the floor is E d min(gamma, 1). Beside follow, find_solutions is asked beyond 1.
"""

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


def forces(case, way):
    body = block(case.comm, (2, 2))
    gamma = fem.Constant(body.domain, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.2))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    moved = ufl.as_vector((0.0 * gamma, -0.01 * way(gamma)))
    system = ParametricContact(problem, gamma, driven=[(body.moved, moved)])
    system.set_parameter(0.1)
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    found = find_solutions(system, [start], 1.7, lengths=(0.5,), max_iterations=20)
    there = [
        system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)
    ]
    system.set_parameter(0.1)
    branch = follow(system, start, 0.1, gamma_range=(0.1, 2.0))
    last = branch.points[-1]
    case.equal("where the branch ends", last.gamma, 2.0)
    return there, system.result_at(last).resultants["contact"][1]


def attack(case):
    there, end = forces(case, lambda g: ufl.min_value(g, 1.0))
    case.equal("found at 1.7", there, [10.0])
    case.equal("followed to 2", end, 10.0)


def honest(case):
    there, end = forces(case, lambda g: g)
    case.equal("found at 1.7", there, [17.0])
    case.equal("followed to 2", end, 20.0)
