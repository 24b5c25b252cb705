# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions and observers that users pass to a run in addition to its task."""

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
    """Functions and observers of a run; see `QuasiStatic.run`.

    Attributes:
        accept: function of a step that returns whether it is accepted.
        stop: function of an accepted step that returns the reason to end the run there, or "".
        observer: observer of every accepted step.
        record: record that keeps every accepted step.
        progress: whether rank 0 shows the progress of the run.
    """

    accept: Callable[[Any], bool] | None = None
    stop: Stop[Any] | None = None
    observer: ObserverLike[Any] | None = None
    record: Observer | None = None
    progress: bool | None = None

    @classmethod
    def of(cls, a: Arguments) -> Listeners:
        """Collect them from the arguments of a run."""
        return cls(getattr(a, "accept", None), a.stop, a.observer, a.record, a.progress)

    def check(self, record: str) -> None:
        """Raise ``ValueError`` if one of them has a wrong type. Not collective.

        Args:
            record: class of the records, in words.
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
        """Whether those are given that all ranks must give or none, by names in messages."""
        return {"stop_condition": self.stop is not None, "a_record": self.record is not None}


def compared_arguments(a: Arguments) -> dict[str, Any]:
    """Whether arguments are given that all ranks must give or none, by names in messages."""
    return Listeners.of(a).compared() | {"a_start": a.start is not None}
