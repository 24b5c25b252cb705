"""The smallest friction that wedges: closed forms, enumeration, a table, a demo."""

import itertools

import cases.wedging
import numpy as np
import pytest
from cases._triangle import linear_triangle, reduced
from scipy.optimize import brentq, linprog
from support.space_problems import random_stiffness

from dolfinx_contact.algorithms import PointProblem
from dolfinx_contact.analysis import critical_friction, wedging_friction
from dolfinx_contact.analysis.wedging import wedging_of

TABLE = {
    (1.0, 1.0): {1: 2.0, 2: 11 / 6, 4: 1.70689477},
    (100.0, 82.0): {1: 1.901099, 2: 1.736633, 4: 1.64042448},
}


def points(S, dim):
    m = len(S) // dim
    return PointProblem(S, np.zeros(dim * m), np.ones(m))


def check_state(found, S, dim):
    """S u = r, un rn = 0, the cone with the coefficient, and the letters."""
    state = found.state
    u, r = state[:, :dim], state[:, dim:]
    size = np.abs(r).max()
    np.testing.assert_allclose(S @ u.reshape(-1), r.reshape(-1), atol=1e-9 * size)
    un, rn = u[:, -1], r[:, -1]
    assert abs(rn.sum() - 1) < 1e-9
    assert un.min() >= -1e-9 * np.abs(u).max()
    assert rn.min() >= -1e-9
    assert np.abs(un * rn).max() <= 1e-9 * np.abs(u).max()
    shear = np.linalg.norm(r[:, :-1], axis=1)
    assert (shear <= found.friction * rn + 1e-8).all()
    letters = np.array(list(found.statuses))
    assert (rn[letters == "o"] <= 1e-9).all()
    assert (np.abs(un[letters == "c"]) <= 1e-9 * np.abs(u).max()).all()


@pytest.mark.verifies(
    "critical friction",
    reference="closed form: kt/|k| of one node, and 1/|A^-1 k| in 3D",
    aspects=("2D", "3D", "proofs"),
    alone=True,
)
def test_one_node_wedges_at_its_closed_form():
    rng = np.random.default_rng(0)
    for _ in range(20):
        S = random_stiffness(1, rng, 20.0)
        flat = S[1:, 1:]
        found = wedging_of(points(flat, 2))
        assert found.complete
        np.testing.assert_allclose(found.friction, flat[0, 0] / abs(flat[0, 1]), rtol=1e-8)
        assert found.lower <= found.friction <= found.lower * (1 + 2e-7)
        check_state(found, flat, 2)
        known = 1 / np.linalg.norm(np.linalg.solve(S[:2, :2], S[2, :2]))
        for sides in (8, 32):
            found = wedging_of(points(S, 3), sides=sides)
            assert found.complete
            assert found.lower <= known * (1 + 1e-9)
            assert known <= found.friction * (1 + 1e-9)
            assert found.friction <= found.lower / np.cos(np.pi / sides) * (1 + 1e-6)
            check_state(found, S, 3)


def by_enumeration(S):
    """The least F over all pairs of open and closed points, by bisection, in displacements."""
    m = len(S) // 2
    best = np.inf
    for closed in itertools.product([False, True], repeat=m):
        closed = np.array(closed)
        if not closed.any() or not is_wedged(S, closed, 1e3):
            continue
        low, high = 0.0, min(best, 1e3)
        if not is_wedged(S, closed, high):
            continue
        while high - low > 1e-9 * high:
            middle = (low + high) / 2
            low, high = (low, middle) if is_wedged(S, closed, middle) else (middle, high)
        best = min(best, high)
    return best


def is_wedged(S, closed, friction):
    """Whether there is a state, with displacements as the unknowns of a linear program."""
    m = len(closed)
    rt, rn = S[0::2], S[1::2]
    none = np.concatenate([S[0::2][~closed], S[1::2][~closed], np.eye(2 * m)[1::2][closed]])
    equal = np.vstack([none, rn[closed].sum(axis=0)])
    value = np.append(np.zeros(len(none)), 1.0)
    cone = [sign * rt[closed] - friction * rn[closed] for sign in (1, -1)]
    upper = np.vstack([*cone, -np.eye(2 * m)[1::2][~closed], -rn[closed]])
    found = linprog(np.zeros(2 * m), upper, np.zeros(len(upper)), equal, value, bounds=(None, None))
    return found.status == 0


