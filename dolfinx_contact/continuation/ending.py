# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ends of branches, paths and histories: a kind, and a sentence with details."""

from __future__ import annotations

from enum import Enum

__all__ = ["Ending", "Ends"]


class Ending(Enum):
    """Kind of an end; its value is the sentence used without details.

    Only `NO_SOLUTION` means that provably nothing continues. After `NOT_FOUND` and `NOT_SOLVED` a
    solution may continue.
    """

    #: The end of the range of gamma, the last time, or rest.
    REACHED = "gamma reached the end of its range"
    CLOSED = "the branch is closed"
    UNBOUNDED = "the branch goes to infinity"
    #: Ended by the user's ``stop``.
    STOPPED = "it was stopped"
    BUDGET = "the budget is exhausted"
    #: Provably, no solution continues.
    NO_SOLUTION = "no solution continues it"
    #: No direction to continue was found.
    NOT_FOUND = "no way on was found"
    #: A step was not solved.
    NOT_SOLVED = "a step was not solved"


class Ends:
    """Base class of results that end.

    Attributes:
        ending: kind of the end; None before it.
        reason: description of the end.
    """

    ending: Ending | None
    reason: str

    def end(self, ending: Ending, reason: str = "") -> None:
        """Record the end, by default with the sentence of its kind."""
        self.ending = ending
        self.reason = reason or ending.value

    def go_on(self) -> None:
        """Remove the end, to continue."""
        self.ending = None
        self.reason = ""
