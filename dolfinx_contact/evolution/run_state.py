# SPDX-License-Identifier: LGPL-3.0-or-later
"""State of a run between two steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution.step import AcceptedState

__all__ = ["RunState"]


@dataclass(frozen=True, eq=False)
class RunState:
    """State of a run between two steps: everything that the next step depends on.

    Attributes:
        accepted: last accepted state.
        length: length of the next step, or an upper bound of it.
        rate: rates of the state in the last step through times, of `changes` and of the largest
            displacement of a point of each surface; None before the first step and by arc length.
        number: number of the last step, over all runs; 0 before the first.
        settled: whether the run can be resumed here; False between steps that were found together,
            up to a jump.
        ending: how the run ends here; None if it continues.
        reason: reason of the ending, in words.
    """

    accepted: AcceptedState
    length: float
    rate: npt.NDArray[np.float64] | None = None
    number: int = 0
    settled: bool = True
    ending: Ending | None = None
    reason: str = ""
