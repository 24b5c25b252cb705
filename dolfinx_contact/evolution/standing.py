# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the run of an evolution stands between two steps, and who keeps it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.moment import Moment

__all__ = ["AtJump", "Recorder", "Standing", "Task"]

#: What to do where no solution continues the evolution.
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


@dataclass(frozen=True, eq=False)
class Standing:
    """All that the next step of a run depends on.

    Attributes:
        moment: the last accepted state.
        length: no longer is the next step.
        rate: of the state in the last step; None before the first.
        number: of the last step; 0 before the first.
        settled: whether it says how the run goes on. It does not in the midst of steps that were
            found together, up to a jump.
    """

    moment: Moment
    length: float
    rate: float | None = None
    number: int = 0
    settled: bool = True


class Recorder(Protocol):
    """Keeps a run. Its methods are collective; the problem is at the state they are told of."""

    def begin(self, task: Task, standing: Standing) -> None:
        """A new run begins."""

    def step(self, step: EvolutionStep, standing: Standing) -> None:
        """A step was accepted; the next one is computed when this returns."""

    def end(self, history: History) -> None:
        """A run has ended otherwise than by an error of somebody else."""
