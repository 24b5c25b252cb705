"""Small parts of continuation and evolution whose answers are known beforehand."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from textbook import Textbook, coulomb_system

from dolfinx_contact._factor import Factor
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.continuation.affine import TOLERANCE
from dolfinx_contact.continuation.batch import BatchedSteps, Crossed, FreeSteps
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.borders import reached
from dolfinx_contact.continuation.branch import BranchPoint, Change, Ray
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.continuation.ray_finder import Kink, RayFinder
from dolfinx_contact.continuation.rays import (
    AffineRay,
    Rays,
    _enumerate,
    _far_end,
    _inverses,
    _kernel,
    _other_end,
)
from dolfinx_contact.continuation.row_update import RowUpdate
from dolfinx_contact.continuation.steps import ExactSteps
from dolfinx_contact.continuation.system import Events, Piece
from dolfinx_contact.evolution.arc_steps import _cubic, _end_reached
from dolfinx_contact.evolution.sliding_steps import _FOLDS, SlidingSteps
from dolfinx_contact.evolution.through_times import ThroughTimes, _aim, checked_times
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN
from dolfinx_contact.solvers.history import ConvergenceError
from dolfinx_contact.solvers.pivoting import _by_stick

COMM = MPI.COMM_WORLD

# -- pieces, their borders and their matrices ----------------------------------------------------


def events(*each):
    """Events of (distance, point, target)."""
    distance, point, target = zip(*each, strict=True)
    types = np.float64, np.int32, np.int8
    return Events(*(np.array(v, t) for v, t in zip((distance, point, target), types, strict=True)))


def test_where_borders_are_reached():
    """On the straight line between two distances; halfway where a border is in one state alone."""
    low = events((1.0, 0, STICK), (2.0, 1, OPEN), (0.0, 2, OPEN), (-0.1, 3, PLUS), (1.0, 4, PLUS))
    high = events(
        (-1.0, 0, STICK), (3.0, 1, OPEN), (-2.0, 2, OPEN), (-1.0, 3, PLUS), (-3.0, 4, PLUS)
    )
    np.testing.assert_allclose(reached(low, high), [0.5, np.inf, 0.0, 0.0, 0.25])
    np.testing.assert_allclose(reached(low, high, (3.0, 1.0)), [0.75, np.inf, 0.0, 0.0, 0.5])
    other = events((-1.0, 4, PLUS), (-1.0, 0, MINUS), (1.0, 7, PLUS), (-9.0, 0, STICK))
    np.testing.assert_allclose(reached(low, other), [0.5, 0.5, np.inf, 0.1])
    at_border = events((0.0, 0, STICK), (0.0, 9, OPEN), (-0.0, 1, OPEN))  # inside still
    np.testing.assert_array_equal(reached(low, at_border), np.inf)


def test_statuses_that_hold_a_state():
    """By Coulomb's law with F = 1/2; what a point alone says is what all of them say."""
    states = {
        (0.1, 0.2, 0.0, 0.0): {OPEN},
        (0.1, 0.0, 0.0, 0.0): {OPEN, PLUS},
        (0.0, 0.0, 0.0, 0.0): {OPEN, STICK, PLUS, MINUS},
        (0.0, 0.0, 0.1, 1.0): {STICK},
        (0.0, 0.0, -0.5, 1.0): {STICK, PLUS},
        (0.2, 0.0, -0.5, 1.0): {PLUS},
        (-0.2, 0.0, 0.5, 1.0): {MINUS},
        (0.2, 0.0, 0.5, 1.0): set(),
        (0.0, 0.0, 0.6, 1.0): set(),
        (0.0, -0.1, 0.0, 0.0): set(),
        (0.0, 0.1, 0.0, 1.0): set(),
    }
    w = np.array(list(states))
    m = len(w)
    system = coulomb_system(np.eye(2 * m), np.zeros(2 * m), np.zeros(2 * m), 0.5)
    held = system.statuses_at(w, 1e-12)
    for i, wanted in enumerate(states.values()):
        assert set(np.flatnonzero(held[i])) == wanted, w[i]
        np.testing.assert_array_equal(system.statuses_of(i, w[i], 1e-12), held[i])
    # What Newton's method takes is one of them, if there is one.
    codes = system.classify(w)
    for i, wanted in enumerate(states.values()):
        assert codes[i] in (wanted or {OPEN, STICK, PLUS, MINUS})


