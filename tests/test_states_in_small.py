"""Accepted states and steps from them, at rest and in motion, with what they ask given."""

import logging
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from blocks import block, box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, _mesh_mark
from dolfinx_contact.body.moving import TimeStep
from dolfinx_contact.evolution import NSCD, accepted, motion, nscd
from dolfinx_contact.evolution.accepted import (
    AcceptedState,
    AtRest,
    SolvedStep,
    Stepper,
    _at_points,
    _at_same_place,
    _other_fields,
    largest_at_points,
)
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.motion import Method, MotionStepper, MovingState
from dolfinx_contact.evolution.motion_energy import MotionEnergies
from dolfinx_contact.evolution.to_rest import RestTask
from dolfinx_contact.laws import Internal
from dolfinx_contact.laws.status import OPEN, STICK
from dolfinx_contact.laws.symbols import SLID
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.solvers.strategies import Trial

COMM = MPI.COMM_WORLD
ALONE = MPI.COMM_SELF
#: As seen by another rank than the first, of which nothing is said.
SECOND = SimpleNamespace(
    rank=1,
    size=2,
    allreduce=lambda v, op=None: v,
    allgather=lambda v: [v],
    Iallreduce=ALONE.Iallreduce,
)


@pytest.fixture(autouse=True)
def _unmarked(monkeypatch):
    """No Function is marked as one that has a state: those in this file are stand-ins."""
    for room in (accepted, motion):
        monkeypatch.setattr(room, "note_put", lambda *functions: None)


def memory(jump=((1.0, 2.0),), **fields):
    given = {
        SLID if k == "slid" else k: np.atleast_1d(np.array(v, float)) for k, v in fields.items()
    }
    return Memory(np.array(jump, dtype=float), given)


# -- what is remembered ---------------------------------------------------------------------------


def test_what_is_remembered_otherwise():
    """By more than round-off beside the larger of both; distances slipped have words."""
    old = memory(beta=[0.5, 2.0], slid=[0.0, 1.0], d=[0.0, 0.0])
    for change, names in (
        ({}, []),
        ({"beta": [0.5, 2.0 * (1 + 0.9e-9)]}, []),
        ({"beta": [0.5, 2.0 * (1 + 1.1e-9)]}, ["beta"]),
        ({"beta": [0.5 - 1.1e-9 * 2.0, 2.0]}, ["beta"]),
        ({"beta": [0.0, 0.0], "slid": [0.0, 0.0]}, ["beta", "the distance slipped"]),
        ({"d": [0.0, 1e-30]}, ["d"]),
    ):
        new = memory(**{"beta": [0.5, 2.0], "slid": [0.0, 1.0], "d": [0.0, 0.0]} | change)
        assert _other_fields(old, new) == names
        assert _other_fields(new, old) == names
    assert _other_fields(old, None) == _other_fields(None, old) == []
    assert _other_fields(old, memory()) == []
    assert _other_fields(memory(beta=[]), memory(beta=[])) == []


def test_what_is_remembered_of_the_same_place():
    """But for round-off beside the jump, and beside the body."""
    old = memory([[0.0, 4.0]])
    for off, size, same in (
        (0.0, 0.0, True),
        (3.9e-9, 0.0, True),
        (4.1e-9, 0.0, False),
        (-4.1e-9, 0.0, False),
        (4.1e-9, 1e4, True),
        (6e-9, 1e4, False),
    ):
        assert _at_same_place(old, memory([[0.0, 4.0 + off]]), size) is same
    assert _at_same_place(old, None, 9.0) is False
    assert _at_same_place(old, memory([[0.0, 4.0], [0.0, 4.0]]), 9.0) is False
    none = memory(np.zeros((0, 2)))
    assert _at_same_place(none, none, 0.0) is True


def resting(jump, beta, method="nodal", bond=True):
    """A state of one surface with a bond, whose third node is clamped."""
    law = SimpleNamespace(weakening=Internal("beta", "falls") if bond else None)
    surface = SimpleNamespace(law=law, method=method)
    clamped = [np.array([False, False, True, True])]
    eq = SimpleNamespace(surfaces=[surface], constraints=SimpleNamespace(clamped=clamped))
    known = SimpleNamespace(fields={"beta": np.array(beta)}) if beta is not None else None
    forces = SimpleNamespace(equations=eq, surfaces=[SimpleNamespace(jump=np.array(jump))])
    state = AtRest.__new__(AtRest)
    vars(state).update(forces=forces, memory=(known,))
    return state


def test_what_happens_at_points():
    """Of those that are not clamped, by the whole change of the jump."""
    a = resting([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]], [0.8, 0.5, 1.0])
    b = resting([[3.0, 4.0], [1.0, 2.0], [9.0, 9.0]], [0.2, 0.5, 0.0])
    (found,) = _at_points(a, b)
    np.testing.assert_allclose(found.distances, [5.0, 1.0])
    np.testing.assert_allclose(found.weakened, [0.6, 0.0])
    np.testing.assert_allclose(found.left, [0.8, 0.5])
    whole = (
        resting(s.forces.surfaces[0].jump, s.memory[0].fields["beta"], "integral") for s in (a, b)
    )
    assert len(_at_points(*whole)[0].distances) == 3
    none = resting([[0.0, 0.0]] * 3, None)
    for first, last in (
        (none, b),
        (a, none),
        (resting([[0.0, 0.0]] * 3, [1.0] * 3, bond=False), b),
    ):
        (found,) = _at_points(first, last)
        assert found.weakened.tolist() == found.left.tolist() == [0.0, 0.0]
    distances, shares = largest_at_points(ALONE, a, b)
    np.testing.assert_allclose(distances, [5.0])
    np.testing.assert_allclose(shares, [0.75])
    moving = SimpleNamespace()
    for first, last in ((a, moving), (moving, a)):
        assert [len(v) for v in largest_at_points(ALONE, first, last)] == [0, 0]


def test_small_changes_of_a_state():
    """Are as large as they are, of a body with no surface too."""
    a, b = (AtRest.__new__(AtRest) for _ in range(2))
    eq = SimpleNamespace(surfaces=[])
    for state, u in ((a, [0.0, 0.5]), (b, [0.25, 0.375])):
        forces = SimpleNamespace(u=np.array(u), covered=None, equations=eq)
        vars(state).update(forces=forces, unknowns=np.array(u), memory=())
    np.testing.assert_allclose(
        accepted.changes(ALONE, a, b), [0.25, np.hypot(0.25, 0.125)], rtol=1e-14
    )


