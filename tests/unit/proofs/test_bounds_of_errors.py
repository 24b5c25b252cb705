"""What the checker allows for errors of the data, against the worst of all data within them.

Small errors add up to |A^-1| (dS |a| + dp) at most, attained where all have the worst sign; larger
ones are drawn. States that obey the law of some data within the errors are never excluded, and
what bounds them does.
"""

import itertools

from mpi4py import MPI

import numpy as np
import pytest
from test_differences_of_solutions import (
    IN_SPACE,
    KINDS,
    arcs_around,
    cells_of,
    in_a_cell,
    quantity_bounds,
    slots,
    state_of,
    unit,
)

from dolfinx_contact.analysis import Certificate, InvalidCertificate, ReducedProblem, check
from dolfinx_contact.analysis import check_proof as cp

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")


def stiffness(n, rng):
    """Positive definite, and errors of which every entry is another one, some zero."""
    A = rng.normal(size=(n, n))
    dS = np.triu(rng.random((n, n)) * (rng.random((n, n)) < 0.7))
    return A @ A.T + 8 * np.eye(n), dS + np.triu(dS, 1).T


def within(error, rng):
    """Errors of the worst size, symmetric ones of a matrix."""
    signs = rng.choice([-1.0, 1.0], size=error.shape)
    if error.ndim == 2:
        signs = np.triu(signs) + np.triu(signs, 1).T
    return signs * error


# -- pieces ----------------------------------------------------------------------------------------


def plane_state(z, codes, F, g):
    """(a, r) of the unknowns of a piece, from the statuses' definition."""
    a, r = np.zeros((2, len(codes), 2))
    for i, (code, (x, y)) in enumerate(zip(codes, z.reshape(-1, 2), strict=True)):
        opened, stuck, sense = code in (0, 4, 5, 6), code in (1, 4), {2: 1, 3: -1, 5: 1, 6: -1}
        a[i, 1], r[i, 1] = (y, 0.0) if opened else (0.0, y)
        a[i, 0] = 0.0 if stuck else x
        r[i, 0] = x if stuck else -sense.get(code, 0) * (F[i] * r[i, 1] + g[i])
    return a.reshape(-1), r.reshape(-1)


def space_state(z, codes, F, g):
    a, r = np.zeros((2, len(codes), 3))
    for i, (code, (x, y, w)) in enumerate(zip(codes, z.reshape(-1, 3), strict=True)):
        opened, stuck, slips = code in (0, 4, 5), code in (1, 4), code in (2, 5) and F[i] + g[i] > 0
        a[i, 2], r[i, 2] = (w, 0.0) if opened else (0.0, w)
        if stuck:
            r[i, :2] = x, y
        elif slips:
            a[i, :2] = x * unit(y)
            r[i, :2] = -(F[i] * r[i, 2] + g[i]) * unit(y)
        else:
            a[i, :2] = x, y
    return a.reshape(-1), r.reshape(-1)


def jacobian(residual, z, h=1e-6):
    return np.stack([(residual(z + e) - residual(z - e)) / (2 * h) for e in h * np.eye(len(z))]).T


PLANE = [
    ((0, 2), (0.5, 0.75), (0, 0)),
    ((1, 3), (0.5, 0.75), (0, 0)),
    ((2, 0), (0.0, 0.75), (0, 0)),
    ((4, 5), (0.0, 0.0), (0.5, 0.25)),
    ((6, 2), (0.0, 0.0), (0.5, 0.25)),
    ((1, 3), (0.0, 0.5), (0.5, 0.0)),
]
SPACE = [
    ((0, 2), (0.5, 0.75), (0, 0)),
    ((1, 2), (0.5, 0.75), (0, 0)),
    ((2, 2), (0.0, 0.75), (0, 0)),
    ((4, 5), (0.0, 0.0), (0.5, 0.25)),
    ((2, 1), (0.0, 0.0), (0.5, 0.25)),
    ((0, 5), (0.5, 0.0), (0.0, 0.5)),
]


