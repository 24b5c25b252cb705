# SPDX-License-Identifier: LGPL-3.0-or-later
"""One process at a time records to a folder; the lock says which, and how to break it.

The lock is that of ``flock`` on the journal, which ends with its holder, whatever ends that. A
note beside the journal says who holds it. On a file system without ``flock`` the note itself is
the lock: one whose holder is known to be gone counts as none, any other has to be removed by hand.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import json
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

from dolfinx_contact.io.disk import os_error

__all__ = ["NOTE_NAME", "Lock", "end_with_launcher"]

NOTE_NAME = "journal.lock"
_WITHOUT = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL)
_LAUNCHERS = ("mpirun", "mpiexec", "prterun", "prted", "orterun", "orted", "hydra_pmi_proxy")
_PR_SET_PDEATHSIG = 1


class Lock:
    """The lock of an open journal, on one rank.

    Args:
        file: the journal, open for writing.
        path: its path.

    Raises:
        BlockingIOError: if another process has it, with what is known of that process.
        OSError: with the path, if the note cannot be written.
    """

    def __init__(self, file: BinaryIO, path: Path):
        self._note = path.with_name(NOTE_NAME)
        alone = False
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise _taken(path, f"{_described(self._note)}. Its end frees the lock") from error
        except OSError as error:
            if error.errno not in _WITHOUT:
                raise
            alone = True
        try:
            self._write(alone, path)
        except BaseException:
            if not alone:
                self._note.unlink(missing_ok=True)
            raise

    def _write(self, alone: bool, path: Path) -> None:
        content = json.dumps(_holder()).encode()
        if alone and self._note.exists() and _alive(_read(self._note)) is False:
            self._note.unlink()
        try:
            how = os.O_EXCL if alone else os.O_TRUNC
            descriptor = os.open(self._note, os.O_WRONLY | os.O_CREAT | how, 0o666)
        except FileExistsError as error:
            said = f"{_described(self._note)}. If it is gone, remove {self._note}"
            raise _taken(path, said) from error
        try:
            os.write(descriptor, content)
        except OSError as error:
            self._note.unlink(missing_ok=True)
            raise os_error(error, self._note) from None
        finally:
            os.close(descriptor)

    def free(self) -> None:
        """Remove the note; the lock ends when the file is closed."""
        self._note.unlink(missing_ok=True)


def end_with_launcher() -> None:
    """Let this process end with the ``mpirun`` that is its parent, also when that is killed.

    Ranks that lose it wait for each other for ever, and would hold their files.
    """
    parent = os.getppid()
    try:
        name = Path(f"/proc/{parent}/comm").read_text().strip()
        prctl = ctypes.CDLL(None, use_errno=True).prctl
    except (OSError, AttributeError):  # not Linux
        return
    if name in _LAUNCHERS:
        prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        if os.getppid() != parent:  # it ended in between
            os.kill(os.getpid(), signal.SIGKILL)


def _taken(path: Path, said: str) -> BlockingIOError:
    return BlockingIOError(errno.EAGAIN, f"another process records to {path}: {said}")


def _holder() -> dict[str, Any]:
    """What this process is known by."""
    return {
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "namespace": _namespace(),
        "started": _started(os.getpid()),
        "since": time.time(),
        "command": " ".join(sys.argv[:3]),
        # docker/run gives a run process numbers of its own; this is the number outside.
        "launcher": os.environ.get("DOLFINX_CONTACT_LAUNCHER", ""),
    }


def _namespace() -> str:
    """Of the process numbers: elsewhere they mean other processes. With the boot of the machine."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{os.readlink('/proc/self/ns/pid')} {boot}"
    except OSError:
        return ""


def _started(pid: int) -> str:
    """When a process started, in ticks since the boot: numbers are used again. Empty if gone."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if words[0] in "ZX" else words[19]


def _read(note: Path) -> dict[str, Any]:
    """The note, or nothing if it is not there or unfinished."""
    try:
        found = json.loads(note.read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and {*_holder()} <= {*found} else {}


def _alive(holder: dict[str, Any]) -> bool | None:
    """Whether a holder is alive; None if that cannot be told from here."""
    here = _holder()
    if not holder or not holder["namespace"]:
        return None
    if any(holder[key] != here[key] for key in ("host", "namespace")):
        return None
    return _started(int(holder["pid"])) == holder["started"]


def _described(note: Path) -> str:
    """Who holds a lock, in words."""
    holder = _read(note)
    if not holder:
        return "it left no word who it is (fuser and lsof name who has a file open)"
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(float(holder["since"])))
    pid = holder["pid"]
    launcher = holder["launcher"]
    who = f"process {pid} ({holder['command']}) on {holder['host']}, since {since}, "
    alive = _alive(holder)
    if alive:
        return f"{who}which is alive; kill {pid} ends it"
    if alive is False:
        return f"{who}which is gone, though a process that it started is not (fuser names it)"
    outside = f"; there kill {launcher} ends its docker/run" if launcher else ""
    return f"{who}with process numbers of its own, so that it cannot be seen from here{outside}"
