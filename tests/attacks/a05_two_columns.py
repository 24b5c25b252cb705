"""Two columns under one lift, each with a snap-back of its own, one within the other's range.

Column i turns at a_i + s_i/k_i and a_i + b_i, while the other is elastic or broken; so the folds of
the path are those four loads, in the order of the first turns.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    BilinearCohesive,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
    meshing,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength

STRENGTH = 2.0
ELASTIC = 0.01
SOFTENING = 0.02


def followed(case, soft, stiff):
    one, two = (block(case.comm, (1, 1), cell="triangle").domain for _ in range(2))
    two.geometry.x[:, 0] += 2.0
    body = meshing.join([one, two])
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    moved = fem.Function(V)
    bottom, top = (
        mesh.locate_entities_boundary(body.mesh, 1, lambda x, y=y: np.isclose(x[1], y))
        for y in (0.0, 1.0)
    )
    left = ufl.SpatialCoordinate(body.mesh)[0] < 1.5
    k = ufl.conditional(left, soft, stiff)
    energy = k / 2 * ufl.dot(u.dx(1), u.dx(1)) * ufl.dx
    law = BilinearCohesive(STRENGTH, ELASTIC, SOFTENING)
    contact = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    others = fem.locate_dofs_geometrical(
        V, lambda x: np.isclose(x[1], 0) & (np.isclose(x[0], 1) | np.isclose(x[0], 3))
    )
    bcs = [
        fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, top)),
        fem.dirichletbc(np.zeros(2), others, V),
    ]
    problem = ContactProblem(energy, u, [contact], bcs=bcs)
    gamma = fem.Constant(body.mesh, 0.0)
    system = ParametricContact(problem, gamma, driven=[(moved, ufl.as_vector((0, gamma)))])
    control = StepControl(initial=0.05, maximum=0.1)
    history = ArcLength(system).run(gamma_range=(0.0, 0.15), control=control)
    expected = []
    for stiffness in (stiff, soft):
        expected += [ELASTIC + STRENGTH / stiffness, ELASTIC + SOFTENING]
    case.unpromised(f"not complete: {history.reason}", not history.complete)
    case.equal("folds", [p.gamma for p in history.folds], expected, 1e-6)
    table = history.steps[-1].result.tables["contact"]
    free = np.isclose(table.x[:, 0], 0) | np.isclose(table.x[:, 0], 2)
    case.equal("opening at the end", table.un[free], [0.15] * 2)


def attack(case):
    followed(case, 20.0, 40.0)
