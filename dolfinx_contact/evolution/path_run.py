# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run by arc length: from a point of the path, or from its midst, point by point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.accepted import Stepper, Taken
from dolfinx_contact.evolution.arc_steps import ArcSteps, Arrival
from dolfinx_contact.evolution.energy import forces_at
from dolfinx_contact.evolution.path import PathEvent, PathStep
from dolfinx_contact.evolution.path_state import PathState, PathTask
from dolfinx_contact.evolution.rate_problem import Directions
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.results.tables import violation

__all__ = ["PathRun"]

_VIOLATION = 1e-6  # of the law, beyond which a point was come to in the wrong statuses
_NOWHERE = 1e-6  # mean length of steps that lead nowhere
_PATIENT = 10  # such steps, and two for each contact point, are allowed


class PathRun(Ends):
    """A run: where it is, and how it goes on.

    Args:
        system: the contact problem and its load.
        stepper: of the problem.
        steps: of the run.
        task: what was asked.
        run_state: where it begins, or stood.

    Attributes:
        ending: how it ends; None while it goes on.
        reason: why, in words.
    """

    def __init__(
        self,
        system: ParametricContact,
        stepper: Stepper,
        steps: ArcSteps,
        task: PathTask,
        run_state: PathState,
    ):
        self._system = system
        self._stepper = stepper
        self._steps = steps
        self._task = task
        self._accepted = run_state.accepted
        self._arrived = run_state.arrived
        self._h = run_state.length
        self._number = run_state.number
        self._passed = run_state.passed
        self._gamma = run_state.gamma
        self.ending = run_state.ending
        self.reason = run_state.reason
        self._leaves: BranchPoint | None = None
        surfaces = stepper.problem.surfaces
        self._weak = any(s.points.E is not None for s in surfaces)
        points = system.comm.allreduce(sum(s.points.number for s in surfaces))
        self._patience = 2 * points + _PATIENT
        steps.know(run_state.known)

    @property
    def taken(self) -> int:
        """Number of the points that it has accepted."""
        return len(self._passed) - 1

    @property
    def run_state(self) -> PathState:
        """Where it stands."""
        return PathState(
            self._accepted,
            self._gamma,
            self._arrived,
            self._h,
            self._steps.known,
            self._number,
            self._passed,
            self.ending,
            self.reason,
        )

    def leave(self) -> None:
        """Find the way by which the path leaves the state that stands in the problem. Collective.

        Raises:
            ValueError: on every rank, if it is the start, and no solution.
        """
        steps = self._steps
        direction = self._task.direction
        if self._arrived is None:
            point = self._start(1.0 if direction == "increasing" else -1.0)
            ways = steps.rate_problem(point.y, point.piece).begun(point.piece, point.tangent)
            self._take(point, ways)
            return
        point = self._arrived
        if not self.taken:
            # The run has its own unit of gamma, and its own test for bifurcations.
            point = replace(point, tangent=point.tangent.copy(), tau=float("nan"))
            point = steps.rescaled(point)
        rates = steps.rate_problem(point.y, point.piece)
        if direction == "back" and not self.taken:
            ways = rates.back(point.piece, point.tangent)
        else:
            ways = rates.onwards(point.piece, point.tangent, every=self._task.rays)
        self._take(point, ways)

    def _start(self, sense: float) -> BranchPoint:
        """The point at the state of the start, with the rate of the load as its tangent."""
        b = self._steps.bordered
        problem = self._stepper.problem
        known = self._accepted.statuses
        y = b.vector()
        gamma = self._gamma
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

    def _take(self, point: BranchPoint, ways: Directions) -> None:
        self._leaves = None
        if ways.onwards is not None:
            self._leaves = self._steps.go_on(point, ways.onwards)
            return
        self.end(
            Ending.NOT_FOUND,
            f"no way on was found from gamma = {point.gamma:.10g}, by {ways.method}; "
            "whether there is one is not decided",
        )

    def step(self) -> tuple[PathStep, Taken] | None:
        """The next accepted point; None, with a reason, where there is none. Collective."""
        assert self._leaves is not None
        system = self._system
        while True:
            found = self._steps.arrive(self._leaves, self._h, self._task.gamma_range)
            if found is None:
                reason = (
                    f"no step of at least {self._steps.control.minimum:g} succeeds beyond "
                    f"gamma = {self._leaves.gamma:.10g}"
                )
                if system.kinks_in_gamma:
                    reason += f"; {system.kinks_in_gamma}"
                self.end(Ending.NOT_SOLVED, reason)
                return None
            before = self._accepted
            point = found.point
            result = system.result_at(point)
            state = self._stepper.problem.state()
            if self._weak or self._violation(state) <= _VIOLATION:
                break
            # Bonds were taken for damaging that are not, or the other way round, within the step.
            self._h = 0.5 * min(self._h, point.step)
        self._h = found.next_h
        eq = system.equations
        energies = before.energies.advanced(
            before.forces, forces := forces_at(eq, state), result.energies["friction"]
        )
        if not np.isfinite(energies.residue):
            where = f"beyond gamma = {self._gamma:.10g} a law gives a number that is not finite"
            self.end(Ending.NOT_SOLVED, where)
            return None
        self._accepted = self._stepper.accepted(
            before.time + point.step, state.statuses, eq.advanced(state), forces, energies
        )
        self._arrived = point
        self._gamma = point.gamma
        self._number = self._number + 1
        self._passed = (*self._passed, self._accepted.time)
        eq.remember(self._accepted.memory)
        ways = Directions(None)
        event: PathEvent = ""
        if found.at == "end":
            self.end(Ending.REACHED)
        else:
            rates = self._steps.rate_problem(point.y, point.piece)
            ways = rates.onwards(point.piece, point.tangent, every=self._task.rays)
            self._take(point, ways)
            event = self._event(found)
        letters = system.letters(point.piece)
        after = letters if self._leaves is None else system.letters(self._leaves.piece)
        step = PathStep(
            self._number,
            before.time,
            self._accepted.time,
            result,
            energies,
            gamma=point.gamma,
            event=event,
            before=letters,
            after=after,
            ways=1 + 2 * len(found.bifurcations) if found.bifurcations else ways.number,
            method="a bifurcation of one piece" if found.bifurcations else ways.method,
            corrections=point.corrections,
        )
        return step, Taken(before, self._accepted, result)

    def _violation(self, state: State) -> float:
        """Of the law, beside the largest forces on the path: one may pass where there are none."""
        eq = self._system.equations
        force, length = self._system.scales
        return violation(eq, state, force, length) if force > 0 else 0.0

    def _event(self, found: Arrival) -> PathEvent:
        """What happens at an accepted point."""
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

    def stuck(self) -> str:
        """Why the path gets nowhere; "" if it does."""
        number = self._patience
        last = self._passed[-self._patience - 1 :]
        if len(last) <= number or last[-1] - last[0] > number * _NOWHERE:
            return ""
        return (
            f"statuses change without end at gamma = {self._gamma:.10g}, where no step of more "
            f"than {_NOWHERE:g} succeeds"
        )
