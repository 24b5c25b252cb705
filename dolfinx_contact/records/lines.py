# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journals: one JSON object a line, only ever appended to.

The first line names the problem. A line is on the disk before what follows is computed, so that a
run may be killed at any moment: at worst the last line lacks its end, and is not counted; a journal
without a complete line counts as none. Every line has its number, and ends with the CRC-32 of what
is before it; a line that was damaged later, or lacks one before it, is an error.
"""

from __future__ import annotations

import errno
import json
import math
import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._files import os_error, sync
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.io.outside import OuterSurface, SurfaceState
from dolfinx_contact.records.arrays import Arrays, DamagedFile, check, load
from dolfinx_contact.records.entries import PointEntry, StateEntry
from dolfinx_contact.records.lock import Lock

__all__ = [
    "FILE_NAME",
    "FORMAT",
    "Followed",
    "JournalFile",
    "Lines",
    "checkpoint_file",
    "has_journal",
    "kind_of",
    "outer_surface_file",
    "parse",
    "surface_file",
]

FILE_NAME = "journal.jsonl"
FORMAT = 3
_MARK = ', "crc": "'


class _Refused(ValueError):
    """A journal that is whole, but of something else or of another version."""


@dataclass
class Followed(Ends):
    """What is known of one branch or run.

    Attributes:
        ending: how it ended; None if it has not.
        reason: why, in words.
    """

    ending: Ending | None = None
    reason: str = ""


@dataclass
class Lines:
    """What is in every journal.

    Attributes:
        header: what identifies the problem, and the places of the contact points.
        sessions: one dictionary for every run that recorded: ranks, versions and time of its
            start; the first one has the fingerprint of the outer surface.
        lines: number of them, without a last one that was not finished.
        length: of these in bytes.
        torn: whether there is such a line.
        folder: of the record; None of what is in memory only.
    """

    kind: ClassVar[str]
    header: dict[str, Any] = field(default_factory=dict)
    sessions: list[dict[str, Any]] = field(default_factory=list)
    lines: int = 0
    length: int = 0
    torn: bool = False
    folder: Path | None = None

    @property
    def places(self) -> dict[str, npt.NDArray[np.float64]]:
        """Coordinates (n, dim) of contact points by surface, in the order of the statuses."""
        return {k: np.array(x, float) for k, x in self.header["points"].items()}

    def surface(self) -> OuterSurface:
        """The outer surface of the bodies before they move, on this rank alone.

        Raises:
            ValueError: if the record has no outer surface yet, or it is damaged.
        """
        folder = self._on_disk()
        if not self.sessions:
            raise ValueError(f"the record in {folder} has no outer surface yet")
        file = outer_surface_file(folder)
        return _made(OuterSurface.of_arrays, file, self.sessions[0]["outer_surface"])

    def surface_at(self, index: int, branch: int = 0) -> SurfaceState:
        """Where the outer surface is at a recorded point, on this rank alone.

        Args:
            index: of the point; of a history or a path that of the step, 0 the start.
            branch: its number; histories and paths have branch 0 alone.

        Raises:
            ValueError: if there is no such point, its displacement was not recorded, or is damaged.
        """
        entries = self.entries(branch)
        if not 0 <= index < len(entries):
            raise ValueError(f"points 0 to {len(entries) - 1} are recorded, not {index}")
        entry = entries[index]
        if entry.surface is None or entry.surface_sum is None:
            raise ValueError(
                f"no displacement was recorded at point {index}: record with "
                "surface_displacement=True"
            )
        file = surface_file(self._on_disk(), entry.surface)
        return _made(SurfaceState.of_arrays, file, entry.surface_sum)

    def check_surfaces(self) -> None:
        """Raise ``ValueError`` if a file with the outer surface is missing or was exchanged."""
        if self.folder is None or not self.sessions:
            return
        check(outer_surface_file(self.folder), self.sessions[0]["outer_surface"])
        for entry in self.all_entries():
            if entry.surface is not None and entry.surface_sum is not None:
                check(surface_file(self.folder, entry.surface), entry.surface_sum)

    def all_entries(self) -> Iterator[PointEntry | StateEntry[Any]]:
        """The entries of all points of all branches, or of all states."""
        raise NotImplementedError

    def _on_disk(self) -> Path:
        if self.folder is None:
            raise ValueError("the journal is in memory only, and has no surface")
        return self.folder

    def entries(self, branch: int = 0) -> Sequence[PointEntry | StateEntry[Any]]:
        """What is known of every point of a branch, or every state of a history or path.

        Raises:
            ValueError: if there is no such branch.
        """
        raise NotImplementedError

    def take(self, entry: dict[str, Any]) -> None:
        """Add one line to what was read before.

        Raises:
            ValueError, KeyError, TypeError, IndexError: if it does not follow.
        """
        kind = entry.pop("type")
        self.lines += 1
        number = entry.pop("line", self.lines)  # earlier versions wrote none
        if (kind == "header") != (not self.header):
            raise ValueError("a journal has one header, as its first line")
        if kind == "header":
            if entry["format"] != FORMAT:
                raise _Refused(
                    f"the journal is in format {entry['format']}, and this version of "
                    f"dolfinx_contact reads and writes format {FORMAT} alone: use the version that "
                    f"wrote it ({entry.get('package', 'unknown')}), or record anew"
                )
            if entry["of"] != self.kind:
                raise _Refused(f"it is the journal of {entry['of']}, not of {self.kind}")
            self.header = entry
        elif kind == "session":
            self.sessions.append(entry)
        else:
            self._take(kind, entry)
        if number != self.lines:
            raise ValueError(f"it was written as line {number}: lines are missing before it")

    @property
    def is_empty(self) -> bool:
        """Whether nothing was recorded yet."""
        raise NotImplementedError

    def _take(self, kind: str, entry: dict[str, Any]) -> None:
        """Add a line that not every journal has."""
        raise NotImplementedError


J = TypeVar("J", bound=Lines)
T = TypeVar("T")


def parse(data: bytes, kind: type[J], folder: Path | None = None) -> J:
    """The journal in ``data``; a last line that was not finished is left out.

    Args:
        data: of the file.
        kind: of the journal.
        folder: of the record.

    Raises:
        ValueError: if a line is damaged or does not follow from those before it, or it is a journal
            of something else or in the format of another version.
    """
    *lines, rest = data.split(b"\n")
    journal = kind(length=len(data) - len(rest), torn=bool(rest), folder=folder)
    for number, line in enumerate(lines, 1):
        try:
            journal.take(_decode(line))
        except _Refused:
            raise
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise ValueError(f"line {number} of the journal is damaged: {error}") from None
    return journal


def kind_of(data: bytes) -> str | None:
    """Of what the journal in ``data`` is, by its first line; None if that has no kind."""
    first, _, _ = data.partition(b"\n")
    try:
        found = _decode(first).get("of")
    except ValueError:  # damaged, as who reads it finds
        return None
    return None if found is None else str(found)


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
    """A number that is not finite, if ``entry`` encodes one.

    What users have given the name "float" has no word under it.
    """
    word = entry.get("float")
    return float(word) if len(entry) == 1 and isinstance(word, str) else entry


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


def checkpoint_file(folder: Path, name: str) -> Path:
    """The file with the fields of a point or state of a record."""
    return folder / "checkpoints" / f"{name}.npz"


def surface_file(folder: Path, name: str) -> Path:
    """The file with the outer surface at a point or state of a record."""
    return folder / "surface" / f"{name}.npz"


def outer_surface_file(folder: Path) -> Path:
    """The file of a record with the outer surface before anything moves."""
    return folder / "surface.npz"


def _made(make: Callable[[Arrays], T], file: Path, fingerprint: str) -> T:
    """An object made of the arrays of a file.

    Raises:
        DamagedFile: if the file is missing, damaged, or lacks an array.
    """
    try:
        return make(load(file, fingerprint))
    except KeyError as error:
        raise DamagedFile(f"{file} is damaged: {error} is missing") from None


def has_journal(folder: Path) -> bool:
    """Whether a folder has a journal with a complete line. On one rank."""
    path = folder / FILE_NAME
    return path.exists() and not _is_blank(path)


def _is_blank(path: Path) -> bool:
    """Whether a journal has no complete line: it was left in the first moment of a run."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        return not file.readline().endswith(b"\n")


