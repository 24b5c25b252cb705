"""Shakedown: closed forms, another linear program, theorems, counterexamples, a body, a demo."""

import itertools

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import linprog
from support.blocks import block
from support.demo_numbers import run
from support.space_problems import random_stiffness

from dolfinx_contact import Coulomb
from dolfinx_contact.algorithms import PointProblem
from dolfinx_contact.analysis import shakedown, wedging_friction
from dolfinx_contact.analysis.shakedown import shakedown_of
from dolfinx_contact.evolution import QuasiStatic


def points(S, friction):
    m = len(friction)
    dim = len(S) // m
    return PointProblem(S, np.zeros(dim * m), np.asarray(friction, dtype=float))


def planar(k_tt, k_tn, k_nn):
    """The stiffness of points in the plane from its blocks."""
    m = len(k_tt)
    S = np.zeros((2 * m, 2 * m))
    S[0::2, 0::2], S[0::2, 1::2], S[1::2, 0::2], S[1::2, 1::2] = (
        k_tt,
        k_tn,
        np.transpose(k_tn),
        k_nn,
    )
    return S


def random_case(rng, *, coupled=True, most=3):
    """Stiffness, friction, steady load and two corners, of points in the plane that are pressed."""
    m = int(rng.integers(2, most + 1))
    S = random_stiffness(m, rng, 20.0)[: 2 * m, : 2 * m]
    if not coupled:
        S = planar(S[0::2, 0::2], np.zeros((m, m)), S[1::2, 1::2])
    F = np.full(m, rng.uniform(0.2, 0.6))
    steady = np.tile([0.0, -1.0], m) + 0.2 * rng.normal(size=2 * m)
    return points(S, F), steady + 0.5 * rng.normal(size=(2, 2 * m)), steady


@pytest.mark.verifies(
    "shakedown",
    reference="closed form: two points whose slips press each other, by hand",
    aspects=("2D",),
    alone=True,
)
@pytest.mark.parametrize("c", [0.0, 0.5, -0.5])
def test_two_points_shake_down_as_by_hand(c):
    """A slip w of either presses the other by c w; a shear +-d acts on the first.

    k |w0| + f d <= F (N + c w1) and k |w1| <= F (N + c w0): w0 = 0, |w1| = F N / k.
    """
    k, F, N, d = 2.0, 0.4, 1.5, 0.3
    S = planar(k * np.eye(2), [[0.0, c], [c, 0.0]], 3.0 * np.eye(2))
    steady = np.array([0.0, -N, 0.0, -N])
    shear = np.array([d, 0.0, 0.0, 0.0])
    found = shakedown_of(points(S, [F, F]), steady + np.array([shear, -shear]), steady)
    np.testing.assert_allclose(found.factor, F * N / d * (1 + F * abs(c) / k), rtol=1e-9)
    assert found.complete
    assert found.theorem_holds == (c == 0)
    if c:
        np.testing.assert_allclose(found.slip[:, 0], [0.0, np.sign(c) * F * N / k], atol=1e-8)
        assert "about to slip" in str(found)


@pytest.mark.verifies(
    "shakedown",
    reference="closed form: one point, F N / d below its wedging friction k_t/|k|, else infinite",
    aspects=("2D",),
    alone=True,
)
@pytest.mark.parametrize("F", [0.5, 1.9, 2.1])
def test_one_point_shakes_down_to_its_closed_form(F):
    S = np.array([[2.0, -1.0], [-1.0, 2.0]])
    steady = np.array([0.0, -1.0])
    found = shakedown_of(points(S, [F]), np.add(steady, [[0.3, 0.0], [-0.3, 0.0]]), steady)
    np.testing.assert_allclose(found.factor, F / 0.3 if F < 2 else np.inf, rtol=1e-9)
    assert found.theorem_holds == (F < 2)
    if F < 2:
        assert {c.ending for c in found.cycles} == {"rest"}
    else:
        assert "every factor" in str(found)


