"""Two cracks that cross in the middle of a square, or meet in a T, under uniform compression.

Closed cracks without friction in a square that is compressed evenly from all sides transmit the
pressure: u = -e x everywhere. Where cracks cross the package may refuse, and name the way.
"""

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials, meshing


def squeezed(case, arms):
    n = 4
    e = 0.01
    domain = mesh.create_unit_square(case.comm, n, n, mesh.CellType.quadrilateral)
    facets = []
    values = []
    for tag, on in enumerate(arms, start=1):
        found = mesh.locate_entities(domain, 1, on)
        facets.append(found)
        values.append(np.full(len(found), tag, dtype=np.int32))
    facets = np.concatenate(facets)
    values = np.concatenate(values)
    order = np.argsort(facets)
    tags = mesh.meshtags(domain, 1, facets[order], values[order])
    body = meshing.crack(domain, list(range(1, len(arms) + 1)), facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    held = fem.Function(V)
    held.interpolate(lambda x: -e * x[:2])
    rim = fem.locate_dofs_geometrical(
        V, lambda x: np.isclose(np.abs(x[0] - 0.5), 0.5) | np.isclose(np.abs(x[1] - 0.5), 0.5)
    )
    steel = materials.LinearElastic.from_young(1000.0, 0.3)
    pairs = [
        ContactPair(u, body, slave=t, master=f"{t}_opposite", law=Frictionless(), name=f"crack{t}")
        for t in range(1, len(arms) + 1)
    ]
    energy = steel.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, pairs, bcs=[fem.dirichletbc(held, rim)])
    result = problem.solve()
    right = fem.Function(V)
    right.interpolate(lambda x: -e * x[:2])
    case.equal("displacement", u.x.array, right.x.array, 1e-6)
    pressure = 1000.0 * e / (1 + 0.3) / (1 - 0.6)
    for pair in pairs:
        table = result.tables[pair.name]
        inner = table.letters != "d"
        case.equal(pair.name, table.pressure[inner], pressure + 0 * table.pressure[inner], 1e-6)


def middle(axis):
    other = 1 - axis

    def on(x):
        inside = (x[axis] > 0.2) & (x[axis] < 0.8)
        return np.isclose(x[other], 0.5) & inside

    return on


def attack(case):
    squeezed(case, [middle(0), middle(1)])


def honest(case):
    squeezed(case, [middle(0)])
