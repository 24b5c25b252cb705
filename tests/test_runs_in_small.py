"""Runs through times and along paths: what is checked, accepted, followed, and how they end."""

import math
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from blocks import block

from dolfinx_contact import Coulomb, Regularised
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution import (
    ArcLength,
    NoContinuation,
    QuasiStatic,
    arc_length,
    evolution,
    forks,
    quasi_static,
    through_times,
)
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.evolution import Evolution, _followed, _history_from
from dolfinx_contact.evolution.forks import Forked, Forks
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.jumps import Found
from dolfinx_contact.evolution.listeners import Listeners
from dolfinx_contact.evolution.motion_energy import MotionEnergies
from dolfinx_contact.evolution.path import PathHistory, PathStep
from dolfinx_contact.evolution.path_state import Known, PathState, PathTask, begun
from dolfinx_contact.evolution.run import Run, _RunProgress
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.evolution.through_times import (
    HistoryTask,
    ThroughTimes,
    _aim,
    _Ended,
    checked_times,
)
from dolfinx_contact.evolution.to_rest import RestState, RestTask, ToRest
from dolfinx_contact.solvers.history import ConvergenceError
from dolfinx_contact.solvers.strategies import Trial

ALONE = MPI.COMM_SELF
#: As seen by another rank than the first, of which nothing is said or shown.
SECOND = SimpleNamespace(rank=1, size=2, allreduce=lambda v, op=None: v, allgather=lambda v: [v])


def at(time, **more):
    return SimpleNamespace(time=time, **more)


def solved(a, b, **more):
    """A step between two times."""
    return SimpleNamespace(before=at(a, solved=True), after=at(b), **more)


# -- tables of steps ------------------------------------------------------------------------------


def result(**more):
    """What a table of steps takes of a result: two surfaces, of one of which bonds are known."""
    tables = {
        "floor": SimpleNamespace(
            status="ok",
            area=np.array([1.0, 3.0]),
            internal={"beta": np.array([0.2, 0.6]), "damage": np.array([0.0, 1.0])},
        ),
        "lid": SimpleNamespace(status="s", area=np.array([2.0]), internal={}),
    }
    known = {
        "tables": tables,
        "resultants": {"floor": np.array([1.5, -2.5]), "lid": np.array([0.5, 0.25, 4.0])},
        "counts": {"open": 1, "stick": 2, "slip": 3, "clamped": 4, "else": 5},
        "iterations": 6,
        "reason": "full steps",
    }
    return SimpleNamespace(**known | more)


def test_a_row_of_a_table_of_steps():
    energies = Energies(5.0, 2.0, 1.5, 0.25)
    step = EvolutionStep(3, 0.5, 0.75, result(), energies, 2, True, 4)
    assert step.status == "oks"
    assert step.row() == {
        "step": 3,
        "time": 0.75,
        "length": 0.25,
        "open": 1,
        "stick": 2,
        "slip": 3,
        "clamped": 4,
        "floor_x": 1.5,
        "floor_y": -2.5,
        "lid_x": 0.5,
        "lid_y": 0.25,
        "lid_z": 4.0,
        "external": 5.0,
        "stored": 2.0,
        "dissipated": 1.5,
        "damage": 0.25,
        "residue": 1.25,
        "beta_floor": (0.2 + 1.8) / 4,
        "damage_floor": 0.75,
        "newton_iterations": 6,
        "strategy": "full steps",
        "rejected": 2,
        "jump": True,
        "directions": 4,
    }
    before = step.row_before({"stored": 7.0, "nothing": 8.0})
    assert list(before) == list(step.row())
    known = {"step": 2, "time": 0.5, "length": 0.0, "stored": 7.0}
    assert before == dict.fromkeys(before) | known
    plain = EvolutionStep(1, 0.0, 1.0, result(), energies)
    assert (plain.rejected, plain.jump, plain.directions) == (0, False, None)


def test_what_a_history_knows_at_its_end():
    before = Energies(1.0)
    history = History(0.5, before)
    assert (history.time, history.energies, history.complete) == (0.5, before, False)
    assert (history.ending, history.reason, history.others) == (None, "not ended", [])
    assert history.rows(start=True) == history.rows() == []
    for number, time in ((1, 0.75), (2, 1.0)):
        energies = Energies(external=2.0 * number)
        history.steps.append(EvolutionStep(number, time - 0.25, time, result(), energies))
    assert (history.time, history.energies.external) == (1.0, 4.0)
    assert history.at(0.75) is history.steps[0]
    assert history.at(1.0) is history.steps[1]
    with pytest.raises(KeyError, match=r"no step ends at 0\.5"):
        history.at(0.5)
    assert [row["time"] for row in history.rows()] == [0.75, 1.0]
    first, *rest = history.rows(start=True)
    assert rest == history.rows()
    assert (first["step"], first["time"], first["external"]) == (0, 0.5, 1.0)
    assert (first["stick"], first["floor_x"]) == (None, None)
    for ending in Ending:
        history.end(ending)
        assert history.complete is (ending is Ending.REACHED)
    error = NoContinuation("nothing", history)
    assert (str(error), error.history) == ("nothing", history)
    assert _history_from(at(2.0, energies=before)) == History(2.0, before)


def test_points_of_a_path_by_what_happens_there():
    events = ("", "kink", "smooth fold", "nonsmooth fold", "kink")
    steps = [
        PathStep(
            i,
            0.0,
            1.0,
            result(),
            Energies(),
            gamma=0.1 * i,
            event=event,
            before="o",
            after="k",
            corrections=9,
        )
        for i, event in enumerate(events)
    ]
    path = PathHistory(0.0, steps=steps, gamma=0.75)
    assert [p.number for p in path.folds] == [2, 3]
    assert [p.number for p in path.kinks] == [1, 4]
    row = steps[3].row()
    wanted = {"newton_iterations": 9, "gamma": 0.1 * 3, "event": "nonsmooth fold"}
    assert {k: row[k] for k in wanted} == wanted
    assert (row["before"], row["after"]) == ("o", "k")
    assert path.rows(start=True)[0]["gamma"] == 0.75
    plain = PathStep(1, 0.0, 1.0, result(), Energies())
    assert (plain.gamma, plain.event, plain.before, plain.after) == (0.0, "", "", "")
    assert (plain.method, plain.corrections) == ("", 0)
    assert PathHistory(0.0).gamma == 0.0


