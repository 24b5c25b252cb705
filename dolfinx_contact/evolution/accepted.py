# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accepted states of an evolution, and one step from one of them.

An `AcceptedState` is all that the next step needs, and it is frozen: steps that are tried and
rejected leave nothing behind but what `Stepper.put` overwrites, bit by bit.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import everywhere, require
from dolfinx_contact._mesh_mark import mesh_may_move, mesh_stays
from dolfinx_contact._shared import largest
from dolfinx_contact.equations.evaluation import Evaluation, Statuses
from dolfinx_contact.equations.given_data import (
    Constancy,
    GivenData,
    check_turn,
    note_put,
    owned,
    placed_data,
    was_put,
)
from dolfinx_contact.equations.measures import Scales
from dolfinx_contact.evolution.energy import Energies, Forces, forces_at
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.results.result import Result
from dolfinx_contact.solvers.strategies import Trial

__all__ = [
    "AcceptedState",
    "AtRest",
    "OfState",
    "SolvedStep",
    "Stepper",
    "change",
    "changes",
    "is_still",
    "largest_at_points",
]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
_SOLVED = 1e-6  # residual of a start that is a solution
_SAME = 1e-9  # of the size of an unknown


@dataclass(frozen=True, eq=False)
class AcceptedState:
    """A state of an evolution, with what it remembers.

    Attributes:
        time: of it.
        fields: values of displacement and multipliers, ghosts included.
        motions: of the rigid bodies.
        statuses: of the contact points; None where none are known, as before the first step.
        shown: statuses of the state as it is shown.
        memory: of the surfaces, for the step that begins here.
        data: Functions and Constants of the user.
        unknowns: all of them as lengths (owned).
        energies: since the start.
        solved: whether it is a solution under its load, which the start of an evolution may not be.
    """

    time: float
    fields: tuple[Array, ...]
    motions: tuple[Array, ...]
    statuses: Statuses | None
    shown: Statuses
    memory: tuple[Memory | None, ...]
    data: GivenData
    unknowns: Array
    energies: Energies
    solved: bool


A = TypeVar("A", bound=AcceptedState)


@dataclass(frozen=True, eq=False)
class AtRest(AcceptedState):
    """A state of equilibrium.

    Attributes:
        forces: at the state.
    """

    forces: Forces


@dataclass(frozen=True, eq=False)
class SolvedStep:
    """A step that was taken: where it ended, and the result there."""

    before: AcceptedState
    after: AcceptedState
    result: Result


