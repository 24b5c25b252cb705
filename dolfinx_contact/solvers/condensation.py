# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Static condensation of multipliers that each answer one displacement dof.

On the contact nodes, with c their displacements and l the multipliers, the Jacobian reads

    K_cc u + B l = r_c,    C u + L l = r_l.

Nodal contact has a diagonal B, so that l = B^-1 (r_c - K_cc u) is cheap. The condensed system has
the size of the displacements:

    (C - L B^-1 K_cc) u = r_l - L B^-1 r_c

in the rows of dofs with a multiplier, K_cc u = r_c in the others. With T the 0-1 matrix that gives
a multiplier's row to its dof, W = B^-1 and E = I - T T^T - T L W this is
(T C + E K_cc) u = T r_l + E r_c.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.solvers.operator import ContactOperator
from dolfinx_contact.solvers.surface_block import SurfaceFactor, SurfaceSet, combined, copied

__all__ = ["CondensedBlock"]


class CondensedBlock:
    """Solves with the block on s by condensing the multipliers; see `SurfaceBlock`.

    Args:
        operator: assembled Jacobian.
        s: unknowns of the surface.
        prefix: prefix of the PETSc options of the direct solver.
    """

    def __init__(self, operator: ContactOperator, s: SurfaceSet, prefix: str):
        self._operator = operator
        self._s = s
        self._comm = operator.comm
        self.factor = SurfaceFactor(operator.comm, prefix)
        B = operator.contact.createSubMatrix(s.displacements, s.multipliers)
        indptr, columns, values = B.getValuesCSR()
        rows = np.repeat(np.arange(s.nodes), np.diff(indptr))
        kept = (values != 0) & s.answered[rows] & ~np.isin(rows, s.fixed)
        rows = rows[kept]
        columns = columns[kept]
        values = values[kept]
        n = s.nodes
        m = len(s.local) - s.nodes
        #: Whether every multiplier has one dof, or was removed.
        self.applies = not self._comm.allreduce(int(len(np.unique(rows)) < len(rows)))
        if not self.applies:
            rows = rows[:0]
            columns = columns[:0]
            values = values[:0]
        starts = np.searchsorted(rows, np.arange(n + 1)).astype(np.int32)
        self._T, inverse = (
            PETSc.Mat().createAIJ(((n, None), (m, None)), csr=(starts, columns, v), comm=self._comm)
            for v in (np.ones(len(rows)), 1.0 / values)
        )
        self._W = inverse.transpose(PETSc.Mat())
        answered = self._T.createVecRight()
        ones = self._T.createVecLeft()
        ones.set(1.0)
        self._T.multTranspose(ones, answered)
        self._alone = answered.array_r == 0  # multipliers without a dof
        removed = np.concatenate(operator.equations.constraints.removed_multipliers())
        fits = bool(((answered.array_r == 1) | (self._alone & removed)).all())
        self.applies = self.applies and not self._comm.allreduce(int(not fits))
        # I - B W: without the rows of dependent dofs, and with their contributions to others.
        identity = PETSc.Mat().createAIJ(((n, None), (n, None)), nnz=(1, 0), comm=self._comm)
        identity.setUp()
        identity.setDiagonal(ones)
        identity.assemble()
        passed_on = B.matMult(self._W)
        self._plain = combined(identity, -1.0, passed_on, None)
        self._rc, self._x = self._plain.createVecs()
        self._rl = answered
        self._y = answered.duplicate()
        self._b, self._t = self._rc.duplicate(), self._rc.duplicate()
        self._K: PETSc.Mat | None = None
        self._C: PETSc.Mat | None = None
        self._L: PETSc.Mat | None = None
        self._LW: PETSc.Mat | None = None
        self._TLW: PETSc.Mat | None = None
        self._TC: PETSc.Mat | None = None
        self._EK: PETSc.Mat | None = None
        self._E: PETSc.Mat | None = None
        self._block: PETSc.Mat | None = None
        for thing in (B, inverse, ones, identity, passed_on):
            thing.destroy()

    def set_stiffness(self, square: PETSc.Mat) -> None:
        """Take the stiffness among the contact nodes. Collective."""
        self._K = copied(square, self._K)
        # Columns of Dirichlet dofs are zero; their rows are never used but as identities.
        rows = self._s.fixed + self._K.getOwnershipRange()[0]
        self._K.zeroRowsColumns(rows, diag=self._operator.diagonal)

    def update(self) -> None:
        """Condense and factorise anew. Collective.

        Patterns never change: products, sums and the analysis of the LU are set up once.
        """
        A = self._operator
        s = self._s
        self._C = A.contact.createSubMatrix(s.multipliers, s.displacements, self._C)
        self._L = A.contact.createSubMatrix(s.multipliers, s.multipliers, self._L)
        self._LW = self._L.matMult(self._W, self._LW)
        self._TLW = self._T.matMult(self._LW, self._TLW)
        self._E = combined(self._plain, -1.0, self._TLW, self._E)
        self._EK = self._E.matMult(self._K, self._EK)
        self._TC = self._T.matMult(self._C, self._TC)
        self._block = combined(self._EK, 1.0, self._TC, self._block)
        # Dirichlet columns of C as well.
        rows = s.fixed + self._block.getOwnershipRange()[0]
        self._block.zeroRowsColumns(rows, diag=A.diagonal)
        self.factor.factorise(self._block)

    def solve(self, residual: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Solve the equations of the contact nodes with all other unknowns fixed. Collective.

        Args:
            residual: local residual at the contact nodes: displacement rows, then multiplier rows.

        Returns:
            Local solution in the same order.
        """
        n = self._s.nodes
        assert self._K is not None
        assert self._E is not None
        self._rc.array[:] = residual[:n]
        self._rl.array[:] = residual[n:]
        self._E.mult(self._rc, self._b)
        self._T.multAdd(self._rl, self._b, self._b)
        self.factor.solve(self._b, self._x)
        self._K.mult(self._x, self._t)
        self._t.aypx(-1.0, self._rc)
        self._W.mult(self._t, self._y)
        multipliers = self._y.array_r.copy()
        multipliers[self._alone] = residual[n:][self._alone] / self._operator.diagonal
        return np.concatenate([self._x.array_r, multipliers])

    def release(self) -> None:
        """Free the PETSc objects."""
        self.factor.destroy()
        made = (self._K, self._C, self._L, self._LW, self._TLW, self._TC, self._EK, self._E)
        mine = (self._T, self._W, self._plain, self._rc, self._x, self._rl, self._y, self._b)
        for thing in (*mine, self._t, *(m for m in (*made, self._block) if m is not None)):
            thing.destroy()
