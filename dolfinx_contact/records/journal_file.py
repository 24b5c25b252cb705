# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journal file, open for appending and locked against other runs.

The lock is an ``flock`` on the journal, which the operating system releases when the process ends.
The file ``journal.lock`` next to the journal names the processes of the run: if ``mpirun`` is
killed and some of its ranks survive, they keep the lock until they are terminated.

Between hosts the lock works if the file system supports it, such as NFS, or Lustre mounted with
``flock``. On a file system without ``flock``, ``journal.lock`` itself is the lock, created with
``O_EXCL``; if a killed run leaves it behind, it must be removed by hand.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Generic, TypeVar

from mpi4py import MPI

from dolfinx_contact._files import os_error, sync
from dolfinx_contact.records.journal import FILE_NAME, AnyJournal, encoded, parse

__all__ = ["NOTE_NAME", "JournalFile", "run_name"]

J = TypeVar("J", bound=AnyJournal)

NOTE_NAME = "journal.lock"
_NO_FLOCK = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL)


def run_name(comm: MPI.Comm) -> str:
    """Describe the processes of this run by host, command and start time. Collective."""
    hosts: dict[str, list[str]] = {}
    for host, number in comm.allgather((socket.gethostname(), os.getpid())):
        hosts.setdefault(host, []).append(str(number))
    ranks = ", ".join(f"{' '.join(numbers)} on {host}" for host, numbers in hosts.items())
    # docker/run gives a run process numbers of its own; this is the number outside.
    launcher = os.environ.get("DOLFINX_CONTACT_LAUNCHER", "")
    outside = f", in the environment of process {launcher}" if launcher else ""
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    end = "; ".join(
        f"kill {launcher or ' '.join(numbers)} on {host}" for host, numbers in hosts.items()
    )
    command = " ".join(sys.argv[:3])
    return f"processes {ranks}{outside} ({command}), since {since}. To end them: {end}"


class JournalFile(Generic[J]):
    """Journal file, open for appending and locked against other runs. Use it on one rank.

    Args:
        folder: folder of the record.
        kind: class of the journal.
        resume: True to require an existing journal, False to require none, "if_exists" for either.
        run: description of this run (`run_name`), shown to other runs that try to open the file.

    Attributes:
        journal: content of the file when it was opened.

    Raises:
        FileExistsError: if ``resume`` is False and the journal contains a complete line.
        FileNotFoundError: if ``resume`` is True and the journal does not exist or has no complete
            line.
        BlockingIOError: if another run has the journal open; the message describes the other run.
        OSError: if the journal cannot be opened, with the path.
        ValueError: if the journal is corrupt or of another kind. The file is not changed.
    """

    def __init__(self, folder: Path, kind: type[J], *, resume: bool | str, run: str):
        self._path = folder / FILE_NAME
        self._note = folder / NOTE_NAME
        self._locked = False
        absent = FileNotFoundError(f"there is no {FILE_NAME} in {folder}")
        exists = FileExistsError(
            f"{self._path} exists: pass resume=True, or record to another folder; nothing is "
            "overwritten"
        )
        if resume is True and not self._path.exists():
            raise absent
        if resume is False and self._path.is_dir():
            raise exists
        # Append mode: the position cannot be wrong.
        self._file: BinaryIO = open(self._path, "a+b", buffering=0)  # noqa: SIM115
        self._removable = resume is not True
        try:
            self._lock(run)
            self._file.seek(0)
            content = self._file.read()
            if (resume is False) and b"\n" in content:
                raise exists
            if (resume is True) and b"\n" not in content:
                raise absent
            self.journal = parse(content, kind, folder)
            if not self.journal.lines and self._removable:
                self._file.truncate(0)
            sync(folder)
        except BaseException:
            self.close()
            raise

    def _lock(self, run: str) -> None:
        """Lock the journal and write ``journal.lock``.

        Raises:
            BlockingIOError: if another run has the lock.
            OSError: with the path, if ``journal.lock`` cannot be written.
        """
        flocked = True
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise self._refusal("Their end frees the lock") from None
        except OSError as error:
            if error.errno not in _NO_FLOCK:
                raise
            flocked = False
        if flocked:  # a note is left over from a killed run, or a link to another file
            self._note.unlink(missing_ok=True)
        try:
            with open(self._note, "x") as note:
                self._locked = True
                note.write(run)
        except FileExistsError:
            raise self._refusal(f"If they are gone, remove {self._note}") from None
        except OSError as error:
            raise os_error(error, self._note) from None

    def _refusal(self, advice: str) -> BlockingIOError:
        try:
            holder = self._note.read_text()
        except OSError:
            holder = "unknown processes (fuser and lsof list those with the file open)"
        self._removable = False
        message = f"another run records to {self._path}: {holder}. {advice}"
        return BlockingIOError(errno.EAGAIN, message)

    def drop_torn_line(self, length: int) -> None:
        """Remove an incomplete last line of a killed run before lines are appended.

        Args:
            length: size of the complete lines in bytes.
        """
        if self._file.seek(0, os.SEEK_END) > length:
            self._file.truncate(length)
            os.fsync(self._file.fileno())

    def append(self, entry: Mapping[str, Any]) -> None:
        """Write one line and flush it to disk.

        Raises:
            OSError: with the path, if the line cannot be written (a partial line is removed), or if
                the file was removed or replaced since it was opened.
        """
        self._require_in_place()
        line = encoded(entry)
        length = self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(length)
            raise os_error(error, self._path) from None

    def _require_in_place(self) -> None:
        """Raise `FileNotFoundError` if the open file was removed or replaced."""
        if self._path.exists() and os.path.samestat(
            os.stat(self._path), os.fstat(self._file.fileno())
        ):
            return
        reason = "the journal was removed or replaced while a run recorded to it"
        raise FileNotFoundError(errno.ENOENT, reason, str(self._path))

    def close(self) -> None:
        """Close the file and release the lock. A new file without a line is removed."""
        if self._removable and self._file.seek(0, os.SEEK_END) == 0:
            self._path.unlink(missing_ok=True)
        if self._locked:
            self._note.unlink(missing_ok=True)
            # A forked process may also have opened the file.
            with contextlib.suppress(OSError):
                fcntl.flock(self._file, fcntl.LOCK_UN)
        self._file.close()