# -- tasks ----------------------------------------------------------------------------------------


def test_tasks_of_runs():
    task = HistoryTask((0.0, 1.0), 2, np.float64(0.5), sudden=1)
    assert (task.longest, task.shortest, task.sudden) == (2.0, 0.5, 1.0)
    assert all(type(getattr(task, k)) is float for k in ("longest", "shortest", "sudden"))
    plain = HistoryTask((0.0, 1.0), 1.0, 1.0)
    assert (plain.at_jump, plain.sudden, plain.locate) == ("raise", math.inf, False)
    assert (plain.rays, plain.follow_rays, plain.extrapolate) == (False, False, False)
    HistoryTask((0.0, 1.0), math.inf, 1e-300, rays=None, follow_rays=True)
    for wrong, words in (
        ({"longest": "x"}, "longest must be a number, got 'x'"),
        ({"shortest": True}, "shortest must be a number, got True"),
        ({"sudden": None}, "sudden must be a number, got None"),
        ({"shortest": 0.0}, "0 < shortest <= longest, got 0.0, 1.0"),
        ({"shortest": -1.0}, "0 < shortest <= longest"),
        ({"shortest": math.inf}, "0 < shortest <= longest"),
        ({"longest": 0.499}, "0 < shortest <= longest, got 0.5, 0.499"),
        ({"longest": math.nan}, "0 < shortest <= longest"),
        ({"at_jump": "leap"}, "at_jump is 'leap': known are"),
        ({"rays": "all"}, "rays must be True, False or None"),
        ({"rays": False, "follow_rays": True}, "rays must be True or None"),
        ({"sudden": 0.999}, "sudden must be 1 or more, got 0.999"),
        ({"sudden": math.nan}, "sudden must be 1 or more"),
    ):
        with pytest.raises(ValueError, match=words):
            HistoryTask(**{"times": (0.0, 1.0), "longest": 1.0, "shortest": 0.5} | wrong)


def test_times_of_runs():
    assert checked_times([1, 2, 4], None) == (1.0, 2.0, 4.0)
    assert checked_times(np.array([[1.0], [2.0]]), at(1.0)) == (1.0, 2.0)
    # Round-off is that of the whole time; beyond all of it is another time.
    assert checked_times([1.0, 2.0, 1e9 + 1.0], at(0.0))[0] == 0.0
    assert checked_times([0.5e-6, 1.0, 1e3], at(0.0)) == (0.0, 1.0, 1e3)
    for wrong in (1.1e-6, -1.1e-6):
        with pytest.raises(ValueError, match=r"the evolution is at the time 0\.0, not"):
            checked_times([wrong, 1.0, 1e3], at(0.0))
    for wrong, words in (
        ("ab", "two or more times are needed, as numbers"),
        ([None, "x"], "two or more times are needed, as numbers"),
        ([1.0], "two or more finite times"),
        ([1.0, math.inf], "two or more finite times"),
        ([math.nan, 1.0], "two or more finite times"),
        ([1.0, 2.0, 2.0], "times must increase, got 2.0 after 2.0"),
        ([2.0, 1.0], "times must increase, got 1.0 after 2.0"),
    ):
        with pytest.raises(ValueError, match=words):
            checked_times(wrong, None)


def run_of_evolution(state=None, **more):
    """Arguments of `QuasiStatic.run`, checked, of an evolution that is somewhere."""
    a = {
        "self": SimpleNamespace(
            _accepted=None if state is None else state.accepted, _record="a record"
        ),
        "times": [0.0, 4.0, 8.0],
        "longest": math.inf,
        "shortest": None,
        "at_jump": "raise",
        "sudden": 2,
        "rays": None,
        "follow_rays": 0,
        "extrapolate": 1,
        **dict.fromkeys(("accept", "stop", "observer", "record", "progress")),
    }
    a = SimpleNamespace(**a | more)
    quasi_static._check_run(a)
    return a


def test_arguments_of_an_evolution():
    a = run_of_evolution()
    assert a.times == (0.0, 4.0, 8.0)
    assert a.shortest == 8.0 / 1024**2
    assert (a.sudden, type(a.sudden)) == (2.0, float)
    assert (a.follow_rays, a.extrapolate) == (False, True)
    assert run_of_evolution(shortest=1).shortest == 1.0
    for wrong, words in (
        ({"accept": 3}, "accept must be a function of a step"),
        ({"stop": 3}, "stop must be a function of a step"),
        ({"record": 3}, "record must be a record"),
        ({"observer": 3}, "observer must be an Observer"),
        ({"progress": 3}, "progress"),
        ({"times": [1.0, 2.0]}, "the evolution is at the time 0.0, not 1.0"),
    ):
        with pytest.raises(ValueError, match=words):
            run_of_evolution(SimpleNamespace(accepted=at(0.0)), **wrong)


def test_listeners_that_ranks_must_share():
    assert Listeners().compared() == {"stop_condition": False, "a_record": False}
    given = Listeners(stop=print, record="r")
    assert given.compared() == {"stop_condition": True, "a_record": True}
    a = SimpleNamespace(stop=1, observer=2, record=3, progress=4)
    assert Listeners.of(a) == Listeners(None, 1, 2, 3, 4)
    a.accept = 0
    assert Listeners.of(a) == Listeners(0, 1, 2, 3, 4)


def path_of(arrived=False, run=True, gamma=0.25, **more):
    """Arguments of `ArcLength.run`, checked, of a path that has begun or not."""
    path = ArcLength.__new__(ArcLength)
    state = SimpleNamespace(arrived="point" if arrived else None) if run else None
    vars(path).update(
        _run_state=state, parametric=SimpleNamespace(constant=SimpleNamespace(value=gamma))
    )
    if state is not None:
        state.gamma = gamma
    a = {
        "self": path,
        "gamma_range": (0, 1),
        "direction": None,
        "control": None,
        "max_steps": 10,
        "rays": None,
        **dict.fromkeys(("stop", "observer", "record", "progress")),
    }
    a = SimpleNamespace(**a | more)
    arc_length._check_run(a)
    return a


