"""The small parts of the checker of proofs, each where the answer is known beforehand.

What a step may say, arcs and their hulls, rounding that is said to be coarse, words.
"""

import contextlib
import dataclasses
import io
import itertools
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.analysis import Certificate, InvalidCertificate, ReducedProblem, check
from dolfinx_contact.analysis import check_proof as cp

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")
#: One node with an open state, a stick and a slip to the left.
THREE = ReducedProblem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-2.5, -1.0]), np.array([3.0]))
#: One in space with an open state, a stick and a slip along -x.
SPACE = ReducedProblem(
    np.array([[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]]),
    np.array([-2.5, 0.1, -1.0]),
    np.array([3.0]),
)
PIECES = {"do": "pieces", "singular": []}


def taken(problem, steps, vectors=()):
    return check(Certificate(problem, steps, [np.array(y, dtype=float) for y in vectors]))


@contextlib.contextmanager
def coarse(u=2.0**-10):
    """Arithmetic that is said to be rounded to few bits; what bounds are is then seen."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cp, "_U", u)
        yield u


# -- arcs ------------------------------------------------------------------------------------------


def arcs_of(*ends):
    ends = np.array(ends, dtype=float)
    return cp.Cells(np.zeros(len(ends), dtype=int), np.full(len(ends), cp.IN_SLIP), ends)


def test_hulls_of_arcs():
    """The arc that is left beside the largest hole."""
    every = cp.Cells.whole(SPACE)
    assert every.hull(0) == (11 / 64, 4.0)
    assert every.kept(every.kind != cp.IN_SLIP).hull(0) is None
    starts = 11 / 64 + np.arange(8) / 2
    for first, number in itertools.product(range(8), range(1, 8)):
        chosen = (first + np.arange(number)) % 8
        keep = np.isin(np.arange(10), 2 + chosen)
        assert every.kept(keep).hull(0) == (starts[first], number / 2)
    assert arcs_of((1, 3), (0, 0.5)).hull(0) == (0.0, 3.0)
    assert arcs_of((3, 3.5), (0, 0.5), (1, 1.25)).hull(0) == (3.0, 2.25)
    assert arcs_of((0, 2), (0.5, 1)).hull(0) == (0.0, 2.0)
    assert arcs_of((0, 1), (1, 3.75)).hull(0) == (0.0, 3.75)
    assert arcs_of((0, 4), (0, 1)).hull(0) == (0.0, 4.0)
    smooth = cp.Cells.whole(ReducedProblem(np.eye(6), np.ones(6), np.array([0.0, 0.5])))
    assert smooth.hull(0) is None
    assert not smooth.ends[smooth.kind != cp.IN_SLIP].any()


def test_arcs_of_one_point_of_two():
    two = ReducedProblem(np.eye(6), np.ones(6), np.ones(2))
    cells = cp.Cells.whole(two)
    halved = cells.halved(1)
    assert [len(c) for c in (cells, halved)] == [20, 28]
    assert halved.node.tolist() == [0] * 10 + [1] * 18
    arcs = halved.ends[12:]
    np.testing.assert_array_equal(arcs[:, 1] - arcs[:, 0], np.full(16, 0.25))
    np.testing.assert_array_equal(arcs[1:, 0], arcs[:-1, 1])
    np.testing.assert_array_equal(halved.ends[:10], cells.ends[:10])
    assert halved.first.tolist() == [0, 10]
    one = cells.kept((cells.node == 1) | (cells.kind != cp.IN_SLIP))
    assert one.hull(0) is None
    assert one.hull(1) == (11 / 64, 4.0)
    assert [one.kinds_at(i) for i in (0, 1)] == [{0, 1}, {0, 1, 2}]
    assert cells.kept(cells.node == 1).first.tolist() == [0]


def test_arcs_are_halved_down_to_their_least_width():
    cells = arcs_of((0.125, 0.125 + 2.0**-18))
    for _ in range(2):
        cells = cells.halved(0)
    assert (cells.ends[:, 1] - cells.ends[:, 0] == 2.0**-20).all()
    for narrow in (cells, arcs_of((0.125, 0.125 + 2.0**-21))):
        with pytest.raises(InvalidCertificate, match="no arc"):
            narrow.halved(0)


def test_rays_of_tables():
    q = np.arange(12).reshape(2, 3, 2) / 3
    for found in (cp.rays(q), cp.directions(q)):
        assert found.shape == (2, 3, 2, 2)
    np.testing.assert_array_equal(cp.rays(q)[1, 2], cp.rays(q[1, 2]))
    np.testing.assert_allclose(np.linalg.norm(cp.directions(q), axis=-1), 1.0)


def test_angles_from_a_direction():
    """Between the first and the last ray of arcs of up to 3.5, unless the opposite is there."""
    for angle in np.linspace(-3.0, 3.0, 7):
        e = np.array([[np.cos(angle), np.sin(angle)]])
        for q, width in itertools.product(np.arange(16) / 4, (0.25, 1.0, 2.0, 2.5, 3.25, 3.5)):
            piece = _slipping_along(e)
            found = cp.angles_of(piece, arcs_of((q, q + width / 2), (q + width / 2, q + width)), 0)
            inside = np.linspace(q, q + width, 400)
            x, y = cp.rays(inside).T
            turned = np.arctan2(e[0, 0] * y - e[0, 1] * x, e[0, 0] * x + e[0, 1] * y)
            away = np.pi - np.abs(turned).max()
            if found is None:
                assert away < 0.05
                continue
            assert away >= 0
            np.testing.assert_allclose(found, [turned[0], turned[-1]], atol=1e-9)
            assert found[0] < turned.min()
            assert found[1] > turned.max()
    piece = _slipping_along(np.array([[1.0, 0.0]]))
    assert cp.angles_of(piece, cp.Cells.whole(SPACE), 0) is None
    assert cp.angles_of(piece, arcs_of((2.1, 3.9), (3.9, 5.7)), 0) is None


def _slipping_along(e):
    z = np.array([[0.5, np.arctan2(e[0, 1], e[0, 0]), 0.5]])
    rest = np.eye(3), np.zeros(3), np.zeros((1, 3))
    return cp.SpacePiece(SPACE, np.array([2], dtype=np.int8), z, e, *rest)


# -- rounding --------------------------------------------------------------------------------------


def test_what_numbers_are_rounded_by():
    """Doubles by 2^-53; sums of 10^6 terms, and angles, by what is larger than their round-off."""
    u = np.finfo(np.float64).eps / 2
    assert u == cp._U
    assert cp.gamma(6) == 10 * u / (1 - 10 * u)
    assert 1e6 * u < cp._SLACK < 1e-8
    assert 64 * u < cp._ANGLES < 1e-10
    for x in (0.0, 1.0, 1e-300, 3e200):
        for bound in (cp.above(x), float(cp.up(np.float64(x)))):
            assert x < bound <= x * (1 + 1e-8) + 1e-280
        for bound in (cp.below(x), float(cp.down(np.float64(x)))):
            assert x * (1 - 1e-8) <= bound < x or bound == x == 0


def test_what_is_taken_from_a_diagonal():
    """At least what the theorem of Rump says, at most twice that of some operations more."""
    with coarse() as u:
        for n in (1, 2, 3):
            Q = np.eye(n)
            theorem = (n + 1) * u / (1 - (n + 1) * u)
            least = theorem / (1 - theorem) * n
            most = 2.02 * (n + 4) * u * n
            assert cp.positive_definite(Q, np.diag(np.full(n, 1 - most)))
            assert not cp.positive_definite(Q, np.diag(np.full(n, 1 - least)))
    assert cp.positive_definite(np.zeros((0, 0)), np.zeros((0, 0)))


def test_a_shift_is_rounded():
    """S - c I is off by what its diagonal is rounded by, which adds to the error of S."""
    with coarse(2.0**-8) as u:
        shift = (1 + 0.9) * 5 * u
        room = 0.1 - 2 * 5 * u * 0.1 - shift
        assert cp.least_eigenvalue(np.eye(1), np.full((1, 1), room - 2 * u * shift - 1e-3)) == 0.9
        assert cp.least_eigenvalue(np.eye(1), np.full((1, 1), room + 1e-3)) == 0.0
    assert cp.least_eigenvalue(-0.5 * np.eye(2), np.zeros((2, 2))) == 0.0


def test_arcs_that_may_hold_a_direction():
    """Where it is not sure that -v is outside an arc the least of v.e is -|v|."""
    for start in np.pi / 4 * np.arange(8):
        turned = np.array([start, start + 0.5])
        first, last = np.stack([np.cos(turned), np.sin(turned)], axis=1)[:, None]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cp, "_ANGLES", 2.0**-10)
            for angle, held in ((-0.5, False), (-0.9, False), (0.9, True), (0.0, True)):
                off = angle * 2.0**-9
                for to in (start + off, start + 0.5 - off):
                    v = -2 * np.array([[np.cos(to), np.sin(to)]])
                    room = 2.0**-10 * np.abs(v).sum() / 2
                    (found,) = cp._least_along(v, first, last)
                    expected = 2.0 if held or -off < room else 2 * np.cos(off)
                    assert found == pytest.approx(-expected, rel=1e-15, abs=1e-15)


def test_two_numbers_that_are_equal_but_for_rounding():
    """States that differ by what differences are rounded by may be one; balls hold what they do."""

    def at(z, radius=0.0):
        z = np.array([[*z]])
        rest = np.zeros((1, 2)), np.eye(3), np.zeros(3), np.full((1, 3), radius)
        return cp.SpacePiece(SPACE, np.array([1], dtype=np.int8), z, *rest)

    with coarse() as u:
        one, other = at((1.0, 2.0, 4.0)), at((1.0, 2.0, 4.0 + 63 * u))
        assert one.same(other) is None
        assert one.same(at((1.0, 2.0, 4.0 + 66 * u))) is False
        # gamma(4) (|z| + |z|) = 16 u |z|, to which the other's radius adds.
        for share, radius, expected in ((15.5, 0, None), (16.5, 0, True), (16.5, u, None)):
            one.__dict__["_alone"] = share * u * np.abs(one.z)
            assert one.same(at((1.0, 2.0, 4.0), radius)) is expected


def test_quotients_of_what_is_not_positive():
    assert [cp._ratio(*v) for v in ((-0.5, 2.0), (1.0, 0.0), (0.0, 1.0), (1.0, -0.5))] == [0.0] * 4
    assert cp._ratio(1.0, 4.0) == pytest.approx(0.25, rel=2e-9)
    assert cp._ratio(1.0, 4.0) < 0.25


# -- pieces ----------------------------------------------------------------------------------------


def test_what_is_near_a_start():
    """However near Newton's method came: e is that of z, the residual that of both, and a solution
    is in the ball; where that is not sure there is none."""
    slip = np.array([2], dtype=np.int8)

    def equilibrium(z):
        s, q, rn = z
        e = np.array([np.cos(q), np.sin(q)])
        return SPACE.S @ [*(s * e), 0.0] - [*(-3.0 * rn * e), rn] - SPACE.p

    off = []
    for angle in np.pi + np.linspace(-2.0, 2.0, 41):
        piece = cp.solve_in_space(SPACE, slip, np.array([[0.8, angle, 0.3]]))
        off.append(np.nan if piece is None else piece.residual.max())
        if piece is None:
            continue
        (z,) = piece.z
        np.testing.assert_allclose(piece.e[0], [np.cos(z[1]), np.sin(z[1])], atol=1e-15)
        f = equilibrium(z)
        np.testing.assert_array_less(np.abs(piece.inverse @ f), piece.residual)
        true = z
        for _ in range(20):
            slopes = [(equilibrium(true + h) - equilibrium(true - h)) / 2e-6
                      for h in 1e-6 * np.eye(3)]  # fmt: skip
            true = true - np.linalg.solve(np.array(slopes).T, equilibrium(true))
        assert (np.abs(true - z) <= piece.radius[0] + 1e-12).all()
    # Some were through with it, some nearly, some not at all.
    assert np.nanmin(off) < 1e-13
    assert np.nanmax(off) > 1e-9
    assert np.isnan(off).any()


def test_matrices_that_cannot_be_inverted():
    """Nothing is proved where an inverse is refused, or is none."""
    slip, z = np.array([2], dtype=np.int8), np.array([[0.5, 3.1, 0.5]])
    piece = cp.solve_in_space(SPACE, slip, z)
    region = cp.SpaceRegion.whole(SPACE)
    kinds = region.cells.kind == cp.IN_SLIP
    near = region.cells.kept(kinds & np.isin(np.arange(10), (5, 6)))
    narrow = near.kept(np.arange(2) == 0)

    def singular(A):
        raise np.linalg.LinAlgError

    def infinite(A):
        return np.full_like(A, np.inf)

    one = np.ones(1)
    for wrong in (singular, infinite):
        with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
            patch.setattr(np.linalg, "inv", wrong)
            assert cp.solved(cp.Ball.of(np.eye(1)), cp.Ball(one, one)) is None
            assert cp.solve_in_space(SPACE, slip, z) is None
            assert not cp.only_one(piece, narrow, region.most)
    assert not cp.only_one(piece, region.cells.kept(kinds), region.most)
    given = ReducedProblem(np.eye(3), np.array([0.1, 0.0, -1.0]), np.zeros(1), np.array([0.5]))
    held = cp.solve_in_space(given, np.array([1], dtype=np.int8), -given.p[None])
    whole = cp.SpaceRegion.whole(given)
    closed = whole.cells.kept(whole.cells.kind == cp.IN_CLOSED)
    assert not cp.only_one(held, closed, whole.most)
    smooth = ReducedProblem(np.eye(3), np.array([0.1, 0.0, -1.0]), np.zeros(1))
    held = cp.solve_in_space(smooth, np.array([2], dtype=np.int8), np.array([[0.1, 0.0, 1.0]]))
    assert cp.only_one(held, closed, whole.most)


def test_matrices_that_contract_have_small_eigenvalues():
    rng = np.random.default_rng(9)
    for n, size in itertools.product((2, 3, 5), (0.3, 0.9, 0.99, 1.01, 1.1, 2.0, 20.0)):
        for _ in range(6):
            G = rng.random((n, n)) ** rng.integers(1, 9)
            G *= size / np.abs(np.linalg.eigvals(G)).max()
            assert cp._contracts(G) == (size < 1)
            G *= rng.random((n, n)) < 0.8
            assert not cp._contracts(G) or np.abs(np.linalg.eigvals(G)).max() < 1


def test_how_far_arcs_may_be():
    """Columns of slips up to an angle of 3, A up to 2.8, of nearly pi."""
    region = cp.SpaceRegion.whole(SPACE)
    for angle, columns, arcs in ((2.0, True, True), (2.75, True, True), (2.85, True, False),
                                 (2.95, True, False), (3.05, False, False)):  # fmt: skip
        q = 1.0 - np.cos(angle) / (np.abs(np.cos(angle)) + np.abs(np.sin(angle)))
        cells = arcs_of((q - 2.0**-10, q))
        for sign in (1, -1):
            piece = _slipping_along(np.array([[1.0, 0.0]]))
            of = cells if sign > 0 else arcs_of((4 - q, 4 - q + 2.0**-10))
            assert (cp._columns_of_slip(piece, of, region.most, 0) is not None) == columns
            assert cp.space_differences(piece, of, region.most).has[6, 0] == arcs


def test_the_largest_pressure_is_that_of_the_cells():
    most = np.zeros((cp.MOST, 1))
    most[cp.OF_RN + 1], most[cp.OF_RK] = 3.0, 5.0
    for kinds, expected in (((0,), 0), ((1,), 5), ((2,), 3), ((0, 1), 5), ((0, 2), 3), ((1, 2), 5),
                            ((0, 3), 3), ((3,), 3)):  # fmt: skip
        assert cp._largest_pressure(most, 0, frozenset(kinds)) == expected
    most[cp.OF_RK] = -1.0
    assert cp._largest_pressure(most, 0, frozenset((1,))) == 0.0


def test_lower_ends_are_rounded_down():
    """A gap of 1 +- 1/2: its lower end is less than 1/2 by round-off of the error."""
    opened = np.array([0], dtype=np.int8)
    z, rest = np.array([[0.5, 0.0, 1.0]]), (np.zeros((1, 2)), np.eye(3), np.zeros(3))
    piece = cp.SpacePiece(SPACE, opened, z, *rest, np.full((1, 3), 0.5))
    made = cp._Forms(1)
    most = np.ones((cp.MOST, 1))
    with coarse() as u:
        assert cp._normal(piece, most, 0, frozenset((cp.IN_OPEN, cp.IN_SLIP)), made)
        lower = 1.0 - 0.5 * (1 + 8 * u / (1 - 8 * u))
    np.testing.assert_allclose(made.factors[1], lower, rtol=1e-8)
    for gap, fits in ((0.5, False), (0.49, False), (0.51, True)):
        piece = cp.SpacePiece(SPACE, opened, gap * z, *rest, np.full((1, 3), 0.5))
        piece.z[0, 2] = gap
        assert cp._normal(piece, most, 0, frozenset((0, 2)), cp._Forms(1)) == fits


def test_uniqueness_with_weights_of_zero():
    """Inequalities may be left out, and what vanishes may do alone; a row may have no diagonal."""
    S = np.array([[1.0, 0.5], [0.5, 1.0]])
    region = cp.StatusRegion.whole(ReducedProblem(S, np.array([0.5, 2.0]), np.array([2.0])))
    opened = cp.solve_piece(region.problem, np.array([0], dtype=np.int8))
    found = cp.differences(opened, np.array([0b1001]), region.ub)
    # S_tt - F S_nt = 0: f = (S_t - F S_n) d = -1.5 dn, and k2 of the gap holds the rest.
    np.testing.assert_allclose(found.R[0], [0.0, -1.5], atol=1e-12)
    for weights, mu, holds in (((0.0, 1.0), 1.0, True), ((0.0, 1.0), 0.0, False),
                               ((0.0, 0.0), 1.0, False), ((5.0, 1.0), 1.0, True)):  # fmt: skip
        assert found.prove(np.array(weights), np.zeros(2), mu) == holds
    alone = cp.differences(opened, np.array([1]), region.ub)
    assert alone.equal.all()
    for mu, holds in ((1.0, True), (0.0, False), (-1.0, False)):
        assert alone.prove(np.zeros(2), np.zeros(2), mu) == holds


def test_an_inverse_that_is_not_exact():
    """A step with it makes the solution as much better, and the bound knows both."""
    A, b = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([1.0, 2.0])
    exact, inverse = np.linalg.solve(A, b), np.linalg.inv(A)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.linalg, "inv", lambda M: inverse * (1 + 1e-4))
        z = cp.solved(cp.Ball.of(A), cp.Ball.of(b))
    assert (np.abs(z.value - exact) <= z.radius).all()
    assert z.radius.max() < 3e-8


@pytest.mark.parametrize("problem", [THREE, SPACE], ids=["plane", "space"])
def test_weights_that_are_refused_whatever_the_form(problem):
    """Negative ones, and numbers that are none, prove nothing even of a form that is definite."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cp, "positive_definite", lambda Q, error: True)
        if problem.dim == 2:
            region = cp.StatusRegion.whole(problem)
            piece = cp.solve_piece(problem, np.array([0], dtype=np.int8))
            found = cp.differences(piece, region.allowed, region.ub)
            theta, one = np.zeros(2), np.ones(2)

            def prove(w, mu):
                return found.prove(w, theta, mu)

            assert not found.prove(one, np.array([0.0, 0.34]), 0.0)
            assert found.prove(one, np.array([0.0, 0.33]), 0.0)
        else:
            region = cp.SpaceRegion.whole(problem)
            start = np.linalg.solve(problem.S, problem.p)[None]
            piece = cp.solve_in_space(problem, np.array([0], dtype=np.int8), start)
            found = cp.space_differences(piece, region.cells, region.most)
            one = np.ones((9, 1))
            prove = found.prove
        assert prove(one, 0.0)
        for mu in (-0.5, -1e-300, np.nan, *([np.inf] if problem.dim == 3 else [])):
            assert not prove(one, mu)
        for bad in (-0.5, -1e-300):
            w = one.copy()
            w.flat[1] = bad
            assert not prove(w, 0.0)


