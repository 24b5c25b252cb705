# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of Functions for ParaView and PyVista, written by DOLFINx.

VTX files (``.bp``, a folder) are written by ADIOS2. In the VTK format, a ``.pvd`` file lists one
``.pvtu`` file per time, which lists one ``.vtu`` file per rank. A displacement of degree 2 is
written on Lagrange cells without loss. All Functions of a file have the same mesh and Lagrange
element.

DOLFINx writes into a hidden folder. When all files are complete, they replace the files of earlier
states. If the disk is full or the process is killed, the earlier files therefore remain.
"""

from __future__ import annotations

import ctypes
import errno
import logging
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, TypeAlias

from mpi4py import MPI

from dolfinx import fem, io

from dolfinx_contact._files import os_error, sync
from dolfinx_contact._mpi import everywhere, on_root, require, same_everywhere
from dolfinx_contact.io.files import output_folder

__all__ = ["Fields", "Format", "Writer", "checked_format"]

logger = logging.getLogger(__name__)

_SCRIPT = "paraview.py"
#: Files in a folder of ADIOS2, whose numbers depend on ranks and steps.
_OF_ADIOS = re.compile(r"(data|md|mmd)\.\d+|md\.idx|profiling\.json|active")
#: Names of files in a ``.pvd`` and a ``.pvtu``.
_NAMED = re.compile(r'\b(?:file|Source)="([^"/]+)"')

#: Format of files; None means VTX, or VTK if DOLFINx was built without ADIOS2.
Format: TypeAlias = Literal["vtx", "vtk"] | None
#: Functions of all files at a state, by the name of the file without prefix and suffix.
Fields: TypeAlias = Mapping[str, Sequence[fem.Function]]


#: Whether DOLFINx was built with ADIOS2.
_HAS_VTX = hasattr(io, "VTXWriter")


def checked_format(comm: MPI.Comm, format: Format) -> Literal["vtx", "vtk"]:
    """Validate a file format and return it; None selects the default format. Collective.

    Raises:
        ValueError: on every rank, if the format is unknown, differs between ranks, or is VTX and
            DOLFINx was built without ADIOS2.
    """
    same_everywhere(comm, format=format)
    require(comm, format in ("vtx", "vtk", None), f"format is {format!r}: vtx and vtk are known")
    require(comm, format != "vtx" or _HAS_VTX, "DOLFINx was built without ADIOS2: format='vtk'")
    if format is None and not _HAS_VTX:
        if comm.rank == 0:
            logger.info("DOLFINx was built without ADIOS2: fields are written as VTK")
        return "vtk"
    return format or "vtx"


class Writer:
    """Writer of a series of states, with a script ``paraview.py`` that shows them. Collective.

    The first state opens the files with its Functions; the values of later states are copied to
    these Functions. At the end of the context, the new files replace earlier files of the same
    names, in either format. After an error earlier files remain.

    Args:
        comm: communicator.
        folder: output folder, created if necessary.
        format: format of the files, "vtx", "vtk" or None for the default.
        prefix: common prefix of the file names of a series; all earlier files with this prefix are
            removed at the end.

    Attributes:
        files: final paths of the files; empty before the first state.

    Raises:
        OSError: on every rank, with the path, from any method if a file cannot be written or
            replaced, for example because a folder of the same name exists.
    """

    def __init__(
        self, comm: MPI.Comm, folder: str | os.PathLike[str], format: Format, prefix: str = ""
    ):
        self._comm = comm
        self._suffix = {"vtx": ".bp", "vtk": ".pvd"}[checked_format(comm, format)]
        self._prefix = prefix
        self.folder = output_folder(comm, folder)
        self.files: list[Path] = []
        self._part = self.folder / f".{prefix}write_fields.part"
        self._first: Fields = {}
        self._writers: dict[str, io.VTXWriter | io.VTKFile] = {}

    def __enter__(self) -> Writer:
        def start() -> None:
            shutil.rmtree(self._part, ignore_errors=True)  # left by a killed run
            self._part.mkdir()

        self._on_root(start)
        return self

    def write(self, time: float, fields: Fields) -> None:
        """Write a state to the files. Collective.

        Args:
            time: time of the state.
            fields: Functions by file name without prefix and suffix, in the same order for all
                states.
        """
        self._first = self._first or fields
        self.files = [self.folder / self._name(stem) for stem in self._first]
        for stem, functions in self._first.items():
            for f, g in zip(functions, fields[stem], strict=True):
                f.x.array[:] = g.x.array
            with self._errors(stem):
                if stem not in self._writers:
                    self._writers[stem] = self._opened(stem, functions)
                writer = self._writers[stem]
                if self._suffix == ".bp":
                    writer.write(time)
                else:
                    writer.write_function(list(functions), time)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        try:
            self._close()
            if error is None:
                self._comm.barrier()
                self._on_root(self._replace)
        finally:
            if self._comm.rank == 0:
                shutil.rmtree(self._part, ignore_errors=True)

    def _name(self, stem: str) -> str:
        """Return the name of a file, with the prefix and the suffix of the format."""
        return self._prefix + stem + self._suffix

    def _close(self) -> None:
        """Finish the files and destroy their writers. Collective.

        A `VTKFile` writes once more when it is destroyed, which must happen before the files move.
        """
        for stem, writer in self._writers.items():
            with self._errors(stem):
                writer.close()
        self._writers = {}

    def _opened(self, stem: str, functions: Sequence[fem.Function]) -> io.VTXWriter | io.VTKFile:
        """Open a file for Functions. Collective."""
        comm = functions[0].function_space.mesh.comm
        file = self._part / self._name(stem)
        if self._suffix == ".bp":
            return io.VTXWriter(comm, file, list(functions))
        return io.VTKFile(comm, file, "w")

    @contextmanager
    def _errors(self, stem: str) -> Iterator[None]:
        """Context manager that raises errors of a file as ``OSError`` with its path. Collective."""
        path = self.folder / self._name(stem)
        try:
            with everywhere(self._comm, f"writing {path}"):
                try:
                    yield
                except (OSError, RuntimeError) as error:
                    raise os_error(error, path) from error
        except OSError:
            if self._suffix == ".bp":
                for writer in self._writers.values():
                    _keep_alive(writer)
            self._writers = {}
            raise

    def _on_root(self, do: Callable[[], None]) -> None:
        """Call a function on rank 0; errors contain final paths, not hidden paths. Collective."""

        def done() -> None:
            try:
                do()
            except OSError as error:
                path = Path(error.filename or self.folder)
                if path.is_relative_to(self._part):
                    path = self.folder / path.relative_to(self._part)
                raise os_error(error, path) from error

        on_root(self._comm, done)

    def _replace(self) -> None:
        """Replace earlier files by the new files. Called on rank 0."""
        if self._first:
            _write_script(self._part, self.folder, {stem: self._name(stem) for stem in self._first})
        new = sorted(self._part.iterdir(), key=lambda p: (not p.is_dir(), p.name))  # folders first
        for path in new:
            _require_replaceable(path, self.folder / path.name)
            _require_complete(path)
        for path in (self._part, *self._part.rglob("*")):
            sync(path)
        stems = {p.stem for p in new if p.suffix in (".bp", ".pvd")}
        if self._prefix:
            earlier = self.folder.glob(f"{self._prefix}*")
            stems |= {p.stem for p in earlier if p.suffix in (".bp", ".pvd")}
        older = {file for stem in stems for file in _files_of(self.folder, stem)}
        before = self._part / "before"  # removed with the hidden folder
        before.mkdir()
        for path in new:
            file = self.folder / path.name
            if file.is_dir():
                file.rename(before / path.name)
            path.replace(file)
            older.discard(file)
        for file in older:
            file.rename(before / file.name)
        sync(self.folder)


def _keep_alive(writer: io.VTXWriter) -> None:
    """Keep a writer alive after an error of ADIOS2, so that its destructor does not run.

    The destructor of DOLFINx would close the file again, and the resulting error would terminate
    the process.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(writer._cpp_object))


