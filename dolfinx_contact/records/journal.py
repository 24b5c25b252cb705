# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journals of branches, of evolutions and of paths, and their reader.

All have one form on the disk (`lines.py`); a kind says which lines there are and what is in them.
Of branches every one has a line where it begins, a line for every point and a line where it ends;
of diagrams there are lines for nodes and edges, too.
Of evolutions and paths there are a line for the start, one where a run begins, one for every
accepted step, and one where a run ends.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._numbers import is_number
from dolfinx_contact._optional import optional
from dolfinx_contact.continuation.ending import Ending, Ends
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
    "JournalEdge",
    "JournalNode",
    "PathJournal",
    "read_journal",
]

_SPECIAL = ("kind", "smooth", "gamma", "parity", "others", "complete", "bracket")


@dataclass
class JournalBranch(Followed):
    """What is known of one branch; its ``task`` is range and scale of gamma, control and budget.

    Attributes:
        points: one dictionary a point, in order: ``index``, ``gamma``, ``step``, ``corrections``,
            ``tau``, ``norm``, ``status``, ``counts``, ``functionals``, ``special``, ``next_step``,
            ``x_scale``, ``largest_distance`` and, where fields were kept, ``checkpoint``.
    """

    points: list[dict[str, Any]] = field(default_factory=list)


@dataclass
class JournalNode:
    """A bifurcation of a recorded diagram; see `continuation.Node`.

    Attributes:
        point: the special point, as in the ``special`` of points of branches, and the ``method`` by
            which its rays were looked for.
        rays: one dictionary a ray: the ``status`` of its piece, and ``gamma``, the part of its unit
            tangent along gamma.
        edges: number of the branch along each ray; None if none has taken it.
    """

    point: dict[str, Any]
    rays: list[dict[str, Any]]
    edges: list[int | None]

    @property
    def gamma(self) -> float:
        """Where it is."""
        return float(self.point["gamma"])


