# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of rectangles and boxes with graded cell sizes."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from dolfinx import mesh

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import Arguments, collective

__all__ = ["create_grid", "graded"]


def graded(length: float, size: float, fine: int, coarse: int) -> Array:
    """Return the coordinates of a graded 1D grid from 0 to ``length``.

    The grid starts with fine cells of equal size, followed by coarse cells. The sizes of the coarse
    cells form a geometric sequence that continues the size of the fine cells.

    Args:
        length: length of the grid.
        size: size of the fine cells.
        fine: number of fine cells.
        coarse: number of coarse cells, at least 1.

    Returns:
        Increasing coordinates, shape (fine + coarse + 1,).

    Raises:
        ValueError: if ``size`` is not positive, if the fine cells fill the length, or if ``coarse``
            is 0.
    """
    if not (size > 0 and fine >= 0 and coarse >= 1 and fine * size < length < np.inf):
        raise ValueError(f"{fine} cells of size {size} and {coarse} more do not fill {length}")
    powers = np.arange(1, coarse + 1)
    rest = length / size - fine

    def excess(growth: float) -> float:
        return float(np.sum(growth**powers) - rest)

    growth = brentq(excess, 0.0, max(1.0, rest) ** (1 / coarse) + 1.0, xtol=1e-15)
    inner = np.arange(fine + 1) * size
    return np.concatenate([inner, inner[-1] + np.cumsum(growth**powers) * size])


def _check(a: Arguments) -> None:
    axes = [np.asarray(c, dtype=float) for c in a.coordinates]
    if len(axes) not in (2, 3) or not all(len(c) > 1 and (np.diff(c) > 0).all() for c in axes):
        raise ValueError("coordinates must be given along two or three axes and must increase")
    a.coordinates = axes


@collective("create_grid", _check)
def create_grid(
    comm: MPI.Comm, coordinates: Sequence[npt.ArrayLike], cell: mesh.CellType
) -> mesh.Mesh:
    """Create a mesh of a rectangle or box with given grid coordinates. Collective.

    Args:
        comm: communicator of the mesh.
        coordinates: increasing coordinates of the grid along each of two or three axes.
        cell: cell type, which must match the number of axes.

    Returns:
        Mesh with one cell per grid cell, or several cells for simplices.

    Raises:
        ValueError: on every rank, if there are not two or three axes, or coordinates are not
            increasing or differ between ranks.
    """
    axes = [np.asarray(c) for c in coordinates]
    create = mesh.create_unit_square if len(axes) == 2 else mesh.create_unit_cube
    domain = create(comm, *(len(c) - 1 for c in axes), cell)
    x = domain.geometry.x
    for i, c in enumerate(axes):
        x[:, i] = np.interp(x[:, i] * (len(c) - 1), np.arange(len(c)), c)
    return domain