# -- starts ---------------------------------------------------------------------------------------


class Eq:
    """Equations of contact of one surface, of which a memory is made from the state."""

    def __init__(self, left, new, comm=ALONE):
        self.memory, self.new = (left,), new
        self.comm = comm
        self.surfaces = [SimpleNamespace(name="floor")]
        self.body_size = 1e4
        self.log = []

    def remember(self, found):
        self.log.append(list(found))
        self.memory = tuple(found)

    def advanced(self, state):
        return (self.new,)

    def refresh(self):
        self.log.append("refreshed")


def begun(left, new, u=1.0, comm=ALONE):
    eq = Eq(left, new, comm)
    found = []
    stepper = Stepper(SimpleNamespace(equations=eq, comm=comm), None, None)

    def find():
        state = SimpleNamespace(u=np.array([0.0, -u]), number=len(found))
        found.append(eq.memory)
        return state

    state, mine = stepper._begun(find)
    return eq, state.number, mine


def test_a_start_with_what_was_left_there(caplog):
    """Bonds are those that a history has left in this state; slips are counted from here."""
    new = memory([[1.0, 2.0]], beta=[1.0])
    eq, number, mine = begun(None, new)
    assert (number, mine, eq.log) == (0, (new,), [[None]])
    eq, number, mine = begun(memory([[1.0, 2.0]], beta=[1.0]), new)
    assert (number, mine) == (0, (new,))
    left = memory([[1.0, 2.0 + 1e-9]], beta=[0.25])
    eq, number, (mine,) = begun(left, new)
    assert number == 1
    assert mine.fields["beta"] == left.fields["beta"]
    np.testing.assert_array_equal(mine.jump, new.jump)
    assert eq.log == [[None], [mine]]
    assert caplog.records == []


@pytest.mark.parametrize("comm", [ALONE, SECOND])
def test_a_start_elsewhere_than_a_history_has_left(comm, caplog):
    """Begins as the law has it; that is said, on one rank."""
    new = memory([[1.0, 2.0]], beta=[1.0], slid=[0.0])
    eq, number, mine = begun(memory([[1.0, 3.0]], beta=[0.25], slid=[2.0]), new, comm=comm)
    assert (number, mine, eq.log) == (0, (new,), [[None]])
    said = [r.message for r in caplog.records]
    assert len(said) == (comm is ALONE)
    for words in said:
        assert words.startswith(
            "the surfaces remember beta and the distance slipped of a history that ended in another"
        )


@pytest.mark.parametrize("comm", [ALONE, SECOND])
@pytest.mark.parametrize(("u", "times"), [(0.0, 1), (0.9e-9, 1), (1.1e-9, 0)])
def test_a_start_that_is_undeformed(comm, u, times, caplog):
    """With bonds that a history has left: that is said, beside the size of the body."""
    new = memory([[0.0, 0.0]], beta=[1.0])
    _, number, (mine,) = begun(memory([[0.0, 0.0]], beta=[0.25]), new, u, comm)
    assert (number, mine.fields["beta"]) == (1, 0.25)
    said = [r.message for r in caplog.records]
    assert len(said) == (times if comm is ALONE else 0)
    for words in said:
        assert words.startswith("the body is undeformed, as a history has left it with beta that")


# -- states in a problem --------------------------------------------------------------------------


def in_problem(comm=ALONE, load=None):
    """A stepper of a problem of one field, body and surface, whose data are a list."""
    data = [1.0]
    eq = Eq("now", None, comm)
    body = SimpleNamespace(values=np.array([1.0]))
    surface = SimpleNamespace(name="floor", statuses=np.array([STICK], np.int8), rigid_body=body)
    problem = SimpleNamespace(
        equations=eq,
        comm=comm,
        u=None,
        fields=[SimpleNamespace(x=SimpleNamespace(array=np.zeros(2)))],
        rigid_bodies=[body],
        surfaces=[surface],
    )
    stepper = Stepper(problem, load or (lambda time: data.__setitem__(0, time)), None)
    there = SimpleNamespace(
        time=2.0,
        fields=(np.array([3.0, 4.0]),),
        motions=(np.array([5.0]),),
        shown=[np.array([OPEN], np.int8)],
        memory=(memory(),),
        data=SimpleNamespace(
            restore=lambda: data.__setitem__(0, 7.0),
            unchanged=lambda: data[0] == 7.0,
            changed=lambda comm: "" if data[0] == 7.0 else "the lid",
        ),
        statuses="codes",
    )
    return stepper, there, data


def test_data_of_a_time_are_taken_back_after_an_error(monkeypatch):
    stepper, _, data = in_problem()
    monkeypatch.setattr(
        accepted,
        "GivenData",
        lambda eq: SimpleNamespace(restore=lambda v=data[0]: data.__setitem__(0, v)),
    )
    with stepper._loaded(3.0):
        assert data == [3.0]
    assert data == [3.0]
    data[0] = 1.0
    with pytest.raises(KeyError), stepper._loaded(4.0):
        raise KeyError("in between")
    assert data == [1.0]


def test_a_step_that_fails_is_put_back():
    """The load is asked in the first step alone; meshes stay as they are meanwhile."""
    stepper, there, _ = in_problem()
    puts, asked, depths = [], [], []
    stepper.put = puts.append

    def stepped(*given):
        depths.append(_mesh_mark._depth)
        if given[4].brief:
            raise RuntimeError("no")
        return given

    stepper._stepped = stepped
    stepper._ask_load = asked.append
    found = stepper.take(there, 2.5, likely=("a",), guess="guess")
    assert found[:4] == (there, 2.5, ("a",), "guess")
    assert found[4].expected == ()
    assert (puts, asked) == ([there], [])
    assert depths == [_mesh_mark._depth + 1]
    stepper.asks = True
    found = stepper.take(there, 2.5)
    assert found[2:4] == ((), None)
    assert asked == [found]
    assert stepper.asks is False
    puts.clear()
    with pytest.raises(RuntimeError):
        stepper.take(there, 2.5, trial=Trial(brief=True))
    assert puts == [there, there]
    assert Stepper.asks is False
    assert stepper.data_watch() == stepper.changed_since_put