def asked(dim, codes, F, g, error):
    """A problem with errors, a piece of it, its unknowns, the residual of other data."""
    F, g = np.array(F, dtype=float), np.array(g, dtype=float)
    rng = np.random.default_rng([dim, *codes, int(10 * F.sum())])
    S, dS = stiffness(2 * dim, rng)
    state = plane_state if dim == 2 else space_state
    z = rng.uniform(0.5, 1.0, 2 * dim) * rng.choice([-1, 1], 2 * dim)
    if dim == 3:
        z[[0, 2, 3, 5]] = np.abs(z[[0, 2, 3, 5]])
    a, r = state(z, codes, F, g)
    dS, dp = error * dS, error * rng.random(2 * dim)
    problem = ReducedProblem(S, S @ a - r, F, g, dS, dp)

    def residual(z, S=S, p=problem.p):
        a, r = state(z, codes, F, g)
        return S @ a - r - p

    code = np.array(codes, dtype=np.int8)
    piece = (
        cp.solve_piece(problem, code)
        if dim == 2
        else cp.solve_in_space(problem, code, z.reshape(2, 3) + 1e-3)
    )
    return problem, piece, z, residual, state, rng


@pytest.mark.parametrize(
    ("dim", "codes", "F", "g"), [*((2, *c) for c in PLANE), *((3, *c) for c in SPACE)]
)
def test_pieces_of_data_with_errors(dim, codes, F, g):
    """As far off as the worst of small errors, in space twice; no farther than larger ones go."""
    problem, piece, z, residual, state, _ = asked(dim, codes, F, g, 1e-7)
    a, _ = state(z, codes, problem.friction, problem.g)
    worst = np.abs(np.linalg.inv(jacobian(residual, z))) @ (problem.dS @ np.abs(a) + problem.dp)
    if dim == 2:
        opened, free = cp.IS_OPEN[piece.codes], cp.IS_FREE[piece.codes]
        normal = np.where(opened, piece.un.radius, piece.rn.radius)
        tangent = np.where(free, piece.ut.radius, piece.rt.radius)
        found = np.stack([tangent, normal], axis=1).reshape(-1)
        slips = free & (cp.SENSE[piece.codes] != 0)
        rubbed = problem.friction * piece.rn.radius
        np.testing.assert_allclose(piece.rt.radius[slips], rubbed[slips], rtol=1e-5, atol=1e-14)
    else:
        found = piece.radius.reshape(-1) / 2
        np.testing.assert_array_less(0.99 * worst, piece.residual)
    np.testing.assert_allclose(found, worst, rtol=1e-3)
    problem, piece, z, residual, state, rng = asked(dim, codes, F, g, 0.02)
    for _ in range(6):
        S, p = problem.S + within(problem.dS, rng), problem.p + within(problem.dp, rng)
        other = z

        def of_these(y, S=S, p=p):
            return residual(y, S, p)

        for _ in range(12):
            other = other - np.linalg.solve(jacobian(of_these, other), of_these(other))
        a, r = (v.reshape(2, dim) for v in state(other, codes, problem.friction, problem.g))
        true = np.concatenate([a, r], axis=1)
        assert (np.abs(true - piece.state) <= piece.away + 1e-9).all()


@pytest.mark.parametrize(("codes", "F", "g"), SPACE)
def test_growth_of_a_ball(codes, F, g):
    """|C f| + |I - C J| r for every J of a state in the ball, and of data with any one error."""
    problem, piece, _, residual, _, rng = asked(3, codes, F, g, 0.0)
    z, r = piece.z.reshape(-1), 1e-4 * rng.random(6)
    none, n = np.zeros((6, 6)), 6

    def growths(piece, S, at):
        def moved(y):
            return residual(y, S)

        return piece.residual + np.abs(np.eye(n) - piece.inverse @ jacobian(moved, at)) @ r

    most = cp._growth(piece, r.reshape(2, 3))
    for _ in range(12):
        found = growths(piece, problem.S, z + r * rng.choice([-1, 1], 6))
        np.testing.assert_array_less(found, most + 1e-10)
    for i, k in itertools.combinations_with_replacement(range(n), 2):
        dS = none.copy()
        dS[i, k] = dS[k, i] = 0.0625
        wide = ReducedProblem(problem.S, problem.p, problem.friction, problem.g, dS)
        other = cp.SpacePiece(
            wide, piece.codes, piece.z, piece.e, piece.inverse, piece.residual, piece.radius
        )
        most = cp._growth(other, r.reshape(2, 3))
        for sign in (-1, 1):
            found = growths(other, problem.S + sign * dS, z)
            np.testing.assert_array_less(found, most + 1e-10)


