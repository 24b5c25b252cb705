# SPDX-License-Identifier: LGPL-3.0-or-later
"""The file of a journal: open for appending, and locked against other runs."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Generic, TypeVar

from dolfinx_contact._files import os_error, sync
from dolfinx_contact.records.journal import FILE_NAME, AnyJournal, encoded, parse, reread
from dolfinx_contact.records.lock import Lock

__all__ = ["JournalFile", "has_journal"]

J = TypeVar("J", bound=AnyJournal)


def has_journal(folder: Path) -> bool:
    """Whether a folder has a journal with a complete line, or something else in its place."""
    path = folder / FILE_NAME
    return path.exists() and not _is_blank(path)


def _is_blank(path: Path) -> bool:
    """Whether a file has no complete line: a run ended in its first moment."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        return not file.readline().endswith(b"\n")


class JournalFile(Generic[J]):
    """A journal that is open for appending, locked against other runs. On one rank.

    Args:
        folder: folder of the record.
        kind: class of the journal.
        new: whether the journal must not exist yet.
        holders: numbers of the processes of the run, by host (`lock.processes`).

    Attributes:
        journal: content of the file.

    Raises:
        FileExistsError: if the journal must not exist and something has been recorded.
        FileNotFoundError: if it must exist and does not, or has no complete line.
        BlockingIOError: if another run has it open, with its process numbers.
        OSError: if it cannot be opened.
        ValueError: if it is damaged, or of another kind. It stays as it is.
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
        self._path = path
        self._new = new
        self._lock: Lock | None = None
        try:
            self._lock = Lock(self._file, path, holders)
            self._file.seek(0)
            content = self._file.readall()  # type: ignore[attr-defined]
            self.journal = parse(content, kind, folder)
            if new and self.journal.length:  # written since
                raise FileExistsError(message)
            if not new and not self.journal.length:
                raise absent
            sync(folder)
        except BaseException as error:
            # What another process has open is not removed.
            if new and not isinstance(error, BlockingIOError) and _is_blank(path):
                path.unlink(missing_ok=True)
            self._free()
            raise

    def drop_torn_line(self) -> None:
        """Cut off a last line that a killed run did not finish, so that lines can follow."""
        if self.journal.torn:
            self._file.truncate(self.journal.length)
            os.fsync(self._file.fileno())
            self.journal.torn = False

    def append(self, entry: Mapping[str, Any]) -> None:
        """Write one line and add it to the journal; it is on the disk when this returns.

        Raises:
            OSError: with the path, if it cannot be written (a partial line is cut off), or the file
                was removed or replaced since it was opened.
        """
        self._require_in_place()
        numbered = {**entry, "line": self.journal.lines + 1}
        line = encoded(numbered)
        length = self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(length)
            raise os_error(error, self._path) from None
        self.journal.take(reread(numbered))

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
        self._free()

    def _free(self) -> None:
        if self._lock is not None:
            self._lock.free()
        self._file.close()
