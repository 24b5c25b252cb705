"""A Dirichlet condition is added to the list of a problem that was made, and to the list given.

A second condition holds the left side: u_x = 0 there. Its reaction is compared with that of a
problem that is made with both.
"""

import numpy as np
from bodies import block, moves, on_floor

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, Coulomb, HalfSpace, materials
from dolfinx_contact import ContactSurface as Surface


def _side(body):
    left = mesh.locate_entities_boundary(body.domain, 1, lambda x: np.isclose(x[0], 0.0))
    dofs = fem.locate_dofs_topological(body.V.sub(0), 1, left)
    return fem.dirichletbc(0.0, dofs, body.V.sub(0))


def attack(case):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    floor = HalfSpace(point=(0.0, 0.0), normal=(0.3, 1.0))
    problem, _contact = on_floor(body, Coulomb(0.1), obstacle=floor)
    problem.solve()
    body.u.x.array[:] = 0.0
    problem.bcs.append(_side(body))
    found = problem.solve().support

    both = block(case.comm, (2, 2), cell="quadrilateral")
    moves(both, 0.0, -0.01)
    contact = Surface(both.u, both.bottom, obstacle=floor, law=Coulomb(0.1))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    anew = ContactProblem(
        steel.energy(both.u) * ufl.dx, both.u, [contact], bcs=[*both.bcs, _side(both)]
    )
    case.equal("reactions", found, anew.solve().support)