def mirrored(codes):
    """Statuses where ut and rt have the other sign."""
    return np.array([0, 1, 3, 2, 4, 6, 5])[codes]


def test_what_is_proved_in_a_mirror():
    """With the other tangent all is as before, with the slots of the other sense."""
    rng = np.random.default_rng(10)
    F, g = np.array([0.75, 0.0, 1.5]), np.array([0.0, 0.5, 0.0])
    sign = np.tile([-1.0, 1.0], 3)
    swap = [1, 0, 2, 4, 3, 5]
    D = np.diag(sign)
    for _ in range(6):
        A = rng.normal(size=(6, 6))
        S, p, y = A @ A.T + 3 * np.eye(6), rng.normal(size=6), rng.normal(size=6)
        errors = 1e-3 * np.ones((6, 6)), 1e-3 * np.ones(6)
        one = ReducedProblem(S, p, F, g, *errors)
        other = ReducedProblem(D @ S @ D, D @ p, F, g, *errors)
        ub = cp.bounded(one)
        np.testing.assert_allclose(cp.bounded(other)[swap], ub, rtol=1e-9)
        h = cp.Dual(one, y).least(ub)
        np.testing.assert_allclose(
            cp.Dual(other, D @ y).least(ub[swap])[:, mirrored(np.arange(7))], h, atol=1e-9
        )
        codes = np.array([rng.choice(4), rng.choice(range(1, 7)), rng.choice(4)], dtype=np.int8)
        pieces = cp.solve_piece(one, codes), cp.solve_piece(other, mirrored(codes).astype(np.int8))
        np.testing.assert_allclose(pieces[1].state, pieces[0].state * [-1, 1, -1, 1], atol=1e-9)
        np.testing.assert_allclose(pieces[1].away, pieces[0].away, rtol=1e-6)
        assert pieces[0].verdict == pieces[1].verdict
        for k in range(20):
            sets = [{int(c)} | set(rng.choice(7, rng.integers(1, 4)).tolist()) for c in codes]
            masks = [np.array([sum(1 << int(f[s]) for s in part) for part in sets])
                     for f in (np.arange(7), mirrored(np.arange(7)))]  # fmt: skip
            found, there = (
                cp.differences(piece, problem.statuses & mask, bounds)
                for piece, problem, mask, bounds in zip(
                    pieces, (one, other), masks, (ub, ub[swap]), strict=True
                )
            )
            assert (found is None) == (there is None), (k, codes, sets)
            if found is None:
                continue
            flip = sign[found.unknown]
            np.testing.assert_array_equal(there.tilted, found.tilted)
            np.testing.assert_allclose(there.R, flip[:, None] * found.R * flip, atol=1e-9)
            np.testing.assert_allclose(there.k1, found.k1, rtol=1e-6)
            np.testing.assert_allclose(there.k2, found.k2, rtol=1e-6)


