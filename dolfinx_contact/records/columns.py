# SPDX-License-Identifier: LGPL-3.0-or-later
"""Entries of journals: points of branches, states of evolutions and paths, nodes and ends.

Each class corresponds to a line of the journal or a part of one. Its fields are the keys of the
JSON object; fields that are None are omitted. There are three sets of columns: branches
(`PointEntry`), histories and motions (`StateEntry` with `HistoryGoesOn`), and paths by arc length
(`StateEntry` with `PathGoesOn`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

import numpy as np

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution.path import Known
from dolfinx_contact.laws import status

__all__ = [
    "Arrived",
    "ChangeEntry",
    "EndEntry",
    "GoesOn",
    "HistoryGoesOn",
    "JournalEdge",
    "JournalNode",
    "NodePoint",
    "PathGoesOn",
    "PointEntry",
    "RayEntry",
    "SpecialEntry",
    "StateEntry",
    "made",
    "plain",
]

T = TypeVar("T")
G = TypeVar("G", bound="GoesOn")


def plain(value: Any) -> Any:
    """Convert a value to JSON types; numbers that are not finite become ``{"float": "nan"}``."""
    if is_dataclass(value) and not isinstance(value, type):
        items = {f.name: getattr(value, f.name) for f in fields(value)}
        return {name: plain(item) for name, item in items.items() if item is not None}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    return value


def made(kind: type[T], line: Mapping[str, Any]) -> T:
    """Return the entry of a line."""
    return kind(**{name: _READ.get(name, _identity)(item) for name, item in line.items()})


def _identity(value: Any) -> Any:
    return value


# -- branches and diagrams -------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ChangeEntry:
    """A contact point that changes its status.

    Attributes:
        surface: name of its surface.
        x: coordinates, shape (dim,).
        before: letter of the status before the change.
        after: letter of the status after the change.
    """

    surface: str
    x: list[float]
    before: str
    after: str


@dataclass(frozen=True, kw_only=True)
class SpecialEntry:
    """A special point; see `continuation.SpecialPoint`.

    Attributes:
        kind: "fold", "event" or "bifurcation".
        smooth: whether no status changes.
        gamma: parameter at the point.
        parity: sign change of the test for bifurcations.
        others: number of further rays.
        complete: whether all rays are known.
        bracket: values of gamma between which the point lies; None if it is located.
        changes: changes of statuses, in the order of coordinates.
    """

    kind: str
    smooth: bool
    gamma: float
    parity: Any = None
    others: int
    complete: Any = None
    bracket: list[float] | None = None
    changes: list[ChangeEntry]


@dataclass(frozen=True, kw_only=True)
class NodePoint(SpecialEntry):
    """The special point of a node.

    Attributes:
        method: method by which its rays were found.
    """

    method: Any = None


@dataclass(frozen=True, kw_only=True)
class RayEntry:
    """A ray of a node.

    Attributes:
        status: statuses of its piece.
        gamma: component of its unit tangent along gamma.
    """

    status: str
    gamma: float


@dataclass(frozen=True, kw_only=True)
class JournalNode:
    """A bifurcation of a recorded diagram; see `continuation.Node`.

    Attributes:
        point: the special point.
        rays: its rays.
        edges: number of the branch along each ray; None if no branch has taken it.
    """

    point: NodePoint
    rays: list[RayEntry]
    edges: list[int | None]

    @property
    def size(self) -> int:
        """Number of rays and of the branches along them, which grows during an exploration."""
        return len(self.rays) + sum(edge is not None for edge in self.edges)

    @property
    def gamma(self) -> float:
        """Parameter at the node."""
        return float(self.point.gamma)


@dataclass(frozen=True, kw_only=True)
class JournalEdge:
    """A branch of a recorded diagram; see `continuation.Edge`.

    Attributes:
        branch: its number; a branch that could not be begun is not among the branches.
        start: number of the node where it starts; None at a start of the exploration.
        end: number of the node where it ends; None if it ends otherwise.
    """

    branch: int
    start: int | None = None
    end: int | None = None


@dataclass(frozen=True, kw_only=True)
class PointEntry:
    """A point of a branch; see `continuation.BranchPoint` and `continuation.Stepping`.

    Attributes:
        index: number of the point.
        gamma: parameter.
        step: length of the step to the point.
        corrections: number of corrections of that step.
        tau: fraction of the step that was taken.
        status: letters of the statuses of all contact points.
        special: special points on the way to the point.
        norm: length of the unknowns in the units of steps, 0 while these are unknown; in memory
            only (`journal_of`) in the metric of the system.
        functionals: values of the functionals, by name.
        next_step: length of the next step; like the following items NaN in memory only.
        x_scale: square of the length of x that counts as 1.
        largest_distance: largest distance of all events up to the point.
        scales: scales of the residual measures.
        tangent_gamma: component of the tangent along gamma.
        checkpoint: name of the checkpoint, if fields were recorded.
        sum: fingerprint of the checkpoint.
        surface: name of the file with the outer surface, if it was recorded.
        surface_sum: fingerprint of that file.
        ending: ending of the branch, if it ends at the point.
        reason: reason of the ending, as a sentence.
    """

    index: int
    gamma: float
    step: float
    corrections: int
    tau: float
    status: str
    special: list[SpecialEntry]
    norm: float
    functionals: dict[str, float]
    next_step: float = math.nan
    x_scale: float = math.nan
    largest_distance: float = math.nan
    scales: Sequence[float] = ()
    tangent_gamma: float = math.nan
    checkpoint: str | None = None
    sum: str | None = None
    surface: str | None = None
    surface_sum: str | None = None
    ending: Ending | None = None
    reason: str | None = None

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of points by status: open, stick, slip and clamped."""
        return status.count(self.status)


