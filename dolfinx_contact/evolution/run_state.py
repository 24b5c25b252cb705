# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the run of an evolution stands between two steps, and who keeps it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.evolution.accepted import AcceptedState
from dolfinx_contact.evolution.history import EvolutionStep, History

__all__ = ["AtJump", "Recorder", "RunRecorder", "RunState", "Task", "aim", "checked_times"]

T = TypeVar("T", contravariant=True)
S = TypeVar("S", contravariant=True)

_ROUND_OFF = 1e-9  # of the whole time
#: What to do where no solution continues the evolution, or none is found that does.
AtJump: TypeAlias = Literal["raise", "stop", "jump"]


@dataclass(frozen=True)
class Task:
    """What was asked of a run; see `QuasiStatic.run`, and `NSCD.run` for ``locate``."""

    times: tuple[float, ...]
    longest: float
    shortest: float
    at_jump: AtJump
    sudden: float
    locate: bool = False
    rays: bool | None = None
    follow_rays: bool = False


@dataclass(frozen=True, eq=False)
class RunState:
    """All that the next step of a run depends on.

    Attributes:
        accepted: the last accepted state.
        length: no longer is the next step.
        rate: of the state in the last step, of `accepted.changes` and of the largest way of a point
            of each surface; None before the first.
        number: of the last step, over all runs of the evolution; 0 before the first.
        settled: whether it says how the run goes on. It does not in the midst of steps that were
            found together, up to a jump.
    """

    accepted: AcceptedState
    length: float
    rate: npt.NDArray[np.float64] | None = None
    number: int = 0
    settled: bool = True


class RunRecorder(Protocol[T, S]):
    """Keeps a run. Its methods are collective; the problem is at the state they are told of."""

    def begin(self, task: T, run_state: S) -> None:
        """A new run begins."""

    def step(self, step: EvolutionStep, run_state: S) -> None:
        """A step was accepted; the next one is computed when this returns."""

    def end(self, history: History) -> None:
        """A run has ended otherwise than by an error of somebody else."""


#: Keeps a run through times.
Recorder: TypeAlias = RunRecorder[Task, RunState]


def aim(start: float, end: float, length: float) -> float:
    """The end of the next of equal steps to a time that are no longer than a length."""
    steps = math.ceil((end - start) / length * (1 - 1e-12))
    return end if steps <= 1 else start + (end - start) / steps


def checked_times(times: Sequence[float], accepted: AcceptedState | None) -> list[float]:
    """The times as numbers, or ``ValueError``. Not collective."""
    try:
        found = [float(t) for t in np.asarray(times, dtype=np.float64).reshape(-1)]
    except (TypeError, ValueError):
        raise ValueError(f"two or more times are needed, as numbers, got {times!r}") from None
    if len(found) < 2 or not all(math.isfinite(t) for t in found):
        raise ValueError(f"two or more finite times are needed, the first of them now: {times!r}")
    for a, b in itertools.pairwise(found):
        if not b > a:
            raise ValueError(f"times must increase, got {b!r} after {a!r}")
    if accepted is not None:
        # Times that are summed up differ from those that are written down.
        if abs(found[0] - accepted.time) > _ROUND_OFF * (found[-1] - found[0]):
            raise ValueError(f"the evolution is at the time {accepted.time!r}, not {found[0]!r}")
        found[0] = accepted.time
    return found
