# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journals of branches, evolutions and paths: format, content and reader.

A journal has one JSON object per line, and lines are only appended. The item `type` of a line is

    header    manifest of the problem, once
    session   a recording run: ranks, versions, start time
    begin     start of a branch, or of a run of an evolution or path: number `branch`, `task`, and
              `after`, the index of the initial state of a run
    point     accepted point of a branch; start or accepted step of an evolution or path
    end       ending of a branch or run, if its last point does not contain it
    node      bifurcation of a diagram, repeated when branches are added to it
    edge      branch of a diagram with its nodes
    explored  end of the exploration of a diagram

The entry of a point contains the number of its `branch`, its `index`, the `status` of all contact
points as letters (only if it differs from the previous point of the branch), and the `ending` and
`reason` if the branch or run ends there. `checkpoint` and `surface` are the names of its array
files, `sum` and `surface_sum` the fingerprints of these files. The remaining columns depend on the
kind of the journal:

- Branches: `gamma`, `step`, `corrections`, `tau` (`continuation.BranchPoint`), `special` (points of
  `continuation.SpecialPoint` on the way, with `changes` of statuses at `x`), `norm` (norm of the
  unknowns in units of steps), `functionals`, and step data for resumption.
- Evolutions: `time`, `size` (norm of the unknowns), `energies`, `data` (`manifest.values_of`),
  `row` (of the table of `History.rows`), and `run`, the items of `evolution.run.RunState`.
- Paths: the columns of evolutions, with the arc length as `time`, and `gamma`.

Every line contains its number and ends with the CRC-32 of the preceding text. A run may be killed
at any time: an incomplete last line is ignored. Any other corrupt or missing line is an error.
Reading a journal requires only the standard library and NumPy:

    journal = read_journal(folder)
    journal.columns(), journal.rows(), journal.to_pandas()    one value or row per point or step
    journal.entries(branch)                                   points or steps
    journal.surface(), journal.surface_at(index, branch)      outer surface of the bodies
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array
from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact._install import optional
from dolfinx_contact._validate import is_number
from dolfinx_contact.laws import status
from dolfinx_contact.records.arrays import check, load
from dolfinx_contact.results.outer_surface import OuterSurface, SurfaceState, nested

__all__ = [
    "ARRAYS",
    "FILE_NAME",
    "FORMAT",
    "AnyJournal",
    "Entry",
    "EvolutionJournal",
    "Explored",
    "Journal",
    "PathJournal",
    "RecordedRun",
    "array_file",
    "encoded",
    "outer_surface_file",
    "parse",
    "read_journal",
    "reread",
]

FILE_NAME = "journal.jsonl"
FORMAT = 6
_CRC = ', "crc": "'


class _ArrayKind(NamedTuple):
    """Kind of array files that belong to points of a record.

    Attributes:
        folder: name of the folder of these files.
        checksum: name of the journal item that contains the fingerprint of such a file.
    """

    folder: str
    checksum: str


#: Arrays of a point, by the item of its entry with the name of the file.
ARRAYS = {
    "checkpoint": _ArrayKind("checkpoints", "sum"),
    "surface": _ArrayKind("surface", "surface_sum"),
}


def array_file(folder: Path, kind: str, name: str) -> Path:
    """Return the path of the "checkpoint" or "surface" file of a point."""
    return folder / ARRAYS[kind].folder / f"{name}.npz"


def outer_surface_file(folder: Path) -> Path:
    """Return the path of the file with the undeformed outer surface."""
    return folder / "surface.npz"


# -- lines -----------------------------------------------------------------------------------------


class Entry(dict[str, Any]):
    """Entry of a journal: a JSON object with attribute access; missing items are None."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self.get(name)


def encoded(entry: Mapping[str, Any]) -> bytes:
    """Encode an entry as a line with a CRC; floats are written without loss of digits.

    Numbers that are not finite are written as NaN and Infinity, as in Python's JSON.
    """
    body = json.dumps(entry, default=_plain)[:-1]
    return f'{body}{_CRC}{zlib.crc32(body.encode()):08x}"}}\n'.encode()


def _plain(value: Any) -> Any:
    """Convert enumerations, NumPy numbers and arrays, and dataclasses to JSON types."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in fields(value)}
    raise TypeError(f"{type(value).__name__} cannot be recorded")