@dataclass(frozen=True, kw_only=True)
class EndEntry:
    """The end of a branch or run.

    Attributes:
        ending: the ending.
        reason: reason, as a sentence.
        checkpoint: checkpoint of the last point of a branch, if it was written at the end.
        sum: fingerprint of that checkpoint.
    """

    ending: Ending
    reason: str
    checkpoint: str | None = None
    sum: str | None = None


# -- histories, motions and paths ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class GoesOn:
    """Continuation of a run from a state; see `evolution.run.RunState`."""

    number: int
    length: float
    settled: bool = True
    ending: Ending | None = None
    reason: str


@dataclass(frozen=True, kw_only=True)
class HistoryGoesOn(GoesOn):
    """Continuation of a history from a state; see `evolution.run.RunState`."""

    rate: list[float] | None = None


@dataclass(frozen=True, kw_only=True)
class Arrived:
    """The step by which a path arrived at a state.

    Attributes:
        tangent: component of the tangent along gamma.
        piece: letters of the statuses of the piece.
        step: length of the step.
        corrections: number of corrections of the step.
        tau: fraction of the step that was taken.
    """

    tangent: float
    piece: str
    step: float
    corrections: int
    tau: float


@dataclass(frozen=True, kw_only=True)
class PathGoesOn(GoesOn):
    """Continuation of a path from a state; see `evolution.path.PathState`."""

    gamma: float
    arrived: Arrived | None = None
    known: Known


@dataclass(frozen=True, kw_only=True)
class StateEntry(Generic[G]):
    """The start or an accepted step of a history, a motion or a path.

    Attributes:
        index: number of the state, 0 for the start.
        time: time; arc length of a path.
        status: letters of the statuses of all contact points, surface by surface.
        size: Euclidean norm of all unknowns.
        energies: energies by name.
        data: values of the data that have changed since the previous state, by place (`values_of`).
        row: row of the table of steps; None at the start.
        first: whether the statuses are unknown.
        run: continuation of the run from the state.
        checkpoint: name of the checkpoint.
        sum: fingerprint of the checkpoint.
        surface: name of the file with the outer surface, if it was recorded.
        surface_sum: fingerprint of that file.
    """

    index: int
    time: float
    status: str
    size: float
    energies: dict[str, float]
    data: dict[str, Any]
    row: dict[str, Any] | None = None
    first: bool
    run: G
    checkpoint: str
    sum: str
    surface: str | None = None
    surface_sum: str | None = None


#: Functions that read the values of keys that are not plain.
_READ: dict[str, Callable[[Any], Any]] = {
    "arrived": lambda line: made(Arrived, line),
    "changes": lambda lines: [made(ChangeEntry, line) for line in lines],
    "ending": lambda name: Ending[name],
    "known": lambda line: Known(**line),
    "point": lambda line: made(NodePoint, line),
    "rays": lambda lines: [made(RayEntry, line) for line in lines],
    "run": lambda line: made(PathGoesOn if "known" in line else HistoryGoesOn, line),
    "special": lambda lines: [made(SpecialEntry, line) for line in lines],
}
