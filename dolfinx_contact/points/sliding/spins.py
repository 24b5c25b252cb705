# SPDX-License-Identifier: LGPL-3.0-or-later
r"""By which angle facets in space have turned about their own normals, and its derivatives.

With two vectors a_i across the normal o of a facet before, the reciprocal ones a^i, these turned
by the smallest rotation from o to the normal n of now, g_i = R a^i, and the vectors e_i of now, the
facet has been stretched and turned by F = sum_i e_i g_i^T. The rotation of its polar decomposition
is that about n by the angle

    tan psi = s / c,    s = n . sum_i g_i x e_i,    c = sum_i g_i . e_i.

Normal parts of changes of e_i do not count. Where n turns, R turns about it by the part
n.(o x dn)/(1 + o.n), and psi is less by that.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import area_vector_rates, area_vectors, edges_of
from dolfinx_contact.points.kinematics import rotation

__all__ = ["spins"]

Array = npt.NDArray[np.float64]


def spins(before: Array, now: Array, sense: Array) -> tuple[Array, Array]:
    """Angles about the outward normals (n,), and derivatives by the corners of now (n, k, dim).

    They are zero in the plane.

    Args:
        before: corners of facets (n, k, dim).
        now: likewise.
        sense: 1 or -1, of their area vectors (n,).
    """
    n, k, dim = now.shape
    if dim == 2:
        return np.zeros(n), np.zeros((n, k, dim))
    m = sense[:, None] * area_vectors(now)
    length = np.linalg.norm(m, axis=1, keepdims=True)
    normal = m / length
    o = sense[:, None] * area_vectors(before)
    o /= np.linalg.norm(o, axis=1, keepdims=True)
    a, b = edges_of(before)
    volume = np.sum(o * np.cross(a, b), axis=1)[:, None]
    reciprocal = np.stack([np.cross(b, o) / volume, np.cross(o, a) / volume], axis=1)
    g = np.einsum("nij,nkj->nki", rotation(o, normal), reciprocal)
    e = np.stack(edges_of(now), axis=1)
    across = np.cross(normal[:, None], g)
    c = np.sum(g * e, axis=(1, 2))
    s = np.sum(across * e, axis=(1, 2))
    by_edges = (c[:, None, None] * across - s[:, None, None] * g) / (c**2 + s**2)[:, None, None]
    by_corners = np.zeros((n, k, dim))
    starts, ends = ((0, 0), (1, 2)) if k == 3 else ((0, 1), (3, 2))
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        by_corners[:, end] += by_edges[:, i]
        by_corners[:, start] -= by_edges[:, i]
    by_normal = np.cross(o, normal) / (1.0 + np.sum(o * normal, axis=1))[:, None]
    rates = sense[:, None, None, None] * area_vector_rates(now)
    by_corners += np.einsum("ni,nikj->nkj", by_normal / length, rates)
    return np.arctan2(s, c), by_corners
