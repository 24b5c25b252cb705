# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Closest points on segments and triangles.

The projection of a point onto the plane of a triangle forms another triangle with each edge. It
lies inside the triangle if the area vectors of these three triangles have the orientation of the
whole triangle. Otherwise the closest point is on an edge. Scalar products of these area vectors are
computed from scalar products of edges. Slivers are an exception, because terms of the magnitude of
the fourth power of the longest edge would cancel. If the closest point is on an edge or corner, the
barycentric coordinates of all other corners are exactly zero.

A search examines few facets. Every facet is covered by a ball, a large facet by several balls. If a
facet has the distance d from a point and its ball the radius r, the centre of the ball is within d
+ r of the point. The facets of the nearest balls give an upper bound of the smallest distance;
other facets are examined only if they may be closer.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import area_vectors, balls, dot, listed_pairs

__all__ = ["ClosestFacets", "ClosestPoints", "closest_on"]


_FIRST = 8  # nearest balls, whose facets give an upper bound of the distance
_LARGER = 1.0 + 1e-12  # round-off of distances
_PAIRS = 2**18  # pairs of points and facets examined together
_THIN = 1e-4  # area of a sliver, squared, relative to the fourth power of its longest edge
_PARTS = 64.0  # balls along the largest extent of a surface, up to which facets are divided


def closest_on(x: Array, corners: Array) -> Array:
    """Return the closest point on each of n simplices, as barycentric coordinates, shape (n, k).

    Args:
        x: points, one for each simplex, shape (n, dim).
        corners: corners of the segments (k = 2) or triangles (k = 3), shape (n, k, dim).
    """
    found = np.zeros(corners.shape[:2])
    outside: Ints = np.arange(len(x), dtype=np.int64)
    if corners.shape[1] == 3:
        parts = _parts(x, corners)
        inside = (parts > 0.0).all(axis=1)
        found[inside] = parts[inside] / parts[inside].sum(axis=1, keepdims=True)
        outside = np.flatnonzero(~inside)
        x, corners = x[outside], corners[outside]
    least = np.full(len(x), np.inf)
    for i, j in combinations(range(corners.shape[1]), 2):
        along = corners[:, j] - corners[:, i]
        away = x - corners[:, i]
        square = np.maximum(dot(along, along), np.finfo(float).tiny)
        part = np.clip(dot(away, along) / square, 0.0, 1.0)
        away -= part[:, None] * along
        distance = dot(away, away)
        closer = np.flatnonzero(distance < least)
        least[closer] = distance[closer]
        rows = outside[closer]
        found[rows] = 0.0
        found[rows, i], found[rows, j] = 1.0 - part[closer], part[closer]
    return found


def _parts(x: Array, corners: Array) -> Array:
    """Return unnormalised barycentric coordinates of projections onto n triangles, shape (n, 3).

    Entry i is, up to a positive factor per triangle, the scalar product of the area vectors of the
    triangle and of its part between the projection and the corners other than i. One point per
    triangle is given, shape (n, 3).
    """
    a = corners[:, 1] - corners[:, 0]
    b = corners[:, 2] - corners[:, 0]
    off = x - corners[:, 0]
    aa, ab, bb, ax, bx = (dot(*pair) for pair in ((a, a), (a, b), (b, b), (a, off), (b, off)))
    square = aa * bb - ab**2
    second = bb * ax - ab * bx
    third = aa * bx - ab * ax
    parts = np.stack([square - second - third, second, third], axis=1)
    thin = np.flatnonzero(square < _THIN * (aa + bb) ** 2)
    if len(thin):
        across = area_vectors(corners[thin])
        away = corners[thin] - x[thin, None]
        squares = np.maximum(dot(across, across), np.finfo(float).tiny)
        height = np.einsum("nki,ni->nk", away, across) / squares[:, None]
        away -= height[..., None] * across[:, None]
        crossed = np.cross(away[:, [1, 2, 0]], away[:, [2, 0, 1]])
        parts[thin] = np.einsum("nki,ni->nk", crossed, across)
    return parts


