# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sparse factorisations, by MUMPS or according to PETSc options.

The KSP in the SNES of Newton's method and the spectral transformation of SLEPc use the same
`DEFAULTS`.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import options_in_database

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix as Columns

__all__ = ["BATCH", "DEFAULTS", "Factor", "is_symmetric", "marked_symmetric"]

#: Options without entries in the database; ICNTL(14) is additional workspace in percent.
DEFAULTS: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 80,
}
BATCH = 128  # right-hand sides that are solved together
_TRIES = 4  # attempts at a factorisation, each with twice the workspace
#: INFOG(1) of MUMPS if workspace or buffers are too small (users' guide, section 8).
_NO_ROOM = (-8, -9, -14, -15, -17, -20)
_SYMMETRIC = 1e-12  # relative difference to the transpose that counts as round-off


class Factor:
    """Factorisations of several matrices, one after the other. Collective, as its methods are.

    Args:
        comm: communicator.
        prefix: prefix of PETSc options.
        symmetric: whether the matrices are marked symmetric (`marked_symmetric`), which halves the
            work and provides the number of negative eigenvalues; default: False.
        determinant: whether the sign of the determinant is required; default: False.
        counted: whether vanishing pivots are counted, for singular matrices; default: False.
        columns: whether many right-hand sides are solved together; default: False.
        room: additional workspace of MUMPS in percent of its estimate.

    Attributes:
        ksp: linear solver.
        defaults: options without entries in the database.
    """

    def __init__(
        self,
        comm: Any,
        prefix: str,
        *,
        symmetric: bool = False,
        determinant: bool = False,
        counted: bool = False,
        columns: bool = False,
        room: int = DEFAULTS["mat_mumps_icntl_14"],
    ):
        self._prefix = prefix
        self.defaults = DEFAULTS | {"mat_mumps_icntl_14": room}
        if symmetric:
            self.defaults["pc_type"] = "cholesky"
        if counted:
            self.defaults["mat_mumps_icntl_24"] = 1
        if columns:
            self.defaults["mat_mumps_icntl_27"] = BATCH
        if determinant:
            self.defaults["mat_mumps_icntl_33"] = 1
        self.ksp = PETSc.KSP().create(comm)
        self.ksp.setOptionsPrefix(prefix)
        with self.options():
            self.ksp.setFromOptions()

    def options(self) -> AbstractContextManager[None]:
        """Context with the options in the database; MUMPS reads its options at every set-up."""
        return options_in_database(self._prefix, self.defaults)

    def factorise(self, A: PETSc.Mat) -> bool:
        """Factorise ``A``; return False for a singular matrix or entries that are not finite.

        MUMPS does not always survive entries that are not finite.
        """
        if not np.isfinite(A.norm(PETSc.NormType.FROBENIUS)):
            return False
        self.ksp.setOperators(A)
        for _ in range(_TRIES):
            with self.options():
                self.ksp.setUp()
            if self.ksp.getPC().getFailedReason() == PETSc.PC.FailedReason.NOERROR:
                return True
            lacking = self._lacks_room()
            self.ksp.reset()  # MUMPS does not recover from a singular matrix
            if not lacking:
                return False
            self.defaults["mat_mumps_icntl_14"] *= 2
            self.ksp.setOperators(A)
        return False

    def _lacks_room(self) -> bool:
        """Return whether MUMPS ran out of workspace that may be enlarged. Collective."""
        if PETSc.Options().hasName(self._prefix + "mat_mumps_icntl_14"):
            return False
        pc = self.ksp.getPC()
        if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
            return False
        return pc.getFactorMatrix().getMumpsInfog(1) in _NO_ROOM

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b and return whether this succeeded."""
        self.ksp.solve(b, x)
        return bool(self.ksp.getConvergedReason() > 0)

    def solve_transposed(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A^T x = b and return whether this succeeded."""
        self.ksp.solveTranspose(b, x)
        return bool(self.ksp.getConvergedReason() > 0)

    def solve_columns(self, loads: Columns) -> PETSc.Mat:
        """Solve A X = B and return X, dense, which the caller destroys.

        Args:
            loads: owned rows of B, shape (n, k).
        """
        pc = self.ksp.getPC()
        factor = pc.getFactorMatrix()
        n, k = loads.shape
        comm = factor.comm
        X = PETSc.Mat().createDense(((n, None), (None, k)), comm=comm)
        X.setUp()
        X.assemble()
        # On one rank MUMPS exploits the zeros of a sparse right-hand side.
        if comm.size == 1 and pc.getFactorSolverType() == "mumps":
            index = PETSc.IntType
            csr = loads.indptr.astype(index), loads.indices.astype(index), loads.data
            rows = PETSc.Mat().createAIJ((k, n), csr=csr, comm=comm)
            B = PETSc.Mat().createTranspose(rows)
            rows.destroy()
        else:
            B = PETSc.Mat().createDense(((n, None), (None, k)), comm=comm)
            B.setUp()
            B.getDenseArray()[:] = np.asarray(loads.todense())
            B.assemble()
        factor.matSolve(B, X)
        B.destroy()
        return X

    @property
    def determinant_sign(self) -> float:
        """Sign of the determinant, from MUMPS."""
        return float(np.sign(self.ksp.getPC().getFactorMatrix().getMumpsRinfog(12)))

    @property
    def inertia(self) -> tuple[int, int, int]:
        """Numbers of negative, zero and positive eigenvalues of a symmetric matrix."""
        negative, zero, positive = self.ksp.getPC().getFactorMatrix().getInertia()
        return int(negative), int(zero), int(positive)

    @property
    def is_symmetric(self) -> bool:
        """Whether the factorisation is one of a symmetric matrix."""
        return bool(self.ksp.getPC().getType() == "cholesky")

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.ksp.destroy()


def is_symmetric(A: PETSc.Mat) -> bool:
    """Return whether a matrix is symmetric up to round-off. Collective.

    PETSc's test considers the rows of each rank alone, and fails if a rank has few rows.
    """
    size = A.norm(PETSc.NormType.NORM_INFINITY)
    off = A.transpose(PETSc.Mat())
    off.axpy(-1.0, A, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    largest = off.norm(PETSc.NormType.NORM_INFINITY)
    off.destroy()
    return bool(largest <= _SYMMETRIC * size)


def marked_symmetric(A: PETSc.Mat) -> bool:
    """Mark a matrix as symmetric if it is; return whether it is. Collective."""
    symmetric = is_symmetric(A)
    if symmetric:
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return symmetric
