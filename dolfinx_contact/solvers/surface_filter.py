# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The surface filter: a multigrid cycle for the body, an exact solve for the contact surface.

With s all dofs of the contact nodes and all multipliers, one application to a residual r is

    z = E A_ss^-1 E^T r,   z += M (r - J z)_u,   z += E A_ss^-1 E^T (r - J z),

A_ss the block of the Jacobian on s, factorised by a sparse LU, and M a multigrid cycle of the
stiffness that knows nothing of the status (compare the AMG with filtering of Petrides, Hartland,
Kolev et al., arXiv:2505.18576). After it the residual vanishes on s: the multipliers are those of
the displacement, exactly, as if they had been condensed out of the system, and every later vector
of a Krylov method that starts from an application (``-ksp_initial_guess_knoll``) vanishes on s as
well, so that its first step is left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import la

from dolfinx_contact._petsc import logged, options_in_database
from dolfinx_contact.solvers.errors import LinearSolverError
from dolfinx_contact.solvers.operator import ContactOperator
from dolfinx_contact.trace import facet_closures, owned_exterior

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["SurfaceFilter", "contact_dofs"]

_DEFAULTS: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 50,
}

_NEGLIGIBLE = 1e-8  # share of a residual on the surface that needs no solve before the cycle


class SurfaceFilter:
    """Context of a PETSc PC of type python for a `ContactOperator`.

    Args:
        operator: the Jacobian.
        prefix: of PETSc options; those of the surface solve follow with ``surface_``.

    Attributes:
        cycle: approximate inverse of the stiffness, a PC on the displacement.
    """

    def __init__(self, operator: ContactOperator, prefix: str):
        self.operator, self.comm = operator, operator.comm
        self.cycle: PETSc.PC | None = None
        self._prefix = prefix + "surface_"
        n = operator.size
        nodes = contact_dofs(operator.problem)
        rest = np.arange(n, sum(operator.problem.owned_sizes), dtype=np.int32)
        self._local = np.concatenate([nodes, rest])  # s among the local unknowns
        first, first_u = operator._x.getOwnershipRange()[0], operator._xu.getOwnershipRange()[0]
        self._s = PETSc.IS().createGeneral(self._local + first, comm=self.comm)
        self._nodes = PETSc.IS().createGeneral(nodes + first_u, comm=self.comm)
        self._all = PETSc.IS().createStride(n, first_u, 1, comm=self.comm)
        self._n_nodes = len(nodes)
        self._fixed = np.flatnonzero(np.isin(nodes, operator.fixed)).astype(np.int32)
        self._Kss: PETSc.Mat | None = None
        self._Krows: PETSc.Mat | None = None
        self._Sss: PETSc.Mat | None = None
        self.block: PETSc.Mat | None = None
        self._assemblies = -1
        self.ksp = PETSc.KSP().create(self.comm)
        self.ksp.setOptionsPrefix(self._prefix)
        with options_in_database(self._prefix, _DEFAULTS):
            self.ksp.setFromOptions()
        self._t, self._e = (operator.problem.create_vector() for _ in range(2))
        self._tu, self._zu = (operator._xu.duplicate() for _ in range(2))
        self._rc: PETSc.Vec | None = None

    # -- set-up ----------------------------------------------------------------------------------

    def update(self) -> None:
        """Factorise the surface block of the operator as it is. Collective.

        Raises:
            LinearSolverError: if it is singular.
        """
        A = self.operator
        with logged("ContactSurfaceLU"):
            if self._assemblies != A.problem.bulk.assemblies:
                self._extract_stiffness()
            self._Sss = A.contact.createSubMatrix(self._s, self._s, self._Sss)
            assert self._Kss is not None
            if self.block is not None:
                self.block.destroy()
            self.block = self._Kss.copy()
            self.block.axpy(1.0, self._Sss, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            rows = self._fixed + self.block.getOwnershipRange()[0]
            self.block.zeroRowsColumns(rows, diag=A.diagonal)
            if self._rc is None:
                self._rc, self._zc = self.block.createVecs()
            self.ksp.setOperators(self.block)
            with options_in_database(self._prefix, _DEFAULTS):
                self.ksp.setUp()
        if self.ksp.getPC().getFailedReason() != PETSc.PC.FailedReason.NOERROR:
            self.ksp.reset()  # MUMPS does not recover from a singular matrix
            raise LinearSolverError(
                "the contact block of the Jacobian is singular: contact conditions contradict one "
                "another or the Dirichlet data, or a contact node has no stiffness"
            )

    def _extract_stiffness(self) -> None:
        """The rows of the contact nodes in K, and their square block in the numbering of s."""
        A = self.operator
        K = A.stiffness
        self._assemblies = A.problem.bulk.assemblies
        self._Krows = K.createSubMatrix(self._nodes, self._all, self._Krows)
        square = K.createSubMatrix(self._nodes, self._nodes)
        indptr, columns, values = square.getValuesCSR()
        starts = np.asarray(square.getOwnershipRanges())
        sizes = np.asarray(self.comm.allgather(len(self._local)))
        shift = np.concatenate([[0], np.cumsum(sizes)])[:-1] - starts[:-1]
        owner = np.searchsorted(starts, columns, side="right") - 1
        n = len(self._local)
        indptr = np.concatenate([indptr, np.full(n - self._n_nodes, indptr[-1])])
        csr = (indptr.astype(np.int32), (columns + shift[owner]).astype(np.int32), values)
        if self._Kss is not None:
            self._Kss.destroy()
        self._Kss = PETSc.Mat().createAIJ(((n, None), (n, None)), csr=csr, comm=self.comm)
        square.destroy()

    # -- application -----------------------------------------------------------------------------

    def apply(self, _pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Z = the filtered cycle of r."""
        A, n, s = self.operator, self.operator.size, self._local
        t = self._t
        r.copy(t)
        z.set(0.0)
        squares = np.array([np.sum(r.array_r[s] ** 2), np.sum(r.array_r**2)])
        on_surface, whole = self.comm.allreduce(squares)
        if on_surface > _NEGLIGIBLE**2 * whole:
            self._solve_surface(t.array_r[s], z)
            A.mult(A.matrix, z, self._e)
            t.axpy(-1.0, self._e)
        tu = self._tu.array
        tu[:] = t.array_r[:n]
        tu[A.fixed] = 0.0
        assert self.cycle is not None
        assert self._Krows is not None
        self.cycle.apply(self._tu, self._zu)
        zu = self._zu.array
        zu[A.fixed] = 0.0
        e = self._e.array
        e[:n], e[n:] = zu, 0.0
        z.array[:] += e
        z.array[A.fixed] += t.array_r[A.fixed] / A.diagonal
        # What the cycle did to the rows of the surface, without a product with all of K.
        rest = t.array_r[s].copy()
        A.contact.mult(self._e, t)
        rest -= t.array_r[s]
        Kz = self._Krows.createVecLeft()
        self._Krows.mult(self._zu, Kz)
        rest[: self._n_nodes] -= Kz.array_r
        Kz.destroy()
        rest[self._fixed] = 0.0
        self._solve_surface(rest, z)

    def _solve_surface(self, residual: npt.NDArray[np.float64], z: PETSc.Vec) -> None:
        """Add the exact solution on s for ``residual`` there to ``z``."""
        assert self._rc is not None
        self._rc.array[:] = residual
        with logged("ContactSurface"):
            self.ksp.solve(self._rc, self._zc)
        z.array[self._local] += self._zc.array_r

    def release(self) -> None:
        """Free the PETSc objects."""
        mine = (self.ksp, self._s, self._nodes, self._all, self._t, self._e, self._tu, self._zu)
        made = (self._Kss, self._Krows, self._Sss, self.block)
        for thing in (*mine, *(m for m in made if m is not None)):
            thing.destroy()


def contact_dofs(problem: ContactProblem) -> npt.NDArray[np.int32]:
    """Owned displacement dofs of the nodes of all contact facets, local indices. Collective."""
    V = problem.V
    marks = la.vector(V.dofmap.index_map, 1)
    marks.array[:] = 0.0
    for s in problem.surfaces:
        facets = owned_exterior(V.mesh, s.submesh.parent_facets)
        marks.array[facet_closures(V, facets).reshape(-1)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    nodes = np.flatnonzero(marks.array[: V.dofmap.index_map.size_local] > 0)
    bs = V.dofmap.index_map_bs
    return (bs * nodes[:, None] + np.arange(bs)).reshape(-1).astype(np.int32)
