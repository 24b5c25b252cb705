# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Stability of steady sliding: growing vibrations (squeal).

A body with stiffness K, damping C and mass M slides steadily over a moving obstacle. Under
perturbations u e^{lambda t}, closed points remain closed, and the shear remains F times the
pressure, opposite to the slip and independent of the velocity. With the friction coefficient F, N
and D are the rows of normal displacements and of slips at slipping points, r_n their normal forces,
and H the rows of held motions (`slip`), with the forces q:

    (K + lambda C + lambda^2 M) u + (N + F D)^T r_n + H^T q = 0,    N u = 0,    H u = 0.

The forces of slipping points do not act along the constraints N u = 0, so that the problem is not
symmetric. A vibration grows if the pressure changes in phase with the slip, usually where two
frequencies meet (mode coupling: A. Akay, Acoustics of friction, J. Acoust. Soc. Am. 111, 2002). In
3D, a point moves across the slip without resistance, provided that sliding is fast compared with
the vibration.

Small problems are projected onto two null spaces, of (N, H) and of (N + F D, H), and all
eigenvalues are computed. For large problems SLEPc computes the eigenvalues nearest to zero. Without
damping, the highest frequencies of the mesh merge first, and the onset decreases under refinement.
Only a damped body has an onset independent of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, minimize_scalar

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective, require
from dolfinx_contact._petsc import DEFAULTS as FACTOR
from dolfinx_contact._petsc import destroy, staged
from dolfinx_contact._validate import ReadOnly, count, nonnegative, positive
from dolfinx_contact.analysis.rows import (
    Problem,
    on_gathered,
    solve_eigenproblem,
    static_equations,
)
from dolfinx_contact.analysis.slip import Direction, Slip
from dolfinx_contact.analysis.vibrations import DenseBody, body_of, damped, first_order
from dolfinx_contact.equations.measures import require_solution
from dolfinx_contact.reduced.constrained_body import ConstrainedField, saddle, with_dirichlet_rows

__all__ = ["Onset", "SlidingModes", "SteadySliding"]

Complex = npt.NDArray[np.complex128]

_STEADY = {True: 1e-11, False: 1e-7}  # round-off of growth over |lambda|, with damping or not
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
class SlidingModes:
    """Vibrations of a sliding body.

    Attributes:
        eigenvalues: values lambda of vibrations e^{lambda t} with nonnegative imaginary part,
            sorted by decreasing real part (growth), shape (k,).
        known_up_to: magnitude |lambda| (for the undamped body) up to which no eigenvalue is
            missing; infinite if all were computed.
        real, imaginary: displacements of the first vibration, a quarter of a period apart.
    """

    eigenvalues: Complex
    known_up_to: float
    real: fem.Function
    imaginary: fem.Function

    @property
    def growth(self) -> float:
        """Growth rate of the fastest growing vibration."""
        return float(self.eigenvalues[0].real)

    @property
    def frequency(self) -> float:
        """Angular frequency of the fastest growing vibration."""
        return float(self.eigenvalues[0].imag)


@dataclass(frozen=True)
class Onset:
    """Smallest friction at which a vibration begins to grow.

    Attributes:
        friction: friction coefficient.
        frequency: angular frequency of the vibration; 0 for growth without oscillation.
    """

    friction: float
    frequency: float


def _check(a: Arguments) -> None:
    a.count = count(a.count, "count")


def _check_onset(a: Arguments) -> None:
    positive(a.max_friction, "max_friction")
    positive(a.step, "step")


def _check_modes(a: Arguments) -> None:
    if a.friction is not None:
        nonnegative(a.friction, "friction")