def test_arguments_of_a_path():
    a = path_of(run=False)
    assert (a.gamma_range, a.rays, a.direction) == ((0.0, 1.0), False, "increasing")
    assert a.control == StepControl(kinks="exact", initial=0.005, maximum=0.005)
    assert path_of().direction == "increasing"
    assert path_of(arrived=True).direction == "onwards"
    mine = StepControl(initial=0.01)
    assert path_of(control=mine, rays=True).control is mine
    assert path_of(rays=True).rays is True
    for direction in ("increasing", "decreasing"):
        assert path_of(direction=direction).direction == direction
        with pytest.raises(ValueError, match="direction of a later run must be one of"):
            path_of(arrived=True, direction=direction)
    for direction in ("onwards", "back"):
        assert path_of(arrived=True, direction=direction).direction == direction
        with pytest.raises(ValueError, match="direction of the first run must be one of"):
            path_of(direction=direction)
    for wrong, words in (
        ({"control": StepControl(kinks="batched")}, "passes kinks exactly, not 'batched'"),
        ({"gamma": 2.0}, r"gamma = 2 must lie in the range \[0.0, 1.0\]"),
        ({"gamma": -0.5, "run": False}, "gamma = -0.5 must lie"),
        ({"max_steps": 0}, "budget of steps"),
        ({"rays": 2}, "rays must be"),
        ({"record": 2}, "record must be a records.PathRecord"),
    ):
        with pytest.raises(ValueError, match=words):
            path_of(**wrong)
    path_of(control=StepControl(kinks="exact"))


def test_where_a_path_begins_again():
    """By the first length of its run, with what is known of scales but not of signs."""
    task = PathTask((0.0, 1.0), "onwards", StepControl(initial=0.03), 5, False)
    known = Known(2.0, 3.0, (4.0,), (5.0,))
    there = PathState(
        at(7.0, gamma=0.5),
        9.0,
        number=6,
        ending=Ending.BUDGET,
        reason="why",
        arrived="point",
        known=known,
        passed=(1.0, 2.0),
    )
    found = begun(task, there)
    assert (found.length, found.number, found.arrived) == (0.03, 6, "point")
    assert found.known == Known(2.0, 0.0, (4.0,), ())
    assert (found.passed, found.ending, found.reason) == ((7.0,), None, "")
    assert found.gamma == 0.5
    assert Known() == Known(0.0, 0.0, (), ())
    plain = PathState(at(0.0), 1.0)
    assert (plain.rate, plain.number, plain.settled) == (None, 0, True)
    assert (plain.ending, plain.reason, plain.arrived, plain.passed) == (None, "", None, ())


# -- through times --------------------------------------------------------------------------------


class Steps(ThroughTimes):
    """A run whose steps are as long as they are solved for, in what is given."""

    def __init__(self, times, **known):
        self.task = HistoryTask(tuple(times), **{"longest": 1.0, "shortest": 0.1} | known)
        self.ending, self.reason = None, ""
        self.failed, self.failure = False, None
        self.start = SimpleNamespace(accepted=at(times[0]))
        self.forks = []
        self._stepper = SimpleNamespace(problem=SimpleNamespace(comm=ALONE))
        self._accepts = None
        self._first = None
        self._accepted = at(times[0])
        self._length = self.task.longest
        self._rate = None
        self._number = 3
        self._settled = True
        self._rejected = 0
        self.asked, self.followed = [], []
        self.longest_solved = math.inf
        self.brief = False
        self.unfolded = True
        self.found = {}
        self.unwanted = set()
        self._sizes = SimpleNamespace(
            trial=lambda accepted, goal, end: SimpleNamespace(brief=self.brief),
            require_unfolded=self.require_unfolded,
            accept=lambda step, jump: None,
        )
        self._forks = SimpleNamespace(take=self.take, others=lambda forked: ["other"])

    def take(self, accepted, goal, trial):
        self.asked.append(goal)
        if goal - accepted.time > self.longest_solved:
            raise ConvergenceError("too long")
        step = SimpleNamespace(
            before=accepted, after=at(goal, energies=Energies()), result=result()
        )
        return Forked(step)

    def require_unfolded(self, step):
        if not self.unfolded:
            raise ConvergenceError("folded")

    def _jump(self, step):
        return self.found.pop(step.after.time, None)

    def _wanted(self, step):
        return step.after.time not in self.unwanted


@pytest.fixture
def rates(monkeypatch):
    monkeypatch.setattr(through_times, "_rate", lambda comm, step: ("rate", step.after.time))


def test_steps_to_the_times_of_the_user(rates):
    run = Steps([0.0, 1.5, 2.0])
    seen = list(run.advances())
    assert [a.step.time for a in seen] == run.asked == [0.75, 1.5, 2.0]
    assert [a.step.number for a in seen] == [4, 5, 6]
    assert [a.step.start for a in seen] == [0.0, 0.75, 1.5]
    assert (run.ending, run.reason) == (Ending.REACHED, "the last time is reached")
    assert not run.failed
    assert run._rate == ("rate", 2.0)
    assert run.forks == []


def test_a_step_that_is_given_comes_first(rates):
    run = Steps([0.0, 2.0], follow_rays=True, rays=True)
    run._first = SimpleNamespace(
        before=at(0.0), after=at(0.5, energies=Energies()), result=result()
    )
    seen = [a.step.time for a in run.advances()]
    assert seen == [0.5, 1.25, 2.0]
    assert run.forks == ["other"] * 3


def test_steps_that_are_not_solved(rates):
    """Are tried again with a quarter of the length, and grow again."""
    run = Steps([0.0, 1.0], shortest=0.09)
    run.longest_solved = 0.3
    seen = [(a.step.time, a.step.rejected) for a in run.advances()]
    # Two of 0.375 follow, which are too long; of these a quarter again, and its double.
    assert run.asked[:5] == [1.0, 0.25, 0.625, 0.34375, 0.34375 + 0.65625 / 4]
    assert seen[:3] == [(0.25, 1), (0.34375, 1), (run.asked[4], 0)]
    assert (run.ending, seen[-1][0]) == (Ending.REACHED, 1.0)
    run = Steps([0.0, 1.0])
    run.longest_solved, run.brief = 0.3, True
    next(run.advances())
    assert run.asked == [1.0, 0.5, 0.25]
    run = Steps([0.0, 1.0])
    run.unfolded = False
    assert list(run.advances()) == []
    assert run.asked == [1.0, 0.25]
    assert (run.ending, run.failed, str(run.failure)) == (Ending.NOT_SOLVED, True, "folded")
    assert "in a step of 0.25, which was not solved: folded" in run.reason


