# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rules of histories and motions: steps through given times, or until the body is at rest.

Between two given times t_k and t_k+1 the rule takes n equal steps,

    n = ceil((t_k+1 - t_k)/L),          L = ``longest``, by default n = 1,

and hits the given times exactly. Additional steps are inserted only on request:

    halving     a step of length h that is not solved is repeated with h/4 from the same state, down
                to the shortest length; the length doubles after every accepted step. For bodies
                sliding over each other h/2 is tried first: Newton's method solves a step of about
                one facet of the master in a few iterations, and if it fails, shorter steps cost
                less than the remaining `strategies`.
    jumps       a step is searched for a jump (`jumps`) if the rate of the unknowns, or the mean or
                largest rate of the points of a surface, exceeds twice its value in the previous
                step, or if a bond loses more than a quarter of the largest strength. Points that
                begin to slip may move with half the rate of the body.
    locate      a step in which a point closes is repeated with h/2.

The rule `ToRest` ends a motion once its kinetic energy E has satisfied E <= rest max E at the ends
of ten successive steps and for a time of 4 sqrt(rest) T, where T is the time since the start. A
body that reverses its velocity after a time T, for example at the top of a throw, satisfies the
inequality only for 2 sqrt(rest) T, because v = v_max t/T around that instant.

At the start of a step every slipping point is at the border of stick, and the rate problem may have
several solutions (`rate_problem`). On request these solutions are counted, and their statuses are
tried if a step is not solved.

