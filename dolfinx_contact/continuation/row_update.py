# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Solves with a matrix that differs from a factorised one in a few rows.

Where a point changes its status, or the border row is another one, A_1 = A_0 + E D, with D the
differences of the rows E. By the formula of Sherman, Morrison and Woodbury, with W = A_0^{-1} E,

    A_1^{-1} = A_0^{-1} - W (I + D W)^{-1} D A_0^{-1},    det A_1 = det A_0 det(I + D W)

(W. W. Hager, Updating the inverse of a matrix, SIAM Rev. 31, 1989). A column of W costs a solve with
A_0, and serves every other matrix as well that differs from A_0 in its row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._factor import Factor

__all__ = ["RowUpdate"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[Any]

_ROUND_OFF = 1e-12  # of the size of a row, by which it counts as the same
_SINGULAR = 1e-13  # reciprocal condition of I + D W, below which the formula does not serve


@dataclass(frozen=True)
class _Entries:
    """Entries of the rows of this rank: row (local) and column (global) of each, and the values."""

    number: int
    rows: Indices
    columns: Indices
    values: Array

    @classmethod
    def of(cls, A: PETSc.Mat) -> _Entries:
        """Those of a matrix, copied."""
        ends, columns, values = A.getValuesCSR()
        number = len(ends) - 1
        return cls(number, np.repeat(np.arange(number), np.diff(ends)), columns, values)

    def sizes(self, values: Array) -> Array:
        """Sums of the absolute values of each row."""
        return np.bincount(self.rows, weights=np.abs(values), minlength=self.number)


class RowUpdate:
    """Solves with the matrix that was taken last, by the factorisation of another.

    Its methods are collective.

    Args:
        factor: the factorisation.

    Attributes:
        solves: with A_0, for columns of W.
        changed: rows in which the matrix that was taken last differs.
    """

    def __init__(self, factor: Factor):
        self._factor = factor
        self._base: _Entries | None = None
        self._columns: dict[int, PETSc.Vec] = {}
        self._D: PETSc.Mat | None = None
        self._W: list[PETSc.Vec] = []
        self._S = np.eye(0)
        self.solves = self.changed = 0

    def begin(self, matrix: PETSc.Mat) -> None:
        """``matrix`` has been factorised: it is A_0 from now on."""
        self._base = _Entries.of(matrix)
        for w in self._columns.values():
            w.destroy()
        self._columns = {}
        self._forget()

    def take(self, matrix: PETSc.Mat, most: int) -> bool:
        """Solve with ``matrix`` from now on; False if it differs in more than ``most`` rows.

        So it is where it is singular, or too near to that for the formula.
        """
        self._forget()
        base = self._base
        assert base is not None
        change = matrix.getValuesCSR()[2] - base.values
        size = base.sizes(change)
        mine = np.flatnonzero(size > _ROUND_OFF * (size + base.sizes(base.values)))
        comm = matrix.comm.tompi4py()
        self.changed = comm.allreduce(len(mine))
        if self.changed > most:
            return False
        start, _ = matrix.getOwnershipRange()
        rows = [int(r) for part in comm.allgather(mine + start) for r in part]
        self._D = _chosen_rows(matrix, base, change, mine)
        self._W = [self._column(matrix, r) for r in rows]
        self._S = np.eye(len(rows)) + self._products(self._W)
        return self._is_regular()

    def _is_regular(self) -> bool:
        if not np.isfinite(self._S).all():
            return False
        values = np.linalg.svd(self._S, compute_uv=False)
        return bool(values.min(initial=1.0) > _SINGULAR * values.max(initial=1.0))

    def _column(self, like: PETSc.Mat, row: int) -> PETSc.Vec:
        """A_0^{-1} times the unit vector of a row."""
        if row not in self._columns:
            e, w = like.createVecs()
            start, end = e.getOwnershipRange()
            if start <= row < end:
                e.array[row - start] = 1.0
            self._factor.solve(e, w)
            self.solves += 1
            e.destroy()
            self._columns[row] = w
        return self._columns[row]

    def _products(self, vectors: list[PETSc.Vec]) -> Array:
        """D times vectors, on every rank (k, number of vectors)."""
        D = self._D
        assert D is not None
        out = D.createVecLeft()
        mine = np.empty((out.getLocalSize(), len(vectors)))
        for j, v in enumerate(vectors):
            D.mult(v, out)
            mine[:, j] = out.array_r
        out.destroy()
        return np.concatenate(D.comm.tompi4py().allgather(mine))

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A_1 x = b, or A_0 x = b where no matrix was taken; whether that worked."""
        solved = self._factor.solve(b, x)
        if solved and self._W:
            parts = np.linalg.solve(self._S, self._products([x])[:, 0])
            x.maxpy(-parts, self._W)
        return solved

    @property
    def determinant_sign(self) -> float:
        """Sign of det A_1."""
        return self._factor.determinant_sign * float(np.sign(np.linalg.det(self._S)))

    def _forget(self) -> None:
        if self._D is not None:
            self._D.destroy()
            self._D = None
        self._W = []
        self._S = np.eye(0)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._forget()
        for w in self._columns.values():
            w.destroy()


def _chosen_rows(like: PETSc.Mat, entries: _Entries, values: Array, rows: Indices) -> PETSc.Mat:
    """The matrix of some rows of this rank, with ``values`` in place of those of the entries."""
    chosen = np.isin(entries.rows, rows)
    ends = np.searchsorted(entries.rows[chosen], rows, side="right")
    index = PETSc.IntType
    csr = np.insert(ends, 0, 0).astype(index), entries.columns[chosen], values[chosen]
    sizes = (len(rows), None), (like.getLocalSize()[1], like.getSize()[1])
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=like.comm)
