"""Steps along paths, directions out of states and searches for jumps, with what they ask given."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

from dolfinx_contact.continuation import Piece, StepControl
from dolfinx_contact.continuation.branch import BranchPoint, Departures, Ray
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.ray_finder import FoundRays
from dolfinx_contact.continuation.system import Events
from dolfinx_contact.evolution import (
    NSCD,
    accepted,
    by_arc_length,
    jumps,
    rate_problem,
    sliding_steps,
    step_branch,
)
from dolfinx_contact.evolution.accepted import AtRest
from dolfinx_contact.evolution.arc_steps import ArcSteps
from dolfinx_contact.evolution.by_arc_length import ByArcLength
from dolfinx_contact.evolution.jumps import Found, _Search, where_it_changes
from dolfinx_contact.evolution.rate_problem import Directions, RateProblem, _slopes
from dolfinx_contact.evolution.run import _RunProgress
from dolfinx_contact.evolution.sliding_steps import SlidingSteps
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.solvers.history import ConvergenceError

ALONE = MPI.COMM_SELF


def vector(*numbers):
    return PETSc.Vec().createWithArray(np.array(numbers, dtype=float), comm=ALONE)


# -- steps along a path ---------------------------------------------------------------------------


class Way:
    """What a step by arc length asks: where it comes to, and what happens on the way there."""

    def __init__(self, **known):
        self.control = StepControl(
            minimum=0.01, initial=0.02, maximum=0.5, increase=2.0, decrease=0.5
        )
        self.tried = []
        self.known = {
            "solved": 1.0,  # steps up to this length are
            "monotone": 1.0,
            "border": lambda h: 1.0,  # the distance to it after a step
            "started": 1.0,
            "located": 1.0,
            "folds": 0.0,  # steps longer than this have one
            "seen": 1.0,
            "corrections": 4,
        } | known

    def _distances(self, y, piece):
        return np.array([self.known["started"] if y == "start" else self.known["border"](y)])

    def _unit(self, y, piece):
        return 2.0

    def _corrected(self, point, h):
        self.tried.append(h)
        if h > self.known["solved"]:
            return None
        return SimpleNamespace(y=h, piece="piece", gamma=h, corrections=self.known["corrections"])

    def _turns_twice(self, point, new):
        return new.y > self.known["monotone"]

    def _any(self, which):
        return bool(which.any())

    def _border(self, point, new):
        if new.y > self.known["located"]:
            return None
        return SimpleNamespace(y="border", piece="piece", gamma=0.1, corrections=1)

    def smooth_points(self, point, new):
        fold = isinstance(new.y, float) and 0 < self.known["folds"] < new.y
        kinds = ["bifurcation", "fold"] if fold else ["bifurcation"]
        return [SimpleNamespace(kind=kind) for kind in kinds]

    def lacks_fold(self, point, new, special):
        return isinstance(new.y, float) and new.y > self.known["seen"]

    def _at_fold(self, point, new, fold):
        return SimpleNamespace(y="fold", gamma=0.1, of=(new, fold))

    def _at_end(self, point, new, gamma):
        return SimpleNamespace(y="end", gamma=gamma, of=new)


START = SimpleNamespace(y="start", piece="piece", gamma=0.0)


@pytest.mark.parametrize(
    ("known", "tried", "at", "next_h"),
    [
        ({}, [0.2], "", 0.4),
        ({"corrections": 5}, [0.2], "", 0.2),
        ({"solved": 0.06}, [0.2, 0.1, 0.05], "", 0.1),
        ({"monotone": 0.11}, [0.2, 0.1], "", 0.2),
        ({"border": lambda h: 0.15 - h}, [0.2], "kink", 0.2),
        ({"border": lambda h: 0.2 - h - 1.9e-9}, [0.2], "", 0.4),
        ({"border": lambda h: 0.2 - h - 2.1e-9}, [0.2], "kink", 0.2),
        ({"border": lambda h: 0.15 - h, "located": 0.1}, [0.2, 0.1], "", 0.2),
        ({"border": lambda h: 0.15 - h, "started": 1.9e-10}, [0.2, 0.1], "", 0.2),
        ({"border": lambda h: 0.15 - h, "started": 2.1e-10}, [0.2], "kink", 0.2),
        ({"folds": 0.15}, [0.2], "fold", 0.2),
        ({"seen": 0.15}, [0.2, 0.1], "", 0.2),
        ({"seen": 0.15, "folds": 0.05}, [0.2, 0.1], "fold", 0.1),
    ],
)
def test_where_steps_by_arc_length_end(known, tried, at, next_h):
    """As long as they succeed, or at what is first on the way; the next one may be longer."""
    way = Way(**known)
    found = ArcSteps.arrive(way, START, 0.2, (-5.0, 5.0))
    np.testing.assert_allclose(way.tried, tried)
    assert (found.at, found.next_h) == (at, pytest.approx(next_h))
    assert found.point.y == {"": tried[-1], "kink": "border", "fold": "fold"}[at]
    assert [s.kind for s in found.bifurcations] == ["bifurcation"]


def test_steps_by_arc_length_that_do_not_succeed():
    """They are shortened to the least length; none is longer than the longest, nor the range."""
    way = Way(solved=0.0)
    assert ArcSteps.arrive(way, START, 0.04, (-5.0, 5.0)) is None
    np.testing.assert_allclose(way.tried, [0.04, 0.02, 0.01])
    assert ArcSteps.arrive(Way(), START, 0.4, (-5.0, 5.0)).next_h == 0.5
    found = ArcSteps.arrive(Way(), START, 0.4, (-5.0, 0.3))
    assert (found.at, found.point.y, found.point.gamma, found.point.of.y) == (
        "end",
        "end",
        0.3,
        0.4,
    )


def test_what_happens_at_points_of_a_path():
    piece = [Piece(np.array([c], dtype=np.int8)) for c in (STICK, STICK, PLUS)]
    a = SimpleNamespace(piece=piece[0], tangent=1.0)

    def event(at, leaves):
        path = SimpleNamespace(
            _leaves=leaves,
            _system=SimpleNamespace(comm=ALONE),
            _steps=SimpleNamespace(turned=lambda s, t: s * t < 0),
        )
        return ByArcLength._event(path, SimpleNamespace(at=at, point=a))

    same, on, back = (
        SimpleNamespace(piece=p, tangent=t)
        for p, t in ((piece[1], 1.0), (piece[2], 1.0), (piece[2], -1.0))
    )
    assert event("fold", on) == "smooth fold"
    assert event("", same) == ""
    assert event("kink", on) == "kink"
    assert event("kink", back) == "nonsmooth fold"
    assert event("kink", None) == "kink"


@pytest.mark.parametrize(
    ("lengths", "ended", "stuck"),
    [
        ([0.5, 0.4], None, False),
        ([1.0, 0.9, 0.9, 0.9], None, True),
        ([1.0, 0.9, 1.0, 1.2], None, False),
        ([9.0, 0.9, 0.9, 0.9], None, True),
        ([1.0, 0.9, 0.9, 0.9], Ending.REACHED, False),
    ],
)
def test_paths_that_get_nowhere(lengths, ended, stuck):
    """In so many steps, all together less than as often the least way."""
    ends = []
    path = SimpleNamespace(
        _patience=3,
        _passed=(0.0, *np.cumsum(lengths) * by_arc_length._NOWHERE),
        ending=ended,
        _accepted=SimpleNamespace(gamma=0.25),
        end=lambda ending, words: ends.append((ending, words)),
    )
    ByArcLength._end_if_stuck(path)
    assert len(ends) == stuck
    for ending, words in ends:
        assert ending is Ending.NOT_FOUND
        assert words.startswith("statuses change without end at gamma = 0.25")


# -- directions out of a state --------------------------------------------------------------------


def events(*each):
    """Events of (distance, point, target)."""
    distance, point, target = zip(*each, strict=True)
    return Events(np.array(distance), np.array(point, np.int32), np.array(target, np.int8))


def test_slopes_of_distances():
    """By differences, on one side where a border is there alone; 0 where it is on neither."""
    h = rate_problem._PROBE
    here = events((0.0, 0, OPEN), (1.0, 0, PLUS), (2.0, 0, PLUS))
    ahead = events((3.0 * h, 0, OPEN), (1.0 - h, 0, PLUS), (2.0 + 2 * h, 0, PLUS))
    behind = events((-h, 0, OPEN), (1.0 + h, 0, PLUS), (2.0 - 4 * h, 0, PLUS))
    np.testing.assert_allclose(_slopes(here, ahead, behind), [2.0, -1.0, 3.0])
    fewer = events((-h, 0, OPEN), (1.0 + h, 0, PLUS))
    np.testing.assert_allclose(_slopes(here, ahead, fewer), [2.0, -1.0, 2.0])
    np.testing.assert_allclose(_slopes(here, fewer, behind), [0.0, 0.0, 4.0])
    np.testing.assert_allclose(_slopes(here, fewer, fewer), [0.0, 0.0, 0.0])
    other = events((3.0 * h, 1, OPEN), (1.0 - h, 0, MINUS), (2.0 + 2 * h, 0, PLUS))
    # The first that is known of one status beyond is the first of it.
    np.testing.assert_allclose(_slopes(here, other, other), [0.0, 0.0, 0.0], atol=3e4)
    assert _slopes(here, other, other)[0] == 0.0


def directions(**known):
    """A problem that has these directions, one by one rate."""
    state = {
        "leads": lambda ray: False,
        "newton": {},
        "enumerated": FoundRays((), True, ""),
        "led": [],
    } | known
    return SimpleNamespace(
        _leads_out=state["leads"],
        _by_newton=lambda piece, t: state["newton"].get(t),
        _enumerated=lambda piece, t: state["enumerated"],
        _led_by_H=lambda t: state["led"],
        _reversed=lambda t: -t,
        _finder=SimpleNamespace(
            same=lambda a, b: a.tangent == b.tangent,
            distinct=lambda rays: list(dict.fromkeys(rays)),
        ),
        _b=SimpleNamespace(inner=lambda a, b: a * b),
    )


def test_directions_that_lead_on():
    """Those of the last step, else what Newton's method finds, else the straightest of all."""
    rays = {k: Ray(f"piece {k}", k) for k in (0.5, 0.9, -0.3, -1.0)}
    straight = RateProblem.onwards(directions(leads=lambda ray: True), "piece", 1.0)
    assert (straight.onwards, straight.others) == (Ray("piece", 1.0), ())
    assert (straight.method, straight.number) == ("the statuses of the last step", None)
    found = RateProblem.onwards(directions(newton={1.0: rays[0.5]}), "piece", 1.0)
    assert (found.onwards, found.others) == (rays[0.5], ())
    assert (found.method, found.complete) == ("Newton's method for the rate problem", False)
    every = FoundRays((rays[0.5], rays[-1.0], rays[0.9], rays[-0.3]), True, "")
    known = directions(enumerated=every, newton={-1.0: rays[-1.0]})
    found = RateProblem.onwards(known, "piece", 1.0)
    assert (found.onwards, found.others) == (rays[0.9], (rays[0.5], rays[-0.3]))
    assert (found.method, found.number) == ("all statuses that meet", 3)
    # What Newton's method found stays first, and is there once.
    known = directions(enumerated=every, newton={1.0: rays[0.5], -1.0: rays[-1.0]})
    found = RateProblem.onwards(known, "piece", 1.0, every=True)
    assert (found.onwards, found.others) == (rays[0.5], (rays[0.9], rays[-0.3]))
    some = FoundRays((), False, "too many")
    found = RateProblem.onwards(directions(enumerated=some, led=[rays[0.9]]), "piece", 1.0)
    assert (found.onwards, found.number) == (rays[0.9], None)
    assert found.method == "some of the statuses that meet"
    found = RateProblem.onwards(directions(), "piece", 1.0)
    assert (found.onwards, found.number, found.complete) == (None, 0, True)
    back = RateProblem.back(directions(newton={-1.0: rays[-1.0]}), "piece", 1.0)
    assert back.onwards is rays[-1.0]
    assert Directions(rays[0.9], (rays[0.5],), "", True).number == 2


