# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of journals for points, states, nodes and ends: written and read here alone.

A field of these dataclasses is a key of a line, in the order of the lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any, Generic, TypeVar

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.evolution.path_state import Known

__all__ = [
    "Arrived",
    "BranchTask",
    "ChangeEntry",
    "EndEntry",
    "Entry",
    "HistoryGoesOn",
    "JournalEdge",
    "JournalNode",
    "NodePoint",
    "PathGoesOn",
    "PointEntry",
    "RayEntry",
    "SpecialEntry",
    "StateEntry",
]

E = TypeVar("E", bound="Entry")
G = TypeVar("G", bound="Entry")


def _how(
    *,
    key: str | None = None,
    read: Callable[[Any], Any] | None = None,
    optional: bool = False,
    within: bool = False,
) -> dict[str, Any]:
    """How a field of an entry is written and read, as its metadata.

    Args:
        key: in lines, if that is not its name.
        read: makes its value of what a line has.
        optional: whether it is left out of lines where it is None.
        within: whether it is an entry whose keys stand among those of the line.
    """
    return {"key": key, "read": read, "optional": optional, "within": within}


def _written(value: Any) -> Any:
    """A value as lines have it."""
    if isinstance(value, Entry):
        return value.line()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, StepControl | Known):
        return asdict(value)
    if isinstance(value, list):
        return [_written(v) for v in value]
    return value


