# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The body with some motions of its contact points held, factorised once.

    [ K   C^T ] [ u ]   [ b ]
    [ A    0  ] [ p ] = [ c ]

with rows A that say which motions are held, and the forces C^T p that hold them (C = A for a
support; other forces come with friction). Rows of Dirichlet data are put in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_matrix as Columns
from scipy.sparse import csr_matrix as Rows

from dolfinx_contact._factor import BATCH, Factor, marked_symmetric
from dolfinx_contact.equations.contact import ContactEquations

__all__ = ["HeldBody", "columns_of", "saddle", "slepc", "with_dirichlet_rows"]

Array = npt.NDArray[np.float64]


def slepc() -> Any:
    """The module of slepc4py.

    Raises:
        ModuleNotFoundError: if it is not installed.
    """
    try:
        from slepc4py import SLEPc
    except ModuleNotFoundError as error:
        message = "slepc4py is not installed beside petsc4py: python3-slepc4py of Debian, or conda"
        raise ModuleNotFoundError(message, name=error.name) from None
    return SLEPc


def with_dirichlet_rows(A: PETSc.Mat, eq: ContactEquations, diagonal: float) -> PETSc.Mat:
    """A copy of a matrix of the displacement with rows of Dirichlet data put in. Collective.

    Args:
        A: to be copied.
        eq: knows what is fixed.
        diagonal: entry of such rows; the others, and their columns, are 0.
    """
    A = A.copy()
    fixed = np.flatnonzero(eq.fixed[: eq.owned_sizes[0]]) + A.getOwnershipRange()[0]
    A.zeroRowsColumns(fixed.astype(PETSc.IntType), diag=diagonal)
    return A


def saddle(
    K: PETSc.Mat, rows: Sequence[PETSc.Mat], forces: Sequence[PETSc.Mat], unit: float
) -> PETSc.Mat:
    """[K, u C^T; u A, 0] with the unit u of multipliers, AIJ, rank by rank. Collective."""
    transposed = [C.transpose(PETSc.Mat()) for C in forces]
    scaled = [A.copy() for A in rows]
    for A in (*transposed, *scaled):
        A.scale(unit)
    none = [None] * len(scaled)
    nest = PETSc.Mat().createNest([[K, *transposed], *([A, *none] for A in scaled)], comm=K.comm)
    matrix = nest.convert("aij", PETSc.Mat())
    for thing in (nest, *transposed, *scaled):
        thing.destroy()
    return matrix


def columns_of(rows: PETSc.Mat) -> Columns:
    """The transposed of some rows, owned rows (n, k): loads that act there. Collective."""
    transposed = rows.transpose(PETSc.Mat())
    indptr, columns, values = transposed.getValuesCSR()
    shape = (len(indptr) - 1, rows.getSize()[0])
    transposed.destroy()
    return Rows((values, columns, indptr), shape=shape).tocsc()


class HeldBody:
    """See the module. Collective, as all its methods are.

    Args:
        eq: the contact problem.
        K: stiffness with Dirichlet rows put in.
        rows: A, blocks of rows; their order is that of the multipliers p.
        forces: C, by default A.
        counted: whether the matrix may be indefinite or singular, and its signs are asked for; by
            default without rows.

    Attributes:
        sizes: numbers of unknowns of this rank: the displacement, then the blocks of p.
        matrix: of the whole; multipliers are forces over a typical stiffness.

    Raises:
        RuntimeError: if the body is not held.
    """

    def __init__(
        self,
        eq: ContactEquations,
        K: PETSc.Mat,
        rows: Sequence[PETSc.Mat],
        forces: Sequence[PETSc.Mat] | None = None,
        *,
        counted: bool | None = None,
    ):
        self.comm = eq.comm
        self.unit = eq.stiffness_scale
        self.sizes = [A.getLocalSize()[0] for A in (K, *rows)]
        self.matrix = saddle(K, rows, rows if forces is None else forces, self.unit)
        # Alone the body's matrix may be indefinite or singular, and says so by its signs.
        counted = not rows if counted is None else counted
        kind: dict[str, bool] = dict(symmetric=marked_symmetric(self.matrix), counted=counted)
        self._factor = Factor(self.comm, "analysis_", columns=True, **kind)
        if not self._factor.factorise(self.matrix):
            raise RuntimeError("the body is not held: Dirichlet data and contact leave it to move")
        self._b, self._x = self.matrix.createVecs()

    def solve(self, *loads: Array) -> list[Array]:
        """Displacement and multipliers, forces, for the owned parts of b and c.

        Args:
            loads: b, then parts of c; what is left out is 0.
        """
        self._b.set(0.0)
        for i, (load, place) in enumerate(zip(loads, self._starts, strict=False)):
            scale = 1.0 if i == 0 else self.unit
            self._b.array[place : place + len(load)] = scale * load
        self._factor.solve(self._b, self._x)
        parts = np.split(self._x.array_r.copy(), self._starts[1:])
        return [parts[0], *(self.unit * p for p in parts[1:])]

    @property
    def definite(self) -> bool:
        """Whether a body without rows is symmetric and positive definite. Collective."""
        return self._factor.is_symmetric and self._factor.inertia[:2] == (0, 0)

    @property
    def signs(self) -> tuple[int, int]:
        """Numbers of negative and zero eigenvalues on the motions that are left. Collective.

        With m independent rows the whole matrix has m more that are negative (N. I. M. Gould, On
        practical conditions for the existence and uniqueness of solutions to the general equality
        quadratic programming problem, Math. Programming 32, 1985). The body must be symmetric, and
        `counted`.
        """
        rows = int(self.comm.allreduce(sum(self.sizes[1:])))
        negative, zero, _ = self._factor.inertia
        return negative - rows, zero

    @property
    def _starts(self) -> npt.NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(np.int64)

    def respond(self, loads: Columns, seen: PETSc.Mat) -> tuple[Array, Array]:
        """The answers to many loads b at once.

        Args:
            loads: owned rows of one vector b a column (n, k), sparse.
            seen: rows at the displacement.

        Returns:
            What is seen of the displacements, owned rows (m, k), and the multipliers of the first
            block, forces (sizes[1], k), of which there are none without blocks.
        """
        n = self.sizes[0]
        k = loads.shape[1]
        first = sum(self.sizes[1:2])
        motions = np.empty((seen.getLocalSize()[0], k))
        forces = np.empty((first, k))
        for a in range(0, k, BATCH):
            part = loads[:, a : a + BATCH]
            part.resize(sum(self.sizes), part.shape[1])
            x = self._factor.solve_columns(part)
            answers = x.getDenseArray(readonly=True)
            forces[:, a : a + BATCH] = self.unit * answers[n : n + first]
            if len(self.sizes) > 1:
                u = PETSc.Mat().createDense(((n, None), (None, part.shape[1])), comm=self.comm)
                u.setUp()
                u.getDenseArray()[:] = answers[:n]
                u.assemble()
                x.destroy()
                x = u
            product = seen.matMult(x)
            motions[:, a : a + BATCH] = product.getDenseArray(readonly=True)
            product.destroy(), x.destroy()
        return motions, forces

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for thing in (self._factor, self.matrix, self._b, self._x):
            thing.destroy()
