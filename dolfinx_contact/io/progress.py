# SPDX-License-Identifier: LGPL-3.0-or-later
"""Live progress of the following of branches, on rank 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO

from mpi4py import MPI

from dolfinx_contact._progress import Line
from dolfinx_contact.continuation import BranchPoint, Ends, Observer, SpecialPoint, Stepping

__all__ = ["Progress"]


class Progress(Observer):
    """One line that is kept up to date on a terminal; elsewhere a line from time to time.

    Special points get a line each in both cases.

    Args:
        comm: only rank 0 writes.
        stream: where to, by default the standard error stream.
        seconds: between lines where there is no terminal.
    """

    def __init__(self, comm: MPI.Comm, *, stream: TextIO | None = None, seconds: float = 10.0):
        self._line = Line(comm, stream=stream, seconds=seconds)
        self._events = 0

    def point(
        self,
        branch: int,
        index: int,
        point: BranchPoint,
        special: Sequence[SpecialPoint],
        stepping: Stepping,
    ) -> None:
        self._events += len(special)
        for s in special:
            if s.kind != "event":
                smooth = "smooth" if s.smooth else "nonsmooth"
                self._line.write(f"branch {branch}: {smooth} {s.kind} at gamma {s.gamma:.10g}")
        self._line.update(
            f"branch {branch}  point {index}  gamma {point.gamma:+.6f}  step {point.step:.1e}  "
            f"special {self._events}"
        )

    def end(self, branch: int, ended: Ends) -> None:
        self._line.write(f"branch {branch}: {ended.reason}")