def reread(entry: Mapping[str, Any]) -> Entry:
    """Encode an entry and decode it again, as if it were read from a journal."""
    return _decoded(encoded(entry).rstrip(b"\n"))


def _decoded(line: bytes) -> Entry:
    """Decode a line of a journal and return its entry.

    Raises:
        ValueError: if the checksum of the line is wrong.
    """
    body, mark, crc = line.decode().rpartition(_CRC)
    if not mark or crc != f'{zlib.crc32(body.encode()):08x}"}}':
        raise ValueError("its checksum is wrong")
    entry: Entry = json.loads(body + "}", object_hook=Entry)
    return entry


# -- journals --------------------------------------------------------------------------------------


@dataclass
class RecordedRun(Ends):
    """Content of a journal about one branch, or about one run of an evolution or path.

    Attributes:
        task: attributes of the task by name; empty for a journal in memory.
        points: entries of the points, in order; in the first run, the first entry is the start.
        after: index of the recorded state from which a run starts; 0 for branches.
        ending: kind of reason why the branch or run ended; None if it has not ended.
        reason: reason why the branch or run ended, as a sentence.
    """

    task: dict[str, Any] = field(default_factory=dict)
    points: list[Entry] = field(default_factory=list)
    after: int = 0
    ending: Ending | None = None
    reason: str = ""

    @property
    def kept(self) -> list[int]:
        """Indices of the points with a checkpoint."""
        return [p.index for p in self.points if p.checkpoint is not None]

    @property
    def complete(self) -> bool:
        """Whether the run reached its last time or the end of its range."""
        return self.ending is Ending.REACHED


