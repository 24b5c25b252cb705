"""Two rings on each other, one of whose energies has no weight; and a load of gamma without one.

With nu = 0 two rings of the same height in a row carry E d A / 2. The twin has all weights.
"""

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, ParametricContact, materials
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import circumference
from dolfinx_contact.meshing import join


def force(case, weights, load_weight):
    parts = [
        mesh.create_rectangle(
            case.comm,
            [np.array([1.0, y]), np.array([2.0, y + 1.0])],
            (2, 1),
            mesh.CellType.quadrilateral,
        )
        for y in (0.0, 1.0)
    ]
    body = join(parts)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    domain.topology.create_connectivity(1, 2)
    of_facet = domain.topology.connectivity(1, 2)
    between = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1.0))
    cells = [of_facet.links(f)[0] for f in between]
    upper = mesh.compute_midpoints(domain, 2, np.array(cells, dtype=np.int32))[:, 1] > 1.0
    steel = materials.Axisymmetric(materials.LinearElastic.from_young(1000.0, 0.0))
    gamma = fem.Constant(domain, 0.0)
    dx = ufl.Measure("dx", domain, subdomain_data=body.cell_tags)
    energy = sum(
        steel.energy(u) * (circumference(domain) if has else 1.0) * dx(tag)
        for tag, has in zip((1, 2), weights, strict=True)
    )
    around = circumference(domain) if load_weight else 1.0
    energy += 2.0 * gamma * u[1] * around * dx(2)
    ends = [
        fem.dirichletbc(
            np.array([0.0, way]),
            fem.locate_dofs_geometrical(V, lambda x, y=y: np.isclose(x[1], y)),
            V,
        )
        for y, way in ((0.0, 0.0), (2.0, -0.01))
    ]
    pair = ContactPair(
        u,
        between[upper],
        master_facets=between[~upper],
        law=Frictionless(),
        axisymmetric=True,
    )
    problem = ContactProblem(energy, u, [pair], bcs=ends)
    problem.solve()
    system = ParametricContact(problem, gamma)
    start = system.create_vector()
    problem.write(start)
    found = find_solutions(system, [start], 1.0)
    return [system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)]


# A weight of 2 per volume on the upper ring: half of it is carried by either end of it, and the
# lower ring gives way.
RIGHT = np.pi * 3.0 * (1000.0 * 0.01 + 2.0 / 2) / 2


def attack(case):
    for weights, load in (((True, False), True), ((False, True), True), ((True, True), False)):
        try:
            found = force(case, weights, load)
        except ValueError:
            found = [RIGHT]
        case.equal(f"force, weights {weights}, load {load}", found, [RIGHT])


def honest(case):
    case.equal("force", force(case, (True, True), True), [RIGHT])
