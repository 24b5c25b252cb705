# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Multigrid solver for a body with prescribed motions of its contact points.

It solves the system of `reduced.constrained_body` for bodies that are too large to factorise,

    [ K   R^T ] [ u ]   [ b ]
    [ R    0  ] [ p ] = [ 0 ]

with the stiffness K, displacements u, loads b, and multipliers p of the constraints R u = 0. Each
row of R has a node of its own, at which no other row is nonzero. Let R_o be the entries of R at
these nodes divided by the square of their norm, and 0 elsewhere, so that R R_o^T = 1. On a rigid
obstacle R_o = R; between two bodies, the node belongs to either of them; next to a clamped node,
the norm is less than 1. Then

    Z = 1 - R_o^T R

projects onto the motions with R u = 0 and is sparse: u = Z w with

    (Z^T K Z + k R_o^T R_o) w = Z^T b,    p = R_o b - R_o K u

for any k > 0. This matrix is positive definite if the body is supported. It is solved by conjugate
gradients with one multigrid hierarchy, which contains the constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array
from dolfinx_contact._petsc import destroy, options_in_database, product, reasons_of, stacked
from dolfinx_contact.analysis.davidson import Davidson
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.reduced.constrained_body import with_dirichlet_rows
from dolfinx_contact.solvers.hierarchy import Hierarchy

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix as Columns

__all__ = ["ConstrainedMultigrid", "have_own_nodes"]

_DEFAULTS = {"ksp_rtol": 1e-11, "ksp_max_it": 1000, "ksp_norm_type": "unpreconditioned"}
_OWN = 1e-10  # largest deviation of R R_o^T from 1
_LEAST = 1e-2  # smallest squared norm of a row at its own node


def have_own_nodes(rows: Sequence[PETSc.Mat], dim: int) -> bool:
    """Return True if each row has a node of its own, as multigrid requires. Collective.

    Args:
        rows: matrices of the jump components that are held, without the columns of Dirichlet data.
        dim: number of unknowns per node.
    """
    R = stacked(rows)
    own = _own_nodes(R, dim)
    R.destroy()
    if own is not None:
        own.destroy()
    return own is not None


