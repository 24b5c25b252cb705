# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solving for many sparse right-hand sides with one factorisation."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from scipy.sparse import csc_matrix as Columns

__all__ = ["factor_kind", "is_symmetric", "solved_columns"]

_SYMMETRIC = 1e-12  # relative, of matrices that are symmetric but for the round-off of assembly


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


def factor_kind(A: PETSc.Mat) -> dict[str, str]:
    """The option of a factorisation, symmetric if the matrix is, which then knows it. Collective.

    That takes half of the work, and tells how many eigenvalues are negative.
    """
    if not is_symmetric(A):
        return {"pc_type": "lu"}
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return {"pc_type": "cholesky"}


def solved_columns(pc: PETSc.PC, loads: Columns) -> PETSc.Mat:
    """X of A X = B, dense. Collective; to be destroyed.

    Args:
        pc: with the factorisation of A.
        loads: owned rows of B (n, k).
    """
    factor = pc.getFactorMatrix()
    n, k = loads.shape
    comm = factor.comm
    X = PETSc.Mat().createDense(((n, None), (None, k)), comm=comm)
    X.setUp(), X.assemble()
    # MUMPS passes over what is zero, where rows are not spread over ranks.
    if comm.size == 1 and pc.getFactorSolverType() == "mumps":
        csr = loads.indptr.astype(PETSc.IntType), loads.indices.astype(PETSc.IntType), loads.data
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
