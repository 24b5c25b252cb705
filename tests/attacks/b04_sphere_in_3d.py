"""A ball pressed into a soft block and turned, as an obstacle of large and of small sliding.

`find_solutions` has what `solve` has, frictionless with large sliding and with friction in small.
"""

import numpy as np
from bodies import block, moves

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    ParametricContact,
    Sphere,
    materials,
)
from dolfinx_contact.continuation import find_solutions


def attack(case):
    for law, sliding in ((Frictionless(), "large"), (Coulomb(0.5), "small")):
        body = block(case.comm, (2, 2, 1), (1.0, 1.0, 1.0))
        steel = materials.LinearElastic.from_young(100.0, 0.3)
        ball = Sphere((0.5, 0.5, -2.0), 2.0)
        contact = ContactSurface(body.u, body.bottom, obstacle=ball, law=law, sliding=sliding)
        energy = steel.energy(body.u) * ufl.dx
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        moves(body, 0.01, 0.02, -0.05)
        system = ParametricContact(problem, fem.Constant(body.domain, 0.0))
        right = problem.solve().resultants["contact"]
        body.u.x.array[:] = 0.0
        x = system.create_vector()
        solutions = find_solutions(system, [x], 0.0, lengths=(0.5,), max_iterations=20)
        off = np.inf
        for solution in solutions.found:
            system.put(solution.x, 0.0, solution.piece)
            force = problem.table(contact).force.sum(axis=0)
            off = min(off, np.abs(force - right).max() / np.abs(right).max())
        case.true(f"{sliding}: found, off by {off}", off < 1e-5)