def test_steps_that_are_not_wanted(rates):
    """Are tried again with half the length."""
    run = Steps([0.0, 1.0])
    run.unwanted = {1.0, 0.5}
    first = next(run.advances())
    assert run.asked == [1.0, 0.5, 0.25]
    assert first.step.rejected == 2


@pytest.mark.parametrize("at_jump", ["raise", "jump"])
def test_steps_in_which_something_jumps(at_jump, rates, monkeypatch):
    """What leads on is accepted, the last of it unsettled; then the jump, or the end."""
    monkeypatch.setattr(through_times, "where_it_changes", lambda *_: "there")
    run = Steps([0.0, 1.0, 2.0], at_jump=at_jump)
    parts = [
        SimpleNamespace(before=at(a), after=at(b, energies=Energies()), result=result())
        for a, b in ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75))
    ]
    run.found = {1.0: Found(parts[:2], parts[2], why="not seen")}
    settled = []
    seen = []
    for advance in run.advances():
        seen.append((advance.step.time, advance.step.jump))
        settled.append(run._settled)
        if advance.step.time == 0.5:
            rate = run._rate
    assert seen[:2] == [(0.25, False), (0.5, False)]
    assert settled[:2] == [False, False]
    assert rate == ("rate", 0.5)
    if at_jump == "jump":
        assert seen[2:] == [(0.75, True), (1.0, False), (2.0, False)]
        assert settled[2:] == [True, True, True]
        assert run.ending is Ending.REACHED
    else:
        assert seen[2:] == []
        assert (run.ending, run.failed, run.failure) == (Ending.NOT_FOUND, True, None)
        assert run.reason == (
            "no solution beyond the time 0.5 was found that continues the evolution, in a step of "
            "0.25; at its end another one was found, there. Whether one does is not decided: not "
            "seen"
        )
    run = Steps([0.0, 1.0])
    run.found = {1.0: Found(parts[:2])}
    settled = []
    for _ in run.advances():
        settled.append(run._settled)
    assert settled == [False, True, True]


def test_why_no_solution_leads_on(monkeypatch):
    monkeypatch.setattr(through_times, "where_it_changes", lambda *_: "there")
    run = Steps([0.0, 1.0])
    error = ConvergenceError("no")
    for found, ending, words in (
        (
            Found([], None, proved=True, why="it turns", failure=None),
            Ending.NO_SOLUTION,
            "in the step from 0.5 to 0.75, where it turns; at its end another one was found, there",
        ),
        (
            Found([], None, failure=error),
            Ending.NOT_SOLVED,
            "no step beyond the time 0.5 was solved, down to 0.1, that leads on from it; in a "
            "solution further off, at 0.75, there. Whether one continues the evolution is not "
            "decided: no",
        ),
    ):
        with pytest.raises(_Ended) as ended:
            run._jump_over(found, solved(0.5, 0.75))
        assert ended.value.ending is ending
        assert str(ended.value).endswith(words)
        assert ended.value.__cause__ is found.failure


def test_only_points_are_as_slow_as_the_body(monkeypatch):
    """The change of all unknowns is sudden by its own rate, as bonds are."""
    monkeypatch.setattr(through_times, "_rate", lambda comm, step: np.array(step.rates))
    monkeypatch.setattr(through_times, "largest_at_points", lambda *_: (None, np.zeros(1)))
    problem = SimpleNamespace(comm=ALONE, surfaces=["one"])
    run = SimpleNamespace(
        _rate=np.array([100.0, 0.1, 1.0, 0.5, 1.0]), _stepper=SimpleNamespace(problem=problem)
    )
    # Of body, unknowns, mean of the points, bonds, one point.
    for rates, known in (
        ([0.0, 0.19, 49.0, 9.0, 49.0], None),
        ([0.0, 0.21, 49.0, 9.0, 49.0], [math.inf, 0.2, 50.0, 0.0]),
        ([0.0, 0.0, 51.0, 0.0, 0.0], [math.inf, 0.2, 50.0, 0.0]),
        ([0.0, 0.0, 0.0, 0.0, 51.0], [math.inf, 0.0, 0.0, 0.0]),
    ):
        found = ThroughTimes._sudden(run, SimpleNamespace(before=0, after=0, rates=rates), 2.0)
        assert (found is None) if known is None else (found.tolist() == known)


def test_when_a_jump_is_looked_for(monkeypatch):
    """In a step that is sudden, from a state that is a solution."""
    asked = []
    monkeypatch.setattr(through_times, "find_jump", lambda *given: asked.append(given) or "found")

    def found(sudden, good=True, slow="slow"):
        run = SimpleNamespace(
            task=SimpleNamespace(sudden=sudden, shortest=0.25),
            _sudden=lambda step, times: (slow, times)[0] if times == sudden else "wrong",
            _stepper="stepper",
        )
        step = SimpleNamespace(before=SimpleNamespace(solved=good))
        return ThroughTimes._jump(run, step), step

    assert found(math.inf)[0] is None
    assert found(2.0, good=False)[0] is None
    assert found(2.0, slow=None)[0] is None
    answer, step = found(2.0)
    assert answer == "found"
    assert asked == [("stepper", step, "slow", 0.25)]


