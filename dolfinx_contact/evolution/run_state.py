# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a run is between two steps, and who keeps it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution.accepted import AcceptedState
from dolfinx_contact.evolution.history import EvolutionStep, History

__all__ = ["RunRecorder", "RunState"]

T = TypeVar("T", contravariant=True)
S = TypeVar("S", contravariant=True)


@dataclass(frozen=True, eq=False)
class RunState:
    """All that the next step of a run depends on.

    Attributes:
        accepted: the last accepted state.
        length: of the next step, or what it is no longer than.
        rate: through times that of the state in the last step, of `accepted.changes` and of the
            largest way of a point of each surface; None before the first, and by arc length.
        number: of the last step, over all runs; 0 before the first.
        settled: whether it says how the run goes on. It does not in the midst of steps that were
            found together, up to a jump.
        ending: how the run ends here; None if it goes on.
        reason: why, in words.
    """

    accepted: AcceptedState
    length: float
    rate: npt.NDArray[np.float64] | None = None
    number: int = 0
    settled: bool = True
    ending: Ending | None = None
    reason: str = ""


class RunRecorder(Protocol[T, S]):
    """Keeps a run. Its methods are collective; the problem is at the state they are told of."""

    def begin(self, task: T, run_state: S) -> None:
        """A new run begins."""

    def step(self, step: EvolutionStep, run_state: S) -> None:
        """A step was accepted; the next one is computed when this returns."""

    def end(self, history: History) -> None:
        """A run has ended otherwise than by an error of somebody else."""
