# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Coarse problem of a two-level scheme on the contact surface.

The coarse correction after a sweep of Gauss-Seidel keeps the statuses: sticking points are fixed,
points in contact remain on the obstacle, and the free components satisfy equations G(a) = 0 (open:
r = 0; slip: rt + (F rn + g) e = 0 with the slip direction e). Let the columns of P be hat functions
of the coarse points, truncated at fixed components (Kornhuber, Numer. Math. 69, 1994; Graeser and
Kornhuber, J. Comput. Math. 27, 2009). The correction is a <- a - s P (P^T G' P)^+ P^T G, projected
onto un >= 0, with the first s of 1, 1/2, 1/4 for which the residual does not increase; otherwise
the correction is skipped.

Sweeps in ascending order transport errors along the surface and damp them only as a single level
does (by 0.35 for an operator of order 1), so that the number of sweeps grows with the extent of a
region of one status. Sweeps therefore visit the coarse points first. The remaining points are then
in equilibrium, their errors are almost interpolated by the hat functions, and the number of sweeps
does not grow.

Coarse corrections do not move the boundaries between statuses, and each sweep moves them by one
point only. The initial state is therefore the solution of the contact problem at the coarse points,
with P^T S P, P^T p and averaged friction, obtained by the same method.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.point_problem import PointProblem

__all__ = ["CoarseProblem"]

Array = npt.NDArray[np.float64]
_COARSENING = 2.0  # number of points per coarse point along one direction


def _hats(x: Array) -> Array:
    """Return interpolation weights from coarse points to all points, shape (m, coarse).

    The coarse points are a subset of all points with distances larger than twice the median
    distance of neighbours. Weights decrease linearly with the distance and add up to 1. For
    equidistant points on a line they are the weights of linear interpolation.

    Args:
        x: coordinates of the points, shape (m, any).
    """
    away = np.linalg.norm(x[:, None] - x[None], axis=2)
    others = away + np.diag(np.full(len(x), np.inf))
    spacing = float(np.median(others.min(axis=1))) if len(x) > 1 else 1.0
    width = _COARSENING * spacing
    chosen: list[int] = []
    free = np.ones(len(x), dtype=bool)
    for i in np.lexsort(x.T[::-1]):
        if free[i]:
            chosen.append(int(i))
            free &= away[i] > width * (1 - 1e-6)
    weights = np.maximum(1.0 - away[:, chosen] / width, 0.0)
    unweighted = weights.sum(axis=1) <= 0
    weights[unweighted, away[np.ix_(unweighted, chosen)].argmin(axis=1)] = 1.0
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _linearised(contact: PointProblem, a: Array, r: Array) -> tuple[Array, Array, Array]:
    """Linearise the equations G(a) = 0 for fixed statuses; n = dim m.

    Args:
        contact: reduced problem.
        a: displacements, shape (m, dim).
        r: forces at these displacements, shape (m, dim).

    Returns:
        Residual G (n,), its derivative by the displacements (n, n), and a mask of the free
        components (n,).
    """
    m, d = a.shape
    closed = contact.closed(a, r)
    stuck = contact.stuck(a, r)
    free = np.ones((m, d), dtype=bool)
    free[closed, -1] = False
    free[stuck, :-1] = False
    pressure = np.where(closed, r[:, -1], 0.0)
    radius = contact.radius(pressure)
    grows = np.where(pressure > 0, contact.friction, 0.0)
    slips = ~stuck & (radius > 0)
    G = r.copy()
    J = contact.S.reshape(m, d, m * d).copy()
    shear = contact.augmented(a, r)[:, :-1]
    size = np.linalg.norm(shear, axis=1)
    for i in np.flatnonzero(slips):
        e = -shear[i] / size[i]
        G[i, :-1] += radius[i] * e
        if grows[i] > 0:
            J[i, :-1] += grows[i] * np.outer(e, contact.S[d * i + d - 1])
        if d == 3:
            # The slip direction e depends on the shear force and the slip.
            turn = (np.eye(2) - np.outer(e, e)) * radius[i] / size[i]
            own = slice(d * i, d * i + 2)
            J[i, :-1] -= turn @ contact.S[own]
            J[i, :-1, own] += contact.augmentation[i] * turn
    return G.reshape(-1), J.reshape(m * d, m * d), free.reshape(-1)


class CoarseProblem:
    """Coarse problem of the two-level scheme; see the module.

    Args:
        contact: reduced problem; points without positions are treated as equidistant on a line.
    """

    def __init__(self, contact: PointProblem):
        self._contact = contact
        x = contact.positions
        x = np.arange(contact.number, dtype=float)[:, None] if x is None else x
        self._x = x
        self._hats = _hats(x)
        self._P = np.kron(self._hats, np.eye(contact.dim))

    @property
    def order(self) -> npt.NDArray[np.int_]:
        """Numbers of the points, coarse points first, shape (m,)."""
        first = self._hats.argmax(axis=0)
        return np.concatenate([first, np.setdiff1d(np.arange(len(self._hats)), first)])

    @property
    def contact(self) -> PointProblem:
        """Reduced contact problem at the coarse points."""
        fine = self._contact
        P = self._P
        weight = self._hats.sum(axis=0)
        return PointProblem(
            P.T @ fine.S @ P,
            P.T @ fine.p,
            self._hats.T @ fine.friction / weight,
            self._hats.T @ fine.bound,
            self._hats.T @ fine.augmentation,
            fine.force,
            fine.length,
            (self._hats.T @ self._x) / weight[:, None],
        )

    def prolonged(self, a: Array) -> Array:
        """Interpolate displacements of the coarse points to all points, shape (m, dim)."""
        return np.asarray(self._hats @ a)

    def corrected(self, a: Array, force: float, length: float) -> Array:
        """Return displacements (m, dim) after the coarse correction.

        Args:
            a: displacements before the correction, shape (m, dim).
            force: scale of forces in the measures.
            length: scale of lengths in the measures.
        """
        contact = self._contact
        r = contact.forces(a)
        G, J, free = _linearised(contact, a, r)
        P = np.where(free[:, None], self._P, 0.0)
        coarse, *_ = np.linalg.lstsq(P.T @ J @ P, P.T @ G, rcond=1e-12)
        step = (P @ coarse).reshape(a.shape)
        worst = contact.measure(a, r, force, length).worst
        for part in (1.0, 0.5, 0.25):
            tried = a - part * step
            tried[:, -1] = np.maximum(tried[:, -1], 0.0)
            if contact.measure(tried, contact.forces(tried), force, length).worst <= worst:
                return tried
        return a