def test_which_steps_are_wanted(monkeypatch):
    """Those in which a point closes are to be short, and what the user asks; if they can be."""
    monkeypatch.setattr(through_times, "_closes", lambda comm, step: step.closes)
    shown = []

    def wanted(accept, length, locate=False, closes=False):
        shown.clear()
        run = SimpleNamespace(
            _stepper=SimpleNamespace(
                problem=SimpleNamespace(comm=ALONE),
                show=shown.append,
                changed_since_put=lambda: changed,
            ),
            task=SimpleNamespace(shortest=0.5, locate=locate),
            _accepts=accept,
            _step=lambda step, jump: (step, jump),
        )
        return ThroughTimes._wanted(run, solved(1.0, 1.0 + length, closes=closes))

    asked = []
    changed = ""
    no = lambda step: asked.append(step) or False  # noqa: E731
    assert wanted(None, 1.0) is True
    assert wanted(None, 1.0, locate=True, closes=True) is False
    assert wanted(None, 0.99, locate=True, closes=True) is True
    assert wanted(None, 1.0, locate=False, closes=True) is True
    assert shown == []
    assert wanted(no, 1.0) is False
    assert len(shown) == 1
    assert asked == [(shown[0], False)]
    assert wanted(no, 0.99) is True
    assert shown == []
    assert wanted(lambda step: np.True_, 1.0) is True
    for answer in (None, 1, "yes"):
        with pytest.raises(ValueError, match="accept must answer True or False, got "):
            wanted(lambda step, answer=answer: answer, 1.0)
    changed = "the lid"
    with pytest.raises(ValueError, match="accept changed the lid"):
        wanted(no, 1.0)


@pytest.mark.parametrize("wanted", [True, False])
def test_a_step_that_another_rank_is_asked_of(wanted):
    """Who is not asked has nothing against it; what one refuses no rank accepts."""
    answers = iter([1, int(not wanted)])
    refused = []

    class Two:
        def Iallreduce(self, mine, failed, op):
            return ALONE.Iallreduce(mine, failed, op)

        def allreduce(self, mine):
            refused.append(mine)
            return next(answers)

        def allgather(self, mine):
            return [mine]

    run = SimpleNamespace(
        _stepper=SimpleNamespace(
            problem=SimpleNamespace(comm=Two()),
            show=lambda step: None,
            changed_since_put=lambda: "",
        ),
        task=SimpleNamespace(shortest=0.5, locate=False),
        _accepts=None,
    )
    assert ThroughTimes._wanted(run, solved(1.0, 3.0)) is wanted
    assert refused == [0, 0]


def test_how_far_solutions_are_looked_for():
    """At times four times as far, each after the other, up to the last one."""
    tried = []

    def take(start, time, likely=(), guess=None):
        tried.append(time)
        raise ConvergenceError("no")

    def beyond(last):
        tried.clear()
        run = SimpleNamespace(
            _stepper=SimpleNamespace(take=take),
            _accepted=at(1.0),
            task=SimpleNamespace(times=(0.0, last)),
        )
        return ThroughTimes._beyond(run, 1.0 + 2.0**-10)

    assert beyond(5.0) is None
    np.testing.assert_allclose(tried, [1 + 4.0**k / 1024 for k in range(1, 6)] + [5.0])
    assert beyond(1 + 4.0**4 / 1024) is None
    np.testing.assert_allclose(tried, [1 + 4.0**k / 1024 for k in range(1, 5)])
    assert beyond(1e30) is None
    assert len(tried) == 20
    assert tried[-1] == 1e30


@pytest.mark.parametrize(("far", "answer"), [(3.0, None), (9.0, "near")])
def test_coming_back_from_a_solution_further_off(far, answer):
    """By a quarter of the way each, never as near as what is looked for."""
    tried = []

    def take(start, time, likely=(), guess=None):
        tried.append((time, guess and guess.time))
        if guess is None and time < far:
            raise ConvergenceError("no")
        if guess is not None and time == 2.0 and (guess.time > 3.5 or answer is None):
            raise ConvergenceError("no")
        return SimpleNamespace(after=at(time, statuses="codes"), name="near")

    run = SimpleNamespace(
        _stepper=SimpleNamespace(take=take),
        _accepted=at(1.0),
        task=SimpleNamespace(times=(0.0, far)),
    )
    found = ThroughTimes._beyond(run, 2.0)
    if answer is None:
        assert found is None
        # A quarter of the way is nearer than that.
        assert tried == [(3.0, None), (2.0, 3.0)]
    else:
        assert found.after.time == 2.0
        assert tried == [(5.0, None), (9.0, None), (2.0, 9.0), (3.0, 9.0), (2.0, 3.0)]


def test_equal_steps_but_for_round_off():
    assert _aim(0.0, 0.3, 0.1) == pytest.approx(0.1)
    assert _aim(0.0, 0.1 * 3 * (1 + 1e-13), 0.1) == pytest.approx(0.1)
    assert _aim(0.0, 0.3 * (1 + 1e-9), 0.1) == pytest.approx(0.075)
    assert _aim(1.0, 2.0, 1.0) == 2.0
    assert _aim(1.0, 2.0, 0.999) == 1.5


def test_a_run_to_rest():
    """Goes on by whole steps, and is where it was if it continues."""
    state = RestState(at(1.0), 0.25, number=7, peak=5.0, quiet=3)
    same = RestState(at(1.0), 0.25)
    assert (same.peak, same.quiet) == (0.0, 0)
    assert same != RestState(same.accepted, 0.25)
    assert RestTask((0.0,), 1.0, 0.5).max_time == math.inf
    assert RestTask((0.0,), 1.0, 0.5).rest == 0.0
    task = RestTask((0.5,), 0.25, 0.125, max_time=2.0, rest=0.5)
    surfaces = []
    problem = SimpleNamespace(comm=ALONE, surfaces=surfaces)
    run = ToRest(SimpleNamespace(problem=problem), task, state)
    assert (run._peak, run._quiet, run._goal) == (5.0, 3, 1.0)
    again = run.run_state
    assert (again.peak, again.quiet, again.number, again.length) == (5.0, 3, 7, 0.25)
    plain = ToRest(SimpleNamespace(problem=problem), task, RunState(at(1.0), 0.25))
    assert (plain._peak, plain._quiet) == (0.0, 0)
    assert run.part(None) is None
    goals = run._goals()
    assert (next(goals), run._goal, run._length) == (1.25, 1.25, 0.25)
    run._accepted, run._length = at(1.25), 99.0
    assert (next(goals), run._length) == (1.5, 0.25)
    run.end(Ending.BUDGET)
    assert list(goals) == []


