# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The problem at contact points in terms of its compliance, which may be singular.

FCLib and Siconos state the contact problem of m points as (Acary and Brogliato, Numerical Methods
for Nonsmooth Dynamical Systems, Springer 2008)

    u = W r + q,    0 <= u_n  against  r_n >= 0,    |r_t| <= F r_n,    r_t = -F r_n u_t/|u_t| .

u are relative velocities or displacements, r forces on the body. W is symmetric and positive
semidefinite. If W is regular, S = W^-1 and p = S q give a `PointProblem`. W is singular if
equilibrium does not determine the contact forces, as in many systems of rigid bodies (hyperstatic
problems). Two algorithms solve singular problems too:

- nonsmooth Gauss-Seidel: each point is solved exactly for its own force, with the other forces held
  (Jean, CMAME 177, 1999). It stops when the violation of the law, measured in every tenth sweep, is
  below the tolerance. It may converge slowly, and it may fail for large friction; it then returns
  the last forces with their violation.
- Lemke's method in 2D (`lemke`). Its proof of termination requires a positive definite W. With a
  singular W it may end in a ray, which says nothing about the existence of solutions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._validate import one_of
from dolfinx_contact.algorithms.lemke import forces_by_lemke, tangents
from dolfinx_contact.algorithms.one_point import OnePoint
from dolfinx_contact.laws import coulomb
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["LocalProblem", "LocalSolution"]

_ZERO = 1e-12  # eigenvalues of W, over the largest one, that count as zero
_ASYMMETRY = 1e-3  # of the largest entry of W, up to which it counts as symmetric
_NEGATIVE = 1e-6  # of the largest eigenvalue of W, up to which a negative one counts as zero
_CHECKED = 10  # sweeps between two measurements of the violation


