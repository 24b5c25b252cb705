"""Two bodies of different stiffness, one on the other, by their tags; each stress is the pressure.

Springs in series: 1000 and 3000 under a way of 0.01 carry 7.5. The shifted upper block is wider,
so that a vertex of one body is none of the other.
"""

import numpy as np
from a13_two_columns import GLASS, STEEL, one_is_refused, written
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, meshing


def attack(case):
    upper = block(case.comm, (3, 1), cell="quadrilateral")
    lower = block(case.comm, (2, 2), cell="quadrilateral")
    upper.domain.geometry.x[:, 1] += 1.0
    both = meshing.join([upper.domain, lower.domain])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V), fem.Function(V)
    domain.topology.create_connectivity(1, 2)
    to_cells = domain.topology.connectivity(1, 2)

    def face(height, tag):
        facets = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))
        mine = set(both.cell_tags.find(tag))
        return np.array([f for f in facets if to_cells.links(f)[0] in mine], dtype=np.int32)

    pair = ContactPair(u, face(1.0, 1), master_facets=face(1.0, 2), law=Frictionless())
    held = [
        fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, face(2.0, 1))),
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, face(0.0, 2)), V),
    ]
    moved.interpolate(lambda x: np.outer((0.0, -0.01), x[1] > 1.5))
    dx = ufl.Measure("dx", domain, subdomain_data=both.cell_tags)
    bulk = STEEL.energy(u) * dx(1) + GLASS.energy(u) * dx(2)
    problem = ContactProblem(bulk, u, [pair], bcs=held)
    problem.solve()
    stresses = {1: STEEL.full_stress(u), 2: GLASS.full_stress(u)}
    centres, found = written(case.comm, problem, stresses)
    expected = np.zeros_like(found)
    expected[:, :, 1, 1] = -7.5
    case.true("cells", len(centres) == 7)
    case.equal("stress", found, expected)
    one_is_refused(case, problem, STEEL.full_stress(u))
