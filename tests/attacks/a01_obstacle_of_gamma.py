"""A floor whose height is a kinked function of gamma, as a level set, and friction that is one.

With the top held aside every point slips: the friction is max(0.1, 20 gamma) times the pressure,
and the end of the branch is what a solve finds there, with the floor at 0.01 - |gamma - 0.01|.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    LevelSet,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import find_solutions, follow


def attack(case):
    body = block(case.comm, (2, 1))
    body.moved.interpolate(lambda x: np.stack([0.5 + 0 * x[0], 0 * x[0]]))
    gamma = fem.Constant(body.domain, 0.005)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    rising = LevelSet(lambda x: x[1] - (0.01 - abs(gamma - 0.01)))
    law = Coulomb(ufl.max_value(0.1, 20 * gamma))
    contact = ContactSurface(body.u, body.bottom, obstacle=rising, law=law)
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    system = ParametricContact(problem, gamma)
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    found = find_solutions(system, [start], 0.012, lengths=(0.5,), max_iterations=20)
    for p in found.points(system, found.found):
        x, y = system.result_at(p).resultants["contact"]
        case.equal("friction over pressure", -x / y, 0.24)
    last = follow(system, start, 0.005, gamma_range=(0.002, 0.015)).points[-1]
    case.equal("where the branch ends", last.gamma, 0.015)
    ends = system.result_at(last).resultants["contact"]
    system.set_parameter(0.015)
    case.equal("as solved", ends, problem.solve().resultants["contact"], 1e-6)
    case.equal("friction over pressure at the end", -ends[0] / ends[1], 0.3)
