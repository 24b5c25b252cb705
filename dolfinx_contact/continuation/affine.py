# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Small dense systems with affine pieces, identical on every rank.

Each point i has k variables w_i (such as displacement and force of a contact point) with

    sum_i M_i w_i = p + gamma q,        w_i in one of a few polyhedral cones.

Each status of the point has a cone: w_i = B z_i with C w_i >= 0. A piece selects one status for
every point; on a piece z and w are affine in gamma. Hence a branch is a chain of segments, whose
ends follow from ratio tests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Mask

__all__ = ["AffinePiece", "AffineSystem", "largest"]


#: Round-off, relative to the largest entry of a state.
TOLERANCE = 1e-10
#: Relative determinant at which a neighbouring piece is nearly singular.
_VANISHING = 1e-10
#: Relative residual of a piece whose updated inverse is not accurate.
_INACCURATE = 1e-11
#: Largest condition number of a piece that is not singular.
_SINGULAR = 1e12


def largest(values: Array) -> float:
    """Return the largest absolute value; 0 for an empty array."""
    return float(np.abs(values).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class AffineSystem:
    """System M w = p + gamma q in the variables w of contact points, confined to cones.

    Each of the m points has k variables and one polyhedral cone for each of its statuses. The cones
    have dimension d; there are N = m d equations.

    Attributes:
        matrix: coefficients M, shape (N, m, k).
        load: constant load p, shape (N,).
        rate: load q for gamma = 1, shape (N,).
        bases: bases B of the subspaces of the cones, shape (m, statuses, k, d), oriented so that
            the determinant of each piece has the same sign as the corresponding determinant of the
            piecewise smooth system.
        inequalities: coefficients C of at most e inequalities C w >= 0 per cone, padded with zero
            rows, shape (m, statuses, e, k).
        classify: function that maps a state outside the cones, shape (m, k), to the statuses of the
            next iteration of Newton's method, shape (m,).
        allowed: mask of the statuses that each point may take, shape (m, statuses).
    """

    matrix: Array
    load: Array
    rate: Array
    bases: Array
    inequalities: Array
    classify: Callable[[Array], Codes]
    allowed: Mask = field(repr=False)

    @property
    def points(self) -> int:
        """Number of contact points of the system."""
        return int(self.bases.shape[0])

    def require_finite(self) -> None:
        """Raise `ValueError` if the coefficients or loads are not finite."""
        if not all(np.isfinite(a).all() for a in (self.matrix, self.load, self.rate)):
            raise ValueError(
                "the stiffness or the loads of the condensed problem are not finite: look for NaN "
                "and overflow in loads, material and Dirichlet data, and gamma"
            )

    def of_codes(self, values: Array, codes: Codes) -> Array:
        """Return, for each point, the entry of an array that belongs to the status of the point.

        Args:
            values: entries for all points and statuses, shape (m, statuses, ...).
            codes: status of each of the m points, shape (m,).
        """
        return np.asarray(values[np.arange(self.points), codes])

    def pieced(self, codes: Codes) -> Array:
        """Return the matrix M B, with the bases B of the cones of ``codes``, shape (N, N)."""
        B = self.of_codes(self.bases, codes)
        return np.einsum("nmk,mkd->nmd", self.matrix, B).reshape(len(self.load), -1)

    def piece(self, codes: Codes) -> AffinePiece | None:
        """Return the affine piece for given statuses; None if its matrix is nearly singular."""
        A = self.pieced(codes)
        try:
            inverse = np.asarray(np.linalg.inv(A), dtype=float)
        except np.linalg.LinAlgError:
            return None
        size = np.abs(inverse).sum(axis=1).max(initial=0.0) * np.abs(A).sum(axis=1).max(initial=0.0)
        if not size < _SINGULAR:
            return None
        return AffinePiece(self, codes, inverse, float(np.linalg.slogdet(A)[0]))

    def slacks(self, codes: Codes, w: Array) -> Array:
        """Return the values C w of the inequalities C w >= 0, shape (m, e); inf for padded rows."""
        C = self.of_codes(self.inequalities, codes)
        values = np.einsum("mek,mk->me", C, w)
        return np.where(np.any(C != 0, axis=2), values, np.inf)

    def step(self, codes: Codes, w: Array, direction: Array) -> float:
        """Return the multiple of a direction at which a state reaches its first border, or inf.

        The state ``w`` lies in the cones of ``codes``; ``w`` and ``direction`` have shape (m, k).
        """
        slack = self.slacks(codes, w)
        rate = self.slacks(codes, direction)
        falling = np.isfinite(slack) & (rate < -TOLERANCE * largest(direction))
        return float(np.min(np.maximum(slack[falling], 0.0) / -rate[falling], initial=np.inf))

    def statuses_at(self, w: Array, tolerance: float) -> Mask:
        """Return a mask of the statuses whose closed cones contain ``w``, shape (m, statuses).

        The variables ``w`` have shape (m, k); distances up to ``tolerance`` count as zero.
        """
        z = np.einsum("msdk,mk->msd", self._left_inverses, w)
        away = np.einsum("mskd,msd->msk", self.bases, z) - w[:, None]
        least = np.einsum("msek,mk->mse", self.inequalities, w).min(axis=2, initial=0.0)
        return np.asarray(
            self.allowed & (np.abs(away).max(axis=2) <= tolerance) & (least >= -tolerance)
        )

    @cached_property
    def largest_entry(self) -> float:
        """Largest absolute entry of the coefficients M."""
        return largest(self.matrix)

    @cached_property
    def _left_inverses(self) -> Array:
        return np.asarray(np.linalg.pinv(self.bases), dtype=float)

    def tangent_cone(self, w: Array, tolerance: float) -> AffineSystem:
        """Return the tangent cone at ``w``: the system of the directions leading out of it.

        A direction changes w by dw and gamma by dgamma, with M dw = dgamma q. A point may take all
        statuses whose cones contain its variables. Only the inequalities that are active at ``w``
        remain.
        """
        slack = np.einsum("msek,mk->mse", self.inequalities, w)
        at_border = np.abs(slack) <= tolerance
        return replace(
            self,
            load=np.zeros_like(self.load),
            inequalities=self.inequalities * at_border[..., None],
            allowed=self.statuses_at(w, tolerance),
        )

    def solve(self, gamma: float, codes: Codes, *, max_iterations: int = 50) -> Codes | None:
        """Compute the statuses of a solution by Newton's method; None if it cycles or fails.

        If the solution lies on the boundary of cones, any of the adjacent statuses may result.

        Args:
            gamma: parameter.
            codes: initial statuses, shape (m,).
            max_iterations: largest number of iterations.
        """
        seen: set[bytes] = set()
        for _ in range(max_iterations):
            if codes.tobytes() in seen:
                return None
            seen.add(codes.tobytes())
            piece = self.piece(codes)
            if piece is None:
                return None
            w = piece.at(gamma)
            if self.slacks(codes, w).min(initial=np.inf) >= -TOLERANCE * largest(w):
                return codes
            wanted = self.classify(w)
            allowed = self.allowed[np.arange(self.points), wanted]
            codes = np.where(allowed, wanted, codes).astype(np.int8)
        return None


@dataclass(frozen=True, eq=False)
class AffinePiece:
    """Affine system with fixed statuses; its solution w_0 + gamma w_1 is affine in gamma.

    Attributes:
        system: piecewise affine system, with m points and N equations.
        codes: statuses of the points, shape (m,).
        inverse: inverse of the matrix M B of the piece (`AffineSystem.pieced`), shape (N, N).
        sign: sign of the determinant of M B.
    """

    system: AffineSystem
    codes: Codes
    inverse: Array
    sign: float

    @cached_property
    def coefficients(self) -> tuple[Array, Array]:
        """Coefficients w_0 and w_1 of the solution w_0 + gamma w_1, shape (m, k) each."""
        s = self.system
        z = self.inverse @ np.stack([s.load, s.rate], axis=1)
        B = s.of_codes(s.bases, self.codes)
        w = np.matmul(B, z.reshape(s.points, -1, 2))
        return w[:, :, 0], w[:, :, 1]

    def at(self, gamma: float) -> Array:
        """Return the variables of all points at the parameter ``gamma``, shape (m, k)."""
        w_0, w_1 = self.coefficients
        return w_0 + gamma * w_1

    def neighbour(self, point: int, code: int) -> AffinePiece | None:
        """Return the piece in which ``point`` has the status ``code``; None if it is singular.

        The inverse is updated by a matrix whose rank is the number d of coordinates of a point
        (Woodbury formula), which costs N^2 d operations for N equations. If the result is not
        accurate, the matrix is inverted.
        """
        s = self.system
        codes = self.codes.copy()
        codes[point] = code
        d = s.bases.shape[3]
        columns = slice(point * d, (point + 1) * d)
        change = s.bases[point, code] - s.bases[point, self.codes[point]]
        V = self.inverse @ (s.matrix[:, point] @ change)
        small = np.eye(d) + V[columns]
        factor = float(np.linalg.det(small))
        if abs(factor) <= _VANISHING * max(1.0, largest(small)) ** d:
            return s.piece(codes)
        inverse = self.inverse - V @ np.linalg.solve(small, self.inverse[columns])
        moved = AffinePiece(s, codes, inverse, self.sign * float(np.sign(factor)))
        w = np.stack(moved.coefficients, axis=2).reshape(-1, 2)
        residual = s.matrix.reshape(len(s.load), -1) @ w - np.stack([s.load, s.rate], axis=1)
        accurate = largest(residual) <= _INACCURATE * s.largest_entry * largest(w)
        return moved if accurate else s.piece(codes)
