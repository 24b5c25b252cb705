# SPDX-License-Identifier: LGPL-3.0-or-later
"""How branches, paths and histories end: one of a few endings, and a sentence with details."""

from __future__ import annotations

from enum import Enum

__all__ = ["Ending", "Ends"]


class Ending(Enum):
    """How something that was followed ended; its value is the sentence where there are no details.

    Only `NO_SOLUTION` means that nothing continues; after `NOT_FOUND` and `NOT_SOLVED` a
    solution may.
    """

    #: The end of the range of gamma, or the last time, or rest where that was looked for.
    REACHED = "gamma reached the end of its range"
    CLOSED = "the branch is closed"
    UNBOUNDED = "the branch goes to infinity"
    #: The user's ``stop`` required it.
    STOPPED = "it was stopped"
    BUDGET = "the budget is exhausted"
    #: It is proved that no solution continues it.
    NO_SOLUTION = "no solution continues it"
    #: No direction to continue was found, by what was tried.
    NOT_FOUND = "no way on was found"
    #: A step was not solved.
    NOT_SOLVED = "a step was not solved"


class Ends:
    """Of what can end: `ending`, and `reason` in words.

    Attributes:
        ending: None while it continues.
        reason: why it ended, in words.
    """

    ending: Ending | None
    reason: str

    def end(self, ending: Ending, reason: str = "") -> None:
        """End it, with a sentence of its own if there is one."""
        self.ending = ending
        self.reason = reason or ending.value

    def go_on(self) -> None:
        """Take the end back: what had ended continues."""
        self.ending = None
        self.reason = ""
