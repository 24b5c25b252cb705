# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journals of branches, of evolutions and of paths, and their reader.

All have one form on the disk (`lines.py`); its kind decides which lines there are and what is in
them. Of branches every one has a line where it begins, a line for every point and a line where it
ends; of diagrams there are lines for nodes and edges, too.
Of evolutions and paths there are a line for the start, one where a run begins, one for every
accepted step, and one where a run ends.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._numbers import is_number
from dolfinx_contact._optional import optional
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.records.entries import (
    BranchTask,
    EndEntry,
    Entry,
    HistoryGoesOn,
    JournalEdge,
    JournalNode,
    PathGoesOn,
    PointEntry,
    SpecialEntry,
    StateEntry,
)
from dolfinx_contact.records.lines import (
    FILE_NAME,
    Followed,
    Lines,
    kind_of,
    parse,
)

__all__ = [
    "EvolutionJournal",
    "EvolutionRun",
    "Explored",
    "Journal",
    "JournalBranch",
    "PathJournal",
    "read_journal",
]


@dataclass
class JournalBranch(Followed):
    """What is known of one branch.

    Attributes:
        task: what it is to do; None of what is in memory only.
        points: in order.
    """

    task: BranchTask | None = None
    points: list[PointEntry] = field(default_factory=list)

    @property
    def kept(self) -> list[int]:
        """Indices of the points of which fields were kept."""
        return [p.index for p in self.points if p.checkpoint is not None]

    def end_with(self, end: EndEntry) -> None:
        """End it at its last point, of which a checkpoint may have been kept since."""
        self.end(end.ending, end.reason)
        if end.checkpoint is not None:
            last = replace(self.points[-1], checkpoint=end.checkpoint, sum=end.sum)
            self.points[-1] = last


@dataclass
class Explored(Ends):
    """How a recorded exploration ended.

    Attributes:
        ending: how; None if it has not.
        reason: why, in words.
        complete: whether every ray has been followed, and every node knows all of its rays.
    """

    ending: Ending | None = None
    reason: str = ""
    complete: bool = False


@dataclass
class EvolutionRun(Followed):
    """What is known of one run.

    Attributes:
        task: what it was to do, as times or a range of gamma.
        after: index of the state at which it begins.
    """

    task: dict[str, Any] = field(default_factory=dict)
    after: int = 0

    @property
    def complete(self) -> bool:
        """Whether it reached the last of its times, or the end of its range."""
        return self.ending is Ending.REACHED


