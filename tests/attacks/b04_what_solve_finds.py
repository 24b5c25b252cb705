"""A problem in 3D that `solve` solves: `find_solutions` finds something from a zero guess too.

What it finds is compared with the closed form of a column (nu = 0: E times the strain), or with the
reaction that `solve` gives; the Functions stay as they were.
"""

import numpy as np
from bodies import block, moves

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


def found(case, energy, shift, friction, force=None, cell="hexahedron", cells=(2, 2, 2)):
    body = block(case.comm, cells, (1.0, 1.0, 1.0), cell)
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(friction))
    problem = ContactProblem(energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 1.0)
    way = ufl.as_vector(tuple(s * gamma for s in shift))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    x = system.create_vector()
    solutions = find_solutions(system, [x], 1.0, lengths=(0.5,), max_iterations=20)
    untouched = np.abs(body.u.x.array).max(initial=0.0)
    case.equal("displacement before", untouched, 0.0)
    moves(body, *shift)
    system.set_parameter(1.0)
    right = problem.solve().resultants["contact"] if force is None else np.array(force)
    forces = []
    for solution in solutions.found:
        system.put(solution.x, 1.0, solution.piece)
        forces.append(problem.table(contact).force.sum(axis=0))
    case.true("something is found", forces)
    off = min((np.abs(f - right).max() for f in forces), default=np.inf)
    case.true(f"{right} among {forces}", off <= 1e-5 * np.abs(right).max())


def attack(case):
    rubber = materials.NeoHookean(*materials.lame(100.0, 0.3))
    found(case, rubber.energy, (0.25, 0.1, -0.2), 0.4, cells=(2, 1, 1))


def honest(case):
    steel = materials.LinearElastic.from_young(100.0, 0.0)
    found(case, steel.energy, (0.0, 0.0, -0.01), 0.4, (0.0, 0.0, 1.0), cells=(1, 1, 2))
