# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Low-rank update of a factorisation, for a matrix with a few changed rows and last column.

If points change their status, or the border row changes, A_1 = A_0 + E D with the changes D of the
rows E. If the state changes as well, the column of gamma changes by c outside of these rows. With
U = (E, c), V^T = (D, e^T), the unit vector e of gamma, and W = A_0^{-1} U,

    A_1^{-1} = A_0^{-1} - W (I + V^T W)^{-1} V^T A_0^{-1},    det A_1 = det A_0 det(I + V^T W)

(Sherman, Morrison and Woodbury; W. W. Hager, SIAM Rev. 31, 1989). Each column of W costs one solve
with A_0. The columns A_0^{-1} E are kept and reused for later matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._petsc import Factor

__all__ = ["RowUpdate"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[Any]

_ROUND_OFF = 1e-12  # relative change of a row that is ignored
_MOST_COLUMNS = 100  # largest number of stored columns of W
_SINGULAR = 1e-13  # reciprocal condition number of I + V^T W below which the update is rejected


@dataclass(frozen=True)
class _Entries:
    """Matrix entries of this rank in coordinate format.

    Attributes:
        number: number of local rows.
        rows: local row of each entry.
        columns: global column of each entry.
        values: values.
    """

    number: int
    rows: Indices
    columns: Indices
    values: Array

    @classmethod
    def of(cls, A: PETSc.Mat) -> _Entries:
        """Copy the entries of a matrix."""
        ends, columns, values = A.getValuesCSR()
        number = len(ends) - 1
        return cls(number, np.repeat(np.arange(number), np.diff(ends)), columns, values)

    def changed(self, change: Array) -> Indices:
        """Return the local rows in which ``change`` is more than round-off, or NaN."""
        size, size_of_change = (
            np.bincount(self.rows, weights=np.abs(v), minlength=self.number)
            for v in (self.values, change)
        )
        return np.flatnonzero(~(size_of_change <= _ROUND_OFF * (size + size_of_change)))


class RowUpdate:
    """Solver for A_1 that uses the factorisation of A_0. All methods are collective.

    Args:
        factor: factorisation of A_0.

    Attributes:
        solves: number of solves with A_0 for columns of W.
        changed: number of rows in which the last matrix passed to `take` differs from A_0.
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
        """Use ``matrix``, which has just been factorised, as A_0."""
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
        changed = base.changed(np.where(at_border, 0.0, change))
        comm = matrix.comm.tompi4py()
        self.changed = comm.allreduce(len(changed))
        if self.changed > most:
            return False
        start, _ = matrix.getOwnershipRange()
        rows = [int(r) for part in comm.allgather(changed + start) for r in part]
        self._W = [self._column(matrix, r) for r in rows]
        self._keep(rows)
        # change of the column of gamma in the other rows
        others = at_border & ~np.isin(base.rows, changed)
        bordered = bool(comm.allreduce(len(base.changed(np.where(others, change, 0.0)))))
        if bordered:
            self._W.append(self._border_column(matrix, base.rows[others], change[others]))
        self._V = _rows_of_change(matrix, base, change, changed, bordered=bordered)
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
        """Return A_0^{-1} times the unit vector of a row."""
        if row not in self._columns:
            start, end = like.getOwnershipRange()
            local = [row - start] if start <= row < end else []
            self._columns[row] = self._solved(like, local, 1.0)
        return self._columns[row]

    def _keep(self, rows: Sequence[int]) -> None:
        """Free the columns of other rows if there are many."""
        if len(self._columns) > _MOST_COLUMNS:
            for row in set(self._columns) - set(rows):
                self._columns.pop(row).destroy()

    def _border_column(self, like: PETSc.Mat, rows: Indices, values: Array) -> PETSc.Vec:
        """Return A_0^{-1} c, given the entries of c on this rank."""
        self._border = self._solved(like, rows, values)
        return self._border

    def _solved(self, like: PETSc.Mat, rows: Any, values: Any) -> PETSc.Vec:
        """Return A_0^{-1} times the vector with these local entries."""
        load, w = like.createVecs()
        load.array[rows] = values
        self._factor.solve(load, w)
        self.solves += 1
        load.destroy()
        return w

    def _products(self, vectors: list[PETSc.Vec]) -> Array:
        """Return V^T times the vectors, shape (k, number of vectors), on every rank."""
        V = self._V
        assert V is not None
        out = V.createVecLeft()
        local = np.empty((out.getLocalSize(), len(vectors)))
        for j, v in enumerate(vectors):
            V.mult(v, out)
            local[:, j] = out.array_r
        out.destroy()
        return np.concatenate(V.comm.tompi4py().allgather(local))

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
        for item in (self._V, self._border):
            if item is not None:
                item.destroy()
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
    """Create V^T: changes of the local ``rows``, and the unit vector of gamma on the last rank."""
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