def test_flexibilities():
    """S^-1 is off by |S^-1| dS |S^-1| at most, for small errors."""
    rng = np.random.default_rng(1)
    S, dS = stiffness(4, rng)
    for error, times in ((1e-8, 1e-4), (1e-3, None)):
        problem = ReducedProblem(S, np.ones(4), np.ones(2), None, error * dS)
        G, off = cp.flexibility(problem)
        np.testing.assert_allclose(G, np.linalg.inv(S), rtol=1e-10)
        if times:
            first = np.abs(G) @ (error * dS) @ np.abs(G)
            np.testing.assert_allclose(off, first, rtol=times, atol=1e-13)
        for _ in range(8):
            other = np.linalg.inv(S + within(error * dS, rng))
            assert (np.abs(other - G) <= off).all()
    far = np.array([[0.0, 0.6], [0.6, 0.0]])
    wide = ReducedProblem(np.diag([1.0, 100.0]), np.ones(2), np.ones(1), None, far)
    assert np.isinf(cp.flexibility(wide)[1]).all()


# -- bounds by energy ------------------------------------------------------------------------------


def by_energy(S, p, rows, of_force):
    """Largest l.a, or l.r = l.(S a - p), of all a with a.S a <= p.a; as large as 0 at least."""
    G = np.linalg.inv(S)
    rho = np.sqrt(p @ G @ p) / 2
    found = []
    for row, force in zip(rows, of_force, strict=True):
        if force:
            found.append(-row @ p / 2 + rho * np.sqrt(row @ S @ row))
        else:
            found.append(row @ G @ p / 2 + rho * np.sqrt(row @ G @ row))
    return np.array(found)


def slot_rows(i, F, n):
    e = np.eye(n)
    t, k = e[2 * i], e[2 * i + 1]
    return [t, -t, k, F * k + t, F * k - t, k], [False] * 3 + [True] * 3


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_bounds_by_energy_in_the_plane(error):
    rng = np.random.default_rng(2)
    F, g = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.75, 0.0])
    for _ in range(10):
        S, dS = stiffness(6, rng)
        p, dp = rng.normal(size=6), error * rng.random(6)
        problem = ReducedProblem(S, p, F, g, error * dS, dp)
        ub = cp.bounded(problem)
        for _ in range(6):
            Q, q = S + within(error * dS, rng), p + within(dp, rng)
            for i in range(3):
                expected = by_energy(Q, q, *slot_rows(i, F[i], 6))
                expected[3:5] = np.minimum(expected[3:5] + g[i], 2 * g[i] if g[i] else np.inf)
                if i == 2:
                    expected[3:5] = 0.0
                assert (ub[:, i] >= expected * (1 - 1e-12)).all()
                if not error:
                    np.testing.assert_allclose(ub[:, i], expected, rtol=1e-6)


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_bounds_by_energy_in_space(error):
    rng = np.random.default_rng(3)
    F, g = np.array([0.5, 0.0]), np.array([0.0, 0.75])
    for _ in range(10):
        S, dS = stiffness(6, rng)
        p, dp = rng.normal(size=6), error * rng.random(6)
        most = cp.bounded_in_space(ReducedProblem(S, p, F, g, error * dS, dp))
        for _ in range(6):
            Q, q = S + within(error * dS, rng), p + within(dp, rng)
            G = np.linalg.inv(Q)
            for i in range(2):
                x, y, k = np.eye(6)[3 * i : 3 * i + 3]
                rows = [-x, x, -y, y, k, k]
                expected = by_energy(Q, q, rows, [False] * 5 + [True])
                found = most[[0, 1, 2, 3, cp.OF_UN, cp.OF_RN + 1], i]
                assert (found >= expected * (1 - 1e-12)).all()
                assert most[cp.OF_RK, i] == most[cp.OF_RN + 1, i]
                assert (most[[cp.OF_S, cp.OF_RN], i] == 0).all()
                # |ut| in the ellipse of tangents: its middle, and the larger half axis.
                block = G[3 * i : 3 * i + 2, 3 * i : 3 * i + 2]
                rho = np.sqrt(q @ G @ q) / 2
                reach = rho * np.sqrt(np.linalg.eigvalsh(block)[1])
                largest = np.hypot(*(G @ q)[3 * i : 3 * i + 2]) / 2 + reach
                assert most[cp.OF_S + 1, i] >= largest * (1 - 1e-12)
                if not error:
                    np.testing.assert_allclose(found, expected, rtol=1e-6)
                    assert most[cp.OF_S + 1, i] == pytest.approx(largest, rel=1e-6)


