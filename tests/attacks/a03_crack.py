"""A block that is cut through as a crack, and its upper half moved off the lower one.

After a width and a fifth nothing is below, and the force is zero. All nodes match.
"""

import numpy as np
from a03_off_the_edge import doubted

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials, meshing


def attack(case):
    domain = mesh.create_unit_square(case.comm, 3, 2)
    cut = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    tags = mesh.meshtags(domain, 1, np.sort(cut), np.full(len(cut), 7, dtype=np.int32))
    body = meshing.crack(domain, [7], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    bcs = []
    for y, value in ((0.0, (0.0, 0.0)), (1.0, (1.2, -0.02))):
        face = mesh.locate_entities_boundary(body.mesh, 1, lambda x, y=y: np.isclose(x[1], y))
        dofs = fem.locate_dofs_topological(V, 1, face)
        bcs.append(fem.dirichletbc(np.array(value), dofs, V))
    steel = materials.LinearElastic.from_young(1.0, 0.0)
    pair = ContactPair(u, body, slave=7, master="7_opposite", law=Coulomb(0.1))
    result = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=bcs).solve()
    case.equal("force", result.resultants["contact"], [0.0, 0.0])
    doubted(case, result)