@pytest.mark.parametrize("at_once", [True, False])
def test_rounds_of_the_rate_problem(at_once):
    """Points that fall take the statuses beyond, all at once or the steepest alone."""
    asked = []

    def falling(ray):
        codes = ray.piece.codes.tolist()
        asked.append(codes)
        over = [i for i, c in enumerate(codes) if c == STICK]
        fall = [1.0 + i for i in over]
        return np.array(over, np.int32), np.full(len(over), PLUS, np.int8), np.array(fall)

    def steepest(points, targets, fall):
        k = int(np.argmax(fall))
        return points[k : k + 1], targets[k : k + 1]

    signs = []
    problem = SimpleNamespace(
        _comm=ALONE,
        _y="y",
        _corrector=SimpleNamespace(tangent=lambda y, t, piece: vector(1.0)),
        _falling=falling,
        _any=lambda points: len(points) > 0,
        _steepest=steepest,
        _parity=lambda a, c: signs.append(c.piece.codes.tolist()) or -1,
    )
    first = Piece(np.array([STICK, OPEN, STICK], dtype=np.int8))
    found = RateProblem._pivoted(problem, first, "t", True, at_once)
    rounds = [[1, 0, 1], [2, 0, 2]] if at_once else [[1, 0, 1], [1, 0, 2], [2, 0, 2]]
    assert asked == rounds
    assert signs == rounds[1:]
    assert found.piece.codes.tolist() == rounds[-1]
    assert found.tangent.array_r.tolist() == [-1.0]
    found = RateProblem._pivoted(problem, first, "t", False, at_once)
    assert found.tangent.array_r.tolist() == [1.0]
    # Round and round, or where a piece is singular.
    problem._falling = lambda ray: (
        np.array([0], np.int32),
        np.array([PLUS if ray.piece.codes[0] == STICK else STICK], np.int8),
        np.ones(1),
    )
    assert RateProblem._pivoted(problem, first, "t", True, at_once) is None
    problem._corrector.tangent = lambda *_: None
    assert RateProblem._pivoted(problem, first, "t", True, at_once) is None


