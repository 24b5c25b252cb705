"""Fallback strategies of a solve: load increments, load following and Lemke's method."""

from unittest import mock

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import KINDS, block, facets, half_block, same_tables

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, Frictionless, HalfSpace
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.materials import NeoHookean
from dolfinx_contact.solvers import strategies

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


def solved_by(strategy, problem):
    """The result of one strategy alone.

    A strategy runs if those before it fail. Which problems make them fail changes whenever one of
    them improves, so that the others are left out here.
    """
    every = strategies.strategies
    with mock.patch.object(
        strategies, "strategies", lambda *a: [s for s in every(*a) if s[0] == strategy]
    ):
        result = problem.solve()
    assert [attempt.strategy for attempt in result.attempts] == [strategy]
    return result


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", [Coulomb(0.3), Coulomb(1.5)])
@pytest.mark.verifies("loads in increments", reference="itself: Newton's method", aspects=("2D",))
def test_increments_find_what_newton_finds(law):
    """Also where the body begins inside the obstacle, and from a state that is loaded already."""
    inside = HalfSpace((0.0, 0.005), (0.0, 1.0))
    tables = [solved_by("load increments", block(law=law, obstacle=inside)).tables["contact"]]
    tables.append(block(law=law, obstacle=inside).solve().tables["contact"])
    problem = block(law=law, obstacle=inside, top=(0.0, -0.005))
    problem.solve()
    (moved,) = problem.bcs
    moved.g.value[:] = (0.004, -0.01)
    tables.append(solved_by("load increments", problem).tables["contact"])
    known = tables[1]
    for table in tables:
        assert table.status == known.status
        np.testing.assert_allclose(table.force, known.force, atol=1e-9 * np.abs(known.force).max())


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


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("dim", "cell"),
    [pytest.param(*k, marks=pytest.mark.long) if k == (2, "tri") else k for k in KINDS],
)
@pytest.mark.verifies(
    "loads in increments",
    "Newton's method",
    reference="itself: Newton's method",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_load_following_finds_the_solution_of_newtons_method(dim, cell):
    """The same solution as by Newton's method."""
    followed = solved_by("load following", block(n=3, cell=cell))
    assert followed.kkt_violation < 1e-8
    same_tables(followed.tables["contact"], block(n=3, cell=cell).solve().tables["contact"], 1e-8)
    assert dim in (2, 3)


@pytest.mark.verifies(
    "loads in increments",
    reference="closed form: Hild's element beyond its folds",
    aspects=("2D",),
    alone=True,
)
def test_load_following_passes_a_fold():
    """Hild's element beyond its folds: from stick at gamma = 0 only separation is left at 1.

    With F = 2.5 under (-4 gamma, -1) the branch of stick ends in a fold at gamma = F / 4.
    """
    system = linear_triangle(1, 2.5, (4.0, 0.0), preload=(0.0, -1.0), comm=MPI.COMM_SELF)
    problem = system.problem
    system.set_parameter(0.0)
    problem.solve()
    assert problem.statuses[0].tolist().count(STICK) == 1
    system.set_parameter(1.0)
    result = solved_by("load following", problem)
    table = result.tables["contact"]
    assert table.letters[0] == "o"
    np.testing.assert_allclose(
        [table.ut[0, 0], table.un[0]],
        np.linalg.solve([[173.0, 91.0], [91.0, 173.0]], [-2.0, -0.5]),
        rtol=1e-8,
    )


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", [Coulomb(0.3), Coulomb(2.0), Frictionless()])
@pytest.mark.parametrize("cell", ["tri", "quad"])
@pytest.mark.verifies(
    "Lemke", "Newton's method", reference="itself: Newton's method", aspects=("2D",)
)
def test_lemkes_method_finds_the_solution_of_newtons(law, cell):
    found = solved_by("Lemke's method", block(n=4, cell=cell, law=law))
    assert found.reason == "Lemke's method"
    table, known = (r.tables["contact"] for r in (found, block(n=4, cell=cell, law=law).solve()))
    np.testing.assert_allclose(table.force, known.force, atol=1e-9 * np.abs(known.force).max())
    np.testing.assert_allclose(table.ut, known.ut, atol=1e-11)
    assert table.status == known.status


def test_lemkes_method_keeps_a_node_on_its_symmetry_plane():
    """A contact node that may move along the normal alone."""
    found = solved_by("Lemke's method", half_block())
    assert found.reason == "Lemke's method"
    table, known = (r.tables["contact"] for r in (found, half_block().solve()))
    np.testing.assert_allclose(table.force, known.force, atol=1e-9 * np.abs(known.force).max())