def test_two_slips_that_differ_by_an_angle():
    """It is at most pi / 2 times the distance of the directions, which is nearly the angle."""

    def at(angle, radius):
        z, e = np.array([[1.0, 0.0, 1.0]]), np.array([[np.cos(angle), np.sin(angle)]])
        balls = np.array([[0.0, radius, 0.0]])
        return cp.SpacePiece(
            SPACE, np.array([2], dtype=np.int8), z, e, np.eye(3), np.zeros(3), balls
        )

    turn = 0.015625
    for ball, expected in ((0.9, None), (1.55, None), (1.65, True)):
        one = at(0.0, 4 * turn)
        one.__dict__["_alone"] = np.array([[1.0, ball * turn, 1.0]])
        assert one.same(at(turn, 0.0)) is expected
        assert one.same(at(-turn, 0.0)) is expected
    with coarse() as u:
        one = at(0.0, 0.0)
        for ball, expected in ((63.5, None), (64.5, True)):
            one.__dict__["_alone"] = np.array([[1.0, ball * u, 1.0]])
            assert one.same(at(0.0, 0.0)) is expected


# -- steps -----------------------------------------------------------------------------------------


def test_only_numbers_that_are_there():
    for value, size in ((0, 1), (2, 3)):
        assert cp._index(value, size) == value
    for value, size in ((-1, 3), (3, 3), (4, 3), (0, 0), (0.0, 1), ("0", 1), (None, 1)):
        with pytest.raises(InvalidCertificate, match="there is no number"):
            cp._index(value, size)


