# SPDX-License-Identifier: LGPL-3.0-or-later
"""Direct solver for the bordered matrix, by default MUMPS.

A factorisation is reused for later matrices that differ in a few rows, namely the rows of points
that change their status and the border row; a low-rank update (`row_update`) accounts for them. If
there are many unknowns, it is also reused for matrices that differ slightly everywhere. GMRES then
reduces the residual to round-off in one or a few iterations. If it needs many iterations, or the
matrix differs too much, the matrix is factorised again.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import Factor
from dolfinx_contact.continuation.layout import BorderedSolver, Enough, Layout
from dolfinx_contact.continuation.row_update import RowUpdate
from dolfinx_contact.continuation.system import Piece

__all__ = ["Factorised"]

_LARGE = 2000  # unknowns above which a factorisation is reused for slightly different matrices
_FEW = 8  # largest number of changed rows for reuse in a small system
_MORE = 48  # largest number of changed rows for reuse in a large system
_ROUND_OFF = 1e-13  # relative tolerance of GMRES
_MOST_ITERATIONS = 40  # largest number of GMRES iterations before the matrix is factorised
_WORN = 20  # number of GMRES iterations above which the next matrix is factorised


class _Updated:
    """The updated factorisation as a preconditioner for PETSc."""

    def __init__(self, update: RowUpdate):
        self._update = update

    def apply(self, pc: PETSc.PC, rhs: PETSc.Vec, out: PETSc.Vec) -> None:
        if not self._update.solve(rhs, out):
            pc.setFailedReason(PETSc.PC.FailedReason.OTHER)


class Factorised(BorderedSolver):
    """Solves with J by a factorisation.

    Args:
        layout: layout of vectors y.
        prefix: prefix of PETSc options.
        reuse: whether a factorisation is reused for later matrices; default: for matrices that
            differ in a few rows, and, if there are many unknowns, for all.
    """

    precision = 1e-12
    many_sides = True
    corrects = False

    def __init__(self, layout: Layout, prefix: str, *, reuse: bool | None = None):
        super().__init__(layout, prefix)
        self.reuse = reuse
        self._is_large = layout.size >= _LARGE
        self._c = self.system.create_vector()
        one = int(layout.last)
        n = layout.local
        N = layout.size
        comm = self.comm
        self._column = PETSc.Mat().createAIJ([[n, N], [one, 1]], nnz=(1, 1), comm=comm)
        self._row = PETSc.Mat().createAIJ([[one, 1], [n, N]], nnz=(max(n, 1), N), comm=comm)
        self._corner = PETSc.Mat().createAIJ([[one, 1], [one, 1]], nnz=(1, 0), comm=comm)
        self._nest: PETSc.Mat | None = None
        self.matrix = PETSc.Mat()
        self.factor = Factor(comm, prefix, determinant=True)
        self.defaults = self.factor.defaults
        self._pc = self.factor.ksp.getPC()
        self._pc.setReusePreconditioner(True)
        self._krylov = PETSc.KSP().create(comm)
        self._krylov.setType(PETSc.KSP.Type.GMRES)
        self._update = RowUpdate(self.factor)
        inverse = self._krylov.getPC()
        inverse.setType(PETSc.PC.Type.PYTHON)
        inverse.setPythonContext(_Updated(self._update))
        self._krylov.setGMRESRestart(_MOST_ITERATIONS)
        self._krylov.setTolerances(rtol=_ROUND_OFF, max_it=_MOST_ITERATIONS)
        #: Whether a factorisation exists, whether it belongs to `matrix`, and whether the last
        #: GMRES solve needed many iterations.
        self._factorised = self._current = self._worn = False
        #: Whether the low-rank update applies to `matrix`; None until it is tried.
        self._updated: bool | None = None
        #: State of `matrix`, state of the factorised matrix, and whether a change of state changes
        #: so many rows that the low-rank update is not tried.
        self._at, self._base_at = (self.system.create_vector() for _ in range(2))
        self._changes_everywhere = False

    def assemble(
        self, y: PETSc.Vec, row: PETSc.Vec, piece: Piece | None, *, along: PETSc.Vec | None = None
    ) -> None:
        layout, x, gamma = self.layout, *self.layout.split(y)
        self.system.jacobian(x, gamma, piece)
        self.system.parameter_derivative(x, gamma, self._c, piece)
        start = self._c.getOwnershipRange()[0]
        rows = np.arange(start, start + layout.local, dtype=np.int32)
        self._column.setValues(rows, [0], self._c.array_r)
        parts = self.comm.gather(row.array_r[: layout.local].copy(), root=self.comm.size - 1)
        if layout.last:
            columns = np.arange(layout.size, dtype=np.int32)
            self._row.setValues([0], columns, np.concatenate(parts))
            self._corner.setValue(0, 0, row.array_r[-1])
        for block in (self._column, self._row, self._corner):
            block.assemble()
        if self._nest is None:
            blocks = [[self.system.matrix, self._column], [self._row, self._corner]]
            self._nest = PETSc.Mat().createNest(blocks, comm=self.comm)
        self._nest.assemble()
        self._nest.convert("aij", self.matrix)
        x.copy(self._at)
        self._current = False
        self._updated = None

    def factorise(self) -> bool:
        return self._current or self._has_few_changes() or self._factorise()

    def _factorise(self) -> bool:
        self._pc.setReusePreconditioner(False)
        ok = self.factor.factorise(self.matrix)
        self._pc.setReusePreconditioner(True)
        self.factorisations += 1
        self._factorised = self._current = ok
        self._worn = False
        if ok and self.reuse is not False:
            self._update.begin(self.matrix)
            self._at.copy(self._base_at)
        return ok

    def _has_few_changes(self) -> bool:
        """Return True if the low-rank update of the factorisation applies to the matrix."""
        if self._updated is None:
            self._updated = (
                self._factorised
                and not self._worn
                and self.reuse is not False
                and (not self._changes_everywhere or self._at.equal(self._base_at))
                and self._take()
            )
        return self._updated

    def _take(self) -> bool:
        before = self._update.solves
        taken = self._update.take(self.matrix, _MORE if self._is_large else _FEW)
        self.solves += self._update.solves - before
        if self._update.changed > self.layout.size / 2 and not self._at.equal(self._base_at):
            self._changes_everywhere = True
        return taken

    def solve(
        self,
        rhs: PETSc.Vec,
        out: PETSc.Vec,
        *,
        rtol: float = 0.0,
        near: PETSc.Vec | None = None,
        enough: Enough | None = None,
    ) -> bool:
        if not self._current:
            a_little = self._is_large if self.reuse is None else self.reuse
            again = self._factorised and not self._worn
            again = again and (self._has_few_changes() or a_little)
            if again and self._solve_by_krylov(rhs, out):
                return True
            if not self._factorise():
                return False
        solved = self.factor.solve(rhs, out)
        self.solves += 1
        return solved and bool(np.isfinite(out.norm()))

    def probe(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        return self.solve(rhs, out)

    def _solve_by_krylov(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        self._krylov.setOperators(self.matrix)
        self._krylov.solve(rhs, out)
        iterations = self._krylov.getIterationNumber()
        self.solves += iterations + 1
        self._worn = iterations > _WORN
        return bool(self._krylov.getConvergedReason() > 0 and np.isfinite(out.norm()))

    def determinant_sign(self) -> float:
        if not self._current and self._has_few_changes():
            return self._update.determinant_sign
        if not self._current and not self._factorise():
            return 0.0
        return self.factor.determinant_sign

    def destroy(self) -> None:
        matrices = (self.matrix, self._column, self._row, self._corner)
        vectors = (self._c, self._at, self._base_at)
        for item in (self._krylov, self._update, self.factor, *matrices, *vectors):
            item.destroy()
        if self._nest is not None:
            self._nest.destroy()
