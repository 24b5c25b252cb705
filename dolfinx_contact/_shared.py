# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks share: values at common places, and sums and extremes of a few numbers over all ranks.

DOLFINx makes communicators of neighbours for every vector, a collective call of a millisecond and
more. What is asked often keeps a `SharedValues`, which makes one vector for each number of entries.

A few numbers go through MPI's buffers: the methods of mpi4py in small letters pickle arrays, which
takes twenty times as long, as long as a law at some contact points.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import common, la

__all__ = ["SharedValues", "anywhere", "largest", "total"]

Array = npt.NDArray[np.float64]


class SharedValues:
    """Values at the places of an index map, by rank the owned ones first and then its ghosts.

    Args:
        index_map: of the places.
    """

    def __init__(self, index_map: common.IndexMap):
        self.index_map = index_map
        self._size: int = index_map.size_local + index_map.num_ghosts
        self._vectors: dict[int, la.Vector] = {}

    def zeros(self, width: int) -> la.Vector:
        """The kept vector of as many entries at a place, all 0. Collective at its first call.

        The next call of this width, of any method, overwrites it.
        """
        found = self._vectors.get(width)
        if found is None:
            found = self._vectors[width] = la.vector(self.index_map, width)
        found.array[:] = 0.0
        return found

    def sums(self, places: npt.NDArray[np.integer], parts: Array) -> Array:
        """Parts (..., s) at local places (...), added over all ranks, by local place (n, s).

        Collective; ``s`` is any shape.
        """
        shape = parts.shape[places.ndim :]
        v, rows = self._rows(shape)
        np.add.at(rows, places.reshape(-1), parts.reshape(places.size, rows.shape[1]))
        v.scatter_reverse(la.InsertMode.add)
        v.scatter_forward()
        return rows.reshape(self._size, *shape).copy()

    def from_owners(self, values: Array) -> Array:
        """Values at the local places (n, s) from those at the owned ones, which come first.

        Collective.
        """
        shape = values.shape[1:]
        v, rows = self._rows(shape)
        owned = self.index_map.size_local
        rows[:owned] = values[:owned].reshape(owned, rows.shape[1])
        v.scatter_forward()
        return rows.reshape(self._size, *shape).copy()

    def _rows(self, shape: tuple[int, ...]) -> tuple[la.Vector, Array]:
        """A vector for values of a shape, and its rows (n, entries)."""
        width = int(np.prod(shape, dtype=int))
        v = self.zeros(width)
        return v, v.array.reshape(self._size, width)


def total(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """Sums over all ranks of numbers of any shape. Collective.

    They are real numbers on every rank: NumPy's functions of nothing may give integers, and what
    ranks send of different types MPI adds as it comes.
    """
    mine = np.ascontiguousarray(values, dtype=np.float64)
    found = np.empty_like(mine)
    comm.Allreduce(mine, found)
    return found.reshape(np.shape(values))


def largest(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """The largest over all ranks, each for itself; NaN where a rank has that. Collective."""
    mine = np.ascontiguousarray(values, dtype=np.float64)
    found = np.empty_like(mine)
    comm.Allreduce(mine, found, op=_LARGEST)
    return found.reshape(np.shape(values))


def anywhere(comm: MPI.Comm, *here: bool) -> list[bool]:
    """Whether each of several things holds on any rank. Collective."""
    mine = np.array(here, dtype=bool)
    found = np.empty_like(mine)
    comm.Allreduce(mine, found, op=MPI.LOR)
    return [bool(there) for there in found]


def _larger(one: MPI.buffer, other: MPI.buffer, _: MPI.Datatype) -> None:
    """MPI's own maximum may lose what is no number."""
    both = np.frombuffer(other, dtype=np.float64)
    np.maximum(np.frombuffer(one, dtype=np.float64), both, out=both)


_LARGEST = MPI.Op.Create(_larger, commute=True)
