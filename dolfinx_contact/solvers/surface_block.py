# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The square block of the Jacobian on the contact nodes and all multipliers, factorised.

With the displacements c of the contact nodes and the multipliers l, the block reads

    K_cc u + B l = r_c,    C u + L l = r_l.

`SurfaceBlock` factorises it as it is. Nodal contact has a diagonal B, so that
l = B^-1 (r_c - K_cc u) is cheap, and `CondensedBlock` factorises the condensed system, which has
the size of the displacements:

    (C - L B^-1 K_cc) u = r_l - L B^-1 r_c

in the rows of dofs with a multiplier, K_cc u = r_c in the others. With T the 0-1 matrix that gives
a multiplier's row to its dof, W = B^-1 and E = I - T T^T - T L W this is
(T C + E K_cc) u = T r_l + E r_c.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx import la

from dolfinx_contact._arrays import Array, Indices
from dolfinx_contact._petsc import Factor
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.points.trace import facet_closures, owned_exterior
from dolfinx_contact.solvers.history import LinearSolverError
from dolfinx_contact.solvers.operator import ContactOperator

__all__ = ["CondensedBlock", "SurfaceBlock", "SurfaceSet"]

_ROOM = 50  # percent beyond what MUMPS expects to need
_STRUCTURE = PETSc.Mat.Structure


class SurfaceSet:
    """The unknowns s of a contact surface: dofs of its nodes, then all multipliers.

    Attributes:
        local: local indices of s.
        nodes: number of displacement dofs in s.
        answered: mask of the displacement dofs on the slave side, which may have a multiplier of
            their own.
        fixed: positions in s with Dirichlet data.
        of_all: index set of s in the numbering of all unknowns.
        of_body: index set of the displacement dofs of s in the numbering of the stiffness.
    """

    def __init__(self, operator: ContactOperator):
        eq = operator.equations
        self.comm = operator.comm
        dofs = _contact_dofs(eq)
        surfaces = _contact_dofs(eq, opposite=False)
        self.answered = np.isin(dofs, surfaces)
        rest = np.arange(operator.size, sum(eq.owned_sizes), dtype=np.int32)
        self.local = np.concatenate([dofs, rest])
        self.nodes = len(dofs)
        self.fixed = np.flatnonzero(np.isin(dofs, operator.fixed)).astype(np.int32)
        first = operator.first
        first_u = operator.stiffness.getOwnershipRange()[0]
        self.of_all = PETSc.IS().createGeneral(self.local + first, comm=self.comm)
        self.of_body = PETSc.IS().createGeneral(dofs + first_u, comm=self.comm)
        self.displacements = PETSc.IS().createGeneral(dofs + first, comm=self.comm)
        self.multipliers = PETSc.IS().createGeneral(rest + first, comm=self.comm)

    def release(self) -> None:
        """Free the index sets."""
        for thing in (self.of_all, self.of_body, self.displacements, self.multipliers):
            thing.destroy()


class _SurfaceFactor(Factor):
    """Direct solver for a matrix on the surface.

    Args:
        comm: communicator.
        prefix: prefix of PETSc options.
    """

    def __init__(self, comm: Any, prefix: str):
        super().__init__(comm, prefix, determinant=True, room=_ROOM)

    def factorise(self, A: PETSc.Mat) -> bool:
        """Factorise ``A``. Collective.

        Raises:
            LinearSolverError: if it is singular.
        """
        # The second attempt repeats the analysis.
        if not (super().factorise(A) or super().factorise(A)):
            raise LinearSolverError(
                "the contact block of the Jacobian is singular: contact conditions contradict one "
                "another or the Dirichlet data, or a contact node has no stiffness"
            )
        return True


class SurfaceBlock:
    """Direct solver of the assembled block on s, with displacements and multipliers.

    It supports any coupling. For a diagonal coupling, `CondensedBlock` solves a system of half the
    size.
    """

    def __init__(self, operator: ContactOperator, s: SurfaceSet, prefix: str):
        self._operator = operator
        self._s = s
        self._comm = operator.comm
        self.factor = _SurfaceFactor(operator.comm, prefix)
        self._K: PETSc.Mat | None = None
        self._S: PETSc.Mat | None = None
        self._block: PETSc.Mat | None = None
        self._b: PETSc.Vec | None = None
        self._contact = operator.contact

    def set_stiffness(self, square: PETSc.Mat) -> None:
        """Set the stiffness of the contact nodes, in the numbering of s. Collective."""
        indptr, columns, values = square.getValuesCSR()
        starts = np.asarray(square.getOwnershipRanges())
        n = len(self._s.local)
        sizes = np.asarray(self._comm.allgather(n))
        shift = np.concatenate([[0], np.cumsum(sizes)])[:-1] - starts[:-1]
        owner = np.searchsorted(starts, columns, side="right") - 1
        indptr = np.concatenate([indptr, np.full(n - self._s.nodes, indptr[-1])])
        csr = (indptr.astype(np.int32), (columns + shift[owner]).astype(np.int32), values)
        whole = PETSc.Mat().createAIJ(((n, None), (n, None)), csr=csr, comm=self._comm)
        self._K = _copied(whole, self._K)
        whole.destroy()

    def update(self) -> None:
        """Assemble the block of the current operator and factorise it. Collective."""
        assert self._K is not None
        A = self._operator
        s = self._s
        if A.contact is not self._contact:  # another pattern
            _free(self._S, self._block)
            self._S = self._block = None
            self._contact = A.contact
        self._S = A.contact.createSubMatrix(s.of_all, s.of_all, self._S)
        self._block = _combined(self._K, 1.0, self._S, self._block)
        rows = s.fixed + self._block.getOwnershipRange()[0]
        self._block.zeroRowsColumns(rows, diag=A.diagonal)
        if self._b is None:
            self._x, self._b = self._block.createVecs()
        # The pattern contains all pairs of facets that may touch; most entries are zero.
        present = _without_zeros(self._block)
        try:
            self.factor.factorise(present)
        finally:
            present.destroy()

    def solve(self, residual: Array) -> Array:
        """Return the unknowns on s for a residual on s, local parts. Collective."""
        assert self._b is not None
        self._b.array[:] = residual
        self.factor.solve(self._b, self._x)
        return self._x.array_r.copy()

    def release(self) -> None:
        """Free the PETSc objects."""
        self.factor.destroy()
        _free(self._K, self._S, self._block)


