"""The gap of a pair follows a Constant between solves; then another gap is set in its place.

Two blocks of the height 1 and nu = 0 are springs in series: the pressure is E (d - gap)/2.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials, meshing


def _pair(case):
    upper = block(case.comm, (2, 1), cell="quadrilateral")
    lower = block(case.comm, (2, 1), cell="quadrilateral")
    upper.domain.geometry.x[:, 1] += 1.0
    both = meshing.join([upper.domain, lower.domain])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V), fem.Function(V)

    def cells_of(tag):
        return both.cell_tags.find(tag)

    def face(height, above):
        facets = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))
        domain.topology.create_connectivity(1, 2)
        to_cells = domain.topology.connectivity(1, 2)
        mine = set(cells_of(1 if above else 2))
        return np.array([f for f in facets if to_cells.links(f)[0] in mine], dtype=np.int32)

    gap = fem.Constant(domain, 0.0)
    pair = ContactPair(
        u,
        face(1.0, True),
        master_facets=face(1.0, False),
        law=Coulomb(0.1),
        gap=gap,
    )
    held = [
        fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, face(2.0, True))),
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, face(0.0, False)), V),
    ]
    moved.interpolate(lambda x: np.outer((0.0, -0.01), x[1] > 1.5))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=held)
    return gap, pair, problem


def _through(case, gap, problem):
    for size in (0.0, 0.004, 0.02, 0.006):
        gap.value = size
        force = problem.solve().resultants["contact"][1]
        case.equal(f"force at a gap of {size}", force, 500.0 * max(0.0, 0.01 - size))


def attack(case):
    gap, pair, problem = _pair(case)
    _through(case, gap, problem)
    pair.gap = 0.008
    case.equal("force at another gap", problem.solve().resultants["contact"][1], 1.0)


def honest(case):
    gap, _, problem = _pair(case)
    _through(case, gap, problem)
