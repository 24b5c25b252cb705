# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Signed distances from a surface of facets, surface normals, and their derivatives.

Let c be the closest point of the surface to a point x. The signed distance is phi = +-|x - c|,
positive outside. Its gradient d = (x - c)/phi equals the facet normal if c is inside a facet. If c
is on an edge of direction t, or at a corner, x lies in the normal cone of this edge or corner, and

    grad d = (I - d d^T - t t^T)/phi on an edge,    (I - d d^T)/phi at a corner.

The surface normal is d at creases, where the normal is discontinuous, and at the rims of an open
surface. At other points it is m/|m|. Here m interpolates the corner normals of the facet with the
barycentric coordinates of c, which are linear in x as long as c stays inside a facet or on an edge.

Beyond the rim of an open surface the distance is positive on both sides, because points past the
rim have left the surface. It is discontinuous for points that return from below the rim. The gap of
a sliding face is continuous instead: the face leaves an open surface gradually, within the size b
of one of its facets. With the mean normal m at the closest point c, the height z = m.(x - c) and
the distance a = |x - c - z m| past the rim, the gap is

    g = z + b - sqrt(b^2 - a^2)    for a < b and z > -b - o,

where o is the overlap removed from the gap, if any. The surface is thus extended by a quarter
circle that turns down, but the normal remains m. Contact forces therefore decrease to zero and keep
their direction as points leave. With a sharper end, normals would push points off the surface,
where no equilibrium is nearby. The extension shrinks with the facets of the sliding face. A point
that starts past the rim and below it has the overlap -z, like the adjacent part of the face, and
leaves as if it had started on the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import dot, tangential, unit, unit_rates
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets
from dolfinx_contact.rigid_surfaces.triangulation import Features, Triangulation

__all__ = ["Distances", "distances_from"]


_ON = 1e-10  # relative to the extent: distance up to which a point is on an edge or corner


@dataclass(frozen=True)
class Distances:
    """Distances of points from a surface.

    Attributes:
        feet: closest points on the surface, shape (n, dim).
        facets: indices of the facets with the closest points, shape (n,).
        distance: signed distances, positive outside, shape (n,).
        slope: gradients of the distances, shape (n, dim).
        normal: unit normals of the surface, pointing out of the obstacle, shape (n, dim).
        turn: derivatives of the normals with respect to the points, shape (n, dim, dim).
        past: mask of the points past the rim of an open surface, shape (n,).
    """

    feet: Array
    facets: Ints
    distance: Array
    slope: Array
    normal: Array
    turn: Array
    past: Mask


def distances_from(
    surface: Triangulation,
    closest: ClosestFacets,
    x: Array,
    ends: Array | None = None,
    removed: Array | None = None,
) -> Distances:
    """Compute signed distances of points from a surface, with normals. Not collective.

    The results are NaN for points that are not finite.

    Args:
        surface: triangulated surface of the obstacle.
        closest: search for the closest facets of the surface.
        x: points, shape (n, dim).
        ends: facet sizes of the sliding face at the points, within which points leave an open
            surface gradually, shape (n,); with zero or None, points leave abruptly.
        removed: overlaps removed from the gaps, shape (n,); None for no overlap.
    """
    finite: Mask = np.asarray(np.isfinite(x).all(axis=1))
    facets, parts, feet, _ = closest(np.where(finite[:, None], x, surface.points[0]))
    corners = surface.points[surface.cells[facets]]
    on = _Places(surface, facets, parts)
    away = x - feet
    length = np.linalg.norm(away, axis=1)
    inside_facet = on.zeros == 0
    far: Mask = ~inside_facet & (length > _ON * surface.size)
    outside = dot(away, on.side)
    sign = np.where((outside >= 0) | on.rim, 1.0, -1.0)
    distance = np.where(inside_facet, outside, sign * length)
    safe = np.where(far, sign * length, 1.0)
    slope = np.where(far[:, None], away / safe[:, None], on.side)
    bent = unit_rates(slope, safe) - _outer(on.along) / safe[:, None, None]
    bent = np.where(far[:, None, None], bent, 0.0)
    mean, mean_turn = _interpolated(surface, facets, parts, corners, on)
    sharp = (on.crease | on.rim) & ~inside_facet
    normal = np.where(sharp[:, None], slope, mean)
    turn = np.where(sharp[:, None, None], bent, mean_turn)
    past = on.rim & (outside < -_ON * surface.size)
    if ends is not None:
        rim = np.flatnonzero(on.rim & ~inside_facet)
        m = np.where(on.crease[:, None], on.side, mean)[rim]
        turning = np.where(on.crease[:, None, None], 0.0, mean_turn)[rim]
        low = -ends[rim] if removed is None else -ends[rim] - removed[rim]
        within, gap, rise = _ended(away[rim], m, turning, on.along[rim], ends[rim], low)
        there = rim[within]
        distance[there], slope[there] = gap[within], rise[within]
        normal[there], turn[there] = m[within], turning[within]
    if not finite.all():
        for values in (distance, slope, normal, turn):
            values[~finite] = np.nan
    return Distances(feet, facets, distance, slope, normal, turn, past & finite)