@pytest.mark.parametrize(
    ("passed", "quiet", "rests"),
    [(100.0, 39, True), (100.0, 38, False), (20.0, 9, True), (20.0, 8, False), (101.0, 39, False)],
)
def test_what_turns_back_is_not_at_rest(passed, quiet, rests):
    """For four times the root of what counts as rest, of the time since the start."""
    task = RestTask((1.0,), 1.0, 0.5, max_time=1e3, rest=0.01)
    run = ToRest.__new__(ToRest)
    ends = []
    vars(run).update(task=task, _goal=1.0 + passed, _peak=5.0, _quiet=quiet)
    run.end = lambda ending, words: ends.append((ending, words))
    energies = MotionEnergies(kinetic=0.05)
    run._end_if_reached(SimpleNamespace(after=at(1.0 + passed, energies=energies)))
    assert ends == ([(Ending.REACHED, "the body is at rest")] if rests else [])
    assert (run._quiet, run._peak) == (quiet + 1, 5.0)
    energies = MotionEnergies(kinetic=0.051)
    run._end_if_reached(SimpleNamespace(after=at(1.0 + passed, energies=energies)))
    assert run._quiet == 0
    energies = MotionEnergies(kinetic=6.0)
    run._end_if_reached(SimpleNamespace(after=at(1.0 + passed, energies=energies)))
    assert run._peak == 6.0


# -- forks ----------------------------------------------------------------------------------------


def forked(wanted=None, solves=lambda likely: True, rays=None, points=1):
    """Forks of a problem with some points, where statuses are numbers and the step returns them."""
    calls = []

    def take(accepted, time, *, trial=None, likely=()):
        calls.append(likely)
        if not solves(likely):
            raise ConvergenceError("no")
        found = likely[0] if likely else accepted.then
        return SimpleNamespace(before=accepted, after=at(time, statuses=found))

    surface = SimpleNamespace(points=SimpleNamespace(number=points))
    problem = SimpleNamespace(comm=ALONE, surfaces=[surface])
    found = Forks(SimpleNamespace(problem=problem, take=take), wanted)
    found._rays = lambda accepted, time: rays
    return found, calls


def codes(*numbers):
    return [np.array(numbers, dtype=np.int8)]


def test_steps_from_which_others_part():
    stick, slip, back = codes(1, 1), codes(1, 2), codes(1, 3)
    rays = SimpleNamespace(statuses=(stick, slip, back))
    start = at(0.0, statuses=stick, then=stick)
    found, _ = forked(rays=rays)
    step = found.take(start, 1.0, Trial())
    assert (step.rays, step.directions) == (None, None)
    for wanted, then in ((True, stick), (None, slip)):
        start.then = then
        found, _ = forked(wanted, rays=rays)
        step = found.take(start, 1.0, Trial())
        assert step.rays is rays
        assert step.directions == 3
    # Where no step is found the other rays are tried, in turn.
    found, calls = forked(None, lambda likely: likely and likely[0] is back, rays)
    step = found.take(start, 1.0, Trial())
    assert calls == [(), (slip,), (back,)]
    assert (step.solved.after.statuses, step.rays) == (back, rays)
    for trial, looked in ((Trial(brief=True), []), (Trial(), [(slip,), (back,)])):
        found, calls = forked(None, lambda likely: False, rays)
        with pytest.raises(ConvergenceError):
            found.take(start, 1.0, trial)
        assert calls[1:] == looked
    found, calls = forked(None, lambda likely: False, None)
    with pytest.raises(ConvergenceError):
        found.take(start, 1.0, Trial())
    assert calls == [()]


def test_statuses_of_two_states_that_are_the_same():
    found, _ = forked()
    assert found._same(codes(1, 2), codes(1, 2)) is True
    assert found._same(codes(1, 2), codes(1, 3)) is False
    assert found._same(None, codes(1)) is True
    assert found._same(codes(1), None) is True
    assert found._same(None, None) is True


@pytest.mark.parametrize(("points", "few"), [(15, True), (16, True), (17, False)])
def test_few_points(points, few):
    assert forked(points=points)[0]._few is few


def test_other_ways_on(monkeypatch, caplog):
    """Those that lead elsewhere, each once; what is not solved is said, on one rank."""
    monkeypatch.setattr(forks, "change", lambda comm, a, b: abs(a.place - b.place))
    places = {"first": 1.0, "same": 1.0 + 0.9e-6, "near": 1.0 + 1.1e-6, "far": 3.0}
    comm = ALONE

    def take(accepted, time, likely):
        (name,) = likely
        if name == "none":
            raise ConvergenceError("not solved")
        return SimpleNamespace(before=accepted, after=at(time, place=places[name]))

    def others(*names):
        found = forked()[0]
        found._stepper = SimpleNamespace(problem=SimpleNamespace(comm=comm), take=take)
        start = at(0.0, place=0.0)
        first = SimpleNamespace(before=start, after=at(1.0, place=1.0))
        rays = SimpleNamespace(statuses=names) if names else None
        return [step.after.place for step in found.others(Forked(first, rays))]

    assert others() == []
    assert others("first", "same") == []
    assert others("near", "far", "far") == [places["near"], 3.0]
    assert caplog.records == []
    assert others("none", "far") == [3.0]
    (said,) = caplog.records
    assert said.message.startswith("another way on from the time 0 is not followed")
    assert said.message.endswith("not solved")
    comm = SECOND
    assert others("none", "far") == [3.0]
    assert len(caplog.records) == 1


# -- evolutions -----------------------------------------------------------------------------------


def test_what_is_no_evolution():
    problem = block(n=1)
    with pytest.raises(ValueError, match="a ContactProblem is needed, got str"):
        QuasiStatic("problem", print)
    with pytest.raises(ValueError, match="the load must be a function of the time, got 3"):
        QuasiStatic(problem, 3)
    slow = block(n=1, law=Regularised(Coulomb(0.3), 0.1))
    with pytest.raises(ValueError, match="lacks a speed"):
        QuasiStatic(slow, print)
    made = QuasiStatic(problem, print)
    assert (made.problem, made.load) == (problem, print)
    assert (made.method, made.kept, made.data, made.forms) == ((), {}, (), ())
    for progress, passed in ((False, False), (True, None), (None, None)):
        assert made._stepper(progress)._progress is passed


