# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files that are whole or not there, on disks that may be full.

What is written goes to a hidden name beside its place and is renamed when it is complete and on the
disk, so that the state of before is kept if anything fails. Libraries that
write in C++ (ADIOS2) cannot be stopped half-way: on one rank they abort, on several the ranks wait
for each other. The room that they will need is therefore reserved before they begin.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI

from dolfinx_contact._errors import on_root
from dolfinx_contact._files import os_error, part_of, sync

__all__ = ["aside", "put", "reserve", "write_text"]

_FILES = 8  # that a folder of ADIOS2 has at most, and some
_UNSUPPORTED = (errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2


def put(file: Path, content: bytes) -> None:
    """Write a file, on this rank alone. An ``OSError`` of it has the path."""
    try:
        file.write_bytes(content)
    except OSError as error:
        raise os_error(error, file) from error


def write_text(comm: MPI.Comm, file: Path, text: Callable[[], str]) -> None:
    """Write a file from rank 0, aside and renamed. Collective.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; it is then as it was.
    """

    def write() -> None:
        content = text()
        with part_of(file) as part:
            part.write_text(content)

    on_root(comm, write)


@contextmanager
def aside(comm: MPI.Comm, folder: Path, name: str) -> Iterator[Path]:
    """A hidden folder whose files and folders are moved to ``folder`` at the end. Collective.

    Files and folders of the same names are replaced. Errors inside must be the same on every rank.

    Args:
        comm: communicator.
        folder: that exists.
        name: of the hidden folder.

    Raises:
        OSError: on every rank, with the path, if a file cannot be put in its place, as where a
            folder is in the way of a file, or the other way round. All is then as it was.
    """
    part = folder / f".{name}.part"

    def start() -> None:
        if part.exists():  # of a run that was killed
            shutil.rmtree(part)
        part.mkdir()

    def finish() -> None:
        new = sorted(part.iterdir(), key=lambda p: (not p.is_dir(), p.name))  # folders first
        for path in new:
            _may_replace(path, folder / path.name)
        for path in (part, *part.rglob("*")):
            sync(path)
        for path in new:
            _replace(path, folder / path.name)
        sync(folder)

    try:
        on_root(comm, start)
        yield part
        comm.barrier()
        on_root(comm, finish)
    except OSError as error:
        # The hidden folder means nothing to the caller.
        path = Path(error.filename or folder)
        if path.is_relative_to(part):
            raise os_error(error, folder / path.relative_to(part)) from error
        raise
    finally:
        if comm.rank == 0:
            shutil.rmtree(part, ignore_errors=True)


def reserve(comm: MPI.Comm, file: Path, size: int) -> None:
    """See that there is room for ``file``. Collective.

    Args:
        comm: communicator.
        file: or folder that is to be made, in a folder that exists.
        size: bytes that this rank is going to write, at most; they are summed over the ranks.

    Raises:
        OSError: on every rank, with the path and the reason, if that is too much for the disk, a
            quota, or a limit of the process.
    """
    total = comm.allreduce(int(size))
    on_root(comm, lambda: _probe(file, max(total, 1)))


def _probe(beside: Path, size: int) -> None:
    """Allocate ``size`` bytes and some files in the folder of a file, and free them."""
    probe = beside.with_name(f".{uuid.uuid4().hex}.part")
    try:
        probe.mkdir()
        for i in range(_FILES):
            (probe / str(i)).touch()
        with open(probe / "0", "wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise OSError(
                error.errno, f"{error.strerror}, {size} bytes are needed", str(beside)
            ) from None
    finally:
        shutil.rmtree(probe, ignore_errors=True)


def _may_replace(new: Path, old: Path) -> None:
    """Refuse to put a file in the place of a folder, or a folder in that of what is no result."""
    number = 0
    if old.is_dir() and not new.is_dir():
        number = errno.EISDIR
    elif new.is_dir() and old.is_dir():
        # Of another number of ranks or steps there may be data.1 or point_000009.vtu.
        stems, kinds = ({part(p) for p in new.iterdir()} for part in (_stem, _suffix))
        foreign = [p for p in old.iterdir() if _stem(p) not in stems and _suffix(p) not in kinds]
        number = errno.EEXIST if foreign else 0
    elif new.is_dir() and old.exists():
        number = errno.ENOTDIR
    if number:
        raise OSError(number, os.strerror(number), str(old))


def _stem(path: Path) -> str:
    return path.stem


def _suffix(path: Path) -> str:
    return path.suffix


def _replace(new: Path, old: Path) -> None:
    """Rename ``new`` to ``old``; in one step for folders too, where the system can do that."""
    try:
        if not (new.is_dir() and old.is_dir()):
            new.replace(old)
            return
        libc = ctypes.CDLL(None, use_errno=True)
        names = os.fsencode(new), os.fsencode(old)
        exchange = getattr(libc, "renameat2", None)
        if exchange and not exchange(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE):
            return
        before = new.with_name(f"{new.name}.before")
        old.rename(before)
        try:
            new.rename(old)
        except OSError:
            before.rename(old)
            raise
    except OSError as error:
        raise os_error(error, old) from None
