"""Factorisations by MUMPS."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import scipy.sparse as sp

from dolfinx_contact._factor import Factor
from dolfinx_contact.solvers.surface_block import without_zeros

COMM = MPI.COMM_WORLD


def indefinite(n=200):
    """A saddle point whose pivots MUMPS has to put off, rows in no order."""
    rng = np.random.default_rng(0)
    side = int(np.sqrt(n))
    K = 1e-8 * sp.diags([-1, -1, 4, -1, -1], [-side, -1, 0, 1, side], shape=(n, n))
    B = sp.random(n, n, density=4 / n, random_state=rng) + sp.diags([1e-6], [0], shape=(n, n))
    A = sp.bmat([[K, B], [B.T, None]], format="csr")
    order = rng.permutation(2 * n)
    A = A[order][:, order].tocsr()
    return A, PETSc.Mat().createAIJ(
        A.shape, csr=(A.indptr, A.indices, A.data), comm=PETSc.COMM_SELF
    )


@pytest.mark.skipif(COMM.size > 1, reason="not collective")
def test_pivots_that_take_more_room_than_expected():
    """MUMPS gets more of it; a singular matrix is not taken for that."""
    A, matrix = indefinite()
    for name in ("icntl_6", "icntl_8"):  # no other order of columns, no scaling
        PETSc.Options()[f"room_mat_mumps_{name}"] = 0
    factor = Factor(PETSc.COMM_SELF, "room_", room=25)
    assert factor.factorise(matrix)
    assert factor.defaults["mat_mumps_icntl_14"] == 100
    b, x = matrix.createVecs()
    b.array[:] = np.arange(1.0, A.shape[0] + 1)
    assert factor.solve(b, x)
    off = np.abs(A @ x.array_r - b.array_r).max()  # of a matrix that is nearly singular
    assert off < 1e-13 * np.abs(A).max() * np.abs(x.array_r).max()
    matrix.zeroRowsColumns([3], diag=0.0)
    assert not factor.factorise(matrix)
    assert factor.defaults["mat_mumps_icntl_14"] == 100
    factor.destroy()
    PETSc.Options()["room_mat_mumps_icntl_14"] = 25  # who says how much is taken at their word
    factor = Factor(PETSc.COMM_SELF, "room_", room=200)
    assert not factor.factorise(indefinite()[1])
    factor.destroy()


@pytest.mark.ranks(2)
def test_matrices_without_their_zeros():
    """Products are the same, entries those that are not zero, on each rank its own."""
    n = 5 + COMM.rank
    size = COMM.allreduce(n)
    first = COMM.exscan(n) or 0
    rng = np.random.default_rng(1)
    whole = np.where(rng.random((size, size)) < 0.3, rng.normal(size=(size, size)), 0.0)
    whole[2] = 0.0
    mine = whole[first : first + n]
    indptr = size * np.arange(n + 1, dtype=np.int32)
    columns = np.tile(np.arange(size, dtype=np.int32), n)
    A = PETSc.Mat().createAIJ(((n, None), (n, None)), csr=(indptr, columns, mine.reshape(-1)))
    B = without_zeros(A)
    assert B.getSizes() == A.getSizes()
    _, places, values = B.getValuesCSR()
    np.testing.assert_array_equal(values, mine[mine != 0])
    np.testing.assert_array_equal(places, np.nonzero(mine)[1])
    x, y = B.createVecs()
    x.array[:] = np.arange(first, first + n)
    B.mult(x, y)
    np.testing.assert_allclose(y.array_r, mine @ np.arange(size), atol=1e-13)
