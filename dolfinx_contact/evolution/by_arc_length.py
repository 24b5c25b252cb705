# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The rule of a path: from one accepted point to the next, by arc length.

From the accepted point y_n with memory m_n, in the piece and along the tangent t_n:

1. `ArcSteps.arrive` solves H(y_n+1; m_n) = 0 at arc length h or at an event before it,
2. the memory is accepted: m_n+1 = A(y_n+1; m_n), and the energies are advanced,
3. the rate problem at y_n+1 with m_n+1 gives the piece and the tangent t_n+1 of the next step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dolfinx_contact.continuation.branch import BranchPoint, FoundRays, Ray
from dolfinx_contact.continuation.ending import OTHER_CAUSE, Ending
from dolfinx_contact.continuation.walk import require_way
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.evolution.arc_steps import ArcSteps, Arrival
from dolfinx_contact.evolution.energy import Forces, forces_at
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.evolution.path import PathEvent, PathState, PathStep, PathStepper, PathTask
from dolfinx_contact.evolution.run import Rule
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.tables import violation

__all__ = ["ByArcLength"]

_VIOLATION = 1e-6  # largest relative violation of the contact law at an accepted point
_IDLE = 1e-6  # mean arc length of steps that make no progress
_PATIENCE = 10  # number of such steps, in addition to two for each contact point