@dataclass
class Journal(Lines):
    """What was recorded of branches; the ``header`` has the names of the functionals.

    Attributes:
        branches: by number.
        nodes: bifurcations of a diagram, by number; none of branches that were followed one by one.
        edges: what its branches lead from and to, by their number.
        explored: how the diagram ended; not at all if something was recorded since.
    """

    kind: ClassVar[str] = "branches"
    branches: dict[int, JournalBranch] = field(default_factory=dict)
    nodes: list[JournalNode] = field(default_factory=list)
    edges: list[JournalEdge] = field(default_factory=list)
    explored: Explored = field(default_factory=Explored)

    @property
    def functionals(self) -> list[str]:
        """Names of the functionals."""
        return list(self.header.get("functionals", []))

    @property
    def is_diagram(self) -> bool:
        """Whether its branches are those of an exploration, which end at nodes."""
        tasks = [branch.task for branch in self.branches.values()]
        return bool(self.edges) or any(task is not None and task.to_node for task in tasks)

    def columns(self, branch: int | None = None) -> dict[str, npt.NDArray[Any]]:
        """All points as numpy arrays by name, of one branch or of all, in order.

        ``branch``, ``index``, ``gamma``, ``step``, ``corrections``, ``tau``, ``norm``, the
        functionals, the numbers of points ``open``, ``stick``, ``slip`` and ``clamped``,
        ``special`` (kinds of special points on the way to the point) and ``status``.
        """
        chosen = self._chosen(branch)
        rows = [(b, p) for b in chosen for p in self.branches[b].points]
        columns: dict[str, npt.NDArray[Any]] = {"branch": np.array([b for b, _ in rows], int)}
        for name in ("index", "corrections"):
            columns[name] = np.array([getattr(p, name) for _, p in rows], int)
        for name in ("gamma", "step", "tau", "norm"):
            columns[name] = np.array([getattr(p, name) for _, p in rows], float)
        for name in self.functionals:
            columns[name] = np.array([p.functionals[name] for _, p in rows], float)
        for name in ("open", "stick", "slip", "clamped"):
            columns[name] = np.array([p.counts[name] for _, p in rows], int)
        kinds = [" ".join(s.kind for s in p.special) for _, p in rows]
        columns["special"] = np.array(kinds, dtype=object)
        columns["status"] = np.array([p.status for _, p in rows], dtype=object)
        return columns

    def rows(
        self, branch: int | None = None, columns: Sequence[str] | None = None
    ) -> list[dict[str, Any]]:
        """All points as dictionaries, of one branch or of all, in order.

        Args:
            branch: its number.
            columns: names of `columns`; by default ``gamma``, the functionals, and the ``status``
                of the points that are not clamped.
        """
        known = self.columns(branch)
        names = ["gamma", "status", *self.functionals] if columns is None else list(columns)
        if set(names) - set(known):
            raise ValueError(f"these are not columns: {', '.join(sorted(set(names) - set(known)))}")
        values: list[list[Any]] = [list(known[name].tolist()) for name in names]
        if columns is None:
            values[1] = [word.replace("d", "") for word in values[1]]
        return [dict(zip(names, row, strict=True)) for row in zip(*values, strict=True)]

    def summary(self, branch: int = 0) -> dict[str, Any]:
        """Scalars and lists of a branch for `summary.json`.

        ``folds``, each with gamma, its kind (``"smooth"``, ``"nonsmooth"``) and the statuses of the
        free points before and after; the number of ``events``; gammas of ``bifurcations``; and the
        last of `rows` as ``end``.
        """
        rows = self.rows(branch)
        points = self.branches[branch].points
        special = [(s, p.index) for p in points for s in p.special]
        folds = [
            {
                "gamma": s.gamma,
                "kind": "smooth" if s.smooth else "nonsmooth",
                "before": rows[i - 1]["status"],
                "after": rows[i]["status"],
            }
            for s, i in special
            if s.kind == "fold"
        ]
        return {
            "folds": folds,
            "events": sum(bool(s.changes) for s, _ in special),
            "bifurcations": [s.gamma for s, _ in special if s.kind == "bifurcation"],
            "end": rows[-1],
        }

    def table(self, branch: int | None = None) -> Any:
        """All points as a pandas DataFrame; see `columns`."""
        return optional("pandas", "records").DataFrame(self.columns(branch))

    def special(self, branch: int | None = None) -> Any:
        """Special points as a pandas DataFrame.

        ``branch``, ``index`` of the point that follows, ``kind``, ``smooth``, ``gamma``,
        ``parity``, ``others`` (number of further rays), ``complete``, ``bracket`` (the values
        of gamma between which it lies; None if it is located), and ``changes``, a list of
        dictionaries with the place ``x`` and the status ``before`` and ``after``.
        """
        names = ["branch", "index", *(f.name for f in fields(SpecialEntry))]
        rows = [
            {"branch": b, "index": p.index, **s.line()}
            for b in self._chosen(branch)
            for p in self.branches[b].points
            for s in p.special
        ]
        return optional("pandas", "records").DataFrame(rows, columns=names)

    @property
    def is_empty(self) -> bool:
        return not self.branches

    def all_entries(self) -> Iterator[PointEntry]:
        for branch in self.branches.values():
            yield from branch.points

    def entries(self, branch: int = 0) -> list[PointEntry]:
        (chosen,) = self._chosen(branch)
        return self.branches[chosen].points

    def _take(self, kind: str, entry: dict[str, Any]) -> None:
        if kind != "explored":
            self.explored = Explored()
        if kind == "branch":
            if entry["branch"] in self.branches:
                raise ValueError(f"branch {entry['branch']} begins twice")
            task = BranchTask.of_line(entry["task"])
            self.branches[entry["branch"]] = JournalBranch(task=task)
        elif kind == "point":
            branch = self.branches[entry["branch"]]
            point = PointEntry.of_line_after(entry, branch.points)
            if point.index != len(branch.points):
                raise ValueError(f"point {point.index} follows after {len(branch.points)} points")
            branch.points.append(point)
            branch.go_on()
            if point.ending is not None:
                branch.end(point.ending, point.reason or "")
        elif kind == "end":
            branch = self.branches[entry["branch"]]
            branch.end_with(EndEntry.of_line(entry))
        elif kind == "node":
            number = entry["node"]
            if not 0 <= number <= len(self.nodes):
                raise ValueError(f"node {number} follows after {len(self.nodes)} nodes")
            self.nodes[number : number + 1] = [JournalNode.of_line(entry)]  # anew when it changes
        elif kind == "edge":
            edge = JournalEdge.of_line(entry)
            if edge.branch != len(self.edges):
                raise ValueError(f"edge {edge.branch} follows after {len(self.edges)} edges")
            self.edges.append(edge)
        elif kind == "explored":
            self.explored = Explored(Ending[entry["ending"]], entry["reason"], entry["complete"])
        else:
            raise ValueError(f"lines of the kind {kind!r} are not known")

    def _chosen(self, branch: int | None) -> list[int]:
        known = branch is None or (is_number(branch) and branch in self.branches)
        if not known:
            raise ValueError(f"no branch {branch} was recorded, only {sorted(self.branches)}")
        return sorted(self.branches) if branch is None else [branch]


