# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The coarse problem of a two-level scheme on the contact surface.

After a sweep of Gauss-Seidel the statuses are taken as they are: stuck points are held, closed ones
stay on the obstacle, and what is free obeys linear equations G(a) = 0 (open: r = 0; slip:
rt + (F rn + g) e = 0 with the direction e of the slip). With hats P around coarse points, cut off
where the fine problem is held (truncation: Kornhuber, Numer. Math. 69, 1994; Graeser and Kornhuber,
J. Comput. Math. 27, 2009), the correction is a <- a - s P (P^T G' P)^+ P^T G, projected on un >= 0,
with the first s of 1, 1/2, 1/4 at which the residual does not grow; else there is none.

Sweeps in the order of the points carry errors along the surface and damp them there as one level
does (on an operator of order 1 by 0.35): the longer the stretch of a status, the more sweeps. So
they take the coarse points first, and last the others, which are left in equilibrium; what is
between coarse points the hats then say nearly, and counts do not grow.

Corrections of what is free do not move the borders between statuses, and sweeps move them by a
point each. So the scheme begins where the contact problem of the coarse points ends: that of the
hats, with P^T S P, P^T p and friction averaged, solved in the same way.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.point_problem import PointProblem

__all__ = ["CoarseProblem", "hats", "linearised"]

Array = npt.NDArray[np.float64]


def hats(x: Array, coarsening: float) -> Array:
    """Weights (m, coarse) of coarse points, which are some of the points x (m, any).

    Coarse points lie further apart than ``coarsening`` times the distance of neighbours; weights
    fall linearly with the distance and add up to 1. On equidistant points of a line they are those
    of linear interpolation.
    """
    away = np.linalg.norm(x[:, None] - x[None], axis=2)
    others = away + np.diag(np.full(len(x), np.inf))
    spacing = float(np.median(others.min(axis=1))) if len(x) > 1 else 1.0
    width = coarsening * spacing
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


def linearised(contact: PointProblem, a: Array, r: Array) -> tuple[Array, Array, Array]:
    """Residual G (n,), its derivative by the displacements (n, n), and what is free (n,).

    Args:
        contact: the problem.
        a: displacements (m, dim).
        r: the forces there.
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
            # e turns with the shear and the slip.
            turn = (np.eye(2) - np.outer(e, e)) * radius[i] / size[i]
            own = slice(d * i, d * i + 2)
            J[i, :-1] -= turn @ contact.S[own]
            J[i, :-1, own] += contact.augmentation[i] * turn
    return G.reshape(-1), J.reshape(m * d, m * d), free.reshape(-1)


class CoarseProblem:
    """Corrects what sweeps leave behind; see the module.

    Args:
        contact: the problem; without positions its points count as equidistant on a line.
        coarsening: points to one coarse point, along one direction.
    """

    def __init__(self, contact: PointProblem, coarsening: float):
        self._contact = contact
        x = contact.positions
        x = np.arange(contact.number, dtype=float)[:, None] if x is None else x
        self._x = x
        self._hats = hats(x, coarsening)
        self._P = np.kron(self._hats, np.eye(contact.dim))

    @property
    def order(self) -> npt.NDArray[np.int_]:
        """The points, coarse ones first (m,)."""
        first = self._hats.argmax(axis=0)
        return np.concatenate([first, np.setdiff1d(np.arange(len(self._hats)), first)])

    @property
    def contact(self) -> PointProblem:
        """The contact problem of the coarse points."""
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
        """Displacements of the coarse points at the fine ones, (m, dim)."""
        return np.asarray(self._hats @ a)

    def corrected(self, a: Array, force: float, length: float) -> Array:
        """The displacements (m, dim), corrected; measured by a force and a length."""
        contact = self._contact
        r = contact.forces(a)
        G, J, free = linearised(contact, a, r)
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
