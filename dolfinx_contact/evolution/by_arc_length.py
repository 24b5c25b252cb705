# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs by arc length, from one accepted point to the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.walk import require_way
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.evolution.arc_steps import ArcSteps, Arrival
from dolfinx_contact.evolution.energy import Energies, Forces, forces_at
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.evolution.path import PathEvent, PathStep
from dolfinx_contact.evolution.path_state import PathState, PathTask
from dolfinx_contact.evolution.path_stepper import PathStepper
from dolfinx_contact.evolution.rate_problem import Directions
from dolfinx_contact.evolution.run import Rule
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.tables import violation

__all__ = ["ByArcLength"]

_VIOLATION = 1e-6  # of the law, beyond which a point was come to in the wrong statuses
_NOWHERE = 1e-6  # mean length of steps that lead nowhere
_PATIENT = 10  # such steps, and two for each contact point, are allowed


@dataclass(frozen=True, eq=False)
class _Solved:
    """A solved point with its result, evaluation, forces and energies."""

    arrival: Arrival
    result: Result
    state: Evaluation
    forces: Forces
    energies: Energies


class ByArcLength(Rule[PathTask, PathState]):
    """A path: the next point is at a given arc length from the last, under a load that is found.

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
        self._accepted = run_state.accepted
        self._arrived = run_state.arrived
        self._length = run_state.length
        self._number = run_state.number
        self._passed = run_state.passed
        self._leaves: BranchPoint | None = None
        surfaces = stepper.problem.surfaces
        self._weak = any(s.points.E is not None for s in surfaces)
        points = system.comm.allreduce(sum(s.points.number for s in surfaces))
        self._patience = 2 * points + _PATIENT
        self._under(run_state.accepted.memory)
        steps.know(run_state.known)

    def _under(self, memory: Sequence[Memory | None]) -> None:
        """Continue with the memory of an accepted state. Collective."""
        self._system = self._system.with_memory(memory)
        self._steps.bordered.system = self._system

    @property
    def run_state(self) -> PathState:
        return PathState(
            self._accepted,
            self._length,
            number=self._number,
            ending=self.ending,
            reason=self.reason,
            arrived=self._arrived,
            known=self._steps.known,
            passed=self._passed,
        )

    def steps(self) -> Iterator[EvolutionStep]:
        while self.accepted_points < self.task.max_steps:
            solved = self._next()
            if solved is None:
                return
            yield self._accept(solved)
        self.end(Ending.BUDGET, f"the budget of {self.task.max_steps} steps is exhausted")

    @property
    def accepted_points(self) -> int:
        """Number of the points that it has accepted."""
        return len(self._passed) - 1

    def where(self, step: EvolutionStep) -> str:
        assert isinstance(step, PathStep)
        low, high = self.task.gamma_range
        return (
            f"gamma {step.gamma:.6g} in [{low:.6g}, {high:.6g}]  point {step.number}  {step.event}"
        )

    def begin(self) -> None:
        """Find the direction in which the path leaves the state in the problem. Collective.

        Raises:
            ValueError: on every rank, if it is the start, and no solution, or the load leaves its
                range at once.
        """
        if self.ending is not None:
            return
        steps = self._steps
        direction = self.task.direction
        if self._arrived is None:
            point = self._first(1.0 if direction == "increasing" else -1.0)
            directions = steps.rate_problem(point.y, point.piece).begun(point.piece, point.tangent)
            self._take(point, directions)
            self._require_way()
            return
        point = self._arrived
        if not self.accepted_points:
            # The run has its own unit of gamma, and its own test for bifurcations.
            point = replace(point, tangent=point.tangent.copy(), tau=float("nan"))
            point = steps.rescaled(point)
        rates = steps.rate_problem(point.y, point.piece)
        if direction == "back" and not self.accepted_points:
            directions = rates.back(point.piece, point.tangent)
        else:
            directions = rates.onwards(point.piece, point.tangent, every=self.task.rays)
        self._take(point, directions)
        self._require_way()

    def _require_way(self) -> None:
        """Raise ``ValueError`` if the load leaves its range at once. Collective."""
        if self._leaves is not None:
            require_way(self._steps.bordered, self._leaves, self.task.gamma_range)

    def _first(self, sense: float) -> BranchPoint:
        """The point at the state of the start, with the rate of the load as its tangent."""
        b = self._steps.bordered
        problem = self._stepper.problem
        known = self._accepted.statuses
        y = b.vector()
        gamma = self._accepted.gamma
        x = problem.create_vector()
        problem.write(x)
        b.join(x, gamma, y)
        piece = self._system.piece_at(x, gamma) if known is None else self._system.piece(known)
        x.destroy()
        if not self._steps.corrector.natural(y, gamma, piece):
            raise ValueError(f"the start is no solution at gamma = {gamma:g}; solve() first")
        t = b.last_unit()
        t.scale(sense * b.gamma_scale)
        return BranchPoint(y, t, piece, b.gamma(y), 0.0, 0)

    def _take(self, point: BranchPoint, directions: Directions) -> None:
        self._leaves = None
        if directions.onwards is not None:
            self._leaves = self._steps.go_on(point, directions.onwards)
            return
        self.end(
            Ending.NOT_FOUND,
            f"no way on was found from gamma = {point.gamma:.10g}, by {directions.method}; "
            "whether there is one is not decided",
        )

    def _next(self) -> _Solved | None:
        """The next point, in the statuses of its state; None, with a reason, if there is none."""
        assert self._leaves is not None
        system = self._system
        while True:
            found = self._steps.arrive(self._leaves, self._length, self.task.gamma_range)
            if found is None:
                reason = (
                    f"no step of at least {self._steps.control.minimum:g} succeeds beyond "
                    f"gamma = {self._leaves.gamma:.10g}"
                )
                if system.kinks_in_gamma:
                    reason += f"; {system.kinks_in_gamma}"
                self.end(Ending.NOT_SOLVED, reason)
                return None
            result = system.result_at(found.point)
            state = system.problem.evaluate()
            if self._weak or self._violation(state) <= _VIOLATION:
                break
            # Within the step bonds counted as damaging that are not, or the other way round.
            self._length = 0.5 * min(self._length, found.point.step)
        forces = forces_at(system.equations, state)
        before = self._accepted
        energies = before.energies.advanced(before.forces, forces, result.energies["friction"])
        if not np.isfinite(energies.residue):
            where = f"beyond gamma = {before.gamma:.10g} a law gives a number that is not finite"
            self.end(Ending.NOT_SOLVED, where)
            return None
        return _Solved(found, result, state, forces, energies)

    def _accept(self, solved: _Solved) -> PathStep:
        """Accept a point, with the memory of which the path continues. Collective."""
        before = self._accepted
        found = solved.arrival
        point = found.point
        law = self._system.problem
        after = self._stepper.at_rest(
            law,
            solved.state,
            law.equations.advanced(solved.state),
            before.time + point.step,
            solved.energies,
            solved.forces,
        )
        self._accepted = after
        self._length = found.next_h
        self._arrived = point
        self._number = self._number + 1
        self._passed = (*self._passed, after.time)
        self._under(after.memory)
        system = self._system
        directions = Directions(None)
        event: PathEvent = ""
        if found.at == "end":
            self.end(Ending.REACHED)
        else:
            rates = self._steps.rate_problem(point.y, point.piece)
            directions = rates.onwards(point.piece, point.tangent, every=self.task.rays)
            self._take(point, directions)
            event = self._event(found)
        self._end_if_stuck()
        letters = system.letters(point.piece)
        return PathStep(
            self._number,
            before.time,
            after.time,
            solved.result,
            solved.energies,
            gamma=point.gamma,
            event=event,
            before=letters,
            after=letters if self._leaves is None else system.letters(self._leaves.piece),
            directions=1 + 2 * len(found.bifurcations) if found.bifurcations else directions.number,
            method="a bifurcation of one piece" if found.bifurcations else directions.method,
            corrections=point.corrections,
            state=after.state,
        )

    def _violation(self, state: Evaluation) -> float:
        """Violation of the law relative to the largest forces on the path so far. Collective."""
        eq = self._system.equations
        force, length = self._system.scales
        return violation(eq, state, force, length) if force > 0 else 0.0

    def _event(self, found: Arrival) -> PathEvent:
        """The event at an accepted point."""
        if found.at == "fold":
            return "smooth fold"
        a = found.point
        b = self._leaves
        if b is None:
            return "kink"
        comm = self._system.comm
        if not comm.allreduce(int(np.any(a.piece.codes != b.piece.codes))):
            return ""
        return "nonsmooth fold" if self._steps.turned(a.tangent, b.tangent) else "kink"

    def _end_if_stuck(self) -> None:
        """End the path if it gets nowhere."""
        number = self._patience
        last = self._passed[-self._patience - 1 :]
        if self.ending or len(last) <= number or last[-1] - last[0] > number * _NOWHERE:
            return
        self.end(
            Ending.NOT_FOUND,
            f"statuses change without end at gamma = {self._accepted.gamma:.10g}, where no step of "
            f"more than {_NOWHERE:g} succeeds",
        )