#: A decoupled node that sticks, in the plane and in space, and that no other state is one.
STICKS = ReducedProblem(np.eye(2), np.array([0.1, -1.0]), np.array([0.5]))
STICKS_IN_SPACE = ReducedProblem(np.eye(3), np.array([0.1, 0.0, -1.0]), np.array([0.5]))
ONLY = {"do": "only", "codes": [1], "weights": [1.0, 1.0], "theta": [0.0, 0.0], "mu": 0.0}
ONLY_IN_SPACE = {"do": "only", "codes": [1], "z": [[-0.1, 0.0, 1.0]], "mu": 1.0}
ONLY_IN_SPACE["weights"] = np.ones((9, 1)).tolist()
#: A step of every kind that holds, of the node in the plane and of the one in space.
STEPS = [
    (THREE, {"do": "branch", "point": 0, "parts": [15]}, [PIECES]),
    (THREE, {"do": "open"}, []),
    (THREE, PIECES, []),
    (THREE, {"do": "bound", "y": 0, "slot": 2, "point": 0, "value": 1e6}, [PIECES]),
    (THREE, {"do": "exclude", "y": 0, "what": []}, [PIECES]),
    (SPACE, {"do": "halve", "point": 0}, [{"do": "open", "why": ""}]),
    (SPACE, {"do": "branch", "point": 0, "parts": [list(range(10))]}, [{"do": "open", "why": ""}]),
    (SPACE, {"do": "open", "why": ""}, []),
    (SPACE, {"do": "bound", "y": 0, "quantity": 4, "point": 0, "value": 1e6},
     [{"do": "open", "why": ""}]),
    (SPACE, {"do": "exclude", "y": 0, "what": []}, [{"do": "open", "why": ""}]),
    (STICKS, ONLY, []),
    (STICKS_IN_SPACE, ONLY_IN_SPACE, []),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(STEPS)))
def test_words_that_are_no_steps(number):
    """A step is known by its whole word: another is refused, whatever else it has."""
    problem, step, after = STEPS[number]
    vectors = [np.zeros(len(problem.p))]
    assert taken(problem, [step, *after], vectors)
    rest = {"singular": [], "parts": [15], "what": [], "why": ""}
    for word in ("", "a", step["do"][:-1], step["do"] + "s", "zzz", step["do"].upper()):
        with pytest.raises(InvalidCertificate):
            taken(problem, [{**rest, **step, "do": word}, *after], vectors)


