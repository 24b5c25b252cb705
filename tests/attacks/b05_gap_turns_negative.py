"""A gap by a Constant that turns negative after the pair was made, with interference and without.

Two blocks of stiffness E (nu = 0), ends held: with an overlap d they are pressed by E d/2; bodies
that may not overlap refuse it.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials, meshing


def overlapped(case, interference, gaps):
    lower, upper = (block(case.comm, (2, 1), cell="quadrilateral") for _ in range(2))
    upper.domain.geometry.x[:, 1] += 1.0
    parts = []
    for part, y in ((lower, 1.0), (upper, 1.0)):
        found = mesh.locate_entities_boundary(part.domain, 1, lambda x, y=y: np.isclose(x[1], y))
        parts.append((part.domain, np.sort(found)))
    tags = [
        mesh.meshtags(domain, 1, found, np.full(len(found), k + 1, dtype=np.int32))
        for k, (domain, found) in enumerate(parts)
    ]
    body = meshing.join([lower.domain, upper.domain], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gap = fem.Constant(body.mesh, 0.0)
    pair = ContactPair(
        u,
        body.facet_tags,
        slave=2,
        master=1,
        law=Frictionless(),
        gap=gap,
        interference=interference,
    )
    ends = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 0) | np.isclose(x[1], 2))
    steel = materials.LinearElastic.from_young(100.0, 0.0)
    energy = steel.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair], bcs=[fem.dirichletbc(np.zeros(2), ends, V)])
    for value in gaps:
        gap.value = value
        force = problem.solve().resultants["contact"][1]
        case.equal(f"force with the gap {value}", force, max(0.0, -50.0 * value))


def attack(case):
    overlapped(case, True, (0.1, -0.01, 0.0, -0.02))
    overlapped(case, False, (0.1, 0.0, -0.01))


def honest(case):
    overlapped(case, True, (0.0, -0.01, 0.01))