def test_bounds_of_a_pressure_are_attained():
    """By the load with its error, and on the ellipsoid by the stiffness with its."""
    loaded = ReducedProblem(
        np.eye(3), np.array([0, 0, -1.0]), np.array([0.5]), p_error=np.array([0, 0, 0.25])
    )
    assert 1.25 <= cp.bounded_in_space(loaded)[cp.OF_RN + 1, 0] <= 1.12 * 1.25
    # rho S_nn^(1/2) with rho = (p.S^-1 p)^(1/2) / 2 = 1/2.
    for p in ([1.0, 0, 0], [0, 1.0, 0]):
        error = np.diag([0, 0, 0.25])
        S = np.diag([1.0, 1.0, 4.0])
        stiff = ReducedProblem(S, np.array(p), np.array([0.5]), S_error=error)
        found = cp.bounded_in_space(stiff)[cp.OF_RN + 1, 0]
        assert found == pytest.approx(4.25**0.5 / 2, rel=1e-6)


def test_bounds_below_zero_count_as_zero():
    """Of gaps, slips and pressures, which are not negative."""
    rng = np.random.default_rng(7)
    S, _ = stiffness(6, rng)
    problem = ReducedProblem(S, np.ones(6), np.array([0.5, 0.0]), np.array([0.0, 0.25]))
    cells = cp.Cells.whole(problem)
    most = np.zeros((cp.MOST, 1))
    most[cp.OF_S], most[cp.OF_S + 1] = 0.5, 2.0
    assert [float(v[0]) for v in cp.ends_of(most, cp.OF_S)] == [0.0, 2.0]
    for quantity in (cp.OF_UN, cp.OF_RK, cp.OF_S + 1, cp.OF_RN + 1):
        most, zero = np.ones((2, cp.MOST, 2))
        most[[cp.OF_S, cp.OF_RN]] = zero[[cp.OF_S, cp.OF_RN]] = 0.0
        most[quantity], zero[quantity] = -0.5, 0.0
        for y in rng.normal(size=(4, 6)):
            dual = cp.SpaceDual(problem, y)
            np.testing.assert_array_equal(dual.least(cells, most), dual.least(cells, zero))
            if quantity != cp.OF_RK:
                most[cp.OF_RK] = zero[cp.OF_RK] = -0.5
            most[:4] = zero[:4] = 0.0
            assert dual.round_off(most) == dual.round_off(zero)


# -- multipliers -----------------------------------------------------------------------------------


def sums_in_the_plane(problem, y, ub):
    """The largest change of y.(S a - p) within the errors, over all a in the bounds."""
    ends = itertools.product(*((-ub[1, i], ub[0, i]) if t == 0 else (0, ub[2, i])
                               for i in range(problem.points) for t in (0, 1)))  # fmt: skip
    return max(np.abs(a) @ problem.dS @ np.abs(y) for a in map(np.array, ends)) + (
        problem.dp @ np.abs(y)
    )


