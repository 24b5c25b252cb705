# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of evolutions through times.

A step that no strategy solves is tried with a quarter of the length, down to a least one. A step in
which the state changes much faster than in the one before is looked at more closely, by halves
(`jumps`): where the change does not shrink with the step what was found is beyond a jump, if it is
proved that no solution continues the evolution; else none was found that does, and that is said.
Times that the user asks for are hit exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, TypeAlias, get_args

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact._errors import everywhere, same_everywhere
from dolfinx_contact._frozen import ReadOnly
from dolfinx_contact._numbers import is_number
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.equations.given_data import Datum
from dolfinx_contact.evolution.accepted import (
    AcceptedState,
    Stepper,
    Taken,
    changes,
    largest_at_points,
)
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.forks import Forked, Forks
from dolfinx_contact.evolution.history import EvolutionStep, History, NoContinuation
from dolfinx_contact.evolution.jumps import Found, find_jump, where_it_changes
from dolfinx_contact.evolution.progress import HistoryProgress
from dolfinx_contact.evolution.run_state import AtJump, Recorder, RunState, Task, aim, checked_times
from dolfinx_contact.laws.status import closed
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["Evolution", "Observer"]

#: Told of every accepted step, or asked whether to accept it, on every rank.
Observer: TypeAlias = Callable[[EvolutionStep], object]

_SUDDEN = 2.0  # times the rate before: a step that was found from beyond is a jump
_SLIPS = 0.5  # of the rate of the body, at most, that of points that begin to
_BREAKS = 0.25  # of a bond, lost in a step: it may have snapped
_FURTHER = 4.0  # times as far in time, the next at which a solution is looked for
_MOST_FURTHER = 20  # such times
_MOST_FORKS = 16  # evolutions along other rays
_HALVINGS = 20  # of the whole time, to the least step
_REACHED = "the last time is reached"