@pytest.mark.parametrize("likely", [(), ("a", None, "b")])
@pytest.mark.parametrize("guess", [None, "guess"])
def test_a_step_of_a_stepper(likely, guess, monkeypatch):
    """From what the state leaves, in the statuses that are likely, else in those it has."""
    monkeypatch.setattr(accepted, "forces_at", lambda eq, state: "after")
    stepper, there, data = in_problem()
    state = AtRest.__new__(AtRest)
    advanced = []

    def energies(*given):
        advanced.append(given)
        return "energies"

    vars(state).update(
        vars(there) | {"forces": "before", "energies": SimpleNamespace(advanced=energies)}
    )
    tried, guessed, turned = [], [], []

    def solve_step(trial, progress):
        tried.append((trial, progress, data[0]))
        result = SimpleNamespace(energies={"friction": 0.25})
        return result, SimpleNamespace(statuses="found")

    stepper.problem.solve_step = solve_step
    stepper._progress = False
    stepper._put_unknowns = guessed.append
    stepper._check_turns = turned.append
    stepper.accepted = lambda *given: given
    trial = Trial(extrapolated="x", brief=True)
    found = stepper._stepped(state, 2.5, likely, guess, trial)
    ((used, progress, time),) = tried
    assert (used.expected, used.extrapolated, used.brief) == (
        ("a", "b") if likely else ("codes",),
        "x",
        True,
    )
    assert (progress, time) == (False, 2.5)
    assert guessed == ([] if guess is None else ["guess"])
    assert turned == [state]
    assert advanced == [("before", "after", 0.25)]
    assert found.before is state
    assert found.after == (2.5, "found", (None,), "after", "energies")
    assert stepper.problem.equations.memory[0].step == 0.5
    state = AtRest.__new__(AtRest)
    vars(state).update(vars(there) | {"statuses": None, "forces": "before"})
    vars(state)["energies"] = SimpleNamespace(advanced=energies)
    stepper._stepped(state, 2.5, (), None, Trial())
    assert tried[-1][0].expected == ()


def test_loads_that_know_more_than_the_time(monkeypatch):
    """They are asked from the data of the start, and from their own."""
    values = {"load": 0.0}

    class Known:
        def __init__(self, *_):
            self.was = values["load"]

        def changed(self):
            return "" if values["load"] == self.was else "the load"

    monkeypatch.setattr(accepted, "placed_data", lambda eq: None)
    monkeypatch.setattr(accepted, "Constancy", Known)
    calls = []
    loads = {
        "good": lambda time: time,
        "counts": lambda time: len(calls),
        "adds": lambda time: values["load"] + (time if len(calls) > 2 else 0.0),
    }
    for name, load in loads.items():
        calls.clear()
        shown = []

        def sets(time, load=load):
            calls.append(time)
            values["load"] = load(time)

        stepper, there, _ = in_problem(load=sets)
        stepper.put = lambda state: values.update(load=0.0)
        stepper.show = shown.append
        sets(3.0)
        step = SolvedStep(there, SimpleNamespace(time=3.0), None)
        if name == "good":
            stepper._ask_load(step)
            assert shown == [step]
            assert calls == [3.0] * 3
        else:
            words = "the load at the time 3 depends on earlier calls, of which the load is not"
            with pytest.raises(ValueError, match=words):
                stepper._ask_load(step)


@pytest.mark.parametrize("comm", [ALONE, SECOND])
@pytest.mark.parametrize("depends", [True, False])
def test_loads_that_depend_on_the_solution(comm, depends, caplog, monkeypatch):
    monkeypatch.setattr(accepted, "placed_data", lambda eq: None)
    data = [2.0]

    class Known:
        def __init__(self, *_):
            self.was = data[0]

        def changed(self):
            return "" if data[0] == self.was else "the lid"

    monkeypatch.setattr(accepted, "Constancy", Known)
    load = lambda time: data.__setitem__(0, time + depends)  # noqa: E731
    stepper, there, restored = in_problem(comm, load)
    start = SimpleNamespace(time=1.0, data=SimpleNamespace(changed=lambda comm: left))
    for left in ("", "the floor"):
        caplog.clear()
        data[0] = 2.0
        stepper.ask_at_end(start, there)
        assert restored == [7.0]
        said = [r.message for r in caplog.records]
        assert len(said) == ((depends or left != "") and comm is ALONE)
        for words in said:
            if depends:
                assert "at the end of the step to the time 2 it sets the lid to" in words
            else:
                assert "with the time 1 of its start it leaves the floor, so" in words


def test_bodies_that_turn_are_those_of_surfaces(monkeypatch):
    asked = []
    monkeypatch.setattr(accepted, "check_turn", lambda s, motion: asked.append((s.name, motion)))
    stepper, *_ = in_problem()
    a, b, c = (SimpleNamespace() for _ in range(3))
    stepper.problem.rigid_bodies = [a, b, c]
    stepper.problem.surfaces = [
        SimpleNamespace(name=n, rigid_body=body)
        for n, body in (("1", b), ("2", None), ("3", a), ("4", b))
    ]
    stepper._check_turns(SimpleNamespace(motions=("of a", "of b", "of c")))
    assert asked == [("3", "of a"), ("1", "of b"), ("4", "of b")]


def test_a_state_of_a_problem_is_a_copy():
    problem = block(n=1)
    stepper = Stepper(problem, lambda t: None, None)
    state = stepper.accepted(1.5, "codes", ("memory",), "forces", Energies(2.0))
    assert (state.time, state.statuses, state.memory, state.forces) == (
        1.5,
        "codes",
        ("memory",),
        "forces",
    )
    assert (state.energies, state.solved) == (Energies(2.0), True)
    assert stepper.accepted(0.0, None, (), None, None, solved=False).solved is False
    for values, f in zip(state.fields, problem.fields, strict=True):
        assert not np.shares_memory(values, f.x.array)
    before = state.fields[0].copy()
    problem.u.x.array[:] += 1.0
    np.testing.assert_array_equal(state.fields[0], before)
    assert state != replace(state)
    assert isinstance(state, AcceptedState)


# -- motions --------------------------------------------------------------------------------------


def mover(comm=ALONE, method=None, **more):
    """A stepper of a motion of a problem whose unknowns are four numbers."""
    stepper = MotionStepper.__new__(MotionStepper)
    eq = SimpleNamespace(
        comm=comm, body_size=2.0, surfaces=[], fixed=np.ones(6, bool), owned_sizes=[4]
    )
    problem = SimpleNamespace(equations=eq, comm=comm, V="V", u=None)
    known = {
        "problem": problem,
        "_method": method or Method("theta", 0.5, "position", 0.0, True),
        "_body": SimpleNamespace(origin=np.zeros(4)),
        "_velocity": None,
        "_warned": False,
        "_asks_turn": True,
        "_parts": None,
    }
    vars(stepper).update(known | more)
    return stepper