def test_the_steepest_of_points():
    """Of those that are as steep but for round-off the first by its place."""
    problem = SimpleNamespace(
        _comm=ALONE,
        _b=SimpleNamespace(system=SimpleNamespace(order=lambda: np.array([3, 1, 0, 2]))),
    )
    points, targets = np.array([0, 1, 3], np.int32), np.array([PLUS, MINUS, OPEN], np.int8)
    for fall, chosen in (
        ([1.0, 2.0, 3.0], 2),
        ([3.0, 1.0, 3.0], 2),
        ([3.0, 3.0 * (1 - 0.9e-6), 3.0], 1),
        ([3.0, 3.0 * (1 - 1.1e-6), 2.0], 0),
        ([-1.0, -2.0, -3.0], 0),
    ):
        point, target = RateProblem._steepest(problem, points, targets, np.array(fall))
        assert (point.tolist(), target.tolist()) == ([points[chosen]], [targets[chosen]])


def test_statuses_that_meet_at_a_state():
    """Of points at a border, in the order of their places, with those beyond."""
    at = events(
        (0.0, 2, PLUS), (1.0, 0, OPEN), (-0.9e-8, 2, MINUS), (0.5e-8, 1, STICK), (1.1e-8, 0, PLUS)
    )
    asked = []
    problem = SimpleNamespace(
        _comm=ALONE,
        _y="y",
        _tolerance=1e-8,
        _b=SimpleNamespace(
            split=lambda y: (y, 0.0),
            system=SimpleNamespace(
                order=lambda: np.array([0, 5, 4]), events=lambda x, g, piece: at
            ),
        ),
        _finder=SimpleNamespace(
            enumerated=lambda *args, **how: asked.append((args, how)) or "found"
        ),
    )
    piece = Piece(np.array([OPEN, OPEN, STICK], dtype=np.int8))
    assert RateProblem._enumerated(problem, piece, "t") == "found"
    (((given, kinks, t), how),) = asked
    assert (given, t, how) == (piece, "t", {"most": rate_problem._MOST_PIECES})
    assert [(k.rank, k.point, k.code, k.target, k.statuses) for k in kinks] == [
        (0, 2, STICK, PLUS, (STICK, PLUS, MINUS)),
        (0, 1, OPEN, STICK, (OPEN, STICK)),
    ]


