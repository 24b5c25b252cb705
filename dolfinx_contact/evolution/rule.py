# SPDX-License-Identifier: LGPL-3.0-or-later
"""What finds the next step of a run: a rule, and what it finds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.evolution.step import SolvedStep

__all__ = ["Advance", "Rule"]

T = TypeVar("T")
S = TypeVar("S", bound=RunState)


@dataclass(frozen=True, eq=False)
class Advance:
    """An accepted step.

    Attributes:
        step: as the user sees it.
        solved: the states at its start and end.
    """

    step: EvolutionStep
    solved: SolvedStep


class Rule(Ends, ABC, Generic[T, S]):
    """How a run goes from an accepted state to the next one, and where it ends.

    Args:
        task: of the run.
        run_state: where it begins, or continues.

    Attributes:
        task: as given.
        start: where it begins.
        ending: how the run ends; None while it continues.
        reason: why, in words.
    """

    #: What runs, and what it accepts, in messages.
    what: ClassVar[str]
    units: ClassVar[str]

    def __init__(self, task: T, run_state: S):
        self.task = task
        self.start = run_state
        self.ending: Ending | None = run_state.ending
        self.reason = run_state.reason

    @property
    @abstractmethod
    def run_state(self) -> S:
        """Where the run is: all that its next step depends on."""

    def begin(self) -> None:
        """Check the start, which is in the problem, before it is recorded. Collective.

        Raises:
            ValueError: on every rank, if no run can begin there.
        """

    @abstractmethod
    def advances(self) -> Iterator[Advance]:
        """The accepted steps, one by one, until the run ends. Collective.

        With each `run_state` is where the run continues from its end, and `ending` is set if it
        does not. The problem may be left anywhere.
        """

    @abstractmethod
    def where(self, step: EvolutionStep) -> str:
        """Where the run is after a step, in words."""

    def part(self, step: EvolutionStep) -> float | None:
        """How much of the run is done after a step, up to 1; None if that is not known."""
