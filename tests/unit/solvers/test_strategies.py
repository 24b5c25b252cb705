"""Fallback strategies of a solve: load increments, load following, Lemke's method."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import block, facets, same_tables

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.materials import NeoHookean

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(600.0, 400.0)


@pytest.mark.parametrize("cell", [pytest.param("tri", marks=pytest.mark.long), "quad"])
@pytest.mark.verifies(
    "loads in increments",
    "hyperelastic bodies",
    reference="itself: eight solves by hand",
    aspects=("2D",),
)
def test_one_solve_presses_a_block_to_a_third(cell):
    """One solve reaches the state of eight increments."""
    problem = block(n=8, cell=cell, material=RUBBER, top=(0.3, -0.7))
    result = problem.solve()
    assert result.reason == "load increments"
    assert [a.strategy for a in result.attempts] == ["full steps", "load increments"]
    assert result.kkt_violation < 1e-8
    found = problem.u.x.array.copy()
    problem.u.x.array[:] = 0.0
    problem.surfaces[0].multiplier.x.array[:] = 0.0
    (moved,) = problem.bcs
    for part in range(1, 9):
        moved.g.value[:] = part / 8 * np.array([0.3, -0.7])
        problem.solve()
    np.testing.assert_allclose(problem.u.x.array, found, atol=1e-8)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "iterations", "strategy"),
    [
        ("tri", 3, "load increments"),
        ("tri", 1, "load following"),
        pytest.param("hex", 1, "load following", marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "loads in increments",
    "Newton's method",
    reference="itself: Newton's method",
    aspects=("2D", "3D"),
)
def test_fallbacks_with_few_iterations_find_the_solution_of_newtons_method(
    cell, iterations, strategy
):
    """A block that begins inside the obstacle, and a limit of the Newton steps of one attempt."""
    dim = 2 if cell == "tri" else 3
    up = np.eye(dim)[-1]
    given = {
        "cell": cell,
        "n": 5 - dim,
        "material": RUBBER,
        "top": 0.1 * np.eye(dim)[0] - 0.2 * up,
        "obstacle": HalfSpace(0.05 * up, up),
    }
    few = block(**given, options={"snes_max_it": iterations}).solve()
    assert few.reason == strategy
    assert few.kkt_violation < 1e-8
    whole = block(**given).solve()
    assert whole.reason == "full steps"
    same_tables(few.tables["contact"], whole.tables["contact"], 1e-8)


def arch(depth):
    """A half ring of rubber, nearly incompressible (Mooney-Rivlin), under a rigid lid."""
    domain = mesh.create_rectangle(
        COMM, [[0.0, 0.0], [1.0, 1.0]], [24, 3], mesh.CellType.quadrilateral
    )
    x = domain.geometry.x
    angle = np.pi * (1 - x[:, 0])
    radius = 0.8 + 0.2 * x[:, 1]
    x[:, :2] = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    V = fem.functionspace(domain, ("Lagrange", 2, (2,)))
    u = fem.Function(V)
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    C = F.T * F
    first = ufl.tr(C) + 1
    second = (first**2 - ufl.tr(C * C) - 1) / 2
    energy = 0.4 * (J ** (-2 / 3) * first - 3) + 0.1 * (J ** (-4 / 3) * second - 3)
    energy += 25 * (J - 1) ** 2
    outer = mesh.locate_entities_boundary(
        domain, 1, lambda x: (np.hypot(x[0], x[1]) > 0.98) & (x[1] > 0.2)
    )
    lid = HalfSpace((0.0, 1.0 - depth), (0.0, -1.0))
    surface = ContactSurface(u, outer, obstacle=lid, law=Coulomb(0.5))
    feet = fem.locate_dofs_topological(V, 1, facets(domain, 1, 0.0))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    return ContactProblem(energy * dx, u, [surface], bcs=[fem.dirichletbc(np.zeros(2), feet, V)])


@pytest.mark.parametrize("depth", [0.1, 0.5])
def test_soft_seal_is_solved_from_a_deep_start(depth):
    """A soft body starts deep in the obstacle, and the first attempts fail quickly."""
    result = arch(depth).solve()
    assert sum(a.cost for a in result.attempts) < 150
    assert result.min_det_F > 0
    assert result.counts["open"] > 0


@pytest.mark.verifies(
    "Lemke",
    reference="closed form: Hild's element beyond its folds",
    aspects=("2D",),
    alone=True,
)
def test_a_solve_beyond_the_folds_finds_separation_by_lemkes_method():
    """Hild's element beyond its folds: from stick at gamma = 0 only separation is left at 1.

    With F = 2.5 under (-4 gamma, -1) the branch of stick ends in a fold at gamma = F / 4.
    """
    system = linear_triangle(1, 2.5, (4.0, 0.0), preload=(0.0, -1.0), comm=MPI.COMM_SELF)
    problem = system.problem
    system.set_parameter(0.0)
    problem.solve()
    assert problem.statuses[0].tolist().count(STICK) == 1
    system.set_parameter(1.0)
    result = problem.solve()
    assert result.reason == "Lemke's method"
    table = result.tables["contact"]
    assert table.letters[0] == "o"
    np.testing.assert_allclose(
        [table.ut[0, 0], table.un[0]],
        np.linalg.solve([[173.0, 91.0], [91.0, 173.0]], [-2.0, -0.5]),
        rtol=1e-8,
    )
