# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Small vibrations of a body whose contact points slip, stick or are open.

Motions u e^{lambda t} about a state with closed points that stay closed (N u = 0, with the rows of
`slip.py`), sticking points (H u = 0) and forces r = -r_n (n + F d) on the body at points that slip
along d:

    (K + lambda C + lambda^2 M) u + (N + F D)^T r_n + H^T q = 0,    N u = 0,    H u = 0.

The forces do not act along the held motions, so that the problem is not symmetric: friction may
feed energy into a motion. With C = eta K it is the eigenproblem K u + ... = mu M u of the undamped
body, and lambda^2 + eta mu lambda + mu = 0 for each mu. Any other C makes it quadratic.

Small problems are projected onto two null spaces, of N and H and of N + F D and H, and all
eigenvalues are computed. In large problems SLEPc finds the eigenvalues nearest to zero.
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
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import everywhere
from dolfinx_contact._petsc import DEFAULTS as FACTOR
from dolfinx_contact._validate import nonnegative, positive
from dolfinx_contact.analysis.rows import on_gathered, solve_eigenproblem
from dolfinx_contact.analysis.slip import Slip
from dolfinx_contact.body.bulk import weighted
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.reduced.held_body import HeldField, saddle, with_dirichlet_rows

__all__ = [
    "Body",
    "DenseBody",
    "Spectrum",
    "Vibrations",
    "body_of",
    "damped",
    "first_order",
    "null_space",
]

Complex = npt.NDArray[np.complex128]

_DENSE = 700  # unknowns up to which all eigenvalues are computed
_FINITE = 30.0  # size that counts as infinite, relative to the highest frequency of an unknown
_DEFAULTS = {
    "eps_tol": 1e-12,
    "eps_max_it": 500,
    "pep_tol": 1e-12,
    "pep_max_it": 500,
    "st_type": "sinvert",
    **{f"st_{key}": value for key, value in FACTOR.items()},
}


@dataclass(frozen=True)
class Body:
    """Stiffness, mass and damping of a body, without rows of Dirichlet data.

    Attributes:
        eq: contact problem.
        K: stiffness.
        M: mass.
        eta: damping over the stiffness, a time.
        C: damping of another kind, or None.
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
        return int(self.eq.comm.allreduce(int(self.free.sum())))

    def scale(self, A: PETSc.Mat) -> float:
        """Return the largest ratio of diagonal entries of A and M on all ranks. Collective."""
        a, m = (np.abs(X.getDiagonal().array_r[self.free]) for X in (A, self.M))
        return float(self.eq.comm.allreduce(float(np.max(a / m, initial=0.0)), op=max))

    def destroy(self) -> None:
        """Free the matrices."""
        for A in (self.K, self.M, self.C):
            if A is not None:
                A.destroy()


def body_of(eq: ContactEquations, u: Array, density: Any, damping: float | ufl.Form) -> Body:
    """Assemble stiffness, mass and damping at a displacement. Collective.

    In a body of revolution, density and damping are per volume or area, without the weight 2 pi r.

    Args:
        eq: contact problem.
        u: displacement, all local values.
        density: mass density, a number, Constant, Function or UFL expression.
        damping: eta of C = eta K, or a UFL form C(trial, test).

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
                raise ValueError("a form of damping has a trial and a test function")
        else:
            eta = nonnegative(damping, "damping", "a time >= 0 or a form")
    C = None if form is None else _assembled(form)
    return Body(eq, eq.bulk.stiffness(u).copy(), _assembled(mass), eta, C)