@pytest.mark.parametrize("finite", [True, False])
def test_where_contact_is_looked_for_in_a_motion(finite):
    """In free flight, if forces there are numbers; else where the body is."""
    asked = []

    def forces(u, v):
        asked.append((u.tolist(), v.tolist()))
        return np.array([0.0, 1.0 if finite else np.inf])

    a = SimpleNamespace(u=np.array([3.0, 4.0]), v=np.array([1.0, -2.0]))
    origin = np.array([10.0, 20.0])
    stepper = mover(_body=SimpleNamespace(origin=origin, forces=forces))
    step = TimeStep(0.5, 0.75, "modified-theta")
    found = stepper._guess(a, step)
    flight = origin + 0.5 * a.v
    assert asked == [(step.displacement(flight, origin).tolist(), a.v.tolist())]
    np.testing.assert_allclose(found, flight if finite else step.seen(a.u, origin))


@pytest.mark.parametrize("comm", [ALONE, SECOND])
def test_velocities_that_turn_are_spoken_of_on_one_rank(comm, caplog):
    """With the place at which they are off most, by half of what they are off."""
    told = []

    def worst(*given):
        told.append(given)
        return "words"

    stepper = mover(comm, _held=lambda: np.array([True, False]), _worst=worst)
    state = SimpleNamespace(motion=SimpleNamespace(u=np.zeros(2)), turns=(np.array([0.25, 0.0]), 2))
    b = SimpleNamespace(u=np.array([1.0, 1.0]), v=np.array([1.75, 9.0]))
    found, times = stepper._turns(state, b, TimeStep(0.5, 0.5, "theta"))
    assert (found.tolist(), times, stepper._warned) == ([-0.25, 0.0], 3, True)
    ((off, tolerance, is_, mean),) = told
    assert (off.tolist(), tolerance) == ([0.25, 0.0], 0.125)
    assert (is_.tolist(), mean.tolist()) == ([1.75, 9.0], [2.0, 2.0])
    assert len(caplog.records) == (comm is ALONE)


def test_a_motion_whose_mass_changes_is_refused(monkeypatch):
    done = []
    monkeypatch.setattr(Stepper, "_set", lambda self, time: done.append(time))
    constancy = SimpleNamespace(changed=lambda: "", restore=lambda: done.append("restored"))
    stepper = mover(_constancy=constancy)
    stepper._set(2.0)
    assert done == [2.0]
    constancy.changed = lambda: "the density"
    with pytest.raises(ValueError, match="refused at the time 3: the density is not what it was"):
        stepper._set(3.0)
    assert done == [2.0, 3.0, "restored"]


@pytest.mark.parametrize("comm", [ALONE, SECOND])
@pytest.mark.parametrize(("turn", "times"), [(0.21, 1), (0.2, 0), (np.nan, 0), (-1.0, 0)])
def test_linear_bodies_that_turn_are_spoken_of_once(turn, times, comm, monkeypatch, caplog):
    made = []
    monkeypatch.setattr(motion, "parts", lambda V: made.append(V) or "parts")
    monkeypatch.setattr(
        motion, "largest_turn", lambda V, u, parts: turn if parts == "parts" else 1 / 0
    )
    stepper = mover(comm)
    for _ in range(3):
        stepper._warn_of_turning("u", 1.5)
    assert made == ["V"]
    said = [r.message for r in caplog.records]
    assert len(said) == (times if comm is ALONE else 0)
    for words in said:
        assert words.startswith("at the time 1.5 a linear body has turned by 0.21 rad")
    assert stepper._asks_turn is (times == 0)
    stepper._asks_turn, stepper._parts = False, None
    stepper._warn_of_turning("u", 1.5)
    assert made == ["V"]


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("revolved", [True, False])
def test_which_bodies_may_turn(linear, revolved, monkeypatch):
    """Linear ones that are no bodies of revolution."""
    monkeypatch.setattr(motion, "MovingBody", SimpleNamespace)
    eq = SimpleNamespace(bulk=SimpleNamespace(linear=linear), axisymmetric=revolved)
    problem = SimpleNamespace(equations=eq)
    stepper = MotionStepper(problem, "velocity", "load", "method", "constancy", None)
    assert stepper._asks_turn is (linear and not revolved)
    assert (stepper._warned, stepper._parts) == (False, None)
    assert (stepper._load, stepper._method, stepper._progress) == ("load", "method", None)


def test_starts_that_are_no_numbers(monkeypatch):
    asked = []
    monkeypatch.setattr(motion, "require_obstacles", asked.append)

    def function(*v):
        return SimpleNamespace(x=SimpleNamespace(array=np.array(v)))

    stepper = mover(_velocity=function(1.0, 2.0))
    stepper.problem.u = function(1.0, 2.0)
    stepper._require_finite()
    assert asked == [stepper.problem.equations]
    stepper._velocity = function(1.0, np.nan)
    with pytest.raises(ValueError, match="the velocity at the start is not finite"):
        stepper._require_finite()
    stepper.problem.u = function(np.inf, 1.0)
    with pytest.raises(ValueError, match="the displacement at the start is not finite"):
        stepper._require_finite()


def test_every_surface_is_asked_for_penetration():
    """But for those that give way."""

    def surface(name, soft):
        return SimpleNamespace(name=name, law=SimpleNamespace(compliant=soft))

    stepper = mover()
    gaps = [np.array([-1.0]), np.array([1.0, -0.125])]
    state = SimpleNamespace(
        surfaces=[SimpleNamespace(kinematics=SimpleNamespace(gap=g)) for g in gaps]
    )
    stepper.problem.equations.surfaces = [surface("soft", True), surface("floor", False)]
    with pytest.raises(ValueError, match=r"floor: at the start .* by up to 0\.125"):
        stepper._require_no_penetration(state)
    gaps[1][1] = 0.0
    stepper._require_no_penetration(state)


