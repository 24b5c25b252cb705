"""Bounds of the proof checker in closed form, and the smallest false claims.

Data have errors far above round-off, so that the exact bound is a number: the worst case over all
data within the errors. A step claiming slightly more than is true is refused. A step that claims
slightly less is accepted.
"""

import itertools
from fractions import Fraction
from operator import add, mul, sub, truediv

import numpy as np
import pytest

from dolfinx_contact.proofs import Certificate, InvalidCertificate, ReducedProblem, check
from dolfinx_contact.proofs.check_proof import (
    Ball,
    Dual,
    SpaceRegion,
    StatusRegion,
    hypot,
    least_eigenvalue,
    positive_definite,
    solve_in_space,
    solve_piece,
    solved,
)

#: One node with an open state, a stick and a slip to the left, in scaled units.
THREE = (np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-2.5, -1.0]), np.array([3.0]))


def taken(problem, steps, vectors=()):
    try:
        return check(Certificate(problem, steps, [np.array(y, dtype=float) for y in vectors]))
    except InvalidCertificate:
        return None


@pytest.mark.parametrize(("A", "b", "dA", "db"), [(2, 1, 0.5, 0.25), (-4, 3, 1, 0), (8, -2, 0, 1)])
def test_one_equation_is_solved_sharply(A, b, dA, db):
    """|b / A - z| is largest where A is smallest and b largest."""
    one = np.ones(1)
    z = solved(Ball(A * np.eye(1), dA * np.eye(1)), Ball(b * one, db * one))
    assert z.value[0] == b / A
    assert z.radius[0] == pytest.approx((abs(b) + db) / (abs(A) - dA) - abs(b / A), rel=1e-6)
    assert solved(Ball(A * np.eye(1), abs(A) * np.eye(1)), Ball.of(b * one)) is None
    assert solved(Ball.of(np.zeros((1, 1))), Ball(one, one)) is None


@pytest.mark.parametrize("scale", [1.0, 2.0**-20, 2.0**28])
def test_definiteness_is_proved_up_to_the_least_eigenvalue(scale):
    """[[1, c], [c, 1]] within e of its entries has eigenvalues from 1 - |c| - 2 e on."""
    D = np.diag([1.0, scale])
    full = np.ones((2, 2))
    for c in (0.5, -0.3, 0.0):
        Q = np.array([[1.0, c], [c, 1.0]])
        most = (1 - abs(c)) / 2
        assert positive_definite(D @ Q @ D, D @ full @ D * (most - 1e-8))
        assert not positive_definite(D @ Q @ D, D @ full @ D * (most + 1e-8))
    for bad in (np.nan, np.inf):
        assert not positive_definite(np.diag([1.0, bad]), np.zeros((2, 2)))
        assert not positive_definite(np.eye(2), np.diag([0.0, bad]))
    assert not positive_definite(np.diag([1.0, 0.0]), np.zeros((2, 2)))
    assert not positive_definite(np.diag([1.0, -1.0]), np.zeros((2, 2)))


def test_least_eigenvalues_are_bounded():
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert 0.8 < least_eigenvalue(S, np.zeros((2, 2))) < 1.0
    assert least_eigenvalue(S, np.full((2, 2), 0.6)) == 0.0
    assert least_eigenvalue(-S, np.zeros((2, 2))) == 0.0
    for bad, error in ((-S, None), (S, np.full((2, 2), 0.6)), (S * 0, None)):
        with pytest.raises(ValueError, match="not positive definite"):
            ReducedProblem(bad, np.ones(2), np.ones(1), None, error)


def test_intervals_hold_their_ends():
    """Computed ends enclose the real ones within units in the last place."""
    x = Ball(np.array([0.1, -0.7]), np.array([1e-17, 0.2]))
    assert (x.low < x.value - x.radius * 0.9999).all()
    assert (x.high > x.value + x.radius * 0.9999).all()
    assert (x.high - x.low < 2 * x.radius + 1e-14).all()


def test_a_bound_is_taken_down_to_the_truth():
    """One decoupled node pressed down has rn = 4, and any larger bound is accepted."""
    problem = ReducedProblem(np.diag([2.0, 4.0]), np.array([0.0, -4.0]), np.array([0.0]))
    scaled = problem.scaled
    rn = 4.0 / problem.units[1]
    y = np.array([0.0, -1.0])
    most = Dual(scaled, y).most(scaled.statuses, StatusRegion.whole(scaled).ub, 5, 0)
    assert most == pytest.approx(rn, rel=1e-8)
    assert most >= rn
    left = {"do": "pieces", "singular": []}
    for value, holds in ((rn * (1 + 1e-8), True), (rn * (1 - 1e-12), False), (np.nan, False)):
        step = {"do": "bound", "y": 0, "slot": 5, "point": 0, "value": value}
        proved = taken(problem, [step, left], [y])
        assert (proved is not None) == holds
        assert proved is None or len(proved.inside) == 1