def _assembled(form: ufl.Form) -> PETSc.Mat:
    A = dolfinx.fem.petsc.assemble_matrix(compiled_form(form))
    A.assemble()
    return A


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues with Im >= 0, by falling growth (real part).

    Attributes:
        values: eigenvalues lambda (k,).
        vectors: displacements, owned (n, k); (n, 0) if they were not requested.
        known_up_to: size up to which no eigenvalue is missing; infinite if all were computed.
    """

    values: Complex
    vectors: Complex
    known_up_to: float

    @classmethod
    def of(cls, values: Complex, vectors: Complex, known_up_to: float) -> Spectrum:
        """Select the eigenvalues with Im >= 0 and sort them."""
        values = np.where(np.abs(values.imag) <= 1e-14 * np.abs(values), values.real + 0j, values)
        upper = np.flatnonzero(values.imag >= 0)
        size = np.abs(values).max(initial=0.0) or 1.0
        growth = np.round(values.real[upper] / size, 13)
        order = upper[np.lexsort((values.imag[upper], -growth))]
        vectors = vectors[:, order] if vectors.shape[1] else vectors
        return cls(values[order], vectors, known_up_to)


class Vibrations:
    """Eigenproblem of a body and a pattern of slip. Collective.

    Args:
        slip: slipping points and their directions.
        body: stiffness, mass and damping; owned by the caller.
        dense: whether all eigenvalues are computed; by default with up to 700 unknowns.
        count: number of eigenvalues that are computed otherwise.
    """

    def __init__(self, slip: Slip, body: Body, *, dense: bool | None, count: int):
        self.comm = body.eq.comm
        self._slip = slip
        self._body = body
        self._count = count
        self.size = body.unknowns - slip.N.getSize()[0] - slip.H.getSize()[0]
        self.complete = self.size <= _DENSE if dense is None else bool(dense)
        if self.complete:
            self._dense = DenseBody(body, [slip.N, slip.D, slip.H])

    def spectrum(self, friction: Array, *, vectors: bool = False) -> Spectrum:
        """Compute the eigenvalues lambda.

        Args:
            friction: coefficients F at the slipping points of this rank.
            vectors: whether displacements are computed.

        Raises:
            RuntimeError: if SLEPc does not converge.
        """
        if self.complete:
            values, motions = self._by_matrices(friction, vectors=vectors)
            known = np.inf
        else:
            values, motions, known = self._by_slepc(friction)
        return Spectrum.of(values, motions, known)

    def _by_matrices(self, friction: Array, *, vectors: bool) -> tuple[Complex, Complex]:
        """Return all lambda, and displacements (n, k) of this rank."""
        body, eta = self._dense, self._body.eta

        def solved(friction: Array) -> tuple[Complex, Complex]:
            N, D, H = body.rows
            forces = np.concatenate([N + friction[:, None] * D, H])
            K, M, C, Z = body.projected(np.concatenate([N, H]), forces)
            inertia = np.linalg.inv(M)
            A = inertia @ K
            if C is not None:
                A = first_order(A, inertia @ C)
            x: npt.NDArray[Any] = np.zeros((len(A), 0))
            if vectors:
                values, x = np.linalg.eig(A)
            else:
                values = np.linalg.eigvals(A)
            if C is None:
                values = damped(values, eta)
                x = np.concatenate([x, x], axis=1)
            motions = np.zeros((len(body.free), x.shape[1]), dtype=complex)
            motions[body.free] = Z @ x[: Z.shape[1]]
            return values.astype(complex), motions

        values, motions = on_gathered(self.comm, solved, friction)
        n, first = self._slip.D.getLocalSize()[1], self._slip.D.getOwnershipRangeColumn()[0]
        return values, motions[first : first + n]

    def _by_slepc(self, friction: Array) -> tuple[Complex, Complex, float]:
        SLEPc = optional("slepc4py.SLEPc", "solver")
        slip = self._slip
        body = self._body
        eq = body.eq
        G = slip.D.copy()
        F = slip.D.createVecLeft()
        F.array[:] = friction
        G.diagonalScale(F, None)
        G.axpy(1.0, slip.N)
        K = with_dirichlet_rows(body.K, eq, eq.stiffness_scale)
        held = [slip.N, slip.H]
        forces = [G, slip.H]
        matrices = [saddle([HeldField(K, held, forces)], eq.stiffness_scale)]
        inertia = [body.M] if body.C is None else [body.C, body.M]
        for A in inertia:
            inside = with_dirichlet_rows(A, eq, 0.0)
            matrices.append(saddle([HeldField(inside, held, forces)], 0.0))
            inside.destroy()
        solver: Any
        if body.C is None:
            solver = SLEPc.EPS().create(self.comm)
            solver.setOperators(*matrices)
            solver.setProblemType(SLEPc.EPS.ProblemType.GNHEP)
            solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        else:
            solver = SLEPc.PEP().create(self.comm)
            solver.setOperators(matrices)
            solver.setWhichEigenpairs(SLEPc.PEP.Which.TARGET_MAGNITUDE)
        solver.setTarget(0.0)
        solver.setDimensions(min(self._count, self.size))
        solve_eigenproblem(solver, _DEFAULTS)
        n = eq.owned_sizes[0]
        farthest = 0.0
        real, imaginary = matrices[0].createVecs()
        values = []
        motions = []
        for i in range(solver.getConverged()):
            value = solver.getEigenpair(i, real, imaginary)
            motion = real.array_r[:n] + 1j * imaginary.array_r[:n]
            size = abs(value) if body.C is not None else np.sqrt(abs(value))
            if size > _FINITE * self._highest:
                continue  # an eigenvalue of the forces, which have no mass
            both = [value] if body.C is not None else damped(np.array([value]), body.eta)
            farthest = max(farthest, float(size))
            values += [complex(each) for each in both]
            motions += [motion] * len(both)
        for thing in (solver, real, imaginary, *matrices, K, G, F):
            thing.destroy()
        if not values:
            raise RuntimeError("SLEPc found no vibration: raise analysis_eps_max_it")
        return np.array(values), np.array(motions).T, farthest

    @cached_property
    def _highest(self) -> float:
        """Estimate of the highest frequency: the largest one of a single unknown."""
        body = self._body
        own = float(np.sqrt(body.scale(body.K)))
        return own if body.C is None else max(own, body.scale(body.C))


class DenseBody:
    """Dense matrices of a body on rank 0. Collective.

    Args:
        body: stiffness, mass and damping.
        rows: rows at the displacement.

    Attributes:
        free: mask of the free displacements, on rank 0 as the following attributes.
        K, M: stiffness and mass of free displacements.
        C: damping of another kind than eta K, or None.
        rows: rows at free displacements.
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
        """Return K, M and C projected onto the motions that rows allow, and these motions.

        Args:
            held: rows of the motions that are held (k, n).
            forces: rows along which forces act (k, n); by default the held ones.
        """
        Z = null_space(held)
        Y = Z if forces is None else null_space(forces)
        K, M = (Y.T @ A @ Z for A in (self.K, self.M))
        C = None if self.C is None else Y.T @ self.C @ Z
        return K, M, C, Z


