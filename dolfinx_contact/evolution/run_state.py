# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a run is between two steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution.step import AcceptedState

__all__ = ["RunState"]


@dataclass(frozen=True, eq=False)
class RunState:
    """All that the next step of a run depends on.

    Attributes:
        accepted: the last accepted state.
        length: of the next step, or what it is no longer than.
        rate: rates of the state in the last step through times, of `changes` and of the largest
            displacement of a point of each surface; None before the first step and by arc length.
        number: of the last step, over all runs; 0 before the first.
        settled: whether it suffices to continue the run. It does not in the midst of steps that
            were found together, up to a jump.
        ending: how the run ends here; None if it continues.
        reason: why, in words.
    """

    accepted: AcceptedState
    length: float
    rate: npt.NDArray[np.float64] | None = None
    number: int = 0
    settled: bool = True
    ending: Ending | None = None
    reason: str = ""