def test_bounds_of_one_node_are_its_worst_cases():
    """A stick carries the load with its error; an open gap is p / S, at worst of all data."""
    S, dS = np.diag([2.0, 4.0]), np.diag([0.125, 0.25])
    p, dp = np.array([1.0, 3.0]), np.array([0.25, 0.4375])
    problem = ReducedProblem(S, p, np.array([0.5]), None, dS, dp)
    opened = solve_piece(problem, np.array([0], dtype=np.int8))
    np.testing.assert_allclose(opened.state, [[0.5, 0.75, 0, 0]])
    np.testing.assert_allclose(
        opened.away, [[1.25 / 1.875 - 0.5, 3.4375 / 3.75 - 0.75, 0, 0]], rtol=1e-6
    )
    down = ReducedProblem(S, np.array([0.25, -3.0]), np.array([0.5]), None, dS, dp)
    stuck = solve_piece(down, np.array([1], dtype=np.int8))
    np.testing.assert_allclose(stuck.state, [[0, 0, -0.25, 3]])
    np.testing.assert_allclose(stuck.away, [[0, 0, 0.25, 0.4375]], rtol=1e-6)
    plus, minus = stuck.slacks
    np.testing.assert_allclose([plus.low, plus.high], [[0.78125], [1.71875]], rtol=1e-6)
    np.testing.assert_allclose([minus.low, minus.high], [[1.28125], [2.21875]], rtol=1e-6)
    assert stuck.verdict == "inside"
    slip = solve_piece(down, np.array([2], dtype=np.int8))
    # S ut = rt + p with rt = -F rn: ut = (0.25 - 1.5) / 2, against its sense.
    np.testing.assert_allclose(slip.state, [[-0.625, 0, -1.5, 3]])
    assert slip.verdict == "outside"


def test_what_has_a_solution_is_not_excluded():
    """No vector excludes any of three solutions, and the leaf of their pieces has three."""
    problem = ReducedProblem(*THREE)
    pieces = {"do": "pieces", "singular": []}
    assert sorted(q.codes[0] for q in taken(problem, [pieces]).inside) == [0, 1, 3]
    for y in itertools.product((-2.0, -1.0, -0.3, 0.0, 0.3, 1.0, 2.0), repeat=2):
        assert taken(problem, [{"do": "empty", "y": 0}], [y]) is None
        for status in (0, 1, 3):
            step = {"do": "exclude", "y": 0, "what": [[0, status]]}
            assert taken(problem, [step, pieces], [y]) is None
    # The slip to the right needs ut > 0: S ut + F rn = p_t < 0 is against it.
    step = {"do": "exclude", "y": 0, "what": [[0, 2]]}
    tried = itertools.product(np.linspace(-3, 3, 25), repeat=2)
    assert any(taken(problem, [step, pieces], [y]) for y in tried)


def one_solution():
    """A decoupled node that sticks, and the uniqueness of it: dt et <= 0 and dn en <= 0."""
    problem = ReducedProblem(np.eye(2), np.array([0.1, -1.0]), np.array([0.5]))
    only = {"do": "only", "codes": [1], "weights": [1.0, 1.0], "theta": [0.0, 0.0], "mu": 0.0}
    return problem, only


def test_uniqueness_needs_what_it_says():
    """Weights that are not negative and make a definite form; |theta| up to 1 / F; a piece."""
    problem, only = one_solution()
    assert len(taken(problem, [only]).inside) == 1
    for change, holds in (
        ({"weights": [0.0, 1.0]}, False),
        ({"weights": [-1.0, 1.0]}, False),
        ({"weights": [1.0, -1e-30]}, False),
        ({"weights": [1.0, np.nan]}, False),
        ({"weights": [1.0]}, False),
        ({"weights": [1.0, 1.0, 1.0]}, False),
        ({"theta": [0.0, 1.9]}, True),
        ({"theta": [0.0, -1.9]}, True),
        ({"theta": [0.0, 2.0 + 1e-9]}, False),
        ({"theta": [0.0, -2.0 - 1e-9]}, False),
        ({"theta": [0.0, np.nan]}, False),
        ({"theta": [0.0]}, False),
        ({"mu": -1e-30}, False),
        ({"mu": np.nan}, False),
        ({"codes": [0]}, False),
        ({"codes": [2]}, False),
        ({"codes": [7]}, False),
        ({"codes": [-1]}, False),
        ({"codes": [1, 1]}, False),
        ({"codes": []}, False),
        ({"codes": [4]}, False),
    ):
        assert (taken(problem, [{**only, **change}]) is not None) == holds, change


def node_in_space(**errors):
    S = np.array([[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]])
    return ReducedProblem(S, np.array([-2.5, 0.1, -1.0]), np.array([3.0]), **errors)


