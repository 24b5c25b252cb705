"""A block in 3D that lies on the floor by its weight alone, pushed by less than friction holds.

The resultant of contact is minus the load; what `find_solutions` finds must balance, too.
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
from dolfinx_contact.continuation import find_solutions


def attack(case):
    body = block(case.comm, (1, 1, 1), (1.0, 1.0, 0.5))
    steel = materials.LinearElastic.from_young(100.0, 0.3)
    gamma = fem.Constant(body.domain, 1.0)
    load = gamma * ufl.as_vector((0.2, 0.1, -1.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(load, body.u) * ufl.dx
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
    problem = ContactProblem(energy, body.u, [contact])
    system = ParametricContact(problem, gamma)
    right = np.array([-0.1, -0.05, 0.5])
    case.equal("solve", problem.solve().resultants["contact"], right)
    x = system.create_vector()
    solutions = find_solutions(system, [x], 1.0, lengths=(0.5,), max_iterations=20)
    case.true("something is found", solutions.found)
    for solution in solutions.found:
        system.put(solution.x, 1.0, solution.piece)
        case.equal("force", problem.table(contact).force.sum(axis=0), right)
