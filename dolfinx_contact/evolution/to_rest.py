# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Motions that continue until the body is at rest.

The body is at rest once its kinetic energy E has satisfied

    E <= rest max E

at the ends of ten successive steps and for a time of 4 sqrt(rest) T, where T is the time since the
start. A body that reverses its velocity v after a time T, for example at the top of a throw, has
v = v_max t/T around that instant, and satisfies the inequality for 2 sqrt(rest) T only.
"""

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

__all__ = ["RestTask", "ToRest"]

_TURNING = 4.0  # multiple of sqrt(rest) T, twice the slow phase of a reversal
_QUIET = 10  # least number of steps at rest


@dataclass(frozen=True)
class RestTask(HistoryTask):
    """Task of a run to rest in steps of the longest length; its only time is the start.

    Attributes:
        max_time: upper bound of the duration.
        rest: fraction of the largest kinetic energy; see `NSCD.settle`.
    """

    max_time: float = math.inf
    rest: float = 0.0


class ToRest(ThroughTimes):
    """Rule of equal steps until the kinetic energy has been small for long enough.

    Args:
        stepper: stepper of the motion.
        task: task of the run.
        run_state: state of the run at its start.
    """

    task: RestTask

    def __init__(self, stepper: Stepper, task: RestTask, run_state: RunState):
        super().__init__(stepper, task, run_state)
        self._peak = 0.0
        self._quiet = 0
        self._goal = run_state.accepted.time

    def where(self, step: EvolutionStep) -> str:
        end = self.task.times[0] + self.task.max_time
        return f"time {step.time:.6g}, at most {end:.6g}  step {step.number}"

    def part(self, step: EvolutionStep) -> float | None:
        return None  # unknown: the body may come to rest at any time

    def _goals(self) -> Iterator[float]:
        """Ends of successive steps of the longest length."""
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
        duration = solved.after.time - self.task.times[0]
        turning = _TURNING * math.sqrt(self.task.rest) * duration
        if self._quiet >= _QUIET and self._quiet * self.task.longest >= turning:
            self.end(Ending.REACHED, "the body is at rest")
        elif not solved.after.time < self.task.times[0] + self.task.max_time:
            self.end(Ending.BUDGET, f"not at rest after {duration:.6g}")
