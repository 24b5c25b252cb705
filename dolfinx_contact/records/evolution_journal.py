# SPDX-License-Identifier: LGPL-3.0-or-later
"""The journal of an evolution.

A line for its start, a line where a run begins, a line for every accepted step, and a line where a
run ends.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.records.lines import FILE_NAME, Lines, ending_of, parse

__all__ = ["EvolutionJournal", "EvolutionRun", "read_evolution"]


@dataclass
class EvolutionRun(Ends):
    """What is known of one run.

    Attributes:
        task: times, limits of the step length, and what to do at jumps.
        after: index of the state at which it begins.
        ending: how it ended; None if it has not.
        reason: why, in words.
    """

    task: dict[str, Any]
    after: int
    ending: Ending | None = None
    reason: str = ""

    @property
    def complete(self) -> bool:
        """Whether it reached the last of its times, or the end of its range."""
        return self.ending is Ending.REACHED


@dataclass
class EvolutionJournal(Lines):
    """What was recorded.

    Attributes:
        header: what identifies the problem, and the places of the contact points.
        states: one dictionary for the start and for every accepted step, in order: ``time``,
            ``status`` (letters of all contact points, surface by surface, in the order of their
            tables), ``norm`` of all unknowns, ``energies``, and how the run goes on from there; of
            steps ``row``, that of the table of steps.
        runs: in order.
        sessions: one dictionary for every run that recorded: ranks, versions, time of its start.
        length: of the file in bytes, without a last line that was not finished.
        torn: whether there is such a line.
    """

    kind: ClassVar[str] = "an evolution"
    #: What lines must have.
    of_states: ClassVar[tuple[str, ...]] = (
        *("time", "status", "norm", "energies", "data", "checkpoint", "sum"),
    )
    of_steps: ClassVar[tuple[str, ...]] = ("row", "number", "length", "rate", "settled")
    states: list[dict[str, Any]] = field(default_factory=list)
    runs: list[EvolutionRun] = field(default_factory=list)

    def rows(self) -> list[dict[str, Any]]:
        """The table of all steps, with their ``status``, for `write_rows`."""
        return [s["row"] | {"status": s["status"]} for s in self.states[1:]]

    @property
    def is_empty(self) -> bool:
        return not self.states

    def _take(self, kind: str, entry: dict[str, Any]) -> None:
        if kind == "state":
            if entry["index"] != len(self.states):
                raise ValueError(f"state {entry['index']} follows after {len(self.states)} states")
            for name in (*self.of_states, *(self.of_steps if self.states else ())):
                entry[name]
            if self.states:
                self.runs[-1].go_on()
            self.states.append(entry)
        elif kind == "run":
            if not entry["after"] == len(self.states) - 1 >= 0:
                raise ValueError(f"a run begins at state {entry['after']}")
            self.runs.append(EvolutionRun(entry["task"], entry["after"]))
        elif kind == "end":
            self.runs[-1].end(ending_of(entry), entry["reason"])
        else:
            raise ValueError(f"lines of the kind {kind!r} are not known")


def read_evolution(folder: str | os.PathLike[str]) -> EvolutionJournal:
    """Read the journal of a folder, on this rank alone; it may be that of a run that goes on.

    Raises:
        OSError: if there is none.
        ValueError: if it is damaged, or no journal of an evolution.
    """
    return parse((Path(folder) / FILE_NAME).read_bytes(), EvolutionJournal)
