# SPDX-License-Identifier: LGPL-3.0-or-later
"""Entries that are added to a PETSc matrix repeatedly at the same places."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

__all__ = ["Entries", "matrix_of"]


class Entries:
    """Places of entries on this rank. Entries at one place add up, also on different ranks.

    Args:
        rows: global row numbers, shape (n,); entries with a negative row or column are omitted.
        columns: global column numbers, shape (n,).

    Attributes:
        number: number n of entries.
    """

    def __init__(self, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64]):
        self.number = len(rows)
        self._kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        i = rows[self._kept]
        j = columns[self._kept]
        width = int(j.max(initial=0)) + 1
        places = i * width + j
        #: Places of the sums; None if every entry has its own place, in order.
        self._sums: npt.NDArray[np.int64] | None = None
        if not np.all(places[1:] > places[:-1]):
            places, self._sums = np.unique(places, return_inverse=True)
            i, j = np.divmod(places, width)
        self._size = len(places)
        starts = np.flatnonzero(np.diff(i, prepend=-1))
        self._rows = i[starts].astype(PETSc.IntType)
        self._starts = np.append(starts, self._size).astype(PETSc.IntType)
        self._columns = j.astype(PETSc.IntType)

    def numbers(self, rows: int) -> npt.NDArray[np.int64]:
        """Return the numbers of places in each of the first ``rows`` rows."""
        return np.bincount(self._rows, weights=np.diff(self._starts), minlength=rows).astype(
            np.int64
        )

    def add(self, values: npt.NDArray[np.float64], A: PETSc.Mat) -> None:
        """Add values, in the order of the places, to ``A`` and assemble it. Collective."""
        self.insert(values, A)
        A.assemble()

    def insert(self, values: npt.NDArray[np.float64], A: PETSc.Mat) -> None:
        """As `add`, without the assembly of ``A``. Not collective."""
        summed = values[self._kept]
        if self._sums is not None:
            sums = np.bincount(self._sums, weights=summed, minlength=self._size)
            summed = np.asarray(sums, dtype=np.float64)
        csr = self._starts, self._columns, summed
        A.setValuesIJV(*csr, addv=PETSc.InsertMode.ADD_VALUES, rowmap=self._rows)


def matrix_of(comm: MPI.Comm, shape: tuple[int, int], *entries: Entries) -> PETSc.Mat:
    """Return a matrix of zeros whose pattern contains places of entries. Collective.

    Args:
        comm: communicator.
        shape: numbers of rows and columns of this rank.
        entries: places in the pattern.
    """
    A = PETSc.Mat().createAIJ(((shape[0], None), (shape[1], None)), comm=comm)
    if comm.size == 1:  # on several ranks, entries of other ranks are unknown
        numbers = sum(e.numbers(shape[0]) for e in entries)
        A.setPreallocationNNZ(np.minimum(numbers, shape[1]).astype(PETSc.IntType))
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    A.setUp()
    for e in entries:
        e.insert(np.zeros(e.number), A)
    A.assemble()
    A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    return A
