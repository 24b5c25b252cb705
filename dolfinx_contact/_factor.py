# SPDX-License-Identifier: LGPL-3.0-or-later
"""One set-up of sparse factorisations, of whatever matrix: by MUMPS, or by PETSc's options.

Two others are set up by what owns them, with the same `DEFAULTS`: that of the KSP in the SNES of
Newton's method, and that of the spectral transformation of SLEPc.
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

#: Options where the database has none; 14 is the room beyond what MUMPS expects to need.
DEFAULTS: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 80,
}
BATCH = 128  # right-hand sides that are solved at once
_TRIES = 4  # of a factorisation, each with twice the room
#: INFOG(1) of MUMPS where arrays or buffers are too small (users' guide, section 8).
_NO_ROOM = (-8, -9, -14, -15, -17, -20)
_SYMMETRIC = 1e-12  # relative, of matrices that are symmetric but for the round-off of assembly


class Factor:
    """Factorisations of one matrix after another. Collective, as its methods are.

    Args:
        comm: communicator.
        prefix: of PETSc options.
        symmetric: whether the matrices are and know it (`marked_symmetric`). That takes half of the
            work, and counts the negative eigenvalues.
        determinant: whether its sign is required.
        counted: whether pivots that vanish are counted, for matrices that may be singular.
        columns: whether many right-hand sides come at once.
        room: percent beyond what MUMPS expects to need.

    Attributes:
        ksp: the solver.
        defaults: options where the database has none.
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
        """The options in the database; MUMPS reads its own at every set-up."""
        return options_in_database(self._prefix, self.defaults)

    def factorise(self, A: PETSc.Mat) -> bool:
        """Factorise ``A``, its pattern analysed if it is new; False if that is not possible.

        So it is of a singular matrix, and of one with an entry that is not finite, which MUMPS does
        not always survive.
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
        """Whether MUMPS had less room than pivots took, and may have more. Collective."""
        if PETSc.Options().hasName(self._prefix + "mat_mumps_icntl_14"):
            return False
        pc = self.ksp.getPC()
        if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
            return False
        return pc.getFactorMatrix().getMumpsInfog(1) in _NO_ROOM

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; whether that worked."""
        self.ksp.solve(b, x)
        return bool(self.ksp.getConvergedReason() > 0)

    def solve_transposed(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with the transposed of A; whether that worked."""
        self.ksp.solveTranspose(b, x)
        return bool(self.ksp.getConvergedReason() > 0)

    def solve_columns(self, loads: Columns) -> PETSc.Mat:
        """X of A X = B, dense, to be destroyed.

        Args:
            loads: owned rows of B (n, k).
        """
        pc = self.ksp.getPC()
        factor = pc.getFactorMatrix()
        n, k = loads.shape
        comm = factor.comm
        X = PETSc.Mat().createDense(((n, None), (None, k)), comm=comm)
        X.setUp()
        X.assemble()
        # MUMPS passes over what is zero, where rows are not spread over ranks.
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
        """Sign of the determinant, by MUMPS."""
        return float(np.sign(self.ksp.getPC().getFactorMatrix().getMumpsRinfog(12)))

    @property
    def inertia(self) -> tuple[int, int, int]:
        """Numbers of negative, zero and positive eigenvalues of a symmetric matrix."""
        negative, zero, positive = self.ksp.getPC().getFactorMatrix().getInertia()
        return int(negative), int(zero), int(positive)

    @property
    def is_symmetric(self) -> bool:
        """Whether the factorisation is that of a symmetric matrix."""
        return bool(self.ksp.getPC().getType() == "cholesky")

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.ksp.destroy()


def is_symmetric(A: PETSc.Mat) -> bool:
    """Whether a matrix is symmetric but for round-off. Collective.

    PETSc's own test answers for the rows of each rank alone, and fails where a rank has few.
    """
    size = A.norm(PETSc.NormType.NORM_INFINITY)
    off = A.transpose(PETSc.Mat())
    off.axpy(-1.0, A, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    largest = off.norm(PETSc.NormType.NORM_INFINITY)
    off.destroy()
    return bool(largest <= _SYMMETRIC * size)


def marked_symmetric(A: PETSc.Mat) -> bool:
    """Whether a matrix is symmetric, which it then knows. Collective."""
    symmetric = is_symmetric(A)
    if symmetric:
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return symmetric