@pytest.mark.skipif(COMM.size > 1, reason="numbers of dofs")
def test_where_values_are_furthest_off():
    """At the first place of several, along the first of its components; unless all is near."""
    V = fem.functionspace(box(COMM, 1, "tri"), ("Lagrange", 1, (2,)))
    stepper = mover()
    stepper.problem.V = V
    nodes = V.tabulate_dof_coordinates()[:, :2]

    def place(x, y):
        return int(np.flatnonzero(np.all(np.isclose(nodes, (x, y)), axis=1))[0])

    off = np.zeros(8)
    is_, wanted = np.arange(8.0), -np.arange(8.0)
    assert stepper._worst(off, 0.0, is_, wanted) == ""
    last = 2 * place(1.0, 1.0)
    off[last] = 0.5
    assert stepper._worst(off, 0.5, is_, wanted) == ""
    words = stepper._worst(off, 0.49, is_, wanted)
    assert words == f"component x at the node (1, 1) is {last}, prescribed is {-last}"
    first = 2 * place(0.0, 1.0) + 1
    for size, i, where in (
        (0.5, first, "y at the node (0, 1)"),
        (0.4999, last, "x at the node (1, 1)"),
    ):
        off[first] = size
        words = stepper._worst(off, 0.1, is_, wanted)
        assert words == f"component {where} is {i}, prescribed is {-i}"
    off[first] = 0.5 * (1 - 0.9e-9)
    assert "(0, 1)" in stepper._worst(off, 0.1, is_, wanted)
    off[first] = 0.5 * (1 - 1.1e-9)
    assert "(1, 1)" in stepper._worst(off, 0.1, is_, wanted)


@pytest.mark.parametrize(("axis", "size"), [(0, 1.0), (1, 1e3)])
def test_what_is_shown_of_a_step_of_a_motion(axis, size, monkeypatch):
    """Contact at its end, with what friction has dissipated."""
    monkeypatch.setattr(motion, "support_at_nodes", lambda eq, state: "supports")
    monkeypatch.setattr(motion, "contact_table", lambda eq, i, state, given: (i, state, given))
    monkeypatch.setattr(motion, "slidings", lambda eq, state: {"a": "sliding"})

    @dataclass(frozen=True)
    class Found:
        tables: Any
        energies: Any
        slidings: Any

    stepper = mover()
    stepper.problem.equations.surfaces = [SimpleNamespace(name=n) for n in ("a", "b")]
    before = Found({}, {"friction": 9.0, "bulk": 2.0 * size}, None)
    shown = stepper._shown(before, "state", 0.5 * size)
    assert shown.tables == {n: (i, "state", "supports") for i, n in enumerate("ab")}
    assert shown.energies == {"friction": 0.5 * size, "bulk": 2.0 * size}
    assert dict(shown.slidings) == {"a": "sliding"}


def test_the_contact_of_a_steps_end():
    @dataclass(frozen=True)
    class One:
        kinematics: Any = None

    @dataclass(frozen=True)
    class Whole:
        surfaces: Any
        u: Any
        q: Any

    stepper = mover()
    eq = stepper.problem.equations
    eq.surfaces, eq.kinematics = ["a", "b"], lambda s, u, q: (s, u, q)
    found = stepper._at(Whole([One(), One()], "w", "q"), "u")
    assert found == Whole([One(("a", "u", "q")), One(("b", "u", "q"))], "u", "q")


def test_a_motion_under_data_of_now(monkeypatch):
    monkeypatch.setattr(motion, "GivenData", lambda eq: "data")

    @dataclass(frozen=True)
    class Moves:
        u: Any = "u"
        v: Any = "v"
        rows: Any = "old"
        load: Any = "old"

    state = MovingState(*[None] * 10, motion=Moves())
    body = SimpleNamespace(forces=lambda u, v: ("rows", u, v), load=lambda: "load")
    found = mover(_body=body)._under_other_data(state)
    assert found.motion == Moves("u", "v", ("rows", "u", "v"), "load")
    assert found.data == "data"
    assert state.turns is None
    assert state != replace(state)


@pytest.mark.parametrize("first", [True, False])
def test_a_motion_that_is_recalled(first):
    stepper = mover()
    stepper.problem.fields = []
    stepper.problem.rigid_bodies = []
    remembered = []
    stepper.problem.equations.remember = remembered.append
    stepper._loaded = contextmanager(lambda time: iter([None]))
    stepper._contact = lambda: SimpleNamespace(statuses="codes")
    stepper._motion = lambda state: ("motion", state.statuses)
    stepper._moving = lambda *given: given
    found = stepper.recalled(1.5, ["memory"], "energies", first=first)
    known = None if first else "codes"
    assert found == (1.5, known, ("memory",), "energies", ("motion", "codes"))
    assert remembered == [["memory"]]


def test_the_start_of_a_motion():
    """Is asked for all that it may lack; its kinetic energy is the first."""
    asked = []
    stepper = mover()
    stepper.problem.equations.refresh = lambda: asked.append("refresh")
    stepper.problem.equations.memory = (None,)

    @contextmanager
    def loaded(time):
        asked.append(time)
        yield

    stepper._loaded = loaded
    for name in ("_require_finite", "_require_data", "_require_held"):
        setattr(stepper, name, lambda name=name: asked.append(name))
    stepper._begun = lambda find: (find, ("memory",))
    stepper._require_no_penetration = lambda state: asked.append(state)
    stepper._motion = lambda state: SimpleNamespace(kinetic=2.5)
    stepper._moving = lambda *given: given
    time, codes, kept, energies, moves = stepper.start(0.75)
    assert asked[:5] == [0.75, "refresh", "_require_finite", "_require_data", "_require_held"]
    assert asked[5] == stepper._contact
    assert (time, codes, kept, moves.kinetic) == (0.75, None, ("memory",), 2.5)
    assert energies == MotionEnergies(kinetic=2.5, at_start=2.5)
    assert energies.residue == 0.0