# -- jumps ----------------------------------------------------------------------------------------


def moment(time):
    return SimpleNamespace(time=time, statuses=f"at {time:g}")


def test_the_longest_step_that_is_solved():
    """A quarter of what was not, down to the least length."""
    for solved, tried, why in (
        (2.0, [3.0], None),
        (0.3, [3.0, 1.5, 1.125], None),
        (0.0, [3.0, 1.5, 1.125], "no"),
    ):
        calls = []

        def take(before, time, likely, solved=solved, calls=calls):
            calls.append(time)
            assert likely == ("at 1", "end")
            if time - before.time > solved:
                raise ConvergenceError("no")
            return ("step", time)

        search = SimpleNamespace(_stepper=SimpleNamespace(take=take), _end="end", _least=0.1)
        found = _Search._first(search, moment(1.0), 3.0)
        np.testing.assert_allclose(calls, tried)
        assert (str(found) == why) if why else (found == ("step", tried[-1]))


def test_where_statuses_change():
    """The first places in their order, and how many more."""

    def surface(name, x):
        return SimpleNamespace(name=name, dim=2, comm=ALONE, positions=np.array(x))

    x = np.column_stack([np.arange(8.0)[::-1] / 4, np.zeros(8)])
    stepper = SimpleNamespace(
        problem=SimpleNamespace(surfaces=[surface("floor", x), surface("lid", x[:2])])
    )

    def shown(*codes):
        return SimpleNamespace(shown=[np.array(c, dtype=np.int8) for c in codes])

    a = shown([STICK] * 8, [OPEN, OPEN])
    assert where_it_changes(stepper, a, a) == "all statuses are the same"
    b = shown([OPEN] + [STICK] * 7, [OPEN, PLUS])
    letters = jumps.letters(2)
    words = where_it_changes(stepper, a, b)
    o, k, p = (letters[c] for c in (OPEN, STICK, PLUS))
    assert words == f"floor: (1.75, 0) {k} to {o}; lid: (1.5, 0) {o} to {p}"
    words = where_it_changes(stepper, a, shown([OPEN] * 8, [OPEN, OPEN]))
    first = ", ".join(f"({c:g}, 0) {k} to {o}" for c in (0, 0.25, 0.5, 0.75, 1))
    assert words == f"floor: {first} and 3 more"