@dataclass
class EvolutionJournal(Lines):
    """What was recorded of the runs of an evolution.

    Attributes:
        states: the start and every accepted step, in order.
        runs: in order.
    """

    kind: ClassVar[str] = "an evolution"
    #: How a run continues from a state.
    run_entry: ClassVar[type[Entry]] = HistoryGoesOn
    states: list[StateEntry[Any]] = field(default_factory=list)
    runs: list[EvolutionRun] = field(default_factory=list)

    def rows(self) -> list[dict[str, Any]]:
        """The table of all steps, with their ``status``, for `write_rows`."""
        return [s.row | {"status": s.status} for s in self.states if s.row is not None]

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """The same as numpy arrays by name; those that hold words or None are of objects."""
        rows = self.rows()
        found = {}
        for name in rows[0] if rows else ():
            values = [row[name] for row in rows]
            numbers = all(isinstance(v, bool | int | float) for v in values)
            found[name] = np.array(values) if numbers else np.array(values, dtype=object)
        return found

    def data_at(self, index: int) -> dict[str, Any]:
        """The values of all data at a state, by place; see `manifest.values_of`."""
        found: dict[str, Any] = {}
        for state in self.states[: index + 1]:
            found |= state.data
        return found

    @property
    def is_empty(self) -> bool:
        return not self.states

    def all_entries(self) -> Iterator[StateEntry[Any]]:
        yield from self.states

    def entries(self, branch: int = 0) -> list[StateEntry[Any]]:
        if branch != 0:
            raise ValueError(f"{self.kind} has no branches, so no branch {branch}")
        return self.states

    def _take(self, kind: str, entry: dict[str, Any]) -> None:
        if kind == "state":
            state: StateEntry[Any] = StateEntry.of_line(entry, run=self.run_entry)
            if state.index != len(self.states):
                raise ValueError(f"state {state.index} follows after {len(self.states)} states")
            if (state.row is None) != (not self.states):
                raise ValueError("steps have a row of the table, and the start has none")
            if self.states:
                self.runs[-1].go_on()
            self.states.append(state)
        elif kind == "run":
            if not entry["after"] == len(self.states) - 1 >= 0:
                raise ValueError(f"a run begins at state {entry['after']}")
            self.runs.append(EvolutionRun(task=entry["task"], after=entry["after"]))
        elif kind == "end":
            end = EndEntry.of_line(entry)
            self.runs[-1].end(end.ending, end.reason)
        else:
            raise ValueError(f"lines of the kind {kind!r} are not known")


@dataclass
class PathJournal(EvolutionJournal):
    """What was recorded of a path by arc length, as an `EvolutionJournal`; times are lengths."""

    kind: ClassVar[str] = "a path"
    run_entry: ClassVar[type[Entry]] = PathGoesOn

    @property
    def gammas(self) -> npt.NDArray[np.float64]:
        """The load at the start and at all accepted points."""
        return np.array([s.run.gamma for s in self.states])

    @property
    def folds(self) -> list[dict[str, Any]]:
        """The rows of points at which the load turns back."""
        return [row for row in self.rows() if row["event"].endswith("fold")]

    @property
    def kinks(self) -> list[dict[str, Any]]:
        """The rows of points at which statuses change and the load continues."""
        return [row for row in self.rows() if row["event"] == "kink"]


_KINDS: dict[str, type[Journal | EvolutionJournal | PathJournal]] = {
    kind.kind: kind for kind in (Journal, EvolutionJournal, PathJournal)
}


def read_journal(folder: str | os.PathLike[str]) -> Journal | EvolutionJournal | PathJournal:
    """Read the journal of a folder, on this rank alone; it may be that of a run that continues.

    Returns:
        The journal of the kind that it is.

    Raises:
        OSError: if there is none.
        ValueError: if it is damaged, no journal, or one of something that is not known.
    """
    data = (Path(folder) / FILE_NAME).read_bytes()
    name = kind_of(data) or Journal.kind  # what has no kind is refused as any of them
    if name not in _KINDS:
        known = ", ".join(_KINDS)
        raise ValueError(f"{folder} has the journal of {name}; known are those of {known}")
    return parse(data, _KINDS[name], Path(folder))
