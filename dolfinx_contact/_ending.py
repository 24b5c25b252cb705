# SPDX-License-Identifier: LGPL-3.0-or-later
"""Endings of branches, paths and histories: a kind and a sentence with details."""

from __future__ import annotations

from enum import Enum

__all__ = ["OTHER_CAUSE", "Ending", "Ends"]


#: Possible cause of an unsolved step, at the end of a reason.
OTHER_CAUSE = "; the load or other data may have kinks or jumps in gamma there"


class Ending(Enum):
    """Kind of an ending; its value is the default sentence.

    Only `NO_SOLUTION` is a proof that no solution continues. After `NOT_FOUND` and `NOT_SOLVED` a
    continuation may exist.
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
    NOT_FOUND = "no continuation was found"
    #: A step was not solved.
    NOT_SOLVED = "a step was not solved"


class Ends:
    """Base class of results with an ending.

    Attributes:
        ending: kind of the ending; None as long as the process continues.
        reason: description of the ending.
    """

    ending: Ending | None
    reason: str

    def end(self, ending: Ending, reason: str = "") -> None:
        """Record the ending; the default reason is the sentence of its kind."""
        self.ending = ending
        self.reason = reason or ending.value

    def go_on(self) -> None:
        """Remove the ending, so that the process can continue."""
        self.ending = None
        self.reason = ""
