# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Solves with a matrix that differs from a factorised one in a few rows and its last column.

Where a point changes its status, or the border row changes, A_1 = A_0 + E D with the differences D
of the rows E. From one state to the next, the column of gamma differs by c outside of these rows.
With U = (E, c), V^T = (D, e^T), e the unit vector of gamma, and W = A_0^{-1} U,

    A_1^{-1} = A_0^{-1} - W (I + V^T W)^{-1} V^T A_0^{-1},    det A_1 = det A_0 det(I + V^T W)

(Sherman, Morrison and Woodbury; W. W. Hager, SIAM Rev. 31, 1989). A column of W costs one solve
with A_0; those of E serve every matrix that differs in these rows.
"""

from __future__ import annotations

from collections.abc import Sequence
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
_MOST_COLUMNS = 100  # of W that are kept
_SINGULAR = 1e-13  # reciprocal condition of I + V^T W, below which the formula does not serve


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

    def changed(self, change: Array) -> Indices:
        """Rows in which a change of the values is more than round-off; NaN is."""
        size, of_change = (
            np.bincount(self.rows, weights=np.abs(v), minlength=self.number)
            for v in (self.values, change)
        )
        return np.flatnonzero(~(of_change <= _ROUND_OFF * (size + of_change)))


class RowUpdate:
    """Solves with the last matrix A_1 by the factorisation of A_0.

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
        self._border: PETSc.Vec | None = None  # A_0^{-1} c
        self._V: PETSc.Mat | None = None
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
        """Use ``matrix`` as A_1; False if more than ``most`` rows differ or it is near singular."""
        self._forget()
        base = self._base
        assert base is not None
        change = matrix.getValuesCSR()[2] - base.values
        at_border = base.columns == matrix.getSize()[1] - 1
        mine = base.changed(np.where(at_border, 0.0, change))
        comm = matrix.comm.tompi4py()
        self.changed = comm.allreduce(len(mine))
        if self.changed > most:
            return False
        start, _ = matrix.getOwnershipRange()
        rows = [int(r) for part in comm.allgather(mine + start) for r in part]
        self._W = [self._column(matrix, r) for r in rows]
        self._keep(rows)
        others = at_border & ~np.isin(base.rows, mine)
        bordered = bool(comm.allreduce(len(base.changed(np.where(others, change, 0.0)))))
        if bordered:
            self._W.append(self._border_column(matrix, base.rows[others], change[others]))
        self._V = _rows_of_change(matrix, base, change, mine, bordered=bordered)
        self._S = np.eye(len(self._W)) + self._products(self._W)
        regular = self._is_regular()
        if not regular:
            self._forget()
        return regular

    def _is_regular(self) -> bool:
        if not np.isfinite(self._S).all():
            return False
        values = np.linalg.svd(self._S, compute_uv=False)
        return bool(values.min(initial=1.0) > _SINGULAR * values.max(initial=1.0))

    def _column(self, like: PETSc.Mat, row: int) -> PETSc.Vec:
        """A_0^{-1} times the unit vector of a row."""
        if row not in self._columns:
            start, end = like.getOwnershipRange()
            here = [row - start] if start <= row < end else []
            self._columns[row] = self._solved(like, here, 1.0)
        return self._columns[row]

    def _keep(self, rows: Sequence[int]) -> None:
        """Free the columns of other rows if there are many."""
        if len(self._columns) > _MOST_COLUMNS:
            for row in set(self._columns) - set(rows):
                self._columns.pop(row).destroy()

    def _border_column(self, like: PETSc.Mat, rows: Indices, values: Array) -> PETSc.Vec:
        """A_0^{-1} c, of the entries of c on this rank."""
        self._border = self._solved(like, rows, values)
        return self._border

    def _solved(self, like: PETSc.Mat, rows: Any, values: Any) -> PETSc.Vec:
        """A_0^{-1} times the vector with these entries."""
        load, w = like.createVecs()
        load.array[rows] = values
        self._factor.solve(load, w)
        self.solves += 1
        load.destroy()
        return w

    def _products(self, vectors: list[PETSc.Vec]) -> Array:
        """V^T times vectors, on every rank (k, number of vectors)."""
        V = self._V
        assert V is not None
        out = V.createVecLeft()
        mine = np.empty((out.getLocalSize(), len(vectors)))
        for j, v in enumerate(vectors):
            V.mult(v, out)
            mine[:, j] = out.array_r
        out.destroy()
        return np.concatenate(V.comm.tompi4py().allgather(mine))

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with A_1, or with A_0 if there is no A_1; False if that fails."""
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
        for thing in (self._V, self._border):
            if thing is not None:
                thing.destroy()
        self._V = self._border = None
        self._W = []
        self._S = np.eye(0)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._forget()
        for w in self._columns.values():
            w.destroy()


def _rows_of_change(
    like: PETSc.Mat, entries: _Entries, change: Array, rows: Indices, *, bordered: bool
) -> PETSc.Mat:
    """V^T: the change of some rows of this rank and, on the last one, that of gamma's column."""
    chosen = np.isin(entries.rows, rows)
    ends = np.insert(np.searchsorted(entries.rows[chosen], rows, side="right"), 0, 0)
    columns = entries.columns[chosen]
    values = change[chosen]
    size = like.getSize()[1]
    if bordered and like.getOwnershipRange()[1] == size:
        ends = np.append(ends, ends[-1] + 1)
        columns = np.append(columns, size - 1)
        values = np.append(values, 1.0)
    csr = ends.astype(PETSc.IntType), columns.astype(PETSc.IntType), values
    sizes = (len(ends) - 1, None), (like.getLocalSize()[1], size)
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=like.comm)