@pytest.mark.parametrize("length", [0.5, 0.5 * (1 + 0.9e-9), 0.5 * (1 - 1.1e-9), 0.25])
@pytest.mark.parametrize("known", [True, False])
def test_a_step_of_a_motion(length, known, monkeypatch):
    """Equal steps have the same matrices; laws see what was left and the length of the step."""
    step = TimeStep(0.5, 0.75, "theta")
    log = []
    w0 = np.array([1.0, 2.0, 3.0, 4.0])
    body = SimpleNamespace(step=step, origin=w0, begin=lambda *given: log.append(("begin", *given)))
    a = SimpleNamespace(u=np.ones(4), v=np.full(4, 2.0), rows="rows")
    w = w0 + 0.375
    state = SimpleNamespace(u=w, statuses="found")
    result = SimpleNamespace(name="result")
    made = []
    monkeypatch.setattr(motion, "motion_at", lambda eq, shown, u, v: ("b", shown, u, v))

    def account(*given):
        made.append(given)
        return MotionEnergies(dissipated=0.75)

    monkeypatch.setattr(motion, "account", account)
    monkeypatch.setattr(Stepper, "_set", lambda self, time: log.append(("set", time)))
    array = np.zeros(4)
    stepper = mover(
        method=Method("theta", 0.75, "position", 0.0, True),
        _body=body,
        _constancy=SimpleNamespace(changed=lambda: ""),
        _velocity=SimpleNamespace(x=SimpleNamespace(array=np.zeros(4))),
        _progress=False,
    )
    problem, eq = stepper.problem, stepper.problem.equations
    problem.u = SimpleNamespace(x=SimpleNamespace(array=array))
    problem.solve_step = lambda progress: (
        log.append(("solve", progress, array.copy()))
        or (
            result,
            state,
        )
    )
    remembered = []
    eq.refresh = lambda: log.append("refresh")
    eq.rigid = SimpleNamespace(fixed=np.array([True, False]), given=np.array([1.0, 5.0]))
    eq.prescribed_motions = lambda: np.array([4.0, 9.0])
    eq.prescribed = SimpleNamespace(unknowns=None)
    eq.remember = remembered.append
    eq.advanced = lambda shown: ("advanced", shown)
    stepper._require_speed = lambda a: log.append("speed")
    stepper._seen = lambda accepted, step, motion: (
        log.append(("seen", step, motion.tolist())) or ["s"]
    )
    stepper._guess = lambda a, step: np.full(4, 8.0)
    stepper._at = lambda state, u: ("shown", u)
    stepper._shown = lambda result, shown, lost: (result.name, lost)
    stepper._turns = lambda accepted, b, step: ("turns", b[0])
    stepper._warn_of_turning = lambda u, time: log.append(("turning", u.tolist(), time))
    stepper._moving = lambda *given: given
    start = MovingState(
        *(2.0, None, None, "codes" if known else None, None, (memory(), None), None, None),
        *(MotionEnergies(dissipated=0.5), True),
        motion=a,
    )
    time = 2.0 + length
    solved = stepper._stepped(start, time, (), None, None)
    taken = next(e for e in log if e[0] == "seen")[1]
    same = abs(length - 0.5) < 1e-9 * length
    assert taken == TimeStep(0.5 if same else time - 2.0, 0.75, "theta")
    assert log[:2] == [("set", time), "refresh"]
    assert ("speed" in log) is not known
    begin = next(e for e in log if e[0] == "begin")
    assert begin[1] == taken
    assert begin[2:] == (a.u, a.v, "rows")
    assert next(e for e in log if e[0] == "seen")[2] == [3.0, 0.0]
    u, v = taken.displacement(w, w0), taken.velocity(w, w0)
    np.testing.assert_allclose(array, u)
    np.testing.assert_allclose(stepper._velocity.x.array, v)
    solve = next(e for e in log if e[0] == "solve")
    assert solve[1] is False
    np.testing.assert_allclose(solve[2], 8.0)
    assert remembered[0] == ["s"]
    assert (remembered[1][0].step, remembered[1][1]) == (taken.length, None)
    assert eq.prescribed.unknowns is None
    (given,) = made
    assert (given[0], given[3], given[4][0], given[5].tolist()) == (
        start.energies,
        a,
        "b",
        [3.0, 0.0],
    )
    assert solved.result == ("result", 0.25)
    end, codes, kept, energies, b, turns = solved.after
    assert (end, codes, energies.dissipated, b[0], turns) == (
        time,
        "found",
        0.75,
        "b",
        ("turns", "b"),
    )
    assert kept[0] == "advanced"
    assert log[-1] == ("turning", u.tolist(), time)
    problem.solve_step = lambda progress: 1 / 0
    with pytest.raises(ZeroDivisionError):
        stepper._stepped(start, time, (), None, None)
    assert eq.prescribed.unknowns is None


# -- what motions are made of ---------------------------------------------------------------------


def given(**more):
    """Arguments of `NSCD`, checked."""
    problem = more.pop("problem", None) or block(n=1)
    a = {
        "problem": problem,
        "density": 2.0,
        "dt": 0.5,
        "scheme": "theta",
        "theta": 0.5,
        "level": "position",
        "mass": "redistributed",
        "restitution": 0.0,
        "velocity": None,
        "damping": None,
    }
    a = SimpleNamespace(**a | more)
    nscd._check(a)
    return a


def test_arguments_of_a_motion():
    problem = block(n=1)
    V = problem.V
    assert given(problem=problem, dt=np.float64(2)).dt == 2.0
    given(problem=problem, velocity=fem.Function(V), density=fem.Constant(V.mesh, 1.0))
    for wrong, words in (
        ({"dt": 0.0}, "dt must be a positive time, got 0.0"),
        ({"dt": -1.0}, "dt must be a positive time"),
        ({"dt": np.inf}, "dt must be a positive time"),
        ({"dt": "x"}, "dt must be a positive time"),
        ({"density": 0.0}, "the density must be positive, got 0.0"),
        ({"density": -1}, "the density must be positive, got -1"),
        ({"density": np.inf}, "the density must be positive"),
        ({"density": problem.u[0]}, "the density depends on the displacement or the velocity"),
        ({"velocity": 3.0}, "velocity must be a Function of the displacement's space"),
        (
            {"velocity": fem.Function(fem.functionspace(V.mesh, ("Lagrange", 2, (2,))))},
            "velocity must be a Function of the displacement's space",
        ),
        ({"theta": 0.4}, "theta must be between"),
    ):
        with pytest.raises(ValueError, match=words):
            given(problem=problem, **wrong)
    velocity = fem.Function(V)
    with pytest.raises(ValueError, match="the density depends on"):
        given(problem=problem, velocity=velocity, density=1 + velocity[0])
    with pytest.raises(ValueError, match="a ContactProblem is needed, got str"):
        nscd._check(SimpleNamespace(problem="problem"))


def run_of_motion(**more):
    me = SimpleNamespace(_dt=0.5, _accepted=None, _record="a record")
    a = {"self": me, "locate": None, "times": [0, 1, 2]}
    a |= dict.fromkeys(("accept", "stop", "observer", "record", "progress"))
    a = SimpleNamespace(**a | more)
    nscd._check_run(a)
    return a


def test_arguments_of_a_run_of_a_motion():
    a = run_of_motion()
    assert (a.locate, a.times) == (None, (0.0, 1.0, 2.0))
    assert run_of_motion(locate=np.float64(0.5)).locate == 0.5
    for wrong, words in (
        ({"locate": 0.51}, "locate must be no longer than dt, got 0.51"),
        ({"locate": 0.0}, "locate must be a positive time"),
        ({"times": [1.0]}, "two or more finite times"),
        ({"record": 3}, "record must be a record"),
        ({"accept": 3}, "accept must be a function"),
    ):
        with pytest.raises(ValueError, match=words):
            run_of_motion(**wrong)


