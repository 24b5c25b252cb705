# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress of a solve on rank 0."""

from __future__ import annotations

import logging
from typing import TextIO

from mpi4py import MPI

from dolfinx_contact._progress import Progress
from dolfinx_contact.solvers.history import Step

__all__ = ["SolveProgress"]


class SolveProgress(Progress):
    """The line of a solve: strategy, iteration, residual, Krylov iterations, elapsed time.

    Args:
        comm: only rank 0 writes.
        wanted: True from the beginning, False never, None once the solve takes some seconds, unless
            the log has every iteration.
        stream: as in `Line`.

    Attributes:
        strategy: what is tried.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None = None, *, stream: TextIO | None = None):
        logged = wanted is None and logging.getLogger("dolfinx_contact").isEnabledFor(logging.INFO)
        super().__init__(comm, False if logged else wanted, stream=stream)
        self.strategy = ""

    def step(self, step: Step) -> None:
        """Say where the solve is."""
        if not self.due:
            return
        parts = [
            f"contact solve: {self.strategy}",
            f"iteration {step.iteration}",
            f"residual {step.measures.worst:.1e}",
            *([f"load {step.load:.3g}"] if step.load != 1.0 else []),
            f"Krylov {step.krylov}",
            f"{self.seconds:.0f} s",
        ]
        self.update("  ".join(parts))

    def end(self, iterations: int | None = None) -> None:
        """End the line, with how a solve went that converged; None for one that did not."""
        text = f"solved by {self.strategy}, {iterations} iterations, {self.seconds:.1f} s"
        self.close("" if iterations is None else f"contact solve: {text}")
