# SPDX-License-Identifier: LGPL-3.0-or-later
"""Paths in load and state: accepted points, folds and kinks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from dolfinx_contact.evolution.history import EvolutionStep, History

__all__ = ["PathEvent", "PathHistory", "PathStep"]

#: What happens to a path at one of its points.
PathEvent: TypeAlias = Literal["", "kink", "smooth fold", "nonsmooth fold"]


@dataclass(frozen=True)
class PathStep(EvolutionStep):
    """An accepted point of a path; `start` and `time` are arc lengths from the start of the path.

    Attributes:
        gamma: the load there.
        event: ``"smooth fold"`` the load turns back while all statuses stay, ``"nonsmooth fold"``
            it turns back because statuses change, ``"kink"`` statuses change and the load
            continues; else "".
        before: statuses by which the path came, as in `status`.
        after: those by which it continues; of bonds and friction as of contact.
        method: how the direction was found. If all statuses that meet there were tried
            `directions` is the number of solutions of the rate problem, less the one that goes
            back. At a smooth bifurcation on the way it counts the path and both senses of the
            other.
        corrections: Newton steps of the corrector.
    """

    gamma: float = 0.0
    event: PathEvent = ""
    before: str = ""
    after: str = ""
    method: str = ""
    corrections: int = 0

    @property
    def is_fold(self) -> bool:
        """Whether the load turns back here."""
        return self.event.endswith("fold")

    def row(self) -> dict[str, Any]:
        return {
            **super().row(),
            "newton_iterations": self.corrections,
            "gamma": self.gamma,
            "event": self.event,
            "before": self.before,
            "after": self.after,
        }


@dataclass
class PathHistory(History):
    """A path as far as it was followed; times are arc lengths.

    Attributes:
        gamma: load at the start.
        steps: accepted points.
    """

    gamma: float = 0.0
    steps: list[PathStep] = field(default_factory=list)  # type: ignore[assignment]

    def _at_start(self) -> dict[str, Any]:
        return super()._at_start() | {"gamma": self.gamma}

    @property
    def folds(self) -> list[PathStep]:
        """Points at which the load turns back."""
        return [p for p in self.steps if p.is_fold]

    @property
    def kinks(self) -> list[PathStep]:
        """Points at which statuses change and the load continues."""
        return [p for p in self.steps if p.event == "kink"]
