# SPDX-License-Identifier: LGPL-3.0-or-later
"""Histories: accepted steps of a run, the table of steps, and why the run ended.

A step leads from the state at its ``start`` to ``state`` at its ``time``. The table has a row for
the start of the run and one for each step. All rows have the same keys: number and times, counts of
statuses, contact forces, reactions and displacements of supports, motions of rigid bodies,
energies, variables of the laws, and the work of the solver.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from dolfinx_contact._arrays import Array, as_text
from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.laws import status
from dolfinx_contact.results.balance import at_conditions
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.tables import ContactTable, contact_tables, support_at_nodes

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = [
    "EvolutionStep",
    "History",
    "NoContinuation",
    "PathEvent",
    "PathHistory",
    "PathStep",
]

#: Event at a point of a path.
PathEvent: TypeAlias = Literal["", "kink", "smooth fold", "nonsmooth fold"]


@dataclass(frozen=True)
class EvolutionStep:
    """Accepted step of an evolution.

    Attributes:
        number: number of the step, from 1, over all runs of the evolution; a run with ``start=``
            begins again at 1.
        start: time at the start of the step.
        time: time at the end of the step.
        result: tables, resultants, checks and indicators at the end of the step.
        energies: energies since the start of the evolution.
        rejected: number of steps that were tried from the same state before and not accepted.
        jump: whether the state jumps in the step: its end is a solution under the load at ``time``
            that no continuous evolution reaches.
        directions: number of computed solutions of the rate problem at the start, the directions in
            which the evolution can continue. None if they were not computed.
        inserted: whether ``time`` is not one of the requested times, because a step was halved or a
            jump was located.
        state: state at the end, with time, energies and, in dynamics, velocity. It may be passed to
            evaluators, as in ``problem.table(surface, state=step.state)``, and as the start of
            another evolution.
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
        """Status letters of all contact points in the order of the tables of the surfaces."""
        return "".join(t.status for t in self.result.tables.values())

    def row(self) -> dict[str, Any]:
        """Return the scalar values of the step as a row of the table of steps."""
        result = self.result
        motions = [(b.name, b.components, b.motion) for b in result.rigid_bodies.values()]
        supports = _of_supports(result.supports, result.support_displacements, motions)
        return {
            **_at_state(self.number, self.start, self.time, result.tables, supports, self.energies),
            "newton_iterations": result.iterations,
            "strategy": result.reason,
            "rejected": self.rejected,
            "jump": self.jump,
            "directions": self.directions,
            "inserted": self.inserted,
        }


def _at_state(
    number: int,
    start: float,
    time: float,
    tables: Mapping[str, ContactTable],
    supports: Mapping[str, float],
    energies: Energies,
) -> dict[str, Any]:
    """Return the entries of a row that describe a state, as a dictionary by column name."""
    forces = {
        f"{name}_{axis}": float(v)
        for name, t in tables.items()
        for axis, v in zip("xyz", t.resultant(t.force), strict=False)
    }
    variables = {
        f"{name}_{variable}": _mean(t, values)
        for name, t in tables.items()
        for variable, values in t.internal.items()
    }
    counts = status.count("".join(t.status for t in tables.values()))
    return {
        "step": number,
        "time": time,
        "length": time - start,
        **{k: counts[k] for k in ("open", "stick", "slip", "clamped")},
        **forces,
        **supports,
        **energies.row(),
        **variables,
    }


def _mean(table: ContactTable, values: Array) -> float:
    """Return the mean of a variable of a law over a surface, weighted by the areas of points.

    Points with the letter "d" do not count: no law applies to them. NaN without points.
    """
    counts = table.letters != "d"
    area = table.area[counts]
    return float(np.dot(values[counts], area) / area.sum()) if len(area) else np.nan


def _of_supports(
    reactions: Array, displacements: Array, motions: Iterable[tuple[str, Sequence[str], Array]]
) -> dict[str, float]:
    """Return the entries of a row that describe supports and rigid bodies, by column name.

    Args:
        reactions: reaction of each Dirichlet condition, shape (conditions, dim).
        displacements: mean displacement of each condition, NaN in free components, shape
            (conditions, dim).
        motions: name, names of the components, and motion of each rigid body.
    """
    columns = {}
    for sign, values in (("", reactions), ("u", displacements)):
        for k, i in np.argwhere(~np.isnan(displacements)):
            columns[f"support_{k}_{sign}{'xyz'[i]}"] = float(values[k, i])
    for name, components, motion in motions:
        for component, value in zip(components, motion, strict=True):
            sign = "u" if component in "xyz" else ""  # the rotations are rx, ry, rz
            columns[f"{name}_{sign}{component}"] = float(value)
    return columns


#: Columns of the work of the solver in the row of the start.
_NO_STEP = {
    "newton_iterations": 0,
    "strategy": "",
    "rejected": 0,
    "jump": False,
    "directions": None,
    "inserted": False,
}


