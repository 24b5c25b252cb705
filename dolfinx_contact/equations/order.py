# SPDX-License-Identifier: LGPL-3.0-or-later
"""The points of all ranks in one order, blind to numbering and ranks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

__all__ = ["Gathered", "by_coordinates"]

T = TypeVar("T", bound=np.generic)

_SAME = 1e-9  # of the size of all, a difference that is round-off


def by_coordinates(x: npt.NDArray[np.float64], ids: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """Order by x, then y, then z, blind to round-off.

    Args:
        x: positions (n, dim).
        ids: what distinguishes points at one place, as at the sides of a crack: rows of numbers
            that do not depend on ranks (n, k).
    """
    least = _SAME * np.ptp(x, axis=0).max(initial=0.0)
    keys = [_grouped(column, least) for column in x.T]
    return np.lexsort([*ids.T[::-1], *keys[::-1]])


def _grouped(values: npt.NDArray[np.float64], least: float) -> npt.NDArray[np.int64]:
    """Places in the order of values, the same for those that differ by ``least`` at most."""
    order = np.argsort(values)
    steps = np.diff(values[order]) > least
    places: npt.NDArray[np.int64] = np.zeros(len(values), dtype=np.int64)
    places[order[1:]] = np.cumsum(steps)
    return places


class Gathered:
    """The points of all ranks in the order of their coordinates, the same everywhere. Collective.

    Args:
        comm: communicator.
        x: positions of the points of this rank (n, dim).
        ids: what distinguishes points at one place; see `by_coordinates` (n, k).

    Attributes:
        positions: of all points, in order (number, dim).
        mine: places of the points of this rank among all (n,).
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
        """Values at all points, in order, from those at the points of this rank. Collective."""
        return np.concatenate(self._comm.allgather(values))[self._order]

    def columns(self, values: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Several by name, as `__call__` has one. Collective."""
        parts = self._comm.allgather(dict(values))
        return {k: np.concatenate([part[k] for part in parts])[self._order] for k in values}

    def owner(self, i: int) -> tuple[int, int]:
        """The rank that owns point ``i``, and its number among the points there."""
        place = int(self._order[i])
        rank = int(np.searchsorted(self._starts, place, side="right") - 1)
        return rank, place - int(self._starts[rank])