def _write_script(part: Path, folder: Path, files: dict[str, str]) -> None:
    """Write ``paraview.py``, which shows the files in its folder. Called on rank 0.

    An existing ``paraview.py`` that this package has not written is kept, with a warning.

    Args:
        part: temporary folder in which the script is written.
        folder: final folder, stored in the script because ParaView does not always pass the path of
            a script.
        files: names of the files, by key such as "body" or "contact".
    """
    text = Path(__file__).with_name("in_paraview.py").read_text()
    head = "".join(text.splitlines(keepends=True)[:2]).encode()
    file = folder / _SCRIPT
    if file.is_file() and not file.read_bytes().startswith(head):
        message = "%s is not one of this package, and is left unchanged: no script for ParaView"
        logger.warning(message, file)
        return
    text = text.replace('FOLDER = ""', f"FOLDER = {str(folder.resolve())!r}")
    text = text.replace("FILES: dict[str, str] = {}", f"FILES = {files}")
    (part / _SCRIPT).write_text(text)


def _require_complete(path: Path) -> None:
    """Raise ``OSError`` if a VTK file is truncated; DOLFINx does not report a full disk."""
    if path.suffix in (".pvd", ".pvtu", ".vtu"):
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - 32, 0))
            if not file.read().rstrip().endswith(b"</VTKFile>"):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _require_replaceable(new: Path, old: Path) -> None:
    """Raise ``OSError`` unless a file replaces a file, or a folder one written by ADIOS2."""
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
    """Return whether a path is a folder that contains only files of ADIOS2."""
    return folder.is_dir() and all(_OF_ADIOS.fullmatch(p.name) for p in folder.iterdir())


def _files_of(folder: Path, stem: str) -> set[Path]:
    """Return the existing files of one name in both formats, including referenced VTK files."""
    bp = folder / f"{stem}.bp"
    found = {bp} if _is_of_adios(bp) else set()
    names = [f"{stem}.pvd"]
    while names:
        file = folder / names.pop()
        if file.is_file():
            found.add(file)
            if file.suffix != ".vtu":
                names += _NAMED.findall(file.read_text(errors="replace"))
    return found
