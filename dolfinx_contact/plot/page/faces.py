# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where contact points lie on the facets of a contact face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

__all__ = ["PointsOnFace", "points_on_face"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

_NEAR = 12  # facets that are tried for a point


@dataclass(frozen=True, eq=False)
class PointsOnFace:
    """Contact points by the vertices of a face.

    Attributes:
        nodes: vertices of the facet that a point lies on (n, k).
        weights: of these, whose sum is 1 (n, k).
        nearest: the contact point next to each corner of each facet (facets, k).
        place: of each point along a face in 2D, from one of its ends (n,); in 3D 0.
    """

    nodes: Cells
    weights: Array
    nearest: Cells
    place: Array


def points_on_face(x: Array, facets: Cells, points: Array) -> PointsOnFace:
    """Find contact points on a face.

    Args:
        x: coordinates of vertices (m, 3).
        facets: vertices of the facets (f, k); of quadrilaterals in the order of DOLFINx.
        points: coordinates of the contact points (n, 3).
    """
    if not len(points):
        nothing = np.zeros((0, facets.shape[1]))
        return PointsOnFace(nothing.astype(int), nothing, np.zeros_like(facets), np.zeros(0))
    corners = x[facets]
    centres = corners.mean(axis=1)
    candidates = np.reshape(
        cKDTree(centres).query(points, min(_NEAR, len(facets)))[1], (len(points), -1)
    )
    nodes = np.zeros((len(points), facets.shape[1]), dtype=np.int64)
    weights = np.zeros(nodes.shape)
    chosen = np.zeros(len(points), dtype=np.int64)
    for i in range(len(points)):
        point = np.asarray(points[i])
        best = np.inf
        for facet in candidates[i]:
            found = _weights(corners[facet], point)
            off = np.linalg.norm(found @ corners[facet] - point)
            size = np.linalg.norm(np.ptp(corners[facet], axis=0))
            # How far it is from the facet, beside and above.
            far = float(off / size) + max(-float(found.min()), 0.0)
            if far < best - 1e-12:
                best = far
                nodes[i] = facets[facet]
                weights[i] = found
                chosen[i] = facet
    parts = 0.6 * corners + 0.4 * centres[:, None]
    nearest = cKDTree(points).query(parts.reshape(-1, 3))[1].reshape(facets.shape)
    place = _along(x, facets, chosen, weights) if facets.shape[1] == 2 else np.zeros(len(points))
    return PointsOnFace(nodes, weights, np.asarray(nearest, dtype=np.int64), place)


def _weights(corners: Array, point: Array) -> Array:
    """Weights of corners (k, 3), with the sum 1, that come closest to a point."""
    size = np.linalg.norm(np.ptp(corners, axis=0))
    matrix = np.vstack([(corners - corners[0]).T / size, np.ones(len(corners))])
    given = np.append((point - corners[0]) / size, 1.0)
    return np.asarray(np.linalg.lstsq(matrix, given, rcond=None)[0])


def _along(x: Array, facets: Cells, chosen: Cells, weights: Array) -> Array:
    """Distances of points along the edges of a face in 2D, part by part of it."""
    of_vertex: dict[int, list[int]] = {}
    for number in range(len(facets)):
        for vertex in map(int, facets[number]):
            of_vertex.setdefault(vertex, []).append(number)
    lengths = np.linalg.norm(x[facets[:, 1]] - x[facets[:, 0]], axis=1)
    start = np.zeros(len(facets))  # distance of the vertex at which an edge is entered
    turned: npt.NDArray[np.bool_] = np.zeros(len(facets), dtype=bool)
    left = set(range(len(facets)))
    reached = 0.0
    while left:
        ends = [v for v, edges in of_vertex.items() if len([e for e in edges if e in left]) == 1]
        pool = ends or [int(facets[min(left), 0])]
        vertex = min(pool, key=lambda v: tuple(x[v]))
        while True:
            onward = [e for e in of_vertex[vertex] if e in left]
            if not onward:
                break
            edge = onward[0]
            left.remove(edge)
            start[edge] = reached
            turned[edge] = facets[edge, 1] == vertex
            reached += lengths[edge]
            vertex = int(facets[edge, 0] if turned[edge] else facets[edge, 1])
    share = np.where(turned[chosen], weights[:, 0], weights[:, 1])
    return np.asarray(start[chosen] + share * lengths[chosen])
