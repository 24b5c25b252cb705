# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions that continue until the body is at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.evolution.motion_energy import MotionEnergies
from dolfinx_contact.evolution.run import RunState
from dolfinx_contact.evolution.step import SolvedStep, Stepper
from dolfinx_contact.evolution.through_times import HistoryTask, ThroughTimes

__all__ = ["RestState", "RestTask", "ToRest"]

_TURNING = 4.0  # sqrt(rest) of the way there: twice as long as one that turns back is slow
_QUIET = 10  # steps in which a body at rest does not move


@dataclass(frozen=True)
class RestTask(HistoryTask):
    """The task of a run to rest, by steps of the longest length; see `NSCD.settle`.

    The only one of its times is that of the start.
    """

    max_time: float = math.inf
    rest: float = 0.0


@dataclass(frozen=True, eq=False)
class RestState(RunState):
    """All that the next step of a run to rest depends on.

    Attributes:
        peak: largest kinetic energy at the end of a step so far.
        quiet: number of the last steps at whose ends the kinetic energy was small.
    """

    peak: float = 0.0
    quiet: int = 0


class ToRest(ThroughTimes):
    """Continues by equal steps until the kinetic energy has been small for long enough.

    Args:
        stepper: stepper of the motion.
        task: task of the run.
        run_state: state of the run where it starts or continues.
    """

    task: RestTask

    def __init__(self, stepper: Stepper, task: RestTask, run_state: RunState):
        super().__init__(stepper, task, run_state)
        self._peak = run_state.peak if isinstance(run_state, RestState) else 0.0
        self._quiet = run_state.quiet if isinstance(run_state, RestState) else 0
        self._goal = run_state.accepted.time

    @property
    def run_state(self) -> RestState:
        return RestState(**vars(super().run_state), peak=self._peak, quiet=self._quiet)

    def where(self, step: EvolutionStep) -> str:
        end = self.task.times[0] + self.task.max_time
        return f"time {step.time:.6g}, at most {end:.6g}  step {step.number}"

    def part(self, step: EvolutionStep) -> None:
        return None  # it may be at rest at any time

    def _goals(self) -> Iterator[float]:
        """Ends of steps of the longest length, one after the other."""
        while self.ending is None:
            self._length = self.task.longest
            self._goal = self._accepted.time + self.task.longest
            yield self._goal

    def _end_if_reached(self, solved: SolvedStep) -> None:
        """End the run if the body is at rest at the end of a step, or the time is over."""
        if solved.after.time < self._goal:
            return
        energies = solved.after.energies
        assert isinstance(energies, MotionEnergies)
        self._peak = max(self._peak, energies.kinetic)
        self._quiet = self._quiet + 1 if energies.kinetic <= self.task.rest * self._peak else 0
        start = self.task.times[0]
        passed = solved.after.time - start
        turning = _TURNING * math.sqrt(self.task.rest) * passed
        if self._quiet >= _QUIET and self._quiet * self.task.longest >= turning:
            self.end(Ending.REACHED, "the body is at rest")
        elif not solved.after.time < start + self.task.max_time:
            self.end(Ending.BUDGET, f"not at rest after {passed:.6g}")