def damped(mu: Complex, eta: float) -> Complex:
    """Return the roots of lambda^2 + eta mu lambda + mu = 0: one per mu, then the others."""
    mu = np.asarray(mu, dtype=complex)
    b = eta * mu
    root = np.sqrt(b * b - 4 * mu)
    # Without cancellation; for mu = 0 both roots are 0.
    q = -0.5 * (b + np.where((np.conj(b) * root).real >= 0, root, -root))
    return np.concatenate([q, np.divide(mu, q, out=np.zeros_like(q), where=q != 0)])


def first_order(K: Array, C: Array) -> Array:
    """Return the matrix (2 n, 2 n) whose eigenvalues are those of K + lambda C + lambda^2."""
    return np.block([[np.zeros_like(K), np.eye(len(K))], [-K, -C]])


def null_space(rows: Array) -> Array:
    """Return an orthonormal basis (n, n - m) of the null space of independent rows (m, n)."""
    basis: Array = qr(rows.T)[0]
    return basis[:, len(rows) :]


def _on_root_dense(A: PETSc.Mat) -> Array:
    """Gather a matrix on rank 0; the result is empty on other ranks. Collective."""
    indptr, columns, values = A.getValuesCSR()
    part = csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, A.getSize()[1]))
    parts = A.comm.tompi4py().gather(part)
    return np.zeros((0, 0)) if parts is None else np.asarray(vstack(parts).toarray())
