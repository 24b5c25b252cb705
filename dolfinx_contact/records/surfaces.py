# SPDX-License-Identifier: LGPL-3.0-or-later
"""The outer surface of bodies in a record, by which it can be drawn without the problem.

As it is before anything moves it is in one file, written at the beginning; where it is at a point
or step is in a file of its own, in single precision, with the tables of contact points there in
double precision. All have the vertices in the order of their numbers in the mesh as it was given to
DOLFINx, and contact points in the order of their coordinates, whatever the number of ranks.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from dolfinx_contact._errors import on_root
from dolfinx_contact._files import part_of, sync
from dolfinx_contact.io.gathering import Arrays
from dolfinx_contact.io.outside import OuterSurface, Outside, SurfaceState

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["SurfaceFiles", "read_state", "read_surface"]

T = TypeVar("T")

_SURFACE = "surface.npz"
_STATES = "surface"


class SurfaceFiles:
    """Writes the outer surface of the bodies of a problem. Collective.

    Args:
        folder: of the record.
        problem: whose displacement is shown.
    """

    def __init__(self, folder: Path, problem: ContactProblem):
        self._folder = folder
        self._comm = problem.comm
        self._outside = Outside(problem)

    def write_surface(self) -> None:
        """Write it as it is before anything moves. Collective.

        Raises:
            OSError: on every rank, with the path, if it cannot be written.
        """
        surface = self._outside.surface()
        arrays = {} if surface is None else surface.arrays()
        on_root(self._comm, lambda: _save(self._folder / _SURFACE, arrays))

    def write_state(self, name: str) -> None:
        """Write where it is at the displacement of the problem. Collective.

        Args:
            name: of the point or step.

        Raises:
            OSError: on every rank, with the path, if it cannot be written; nothing is left then.
        """
        state = self._outside.state()
        arrays = {} if state is None else state.arrays()

        def write() -> None:
            (self._folder / _STATES).mkdir(exist_ok=True)
            _save(_file_of(self._folder, name), arrays)

        on_root(self._comm, write)

    def remove(self, name: str) -> None:
        """Forget where it is at a point or step, on rank 0."""
        if self._comm.rank == 0:
            _file_of(self._folder, name).unlink(missing_ok=True)


def read_surface(folder: Path) -> OuterSurface:
    """The outer surface of a record, on this rank alone.

    Raises:
        ValueError: if it is damaged or missing.
    """
    return _read(folder / _SURFACE, OuterSurface.of_arrays)


def read_state(folder: Path, name: str) -> SurfaceState:
    """Where the outer surface of a record is at a point or step, on this rank alone.

    Raises:
        ValueError: if it is damaged or missing.
    """
    return _read(_file_of(folder, name), SurfaceState.of_arrays)


def _file_of(folder: Path, name: str) -> Path:
    return folder / _STATES / f"{name}.npz"


def _save(file: Path, arrays: Arrays) -> None:
    """Write a file that is whole or not there, and on the disk when this returns."""
    with part_of(file) as part:
        np.savez_compressed(part, **arrays)  # type: ignore[arg-type]
    sync(file.parent)


def _read(file: Path, made_of: Callable[[Arrays], T]) -> T:
    """What is made of the arrays of a file.

    Raises:
        ValueError: if it is missing, damaged, or lacks an array.
    """
    if file.is_file() and not zipfile.is_zipfile(file):
        raise ValueError(f"{file} is damaged: it is no npz file")
    try:
        with np.load(file, allow_pickle=False) as found:
            arrays = dict(found)
    except FileNotFoundError:
        raise ValueError(f"{file} is missing") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError) as error:
        raise ValueError(f"{file} is damaged: {error}") from None
    try:
        return made_of(arrays)
    except KeyError as error:
        raise ValueError(f"{file} is damaged: {error} is missing") from None
