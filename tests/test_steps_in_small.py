"""Steps over kinks, rays led by H and rounds of pivots; what surrounds each is given."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from textbook import Textbook

from dolfinx_contact.continuation import Piece, StepControl
from dolfinx_contact.continuation.batch import BatchedSteps, Crossed, FreeSteps
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import BranchPoint, Change, SpecialPoint
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ray_finder import Kink, RayFinder
from dolfinx_contact.continuation.steps import ExactSteps
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.solvers import pivoting

COMM = MPI.COMM_WORLD
CHANGE = (0.5, Change(0, 0, STICK, OPEN))


def vector(*numbers):
    return PETSc.Vec().createWithArray(np.array(numbers, dtype=float), comm=MPI.COMM_SELF)


def gamma_of(v):
    return float(v.array_r[-1])


def stepper(*, y, tangent, before=1.0, after=-1.0, changes=(CHANGE,), lands=True, turned=False):
    """What a step on H itself needs, where it is known where it leads."""
    asked = []

    def moore_penrose(there, t, piece):
        asked.append((there.array_r.copy(), piece))
        if y is None:
            return False
        there.array[:] = y
        return True

    def tangent_at(at, towards, piece, **how):
        asked.append((piece, how))
        return tangent

    corrector = SimpleNamespace(
        moore_penrose=moore_penrose, tangent=tangent_at, iterations=3, orientation=lambda: after
    )
    bordered = SimpleNamespace(
        gamma=gamma_of, split=lambda v: (v, 0.0), inner=lambda a, b: 4.0 * a.dot(b)
    )
    return asked, SimpleNamespace(
        corrector=corrector,
        bordered=bordered,
        system=SimpleNamespace(piece_at=lambda x, gamma: "new"),
        changes=lambda *_: changes,
        _orientation=lambda point: before,
        lands=lambda *_: lands,
        test=lambda accepted: 0.25,
        turned=lambda a, b: turned,
        _oriented=None,
    )


@pytest.mark.parametrize(
    ("gamma", "rate", "turned"),
    [
        (0.06, 0.3, False),
        (0.026, 0.3, False),
        (0.024, 0.3, True),
        (0.03, 0.05, False),
        (0.001, 0.05, True),
        (-0.06, 0.3, True),
        (0.06, -0.2, True),
    ],
)
def test_where_gamma_turns_twice_in_a_step(gamma, rate, turned):
    """Where it goes by less than half of what the slower rate has it go."""
    asked, known = stepper(y=(0.08, gamma), tangent=vector(0.4, rate))
    point = BranchPoint(vector(0.0, 0.0), vector(0.4, 0.3), "old", 0.0, 0.0, 0)
    found = FreeSteps.try_step(known, point, 0.2)
    assert asked[0][0].tolist() == pytest.approx([0.08, 0.06])
    assert asked[0][1] is None
    assert asked[1] == ("new", {"start": point.y, "factorise": True, "precise": False})
    assert (found.turned, found.parity, found.changes) == (turned, -1, (CHANGE,))
    new = found.new
    assert (new.piece, new.gamma, new.step, new.corrections) == ("new", gamma, 0.2, 3)
    assert new.tau == 0.25
    assert known._oriented == (new.y, -1.0)


def test_steps_that_lead_nowhere():
    """Or stay in one piece, whose orientation is not asked for."""
    point = BranchPoint(vector(0.0, 0.0), vector(0.4, 0.3), "old", 0.0, 0.0, 0)
    _, known = stepper(y=None, tangent=None)
    assert FreeSteps.try_step(known, point, 0.2) == Crossed(None)
    for how in ({"tangent": None}, {"tangent": vector(0.4, 0.3), "lands": False}):
        _, known = stepper(y=(0.08, 0.06), **how)
        assert FreeSteps.try_step(known, point, 0.2) == Crossed(None, (CHANGE,))
    for turned in (False, True):
        asked, known = stepper(y=(0.0, 0.0), tangent=vector(0.4, 0.3), changes=(), turned=turned)
        found = FreeSteps.try_step(known, point, 0.2)
        assert (found.changes, found.turned, found.parity) == ((), turned, 0)
        assert asked[1][1]["factorise"] is False
        assert known._oriented is None


def test_orientations_are_known_once():
    """At the point itself, or from the last one where no bifurcation lies between."""
    point, other = (BranchPoint(vector(i, i), "t", "piece", 0.0, 0.0, 0) for i in range(2))
    calls = []

    def tangent(y, towards, piece, factorise):
        calls.append(y)
        return "t" if y is point.y else None

    known = SimpleNamespace(
        _oriented=None, corrector=SimpleNamespace(tangent=tangent, orientation=lambda: -1.0)
    )
    assert [FreeSteps._orientation(known, point) for _ in range(2)] == [-1.0, -1.0]
    assert calls == [point.y]
    assert [FreeSteps._orientation(known, other) for _ in range(2)] == [0.0, 0.0]
    assert calls == [point.y, other.y]
    FreeSteps.keep_orientation(known, point, other)
    assert known._oriented == (other.y, 0.0)
    FreeSteps.keep_orientation(known, other, point)
    assert known._oriented == (point.y, 0.0)
    assert FreeSteps._orientation(known, point) == 0.0
    empty = SimpleNamespace(_oriented=None)
    FreeSteps.keep_orientation(empty, point, other)
    assert empty._oriented is None


@pytest.mark.parametrize("kind", ["fold", "bifurcation", None])
def test_steps_within_a_piece(kind):
    """Are taken with their smooth special points; a bifurcation changes the orientation."""
    special = [] if kind is None else [SimpleNamespace(kind=kind)]
    kept = []
    known = SimpleNamespace(
        smooth_points=lambda point, new: special,
        lacks_fold=lambda point, new, found: False,
        keep_orientation=lambda point, new: kept.append(new),
        rescaled=lambda new: (new, "rescaled"),
        longer=lambda h, new: 2 * h,
    )
    found = FreeSteps.within_piece(known, "point", Crossed("new"), 0.5)
    assert found == (("new", "rescaled"), special, 1.0)
    assert kept == ([] if kind == "bifurcation" else ["new"])
    assert FreeSteps.within_piece(known, "point", Crossed(None), 0.5) is None
    assert FreeSteps.within_piece(known, "point", Crossed("new", (CHANGE,)), 0.5) is None
    known.lacks_fold = lambda point, new, found: True
    assert FreeSteps.within_piece(known, "point", Crossed("new"), 0.5) is None


def batched(control=StepControl(), locate=None):  # noqa: B008
    system = Textbook(1, lambda x, g, c: x, None, None, lambda *_: [[]], lambda x, g: [STICK])
    return BatchedSteps(Corrector(Bordered(system, gamma_scale=1.0), control), locate)


def test_the_length_of_steps():
    """It grows after easy steps, up to the longest."""
    control = StepControl(increase=1.5, easy=4, maximum=0.1)
    steps = batched(control)
    for h, corrections, expected in ((0.02, 4, 0.03), (0.02, 5, 0.02), (0.08, 0, 0.1)):
        new = BranchPoint(None, None, None, 0.0, h, corrections)
        assert steps.longer(h, new) == pytest.approx(expected)


@pytest.mark.parametrize(("smooth", "length"), [(False, 0.1), (True, 0.001), (None, 0.001)])
def test_a_step_that_was_refused_is_tried_again_beyond(smooth, length, monkeypatch):
    """What stood in its way: something that is not smooth, which was crossed."""
    steps = batched()
    special = [] if smooth is None else [SpecialPoint("fold", smooth, 0.0, None, 0)]
    monkeypatch.setattr(steps, "try_step", lambda point, h: Crossed(None, (CHANGE,)))
    monkeypatch.setattr(ExactSteps, "step", lambda self, point, h: ("new", special, 0.001))
    assert steps.step(None, 0.1) == ("new", special, length)
    assert steps._refused == (0.0 if smooth is False else 0.1)


@pytest.mark.parametrize(
    ("fractions", "located", "lengths"),
    [
        ((0.2, 0.3, 0.4, 0.5), 3, [0.1, 0.1 * 0.45, 0.1 * 0.45**2]),
        ((0.2, 0.3, 0.4, 0.9), 3, [0.1, 0.05, 0.025]),
        ((0.2, 0.3, 0.4, 0.9), 2, [0.1]),
        ((0.2, 0.3), None, [0.1]),
    ],
)
def test_how_far_short_of_an_event_a_step_is_taken(fractions, located, lengths, monkeypatch):
    """By a tenth, where more changes come before than are crossed one by one."""
    mine = COMM.rank
    changes = tuple((f, Change(mine, i, STICK, OPEN)) for i, f in enumerate(fractions))
    steps = batched(StepControl(decrease=0.5), lambda change: change.point == located)
    new = BranchPoint(None, None, None, 1.0, 0.1, 9)
    tried = []

    def try_step(point, h):
        tried.append(h)
        return Crossed(new, changes if len(tried) < 3 else changes[:3], False, 1)

    monkeypatch.setattr(steps, "try_step", try_step)
    monkeypatch.setattr(steps, "rescaled", lambda point: point)
    monkeypatch.setattr(ExactSteps, "step", lambda self, point, h: ("exact", [], h))
    start = BranchPoint(None, None, None, 0.0, 0.0, 0)
    found, special, h = steps.step(start, 0.1)
    np.testing.assert_allclose(tried, lengths)
    if located is None:
        assert (found, len(special), h) == (new, 2, 0.1)
    elif located == 3:
        assert found is new
    else:
        assert (found, h) == ("exact", 0.1)


@pytest.mark.parametrize(
    ("turned", "parity", "exact"),
    [(False, 1, False), (True, 1, True), (False, -1, True), (False, 0, True)],
)
def test_steps_that_are_not_monotone_are_not_taken(turned, parity, exact, monkeypatch):
    steps = batched()
    new = BranchPoint(None, None, None, 1.0, 0.1, 9)
    step = Crossed(new, (CHANGE,), turned, parity)
    monkeypatch.setattr(steps, "try_step", lambda point, h: step)
    monkeypatch.setattr(steps, "rescaled", lambda point: point)
    monkeypatch.setattr(ExactSteps, "step", lambda self, point, h: ("exact", [], h))
    start = BranchPoint(None, None, None, 0.0, 0.0, 0)
    assert steps.step(start, 0.1)[0] == ("exact" if exact else new)


def test_a_point_at_the_end_of_a_step(monkeypatch):
    """Solved for on H itself, with the changes until there."""
    steps = batched()
    b = steps.bordered
    y = b.vector()
    old, new = (
        BranchPoint(b.vector(), "t", Piece(np.array([c], np.int8)), g, 0.3, 2)
        for c, g in ((STICK, 0.0), (OPEN, 2.0))
    )
    monkeypatch.setattr(steps, "piece_between", lambda a, c: None)
    monkeypatch.setattr(steps, "between", lambda a, c, at: (y, at))
    monkeypatch.setattr(steps.corrector, "natural", lambda y, gamma, piece: True)
    monkeypatch.setattr(steps, "changes", lambda point, y, piece: (CHANGE,))
    for tangent in (None, "there"):
        monkeypatch.setattr(steps.corrector, "tangent", lambda *_, t=tangent: t)
        end, special = steps.end_at(
            old, new, [SimpleNamespace(smooth=False, gamma=0.5)], (-1.0, 1.0)
        )
        assert (end.y, end.gamma, end.step, end.corrections) == (y, 1.0, 0.3, 2)
        assert end.tangent == (tangent or "t")
        (event,) = special
        assert (event.kind, event.gamma, event.changes) == ("event", 0.5, (CHANGE[1],))
        assert (event.bracket, event.y, event.parity) == ((0.0, 1.0), y, 0)


def test_changes_beyond_their_step_are_at_its_end():
    """So are those whose border is reached at the very end."""

    def distances(x, _g, _codes):
        return [[(value, OPEN)] for value in x]

    old = np.array([STICK, STICK, STICK], dtype=np.int8)
    system = Textbook(3, lambda x, g, c: x, None, None, distances, lambda x, g: old)
    steps = FreeSteps(Corrector(Bordered(system, gamma_scale=1.0), StepControl()))
    b = steps.bordered
    ends = []
    for values in ((1.0, 1.0, 1.0), (-3.0, 0.5, 0.0)):
        x = system.create_vector()
        x.array[:] = np.array(values)[slice(*x.getOwnershipRange())]
        y = b.vector()
        b.join(x, 0.0, y)
        ends.append(y)
    piece = system.piece_at(system.create_vector(), 0.0)
    last = COMM.size - 1
    new = Piece(np.full(3 if COMM.rank == last else 0, OPEN, dtype=np.int8))
    start = BranchPoint(ends[0], None, piece, 0.0, 0.0, 0)
    found = steps.changes(start, ends[1], new)
    assert [(f, c.point) for f, c in found] == [(0.25, 0), (1.0, 1), (1.0, 2)]


# -- rays led by H --------------------------------------------------------------------------------


@pytest.mark.parametrize("at_point", [True, False])
def test_rays_led_by_solutions_beside_a_point(at_point):
    """By the first that leads out, with its tangent at the point or at the solution."""
    tangents = {"first": None, "second": "t2", "third": "t3", "fourth": "t4"}
    beside = [(f"y {name}", f"away {name}", name) for name in tangents]
    asked = []

    def tangent(at, away, piece):
        asked.append((at, away))
        return tangents[piece]

    known = SimpleNamespace(
        _y="point",
        _corrector=SimpleNamespace(tangent=tangent),
        _solutions_beside=lambda senses: iter(beside if senses else []),
    )
    found = RayFinder.led_by_H(
        known, (1.0,), lambda ray, away: ray.piece == "third", tangent_at_point=at_point
    )
    (ray,) = found.rays
    assert (ray.piece, ray.tangent, found.complete) == ("third", "t3", False)
    names = ("first", "second", "third")
    assert asked == [("point" if at_point else f"y {n}", f"away {n}") for n in names]
    none = RayFinder.led_by_H(known, (), lambda *_: True, tangent_at_point=at_point)
    assert (none.rays, none.complete, none.method) == ((), False, found.method)


def test_solutions_that_are_looked_for_beside_a_point():
    """At lengths one after the other, in the given order of senses."""
    tried = []

    def natural(y, gamma, piece):
        tried.append(gamma)
        y.array[:] = gamma
        return len(tried) in (2, 5)

    known = SimpleNamespace(
        _y=vector(7.0, 5.0),
        _corrector=SimpleNamespace(
            bordered=SimpleNamespace(
                gamma=gamma_of,
                gamma_scale=10.0,
                split=lambda y: (y, gamma_of(y)),
                system=SimpleNamespace(piece_at=lambda x, gamma: f"at {gamma:g}"),
            ),
            natural=natural,
        ),
    )
    found = list(RayFinder._solutions_beside(known, (-1.0, 1.0)))
    lengths = (1e-3, 1e-2, 1e-4, 1e-5)
    np.testing.assert_allclose(tried, [5 + s * 10 * k for k in lengths for s in (-1, 1)])
    assert [piece for _, _, piece in found] == ["at 5.01", "at 4.999"]
    for there, away, _ in found:
        np.testing.assert_allclose(away.array_r, there.array_r - [7.0, 5.0])


@pytest.mark.parametrize("inside", [(), (1.0,), (-1.0,), (1.0, -1.0)])
def test_rays_of_statuses_of_points(inside):
    """Both senses of the unit tangent in their piece that stay inside of it."""
    asked = []
    tangent = PETSc.Vec().createWithArray(np.array([0.6, 0.8]), comm=MPI.COMM_SELF)
    corrector = SimpleNamespace(
        bordered=SimpleNamespace(comm=SimpleNamespace(rank=1)),
        tangent=lambda y, t, piece: asked.append((y, t, piece.codes.tolist())) or tangent.copy(),
    )
    finder = RayFinder(
        corrector, "y", lambda ray: float(np.sign(ray.tangent.array_r[0])) in inside, None
    )
    kinks = [Kink(rank, point, 0, 1, (0, 1)) for rank, point in ((1, 2), (0, 1), (1, 0))]
    first = Piece(np.array([3, 3, 3], dtype=np.int8))
    rays = finder.of_statuses(first, kinks, (1, 0, 2), "towards")
    assert asked == [("y", "towards", [2, 3, 1])]
    assert [r.tangent.array_r.tolist() for r in rays] == [[0.6 * s, 0.8 * s] for s in inside]
    assert all(r.piece.codes.tolist() == [2, 3, 1] for r in rays)
    corrector.tangent = lambda *_: None
    assert finder.of_statuses(first, kinks, (1, 0, 2), "towards") == []


def test_rays_that_are_one_by_their_tangents():
    """They differ by less than a millionth of the first."""
    known = SimpleNamespace(_norm=lambda v: v.norm())
    ray = SimpleNamespace(tangent=vector(3.0, 4.0))
    for off, same in ((4.9e-6, True), (5.1e-6, False), (0.0, True)):
        other = SimpleNamespace(tangent=vector(3.0, 4.0 + off))
        assert RayFinder.same(known, ray, other) is same


# -- factorisations -------------------------------------------------------------------------------


def test_a_factorisation_that_does_not_serve_is_made_anew():
    """Where GMRES does not converge in the iterations that it has, or in too many to go on."""
    rng = np.random.default_rng(3)
    n = 10
    now = {}
    system = Textbook(n, None, lambda *_: now["J"][:n, :n], lambda *_: now["J"][:n, n])
    b = Bordered(system, gamma_scale=1.0)
    b.solver.reuse = True
    calls = []
    solve = b.solver.factor.solve
    b.solver.factor.solve = lambda rhs, x: calls.append(0) or solve(rhs, x)
    y, row, rhs, out = (b.vector() for _ in range(4))
    rhs.set(1.0)

    def solved(J):
        now["J"] = J
        x = system.create_vector()
        x.array[:] = J[n, slice(*x.getOwnershipRange())]
        b.join(x, J[n, n], row)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        whole = np.concatenate(COMM.allgather(out.array_r))
        np.testing.assert_allclose(J @ whole, 1.0, atol=1e-9)
        assert b.solver.solves == len(calls)
        return b.solver.factorisations

    base = rng.normal(size=(n + 1, n + 1)) + 4 * np.eye(n + 1)
    assert solved(base) == 1
    near = base * (1 + 1e-4 * rng.normal(size=base.shape))
    assert solved(near) == 1  # all rows differ, by a little
    assert not b.solver._worn
    other = rng.normal(size=base.shape) + 4 * np.eye(n + 1)
    b.solver._krylov.setTolerances(max_it=2)
    assert solved(other) == 2
    b.solver._krylov.setTolerances(max_it=40)
    b.solver._worn = True
    assert solved(other * (1 + 1e-4 * rng.normal(size=base.shape))) == 3
    b.destroy()


# -- rounds of pivots -----------------------------------------------------------------------------


class Rounds:
    """A solver whose states require statuses that are known beforehand."""

    def __init__(self, first, required, solved=True, gives_up=99):
        self.required = [np.array(first, dtype=np.int8)]
        self.required += [np.array(codes, dtype=np.int8) for codes in required]
        self.now = 0
        self.held = None
        self.rounds = []
        n = len(first)
        surface = SimpleNamespace(
            points=SimpleNamespace(number_everywhere=n, ids=np.zeros((n, 1), dtype=int)),
            positions=np.column_stack([np.arange(n), np.zeros(n)])[::-1],
        )
        contact = lambda x: SimpleNamespace(statuses=[self.required[self.now]])  # noqa: E731
        self.equations = SimpleNamespace(
            comm=MPI.COMM_SELF, surfaces=[surface], contact=contact, body_size=1.0
        )
        self.attempt = SimpleNamespace(
            gives_up=lambda: self.now >= gives_up,
            steps=[SimpleNamespace(measures=SimpleNamespace(worst=1.0))],
            reason="",
        )
        self.solved = solved

    def run(self, x, attempt):
        self.rounds.append(None if self.held is None else self.held[0].tolist())
        if self.held is not None:
            self.now = min(self.now + 1, len(self.required) - 1)
        return self.solved


def test_points_that_object_change_at_once():
    """Until none does: then H itself is solved."""
    rounds = Rounds([STICK] * 3, [[OPEN, STICK, PLUS], [OPEN, OPEN, PLUS], [OPEN, OPEN, PLUS]])
    assert pivoting.pivot(rounds, "x", rounds.attempt) is True
    assert rounds.rounds == [[1, 1, 1], [0, 1, 2], [0, 0, 2], None]
    assert rounds.held is None


def test_only_the_last_point_changes_after_some_rounds():
    """Those that go on objecting do so one by one, and slip turns by way of stick."""
    a, b = [PLUS, PLUS, STICK], [MINUS, MINUS, STICK]
    rounds = Rounds(a, [b, a] * 50)
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    # Two object at once, with no new minimum four times; then the last in order of coordinates.
    whole = rounds.rounds
    assert len(whole) == 20 + 4 * 3
    assert whole[:6] == [a, b, a, b, a, b]
    assert whole[6] == [STICK, MINUS, STICK]
    assert rounds.attempt.reason == "1 points keep objecting to their status"


def test_rounds_that_come_to_nothing():
    """Where it is given up, or a state is no number; a round that is not solved goes on else."""
    script = [[OPEN, STICK], [OPEN, OPEN], [OPEN, OPEN]]
    rounds = Rounds([STICK, STICK], script, gives_up=2)
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    assert (len(rounds.rounds), rounds.attempt.reason, rounds.held) == (2, "", None)
    rounds = Rounds([STICK, STICK], script, solved=False)
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    assert rounds.rounds == [[1, 1], [0, 1], [0, 0], None]
    rounds = Rounds([STICK, STICK], script, solved=False)
    rounds.attempt.steps[-1].measures.worst = np.inf
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    assert rounds.rounds == [[1, 1]]


@pytest.mark.parametrize("rows", [(0,), (0, 4), (2, 3), ()])
def test_signs_of_quotients_of_determinants(rows):
    """Of two pieces that differ in some rows, the first among them, and in the border."""
    rng = np.random.default_rng(7)
    n = 5
    signs = set()
    for _ in range(6):
        first = rng.normal(size=(n + 1, n + 1))
        second = first.copy()
        second[list(rows)] = rng.normal(size=(len(rows), n + 1))
        second[n] = rng.normal(size=n + 1)
        by_code = {STICK: first, PLUS: second}
        system = Textbook(
            n,
            None,
            lambda x, g, c, J=by_code: J[int(c[0])][:n, :n],
            lambda x, g, c, J=by_code: J[int(c[0])][:n, n],
            lambda *_: [[]],
            lambda x, g: [STICK],
        )
        b = Bordered(system, gamma_scale=1.0)
        sides = []
        for code, J in by_code.items():
            x = system.create_vector()
            x.array[:] = J[n, slice(*x.getOwnershipRange())]
            last = COMM.rank == COMM.size - 1
            piece = Piece(np.full(1 if last else 0, code, dtype=np.int8))
            sides.append((b.joined(x, J[n, n]), piece))
        y, made = b.vector(), []
        vector = b.solver.layout.vector
        b.solver.layout.vector = lambda made=made, make=vector: made.append(make()) or made[-1]
        found = b.solver.determinant_quotient(y, *sides)
        assert found == np.sign(np.linalg.det(second) / np.linalg.det(first))
        assert made
        assert not any(made)  # all are freed
        signs.add(found)
        b.destroy()
    assert signs == {-1, 1}
