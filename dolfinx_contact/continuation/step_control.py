# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters of a continuation."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, TypeAlias, get_args

import numpy as np

from dolfinx_contact._validate import is_number

__all__ = ["Direction", "Kinks", "StepControl", "sign_of"]

#: Method of passing kinks.
Kinks: TypeAlias = Literal["exact", "batched", "stepping"]

#: Change of the parameter at the start of a branch.
Direction: TypeAlias = Literal["increasing", "decreasing"]


def sign_of(direction: Direction) -> float:
    """Return 1 for an increasing and -1 for a decreasing parameter.

    Raises:
        ValueError: for another direction.
    """
    if direction not in get_args(Direction):
        raise ValueError(f"direction must be one of {get_args(Direction)}, got {direction!r}")
    return 1.0 if direction == "increasing" else -1.0


@dataclass(frozen=True)
class StepControl:
    """Control of steps; the first tangent and the range of gamma have length 1.

    Attributes:
        initial: length of the first step.
        minimum: shortest step.
        maximum: longest step.
        increase: factor after a step with at most ``easy`` corrections.
        decrease: factor after a rejected step.
        easy: largest number of corrections after which the step length is increased.
        cosine: smallest admissible cosine of the angle between the tangents at two successive
            points with the same statuses.
        corrections: largest number of corrections of a step.
        tolerance: largest relative residual of an accepted point.
        kinks: method of passing kinks. ``"exact"``: every event is located, and a step ends there.
            ``"batched"``: a step may pass many events at which gamma does not turn and no other
            branch meets; other events are located. Two turns within one step are not detected; use
            shorter steps. ``"stepping"``: the step shrinks to its minimum before a kink, and the
            tangents beyond are then tried. None: batched if there are many combinations of statuses
            (`System.has_many_pieces`), otherwise exact.
    """

    initial: float = 0.02
    minimum: float = 1e-8
    maximum: float = 0.1
    increase: float = 1.5
    decrease: float = 0.5
    easy: int = 4
    cosine: float = 0.9
    corrections: int = 12
    tolerance: float = 1e-10
    kinks: Kinks | None = None

    def __post_init__(self) -> None:
        numbers = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "kinks"}
        for name, value in numbers.items():
            number = is_number(value)
            if not number or not np.isfinite(value):
                raise ValueError(f"{name} of a StepControl must be a finite number, got {value!r}")
        if not 0 < self.minimum <= self.initial <= self.maximum:
            raise ValueError(
                "step lengths must satisfy 0 < minimum <= initial <= maximum, got "
                f"{self.minimum}, {self.initial}, {self.maximum}"
            )
        if not 0 < self.decrease < 1 < self.increase:
            raise ValueError("step factors must satisfy 0 < decrease < 1 < increase")
        if not -1 <= self.cosine < 1:
            raise ValueError(f"cosine must lie in [-1, 1), got {self.cosine}")
        if self.corrections < 1 or self.easy < 0 or not self.tolerance > 0:
            raise ValueError("corrections, easy and tolerance must be positive")
        if self.kinks is not None and self.kinks not in get_args(Kinks):
            raise ValueError(f"kinks must be one of {get_args(Kinks)}, got {self.kinks!r}")
