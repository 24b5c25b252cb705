"""Bounds of the checker of proofs where they are known in closed form, and the smallest lies.

Data have errors far above round-off, so that what is asked of a bound is a number: the worst case
over all data within the errors. A step that claims a little more than is true is refused, beside
one that claims a little less, which is taken.
"""

import copy
import itertools

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.analysis import Certificate, InvalidCertificate, ReducedProblem, check
from dolfinx_contact.analysis import check_proof as cp
from dolfinx_contact.analysis.check_proof import (
    MOST_PIECES,
    NARROWEST,
    Ball,
    Dual,
    SpaceRegion,
    StatusRegion,
    differences,
    directions,
    least_eigenvalue,
    positive_definite,
    rays,
    solve_in_space,
    solve_piece,
    solved,
    space_differences,
)

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")
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
def test_definite_up_to_the_least_eigenvalue(scale):
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


def test_matrices_that_contract():
    """G v < v for a v > 0 where all eigenvalues are below 1, also where rows of G are 0."""
    for diagonal, contracts in (((0, 0.5), True), ((0.5, 0.999), True), ((0.5, 1), False)):
        assert cp._contracts(np.diag(np.array(diagonal, dtype=float))) == contracts
    assert cp._contracts(np.array([[0.1, 3.0], [0.25, 0.1]]))
    assert not cp._contracts(np.array([[0.1, 5.0], [0.25, 0.1]]))
    assert not cp._contracts(np.array([[np.nan]]))


def test_solutions_that_cannot_be_distinguished():
    """Two that may be one: inside they are refused, at a border both are named."""
    border = ReducedProblem(np.eye(3), np.array([0.3, 0.4, -1.0]), np.array([0.5]))
    touching = solve_in_space(border, np.array([1], dtype=np.int8), -border.p[None])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cp, "_is_same", lambda a, b: None)
        proved = cp.Proved()
        proved.add(touching)
        proved.add(touching)
        assert [len(q) for q in (proved.inside, proved.border)] == [0, 2]
        inside = ReducedProblem(np.eye(3), np.array([0.1, 0.2, -1.0]), np.array([0.5]))
        stick = solve_in_space(inside, np.array([1], dtype=np.int8), -inside.p[None])
        proved.add(stick)
        with pytest.raises(InvalidCertificate, match="distinguished"):
            proved.add(stick)
    proved = cp.Proved()
    proved.add(stick)
    proved.add(stick)
    assert len(proved.inside) == 1


def test_vectors_are_kept_once():
    proof = Certificate(ReducedProblem(*THREE))
    y = np.ones(2)
    assert [proof.vector(v) for v in (y, y, np.ones(2), y)] == [0, 0, 1, 2]
    assert len(proof.vectors) == 3


def test_least_eigenvalues():
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert 0.8 < least_eigenvalue(S, np.zeros((2, 2))) < 1.0
    assert least_eigenvalue(S, np.full((2, 2), 0.6)) == 0.0
    assert least_eigenvalue(-S, np.zeros((2, 2))) == 0.0
    for bad, error in ((-S, None), (S, np.full((2, 2), 0.6)), (S * 0, None)):
        with pytest.raises(ValueError, match="not positive definite"):
            ReducedProblem(bad, np.ones(2), np.ones(1), None, error)


def test_intervals_hold_their_ends():
    """Ends are outside those of real numbers, by units in the last place."""
    x = Ball(np.array([0.1, -0.7]), np.array([1e-17, 0.2]))
    assert (x.low < x.value - x.radius * 0.9999).all()
    assert (x.high > x.value + x.radius * 0.9999).all()
    assert (x.high - x.low < 2 * x.radius + 1e-14).all()


def test_diamond_angles():
    """q goes round the square |x| + |y| = 1 once, counterclockwise, and 4 is 0."""
    q = np.arange(-4, 12, 0.25)
    xy = rays(q)
    assert (np.abs(xy).sum(axis=1) == 1).all()
    np.testing.assert_array_equal(rays(np.arange(5.0)), [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]])
    np.testing.assert_array_equal(rays(q + 4), xy)
    assert (xy[:-1, 0] * xy[1:, 1] > xy[:-1, 1] * xy[1:, 0]).all()
    np.testing.assert_allclose(np.linalg.norm(directions(q), axis=1), 1, rtol=1e-15)


