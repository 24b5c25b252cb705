# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Stiffness, mass and damping of a body for small motions u e^{lambda t}.

Without contact, small motions with the amplitude u satisfy the quadratic eigenproblem

    (K + lambda C + lambda^2 M) u = 0.

K is the stiffness, C the damping and M the mass. `steady_sliding` and `stability` add constraints:
rows of jumps at the contact points. Small problems are projected onto the null spaces of these rows
using dense matrices. If C = eta K, the eigenvalues mu of the undamped body, K u = mu M u, give
lambda as the roots of lambda^2 + eta mu lambda + mu = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr
from scipy.sparse import csr_matrix, vstack

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._mpi import count_of, everywhere, maximum
from dolfinx_contact._petsc import destroy
from dolfinx_contact._validate import nonnegative, positive
from dolfinx_contact.body.bulk import weighted
from dolfinx_contact.equations.contact import ContactEquations

__all__ = [
    "Body",
    "DenseBody",
    "body_of",
    "damped",
    "first_order",
]

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Body:
    """Matrices of a body, without the rows of Dirichlet data.

    Attributes:
        eq: contact problem.
        K: stiffness.
        M: mass.
        eta: damping time; the damping is eta K if ``C`` is None.
        C: damping matrix of another kind; None for damping eta K.
    """

    eq: ContactEquations
    K: PETSc.Mat
    M: PETSc.Mat
    eta: float
    C: PETSc.Mat | None

    @property
    def free(self) -> Mask:
        """Mask of the owned displacements without Dirichlet data."""
        return ~self.eq.fixed[: self.eq.owned_sizes[0]]

    @cached_property
    def unknowns(self) -> int:
        """Number of free displacements on all ranks; collective when first computed."""
        return count_of(self.eq.comm, self.free)

    def scale(self, A: PETSc.Mat) -> float:
        """Return the largest ratio of diagonal entries of a matrix and the mass. Collective."""
        a, m = (np.abs(X.getDiagonal().array_r[self.free]) for X in (A, self.M))
        return maximum(self.eq.comm, a / m)

    def destroy(self) -> None:
        """Free the matrices."""
        destroy(self.K, self.M, self.C)


def body_of(eq: ContactEquations, u: Array, density: Any, damping: float | ufl.Form) -> Body:
    """Assemble stiffness, mass and damping at a displacement. Collective.

    For an axisymmetric body, density and damping are given per volume or area; they do not contain
    the weight 2 pi r.

    Args:
        eq: contact problem.
        u: displacement, values of all local and ghost degrees of freedom.
        density: mass density: a number, Constant, Function or UFL expression.
        damping: damping time, the ratio of damping and stiffness, or a UFL form of a trial and a
            test function.

    Raises:
        ValueError: on every rank, if density or damping is not valid.
    """
    domain = eq.V.mesh
    v, w = ufl.TrialFunction(eq.V), ufl.TestFunction(eq.V)
    with everywhere(eq.comm, "mass and damping"):
        if isinstance(density, int | float | np.number):
            density = fem.Constant(domain, positive(density, "density"))
        elif not isinstance(density, ufl.core.expr.Expr) or density.ufl_shape != ():
            raise ValueError(f"the density must be a number or a UFL scalar, got {density!r}")
        mass = weighted(
            density * ufl.dot(v, w) * ufl.dx(domain=domain), axisymmetric=eq.axisymmetric
        )
        form: ufl.Form | None = None
        eta = 0.0
        if isinstance(damping, ufl.Form):
            form = weighted(damping, axisymmetric=eq.axisymmetric)
            if len(form.arguments()) != 2:
                raise ValueError("a damping form must have a trial and a test function")
        else:
            eta = nonnegative(damping, "damping", "a time >= 0 or a form")
    C = None if form is None else _assembled(form)
    return Body(eq, eq.bulk.stiffness(u).copy(), _assembled(mass), eta, C)


def _assembled(form: ufl.Form) -> PETSc.Mat:
    A = dolfinx.fem.petsc.assemble_matrix(compiled_form(form))
    A.assemble()
    return A


class DenseBody:
    """Dense matrices of a body on rank 0. Collective.

    Args:
        body: stiffness, mass and damping.
        rows: matrices with rows of jumps or constraints.

    Attributes:
        free: mask of the free displacements; only on rank 0, like all attributes.
        K, M: stiffness and mass of the free displacements.
        C: damping of the free displacements; None for damping eta K.
        rows: matrices ``rows`` with the columns of the free displacements.
    """

    def __init__(self, body: Body, rows: Sequence[PETSc.Mat]):
        free = body.eq.comm.gather(body.free)
        C = None if body.C is None else _on_root_dense(body.C)
        K, M, *dense = (_on_root_dense(A) for A in (body.K, body.M, *rows))
        if free is None:
            return
        self.free = np.concatenate(free)
        inside = np.ix_(self.free, self.free)
        self.K, self.M = K[inside], M[inside]
        self.C = None if C is None else C[inside]
        self.rows = [A[:, self.free] for A in dense]

    def projected(
        self, held: Array, forces: Array | None = None
    ) -> tuple[Array, Array, Array | None, Array]:
        """Return stiffness, mass, damping (or None) projected onto the motions Z, and Z itself.

        Args:
            held: rows of the held motions, ``held`` Z = 0, shape (k, n).
            forces: rows along which the constraint forces act, shape (k, n); by default ``held``.
        """
        Z = _null_space(held)
        Y = Z if forces is None else _null_space(forces)
        K, M = (Y.T @ A @ Z for A in (self.K, self.M))
        C = None if self.C is None else Y.T @ self.C @ Z
        return K, M, C, Z


def damped(mu: Complex, eta: float) -> Complex:
    """Return both roots lambda of lambda^2 + eta mu lambda + mu = 0 for k values mu.

    mu are the eigenvalues of the undamped body, eta is the damping time, the ratio of damping and
    stiffness. The first roots of all mu precede the second ones, shape (2 k,).
    """
    mu = np.asarray(mu, dtype=complex)
    b = eta * mu
    root = np.sqrt(b * b - 4 * mu)
    # Without cancellation; for mu = 0 both roots are 0.
    q = -0.5 * (b + np.where((np.conj(b) * root).real >= 0, root, -root))
    return np.concatenate([q, np.divide(mu, q, out=np.zeros_like(q), where=q != 0)])


def first_order(K: Array, C: Array) -> Array:
    """Return the matrix with the eigenvalues lambda of (K + lambda C + lambda^2) x = 0.

    K and C are stiffness and damping for unit mass; eigenvectors are (x, lambda x), shape (2 n,).
    """
    return np.block([[np.zeros_like(K), np.eye(len(K))], [-K, -C]])


def _null_space(rows: Array) -> Array:
    """Return an orthonormal basis of the null space of ``rows``, as columns, shape (n, n - m).

    The rows, shape (m, n), are linearly independent.
    """
    basis: Array = qr(rows.T)[0]
    return basis[:, len(rows) :]


def _on_root_dense(A: PETSc.Mat) -> Array:
    """Gather a matrix on rank 0; the result is empty on other ranks. Collective."""
    indptr, columns, values = A.getValuesCSR()
    part = csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, A.getSize()[1]))
    parts = A.comm.tompi4py().gather(part)
    return np.zeros((0, 0)) if parts is None else np.asarray(vstack(parts).toarray())
