# SPDX-License-Identifier: LGPL-3.0-or-later
"""Communication: values at shared places, and sums and maxima of a few numbers over all ranks.

DOLFINx creates communicators of neighbours for every vector, a collective call of a millisecond or
more. Frequent users keep a `SharedValues`, which creates one vector for each number of entries.

A few numbers are sent through MPI's buffers: the lower-case methods of mpi4py pickle arrays, which
takes twenty times as long, as much as the evaluation of a law at some contact points.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import common, la

__all__ = ["SharedValues", "anywhere", "largest", "total"]

Array = npt.NDArray[np.float64]


class SharedValues:
    """Values at the local places of an index map, owned places first.

    Args:
        index_map: index map of the places.
    """

    def __init__(self, index_map: common.IndexMap):
        self.index_map = index_map
        self._size: int = index_map.size_local + index_map.num_ghosts
        self._vectors: dict[int, la.Vector] = {}

    def zeros(self, width: int) -> la.Vector:
        """Return the kept vector with ``width`` entries per place, set to 0.

        Collective at the first call. The next call of any method with this width overwrites it.
        """
        vector = self._vectors.get(width)
        if vector is None:
            vector = self._vectors[width] = la.vector(self.index_map, width)
        vector.array[:] = 0.0
        return vector

    def sums(self, places: npt.NDArray[np.integer], parts: Array) -> Array:
        """Return sums over all ranks of parts at local places. Collective.

        Args:
            places: local places, any shape.
            parts: values there, shape (*places.shape, *s) with any shape s.

        Returns:
            Sums at the local places, shape (n, *s).
        """
        shape = parts.shape[places.ndim :]
        v, rows = self._rows(shape)
        np.add.at(rows, places.reshape(-1), parts.reshape(places.size, rows.shape[1]))
        v.scatter_reverse(la.InsertMode.add)
        v.scatter_forward()
        return rows.reshape(self._size, *shape).copy()

    def from_owners(self, values: Array) -> Array:
        """Return values at the local places (n, *s) from those at owned places. Collective."""
        shape = values.shape[1:]
        v, rows = self._rows(shape)
        owned = self.index_map.size_local
        rows[:owned] = values[:owned].reshape(owned, rows.shape[1])
        v.scatter_forward()
        return rows.reshape(self._size, *shape).copy()

    def _rows(self, shape: tuple[int, ...]) -> tuple[la.Vector, Array]:
        """Return a vector for values of a shape, and its rows, shape (n, entries)."""
        width = int(np.prod(shape, dtype=int))
        v = self.zeros(width)
        return v, v.array.reshape(self._size, width)


def total(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """Return sums over all ranks of numbers of any shape, as floats. Collective.

    Sums of empty arrays may be integers on some ranks, and MPI would mix the types.
    """
    local = np.ascontiguousarray(values, dtype=np.float64)
    sums = np.empty_like(local)
    comm.Allreduce(local, sums)
    return sums.reshape(np.shape(values))


def largest(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """Return entrywise maxima over all ranks; NaN if a rank has NaN. Collective."""
    local = np.ascontiguousarray(values, dtype=np.float64)
    maxima = np.empty_like(local)
    comm.Allreduce(local, maxima, op=_LARGEST)
    return maxima.reshape(np.shape(values))


def anywhere(comm: MPI.Comm, *here: bool) -> list[bool]:
    """Return for each of several flags whether it is set on any rank. Collective."""
    local = np.array(here, dtype=bool)
    flags = np.empty_like(local)
    comm.Allreduce(local, flags, op=MPI.LOR)
    return [bool(flag) for flag in flags]


def _larger(one: MPI.buffer, other: MPI.buffer, _: MPI.Datatype) -> None:
    """Maximum that keeps NaN, which MPI's own may lose."""
    target = np.frombuffer(other, dtype=np.float64)
    np.maximum(np.frombuffer(one, dtype=np.float64), target, out=target)


_LARGEST = MPI.Op.Create(_larger, commute=True)