def test_errors_of_sums():
    """They are those of the worst a in its bounds, of which every component has its own."""
    rng = np.random.default_rng(4)
    for dim, _ in itertools.product((2, 3), range(8)):
        n = 2 * dim
        S, dS = stiffness(n, rng)
        dp, y = rng.random(n), rng.normal(size=n)
        F, g = np.array([0.5, 0.0]), np.array([0.0, 0.25])
        problem = ReducedProblem(S, rng.normal(size=n), F, g, 0.05 * dS, 0.05 * dp)
        if dim == 2:
            ub = rng.random((6, 2))
            found = cp.Dual(problem, y).round_off(ub)
            assert found == pytest.approx(sums_in_the_plane(problem, y, ub), rel=1e-8)
            continue
        most = rng.random((cp.MOST, 2)) * rng.choice([0.1, 1, 10], (cp.MOST, 2))
        most[[0, 2]] -= 0.2
        reach = np.zeros((2, 3))
        for c in (0, 1):
            reach[:, c] = np.abs(most[[2 * c, 2 * c + 1, cp.OF_S + 1]]).max(axis=0)
        reach[:, 2] = most[cp.OF_UN]
        expected = reach.reshape(-1) @ problem.dS @ np.abs(y) + problem.dp @ np.abs(y)
        found = cp.SpaceDual(problem, y).round_off(most)
        assert found == pytest.approx(expected, rel=1e-8)


def test_round_off_of_forces():
    """Pressures of slips and of sticks, and the shear that friction lets them have."""
    F, g = np.array([0.5, 0.0]), np.array([0.0, 0.25])
    problem = ReducedProblem(np.eye(6), np.zeros(6), F, g)
    y = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])
    for slides, sticks in ((3.0, 2.0), (2.0, 3.0), (2.0, 0.0), (0.0, 2.0)):
        most = np.zeros((cp.MOST, 2))
        most[cp.OF_RN + 1], most[cp.OF_RK] = slides, sticks
        largest = max(slides, sticks)
        forces = np.array([0.5 * largest, 0.5 * largest, largest, 0.25, 0.25, largest])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cp, "_U", 2.0**-20)
            found = cp.SpaceDual(problem, y).round_off(most)
            assert found == pytest.approx(2 * cp.gamma(6 + 64) * forces @ np.abs(y), rel=1e-6)


@pytest.mark.parametrize("error", [0.0, 0.05])
@pytest.mark.parametrize("kind", KINDS)
def test_no_vector_excludes_a_state(kind, error):
    """Two points with states that obey the law, in regions with the bounds that they attain."""
    F, g, codes = KINDS[kind]
    rng = np.random.default_rng(5)
    for _ in range(16):
        S, dS = stiffness(4, rng)
        both = rng.choice(list(codes), 2)
        states = [state_of(code, F, g, rng, True) for code in both]
        a, r = np.concatenate([s[:2] for s in states]), np.concatenate([s[2:] for s in states])
        dS, dp = error * dS, error * rng.random(4)
        p = (S + within(dS, rng)) @ a - r + within(dp, rng)
        two = np.full(2, F), np.full(2, g)
        problem = ReducedProblem(S, p, *two, dS, dp)
        ub = np.stack([slots(s, F, g) for s in states], axis=1)
        if kind == "free":
            ub[3:5] = 0.0
        masks = problem.statuses & (1 << both | rng.integers(0, 128, 2))
        region = cp.StatusRegion(problem, masks, ub)
        for y in rng.normal(size=(4, 4)):
            assert not region.excluded(y)[[0, 1], both].any()
            for slot, point in itertools.product(range(6), (0, 1)):
                assert region.most(y, slot, point) >= ub[slot, point] - 1e-12


