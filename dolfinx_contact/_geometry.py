# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors and facets: products by row, unit vectors, area vectors and their derivatives."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["area_vector_rates", "area_vectors", "dot", "edges_of", "unit"]

Array = npt.NDArray[np.float64]

_TINY = 1e-300  # length, below which a vector is left as it is


def dot(a: Array, b: Array) -> Array:
    """Scalar products (...) of vectors (..., dim)."""
    return np.asarray(np.sum(a * b, axis=-1))


def unit(v: Array) -> Array:
    """Vectors (..., dim) of length one; zero vectors remain zero."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), _TINY))


def area_vectors(x: Array) -> Array:
    """Area vectors of facets (n, k, dim), of one sense in the order of their corners."""
    if x.shape[2] == 2:
        along = x[:, 1] - x[:, 0]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    first, second = edges_of(x)
    return np.asarray(0.5 * np.cross(first, second))


def area_vector_rates(x: Array) -> Array:
    """Derivatives of `area_vectors` by the corners (n, dim, k, dim)."""
    n, k, dim = x.shape
    rates = np.zeros((n, dim, k, dim))
    if dim == 2:
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        rates[:, :, 0] = -turn
        rates[:, :, 1] = turn
        return rates
    first, second = edges_of(x)
    (a, b), (c, d) = ((1, 0), (2, 0)) if k == 3 else ((3, 0), (2, 1))
    by_first = -0.5 * _crossing(second)
    by_second = 0.5 * _crossing(first)
    rates[:, :, a] += by_first
    rates[:, :, b] -= by_first
    rates[:, :, c] += by_second
    rates[:, :, d] -= by_second
    return rates


def edges_of(x: Array) -> tuple[Array, Array]:
    """Two edges of triangles, the diagonals of quadrilaterals in tensor order; in space."""
    if x.shape[1] == 3:
        return x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    return x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]


def _crossing(v: Array) -> Array:
    """Matrices (n, 3, 3) of the product v x."""
    found = np.zeros((len(v), 3, 3))
    found[:, 0, 1] = -v[:, 2]
    found[:, 0, 2] = v[:, 1]
    found[:, 1, 2] = -v[:, 0]
    return found - found.transpose(0, 2, 1)