def search(**known):
    """A search in steps whose changes are their lengths, or those given."""
    state = {"least": 0.1, "slow": 0.0, "small": 0.0, "straight": False, "change": None} | known
    change = state["change"] or (lambda step: step.after.time - step.before.time)
    looked = []
    found = SimpleNamespace(
        _change=lambda step: np.array([change(step)]),
        _small=np.array([state["small"]]),
        _slow=np.array([state["slow"]]),
        _least=state["least"],
        _is_straight=lambda step: state["straight"],
        _at_last=lambda path, step: ("at last", tuple(path), step.after.time),
        looked=looked,
    )
    found.look = lambda path, step, even=False: _Search.look(found, path, step, even)
    found._first = state.get("first") or (lambda before, time: part(before.time, time))
    found._leads_to_end = lambda step: state.get("leads", False)
    found._is_elsewhere = lambda second, step: state.get("elsewhere", False)
    return found


def part(a, b):
    return SimpleNamespace(before=SimpleNamespace(time=a), after=SimpleNamespace(time=b))


def test_parts_of_a_step_that_do_not_jump():
    """Where it is slow, small, straight or even."""
    step = part(0.0, 1.0)
    assert _Search.look(search(slow=1.0), [], step) is None
    assert _Search.look(search(small=1.0), [], step) is None
    assert _Search.look(search(straight=True), [], step) is None
    assert _Search.look(search(), [], step) is None  # evenly, in its halves and theirs
    assert _Search.look(search(least=0.6), [], step)[0] == "at last"
    assert _Search.look(search(least=0.6), [], step, even=True) is None


def test_a_step_that_jumps_at_a_time():
    """It is found in ever shorter parts, with the steps that lead there."""
    where = 0.7
    jump = lambda step: 1.0 if step.before.time < where <= step.after.time else 0.0  # noqa: E731
    kind, path, end = _Search.look(search(change=jump, small=0.1), [], part(0.0, 1.0))
    assert kind == "at last"
    assert end == 0.75
    assert [(s.before.time, s.after.time) for s in path] == [(0.0, 0.5), (0.5, 0.625)]
    # Halves that are not solved are jumps unless a branch leads to the end.
    failure = ConvergenceError("no")

    def first(before, time):
        return failure if time > 0.9 else part(before.time, time)

    found = _Search.look(search(change=jump, small=0.1, first=first), [], part(0.0, 1.0))
    assert (found.far.after.time, found.failure, list(found.steps)) == (1.0, failure, [])
    assert (
        _Search.look(search(change=jump, small=0.1, first=first, leads=True), [], part(0.0, 1.0))
        is None
    )
    # A half that ends before its middle leads on.
    short = lambda before, time: part(before.time, min(time, 0.3))  # noqa: E731
    found = _Search.look(search(first=short), [], part(0.0, 1.0))
    assert (found.far, [s.after.time for s in found.steps]) == (None, [0.3])


@pytest.mark.parametrize("leads", [True, False])
def test_when_halves_are_elsewhere(leads, monkeypatch):
    """By more than half of the change in the whole, and of what is small; unless solutions lead."""
    monkeypatch.setattr(jumps, "changes", lambda comm, a, b: np.array([b - a, 0.0]))
    known = SimpleNamespace(
        _stepper=SimpleNamespace(problem=SimpleNamespace(comm=ALONE)),
        _small=np.array([0.25, 0.25]),
        _leads_to_end=lambda step: leads,
    )
    for whole, off, elsewhere in (
        (1.0, 0.4, False),
        (1.0, 0.5, False),
        (1.0, 0.6, True),
        (0.1, 0.2, False),
        (0.1, 0.3, True),
    ):
        known._change = lambda step, whole=whole: np.array([whole, 0.0])
        halves, step = SimpleNamespace(after=1.0), SimpleNamespace(after=1.0 + off)
        assert _Search._is_elsewhere(known, halves, step) is (elsewhere and not leads)


def test_halves_that_lead_elsewhere():
    """Lead on by themselves: there is no jump then."""
    found = _Search.look(search(elsewhere=True, least=0.2), [], part(0.0, 1.0))
    assert found.far is None
    assert found.steps[-1].after.time == 1.0