def _ending(name: str | None) -> Ending | None:
    return None if name is None else Ending[name]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A part of a line: its keys are the fields."""

    def line(self) -> dict[str, Any]:
        """It as a line has it."""
        found: dict[str, Any] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.metadata.get("within"):
                found |= value.line()
            elif value is not None or not f.metadata.get("optional"):
                found[f.metadata.get("key") or f.name] = _written(value)
        return found

    @classmethod
    def of_line(cls: type[E], line: Mapping[str, Any], **kinds: type[Entry]) -> E:
        """The entry that a line has, which may have other keys beside.

        Args:
            line: the line.
            kinds: of the entries within, by the names of fields.

        Raises:
            KeyError: if a key is missing.
        """
        values: dict[str, Any] = {}
        for f in fields(cls):
            key = f.metadata.get("key") or f.name
            read = f.metadata.get("read")
            if f.metadata.get("within"):
                values[f.name] = kinds[f.name].of_line(line)
            elif key in line:
                values[f.name] = read(line[key]) if read else line[key]
            elif not f.metadata.get("optional"):
                raise KeyError(key)
        return cls(**values)


def _entries(kind: type[Entry]) -> Callable[[Any], Any]:
    """What reads a list of entries."""
    return lambda lines: [kind.of_line(line) for line in lines]


# -- branches and diagrams -------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class BranchTask(Entry):
    """What a branch is to do; see `continuation.Task`."""

    gamma_range: list[float]
    gamma_scale: float
    control: StepControl = field(metadata=_how(read=lambda words: StepControl(**words)))
    max_steps: int
    to_node: bool


@dataclass(frozen=True, kw_only=True)
class ChangeEntry(Entry):
    """A contact point that changes its status.

    Attributes:
        surface: its name.
        x: place.
        before: letter of the status.
        after: likewise.
    """

    surface: str
    x: list[float]
    before: str
    after: str


@dataclass(frozen=True, kw_only=True)
class SpecialEntry(Entry):
    """A special point; see `continuation.SpecialPoint`.

    Attributes:
        kind: fold, event or bifurcation.
        smooth: whether statuses stay.
        gamma: where it is.
        parity: of the test for bifurcations.
        others: number of further rays.
        complete: whether these are all.
        bracket: values of gamma between which it lies; None if it is located.
        changes: of statuses, in order of coordinates.
    """

    kind: str
    smooth: bool
    gamma: float
    parity: Any
    others: int
    complete: Any
    bracket: list[float] | None
    changes: list[ChangeEntry] = field(metadata=_how(read=_entries(ChangeEntry)))


@dataclass(frozen=True, kw_only=True)
class NodePoint(SpecialEntry):
    """The special point of a node.

    Attributes:
        method: by which its rays were looked for.
    """

    method: Any


@dataclass(frozen=True, kw_only=True)
class RayEntry(Entry):
    """A ray of a node.

    Attributes:
        status: of its piece.
        gamma: the part of its unit tangent along gamma.
    """

    status: str
    gamma: float


@dataclass(frozen=True, kw_only=True)
class JournalNode(Entry):
    """A bifurcation of a recorded diagram; see `continuation.Node`.

    Attributes:
        point: the special point.
        rays: its rays.
        edges: number of the branch along each ray; None if none has taken it.
    """

    point: NodePoint = field(metadata=_how(read=NodePoint.of_line))
    rays: list[RayEntry] = field(metadata=_how(read=_entries(RayEntry)))
    edges: list[int | None]

    @property
    def gamma(self) -> float:
        """Where it is."""
        return float(self.point.gamma)


@dataclass(frozen=True, kw_only=True)
class JournalEdge(Entry):
    """A branch of a recorded diagram, with the numbers of nodes; see `continuation.Edge`.

    Attributes:
        branch: its number; one that could not be begun is not among the branches.
        start: number of a node, None at a start of the exploration.
        end: number of a node, None where the branch ends otherwise.
    """

    branch: int
    start: int | None
    end: int | None


@dataclass(frozen=True, kw_only=True)
class PointEntry(Entry):
    """A point of a branch; see `continuation.BranchPoint`, and `continuation.Stepping`.

    Attributes:
        index: of the point.
        gamma: where it is.
        step: length of the step to it.
        corrections: of that.
        tau: part of the step that was taken.
        status: letters of all contact points.
        counts: of statuses, by name.
        special: special points on the way to it.
        norm: length of the unknowns in the units of steps, 0 while these are not known; in memory
            only (`journal_of`) in those of the metric of the system.
        checkpoint: name of that where fields were kept.
        sum: fingerprint of that.
        functionals: by name.
        next_step: length of the next step; like the following unknown of what is in memory only.
        x_scale: square of the length of x that counts as 1.
        largest_distance: of all events up to it.
        scales: by which residuals are measured.
        tangent_gamma: part of the tangent along gamma.
        surface: name of the file with the outer surface, if that is kept.
        surface_sum: fingerprint of that file.
        ending: how the branch ends here.
        reason: why, in words.
    """

    index: int
    gamma: float
    step: float
    corrections: int
    tau: float
    status: str
    counts: dict[str, int]
    special: list[SpecialEntry] = field(metadata=_how(read=_entries(SpecialEntry)))
    norm: float
    checkpoint: str | None = field(default=None, metadata=_how(optional=True))
    sum: str | None = field(default=None, metadata=_how(optional=True))
    functionals: dict[str, float]
    next_step: float = float("nan")
    x_scale: float = float("nan")
    largest_distance: float = float("nan")
    scales: Sequence[float] = ()
    tangent_gamma: float = float("nan")
    surface: str | None = field(default=None, metadata=_how(optional=True))
    surface_sum: str | None = field(default=None, metadata=_how(optional=True))
    ending: Ending | None = field(default=None, metadata=_how(read=_ending, optional=True))
    reason: str | None = field(default=None, metadata=_how(optional=True))

    def line_after(self, before: PointEntry | None) -> dict[str, Any]:
        """It as a line, behind that of the point before: statuses are written when they change."""
        line = self.line()
        if before is not None and before.status == self.status:
            del line["status"]
        return line

    @staticmethod
    def of_line_after(line: Mapping[str, Any], points: Sequence[PointEntry]) -> PointEntry:
        """The point of a line behind other points.

        Raises:
            KeyError: if a key is missing.
            IndexError: if there is no status, and no point before.
        """
        status = {} if "status" in line else {"status": points[-1].status}
        return PointEntry.of_line({**line, **status})


@dataclass(frozen=True, kw_only=True)
class EndEntry(Entry):
    """The end of a branch or run.

    Attributes:
        ending: how it ended.
        reason: why, in words.
        checkpoint: of the last point of a branch, if that is kept now.
        sum: fingerprint of that.
    """

    ending: Ending = field(metadata=_how(read=_ending))
    reason: str
    checkpoint: str | None = field(default=None, metadata=_how(optional=True))
    sum: str | None = field(default=None, metadata=_how(optional=True))


# -- histories, motions and paths ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class HistoryGoesOn(Entry):
    """How a history continues from a state; see `evolution.run_state.RunState`."""

    number: int
    length: float
    rate: list[float] | None
    settled: bool
    ending: Ending | None = field(metadata=_how(read=_ending))
    reason: str


@dataclass(frozen=True, kw_only=True)
class Arrived(Entry):
    """By which way a path came to a state.

    Attributes:
        tangent: its part along gamma.
        piece: letters of the statuses.
        step: length of the step.
        corrections: of that.
        tau: part of the step that was taken.
    """

    tangent: float
    piece: str
    step: float
    corrections: int
    tau: float


def _arrived(line: Mapping[str, Any] | None) -> Arrived | None:
    return None if line is None else Arrived.of_line(line)


@dataclass(frozen=True, kw_only=True)
class PathGoesOn(Entry):
    """How a path continues from a state; see `evolution.path_state.PathState`."""

    gamma: float
    arrived: Arrived | None = field(metadata=_how(read=_arrived))
    number: int
    length: float
    known: Known = field(metadata=_how(read=lambda words: Known(**words)))
    ending: Ending | None = field(metadata=_how(read=_ending))
    reason: str


@dataclass(frozen=True, kw_only=True)
class StateEntry(Entry, Generic[G]):
    """The start or an accepted step of a history, a motion or a path.

    Attributes:
        index: of the state, 0 the start.
        time: of paths the arc length.
        status: letters of all contact points, surface by surface, in the order of their tables.
        size: Euclidean norm of all unknowns (``norm`` in lines, where points of branches have
            another one).
        energies: by name.
        data: values of the data that have changed since the state before, by place (`values_of`).
        row: of the table of steps; None at the start.
        first: whether statuses are not known.
        run: how the run continues from there.
        checkpoint: name of the checkpoint.
        sum: fingerprint of that.
        surface: name of the file with the outer surface, if that is kept.
        surface_sum: fingerprint of that file.
    """

    index: int
    time: float
    status: str
    size: float = field(metadata=_how(key="norm"))
    energies: dict[str, float]
    data: dict[str, Any]
    row: dict[str, Any] | None = field(default=None, metadata=_how(optional=True))
    first: bool
    run: G = field(metadata=_how(within=True))
    checkpoint: str
    sum: str
    surface: str | None = field(default=None, metadata=_how(optional=True))
    surface_sum: str | None = field(default=None, metadata=_how(optional=True))