def test_tasks_of_motions(monkeypatch):
    """Steps of dt, halved twenty times at most, or as short as contact is to be located."""
    one = NSCD.__new__(NSCD)
    tasks = []
    vars(one).update(
        _dt=0.5,
        _run_state=None,
        velocity="velocity",
        load="load",
        _method="method",
        _constancy="constancy",
        problem="problem",
        _begin=lambda task, listeners: tasks.append((task, listeners)),
    )
    raw = lambda name: getattr(NSCD, name).__wrapped__  # noqa: E731
    raw("run")(one, [0.0, 1.0])
    raw("run")(one, [0.0, 1.0], locate=0.125, progress=True)
    raw("settle")(one, 9.0)
    raw("settle")(one, 9.0, rest=0.5)
    (plain, _), (located, listeners), (rests, _), (half, _) = tasks
    assert (plain.times, plain.longest, plain.shortest) == ((0.0, 1.0), 0.5, 0.5 / 1024**2)
    assert (plain.locate, located.locate, located.shortest) == (False, True, 0.125)
    assert listeners.progress is True
    assert isinstance(rests, RestTask)
    assert (rests.times, rests.longest, rests.max_time, rests.rest) == ((0.0,), 0.5, 9.0, 1e-6)
    assert half.rest == 0.5
    made = []
    monkeypatch.setattr(nscd, "MotionStepper", lambda *given: made.append(given))
    for progress, wanted in ((False, False), (None, None), (True, None)):
        one._stepper(progress)
        assert made[-1] == ("problem", "velocity", "load", "method", "constancy", wanted)
    vars(one)["_run_state"] = SimpleNamespace(accepted=SimpleNamespace(time=3.5))
    assert one._time == 3.5


@pytest.mark.parametrize("mass", ["lumped", "redistributed"])
def test_a_motion_whose_forces_alternate_is_spoken_of(mass, caplog):
    with caplog.at_level(logging.WARNING):
        made = NSCD(block(n=2), 1.0, dt=0.5, mass=mass)
    said = [r for r in caplog.records if "contact forces alternate" in r.message]
    assert len(said) == (mass == "lumped" and COMM.rank == 0)
    assert made._dt == 0.5
    assert made.velocity.name == "velocity"
    assert made.kept == {"velocity": made.velocity}
    assert made.method == (
        made.method[0],
        "scheme theta",
        "theta 0.5",
        "level position",
        f"mass {mass}",
        "restitution 0.0",
        "damping None",
    )
    assert made.load(3.0) is None


def test_forms_of_damping():
    problem = block(n=1)
    u, V = problem.u, problem.V
    velocity = fem.Function(V)
    w, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    other = ufl.TestFunction(fem.functionspace(V.mesh, ("Lagrange", 2, (2,))))
    both = ufl.inner(w, v) * ufl.dx
    assert nscd._damping_form(u, velocity, both) == (both, None)
    drag = ufl.inner(velocity, v) * ufl.dx
    C, wind = nscd._damping_form(u, velocity, drag)
    assert wind is None
    assert len(C.arguments()) == 2
    assert nscd._damping_form(u, velocity, drag - v[0] * ufl.dx)[1] is not None
    for form, words in (
        (ufl.inner(velocity, velocity) * ufl.dx, "damping must have a test function"),
        (ufl.inner(velocity, other) * ufl.dx, "damping must have a test function"),
        (ufl.inner(w, other) * ufl.dx, "damping must have a test function"),
        (ufl.inner(u, v) * ufl.dx, "damping depends on the displacement"),
        (velocity[0] * ufl.inner(w, v) * ufl.dx, "must not hold the velocity"),
        (v[0] * ufl.dx, "must be a form in the Function that is given as velocity"),
        (velocity[0] ** 2 * v[0] * ufl.dx, "must be affine in the velocity, and is not by"),
        (abs(velocity[0]) * v[0] * ufl.dx, "must be affine in the velocity"),
    ):
        with pytest.raises(ValueError, match=words):
            nscd._damping_form(u, velocity, form)


def test_data_of_motions():
    """Those of density and damping, but for the velocity, by names; numbers are none."""
    problem = block(n=1)
    domain = problem.V.mesh
    velocity = fem.Function(problem.V)
    rho, a, b = (fem.Constant(domain, v) for v in (1.0, 2.0, 3.0))
    assert nscd._data(2.0, (1, 2), velocity) == []
    found = nscd._data(rho, (a, b), velocity)
    assert [d.value for d in found] == [rho, a, b]
    assert [d.place for d in found[1:]] == [
        "the factor a of Rayleigh's damping",
        "the factor b of Rayleigh's damping",
    ]
    assert [d.value for d in nscd._data(rho, (0.5, b), velocity)] == [rho, b]
    form = a * ufl.inner(velocity, ufl.TestFunction(problem.V)) * ufl.dx
    assert [d.value for d in nscd._data(2.0, form, velocity)] == [a]
    assert [d.value for d in nscd._data(rho, None, velocity)] == [rho]
    assert nscd._described([a, 1], None) == "(2.0, 1)"


def test_the_stiffness_in_rayleighs_damping():
    """Of b > 0 what it depends on is to stay; of a form, or b = 0, it may change."""
    domain = box(COMM, 1, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    young, load = fem.Constant(domain, 5.0), fem.Constant(domain, 1.0)
    energy = young * LinearElastic(1.0, 1.0).energy(u) * ufl.dx - load * u[0] * ufl.dx
    held = fem.locate_dofs_topological(V.sub(0), 1, facets(domain, 1, 1.0))
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=HalfSpace((0.0, 0.0), (0.0, 1.0)), law=Coulomb(0.3)
    )
    bcs = [fem.dirichletbc(young, held, V.sub(0))]
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    form = ufl.inner(u, ufl.TestFunction(V)) * ufl.dx
    for damping in (None, form, (1.0, 0.0)):
        assert nscd._of_stiffness(problem, damping) == []
    found = nscd._of_stiffness(problem, (0.0, 0.5))
    values = [d.value for d in found]
    # The load is not among them, nor what the same Constant prescribes.
    assert len(found) == 3
    assert young in values
    assert load not in values
    end = "in the form of the body, whose stiffness is in the damping,"
    assert all(d.place.endswith(end) for d in found)