def change(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> float:
    """How much the state changes from one to the other, a length. Collective."""
    d = b.unknowns - a.unknowns
    if isinstance(a, AtRest) and isinstance(b, AtRest):
        before = a.forces.covered
        after = b.forces.covered
        if before is not None and after is not None:
            d = d * np.minimum(before, after)
    return float(np.sqrt(comm.allreduce(float(np.dot(d, d)))))


def changes(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> Array:
    """How much the body and its surfaces change from one state to the other. Collective.

    Returns:
        The largest displacement of a node, a length, and `change`; between states of equilibrium
        then, surface by surface, the mean change of the jump at points that are not clamped, a
        length, and that of the variable by which bonds weaken. Where points move one after the
        other, such a mean over a time is the sum of those over its parts.
    """
    if not (isinstance(a, AtRest) and isinstance(b, AtRest)):
        return np.array([0.0, change(comm, a, b)])
    moved = float(np.abs(b.forces.u - a.forces.u).max(initial=0.0))
    moved = comm.allreduce(moved, op=MPI.MAX)
    points = _at_points(a, b)
    sums = np.array([[p.distances.sum(), p.weakened.sum(), len(p.distances)] for p in points])
    total, weakened, number = comm.allreduce(sums.reshape(-1, 3)).T
    means = np.array([total, weakened]) / np.maximum(number, 1.0)
    return np.array([moved, change(comm, a, b), *means.ravel()])


def largest_at_points(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> tuple[Array, Array]:
    """What one point alone may do from one state to the other, surface by surface. Collective.

    Returns:
        The largest change of the jump at a point, a length; and by how much a bond weakens, at
        most, as a part of what the strongest had left (0 where that is not known).
    """
    if not (isinstance(a, AtRest) and isinstance(b, AtRest)):
        return np.zeros(0), np.zeros(0)
    found = np.array(
        [
            [np.max(v, initial=0.0) for v in (p.distances, p.weakened, p.left)]
            for p in _at_points(a, b)
        ]
    )
    distances, weakened, left = comm.allreduce(found.reshape(-1, 3), op=np.maximum).T
    return distances, np.divide(weakened, left, out=np.zeros_like(left), where=left > 0)


class OfState(NamedTuple):
    """What has a part of a state, what it is called, and values of it (local)."""

    name: str
    unknown: fem.Function | RigidBody
    values: Array


class _AtPoints(NamedTuple):
    """What happens at the points of a surface (n,) from a state to another, on this rank.

    Attributes:
        ways: changes of the jump.
        weakened: those of the variable by which bonds weaken.
        left: what that had left.
    """

    distances: Array
    weakened: Array
    left: Array


def _at_points(a: AtRest, b: AtRest) -> list[_AtPoints]:
    """Of all points that are not clamped, surface by surface."""
    eq = a.forces.equations
    found = []
    for k, s in enumerate(eq.surfaces):
        distances = np.linalg.norm(b.forces.surfaces[k].jump - a.forces.surfaces[k].jump, axis=1)
        weakened = np.zeros_like(distances)
        left = np.zeros_like(distances)
        before = a.memory[k]
        after = b.memory[k]
        bond = s.law.weakening
        if bond is not None and before is not None and after is not None:
            weakened = np.abs(after.fields[bond.name] - before.fields[bond.name])
            end = bond.end
            if end is None:
                end = 0.0 if bond.sense < 0 else math.nan
            left = np.nan_to_num(np.abs(end - before.fields[bond.name]))
        free = (
            slice(None) if s.method == "integral" else ~eq.constraints.clamped[k][: len(distances)]
        )
        found.append(_AtPoints(distances[free], weakened[free], left[free]))
    return found


def is_still(comm: MPI.Comm, f: fem.Function | RigidBody, values: Array) -> bool:
    """Whether an unknown has values (local), but for the round-off of a scale. Collective."""
    was = owned(f, values)
    off = float(np.max(np.abs(owned(f) - was), initial=0.0))
    size = float(np.max(np.abs(was), initial=0.0))
    off, size = largest(comm, [off, size])
    return bool(off <= _SAME * size)


class Stepper:
    """Takes steps of a problem from moments.

    Args:
        problem: whose Functions follow what is taken or put.
        load: puts the data of a time into Functions and Constants.
        progress: of the solves, as in `ContactProblem.solve`.

    Attributes:
        static: the problem as given.
        problem: the same under the memory of the step.
        asks: whether the load is asked in the next step whether it knows more than the time.
    """

    asks = False
    #: What has its runs, in words.
    kind = "QuasiStatic"

    def __init__(
        self, problem: ContactProblem, load: Callable[[float], object], progress: bool | None
    ):
        self.static = problem
        self.problem = problem
        self._load = load
        self._progress = progress
        #: The state that was put last.
        self._there: AcceptedState | None = None

    def start(self, time: float) -> AcceptedState:
        """The state in the Functions, from which slips are counted. Collective.

        Raises:
            ValueError: on every rank, for Dirichlet data that a solve refuses.
        """
        eq = self.problem.equations
        with self._loaded(time):
            eq.refresh()
            self._require_finite()
            self._require_data()
            state, memory = self._begun(lambda: self.problem.evaluate())
            state, residual = self._best(state, memory)
        solved = residual <= _SOLVED
        if not solved and eq.comm.rank == 0:
            logger.warning(
                "the start of the evolution is no solution under the load at the time %g (residual "
                "%.1e): its energies mean nothing; solve() first",
                time,
                residual,
            )
        forces = forces_at(eq, state)
        return self.accepted(time, None, memory, forces, Energies(), solved=solved)

    def _begun(
        self, find: Callable[[], Evaluation]
    ) -> tuple[Evaluation, tuple[Memory | None, ...]]:
        """The state at a start, and its virgin memory: slips are counted from there. Collective.

        Args:
            find: what is in the problem as a state. Collective.
        """
        self.remember([None] * len(self.problem.surfaces))
        state = find()
        return state, self.problem.equations.advanced(state)

    def _best(
        self,
        state: Evaluation,
        memory: tuple[Memory | None, ...],
    ) -> tuple[Evaluation, float]:
        """The start, with the statuses in which it is a solution, and its residual. Collective.

        Its forces are such as a history may begin with where they are in equilibrium and friction
        is within its bound, whether the static law has them or slips of before.

        Args:
            state: as `_begun` found it.
            memory: of the start.
        """
        eq = self.problem.equations
        residual = Scales(eq, settled=True).measure(state).worst
        if not residual > _SOLVED:
            return state, residual
        # Before any solve the surfaces do not know their statuses.
        required = self.problem.evaluate(statuses=[s.answers.required for s in state.surfaces])
        other = Scales(eq, settled=True).measure(required).worst
        if other < residual:
            state = required
            residual = other
        timed = any(s.law_at_points.compiled.needs_time(0.0) for s in eq.surfaces)
        if timed or not residual > _SOLVED:
            return state, residual
        here = self.static.with_memory(memory).evaluate()
        found = Scales(eq, settled=True).measure(here).worst
        return (here, found) if found <= _SOLVED else (state, residual)

    def _require_finite(self) -> None:
        """Refuse a start that is not finite. Collective."""
        finite = bool(np.isfinite(self.problem.u.x.array).all())
        require(self.problem.comm, finite, "the displacement at the start is not finite")

    def _require_data(self) -> None:
        """Refuse a start with Dirichlet data that a solve refuses. Collective."""
        eq = self.problem.equations
        eq.constraints.check_values(eq.surfaces, eq.body_size, " at the start")

    def recalled(
        self, time: float, memory: Sequence[Memory | None], energies: Energies, *, first: bool
    ) -> AcceptedState:
        """An accepted state of before, of which the state is in the problem. Collective.

        Args:
            time: of it.
            memory: that it left.
            energies: since the start.
            first: whether it is the start, whose statuses are not known.
        """
        note_put(*self.problem.fields, *self.problem.rigid_bodies)
        with self._loaded(time):
            self.remember(memory)
            state = self.problem.evaluate()
        eq = self.problem.equations
        known = None if first else state.statuses
        solved = not first or self._is_solved(state)
        forces = forces_at(eq, state)
        return self.accepted(time, known, tuple(memory), forces, energies, solved=solved)

    def renewed(self, accepted: AcceptedState) -> AcceptedState:
        """The accepted state with the data as they are now, under which it may be no solution.

        Those that the load sets are what it makes of them at the time of the state, whatever they
        were set to since, as by another history of the problem, or by the load of another time.
        Collective; the problem is then at that state.
        """
        eq = self.problem.equations
        data = GivenData(eq)
        self._put_unknowns(accepted)
        self.remember(accepted.memory)
        try:
            self._set(accepted.time)
        except BaseException:
            data.restore()
            raise
        if eq.comm.allreduce(int(accepted.data.unchanged()), op=MPI.MIN):
            return accepted
        return self._under_other_data(accepted)

    def _under_other_data(self, accepted: AcceptedState) -> AcceptedState:
        """An accepted state, which is in the problem, under the data that are there. Collective."""
        solved = self._is_solved(self.problem.evaluate())
        return replace(accepted, data=GivenData(self.problem.equations), solved=solved)

    def _is_solved(self, state: Evaluation) -> bool:
        """Whether a state is a solution under the load that is there. Collective."""
        return Scales(self.problem.equations, settled=True).measure(state).worst <= _SOLVED

    def _of_state(self, accepted: AcceptedState) -> list[OfState]:
        """What has the state, and its values at an accepted one."""
        problem = self.problem
        names = ["displacement", *(f"multiplier of {s.name!r}" for s in problem.surfaces)]
        found = list(map(OfState, names, problem.fields, accepted.fields))
        moved = zip(problem.rigid_bodies, accepted.motions, strict=True)
        return found + [OfState(f"motion of {body.name!r}", body, v) for body, v in moved]

    def require_untouched(self, accepted: AcceptedState) -> None:
        """Refuse a later run where users have put something else in place of its start. Collective.

        What solves, runs and records have put there since is none of the user's.

        Args:
            accepted: the last state, where the run begins.
        """
        other = self._other_state(accepted)
        require(
            self.problem.comm,
            not other,
            f"the {other} has been changed since the last run ended at {accepted.time:.10g}, "
            "and a later run begins with the state in which that ended: to begin with what is "
            f"there now make another {self.kind}, else put back what was there",
        )

    def _other_state(self, accepted: AcceptedState) -> str:
        """What users have put in place of an accepted state, "" if nothing. Collective."""
        comm = self.problem.comm
        for name, f, values in self._of_state(accepted):
            known = bool(comm.allreduce(int(was_put(f)), op=MPI.MIN))
            if not (known or is_still(comm, f, values)):
                return name
        return ""

    def put(self, accepted: AcceptedState) -> None:
        """Put a state into Functions, statuses, rigid bodies, data and memory, bit by bit.

        Collective.
        """
        self._put_unknowns(accepted)
        self.remember(accepted.memory)
        accepted.data.restore()
        self._there = accepted

    def _put_unknowns(self, accepted: AcceptedState) -> None:
        """Put those and the statuses of an accepted state into the problem. Not collective."""
        problem = self.problem
        for f, values in zip(problem.fields, accepted.fields, strict=True):
            f.x.array[:] = values
        for body, motion in zip(problem.rigid_bodies, accepted.motions, strict=True):
            body.values = motion.copy()
        note_put(*problem.fields, *problem.rigid_bodies)
        problem.note_statuses(accepted.shown)

    def show(self, solved: SolvedStep) -> None:
        """Put the end of a step into the problem, with the memory of the step. Collective."""
        self.put(solved.after)
        self._remember(solved.before, solved.after.time)

    def prepare(self, accepted: AcceptedState, time: float) -> None:
        """Put a state into the problem with memory and data of a step to a time. Collective."""
        self.put(accepted)
        try:
            self._remember(accepted, time)
            self._set(time)
        except BaseException:
            self.put(accepted)
            raise

    @mesh_stays()
    def take(
        self,
        accepted: AcceptedState,
        time: float,
        *,
        likely: Sequence[Statuses | None] = (),
        guess: AcceptedState | None = None,
        trial: Trial | None = None,
    ) -> SolvedStep:
        """Step from a state to a time; the problem is left there, with the memory of the step.

        Collective.

        Args:
            accepted: where the step begins.
            time: at its end.
            likely: statuses of the end, the likeliest first; by default those of that state.
            guess: where the solver begins, by default at that state.
            trial: how it is tried, but for the statuses, by default by all strategies. Motions have
                a way of their own.

        Raises:
            ConvergenceError: if nothing solves the step. The problem is then at that state, as it
                is after any other error.
            ValueError: on every rank, for a load that depends on earlier calls.
        """
        self.put(accepted)
        try:
            solved = self._stepped(accepted, time, likely, guess, trial or Trial())
            if self.asks:
                self._ask_load(solved)
                self.asks = False
            return solved
        except BaseException:
            self.put(accepted)
            raise

    def _stepped(
        self,
        accepted: AcceptedState,
        time: float,
        likely: Sequence[Statuses | None],
        guess: AcceptedState | None,
        trial: Trial,
    ) -> SolvedStep:
        """The step from a state, which is in the problem; see `take`. Collective."""
        assert isinstance(accepted, AtRest)
        self._remember(accepted, time)
        eq = self.problem.equations
        self._set(time)
        self._check_turns(accepted)
        if guess is not None:
            self._put_unknowns(guess)
        expected = tuple(s for s in likely or (accepted.statuses,) if s is not None)
        trial = replace(trial, expected=expected)
        result, state = self.problem.solve_step(trial, progress=self._progress)
        forces = forces_at(eq, state)
        energies = accepted.energies.advanced(accepted.forces, forces, result.energies["friction"])
        after = self.accepted(time, state.statuses, eq.advanced(state), forces, energies)
        return SolvedStep(accepted, after, result)

    def _ask_load(self, solved: SolvedStep) -> None:
        """Refuse a load that depends on earlier calls. Collective.

        Steps are tried from one state with several lengths, in any order, so that the data of a
        time must not be those of the calls before. The problem is at the end of the step.
        """
        time = solved.after.time
        given = self._given()
        self.put(solved.before)
        changed = ""
        for _ in range(2):  # from the data of the step's start, and from its own
            self._set(time)
            changed = changed or given.changed()
        require(
            self.problem.comm,
            not changed,
            f"the load at the time {time:g} depends on earlier calls, of which {changed} is not "
            "what it was in the first: steps are tried again with other lengths, from data that "
            "are put back, so a load is to set all that it changes from the time alone",
        )
        self.show(solved)

    def ask_at_end(self, start: AcceptedState, accepted: AcceptedState) -> None:
        """Warn of a load that knows more than the time, at the end of a run. Collective.

        Args:
            start: where the run began.
            accepted: the last state of the run, at which the problem is.
        """
        given = self._given()
        self._set(accepted.time)
        changed = given.changed()
        left = ""
        if not changed:
            self._set(start.time)
            left = start.data.changed(self.problem.comm)
        accepted.data.restore()
        if self.problem.comm.rank > 0:
            return
        if changed:
            logger.warning(
                "the load depends on the solution: at the end of the step to the time %g it sets "
                "%s to something else than at its start. It is called before a step is solved, so "
                "that the step is one under data of the state before, however long it was: take "
                "short steps, or put what depends on the displacement into forms or law",
                accepted.time,
                changed,
            )
        elif left:
            logger.warning(
                "the load does not set all that it changes: called at the end of the run with the "
                "time %g of its start it leaves %s, so that another history would begin with other "
                "data; let it set at every time what it sets at any",
                start.time,
                left,
            )

    def _given(self) -> Constancy:
        """The data as they are, to be compared. Collective."""
        return Constancy(self.problem.comm, placed_data(self.problem.equations))

    def _check_turns(self, accepted: AcceptedState) -> None:
        """Raise ``ValueError`` if rigid bodies turn too far in a step from a state. Collective."""
        for body, motion in zip(self.problem.rigid_bodies, accepted.motions, strict=True):
            for s in self.problem.surfaces:
                if s.rigid_body is body:
                    check_turn(s, motion)

    def _remember(self, accepted: AcceptedState, time: float) -> None:
        """Let the surfaces remember an accepted state at a later time. Collective."""
        step = time - accepted.time
        later = [None if m is None else m.later(step) for m in accepted.memory]
        self.remember(later)

    def remember(self, memory: Sequence[Memory | None]) -> None:
        """Take the problem under another memory of the contact points. Collective."""
        self.problem = self.static.with_memory(memory)

    @contextmanager
    def _loaded(self, time: float) -> Iterator[None]:
        """Set the load of a time; take it and memory back if the context raises. Collective."""
        eq = self.problem.equations
        data = GivenData(eq)
        before = self.problem
        try:
            self._set(time)
            yield
        except BaseException:
            data.restore()
            self.problem = before
            raise

    def _set(self, time: float) -> None:
        where = f"the load at the time {time:g}"
        with mesh_may_move(), everywhere(self.problem.comm, where):
            self._load(time)

    def accepted(
        self,
        time: float,
        statuses: Statuses | None,
        memory: tuple[Memory | None, ...],
        forces: Forces,
        energies: Energies,
        *,
        solved: bool = True,
    ) -> AtRest:
        """The equilibrium in the problem as an accepted state. Collective."""
        return self._accepted(
            AtRest, time, statuses, memory, energies, solved=solved, forces=forces
        )

    def _accepted(
        self,
        kind: type[A],
        time: float,
        statuses: Statuses | None,
        memory: tuple[Memory | None, ...],
        energies: Energies,
        *,
        solved: bool = True,
        **more: Any,
    ) -> A:
        """What is in the problem, as an accepted state, which may have more. Collective."""
        problem = self.problem
        x = problem.create_vector()
        problem.write(x)
        unknowns = x.array_r.copy()
        x.destroy()
        return kind(
            time,
            tuple(f.x.array.copy() for f in problem.fields),
            tuple(body.values.copy() for body in problem.rigid_bodies),
            statuses,
            problem.statuses,
            memory,
            GivenData(problem.equations),
            unknowns,
            energies,
            solved,
            **more,
        )