def test_kernels_of_pieces():
    """The dimension of the solutions (z, rate) of A z = rate q, and the only one."""
    q = np.array([1.0, 2.0])
    for A, dimension, exact in (
        (np.array([[2.0, 0.0], [0.0, 4.0]]), 1, (0.5, 0.5, 1.0)),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), 1, (1.0, -1.0, 0.0)),
        (np.array([[1.0, 1.0], [2.0, 2.0]]), 2, None),
        (np.diag([1.0, 1e-11]), -1, None),
    ):
        found, vector = _kernel(A, q)
        assert found == dimension
        assert (vector is None) is (exact is None)
        if vector is not None:
            z = np.append(*vector)
            assert abs(z @ exact) == pytest.approx(np.linalg.norm(exact), rel=1e-12)
    assert _kernel(np.ones((3, 3)), np.ones(3)) == (3, None)
    assert _kernel(np.zeros((2, 2)), np.zeros(2)) == (3, None)


def test_inverses_with_singular_ones_among_them():
    A = np.random.default_rng(3).normal(size=(7, 3, 3))
    A[[2, 5]] = 1.0
    A[2, 0] = A[5, 2] = 0.0
    inverses = _inverses(A)
    for i in range(7):
        if i in (2, 5):
            assert not np.isfinite(inverses[i]).any()
        else:
            np.testing.assert_allclose(inverses[i] @ A[i], np.eye(3), atol=1e-12)


def test_rays_of_points_that_leave_a_body_free():
    """Two open points that move together under no force, whatever a third one does."""
    S = np.eye(6)
    S[np.ix_([0, 2], [0, 2])] = [[1.0, -1.0], [-1.0, 1.0]]
    rate = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # no displacement bears it
    system = coulomb_system(S, np.zeros(6), rate, 0.5)
    choices = [np.array([OPEN]), np.array([OPEN]), np.array([OPEN, STICK])]
    wide = []
    rays = list(_enumerate(system, choices, wide))
    assert wide == []
    along = np.zeros((3, 4))
    along[:2, 0] = 1.0
    for code in choices[2]:
        mine = [r for r in rays if r.codes.tolist() == [OPEN, OPEN, code]]
        first, second = sorted(mine, key=lambda r: -r.direction[0, 0])
        assert (first.rate, second.rate) == (0.0, 0.0)
        np.testing.assert_allclose(first.direction, along, atol=1e-12)
        np.testing.assert_allclose(second.direction, -along, atol=1e-12)
    assert len(rays) == 4


def test_directions_that_lead_out_of_a_state():
    """Of what is inside a cone nothing is left, and all of what is at its border."""
    system = coulomb_system(np.eye(4), np.zeros(4), np.zeros(4), 0.5)
    w = np.array([[0.0, 0.0, 0.1, 1.0], [0.0, 0.0, -0.5, 1.0]])
    cone = system.tangent_cone(w, 1e-12)
    np.testing.assert_array_equal(cone.allowed, system.statuses_at(w, 1e-12))
    np.testing.assert_array_equal(cone.inequalities[0, STICK], 0.0)
    at_border = np.abs(system.inequalities[1, STICK] @ w[1]) < 1e-15
    assert 0 < at_border.sum() < len(at_border)
    kept = np.where(at_border[:, None], system.inequalities[1, STICK], 0.0)
    np.testing.assert_array_equal(cone.inequalities[1, STICK], kept)
    assert np.abs(kept).max() > 0


@pytest.mark.parametrize("rate", [(0.3, 0.0), (0.0, 0.0)])
def test_a_branch_that_meets_no_border(rate):
    """An open point that is moved along its obstacle, or not at all, stays as it is."""
    system = coulomb_system(np.eye(2), np.array([0.0, 1.0]), np.array(rate), 0.5)
    piece = system.piece(np.array([OPEN], dtype=np.int8))
    for sense in (1.0, -1.0):
        found = _far_end(piece, 7.0, sense)
        assert (found.codes.tolist(), found.rate) == ([OPEN], sense)
        expected = sense * np.array([[*rate, 0.0, 0.0]])
        np.testing.assert_allclose(found.direction, expected, atol=1e-15)


