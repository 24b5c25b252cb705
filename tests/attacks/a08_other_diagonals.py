"""The diagonals of the triangles lean to the other side when a killed history is resumed: nodes,
their order and the number of cells are the same.

The right answer is the history of the second script, never killed.
"""

import numpy as np
from recorded import TIMES, WAY, compare, resumed

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic


def make(comm, diagonal):
    domain = mesh.create_unit_square(comm, 3, 2, diagonal=diagonal)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    moved = fem.Function(V)
    below, above = (
        mesh.locate_entities_boundary(domain, 1, lambda x, at=at: np.isclose(x[1], at))
        for at in (0.0, 1.0)
    )
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, above))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(u, below, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [contact], bcs=[held])

    def load(t):
        x, y = (np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        moved.interpolate(lambda p: np.stack([x + 0 * p[0], y + 0 * p[0]]))

    return QuasiStatic(problem, load)


def attack(case):
    sides = mesh.DiagonalType.left, mesh.DiagonalType.right
    first, second = (lambda side=side: make(case.comm, side) for side in sides)
    found = resumed(case.comm, first, second, TIMES)
    compare(case, found, second().run(TIMES))