@pytest.mark.parametrize("aim", [1.0, 3.0])
def test_what_leads_on_from_the_last_step(aim, monkeypatch):
    """A branch to its end is no jump; one elsewhere is taken, if it is near; else it is far."""
    step = part(0.5, 1.0)
    branches = {}
    monkeypatch.setattr(jumps, "branch_of_step", lambda stepper, before, time: branches[time])

    def branch(reaches, ends=False, why="why"):
        return SimpleNamespace(reaches_end=reaches, ends=ends, why=why, statuses="codes")

    def at_last(there=False, near=0.1, solved=True):
        def take(before, time, likely):
            if not solved:
                raise ConvergenceError("no")
            assert likely == ("codes",)
            return SimpleNamespace(before=before, after=SimpleNamespace(time=time), near=near)

        known = SimpleNamespace(
            _stepper=SimpleNamespace(take=take),
            _aim=aim,
            _small=np.array([0.01]),
            _change=lambda s: np.array([getattr(s, "near", 1.0)]),
            _is_at=lambda branch, step: there,
        )
        return _Search._at_last(known, ["path"], step)

    branches |= {1.0: branch(False, True, "proved"), 3.0: branch(False, False)}
    found = at_last()
    assert (found.steps, found.far, found.proved, found.why) == (["path"], step, True, "proved")
    branches[1.0] = branch(True)
    assert at_last(there=True) is None
    found = at_last(near=0.5)
    assert (found.far, found.steps[-1].after.time) == (None, 1.0)
    found = at_last(near=0.6)
    assert (found.far, found.proved) == (step, False)
    assert found.why == "solutions lead on from the state, but no step led to them"
    found = at_last(solved=False)
    assert (found.far, str(found.failure)) == (step, "no")
    branches[3.0] = branch(True)
    found = at_last(there=True, near=0.4)
    if aim == 1.0:
        assert found is None
    else:
        assert (found.far, found.steps[-1].after.time) == (None, 3.0)
    assert Found([]).proved is False


# -- what steps are held to -----------------------------------------------------------------------


def test_how_steps_of_sliding_faces_are_tried():
    """Briefly while they may be halved; from where the last step leads to, if that is known."""
    last = SimpleNamespace(time=2.0, unknowns=np.array([1.0, 4.0]))
    here = SimpleNamespace(time=2.5, unknowns=np.array([2.0, 3.0]))
    parts = sliding_steps._PARTS

    def steps(**known):
        state = {"_slide": True, "_extrapolate": True, "_shortest": 0.01}
        state["_last"] = SimpleNamespace(before=last, after=here)
        found = SimpleNamespace(_times=(0.0, 2.0, 6.0), _longest=3.0, **(state | known))
        found._extrapolated = lambda a, t: SlidingSteps._extrapolated(found, a, t)
        return found

    still = SlidingSteps.trial(steps(_slide=False), here, 3.0, 6.0)
    assert (still.extrapolated, still.brief, still.expected) == (None, False, ())
    found = SlidingSteps.trial(steps(), here, 3.5, 6.0)
    np.testing.assert_allclose(found.extrapolated, [4.0, 1.0])
    least = 3.0 / parts
    for length, brief in (
        (2 * least * (1 + 1e-12), True),
        (2 * least * (1 - 1e-12), True),
        (1.99 * least, False),
    ):
        assert SlidingSteps.trial(steps(), here, 2.5 + length, 6.0).brief is brief
    shorter = 2.0 / parts
    assert SlidingSteps.trial(steps(), here, 2.5 + 2.01 * shorter, 2.0).brief is True
    assert SlidingSteps.trial(steps(), here, 2.5 + 1.99 * shorter, 2.0).brief is False
    assert SlidingSteps.trial(steps(_shortest=1.0), here, 2.5 + 1.9, 6.0).brief is False
    for known in (
        {"_extrapolate": False},
        {"_last": None},
        {"_last": SimpleNamespace(before=last, after=last)},
    ):
        assert SlidingSteps.trial(steps(**known), here, 3.5, 6.0).extrapolated is None


def test_steps_over_many_facets_are_said_once(caplog):
    """Of the surface that slips farthest, beyond two facets."""
    steps = SimpleNamespace(
        _slide=True,
        _extrapolate=True,
        _last=None,
        _told=False,
        _problem=SimpleNamespace(comm=ALONE),
    )

    def accept(*ways, jump=False, solved=True):
        slidings = {f"s{i}": SimpleNamespace(distance=w) for i, w in enumerate(ways)}
        step = SimpleNamespace(
            before=SimpleNamespace(solved=solved, time=1.0),
            after=SimpleNamespace(time=2.0),
            result=SimpleNamespace(slidings=slidings),
        )
        SlidingSteps.accept(steps, step, jump=jump)
        return steps._last is step

    assert accept(1.0, 2.0)
    assert not accept(1.0, jump=True)
    assert not accept(1.0, solved=False)
    assert caplog.records == []
    accept(2.1, 2.3, 0.0)
    (said,) = caplog.records
    assert said.message.startswith("s1: in the step from 1 to 2 points that touch slip over 2.3 ")
    accept(5.0)
    assert len(caplog.records) == 1
    steps._slide, steps._last = False, None
    assert not accept(5.0)
    steps._slide, steps._extrapolate = True, False
    assert not accept(1.0)