def test_regions_that_are_empty():
    """A node that is pressed is not open, as the row of the normal says; by no other word."""
    for problem, parts, left in (
        (STICKS, [1, 14], PIECES),
        (STICKS_IN_SPACE, [[0], list(range(1, 10))], {"do": "open", "why": ""}),
    ):
        y = np.zeros(problem.dim)
        y[-1] = 1.0
        branch = {"do": "branch", "point": 0, "parts": parts}
        assert taken(problem, [branch, {"do": "empty", "y": 0}, left], [y])
        rest = {"singular": [], "parts": parts, "what": [], "why": "", "y": 0}
        for word in ("", "a", "d", "empt", "emptys", "f", "zzz"):
            with pytest.raises(InvalidCertificate):
                taken(problem, [branch, {**rest, "do": word}, left], [y])
        with pytest.raises(InvalidCertificate, match="not proved empty"):
            taken(problem, [branch, {"do": "empty", "y": 0}, left], [-y])
    assert cp.SpaceRegion.whole(STICKS_IN_SPACE).kinds == [frozenset((0, 1, 2))]


def test_leaves_of_one_kind():
    """A leaf is of the cells of the status, whatever the coefficient; of others it is refused."""
    slips = ReducedProblem(np.eye(3), np.array([1.0, 0.0, -1.0]), np.array([0.5]))
    opened = {"do": "open", "why": ""}
    leaf = {"do": "leaf", "codes": [2], "z": [[0.5, 0.0, 1.0]]}
    others = list(range(9))
    branch = {"do": "branch", "point": 0, "parts": [[9], others]}
    assert len(taken(slips, [branch, leaf, opened]).inside) == 1
    stick = {"do": "leaf", "codes": [1], "z": [[-0.1, 0.0, 1.0]]}
    parts = [[0], [1], [9], list(range(2, 9))]
    branch = {"do": "branch", "point": 0, "parts": parts}
    assert len(taken(STICKS_IN_SPACE, [branch, opened, stick, opened, opened]).inside) == 1
    for place in (0, 2, 3):
        steps = [branch, *[opened] * 4]
        steps[1 + place] = stick
        with pytest.raises(InvalidCertificate, match="not those of the cells"):
            taken(STICKS_IN_SPACE, steps)
    two = ReducedProblem(np.eye(6), np.ones(6), np.ones(2))
    for point in (0, 1):
        cells = list(range(10 * point, 10 * point + 10))
        branch = {"do": "branch", "point": point, "parts": [cells[:4], cells[4:]]}
        assert len(taken(two, [branch, opened, opened]).open_regions) == 2


def test_two_solutions_of_one_piece():
    """Slips have directions: of one status there may be several."""
    slip = np.array([2], dtype=np.int8)
    one = cp.solve_in_space(SPACE, slip, np.array([[0.5, 3.1, 0.5]]))
    other = dataclasses.replace(one, z=one.z + np.array([0.1, 0.0, 0.0]))
    proved = cp.Proved()
    for piece in (one, other, one, other):
        proved.add(piece)
    assert len(proved.inside) == 2


def test_steps_with_other_shapes():
    for change in (
        {"weights": [1.0], "theta": [0.0]},
        {"weights": [1.0] * 3, "theta": [0.0] * 3},
        {"weights": [[1.0, 1.0]], "theta": [[0.0, 0.0]]},
        {"weights": [1.0, 1.0, 1.0]},
        {"theta": [0.0]},
    ):
        with pytest.raises(InvalidCertificate, match="a uniqueness is not proved"):
            taken(STICKS, [{**ONLY, **change}])
    for codes in ([], [1, 1], [-1], [7], [8]):
        with pytest.raises(InvalidCertificate, match="statuses do not fit"):
            taken(STICKS, [{**ONLY, "codes": codes}])
    smooth = ReducedProblem(STICKS.S, STICKS.p, np.zeros(1))
    for problem, codes in ((STICKS, (4, 5, 6)), (smooth, (1, 3, 4, 5, 6))):
        for code in codes:
            with pytest.raises(InvalidCertificate, match="cannot have this status"):
                taken(problem, [{**ONLY, "codes": [code]}])
    bound = {"do": "bound", "y": 0, "slot": 6, "point": 0, "value": 1e6}
    exclude = {"do": "exclude", "y": 0, "what": [[0, 7]]}
    for step in (bound, exclude):
        with pytest.raises(InvalidCertificate, match="there is no number"):
            taken(STICKS, [step, PIECES], [np.zeros(2)])


def test_what_does_not_fit_has_no_differences_in_space():
    """A stick beyond its friction, slips without a direction, contact that draws."""
    region = cp.SpaceRegion.whole(SPACE)
    kind = region.cells.kind
    rest = np.eye(3), np.zeros(3), np.zeros((1, 3))
    none = np.zeros((1, 2))
    for code, z, kinds in (
        (1, [2.0, 0.0, 0.5], (1, 2)),
        (1, [0.0, 0.0, -0.5], (1, 2)),
        (0, [0.0, 0.0, 0.5], (0, 2)),
        (0, [0.5, 0.0, -0.5], (0, 2)),
        (0, [0.5, 0.0, 0.5], (1, 2)),
    ):
        codes = np.array([code], dtype=np.int8)
        piece = cp.SpacePiece(SPACE, codes, np.array([z]), none, *rest)
        cells = region.cells.kept(np.isin(kind, kinds))
        assert cp.space_differences(piece, cells, region.most) is None
        if code == 0:
            fitting = cp.SpacePiece(SPACE, codes, np.array([[0.5, 0.0, 0.5]]), none, *rest)
            cells = region.cells.kept(np.isin(kind, (0, 2)))
            assert cp.space_differences(fitting, cells, region.most) is not None


def test_rest():
    """Without load nothing but a = 0 is a solution, in space as well."""
    still = ReducedProblem(SPACE.S, np.zeros(3), SPACE.friction)
    proved = taken(still, [{"do": "rest"}])
    assert proved.at_rest
    assert str(proved) == "1 solution, proved to be all there are"
    lines = cp.report(Certificate(still, [{"do": "rest"}]), proved)
    assert any("there are 1 solution as follows" in line for line in lines)
    assert "  rest, without forces" in lines
    for change in ({"p": np.array([0, 0, -1e-300])}, {"p_error": np.array([0, 1e-300, 0])}):
        with pytest.raises(InvalidCertificate, match="there is a load"):
            taken(dataclasses.replace(still, **change), [{"do": "rest"}])
    plane = ReducedProblem(THREE.S, np.zeros(2), THREE.friction)
    for problem, word in itertools.product((still, plane), ("rests", "res", "s", "zzz")):
        with pytest.raises(InvalidCertificate):
            taken(problem, [{"do": word, "y": 0, "why": ""}], [np.zeros(len(problem.p))])