class Whole(Evolution):
    """An evolution whose runs are recorded, and do nothing."""

    def __init__(self):
        vars(self).update(runs=[], asked=[], _run_state=None, load="load", _asked=None)

    def _stepper(self, progress):
        return SimpleNamespace(
            start=lambda time: ("start", time),
            renewed=lambda accepted: ("renewed", accepted),
            require_untouched=self.asked.append,
        )

    def _run(self, task, run_state, listeners):
        self.runs.append((task, run_state, listeners))
        return "history"


def test_where_runs_begin():
    one = Whole()
    task = HistoryTask((2.0, 3.0), 0.5, 0.25)
    assert one._begin(task, Listeners()) == "history"
    (_, state, _) = one.runs[0]
    assert (state.accepted, state.length, state.rate, state.number) == (
        ("start", 2.0),
        0.5,
        None,
        0,
    )
    vars(one)["_run_state"] = RunState("there", 9.0, "rate", 7, False, Ending.STOPPED, "why")
    one._begin(task, Listeners())
    assert one.asked == ["there"]
    (_, state, _) = one.runs[1]
    assert (state.accepted, state.length) == (("renewed", "there"), 0.5)
    assert (state.rate, state.number, state.settled) == ("rate", 7, True)
    assert (state.ending, state.reason) == (None, "")


@pytest.mark.parametrize("failed", [True, False])
@pytest.mark.parametrize("at_jump", ["raise", "stop"])
@pytest.mark.parametrize("asked", [True, False])
def test_how_runs_end(failed, at_jump, asked, monkeypatch):
    """The load is asked once whether it depends on the solution, where a run did not fail."""
    done, asks = [], []
    stepper = SimpleNamespace(
        put=lambda accepted: done.append(("put", accepted)),
        ask_at_end=lambda start, accepted: done.append(("asked", start.time, accepted)),
    )
    rule = SimpleNamespace(
        forks=["fork"],
        run_state=SimpleNamespace(accepted="last"),
        failed=failed,
        failure=ConvergenceError("cause"),
    )
    monkeypatch.setattr(evolution, "_followed", lambda *given: ["others", given[0]])
    one = Whole()
    vars(one)["_asked"] = one.load if asked else None
    vars(one).update(
        _stepper=lambda progress: stepper,
        _rule=lambda *given: rule,
        _follow=lambda run: asks.append((stepper.asks, run._rule, run._history)),
    )
    monkeypatch.setattr(evolution, "Run", lambda s, r, ls, h: SimpleNamespace(_rule=r, _history=h))
    task = SimpleNamespace(at_jump=at_jump)
    state = RunState(at(1.5, energies="energies"), 1.0)
    run = lambda: Evolution._run(one, task, state, Listeners(accept="a"))  # noqa: E731
    if failed and at_jump == "raise":
        with pytest.raises(NoContinuation) as error:
            run()
        assert error.value.__cause__ is rule.failure
        history = error.value.history
    else:
        history = run()
    assert (history.start, history.before) == (1.5, "energies")
    assert history.others == ["others", ["fork"]]
    (told,) = asks
    assert told == (not asked, rule, history)
    assert done[0] == ("put", "last")
    assert done[1:] == ([("asked", 1.5, "last")] if not asked and not failed else [])
    assert one._asked == (one.load if asked or not failed else None)


def test_evolutions_along_other_rays(monkeypatch):
    """Each is followed with its own, up to a number; of the rest it is said that they are not."""
    made = []

    class Rule:
        def __init__(self, stepper, task, run_state, first):
            made.append((run_state.accepted.time, run_state.length, first))
            self.forks = [fork(first.before.time + 100)] if first.before.time == 0 else []

    def fork(time):
        return SimpleNamespace(before=at(time, energies=Energies(external=time)))

    class OneRun:
        def __init__(self, stepper, rule, listeners, history):
            assert listeners == Listeners(progress=False)
            self.history = history

        def go(self):
            self.history.end(Ending.REACHED)
            return self.history

    monkeypatch.setattr(evolution, "ThroughTimes", Rule)
    monkeypatch.setattr(evolution, "Run", OneRun)
    task = SimpleNamespace(longest=0.5)
    assert _followed([], "stepper", task) == []
    found = _followed([fork(0.0), fork(1.0)], "stepper", task)
    assert [h.start for h in found] == [0.0, 1.0, 100.0]
    assert [m[:2] for m in made] == [(0.0, 0.5), (1.0, 0.5), (100.0, 0.5)]
    assert [h.before.external for h in found] == [0.0, 1.0, 100.0]
    found = _followed([fork(float(i)) for i in range(1, 19)], "stepper", task)
    assert len(found) == 18
    assert [h.ending for h in found] == [Ending.REACHED] * 16 + [Ending.BUDGET] * 2
    assert found[-1].reason == "not followed: more than 16 evolutions"
    assert found[-1].start == 18.0


# -- jumps by dynamics ----------------------------------------------------------------------------


def quiet(u, time=1.0):
    """A quasi-static evolution at a time, of which the problem is a displacement alone."""
    one = QuasiStatic.__new__(QuasiStatic)
    state = RunState(at(time, energies=Energies(1.0, 2.0, 3.0, 4.0)), 0.5, "rate", 7)
    loads, puts = [], []
    vars(one).update(
        problem=SimpleNamespace(comm=ALONE, u=u),
        _run_state=state,
        load=loads.append,
        put=puts.append,
        recalled=lambda *given, first: (given, first),
    )
    return one, loads, puts


@pytest.mark.parametrize("complete", [True, False])
def test_a_jump_by_dynamics(complete):
    """Energies of motion are added, and the evolution is where the body rests."""
    history = History(0.0, Energies(10.0, 20.0, 30.0, 40.0), reason="too long")
    history.ending = Ending.REACHED if complete else Ending.BUDGET
    settled = []
    motion = SimpleNamespace(
        problem=SimpleNamespace(u="u"),
        memory="memory",
        settle=lambda *given, **more: settled.append((given, more)) or history,
    )
    one, loads, puts = quiet("u")
    if complete:
        assert one.jump(motion, 1.5, 9.0) is history
        before, after = puts
        assert after.accepted == ((1.5, "memory", Energies(11.0, 22.0, 33.0, 44.0)), False)
        assert (after.rate, after.length, after.number) == (None, 0.5, 7)
    else:
        with pytest.raises(NoContinuation, match="the body moves on: too long"):
            one.jump(motion, 1.5, 9.0)
        before, after = puts
        assert after is before
    assert before is one._run_state
    assert loads == [1.5]
    assert settled == [((9.0,), {"rest": 1e-6, "progress": False})]