@dataclass(repr=False)
class AnyJournal:
    """Common content of all journals.

    Attributes:
        header: dictionary with the manifest of the problem and positions of the contact points.
        sessions: one dictionary per recording run, with ranks, versions and start time; the first
            one contains the fingerprint of the outer surface.
        branches: branches, or runs of an evolution or path, by number.
        lines: number of complete lines that were read or written.
        length: size of the complete lines in bytes when the journal was read.
        torn: whether the last line was incomplete when the journal was read.
        folder: folder of the record; None for a journal in memory only.
    """

    kind: ClassVar[str]
    header: dict[str, Any] = field(default_factory=dict)
    sessions: list[dict[str, Any]] = field(default_factory=list)
    branches: dict[int, RecordedRun] = field(default_factory=dict)
    lines: int = 0
    length: int = 0
    torn: bool = False
    folder: Path | None = None

    def __repr__(self) -> str:
        place = "in memory" if self.folder is None else f"in {self.folder}"
        runs, points = len(self.branches), len(self.all_entries())
        return f"<{type(self).__name__} {place}: branches or runs {runs}, points {points}>"

    @property
    def places(self) -> dict[str, Array]:
        """Coordinates of the n contact points of each surface, by name, shape (n, dim).

        Points are in the order of their statuses in the entries.
        """
        return {k: np.array(x, float) for k, x in self.header["points"].items()}

    @property
    def is_empty(self) -> bool:
        """Whether no point was recorded yet."""
        return not self.all_entries()

    def entries(self, branch: int = 0) -> list[Entry]:
        """Return the entries of all points of a branch, or all states of a history or path.

        Raises:
            ValueError: if the branch does not exist.
        """
        return [p for _, p in self._points(branch)]

    def all_entries(self) -> list[Entry]:
        """Return the entries of the points of all branches or runs."""
        return [p for _, p in self._points(None)]

    def rows(self, branch: int | None = None) -> list[dict[str, Any]]:
        """Return a table with one row per point.

        Args:
            branch: number of the branch or run; default: all.
        """
        raise NotImplementedError

    def columns(self, branch: int | None = None) -> dict[str, npt.NDArray[Any]]:
        """Return the columns of `rows` as NumPy arrays by name; text and None have dtype object."""
        return _columns(self.rows(branch))

    def to_pandas(self, branch: int | None = None) -> Any:
        """Return the points of one or all branches as a pandas DataFrame; see `columns`."""
        return optional("pandas", "records").DataFrame(self.columns(branch))

    def surface(self) -> OuterSurface:
        """Return the undeformed outer surface of the bodies. Not collective.

        Raises:
            ValueError: if the record has no outer surface yet, or its file is missing or corrupt.
        """
        if self.folder is None or not self.sessions:
            raise ValueError("the journal is in memory only or has no session, thus no surface")
        arrays = load(outer_surface_file(self.folder), self.sessions[0]["outer_surface"])
        return OuterSurface(**nested(arrays))

    def surface_at(self, index: int, branch: int = 0) -> SurfaceState:
        """Return the outer surface at a recorded point. Not collective.

        Args:
            index: number of the point, or of the step of a history or path; 0 is the start.
            branch: number of the branch; 0 for histories and paths.

        Raises:
            ValueError: if the point does not exist, if its displacement was not recorded, or if the
                file with the displacement is missing or corrupt.
        """
        entries = self.entries(branch)
        if not 0 <= index < len(entries):
            raise ValueError(f"points 0 to {len(entries) - 1} are recorded, not {index}")
        entry = entries[index]
        if entry.surface is None or self.folder is None:
            raise ValueError(
                f"no displacement was recorded at point {index}: record with "
                "surface_displacement=True"
            )
        arrays = load(array_file(self.folder, "surface", entry.surface), entry.surface_sum)
        return SurfaceState(**nested(arrays))

    def check_surfaces(self) -> None:
        """Raise `ValueError` if a file with the outer surface is missing or was replaced."""
        if self.folder is None or not self.sessions:
            return
        check(outer_surface_file(self.folder), self.sessions[0]["outer_surface"])
        for entry in self.all_entries():
            if entry.surface is not None:
                check(array_file(self.folder, "surface", entry.surface), entry.surface_sum)

    def take(self, entry: Entry) -> None:
        """Add the next entry of a journal file to this journal.

        Raises:
            ValueError: if the entry is a header of another kind or format.
        """
        kind = entry.pop("type")
        self.lines = entry.pop("line")
        if kind == "header":
            self._require_kind(entry)
            self.header = entry
        elif kind == "session":
            self.sessions.append(entry)
        else:
            self._take(kind, entry)

    def _require_kind(self, header: Mapping[str, Any]) -> None:
        if header["format"] != FORMAT:
            raise ValueError(
                f"the journal is in format {header['format']}, and this version of "
                f"dolfinx_contact reads and writes format {FORMAT} only: use the version that "
                f"wrote it ({header.get('package', 'unknown')}), or record again"
            )
        if header["of"] != self.kind:
            raise ValueError(f"it is the journal of {header['of']}, not of {self.kind}")

    def _take(self, kind: str, entry: Entry) -> None:
        """Add an entry of any type except header and session."""
        number = entry.pop("branch")
        if kind == "begin":
            self.branches[number] = RecordedRun(entry.task, after=entry.after)
            return
        branch = self.branches[number]
        if kind == "point":
            if "status" not in entry:
                entry["status"] = branch.points[-1].status
            branch.points.append(entry)
            branch.go_on()
        elif entry.checkpoint is not None:
            branch.points[-1] |= {"checkpoint": entry.checkpoint, "sum": entry.sum}
        if entry.ending is not None:
            branch.end(Ending[entry.ending], entry.reason)

    def _points(self, branch: int | None) -> list[tuple[int, Entry]]:
        """Return pairs of branch number and entry of a point, for one branch or all branches."""
        if branch is not None and not (is_number(branch) and branch in self.branches):
            raise ValueError(f"no branch {branch} was recorded, only {sorted(self.branches)}")
        numbers = sorted(self.branches) if branch is None else [branch]
        return [(b, p) for b in numbers for p in self.branches[b].points]


@dataclass
class Explored(Ends):
    """End of a recorded exploration of a diagram.

    Attributes:
        ending: kind of reason why the exploration ended; None if it has not ended.
        reason: reason why the exploration ended, as a sentence.
        complete: whether all rays of every node are known and have been followed.
    """

    ending: Ending | None = None
    reason: str = ""
    complete: bool = False