@pytest.mark.parametrize("problem", [THREE, SPACE], ids=["plane", "space"])
def test_vectors_that_do_not_fit(problem):
    n = len(problem.p)
    place = {"slot": 2, "quantity": 4}
    for y in (np.zeros(n - 1), np.zeros(n + 1), np.zeros(1), np.array([*np.zeros(n - 1), np.nan]),
              np.array([np.inf, *np.zeros(n - 1)])):  # fmt: skip
        step = {"do": "bound", "y": 0, **place, "point": 0, "value": np.inf}
        with pytest.raises(InvalidCertificate, match="does not fit"):
            taken(problem, [step, {"do": "open", "why": ""}], [y])


def test_a_bound_is_kept():
    """The smaller of that which was there and the new one, and not below zero."""
    scaled = THREE.scaled
    # Of any vector the bound of a slot is one; the vector 0 proves the one that is there.
    proof = Certificate(THREE, [], [np.zeros(2)])
    for value, kept in ((1e6, None), (None, None)):
        region = cp.StatusRegion.whole(scaled)
        before = region.ub.copy()
        step = {"do": "bound", "y": 0, "slot": 2, "point": 0}
        step["value"] = region.most(np.zeros(2), 2, 0) if value is None else value
        (after,) = cp.follow(proof, step, region, cp.Proved())
        np.testing.assert_array_equal(after.ub, before)
        assert kept is None
    region = cp.StatusRegion.whole(scaled)
    region.ub[2, 0] = 2.0**-20
    step = {"do": "bound", "y": 0, "slot": 2, "point": 0, "value": 2.0**-19}
    (after,) = cp.follow(proof, step, region, cp.Proved())
    assert after.ub[2, 0] == 2.0**-20
    region = cp.StatusRegion(scaled, np.array([1]), cp.StatusRegion.whole(scaled).ub * 0)
    step["value"] = region.most(np.zeros(2), 2, 0)
    (after,) = cp.follow(proof, step, region, cp.Proved())
    assert after.ub[2, 0] == 0.0
    # Where the bound is negative the slot is none.
    drawn = ReducedProblem(np.eye(2), np.array([-0.5, 1.0]), np.array([0.5]))
    region = cp.StatusRegion(drawn, np.array([1]), np.array([[1.0], [0], [1], [0], [0], [0]]))
    proof = Certificate(drawn, [], [np.array([1.0, 0.0])])
    step = {"do": "bound", "y": 0, "slot": 0, "point": 0, "value": -0.25}
    (after,) = cp.follow(proof, step, region, cp.Proved())
    assert after.ub[0, 0] == 0.0


def test_bounds_of_what_a_status_does_not_use():
    """Open points have no slacks, points that stick no slip and no gap, slips no slack behind."""
    problem = ReducedProblem(np.eye(6), -np.ones(6), np.array([0.5, 0, 0]), np.array([0, 0.5, 0]))
    plane = cp.StatusRegion.whole(problem)
    plane.ub = np.ones((6, 3))
    used = {
        0: {0: [0, 1, 2], 1: [3, 4, 5], 2: [0, 4, 5], 3: [1, 3, 5]},
        1: {1: [3, 4, 5], 2: [0, 4, 5], 3: [1, 3, 5], 4: [2, 3, 4], 5: [0, 2, 4], 6: [1, 2, 3]},
        2: {0: [0, 1, 2], 2: [0, 1, 5]},
    }
    assert {i: sorted(v) for i, v in used.items()} == dict(enumerate(plane.choices))
    every = (
        np.array([np.isin(range(6), [*itertools.chain(*v.values())]) for v in used.values()]).T
        * 1.0
    )
    for point, slots in used.items():
        for statuses in itertools.combinations(slots, 2):
            part = plane.part(point, sum(1 << s for s in statuses))
            expected = every.copy()
            expected[:, point] = np.isin(range(6), [k for s in statuses for k in slots[s]])
            np.testing.assert_array_equal(part.ub, expected)
        for status, own in slots.items():
            part = plane.part(point, 1 << status)
            np.testing.assert_array_equal(part.ub[:, point], np.isin(range(6), own))


def test_weights_that_do_not_fit_in_space():
    """They are as many as the inequalities, not one for all."""
    pressed = ReducedProblem(np.diag([2.0, 2.0, 4.0]), np.array([0.05, 0.0, -1.0]), np.array([0.5]))
    step = {"do": "only", "codes": [1], "z": [[-0.05, 0.0, 1.0]], "mu": 1.0}
    assert taken(pressed, [{**step, "weights": np.ones((9, 1)).tolist()}]).verdict == "complete"
    for shape in ((1, 1), (9,), (9, 2), (1,), (8, 1)):
        with pytest.raises(InvalidCertificate, match="a uniqueness is not proved"):
            taken(pressed, [{**step, "weights": np.ones(shape).tolist()}])
    for change in ({"codes": []}, {"codes": [1, 1]}, {"z": []}, {"z": [[0.0] * 2]},
                   {"z": [[0.0] * 4]}, {"z": [[0.0] * 3] * 2}):  # fmt: skip
        with pytest.raises(InvalidCertificate, match="statuses do not fit"):
            taken(pressed, [{**step, **change}])


@pytest.mark.parametrize("problem", [THREE, SPACE], ids=["plane", "space"])
def test_exclusion_needs_its_margin(problem):
    """Excluded is what is so by more than the round-off once; at a margin, by so many times."""
    whole = cp.SpaceRegion.whole if problem.dim == 3 else cp.StatusRegion.whole
    region = whole(problem.scaled)
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(200):
        y = rng.normal(size=len(problem.p))
        if not region.excluded(y).any() or region.excluded(y).all():
            continue
        low, high = 0.0, 1e18
        for _ in range(80):
            middle = (low * high) ** 0.5 if low else high / 2
            gone = region.excluded(y, margin=middle).any()
            low, high = (middle, high) if gone else (low, middle)
        with pytest.MonkeyPatch.context() as patch:
            dual = cp.SpaceDual if problem.dim == 3 else cp.Dual
            size = dual.round_off
            for share, gone in ((0.75, True), (1.5, False)):
                patch.setattr(dual, "round_off", lambda *a, s=share: s * low * size(*a))  # noqa: B023
                assert region.excluded(y).any() == gone
                if problem.dim == 3:
                    of = cp.SpaceDual(region.problem, y)
                    assert of.impossible(region.cells, region.most).any() == gone
                seen.add(gone)
        break
    assert seen == {True, False}
    with pytest.raises(TypeError):
        region.excluded(np.zeros(len(problem.p)), 1.0)