def test_jumps_that_are_none():
    one, *_ = quiet("u")
    motion = SimpleNamespace(problem=SimpleNamespace(u="u"))
    check = lambda **given: quasi_static._check_jump(  # noqa: E731
        SimpleNamespace(**{"self": one, "motion": motion, "time": 1.0} | given)
    )
    check()
    check(time=1.5)
    with pytest.raises(ValueError, match="at its time or later"):
        check(time=0.999)
    with pytest.raises(ValueError, match="at its time or later"):
        check(time=math.nan)
    with pytest.raises(ValueError, match="the motion is that of another body"):
        check(motion=SimpleNamespace(problem=SimpleNamespace(u="v")))
    vars(one)["_run_state"] = None
    with pytest.raises(ValueError, match="a jump begins where a run has ended"):
        check()


# -- one run --------------------------------------------------------------------------------------


class Rule:
    """Goes two steps, and ends."""

    what, units = "evolution", "steps"

    def __init__(self, log, ending=None):
        self.task, self.start = "task", SimpleNamespace(accepted="start")
        self.ending, self.reason = ending, "why" if ending else ""
        self.log = log
        self.number = 0

    @property
    def run_state(self):
        return SimpleNamespace(accepted=f"state {self.number}", ending=self.ending)

    def begin(self):
        self.log.append("begin")

    def end(self, ending, reason=""):
        self.ending, self.reason = ending, reason

    def advances(self):
        for self.number in (1, 2, 3):
            if self.number == 2:
                self.end(Ending.REACHED, "done")
            step = SimpleNamespace(result=f"result {self.number}", number=self.number)
            yield SimpleNamespace(step=step, solved=f"solved {self.number}")


class Log:
    """An observer or record that writes down what it is called with."""

    def __init__(self, name, log):
        self.name, self.log = name, log

    def begin(self, task, state):
        self.log.append(f"{self.name} begins")

    def step(self, step, state):
        self.log.append(f"{self.name} {step.number} {state.accepted}")

    def end(self, ended):
        self.log.append(f"{self.name} ends {ended.reason}")

    def explored(self, diagram):
        raise AssertionError


def a_run(log, ending=None, **more):
    watch = more.pop("watch", lambda: "")

    class Problem:
        comm = ALONE

        def warning_once(self):
            return self

        def __enter__(self):
            log.append("in")

        def __exit__(self, *_):
            log.append("out")

        def warn_of_doubts(self, found):
            log.append(f"doubts of {found}")

    stepper = SimpleNamespace(
        problem=Problem(),
        put=lambda accepted: log.append(f"put {accepted}"),
        show=lambda step: log.append(f"show {step}"),
        data_watch=lambda: watch,
    )
    listeners = Listeners(record=Log("record", log), observer=Log("observer", log), **more)
    history = History(0.0)
    return Run(stepper, Rule(log, ending), listeners, history), history


def of(log, *names):
    return [line for line in log if line.split()[0] in names]


def test_a_run_from_its_start_to_its_end():
    log = []
    run, history = a_run(log, progress=False)
    assert run.run_state is None
    assert run.go() is history
    assert (history.ending, history.reason) == (Ending.REACHED, "done")
    assert [s.number for s in history.steps] == [1, 2]
    assert run.run_state.accepted == "state 2"
    assert of(log, "begin", "record", "observer") == [
        "begin",
        "record begins",
        "observer begins",
        "record 1 state 1",
        "observer 1 state 1",
        "record 2 state 2",
        "observer 2 state 2",
        "record ends done",
        "observer ends done",
    ]
    assert of(log, "doubts") == ["doubts of result 1", "doubts of result 2"]
    assert log[0] == "put start"
    assert log[-1] == "put state 2"
    # Records see the state, observers the step by which it was solved.
    for who, seen in (("record 1 state 1", "put state 1"), ("observer 1 state 1", "show solved 1")):
        assert log[log.index(who) - 1] == seen
    assert log[log.index("observer begins") - 1] == "put start"
    log.clear()
    run, history = a_run(log, Ending.BUDGET, progress=False)
    run.go()
    assert (history.ending, history.reason, history.steps) == (Ending.BUDGET, "why", [])
    assert "in" not in log


def test_a_run_that_the_user_ends():
    """By a reason, with the step that is then the last; not one that is over."""
    log, asked = [], []
    run, history = a_run(
        log, progress=False, stop=lambda step: asked.append(step.number) or "enough"
    )
    run.go()
    assert (history.ending, history.reason) == (Ending.STOPPED, "enough")
    assert asked == [1]
    assert run.run_state.ending is Ending.STOPPED
    asked.clear()
    run, history = a_run(log, progress=False, stop=lambda step: asked.append(step.number) or "")
    run.go()
    assert asked == [1]
    assert history.reason == "done"
    run, _ = a_run(log, progress=False, stop=lambda step: "", watch=lambda: "the load")
    with pytest.raises(ValueError, match="changed the load"):
        run.go()


def test_the_last_line_of_a_run():
    closed = []
    shown = SimpleNamespace(
        _progress=SimpleNamespace(close=closed.append),
        _rule=SimpleNamespace(what="path", units="points"),
    )
    history = History(0.0, steps=["a", "b"], reason="it is over")
    _RunProgress.end(shown, history)
    assert closed == ["path: 2 points, it is over"]


def test_where_the_next_run_begins():
    """Where the last one has ended, also if it failed; else where the one before has."""
    one = Whole()
    one._follow(SimpleNamespace(go=lambda: None, run_state="there"))
    assert one._run_state == "there"
    assert Whole()._accepted is None

    def fails():
        raise RuntimeError("no")

    for state, where in (("here", "here"), (None, "here")):
        with pytest.raises(RuntimeError):
            one._follow(SimpleNamespace(go=fails, run_state=state))
        assert one._run_state == where