@dataclass
class JournalEdge:
    """A branch of a recorded diagram, with the numbers of nodes; see `continuation.Edge`.

    Attributes:
        branch: its number; one that could not be begun is not among the branches.
        start: number of a node, None at a start of the exploration.
        end: number of a node, None where the branch ends otherwise.
    """

    branch: int
    start: int | None
    end: int | None


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
    """What is known of one run; its ``task`` is what it was to do, as times or a range of gamma.

    Attributes:
        after: index of the state at which it begins.
    """

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
        explored: how the diagram ended.
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
            columns[name] = np.array([p[name] for _, p in rows], int)
        for name in ("gamma", "step", "tau", "norm"):
            columns[name] = np.array([p[name] for _, p in rows], float)
        for name in self.functionals:
            columns[name] = np.array([p["functionals"][name] for _, p in rows], float)
        for name in ("open", "stick", "slip", "clamped"):
            columns[name] = np.array([p["counts"][name] for _, p in rows], int)
        kinds = [" ".join(s["kind"] for s in p["special"]) for _, p in rows]
        columns["special"] = np.array(kinds, dtype=object)
        columns["status"] = np.array([p["status"] for _, p in rows], dtype=object)
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
        special = [(s, p["index"]) for p in points for s in p["special"]]
        folds = [
            {
                "gamma": s["gamma"],
                "kind": "smooth" if s["smooth"] else "nonsmooth",
                "before": rows[i - 1]["status"],
                "after": rows[i]["status"],
            }
            for s, i in special
            if s["kind"] == "fold"
        ]
        return {
            "folds": folds,
            "events": sum(bool(s["changes"]) for s, _ in special),
            "bifurcations": [s["gamma"] for s, _ in special if s["kind"] == "bifurcation"],
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
        names = ["branch", "index", *_SPECIAL, "changes"]
        rows = [
            {"branch": b, "index": p["index"], **{k: s[k] for k in names[2:]}}
            for b in self._chosen(branch)
            for p in self.branches[b].points
            for s in p["special"]
        ]
        return optional("pandas", "records").DataFrame(rows, columns=names)

    @property
    def is_empty(self) -> bool:
        return not self.branches

    def entries(self, branch: int = 0) -> list[dict[str, Any]]:
        (chosen,) = self._chosen(branch)
        return self.branches[chosen].points

    def _take(self, kind: str, entry: dict[str, Any]) -> None:
        if kind == "branch":
            if entry["branch"] in self.branches:
                raise ValueError(f"branch {entry['branch']} begins twice")
            self.branches[entry["branch"]] = JournalBranch(entry["task"])
        elif kind == "point":
            branch = self.branches[entry.pop("branch")]
            if entry["index"] != len(branch.points):
                raise ValueError(
                    f"point {entry['index']} follows after {len(branch.points)} points"
                )
            for name in ("gamma", "next_step", "status", "special", "functionals", "counts"):
                if name == "status" and name not in entry:
                    entry[name] = branch.points[-1][name]  # written when it changes
                entry[name]
            branch.points.append(entry)
            branch.go_on()
            if "ending" in entry:
                branch.end(Ending[entry["ending"]], entry["reason"])
        elif kind == "end":
            branch = self.branches[entry["branch"]]
            branch.end(Ending[entry["ending"]], entry["reason"])
            branch.points[-1].update({k: entry[k] for k in ("checkpoint", "sum") if k in entry})
        elif kind == "node":
            number = entry.pop("node")
            self.nodes[number : number + 1] = [JournalNode(**entry)]  # anew when it changes
        elif kind == "edge":
            if entry["branch"] != len(self.edges):
                raise ValueError(f"edge {entry['branch']} follows after {len(self.edges)} edges")
            self.edges.append(JournalEdge(**entry))
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
        states: one dictionary for the start and for every accepted step, in order: ``time``,
            ``status`` (letters of all contact points, surface by surface, in the order of their
            tables), ``norm`` of all unknowns, ``energies``, and how the run goes on from there; of
            steps ``row``, that of the table of steps.
        runs: in order.
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

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """The same as numpy arrays by name; those that hold words or None are of objects."""
        rows = self.rows()
        found = {}
        for name in rows[0] if rows else ():
            values = [row[name] for row in rows]
            numbers = all(isinstance(v, bool | int | float) for v in values)
            found[name] = np.array(values) if numbers else np.array(values, dtype=object)
        return found

    @property
    def is_empty(self) -> bool:
        return not self.states

    def entries(self, branch: int = 0) -> list[dict[str, Any]]:
        if branch != 0:
            raise ValueError(f"{self.kind} has no branches, so no branch {branch}")
        return self.states

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
            self.runs.append(EvolutionRun(entry["task"], after=entry["after"]))
        elif kind == "end":
            self.runs[-1].end(Ending[entry["ending"]], entry["reason"])
        else:
            raise ValueError(f"lines of the kind {kind!r} are not known")


@dataclass
class PathJournal(EvolutionJournal):
    """What was recorded of a path by arc length, as an `EvolutionJournal`; times are lengths."""

    kind: ClassVar[str] = "a path"
    of_states: ClassVar[tuple[str, ...]] = (
        *EvolutionJournal.of_states,
        *("gamma", "arrived", "number", "length", "known", "reason"),
    )
    of_steps: ClassVar[tuple[str, ...]] = ("row",)

    @property
    def gammas(self) -> npt.NDArray[np.float64]:
        """The load at the start and at all accepted points."""
        return np.array([s["gamma"] for s in self.states])

    @property
    def folds(self) -> list[dict[str, Any]]:
        """The rows of points at which the load turns back."""
        return [row for row in self.rows() if row["event"].endswith("fold")]

    @property
    def kinks(self) -> list[dict[str, Any]]:
        """The rows of points at which statuses change and the load goes on."""
        return [row for row in self.rows() if row["event"] == "kink"]


_KINDS: dict[str, type[Journal | EvolutionJournal | PathJournal]] = {
    kind.kind: kind for kind in (Journal, EvolutionJournal, PathJournal)
}


def read_journal(folder: str | os.PathLike[str]) -> Journal | EvolutionJournal | PathJournal:
    """Read the journal of a folder, on this rank alone; it may be that of a run that goes on.

    Returns:
        The journal of the kind that it is.

    Raises:
        OSError: if there is none.
        ValueError: if it is damaged, no journal, or one of something that is not known.
    """
    data = (Path(folder) / FILE_NAME).read_bytes()
    name = kind_of(data) or Journal.kind  # what does not say it is refused as any of them
    if name not in _KINDS:
        known = ", ".join(_KINDS)
        raise ValueError(f"{folder} has the journal of {name}; known are those of {known}")
    return parse(data, _KINDS[name], Path(folder))
