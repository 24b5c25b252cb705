# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The points of segments and triangles that are closest to others.

On a triangle the regions of its corners, edges and inside are distinguished by six products
(Ericson, Real-Time Collision Detection, 2005, section 5.1.5). Barycentric coordinates of what is
on an edge or a corner are exactly zero for the corners that have no part in it. Three of the
products are differences of the order of the fourth power of the longest edge; of slivers, whose
area squared is far less, they are those of the area vector with parts of it instead.

A search examines few facets: each is covered by balls of radii r, large facets by balls around
their parts. What is at a distance d has its facet among those whose balls have their centres within
d + r. The facets of the nearest balls bound d; where others may be closer they are examined too.
"""

from __future__ import annotations

from itertools import chain

import numpy as np
import numpy.typing as npt
import scipy

from dolfinx_contact.rigid_surfaces.normals import crossed

__all__ = ["ClosestFacets", "closest_on"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_FIRST = 8  # balls whose facets bound the distance
_LARGER = 1.0 + 1e-12  # round-off of distances
_PAIRS = 2**18  # of points and facets that are looked at in one go
_THIN = 1e-4  # of squares of edges, squared, an area squared that is a sliver's
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
    squares = _dot(ab, ab), _dot(ac, ac)
    thin = np.flatnonzero(squares[0] * squares[1] - _dot(ab, ac) ** 2 < _THIN * sum(squares) ** 2)
    if len(thin):
        of_a[thin], of_b[thin], of_c[thin] = _areas(x[thin], corners[thin])
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


def _areas(x: Array, corners: Array) -> tuple[Array, Array, Array]:
    """Products of the area vectors of triangles with those of their parts opposite to corners."""
    across = crossed(corners)
    off = corners - x[:, None]
    # In the plane of the triangle, where it is close to what is far above.
    squares = _dot(across, across)
    squares[squares == 0] = 1.0  # of a segment
    height = np.einsum("nki,ni->nk", off, across) / squares[:, None]
    off = off - height[..., None] * across[:, None]
    parts = np.asarray(np.cross(off[:, [1, 2, 0]], off[:, [2, 0, 1]]), dtype=np.float64)
    a, b, c = _dot(across[:, None], parts).T
    return a, b, c


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
        self._centres, self._owners, self._radii = _covered(self._corners)
        self._largest = float(self._radii.max())
        self._tree = scipy.spatial.cKDTree(self._centres)

    def __call__(self, x: Array) -> tuple[Ints, Array]:
        """The facets (n,) that are closest to points (n, dim), and barycentric coordinates."""
        count = min(_FIRST, self._tree.n)
        away, balls = self._tree.query(x, k=range(1, count + 1))
        facets, parts, distance = self._among(x, balls.reshape(-1), np.full(len(x), count))
        within = _LARGER * (distance + self._largest)
        left = np.flatnonzero((away[:, -1] < within) & (count < self._tree.n))
        sizes = self._tree.query_ball_point(x[left], within[left], return_length=True)
        groups = np.cumsum(sizes) // _PAIRS
        for some in np.split(left, np.flatnonzero(np.diff(groups)) + 1):
            found = self._tree.query_ball_point(x[some], within[some])
            balls = np.fromiter(chain.from_iterable(found), dtype=np.int64)
            points = np.repeat(some, [len(f) for f in found])
            apart = np.linalg.norm(x[points] - self._centres[balls], axis=1)
            near = apart <= _LARGER * (distance[points] + self._radii[balls])
            sizes = np.bincount(points[near], minlength=len(x))[some]
            facets[some], parts[some], _ = self._among(x[some], balls[near], sizes)
        return facets, parts

    def _among(self, x: Array, balls: Ints, sizes: Ints) -> tuple[Ints, Array, Array]:
        """The closest facets among those of balls, so many point by point, and distances."""
        owners = self._owners[balls]
        points = np.repeat(np.arange(len(x)), sizes)
        parts = closest_on(x[points], self._corners[owners])
        feet = np.einsum("pk,pki->pi", parts, self._corners[owners])
        distances = np.linalg.norm(x[points] - feet, axis=1)
        first = np.cumsum(sizes) - sizes
        best = np.lexsort((owners, distances, points))[first]
        return owners[best], parts[best], distances[best]


def _covered(corners: Array) -> tuple[Array, Ints, Array]:
    """Balls that cover facets: their centres, the facet of each, and their radii."""
    owners = np.arange(len(corners))
    largest = float(np.ptp(corners.reshape(-1, corners.shape[2]), axis=0).max()) / _PARTS
    target = max(largest, 2.0 * float(np.median(_radii(corners))))
    done: list[tuple[Array, Ints, Array]] = []
    while True:
        radii = _radii(corners)
        large = radii > target
        done.append((corners[~large].mean(axis=1), owners[~large], radii[~large]))
        if not large.any():
            break
        corners = _halved(corners[large])
        owners = np.repeat(owners[large], 2)
    centres, facets, radii = (np.concatenate(part) for part in zip(*done, strict=True))
    return centres, facets, radii


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
