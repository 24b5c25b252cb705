# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reasons why a branch, path or history stopped: a kind of reason and a detailed message."""

from __future__ import annotations

from enum import Enum

__all__ = ["OTHER_CAUSE", "Ending", "Ends"]


#: Possible cause of an unsolved step, at the end of a reason.
OTHER_CAUSE = "; the load or other data may have kinks or jumps in gamma there"


class Ending(Enum):
    """Kind of reason why a branch, path or history stopped; its value is a default message.

    Only `NO_SOLUTION` is a proof that there is no continuation. After `NOT_FOUND` and `NOT_SOLVED`
    a continuation may exist.
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
    """Base class of results of a process that may stop, such as a branch or a history.

    Attributes:
        ending: kind of reason why the process stopped; None while it continues.
        reason: message with details of the stop; "" while the process continues.
    """

    ending: Ending | None
    reason: str

    def end(self, ending: Ending, reason: str = "") -> None:
        """Record why the process stopped; ``reason`` defaults to the message of the kind."""
        self.ending = ending
        self.reason = reason or ending.value

    def go_on(self) -> None:
        """Clear the recorded `ending` and `reason`, so that the process can continue."""
        self.ending = None
        self.reason = ""