class JournalFile(Generic[J]):
    """A journal that is open for appending, locked against other runs. On one rank.

    Args:
        folder: where it is, or is to be.
        kind: of the journal.
        new: whether it must not exist yet.
        holders: numbers of the processes of the run, by host (`lock.processes`).

    Attributes:
        journal: what was in it when it was opened.

    Raises:
        FileExistsError: if it is to be new and something has been recorded.
        FileNotFoundError: if it is to exist and does not, or has no complete line.
        BlockingIOError: if another run has it open, with its process numbers.
        OSError: if it cannot be opened.
        ValueError: if it is damaged, or a journal of something else. It stays as it is.
    """

    def __init__(
        self, folder: Path, kind: type[J], *, new: bool, holders: Mapping[str, Sequence[int]]
    ):
        path = folder / FILE_NAME
        absent = FileNotFoundError(f"there is no {FILE_NAME} in {folder}")
        if not new and not path.exists():
            raise absent
        message = f"{path} exists: resume it, or record to another folder; nothing is overwritten"
        if new and has_journal(folder):
            raise FileExistsError(message)
        # Append mode: the position cannot be wrong.
        self._file: BinaryIO = open(path, "a+b", buffering=0)  # noqa: SIM115
        try:
            self._lock: Lock | None = None
            self._lock = Lock(self._file, path, holders)
            self._file.seek(0)
            content = self._file.readall()  # type: ignore[attr-defined]
            self.journal = parse(content, kind, folder)
            if new and self.journal.length:  # written since
                raise FileExistsError(message)
            if not new and not self.journal.length:
                raise absent
            self._path = path
            self._new = new
            sync(folder)
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
            OSError: with the path, if it cannot be written (a partial line is cut off), or the file
                was removed or replaced since it was opened.
        """
        self._require_in_place()
        number = self.journal.lines + 1
        line = _encode({**entry, "line": number})
        length = self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(length)
            raise os_error(error, self._path) from None
        self.journal.lines = number

    def _require_in_place(self) -> None:
        """Raise ``FileNotFoundError`` if the path does not lead to the open file any more."""
        mine = os.fstat(self._file.fileno())
        try:
            there = os.stat(self._path)
        except FileNotFoundError:
            there = None
        if there is None or (there.st_dev, there.st_ino) != (mine.st_dev, mine.st_ino):
            reason = "the journal was removed or replaced while a run recorded to it"
            raise FileNotFoundError(errno.ENOENT, reason, str(self._path))

    def close(self) -> None:
        """Close the file, which frees the lock. A new one without a line is removed."""
        if self._new and self._file.seek(0, os.SEEK_END) == 0:
            self._path.unlink(missing_ok=True)
        if self._lock is not None:
            self._lock.free()
        self._file.close()
