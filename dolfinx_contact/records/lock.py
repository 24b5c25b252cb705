# SPDX-License-Identifier: LGPL-3.0-or-later
"""One run at a time records to a folder; the lock names it.

The lock is that of ``flock`` on the journal, which ends with its holder, whatever ends that. A
note beside the journal names the processes of the run: ranks that outlive a killed ``mpirun`` wait
for each other, and hold the record until somebody ends them.

Between hosts the lock is as good as the file system: NFS passes it on, Lustre does if it is mounted
with ``flock``. Mounted with ``localflock`` (Lustre) or ``local_lock`` (NFS), two hosts do not see
each other's locks. On a file system without ``flock`` the note itself is the lock, made by
``O_EXCL``: one that a killed run has left has to be removed by hand.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from mpi4py import MPI

from dolfinx_contact._files import os_error

__all__ = ["NOTE_NAME", "Lock", "processes"]

NOTE_NAME = "journal.lock"
_WITHOUT = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL)


class Lock:
    """The lock of an open journal, on one rank.

    Args:
        file: the journal, open for writing.
        path: its path.
        holders: numbers of the processes of this run, by host.

    Raises:
        BlockingIOError: if another run has it, with its hosts and process numbers.
        OSError: with the path, if the note cannot be written.
    """

    def __init__(self, file: BinaryIO, path: Path, holders: Mapping[str, Sequence[int]]):
        self._file = file
        self._note = path.with_name(NOTE_NAME)
        alone = False
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise _acquired(path, f"{_described(self._note)}. Their end frees the lock") from error
        except OSError as error:
            if error.errno not in _WITHOUT:
                raise
            alone = True
        self._alone = alone
        try:
            self._write(alone, path, holders)
        except BaseException:
            if not alone and not self._note.is_symlink():
                self._note.unlink(missing_ok=True)
            raise

    def _write(self, alone: bool, path: Path, holders: Mapping[str, Sequence[int]]) -> None:
        content = {
            "processes": {host: list(numbers) for host, numbers in holders.items()},
            "since": time.time(),
            "command": " ".join(sys.argv[:3]),
            # docker/run gives a run process numbers of its own; this is the number outside.
            "launcher": os.environ.get("DOLFINX_CONTACT_LAUNCHER", ""),
        }
        try:
            how = os.O_EXCL if alone else os.O_TRUNC | os.O_NOFOLLOW
            descriptor = os.open(self._note, os.O_WRONLY | os.O_CREAT | how, 0o666)
        except FileExistsError as error:
            holder = f"{_described(self._note)}. If they are gone, remove {self._note}"
            raise _acquired(path, holder) from error
        except OSError as error:  # a link, which may lead to a file of the user
            raise os_error(error, self._note) from None
        try:
            os.write(descriptor, json.dumps(content).encode())
        except OSError as error:
            self._note.unlink(missing_ok=True)
            raise os_error(error, self._note) from None
        finally:
            os.close(descriptor)

    def free(self) -> None:
        """Remove the note and give the lock back, also where a forked process has the file open."""
        self._note.unlink(missing_ok=True)
        if not self._alone:
            fcntl.flock(self._file, fcntl.LOCK_UN)


def processes(comm: MPI.Comm) -> dict[str, list[int]]:
    """Numbers of the processes of all ranks, by host. Collective."""
    found: dict[str, list[int]] = {}
    for host, number in comm.allgather((socket.gethostname(), os.getpid())):
        found.setdefault(host, []).append(number)
    return found


def _acquired(path: Path, holder: str) -> BlockingIOError:
    return BlockingIOError(errno.EAGAIN, f"another run records to {path}: {holder}")


def _described(note: Path) -> str:
    """Who holds a lock, in words."""
    try:
        known = json.loads(note.read_text())
        since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(float(known["since"])))
        ranks = [
            f"{' '.join(map(str, numbers))} on {host}"
            for host, numbers in known["processes"].items()
        ]
        launcher = known["launcher"]
        # Numbers in an environment of its own mean other processes outside.
        outside = f", in the environment of process {launcher}" if launcher else ""
        return f"processes {', '.join(ranks)}{outside} ({known['command']}), since {since}"
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return "it left no word who it is (fuser and lsof name who has a file open)"
