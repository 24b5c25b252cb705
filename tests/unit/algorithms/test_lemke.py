"""Lemke's method: on random reduced problems, and as the last strategy of a solve."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.algorithms import (
    RayTermination,
    coulomb_by_lemke,
    lemke,
)
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


def violation(w, S, p, friction, bound=0.0):
    """Largest violation of equilibrium, Signorini's conditions and Coulomb's law, relative."""
    ut, un, rt, rn = w.T
    length = np.abs(np.linalg.solve(S, p)).max() or 1.0
    force = np.abs(p).max() or 1.0
    a = w[:, :2].reshape(-1)
    r = w[:, 2:].reshape(-1)
    radius = friction * rn + bound
    return max(
        np.abs(S @ a - r - p).max() / force,
        max(-un.min(), 0) / length,
        max(-rn.min(), 0) / force,
        np.abs(un * rn).max() / (length * force),
        np.maximum(np.abs(rt) - radius, 0).max() / force,
        np.abs(rt * np.abs(ut) + radius * ut).max() / (length * force),
    )


def random_problem(rng):
    m = rng.integers(1, 13)
    G = rng.standard_normal((2 * m, 2 * m))
    S = G @ G.T + 0.05 * np.eye(2 * m) if rng.random() < 0.5 else G @ G.T / m + 0.5 * np.eye(2 * m)
    return S, rng.standard_normal(2 * m), rng.uniform(0, 20, m) * (rng.random(m) < 0.9)


@pytest.mark.verifies(
    "Lemke",
    reference="independent code: the violation of the law, in numpy",
    aspects=("2D",),
    alone=True,
)
def test_lemke_solves_random_problems():
    """With friction up to 20 there is neither a ray nor a cycle, and the result is a solution."""
    rng = np.random.default_rng(7)
    for number in range(1000):
        S, p, friction = random_problem(rng)
        if number % 4 == 0:
            p = np.round(p)  # many ties
        w, _ = coulomb_by_lemke(S, p, friction)
        assert violation(w, S, p, friction) < 1e-10


def test_lemke_solves_trescas_law():
    rng = np.random.default_rng(8)
    for _ in range(200):
        S, p, friction = random_problem(rng)
        bound = rng.uniform(0, 1, len(friction))
        w, _ = coulomb_by_lemke(S, p, friction, bound=bound)
        assert violation(w, S, p, friction, bound) < 1e-10


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_lemke_does_not_depend_on_units(scale):
    rng = np.random.default_rng(9)
    S, p, friction = random_problem(rng)
    one, pivots = coulomb_by_lemke(S, p, friction)
    other, same = coulomb_by_lemke(scale * S, scale**2 * p, friction)
    assert pivots == same
    np.testing.assert_allclose(other[:, :2], scale * one[:, :2], atol=1e-12 * scale)


def test_lemke_solves_without_contact():
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    for p in (np.zeros(2), S @ np.array([0.3, 0.2])):
        (w,), _ = coulomb_by_lemke(S, p, np.array([3.0]))
        np.testing.assert_allclose(w, [*np.linalg.solve(S, p), 0, 0], atol=1e-14)


@pytest.mark.ranks(2)
def test_lemke_refuses_indefinite_and_spatial_problems():
    S = np.eye(2)
    p = np.array([0.0, -1.0])
    F = np.array([0.3])
    for bad in (
        (np.array([[1.0, 2.0], [2.0, 1.0]]), p, F),
        (S, np.array([np.nan, 0.0]), F),
        (S, p, np.array([-0.1])),
    ):
        with pytest.raises(ValueError, match=r"positive definite|not finite|negative"):
            coulomb_by_lemke(*bad)
    with pytest.raises(ValueError, match="in 3D"):
        coulomb_by_lemke(np.eye(3), np.array([0.0, 0.0, -1.0]), F)
    with pytest.raises(RayTermination, match="ray"):
        lemke(np.array([[-1.0]]), np.array([-1.0]))  # 0 <= -1 - z has no solution


def random_body(rng, friction):
    """A sheared and tilted body with a few contact nodes over a floor, gaps and loads at random.

    With it the solutions that the enumeration of all statuses finds.
    """
    n = rng.integers(1, 5)
    rows = rng.integers(1, 4)
    kind = mesh.CellType.triangle if rng.random() < 0.5 else mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(COMM, [[0.0, 0.0], [1.0, 1.0]], [n, rows], kind)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    bottom = facets(domain, 1, 0.0)
    sides = [facets(domain, 1, 1.0)]
    if rng.random() < 0.3:  # a second support, of which a corner may touch
        sides.append(facets(domain, 0, 1.0))
    held = [fem.locate_dofs_topological(V, 1, side) for side in sides]
    motion = np.array([rng.uniform(-0.1, 0.1), rng.uniform(-0.2, 0.15)])
    map_ = np.array([[rng.uniform(0.3, 3), rng.uniform(-1, 1)], [rng.uniform(-0.2, 0.2), 1.0]])
    domain.geometry.x[:, :2] = domain.geometry.x[:, :2] @ map_.T
    lowest = COMM.allreduce(float(domain.geometry.x[:, 1].min(initial=np.inf)), op=min)
    floor = HalfSpace((0.0, lowest - 0.05 + 0.1 * rng.random()), (rng.uniform(-0.3, 0.3), 1.0))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    force = fem.Constant(domain, rng.uniform(-30, 30, 2))
    work = LinearElastic.from_young(100.0, rng.uniform(-0.2, 0.45)).energy(u) - ufl.dot(force, u)
    bcs = [fem.dirichletbc(motion, dofs, V) for dofs in held]
    return ContactProblem(work * ufl.dx, u, [surface], bcs=bcs)


def check_random_body(seed):
    """Solve, looking for the solution among all solutions; return the successful strategy."""
    rng = np.random.default_rng(seed)
    problem = random_body(rng, friction=rng.choice([0.0, 0.5, 2.0, 5.0]))
    try:
        result = problem.solve()
    except ValueError as error:
        if "into the obstacle" in str(error):  # a clamped corner that the floor is in
            return "refused"
        raise
    system = ParametricContact(problem)
    x = system.create_vector()
    problem.write(x)
    solutions = find_solutions(system, [x], 0.0)
    away = []
    for other in solutions.found:
        problem.read(other.x)
        (table,) = (t for t in problem.solve().tables.values())
        mine = result.tables["contact"]
        force = max(np.abs(table.force).max(), 1e-6)
        away.append(
            max(
                np.abs(table.force - mine.force).max() / force,
                np.abs(table.ut - mine.ut).max() + np.abs(table.un - mine.un).max(),
            )
        )
    assert solutions.complete
    assert min(away) < 1e-7, seed
    return result.reason


@pytest.mark.parametrize("first", [0, pytest.param(15, marks=pytest.mark.long)])
def test_lemke_solves_random_bodies(first):
    found = [check_random_body(seed) for seed in range(first, first + 15)]
    assert sum(reason != "refused" for reason in found) > 9


def test_lemke_accepts_round_off_without_contact():
    """The load lifts the body without a tangential motion: no ray, no force."""
    S = np.array(
        [[5.535226292127968, 0.24491892261131346], [0.24491892261131346, 1.0476883877824614]]
    )
    (w,), _ = coulomb_by_lemke(S, S[1], np.array([0.4]))
    np.testing.assert_allclose(w, [0.0, 1.0, 0.0, 0.0], atol=1e-14)