def test_singular_pieces():
    """S ut - r = p of a slip to the left with F = S_tt / S_nt has no solution, or many.

    2 ut - 2 rn = p_t and ut - rn = p_n contradict each other unless p_t = 2 p_n, as y = (1, -2)
    says, with the sign by which y.p < 0.
    """
    node = np.array([[2.0, 1.0], [1.0, 2.0]])
    for m, p_t in itertools.product((1, 2), (-2.5, -1.5)):
        S, p = np.kron(np.eye(m), node), np.tile([p_t, -1.0], m)
        problem = ReducedProblem(S, p, np.array([2.0, 0.5][:m]))
        pieces = [[3, *rest] for rest in itertools.product(range(4), repeat=m - 1)]
        for sign in (1, -1):
            y = np.zeros(2 * m)
            y[:2] = sign * np.array([1.0, -2.0])
            proved = taken(problem, [{"do": "pieces", "singular": [[c, 0] for c in pieces]}], [y])
            shown = sign * (p_t + 2) < 0
            assert proved.verdict == ("complete" if shown else "degenerate")
            assert [c.tolist() for c in proved.singular] == ([] if shown else pieces)
            assert [q.codes[0] for q in proved.inside] == [0 if p_t < -2 else 1]
            proved = taken(problem, [{"do": "pieces", "singular": [[pieces[0], 0]]}], [y])
            assert [c.tolist() for c in proved.singular] == pieces[int(shown) :]
        proved = taken(problem, [PIECES])
        assert [c.tolist() for c in proved.singular] == pieces
        for number in (1, -1, 0.0):
            with pytest.raises(InvalidCertificate, match="there is no number"):
                taken(problem, [{"do": "pieces", "singular": [[pieces[0], number]]}], [y])


# -- what is said ----------------------------------------------------------------------------------


def test_how_many_in_words():
    proved = "2 solutions, proved"
    for numbers, words in (
        ((1, 0, 0, 0), "1 solution, proved to be all there are"),
        ((2, 0, 0, 0), f"{proved} to be all there are"),
        ((2, 0, 0, 1), f"{proved}; not decided: 1 set of statuses"),
        ((2, 1, 1, 3), f"{proved}; not decided: 3 sets of statuses"),
        ((2, 1, 0, 1), f"{proved}; not decided: 1 set of statuses"),
        (
            (2, 1, 1, 0),
            f"{proved}; others, if any, are at 1 border of statuses and in 1 singular piece of"
            " statuses",
        ),
        ((2, 1, 0, 0), f"{proved}; others, if any, are at 1 border of statuses"),
        ((2, 0, 2, 0), f"{proved}; others, if any, are at 2 singular pieces of statuses"),
        (
            (0, 2, 1, 0),
            "0 solutions, proved; others, if any, are at 2 borders of statuses and in 1 singular"
            " piece of statuses",
        ),
    ):
        assert cp.in_words(*numbers) == words


def test_sums_of_forces_and_their_errors():
    """A stick carries the load, with its error: of each component its own."""
    p, dp = np.array([0.25, -3.0]), np.array([0.125, 0.5])
    for dim in (2, 3):
        order = [0, 1] if dim == 2 else [0, 0, 1]
        S = 4 * np.eye(dim)
        problem = ReducedProblem(S, p[order], np.array([2.0]), None, None, dp[order])
        piece = (
            cp.solve_piece(problem.scaled, np.array([1], dtype=np.int8))
            if dim == 2
            else cp.solve_in_space(
                problem.scaled, np.array([1], dtype=np.int8), -problem.scaled.p[None]
            )
        )
        proved = cp.Proved(inside=[piece])
        lines = cp.report(Certificate(problem, [{"do": "open"}]), proved)
        (line,) = [found for found in lines if "sum rn" in found]
        found = dict(part.split(" = ") for part in line.split("sum ", 1)[1].split(", sum "))
        assert ("rt" in found) == (dim == 2)
        for name, value, error in (("rt", -0.25, 0.125), ("rn", 3.0, 0.5)):
            if name not in found:
                continue
            number, off = map(float, found[name].split(" +- "))
            assert number == pytest.approx(value, rel=1e-9)
            # In space the ball is twice as wide as it must be.
            assert error <= off <= (1.05 if dim == 2 else 2.1) * error


def test_sets_of_statuses_of_cells():
    """1 open, 2 stick, 4 slip or, without friction, closed."""
    problem = ReducedProblem(np.eye(6), np.ones(6), np.array([0.5, 0.0]))
    cells = cp.Cells.whole(problem)
    for kinds, masks in (
        ((0, 1, 2, 3), [7, 5]),
        ((0,), [1, 1]),
        ((0, 1, 3), [3, 5]),
        ((1, 2, 3), [6, 4]),
    ):
        kept = cells.kept(np.isin(cells.kind, kinds))
        assert cp.OpenCells(kept, np.zeros((cp.MOST, 2)), "").statuses.tolist() == masks


def test_objects_with_arrays():
    """They are compared by identity, and their numbers are not exchanged."""
    may_change = {"Certificate", "Proved", "StatusRegion", "SpaceRegion", "_Row"}
    by_value = {"Certificate", "_Row"}
    known = {name: v for name, v in vars(cp).items() if dataclasses.is_dataclass(v)}
    for name, of in known.items():
        assert of.__dataclass_params__.frozen == (name not in may_change)
        assert of.__dataclass_params__.eq == (name in by_value)
    assert known.keys() >= may_change | by_value


