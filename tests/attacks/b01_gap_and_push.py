"""One row of cells whose nodes can move by round-off alone: the floor is a hair below, or above.

With a floor at -h the nodes are pressed down by the held top's own motion of -h: everything moves
as one, stress-free, and touches without a force; h is 1e-12 of the size. Above by 1e-3 it is
pressed.
"""

import numpy as np
from bodies import block, moves

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials


def pushed(case, heights, algorithms):
    body = block(case.comm, (3, 1), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1e5, 0.0)
    at = fem.Constant(body.domain, (0.0, 0.0))
    floor = HalfSpace(at, (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(3.0))
    energy = steel.energy(body.u) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    for height, press in heights:
        at.value[1] = height
        moves(body, 0.0, height - press)
        for algorithm in algorithms:
            body.u.x.array[:] = 0.0
            result = problem.solve(algorithm=algorithm)
            force = result.resultants["contact"][1]
            case.equal(f"{algorithm} at {height}: force", force, 1e5 * press, 1e-6)
            bottom = result.tables["contact"].un
            case.equal(f"{algorithm} at {height}: gaps", np.abs(bottom).max(), 0.0, 1e-11)


def attack(case):
    pushed(
        case,
        [(-1e-12, 0.0), (1e-12, 0.0), (0.0, 1e-9), (0.1, 1e-6)],
        ("newton", "lemke", "gauss-seidel"),
    )


def honest(case):
    pushed(case, [(0.0, 1e-3)], ("newton", "lemke", "gauss-seidel"))