@pytest.mark.parametrize("rate", [1.0, -1.0, 0.0])
def test_where_a_branch_comes_out_again(rate):
    """By the other end of a straight line; of a ray without load it is not known."""
    system = coulomb_system(np.eye(2), np.array([0.0, 1.0]), np.array([0.3, 0.0]), 0.5)
    along = np.array([[0.3, 0.0, 0.0, 0.0]])
    found = _other_end(system, AffineRay(np.array([OPEN], dtype=np.int8), rate * along, rate))
    if rate == 0:
        assert found is None
    else:
        assert (found.codes.tolist(), found.rate) == ([OPEN], -rate)
        np.testing.assert_allclose(found.direction, -rate * along, atol=1e-12)


def of_all_ranks(A):
    """A dense matrix as one of PETSc, its rows on all ranks, with all entries."""
    n = len(A)
    found = PETSc.Mat().createAIJ((n, n), nnz=n, comm=COMM)
    found.setUp()
    start, end = found.getOwnershipRange()
    found.setValues(range(start, end), range(n), A[start:end])
    found.assemble()
    return found


def test_matrices_that_differ_in_rows_and_a_column():
    """Solutions and signs of determinants as of numpy; what does not serve is not taken."""
    rng = np.random.default_rng(11)
    n = 6
    base = rng.normal(size=(n, n))
    matrix = of_all_ranks(base)
    factor = Factor(COMM, "rows_", determinant=True)
    assert factor.factorise(matrix)
    update = RowUpdate(factor)
    update.begin(matrix)
    b, x = matrix.createVecs()
    b.array[:] = 1.0

    def solves(A):
        assert update.solve(b, x)
        parts = np.concatenate(COMM.allgather(x.array_r))
        np.testing.assert_allclose(A @ parts, np.ones(n), atol=1e-9)
        assert update.determinant_sign == np.sign(np.linalg.det(A))

    for rows, border in (((1,), False), ((0, 4), True), ((), True), ((), False), ((2, 5), False)):
        for _ in range(3):
            new = base.copy()
            new[list(rows)] = rng.normal(size=(len(rows), n))
            if border:
                new[:, -1] = rng.normal(size=n)
                new[[0, 4]] = base[[0, 4]] if not rows else new[[0, 4]]
            changed = of_all_ranks(new)
            assert update.take(changed, 2)
            assert update.changed == len(rows)
            solves(new)
    singular = base.copy()
    singular[3] = singular[2]
    assert not update.take(of_all_ranks(singular), 2)
    solves(base)
    three = base + np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert not update.take(of_all_ranks(three), 2)
    assert update.changed == 3
    solves(base)
    noise = base * (1 + 1e-14 * rng.normal(size=(n, n)))
    assert update.take(of_all_ranks(noise), 0)
    update.destroy()


def test_a_factorisation_serves_matrices_that_differ_in_a_few_rows():
    """Solutions, signs and their quotients are numpy's; with more rows it is factorised anew."""
    rng = np.random.default_rng(5)
    n = 12
    base = rng.normal(size=(n + 1, n + 1))
    now = {}
    system = Textbook(n, lambda x, g, s: x, lambda *_: now["J"][:n, :n], lambda *_: now["J"][:n, n])
    b = Bordered(system, gamma_scale=1.0)
    y, row, rhs, out = (b.vector() for _ in range(4))
    rhs.array[:] = 1.0

    def put(J):
        now["J"] = J
        x = system.create_vector()
        x.array[:] = J[n, slice(*x.getOwnershipRange())]
        b.join(x, J[n, n], row)

    for changed, factorisations in (((), 1), ((3, 7), 1), ((n,), 1), (range(9), 2)):
        J = base.copy()
        J[list(changed)] = rng.normal(size=(len(changed), n + 1))
        put(J)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        whole = np.concatenate(COMM.allgather(out.array_r))
        np.testing.assert_allclose(J @ whole, np.ones(n + 1), atol=1e-10)
        sign = b.solver.determinant_sign()
        assert sign == np.sign(np.linalg.det(J))
        assert b.solver.factorisations == factorisations
    # At states that change most rows the formula is tried once, and no more.
    tried = []
    take = b.solver._take
    b.solver._take = lambda: tried.append(0) or take()
    for number in (1.0, 2.0):
        y.array[:] = number
        J = rng.normal(size=(n + 1, n + 1))
        put(J)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        assert len(tried) == 1
    assert b.solver.factorisations == 4
    # A sign is that of the matrix as it is, solved with or not.
    for _ in range(6):
        J = rng.normal(size=(n + 1, n + 1))
        put(J)
        b.solver.assemble(y, row, None)
        assert b.solver.determinant_sign() == np.sign(np.linalg.det(J))
    b.destroy()


