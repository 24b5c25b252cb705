"""Ways along paths and within steps: points, directions and searches, with what they ask given."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

from dolfinx_contact.continuation import Piece, StepControl
from dolfinx_contact.continuation.branch import BranchPoint, Ray
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.system import Events
from dolfinx_contact.evolution import (
    ArcLength,
    arc_length,
    by_arc_length,
    jumps,
    path_stepper,
    rate_problem,
    sliding_steps,
    step_branch,
    step_rays,
)
from dolfinx_contact.evolution.accepted import AtRest
from dolfinx_contact.evolution.arc_steps import ArcSteps
from dolfinx_contact.evolution.by_arc_length import ByArcLength
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.jumps import Found, _Search
from dolfinx_contact.evolution.path_state import Known, PathState, PathTask
from dolfinx_contact.evolution.path_stepper import OnPath, PathStepper
from dolfinx_contact.evolution.rate_problem import Directions, RateProblem
from dolfinx_contact.evolution.sliding_steps import SlidingSteps
from dolfinx_contact.laws.status import OPEN, PLUS, STICK

ALONE = MPI.COMM_SELF
#: As seen by another rank than the first, of which nothing is said.
SECOND = SimpleNamespace(rank=1, size=2, allreduce=lambda v, op=None: v, allgather=lambda v: [v])


def vector(*numbers):
    return PETSc.Vec().createWithArray(np.array(numbers, dtype=float), comm=ALONE)


def numbers(v):
    return v.array_r.tolist()


def piece(*codes):
    return Piece(np.array(codes, dtype=np.int8))


def same(*objects):
    return all(o is objects[0] for o in objects)


class Plane:
    """The bordered system of (x, gamma), of which the last number is gamma, in units of 2."""

    comm = ALONE
    gamma_scale = 2.0
    x_scale = 12.0
    x_scale_is_new = False
    system = SimpleNamespace(scales=(5.0, 6.0))

    def gamma(self, y):
        return float(y.array_r[-1])

    def inner(self, a, c):
        return float(np.dot(a.array_r, c.array_r))

    def split(self, y):
        return vector(*y.array_r[:-1]), self.gamma(y)

    def join(self, x, gamma, y):
        y.array[:] = [*x.array_r, gamma]

    def vector(self):
        return vector(0.0, 0.0, 0.0)

    def last_unit(self):
        return vector(0.0, 0.0, 1.0)


# -- points of steps by arc length ----------------------------------------------------------------


class Way(ArcSteps):
    """Steps whose corrector adds to the second unknown, and whose tangent is given."""

    def __init__(self, **known):
        self.bordered = Plane()
        self.solves, self.new_tangent, self.lands_there = True, vector(1.0, 0.0, 0.5), True
        self.largest_distance = 4.0
        self.control = StepControl()
        self.asked = []
        vars(self).update(known)
        self.corrector = SimpleNamespace(
            moore_penrose=self.moore_penrose,
            tangent=self.tangent,
            natural=lambda y, gamma, p: self.solves,
            iterations=3,
            bordered=self.bordered,
        )
        self.test = lambda accepted=False: 8.0 if accepted else 7.0
        self.test.signs = np.array([1.0, -1.0])

    @property
    def system(self):
        return self.bordered.system

    def moore_penrose(self, y, t, p):
        y.array[1] += 0.25
        return self.solves

    def tangent(self, y, t, p):
        self.asked.append((numbers(y), numbers(t), p))
        self.corrector.iterations = 99
        return self.new_tangent

    def lands(self, point, h, y, tangent):
        return self.lands_there

    def rescaled(self, point):
        return ("rescaled", point)


START = BranchPoint(vector(1.0, 2.0, 3.0), vector(0.0, 0.0, 1.0), piece(1), 3.0, 0.5, 2)


def test_a_step_of_a_length():
    way = Way()
    what, new = way._corrected(START, 0.5)
    assert what == "rescaled"
    assert (numbers(new.y), numbers(new.tangent)) == ([1.0, 2.25, 3.5], [1.0, 0.0, 0.5])
    assert (new.gamma, new.step, new.corrections, new.tau) == (3.5, 0.5, 3, 8.0)
    assert new.piece is START.piece
    assert numbers(START.y) == [1.0, 2.0, 3.0]
    assert way.asked == [([1.0, 2.25, 3.5], [0.0, 0.0, 1.0], START.piece)]
    for wrong in ({"solves": False}, {"new_tangent": None}, {"lands_there": False}):
        assert Way(**wrong)._corrected(START, 0.5) is None


def test_points_that_are_located_on_the_way():
    """With tangents of their own, in the piece of the step; at the end gamma is exact."""
    way = Way()
    found = way._there(START, 0.25, vector(4.0, 5.0, 6.0))
    assert (found.gamma, found.step, found.tau, found.corrections) == (6.0, 0.25, 7.0, 99)
    assert numbers(found.tangent) == [1.0, 0.0, 0.5]
    assert Way(new_tangent=None)._there(START, 0.25, START.y) is None
    new = BranchPoint(vector(9.0, 9.0, 9.0), vector(0.0, 0.0, 1.0), piece(1), 9.0, 0.5, 2)
    fold = SimpleNamespace(y=vector(1.0, 2.0 + 3.0, 3.0 + 4.0))
    found = way._at_fold(START, new, fold)
    assert (found.step, found.gamma) == (5.0, 7.0)
    assert Way(new_tangent=None)._at_fold(START, new, fold) is new
    for off in (0.0, 1e-9):
        end = BranchPoint(
            vector(1.0, 5.0, 7.0 + off), vector(0.0, 0.0, 1.0), piece(1), 7.0 + off, 0.1, 2
        )
        way = Way(end_at=lambda *given, end=end: (end, given))
        found = way._at_end(START, new, 7.0)
        assert (found.gamma, numbers(found.y)) == (7.0, [1.0, 5.0, 7.0])
        assert found.step == 5.0
        assert (
            Way(new_tangent=None, end_at=lambda *_, end=end: (end, ()))._at_end(START, new, 7.0)
            is end
        )
    asked = []
    way = Way(end_at=lambda *given: asked.append(given) or (new, ()))
    assert way._at_end(START, new, 7.0).gamma == 9.0
    assert asked == [(START, new, (), (7.0, 7.0))]
    for located, y in ((None, None), ((0.25, vector(4.0, 5.0, 6.0)), 6.0)):
        way = Way(_first_event=lambda point, y, located=located: located)
        found = way._border(START, new)
        assert found is None if located is None else (found.step, found.gamma) == (0.25, y)


def test_what_steps_have_found_out():
    """The scale of x is that of one unit of gamma, whatever the unit of the run."""
    way = Way()
    assert way.known == Known(3.0, 4.0, (5.0, 6.0), (1.0, -1.0))
    other = Way()
    other.bordered = Plane()
    other.bordered.x_scale = None
    other.know(way.known)
    assert other.bordered.x_scale == 12.0
    rates = Way(_unit=lambda y, p: 7.0).rate_problem(START.y, START.piece)
    assert (rates._tolerance, rates._outside) == pytest.approx((7e-10, 7e-9))
    assert rates._y is START.y


def test_leaving_a_point_by_another_ray():
    way = Way()
    assert way.go_on(START, Ray(START.piece, START.tangent)) is START
    ray = Ray(piece(2), vector(0.0, 1.0, 0.0))
    what, new = way.go_on(START, ray)
    assert what == "rescaled"
    assert same(new.piece, ray.piece)
    assert same(new.tangent, ray.tangent)
    assert (new.gamma, new.step, new.corrections) == (3.0, 0.5, 0)
    assert numbers(new.y) == [1.0, 2.0, 3.0]


def test_distances_away_from_a_point():
    """Along its tangent, by the borders that the start of the step has."""

    def events(y, p):
        return Events(np.array([y.array_r[2], -1.0]), np.array([0, 1]), np.array([PLUS, OPEN]))

    way = Way(_events=events)
    at = events(START.y, None)
    np.testing.assert_allclose(way._again(at, START, 0.25), [3.25, -1.0])
    assert numbers(START.y) == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_borders_that_are_reached_in_a_step_in_any_units(scale):
    """Rates are those at the ends, whatever distances are farther away, and their size."""

    def distance(s):
        return scale * ((s - 0.5) ** 2 - 0.04 + 5.0 * s**3 * (s - 1.0) ** 2)

    rising = SimpleNamespace(
        bordered=SimpleNamespace(gamma=float, gamma_scale=1.0),
        _length=lambda v: v.norm() if isinstance(v, PETSc.Vec) else 1.0,
        _events=lambda y, p: None,
        _again=lambda events, p, away: np.array([distance(p.gamma + away)]),
        _unit=lambda y, p: scale,
        _any=lambda which: bool(which.any()),
    )
    ends = [SimpleNamespace(y=vector(s), gamma=s, tangent=0.0, piece=None) for s in (0.0, 1.0)]
    assert ArcSteps._turns_twice(rising, *ends) is True


# -- along a path ---------------------------------------------------------------------------------


def path(**known):
    """A path by arc length somewhere, with what it asks given."""
    way = ByArcLength.__new__(ByArcLength)
    control = StepControl(minimum=0.001)
    state = {
        "task": PathTask((0.0, 1.0), "onwards", control, 3, True),
        "ending": None,
        "reason": "",
        "_accepted": SimpleNamespace(time=1.5, gamma=0.25, statuses="codes", energies=Energies()),
        "_arrived": None,
        "_length": 0.2,
        "_number": 4,
        "_passed": (1.5,),
        "_leaves": None,
        "_weak": False,
        "_patience": 99,
        "_system": SimpleNamespace(comm=ALONE, kinks_in_gamma=""),
        "_stepper": SimpleNamespace(),
        "_steps": SimpleNamespace(control=control, bordered=Plane()),
    }
    vars(way).update(state | known)
    return way


def test_what_a_path_is_made_of():
    """Points of which it says when it gets nowhere, and what it knows when it continues."""
    known = Known(1.0, 2.0)
    seen = []
    surfaces = [
        SimpleNamespace(points=SimpleNamespace(E=e, number=n)) for e, n in ((None, 4), (None, 3))
    ]
    stepper = SimpleNamespace(problem=SimpleNamespace(surfaces=surfaces))
    steps = SimpleNamespace(know=seen.append, known="now")
    state = PathState("there", 0.2, number=4, arrived="point", known=known, passed=(1.0, 2.0, 4.0))
    system = SimpleNamespace(comm=ALONE)
    way = ByArcLength(system, stepper, steps, "task", state)
    assert seen == [known]
    assert way._patience == 2 * 7 + 10
    assert way._weak is False
    assert way.accepted_points == 2
    again = way.run_state
    assert (again.accepted, again.length, again.number) == ("there", 0.2, 4)
    assert (again.arrived, again.known, again.passed) == ("point", "now", (1.0, 2.0, 4.0))
    surfaces[1].points.E = "matrix"
    assert ByArcLength(system, stepper, steps, "task", state)._weak is True
    way.end(Ending.BUDGET, "why")
    assert (way.run_state.ending, way.run_state.reason) == (Ending.BUDGET, "why")


def test_where_a_path_is_shown_to_be():
    step = by_arc_length.PathStep(7, 0.0, 1.0, None, None, gamma=0.1234567, event="kink")
    assert ByArcLength.where(path(), step) == "gamma 0.123457 in [0, 1]  point 7  kink"


@pytest.mark.parametrize(("points", "taken"), [(3, 3), (4, 4)])
def test_how_many_points_a_path_has(points, taken):
    way = path(task=PathTask((0.0, 1.0), "onwards", StepControl(), points, True))
    way._next = lambda: "solved"

    def accept(found):
        way._passed = (*way._passed, 0.0)
        return found

    way._accept = accept
    assert list(way.advances()) == ["solved"] * taken
    assert (way.ending, way.reason) == (
        Ending.BUDGET,
        f"the budget of {points} steps is exhausted",
    )
    way = path(_next=lambda: None)
    assert list(way.advances()) == []
    assert way.ending is None


@pytest.mark.parametrize("direction", ["increasing", "decreasing"])
def test_where_a_path_begins(direction, monkeypatch):
    asked = []
    monkeypatch.setattr(by_arc_length, "require_way", lambda *given: asked.append(given))
    point = SimpleNamespace(y="y", piece="piece", tangent="tangent", gamma=0.25)
    leaves = SimpleNamespace(name="leaves")
    rates = SimpleNamespace(begun=lambda *given: Directions(asked.append(given) or "ray"))
    steps = SimpleNamespace(
        rate_problem=lambda *given: asked.append(given) or rates,
        go_on=lambda *given: asked.append(given) or leaves,
        bordered="bordered",
    )
    task = PathTask((0.0, 1.0), direction, StepControl(), 3, True)
    way = path(task=task, _steps=steps, _first=lambda sense: asked.append(sense) or point)
    way.begin()
    assert asked == [
        1.0 if direction == "increasing" else -1.0,
        ("y", "piece"),
        ("piece", "tangent"),
        (point, "ray"),
        ("bordered", leaves, (0.0, 1.0)),
    ]
    assert way._leaves is leaves
    asked.clear()
    over = path(ending=Ending.REACHED, task=task, _steps=steps)
    over.begin()
    assert asked == []
    lost = path(task=task, _steps=steps, _first=lambda sense: point)
    rates.begun = lambda *given: Directions(None, method="trial")
    lost.begin()
    assert (lost.ending, lost._leaves) == (Ending.NOT_FOUND, None)
    assert lost.reason == (
        "no way on was found from gamma = 0.25, by trial; whether there is one is not decided"
    )


@pytest.mark.parametrize("direction", ["onwards", "back"])
@pytest.mark.parametrize("accepted", [0, 2])
def test_where_a_path_goes_on(direction, accepted, monkeypatch):
    """A later run in units of its own, on or back; one that is continued always on."""
    monkeypatch.setattr(by_arc_length, "require_way", lambda *given: None)
    asked = []
    rates = SimpleNamespace(
        onwards=lambda *given, every: Directions(asked.append(("on", every)) or "ray"),
        back=lambda *given: Directions(asked.append("back") or "ray"),
    )
    arrived = BranchPoint(vector(1.0), vector(2.0), piece(1), 0.5, 0.1, 2, 3.0)
    rescaled = []
    steps = SimpleNamespace(
        rate_problem=lambda y, p: rates,
        go_on=lambda point, ray: point,
        rescaled=lambda point: rescaled.append(point) or point,
        bordered=None,
    )
    task = PathTask((0.0, 1.0), direction, StepControl(), 3, False)
    way = path(task=task, _steps=steps, _arrived=arrived, _passed=(0.0,) * (1 + accepted))
    way.begin()
    back = direction == "back" and not accepted
    assert asked == (["back"] if back else [("on", False)])
    assert len(rescaled) == (0 if accepted else 1)
    if not accepted:
        (new,) = rescaled
        assert np.isnan(new.tau)
        assert new.tangent is not arrived.tangent
        assert numbers(new.tangent) == [2.0]
    assert (way._leaves is arrived) is bool(accepted)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_first_point_of_a_path(known, sense):
    """With the rate of the load alone; in the statuses of its start if they are known."""
    corrector = SimpleNamespace(natural=lambda y, gamma, p: numbers(y) == [4.0, 5.0, 0.25] and True)
    steps = SimpleNamespace(bordered=Plane(), corrector=corrector)

    def write(x):
        x.array[:] = [4.0, 5.0]

    problem = SimpleNamespace(create_vector=lambda: vector(0.0, 0.0), write=write)
    system = SimpleNamespace(
        piece_at=lambda x, gamma: ("at", gamma), piece=lambda codes: ("of", codes)
    )
    way = path(_steps=steps, _stepper=SimpleNamespace(problem=problem), _system=system)
    way._accepted.statuses = "codes" if known else None
    point = way._first(sense)
    assert numbers(point.y) == [4.0, 5.0, 0.25]
    assert numbers(point.tangent) == [0.0, 0.0, 2.0 * sense]
    assert point.piece == (("of", "codes") if known else ("at", 0.25))
    assert (point.gamma, point.step, point.corrections) == (0.25, 0.0, 0)
    corrector.natural = lambda *_: False
    with pytest.raises(ValueError, match=r"no solution at gamma = 0\.25; solve"):
        way._first(sense)


def test_the_next_point_of_a_path(monkeypatch):
    """In steps that are halved until its statuses are right, of which energies are numbers."""
    lengths, violations = [], []
    monkeypatch.setattr(by_arc_length, "forces_at", lambda eq, state: "forces")

    def arrive(leaves, length, gamma_range):
        lengths.append(length)
        assert (leaves, gamma_range) == ("leaves", (0.0, 1.0))
        return SimpleNamespace(point=SimpleNamespace(step=0.8 * length))

    before = SimpleNamespace(
        advanced=lambda *given: (
            Energies(np.nan)
            if bad
            else Energies(1.0)
            if given == ("before", "forces", 0.75)
            else None
        )
    )
    bad = False
    control = StepControl(minimum=0.001)

    def way_of(worst, weak=False):
        lengths.clear()
        violations[:] = worst
        way = path(
            _leaves="leaves",
            _weak=weak,
            _steps=SimpleNamespace(arrive=arrive, control=control),
            _stepper=SimpleNamespace(problem=SimpleNamespace(state=lambda: "state")),
            _system=SimpleNamespace(
                result_at=lambda point: SimpleNamespace(energies={"friction": 0.75}),
                equations="equations",
                kinks_in_gamma="",
            ),
        )
        way._accepted = SimpleNamespace(energies=before, forces="before", gamma=0.25)
        way._violation = lambda state: violations.pop(0)
        return way

    found = way_of([1e-6])._next()
    assert lengths == [0.2]
    assert (found.state, found.forces, found.energies) == ("state", "forces", Energies(1.0))
    way = way_of([1.1e-6, 2e-6, 0.0])
    way._next()
    np.testing.assert_allclose(lengths, [0.2, 0.5 * 0.16, 0.5 * 0.8 * 0.08])
    way_of([], weak=True)._next()
    assert lengths == [0.2]
    bad = True
    way = way_of([0.0])
    assert way._next() is None
    assert way.ending is Ending.NOT_SOLVED
    assert way.reason == "beyond gamma = 0.25 a law gives a number that is not finite"
    for kinks, more in (("", ""), ("it has kinks", "; it has kinks")):
        way = way_of([])
        way._leaves = SimpleNamespace(gamma=0.125)
        way._steps = SimpleNamespace(arrive=lambda *_: None, control=control)
        way._system.kinks_in_gamma = kinks
        assert way._next() is None
        assert way.ending is Ending.NOT_SOLVED
        assert way.reason == f"no step of at least 0.001 succeeds beyond gamma = 0.125{more}"


@pytest.mark.parametrize("at", ["", "end"])
@pytest.mark.parametrize("bifurcations", [0, 1, 2])
def test_a_point_of_a_path_is_accepted(at, bifurcations):
    """With a new memory, and the directions that lead on from there."""
    remembered, made, asked = [], [], []

    def accepted(*given):
        made.append(given)
        return SimpleNamespace(time=given[0], memory="memory", statuses=given[1])

    rates = SimpleNamespace(
        onwards=lambda p, t, every: (
            asked.append((p.codes.tolist(), t, every))
            or Directions("ray", ("other",), "trial", True)
        )
    )
    system = SimpleNamespace(
        comm=ALONE,
        equations=SimpleNamespace(
            advanced=lambda state: ("advanced", state.statuses), remember=remembered.append
        ),
        letters=lambda p: "".join(map(str, p.codes)),
    )
    there = piece(STICK, OPEN)
    point = BranchPoint("y", "t", there, 0.5, 0.25, 6)
    leaves = BranchPoint("y", "t", piece(PLUS, OPEN), 0.5, 0.25, 6)
    steps = SimpleNamespace(
        rate_problem=lambda y, p: rates, go_on=lambda p, ray: leaves, turned=lambda a, b: False
    )
    way = path(_system=system, _stepper=SimpleNamespace(accepted=accepted), _steps=steps)
    before = way._accepted
    arrival = SimpleNamespace(point=point, at=at, bifurcations=("b",) * bifurcations, next_h=0.3)
    state = SimpleNamespace(statuses="now")
    advance = way._accept(
        SimpleNamespace(
            arrival=arrival, state=state, forces="forces", result="result", energies=Energies(2.0)
        )
    )
    step = advance.step
    assert made == [(1.75, "now", ("advanced", "now"), "forces", Energies(2.0))]
    assert remembered == ["memory"]
    assert (way._length, way._number, way._passed) == (0.3, 5, (1.5, 1.75))
    assert way._arrived is point
    assert (step.number, step.start, step.time, step.gamma) == (5, 1.5, 1.75, 0.5)
    assert (step.before, step.corrections) == ("10", 6)
    assert (advance.solved.before, advance.solved.after.time) == (before, 1.75)
    if bifurcations:
        assert step.directions == 1 + 2 * bifurcations
        assert step.method == "a bifurcation of one piece"
    if at == "end":
        assert asked == []
        assert (way.ending, step.after, step.event) == (Ending.REACHED, "10", "")
        assert bifurcations or (step.directions, step.method) == (None, "")
    else:
        assert asked == [([STICK, OPEN], "t", True)]
        assert (way.ending, step.after, step.event) == (None, "20", "kink")
        assert bifurcations or (step.directions, step.method) == (2, "trial")


def test_violations_beside_the_largest_forces(monkeypatch):
    monkeypatch.setattr(by_arc_length, "violation", lambda *given: given)
    system = SimpleNamespace(equations="eq", scales=(2.0, 3.0))
    assert ByArcLength._violation(path(_system=system), "state") == ("eq", "state", 2.0, 3.0)
    system.scales = (0.0, 3.0)
    assert ByArcLength._violation(path(_system=system), "state") == 0.0


# -- paths and their states -----------------------------------------------------------------------


def parametric(value=0.25, **laws):
    """What a path asks of a problem of one surface."""
    compiled = SimpleNamespace(
        needs_time=lambda step: laws.get("timed", False) if step == 0.0 else "wrong",
        knows_slip=laws.get("slips", False),
    )
    surface = SimpleNamespace(
        name="floor",
        update_geometry=lambda: None,
        points=SimpleNamespace(data=SimpleNamespace(fields=laws.get("fields", {}))),
        law=SimpleNamespace(name="Law", needs_time=laws.get("needs", ())),
        law_at_points=SimpleNamespace(compiled=compiled),
    )
    problem = SimpleNamespace(comm=ALONE, surfaces=[surface])
    return SimpleNamespace(problem=problem, constant=SimpleNamespace(value=value))


@pytest.mark.parametrize(
    ("laws", "words"),
    [
        ({}, ""),
        ({"needs": ("b", "c"), "fields": {"b": np.zeros(2), "c": np.zeros(2)}}, ""),
        (
            {"needs": ("b", "c"), "fields": {"b": np.array([0.0, 1.0]), "c": np.ones(2)}},
            "floor: the law Law answers to the time or length of a step, by its b and c;",
        ),
        (
            {"needs": ("b", "c"), "fields": {"b": np.zeros(2), "c": np.array([0.0, -1.0])}},
            "by its c;",
        ),
        ({"timed": True}, "floor: the law Law depends on the time of a step"),
        ({"timed": True, "needs": ("b",), "fields": {"b": np.zeros(2)}}, ""),
        ({"slips": True}, "floor: friction of the law Law depends on the distance slipped"),
    ],
)
def test_paths_know_no_time(laws, words, monkeypatch):
    monkeypatch.setattr(arc_length, "check_times", lambda surfaces: None)
    one = ArcLength.__new__(ArcLength)
    vars(one).update(problem=parametric(**laws).problem)
    if not words:
        one._require_no_time()
        return
    with pytest.raises(ValueError, match=words):
        one._require_no_time()


def test_the_load_of_a_path():
    """That of the last state; before the first run that of the parameter."""
    one = ArcLength.__new__(ArcLength)
    vars(one).update(parametric=parametric(0.25), _run_state=None)
    assert one._gamma == 0.25
    vars(one)["_run_state"] = SimpleNamespace(gamma=0.75)
    assert one._gamma == 0.75
    with pytest.raises(ValueError, match="a ParametricContact is needed, got str"):
        ArcLength("problem")


def test_a_run_of_a_path(monkeypatch):
    """All that it makes is freed, also if it fails."""
    made, freed = [], []

    class Thing:
        def __init__(self, *given, **more):
            made.append((type(self).__name__, given, more))

        def destroy(self):
            freed.append(type(self).__name__)

    kinds = {name: type(name, (Thing,), {}) for name in ("Bordered", "Corrector")}
    kinds["ArcSteps"] = type("ArcSteps", (Thing,), {"corrector": kinds["Corrector"]()})
    for name, kind in kinds.items():
        monkeypatch.setattr(arc_length, name, kind)
    monkeypatch.setattr(arc_length, "ByArcLength", lambda *given: given)
    monkeypatch.setattr(arc_length, "Run", lambda *given: given)
    made.clear()
    one = ArcLength.__new__(ArcLength)
    vars(one).update(
        parametric="system",
        _stepper=lambda progress: f"stepper {progress}",
        _follow=lambda run: None,
    )
    energies = Energies(1.0)
    state = SimpleNamespace(accepted=SimpleNamespace(time=1.5, energies=energies, gamma=0.5))
    task = PathTask((-1.0, 2.0), "onwards", "control", 3, True)
    listeners = SimpleNamespace(progress=True)
    history = one._run(task, state, listeners)
    assert (history.start, history.before, history.gamma) == (1.5, energies, 0.5)
    assert made[0] == ("Bordered", ("system",), {"gamma_scale": 3.0})
    name, (_, control), more = made[1]
    assert (name, control, more) == ("Corrector", "control", {"chords": False})
    assert freed == ["ArcSteps", "Corrector", "Bordered"]
    freed.clear()
    vars(one)["_follow"] = lambda run: 1 / 0
    with pytest.raises(ZeroDivisionError):
        one._run(task, state, listeners)
    assert freed == ["ArcSteps", "Corrector", "Bordered"]


def test_a_first_run_of_a_path_begins_at_no_length():
    """A later one where the path has come to."""
    one = ArcLength.__new__(ArcLength)
    runs, samples, asked = [], [], []
    scales = (1.0, 2.0)
    vars(one).update(
        _run_state=None,
        parametric=SimpleNamespace(scales=scales, check_parameter=samples.append),
        _require_no_time=lambda: None,
        _stepper=lambda progress: SimpleNamespace(
            start=lambda time: SimpleNamespace(time=time), require_untouched=asked.append
        ),
        _run=lambda task, state, listeners: runs.append((task, state, listeners)),
    )
    run = ArcLength.run.__wrapped__
    control = StepControl(initial=0.03)
    given = {"gamma_range": (0.0, 2.0), "control": control, "direction": "increasing"}
    run(one, **given)
    ((task, state, listeners),) = runs
    assert (task.gamma_range, task.direction, task.max_steps, task.rays) == (
        (0.0, 2.0),
        "increasing",
        1000,
        False,
    )
    assert (state.accepted.time, state.length, state.number) == (0.0, 0.03, 0)
    assert (state.known, state.passed) == (Known(scales=scales), (0.0,))
    assert listeners.accept is None
    assert (samples[0][0], samples[0][-1]) == (0.0, 2.0)
    vars(one)["_run_state"] = PathState(SimpleNamespace(time=5.0), 0.5, number=7)
    run(one, **given, rays=True, max_steps=3)
    assert [a.time for a in asked] == [5.0]
    task, state, _ = runs[1]
    assert (task.rays, task.max_steps) == (True, 3)
    assert (state.number, state.passed, state.length) == (7, (5.0,), 0.03)


@pytest.mark.parametrize("remembers", [True, False])
def test_the_state_that_a_path_begins_with(remembers, monkeypatch):
    """Of a history the memory and statuses that it left; else a start as any other."""
    sets = []
    eq = SimpleNamespace(memory=("memory",) if remembers else (None,))
    problem = SimpleNamespace(equations=eq, state=lambda: SimpleNamespace(statuses="codes"))
    system = SimpleNamespace(
        problem=problem, constant=SimpleNamespace(value=np.array(0.5)), _set=sets.append
    )
    stepper = PathStepper(system)
    stepper._warn_of_memory = lambda state: None
    started = OnPath.__new__(OnPath)
    monkeypatch.setattr(path_stepper.Stepper, "start", lambda self, time: started)
    monkeypatch.setattr(path_stepper, "forces_at", lambda eq, state: "forces")
    kept = []
    stepper._accepted = lambda *given, **more: kept.append((given, more)) or "accepted"
    found = stepper.start(2.0)
    assert sets == [0.5]
    if not remembers:
        assert found is started
        return
    assert found == "accepted"
    assert kept == [
        (
            (OnPath, 2.0, "codes", ("memory",), Energies()),
            {"solved": True, "forces": "forces", "gamma": 0.5},
        )
    ]
    system.data_watch = lambda: "watch"
    assert stepper.data_watch() == "watch"
    assert stepper._load(3.0) is None


# -- directions -----------------------------------------------------------------------------------


def test_how_newtons_method_looks_for_a_direction():
    """All points that fall at once; where that leads in circles one by one."""
    for answers, found, asked in (
        (("ray", "other"), "ray", [True]),
        ((None, "other"), "other", [True, False]),
        ((None, None), None, [True, False]),
    ):
        seen = []
        known = SimpleNamespace(
            _pivoted=lambda p, t, oriented, at_once, answers=answers, seen=seen: (
                seen.append(at_once) or answers[not at_once]
            )
        )
        assert RateProblem._by_newton(known, "piece", "t") == found
        assert seen == asked
    oriented = []
    known = SimpleNamespace(_pivoted=lambda p, t, o, at_once: oriented.append(o) or "ray")
    RateProblem._by_newton(known, "piece", "t")
    RateProblem._by_newton(known, "piece", "t", oriented=False)
    assert oriented == [True, False]


@pytest.mark.parametrize(("rate", "sense"), [(2.0, 1.0), (-2.0, -1.0), (0.0, 1.0)])
def test_where_h_itself_leads(rate, sense):
    """In the sense of the direction by which the path came, where it leads out."""
    asked = []

    def led(senses, leads, tangent_at_point):
        asked.append((senses, leads("ray", 1.0), tangent_at_point))
        return SimpleNamespace(rays=("a", "b"))

    known = SimpleNamespace(
        _b=SimpleNamespace(gamma=lambda t: t),
        _finder=SimpleNamespace(led_by_H=led),
        _leads_out=lambda ray: f"out by {ray}",
    )
    assert RateProblem._led_by_H(known, rate) == ["a", "b"]
    assert asked == [((sense,), "out by ray", True)]


def test_lengths_and_senses_of_directions():
    known = SimpleNamespace(_b=Plane(), _comm=ALONE)
    t = vector(3.0, 0.0, 4.0)
    assert RateProblem._size(known, t) == 5.0
    assert numbers(RateProblem._reversed(known, t)) == [-3.0, 0.0, -4.0]
    assert numbers(t) == [3.0, 0.0, 4.0]
    assert RateProblem._any(known, np.zeros(0)) is False
    assert RateProblem._any(known, np.zeros(1)) is True


@pytest.mark.parametrize(
    ("distance", "slope", "falls"),
    [
        (1e-8, -1.0, True),
        (-1e-8, -1.0, True),
        (1.01e-8, -1.0, False),
        (-1.01e-8, -1.0, False),
        (-0.5, 1.0, False),
        (-0.51, 1.0, True),
        (0.0, -4.1 * rate_problem._IDLE, True),
        (0.0, -3.9 * rate_problem._IDLE, False),
    ],
)
def test_points_at_borders_and_beyond(distance, slope, falls):
    """At a border within the tolerance, where the rate counts; beyond it in any case."""

    def events(ray, away):
        return Events(
            np.array([distance + slope * (away - 50.0 * away**3), 9.0 + 4.0 * away]),
            np.array([5, 7], np.int32),
            np.array([PLUS, OPEN], np.int8),
        )

    known = SimpleNamespace(_comm=ALONE, _tolerance=1e-8, _outside=0.5, _distances=events)
    points, targets, fall = RateProblem._falling(known, None)
    assert points.tolist() == ([5] if falls else [])
    assert targets.tolist() == ([PLUS] if falls else [])
    np.testing.assert_allclose(fall, [-slope] if falls else [], rtol=1e-3, atol=1e-9)
    known = SimpleNamespace(
        _y=vector(1.0, 2.0, 3.0),
        _b=SimpleNamespace(
            split=lambda y: (numbers(y)[:-1], numbers(y)[-1]),
            system=SimpleNamespace(events=lambda *given: given),
        ),
    )
    ray = Ray("piece", vector(1.0, 0.0, -1.0))
    assert RateProblem._distances(known, ray, 0.5) == ([1.5, 2.0], 2.5, "piece")
    assert numbers(known._y) == [1.0, 2.0, 3.0]


# -- searches for jumps ---------------------------------------------------------------------------


def search(linear=True, piecewise=True, change=(4.0, 0.0, 2e-6), **step):
    """A search in a step of a problem with one surface whose law is piecewise linear or not."""
    surface = SimpleNamespace(
        law_at_points=SimpleNamespace(compiled=SimpleNamespace(is_piecewise_linear=piecewise))
    )
    equations = SimpleNamespace(
        linear=linear, surfaces=[surface], bulk=SimpleNamespace(stiffness_data=["E", "nu"])
    )
    stepper = SimpleNamespace(problem=SimpleNamespace(comm=ALONE, equations=equations))
    after = SimpleNamespace(statuses="end", time=3.0)
    whole = SimpleNamespace(before=None, after=after, **step)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jumps, "changes", lambda comm, a, b: np.array(change))
        patch.setattr(jumps, "data_of_surface", lambda s: [SimpleNamespace(value="gap")])
        return _Search(stepper, whole, "slow", 0.25)


def test_what_is_small_beside_a_jump():
    """A tenth of each change; and what is round-off beside the largest of them."""
    found = search()
    np.testing.assert_allclose(found._small, [0.4, 4e-6, 4e-6])
    assert (found._slow, found._least, found._end, found._aim) == ("slow", 0.25, "end", 3.0)
    assert found._kept == ["E", "nu", "gap"]
    for linear in (True, False):
        for piecewise in (True, False):
            assert search(linear, piecewise)._linear is (linear and piecewise)


@pytest.mark.parametrize(
    ("a", "b", "agrees", "linear", "straight"),
    [
        ([1, 2], [1, 2], True, True, True),
        ([1, 2], [1, 3], True, True, False),
        ([1, 2], [1, 2], False, True, False),
        ([1, 2], [1, 2], True, False, False),
        (None, [1, 2], True, True, False),
        ([1, 2], None, True, True, False),
        (None, None, True, True, False),
    ],
)
def test_straight_lines_between_states(a, b, agrees, linear, straight):
    """Where both have the same statuses, are linear in all, and data stay that matter."""

    def state(codes):
        statuses = None if codes is None else [np.array(codes), np.array([0])]
        data = SimpleNamespace(agrees=lambda other, kept: agrees and kept == ["E"])
        return SimpleNamespace(statuses=statuses, data=data)

    known = SimpleNamespace(
        _linear=linear,
        _kept=["E"],
        _stepper=SimpleNamespace(problem=SimpleNamespace(comm=ALONE)),
    )
    step = SimpleNamespace(before=state(a), after=state(b))
    assert _Search._is_straight(known, step) is straight


@pytest.mark.parametrize("reaches", [True, False])
@pytest.mark.parametrize("at", [True, False])
def test_where_a_branch_of_a_step_leads(reaches, at, monkeypatch):
    monkeypatch.setattr(
        jumps,
        "branch_of_step",
        lambda stepper, before, time: SimpleNamespace(reaches_end=reaches, asked=(before, time)),
    )
    known = SimpleNamespace(_stepper="stepper", _is_at=lambda branch, step: at)
    step = SimpleNamespace(before="before", after=SimpleNamespace(time=2.0))
    assert _Search._leads_to_end(known, step) is (reaches and at)


def looks(least=0.25, even=False, leads=False, fails=0, size=None):
    """A look at the step from 0 to 1; the first or second half of which fails."""
    tried = []

    def first(before, time):
        tried.append(time)
        if fails == len(tried):
            return jumps.ConvergenceError("no")
        return SimpleNamespace(before=before, after=SimpleNamespace(time=time))

    def change(step):
        return np.array([size(step) if size else step.after.time - step.before.time])

    known = SimpleNamespace(
        _change=change,
        _small=np.zeros(1),
        _slow=np.zeros(1),
        _least=least,
        _is_straight=lambda step: False,
        _first=first,
        _leads_to_end=lambda step: leads,
        _is_elsewhere=lambda a, b: False,
        _at_last=lambda path, step: "at last",
    )
    known.look = lambda path, step, even=False: tried.append((step.after.time, even))
    step = SimpleNamespace(before=SimpleNamespace(time=0.0), after=SimpleNamespace(time=1.0))
    return _Search.look(known, ["path"], step, even), tried, step


def test_when_a_part_of_a_step_is_not_halved():
    """Where its halves would be shorter than the least length, or no numbers lie between."""
    assert looks(least=0.5)[0] is None
    assert looks(least=0.5)[1][0] == 0.5
    assert looks(least=0.51)[0] == "at last"
    assert looks(least=0.51, even=True)[0] is None
    known = SimpleNamespace(
        _change=lambda step: np.ones(1),
        _small=np.zeros(1),
        _slow=np.zeros(1),
        _least=0.0,
        _is_straight=lambda step: False,
        _at_last=lambda path, step: "at last",
    )
    for a in (1.0, float(np.nextafter(2.0, 1.0))):
        b = float(np.nextafter(a, 3.0))
        step = SimpleNamespace(before=SimpleNamespace(time=a), after=SimpleNamespace(time=b))
        assert _Search.look(known, [], step) == "at last"


@pytest.mark.parametrize("length", [0.5, 2.0])
@pytest.mark.parametrize(("size", "left"), [(0.9, True), (1.1, False)])
def test_parts_that_change_slowly_are_left_alone(length, size, left):
    """By less than a rate times their length, or by little at all; all that changes has to."""
    for small, slow, change in (
        ([0.0, 0.0], [1.0, 1.0], [size * length, 0.0]),
        ([0.0, 0.0], [1.0, 2.0], [0.0, 2.0 * size * length]),
        ([1.0, 1.0], [0.0, 0.0], [0.5, size]),
    ):
        known = SimpleNamespace(
            _change=lambda step, change=change: np.array(change),
            _small=np.array(small),
            _slow=np.array(slow),
            _least=9.0,
            _is_straight=lambda step: False,
            _at_last=lambda path, step: "at last",
        )
        step = SimpleNamespace(
            before=SimpleNamespace(time=1.0), after=SimpleNamespace(time=1.0 + length)
        )
        assert _Search.look(known, [], step) == (None if left else "at last")


def test_nothing_falls_where_nothing_moves():
    """Not at a border either."""
    at = Events(np.zeros(2), np.array([5, 7], np.int32), np.array([PLUS, OPEN], np.int8))
    known = SimpleNamespace(
        _comm=ALONE, _tolerance=1e-8, _outside=0.5, _distances=lambda ray, away: at
    )
    assert [len(v) for v in RateProblem._falling(known, None)] == [0, 0, 0]


@pytest.mark.parametrize("fails", [1, 2])
def test_halves_that_are_not_solved(fails):
    found, _, step = looks(fails=fails)
    assert (found.steps, found.far, str(found.failure)) == (["path"], step, "no")
    assert looks(fails=fails, leads=True)[0] is None


def test_halves_that_change_unevenly():
    """The first is looked at before the second is taken; an even one after it."""
    even = looks()[1]
    assert even == [0.5, 1.0, (0.5, True), (1.0, True)]
    assert looks(even=True)[1] == [0.5, 1.0]
    uneven = looks(size=lambda s: 0.6 if s.after.time == 0.5 else 1.0)[1]
    assert uneven == [0.5, (0.5, False), 1.0, (1.0, False)]
    late = looks(size=lambda s: 0.5 if s.after.time == 0.5 else 1.0)[1]
    assert late == [0.5, 1.0, (0.5, False), (1.0, False)]
    # By parts of the whole, whatever its size.
    for scale in (0.1, 10.0):
        evenly = looks(
            size=lambda s, k=scale: k * (1.0 if s.before.time + s.after.time == 1 else 0.55)
        )
        assert evenly[1] == even
    assert Found([1]).why == ""
    assert (Found([1]).far, Found([1]).failure) == (None, None)


# -- steps of sliding faces -----------------------------------------------------------------------


def sliding(slides=True, linear=False, rest=True, **more):
    bulk = SimpleNamespace(linear=linear)
    problem = SimpleNamespace(
        comm=ALONE,
        surfaces=[SimpleNamespace(slides=False), SimpleNamespace(slides=slides)],
        equations=SimpleNamespace(bulk=bulk, V="V", axisymmetric="axis"),
    )
    start = AtRest.__new__(AtRest) if rest else SimpleNamespace()
    given = {"longest": 1.0, "shortest": 0.1, "extrapolate": True} | more
    return SlidingSteps(problem, (0.0, 1.0), start=start, **given)


def test_which_steps_are_held_to_more():
    """Those of faces that slide, at rest; only what is not linear folds."""
    for slides in (True, False):
        for linear in (True, False):
            for rest in (True, False):
                found = sliding(slides, linear, rest)
                assert found._slide is (slides and rest)
                assert found._folds is (slides and rest and not linear)
    found = sliding()
    assert (found._known, found._last, found._told) == (None, None, False)


def test_the_smallest_determinant_is_known_once(monkeypatch):
    asked = []
    monkeypatch.setattr(
        sliding_steps,
        "smallest_jacobian",
        lambda V, u, **how: asked.append((V, u, how)) or (0.75, "there"),
    )
    steps = sliding()
    a, b = (SimpleNamespace(fields=("u", "lambda"), solved=True) for _ in range(2))
    assert steps._smallest(a) == 0.75
    assert asked == [("V", "u", {"vertices": False, "axisymmetric": "axis"})]
    steps._known = a, 0.5
    assert steps._smallest(a) == 0.5
    assert steps._smallest(b) == 0.75
    steps._known = None
    asked.clear()
    steps.require_unfolded(SimpleNamespace(before=a, after=b))
    assert steps._known == (b, 0.75)
    for none in (sliding(linear=True), sliding(slides=False)):
        none.require_unfolded(None)
    a.solved = False
    steps._known = None
    steps.require_unfolded(SimpleNamespace(before=a, after=b))
    assert steps._known is None


def test_steps_are_spoken_of_on_one_rank(caplog):
    steps = sliding()
    steps._problem = SimpleNamespace(comm=SECOND)
    result = SimpleNamespace(slidings={"s": SimpleNamespace(distance=9.0)})
    state = SimpleNamespace(solved=True, time=1.0)
    steps.accept(SimpleNamespace(before=state, after=state, result=result), jump=False)
    assert steps._told is True
    assert caplog.records == []


# -- branches and rays of steps -------------------------------------------------------------------


class Ramp:
    """A problem whose data may be ramped, with what is made of it."""

    def __init__(self, log, fails=False):
        self.log, self.fails = log, fails
        self.prescribed = SimpleNamespace(part=None)
        self.equations, self.linear_solver, self.comm = self, "solver", ALONE
        self.surfaces = [SimpleNamespace(points=SimpleNamespace(number=n)) for n in (3, 4)]

    def create_vector(self):
        return SimpleNamespace(destroy=lambda: self.log.append("x freed"))

    def write(self, x):
        self.log.append("written")

    def ramped(self, x):
        return self

    def __enter__(self):
        self.log.append("ramped")

    def __exit__(self, *_):
        self.log.append("as given")


@pytest.mark.parametrize("fails", [True, False])
def test_the_branch_of_a_step_is_that_of_its_load(fails, monkeypatch):
    """From nothing of it to all of it, in units of the whole; all is put back and freed."""
    log, made = [], []
    problem = Ramp(log)

    class Follower:
        def __init__(self, system, control, gamma_scale):
            made.append((control, gamma_scale, problem.prescribed.part, system.linear()))

        def __enter__(self):
            return self

        def __exit__(self, *_):
            log.append("follower freed")

    def followed(follower, system, x):
        if fails:
            raise ValueError("no branch")
        return "branch"

    monkeypatch.setattr(
        step_branch,
        "Loaded",
        lambda eq, linear, x: SimpleNamespace(
            linear=linear, destroy=lambda: log.append("system freed")
        ),
    )
    monkeypatch.setattr(step_branch, "Follower", Follower)
    monkeypatch.setattr(step_branch, "_followed", followed)
    stepper = SimpleNamespace(
        problem=problem,
        prepare=lambda state, time: log.append(("prepared", state, time)),
        put=lambda state: log.append(("put", state)),
    )
    found = step_branch.branch_of_step(stepper, "state", 2.0)
    assert made == [(StepControl(kinks="exact"), 1.0, 0.0, "solver")]
    assert log == [
        ("prepared", "state", 2.0),
        "written",
        "ramped",
        "follower freed",
        "system freed",
        "as given",
        "x freed",
        ("put", "state"),
    ]
    if fails:
        assert found.why == "the solutions were not followed in the step: no branch"
        assert (found.reaches_end, found.ends) == (False, False)
    else:
        assert found == "branch"


def test_where_the_load_turns():
    for kinds, words in (
        ((), ""),
        (("event", "end"), ""),
        (("event", "fold"), "the load turns back"),
        (("bifurcation",), "the load turns back"),
    ):
        step = SimpleNamespace(special=[SimpleNamespace(kind=k) for k in kinds])
        assert step_branch._turned(step) == words


def test_rays_of_one_start_alone():
    """One ray with more load is followed without asking for the direction of the start."""
    follower = SimpleNamespace(
        bordered=SimpleNamespace(gamma=float, inner=lambda a, b: a * b), start=lambda *_: 1 / 0
    )

    def point(rate):
        return SimpleNamespace(tangent=rate)

    for rates, chosen in (
        ((0.5, -0.5, 1e-9), [0.5]),
        ((1.1e-9, 1e-9), [1.1e-9]),
        ((-0.5, -1e-9), [-1e-9]),
        ((-0.5, 1e-9), [1e-9]),
    ):
        found = SimpleNamespace(points=tuple(map(point, rates)), complete=False)
        assert [p.tangent for p in step_branch._with_more(follower, None, found)] == chosen


@pytest.mark.parametrize("why", ["", "cannot", "moves", "singular"])
def test_rays_of_a_step(why, monkeypatch):
    """Those along which the load grows, of what can be condensed; all is freed."""
    log = []
    problem = Ramp(log)
    system = SimpleNamespace(
        leaves_surfaces_alone=lambda: why != "moves",
        destroy=lambda: log.append("system freed"),
        statuses_of=lambda p: None if p == "piece c" else f"statuses of {p}",
    )
    asked = []

    class Condensed:
        def __init__(self, *given, **how):
            if why == "singular":
                raise RuntimeError("singular")
            asked.append((given[2], how, problem.prescribed.part))
            self.system = SimpleNamespace(tangent_cone=lambda w, tol: (w.tolist(), tol))

        def contract(self, x):
            return np.array([[3.0, -5.0]])

        def piece(self, codes):
            return f"piece {codes}"

        def destroy(self):
            log.append("condensed freed")

    def outgoing(cone):
        asked.append(cone)
        rays = [
            SimpleNamespace(codes=c, rate=r) for c, r in zip("abcd", (1, 0, 2, -1), strict=True)
        ]
        return SimpleNamespace(rays=rays, complete="complete", method="method")

    monkeypatch.setattr(step_rays, "Loaded", lambda *given: system)
    monkeypatch.setattr(step_rays, "can_condense", lambda system: why != "cannot")
    monkeypatch.setattr(step_rays, "Reduction", Condensed)
    monkeypatch.setattr(step_rays, "outgoing", outgoing)
    found = step_rays.rays_of_step(problem)
    assert log[-3:] == ["system freed", "as given", "x freed"]
    if why:
        assert found is None
        return
    assert asked[0] == (0.0, {"exact": False}, 0.0)
    assert asked[1] == ([[3.0, -5.0]], pytest.approx(5e-8))
    assert log[-4] == "condensed freed"
    assert found.statuses == ("statuses of piece a",)
    assert (found.complete, found.method) == ("complete", "method")
    assert step_rays.number_of_points(problem) == 7
