"""Two blocks, one on the other, and beside them a spring that the upper one meets after a way c.

Each of modulus E and height 1, the lower one held below, the upper one pressed by d from above.
The spring pulls at the lower face of the upper one, whose way is b: E b = R on the lower block, and
E (d - b) + k (c - b) = R.
"""

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials, meshing


def attack(case):
    E = 1000.0
    K = 3000.0
    C = 0.002
    D = 0.01
    parts = [
        mesh.create_rectangle(
            case.comm,
            [np.array([0.0, y]), np.array([1.0, y + 1.0])],
            (2, 1),
            mesh.CellType.quadrilateral,
        )
        for y in (0.0, 1.0)
    ]
    body = meshing.join(parts)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    domain.topology.create_connectivity(1, 2)
    of_facet = domain.topology.connectivity(1, 2)
    between = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1.0))
    cells = np.array([of_facet.links(f)[0] for f in between], dtype=np.int32)
    is_upper = mesh.compute_midpoints(domain, 2, cells)[:, 1] > 1.0
    slave = between[is_upper]
    master = between[~is_upper]
    ends = [
        fem.dirichletbc(
            np.array([0.0, way]),
            fem.locate_dofs_geometrical(V, lambda x, y=y: np.isclose(x[1], y)),
            V,
        )
        for y, way in ((0.0, 0.0), (2.0, -D))
    ]
    tags = mesh.meshtags(domain, 1, np.sort(slave), np.full(len(slave), 7, dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)
    steel = materials.LinearElastic.from_young(E, 0.0)
    sunk = ufl.max_value(-u[1] - C, 0.0)
    energy = steel.energy(u) * ufl.dx + K / 2 * sunk**2 * ds(7)
    pair = ContactPair(u, slave, master_facets=master, law=Frictionless())
    problem = ContactProblem(energy, u, [pair], bcs=ends)
    result = problem.solve()
    b = (E * D + K * C) / (2 * E + K)
    case.equal("force", result.resultants["contact"][1], E * b, 1e-6)
    case.true("not called the only one without a proof", result.unique in ("proved", "not proved"))