@dataclass(repr=False)
class Journal(AnyJournal):
    """Journal of branches.

    Attributes:
        nodes: bifurcations of a diagram by number; empty if branches were followed one by one.
        edges: branches of a diagram with the nodes where they start and end, by number.
        explored: end of the exploration; without an ending if more entries have been recorded
            since.
    """

    kind: ClassVar[str] = "branches"
    nodes: list[Entry] = field(default_factory=list)
    edges: list[Entry] = field(default_factory=list)
    explored: Explored = field(default_factory=Explored)

    @property
    def functionals(self) -> list[str]:
        """Names of the functionals."""
        return list(self.header.get("functionals", []))

    @property
    def is_diagram(self) -> bool:
        """Whether the branches were recorded as edges that end at the nodes of a diagram."""
        return bool(self.edges) or any(b.task.get("to_node") for b in self.branches.values())

    def columns(self, branch: int | None = None) -> dict[str, npt.NDArray[Any]]:
        """Return the points of one or all branches as arrays by name, shape (points,) each.

        The names are ``branch``, ``index``, ``gamma``, ``step``, ``corrections``, ``tau``,
        ``norm``, the functionals, the numbers of points ``open``, ``stick``, ``slip`` and
        ``clamped``, ``special`` (kinds of special points on the way to the point) and ``status``.
        """
        names = (*_INTEGERS, *_FLOATS, *self.functionals, *status.KINDS, "special", "status")
        rows = [
            {"branch": b, **p, **p.functionals, **status.count(p.status)}
            | {"special": " ".join(s.kind for s in p.special)}
            for b, p in self._points(branch)
        ]
        return _columns(rows, names)

    def rows(self, branch: int | None = None) -> list[dict[str, Any]]:
        """Return a table with ``gamma``, the functionals, and ``status``, one row per point.

        ``status`` contains the letters of the contact points that are not clamped.

        Args:
            branch: number of the branch; default: all branches.
        """
        return [
            {"gamma": p.gamma, "status": p.status.replace("d", ""), **p.functionals}
            for _, p in self._points(branch)
        ]

    def summary(self, branch: int = 0) -> dict[str, Any]:
        """Summarise a branch by scalars and lists, for example for `io.write_summary`.

        The items are ``folds``, each with gamma, its kind (``"smooth"``, ``"nonsmooth"``) and the
        statuses of the free points before and after; the number of ``events``; the gammas of
        ``bifurcations``; and the last of `rows` as ``end``.
        """
        rows = self.rows(branch)
        special = [(s, p.index) for p in self.entries(branch) for s in p.special]
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

    def special(self, branch: int | None = None) -> Any:
        """Return the special points as a pandas DataFrame.

        The columns, most of which are attributes of `continuation.SpecialPoint`, are ``branch``,
        ``index`` of the following point, ``kind``, ``smooth``, ``gamma``, ``parity``, ``others``
        (number of other rays), ``complete``, ``bracket`` (two values of gamma between which the
        special point lies; None if it was located exactly), and ``changes``, a list of dictionaries
        with the position ``x`` and the status ``before`` and ``after``.
        """
        rows = [
            {"branch": b, "index": p.index, **s} for b, p in self._points(branch) for s in p.special
        ]
        names = ["branch", "index", *_SPECIAL]
        return optional("pandas", "records").DataFrame(rows, columns=names)

    def _take(self, kind: str, entry: Entry) -> None:
        self.explored = Explored()
        if kind == "node":
            number = entry.pop("node")
            self.nodes[number : number + 1] = [entry]  # again when it changes
        elif kind == "edge":
            self.edges.append(entry)
        elif kind == "explored":
            self.explored = Explored(Ending[entry.ending], entry.reason, entry.complete)
        else:
            super()._take(kind, entry)


_INTEGERS = ("branch", "index", "corrections")
_FLOATS = ("gamma", "step", "tau", "norm")
_SPECIAL = ("kind", "smooth", "gamma", "parity", "others", "complete", "bracket", "changes")


def _columns(
    rows: Sequence[Mapping[str, Any]], names: Iterable[str] = ()
) -> dict[str, npt.NDArray[Any]]:
    """Return the values of rows as arrays by name.

    Args:
        rows: rows of a table.
        names: names of the columns; default: keys of the first row.
    """
    columns = {}
    for name in names or (rows[0] if rows else ()):
        values = [row[name] for row in rows]
        numbers = all(isinstance(v, bool | int | float) for v in values)
        columns[name] = np.array(values, dtype=None if numbers else object)
    return columns


