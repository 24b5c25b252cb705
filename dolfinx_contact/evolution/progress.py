# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run says on rank 0 while it goes."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from dolfinx_contact._progress import Progress
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.rule import Rule

__all__ = ["RunProgress"]


class RunProgress:
    """The line of progress: where the run is, statuses, time by the clock and what is left of it.

    Args:
        comm: only rank 0 writes.
        wanted: see `QuasiStatic.run`.
        rule: of the run.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None, rule: Rule[Any, Any]):
        self._progress = Progress(comm, wanted)
        self._rule = rule

    def step(self, step: EvolutionStep) -> None:
        """Say where the run is after a step."""
        if not self._progress.due:
            return
        rule = self._rule
        passed = self._progress.seconds
        counts = ", ".join(f"{n} {k}" for k, n in step.result.counts.items() if n)
        time = f"{passed:.0f} s"
        done = rule.part(step)
        if done:
            time += f", about {passed * (1 - done) / done:.0f} s left"
        if step.jump:
            self._progress.write(f"{rule.what}: the state jumps at the time {step.start:.10g}")
        self._progress.update(f"{rule.what}: {rule.where(step)}  {counts}  {time}")

    def end(self, history: History) -> None:
        """Say how the run ended, if anything was said before."""
        self._progress.close(
            f"{self._rule.what}: {len(history.steps)} {self._rule.units}, {history.reason}"
        )