class _Places:
    """Facet, ridge (`triangulation`) or corner on which each of n closest points lies.

    Attributes:
        zeros: number of vanishing barycentric coordinates of the closest point, shape (n,).
        side: outward pseudonormals at the closest points, which determine the signs of the
            distances, shape (n, dim).
        along: unit vectors along the edges that contain closest points, otherwise zero, shape (n,
            dim).
        crease: mask of the closest points on creases, shape (n,).
        rim: mask of the closest points on rims, shape (n,).
    """

    def __init__(self, surface: Triangulation, facets: Ints, parts: Array):
        dim = parts.shape[1]
        none = parts == 0.0
        self.zeros = none.sum(axis=1)
        self.side = surface.normals[facets].copy()
        self.along = np.zeros_like(self.side)
        self.crease = np.zeros(len(facets), dtype=bool)
        self.rim = np.zeros(len(facets), dtype=bool)
        cells = surface.cells[facets]
        edges = np.flatnonzero((self.zeros == 1) & (dim == 3))
        opposite = np.argmax(none[edges], axis=1)
        self._take(edges, surface.of_ridges, surface.ridges[facets[edges], opposite])
        ends = [cells[edges, (opposite + k) % dim] for k in (1, 2)]
        self.along[edges] = unit(surface.points[ends[1]] - surface.points[ends[0]])
        corners = np.flatnonzero(self.zeros == dim - 1)
        points = cells[corners, np.argmax(parts[corners], axis=1)]
        self._take(corners, surface.of_points, points)

    def _take(self, where: Ints, features: Features, numbers: Ints) -> None:
        """Set normals and flags of closest points ``where`` to features with these ``numbers``."""
        self.side[where] = unit(features.normals[numbers])
        self.crease[where] = features.creases[numbers]
        self.rim[where] = features.rims[numbers]


def _ended(
    away: Array, m: Array, turn: Array, along: Array, b: Array, low: Array
) -> tuple[Mask, Array, Array]:
    """Return a mask of the points leaving an open surface past its rim, gaps, and gap gradients.

    Gaps and gradients, shapes (n,) and (n, dim), are valid only for points in the mask.

    Args:
        away: vectors from the closest points on the surface to the n points, shape (n, dim).
        m: surface normals at the closest points, shape (n, dim).
        turn: derivatives of the normals, shape (n, dim, dim).
        along: directions of the edges on which closest points move, otherwise zero, shape (n, dim).
        b: distances past the rim within which points leave, shape (n,).
        low: smallest heights at which points leave gradually, shape (n,).
    """
    z = dot(away, m)
    past = tangential(away, m)
    square = b**2 - dot(past, past)
    within: Mask = (square > 0.0) & (z > low)
    root = np.sqrt(np.where(within, square, 1.0))
    rise = tangential(m, along) + np.einsum("ni,nij->nj", away, turn)
    slope = (1.0 - z / root)[:, None] * rise + away / root[:, None]
    return within, z + b - root, slope


def _interpolated(
    surface: Triangulation, facets: Ints, parts: Array, corners: Array, on: _Places
) -> tuple[Array, Array]:
    """Return unit normals interpolated at n closest points, and their derivatives.

    ``parts`` are the barycentric coordinates of the closest points in ``facets``, ``corners`` the
    corners of these facets.
    """
    of_corners = surface.corner_normals[facets]
    mean = np.einsum("nk,nki->ni", parts, of_corners)
    size = np.linalg.norm(mean, axis=1)
    mean = mean / size[:, None]
    slopes = _slopes(corners)
    # On an edge only the coordinates of its two ends change; at a corner all are constant.
    held = np.where((on.zeros == 0)[:, None, None], np.eye(corners.shape[2]), _outer(on.along))
    slopes = np.where((parts == 0.0)[..., None], 0.0, slopes @ held)
    return mean, unit_rates(mean, size) @ np.einsum("nki,nkj->nij", of_corners, slopes)


def _slopes(corners: Array) -> Array:
    """Return the gradients of the k barycentric coordinates of n facets, shape (n, k, dim)."""
    edges = corners[:, 1:] - corners[:, :1]
    inner = np.einsum("nai,nbi->nab", edges, edges)
    rest = np.linalg.solve(inner, edges)
    return np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)


def _outer(v: Array) -> Array:
    return v[:, :, None] * v[:, None, :]