@pytest.mark.skipif(COMM.size > 1, reason="numbers of dofs")
def test_nodes_that_may_touch():
    """Both components of each node of the contact surface, and of no other."""
    problem = block(n=2)
    marks = nscd._touching(problem.equations).reshape(-1, 2)
    y = problem.V.tabulate_dof_coordinates()[:, 1]
    np.testing.assert_array_equal(marks, np.column_stack([y < 1e-9] * 2))
    eq = SimpleNamespace(
        owned_sizes=[8],
        dim=2,
        surfaces=[
            SimpleNamespace(
                slides=True,
                obstacle=SimpleNamespace(
                    opposite=SimpleNamespace(
                        sides=np.array(
                            [[True, False, False, False, True], [False, False, True, False, False]]
                        )
                    )
                ),
            )
        ],
    )
    sides = np.repeat([True, False, True, False], 2)
    np.testing.assert_array_equal(nscd._touching(eq), sides)
    # Whatever other surfaces there are.
    n = problem.equations.owned_sizes[0]
    more = np.zeros((2, n // 2 + 1), dtype=bool)
    more[0, 5] = True
    opposite = SimpleNamespace(opposite=SimpleNamespace(sides=more))
    both = [SimpleNamespace(slides=True, obstacle=opposite), problem.surfaces[0]]
    mixed = SimpleNamespace(owned_sizes=[n], dim=2, surfaces=both)
    expected = (y < 1e-9).repeat(2)
    expected[10:12] = True
    np.testing.assert_array_equal(nscd._touching(mixed), expected)


def test_nodes_that_hardly_touch():
    """By any weight, of either sign, in a jump."""
    B = PETSc.Mat().createAIJ((2, 6), comm=ALONE)
    B.setUp()
    for i, j, v in ((0, 0, 1e-3), (1, 1, -1e-3), (0, 4, 0.25), (1, 4, -0.25)):
        B.setValue(i, j, v)
    B.assemble()
    surface = SimpleNamespace(slides=False, constant_operator=lambda words: SimpleNamespace(B=B))
    eq = SimpleNamespace(owned_sizes=[6], dim=2, surfaces=[surface, surface])
    assert nscd._touching(eq).tolist() == [True, True, False, False, True, True]
    np.testing.assert_allclose(B.norm(), np.sqrt(2e-6 + 0.125))


def test_what_is_put_into_a_motion_is_that_of_the_owners(monkeypatch):
    """Ghosts follow them; the state is a copy."""
    monkeypatch.setattr(motion, "motion_at", lambda eq, state, u, v: (state, u, v))
    log = []

    def function(name, *values):
        x = SimpleNamespace(array=np.array(values), scatter_forward=lambda: log.append(name))
        return SimpleNamespace(x=x)

    stepper = mover(_velocity=function("v", 3.0))
    stepper.problem.u = function("u", 2.0)
    state, u, v = stepper._motion("state")
    assert log == ["u", "v"]
    assert (state, u.tolist(), v.tolist()) == ("state", [2.0], [3.0])
    assert not np.shares_memory(u, stepper.problem.u.x.array)
    assert not np.shares_memory(v, stepper._velocity.x.array)


@pytest.mark.parametrize("comm", [ALONE, SECOND])
@pytest.mark.parametrize(
    ("share", "falls", "words"),
    [
        (0.01, {}, None),
        (0.1, {}, "up to 10 % otherwise than they should be; take"),
        (0.0, {"x": 0.011, "y": 0.1}, "its fall (1.1 % along x, 10 % along y); take"),
    ],
)
def test_masses_that_lie_elsewhere(share, falls, words, comm, monkeypatch, caplog):
    made = []

    def mass_matrix(V, density, kind, touching):
        made.append((V, density, kind, touching.tolist()))
        return SimpleNamespace(destroy=lambda: made.append("freed"))

    monkeypatch.setattr(nscd, "mass_matrix", mass_matrix)
    monkeypatch.setattr(nscd, "rigid_errors", lambda *given, axisymmetric: (share, falls))
    eq = SimpleNamespace(
        owned_sizes=[3, 9], constraints=SimpleNamespace(fixed="fixed"), axisymmetric=False
    )
    problem = SimpleNamespace(equations=eq, V="V", comm=comm)
    nscd._warn_of_inertia(problem, "M", 2.0)
    assert made == [("V", 2.0, "consistent", [False] * 3), "freed"]
    said = [r.message for r in caplog.records]
    assert len(said) == (words is not None and comm is ALONE)
    for line in said:
        assert words in line


@pytest.mark.parametrize("revolved", [True, False])
@pytest.mark.parametrize("mass", ["consistent", "redistributed"])
@pytest.mark.parametrize("wind", ["wind", None])
def test_what_a_moving_body_is_made_of(revolved, mass, wind, monkeypatch):
    """Of a body of revolution the mass is that of the whole circumference."""
    domain = box(COMM, 1, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    made, warned = [], []
    monkeypatch.setattr(nscd, "mass_matrix", lambda *given: made.append(given) or "M")
    monkeypatch.setattr(nscd, "_touching", lambda eq: "touching")
    monkeypatch.setattr(nscd, "_warn_of_inertia", lambda *given: warned.append(given))
    monkeypatch.setattr(nscd, "_damping", lambda *given: ("C", wind))

    class Body:
        def __init__(self, *given):
            self.given = given
            self.body = "inner"

        def loaded(self, wind):
            return ("loaded", wind)

    monkeypatch.setattr(nscd, "MovingBody", Body)
    plain = SimpleNamespace(loaded=lambda wind: ("loaded", wind))
    eq = SimpleNamespace(axisymmetric=revolved, bulk=plain)
    problem = SimpleNamespace(V=V, equations=eq)
    density = fem.Constant(domain, 2.0)
    found = nscd._moving_body(problem, "v", "step", density, mass, None)
    body = plain if wind is None else ("loaded", "wind")
    assert found.given == (body, "M", "C", "step")
    ((space, weight, kind, touching),) = made
    assert (space, kind, touching) == (V, mass, "touching")
    total = COMM.allreduce(fem.assemble_scalar(fem.form(weight * ufl.dx(domain))))
    # The volume of a cylinder of radius and height 1.
    assert total == pytest.approx(2.0 * np.pi if revolved else 2.0)
    assert len(warned) == (mass == "redistributed")
    if wind is None:
        eq.bulk = Body()
        assert nscd._moving_body(problem, "v", "step", density, mass, None).given[0] == "inner"
