# SPDX-License-Identifier: LGPL-3.0-or-later
"""What users give to a run beside its task: who looks on, and who decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

from dolfinx_contact._errors import same_everywhere
from dolfinx_contact.continuation.arguments import check_functions, check_listeners
from dolfinx_contact.continuation.observer import Observer, Seen, Stop

__all__ = ["Listeners"]


@dataclass(frozen=True)
class Listeners:
    """Who looks on in a run, and who decides; see `QuasiStatic.run`.

    Attributes:
        accept: called with every step; whether it is accepted.
        stop: called with every accepted step; the reason for which the run ends with it, or "".
        observer: called with every accepted step.
        record: keeps every accepted step.
        progress: whether rank 0 shows where the run is.
    """

    accept: Callable[[Any], bool] | None = None
    stop: Stop[Any] | None = None
    observer: Seen[Any] | None = None
    record: Observer | None = None
    progress: bool | None = None

    def check(self, record: str) -> None:
        """Raise ``ValueError`` for what is none. Not collective.

        Args:
            record: what a record has to be, in words.
        """
        check_functions("a step", accept=self.accept)
        check_listeners(
            observer=self.observer,
            record=self.record,
            progress=self.progress,
            stop=self.stop,
            of=record,
        )

    def require_same(self, comm: MPI.Comm) -> None:
        """Raise ``ValueError`` on every rank where some ranks have what others lack. Collective."""
        same_everywhere(
            comm, stop_condition=self.stop is not None, a_record=self.record is not None
        )
