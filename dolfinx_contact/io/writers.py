# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of Functions for ParaView and PyVista, written by DOLFINx.

VTX (``.bp``, a folder) is written by ADIOS2; VTK is a ``.pvd`` that names the ``.pvtu`` of each
time and the ``.vtu`` of each rank. Cells of displacements of degree 2 are Lagrange cells, so that
nothing is lost. The Functions of a file have one mesh and one Lagrange element.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Literal, TypeAlias

from mpi4py import MPI

from dolfinx import fem, io

from dolfinx_contact._compat import VTXFile, has_vtx
from dolfinx_contact._files import os_error
from dolfinx_contact._mpi import everywhere, require, same_everywhere
from dolfinx_contact.io.files import aside, output_folder, write_script

__all__ = ["Fields", "Format", "Writer", "checked_format"]

logger = logging.getLogger(__name__)

#: Format of files; None means VTX, or VTK if DOLFINx was built without ADIOS2.
Format: TypeAlias = Literal["vtx", "vtk"] | None
#: Functions of all files at a state, by the name of the file without suffix.
Fields: TypeAlias = Mapping[str, Sequence[fem.Function]]


def checked_format(comm: MPI.Comm, format: Format) -> Literal["vtx", "vtk"]:
    """Validate a file format and return it, or the default format. Collective.

    Raises:
        ValueError: on every rank, if the format is unknown, differs between ranks, or is VTX and
            DOLFINx was built without ADIOS2.
    """
    same_everywhere(comm, format=format)
    require(comm, format in ("vtx", "vtk", None), f"format is {format!r}: vtx and vtk are known")
    require(comm, format != "vtx" or has_vtx(), "DOLFINx was built without ADIOS2: format='vtk'")
    if format is None and not has_vtx():
        if comm.rank == 0:
            logger.info("DOLFINx was built without ADIOS2: fields are written as VTK")
        return "vtk"
    return format or "vtx"


class Writer:
    """Writer of a series of states, with a script ``paraview.py`` that shows them. Collective.

    The first state opens the files in a hidden folder. Later states are copied to its Functions.
    At the end of the context, the files are moved to their folder and replace earlier files.

    Args:
        comm: communicator.
        folder: output folder, created if necessary.
        format: format of the files.
        prefix: beginning of the names of a series, whose earlier files are all removed.

    Attributes:
        files: final paths of the files; empty before the first state.
    """

    def __init__(
        self, comm: MPI.Comm, folder: str | os.PathLike[str], format: Format, prefix: str = ""
    ):
        self._comm = comm
        self._suffix = {"vtx": ".bp", "vtk": ".pvd"}[checked_format(comm, format)]
        self._prefix = prefix
        self.folder = output_folder(comm, folder)
        self.files: list[Path] = []
        self._first: Fields = {}
        self._writers: list[VTXFile | io.VTKFile] = []
        self._stack = ExitStack()

    def __enter__(self) -> Writer:
        name = f"{self._prefix}write_fields"
        self._part = self._stack.enter_context(aside(self._comm, self.folder, name, self._prefix))
        return self

    def write(self, time: float, fields: Fields) -> None:
        """Write a state. Collective.

        Args:
            time: time of the state.
            fields: Functions by file; the files and their order must be the same for all states.

        Raises:
            OSError: on every rank, with the path, if a file cannot be written.
        """
        self._first = self._first or fields
        self.files = [self.folder / (stem + self._suffix) for stem in self._first]
        for number, (stem, functions) in enumerate(self._first.items()):
            for f, g in zip(functions, fields[stem], strict=True):
                f.x.array[:] = g.x.array
            with self._errors(number):
                if number == len(self._writers):
                    comm = functions[0].function_space.mesh.comm
                    file = self._part / (stem + self._suffix)
                    if self._suffix == ".bp":
                        self._writers.append(VTXFile(comm, file, functions))
                    else:
                        self._writers.append(io.VTKFile(comm, file, "w"))
                writer = self._writers[number]
                if isinstance(writer, VTXFile):
                    writer.write(time)
                else:
                    writer.write_function(list(functions), time)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        with self._stack:
            self._close()
            if error is not None:
                raise error  # the files are not moved
            if self._first:
                write_script(self._comm, self._part, self.folder)

    def _close(self) -> None:
        """Finish the files. Collective."""
        for number, writer in enumerate(self._writers):
            with self._errors(number):
                writer.close()
        self._writers = []  # a VTKFile that is destroyed later would write once more

    @contextmanager
    def _errors(self, number: int) -> Iterator[None]:
        """Raise an error of a file as ``OSError`` with its path on every rank. Collective."""
        stem, functions = list(self._first.items())[number]
        path = self._part / (stem + self._suffix)
        try:
            with everywhere(functions[0].function_space.mesh.comm, f"writing {path}"):
                try:
                    yield
                except (OSError, RuntimeError) as error:
                    raise os_error(error, path) from error
        except OSError:
            for writer in self._writers:
                if isinstance(writer, VTXFile):
                    writer.abandon()
            self._writers = []
            raise
