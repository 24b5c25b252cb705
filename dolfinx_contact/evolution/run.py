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
from dolfinx_contact.equations.given_data import Datum
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.forks import Forked, Forks
from dolfinx_contact.evolution.history import EvolutionStep, History, NoContinuation
from dolfinx_contact.evolution.jumps import Found, find_jump, where_it_changes
from dolfinx_contact.evolution.moment import Moment, Stepper, Taken, changes
from dolfinx_contact.evolution.said import Said
from dolfinx_contact.evolution.standing import AtJump, Recorder, Standing, Task, aim, checked_times
from dolfinx_contact.laws.status import closed
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["Evolution", "Observer"]

#: Told of every accepted step, or asked whether to accept it, on every rank.
Observer: TypeAlias = Callable[[EvolutionStep], object]

_SLIPS = 0.5  # of the rate of the body, at most, that of points that begin to
_MOST_FORKS = 16  # evolutions along other rays
_HALVINGS = 20  # of the whole time, to the least step


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
        self.problem, self.load = problem, load
        self._moment: Moment | None = None
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
            given = checked_times(times, self._moment)
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
                raise ValueError(f"record must be an output.EvolutionRecord, got {record!r}")
        same_everywhere(comm, times=given, longest=longest, shortest=shortest, at_jump=at_jump)
        same_everywhere(comm, sudden=float(sudden), rays=rays, follow_rays=bool(follow_rays))
        same_everywhere(comm, a_record=record is not None)
        limits = tuple(given), float(longest), least
        task = Task(*limits, at_jump, float(sudden), locate, rays, bool(follow_rays))
        stepper = self._stepper(progress)
        moment = self._moment
        if moment is None:
            moment = stepper.start(given[0])
        elif not comm.allreduce(int(moment.data.stands()), op=MPI.MIN):
            # Data that were changed between two runs are those of the next.
            moment = stepper.renewed(moment)
        standing = Standing(moment, task.longest, self._rate, self._number)
        if record is not None:
            stepper.put(standing.moment)
            record.begin(task, standing)
        return self._go(stepper, task, standing, accept, observer, record, progress)

    def go_on(
        self,
        task: Task,
        standing: Standing,
        *,
        accept: Callable[[EvolutionStep], bool] | None = None,
        observer: Observer | None = None,
        record: Recorder | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go on with a run from where it stood, as a record does. Collective.

        Args:
            task: what was asked of the run.
            standing: where it stood.
            accept: as in the run, as for what follows, the errors and the result.
            observer: told of the steps from there on.
            record: keeps them.
            progress: whether to say where it is.
        """
        stepper = self._stepper(progress)
        return self._go(stepper, task, standing, accept, observer, record, progress)

    def put(self, standing: Standing) -> None:
        """Put the evolution where a run of it ended, from which the next goes on. Collective."""
        self._moment, self._rate = standing.moment, standing.rate
        self._number = standing.number
        self._stepper(None).put(standing.moment)

    def recalled(
        self, time: float, memory: Sequence[Memory | None], energies: Energies, *, first: bool
    ) -> Moment:
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
        standing: Standing,
        accept: Callable[[EvolutionStep], bool] | None,
        observer: Observer | None,
        record: Recorder | None,
        progress: bool | None,
    ) -> History:
        """A run from where it stands to its end. Collective."""
        said = Said(self.problem.comm, progress, (standing.moment.time, task.times[-1]))
        run = _Run(stepper, task, standing, accept, observer, record, said)
        history, failure = run.history, None
        try:
            with stepper.problem.telling_once():
                for end in task.times[1:]:
                    run.to(end)
            history.reason, history.complete = "the last time is reached", True
        except _Ended as ended:
            history.reason, failure = str(ended), ended
        finally:
            self._moment, self._rate, self._number = run.moment, run.rate, run.number
            stepper.put(run.moment)
            said.end(history)
        if record is not None:
            record.end(history)
        history.others = _followed(run.forks, stepper, task)
        stepper.put(run.moment)
        if failure is not None and task.at_jump != "stop":
            raise NoContinuation(history.reason, history) from failure.__cause__
        return history


class _Ended(Exception):
    """A run cannot go on: no solution continues it, none was found, or a step was not solved."""


class _Run:
    """A run: where it is, and what it has accepted."""

    def __init__(
        self,
        stepper: Stepper,
        task: Task,
        standing: Standing,
        accept: Callable[[EvolutionStep], bool] | None,
        observer: Observer | None,
        record: Recorder | None,
        said: Said,
    ):
        self.moment = standing.moment
        self.history = History(self.moment.time, self.moment.energies)
        self._stepper, self._task, self._said = stepper, task, said
        self._accepts, self._observer, self._record = accept, observer, record
        self._length, self._rejected = standing.length, 0
        self._forks = Forks(stepper, task.rays)
        #: Steps along other rays, which are to be followed.
        self.forks: list[Taken] = []
        self.rate, self._before = standing.rate, standing.number

    def begin(self, taken: Taken) -> None:
        """Accept a step that was taken."""
        self._accept(Forked(taken))

    @property
    def number(self) -> int:
        """Of the last step."""
        return self._before + len(self.history.steps)

    def to(self, end: float) -> None:
        """Go on to a time."""
        while self.moment.time < end:
            goal = aim(self.moment.time, end, self._length)
            try:
                forked = self._forks.take(self.moment, goal)
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
        sudden, before = self._task.sudden, self.rate
        if math.isinf(sudden) or not taken.before.solved:
            return None
        rate = _rate(self._stepper.problem.comm, taken)
        slow = np.zeros_like(rate) if before is None else sudden * before
        slow[0] = math.inf
        if before is not None:  # points that begin to slip come to be as fast as the body
            slow[2:] = np.maximum(slow[2:], _SLIPS * before[0])
        if (rate <= slow).all():
            return None
        return find_jump(self._stepper, taken, slow, self._task.shortest)

    def _jump_over(self, found: Found, far: Taken) -> None:
        """Accept a step whose end is far as a jump, or end the run there and say why."""
        a, b = far.before, far.after
        if self._task.at_jump == "jump":
            self._accept(Forked(far), jump=True)
            return
        beyond, least = f"beyond the time {a.time:.10g}", self._task.shortest
        there = f"found at {b.time:.10g}, {where_it_changes(self._stepper, a, b)}"
        if found.proved:
            said = f"no solution continues the evolution {beyond}; in the next one, {there}"
            said += f" ({found.why})"
        elif found.failure is not None:
            said = (
                f"no step {beyond} was solved, down to {least:.2g}, that leads on from it; in a "
                f"solution further off, {there}. Whether one continues the evolution is not "
                f"decided: {found.failure}"
            )
        else:
            said = (
                f"no solution {beyond} was found that continues the evolution, in a step of "
                f"{b.time - a.time:.2g}; in the next one, {there}. Whether one does is not "
                f"decided: {found.why}"
            )
        raise _Ended(said) from found.failure

    def _shorten(self, aim: float, error: ConvergenceError | None = None) -> None:
        """Try half the step next time, or a quarter if there was an error; end if too short."""
        length, part = aim - self.moment.time, 2 if error is None else 4
        if length / part < self._task.shortest:
            raise _Ended(
                f"no solution was found beyond the time {self.moment.time:.10g}, in a step of "
                f"{length:.2g}, which was not solved: {error}"
            ) from error
        self._length, self._rejected = length / part, self._rejected + 1

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
        taken, comm = forked.taken, self._stepper.problem.comm
        step = self._step(taken, jump, forked.ways)
        if self._task.follow_rays:
            self.forks += self._forks.others(forked)
        self.history.steps.append(step)
        self.moment = taken.after
        if not jump:
            self.rate = _rate(self._stepper.problem.comm, taken)
        self._rejected, self._length = 0, min(2 * self._length, self._task.longest)
        if self._record is not None:
            standing = Standing(taken.after, self._length, self.rate, step.number, settled)
            self._stepper.put(taken.after)
            self._record.step(step, standing)
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
    a, b = taken.before.shown, taken.after.shown
    mine = any(bool((closed(y) & ~closed(x)).any()) for x, y in zip(a, b, strict=True))
    return bool(comm.allreduce(int(mine)))


def _rate(comm: MPI.Comm, taken: Taken) -> npt.NDArray[np.float64]:
    """Of the state in a step, as `changes` has it. Collective."""
    length = taken.after.time - taken.before.time
    return np.asarray(changes(comm, taken.before, taken.after) / length)


def _followed(forks: list[Taken], stepper: Stepper, task: Task) -> list[History]:
    """Evolutions along the rays that a run did not take, and along theirs. Collective."""
    found: list[History] = []
    left = list(forks)
    while left and len(found) < _MOST_FORKS:
        first = left.pop(0)
        standing = Standing(first.before, task.longest)
        run = _Run(
            stepper, task, standing, None, None, None, Said(stepper.problem.comm, False, task.times)
        )
        try:
            run.begin(first)
            for end in task.times:
                run.to(end)
            run.history.reason, run.history.complete = "the last time is reached", True
        except _Ended as ended:
            run.history.reason = str(ended)
        found.append(run.history)
        left += run.forks
    for rest in left:
        found.append(History(rest.before.time, rest.before.energies))
        found[-1].reason = f"not followed: more than {_MOST_FORKS} evolutions"
    return found