class ClosestPoints(NamedTuple):
    """Closest points on a surface, for n given points.

    Attributes:
        facets: indices of the facets that contain the closest points, shape (n,).
        parts: barycentric coordinates of the closest points in these facets with k corners, shape
            (n, k).
        feet: closest points, shape (n, dim).
        distance: distances between the given and the closest points, shape (n,).
    """

    facets: Ints
    parts: Array
    feet: Array
    distance: Array


class ClosestFacets:
    """Search for the closest facet and point of a surface. Not collective.

    Args:
        points: points of the surface, shape (m, dim).
        cells: indices of the points of each of k facets, shape (k, dim).
    """

    def __init__(self, points: Array, cells: Ints):
        self._corners = points[cells]
        self._centres, self._owners, self._radii = _covered(self._corners)
        self._largest = float(self._radii.max())
        self._tree = scipy.spatial.cKDTree(self._centres)

    def __call__(self, x: Array) -> ClosestPoints:
        """Return the closest point of the surface for each of n points, shape (n, dim)."""
        count = min(_FIRST, self._tree.n)
        away, balls = self._tree.query(x, k=range(1, count + 1))
        closest = self._among(x, balls.reshape(-1), np.full(len(x), count))
        within = _LARGER * (closest.distance + self._largest)
        left = np.flatnonzero((away[:, -1] < within) & (count < self._tree.n))
        sizes = self._tree.query_ball_point(x[left], within[left], return_length=True)
        groups = np.cumsum(sizes) // _PAIRS
        for some in np.split(left, np.flatnonzero(np.diff(groups)) + 1):
            points, balls = listed_pairs(self._tree.query_ball_point(x[some], within[some]))
            points = some[points]
            apart = np.linalg.norm(x[points] - self._centres[balls], axis=1)
            near = apart <= _LARGER * (closest.distance[points] + self._radii[balls])
            sizes = np.bincount(points[near], minlength=len(x))[some]
            nearer = self._among(x[some], balls[near], sizes)
            for values, new in zip(closest, nearer, strict=True):
                values[some] = new
        return closest

    def _among(self, x: Array, balls: Ints, sizes: Ints) -> ClosestPoints:
        """Return, for each point, the closest point on the facets of the given balls.

        Args:
            x: points, shape (n, dim).
            balls: indices of balls, concatenated for all points.
            sizes: number of balls per point, shape (n,).
        """
        owners = self._owners[balls]
        points = np.repeat(np.arange(len(x)), sizes)
        parts = closest_on(x[points], self._corners[owners])
        feet = np.einsum("pk,pki->pi", parts, self._corners[owners])
        distances = np.linalg.norm(x[points] - feet, axis=1)
        first = np.cumsum(sizes) - sizes
        best = np.lexsort((owners, distances, points))[first]
        return ClosestPoints(owners[best], parts[best], feet[best], distances[best])


def _covered(corners: Array) -> tuple[Array, Ints, Array]:
    """Return balls that cover all facets: centres, index of the facet of each, and radii."""
    owners = np.arange(len(corners))
    largest = float(np.ptp(corners.reshape(-1, corners.shape[2]), axis=0).max()) / _PARTS
    target = max(largest, 2.0 * float(np.median(balls(corners)[1])))
    done: list[tuple[Array, Ints, Array]] = []
    while True:
        centres, radii = balls(corners)
        large = radii > target
        done.append((centres[~large], owners[~large], radii[~large]))
        if not large.any():
            break
        corners = _halved(corners[large])
        owners = np.repeat(owners[large], 2)
    centres, facets, radii = (np.concatenate(part) for part in zip(*done, strict=True))
    return centres, facets, radii


def _halved(corners: Array) -> Array:
    """Bisect each of n facets at its longest edge; return both halves, shape (2 n, k, dim)."""
    k = corners.shape[1]
    pairs = list(combinations(range(k), 2))
    lengths = [np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in pairs]
    ends = np.array(pairs)[np.argmax(lengths, axis=0)]
    row = np.arange(len(corners))
    middle = corners[row[:, None], ends].mean(axis=1)
    halves = np.repeat(corners[:, None], 2, axis=1)
    for half in range(2):
        halves[row, half, ends[:, half]] = middle
    return halves.reshape(-1, k, corners.shape[2])