class SteadySliding(ReadOnly):
    """Vibrations of a body sliding steadily over an obstacle. Collective.

    Args:
        problem: contact problem, nodal or mixed. A nonlinear bulk is linearised at the displacement
            in the Functions.
        direction: slip direction of the body relative to the obstacle. With a vector, all contact
            points are closed and slip along its tangential part; the default is t = (-n_y, n_x) in
            2D. With ``"solution"``, points slip, stick or are open as in the solution in the
            Functions.
        density: mass density: a number, Constant, Function or UFL expression.
        damping: damping time eta of C = eta K, or a UFL form C(trial, test).
        dense: whether all eigenvalues are computed; by default up to 700 unknowns.
        count: number of eigenvalues nearest to zero that SLEPc computes if not all are computed.

    Raises:
        ValueError: on every rank, for invalid arguments.
    """

    @collective("steady sliding", _check)
    def __init__(
        self,
        problem: Problem,
        direction: Direction = None,
        *,
        density: Any,
        damping: float | ufl.Form = 0.0,
        dense: bool | None = None,
        count: int = 40,
    ):
        eq = static_equations(problem)
        self._eq = eq
        self.comm = eq.comm
        evaluation = problem.evaluate()
        if isinstance(direction, str):
            require_solution(problem)
        self._slip = Slip(eq, direction, evaluation, steady=True)
        self._body = body_of(eq, evaluation.u, density, damping)
        self._damped = self._body.C is not None or self._body.eta > 0
        self._count = count
        rows = [self._slip.N, self._slip.D, self._slip.H]
        self._size = self._body.unknowns - rows[0].getSize()[0] - rows[2].getSize()[0]
        complete = self._size <= _DENSE if dense is None else dense
        self._matrices = DenseBody(self._body, rows) if complete else None
        slopes = [s.answers.unit_bound for s in evaluation.surfaces]
        self._slope = np.concatenate(slopes)[self._slip.places]

    @collective("vibrations", _check_modes)
    @staged("ContactSliding")
    def modes(self, friction: float | None = None) -> SlidingModes:
        """Compute the vibrations. Collective.

        Args:
            friction: coefficient at all slipping points; by default the coefficient of the law.

        Raises:
            ValueError: on every rank, if it is negative, or the law has no coefficient.
            RuntimeError: if SLEPc does not converge.
        """
        values, motions, known_up_to = self._spectrum(friction, vectors=True)
        first = motions[:, 0]
        parts = []
        for name, part in (("real", first.real), ("imaginary", first.imag)):
            f = fem.Function(self._eq.V, name=name)
            f.x.array[: len(part)] = part
            f.x.scatter_forward()
            parts.append(f)
        return SlidingModes(values, known_up_to, *parts)

    @collective("the onset of growth", _check_onset)
    @staged("ContactSliding")
    def onset(self, max_friction: float = 5.0, *, step: float = 0.05) -> Onset | None:
        """Find the smallest friction at which a vibration grows. Collective.

        Args:
            max_friction: largest friction coefficient of the search. Default 5.
            step: increment of the friction coefficient, default 0.05. Maxima of the growth are also
                searched for between two increments; narrower intervals of growth may be missed.

        Returns:
            The onset; None if no vibration grows up to ``max_friction``.

        Raises:
            ValueError: on every rank, for arguments that are not positive.
            RuntimeError: if SLEPc does not converge.
        """
        frictions = [0.0]
        growths = [self._growth(0.0)]
        if growths[0] > 0:
            return self._at(0.0)
        number = int(np.ceil(max_friction / step))
        for friction in max_friction * np.arange(1, number + 1) / number:
            frictions.append(float(friction))
            growths.append(self._growth(float(friction)))
            if growths[-1] <= 0:
                self._look_between(frictions, growths)
            if growths[-1] > 0:
                return self._at(brentq(self._growth, *frictions[-2:], xtol=1e-13, rtol=1e-12))
        return None

    def _look_between(self, frictions: list[float], growths: list[float]) -> None:
        """Replace the last two entries by a maximum of the growth between the last three.

        This requires that the middle growth is the largest and the maximum is positive.

        Args:
            frictions: friction coefficients.
            growths: growth at each friction coefficient (`_growth`).
        """
        if len(growths) < 3 or not growths[-3] < growths[-2] > growths[-1]:
            return
        best = minimize_scalar(
            lambda F: -self._growth(F), bounds=(frictions[-3], frictions[-1]), method="bounded"
        )
        if best.fun < 0:
            frictions[-2:] = [float(best.x)]
            growths[-2:] = [-float(best.fun)]

    def _growth(self, friction: float) -> float:
        """Return the largest ratio of growth rate to |lambda|, less the level of round-off."""
        values, _, _ = self._spectrum(friction)
        ratio = values.real / np.maximum(np.abs(values), np.abs(values).max() * 1e-15)
        return float(ratio.max()) - _STEADY[self._damped]

    def _at(self, friction: float) -> Onset:
        """Return the onset at a critical coefficient, with the frequency just above it."""
        values, _, _ = self._spectrum(friction * (1.0 + 1e-11))
        size = np.maximum(np.abs(values), np.abs(values).max() * 1e-15)
        return Onset(friction, float(values[np.argmax(values.real / size)].imag))

    # -- eigenproblems ---------------------------------------------------------------------------

    def _spectrum(
        self, friction: float | None, *, vectors: bool = False
    ) -> tuple[Complex, Complex, float]:
        """Return eigenvalues by decreasing growth, and the displacements of the vibrations.

        Args:
            friction: coefficient at all slipping points; None for the coefficient of the law.
            vectors: whether displacements are needed.

        Returns:
            Eigenvalues lambda with nonnegative imaginary part, shape (k,); owned displacements,
            shape (n, k), or (n, 0) if they are not needed and all eigenvalues are computed; and the
            magnitude up to which no eigenvalue is missing.
        """
        slopes = self._slope
        if friction is None:
            known = bool(np.isfinite(slopes).all())
            require(self._eq.comm, known, "the law has no friction coefficient: pass friction=")
        else:
            slopes = np.full_like(slopes, friction)
        known_up_to = np.inf
        if self._matrices is None:
            values, motions, known_up_to = self._by_slepc(slopes)
        else:
            values, motions = self._by_matrices(self._matrices, slopes, vectors=vectors)
        # keep Im >= 0, in order: growth up to round-off, then frequency
        values = np.where(np.abs(values.imag) <= 1e-14 * np.abs(values), values.real + 0j, values)
        upper = np.flatnonzero(values.imag >= 0)
        size = np.abs(values).max(initial=0.0) or 1.0
        growth = np.round(values.real[upper] / size, 13)
        order = upper[np.lexsort((values.imag[upper], -growth))]
        return values[order], motions[:, order] if motions.shape[1] else motions, known_up_to

    def _by_matrices(
        self, body: DenseBody, friction: Array, *, vectors: bool
    ) -> tuple[Complex, Complex]:
        """Return all eigenvalues, and displacements on this rank, shape (n, k) or (n, 0)."""
        eta = self._body.eta

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
        """Compute the eigenvalues nearest to zero using SLEPc.

        Returns:
            Eigenvalues lambda, shape (k,); owned displacements, shape (n, k); and the largest
            magnitude |lambda|, without damping if it is proportional to the stiffness.
        """
        SLEPc = optional("slepc4py.SLEPc", "solver")
        slip = self._slip
        body = self._body
        eq = body.eq
        quadratic = body.C is not None
        # [[A, forces^T], [held, 0]] for A = K, C, M; the forces act along N + F D
        G = slip.D.copy()
        F = slip.D.createVecLeft()
        F.array[:] = friction
        G.diagonalScale(F, None)
        G.axpy(1.0, slip.N)
        held = [slip.N, slip.H]
        forces = [G, slip.H]
        matrices = []
        for A, scale in ((body.K, eq.scaling.stiffness), (body.C, 0.0), (body.M, 0.0)):
            if A is not None:
                inside = with_dirichlet_rows(A, eq, scale)
                matrices.append(saddle([ConstrainedField(inside, held, forces)], scale))
                inside.destroy()
        # eigenvalues nearest to zero
        solver: Any
        if quadratic:
            solver = SLEPc.PEP().create(self.comm)
            solver.setOperators(matrices)
            solver.setWhichEigenpairs(SLEPc.PEP.Which.TARGET_MAGNITUDE)
        else:
            solver = SLEPc.EPS().create(self.comm)
            solver.setOperators(*matrices)
            solver.setProblemType(SLEPc.EPS.ProblemType.GNHEP)
            solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        solver.setTarget(0.0)
        solver.setDimensions(min(self._count, self._size))
        solve_eigenproblem(solver, _DEFAULTS)
        # Leave out the infinite eigenvalues of the forces, which have no mass. The highest
        # frequency of a single unknown is an estimate of the highest one of the body.
        highest = float(np.sqrt(body.scale(body.K)))
        highest = max(highest, body.scale(body.C)) if quadratic else highest
        n = eq.owned_sizes[0]
        farthest = 0.0
        real, imaginary = matrices[0].createVecs()
        values: list[complex] = []
        motions = []
        for i in range(solver.getConverged()):
            value = solver.getEigenpair(i, real, imaginary)
            size = float(abs(value) if quadratic else np.sqrt(abs(value)))
            if size > _FINITE * highest:
                continue
            farthest = max(farthest, size)
            both = [value] if quadratic else [*map(complex, damped(np.array([value]), body.eta))]
            values += both
            motions += [real.array_r[:n] + 1j * imaginary.array_r[:n]] * len(both)
        destroy(solver, real, imaginary, *matrices, G, F)
        if not values:
            raise RuntimeError("SLEPc found no vibration: increase -analysis_eps_max_it")
        return np.array(values), np.array(motions).T, farthest

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._slip.destroy()
        self._body.destroy()
