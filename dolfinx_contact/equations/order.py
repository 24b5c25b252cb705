# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of all ranks in one order, independent of numbering and ranks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import by_coordinates

__all__ = ["Gathered"]

T = TypeVar("T", bound=np.generic)


class Gathered:
    """Points of all ranks in the order of their coordinates, on every rank. Collective.

    Args:
        comm: communicator.
        x: positions of the points of this rank, shape (n, dim).
        ids: keys distinguishing points at one place (`by_coordinates`), shape (n, k).

    Attributes:
        positions: positions of all points, in order, shape (number, dim).
        mine: places of the points of this rank among all points, shape (n,).
    """

    def __init__(
        self, comm: MPI.Comm, x: npt.NDArray[np.float64], ids: npt.NDArray[np.int64]
    ) -> None:
        self._comm = comm
        parts = comm.allgather((x, ids))
        everywhere = np.concatenate([places for places, _ in parts])
        self._order = by_coordinates(everywhere, np.concatenate([names for _, names in parts]))
        self._starts = np.concatenate([[0], np.cumsum([len(places) for places, _ in parts])])
        self.positions = everywhere[self._order]
        places = np.argsort(self._order)
        first = self._starts[comm.rank]
        self.mine: npt.NDArray[np.int64] = places[first : first + len(x)]

    def __len__(self) -> int:
        """Number of points of all ranks."""
        return len(self.positions)

    def __call__(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Return values at all points, in order, from those of this rank. Collective."""
        return np.concatenate(self._comm.allgather(values))[self._order]

    def columns(self, values: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Apply `__call__` to several arrays by name. Collective."""
        parts = self._comm.allgather(dict(values))
        return {k: np.concatenate([part[k] for part in parts])[self._order] for k in values}

    def owner(self, i: int) -> tuple[int, int]:
        """Return the rank owning point ``i``, and its number among the points there."""
        place = int(self._order[i])
        rank = int(np.searchsorted(self._starts, place, side="right") - 1)
        return rank, place - int(self._starts[rank])
