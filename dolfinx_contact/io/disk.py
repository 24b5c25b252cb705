# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files that are complete or absent.

A file is written under a hidden name in the same folder and renamed when it is complete and on the
disk, so that an earlier file remains if writing fails.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

from mpi4py import MPI

from dolfinx_contact._files import os_error, part_of, sync
from dolfinx_contact._mpi import on_root

__all__ = ["aside", "put", "write_text"]

#: Files in a folder of ADIOS2, whose numbers depend on ranks and steps.
_OF_ADIOS = re.compile(r"(data|md|mmd)\.\d+|md\.idx|profiling\.json|active")


def put(file: Path, content: bytes) -> None:
    """Write a file; an ``OSError`` has its path. Not collective."""
    try:
        file.write_bytes(content)
    except OSError as error:
        raise os_error(error, file) from error


def write_text(comm: MPI.Comm, file: Path, text: Callable[[], str]) -> None:
    """Write a file from rank 0. Collective.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; an earlier file remains.
    """

    def write() -> None:
        content = text()
        with part_of(file) as part:
            part.write_text(content)

    on_root(comm, write)


@contextmanager
def aside(comm: MPI.Comm, folder: Path, name: str) -> Iterator[Path]:
    """Provide a hidden folder whose content is moved to ``folder`` at the end. Collective.

    Files and folders of the same names are replaced. Errors inside must be the same on every rank.

    Args:
        comm: communicator.
        folder: existing folder.
        name: name of the hidden folder.

    Raises:
        OSError: on every rank, with the path, if a file is incomplete or cannot be moved, for
            example because a folder has its name. Earlier files then remain.
    """
    part = folder / f".{name}.part"

    def start() -> None:
        if part.exists():  # left by a killed run
            shutil.rmtree(part)
        part.mkdir()

    def finish() -> None:
        new = sorted(part.iterdir(), key=lambda p: (not p.is_dir(), p.name))  # folders first
        for path in new:
            _require_replaceable(path, folder / path.name)
            _require_complete(path)
        for path in (part, *part.rglob("*")):
            sync(path)
        older = set().union(*(_parts_of(folder / p.name) for p in new if p.suffix == ".pvd"))
        for path in new:
            _replace(path, folder / path.name)
        for name in older - {path.name for path in new}:
            (folder / name).unlink(missing_ok=True)
        sync(folder)

    try:
        on_root(comm, start)
        yield part
        comm.barrier()
        on_root(comm, finish)
    except OSError as error:
        # Users do not know the hidden folder.
        path = Path(error.filename or folder)
        if path.is_relative_to(part):
            raise os_error(error, folder / path.relative_to(part)) from error
        raise
    finally:
        if comm.rank == 0:
            shutil.rmtree(part, ignore_errors=True)


def _require_complete(path: Path) -> None:
    """Raise ``OSError`` for a truncated file of VTK: DOLFINx does not report a full disk."""
    if path.suffix in (".pvd", ".pvtu", ".vtu"):
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - 32, 0))
            if not file.read().rstrip().endswith(b"</VTKFile>"):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _require_replaceable(new: Path, old: Path) -> None:
    """Raise ``OSError`` if a file would replace a folder, or a folder foreign files."""
    number = 0
    if old.is_dir() and not new.is_dir():
        number = errno.EISDIR
    elif new.is_dir() and old.is_dir():
        foreign = [p for p in old.iterdir() if not _OF_ADIOS.fullmatch(p.name)]
        number = errno.EEXIST if foreign else 0
    elif new.is_dir() and old.exists():
        number = errno.ENOTDIR
    if number:
        raise OSError(number, os.strerror(number), str(old))


def _replace(new: Path, old: Path) -> None:
    """Rename ``new`` to ``old``, which it replaces."""
    before = new.with_name(f"{new.name}.before")
    try:
        if not (new.is_dir() and old.is_dir()):
            new.replace(old)
            return
        old.rename(before)
        try:
            new.rename(old)
        except OSError:
            before.rename(old)
            raise
    except OSError as error:
        raise os_error(error, old) from None


def _parts_of(collection: Path) -> set[str]:
    """Return the names of the files of a ``.pvd`` and its ``.pvtu``; none if it is missing."""
    names: set[str] = set()
    if not collection.is_file():
        return names
    for time in _named_in(collection, "DataSet", "file"):
        names.add(time)
        names |= set(_named_in(collection.with_name(time), "Piece", "Source"))
    return names


def _named_in(path: Path, tag: str, attribute: str) -> list[str]:
    """Return file names in the same folder from an XML file of VTK; none if it is damaged."""
    try:
        found = [e.get(attribute, "") for e in ET.parse(path).iter(tag)]
    except (OSError, ET.ParseError):
        return []
    return [name for name in found if name and Path(name).name == name]