@dataclass(frozen=True, eq=False)
class LocalProblem:
    """u = W r + q with Signorini's conditions and Coulomb friction at m points.

    Args:
        W: compliance (dim m, dim m), ordered point by point, tangents before the normal; symmetric
            up to 1e-3, and positive semidefinite. It is symmetrised; see `asymmetry`.
        q: relative velocities or displacements without contact forces (dim m,).
        friction: friction coefficients F >= 0 (m,).

    Attributes:
        asymmetry: largest difference of W from its transpose, over its largest entry. Forces that
            solve the symmetrised problem violate the original one by about as much.

    Raises:
        ValueError: if shapes do not match, a number is not finite, a coefficient is negative, W is
            not symmetric or not positive semidefinite, or the compliance of a single point is not
            positive definite.

    Example:
        ::

            problem = load_local("FrictionContactProblem00394.dat")
            solution = problem.solve()
            print(solution.violation, problem.reaction_freedom(solution))
    """

    W: Array
    q: Array
    friction: Array
    asymmetry: float = field(init=False)

    def __post_init__(self) -> None:
        m = np.size(self.friction)
        n = (3 if np.size(self.q) == 3 * m else 2) * m
        for name, shape in (("W", (n, n)), ("q", (n,)), ("friction", (m,))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if m == 0 or value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} must be finite numbers of shape {shape}")
            object.__setattr__(self, name, value)
        if (self.friction < 0).any():
            raise ValueError("friction must not be negative")
        largest = float(np.abs(self.W).max()) or 1.0
        asymmetry = float(np.abs(self.W - self.W.T).max()) / largest
        if asymmetry > _ASYMMETRY:
            raise ValueError(
                f"W is not symmetric: it differs from its transpose by {asymmetry:.2g}"
            )
        object.__setattr__(self, "asymmetry", asymmetry)
        object.__setattr__(self, "W", (self.W + self.W.T) / 2)
        values = np.linalg.eigvalsh(self.W)
        if values[0] < -_NEGATIVE * values[-1]:
            raise ValueError(f"W has the negative eigenvalue {values[0]:.3g}")
        if not (np.linalg.eigvalsh(self._blocks)[:, 0] > 0).all():
            raise ValueError("the compliance of a point is not positive definite")

    @property
    def number(self) -> int:
        """Number m of points."""
        return len(self.friction)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(self.q) // self.number

    @cached_property
    def rank(self) -> int:
        """Number of eigenvalues of W above 1e-12 of the largest one."""
        values = np.linalg.eigvalsh(self.W)
        return int((values > _ZERO * values[-1]).sum())

    @property
    def _blocks(self) -> Array:
        """Compliance of every point alone (m, dim, dim)."""
        m, d = self.number, self.dim
        every = np.arange(m)
        return np.asarray(self.W.reshape(m, d, m, d)[every, :, every])

    def points(self) -> PointProblem:
        """Return the same problem in terms of its stiffness S = W^-1.

        Raises:
            ValueError: if W is singular.
        """
        if self.rank < len(self.q):
            raise ValueError(
                f"the compliance is singular (rank {self.rank} of {len(self.q)}): the forces of "
                "rigid bodies are not determined; use LocalProblem.solve"
            )
        S = np.linalg.inv(self.W)
        return PointProblem((S + S.T) / 2, S @ self.q, self.friction)

    def velocities(self, r: Array) -> Array:
        """Return u = W r + q for forces r of shape (m, dim)."""
        return (self.W @ r.reshape(-1) + self.q).reshape(r.shape)

    def violation(self, r: Array) -> float:
        """Return the violation of the law by forces (m, dim), relative to the largest force.

        It is |r - P(r - k u)| with the projection P onto the friction cone (`laws.coulomb`) and the
        mean stiffness k of the points; 0 at a solution.
        """
        k = self._stiffness
        none = np.zeros(self.number)
        answer = coulomb.allowed(r - k * self.velocities(r), self.friction, none)
        size = max(float(np.abs(r).max()), k * float(np.abs(self.q).max())) or 1.0
        return float(np.abs(r - answer).max()) / size

    @property
    def _stiffness(self) -> float:
        return float(1.0 / np.diag(self.W).mean())

    def solve(
        self,
        algorithm: Literal["gauss-seidel", "lemke"] = "gauss-seidel",
        *,
        tolerance: float = 1e-10,
        max_iterations: int = 20000,
    ) -> LocalSolution:
        """Find one solution; W may be singular.

        Args:
            algorithm: "gauss-seidel" (default), or "lemke" in 2D.
            tolerance: violation at which Gauss-Seidel stops; default: 1e-10.
            max_iterations: largest number of sweeps; default: 20000.

        Returns:
            The forces, also if the tolerance was not reached; see `LocalSolution.violation`.

        Raises:
            RayTermination: if Lemke's method ends in a ray.
            ValueError: for an unknown algorithm, and for Lemke's method in 3D.
        """
        one_of(algorithm, "algorithm", ("gauss-seidel", "lemke"))
        if algorithm == "lemke":
            r, iterations = self._by_lemke()
        else:
            r, iterations = self._by_sweeps(tolerance, max_iterations)
        return LocalSolution(algorithm, r, self.velocities(r), self.violation(r), iterations)

    def _by_sweeps(self, tolerance: float, max_iterations: int) -> tuple[Array, int]:
        """Return forces (m, dim) by Gauss-Seidel, and the number of sweeps."""
        stiffness: list[Array] = list(np.linalg.inv(self._blocks))
        points = [OnePoint(k, F, 0.0) for k, F in zip(stiffness, self.friction, strict=True)]
        m, d = self.number, self.dim
        rows = np.ascontiguousarray(self.W.reshape(m, d, m * d))
        forces = np.zeros(m * d)
        violation = self.violation(forces.reshape(m, d))
        sweep = 0
        while violation > tolerance and sweep < max_iterations:
            for i in range(m):
                place = slice(d * i, d * i + d)
                # Equilibrium of the point, K a = r + K c, with c from the forces of the others.
                c = self.q[place] + rows[i] @ forces - rows[i][:, place] @ forces[place]
                load = stiffness[i] @ c
                forces[place] = stiffness[i] @ np.array(points[i].solve(load)) - load
            sweep += 1
            if sweep % _CHECKED == 0:
                violation = self.violation(forces.reshape(m, d))
        return forces.reshape(m, d), sweep

    def _by_lemke(self) -> tuple[Array, int]:
        """Return forces (m, 2) by Lemke's method, and the number of pivots."""
        if self.dim != 2:
            raise ValueError("Lemke's method needs a plane problem; use 'gauss-seidel'")
        k = self._stiffness
        length = float(np.abs(self.q).max()) or 1.0
        free = np.asarray((self.q / length).reshape(self.number, 2), np.float64)
        none = np.zeros(self.number)
        r, pivots = forces_by_lemke(self.W * k, free, self.friction, none, tangents(2, 2))
        return r * k * length, pivots

    def reaction_freedom(self, solution: LocalSolution, tolerance: float = 1e-8) -> int:
        """Return the dimension of the set of forces near a solution with the same velocities.

        This is the dimension of the kernel of W in the directions that the statuses leave: none at
        open points, along the edge of the cone at slipping points, and all at sticking points. 0
        means that the velocities determine the forces. Points on the border of a status count with
        the status that was found.

        Args:
            solution: solution of this problem.
            tolerance: velocities and forces that count as zero, relative to the largest ones.
        """
        size = np.abs(solution.r).max() or 1.0
        moving = tolerance * max(float(np.abs(solution.u).max()), float(np.abs(self.q).max()))
        columns = []
        for i in range(self.number):
            if solution.r[i, -1] <= tolerance * size:
                continue
            slip = solution.u[i, :-1]
            speed = float(np.linalg.norm(slip))
            directions = np.eye(self.dim)
            if self.friction[i] == 0:
                directions = directions[:, -1:]
            elif speed > moving:
                directions = np.append(-self.friction[i] * slip / speed, 1.0)[:, None]
            full = np.zeros((len(self.q), directions.shape[1]))
            full[self.dim * i : self.dim * (i + 1)] = directions
            columns.append(full)
        if not columns:
            return 0
        B = np.concatenate(columns, axis=1)
        values = np.linalg.eigvalsh(B.T @ self.W @ B)
        return int((values <= _ZERO * np.linalg.norm(self.W, 2)).sum())


@dataclass(frozen=True, eq=False)
class LocalSolution:
    """One solution of a `LocalProblem`.

    Attributes:
        algorithm: name of the algorithm.
        r: forces on the body (m, dim), tangents before the normal.
        u: relative velocities or displacements (m, dim).
        violation: violation of the law, over the largest force.
        iterations: number of sweeps or pivots.
    """

    algorithm: str
    r: Array
    u: Array
    violation: float
    iterations: int