# -- the branch of a step -------------------------------------------------------------------------


def point_of(rate):
    return BranchPoint(None, rate, None, 0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("rates", "complete", "chosen"),
    [
        ((0.5, -0.5), True, [0.5]),
        ((0.2, 0.9, -0.5), True, [0.2, 0.9]),
        ((0.9, 0.2, 0.5), True, [0.2, 0.5, 0.9]),
        ((-0.5, 0.0), True, [0.0]),
        ((-0.5,), True, []),
        ((-0.5,), False, ["start"]),
        ((), False, ["start"]),
        ((0.0, 1e-3), True, [1e-3]),
    ],
)
def test_rays_with_more_load(rates, complete, chosen):
    """The straightest last, which is followed first; else those under which the load stays."""
    start = point_of(1.0)
    follower = SimpleNamespace(
        bordered=SimpleNamespace(gamma=float, inner=lambda a, b: a * b),
        start=lambda x, gamma: start,
    )
    points = tuple(point_of(rate) for rate in rates)
    found = step_branch._with_more(follower, None, Departures(points, complete, ""))
    assert [p if p is start else p.tangent for p in found] == [
        start if c == "start" else c for c in chosen
    ]


def followed(runs, **known):
    """Branches that end as they are given, from one start after the other."""
    state = {"complete": True, "turns": [], "method": "trial"} | known
    number = iter(range(99))

    def run(start, gamma_range, max_steps, stop):
        assert gamma_range == (0.0, 1.0)
        return runs[next(number)]

    follower = SimpleNamespace(
        departures=lambda x, gamma: Departures((), state["complete"], state["method"]),
        run=run,
        bordered=SimpleNamespace(split=lambda y: (y, None)),
        branch_off=lambda special, ray: f"along {ray}",
    )
    system = SimpleNamespace(statuses_of=lambda piece: f"of {piece}")
    return step_branch._followed(follower, system, None)


def branch(gamma, *kinds, ending=Ending.STOPPED, reason="it ended"):
    last = SimpleNamespace(gamma=gamma, y=vector(gamma), piece=gamma)
    special = [SimpleNamespace(kind=kind, gamma=gamma) for kind in kinds]
    return SimpleNamespace(points=[None, last], special=special, ending=ending, reason=reason)


def test_branches_of_a_step(monkeypatch):
    """One that reaches the load leads on; where all turn back it is known that none does."""
    monkeypatch.setattr(step_branch, "_with_more", lambda *_: ["start"])
    turns = []
    monkeypatch.setattr(step_branch, "_at_turn", lambda follower, special: turns.pop(0))
    Turn = step_branch._Turn
    found = followed([branch(1.0)])
    assert (found.reaches_end, found.statuses, found.unknowns.tolist()) == (True, "of 1.0", [1.0])
    turns[:] = [Turn("it turns", known=True)]
    found = followed([branch(0.25, "event", "fold")])
    assert (found.reaches_end, found.ends) == (False, True)
    assert found.why == "it turns, at 0.25 of its change"
    turns[:] = [Turn("branches meet")]
    found = followed([branch(0.25, "fold")])
    assert (found.ends, found.why) == (False, "branches meet")
    for b in (branch(0.25, "event"), branch(0.25, "fold", ending=Ending.NOT_SOLVED)):
        found = followed([b])
        assert (found.ends, found.why) == (
            False,
            "the solutions were followed in the step: it ended",
        )
    found = followed([branch(0.25, "event")], complete=False)
    assert not found.ends
    turns[:] = [
        Turn("it turns", True, ("a", "b"), "by trial"),
        Turn("again", True),
        Turn("at last", True),
    ]
    found = followed([branch(0.25, "fold"), branch(0.5, "fold"), branch(0.75, "bifurcation")])
    assert (found.ends, found.why) == (True, "at last, at 0.75 of its change")
    turns[:] = [Turn("it turns", True, ("a",))] * 99
    found = followed([branch(0.25, "fold")] * 99)
    assert not found.ends
    assert found.why == f"the load turns back on more than {step_branch._MOST_TURNS} branches"
    assert len(turns) == 99 - step_branch._MOST_TURNS - 1
    monkeypatch.setattr(step_branch, "_with_more", lambda *_: [])
    found = followed([])
    assert (found.ends, found.why) == (True, "the load turns back at the start, by trial")
    found = followed([], complete=False)
    assert (found.ends, found.why) == (False, "rays out of the start may be missing, trial")


# -- what is known of states ----------------------------------------------------------------------


def rests(u, unknowns, covered=None):
    forces = SimpleNamespace(u=np.array(u), covered=None if covered is None else np.array(covered))
    state = object.__new__(AtRest)
    vars(state).update(unknowns=np.array(unknowns), forces=forces)
    return state


