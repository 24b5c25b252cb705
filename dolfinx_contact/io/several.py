# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields at states that follow each other, in several files for ParaView: a series each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mpi4py import MPI

from dolfinx import fem

from dolfinx_contact.io.writers import Series, see_room, series

__all__ = ["FieldSeries", "FieldsOfFile"]


@dataclass(frozen=True, eq=False)
class FieldsOfFile:
    """What one file has of a state.

    Attributes:
        stem: of the file, without suffix.
        comm: of the mesh.
        functions: of one mesh and one Lagrange element.
    """

    stem: str
    comm: MPI.Comm
    functions: Sequence[fem.Function]


class FieldSeries:
    """Files to which one state after the other is written. Collective.

    They are begun with the first state. The Functions of that one are those of the series: it keeps
    them, and what later states have is copied into them.

    Args:
        comm: of the problem.
        part: the hidden folder in which files are written (`disk.aside`).
        folder: where they are going to be.
        format: of the files.
        single: whether there is one state alone.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        part: Path,
        folder: Path,
        format: Literal["vtx", "vtk"],
        *,
        single: bool = False,
    ):
        self._comm = comm
        self._part = part
        self._folder = folder
        self._format = format
        self._single = single
        self._shown: list[FieldsOfFile] = []
        self._opened: list[Series] = []

    @property
    def files(self) -> list[Path]:
        """Their names, where they are going to be; none before the first state."""
        return [self._folder / each.file.name for each in self._opened]

    def write(self, time: float, state: Sequence[FieldsOfFile], *, left: int = 1) -> None:
        """Write a state. Collective.

        Args:
            time: of it.
            state: its fields, the same files in the same order at all states.
            left: states that are to come, with this one, for which there must be room: a disk may
                fill up on the way.

        Raises:
            OSError: on every rank, with the path, if it cannot be written, or has no room.
        """
        self._shown = self._shown or list(state)
        if self._format == "vtx":
            every = [fields.functions for fields in self._shown]
            see_room(self._comm, self._folder / self._shown[0].stem, every, left)
        for fields in self._shown[len(self._opened) :]:
            stem = self._part / fields.stem
            begun = series(fields.comm, stem, fields.functions, self._format, single=self._single)
            self._opened.append(begun)
        for shown, now, each in zip(self._shown, state, self._opened, strict=True):
            for f, g in zip(shown.functions, now.functions, strict=True):
                f.x.array[:] = g.x.array
            each.write(time)

    def close(self) -> None:
        """Finish the files; an error of before is enough. Collective."""
        for each in self._opened:
            each.close()