def test_a_bound_is_taken_down_to_the_truth():
    """Of one decoupled node pressed down: rn = 4, no more, and any bound from there on is one."""
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


def test_data_with_errors_at_one_node():
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


@pytest.mark.parametrize("off", [1e-9, -1e-9])
def test_verdicts_at_a_border(off):
    """Shear that is the friction but for its error: neither inside nor outside."""
    for error, expected in ((1e-12, "inside" if off < 0 else "outside"), (1e-8, "border")):
        p = np.array([0.5 + off, -1.0])
        problem = ReducedProblem(np.eye(2), p, np.array([0.5]), None, None, np.full(2, error))
        assert solve_piece(problem, np.array([1], dtype=np.int8)).verdict == expected
        p = np.array([0.3 * (1 + 2 * off), 0.4 * (1 + 2 * off), -1.0])
        space = ReducedProblem(np.eye(3), p, np.array([0.5]), None, None, np.full(3, error))
        piece = solve_in_space(space, np.array([1], dtype=np.int8), -space.p[None])
        assert piece.verdict == expected


def test_what_has_a_solution_is_not_excluded():
    """Of three solutions none is excluded by any vector, and the leaf of their pieces has three."""
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


def test_numbers_that_are_none():
    """Numbers of points, statuses and vectors are whole, from 0 on, and below their number."""
    problem = ReducedProblem(*THREE)
    pieces = {"do": "pieces", "singular": []}
    branch = {"do": "branch", "point": 0, "parts": [15]}
    assert taken(problem, [branch, pieces])
    for point in (-1, 1, 0.0, "0", None):
        assert taken(problem, [{**branch, "point": point}, pieces]) is None
    bound = {"do": "bound", "y": 0, "slot": 2, "point": 0, "value": 1e6}
    assert taken(problem, [bound, pieces], [[0.0, 0.0]])
    for change in ({"slot": 6}, {"slot": -1}, {"y": 1}, {"y": -1}, {"point": 1}, {"value": "1"}):
        assert taken(problem, [{**bound, **change}, pieces], [[0.0, 0.0]]) is None
    for y in ([0.0], [0.0, np.nan], [np.inf, 0.0], [0.0, 0.0, 0.0]):
        with pytest.raises(InvalidCertificate):
            check(Certificate(problem, [bound, pieces], [np.array(y)]))


def test_branches_cover_and_steps_are_counted():
    problem = ReducedProblem(*THREE)
    pieces = {"do": "pieces", "singular": []}
    for parts, holds in (([1, 14], True), ([3, 14], True), ([15, 0], True), ([1, 2, 8], False),
                         ([14], False), ([], False)):  # fmt: skip
        steps = [{"do": "branch", "point": 0, "parts": parts}, *[pieces] * len(parts)]
        proved = taken(problem, steps)
        assert (proved is not None) == holds
        assert not holds or len(proved.inside) == 3
        assert taken(problem, steps[:-1]) is None
        assert taken(problem, [*steps, pieces]) is None
    assert taken(problem, [{"do": "rest"}]) is None
    rest = ReducedProblem(THREE[0], np.zeros(2), THREE[2])
    assert taken(rest, [{"do": "rest"}]).at_rest
    near = ReducedProblem(THREE[0], np.zeros(2), THREE[2], None, None, np.array([0.0, 1e-300]))
    assert taken(near, [{"do": "rest"}]) is None
    opened = taken(problem, [{"do": "open"}])
    assert (opened.verdict, [r.tolist() for r in opened.open_regions]) == ("open", [[15]])


def test_as_many_pieces_as_are_solved():
    """A leaf may have 4^4 = 256 pieces, and no more."""
    pieces = {"do": "pieces", "singular": []}
    for m, holds in ((4, True), (5, False)):
        p = np.tile([0.1, -1.0], m)
        proved = taken(ReducedProblem(np.eye(2 * m), p, np.full(m, 0.5)), [pieces])
        assert (proved is not None) == holds
        assert not holds or [q.codes.tolist() for q in proved.inside] == [[1] * m]
    assert MOST_PIECES == 256


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


