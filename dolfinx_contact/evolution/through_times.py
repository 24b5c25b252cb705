# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs through times, in steps whose lengths adapt.

A step that no strategy solves is tried again with a quarter of the length, down to the shortest
length; where bodies slide over each other it is halved first (`sliding_steps`). A step in which the
state changes much faster than in the step before is searched for a jump, by halves (`jumps`). If
the change does not shrink with the step, the state jumps, or no solution was found that continues
the evolution; the run then ends, or jumps on request. The times of the user are hit exactly.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._errors import everywhere, require
from dolfinx_contact._validate import is_number
from dolfinx_contact.continuation.arguments import check_rays
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution.changes import changes, largest_at_points
from dolfinx_contact.evolution.forks import Forked, Forks
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.evolution.jumps import Found, find_jump, where_it_changes
from dolfinx_contact.evolution.run import Rule, RunState
from dolfinx_contact.evolution.sliding_steps import SlidingSteps
from dolfinx_contact.evolution.step import AcceptedState, AtRest, SolvedStep, Stepper
from dolfinx_contact.laws.status import closed
from dolfinx_contact.results.indicators import StepIndicators
from dolfinx_contact.results.result import Result
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["Accept", "AtJump", "HistoryTask", "ThroughTimes", "checked_times"]

#: What to do where no solution continues the evolution, or none is found that does.
AtJump: TypeAlias = Literal["raise", "stop", "jump"]
#: Asked of every step whether it is accepted.
Accept: TypeAlias = Callable[[EvolutionStep], bool]

_ROUND_OFF = 1e-9  # of the whole time
_SUDDEN = 2.0  # times the rate before: a step that was found from beyond is a jump
_SLIPS = 0.5  # of the rate of the body, at most, that of points that begin to
_BREAKS = 0.25  # of a bond, lost in a step: it may have snapped
_FURTHER = 4.0  # times as far in time, the next at which a solution is looked for
_MOST_FURTHER = 20  # such times
_REACHED = "the last time is reached"
_HALVE = "; shorter steps are tried with halve_steps=True"


@dataclass(frozen=True)
class HistoryTask:
    """The task of a run; see `QuasiStatic.run`, and `NSCD.run` for ``locate``.

    Raises:
        ValueError: if it does not fit.
    """

    times: tuple[float, ...]
    longest: float
    shortest: float
    at_jump: AtJump = "raise"
    sudden: float = 2.0
    locate: bool = False
    locate_jumps: bool = False
    halve: bool = True
    rays: bool | None = False
    follow_rays: bool = False
    extrapolate: bool = False

    def __post_init__(self) -> None:
        for name in ("longest", "shortest", "sudden"):
            value = getattr(self, name)
            if not is_number(value):
                raise ValueError(f"{name} must be a number, got {value!r}")
            object.__setattr__(self, name, float(value))
        least = self.shortest
        if not (math.isfinite(least) and least > 0 and self.longest >= least):
            raise ValueError(
                f"steps must have 0 < shortest <= longest, got {least}, {self.longest}"
            )
        if self.at_jump not in get_args(AtJump):
            raise ValueError(f"at_jump is {self.at_jump!r}: known are {get_args(AtJump)}")
        check_rays(self.rays)
        if self.follow_rays and self.rays is False:
            raise ValueError("rays must be True or None, to follow some too: False")
        if self.at_jump == "jump" and not self.locate_jumps:
            raise ValueError("at_jump='jump' needs locate_jumps=True")
        if not self.sudden >= 1:
            raise ValueError(f"sudden must be 1 or more, got {self.sudden}")


def checked_times(times: Sequence[float], accepted: AcceptedState | None) -> tuple[float, ...]:
    """The times as numbers, or ``ValueError``. Not collective."""
    try:
        found = [float(t) for t in np.asarray(times, dtype=np.float64).reshape(-1)]
    except (TypeError, ValueError):
        raise ValueError(f"two or more times are needed, as numbers, got {times!r}") from None
    if len(found) < 2 or not all(math.isfinite(t) for t in found):
        raise ValueError(f"two or more finite times are needed, the first of them now: {times!r}")
    for a, b in itertools.pairwise(found):
        if not b > a:
            raise ValueError(f"times must increase, got {b!r} after {a!r}")
    if accepted is not None:
        # Times that are summed up differ from those that are written down.
        if abs(found[0] - accepted.time) > _ROUND_OFF * (found[-1] - found[0]):
            raise ValueError(f"the evolution is at the time {accepted.time!r}, not {found[0]!r}")
        found[0] = accepted.time
    return tuple(found)


