# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Factorised body whose displacements satisfy prescribed linear conditions.

    [ K   C^T ] [ u ]   [ b ]
    [ A    0  ] [ p ] = [ c ]

The displacement u is determined by the loads b and by the conditions A u = c, for example
prescribed motions c of the contact points. K is the stiffness. C^T p are the forces that enforce
the conditions, with the multipliers p (C = A for a support; with friction C differs from A). Rows
of Dirichlet data are inserted. The condensed problem (`reduction`) and analyses of the body in
contact use this factorisation to eliminate the body.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
from scipy.sparse import csc_matrix as Columns
from scipy.sparse import csr_matrix as Rows

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._petsc import BATCH, Factor, destroy, marked_symmetric
from dolfinx_contact.equations.contact import ContactEquations

__all__ = [
    "ROUND_OFF",
    "ConstrainedBody",
    "ConstrainedField",
    "columns_of",
    "is_positive_definite",
    "saddle",
    "with_dirichlet_rows",
]

ROUND_OFF = 2.0**-53
_TERMS = 256  # largest number of entries in a row of the matrix, approximately


def with_dirichlet_rows(A: PETSc.Mat, eq: ContactEquations, diagonal: float) -> PETSc.Mat:
    """Return a copy of a displacement matrix with Dirichlet rows inserted. Collective.

    Args:
        A: matrix on the displacements.
        eq: contact problem.
        diagonal: diagonal entry of Dirichlet rows; the rest of their rows and columns is set to 0.
    """
    A = A.copy()
    fixed = np.flatnonzero(eq.fixed[: eq.owned_sizes[0]]) + A.getOwnershipRange()[0]
    A.zeroRowsColumns(fixed.astype(PETSc.IntType), diag=diagonal)
    return A


@dataclass(frozen=True, eq=False)
class ConstrainedField:
    """Field of unknowns: displacements of the body, or motions of rigid bodies.

    Attributes:
        stiffness: stiffness of the field with Dirichlet rows.
        rows: matrices mapping the field to the prescribed motions, one per block of multipliers;
            every field has the same number of blocks.
        forces: matrices, one per block, whose transposes map multipliers to forces on the field;
            default: ``rows``.
        without_forces: indices of the unknowns of the field on which multipliers exert no force;
            default: none.
    """

    stiffness: PETSc.Mat
    rows: Sequence[PETSc.Mat]
    forces: Sequence[PETSc.Mat] | None = None
    without_forces: Ints | None = None

    def transposed(self, unit: float) -> list[PETSc.Mat]:
        """Return the matrices from multipliers to forces, times ``unit``, one for each block.

        The caller must destroy them. Collective.
        """
        found = []
        for C in self.rows if self.forces is None else self.forces:
            block = C.transpose(PETSc.Mat())
            block.scale(unit)
            if self.without_forces is not None:
                block.zeroRows(self.without_forces.astype(PETSc.IntType), diag=0.0)
            found.append(block)
        return found


def saddle(fields: Sequence[ConstrainedField], unit: float) -> PETSc.Mat:
    """Return the matrix of the linear system of a body with prescribed motions. Collective.

    The AIJ matrix is [K, s C^T; s A, 0] with the stiffness K of all fields, the matrix A from the
    fields to the prescribed motions, the transpose of a matrix C from multipliers to forces, and
    the unit s = ``unit`` of the multipliers.
    """
    scaled = [[A * unit for A in field.rows] for field in fields]
    transposed = [field.transposed(unit) for field in fields]
    rows: list[list[PETSc.Mat | None]] = []
    for i, (field, forces) in enumerate(zip(fields, transposed, strict=True)):
        rows.append([field.stiffness if i == k else None for k in range(len(fields))] + forces)
    for blocks in zip(*scaled, strict=True):
        rows.append([*blocks, *(None for _ in transposed[0])])
    nest = PETSc.Mat().createNest(rows, comm=fields[0].stiffness.comm)
    matrix = nest.convert("aij", PETSc.Mat())
    destroy(nest, *(A for blocks in (*scaled, *transposed) for A in blocks))
    return matrix


