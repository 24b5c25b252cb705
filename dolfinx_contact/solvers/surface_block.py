# SPDX-License-Identifier: LGPL-3.0-or-later
"""The square block of the Jacobian on the contact nodes and all multipliers, factorised."""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import la

from dolfinx_contact._petsc import Factor
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.points.trace import facet_closures, owned_exterior
from dolfinx_contact.solvers.history import LinearSolverError
from dolfinx_contact.solvers.operator import ContactOperator

__all__ = [
    "SurfaceBlock",
    "SurfaceFactor",
    "SurfaceSet",
    "combined",
    "contact_dofs",
    "copied",
    "without_zeros",
]

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
        dofs = contact_dofs(eq)
        surfaces = contact_dofs(eq, opposite=False)
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


class SurfaceFactor(Factor):
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

    It supports any coupling. For a diagonal coupling, `condensation.CondensedBlock` solves a system
    of half the size.
    """

    def __init__(self, operator: ContactOperator, s: SurfaceSet, prefix: str):
        self._operator = operator
        self._s = s
        self._comm = operator.comm
        self.factor = SurfaceFactor(operator.comm, prefix)
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
        self._K = copied(whole, self._K)
        whole.destroy()

    def update(self) -> None:
        """Assemble the block of the current operator and factorise it. Collective."""
        assert self._K is not None
        A = self._operator
        s = self._s
        if A.contact is not self._contact:  # another pattern
            self._free(self._S, self._block)
            self._S = self._block = None
            self._contact = A.contact
        self._S = A.contact.createSubMatrix(s.of_all, s.of_all, self._S)
        self._block = combined(self._K, 1.0, self._S, self._block)
        rows = s.fixed + self._block.getOwnershipRange()[0]
        self._block.zeroRowsColumns(rows, diag=A.diagonal)
        if self._b is None:
            self._x, self._b = self._block.createVecs()
        # The pattern contains all pairs of facets that may touch; most entries are zero.
        present = without_zeros(self._block)
        try:
            self.factor.factorise(present)
        finally:
            present.destroy()

    def solve(self, residual: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the unknowns on s for a residual on s, local parts. Collective."""
        assert self._b is not None
        self._b.array[:] = residual
        self.factor.solve(self._b, self._x)
        return self._x.array_r.copy()

    def release(self) -> None:
        """Free the PETSc objects."""
        self.factor.destroy()
        self._free(self._K, self._S, self._block)

    @staticmethod
    def _free(*made: PETSc.Mat | None) -> None:
        for thing in made:
            if thing is not None:
                thing.destroy()


def without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """Return ``A`` without stored zeros, which makes its factors sparser. Collective."""
    indptr, columns, values = A.getValuesCSR()
    kept = values != 0
    before = np.concatenate([[0], np.cumsum(kept)])
    csr = (before[indptr].astype(PETSc.IntType), columns[kept], values[kept])
    return PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=A.comm)


def copied(A: PETSc.Mat, out: PETSc.Mat | None) -> PETSc.Mat:
    """Copy ``A`` with its pattern, into ``out`` if it exists. Collective."""
    if out is None:
        out = A.copy()
        out.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    else:
        A.copy(out, structure=_STRUCTURE.SAME_NONZERO_PATTERN)
    return out


def combined(A: PETSc.Mat, a: float, B: PETSc.Mat, out: PETSc.Mat | None) -> PETSc.Mat:
    """Return A + a B, in ``out`` if it is an earlier sum of the same patterns. Collective."""
    if out is None:
        out = copied(A, None)
        out.axpy(a, B, structure=_STRUCTURE.DIFFERENT_NONZERO_PATTERN)
        out.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return out
    out.zeroEntries()
    out.axpy(1.0, A, structure=_STRUCTURE.SUBSET_NONZERO_PATTERN)
    out.axpy(a, B, structure=_STRUCTURE.SUBSET_NONZERO_PATTERN)
    return out


def contact_dofs(equations: ContactEquations, *, opposite: bool = True) -> npt.NDArray[np.int32]:
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