@pytest.mark.verifies(
    "shakedown",
    reference="closed form: k_t - s^2/k_j of a point joined to one that slides freely",
    aspects=("2D",),
    alone=True,
)
@pytest.mark.parametrize("F", [0.6, 0.7])
def test_frictionless_neighbour_lowers_the_critical_friction(F):
    """It softens the other point, whose critical friction falls from 2.0/1.8 to 1.2/1.8."""
    S = np.array([[2.0, -1.8, 1.0], [-1.8, 4.0, 0.0], [1.0, 0.0, 1.25]])
    steady = np.array([0.0, -1.0, 0.0, -1.0])
    change = np.array([0.3, 0.1, 0.0, 0.0])
    loads = steady + np.array([change, -change])
    found = shakedown_of(points(block_diag(S, 3.0), [F, 0.0]), loads, steady, factor=1.5)
    assert found.theorem_holds == (F < 1.2 / 1.8)
    assert not (found.theorem_holds and found.broken)
    softer = np.array([[1.2, -1.8], [-1.8, 4.0]])
    alone = shakedown_of(points(softer, [F]), loads[:, :2], steady[:2], factor=1.5)
    assert alone.theorem_holds == found.theorem_holds
    np.testing.assert_allclose(found.factor, alone.factor, rtol=1e-9)