def test_how_much_a_state_changes(monkeypatch):
    """A length of all unknowns; of equilibria the largest displacement, and means at points."""
    a, b = rests([1.0, -2.0], [0.0, 0.0, 1.0]), rests([1.5, -5.0], [3.0, 4.0, 1.0])
    points = [
        SimpleNamespace(distances=np.array([1.0, 3.0]), weakened=np.array([0.5, 0.0])),
        SimpleNamespace(distances=np.zeros(0), weakened=np.zeros(0)),
    ]
    monkeypatch.setattr(accepted, "_at_points", lambda a, b: points)
    assert accepted.change(ALONE, a, b) == 5.0
    np.testing.assert_allclose(accepted.changes(ALONE, a, b), [3.0, 5.0, 2.0, 0.0, 0.25, 0.0])
    # What has nothing opposite counts by the part that has, at both.
    c, d = rests([0.0], [0.0, 0.0], [1.0, 0.5]), rests([0.0], [3.0, 4.0], [0.25, 1.0])
    assert accepted.change(ALONE, c, d) == pytest.approx(np.hypot(0.75, 2.0))
    assert accepted.change(ALONE, a, rests([0.0], [3.0, 4.0, 1.0], [0.0] * 3)) == 5.0
    moving = SimpleNamespace(unknowns=np.array([3.0, 4.0, 1.0]))
    np.testing.assert_allclose(accepted.changes(ALONE, a, moving), [0.0, 5.0])


def test_the_line_of_progress_of_a_run():
    """What is left by the part that is done, and jumps on lines of their own."""
    lines, written = [], []
    progress = SimpleNamespace(due=True, seconds=30.0, update=lines.append, write=written.append)
    rule = SimpleNamespace(
        what="evolution", units="steps", part=lambda step: step.part, where=lambda step: "where"
    )
    shown = SimpleNamespace(_progress=progress, _rule=rule)

    def step(part, jump=False):
        result = SimpleNamespace(counts={"stick": 2, "open": 0, "slip": 1})
        _RunProgress.step(
            shown, SimpleNamespace(part=part, jump=jump, start=0.125, result=result), None
        )

    step(0.75)
    step(None, jump=True)
    step(0.0)
    assert lines == [
        "evolution: where  2 stick, 1 slip  30 s, about 10 s left",
        "evolution: where  2 stick, 1 slip  30 s",
        "evolution: where  2 stick, 1 slip  30 s",
    ]
    assert written == ["evolution: the state jumps at the time 0.125"]
    progress.due = False
    step(0.5)
    assert len(lines) == 3


def test_the_memory_of_a_motion():
    """That of the last accepted state; before it that of the surfaces."""
    problem = SimpleNamespace(equations=SimpleNamespace(memory="of the surfaces"))
    motion = SimpleNamespace(_accepted=None, problem=problem)
    assert NSCD.memory.fget(motion) == "of the surfaces"
    motion._accepted = SimpleNamespace(memory="of the state")
    assert NSCD.memory.fget(motion) == "of the state"


@pytest.mark.parametrize("complete", [True, False])
@pytest.mark.parametrize("incoming", ["in", None])
def test_what_leads_on_where_not_all_rays_are_known(complete, incoming, monkeypatch):
    """They are looked for among the statuses that meet in the piece by which the branch came."""
    asked = []
    rays = (Ray("a", 0.5), Ray("b", -0.5), Ray("c", 0.0))

    def enumerated(piece, kinks, towards, most):
        asked.append((piece, kinks, towards))
        return FoundRays(rays, complete, "trial")

    finder = SimpleNamespace(enumerated=enumerated)
    monkeypatch.setattr(step_branch, "kinks_at", lambda c, y, piece, tolerance: (piece, tolerance))
    monkeypatch.setattr(step_branch, "finder_at", lambda corrector, y, kinks: finder)
    at = events((3.0, 0, OPEN), (-4.0, 1, OPEN))
    system = SimpleNamespace(events=lambda x, gamma, piece: at)
    follower = SimpleNamespace(
        corrector=None,
        bordered=SimpleNamespace(gamma=float, comm=ALONE, system=system, split=lambda y: (y, 0.5)),
    )
    on = Ray("on", 0.25)
    came = None if incoming is None else Ray("in", 0.75)
    special = SimpleNamespace(
        kind="fold", smooth=False, onwards=on, incoming=came, complete=False, y="y", others=()
    )
    found = step_branch._at_turn(follower, special)
    ray = on if came is None else came
    tolerance = step_branch._AT_BORDER * 4.0
    assert asked == [(ray.piece, (ray.piece, tolerance), ray.tangent)]
    if complete:
        assert (found.known, list(found.rays), found.method) == (True, [rays[0]], "by trial")
    else:
        assert (found.known, found.why) == (False, "trial")
