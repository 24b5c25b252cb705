"""The gap between two bodies, a Function, is mirrored between a killed history and its resumption.

The right answer is the history of the second script, never killed.
"""

import numpy as np
from recorded import TIMES, WAY, compare, resumed

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials, meshing
from dolfinx_contact.evolution import QuasiStatic


def make(comm, left, right):
    parts = [
        mesh.create_rectangle(
            comm, [(0.0, low), (1.0, low + 0.5)], (3, 1), mesh.CellType.quadrilateral
        )
        for low in (0.0, 0.5)
    ]
    domain = meshing.join(parts).mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved, none = (fem.Function(V) for _ in range(3))

    def face(height, above):
        """Facets at a height, of the cells above it or below it."""
        found = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))
        domain.topology.create_connectivity(1, 2)
        cells = [domain.topology.connectivity(1, 2).links(f)[0] for f in found]
        middles = mesh.compute_midpoints(domain, 2, np.array(cells, dtype=np.int32))
        return found[(middles[:, 1] > height) == above]

    held = [
        fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, face(1.0, False))),
        fem.dirichletbc(none, fem.locate_dofs_topological(V, 1, face(0.0, True))),
    ]
    gap = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    gap.interpolate(lambda x: left + (right - left) * x[0])
    pair = ContactPair(
        u, face(0.5, True), master_facets=face(0.5, False), law=Coulomb(0.3), gap=gap
    )
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=held)

    def load(t):
        x, y = (np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        moved.interpolate(lambda p: np.stack([x + 0 * p[0], 2 * y + 0 * p[0]]))

    return QuasiStatic(problem, load)


def attack(case):
    found = resumed(
        case.comm,
        lambda: make(case.comm, 0.0, 0.01),
        lambda: make(case.comm, 0.01, 0.0),
        TIMES,
    )
    compare(case, found, make(case.comm, 0.01, 0.0).run(TIMES))