class _Ended(Exception):
    """A run cannot continue: no solution continues it, none was found, or a step was not solved."""

    def __init__(self, ending: Ending, reason: str):
        super().__init__(reason)
        self.ending = ending


class ThroughTimes(Rule[HistoryTask, RunState]):
    """Goes from time to time, in steps that may be shorter.

    Args:
        stepper: stepper of the problem.
        task: task of the run.
        run_state: state of the run where it starts or continues.
        accept: function of a step that returns whether it is accepted.
        first: step that is accepted before any other.

    Attributes:
        failed: whether the run ended because no step continues it.
        failure: error of the last step; None if it was solved.
        forks: steps along other rays, which are to be followed.
    """

    what = "evolution"
    units = "steps"

    def __init__(
        self,
        stepper: Stepper,
        task: HistoryTask,
        run_state: RunState,
        accept: Accept | None = None,
        *,
        first: SolvedStep | None = None,
    ):
        super().__init__(task, run_state)
        self.failed = False
        self.failure: BaseException | None = None
        self.forks: list[SolvedStep] = []
        self._stepper = stepper
        self._accepts = accept
        self._first = first
        self._accepted = run_state.accepted
        self._length = run_state.length
        self._rate = run_state.rate
        self._number = run_state.number
        self._settled = True
        self._rejected = 0
        self._forks = Forks(stepper, task.rays)
        self._sizes = SlidingSteps(
            stepper.problem,
            task.times,
            longest=task.longest,
            shortest=task.shortest,
            extrapolate=task.extrapolate,
            halve=task.halve,
            start=run_state.accepted,
        )

    @property
    def run_state(self) -> RunState:
        return RunState(
            self._accepted,
            self._length,
            self._rate,
            self._number,
            self._settled,
            self.ending,
            self.reason,
        )

    def steps(self) -> Iterator[EvolutionStep]:
        try:
            if self._first is not None:
                yield self._accept(Forked(self._first))
            for end in self._goals():
                yield from self._to(end)
        except _Ended as ended:
            self.end(ended.ending, str(ended))
            self.failed = True
            self.failure = ended.__cause__
        if self.ending is None:
            self.end(Ending.REACHED, _REACHED)

    def where(self, step: EvolutionStep) -> str:
        return (
            f"time {step.time:.6g} of {self.task.times[-1]:.6g}  step {step.number}, of "
            f"{step.time - step.start:.2g}"
        )

    def part(self, step: EvolutionStep) -> float | None:
        start = self.start.accepted.time
        return (step.time - start) / (self.task.times[-1] - start)

    def _goals(self) -> Iterable[float]:
        """Times that are hit exactly."""
        return self.task.times

    def _to(self, end: float) -> Iterator[EvolutionStep]:
        """The steps to a time."""
        while self._accepted.time < end:
            goal = _aim(self._accepted.time, end, self._length)
            trial = self._sizes.trial(self._accepted, goal, end)
            try:
                forked = self._forks.take(self._accepted, goal, trial)
                self._sizes.require_unfolded(forked.solved)
            except ConvergenceError as error:
                beyond = self._shorten(goal, error, brief=trial.brief)
                if beyond is not None:
                    yield beyond
                continue
            solved = forked.solved
            found = self._jump(solved)
            if found is not None:
                for before in found.steps:
                    settled = found.far is None and before is found.steps[-1]
                    yield self._accept(Forked(before), settled=settled)
                if found.far is not None:
                    yield self._jump_over(found, found.far)
            elif self._wanted(solved):
                yield self._accept(forked)
            else:
                self._shorten(goal)

    def _accept(self, forked: Forked, *, jump: bool = False, settled: bool = True) -> EvolutionStep:
        """Go to the end of a step."""
        solved = forked.solved
        step = self._step(solved, jump, forked.directions)
        if self.task.follow_rays:
            self.forks += self._forks.others(forked)
        if not jump:
            self._rate = _rate(self._stepper.problem.comm, solved)
        self._sizes.accept(solved, jump=jump)
        self._accepted = solved.after
        self._number = step.number
        self._settled = settled
        self._rejected = 0
        self._length = min(2 * self._length, self.task.longest)
        self._end_if_reached(solved)
        return step

    def _end_if_reached(self, solved: SolvedStep) -> None:
        """End the run if a step that was accepted leads to where it is to go."""
        if solved.after.time >= self.task.times[-1]:
            self.end(Ending.REACHED, _REACHED)

    def _step(self, solved: SolvedStep, jump: bool, directions: int | None = None) -> EvolutionStep:
        start = solved.before.time
        end = solved.after.time
        requested = self._sizes.requested(end)
        return EvolutionStep(
            self._number + 1,
            start,
            end,
            self._with_indicators(solved),
            solved.after.energies,
            self._rejected,
            jump,
            directions,
            inserted=end not in self.task.times and end - start < (1 - _ROUND_OFF) * requested,
            state=solved.after.state,
        )

    def _with_indicators(self, solved: SolvedStep) -> Result:
        """Return the result of a step with its indicators of a jump. Collective."""
        a, b = solved.before, solved.after
        result = solved.result
        if not (isinstance(a, AtRest) and a.solved) or self._rate is None:
            return result
        rate = _rate(self._stepper.problem.comm, solved)[1]
        indicators = StepIndicators(
            self._number + 1,
            a.time,
            b.time,
            float(rate / self._rate[1]) if self._rate[1] > 0 else math.inf,
            b.energies.residue_since(a.energies),
            searched=self.task.locate_jumps,
        )
        return replace(result, indicators=replace(result.indicators, step=indicators))

    def _jump(self, solved: SolvedStep) -> Found | None:
        """Search a step for a jump if it changes the state suddenly; None if there is none."""
        if not self.task.locate_jumps or not solved.before.solved:
            return None
        slow = self._sudden(solved, self.task.sudden)
        if slow is None:
            return None
        return find_jump(self._stepper, solved, slow, self.task.shortest)

    def _sudden(self, solved: SolvedStep, times: float) -> npt.NDArray[np.float64] | None:
        """Rates up to which nothing jumps in a step that is sudden; None if it is not. Collective.

        Args:
            solved: the step.
            times: the rate of the step before that are sudden.
        """
        before = self._rate
        comm = self._stepper.problem.comm
        rate = _rate(comm, solved)
        n = len(self._stepper.problem.surfaces)
        means = slice(2, 2 + n)
        bonds = slice(2 + n, 2 + 2 * n)
        one = slice(2 + 2 * n, None)
        slow = np.zeros_like(rate) if before is None else times * before
        if before is not None:  # points that begin to slip come to be as fast as the body
            for part in (means, one):
                slow[part] = np.maximum(slow[part], _SLIPS * before[0])
        slow[0] = math.inf
        fast = rate > slow
        fast[bonds] = largest_at_points(comm, solved.before, solved.after)[1] > _BREAKS
        if not fast.any():
            return None
        # In a mean what one point does is small, and a bond that breaks is no rate.
        known = np.where(fast[: 2 + n].any(), slow, 0.0)[: one.start]
        known[0] = math.inf
        known[bonds] = 0.0
        return np.asarray(known)

    def _jump_over(self, found: Found, far: SolvedStep) -> EvolutionStep:
        """Accept a step whose end is far as a jump, or end the run there with the reason."""
        a = far.before
        b = far.after
        if self.task.at_jump == "jump":
            return self._accept(Forked(far), jump=True)
        beyond = f"beyond the time {a.time:.10g}"
        least = self.task.shortest
        there = where_it_changes(self._stepper, a, b)
        if found.proved:
            ending = Ending.NO_SOLUTION
            words = (
                f"no solution continues the evolution in the step from {a.time:.10g} to "
                f"{b.time:.10g}, where {found.why}; at its end another one was found, {there}"
            )
        elif found.failure is not None:
            ending = Ending.NOT_SOLVED
            words = (
                f"no step {beyond} was solved, down to {least:.2g}, that leads on from it; in a "
                f"solution further off, at {b.time:.10g}, {there}. Whether one continues the "
                f"evolution is not decided: {found.failure}"
            )
        else:
            ending = Ending.NOT_FOUND
            words = (
                f"no solution {beyond} was found that continues the evolution, in a step of "
                f"{b.time - a.time:.2g}; at its end another one was found, {there}. Whether one "
                f"does is not decided: {found.why}"
            )
        raise _Ended(ending, words) from found.failure

    def _shorten(
        self, goal: float, error: ConvergenceError | None = None, *, brief: bool = False
    ) -> EvolutionStep | None:
        """Try half the step next time, or a quarter if no strategy solves it; end if too short.

        The step that jumps then, if it may; else None.
        """
        length = goal - self._accepted.time
        part = 2 if error is None or brief else 4
        if not self.task.halve or length / part < self.task.shortest:
            if error is not None and self.task.at_jump == "jump":
                beyond = self._beyond(goal)
                if beyond is not None:
                    times = min(self.task.sudden, _SUDDEN)
                    jump = self._sudden(beyond, times) is not None
                    return self._accept(Forked(beyond), jump=jump)
            raise _Ended(
                Ending.NOT_SOLVED,
                f"no solution was found beyond the time {self._accepted.time:.10g}, in a step of "
                f"{length:.2g}, which was not solved: {error}"
                + ("" if self.task.halve else _HALVE),
            ) from error
        self._length = length / part
        self._rejected = self._rejected + 1
        return None

    def _beyond(self, goal: float) -> SolvedStep | None:
        """A step to a time at which no solution was found near; None if there is none either.

        A solution further off in time is where the solver begins then, or one between. Collective.
        """
        far: SolvedStep | None = None
        start = self._accepted
        last = self.task.times[-1]
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

    def _wanted(self, solved: SolvedStep) -> bool:
        """Whether the user accepts a step, whose end is put into the problem. Collective.

        Raises:
            ValueError: on every rank, if the user rejects a step that cannot be shorter.
        """
        comm = self._stepper.problem.comm
        length = solved.after.time - solved.before.time
        shorter = length / 2 >= self.task.shortest
        if shorter and self.task.locate and _closes(comm, solved):
            return False
        if not comm.allreduce(int(self._accepts is not None)):
            return True
        self._stepper.put(solved.after)
        wanted = True
        with everywhere(comm, "accept"):
            if self._accepts is not None:
                answer = self._accepts(self._step(solved, False))
                if not isinstance(answer, bool | np.bool_):
                    raise ValueError(f"accept must answer True or False, got {answer!r}")
                wanted = bool(answer)
        # All that were called must require it.
        wanted = not comm.allreduce(int(not wanted))
        require(
            comm,
            wanted or shorter,
            f"accept rejects every step from the time {solved.before.time:.10g}, down to one of "
            f"{length:.2g}: accept longer steps, or give a smaller shortest length than "
            f"{self.task.shortest:.2g}",
        )
        return wanted


def _aim(start: float, end: float, length: float) -> float:
    """The end of the next of equal steps to a time, none longer than a length."""
    steps = math.ceil((end - start) / length * (1 - 1e-12))
    return end if steps <= 1 else start + (end - start) / steps


def _closes(comm: MPI.Comm, solved: SolvedStep) -> bool:
    """Whether a point closes in a step. Collective."""
    a = solved.before.shown
    b = solved.after.shown
    mine = any(bool((closed(y) & ~closed(x)).any()) for x, y in zip(a, b, strict=True))
    return bool(comm.allreduce(int(mine)))


def _rate(comm: MPI.Comm, solved: SolvedStep) -> npt.NDArray[np.float64]:
    """Rates in a step: of `changes`, then of the largest displacement of a point. Collective."""
    distances, _ = largest_at_points(comm, solved.before, solved.after)
    found = np.concatenate([changes(comm, solved.before, solved.after), distances])
    return np.asarray(found / (solved.after.time - solved.before.time))
