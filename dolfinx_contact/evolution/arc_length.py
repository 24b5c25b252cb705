# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Paths by arc length: a quasi-static evolution under a load that is unknown beforehand.

A state x_n under the load gamma_n has the memory m_n (slip, intensity of bonds). The next point
lies on the curve

    H(x, gamma; m_n) = 0,        <(x - x_n, gamma - gamma_n), t_n> = h,

at arc length h, where <., .> is the inner product of `continuation.bordered`, and t_n solves the
rate problem at x_n (`rate_problem`). The path is a quasi-static evolution in which the load, or
imposed displacement, rises and falls such that the state changes slowly, for example where a
structure snaps back. Friction opposes the slip increments, and damage is irreversible. The
constraint was introduced by Riks (Int. J. Solids Struct. 15, 1979); here it is used on the pieces
of H.

A step of the path has the three parts of a quasi-static step (`step`):

1. solve H(x_n+1, gamma_n+1; m_n) = 0 at arc length h or at an event before it (`arc_steps`),
2. account for the energies,
3. advance the memory from m_n to m_n+1.

Then the rule `ByArcLength` solves the rate problem at x_n+1 with m_n+1 for the piece and the
tangent t_n+1 of the next step. The arc length from the start of the path is stored as time; laws
must not depend on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from dolfinx_contact._ending import OTHER_CAUSE, Ending
from dolfinx_contact._mpi import Arguments, any_rank, collective, require
from dolfinx_contact._validate import instance
from dolfinx_contact.continuation.arguments import (
    check_rays,
    check_steps,
    checked_range,
    require_smooth,
    samples_of,
)
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import BranchPoint, FoundRays, Ray, SpecialPoint
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.continuation.system import ResidualScales
from dolfinx_contact.continuation.tracing import require_in_range
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.state import State
from dolfinx_contact.equations.validation import check_times
from dolfinx_contact.evolution.arc_steps import ArcSteps, Arrival
from dolfinx_contact.evolution.energy import Forces, forces_at
from dolfinx_contact.evolution.history import EvolutionStep, PathEvent, PathHistory, PathStep
from dolfinx_contact.evolution.run import Ended, Listeners, Rule, Runnable, RunState
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.tables import violation

__all__ = ["ArcLength", "PathDirection", "PathStepper", "PathTask"]

#: Direction in which a run leaves its start: increasing or decreasing load in a first run; onwards
#: or back in a later run.
PathDirection: TypeAlias = Literal["increasing", "decreasing", "onwards", "back"]

_LONGEST = 0.005  # default step length, relative to the range of gamma and the first tangent
_VIOLATION = 1e-6  # largest relative violation of the contact law at an accepted point
_IDLE = 1e-6  # mean arc length of steps that make no progress
_PATIENCE = 10  # number of such steps, in addition to two for each contact point


@dataclass(frozen=True)
class PathTask:
    """Arguments of `ArcLength.run` that determine the path, as attributes."""

    gamma_range: tuple[float, float]
    direction: PathDirection
    control: StepControl
    max_steps: int
    rays: bool


def _check_run(a: Arguments) -> None:
    """Check the arguments of `ArcLength.run` and insert defaults."""
    path: ArcLength = a.self
    gamma = path._gamma if a.start is None else getattr(a.start, "gamma", None)
    value = float(path.parametric.constant.value) if gamma is None else gamma
    a.gamma_range = checked_range(a.gamma_range, [value])
    check_steps(a.control, a.max_steps)
    check_rays(a.rays)
    a.rays = bool(a.rays)
    Listeners.of(a).check(path._record)
    a.control = a.control or StepControl(kinks="exact", initial=_LONGEST, maximum=_LONGEST)
    if a.control.kinks not in (None, "exact"):
        raise ValueError(f"a path with memory requires kinks='exact', got {a.control.kinks!r}")
    is_first = a.start is not None or path._run_state is None or path._run_state.arrived is None
    known = ("increasing", "decreasing") if is_first else ("onwards", "back")
    a.direction = a.direction or known[0]
    if a.direction not in known:
        run = "the first run" if is_first else "a later run"
        raise ValueError(f"the direction of {run} must be one of {known}: {a.direction!r}")