def test_cells_with_a_solution_are_not_excluded():
    """Open, stick and the arc around -x have one each, whatever the vector."""
    problem = node_in_space()
    region = SpaceRegion.whole(problem.scaled)
    opened = {"do": "open", "why": "x"}
    rng = np.random.default_rng(1)
    excluded = set()
    for k in range(300):
        y = rng.normal(size=3)
        gone = region.excluded(y)
        excluded |= set(np.flatnonzero(gone).tolist())
        if k % 15:
            continue
        assert taken(problem, [{"do": "empty", "y": 0}], [y]) is None
        for cell in range(10):
            step = {"do": "exclude", "y": 0, "what": [cell]}
            assert (taken(problem, [step, opened], [y]) is not None) == gone[cell]
    # Of the arcs the one from 11/64 + 3/2 to 11/64 + 2 has the direction -x, at q = 2.
    assert excluded
    assert not excluded & {0, 1, 5}


def test_ball_contains_the_slips_of_all_data():
    """The ball grows until it holds the slip of all data within the errors."""
    z = np.array([[0.5, 3.1, 0.5]])
    exact = solve_in_space(node_in_space().scaled, np.array([2], dtype=np.int8), z)
    errors = {"S_error": np.full((3, 3), 1e-3), "p_error": np.full(3, 1e-3)}
    wide = solve_in_space(node_in_space(**errors).scaled, np.array([2], dtype=np.int8), z)
    assert (np.abs(wide.state - exact.state) <= wide.away).all()
    assert 1e-3 < wide.away.max() < 0.1
    # A first ball of twice the residual is not enough where errors of S count as much.
    errors = {"S_error": np.full((3, 3), 0.017)}
    assert solve_in_space(node_in_space(**errors).scaled, np.array([2], dtype=np.int8), z)
    assert exact.away.max() < 1e-13


def ball(rng, shape, size):
    """Numbers of all magnitudes up to a size, with errors up to a part of them, or none."""
    value = size * rng.normal(size=shape) * 10.0 ** rng.integers(-12, 1, shape)
    part = rng.choice([0.0, 1e-17, 1e-3, 0.5], shape)
    return Ball(value, np.abs(value) * part * rng.random(shape))


def ends(x, i):
    """Exact ends of an entry."""
    value, radius = Fraction(float(x.value[i])), Fraction(float(x.radius[i]))
    return value - radius, value + radius


def holds(x, i, exact):
    return abs(exact - Fraction(float(x.value[i]))) <= Fraction(float(x.radius[i]))


@pytest.mark.parametrize("size", [1.0, 1e-140, 1e140])
@pytest.mark.parametrize("operation", [add, sub, mul, truediv])
def test_an_operation_contains_the_exact_results(operation, size):
    rng = np.random.default_rng(3)
    a, b = ball(rng, 200, size), ball(rng, 200, size)
    with np.errstate(all="ignore"):
        found = operation(a, b)
    for i in range(200):
        for x in ends(a, i):
            for y in ends(b, i):
                if operation is truediv and np.isinf(found.radius[i]):
                    continue
                assert holds(found, i, operation(x, y))


@pytest.mark.parametrize("size", [1.0, 1e-140, 1e140])
def test_a_product_of_matrices_contains_the_exact_results(size):
    rng = np.random.default_rng(4)
    for _ in range(20):
        A, b = ball(rng, (3, 7), size), ball(rng, 7, size)
        found = A @ b
        for signs in rng.choice([-1, 1], (20, 2, 7)):
            for i in range(3):
                exact = sum(
                    ends(A, (i, j))[int(s > 0)] * ends(b, j)[int(t > 0)]
                    for j, (s, t) in enumerate(zip(*signs, strict=True))
                )
                assert holds(found, i, exact)


def test_exact_numbers_are_balls_on_either_side():
    x = Ball(np.array([1.0, 2.0]), np.array([0.5, 0.0]))
    eye = np.eye(2)
    for found, value in (
        (1 - x, [0, -1]),
        (2.0 * x, [2, 4]),
        (eye @ x, [1, 2]),
        (x + np.ones(2), [2, 3]),
        (-x, [-1, -2]),
    ):
        assert found.value.tolist() == value
        assert found.radius[0] >= 0.5


def test_a_denominator_that_may_be_zero_gives_no_bound():
    one = Ball.of(np.ones(3))
    found = one / Ball(np.array([1.0, 0.5, -0.5]), np.array([1.0, 0.5, 0.6]))
    assert np.isinf(found.radius).all()


def test_lengths_contain_the_lengths_of_all_points():
    rng = np.random.default_rng(5)
    x, y = ball(rng, 200, 1.0), ball(rng, 200, 1.0)
    found = hypot(x, y)
    for i in range(200):
        low, high = (Fraction(float(v[i])) for v in (found.low, found.high))
        for a in ends(x, i):
            for b in ends(y, i):
                square = a * a + b * b
                assert square <= high * high
                assert low <= 0 or low * low <= square