In a long step of sliding bodies Newton's method may converge to a folded state that does not
continue the evolution: the smallest determinant of the deformation gradient F falls below half of
its previous value (at most 1). Such a step is not accepted.
"""

from __future__ import annotations

import bisect
import logging
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._ending import Ending
from dolfinx_contact._mpi import any_rank
from dolfinx_contact._validate import listed, one_of, positive
from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.continuation.arguments import check_rays
from dolfinx_contact.equations.evaluation import Statuses, differs
from dolfinx_contact.evolution.energy import Forces, MotionEnergies
from dolfinx_contact.evolution.history import EvolutionStep, History, NoContinuation
from dolfinx_contact.evolution.jumps import (
    MOVED,
    UNKNOWNS,
    Found,
    StateChanges,
    changes,
    find_jump,
    where_it_changes,
)
from dolfinx_contact.evolution.rate_problem import rays_of_step
from dolfinx_contact.evolution.run import Ended, Rule, RunState
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.laws.status import closed
from dolfinx_contact.results.indicators import StepIndicators, alternation
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.tables import ContactTable
from dolfinx_contact.solvers import ConvergenceError
from dolfinx_contact.solvers.strategies import Trial

__all__ = ["AtJump", "HistoryTask", "ThroughTimes", "ToRest", "checked_times"]

#: Action if no solution continues the evolution, or none is found that does.
AtJump: TypeAlias = Literal["raise", "stop", "jump"]

logger = logging.getLogger(__name__)


_ROUND_OFF = 1e-9  # relative difference of equal times and lengths
_SUDDEN = 2.0  # ratio to the previous rates above which a step may contain a jump
_SLIPS = 0.5  # largest rate of points that begin to slip, as a fraction of the rate of the body
_BREAKS = 0.25  # loss of strength above which a bond may have snapped
_FURTHER = 4.0  # ratio of successive distances in time at which a later solution is searched
_MOST_FURTHER = 20  # largest number of these distances
_PARTS = 16  # number of parts of a requested step; shorter steps are solved by all strategies
_FOLDS = 0.5  # factor of the previous smallest det F, at most 1, below which a state is folded
_FEW = 16  # largest number of contact points for which rays are computed by default
_TURNING = 4.0  # multiple of sqrt(rest) T, twice the slow phase of a reversal
_QUIET = 10  # least number of steps at rest
_REACHED = "the last time is reached"
_HALVE = "; halve_steps=True tries shorter steps"
_LONGER = (
    "; a law depends on the length of a step: if it weakens with the speed, take longer steps, or "
    "NSCD with mass='lumped' (recipe on velocity weakening)"
)


@dataclass(frozen=True)
class HistoryTask:
    """Arguments of a run through times, from `QuasiStatic.run`, `NSCD.run` or `NSCD.settle`.

    Attributes:
        times: time of the start, then the times at which steps end exactly.
        longest: upper bound of the length of a step.
        shortest: lower bound of the length of a halved step.
        at_jump: action if no solution continues the evolution.
        locate: whether steps in which a contact point closes are shortened, down to ``shortest``.
        rest: fraction of the largest kinetic energy below which a motion is at rest and the run
            ends (see `NSCD.settle`); 0: the run ends at the last time.
        locate_jumps: whether steps with sudden changes are searched for jumps.
        halve: whether steps that are not solved are repeated with a shorter length.
        rays: whether all solutions of the rate problem are computed; None: only for up to sixteen
            points, in steps in which statuses change.
        extrapolate: whether the solver starts from the extrapolation of the last step if bodies
            slide.

    Raises:
        ValueError: if an argument is not admissible.
    """

    times: tuple[float, ...]
    longest: float
    shortest: float
    at_jump: AtJump = "raise"
    locate: bool = False
    rest: float = 0.0
    locate_jumps: bool = False
    halve: bool = True
    rays: bool | None = False
    extrapolate: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "longest", positive(self.longest, "longest", infinite=True))
        object.__setattr__(self, "shortest", positive(self.shortest, "shortest"))
        if self.shortest > self.longest:
            raise ValueError(f"shortest = {self.shortest} is longer than longest = {self.longest}")
        first, *_, last = self.times
        if self.longest <= np.spacing(max(abs(first), abs(last))):
            raise ValueError(
                f"steps of at most {self.longest:g} are below the round-off of the times up to "
                f"{last:g}: take longer steps"
            )
        one_of(self.at_jump, "at_jump", get_args(AtJump))
        check_rays(self.rays)
        if self.at_jump == "jump" and not self.locate_jumps:
            raise ValueError("at_jump='jump' needs locate_jumps=True")

    def requested(self, time: float) -> float:
        """Return the length of the equal steps into which the interval around a time is divided.

        It is 0 if the time is not in the range of `times`.
        """
        k = bisect.bisect_left(self.times, time)
        if not 0 < k < len(self.times):
            return 0.0
        return _aim(self.times[k - 1], self.times[k], self.longest) - self.times[k - 1]


def checked_times(times: Sequence[float], accepted: AcceptedState | None) -> tuple[float, ...]:
    """Validate times and return them as numbers. Not collective.

    Args:
        times: times of a run, at least two.
        accepted: state at the first time; None if the first time is arbitrary.
    """
    values = np.array(listed(times, "times"), dtype=np.float64).reshape(-1)
    if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values) > 0).all():
        raise ValueError(f"times must be two or more increasing numbers, got {times!r}")
    if accepted is not None:
        # accumulated times differ from literal times by round-off
        if abs(values[0] - accepted.time) > _ROUND_OFF * (values[-1] - values[0]):
            raise ValueError(
                f"the evolution is at the time {accepted.time!r}, not {float(values[0])!r}"
            )
        values[0] = accepted.time
    return tuple(values.tolist())


class ThroughTimes(Rule[HistoryTask]):
    """Rule of a run through given times.

    Args:
        stepper: stepper of the problem.
        task: arguments of the run.
        state: state of the run where it starts or continues.
    """

    what = "evolution"
    units = "steps"

    def __init__(self, stepper: Stepper, task: HistoryTask, state: RunState):
        super().__init__(task, state)
        self._stepper = stepper
        self._comm = stepper.problem.comm
        surfaces = stepper.problem.surfaces
        at_rest = isinstance(state.accepted.forces, Forces)
        self._slides = at_rest and any(s.slides for s in surfaces)
        points = sum(s.points.number_everywhere for s in surfaces)
        self._rays_are_cheap = task.rays is None and points <= _FEW
        #: Whether a warning reports the first halved step; in histories halving is requested.
        self._reports_halving = not at_rest
        #: Number of steps that were tried from the present state and not accepted.
        self._rejected = 0
        #: State before the present one, if the step between them may be extrapolated.
        self._before: AcceptedState | None = None
        #: Smallest det F of a state.
        self._det: tuple[AcceptedState, float] | None = None
        # A law of the speed becomes steeper in shorter steps; fields named in needs_time do not.
        rates = (s for s in surfaces if not s.law.needs_time)
        #: Names of the surfaces whose law may depend on the speed.
        self._of_speed = [s.name for s in rates if s.law_at_points.compiled.needs_time(1.0)]
        #: Tables of these surfaces at the ends of the last steps of the run.
        self._tables: deque[dict[str, ContactTable]] = deque(maxlen=4)

    def where(self, step: EvolutionStep) -> str:
        return (
            f"time {step.time:.6g} of {self.task.times[-1]:.6g}  step {step.number}, of "
            f"{step.time - step.start:.2g}"
        )

    def part(self, step: EvolutionStep) -> float | None:
        start = self.start.accepted.time
        return (step.time - start) / (self.task.times[-1] - start)

    def require_continuation(self, history: History) -> None:
        if self.stuck is not None and self.task.at_jump != "stop":
            raise NoContinuation(history.reason, history)

    # -- the steps -------------------------------------------------------------------------------

    def steps(self) -> Iterator[EvolutionStep]:
        for end in self.task.times:
            while self.state.accepted.time < end:
                yield from self._towards(end)
        if self.state.ending is None:
            self.end(Ending.REACHED, _REACHED)

    def _towards(self, end: float) -> Iterator[EvolutionStep]:
        """Try a step towards a time; yield the accepted steps, or prepare a shorter step."""
        task = self.task
        start = self.state.accepted
        goal = _aim(start.time, end, self.state.length)
        length = goal - start.time
        trial = self._trial(goal, end)
        # solve, or shorten the step, or step beyond a jump
        try:
            after = self._take(goal, trial)
        except ConvergenceError as error:
            shorter = length / (2 if trial.brief else 4)
            if task.halve and shorter >= task.shortest:
                self._report_halving(length)
                self._retry(shorter)
                return
            beyond = self._beyond(goal)
            if beyond is None:
                raise Ended(Ending.NOT_SOLVED, self._not_solved(length, error)) from error
            yield self._accept(beyond, jump=self._slow_rates(beyond) is not None)
            return
        # accept the step, or the steps around a jump in it
        found = self._search(after)
        if found is not None:
            for state in found.steps:
                settled = found.far is None and state is found.steps[-1]
                yield self._accept(state, settled=settled)
            if found.far is not None:
                if task.at_jump != "jump":
                    raise self._end_before(found, found.far) from found.failure
                yield self._accept(found.far, jump=True)
        elif task.locate and length / 2 >= task.shortest and self._closes(after):
            self._retry(length / 2)
        else:
            yield self._accept(after)

    def _report_halving(self, length: float) -> None:
        """Log a warning, once per run, that steps are shortened, unless the user requested this."""
        if self._reports_halving and self._comm.rank == 0:
            logger.warning(
                "step %d of the %s, from the time %.10g and of length %.3g, was not solved: it is "
                "tried again with shorter steps, down to %.3g; later steps are not reported",
                self.state.number + 1,
                self.what,
                self.state.accepted.time,
                length,
                self.task.shortest,
            )
        self._reports_halving = False

    def _retry(self, length: float) -> None:
        """Prepare to repeat the step from the same state with a shorter length."""
        self.state = replace(self.state, length=length)
        self._rejected += 1

    def _accept(
        self, after: AcceptedState, *, jump: bool = False, settled: bool = True
    ) -> EvolutionStep:
        """Accept the end of a step; return the record of the step for the history. Collective.

        Args:
            after: state at the end of the step.
            jump: whether the state jumps in the step.
            settled: see `RunState`.
        """
        before = self.state.accepted
        change = changes(self._comm, before, after)
        step = self._step(after, change, jump)
        self._before = None if jump or not before.solved else before
        self._rejected = 0
        self.state = RunState(
            after,
            min(2 * self.state.length, self.task.longest),
            step.number,
            settled,
            rate=self.state.rate if jump else change.rates(after.time - before.time),
        )
        self._end_if_reached()
        return step

    def _end_if_reached(self) -> None:
        """End the run if the accepted state is at its last time."""
        if self.state.accepted.time >= self.task.times[-1]:
            self.end(Ending.REACHED, _REACHED)

    def _step(self, after: AcceptedState, change: StateChanges, jump: bool) -> EvolutionStep:
        """Return the record of a step from the accepted state to another state."""
        start = self.state.accepted.time
        end = after.time
        shorter = end - start < (1 - _ROUND_OFF) * self.task.requested(end)
        return EvolutionStep(
            self.state.number + 1,
            start,
            end,
            self._with_indicators(after, change),
            after.energies,
            self._rejected,
            jump,
            after.directions,
            inserted=shorter and end not in self.task.times,
            state=after.state,
        )

    def _with_indicators(self, after: AcceptedState, change: StateChanges) -> Result:
        """Return the result of a step with indicators of jumps and of alternating friction."""
        before = self.state.accepted
        result = after.result
        assert result is not None
        self._tables.append({name: result.tables[name] for name in self._of_speed})
        if not (isinstance(before.forces, Forces) and before.solved) or self.state.rate is None:
            return result
        rate = change.unknowns / (after.time - before.time)
        last = float(self.state.rate[UNKNOWNS])
        indicators = StepIndicators(
            self.state.number + 1,
            before.time,
            after.time,
            rate / last if last > 0 else (math.inf if rate > 0 else 0.0),
            after.energies.residue_since(before.energies),
            searched=self.task.locate_jumps,
            timed=bool(self._of_speed),
            alternation=max(
                (alternation([t[name] for t in self._tables]) for name in self._of_speed),
                default=0.0,
            ),
        )
        return replace(result, indicators=replace(result.indicators, step=indicators))

    # -- one step --------------------------------------------------------------------------------

    def _trial(self, goal: float, end: float) -> Trial:
        """Return the solver strategies for a step to ``goal`` on the way to the time ``end``."""
        if not self._slides:
            return Trial()
        task = self.task
        start = self.state.accepted
        whole = end - task.times[max(bisect.bisect_left(task.times, end) - 1, 0)]
        least = max(min(whole, task.longest) / _PARTS, task.shortest)
        half = (goal - start.time) / 2
        brief = task.halve and half >= least * (1 - _ROUND_OFF)
        extrapolated = None
        if task.extrapolate and self._before is not None:
            part = (goal - start.time) / (start.time - self._before.time)
            extrapolated = start.unknowns + part * (start.unknowns - self._before.unknowns)
        return Trial(extrapolated=extrapolated, brief=brief)

    def _take(self, time: float, trial: Trial) -> AcceptedState:
        """Step from the accepted state to a time. Collective.

        Raises:
            ConvergenceError: if no strategy solves the step, or its end is a folded state.
        """
        start = self.state.accepted
        after: AcceptedState | None = None
        rays: Sequence[Statuses] | None = None
        try:
            after = self._stepper.take(start, time, trial=trial)
        except ConvergenceError:
            rays = None if trial.brief else self._rays(start, time)
            for statuses in rays or ():
                if self._same(start.statuses, statuses):
                    continue  # these statuses have been tried
                try:
                    after = self._stepper.take(start, time, likely=(statuses,))
                    break
                except ConvergenceError:
                    continue
            if after is None:
                raise
        else:
            every = self.task.rays
            if every or (every is None and not self._same(start.statuses, after.statuses)):
                rays = self._rays(start, time)
        self._require_unfolded(after)
        return after if rays is None else replace(after, directions=len(rays))

    def _rays(self, start: AcceptedState, time: float) -> Sequence[Statuses] | None:
        """Return the statuses with which the state can continue; None if they are not computed."""
        if not (self.task.rays or self._rays_are_cheap) or start.statuses is None:
            return None
        found = rays_of_step(self._stepper.begin(start, time))
        return None if found is None else found.rays

    def _same(self, a: Statuses | None, b: Statuses | None) -> bool:
        """Return whether statuses are equal on all ranks, or one of them is unknown. Collective."""
        if a is None or b is None:
            return True
        return not any_rank(self._comm, any(d.any() for d in differs(a, b)))

    def _require_unfolded(self, after: AcceptedState) -> None:
        """Raise `ConvergenceError` if the deformation becomes folded in a step. Collective.

        This is the case if the smallest determinant of the deformation gradient falls suddenly.
        """
        start = self.state.accepted
        if not self._slides or self._stepper.problem.equations.bulk.linear or not start.solved:
            return
        state, before = self._det or (None, 0.0)
        if state is not start:
            before = self._smallest_det(start)
        smallest = self._smallest_det(after)
        if before > 0 and not smallest >= _FOLDS * min(before, 1.0):  # NaN counts as folded
            raise ConvergenceError(
                f"the smallest det F falls from {before:.3g} to {smallest:.3g} in one step: the "
                "solution is folded and does not continue the state"
            )
        self._det = after, smallest

    def _smallest_det(self, accepted: AcceptedState) -> float:
        """Return the smallest determinant of the deformation gradient F at a state. Collective."""
        eq = self._stepper.problem.equations
        u = accepted.state.displacement
        return smallest_jacobian(eq.V, u, vertices=False, axisymmetric=eq.axisymmetric)[0]

    def _closes(self, after: AcceptedState) -> bool:
        """Return whether a contact point closes in a step. Collective."""
        pairs = zip(self.state.accepted.state.statuses, after.state.statuses, strict=True)
        here = any((closed(new) & ~closed(old)).any() for old, new in pairs)
        return any_rank(self._comm, here)

    # -- jumps -----------------------------------------------------------------------------------

    def _search(self, after: AcceptedState) -> Found | None:
        """Search a step for a jump if the state changes suddenly in it; None without a jump.

        Collective.
        """
        before = self.state.accepted
        if not self.task.locate_jumps or not before.solved:
            return None
        slow = self._slow_rates(after)
        if slow is None:
            return None
        return find_jump(self._stepper, before, after, slow, self.task.shortest)

    def _slow_rates(self, after: AcceptedState) -> Array | None:
        """Return the rates of change up to which the state is assumed not to jump. Collective.

        They refer to `StateChanges.parts`. None if the state does not change suddenly in the step.

        Args:
            after: end of the step from the accepted state.
        """
        before = self.state.accepted
        change = changes(self._comm, before, after)
        n = len(change.largest)
        means = slice(2, 2 + n)
        bonds = slice(2 + n, 2 + 2 * n)
        largest = slice(2 + 2 * n, None)
        rate = change.rates(after.time - before.time)
        slow = np.zeros_like(rate)
        if self.state.rate is not None:
            slow = _SUDDEN * self.state.rate
            for points in (means, largest):
                slow[points] = np.maximum(slow[points], _SLIPS * self.state.rate[MOVED])
        fast = rate > slow
        fast[MOVED] = False  # the largest displacement is the scale of the other rates
        fast[bonds] = change.broken > _BREAKS
        if not fast.any():
            return None
        # If only single points or bonds are fast, every change counts as fast: a point hardly
        # changes a mean. A breaking bond has no typical rate.
        parts = slow[: 2 + 2 * n] if fast[: 2 + n].any() else np.zeros(2 + 2 * n)
        parts[MOVED] = math.inf
        parts[bonds] = 0.0
        return np.asarray(parts)

    def _end_before(self, found: Found, far: AcceptedState) -> Ended:
        """Return the exception that ends a run before a jump.

        Args:
            found: result of the search.
            far: state beyond the jump.
        """
        a = self.state.accepted.time
        b = far.time
        places = where_it_changes(self._stepper, self.state.accepted, far)
        if found.proved:
            return Ended(
                Ending.NO_SOLUTION,
                f"no solution continues the evolution in the step from {a:.10g} to {b:.10g}, where "
                f"{found.why}; at its end there is another solution, {places}",
            )
        if found.failure is not None:
            return Ended(
                Ending.NOT_SOLVED,
                f"no step that continues the evolution beyond the time {a:.10g} was solved, down "
                f"to the length {self.task.shortest:.2g}; in a more distant solution, at {b:.10g}, "
                f"{places}. Whether a solution continues the evolution is not decided: "
                f"{found.failure}",
            )
        return Ended(
            Ending.NOT_FOUND,
            f"no solution beyond the time {a:.10g} was found that continues the evolution, in a "
            f"step of {b - a:.2g}; at its end there is another solution, {places}. Whether a "
            f"solution continues the evolution is not decided: {found.why}",
        )

    def _not_solved(self, length: float, error: ConvergenceError) -> str:
        """Describe why a run ends at a step that was not solved."""
        advice = "" if self.task.halve else _HALVE
        if self._of_speed:
            advice = _LONGER
        # the reason and the remedy before the list of attempts
        reason, *details = str(error).splitlines()
        return "\n".join(
            [
                f"no solution was found beyond the time {self.state.accepted.time:.10g}, in a step "
                f"of {length:.2g}: {reason.rstrip('.:')}{advice}",
                *details,
            ]
        )

    def _beyond(self, goal: float) -> AcceptedState | None:
        """Find a solution at a time at which a step was not solved, if the run may jump.

        Collective. A solution at a later time is searched for, at increasing distances. The solver
        then starts from this solution, or from solutions in between, to solve for the given time.
        The result is None if this also fails, or if the run must not jump.
        """
        if self.task.at_jump != "jump":
            return None
        start = self.state.accepted
        last = self.task.times[-1]
        ahead = (start.time + (goal - start.time) * _FURTHER**k for k in range(1, _MOST_FURTHER))
        far: AcceptedState | None = None
        for time in [*(t for t in ahead if t < last), last]:
            try:
                far = self._stepper.take(start, time)
                break
            except ConvergenceError:
                continue
        while far is not None:
            from_far: dict[str, Any] = {"likely": (far.statuses,), "guess": far}
            try:
                return self._stepper.take(start, goal, **from_far)
            except ConvergenceError:
                between = start.time + (far.time - start.time) / _FURTHER
            if not goal < between < far.time:
                return None
            try:
                far = self._stepper.take(start, between, **from_far)
            except ConvergenceError:
                return None
        return None


class ToRest(ThroughTimes):
    """Rule of a motion that ends when the body is at rest, or at the last time."""

    def __init__(self, stepper: Stepper, task: HistoryTask, state: RunState):
        super().__init__(stepper, task, state)
        self._peak = 0.0  # largest kinetic energy
        self._quiet = 0  # number of slow steps
        self._awake = state.accepted.time  # time before these

    def _end_if_reached(self) -> None:
        accepted = self.state.accepted
        assert isinstance(accepted.energies, MotionEnergies)
        rest = self.task.rest
        kinetic = accepted.energies.kinetic
        self._peak = max(self._peak, kinetic)
        self._quiet += 1
        if kinetic > rest * self._peak:
            self._quiet = 0
            self._awake = accepted.time
        duration = accepted.time - self.task.times[0]
        turning = _TURNING * math.sqrt(rest) * duration * (1 - _ROUND_OFF)
        if self._quiet >= _QUIET and accepted.time - self._awake >= turning:
            self.end(Ending.REACHED, "the body is at rest")
        elif accepted.time >= self.task.times[-1]:
            self.end(Ending.BUDGET, f"not at rest after {duration:.6g}")


def _aim(start: float, end: float, length: float) -> float:
    """Return the end of the first of equal steps from ``start`` to ``end``.

    Their number is the smallest for which they are at most ``length`` long.
    """
    steps = math.ceil((end - start) / length * (1 - 1e-12))
    return end if steps <= 1 else start + (end - start) / steps