def test_statuses_without_a_derivative():
    """Where the shear grows as the length of a vector, no two changes add up."""

    def H(x, _g, codes):
        return x + np.array([np.hypot(x[0], x[1]) if codes[0] == PLUS else 2 * x[1], 0.0, 0.0])

    system = Textbook(3, H, None, None, codes=lambda x, g: [OPEN])
    corrector = Corrector(Bordered(system, gamma_scale=1.0), StepControl())
    kink = Kink(COMM.size - 1, 0, OPEN, STICK, (OPEN, STICK, PLUS))
    y = corrector.bordered.vector()
    finder = RayFinder(corrector, y, bool, PETSc.Vec.norm)
    piece = system.piece_at(system.create_vector(), 0.0)
    assert finder.rough_statuses(piece, [kink]) == {PLUS}
    y.array[:] = 1.0  # away from its kink it has one
    assert finder.rough_statuses(piece, [kink]) == set()


def test_slip_turns_by_way_of_stick():
    """Where it is to reverse, at open points too; all else changes at once."""
    pairs = {
        (PLUS, MINUS): STICK,
        (MINUS, PLUS): STICK,
        (PLUS, OPEN): OPEN,
        (STICK, MINUS): MINUS,
        (OPEN, PLUS): PLUS,
        (PLUS, PLUS): PLUS,
        (PLUS + WHERE_OPEN, MINUS): STICK + WHERE_OPEN,
    }
    held, required = np.array(list(pairs), dtype=np.int8).T
    np.testing.assert_array_equal(_by_stick(required, held), list(pairs.values()))


# -- steps ----------------------------------------------------------------------------------------


def test_a_cubic_through_two_ends():
    """It is found again from its values and rates at the ends, inside them."""
    p = np.polynomial.Polynomial([1.0, -2.0, 3.0, -4.0])
    ends = np.array([0.0, 2.5])
    inside = np.linspace(*ends, 17)[1:-1]
    value, slope = _cubic(p(ends), p.deriv()(ends), 2.5)
    np.testing.assert_allclose(value[:, 0], p(inside), rtol=1e-12)
    np.testing.assert_allclose(slope[:, 0], p.deriv()(inside), rtol=1e-12)


def test_ends_of_a_range_that_are_reached():
    """Beyond them, and near them unless the step began there."""
    for before, gamma, end in (
        (0.0, 0.5, None),
        (0.5, 1.5, 1.0),
        (0.0, -2.5, -2.0),
        (0.5, 1.0 - 1e-10, 1.0),
        (0.5, 1.0 - 1e-9, None),
        (-1.0, -2.0, -2.0),
        (1.0, 1.0 - 1e-11, None),
        (-2.0, -2.0 + 1e-11, None),
        (-2.0, 1.0, 1.0),
    ):
        assert _end_reached(before, gamma, (-2.0, 1.0)) == end


def test_equal_steps_to_a_time():
    """As few as are no longer than asked for, but for round-off."""
    for end, length, number in ((1.0, 0.1, 10), (0.3, 0.1, 3), (1.0, 0.4, 3), (1.0, 2.0, 1)):
        times = [0.0]
        while times[-1] < end:
            times.append(_aim(times[-1], end, length))
        np.testing.assert_allclose(times, np.linspace(0.0, end, number + 1), rtol=1e-12)
        assert times[-1] == end


def test_times_begin_where_the_evolution_is():
    """But for the round-off of sums, which is that of the whole time."""
    now = SimpleNamespace(time=0.1 + 0.2)
    assert checked_times([0.3, 5.0], now) == (now.time, 5.0)
    assert checked_times([0.3 + 1e-9, 5.0], now) == (now.time, 5.0)
    for wrong in (0.3 + 1e-8, 0.3 - 1e-8):
        with pytest.raises(ValueError, match="the evolution is at the time"):
            checked_times([wrong, 5.0], now)


