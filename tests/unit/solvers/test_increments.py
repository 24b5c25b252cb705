"""Loads in increments, budgets of strategies, and bodies turned inside out."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.materials import NeoHookean
from dolfinx_contact.solvers import ladder
from dolfinx_contact.solvers.history import Attempt
from dolfinx_contact.solvers.newton import Newton
from dolfinx_contact.solvers.strategies import raise_load

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(600.0, 400.0)


@pytest.mark.parametrize("cell", [pytest.param("tri", marks=pytest.mark.long), "quad"])
@pytest.mark.verifies(
    "loads in increments",
    "hyperelastic bodies",
    reference="itself: eight solves by hand",
    aspects=("2D",),
)
def test_a_block_pressed_to_a_third_of_its_height(cell):
    """One solve does what eight by hand do."""
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


def increments_alone(monkeypatch, problem):
    whole = ladder.strategies
    monkeypatch.setattr(
        ladder, "strategies", lambda *a: [r for r in whole(*a) if r[0] == "load increments"]
    )
    result = problem.solve()
    monkeypatch.undo()
    return result.tables["contact"]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", [Coulomb(0.3), Coulomb(1.5)])
@pytest.mark.verifies("loads in increments", reference="itself: Newton's method", aspects=("2D",))
def test_increments_find_what_newton_finds(law, monkeypatch):
    """Also where the body begins inside the obstacle, and from a state that is loaded already."""
    inside = HalfSpace((0.0, 0.005), (0.0, 1.0))
    tables = [increments_alone(monkeypatch, block(law=law, obstacle=inside))]
    tables.append(block(law=law, obstacle=inside).solve().tables["contact"])
    problem = block(law=law, obstacle=inside, top=(0.0, -0.005))
    problem.solve()
    (moved,) = problem.bcs
    moved.g.value[:] = (0.004, -0.01)
    tables.append(increments_alone(monkeypatch, problem))
    known = tables[1]
    for table in tables:
        assert table.status == known.status
        np.testing.assert_allclose(table.force, known.force, atol=1e-9 * np.abs(known.force).max())


@pytest.mark.ranks(2)
def test_the_load_is_what_it_was_after_a_failure(monkeypatch):
    problem = block(n=8, material=RUBBER, top=(0.3, -0.7), options={"snes_max_it": 2})
    x = problem.create_vector()
    attempt = Attempt("load increments", limit=10.0)
    with Newton(problem.equations, problem.linear_solver, "none", None) as solver:
        assert not raise_load(solver, x, attempt, 8)
    assert "of the load" in attempt.reason
    np.testing.assert_allclose(
        problem.equations.prescribed.values()[problem.equations.constraints.fixed].reshape(-1, 2)[
            :, 1
        ],
        -0.7,
    )


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
def test_a_seal(depth):
    """A soft body that starts deep in the obstacle: what failed first was not dear."""
    result = arch(depth).solve()
    assert sum(a.cost for a in result.attempts) < 150
    assert result.min_det_F > 0
    assert result.counts["open"] > 0


@pytest.mark.ranks(2)
def test_budgets():
    """A strategy gives up when its cost is used up; residuals alone cost as well."""
    attempt = Attempt("line search", limit=3.0)
    assert not attempt.gives_up()
    attempt.evaluations = 12
    assert attempt.cost == 3.0
    assert attempt.gives_up()
    assert "gave up" in attempt.reason
