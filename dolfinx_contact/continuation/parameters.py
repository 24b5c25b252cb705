# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters of a continuation, validated when made."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, TypeAlias, get_args

import numpy as np

from dolfinx_contact._validate import is_number

__all__ = ["Direction", "Kinks", "StepControl", "sign_of"]

#: How kinks are passed.
Kinks: TypeAlias = Literal["exact", "batched", "stepping"]

#: How the parameter changes where a branch starts.
Direction: TypeAlias = Literal["increasing", "decreasing"]


def sign_of(direction: Direction) -> float:
    """1 where the parameter increases at the start, -1 where it decreases.

    Raises:
        ValueError: for another direction.
    """
    if direction not in get_args(Direction):
        raise ValueError(f"direction must be one of {get_args(Direction)}, got {direction!r}")
    return 1.0 if direction == "increasing" else -1.0


@dataclass(frozen=True)
class StepControl:
    """How long steps are, in units in which the first tangent and the range of gamma have size 1.

    Attributes:
        initial: first step.
        minimum: a step that would have to be shorter fails.
        maximum: longest step.
        increase: factor after a step that took at most ``easy`` corrections.
        decrease: factor after a step that was rejected.
        easy: number of corrections.
        cosine: least cosine between the tangents of two points of one piece.
        corrections: most corrections of a step.
        tolerance: relative residual at which a point is accepted.
        kinks: how a branch passes them: ``"exact"`` every event is located, and a step ends there
            (`ExactSteps`); ``"batched"`` a step may pass many events along which the branch
            continues without turning or branching, the others are located (`BatchedSteps`), but for
            two turns within one step, which are passed: shorter steps show whether there are any;
            ``"stepping"`` the step shrinks to its minimum before a kink and is then tried along
            the tangents beyond (`SteppingSteps`). None: batched where the system has many pieces
            (`System.has_many_pieces`), else exact.
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
                "step lengths need 0 < minimum <= initial <= maximum, got "
                f"{self.minimum}, {self.initial}, {self.maximum}"
            )
        if not 0 < self.decrease < 1 < self.increase:
            raise ValueError("step factors need 0 < decrease < 1 < increase")
        if not -1 <= self.cosine < 1:
            raise ValueError(f"the least cosine must lie in [-1, 1), got {self.cosine}")
        if self.corrections < 1 or self.easy < 0 or not self.tolerance > 0:
            raise ValueError("corrections, easy and tolerance must be positive")
        if self.kinks is not None and self.kinks not in get_args(Kinks):
            raise ValueError(f"kinks are passed {get_args(Kinks)}, got {self.kinks!r}")