@pytest.mark.parametrize("number", [8, pytest.param(100, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "critical friction",
    reference="enumeration: all open and closed points, by bisection",
    aspects=("2D", "proofs"),
    alone=True,
)
def test_random_stiffnesses_wedge_as_enumerated(number):
    rng = np.random.default_rng(1)
    several = 0
    for _ in range(number):
        m = int(rng.integers(2, 5))
        S = random_stiffness(2 * m, rng, 50.0)[: 2 * m, : 2 * m]
        found = wedging_of(points(S, 2))
        assert found.complete
        np.testing.assert_allclose(found.friction, by_enumeration(S), rtol=1e-6)
        check_state(found, S, 2)
        several += "o" in found.statuses
    assert several > 0


@pytest.mark.parametrize("lame", list(TABLE))
@pytest.mark.verifies(
    "critical friction",
    reference="independent code: the triangle of Hild with 1, 2 and 4 contact nodes",
    aspects=("2D", "proofs"),
)
def test_triangle_wedges_as_tabulated(lame):
    for n, expected in TABLE[lame].items():
        problem = linear_triangle(n, 0.5, lame=lame).problem
        found = wedging_friction(problem)
        assert found.complete
        np.testing.assert_allclose(found.friction, expected, rtol=4e-7 if n < 4 else 5e-9)
        sliding = abs(critical_friction(problem).friction)
        if n <= 2:
            np.testing.assert_allclose(found.friction, sliding, rtol=1e-8)
        else:
            assert found.friction < 0.98 * sliding
            assert found.statuses == {1.0: "cooc", 100.0: "cocc"}[lame[0]]
        assert "proved" in str(found)


@pytest.mark.long
@pytest.mark.verifies(
    "critical friction",
    reference="closed form: load over force of the last piece before the body is free",
    aspects=("2D",),
)
def test_the_wedging_demo_moves_above_its_coefficient(folder):
    """Just below the coefficient the body is free without load, just above a pull frees it."""
    summary = cases.wedging.main(["--n", "4", "--output", str(folder)])
    np.testing.assert_allclose(summary["wedging"], 1.64042448, rtol=5e-9)
    assert summary["complete"]
    assert summary["statuses"] == "cocc"
    assert summary["levels"][-1]["renard"] < summary["wedging"] < summary["levels"][-1]["sliding"]
    below, above, far = summary["branches"]
    assert np.abs(below["unloaded"]).max() < 1e-9 * below["loaded"]
    assert below["pulled"] == 0.0
    assert far["pulled"] < 100 * above["pulled"] < 0
    for branch in (above, far):
        rn, rt = branch["unloaded"]
        assert 0.1 * branch["loaded"] < rn < branch["loaded"]
        assert 0 < rt <= branch["friction"] * rn * (1 + 1e-9)
    points = reduced(4, 1.0, cases.wedging.LOAD, (100.0, 82.0))
    closed = np.array(list(summary["statuses"])) == "c"
    for branch in (below, above):
        expected = load_over_force(branch["friction"], points, closed)
        assert branch["load_over_force"] == pytest.approx(expected, rel=1e-8)
    sign = brentq(load_over_force, below["friction"], above["friction"], args=(points, closed))
    assert sign == pytest.approx(summary["wedging"], rel=1e-9)
    for name in ("state", "coefficients", "branches", "branches_without_load"):
        assert (folder / f"{name}.png").stat().st_size > 10_000


def load_over_force(friction, points, closed):
    """Return load over force where all closed points slip to the left: load 1 over sum rn."""
    at = np.kron(np.diag(closed.astype(float)), [[0.0, friction], [0.0, 1.0]])
    free = np.kron(np.diag(1.0 - closed), np.eye(2)) + np.kron(np.diag(closed), [[1, 0], [0, 0]])
    # S a = r + p with a = free z, r = at z.
    z = np.linalg.solve(points.S @ free - at, points.p)
    return 1 / z[1::2][closed].sum()


@pytest.mark.parametrize("contrast", [1.0, 1e3, 1e6, 1e9])
@pytest.mark.verifies(
    "critical friction",
    reference="theorem: displacements and forces of a point may have a unit of their own",
    aspects=("2D", "3D", "proofs"),
    alone=True,
)
def test_wedging_does_not_depend_on_scales_of_points(contrast):
    """Cones have no unit: D S D has the coefficient of S; closed forms of one point and two."""
    one = np.array([[2.0, 0.5], [0.5, 2.0]])
    other = contrast * np.array([[2.0, 1.0], [1.0, 2.0]])
    apart = np.zeros((4, 4))
    apart[:2, :2] = one
    apart[2:, 2:] = other
    assert wedging_of(points(other, 2)).friction == pytest.approx(2.0, rel=1e-9)
    found = wedging_of(points(apart, 2))
    assert found.friction == pytest.approx(2.0, rel=1e-9)
    assert found.complete
    rng = np.random.default_rng(3)
    for dim, number in ((2, 3), (3, 2)):
        B = rng.normal(size=(dim * number, dim * number))
        S = B @ B.T + np.eye(len(B))
        scales = np.repeat(contrast ** rng.uniform(-0.5, 0.5, number), dim)
        plain = wedging_of(points(S, dim), sides=8)
        scaled = wedging_of(points(scales[:, None] * S * scales, dim), sides=8)
        assert plain.complete
        assert scaled.complete
        assert scaled.friction == pytest.approx(plain.friction, rel=1e-6)
        assert scaled.lower == pytest.approx(plain.lower, rel=1e-6)
