# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Systems whose pieces are affine: few unknowns, dense, the same on every rank.

At point i live k numbers w_i (displacements and reactions of a contact point, say), bound by

    sum_i M_i w_i = p + gamma q,        w_i in one of a few polyhedral cones,

and each cone is a status of the point: w_i = B z_i with C w_i >= 0. A piece is one status for
every point; there z, and with it w, is affine in gamma. So a branch is a chain of segments whose
ends are found by ratio tests, and no Newton's method and no step length is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

__all__ = ["AffinePiece", "AffineSystem", "largest"]

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]

#: Round-off, relative to the largest entry of a state.
TOLERANCE = 1e-10
#: Entries of an inverse beyond which, relative to those of the matrix, a piece counts as singular.
_SINGULAR = 1e12


def largest(values: Array) -> float:
    """The largest absolute value; 0 of none."""
    return float(np.abs(values).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class AffineSystem:
    """M w = p + gamma q with w in cones, point by point.

    Attributes:
        matrix: M, (N, m, k) for m points, N = m d.
        load: p, (N,).
        rate: q, (N,).
        bases: B, (m, statuses, k, d), oriented so that the determinants of the pieces have the
            signs of those of the piecewise smooth system that this one represents.
        inequalities: C, (m, statuses, e, k); rows of zeros fill up.
        classify: statuses that a state (m, k) outside of the cones determines, to start Newton's
            method of.
        allowed: (m, statuses), which statuses a point may take at all.
    """

    matrix: Array
    load: Array
    rate: Array
    bases: Array
    inequalities: Array
    classify: Callable[[Array], Codes]
    allowed: npt.NDArray[np.bool_] = field(repr=False)

    @property
    def points(self) -> int:
        """Number of points."""
        return int(self.bases.shape[0])

    def require_finite(self) -> None:
        """Raise ``ValueError`` if a number is not finite: nothing can be proved with such data."""
        if not all(np.isfinite(a).all() for a in (self.matrix, self.load, self.rate)):
            raise ValueError(
                "the stiffness or the loads of the condensed problem are not finite: look for NaN "
                "and overflow in loads, material and Dirichlet data, and gamma"
            )

    def pieced(self, codes: Codes) -> Array:
        """A = M B of the piece, (N, N)."""
        B = self.bases[np.arange(self.points), codes]
        return np.einsum("nmk,mkd->nmd", self.matrix, B).reshape(len(self.load), -1)

    def piece(self, codes: Codes) -> AffinePiece | None:
        """The piece, or None if it is singular."""
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
        """C w of the statuses ``codes``, (m, e); infinite where there is no inequality."""
        C = self.inequalities[np.arange(self.points), codes]
        values = np.einsum("mek,mk->me", C, w)
        return np.where(np.any(C != 0, axis=2), values, np.inf)

    def step(self, codes: Codes, w: Array, direction: Array) -> float:
        """Distance along a direction to the first border of a piece; infinite if there is none."""
        slack = self.slacks(codes, w)
        rate = self.slacks(codes, direction)
        falling = np.isfinite(slack) & (rate < -TOLERANCE * largest(direction))
        return float(np.min(np.maximum(slack[falling], 0.0) / -rate[falling], initial=np.inf))

    def statuses_at(self, w: Array, tolerance: float) -> npt.NDArray[np.bool_]:
        """Which statuses hold every point of the state ``w``, borders included, (m, statuses)."""
        z = np.einsum("msdk,mk->msd", self._left_inverses, w)
        away = np.einsum("mskd,msd->msk", self.bases, z) - w[:, None]
        least = np.einsum("msek,mk->mse", self.inequalities, w).min(axis=2, initial=0.0)
        return np.asarray(
            self.allowed & (np.abs(away).max(axis=2) <= tolerance) & (least >= -tolerance)
        )

    def statuses_of(self, i: int, w: Array, tolerance: float) -> npt.NDArray[np.bool_]:
        """Which statuses hold one point with the numbers ``w``, (statuses,)."""
        z = self._left_inverses[i] @ w
        away = np.einsum("skd,sd->sk", self.bases[i], z) - w
        least = (self.inequalities[i] @ w).min(axis=1, initial=0.0)
        near = np.abs(away).max(axis=1) <= tolerance
        return np.asarray(self.allowed[i] & near & (least >= -tolerance))

    @cached_property
    def _largest(self) -> float:
        return largest(self.matrix)

    @cached_property
    def _flat(self) -> Array:
        return self.matrix.reshape(len(self.load), -1)

    @cached_property
    def _left_inverses(self) -> Array:
        return np.asarray(np.linalg.pinv(self.bases), dtype=float)

    def tangent_cone(self, w: Array, tolerance: float) -> AffineSystem:
        """The system of the directions that lead out of the state ``w``: M dw = dgamma q.

        Points keep the statuses that hold them at ``w``, and of those the inequalities that are at
        their border; what is inside its cone is free.
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
        """Statuses of a solution at ``gamma`` by Newton's method from ``codes``; None if it cycles.

        Where the solution lies on a border of its cones any of the statuses may come out.
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
            held = self.allowed[np.arange(self.points), wanted]
            codes = np.where(held, wanted, codes).astype(np.int8)
        return None


@dataclass(frozen=True, eq=False)
class AffinePiece:
    """One piece: w = w_0 + gamma w_1.

    Attributes:
        system: whose piece it is.
        codes: statuses of the points.
        inverse: A^{-1}, (N, N).
        sign: of det A.
    """

    system: AffineSystem
    codes: Codes
    inverse: Array
    sign: float

    @cached_property
    def coefficients(self) -> tuple[Array, Array]:
        """w_0 and w_1, (m, k) each."""
        s = self.system
        z = self.inverse @ np.stack([s.load, s.rate], axis=1)
        B = s.bases[np.arange(s.points), self.codes]
        w = np.matmul(B, z.reshape(s.points, -1, 2))
        return w[:, :, 0], w[:, :, 1]

    @cached_property
    def slack_coefficients(self) -> tuple[Array, Array]:
        """C w = s_0 + gamma s_1 of the inequalities, (m, e) each; s_0 infinite where none is."""
        w_0, w_1 = self.coefficients
        C = self.system.inequalities[np.arange(self.system.points), self.codes]
        s_0, s_1 = (np.matmul(C, w[:, :, None])[:, :, 0] for w in (w_0, w_1))
        return np.where(np.any(C != 0, axis=2), s_0, np.inf), s_1

    def at(self, gamma: float) -> Array:
        """The state at ``gamma``, (m, k)."""
        w_0, w_1 = self.coefficients
        return w_0 + gamma * w_1

    def neighbour(self, points: npt.NDArray[np.int64], codes: Codes) -> AffinePiece | None:
        """The piece in which ``points`` have the status ``codes``; None if it is singular.

        The inverse is brought up to date by the columns that change.
        """
        s = self.system
        new = self.codes.copy()
        new[points] = codes
        d = s.bases.shape[3]
        columns = (points[:, None] * d + np.arange(d)).reshape(-1)
        change = s.bases[points, new[points]] - s.bases[points, self.codes[points]]
        U = np.concatenate(
            [s.matrix[:, i] @ c for i, c in zip(points, change, strict=True)], axis=1
        )
        V = self.inverse @ U
        small = np.eye(len(columns)) + V[columns]
        determinant = float(np.linalg.det(small))
        if abs(determinant) <= 1e-10 * max(1.0, largest(small)) ** len(columns):
            return s.piece(new)
        inverse = self.inverse - V @ np.linalg.solve(small, self.inverse[columns])
        moved = AffinePiece(s, new, inverse, self.sign * float(np.sign(determinant)))
        w = np.stack(moved.coefficients).reshape(2, -1)
        residual = s._flat @ w.T - np.stack([s.load, s.rate], axis=1)
        size = s._largest * largest(w)
        return moved if largest(residual) <= 1e-11 * size else s.piece(new)