class Evolution(ReadOnly):
    """A contact problem in time: runs through times, step by step, which a `Stepper` takes.

    Args:
        problem: the contact problem.
        load: called with a time, on every rank, sets Constants and Functions of the problem's data
            to what they are then.

    Attributes:
        problem: as given.
        load: as given; it may be set between two runs, all else is read-only.
        account: what its energies are.
        method: what it is known by beside the problem, in words.
        kept: Functions that a state has beside those of the problem, by name.
        data: Functions and Constants beside those of the problem, as in a density.
        forms: beside those of the problem, as one of damping.

    Raises:
        ValueError: on every rank, if arguments do not fit.
    """

    _may_be_set = ("load",)
    _instead: ClassVar[Mapping[str, str]] = {
        "": "what changes in time are values of Constants and Functions, which the load sets; else "
        "make another evolution"
    }
    account: type[Energies] = Energies
    method: Sequence[str] = ()
    kept: Mapping[str, fem.Function] = {}
    data: Sequence[Datum] = ()
    forms: Sequence[ufl.Form] = ()

    def __init__(self, problem: ContactProblem, load: Callable[[float], object]):
        if not isinstance(problem, ContactProblem):
            raise ValueError(f"a ContactProblem is needed, got {type(problem).__name__}")
        with everywhere(problem.comm, "an evolution"):
            if not callable(load):
                raise ValueError(f"the load must be a function of the time, got {load!r}")
            for s in problem.surfaces:
                lack = s.law.lacks(history=True)
                if lack:
                    raise ValueError(f"{s.name}: the law {s.law.name} lacks {lack}")
        self.problem = problem
        self.load = load
        self._accepted: AcceptedState | None = None
        self._rate: npt.NDArray[np.float64] | None = None
        self._number = 0

    def _through(
        self,
        times: Sequence[float],
        *,
        longest: float = math.inf,
        shortest: float | None = None,
        at_jump: AtJump = "raise",
        sudden: float = math.inf,
        locate: bool = False,
        rays: bool | None = False,
        follow_rays: bool = False,
        accept: Callable[[EvolutionStep], bool] | None = None,
        observer: Observer | None = None,
        record: Recorder | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go through times; see `QuasiStatic.run`. Collective."""
        comm = self.problem.comm
        with everywhere(comm, "the times of an evolution"):
            given = checked_times(times, self._accepted)
            span = given[-1] - given[0]
            for name, value in dict(longest=longest, shortest=shortest, sudden=sudden).items():
                if not (is_number(value) or (name == "shortest" and value is None)):
                    raise ValueError(f"{name} must be a number, got {value!r}")
            least = span / 2**_HALVINGS if shortest is None else float(shortest)
            if not (math.isfinite(least) and least > 0 and longest >= least):
                raise ValueError(f"steps must have 0 < shortest <= longest, got {least}, {longest}")
            if at_jump not in get_args(AtJump):
                raise ValueError(f"at_jump is {at_jump!r}: known are {get_args(AtJump)}")
            if rays not in (True, False, None) or (follow_rays and rays is False):
                raise ValueError(f"rays must be True, False or None, to follow some too: {rays!r}")
            if not sudden >= 1:
                raise ValueError(f"sudden must be 1 or more, got {sudden}")
            for name, call in (("accept", accept), ("observer", observer)):
                if call is not None and not callable(call):
                    raise ValueError(f"{name} must be a function of a step, got {call!r}")
            if record is not None and not hasattr(record, "begin"):
                raise ValueError(f"record must be an records.EvolutionRecord, got {record!r}")
        same_everywhere(comm, times=given, longest=longest, shortest=shortest, at_jump=at_jump)
        same_everywhere(comm, sudden=float(sudden), rays=rays, follow_rays=bool(follow_rays))
        same_everywhere(comm, a_record=record is not None)
        limits = tuple(given), float(longest), least
        task = Task(*limits, at_jump, float(sudden), locate, rays, bool(follow_rays))
        stepper = self._stepper(progress)
        accepted = self._accepted
        if accepted is None:
            accepted = stepper.start(given[0])
        elif not comm.allreduce(int(accepted.data.stands()), op=MPI.MIN):
            # Data that were changed between two runs are those of the next.
            accepted = stepper.renewed(accepted)
        run_state = RunState(accepted, task.longest, self._rate, self._number)
        if record is not None:
            stepper.put(run_state.accepted)
            record.begin(task, run_state)
        return self._go(stepper, task, run_state, accept, observer, record, progress)

    def go_on(
        self,
        task: Task,
        run_state: RunState,
        *,
        accept: Callable[[EvolutionStep], bool] | None = None,
        observer: Observer | None = None,
        record: Recorder | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go on with a run from where it stood, as a record does. Collective.

        Args:
            task: what was asked of the run.
            run_state: where it stood.
            accept: as in the run, as for what follows, the errors and the result.
            observer: told of the steps from there on.
            record: keeps them.
            progress: whether to say where it is.
        """
        stepper = self._stepper(progress)
        return self._go(stepper, task, run_state, accept, observer, record, progress)

    def put(self, run_state: RunState) -> None:
        """Put the evolution where a run of it ended, from which the next goes on. Collective."""
        self._accepted = run_state.accepted
        self._rate = run_state.rate
        self._number = run_state.number
        self._stepper(None).put(run_state.accepted)

    def recalled(
        self, time: float, memory: Sequence[Memory | None], energies: Energies, *, first: bool
    ) -> AcceptedState:
        """The state that stands in Functions, statuses and rigid bodies, as one of it. Collective.

        Args:
            time: of the state.
            memory: that it left.
            energies: since the start.
            first: whether it is the start of the evolution, whose statuses are not known.
        """
        return self._stepper(None).recalled(time, memory, energies, first=first)

    def _stepper(self, progress: bool | None) -> Stepper:
        return Stepper(self.problem, self.load, False if progress is False else None)

    def _go(
        self,
        stepper: Stepper,
        task: Task,
        run_state: RunState,
        accept: Callable[[EvolutionStep], bool] | None,
        observer: Observer | None,
        record: Recorder | None,
        progress: bool | None,
    ) -> History:
        """A run from where it stands to its end. Collective."""
        said = HistoryProgress(
            self.problem.comm, progress, (run_state.accepted.time, task.times[-1])
        )
        run = _Run(stepper, task, run_state, accept, observer, record, said)
        history = run.history
        failure = None
        try:
            with stepper.problem.telling_once():
                for end in task.times[1:]:
                    run.to(end)
            history.end(Ending.REACHED, _REACHED)
        except _Ended as ended:
            history.end(ended.ending, str(ended))
            failure = ended
        finally:
            self._accepted = run.accepted
            self._rate = run.rate
            self._number = run.number
            stepper.put(run.accepted)
            said.end(history)
        if record is not None:
            record.end(history)
        history.others = _followed(run.forks, stepper, task)
        stepper.put(run.accepted)
        if failure is not None and task.at_jump != "stop":
            raise NoContinuation(history.reason, history) from failure.__cause__
        return history


class _Ended(Exception):
    """A run cannot go on: no solution continues it, none was found, or a step was not solved."""

    def __init__(self, ending: Ending, reason: str):
        super().__init__(reason)
        self.ending = ending


class _Run:
    """A run: where it is, and what it has accepted."""

    def __init__(
        self,
        stepper: Stepper,
        task: Task,
        run_state: RunState,
        accept: Callable[[EvolutionStep], bool] | None,
        observer: Observer | None,
        record: Recorder | None,
        said: HistoryProgress,
    ):
        self.accepted = run_state.accepted
        self.history = History(self.accepted.time, self.accepted.energies)
        self._stepper = stepper
        self._task = task
        self._said = said
        self._accepts = accept
        self._observer = observer
        self._record = record
        self._length = run_state.length
        self._rejected = 0
        self._forks = Forks(stepper, task.rays)
        #: Steps along other rays, which are to be followed.
        self.forks: list[Taken] = []
        self.rate = run_state.rate
        self._before = run_state.number

    def begin(self, taken: Taken) -> None:
        """Accept a step that was taken."""
        self._accept(Forked(taken))

    @property
    def number(self) -> int:
        """Of the last step."""
        return self._before + len(self.history.steps)

    def to(self, end: float) -> None:
        """Go on to a time."""
        while self.accepted.time < end:
            goal = aim(self.accepted.time, end, self._length)
            try:
                forked = self._forks.take(self.accepted, goal)
            except ConvergenceError as error:
                self._shorten(goal, error)
                continue
            taken = forked.taken
            found = self._jump(taken)
            if found is not None:
                for before in found.steps:
                    settled = found.far is None and before is found.steps[-1]
                    self._accept(Forked(before), settled=settled)
                if found.far is not None:
                    self._jump_over(found, found.far)
            elif self._wanted(taken):
                self._accept(forked)
            else:
                self._shorten(goal)

    def _jump(self, taken: Taken) -> Found | None:
        """What is found in a step that changes the state suddenly; None if it is no jump."""
        if math.isinf(self._task.sudden) or not taken.before.solved:
            return None
        slow = self._sudden(taken, self._task.sudden)
        if slow is None:
            return None
        return find_jump(self._stepper, taken, slow, self._task.shortest)

    def _sudden(self, taken: Taken, times: float) -> npt.NDArray[np.float64] | None:
        """Rates up to which nothing jumps in a step that is sudden; None if it is not. Collective.

        Args:
            taken: the step.
            times: the rate of the step before that are sudden.
        """
        before = self.rate
        comm = self._stepper.problem.comm
        rate = _rate(comm, taken)
        n = len(self._stepper.problem.surfaces)
        means = slice(2, 2 + n)
        bonds = slice(2 + n, 2 + 2 * n)
        one = slice(2 + 2 * n, None)
        if before is not None and before.shape != rate.shape:
            before = None  # that of an older record, which had other rates
        slow = np.zeros_like(rate) if before is None else times * before
        if before is not None:  # points that begin to slip come to be as fast as the body
            for part in (means, one):
                slow[part] = np.maximum(slow[part], _SLIPS * before[0])
        slow[0] = math.inf
        fast = rate > slow
        fast[bonds] = largest_at_points(comm, taken.before, taken.after)[1] > _BREAKS
        if not fast.any():
            return None
        # In a mean what one point does is small, and a bond that breaks is no rate.
        known = np.where(fast[: 2 + n].any(), slow, 0.0)[: one.start]
        known[0] = math.inf
        known[bonds] = 0.0
        return np.asarray(known)

    def _jump_over(self, found: Found, far: Taken) -> None:
        """Accept a step whose end is far as a jump, or end the run there and say why."""
        a = far.before
        b = far.after
        if self._task.at_jump == "jump":
            self._accept(Forked(far), jump=True)
            return
        beyond = f"beyond the time {a.time:.10g}"
        least = self._task.shortest
        there = where_it_changes(self._stepper, a, b)
        if found.proved:
            ending = Ending.NO_SOLUTION
            said = (
                f"no solution continues the evolution in the step from {a.time:.10g} to "
                f"{b.time:.10g}, where {found.why}; at its end another one was found, {there}"
            )
        elif found.failure is not None:
            ending = Ending.NOT_SOLVED
            said = (
                f"no step {beyond} was solved, down to {least:.2g}, that leads on from it; in a "
                f"solution further off, at {b.time:.10g}, {there}. Whether one continues the "
                f"evolution is not decided: {found.failure}"
            )
        else:
            ending = Ending.NOT_FOUND
            said = (
                f"no solution {beyond} was found that continues the evolution, in a step of "
                f"{b.time - a.time:.2g}; at its end another one was found, {there}. Whether one "
                f"does is not decided: {found.why}"
            )
        raise _Ended(ending, said) from found.failure

    def _shorten(self, aim: float, error: ConvergenceError | None = None) -> None:
        """Try half the step next time, or a quarter if there was an error; end if too short."""
        length = aim - self.accepted.time
        part = 2 if error is None else 4
        if length / part < self._task.shortest:
            if error is not None and self._task.at_jump == "jump":
                beyond = self._beyond(aim)
                if beyond is not None:
                    times = min(self._task.sudden, _SUDDEN)
                    self._accept(Forked(beyond), jump=self._sudden(beyond, times) is not None)
                    return
            raise _Ended(
                Ending.NOT_SOLVED,
                f"no solution was found beyond the time {self.accepted.time:.10g}, in a step of "
                f"{length:.2g}, which was not solved: {error}",
            ) from error
        self._length = length / part
        self._rejected = self._rejected + 1

    def _beyond(self, goal: float) -> Taken | None:
        """A step to a time at which no solution was found near; None if there is none either.

        A solution further off in time is where the solver begins then, or one between. Collective.
        """
        far: Taken | None = None
        start = self.accepted
        last = self._task.times[-1]
        ahead = [start.time + (goal - start.time) * _FURTHER**k for k in range(1, _MOST_FURTHER)]
        for time in [*(t for t in ahead if t < last), last]:
            try:
                far = self._stepper.take(start, time)
                break
            except ConvergenceError:
                continue
        while far is not None:
            likely = (far.after.statuses,)
            try:
                return self._stepper.take(start, goal, likely=likely, guess=far.after)
            except ConvergenceError:
                between = start.time + (far.after.time - start.time) / _FURTHER
            if not goal < between < far.after.time:
                return None
            try:
                far = self._stepper.take(start, between, likely=likely, guess=far.after)
            except ConvergenceError:
                return None
        return None

    def _step(self, taken: Taken, jump: bool, ways: int | None = None) -> EvolutionStep:
        return EvolutionStep(
            self.number + 1,
            taken.before.time,
            taken.after.time,
            taken.result,
            taken.after.energies,
            self._rejected,
            jump,
            ways,
        )

    def _wanted(self, taken: Taken) -> bool:
        """Whether the user accepts a step that could be shorter. Collective."""
        comm = self._stepper.problem.comm
        shorter = (taken.after.time - taken.before.time) / 2 >= self._task.shortest
        if shorter and self._task.locate and _closes(comm, taken):
            return False
        if not (shorter and comm.allreduce(int(self._accepts is not None))):
            return True
        self._stepper.show(taken)
        wanted = True
        with everywhere(comm, "accept"):
            if self._accepts is not None:
                answer = self._accepts(self._step(taken, False))
                if not isinstance(answer, bool | np.bool_):
                    raise ValueError(f"accept must answer True or False, got {answer!r}")
                wanted = bool(answer)
        # All that were asked must want it.
        return not comm.allreduce(int(not wanted))

    def _accept(self, forked: Forked, *, jump: bool = False, settled: bool = True) -> None:
        taken = forked.taken
        comm = self._stepper.problem.comm
        step = self._step(taken, jump, forked.ways)
        if self._task.follow_rays:
            self.forks += self._forks.others(forked)
        self.history.steps.append(step)
        self.accepted = taken.after
        if not jump:
            self.rate = _rate(self._stepper.problem.comm, taken)
        self._rejected, self._length = 0, min(2 * self._length, self._task.longest)
        if self._record is not None:
            run_state = RunState(taken.after, self._length, self.rate, step.number, settled)
            self._stepper.put(taken.after)
            self._record.step(step, run_state)
        if comm.allreduce(int(self._observer is not None)):
            self._stepper.show(taken)
            with everywhere(comm, "the observer"):
                if self._observer is not None:
                    self._observer(step)
        self._stepper.put(taken.after)
        self._stepper.problem.tell(step.result)
        self._said.step(step)


def _closes(comm: MPI.Comm, taken: Taken) -> bool:
    """Whether a point closes in a step. Collective."""
    a = taken.before.shown
    b = taken.after.shown
    mine = any(bool((closed(y) & ~closed(x)).any()) for x, y in zip(a, b, strict=True))
    return bool(comm.allreduce(int(mine)))


def _rate(comm: MPI.Comm, taken: Taken) -> npt.NDArray[np.float64]:
    """Of the state in a step: of `changes`, then of the farthest ways of a point. Collective."""
    ways, _ = largest_at_points(comm, taken.before, taken.after)
    found = np.concatenate([changes(comm, taken.before, taken.after), ways])
    return np.asarray(found / (taken.after.time - taken.before.time))


def _followed(forks: list[Taken], stepper: Stepper, task: Task) -> list[History]:
    """Evolutions along the rays that a run did not take, and along theirs. Collective."""
    found: list[History] = []
    left = list(forks)
    while left and len(found) < _MOST_FORKS:
        first = left.pop(0)
        run_state = RunState(first.before, task.longest)
        run = _Run(
            stepper,
            task,
            run_state,
            None,
            None,
            None,
            HistoryProgress(stepper.problem.comm, False, task.times),
        )
        try:
            run.begin(first)
            for end in task.times:
                run.to(end)
            run.history.end(Ending.REACHED, _REACHED)
        except _Ended as ended:
            run.history.end(ended.ending, str(ended))
        found.append(run.history)
        left += run.forks
    for rest in left:
        found.append(History(rest.before.time, rest.before.energies))
        found[-1].end(Ending.BUDGET, f"not followed: more than {_MOST_FORKS} evolutions")
    return found