@pytest.mark.parametrize(("length", "next_one"), [(0.2, 0.4), (0.7, 1.0)])
def test_steps_grow_to_twice_their_length(length, next_one):
    """After one that was accepted, but not beyond the longest."""
    known = SimpleNamespace(
        task=SimpleNamespace(follow_rays=False, longest=1.0),
        _length=length,
        _step=lambda *_: SimpleNamespace(number=4),
        _sizes=SimpleNamespace(accept=lambda solved, jump: None),
        _end_if_reached=lambda solved: None,
    )
    forked = SimpleNamespace(solved=SimpleNamespace(after="after"), directions=None)
    ThroughTimes._accept(known, forked, jump=True)
    assert (known._length, known._number, known._accepted) == (next_one, 4, "after")
    assert (known._rejected, known._settled) == (0, True)


def test_what_counts_as_folded():
    """Of a state that is not folded the smallest det F falls below a part of it, or of 1."""
    for before, after, folded in (
        (1.0, 1.01 * _FOLDS, False),
        (1.0, 0.99 * _FOLDS, True),
        (4.0, 1.01 * _FOLDS, False),
        (0.5, 0.51 * _FOLDS, False),
        (0.5, 0.49 * _FOLDS, True),
        (0.0, -1.0, False),
        (-0.1, -1.0, False),
    ):
        known = SimpleNamespace(_folds=True, _smallest=lambda state: state.det)
        ends = (SimpleNamespace(solved=True, det=det) for det in (before, after))
        solved = SimpleNamespace(**dict(zip(("before", "after"), ends, strict=True)))
        if folded:
            with pytest.raises(ConvergenceError, match="is folded"):
                SlidingSteps.require_unfolded(known, solved)
        else:
            SlidingSteps.require_unfolded(known, solved)
            assert known._known == (solved.after, after)


def along(corrector, *coordinates):
    """States of a system of as many unknowns, and gamma = 0."""
    b = corrector.bordered
    x = b.system.create_vector()
    x.array[:] = np.array(coordinates)[slice(*x.getOwnershipRange())]
    y = b.vector()
    b.join(x, 0.0, y)
    return y


def of_distances(*statuses):
    """A corrector of a system whose points have the unknowns as distances to one border each."""
    n = len(statuses)

    def distances(x, _g, _codes):
        return [[(value, OPEN)] for value in x]

    codes = np.array(statuses, dtype=np.int8)
    system = Textbook(n, lambda x, g, c: x, None, None, distances, lambda x, g: codes)
    return Corrector(Bordered(system, gamma_scale=1.0), StepControl())


def test_changes_of_a_step_in_order():
    """To larger and to smaller codes, each where its distance vanishes; none of what stays."""
    corrector = of_distances(OPEN, PLUS, STICK, MINUS)
    last = COMM.size - 1
    codes = np.array([PLUS, OPEN, STICK, STICK], dtype=np.int8)
    system = corrector.bordered.system
    old = system.piece_at(system.create_vector(), 0.0)
    new = Piece(codes if COMM.rank == last else old.codes)
    start = BranchPoint(along(corrector, 1.0, 1.0, -1.0, 3.0), None, old, 0.0, 0.0, 0)
    found = FreeSteps(corrector).changes(start, along(corrector, -1.0, -3.0, 1.0, -1.0), new)
    assert [change for _, change in found] == [
        Change(last, 1, PLUS, OPEN),
        Change(last, 0, OPEN, PLUS),
        Change(last, 3, MINUS, STICK),
    ]
    np.testing.assert_allclose([fraction for fraction, _ in found], [0.25, 0.5, 0.75])


@pytest.mark.parametrize(("changes", "tried"), [(1, 1), (3, 1), (4, 6), (0, 6)])
def test_how_often_a_step_is_shortened(changes, tried, monkeypatch):
    """Until it holds a few changes, or has been as often as is allowed; each length once."""
    lengths = []
    step = Crossed(None, tuple((0.5, Change(0, i, STICK, OPEN)) for i in range(changes)))
    corrector = of_distances(STICK)
    steps = BatchedSteps(corrector)
    monkeypatch.setattr(steps, "try_step", lambda point, h: lengths.append(h) or step)
    monkeypatch.setattr(ExactSteps, "step", lambda self, point, h: (None, [], h))
    first = corrector.control.maximum
    steps.step(None, first)
    np.testing.assert_allclose(lengths, first * corrector.control.decrease ** np.arange(tried))


