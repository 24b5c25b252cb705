# SPDX-License-Identifier: LGPL-3.0-or-later
"""The journal of a continuation: one JSON object a line, only ever appended to.

The first line names the problem; then every branch has a line where it begins, a line for every
point and a line where it ends. A line is on the disk before the next point is computed, so that a
run may be killed at any moment: at worst the last line lacks its end, and is not counted; a journal
without a complete line counts as none. Every line ends with the CRC-32 of what is before it; a line
that was damaged later is an error.
"""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from dolfinx_contact._optional import optional
from dolfinx_contact.output.disk import os_error, sync_folder
from dolfinx_contact.output.lock import Lock

__all__ = [
    "FILE_NAME",
    "FORMAT",
    "Journal",
    "JournalBranch",
    "JournalFile",
    "parse",
    "read_journal",
]

FILE_NAME = "journal.jsonl"
FORMAT = 1
_MARK = ', "crc": "'
_SPECIAL = ("kind", "smooth", "gamma", "parity", "others", "complete", "bracket")


@dataclass
class JournalBranch:
    """What is known of one branch.

    Attributes:
        task: range and scale of gamma, step control, budget.
        points: one dictionary a point, in order: ``index``, ``gamma``, ``step``, ``corrections``,
            ``tau``, ``norm``, ``status``, ``counts``, ``functionals``, ``special``, ``next_step``,
            ``x_scale``, ``largest_distance`` and, where fields were kept, ``checkpoint``.
        reason: why it ended; empty if it has not.
    """

    task: dict[str, Any]
    points: list[dict[str, Any]] = field(default_factory=list)
    reason: str = ""


@dataclass
class Journal:
    """What was recorded.

    Attributes:
        header: what identifies the problem, the names of the functionals, and (not in journals of
            old) the places of the contact points.
        branches: by number.
        sessions: one dictionary for every run that recorded: ranks, versions, time of its start.
        length: of the file in bytes, without a last line that was not finished.
        torn: whether there is such a line.
    """

    header: dict[str, Any] = field(default_factory=dict)
    branches: dict[int, JournalBranch] = field(default_factory=dict)
    sessions: list[dict[str, Any]] = field(default_factory=list)
    length: int = 0
    torn: bool = False

    @property
    def functionals(self) -> list[str]:
        """Names of the functionals."""
        return list(self.header.get("functionals", []))

    @property
    def places(self) -> dict[str, npt.NDArray[np.float64]]:
        """Coordinates (n, dim) of contact points by surface, in the order of the statuses.

        Empty for a journal that does not have them.
        """
        return {k: np.array(x, float) for k, x in self.header.get("points", {}).items()}

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
        rows, points = self.rows(branch), self.branches[branch].points
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
        return optional("pandas", "output").DataFrame(self.columns(branch))

    def special(self, branch: int | None = None) -> Any:
        """Special points as a pandas DataFrame.

        ``branch``, ``index`` of the point that follows, ``kind``, ``smooth``, ``gamma``,
        ``parity``, ``others`` (number of further rays), ``complete``, ``bracket`` (the values
        of gamma between which it lies; None if it is located), and ``changes``, a list of
        dictionaries with the place ``x`` and the status ``before`` and ``after``.
        """
        names = ["branch", "index", *_SPECIAL, "changes"]
        rows = [
            {"branch": b, "index": p["index"], **{k: s.get(k) for k in names[2:]}}
            for b in self._chosen(branch)
            for p in self.branches[b].points
            for s in p["special"]
        ]
        return optional("pandas", "output").DataFrame(rows, columns=names)

    def _chosen(self, branch: int | None) -> list[int]:
        if branch is not None and branch not in self.branches:
            raise ValueError(f"no branch {branch} was recorded, only {sorted(self.branches)}")
        return sorted(self.branches) if branch is None else [branch]


def read_journal(folder: str | os.PathLike[str]) -> Journal:
    """Read the journal of a folder, on this rank alone; it may be that of a run that goes on.

    Raises:
        OSError: if there is none.
        ValueError: if it is damaged, or no journal.
    """
    return parse((Path(folder) / FILE_NAME).read_bytes())


def parse(data: bytes) -> Journal:
    """The journal in ``data``; a last line that was not finished is left out.

    Raises:
        ValueError: if a line is damaged or does not follow from those before it.
    """
    *lines, rest = data.split(b"\n")
    journal = Journal(length=len(data) - len(rest), torn=bool(rest))
    for number, line in enumerate(lines, 1):
        try:
            _take(journal, _decode(line))
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise ValueError(f"line {number} of the journal is damaged: {error}") from None
    return journal