def test_differences_of_three_solutions_are_not_definite():
    """Where there are others, no weights prove that there are none."""
    problem = ReducedProblem(*THREE).scaled
    region = StatusRegion.whole(problem)
    rng = np.random.default_rng(0)
    for code in (0, 1, 3):
        piece = solve_piece(problem, np.array([code], dtype=np.int8))
        found = differences(piece, region.allowed, region.ub)
        if found is None:
            continue
        n = len(found.unknown)
        for _ in range(200):
            weights, theta = 10 ** rng.uniform(-3, 3, n), rng.uniform(-1 / 3, 1 / 3, n)
            assert not found.prove(weights, theta, float(10 ** rng.uniform(-3, 3)))


def node_in_space(**errors):
    S = np.array([[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]])
    return ReducedProblem(S, np.array([-2.5, 0.1, -1.0]), np.array([3.0]), **errors)


def test_steps_in_space():
    """Arcs are halved down to their least width; parts hold all cells; numbers are numbers."""
    problem = node_in_space()
    halve, opened = {"do": "halve", "point": 0}, {"do": "open", "why": "x"}
    times = int(np.log2(0.5 / NARROWEST))
    part = {"do": "branch", "point": 0, "parts": [[2], [0, 1, *range(3, 10)]]}
    half = {"do": "branch", "point": 0, "parts": [[0], [1]]}
    narrow = [part, *[halve, half] * times]
    assert taken(problem, [*narrow, *[opened] * (times + 2)]).verdict == "open"
    assert taken(problem, [*narrow, halve, *[opened] * (times + 2)]) is None
    every = list(range(10))
    holding = [[every], [every[:5], every[5:]], [every[:5], every]]
    lacking = [[every[1:]], [every, []], [], [[*every, 10]], [[-1, *every]]]
    for parts in (*holding, *lacking):
        steps = [{"do": "branch", "point": 0, "parts": parts}, *[opened] * len(parts)]
        assert (taken(problem, steps) is not None) == (parts in holding)
    for point in (-1, 1, "0", None):
        assert taken(problem, [{**halve, "point": point}, opened]) is None
    assert taken(problem, [{"do": "rest"}]) is None
    assert taken(problem, [{"do": "nothing", "y": 0}], [np.zeros(3)]) is None
    bound = {"do": "bound", "y": 0, "quantity": 4, "point": 0, "value": 1e6}
    assert taken(problem, [bound, opened], [np.zeros(3)])
    for change in ({"quantity": 10}, {"quantity": -1}, {"point": 1}, {"y": 1}, {"value": -1e6}):
        assert taken(problem, [{**bound, **change}, opened], [np.zeros(3)]) is None


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


def test_statuses_that_a_point_in_space_cannot_have():
    """Slips have no sense there, and what is open and sticks needs a bound given in advance."""
    S, z = np.diag([2.0, 2.0, 4.0]), [[0.0, 0.0, 0.0]]
    known = [0.05, 0.0, -1.0]
    for friction, bound, codes in ((0.5, 0.0, {1}), (0.0, 0.0, {2}), (0.0, 0.1, {1})):
        problem = ReducedProblem(S, known, np.array([friction]), np.array([bound]))
        for code in range(-1, 8):
            solved = {1: [-0.05, 0.0, 1.0], 2: [0.025, 0.0, 1.0]}.get(code, z[0])
            step = {"do": "only", "codes": [code], "z": [solved], "mu": 1.0}
            step["weights"] = np.ones((9, 1)).tolist()
            proved = taken(problem, [step])
            assert (proved is not None and len(proved.inside) == 1) == (code in codes), code
            for change in ({"z": [solved[:2]]}, {"z": solved}, {"codes": [code, code]}):
                assert taken(problem, [{**step, **change}]) is None