@dataclass
class History(Ends):
    """History of a run up to its last accepted state.

    Attributes:
        start: time at which the run started.
        before: energies at the start of the run.
        steps: accepted steps.
        ending: kind of the end of the run (`Ending`); None while it continues.
        reason: reason for the end of the run, as a sentence.
        first: row of the table of steps that describes the start.
    """

    start: float
    before: Energies = field(default_factory=Energies)
    steps: list[EvolutionStep] = field(default_factory=list)
    ending: Ending | None = None
    reason: str = "not ended"
    first: dict[str, Any] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        """Describe the number of steps, the times, why the run ended, and its warnings."""
        return self._text("step", "time", [self.start, self.time])

    def _text(self, unit: str, coordinate: str, values: Sequence[float]) -> str:
        """Describe the number of steps, the range of a coordinate, the end, and warnings.

        Args:
            unit: noun for a step.
            coordinate: name of the coordinate.
            values: values of the coordinate, from the start to the end.
        """
        number = len(self.steps)
        many = f"{number} {unit}{'' if number == 1 else 's'}"
        first, last = (as_text(v, max(map(abs, values))) for v in (values[0], values[-1]))
        text = f"{many} from {coordinate} {first} to {last}: {self.reason}"
        if self.warnings:
            text += "; warnings: " + ", ".join(
                f"{name} ({unit} {numbers[0]})" for name, numbers in self.warnings.items()
            )
        return text

    @property
    def complete(self) -> bool:
        """Whether the run reached its last time, or the end of its range of gamma."""
        return self.ending is Ending.REACHED

    @property
    def time(self) -> float:
        """Time at the last accepted state."""
        return self.steps[-1].time if self.steps else self.start

    @property
    def energies(self) -> Energies:
        """Energies at the last accepted state."""
        return self.steps[-1].energies if self.steps else self.before

    @property
    def warnings(self) -> dict[str, list[int]]:
        """Numbers of the steps with a warning, by name of the warning.

        The text of a warning is in `Result.warnings` of each of these steps.
        """
        numbers: dict[str, list[int]] = {}
        for step in self.steps:
            for name in step.result.warnings:
                numbers.setdefault(name, []).append(step.number)
        return numbers

    def at(self, time: float) -> EvolutionStep:
        """Return the step ending at a time.

        Raises:
            KeyError: if no step ends at the time.
        """
        for step in self.steps:
            if step.time == time:
                return step
        raise KeyError(f"no step ends at {time!r}")

    def begin(self, number: int, problem: ContactProblem) -> None:
        """Set the first row of the table of steps, which describes the start. Collective.

        Args:
            number: number of the last step of earlier runs; 0 if there are none.
            problem: contact problem in the state of the start.
        """
        with problem.at(None) as shown:
            evaluation = shown.evaluate()
            eq = shown.equations
        reactions = support_at_nodes(eq, evaluation)
        tables = contact_tables(eq, evaluation, reactions)
        motions = [(b.name, b.components, b.values) for b in problem.rigid_bodies]
        supports = _of_supports(*at_conditions(eq, reactions, evaluation.u), motions)
        row = _at_state(number, self.start, self.start, tables, supports, self.before)
        self.first = row | _NO_STEP

    def rows(self) -> list[dict[str, Any]]:
        """Return the table of steps for `io.write_rows`: one row for the start and one per step."""
        return [self.first, *(step.row() for step in self.steps)]


@dataclass(frozen=True)
class PathStep(EvolutionStep):
    """Accepted point of a path; `start` and `time` are arc lengths from the start of the path.

    If all combinations of the statuses at the point were tried, which `method` states, `directions`
    is the number of directions in which the path can continue, without the one leading back. If a
    smooth bifurcation lies on the step, `directions` counts the path and both directions of the
    other branch.

    Attributes:
        gamma: load parameter.
        event: ``"smooth fold"`` if the load turns back without changes of status, ``"nonsmooth
            fold"`` if it turns back because statuses change, ``"kink"`` if statuses change and the
            load continues; otherwise "".
        before: letters of the statuses on the step to the point, as in `status`, bonds included.
        after: letters of the statuses on the next step.
        method: method by which the direction of the next step was found.
        corrections: number of Newton steps of the corrector.
    """

    gamma: float = 0.0
    event: PathEvent = ""
    before: str = ""
    after: str = ""
    method: str = ""
    corrections: int = 0

    @property
    def is_fold(self) -> bool:
        """Whether the load turns back at the point."""
        return self.event.endswith("fold")

    def row(self) -> dict[str, Any]:
        """Return the scalar values of the point as a row of the table of points."""
        return {
            **super().row(),
            "newton_iterations": self.corrections,
            "gamma": self.gamma,
            "event": self.event,
            "before": self.before,
            "after": self.after,
        }


@dataclass
class PathHistory(History):
    """History of a run by arc length: its steps are points of a path, its times arc lengths.

    Attributes:
        gamma: load parameter at the start.
        steps: accepted points.
    """

    gamma: float = 0.0
    steps: list[PathStep] = field(default_factory=list)  # type: ignore[assignment]

    def __str__(self) -> str:
        """Describe the number of points, the loads, and why the run ended."""
        return self._text("point", "gamma", [self.gamma, *(p.gamma for p in self.steps)])

    def begin(self, number: int, problem: ContactProblem) -> None:
        super().begin(number, problem)
        self.first |= {"gamma": self.gamma, "event": "", "before": "", "after": ""}

    @property
    def folds(self) -> list[PathStep]:
        """Points at which the load turns back."""
        return [p for p in self.steps if p.is_fold]

    @property
    def kinks(self) -> list[PathStep]:
        """Points at which statuses change and the load continues."""
        return [p for p in self.steps if p.event == "kink"]


class NoContinuation(RuntimeError):
    """Error raised if an evolution does not continue; the problem is in the last accepted state.

    The message states the cause: provably no continuation exists, no continuation was found, or
    steps were not solved.

    Attributes:
        history: history up to the last accepted state.
    """

    def __init__(self, message: str, history: History):
        super().__init__(message)
        self.history = history