def _take(journal: Journal, entry: dict[str, Any]) -> None:
    """Add one line to what was read before."""
    kind = entry.pop("type")
    if (kind == "header") != (not journal.header):
        raise ValueError("a journal has one header, as its first line")
    if kind == "header":
        if entry["format"] != FORMAT:
            raise ValueError(f"its format is {entry['format']}, known is {FORMAT}")
        journal.header = entry
    elif kind == "session":
        journal.sessions.append(entry)
    elif kind == "branch":
        if entry["branch"] in journal.branches:
            raise ValueError(f"branch {entry['branch']} begins twice")
        journal.branches[entry["branch"]] = JournalBranch(entry["task"])
    elif kind == "point":
        branch = journal.branches[entry.pop("branch")]
        if entry["index"] != len(branch.points):
            raise ValueError(f"point {entry['index']} follows after {len(branch.points)} points")
        for name in ("gamma", "next_step", "status", "special", "functionals", "counts"):
            if name == "status" and name not in entry:
                entry[name] = branch.points[-1][name]  # written when it changes
            entry[name]
        branch.points.append(entry)
        branch.reason = ""
    elif kind == "end":
        branch = journal.branches[entry["branch"]]
        branch.reason = entry["reason"]
        branch.points[-1].update({k: entry[k] for k in ("checkpoint", "sum") if k in entry})
    else:
        raise ValueError(f"lines of the kind {kind!r} are not known")


def _encode(entry: Mapping[str, Any]) -> bytes:
    """A line for ``entry``; numbers keep all their digits, those that are not finite are words."""
    body = json.dumps(_plain(entry), allow_nan=False)[:-1]
    return f'{body}{_MARK}{zlib.crc32(body.encode()):08x}"}}\n'.encode()


def _decode(line: bytes) -> dict[str, Any]:
    text = line.decode()
    body, mark, crc = text.rpartition(_MARK)
    if not mark or crc != f'{zlib.crc32(body.encode()):08x}"}}':
        raise ValueError("its check sum is wrong")
    return dict(json.loads(body + "}", object_hook=_number))


def _number(entry: dict[str, Any]) -> Any:
    """A number that is not finite, if ``entry`` stands for one."""
    return float(entry["float"]) if list(entry) == ["float"] else entry


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    return value


def _is_blank(path: Path) -> bool:
    """Whether a journal has no complete line: it was left in the first moment of a run."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        return not file.readline().endswith(b"\n")


class JournalFile:
    """A journal that is open for appending, locked against other processes. On one rank.

    Args:
        folder: where it is, or is to be.
        new: whether it must not exist yet.

    Attributes:
        journal: what was in it when it was opened.

    Raises:
        FileExistsError: if it is to be new and something has been recorded.
        FileNotFoundError: if it is to exist and does not, or has no complete line.
        BlockingIOError: if another process has it open; it says which.
        OSError: if it cannot be opened.
        ValueError: if it is damaged. It stays as it is.
    """

    def __init__(self, folder: Path, *, new: bool):
        path = folder / FILE_NAME
        absent = FileNotFoundError(f"there is no {FILE_NAME} in {folder}")
        if not new and not path.exists():
            raise absent
        message = f"{path} exists: resume it, or record to another folder; nothing is overwritten"
        if new and path.exists() and not _is_blank(path):
            raise FileExistsError(message)
        # Append mode: the position cannot be wrong.
        self._file: BinaryIO = open(path, "a+b", buffering=0)  # noqa: SIM115
        try:
            self._lock: Lock | None = None
            self._lock = Lock(self._file, path)
            self._file.seek(0)
            self.journal = parse(self._file.readall())  # type: ignore[attr-defined]
            if new and self.journal.length:  # written since
                raise FileExistsError(message)
            if not new and not self.journal.length:
                raise absent
            self._path, self._new = path, new
            sync_folder(folder)
        except BaseException as error:
            # What another process has open is not removed.
            if new and not isinstance(error, BlockingIOError) and _is_blank(path):
                path.unlink(missing_ok=True)
            if self._lock is not None:
                self._lock.free()
            self._file.close()
            raise

    def drop_torn_line(self) -> None:
        """Cut off a last line that a killed run did not finish, so that lines can follow."""
        if self.journal.torn:
            self._file.truncate(self.journal.length)
            os.fsync(self._file.fileno())
            self.journal.torn = False

    def append(self, entry: Mapping[str, Any]) -> None:
        """Write one line; it is on the disk when this returns.

        Raises:
            OSError: with the path, if it cannot be written. What was written of it is cut off.
        """
        line, length = _encode(entry), self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(length)
            raise os_error(error, self._path) from None

    def close(self) -> None:
        """Close the file, which frees the lock. A new one without a line is removed."""
        if self._new and self._file.seek(0, os.SEEK_END) == 0:
            self._path.unlink(missing_ok=True)
        if self._lock is not None:
            self._lock.free()
        self._file.close()