def test_what_differences_need():
    """A known solution fits the sets only where its own status does; weights are not negative."""
    flat = ReducedProblem(*THREE).scaled
    ub = StatusRegion.whole(flat).ub
    slip, stick = (solve_piece(flat, np.array([code], dtype=np.int8)) for code in (3, 1))
    fitting = [(slip, 8), (stick, 2)]
    others = [(slip, 2), (slip, 1), (slip, 4), (stick, 8), (stick, 9)]
    for piece, allowed in (*fitting, *others):
        found = differences(piece, np.array([allowed]), ub)
        assert (found is not None) == ((piece, allowed) in fitting)
    problem = node_in_space().scaled
    region = SpaceRegion.whole(problem)
    cells = region.cells
    starts = [np.linalg.solve(problem.S, problem.p), -problem.p, np.array([0.5, 3.1, 0.5])]
    pieces = [
        solve_in_space(problem, np.array([code], dtype=np.int8), z[None])
        for code, z in enumerate(starts)
    ]
    for code, kind in itertools.product(range(3), range(3)):
        found = space_differences(pieces[code], cells.kept(cells.kind == kind), region.most)
        assert (found is not None) == (code == kind)
    stuck = space_differences(pieces[1], cells.kept(cells.kind == 1), region.most)
    assert len(stuck.unknown) == 0
    opened = space_differences(pieces[0], cells.kept(cells.kind == 0), region.most)
    weights = np.ones((9, 1))
    assert opened.prove(weights, 1.0)
    for mu in (-1e-9, -1.0, np.nan, np.inf, 0.0):
        assert not opened.prove(weights, mu)
    for bad in (-1e-9, np.nan, np.inf):
        other = weights.copy()
        other[8] = bad
        assert not opened.prove(other, 1.0)
    given = ReducedProblem(
        np.eye(3), np.array([0.1, 0.0, -1.0]), np.zeros(1), np.array([0.5])
    ).scaled
    held = solve_in_space(given, np.array([1], dtype=np.int8), -given.p[None])
    whole = SpaceRegion.whole(given)
    beyond = ReducedProblem(
        np.eye(3), np.array([0.9, 0.0, -1.0]), np.zeros(1), np.array([0.5])
    ).scaled
    drawn = solve_in_space(beyond, np.array([1], dtype=np.int8), -beyond.p[None])
    assert drawn.verdict == "outside"
    closed = whole.cells.kept(whole.cells.kind == 3)
    assert space_differences(drawn, closed, whole.most) is None
    for kind, fits in ((0, False), (3, True)):
        kept = whole.cells.kept(whole.cells.kind == kind)
        assert (space_differences(held, kept, whole.most) is not None) == fits


def test_a_slip_of_data_with_errors():
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


def test_arcs_on_either_side():
    """The angle between two slips is bounded up to 2.8, more than a right angle."""
    problem = node_in_space().scaled
    piece = solve_in_space(problem, np.array([2], dtype=np.int8), np.array([[0.5, 3.1, 0.5]]))
    region = SpaceRegion.whole(problem)
    for first, last, bounded in ((3, 5, True), (5, 7, True), (2, 5, False), (2, 9, False)):
        keep = (region.cells.kind == 2) & np.isin(np.arange(10), range(first, last + 1))
        cells = region.cells.kept(keep)
        found = space_differences(piece, cells, region.most)
        assert found.has[6, 0] == bounded


def test_what_two_in_space_say_of_each_other():
    """A solution is the same as itself from another start, and not another one."""
    problem = node_in_space().scaled
    slip = np.array([2], dtype=np.int8)
    starts = [np.array([[0.5, angle, 0.5]]) for angle in (3.0, -3.2, 3.3)]
    one, other, third = (solve_in_space(problem, slip, z) for z in starts)
    assert one.same(other) is True
    assert one.same(third) is True
    stick = solve_in_space(problem, np.array([1], dtype=np.int8), -problem.p[None])
    assert one.same(stick) is False
    moved = copy.copy(one)
    object.__setattr__(moved, "z", one.z + np.array([0.1, 0.0, 0.0]))
    for name in ("numbers", "unknowns"):
        moved.__dict__.pop(name, None)
    assert one.same(moved) is False