@pytest.mark.each_value
@pytest.mark.parametrize("error", [0.0, 0.05])
@pytest.mark.parametrize("law", IN_SPACE)
def test_no_vector_excludes_a_state_in_space(law, error):
    F, g, codes = IN_SPACE[law]
    kinds = sorted(set(codes.values()))
    rng = np.random.default_rng(6)
    for _ in range(12):
        S, dS = stiffness(6, rng)
        both = rng.choice(kinds, 2)
        q = rng.integers(0, 64, 2) / 16
        states, mosts, tables = [], [], []
        for i, kind in enumerate(both):
            a, s = in_a_cell(kind, F, g, np.arctan2(*cp.rays(q[i])[::-1]), rng)
            states.append(a)
            mosts.append(quantity_bounds(kind, a, s))
            others = [k for k in kinds if k == kind or rng.random() < 0.5]
            arcs = arcs_around(q[i], *rng.integers(0, 6, 2))
            cells = cells_of(others, arcs)
            tables.append((np.full(len(cells), i), cells.kind, cells.ends))
        cells = cp.Cells(*(np.concatenate(parts) for parts in zip(*tables, strict=True)))
        most = np.concatenate(mosts, axis=1)
        a, r = np.concatenate([s[:3] for s in states]), np.concatenate([s[3:] for s in states])
        dS, dp = error * dS, error * rng.random(6)
        p = (S + within(dS, rng)) @ a - r + within(dp, rng)
        problem = ReducedProblem(S, p, np.full(2, F), np.full(2, g), dS, dp)
        region = cp.SpaceRegion(problem, cells, most)
        holds = np.zeros(len(cells), dtype=bool)
        for i in (0, 1):
            mine = (cells.node == i) & (cells.kind == both[i])
            ends = (q[i] - cells.ends[:, 0]) % 4 <= cells.ends[:, 1] - cells.ends[:, 0]
            holds |= mine & (ends | (cells.kind != cp.IN_SLIP))
        for y in rng.normal(size=(4, 6)):
            assert not region.excluded(y)[holds].any()
            for quantity, i in itertools.product(range(cp.MOST), (0, 1)):
                if both[i] not in cp._BOUNDED_KINDS[quantity]:
                    continue
                bound = cp.SpaceDual(problem, y).most(cells, most, quantity, i)
                assert bound >= most[quantity, i] - 1e-12


def test_slots_that_no_vector_bounds():
    """rn with Coulomb friction, and slacks of a bound given in advance, are not counted by one.

    With the vector 0 they would have been bounded by 0, and of three solutions one be the only.
    """
    S, p = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-2.5, -1.0])
    three = ReducedProblem(S, p, np.array([3.0]))
    assert len(check(Certificate(three, [{"do": "pieces", "singular": []}])).inside) == 3
    only = {"do": "only", "codes": [0], "weights": [1.0, 1.0], "theta": [0.0, 0.0], "mu": 0.0}
    for value in (1e-12, 1.0, 1e300):
        bound = {"do": "bound", "y": 0, "slot": 5, "point": 0, "value": value}
        with pytest.raises(InvalidCertificate, match="a bound is not proved"):
            check(Certificate(three, [bound, only], [np.zeros(2)]))
    counted = {(0.5, 0.0): {0, 1, 2, 3, 4}, (0.0, 0.5): {0, 1, 2, 5}, (0.0, 0.0): {0, 1, 2, 5}}
    for (F, g), expected in counted.items():
        region = cp.StatusRegion.whole(ReducedProblem(S, p, np.array([F]), np.array([g])))
        found = {slot for slot in range(6) if np.isfinite(region.most(np.ones(2), slot, 0))}
        assert found == expected


def test_a_vector_that_is_worth_its_bound():
    """Where y is the row of a point that is known to be open, un = p / S for all in the region."""
    S, p = np.diag([2.0, 4.0]), np.array([0.5, 3.0])
    problem = ReducedProblem(S, p, np.array([0.5]))
    region = cp.StatusRegion(problem, np.array([1]), cp.bounded(problem))
    region.ub[1] = 0.0  # ut is not negative
    for slot, value in ((0, 0.25), (2, 0.75)):
        y = np.zeros(2)
        y[slot // 2] = 1 / S[slot // 2, slot // 2]
        assert region.most(y, slot, 0) == pytest.approx(value, rel=1e-9)
    space = ReducedProblem(np.diag([2.0, 4.0, 8.0]), np.array([0.5, -3.0, 2.0]), np.array([0.5]))
    whole = cp.SpaceRegion.whole(space)
    opened = whole.part(whole.cells.kind == cp.IN_OPEN)
    for quantity, value in ((0, -0.25), (1, 0.25), (2, 0.75), (3, -0.75), (cp.OF_UN, 0.25)):
        row = min(quantity // 2, 2)
        sign = -1 if quantity in (0, 2) else 1
        y = np.zeros(3)
        y[row] = sign / space.S[row, row]
        dual = cp.SpaceDual(space, y)
        assert dual.most(opened.cells, opened.most, quantity, 0) == pytest.approx(value, rel=1e-9)