@pytest.mark.verifies(
    "shakedown",
    reference="closed form: F N over the radius of the circle about three shears",
    aspects=("3D",),
    alone=True,
)
def test_shears_in_space_shake_down_to_their_circle():
    """Slips move the centre of the shears: the least circle about them, of a scalene triangle."""
    S = random_stiffness(1, np.random.default_rng(1), 5.0)
    S[:2, 2] = S[2, :2] = 0.0
    shears = np.array([[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [0.3, 0.9, 0.0]])
    sides = [np.linalg.norm(shears[i] - shears[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    area = abs(np.cross(shears[1], shears[2])[2]) / 2
    radius = np.prod(sides) / (4 * area)
    steady = np.array([0.0, 0.0, -2.0])
    found = shakedown_of(points(S, [0.3]), steady + shears, steady)
    np.testing.assert_allclose([found.factor, found.upper], 0.3 * 2.0 / radius, rtol=1e-8)
    assert found.factor <= found.upper * (1 + 1e-9)
    assert {c.ending for c in found.cycles} == {"rest"}
    over = shakedown_of(points(S, [0.3]), steady + shears, steady, factor=1.05 * found.factor)
    assert {c.ending for c in over.cycles} == {"alternating slip"}


@pytest.mark.verifies(
    "shakedown",
    reference="closed form: a point that the steady load opens; its factors are two intervals",
    aspects=("2D",),
    alone=True,
)
def test_factors_need_not_begin_with_zero():
    """Open up to f = 1/2, closed from f = 1 on, at rest where 0.8 f <= F (f - 1) + F (2 f - 1)."""
    steady = np.array([0.0, 1.0])
    loads = steady + np.array([[0.4, -1.0], [-0.4, -2.0]])
    given = points(np.diag([2.0, 3.0]), [0.3])
    between = shakedown_of(given, loads, steady, factor=3.0)
    np.testing.assert_allclose(between.ranges, [(0.0, 0.5), (6.0, np.inf)], rtol=1e-8)
    assert between.factor == np.inf
    assert "up to the factor 0.5, and from the factor 6 on" in str(between)
    assert {c.ending for c in between.cycles} == {"alternating slip"}
    assert between.theorem_holds
    assert between.broken == ()
    beyond = shakedown_of(given, loads, steady)
    np.testing.assert_allclose(beyond.cycles[0].factor, 12.0)
    assert {c.ending for c in beyond.cycles} == {"rest"}


@pytest.mark.verifies(
    "shakedown",
    reference="closed form: a point without friction passes its shear on to another, q / k of it",
    aspects=("2D",),
    alone=True,
)
def test_points_without_friction_slide_freely():
    k, q, F, N, d = 2.0, 0.5, 0.4, 1.5, 0.3
    S = planar(np.array([[k, q], [q, k]]), np.zeros((2, 2)), 3.0 * np.eye(2))
    steady = np.array([0.0, -N, 0.0, -N])
    shear = np.array([0.0, 0.0, d, 0.0])
    loads = steady + np.array([shear, -shear])
    found = shakedown_of(points(S, [F, 0.0]), loads, steady)
    np.testing.assert_allclose(found.factor, F * N * k / (q * d), rtol=1e-9)
    assert found.theorem_holds
    assert {c.ending for c in found.cycles} == {"rest"}
    assert all(limit.startswith("point 0 is about to slip") for limit in found.limits)
    over = shakedown_of(points(S, [F, 0.0]), loads, steady, factor=1.05 * found.factor)
    assert {c.ending for c in over.cycles} == {"alternating slip"}
    free = shakedown_of(points(S, [0.0, 0.0]), loads, steady)
    assert free.factor == np.inf
    assert {c.ending for c in free.cycles} == {"rest"}


def test_a_smooth_point_in_space_opens_at_its_closed_form():
    """One point without friction: its pressure N vanishes where the factor is N / d."""
    steady = np.array([0.0, 0.0, -1.5])
    lift = np.array([0.1, 0.2, 0.3])
    loads = steady + np.array([np.zeros(3), lift])
    found = shakedown_of(points(np.diag([1.0, 2.0, 3.0]), [0.0]), loads, steady)
    np.testing.assert_allclose(found.ranges, [(0.0, 5.0)], rtol=1e-9)


def by_displacements(given, loads, steady):
    """The factor by another program: all displacements at all corners are unknowns."""
    S, F = given.S, given.friction
    m, K = given.number, len(loads)
    n = 2 * m
    unit = np.eye(n)
    best = -np.inf
    for opened in itertools.product([False, True], repeat=m):
        equal, value, upper, most = [], [], [], []

        def add(rows, rhs, k, form, load=0.0, factor=0.0):
            row = np.zeros(K * n + 1)
            row[k * n : (k + 1) * n] = form
            row[-1] = factor
            rows.append(row)
            rhs.append(load)

        for k, i in itertools.product(range(K), range(m)):
            t, o = 2 * i, 2 * i + 1
            apart = loads[k] - steady
            if opened[i]:
                for j in (t, o):
                    add(equal, value, k, S[j], steady[j], -apart[j])
                add(upper, most, k, -unit[o])
                continue
            add(equal, value, k, unit[o])
            for sign in (1, -1):
                form = sign * S[t] - F[i] * S[o]
                load = sign * steady[t] - F[i] * steady[o]
                add(upper, most, k, form, load, -(sign * apart[t] - F[i] * apart[o]))
            add(upper, most, k, -S[o], -steady[o], apart[o])
            if k:
                row = np.zeros(K * n + 1)
                row[k * n + t], row[t] = 1.0, -1.0
                equal.append(row)
                value.append(0.0)
        cost = np.append(np.zeros(K * n), -1.0)
        bounds = [(None, None)] * (K * n) + [(0, None)]
        lp = linprog(cost, np.array(upper), most, np.array(equal), value, bounds=bounds)
        if lp.status == 0:
            best = max(best, lp.x[-1])
    return best


@pytest.mark.verifies(
    "shakedown",
    reference="independent code: a program in all displacements, over all sets of open points",
    aspects=("2D",),
    alone=True,
)
def test_shakedown_agrees_with_another_program():
    rng = np.random.default_rng(2)
    for _ in range(12):
        given, loads, steady = random_case(rng)
        found = shakedown_of(given, loads, steady, cycles=1, steps=1, starts=0)
        np.testing.assert_allclose(found.factor, by_displacements(given, loads, steady), rtol=1e-7)


@pytest.mark.verifies(
    "shakedown",
    reference="theorem: without coupling cycles come to rest below the bound; none above",
    aspects=("2D",),
    alone=True,
)
@pytest.mark.parametrize("number", [4, pytest.param(8, marks=pytest.mark.long)])
def test_rest_below_the_bound_alone(number):
    rng = np.random.default_rng(3)
    kinds = set()
    for coupled in (False, True) * number:
        given, loads, steady = random_case(rng, coupled=coupled)
        below = shakedown_of(given, loads, steady, cycles=400, starts=3)
        if below.factor == np.inf:  # every corner presses more than it shears
            continue
        kinds |= {(coupled, c.ending) for c in below.cycles}
        above = shakedown_of(given, loads, steady, factor=1.02 * below.factor, cycles=50)
        assert all(c.lifts or c.ending != "rest" for c in above.cycles)
        if not coupled:
            assert below.theorem_holds
            assert {c.ending for c in below.cycles} == {"rest"}
            assert not below.broken
    assert (True, "alternating slip") in kinds


def pressed(friction, shear=0.002):
    """A block that is pressed down by its top, which moves to and fro; and its loads."""
    problem = block(n=2, cell="quad", law=Coulomb(friction), top=(0.0, -0.01))
    top = problem.bcs[0].g

    def at(x):
        def put():
            top.value[:] = (x, -0.01)

        return put

    return problem, [at(shear), at(-shear)], at(0.0)


@pytest.mark.verifies(
    "shakedown",
    reference="itself: cycles of the points are histories of the body",
    aspects=("2D",),
)
def test_body_shakes_down_like_its_points():
    problem, loads, steady = pressed(0.3)
    found = shakedown(problem, loads, steady=steady, factor=1.0, cycles=4, starts=0)
    (cycle,) = found.cycles
    assert wedging_friction(problem).friction > 0.3
    assert found.factor < np.inf
    other = shakedown(problem, loads, steady=steady, factor=2.0, cycles=1, starts=0)
    np.testing.assert_allclose(other.factor, found.factor, rtol=1e-9)

    def load(t):
        steady()
        problem.bcs[0].g.value[0] = np.interp(t % 2, [0, 1, 2], [0.002, -0.002, 0.002])

    n = 8 * cycle.number
    history = QuasiStatic(problem, load).run(np.linspace(0, 2 * cycle.number, n + 1))
    assert history.complete
    work = [step.energies.dissipated for step in history.steps]
    last = work[-1] - work[-9]
    np.testing.assert_allclose(cycle.dissipation[-1], last, rtol=1e-7, atol=1e-12)


@pytest.mark.ranks(2)
def test_shakedown_refuses_loads_and_factors():
    problem, loads, _ = pressed(0.3)
    with pytest.raises(ValueError, match="two functions"):
        shakedown(problem, loads[:1])
    with pytest.raises(ValueError, match="do not differ"):
        shakedown(problem, [loads[0], loads[0]])
    with pytest.raises(ValueError, match="ContactProblem"):
        shakedown(None, loads)
    for wrong in (dict(factor=-1.0), dict(cycles=0), dict(steps=1.5), dict(starts=-1)):
        with pytest.raises(ValueError, match="must be"):
            shakedown(problem, loads, **wrong)
    with pytest.raises(ValueError, match="steady"):
        shakedown(problem, loads, steady=3)

    shear = problem.bcs[0].g.value
    loads[0]()
    before = shear.copy()

    def failing():
        loads[1]()
        raise ZeroDivisionError("no load")

    with pytest.raises(ZeroDivisionError, match="no load"):
        shakedown(problem, [loads[0], failing])
    np.testing.assert_array_equal(shear, before)


@pytest.mark.long
def test_the_shakedown_demo_comes_to_rest(folder):
    names = run("shakedown", folder, n=4)
    assert names["theorem"] == {"pair": True, "floor": False}
    np.testing.assert_allclose(names["factors"]["pair"], 4.71273572, rtol=1e-6)
    np.testing.assert_allclose(names["factors"]["floor"], 4.37285334, rtol=1e-6)
    assert names["endings"]["pair"] == (["rest"], ["alternating slip"])
    assert names["endings"]["floor"] == (["alternating slip", "rest"], ["alternating slip"])
    assert wedging_friction(names["block"](True)[0]).friction == np.inf
    for name in ("pair", "floor"):
        assert (folder / "output" / "shakedown" / f"{name}.png").stat().st_size > 10_000


@pytest.mark.long
def test_cycles_below_the_bound_that_never_come_to_rest():
    """Among random points under two corners of a load; some do from other starts."""
    rng = np.random.default_rng(0)
    broken = []
    for _ in range(6):
        B = rng.normal(size=(4, 4))
        friction = rng.uniform(0.2, 0.6)
        points = PointProblem(B @ B.T / 4 + 0.3 * np.eye(4), np.zeros(4), np.full(2, friction))
        steady = np.array([0.0, -1.0, 0.0, -1.0]) + 0.2 * rng.normal(size=4)
        loads = steady + 0.5 * rng.normal(size=(2, 4))
        result = shakedown_of(points, loads, steady, cycles=200)
        if result.broken:
            finer = shakedown_of(points, loads, steady, cycles=200, steps=8)
            if len(finer.broken) == len(result.broken):
                broken.append(result)
    assert any(c.ending == "rest" for r in broken for c in r.cycles)
