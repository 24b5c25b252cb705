# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The points of segments and triangles that are closest to others.

On a triangle the regions of its corners, edges and inside are distinguished by six products
(Ericson, Real-Time Collision Detection, 2005, section 5.1.5). Barycentric coordinates of what is
on an edge or a corner are exactly zero for the corners that have no part in it.

A search examines few facets: each is covered by balls of at most one radius R, large facets by
balls around their parts. What is at a distance d has its facet among those whose balls have their
centres within d + R.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy

__all__ = ["ClosestFacets", "closest_on"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_FIRST = 8  # balls that are looked at first
_MORE = 4  # factor of their number where these do not decide
_PAIRS = 2**18  # of points and facets that are looked at in one go
_PARTS = 64.0  # balls along the largest extent of a surface, up to which facets are cut


def closest_on(x: Array, corners: Array) -> Array:
    """Barycentric coordinates (n, k) of what is closest to points on simplices, one each.

    Args:
        x: points (n, dim).
        corners: of segments (n, 2, dim) or triangles (n, 3, dim), none of them degenerate.
    """
    return _on_segments(x, corners) if corners.shape[1] == 2 else _on_triangles(x, corners)


def _on_segments(x: Array, corners: Array) -> Array:
    along = corners[:, 1] - corners[:, 0]
    part = _dot(x - corners[:, 0], along) / _dot(along, along)
    part = np.clip(part, 0.0, 1.0)
    return np.stack([1.0 - part, part], axis=1)


def _on_triangles(x: Array, corners: Array) -> Array:
    a, b, c = (corners[:, i] for i in range(3))
    ab, ac = b - a, c - a
    d1, d2 = _dot(ab, x - a), _dot(ac, x - a)
    d3, d4 = _dot(ab, x - b), _dot(ac, x - b)
    d5, d6 = _dot(ab, x - c), _dot(ac, x - c)
    of_c, of_b, of_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    zero, one = np.zeros(len(x)), np.ones(len(x))
    with np.errstate(divide="ignore", invalid="ignore"):
        on_ab, on_ac = d1 / (d1 - d3), d2 / (d2 - d6)
        on_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        inside = np.stack([of_a, of_b, of_c], axis=1) / (of_a + of_b + of_c)[:, None]
    regions = [
        ((d1 <= 0) & (d2 <= 0), (one, zero, zero)),
        ((d3 >= 0) & (d4 <= d3), (zero, one, zero)),
        ((d6 >= 0) & (d5 <= d6), (zero, zero, one)),
        ((of_c <= 0) & (d1 >= 0) & (d3 <= 0), (1 - on_ab, on_ab, zero)),
        ((of_b <= 0) & (d2 >= 0) & (d6 <= 0), (1 - on_ac, zero, on_ac)),
        ((of_a <= 0) & (d4 >= d3) & (d5 >= d6), (zero, 1 - on_bc, on_bc)),
    ]
    found = inside
    for where, parts in reversed(regions):
        found = np.where(where[:, None], np.stack(parts, axis=1), found)
    return found


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


class ClosestFacets:
    """A search for the closest facet and point of a surface, on this rank alone.

    Args:
        points: of the surface (m, dim).
        cells: its facets by their points (k, dim).
    """

    def __init__(self, points: Array, cells: Ints):
        self._corners = points[cells]
        centres, self._owners, self._radius = _covered(self._corners)
        self._tree = scipy.spatial.cKDTree(centres)

    def __call__(self, x: Array) -> tuple[Ints, Array]:
        """The facets (n,) that are closest to points (n, dim), and barycentric coordinates."""
        facets: Ints = np.zeros(len(x), dtype=np.int64)
        parts = np.zeros((len(x), self._corners.shape[1]))
        left = np.arange(len(x))
        count = min(_FIRST, self._tree.n)
        while len(left):
            rest = []
            step = max(_PAIRS // count, 1)
            for some in (left[i : i + step] for i in range(0, len(left), step)):
                facets[some], parts[some], sure = self._among(x[some], count)
                rest.append(some[~sure])
            left = np.concatenate(rest)
            count = min(_MORE * count, self._tree.n)
        return facets, parts

    def _among(self, x: Array, count: int) -> tuple[Ints, Array, npt.NDArray[np.bool_]]:
        """The closest facets among so many balls, and whether there can be no closer one."""
        away, balls = self._tree.query(x, k=range(1, count + 1))
        owners = self._owners[balls]
        points, which = np.nonzero(np.ones_like(owners, dtype=bool))
        parts = closest_on(x[points], self._corners[owners[points, which]])
        feet = np.einsum("pk,pki->pi", parts, self._corners[owners[points, which]])
        distances = np.linalg.norm(x[points] - feet, axis=1).reshape(owners.shape)
        best = np.argmin(distances, axis=1)
        row = np.arange(len(x))
        sure = (distances[row, best] <= away[:, -1] - self._radius) | (count == self._tree.n)
        return owners[row, best], parts.reshape(*owners.shape, -1)[row, best], sure


def _covered(corners: Array) -> tuple[Array, Ints, float]:
    """Balls that cover facets: centres, the facet of each, and a radius that all have."""
    owners = np.arange(len(corners))
    largest = float(np.ptp(corners.reshape(-1, corners.shape[2]), axis=0).max()) / _PARTS
    target = max(largest, 2.0 * float(np.median(_radii(corners))))
    done: list[tuple[Array, Ints]] = []
    while True:
        large = _radii(corners) > target
        done.append((corners[~large].mean(axis=1), owners[~large]))
        if not large.any():
            break
        corners = _halved(corners[large])
        owners = np.repeat(owners[large], 2)
    return np.concatenate([c for c, _ in done]), np.concatenate([o for _, o in done]), target


def _radii(corners: Array) -> Array:
    """Of balls around the centres of facets."""
    away = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2)
    return np.asarray(away.max(axis=1))


def _halved(corners: Array) -> Array:
    """Both halves of each facet, which is cut in the middle of its longest edge."""
    k = corners.shape[1]
    pairs = [(i, j) for i in range(k) for j in range(i + 1, k)]
    lengths = [np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in pairs]
    longest = np.array(pairs)[np.argmax(lengths, axis=0)]
    row = np.arange(len(corners))
    halves = np.repeat(corners, 2, axis=0).reshape(-1, 2, k, corners.shape[2])
    middle = (corners[row, longest[:, 0]] + corners[row, longest[:, 1]]) / 2
    halves[row, 0, longest[:, 0]] = middle
    halves[row, 1, longest[:, 1]] = middle
    return halves.reshape(-1, k, corners.shape[2])