@pytest.mark.parametrize(("fractions", "parity"), [((0.25,), -1), ((0.25, 0.75), 0)])
def test_events_of_one_step(fractions, parity):
    """As far along as their changes; a parity is that of the step, which has one of them."""
    corrector = of_distances(STICK)
    start, new = (BranchPoint(None, None, None, gamma, 0.0, 0) for gamma in (1.0, 3.0))
    changes = tuple((part, Change(0, i, STICK, OPEN)) for i, part in enumerate(fractions))
    found = FreeSteps(corrector).events(start, new, Crossed(new, changes, parity=-1))
    for special, (part, change) in zip(found, changes, strict=True):
        assert (special.kind, special.smooth, special.gamma) == ("event", False, 1.0 + 2 * part)
        assert (special.changes, special.parity) == ((change,), parity)
        assert special.bracket == (1.0, 3.0)


@pytest.mark.parametrize(("gamma", "end"), [(-3.0, -2.0), (1.5, 1.0)])
def test_the_end_that_a_step_goes_beyond(gamma, end, monkeypatch):
    """Is where the branch is cut; what is found beyond it is left out."""
    corrector = of_distances(STICK)
    monkeypatch.setattr(corrector, "natural", lambda y, gamma, piece: False)
    steps = FreeSteps(corrector)
    cut = []
    monkeypatch.setattr(steps, "piece_between", lambda a, c: None)
    monkeypatch.setattr(steps, "between", lambda a, c, at: (cut.append(at), at))
    start, new = (BranchPoint(None, None, None, g, 0.0, 0) for g in (0.0, gamma))
    special = [SimpleNamespace(smooth=s, gamma=g) for s in (True, False) for g in (-2.5, 0.5, 1.2)]
    assert steps.end_at(start, new, special, (-2.0, 1.0)) == (new, [special[1]])
    assert cut == [end]


@pytest.mark.parametrize(("located", "batched"), [(None, True), (False, True), (True, False)])
def test_changes_that_are_located_are_not_batched(located, batched, monkeypatch):
    """Even those at the very end of a step."""
    corrector = of_distances(STICK)
    start, new = (BranchPoint(None, None, None, gamma, 0.0, 0) for gamma in (1.0, 3.0))
    step = Crossed(new, ((1.0, Change(COMM.rank, 0, STICK, OPEN)),), False, 1)
    steps = BatchedSteps(corrector, None if located is None else lambda change: located)
    monkeypatch.setattr(steps, "try_step", lambda point, h: step)
    monkeypatch.setattr(steps, "rescaled", lambda point: point)
    monkeypatch.setattr(ExactSteps, "step", lambda self, point, h: (None, [], h))
    found, special, _ = steps.step(start, corrector.control.maximum)
    assert found is (new if batched else None)
    assert len(special) == batched


# -- by pivots ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rate", "exact"), [(1.0, True), (-1.0, True), (0.0, False)])
def test_the_state_at_a_vertex(rate, exact):
    """That of the piece, which along a ray without load does not know it; else of the segment."""
    w = np.array([[1.0, 2.0]])
    ray = AffineRay(np.zeros(1, dtype=np.int8), np.array([[0.5, -1.0]]), rate)
    end = w + 2.0 * ray.direction
    for off in (0.5 * TOLERANCE, 2.0 * TOLERANCE):
        at = end + 4.0 * off
        piece = SimpleNamespace(at=lambda gamma, at=at: at)
        known = SimpleNamespace(_piece=lambda codes, piece=piece: piece, _unit=4.0)
        found = Pivoting.moved(known, w, 0.7, 2.0, ray)
        np.testing.assert_array_equal(found, at if exact and off < TOLERANCE else end)