@dataclass(repr=False)
class EvolutionJournal(AnyJournal):
    """Journal of the runs of an evolution.

    Attributes:
        states: entries of the start and of every accepted step of all runs, in order.
    """

    kind: ClassVar[str] = "an evolution"
    states: list[Entry] = field(default_factory=list)

    @property
    def runs(self) -> list[RecordedRun]:
        """Recorded runs, in the order in which they were made."""
        return [self.branches[number] for number in sorted(self.branches)]

    def entries(self, branch: int = 0) -> list[Entry]:
        if branch != 0:
            raise ValueError(f"{self.kind} has no branches, so no branch {branch}")
        return self.states

    def rows(self, branch: int | None = None) -> list[dict[str, Any]]:
        """Return `History.rows` with a column ``status``: a row for the start and for each step.

        Args:
            branch: number of the run; default: all runs. The start is in the first run.
        """
        return [p.row | {"status": p.status} for _, p in self._points(branch)]

    def loads(self) -> dict[str, Array]:
        """Return the values of changing Constants at all states, by description.

        Descriptions of vectors end with the component, as in "point of HalfSpace of 'floor' y".
        Dirichlet values are the columns ``support_0_ux``, ... of `rows`. On a path,
        `PathJournal.gammas` is the load.
        """
        first = self.states[0].data if self.states else {}
        numbers = [name for name, values in first.items() if isinstance(values, list)]
        found: dict[str, Array] = {}
        for name in numbers:
            values = np.array([s.data[name] for s in self.states])
            changing = np.flatnonzero(np.ptp(values, axis=0) > 0)
            size = values.shape[1]
            parts = [f" {part}" for part in ("xyz" if size <= 3 else range(size))]
            short = name.removeprefix("the ")
            found |= {short + parts[i] if size > 1 else short: values[:, i] for i in changing}
        return found

    def _take(self, kind: str, entry: Entry) -> None:
        super()._take(kind, entry)
        if kind == "point":
            self.states.append(entry)


@dataclass(repr=False)
class PathJournal(EvolutionJournal):
    """Journal of an arc-length path: an `EvolutionJournal` whose times are arc lengths."""

    kind: ClassVar[str] = "a path"

    @property
    def gammas(self) -> Array:
        """Load parameter gamma at the start and at all accepted points, shape (points,)."""
        return np.array([s.gamma for s in self.states])

    @property
    def folds(self) -> list[dict[str, Any]]:
        """Rows of the table for the points at which the load parameter gamma turns back."""
        return [row for row in self.rows() if row["event"].endswith("fold")]

    @property
    def kinks(self) -> list[dict[str, Any]]:
        """Rows of the table for the points at which a status changes but gamma continues."""
        return [row for row in self.rows() if row["event"] == "kink"]


J = TypeVar("J", bound=AnyJournal)
_KINDS: dict[str, type[Journal | EvolutionJournal | PathJournal]] = {
    kind.kind: kind for kind in (Journal, EvolutionJournal, PathJournal)
}


def parse(data: bytes, kind: type[J], folder: Path | None = None) -> J:
    """Parse the content of a journal file; an incomplete last line is ignored.

    Args:
        data: content of the file.
        kind: class of the journal.
        folder: folder of the record.

    Raises:
        ValueError: if a line is corrupt or missing, or the journal has another kind or format.
    """
    *lines, rest = data.split(b"\n")
    journal = kind(length=len(data) - len(rest), torn=bool(rest), folder=folder)
    for number, line in enumerate(lines, 1):
        try:
            entry = _decoded(line)
            if entry["line"] != number:
                raise ValueError(f"it is not line {number}: lines are missing before it")
        except ValueError as error:
            raise ValueError(f"line {number} of the journal is damaged: {error}") from None
        journal.take(entry)
    return journal


def read_journal(folder: str | os.PathLike[str]) -> Journal | EvolutionJournal | PathJournal:
    """Read the journal of a record, even while a run is writing to it. Not collective.

    Returns:
        A `Journal`, `EvolutionJournal` or `PathJournal`, according to the kind of the record.

    Raises:
        OSError: if the folder does not contain a journal.
        ValueError: if the journal is corrupt or of an unknown kind.
    """
    data = (Path(folder) / FILE_NAME).read_bytes()
    try:
        name = str(_decoded(data.partition(b"\n")[0])["of"])
    except (ValueError, KeyError):  # empty, or damaged: then `parse` raises
        name = Journal.kind
    if name not in _KINDS:
        kinds = ", ".join(_KINDS)
        raise ValueError(f"{folder} has the journal of {name}; known kinds: {kinds}")
    return parse(data, _KINDS[name], Path(folder))
