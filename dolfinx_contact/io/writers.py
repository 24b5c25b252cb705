# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of Functions for ParaView and PyVista, written by DOLFINx.

VTX (``.bp``, a folder) is written by ADIOS2; VTK is a ``.pvd`` that names the ``.pvtu`` of each
time and the ``.vtu`` of each rank. Cells of displacements of degree 2 are Lagrange cells, so that
nothing is lost. The Functions of a file have one mesh and one Lagrange element.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from mpi4py import MPI

from dolfinx import fem, io

from dolfinx_contact._compat import VTXFile, has_vtx
from dolfinx_contact._files import os_error
from dolfinx_contact._mpi import everywhere, require, same_everywhere

__all__ = ["FieldSeries", "FieldsOfFile", "Format", "checked_format"]

logger = logging.getLogger(__name__)

#: Format of files; None means VTX, or VTK if DOLFINx was built without ADIOS2.
Format: TypeAlias = Literal["vtx", "vtk"] | None


def checked_format(comm: MPI.Comm, format: Format) -> Literal["vtx", "vtk"]:
    """Return the format that is used. Collective.

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


@dataclass(frozen=True, eq=False)
class FieldsOfFile:
    """The fields of one file at a state.

    Attributes:
        stem: name of the file without suffix.
        comm: communicator of the mesh.
        functions: Functions of one mesh and one Lagrange element.
    """

    stem: str
    comm: MPI.Comm
    functions: Sequence[fem.Function]


class FieldSeries:
    """Files to which states are written one after the other. Collective.

    The first state opens the files. Later states are copied into its Functions.

    Args:
        part: hidden folder in which the files are written (`disk.aside`).
        folder: folder to which they will be moved.
        format: format of the files.
    """

    def __init__(self, part: Path, folder: Path, format: Literal["vtx", "vtk"]):
        self._part = part
        self._folder = folder
        self._suffix = {"vtx": ".bp", "vtk": ".pvd"}[format]
        self._first: Sequence[FieldsOfFile] = []
        self._writers: list[VTXFile | io.VTKFile] = []

    @property
    def files(self) -> list[Path]:
        """Final paths of the files; none before the first state."""
        return [self._folder / (fields.stem + self._suffix) for fields in self._first]

    def write(self, time: float, state: Sequence[FieldsOfFile]) -> None:
        """Write a state. Collective.

        Args:
            time: time of the state.
            state: fields of all files, the same files in the same order at all states.

        Raises:
            OSError: on every rank, with the path, if a file cannot be written.
        """
        self._first = self._first or state
        for number, (shown, fields) in enumerate(zip(self._first, state, strict=True)):
            functions = list(shown.functions)
            for f, g in zip(functions, fields.functions, strict=True):
                f.x.array[:] = g.x.array
            with self._errors(number):
                if number == len(self._writers):
                    file = self._part / (shown.stem + self._suffix)
                    vtx = self._suffix == ".bp"
                    self._writers.append(
                        VTXFile(shown.comm, file, functions)
                        if vtx
                        else io.VTKFile(shown.comm, file, "w")
                    )
                writer = self._writers[number]
                if isinstance(writer, VTXFile):
                    writer.write(time)
                else:
                    writer.write_function(functions, time)

    def close(self) -> None:
        """Finish the files. Collective."""
        for number, writer in enumerate(self._writers):
            with self._errors(number):
                writer.close()
        self._writers = []

    @contextmanager
    def _errors(self, number: int) -> Iterator[None]:
        """Raise an error of a file as ``OSError`` with its path on every rank. Collective."""
        fields = self._first[number]
        path = self._part / (fields.stem + self._suffix)
        try:
            with everywhere(fields.comm, f"writing {path}"):
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
