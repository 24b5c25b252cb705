# SPDX-License-Identifier: LGPL-3.0-or-later
"""Output folders and atomic writing of files.

A file is written under a hidden name in the same folder and renamed after it has been flushed to
disk. If writing fails, an earlier file of the same name is unchanged.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import dolfinx

from dolfinx_contact._files import os_error, part_of, sync
from dolfinx_contact._mpi import everywhere, on_root, same_everywhere

__all__ = ["agreed_path", "aside", "output_folder", "write_script", "write_summary", "write_text"]

logger = logging.getLogger(__name__)

_STARTED = time.perf_counter()
_SCRIPT = "paraview.py"
#: Files in a folder of ADIOS2, whose numbers depend on ranks and steps.
_OF_ADIOS = re.compile(r"(data|md|mmd)\.\d+|md\.idx|profiling\.json|active")


def agreed_path(comm: MPI.Comm, path: str | os.PathLike[str], what: str) -> Path:
    """Return a path that is equal on all ranks. Collective.

    Args:
        comm: communicator.
        path: path given by the user.
        what: name of the argument, for the message.

    Raises:
        TypeError: on every rank, if it is not a path.
        ValueError: on every rank, if it differs between ranks.
    """
    with everywhere(comm, what):
        found = Path(path)
    same_everywhere(comm, **{what: str(found)})
    return found


def output_folder(comm: MPI.Comm, path: str | os.PathLike[str]) -> Path:
    """Create the folder ``path`` if necessary and test that it is writable. Collective.

    Raises:
        OSError: on every rank, if the folder cannot be made or written to.
        ValueError: on every rank, if it differs between ranks.
    """
    folder = agreed_path(comm, path, "folder")

    def make() -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            probe = folder / f".{uuid.uuid4().hex}.part"
            probe.touch()
            probe.unlink()
        except OSError as error:
            reason = f"cannot write to the output folder: {error.strerror}"
            raise OSError(error.errno, reason, str(folder)) from None

    on_root(comm, make)
    return folder


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


def write_summary(
    comm: MPI.Comm, folder: str | os.PathLike[str], scalars: Mapping[str, Any]
) -> dict[str, Any]:
    """Write ``scalars``, ranks, versions and the time since import to ``folder/summary.json``.

    Returns:
        Content of the file, on every rank.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; an earlier file remains.
        TypeError: on every rank, if a value cannot be written as JSON.
    """
    from dolfinx_contact import __version__

    summary = {
        **scalars,
        "ranks": comm.size,
        "versions": {
            "dolfinx": dolfinx.__version__,
            "petsc": ".".join(str(v) for v in PETSc.Sys.getVersion()),
            "dolfinx_contact": __version__,
        },
        "wall_seconds": comm.bcast(time.perf_counter() - _STARTED),
    }
    file = Path(folder) / "summary.json"
    write_text(comm, file, lambda: json.dumps(summary, indent=2, default=_plain) + "\n")
    return summary


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"cannot write {type(value).__name__} to a summary")


# -- fields for ParaView -------------------------------------------------------------------------


def write_script(comm: MPI.Comm, part: Path, folder: Path) -> None:
    """Write ``paraview.py``, which shows the results in its folder. Collective.

    Another file of that name is kept, with a warning.

    Args:
        comm: communicator.
        part: folder in which it is written.
        folder: final folder, stored in the script because ParaView does not always pass the path of
            a script. The folder may be moved.
    """

    def write() -> None:
        text = Path(__file__).with_name("in_paraview.py").read_text()
        head = "".join(text.splitlines(keepends=True)[:2]).encode()
        file = folder / _SCRIPT
        if file.is_file() and not file.read_bytes().startswith(head):
            message = "%s is not one of this package, and is left unchanged: no script for ParaView"
            logger.warning(message, file)
            return
        known = text.replace('WRITTEN_TO = ""', f"WRITTEN_TO = {str(folder.resolve())!r}")
        try:
            (part / _SCRIPT).write_text(known)
        except OSError as error:
            raise os_error(error, part / _SCRIPT) from error

    on_root(comm, write)


@contextmanager
def aside(comm: MPI.Comm, folder: Path, name: str, prefix: str = "") -> Iterator[Path]:
    """Context manager: hidden folder whose content is moved to ``folder`` on exit. Collective.

    Files of the same names are replaced, in both formats. Errors raised inside the context must be
    the same on every rank.

    Args:
        comm: communicator.
        folder: existing folder.
        name: name of the hidden folder.
        prefix: beginning of the names of a series, whose earlier files are all removed.

    Raises:
        OSError: on every rank, with the path, if a file is incomplete or cannot be moved, for
            example because a folder of the same name exists. Earlier files then remain.
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
        stems = {p.stem for p in new if p.suffix in (".bp", ".pvd")}
        if prefix:
            stems |= {p.stem for p in folder.glob(f"{prefix}*") if p.suffix in (".bp", ".pvd")}
        older = set[Path]().union(*(_files_of(folder, stem) for stem in stems))
        before = part / "before"  # removed with the hidden folder
        before.mkdir()
        for path in new:
            if (folder / path.name).is_dir():
                (folder / path.name).rename(before / path.name)
            path.replace(folder / path.name)
        for path in older - {folder / path.name for path in new}:
            path.rename(before / path.name)
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
    elif old.is_dir() and not _is_of_adios(old):
        number = errno.EEXIST
    elif new.is_dir() and old.is_file():
        number = errno.ENOTDIR
    if number:
        raise OSError(number, os.strerror(number), str(old))


def _is_of_adios(folder: Path) -> bool:
    """Return whether all files of a folder are files of ADIOS2."""
    return folder.is_dir() and all(_OF_ADIOS.fullmatch(p.name) for p in folder.iterdir())


def _files_of(folder: Path, stem: str) -> set[Path]:
    """Return the existing files of fields in both formats; those of VTK are named in the .pvd."""
    bp = folder / f"{stem}.bp"
    files = {bp} if _is_of_adios(bp) else set()
    pvd = folder / f"{stem}.pvd"
    if pvd.is_file():
        times = _named_in(pvd, "DataSet", "file")
        pieces = (piece for time in times for piece in _named_in(time, "Piece", "Source"))
        files |= {pvd, *times, *pieces}
    return {file for file in files if file.exists()}


def _named_in(path: Path, tag: str, attribute: str) -> list[Path]:
    """Return files in the same folder named in an XML file of VTK; none if it is damaged."""
    try:
        names = [e.get(attribute, "") for e in ET.parse(path).iter(tag)]
    except (OSError, ET.ParseError):
        return []
    return [path.with_name(name) for name in names if name and Path(name).name == name]
