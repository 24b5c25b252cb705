# SPDX-License-Identifier: LGPL-3.0-or-later
"""Direct solver for the bordered matrix, by default MUMPS.

The factorisation of a bordered matrix A_0 is reused for later bordered matrices A_1. If points
change their status, or the last row changes, A_1 differs from A_0 by D in a few rows, selected by
the unit vectors E. If the state changes, the last column also differs, by c outside these rows.
With U = (E, c), V^T = (D, e^T), the last unit vector e, and W = A_0^{-1} U,

    A_1^{-1} = A_0^{-1} - W S^{-1} V^T A_0^{-1},    det A_1 = det A_0 det S,    S = I + V^T W

(Sherman, Morrison and Woodbury; W. W. Hager, SIAM Rev. 31, 1989). Each column of W costs one solve
with A_0. The columns A_0^{-1} E are kept for later matrices. If there are many unknowns, A_0 is
also used for matrices that differ slightly in all rows. In both cases GMRES reduces the residual to
round-off. If it needs many iterations, or the matrix differs too much, the matrix is factorised.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._petsc import Factor
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.system import Piece

__all__ = ["BorderedMatrix", "Factorised"]

Indices = npt.NDArray[Any]

_LARGE = 2000  # unknowns above which a factorisation is reused for slightly different matrices
_FEW = 8  # largest number of changed rows for an update of a small system
_MORE = 48  # largest number of changed rows for an update of a large system
_MOST_COLUMNS = 100  # largest number of stored columns of W
_SAME_ROW = 1e-12  # relative change of a row that is ignored
_SINGULAR = 1e-13  # reciprocal condition number of S below which the update is rejected
_ROUND_OFF = 1e-13  # relative tolerance of GMRES
_MOST_ITERATIONS = 40  # largest number of GMRES iterations before the matrix is factorised
_WORN = 20  # number of GMRES iterations above which the next matrix is factorised


class BorderedMatrix:
    """Assembled matrix [A c; w^T s], A bordered by a column and a row. Methods are collective.

    Args:
        layout: layout of vectors (x, gamma).

    Attributes:
        matrix: bordered matrix in AIJ format, without entries before the first assembly.
    """

    def __init__(self, layout: Layout):
        self._layout = layout
        n, N, one = layout.local, layout.size, int(layout.last)
        sizes = ([n, N], [one, 1]), ([one, 1], [n, N]), ([one, 1], [one, 1])
        entries = (1, 1), (max(n, 1), N), (1, 0)
        self._blocks = [
            PETSc.Mat().createAIJ(size, nnz=nnz, comm=layout.comm)
            for size, nnz in zip(sizes, entries, strict=True)
        ]
        self._nest: PETSc.Mat | None = None
        self.matrix = PETSc.Mat()

    def assemble(self, A: PETSc.Mat, c: PETSc.Vec, row: PETSc.Vec) -> None:
        """Assemble the matrix from A (for x), the column c (for gamma) and the last row (w, s)."""
        layout = self._layout
        comm = layout.comm
        column, border, corner = self._blocks
        column.setValues(np.arange(*c.getOwnershipRange(), dtype=np.int32), [0], c.array_r)
        parts = comm.gather(row.array_r[: layout.local].copy(), root=comm.size - 1)
        if layout.last:
            border.setValues([0], np.arange(layout.size, dtype=np.int32), np.concatenate(parts))
            corner.setValue(0, 0, row.array_r[-1])
        for block in self._blocks:
            block.assemble()
        if self._nest is None:
            self._nest = PETSc.Mat().createNest([[A, column], [border, corner]], comm=comm)
        self._nest.assemble()
        self._nest.convert("aij", self.matrix)


class _RowUpdate:
    """Solver for a matrix A_1 differing in a few rows from a factorised A_0. Collective.

    Args:
        factor: factorisation of A_0.

    Attributes:
        solves: number of solves with A_0 for the low-rank update (columns of W).
        changed: number of rows in which the last matrix passed to `take` differs from A_0.
    """

    def __init__(self, factor: Factor):
        self._factor = factor
        self._base = np.zeros(0)  # entries of A_0 on this rank
        self._columns: dict[int, PETSc.Vec] = {}  # A_0^{-1} E by row
        self._V: PETSc.Mat | None = None
        self._W: list[PETSc.Vec] = []
        self._S = np.eye(0)
        self.solves = self.changed = 0

    def begin(self, matrix: PETSc.Mat) -> None:
        """Store ``matrix``, which has just been factorised, as the matrix to be updated."""
        self._base = matrix.getValuesCSR()[2]
        self._columns = {}
        self._forget()

    def take(self, matrix: PETSc.Mat, most: int) -> bool:
        """Prepare solves with a matrix that differs from the factorised matrix in a few rows.

        Return False if more than ``most`` rows differ or the update is nearly singular.
        """
        self._forget()
        # rows that differ outside the column of gamma
        ends, columns, values = matrix.getValuesCSR()
        row_of = np.repeat(np.arange(len(ends) - 1), np.diff(ends))
        change = values - self._base
        size = matrix.getSize()[1]
        at_border = columns == size - 1
        changed = self._changed_rows(row_of, change, ~at_border, len(ends) - 1)
        comm = matrix.comm.tompi4py()
        self.changed = comm.allreduce(len(changed))
        if self.changed > most:
            return False
        start, end = matrix.getOwnershipRange()
        rows = [int(r) for part in comm.allgather(changed + start) for r in part]
        # columns of W
        self._W = [self._column(matrix, r) for r in rows]
        if len(self._columns) > _MOST_COLUMNS:
            self._columns = {r: self._columns[r] for r in rows}
        others = at_border & ~np.isin(row_of, changed)
        # The column of gamma has its own unit and is therefore compared separately.
        in_column = self._changed_rows(row_of, change, others, len(ends) - 1)
        has_column = bool(comm.allreduce(len(in_column)))
        if has_column:
            self._W.append(self._solved(matrix, row_of[others], change[others]))
        # V^T: the changes D, and on the last rank the unit vector of gamma
        chosen = np.isin(row_of, changed)
        ends = np.insert(np.searchsorted(row_of[chosen], changed, side="right"), 0, 0)
        entries = change[chosen]
        columns = columns[chosen]
        if has_column and end == size:
            ends = np.append(ends, ends[-1] + 1)
            columns = np.append(columns, size - 1)
            entries = np.append(entries, 1.0)
        csr = ends.astype(PETSc.IntType), columns.astype(PETSc.IntType), entries
        shape = (len(ends) - 1, None), (end - start, size)
        self._V = PETSc.Mat().createAIJ(shape, csr=csr, comm=matrix.comm)
        self._S = np.eye(len(self._W)) + self._products(self._W)
        regular = bool(np.isfinite(self._S).all())
        if regular:
            singular = np.linalg.svd(self._S, compute_uv=False)
            regular = bool(singular.min(initial=1.0) > _SINGULAR * singular.max(initial=1.0))
        if not regular:
            self._forget()
        return regular

    def _changed_rows(self, row_of: Indices, change: Array, chosen: Mask, number: int) -> Indices:
        """Return the local rows in which chosen matrix entries have changed or are NaN."""
        sizes, changes = (
            np.bincount(row_of[chosen], weights=np.abs(v[chosen]), minlength=number)
            for v in (self._base, change)
        )
        return np.flatnonzero(~(changes <= _SAME_ROW * (sizes + changes)))

    def _column(self, like: PETSc.Mat, row: int) -> PETSc.Vec:
        """Return the solution with the factorised matrix for the unit vector of a row."""
        if row not in self._columns:
            start, end = like.getOwnershipRange()
            local = [row - start] if start <= row < end else []
            self._columns[row] = self._solved(like, local, 1.0)
        return self._columns[row]

    def _solved(self, like: PETSc.Mat, rows: Any, values: Any) -> PETSc.Vec:
        """Return the solution with the factorised matrix for the given right-hand side.

        Args:
            like: matrix with the required layout of vectors.
            rows: local rows of the nonzero entries of the right-hand side.
            values: nonzero entries.
        """
        load, w = like.createVecs()
        load.array[rows] = values
        self._factor.solve(load, w)
        self.solves += 1
        return w

    def _products(self, vectors: list[PETSc.Vec]) -> Array:
        """Return the products of the k rows V^T of the low-rank update with vectors, on every rank.

        The shape is (k, number of vectors).
        """
        V = self._V
        assert V is not None
        out = V.createVecLeft()
        local = np.empty((out.getLocalSize(), len(vectors)))
        for j, v in enumerate(vectors):
            V.mult(v, out)
            local[:, j] = out.array_r
        return np.concatenate(V.comm.tompi4py().allgather(local))

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with A_1 or, before an update, with A_0 (see the class); False if this fails."""
        solved = self._factor.solve(b, x)
        if solved and self._W:
            x.maxpy(-np.linalg.solve(self._S, self._products([x])[:, 0]), self._W)
        return solved

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Apply the preconditioner of GMRES; called by PETSc."""
        if not self.solve(b, x):
            pc.setFailedReason(PETSc.PC.FailedReason.OTHER)

    @property
    def determinant_sign(self) -> float:
        """Sign of the determinant of the updated matrix."""
        return self._factor.determinant_sign * float(np.sign(np.linalg.det(self._S)))

    def _forget(self) -> None:
        """Discard the low-rank update, so that solves use the factorised matrix itself."""
        self._V = None
        self._W = []
        self._S = np.eye(0)


class Factorised:
    """Solves with the bordered matrix J by a factorisation; see `Bordered.solver`.

    Args:
        layout: layout of vectors y = (x, gamma).
        prefix: prefix of PETSc options.
    """

    row: PETSc.Vec
    precision = 1e-12
    is_direct = True

    def __init__(self, layout: Layout, prefix: str):
        self._layout = layout
        self._is_large = layout.size >= _LARGE
        create = layout.system.create_vector
        self._c = create()
        self._bordered = BorderedMatrix(layout)
        self.factor = Factor(layout.comm, prefix, determinant=True)
        self.factor.ksp.getPC().setReusePreconditioner(True)
        self._update = _RowUpdate(self.factor)
        self._gmres = PETSc.KSP().create(layout.comm)
        self._gmres.setType(PETSc.KSP.Type.GMRES)
        self._gmres.setGMRESRestart(_MOST_ITERATIONS)
        self._gmres.setTolerances(rtol=_ROUND_OFF, max_it=_MOST_ITERATIONS)
        self._gmres.getPC().setType(PETSc.PC.Type.PYTHON)
        self._gmres.getPC().setPythonContext(self._update)
        self.factorisations = 0
        self._other_solves = 0
        #: Whether the factorisation belongs to `matrix`, and whether it may serve other matrices.
        self._is_current = self._serves = False
        #: Whether the low-rank update applies to `matrix`; None until it is tried.
        self._is_updated: bool | None = None
        #: State of `matrix`, state of the factorised matrix, and whether a change of state changes
        #: so many rows that the low-rank update is not tried.
        self._at, self._base_at = create(), create()
        self._changes_everywhere = False

    @property
    def matrix(self) -> PETSc.Mat:
        """Bordered matrix J, without entries before the first assembly."""
        return self._bordered.matrix

    @property
    def solves(self) -> int:
        """Number of solves with a factorisation."""
        return self._other_solves + self._update.solves

    def assemble(
        self, y: PETSc.Vec, row: PETSc.Vec, piece: Piece | None, *, along: PETSc.Vec | None = None
    ) -> None:
        """Assemble the bordered matrix with the last row ``row``; ``along`` is ignored."""
        system = self._layout.system
        x, gamma = self._layout.split(y)
        system.jacobian(x, gamma, piece)
        system.parameter_derivative(x, gamma, self._c, piece)
        self.row = row
        self._bordered.assemble(system.matrix, self._c, row)
        x.copy(self._at)
        self._is_current = False
        self._is_updated = None

    def prepare(self) -> bool:
        """Prepare for solves with the bordered matrix; return False if it is singular."""
        return self._is_current or self._has_few_changes() or self._factorise()

    def _factorise(self) -> bool:
        pc = self.factor.ksp.getPC()
        pc.setReusePreconditioner(False)
        self._is_current = self._serves = self.factor.factorise(self.matrix)
        pc.setReusePreconditioner(True)
        self.factorisations += 1
        if self._is_current:
            self._update.begin(self.matrix)
            self._at.copy(self._base_at)
        return self._is_current

    def _has_few_changes(self) -> bool:
        """Return True if solves can use a low-rank update of the last factorisation."""
        if self._is_updated is None:
            same_state = self._at.equal(self._base_at)
            tried = self._serves and (same_state or not self._changes_everywhere)
            most = _MORE if self._is_large else _FEW
            self._is_updated = tried and self._update.take(self.matrix, most)
            if tried and not same_state and self._update.changed > self._layout.size / 2:
                self._changes_everywhere = True
        return self._is_updated

    def solve(self, rhs: PETSc.Vec, out: PETSc.Vec, **_: Any) -> bool:
        """Solve with the bordered matrix; return False on failure. Other keywords are ignored."""
        if not self._is_current:
            reused = self._serves and (self._has_few_changes() or self._is_large)
            if reused and self._solve_by_gmres(rhs, out):
                return True
            if not self._factorise():
                return False
        self._other_solves += 1
        return self.factor.solve(rhs, out) and bool(np.isfinite(out.norm()))

    probe = solve

    def _solve_by_gmres(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        self._gmres.setOperators(self.matrix)
        self._gmres.solve(rhs, out)
        iterations = self._gmres.getIterationNumber()
        self._other_solves += iterations + 1
        self._serves = iterations <= _WORN
        return bool(self._gmres.getConvergedReason() > 0 and np.isfinite(out.norm()))

    def determinant_sign(self) -> float:
        """Return the sign of the bordered determinant up to a constant factor; 0 if it vanishes."""
        if not self._is_current and self._has_few_changes():
            return self._update.determinant_sign
        return self.factor.determinant_sign if self._is_current or self._factorise() else 0.0

    def destroy(self) -> None:
        """Free the factorisation."""
        self.factor.destroy()
