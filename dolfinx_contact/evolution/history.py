# SPDX-License-Identifier: LGPL-3.0-or-later
"""Histories: the accepted steps of an evolution and its ending."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.results.result import Result

__all__ = ["EvolutionStep", "History", "NoContinuation"]


@dataclass(frozen=True)
class EvolutionStep:
    """An accepted step.

    Attributes:
        number: from 1, over all runs of the evolution.
        start: time at its start.
        time: at its end.
        result: tables, resultants and checks of its end.
        energies: since the start of the evolution.
        rejected: steps that were tried from the same state and not accepted.
        jump: whether the state jumps in it: its end is a solution under the load of its end, to
            which no continuous evolution leads. What happens in between is no quasi-static
            evolution.
        directions: number of solutions of the rate problem at its start that are known; more than
            one if other evolutions lead on from there. None if they were not looked for.
        inserted: whether the run inserted its end between the requested times, because a step was
            halved or a jump was located.
        state: state at its end, with time, energies and, in dynamics, velocity. Evaluators take it,
            as ``problem.table(surface, state=step.state)``, and another evolution starts from it.
    """

    number: int
    start: float
    time: float
    result: Result
    energies: Energies
    rejected: int = 0
    jump: bool = False
    directions: int | None = None
    inserted: bool = False
    state: State | None = field(default=None, compare=False, repr=False)

    @property
    def status(self) -> str:
        """Letters of all contact points, surface by surface, in the order of their tables."""
        return "".join(t.status for t in self.result.tables.values())

    def row(self) -> dict[str, Any]:
        """Scalars of a table of steps."""
        forces = {
            f"{name}_{axis}": float(v)
            for name, force in self.result.resultants.items()
            for axis, v in zip("xyz", force, strict=False)
        }
        counts = self.result.counts
        return {
            "step": self.number,
            "time": self.time,
            "length": self.time - self.start,
            **{k: counts[k] for k in ("open", "stick", "slip", "clamped")},
            **forces,
            **self.energies.row(),
            **self._bonds(),
            "newton_iterations": self.result.iterations,
            "strategy": self.result.reason,
            "rejected": self.rejected,
            "jump": self.jump,
            "directions": self.directions,
            "inserted": self.inserted,
        }

    def row_before(self, known: Mapping[str, Any]) -> dict[str, Any]:
        """A row of the state at its start, for the head of a table: the keys of `row`.

        Args:
            known: of that state; what is not in it, and is neither number nor time, is None.
        """
        given = {"step": self.number - 1, "time": self.start, "length": 0.0, **known}
        return {name: given.get(name) for name in self.row()}

    def _bonds(self) -> dict[str, float]:
        """Means of the variables of laws, as the intensity of adhesion, over the areas."""
        tables = self.result.tables.items()
        return {
            f"{variable}_{name}": float(np.dot(values, t.area) / t.area.sum())
            for name, t in tables
            for variable, values in t.internal.items()
        }


@dataclass
class History(Ends):
    """An evolution up to its last accepted state.

    Attributes:
        start: time at which it began.
        before: energies until then.
        steps: accepted ones.
        ending: how it ended; None before.
        reason: why, in words.
        others: evolutions that part from this one where its rate problem has several solutions, if
            they were to be followed; each begins with the step that parts.
    """

    start: float
    before: Energies = field(default_factory=Energies)
    steps: list[EvolutionStep] = field(default_factory=list)
    ending: Ending | None = None
    reason: str = "not ended"
    others: list[History] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Whether it reached the last of the times, or the end of the range, that was requested."""
        return self.ending is Ending.REACHED

    @property
    def time(self) -> float:
        """At the last accepted state."""
        return self.steps[-1].time if self.steps else self.start

    @property
    def energies(self) -> Energies:
        """At the last accepted state."""
        return self.steps[-1].energies if self.steps else self.before

    def at(self, time: float) -> EvolutionStep:
        """The step that ends at a time.

        Raises:
            KeyError: if none does.
        """
        for step in self.steps:
            if step.time == time:
                return step
        raise KeyError(f"no step ends at {time!r}")

    def rows(self, *, start: bool = False) -> list[dict[str, Any]]:
        """The table of steps, for `io.write_rows`.

        Args:
            start: whether a row of the state at the start comes before that of the first step: its
                time and energies, of a path its load, and None for what is known of steps alone.
        """
        rows = [step.row() for step in self.steps]
        return [self.steps[0].row_before(self._at_start()), *rows] if start and rows else rows

    def _at_start(self) -> dict[str, Any]:
        """What is known at the start, by the names of a table of steps."""
        return self.before.row()


class NoContinuation(RuntimeError):
    """An evolution does not continue; the problem is at the last accepted state.

    The message names the case: no solution continues it, which is proved; none was found that
    does, by what was tried; or steps were not solved, and why.

    Attributes:
        history: the evolution up to there.
    """

    def __init__(self, message: str, history: History):
        super().__init__(message)
        self.history = history
