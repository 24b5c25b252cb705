# SPDX-License-Identifier: LGPL-3.0-or-later
"""What users give to a run beside its task: who looks on, and who decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dolfinx_contact._collective import Arguments
from dolfinx_contact.continuation.arguments import check_functions, check_listeners
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop

__all__ = ["NOT_BY_VALUE", "Listeners", "compared_arguments"]

#: Arguments of a run that are compared as in `Listeners.compared`, or may differ.
NOT_BY_VALUE = ("accept", "stop", "record", "start")


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
    observer: ObserverLike[Any] | None = None
    record: Observer | None = None
    progress: bool | None = None

    @classmethod
    def of(cls, a: Arguments) -> Listeners:
        """Those among the arguments of a run."""
        return cls(getattr(a, "accept", None), a.stop, a.observer, a.record, a.progress)

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

    def compared(self) -> dict[str, Any]:
        """Whether there are those that every rank must have or lack, by names in messages."""
        return {"stop_condition": self.stop is not None, "a_record": self.record is not None}


def compared_arguments(a: Arguments) -> dict[str, Any]:
    """Arguments of a run that every rank must have or lack, by names in messages."""
    return Listeners.of(a).compared() | {"a_start": a.start is not None}