@pytest.mark.parametrize(
    ("signs", "rates", "kind", "parity"),
    [
        ((1, -1), (1.0, -1.0), "fold", 1),
        ((1, -1), (1.0, 1.0), "event", -1),
        ((1, None), (1.0, 0.0), "event", 0),
        ((None, 1), (0.0, 1.0), "event", 0),
        ((1, 1), (-1.0, -1.0), "event", 1),
    ],
)
def test_the_parity_at_a_vertex(signs, rates, kind, parity):
    """The sign of the ratio of det A/gamma' on both sides; 0 where a piece is singular."""
    first, second = (
        AffineRay(np.array([code], dtype=np.int8), np.ones((1, 4)), rate)
        for code, rate in zip((STICK, PLUS), rates, strict=True)
    )
    pieces = [s and SimpleNamespace(sign=s) for s in signs]
    known = SimpleNamespace(
        _piece=lambda codes: pieces[int(codes[0] == PLUS)],
        _rays_onwards=lambda *_: Rays((second,), True, "all"),
        _parity=Pivoting._parity,
        point=lambda *_: SimpleNamespace(y=None, piece=None, tangent=None),
        condensed=SimpleNamespace(point=lambda i: (0, i)),
    )
    _, special, onwards = Pivoting.cross(known, np.zeros((1, 4)), 0.5, first, 1.0)
    assert onwards is second
    assert (special.kind, special.parity) == (kind, parity)
    assert special.changes == (Change(0, 0, STICK, PLUS),)


def test_points_by_pivots():
    """They are exact, without corrections; at a special point a branch begins with no step."""

    def vector():
        return PETSc.Vec().createWithArray(np.zeros(1), comm=MPI.COMM_SELF)

    known = SimpleNamespace(
        bordered=SimpleNamespace(vector=vector, join=lambda *_: None),
        system=SimpleNamespace(create_vector=vector),
        condensed=SimpleNamespace(expand=lambda *_: None, piece=lambda codes: "piece"),
        _tangent=lambda *_: None,
        _unit=1.0,
    )
    w = np.array([[3.0, -4.0]])
    ray = AffineRay(np.zeros(1, dtype=np.int8), w, 1.0)
    found = Pivoting.point(known, w, 0.5, ray, 2.0)
    assert (found.piece, found.gamma, found.step, found.corrections) == ("piece", 0.5, 2.0, 0)
    assert known._unit == 4.0
    special = SimpleNamespace(y=None, gamma=0.5)
    start = Pivoting.branch_off(known, special, Ray("other", None))
    assert (start.piece, start.gamma, start.step, start.corrections) == ("other", 0.5, 0.0, 0)


@pytest.mark.parametrize(
    ("start", "codes", "passed"),
    [
        ((0.6, 0.8), STICK, True),
        ((1.2, 1.6), STICK, True),
        ((1.5, 2.0), STICK, False),
        ((-0.6, -0.8), STICK, False),
        ((0.0, 0.0), STICK, False),
        ((0.6, 0.81), STICK, False),
        ((0.6, 0.8), PLUS, False),
    ],
)
def test_segments_that_pass_a_start(start, codes, passed):
    """In their own statuses, beyond their first point and up to their last."""
    ray = AffineRay(np.array([STICK], dtype=np.int8), np.array([[0.6, 0.8]]), 1.0)
    known = SimpleNamespace(condensed=SimpleNamespace(codes=lambda piece: piece), _unit=1.0)
    w_start = np.array([start])
    at = SimpleNamespace(piece=np.array([codes], dtype=np.int8))
    assert Pivoting.passes(known, np.zeros((1, 2)), ray, 2.0, w_start, at) is passed


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_one_ray_onwards_in_any_units(unit):
    """Of two points with F = 1/2 that stick, one begins to slip when its shear is half of rn = 1:

    it is the only one there, so that nothing else is looked for.
    """
    system = coulomb_system(
        np.eye(4), unit * np.array([0.0, -1.0, 0.0, -1.0]), unit * np.array([1.0, 0, 0.1, 0]), 0.5
    )
    codes = np.full(2, STICK, dtype=np.int8)
    before = system.piece(codes)
    w = before.at(0.5)
    expected = unit * np.array([[0.0, 0.0, -0.5, 1.0], [0.0, 0.0, -0.05, 1.0]])
    np.testing.assert_allclose(w, expected, atol=1e-14 * unit)
    ray = AffineRay(codes, before.coefficients[1], 1.0)
    known = SimpleNamespace(
        condensed=SimpleNamespace(system=system), _unit=unit, _parity=Pivoting._parity
    )
    found = Pivoting._rays_onwards(known, w, 0.5, ray, before)
    (only,) = found.rays
    assert (only.codes.tolist(), only.rate, found.method) == ([PLUS, STICK], 1.0, "")
    rates = unit * np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -0.1, 0.0]])
    np.testing.assert_allclose(only.direction, rates, atol=1e-14 * unit)
