# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress on rank 0 while a branch is followed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO

from mpi4py import MPI

from dolfinx_contact._progress import Progress
from dolfinx_contact.continuation.branch import BranchPoint, SpecialPoint
from dolfinx_contact.continuation.ending import Ends
from dolfinx_contact.continuation.observer import Observer, Stepping

__all__ = ["BranchProgress"]


class BranchProgress(Observer):
    """The line of progress: branch, point, gamma, length of the step, special points so far.

    Folds and bifurcations get a line each.

    Args:
        comm: only rank 0 writes.
        wanted: see `follow`.
        stream: where to, by default the standard error stream.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None = None, *, stream: TextIO | None = None):
        self._progress = Progress(comm, wanted, stream=stream)
        self._special = 0

    def point(
        self,
        branch: int,
        index: int,
        point: BranchPoint,
        special: Sequence[SpecialPoint],
        stepping: Stepping,
    ) -> None:
        self._special += len(special)
        if not self._progress.due:
            return
        for s in special:
            if s.kind != "event":
                smooth = "smooth" if s.smooth else "nonsmooth"
                where = f"branch {branch}: {smooth} {s.kind} at gamma {s.gamma:.10g}"
                self._progress.write(where)
        self._progress.update(
            f"branch {branch}  point {index}  gamma {point.gamma:+.6f}  step {point.step:.1e}  "
            f"special {self._special}"
        )

    def end(self, branch: int, ended: Ends) -> None:
        self._progress.close(f"branch {branch}: {ended.reason}")
