# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Rays from points of a face along its normals to facets of another one, and their derivatives.

A point x = sum_a N_a x_a of a slave facet has the normal n = m / |m|, m = sum_a N_a m_a, of the
vectors m_a at its nodes, each the sum of the area vectors of the facets around it. The ray from x
along n meets the facet y(eta) = sum_b N_b(eta) y_b of the master at

    x + g n = y(eta),

which gives the gap g and the place eta. With the columns Y_i = dy/deta_i the derivatives along
displacements dx_a, dy_b and changes dm_a solve

    [Y | -n] (deta, dg) = dx - sum_b N_b dy_b + g dn,    dn = (I - n n^T) dm / |m|

(Poulios and Renard, Comput. Struct. 153, 2015, section 3, with the normals of the slave).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.points.clipping import basis

__all__ = ["CastRays", "cast", "slopes"]

Array = npt.NDArray[np.float64]
_STEPS = 25
_FOUND = 1e-12  # relative to the facet, a step of Newton's method after which none is needed


@dataclass(frozen=True, eq=False)
class CastRays:
    """Rays of some pieces of facets, p, with q points each.

    Attributes:
        normal: n (p, q, dim).
        length: |m| (p, q).
        gap: g (p, q).
        weights: of the nodes of the master, N_b(eta) (p, q, b).
        slopes: their derivatives by eta (p, q, b, dim - 1).
        inverse: of [Y | -n] (p, q, dim, dim).
    """

    normal: Array
    length: Array
    gap: Array
    weights: Array
    slopes: Array
    inverse: Array

    @property
    def by_normal(self) -> Array:
        """dn/dm (p, q, dim, dim)."""
        n = self.normal
        along = n[..., :, None] * n[..., None, :]
        return np.asarray((np.eye(n.shape[-1]) - along) / self.length[..., None, None])


def cast(x: Array, m: Array, y: Array, eta: Array) -> CastRays:
    """Where rays meet facets.

    Args:
        x: their starts (p, q, dim).
        m: normals there, of any length (p, q, dim).
        y: nodes of the facets of the master (p, b, dim).
        eta: places where they may meet (p, q, dim - 1).
    """
    dim = x.shape[-1]
    corners = y.shape[1]
    length = np.linalg.norm(m, axis=-1)
    n = m / length[..., None]
    eta = eta.copy()
    gap = np.zeros(x.shape[:2])
    for _ in range(_STEPS):
        weights = basis(eta, corners, 1)
        by_eta = slopes(eta, corners)
        matrix = np.concatenate([np.einsum("pqbi,pbd->pqdi", by_eta, y), -n[..., None]], axis=-1)
        off = x + gap[..., None] * n - np.einsum("pqb,pbd->pqd", weights, y)
        step = np.linalg.solve(matrix, off[..., None])[..., 0]
        eta += step[..., : dim - 1]
        gap += step[..., -1]
        if np.max(np.abs(step[..., : dim - 1]), initial=0.0) <= _FOUND:
            break
    weights = basis(eta, corners, 1)
    by_eta = slopes(eta, corners)
    matrix = np.concatenate([np.einsum("pqbi,pbd->pqdi", by_eta, y), -n[..., None]], axis=-1)
    return CastRays(n, length, gap, weights, by_eta, np.linalg.inv(matrix))


def slopes(eta: Array, corners: int) -> Array:
    """Derivatives of the basis of a facet at places (p, q, dim - 1), (p, q, corners, dim - 1)."""
    if corners == 2:
        constant = np.array([[-1.0], [1.0]])
    elif corners == 3:
        constant = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    else:
        a = eta[..., 0]
        b = eta[..., 1]
        by_a = np.stack([b - 1, 1 - b, -b, b], axis=-1)
        by_b = np.stack([a - 1, -a, 1 - a, a], axis=-1)
        return np.stack([by_a, by_b], axis=-1)
    return np.asarray(np.broadcast_to(constant, (*eta.shape[:-1], *constant.shape)))
