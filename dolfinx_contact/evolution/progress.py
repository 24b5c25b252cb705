# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an evolution says while it runs, on rank 0."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence

from mpi4py import MPI

from dolfinx_contact._progress import Line
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.path import PathHistory, PathStep

__all__ = ["HistoryProgress", "PathProgress"]

_PATIENCE = 3.0  # seconds before progress is said by itself


class HistoryProgress:
    """The line of progress: time, step, statuses, and the time that is left by the clock."""

    def __init__(self, comm: MPI.Comm, wanted: bool | None, times: Sequence[float]):
        self._line = Line(comm)
        self._start = clock.monotonic()
        self._span = (times[0], times[-1])
        self._silent = wanted is False or comm.rank > 0
        self._after = 0.0 if wanted else _PATIENCE
        self._shown = False

    def step(self, step: EvolutionStep) -> None:
        passed = clock.monotonic() - self._start
        a, b = self._span
        if self._silent or passed < self._after:
            return
        self._shown = True
        counts = ", ".join(f"{n} {k}" for k, n in step.result.counts.items() if n)
        left = passed * (b - step.time) / (step.time - a)
        if step.jump:
            self._line.write(f"evolution: the state jumps at the time {step.start:.10g}")
        self._line.update(
            f"evolution: time {step.time:.6g} of {b:.6g}  step {step.number}, of "
            f"{step.time - step.start:.2g}  {counts}  {passed:.0f} s, about {left:.0f} s left"
        )

    def end(self, history: History) -> None:
        self._line.clear()
        if self._shown:
            self._line.write(f"evolution: {len(history.steps)} steps, {history.reason}")


class PathProgress:
    """The line of progress: load, number of the point, statuses, time by the clock."""

    def __init__(self, comm: MPI.Comm, wanted: bool | None, limits: tuple[float, float]):
        self._line = Line(comm)
        self._start = clock.monotonic()
        self._limits = limits
        self._silent = wanted is False or comm.rank > 0
        self._after = 0.0 if wanted else _PATIENCE
        self._shown = False

    def step(self, step: PathStep) -> None:
        passed = clock.monotonic() - self._start
        low, high = self._limits
        if self._silent or passed < self._after:
            return
        self._shown = True
        counts = ", ".join(f"{n} {k}" for k, n in step.result.counts.items() if n)
        self._line.update(
            f"path: gamma {step.gamma:.6g} in [{low:.6g}, {high:.6g}]  point {step.number}  "
            f"{step.event}  {counts}  {passed:.0f} s"
        )

    def end(self, history: PathHistory) -> None:
        self._line.clear()
        if self._shown:
            self._line.write(f"path: {len(history.steps)} points, {history.reason}")