def test_numbers_that_must_not_be():
    S, p = np.eye(2), np.ones(2)
    for F, g in (([0.5], [0.25]), ([-0.5], [0.0]), ([0.0], [-0.5]), ([np.nan], [0.0])):
        with pytest.raises(ValueError, match=r"either|negative|finite"):
            ReducedProblem(S, p, np.array(F), np.array(g))
    with pytest.raises(ValueError, match="shape"):
        ReducedProblem(np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    shapes = {"S": (2, 2), "p": (2,), "friction": (1,), "bound": (1,)}
    shapes |= {"S_error": (2, 2), "p_error": (2,)}
    for name, shape in shapes.items():
        for other in ((1, 1), (3, 3), (1,), (3,), (), (2, 3), (0,)):
            parts = {n: np.eye(2) if n == "S" else np.zeros(s) for n, s in shapes.items()}
            if other != shape and not (name == "friction" and other in ((1, 1), (1,))):
                with pytest.raises((ValueError, TypeError), match=r"shape|unsized"):
                    ReducedProblem(**{**parts, name: np.ones(other)})
    for name in ("S_error", "p_error"):
        with pytest.raises(ValueError, match=f"{name} must not be negative"):
            ReducedProblem(**{**parts, name: -1e-9 * np.ones(shapes[name])})


def test_what_a_matrix_is_off_from_its_transpose():
    """It adds to the errors, with the rounding of the difference, on both sides of the diagonal."""
    S = np.array([[32.0, 1.0], [1.25, 32.0]])
    error = np.array([[0.0, 0.125], [0.0, 0.25]])
    with coarse() as u:
        found = ReducedProblem(S, np.ones(2), np.ones(1), None, error)
        np.testing.assert_array_equal(found.S, [[32, 1.125], [1.125, 32]])
        rounded = 5 * u / (1 - 5 * u)
        expected = [[0, 0.125 + 0.25 + rounded], [0.125 + 0.25 + 1.25 * rounded, 0.25]]
        np.testing.assert_allclose(found.dS, expected, rtol=1e-14)
        same = ReducedProblem(np.eye(2), np.ones(2), np.ones(1))
        assert not same.dS.any()


@pytest.mark.parametrize("dim", [2, 3])
def test_statuses_of_points(dim):
    F, g = np.array([0.5, 2.0, 0, 0]), np.array([0, 0, 0.5, 0])
    problem = ReducedProblem(np.eye(4 * dim), np.ones(4 * dim), F, g)
    found = [set(np.flatnonzero(has).tolist()) for has in cp.has_status(problem.statuses)]
    senses = {3, 6} if dim == 2 else set()
    coulomb = {0, 1, 2, 3} - ({3} - senses)
    assert found == [coulomb, coulomb, {1, 2, 4, 5} | senses, {0, 2}]


# -- files -----------------------------------------------------------------------------------------


def stored(folder, **changes):
    """A file of the three solutions, with other parts; None takes one out."""
    path = folder / "proof.npz"
    Certificate(THREE, [PIECES], [np.zeros(2)]).save(path)
    with np.load(path) as archive:
        parts = {**archive, **changes}
    np.savez(path, **{name: value for name, value in parts.items() if value is not None})
    return path


def test_files_that_were_changed(tmp_path):
    """Refused by their own words; what has neither format nor digests is read as it is."""
    known = Certificate(THREE, [PIECES], [np.zeros(2)])
    digests = [known.problem.digest, known.digest]
    S = THREE.S
    for changes, words in (
        ({"S": S.astype(complex)}, "no double"),
        ({"S": S.astype(int)}, "no double"),
        ({"S": S.astype(np.longdouble)}, "no double"),
        ({"vectors": np.zeros((1, 2), dtype=np.float32)}, "no double"),
        ({"S": S.astype(object)}, "is no proof"),
        ({"p": None}, "parts are missing"),
        ({"steps": None}, "parts are missing"),
        ({"vectors": None}, "parts are missing"),
        ({"format": np.array("dolfinx_contact proof 0")}, "of the format"),
        ({"format": np.array("e")}, "of the format"),
        ({"S": -S}, "not positive definite"),
        ({"steps": np.array("[")}, "is no proof"),
        ({"steps": np.array("[" * 100_000)}, "is no proof"),
        ({"vectors": np.array(1.0)}, "is no proof"),
        ({"p": np.array([-2.5, -1.25])}, "the data are not"),
        ({"p": np.array([-2.5, -0.75])}, "the data are not"),
        ({"steps": np.array("[]")}, "the steps are not"),
        ({"vectors": np.ones((1, 2))}, "the steps are not"),
        ({"digests": np.array(["", digests[1]])}, "the data are not"),
        ({"digests": np.array(["~", digests[1]])}, "the data are not"),
        ({"digests": np.array([digests[0], ""])}, "the steps are not"),
        ({"digests": np.array(digests[:1])}, "the steps are not"),
        ({"digests": None}, "the data are not"),
        ({"digests": np.zeros(0), "format": None}, "the data are not"),
    ):
        path = stored(tmp_path, **changes)
        with pytest.raises(InvalidCertificate, match=words):
            Certificate.load(path)
    for changes in ({}, {"format": None}, {"digests": None, "format": None}):
        again = Certificate.load(stored(tmp_path, **changes))
        assert [again.problem.digest, again.digest] == digests
    for content in (b"", b"PK", b"PK\x05\x06" + bytes(18)):
        path.write_bytes(content)
        with pytest.raises(InvalidCertificate, match=r"no certificate|no npz"):
            Certificate.load(path)
    with pytest.raises(FileNotFoundError):
        Certificate.load(tmp_path / "none.npz")
    with pytest.raises(FileNotFoundError):
        Certificate.load(tmp_path)


def test_what_the_command_returns(tmp_path):
    """0 that it holds, 1 that it is refused or open, 2 that there is no file; words in place."""
    path = stored(tmp_path)

    def run(path):
        out, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            status = cp.main([str(path)])
        return status, out.getvalue(), errors.getvalue()

    status, out, errors = run(path)
    assert (status, errors) == (0, "")
    assert out.splitlines()[-1] == "the proof holds"
    assert "data: 1 contact points;" in out
    letters = {line.split()[0] for line in out.splitlines() if "sum rn" in line}
    assert letters == {"o", "k", "-"}
    status, out, errors = run(tmp_path / "none.npz")
    assert (status, out) == (2, "")
    assert errors.startswith("refused: there is no file")
    status, out, errors = run(stored(tmp_path, p=np.zeros(2)))
    assert (status, out) == (1, "")
    assert errors.startswith("refused: ")
    opened = {"do": "open", "why": "time is over"}
    for problem, words in ((THREE, []), (SPACE, ["  time is over"])):
        Certificate(problem, [opened], []).save(path)
        status, out, errors = run(path)
        assert (status, errors) == (1, "")
        assert out.splitlines()[-1] == "not decided"
        assert "not decided: 1 sets of statuses" in out
        assert [line for line in out.splitlines() if "time" in line] == words
        assert (" in 3D;" in out) == (problem is SPACE)


def test_letters_of_statuses():
    F, g = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])
    for dim, codes in (
        (2, {"oko": (0, 1, 0), "k+c": (1, 2, 2), "+-c": (2, 3, 2), "-Ko": (3, 4, 0),
             "oPo": (0, 5, 0), "oMo": (0, 6, 0)}),
        (3, {"oko": (0, 1, 0), "ksc": (1, 2, 2), "sKo": (2, 4, 0), "oSo": (0, 5, 0)}),
    ):  # fmt: skip
        problem = ReducedProblem(np.eye(3 * dim), np.ones(3 * dim), F, g)
        for letters, numbers in codes.items():
            assert cp._letters(problem, np.array(numbers, dtype=np.int8)) == letters


@pytest.mark.parametrize("slacks", [(1.0, 0.0), (0.0, 1.0)])
def test_a_stick_at_the_border_of_its_cone_is_one(slacks):
    """A slack that is known to be nothing is none that is negative."""

    def one(value):
        return cp.Ball(np.array([value]), np.zeros(1))

    piece = SimpleNamespace(
        codes=np.array([1]),
        problem=SimpleNamespace(friction=np.array([0.5])),
        slacks=tuple(map(one, slacks)),
        rn=one(1.0),
        rt=one(slacks[1] - 0.5),
    )
    assert min(s.low[0] for s in piece.slacks) == 0.0
    (row,) = cp._coulomb(piece, 0, 0b1111, np.ones(2))
    assert row.x == 0.5 - slacks[1]