def is_positive_definite(eq: ContactEquations, A: PETSc.Mat) -> bool:
    """Return whether a displacement matrix is symmetric and positive definite. Collective.

    Dirichlet rows are excluded. Pivots count as zero up to round-off.
    """
    inside = with_dirichlet_rows(A, eq, eq.scaling.stiffness)
    definite = False
    if marked_symmetric(inside):
        factor = Factor(eq.comm, "analysis_", symmetric=True, counted=True)
        definite = factor.factorise(inside) and factor.inertia[:2] == (0, 0)
        factor.destroy()
    inside.destroy()
    return definite


def columns_of(rows: PETSc.Mat) -> Columns:
    """Return the transpose of a matrix with k rows as k sparse columns. Collective.

    The n owned entries of each column are returned, shape (n, k).
    """
    transposed = rows.transpose(PETSc.Mat())
    indptr, columns, values = transposed.getValuesCSR()
    shape = (len(indptr) - 1, rows.getSize()[0])
    transposed.destroy()
    return Rows((values, columns, indptr), shape=shape).tocsc()


class ConstrainedBody:
    """Factorised body with prescribed motions, see the module. All methods are collective.

    Args:
        comm: communicator.
        fields: fields of unknowns; their rows are in the order of the multipliers.
        unit: unit of the multipliers, of the magnitude of the stiffness.
        prefix: prefix of PETSc options.
        counted: whether the numbers of negative and zero pivots are required (`signs`, `definite`);
            default: only if no motions are prescribed.

    Attributes:
        sizes: local numbers of unknowns: those of all fields together, followed by those of each
            block of multipliers.
        matrix: matrix of the whole linear system (`saddle`), in which multipliers are forces
            divided by ``unit``.

    Raises:
        RuntimeError: if a rigid motion of the body remains free.
        ValueError: if the stiffness is not finite.
    """

    def __init__(
        self,
        comm: Any,
        fields: Sequence[ConstrainedField],
        unit: float,
        *,
        prefix: str = "analysis_",
        counted: bool | None = None,
    ):
        self.comm = comm
        self.unit = unit
        rows = fields[0].rows
        moving = sum(field.stiffness.getLocalSize()[0] for field in fields)
        self.sizes = [moving, *(A.getLocalSize()[0] for A in rows)]
        self.matrix = saddle(fields, unit)
        # Without rows the matrix may be indefinite or singular, which its inertia shows.
        counted = not rows if counted is None else counted
        kind: dict[str, bool] = dict(symmetric=marked_symmetric(self.matrix), counted=counted)
        self._factor = Factor(self.comm, prefix, columns=True, **kind)
        if not self._factor.factorise(self.matrix):
            finite = np.isfinite(self.matrix.norm(PETSc.NormType.FROBENIUS))
            destroy(self._factor, self.matrix)
            if not finite:
                raise ValueError("the stiffness is not finite: look at the material data")
            raise RuntimeError("the body is not held: Dirichlet data and contact leave it to move")
        self._b, self._x = self.matrix.createVecs()

    def solve(self, *loads: Array) -> list[Array]:
        """Solve for one right-hand side.

        Args:
            loads: owned entries of the loads on all fields, followed by owned entries of the
                prescribed motions of each block; omitted blocks are 0.

        Returns:
            Owned values of the fields, followed by the owned multipliers of each block, as forces.
        """
        self._b.set(0.0)
        for i, (load, place) in enumerate(zip(loads, self._starts, strict=False)):
            scale = 1.0 if i == 0 else self.unit
            self._b.array[place : place + len(load)] = scale * load
        self._factor.solve(self._b, self._x)
        parts = np.split(self._x.array_r.copy(), self._starts[1:])
        return [parts[0], *(self.unit * p for p in parts[1:])]

    def left(self) -> float:
        """Return a bound of the residual norm of the last `solve`, including round-off."""
        off = self.round_off(self._x.norm(), self._b.norm())
        self._b.scale(-1.0)
        residual = self._b.duplicate()
        self.matrix.multAdd(self._x, self._b, residual)
        off += residual.norm()
        residual.destroy()
        return float(off)

    def round_off(self, x: Any, b: Any) -> Any:
        """Return a bound of the round-off in a residual of the linear system. Collective.

        ``x`` is the norm of the solution, and ``b`` the norm of the right-hand side.
        """
        A = self.matrix
        size = np.sqrt(A.norm(PETSc.NormType.NORM_1) * A.norm(PETSc.NormType.NORM_INFINITY))
        return _TERMS * ROUND_OFF * (size * x + b)

    @property
    def definite(self) -> bool:
        """Whether the matrix is positive definite; only without prescribed motions. Collective."""
        return self._factor.is_symmetric and self._factor.inertia[:2] == (0, 0)

    @property
    def signs(self) -> tuple[int, int]:
        """Numbers of negative and zero eigenvalues of the stiffness on a null space. Collective.

        The null space belongs to the matrix A from the fields to the prescribed motions. With m
        independent rows of A, the whole matrix has m more negative eigenvalues (N. I. M. Gould, On
        practical conditions for the existence and uniqueness of solutions to the general equality
        quadratic programming problem, Math. Programming 32, 1985). The stiffness must be symmetric,
        and ``counted`` True.
        """
        rows = int(self.comm.allreduce(sum(self.sizes[1:])))
        negative, zero, _ = self._factor.inertia
        return negative - rows, zero

    @property
    def _starts(self) -> Ints:
        return np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(np.int64)

    def answers(self, loads: Columns) -> Iterator[tuple[slice, Columns, PETSc.Mat]]:
        """Solve for many right-hand sides in batches.

        Args:
            loads: sparse columns with the owned loads on the fields, followed by the owned
                prescribed motions times ``unit``, shape (n, k).

        Yields:
            Slice of the columns in a batch, loads of the batch, and the dense matrix of solutions,
            which is destroyed afterwards. Its multipliers are forces divided by ``unit``.
        """
        for a in range(0, loads.shape[1], BATCH):
            part = loads[:, a : a + BATCH]
            X = self._factor.solve_columns(part)
            yield slice(a, a + part.shape[1]), part, X
            X.destroy()

    def respond(self, loads: Columns, seen: PETSc.Mat) -> tuple[Array, Array]:
        """Return displacements and multipliers caused by many loads, without prescribed motions.

        Args:
            loads: sparse columns with the owned entries of the loads on the fields, shape (n, k).
            seen: matrix that is applied to the displacements.

        Returns:
            Owned rows of the product of ``seen`` and the displacements, shape (m, k); and
            multipliers (forces) of the first block, shape (sizes[1], k), empty without blocks.
        """
        n = self.sizes[0]
        k = loads.shape[1]
        first = sum(self.sizes[1:2])
        motions = np.empty((seen.getLocalSize()[0], k))
        forces = np.empty((first, k))
        whole = loads.copy()
        whole.resize(sum(self.sizes), k)
        for here, part, X in self.answers(whole):
            found = X.getDenseArray(readonly=True)
            forces[:, here] = self.unit * found[n : n + first]
            u = X
            if len(self.sizes) > 1:
                u = PETSc.Mat().createDense(((n, None), (None, part.shape[1])), comm=self.comm)
                u.setUp()
                u.getDenseArray()[:] = found[:n]
                u.assemble()
                X.destroy()
            product = seen.matMult(u)
            motions[:, here] = product.getDenseArray(readonly=True)
            destroy(product, u)
        return motions, forces

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self._factor, self.matrix, self._b, self._x)