class ByArcLength(Rule[PathTask, PathState]):
    """Rule of a path: the next point is at a given arc length; its load is unknown beforehand.

    Args:
        system: contact problem with its load parameter.
        stepper: stepper of the problem.
        steps: steps by arc length.
        task: task of the run.
        run_state: state of the run where it starts or continues.
    """

    what = "path"
    units = "points"

    def __init__(
        self,
        system: ParametricContact,
        stepper: PathStepper,
        steps: ArcSteps,
        task: PathTask,
        run_state: PathState,
    ):
        super().__init__(task, run_state)
        self._system = system
        self._stepper = stepper
        self._steps = steps
        self._state = run_state
        #: Last point with the piece and tangent of the next step; None without a continuation.
        self._leaves: BranchPoint | None = None
        surfaces = stepper.problem.surfaces
        self._weak = any(s.points.E is not None for s in surfaces)
        points = system.comm.allreduce(sum(s.points.number for s in surfaces))
        self._patience = 2 * points + _PATIENCE
        self._use_memory(run_state.accepted.memory)
        steps.restore(run_state.known)

    @property
    def run_state(self) -> PathState:
        known = self._steps.known
        return replace(self._state, known=known, ending=self.ending, reason=self.reason)

    def where(self, step: EvolutionStep) -> str:
        assert isinstance(step, PathStep)
        low, high = self.task.gamma_range
        return (
            f"gamma {step.gamma:.6g} in [{low:.6g}, {high:.6g}]  point {step.number}  {step.event}"
        )

    def _use_memory(self, memory: Sequence[Memory | None]) -> None:
        """Continue with the memory of an accepted state. Collective."""
        self._system = self._system.with_memory(memory)
        self._steps.bordered.system = self._system

    # -- the start -------------------------------------------------------------------------------

    def begin(self) -> None:
        """Find the direction in which the path leaves the state in the problem. Collective.

        Raises:
            ValueError: on every rank, if the start of a path is not a solution, or the load leaves
                its range immediately.
        """
        if self.ending is not None:
            return
        steps = self._steps
        task = self.task
        is_new_run = len(self._state.passed) == 1
        if self._state.arrived is None:
            point = self._start_point(1.0 if task.direction == "increasing" else -1.0)
            rates = steps.rate_problem(point.y, point.piece)
            directions = rates.from_start(point.piece, point.tangent)
        else:
            point = self._state.arrived
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
            require_way(steps.bordered, self._leaves, task.gamma_range)

    def _start_point(self, sense: float) -> BranchPoint:
        """Return the point of the start, whose tangent is the rate of the load.

        Args:
            sense: 1 for an increasing load, -1 for a decreasing one.
        """
        b = self._steps.bordered
        problem = self._stepper.problem
        gamma = self._state.gamma
        statuses = self._state.accepted.statuses
        x = problem.create_vector()
        problem.write(x)
        y = b.vector()
        b.join(x, gamma, y)
        system = self._system
        piece = system.piece_at(x, gamma) if statuses is None else system.piece(statuses)
        x.destroy()
        if not self._steps.corrector.natural(y, gamma, piece):
            raise ValueError(f"the start is not a solution at gamma = {gamma:g}; solve() first")
        t = b.last_unit()
        t.scale(sense * b.gamma_scale)
        return BranchPoint(y, t, piece, b.gamma(y), 0.0, 0)

    # -- one step --------------------------------------------------------------------------------

    def steps(self) -> Iterator[EvolutionStep]:
        while len(self._state.passed) <= self.task.max_steps:
            step = self._step()
            if step is None:
                return
            yield step
        self.end(Ending.BUDGET, f"the budget of {self.task.max_steps} steps is exhausted")

    def _step(self) -> PathStep | None:
        """Take and accept a step; end the path and return None if that is impossible. Collective.

        The Functions receive the point.
        """
        # 1. solve
        solution = self._solve()
        if solution is None:
            return None
        arrival, result, evaluation = solution
        point = arrival.point
        # 2. accept the memory, account for the energies
        before = self._state.accepted
        law = self._system.problem
        forces = forces_at(law.equations, evaluation)
        friction = result.energies["friction"]
        assert isinstance(before.forces, Forces)
        energies = before.energies.advanced(before.forces, forces, friction)
        if not np.isfinite(energies.residue):
            self.end(
                Ending.NOT_SOLVED,
                f"beyond gamma = {before.gamma:.10g} a law gives a number that is not finite",
            )
            return None
        memory = law.equations.advanced(evaluation)
        time = before.time + point.step
        after = self._stepper.accept(law, evaluation.statuses, memory, time, energies, forces)
        self._state = PathState(
            after,
            arrival.next_h,
            number=self._state.number + 1,
            arrived=point,
            passed=(*self._state.passed, time),
        )
        self._use_memory(memory)
        # 3. find the next direction
        event, directions = self._continue_from(arrival)
        self._end_if_idle()
        number = len(directions.rays) if directions.complete else None
        method = directions.method
        if arrival.bifurcations:
            number, method = 1 + 2 * len(arrival.bifurcations), "a bifurcation of one piece"
        next_piece = point.piece if self._leaves is None else self._leaves.piece
        return PathStep(
            self._state.number,
            before.time,
            time,
            result,
            energies,
            gamma=point.gamma,
            event=event,
            before=self._system.letters(point.piece),
            after=self._system.letters(next_piece),
            directions=number,
            method=method,
            corrections=point.corrections,
            state=after.state,
        )

    def _continue_from(self, arrival: Arrival) -> tuple[PathEvent, FoundRays[Ray]]:
        """Find the directions out of an accepted point and leave it. Collective.

        Returns:
            The event at the point and the directions; none at the end of the range of gamma.
        """
        if arrival.at == "end":
            self._leaves = None
            self.end(Ending.REACHED)
            return "", FoundRays((), False, "")
        point = arrival.point
        rates = self._steps.rate_problem(point.y, point.piece)
        directions = rates.onwards(point.piece, point.tangent, every=self.task.rays)
        self._leave(point, directions)
        return self._event(arrival), directions

    def _solve(self) -> tuple[Arrival, Result, Evaluation] | None:
        """Solve the next point on the piece of the last one; end the path if that fails.

        The Functions receive the point. If the assumption which bonds break turns out wrong, the
        contact law is violated, and a shorter step is tried. Collective.
        """
        assert self._leaves is not None
        system = self._system
        length = self._state.length
        while True:
            arrival = self._steps.arrive(self._leaves, length, self.task.gamma_range)
            if arrival is None:
                reason = (
                    f"no step of at least {self.task.control.minimum:g} succeeds beyond "
                    f"gamma = {self._leaves.gamma:.10g}{OTHER_CAUSE}"
                )
                self.end(Ending.NOT_SOLVED, reason)
                return None
            result = system.result_at(arrival.point)
            evaluation = system.problem.evaluate()
            if self._weak or self._violation(evaluation) <= _VIOLATION:
                return arrival, result, evaluation
            length = 0.5 * min(length, arrival.point.step)

    def _violation(self, evaluation: Evaluation) -> float:
        """Violation of the contact law relative to the largest forces so far. Collective."""
        force, length = self._system.scales
        return violation(self._system.equations, evaluation, force, length) if force > 0 else 0.0

    def _leave(self, point: BranchPoint, directions: FoundRays[Ray]) -> None:
        """Leave a point in the first direction; end the path if there is none. Collective."""
        self._leaves = None
        if directions.rays:
            self._leaves = self._steps.leave(point, directions.rays[0])
            return
        self.end(
            Ending.NOT_FOUND,
            f"no continuation was found from gamma = {point.gamma:.10g}, by {directions.method}; "
            "whether one exists is not decided",
        )

    def _event(self, arrival: Arrival) -> PathEvent:
        """Return the event at an accepted point. Collective."""
        if arrival.at == "fold":
            return "smooth fold"
        point = arrival.point
        leaves = self._leaves
        if leaves is None:
            return "kink"
        changed = bool(np.any(point.piece.codes != leaves.piece.codes))
        if not self._system.comm.allreduce(int(changed)):
            return ""
        return "nonsmooth fold" if self._steps.turned(point.tangent, leaves.tangent) else "kink"

    def _end_if_idle(self) -> None:
        """End the path if its last steps make no progress."""
        number = self._patience
        last = self._state.passed[-number - 1 :]
        if self.ending or len(last) <= number or last[-1] - last[0] > number * _IDLE:
            return
        self.end(
            Ending.NOT_FOUND,
            f"statuses change endlessly at gamma = {self._state.gamma:.10g}, where no step longer "
            f"than {_IDLE:g} succeeds",
        )