class ArcLength(Runnable[PathTask, PathHistory]):
    """Path of a contact problem with memory, under a load that is unknown beforehand.

    The first run starts from the state in the Functions of the problem, which must be a solution
    under the present value of the parameter, or from ``start=``. A later run starts where the
    previous one ended. Another evolution of the same problem requires ``start=``. The Functions and
    the parameter follow the accepted points. The state of each point is stored, for example in
    ``history.steps[-1].state``.

    Args:
        parametric: contact problem with its load or imposed displacement gamma.

    Attributes:
        parametric: parametric problem as given.
        problem: contact problem.

    Raises:
        ValueError: on every rank, if a law depends on time, on the length of a step or on the
            distance slipped, or if the bulk form has kinks in u.

    Example:
        ::

            path = ArcLength(ParametricContact(problem, lift, driven=[(top, as_vector((0, lift)))]))
            history = path.run(gamma_range=(0.0, 1.0))
            print([(p.gamma, p.event) for p in history.folds], history.reason)
            back = path.run(gamma_range=(0.0, 1.0), direction="back")
    """

    _advice = "change values of Constants and Functions, or make another ArcLength"
    _record = "a records.PathRecord"

    def __init__(self, parametric: ParametricContact):
        instance(parametric, "parametric", ParametricContact)
        self.parametric = parametric
        self.problem = parametric.problem
        self.driven = parametric._driven_expressions
        require_smooth(parametric)
        self._require_no_time()

    def _require_no_time(self) -> None:
        """Raise ``ValueError`` if a law depends on time or on the distance slipped. Collective."""
        check_times(self.problem.equations)
        for s in self.problem.surfaces:
            s.update_geometry()
            obstacle_to_path = _dependence(s)
            message = f"{s.name}: the law {s.law.name} {obstacle_to_path}"
            require(self.problem.comm, not obstacle_to_path, message)

    @collective(
        "a path by arc length",
        _check_run,
        local=("start",),
    )
    def run(
        self,
        *,
        gamma_range: tuple[float, float],
        start: State | None = None,
        direction: PathDirection | None = None,
        control: StepControl | None = None,
        max_steps: int = 1000,
        rays: bool | None = None,
        stop: Stop[PathStep] | None = None,
        observer: ObserverLike[PathStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> PathHistory:
        """Follow the path until the load reaches an end of its range. Collective.

        Args:
            gamma_range: range of the load, (lowest, highest).
            start: state at which the path starts, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``. Its load is its ``gamma``, or the present value of the
                parameter if it has none. Default: end of the previous run; in a first run the
                present Functions with virgin memory (no slip, intact bonds). Required in the first
                run if the problem has had another evolution.
            direction: direction in which the path leaves its start: in the first run
                ``"increasing"`` (default) or ``"decreasing"`` load; in a later run ``"onwards"``
                (default) or ``"back"``, in which the state unloads without recovery of slip and
                damage.
            control: lengths of steps, in units in which the first tangent and the range of gamma
                have length 1; default: up to 0.005. Longer steps may miss a fold at which many
                bonds break.
            max_steps: largest number of accepted points.
            rays: whether all solutions of the rate problem (outgoing directions) are computed and
                counted in `PathStep.directions`. True: at every kink and nonsmooth fold, from all
                combinations of statuses there, up to 256. False or None (default): only if no
                direction is found otherwise.
            stop: function that returns a reason to end the run, see `QuasiStatic.run`.
            observer: function or observer called with each accepted point, see `QuasiStatic.run`.
            record: record of the accepted points, such as `records.PathRecord`.
            progress: whether rank 0 shows the progress, see `QuasiStatic.run`.

        Returns:
            History with the accepted points and the reason why the path ended. A path never jumps:
            if no continuation is found, or no step is solved, it ends, and ``complete`` is False.

        Raises:
            ValueError: on every rank, if arguments are not admissible, a law depends on the time,
                the start is not a solution, or the load leaves its range immediately. Errors of
                ``stop`` and ``observer`` on one rank are raised on every rank.
            OSError: on every rank, if a point cannot be recorded.
        """
        assert control is not None
        assert direction is not None
        self._require_no_time()
        self.parametric.check_parameter(samples_of(*gamma_range))
        task = PathTask(gamma_range, direction, control, max_steps, bool(rays))
        return self._begin(task, Listeners(stop, observer, record, progress), start)

    @property
    def _gamma(self) -> float:
        """Load gamma at the last accepted state; before the first run, value of the parameter."""
        value = self.parametric.constant.value
        return float(value) if self._accepted is None else self._accepted.gamma

    def stepper(self, progress: bool | None) -> PathStepper:
        return PathStepper(self.parametric)

    def history(self, run_state: RunState) -> PathHistory:
        accepted = run_state.accepted
        return PathHistory(accepted.time, accepted.energies, gamma=accepted.gamma)

    def begun(self, task: PathTask, run_state: RunState) -> RunState:
        known = {
            "x_scale": run_state.known.get("x_scale", 0.0),
            "largest_distance": 0.0,
            "scales": run_state.known.get("scales", ()),
            "signs": (),
        }
        return replace(
            run_state,
            length=task.control.initial,
            known=known,
            passed=(run_state.accepted.time,),
            ending=None,
            reason="",
        )

    def _rule(self, stepper: Stepper, task: PathTask, run_state: RunState) -> ByArcLength:
        assert isinstance(stepper, PathStepper)
        return ByArcLength(stepper, task, run_state)

    def _accepted_start(
        self, stepper: Stepper, task: PathTask, start: State | None
    ) -> AcceptedState:
        if start is None and self._accepted is not None:
            return self._accepted
        return stepper.start(0.0, start)


class PathStepper(Stepper):
    """Stepper of a path, which takes the steps from one accepted state to the next.

    Args:
        given: contact problem with its load parameter gamma.

    Attributes:
        system: system H(x, gamma) = 0 with the memory of the last accepted state.
    """

    def __init__(self, given: ParametricContact):
        super().__init__(given.problem, lambda _: None, None)
        self._given = given
        self.system = given
        self._weak = self.problem.equations.is_weak

    def start(self, time: float, given: State | None = None) -> AcceptedState:
        accepted = super().start(time, given)
        if given is None or None in given.previous:
            return accepted
        # keep the statuses of the last step: at borders the state does not determine them
        return replace(accepted, statuses=given.statuses)

    def use_memory(self, steps: ArcSteps, memory: Sequence[Memory | None]) -> None:
        """Set the memory of an accepted state in the system and in the steps. Collective."""
        self.system = self.system.with_memory(memory)
        steps.bordered.system = self.system

    def take_along(
        self,
        steps: ArcSteps,
        leaves: BranchPoint,
        before: AcceptedState,
        h: float,
        gamma_range: tuple[float, float],
    ) -> tuple[AcceptedState, Arrival]:
        """Step along a path and write the end of the step into the Functions. Collective.

        Args:
            steps: solver of steps of given arc length; afterwards it has the memory of the end.
            leaves: accepted state as a branch point, with the statuses and the tangent of the step.
            before: accepted state at the start.
            h: largest arc length of the step.
            gamma_range: range of gamma.

        Raises:
            Ended: if no step succeeds, or a law returns a number that is not finite.
        """
        assert isinstance(before.forces, Forces)
        # 1. solve on the piece
        arrival, result, evaluation = self._solved(steps, leaves, h, gamma_range)
        # 2. account for the energies
        equations = self.system.equations
        forces = forces_at(equations, evaluation)
        energies = before.energies.advanced(before.forces, forces, result.energies["friction"])
        if not np.isfinite(energies.residue):
            raise Ended(
                Ending.NOT_SOLVED,
                f"beyond gamma = {before.gamma:.10g} a law returns a number that is not finite",
            )
        # 3. advance the memory
        memory = equations.memory_after(evaluation)
        after = self.accept(
            self.system.problem,
            evaluation.statuses,
            memory,
            before.time + arrival[0].step,
            energies,
            forces,
            result=result,
        )
        self.use_memory(steps, memory)
        return after, arrival

    def _solved(
        self, steps: ArcSteps, leaves: BranchPoint, h: float, gamma_range: tuple[float, float]
    ) -> tuple[Arrival, Result, Evaluation]:
        """Solve for the end of a step with fixed statuses; see `take_along`. Collective.

        The statuses imply which bonds break. If this is wrong, the solution violates the contact
        law, and a shorter step is tried.
        """
        while True:
            arrival = steps.arrive(leaves, h, gamma_range)
            if arrival is None:
                raise Ended(
                    Ending.NOT_SOLVED,
                    f"no step of at least {steps.control.minimum:g} succeeds beyond "
                    f"gamma = {leaves.gamma:.10g}{OTHER_CAUSE}",
                )
            result = self.system.collect(arrival[0])
            evaluation = self.system.problem.evaluate()
            scales = steps.corrector.scales
            if self._weak or self._violation(evaluation, scales) <= _VIOLATION:
                return arrival, result, evaluation
            h = 0.5 * min(h, arrival[0].step)

    def _violation(self, evaluation: Evaluation, scales: ResidualScales) -> float:
        """Return the violation of the contact law, relative to the largest forces so far."""
        force, length = scales
        return violation(self.system.equations, evaluation, force, length) if force > 0 else 0.0

    def _more(self) -> dict[str, Any]:
        return {"gamma": float(self._given.constant.value)}

    def _show_more(self, state: State) -> None:
        gamma = self._given.constant.value if state.gamma is None else state.gamma
        self._given._set(float(gamma))


class ByArcLength(Rule[PathTask]):
    """Rule of a path: the next point lies at a given arc length; its load is unknown beforehand.

    Args:
        stepper: stepper of the path.
        task: arguments of the run.
        state: state of the run where it starts or continues.
    """

    what = "path"
    units = "points"

    def __init__(self, stepper: PathStepper, task: PathTask, state: RunState):
        super().__init__(task, state)
        self._stepper = stepper
        low, high = task.gamma_range
        bordered = Bordered(stepper.system, gamma_scale=high - low)
        self._steps = ArcSteps(Corrector(bordered, task.control, chords=False))
        #: Last point with the piece and tangent of the next step; None without a continuation.
        self._leaves: BranchPoint | None = None
        points = sum(s.points.number for s in stepper.problem.surfaces)
        self._patience = 2 * stepper.problem.comm.allreduce(points) + _PATIENCE
        stepper.use_memory(self._steps, state.accepted.memory)
        self._steps.restore(state.known)

    def close(self) -> None:
        self._steps.bordered.destroy()

    def where(self, step: EvolutionStep) -> str:
        assert isinstance(step, PathStep)
        low, high = self.task.gamma_range
        return (
            f"gamma {step.gamma:.6g} in [{low:.6g}, {high:.6g}]  point {step.number}  {step.event}"
        )

    # -- the start -------------------------------------------------------------------------------

    def begin(self) -> None:
        """Find the direction in which the path leaves its start. Collective.

        Raises:
            ValueError: on every rank, if the start of a path is not a solution, or the load leaves
                its range immediately.
        """
        if self.state.ending is not None:
            return
        steps = self._steps
        task = self.task
        is_new_run = len(self.state.passed) == 1
        point = self.state.arrived
        if point is None:
            point = self._start_point(1.0 if task.direction == "increasing" else -1.0)
            rates = steps.rate_problem(point.y, point.piece)
            directions = rates.from_start(point.piece, point.tangent)
        else:
            if is_new_run:
                # a run has its own unit of gamma and its own test for bifurcations
                tangent = point.tangent.copy()
                point = steps.rescaled(replace(point, tangent=tangent, tau=float("nan")))
            rates = steps.rate_problem(point.y, point.piece)
            if is_new_run and task.direction == "back":
                directions = rates.back(point.piece, point.tangent)
            else:
                directions = rates.onwards(point.piece, point.tangent, every=task.rays)
        self._leave(point, directions)
        if self._leaves is not None:
            require_in_range(steps.bordered, self._leaves, task.gamma_range)

    def _start_point(self, sense: float) -> BranchPoint:
        """Return the start as a branch point, along whose tangent only the load changes.

        Args:
            sense: 1 for an increasing load, -1 for a decreasing one.
        """
        b = self._steps.bordered
        accepted = self.state.accepted
        gamma = accepted.gamma
        x = self._stepper.problem.create_vector()
        self._stepper.problem.write(x)
        y = b.joined(x, gamma)
        system = self._stepper.system
        statuses = accepted.statuses
        piece = system.piece_at(x, gamma) if statuses is None else system.piece(statuses)
        x.destroy()
        if not self._steps.corrector.natural(y, gamma, piece):
            raise ValueError(f"the start is not a solution at gamma = {gamma:g}; solve() first")
        t = b.last_unit()
        t.scale(sense * b.gamma_scale)
        return BranchPoint(y, t, piece, b.gamma(y), 0.0, 0)

    # -- one step --------------------------------------------------------------------------------

    def steps(self) -> Iterator[EvolutionStep]:
        while len(self.state.passed) <= self.task.max_steps:
            yield self._step()
        self.end(Ending.BUDGET, f"the budget of {self.task.max_steps} steps is exhausted")

    def _step(self) -> PathStep:
        """Take and accept a step, and write the point into the Functions. Collective."""
        assert self._leaves is not None
        before = self.state.accepted
        after, (point, special, next_h, at_end) = self._stepper.take_along(
            self._steps, self._leaves, before, self.state.length, self.task.gamma_range
        )
        number = self.state.number + 1
        passed = (*self.state.passed, after.time)
        self.state = RunState(after, next_h, number, arrived=point, passed=passed)
        event, directions, method = self._continue_from(point, special, at_end=at_end)
        self._end_if_idle()
        self.state = replace(self.state, known=self._steps.known)
        assert after.result is not None
        letters = self._stepper.system.letters
        return PathStep(
            number,
            before.time,
            after.time,
            after.result,
            after.energies,
            gamma=point.gamma,
            event=event,
            before=letters(point.piece),
            after=letters((self._leaves or point).piece),
            directions=directions,
            method=method,
            corrections=point.corrections,
            state=after.state,
        )

    def _continue_from(
        self, point: BranchPoint, special: Sequence[SpecialPoint], *, at_end: bool
    ) -> tuple[PathEvent, int | None, str]:
        """Choose the direction in which the path leaves a point, or end the path. Collective.

        Args:
            point: accepted point, with the piece and the tangent of the last step.
            special: folds and bifurcations within that step.
            at_end: whether the end of the range is reached.

        Returns:
            Event at the point; number of outgoing directions, None if unknown; and method by which
            they were found.
        """
        self._leaves = None
        event: PathEvent = ""
        number: int | None = None
        method = ""
        if at_end:
            self.end(Ending.REACHED)
        else:
            rates = self._steps.rate_problem(point.y, point.piece)
            directions = rates.onwards(point.piece, point.tangent, every=self.task.rays)
            self._leave(point, directions)
            is_fold = any(s.kind == "fold" for s in special)
            event = "smooth fold" if is_fold else self._event(point)
            number = len(directions.rays) if directions.complete else None
            method = directions.method
        bifurcations = sum(s.kind == "bifurcation" for s in special)
        if bifurcations:
            number, method = 1 + 2 * bifurcations, "a bifurcation of one piece"
        return event, number, method

    def _leave(self, point: BranchPoint, directions: FoundRays[Ray]) -> None:
        """Continue along the first outgoing direction; end the path without one. Collective."""
        self._leaves = None
        if directions.rays:
            self._leaves = self._steps.leave(point, directions.rays[0])
            return
        self.end(
            Ending.NOT_FOUND,
            f"no continuation was found from gamma = {point.gamma:.10g}, by {directions.method}; "
            "whether one exists is not decided",
        )

    def _event(self, point: BranchPoint) -> PathEvent:
        """Return the event at an accepted point (`PathStep.event`). Collective."""
        leaves = self._leaves
        if leaves is None:
            return "kink"
        changed = point.piece.codes != leaves.piece.codes
        if not any_rank(self._stepper.problem.comm, changed):
            return ""
        return "nonsmooth fold" if self._steps.turned(point.tangent, leaves.tangent) else "kink"

    def _end_if_idle(self) -> None:
        """End the path if it has hardly advanced over its last steps."""
        number = self._patience
        last = self.state.passed[-number - 1 :]
        if self.state.ending or len(last) <= number or last[-1] - last[0] > number * _IDLE:
            return
        self.end(
            Ending.NOT_FOUND,
            f"statuses change endlessly at gamma = {self.state.accepted.gamma:.10g}, where no step "
            f"longer than {_IDLE:g} succeeds",
        )


def _dependence(s: DiscreteSurface) -> str:
    """Return the reason why a path by arc length is impossible with the law of a surface.

    The reason is a predicate that follows the name of the law in a message; "" if there is none.
    """
    rates = [name for name in s.law.needs_time if np.any(s.points.data.fields[name] != 0)]
    if rates:
        return (
            f"answers to the time or length of a step, by its {' and '.join(rates)}; a path by arc "
            "length has no time: use QuasiStatic"
        )
    compiled = s.law_at_points.compiled
    if not s.law.needs_time and compiled.needs_time(0.0):
        return (
            "depends on the time of a step (a.step); a path by arc length has none: use QuasiStatic"
        )
    if compiled.knows_slip:
        return (
            "has friction that depends on the distance slipped (a.slid), of which a path by arc "
            "length has no memory"
        )
    return ""