class CondensedBlock:
    """Direct solver of the block on s that condenses the multipliers.

    Args:
        operator: assembled Jacobian.
        s: unknowns of the surface.
        prefix: prefix of the PETSc options of the direct solver.
    """

    def __init__(self, operator: ContactOperator, s: SurfaceSet, prefix: str):
        self._operator = operator
        self._s = s
        self._comm = operator.comm
        self.factor = _SurfaceFactor(operator.comm, prefix)
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
        removed = np.concatenate(operator.equations.constraints.removed_multipliers)
        fits = bool(((answered.array_r == 1) | (self._alone & removed)).all())
        self.applies = self.applies and not self._comm.allreduce(int(not fits))
        # I - B W: without the rows of dependent dofs, and with their contributions to others.
        identity = PETSc.Mat().createAIJ(((n, None), (n, None)), nnz=(1, 0), comm=self._comm)
        identity.setUp()
        identity.setDiagonal(ones)
        identity.assemble()
        passed_on = B.matMult(self._W)
        self._plain = _combined(identity, -1.0, passed_on, None)
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
        """See `SurfaceBlock.set_stiffness`. Collective."""
        self._K = _copied(square, self._K)
        # Columns of Dirichlet dofs are zero; their rows are never used but as identities.
        rows = self._s.fixed + self._K.getOwnershipRange()[0]
        self._K.zeroRowsColumns(rows, diag=self._operator.diagonal)

    def update(self) -> None:
        """Condense and factorise the block of the current operator. Collective.

        Patterns never change: products, sums and the analysis of the LU are set up once.
        """
        A = self._operator
        s = self._s
        self._C = A.contact.createSubMatrix(s.multipliers, s.displacements, self._C)
        self._L = A.contact.createSubMatrix(s.multipliers, s.multipliers, self._L)
        self._LW = self._L.matMult(self._W, self._LW)
        self._TLW = self._T.matMult(self._LW, self._TLW)
        self._E = _combined(self._plain, -1.0, self._TLW, self._E)
        self._EK = self._E.matMult(self._K, self._EK)
        self._TC = self._T.matMult(self._C, self._TC)
        self._block = _combined(self._EK, 1.0, self._TC, self._block)
        # Dirichlet columns of C as well.
        rows = s.fixed + self._block.getOwnershipRange()[0]
        self._block.zeroRowsColumns(rows, diag=A.diagonal)
        self.factor.factorise(self._block)

    def solve(self, residual: Array) -> Array:
        """Return the unknowns on s for a residual on s, local parts. Collective."""
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
        _free(*mine, self._t, *made, self._block)


def _free(*made: PETSc.Object | None) -> None:
    for thing in made:
        if thing is not None:
            thing.destroy()


def _without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """Return ``A`` without stored zeros, which makes its factors sparser. Collective."""
    indptr, columns, values = A.getValuesCSR()
    kept = values != 0
    before = np.concatenate([[0], np.cumsum(kept)])
    csr = (before[indptr].astype(PETSc.IntType), columns[kept], values[kept])
    return PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=A.comm)


def _copied(A: PETSc.Mat, out: PETSc.Mat | None) -> PETSc.Mat:
    """Copy ``A`` with its pattern, into ``out`` if it exists. Collective."""
    if out is None:
        out = A.copy()
        out.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    else:
        A.copy(out, structure=_STRUCTURE.SAME_NONZERO_PATTERN)
    return out


def _combined(A: PETSc.Mat, a: float, B: PETSc.Mat, out: PETSc.Mat | None) -> PETSc.Mat:
    """Return A + a B, in ``out`` if it is an earlier sum of the same patterns. Collective."""
    if out is None:
        out = _copied(A, None)
        out.axpy(a, B, structure=_STRUCTURE.DIFFERENT_NONZERO_PATTERN)
        out.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return out
    out.zeroEntries()
    out.axpy(1.0, A, structure=_STRUCTURE.SUBSET_NONZERO_PATTERN)
    out.axpy(a, B, structure=_STRUCTURE.SUBSET_NONZERO_PATTERN)
    return out


def _contact_dofs(equations: ContactEquations, *, opposite: bool = True) -> Indices:
    """Return the owned displacement dofs of all contact facets, local indices. Collective.

    Args:
        equations: contact problem.
        opposite: whether to include the facets of masters.
    """
    V = equations.V
    marks = la.vector(V.dofmap.index_map, 1)
    marks.array[:] = 0.0
    for s in equations.surfaces:
        sides = [s.submesh.parent_facets]
        if opposite and s.obstacle.opposite is not None:
            sides.append(s.obstacle.opposite.master_facets)
        for side in sides:
            facets = owned_exterior(V.mesh, side)
            marks.array[facet_closures(V, facets).reshape(-1)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    nodes = np.flatnonzero(marks.array[: V.dofmap.index_map.size_local] > 0)
    bs = V.dofmap.index_map_bs
    return (bs * nodes[:, None] + np.arange(bs)).reshape(-1).astype(np.int32)
