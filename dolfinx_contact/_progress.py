# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress on rank 0: a line that is kept up to date on a terminal, elsewhere a line now and then.

Nothing waits for it and nothing is communicated: on other ranks it does nothing.
"""

from __future__ import annotations

import logging
import shutil
import sys
import time
from typing import TYPE_CHECKING, TextIO

from mpi4py import MPI

if TYPE_CHECKING:
    from dolfinx_contact.solvers.history import Step

__all__ = ["Line", "SolveProgress"]

_PATIENCE = 3.0  # seconds of a solve before it says anything by itself
_SECONDS = 10.0  # between lines where there is no terminal


class Line:
    """Where progress is written to.

    Args:
        comm: only rank 0 writes.
        stream: where to, by default the standard error stream.
        seconds: between lines where there is no terminal.
    """

    def __init__(self, comm: MPI.Comm, *, stream: TextIO | None = None, seconds: float = _SECONDS):
        self._stream = (stream or sys.stderr) if comm.rank == 0 else None
        self._seconds = seconds
        self._next = 0.0
        self._live = self._stream is not None and self._stream.isatty()
        self._open = False

    def update(self, text: str) -> None:
        """Replace the line of a terminal; elsewhere write one, if the last is old enough."""
        if self._live:
            # A line that is wrapped could not be taken back.
            self._put(text[: shutil.get_terminal_size().columns - 1], stay=True)
        elif time.monotonic() >= self._next:
            self._put(text)
            self._next = time.monotonic() + self._seconds

    def write(self, text: str) -> None:
        """Write a line that stays."""
        self._put(text)

    def clear(self) -> None:
        """Take back the line of a terminal, so that others can write there."""
        if self._open and self._stream is not None:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._open = False

    def _put(self, text: str, *, stay: bool = False) -> None:
        if self._stream is None:
            return
        erase = "\r\x1b[K" if self._open else ""
        self._stream.write(erase + text + ("" if stay else "\n"))
        self._stream.flush()
        self._open = stay


class SolveProgress:
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
        self._line = Line(comm, stream=stream)
        self._start = time.monotonic()
        heard = wanted is None and logging.getLogger(__package__).isEnabledFor(logging.INFO)
        self._silent = wanted is False or heard or comm.rank > 0
        self._after = 0.0 if wanted else _PATIENCE
        self._shown = False
        self.strategy = ""

    @property
    def seconds(self) -> float:
        """Since the start of the solve."""
        return time.monotonic() - self._start

    def step(self, step: Step) -> None:
        """Say where the solve is."""
        if self._silent or self.seconds < self._after:
            return
        self._shown = True
        parts = [
            f"contact solve: {self.strategy}",
            f"iteration {step.iteration}",
            f"residual {step.measures.worst:.1e}",
            *([f"load {step.load:.3g}"] if step.load != 1.0 else []),
            f"Krylov {step.krylov}",
            f"{self.seconds:.0f} s",
        ]
        self._line.update("  ".join(parts))

    def clear(self) -> None:
        """As `Line.clear`."""
        self._line.clear()

    def end(self, iterations: int | None = None) -> None:
        """End the line, with how a solve went that converged; None for one that did not."""
        if not self._shown:
            return
        self.clear()
        if iterations is not None:
            self._line.write(
                f"contact solve: solved by {self.strategy}, {iterations} iterations, "
                f"{self.seconds:.1f} s"
            )
        self._shown = False