def _own_nodes(rows: PETSc.Mat, dim: int) -> PETSc.Mat | None:
    """Return the matrix R_o of the module, or None. Collective.

    It contains the entries of each row at a node of its own, divided by the square of their norm.
    None if a row has no node of its own.

    Args:
        rows: matrix R of the held jump components, with columns for the displacement dofs.
        dim: number of unknowns per node.
    """
    starts, columns, values = rows.getValuesCSR()
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    pairs, entry = np.unique(np.stack([row, columns // dim]), axis=1, return_inverse=True)
    entry = entry.reshape(-1)
    sizes = np.zeros(pairs.shape[1])
    np.add.at(sizes, entry, values**2)
    # Prefer nodes with small entries in other rows. Rounding breaks ties independently of
    # round-off, so that all rows of a point choose the same node.
    at = np.zeros((len(sizes), dim))
    at[entry, columns % dim] = values
    seen = _seen_by_all(rows, at, entry)
    share = np.where(sizes > _LEAST, sizes**2 / np.maximum(seen, _LEAST**2), 0.0)
    order = np.lexsort((pairs[1], -np.round(sizes, 9), -np.round(share, 9), pairs[0]))
    first = np.unique(pairs[0][order], return_index=True)[1]
    chosen = np.zeros(len(sizes), dtype=bool)
    chosen[order[first]] = True
    own = rows.copy()
    sizes[~chosen] = np.inf
    own.setValuesCSR(starts, columns, values / sizes[entry])
    own.assemble()
    transposed = own.transpose(PETSc.Mat())
    squared = rows.matMult(transposed)
    one = PETSc.Mat().createConstantDiagonal(squared.getSizes(), 1.0, comm=rows.comm)
    off = one.convert("aij", PETSc.Mat())
    off.axpy(-1.0, squared, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    fits = bool(off.norm(PETSc.NormType.NORM_INFINITY) <= _OWN)
    destroy(transposed, squared, one, off)
    if not fits:
        own.destroy()
        return None
    return own


def _seen_by_all(rows: PETSc.Mat, at: Array, entry: npt.NDArray[np.intp]) -> Array:
    """Return the sum of (v.w)^2 over the rows at the node of v, for each v. Collective.

    v and w are vectors of the matrix entries of one row at one node.

    Args:
        rows: matrix R of the held jump components.
        at: vectors v, shape (k, dim).
        entry: index of the vector v that contains each matrix entry of this rank.

    Returns:
        Sums of squares, shape (k,).
    """
    starts, columns, values = rows.getValuesCSR()
    products = rows.copy()
    sums, ones = products.createVecs()
    ones.set(1.0)
    seen = np.zeros(len(at))
    for component in at.T:
        products.setValuesCSR(starts, columns, values * component[entry])
        products.assemble()
        products.multTranspose(ones, sums)
        products.diagonalScale(None, sums)
        np.add.at(seen, entry, products.getValuesCSR()[2])
    destroy(products, sums, ones)
    return seen


class ConstrainedMultigrid:
    """Multigrid solver of a body with jump components held at zero (see the module).

    All methods are collective.

    Args:
        eq: contact problem.
        u: displacement of this rank at which the stiffness is evaluated.
        rows: matrices of the held jump components, without the columns of Dirichlet data.
        prefix: prefix of PETSc options, followed by ``held_`` for the Krylov method and ``amg_``
            for the multigrid hierarchy.

    Attributes:
        solves: number of solves so far.
        iterations: total number of Krylov iterations.
        symmetric: whether the stiffness is symmetric; otherwise GMRES replaces conjugate gradients.

    Raises:
        ValueError: on every rank, if a row has no node of its own.
    """

    def __init__(self, eq: ContactEquations, u: Array, rows: Sequence[PETSc.Mat], prefix: str):
        self.comm = eq.comm
        self.solves = 0
        self.iterations = 0
        self._sizes = [R.getLocalSize()[0] for R in rows]
        R = stacked(rows)
        own = _own_nodes(R, eq.dim)
        if own is None:
            R.destroy()
            raise ValueError("multigrid needs contact points that are nodes: use solver='direct'")
        self._own = own
        self._Z = _projection(R, own)
        R.destroy()
        K = with_dirichlet_rows(eq.bulk.stiffness(u), eq, eq.scaling.stiffness)
        self._forces = own.matMult(K)
        A = K.ptap(self._Z)
        held = own.transposeMatMult(own)
        A.axpy(eq.scaling.stiffness, held, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.symmetric = eq.bulk.is_energy
        self._hierarchy = Hierarchy(eq.V, prefix, symmetric=self.symmetric)
        fixed = np.flatnonzero(eq.fixed[: A.getLocalSize()[0]]).astype(np.int32)
        self._ksp = PETSc.KSP().create(self.comm)
        self._ksp.setOptionsPrefix(prefix + "held_")
        self._ksp.setType("cg" if self.symmetric else "gmres")
        with options_in_database(prefix + "held_", _DEFAULTS):
            self._ksp.setFromOptions()
        self._ksp.setPC(self._hierarchy.build(A, fixed, eq.scaling.stiffness))
        self._b, self._x = A.createVecs()
        self._rest = self._b.duplicate()
        destroy(K, A, held)

    def solve(self, load: Array, start: Array | None = None) -> list[Array]:
        """Compute the displacement and the constraint forces under one load.

        Args:
            load: owned part of the load.
            start: initial guess of the displacement, zero by default.

        Returns:
            Displacement, and the multipliers (forces) of each matrix of held components; owned
            parts.

        Raises:
            RuntimeError: on every rank, if conjugate gradients do not converge.
        """
        b, x, rest = self._b, self._x, self._rest
        b.array[:] = load
        self._Z.multTranspose(b, rest)
        x.array[:] = 0.0 if start is None else start
        self._ksp.setInitialGuessNonzero(start is not None)
        self._ksp.solve(rest, x)
        self.solves += 1
        self.iterations += self._ksp.getIterationNumber()
        if self._ksp.getConvergedReason() < 0:
            raise RuntimeError(
                f"multigrid did not solve the held body ({reasons_of(self._ksp)}); use "
                "solver='direct' if memory allows"
            )
        u = product(self._Z, x.array_r)
        p = product(self._own, load) - product(self._forces, u)
        return [u, *np.split(p, np.cumsum(self._sizes)[:-1])]

    def respond(self, loads: Columns, seen: PETSc.Mat) -> tuple[Array, Array]:
        """Solve for k loads b, one after the other, as `ConstrainedBody.respond` does.

        Args:
            loads: sparse matrix with one load per column, shape (n, k) for n owned dofs.
            seen: matrix with m owned rows, by which the displacements are multiplied.

        Returns:
            Products of ``seen`` and the displacements, shape (m, k), and the multipliers (forces)
            of the n_1 owned rows of the first block, shape (n_1, k).

        Raises:
            RuntimeError: on every rank, if conjugate gradients do not converge.
        """
        motions = np.empty((seen.getLocalSize()[0], loads.shape[1]))
        forces = np.empty((self._sizes[0], loads.shape[1]))
        for k in range(loads.shape[1]):
            u, forces[:, k], *_ = self.solve(loads[:, [k]].toarray()[:, 0])
            motions[:, k] = product(seen, u)
        return motions, forces

    def leaves_alone(self, D: PETSc.Mat) -> bool:
        """Return True if forces D^T f act only on free motions. Collective.

        The condition is R_o D^T = 0 with the matrix R_o of the module.
        """
        transposed = D.transpose(PETSc.Mat())
        forces = self._own.matMult(transposed)
        off = forces.norm(PETSc.NormType.NORM_INFINITY)
        destroy(transposed, forces)
        return bool(off <= _OWN)

    def eigenvalues(self, D: PETSc.Mat, loads: Array) -> Davidson:
        """Return the eigenvalue solver of the map f -> p for the load D^T f. Collective.

        p are the multipliers of the first matrix of held components. In the notation of the module,
        u = Z w and G w = p, and the eigenvalues mu solve the problem (D Z)^T G
        w = mu (Z^T K Z + k R_o^T R_o) w. The body must be `symmetric`. Destroy the returned object
        before this one.

        Args:
            D: matrix with as many rows as the first matrix of held components, for which
                `leaves_alone` is true.
            loads: magnitudes of the random vector with which a search begins (`Davidson`).
        """
        first = self._forces.getOwnershipRange()[0]
        rows = PETSc.IS().createStride(self._sizes[0], first, 1, comm=self.comm)
        forces = self._forces.createSubMatrix(rows)
        E, G = (A.matMult(self._Z) for A in (D, forces))
        G.scale(-1.0)
        destroy(rows, forces)
        pc = self._ksp.getPC()
        return Davidson(pc.getOperators()[0], pc, E, G, loads)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(
            self._hierarchy,
            self._ksp,
            self._own,
            self._Z,
            self._forces,
            self._b,
            self._x,
            self._rest,
        )


def _projection(R: PETSc.Mat, own: PETSc.Mat) -> PETSc.Mat:
    """Return the projection 1 - R_o^T R onto the motions with R u = 0. Collective.

    Args:
        R: matrix of the held jump components.
        own: matrix R_o, see `_own_nodes`.
    """
    removed = own.transposeMatMult(R)
    one = PETSc.Mat().createConstantDiagonal(removed.getSizes(), 1.0, comm=R.comm)
    Z = one.convert("aij", PETSc.Mat())
    Z.axpy(-1.0, removed, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    destroy(one, removed)
    return Z
