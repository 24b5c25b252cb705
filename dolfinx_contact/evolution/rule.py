# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rules that find the next step of a run."""

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
        step: step as users see it.
        solved: step with its accepted states.
    """

    step: EvolutionStep
    solved: SolvedStep


class Rule(Ends, ABC, Generic[T, S]):
    """A rule by which a run goes from an accepted state to the next one, up to its end.

    Args:
        task: task of the run.
        run_state: state of the run where it starts or continues.

    Attributes:
        task: task as given.
        start: state of the run as given.
        ending: how the run ends; None while it continues.
        reason: reason of the ending, in words.
    """

    #: Kind of the run and of its steps, for messages.
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
        """State of the run now."""

    def begin(self) -> None:
        """Check the start, which is in the problem, before it is recorded. Collective.

        Raises:
            ValueError: on every rank, if no run can begin there.
        """

    @abstractmethod
    def advances(self) -> Iterator[Advance]:
        """The accepted steps, one by one, until the run ends. Collective.

        After each of them `run_state` is the state at its end, and `ending` is set if the run ends
        there. The Functions are left in any state.
        """

    @abstractmethod
    def where(self, step: EvolutionStep) -> str:
        """The place of the run after a step, in words."""

    def part(self, step: EvolutionStep) -> float | None:
        """The completed part of the run after a step, up to 1; None if it is not known."""
