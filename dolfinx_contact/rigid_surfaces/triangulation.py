# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of segments (2D) or triangles (3D): validation, orientation and normals.

A *ridge* is the intersection of two facets: a point in 2D, an edge in 3D. A ridge with a single
facet is part of the rim of an open surface. A ridge with three or more facets is an error. A
*crease* is a ridge with a large angle between the normals of its facets. Corner normals (`normals`)
are averaged over a *fan*, the facets around a point not separated by creases. Angle-weighted
pseudonormals determine on which side of the surface a point is (Baerentzen and Aanaes, IEEE Trans.
Vis. Comput. Graph. 11, 2005).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import balls, connected_parts, dot, listed_pairs, unit
from dolfinx_contact.rigid_surfaces.closest import closest_on
from dolfinx_contact.rigid_surfaces.normals import corner_normals, crossed, without_tips

__all__ = ["Triangulation", "merged", "triangulated"]


_SAME = 1e-7  # relative to the extent: distance of coincident points of a file (single precision)
_ON_EDGE = 1e-3  # relative to the extent: distance of a rim point on the edge of another facet
_SLIT = 0.01  # relative to the edges: distance of two points on rims that are meant to coincide
_COPLANAR = 1e-4  # difference of unit normals below which facets are coplanar
_FLAT = 1e-10  # area of a degenerate facet, relative to its longest edge squared
_REPAIR = "pyvista.read(path).clean().compute_normals(auto_orient_normals=True)"


@dataclass(frozen=True)
class Features:
    """Normals and flags of the m ridges (points in 2D, edges in 3D) or points of a surface.

    Attributes:
        normals: outward pseudonormals, not normalised, shape (m, dim).
        creases: mask of the ridges or points at which normals are not averaged, shape (m,).
        rims: mask of the ridges or points on the rim of an open surface, shape (m,).
    """

    normals: Array
    creases: Mask
    rims: Mask


@dataclass(frozen=True)
class Triangulation:
    """Consistently oriented surface of facets, which meet at ridges (points in 2D, edges in 3D).

    Attributes:
        points: coordinates of the points, shape (m, dim).
        cells: indices of the points of each facet, shape (k, dim).
        normals: unit normals of the facets, pointing out of the obstacle, shape (k, dim).
        ridges: index of the ridge opposite to each corner of the facets, shape (k, dim).
        of_ridges: pseudonormals of the ridges, and flags for creases and rims.
        of_points: pseudonormals of the points, and flags for creases and rims.
        corner_normals: averaged normals at the corners of facets, shape (k, dim, dim).
    """

    points: Array
    cells: Ints
    normals: Array
    ridges: Ints
    of_ridges: Features
    of_points: Features
    corner_normals: Array

    @property
    def closed(self) -> bool:
        """Whether the surface has no rim, i.e. every ridge has two facets."""
        return not bool(self.of_ridges.rims.any())

    @property
    def edges(self) -> Ints:
        """Edges that are creases or rims, as pairs of points, shape (n, 2); empty in 2D."""
        if self.points.shape[1] == 2:
            return np.zeros((0, 2), dtype=np.int64)
        first = np.unique(self.ridges, return_index=True)[1]
        facet, corner = np.divmod(first[self.of_ridges.creases | self.of_ridges.rims], 3)
        return np.stack([self.cells[facet, (corner + k) % 3] for k in (1, 2)], axis=1)

    @property
    def size(self) -> float:
        """Length of the diagonal of the bounding box of the surface."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


class _Ridges:
    """Ridges, i.e. points in 2D and edges in 3D at which facets meet, and their facets.

    Args:
        cells: points of the facets, shape (k, dim).
        name: name of the surface for messages.

    Attributes:
        what: name of the ridges in messages.
        numbers: index of the ridge opposite to each corner of the facets, shape (k, dim).
        nodes: points of the ridge opposite to each corner, oriented as the facet, shape (k dim, dim
            - 1).
        signs: orientation of each row of ``nodes`` in its facet, 1 or -1, shape (k dim,).
        first: row of ``nodes`` for the first of two facets at each interior ridge.
        second: row of ``nodes`` for the second facet at each interior ridge.
        rims: mask of the ridges with a single facet, by facet, shape (k, dim).
    """

    def __init__(self, cells: Ints, name: str):
        k, self.dim = cells.shape
        self.what = "points" if self.dim == 2 else "edges"
        if self.dim == 2:
            self.nodes = cells[:, [1, 0]].reshape(-1, 1)
            self.signs = np.tile([1, -1], k)
        else:
            self.nodes = cells[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2)
            self.signs = np.where(self.nodes[:, 0] < self.nodes[:, 1], 1, -1)
        ordered = np.sort(self.nodes, axis=1)
        numbers = np.unique(ordered, axis=0, return_inverse=True)[1].reshape(-1)
        counts = np.bincount(numbers)
        if counts.max(initial=0) > 2:
            raise ValueError(
                f"{name} is not a manifold: {np.sum(counts > 2)} {self.what} have more than two "
                f"facets (up to {counts.max()})"
            )
        order = np.argsort(numbers, kind="stable")
        starts = (np.cumsum(counts) - counts)[counts == 2]
        self.first, self.second = order[starts], order[starts + 1]
        self.numbers = numbers.reshape(k, self.dim)
        self.rims = counts[self.numbers] == 1

    @property
    def facets(self) -> tuple[Ints, Ints]:
        """Index of the first and of the second facet at each interior ridge."""
        return self.first // self.dim, self.second // self.dim

    @property
    def alike(self) -> Mask:
        """Mask of the ridges with two facets at which these are oriented inconsistently."""
        return self.signs[self.first] == self.signs[self.second]

    def fans(self, cells: Ints, joined: Mask) -> Ints:
        """Return the index of the fan that contains each corner of the k facets, shape (k dim,).

        A fan consists of facets around a point. Two corners at the same point belong to the same
        fan if their facets are connected through joined ridges.

        Args:
            cells: points of the facets, shape (k, dim).
            joined: mask of the interior ridges that connect their facets.
        """
        links = []
        for column in range(self.dim - 1):
            node = self.nodes[self.first[joined], column]
            ends = [
                p // self.dim * self.dim + np.argmax(cells[p // self.dim] == node[:, None], axis=1)
                for p in (self.first[joined], self.second[joined])
            ]
            links.append(np.stack(ends, axis=1))
        return connected_parts(cells.size, *np.concatenate(links).T)


def merged(points: Array, cells: Ints) -> tuple[Array, Ints]:
    """Merge points that coincide up to 1e-7 of the extent, and remove points without a facet.

    Args:
        points: points, shape (m, dim).
        cells: points of the facets, shape (k, dim).

    Returns:
        Remaining points, and indices of these points for each facet.
    """
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = scipy.spatial.cKDTree(points).query_pairs(_SAME * size, output_type="ndarray")
    group = connected_parts(len(points), *pairs.T)
    used, renumbered = np.unique(group[cells], return_inverse=True)
    first = np.unique(group, return_index=True)[1]
    return points[first[used]], renumbered.reshape(cells.shape).astype(np.int64)


def triangulated(
    points: Array, cells: Ints, crease: float, name: str, *, inward: bool = False
) -> Triangulation:
    """Validate a surface and compute its ridges and normals.

    Args:
        points: points, shape (m, dim).
        cells: points of the facets, shape (k, dim).
        crease: angle in radians between facet normals above which they are not averaged.
        name: name of the surface for messages.
        inward: whether closed parts with a negative volume are accepted.

    Raises:
        ValueError: if facets are degenerate or repeated, three facets share a ridge (a point in 2D,
            an edge in 3D), parts touch at a single point, neighbours are oriented inconsistently, a
            closed part encloses a negative volume, or points of rims nearly coincide.
    """
    _check_facets(points, cells, name)
    corners = points[cells]
    normals = unit(crossed(corners))
    ridges = _Ridges(cells, name)
    _check_sides(points, cells, ridges, name, inward=inward)
    first, second = ridges.facets
    # creases and rims
    at_crease = dot(normals[first], normals[second]) < np.cos(crease)
    count = int(ridges.numbers.max()) + 1
    creases, rims = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    creases[ridges.numbers.ravel()[ridges.first]] = at_crease
    rims[ridges.numbers[ridges.rims]] = True
    point_rims = np.zeros(len(points), dtype=bool)
    point_rims[ridges.nodes[ridges.rims.ravel()]] = True
    fans = without_tips(corners, ridges.fans(cells, ~at_crease))
    _check_torn(points, cells, ridges, name)
    # normals
    ridge_normals = np.zeros((count, cells.shape[1]))
    np.add.at(ridge_normals, ridges.numbers, normals[:, None])
    point_normals = np.zeros_like(points)
    np.add.at(point_normals, cells, _angles(corners)[..., None] * normals[:, None])
    same = np.linalg.norm(normals[first] - normals[second], axis=1) < _COPLANAR
    planes = connected_parts(len(cells), first[same], second[same])
    bends = _bends_at_creases(corners, normals, ridges, at_crease, planes)
    of_ridges = Features(ridge_normals, creases, rims)
    of_points = Features(point_normals, _fans_of_points(cells, fans) > 1, point_rims)
    averaged = corner_normals(corners, fans, planes, bends)
    return Triangulation(points, cells, normals, ridges.numbers, of_ridges, of_points, averaged)


# -- checks ----------------------------------------------------------------------------------------


def _check_facets(points: Array, cells: Ints, name: str) -> None:
    """Raise ``ValueError`` for facets that are degenerate or repeated."""
    corners = points[cells]
    area = np.linalg.norm(crossed(corners), axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = area <= _FLAT * longest ** (cells.shape[1] - 1)
    if flat.any():
        raise ValueError(
            f"{name}: {flat.sum()} facets have no area, the first at {_at(corners[flat][0])}; "
            f"remove those with two coincident corners, for example by {_REPAIR}, and repair "
            "others in the program that created the surface"
        )
    twice = len(cells) - len(np.unique(np.sort(cells, axis=1), axis=0))
    if twice:
        raise ValueError(f"{name}: {twice} facets are repeated; remove them")


def _check_sides(points: Array, cells: Ints, ridges: _Ridges, name: str, *, inward: bool) -> None:
    """Raise `ValueError` if orientations are inconsistent or a closed part has inward normals."""
    unlike = ridges.alike
    if unlike.any():
        raise ValueError(
            f"{name}: the facets at {unlike.sum()} of {len(unlike)} {ridges.what} between two are "
            f"oriented inconsistently, first at "
            f"{_at(points[ridges.nodes[ridges.first[unlike][0]]])}; flip facets, for example by "
            f"{_REPAIR}"
        )
    part = connected_parts(len(cells), *ridges.facets)
    volume = np.bincount(part, _volumes(points, cells))
    wrong = (volume < 0) & (np.bincount(part, ridges.rims.any(axis=1)) == 0)
    if wrong.any() and not inward:
        first = cells[part == np.flatnonzero(wrong)[0]][0]
        raise ValueError(
            f"{name}: a closed surface has inward normals, at {_at(points[first])}; flip all "
            f"its facets, for example by {_REPAIR}; reverse=True is for a body inside the surface"
        )


def _check_torn(points: Array, cells: Ints, ridges: _Ridges, name: str) -> None:
    """Raise ``ValueError`` if parts touch at a point only, or facets do not join at rims.

    Facets do not join if a rim point lies on or near another rim edge (in 2D another segment).
    """
    fans = ridges.fans(cells, np.ones(len(ridges.first), dtype=bool))
    several = np.flatnonzero(_fans_of_points(cells, fans) > 1)
    if len(several):
        raise ValueError(
            f"{name}: parts of the surface touch only at {len(several)} points, the first at "
            f"{_at(points[several[:1]])}"
        )
    rims = np.flatnonzero(ridges.rims.ravel())
    ends = np.unique(ridges.nodes[rims])
    if not len(ends):
        return
    # other edges of rims (in 2D other segments) near the points of rims
    edges = ridges.nodes[rims] if ridges.dim == 3 else cells
    corners = points[edges]
    middles, radii = balls(corners)
    shortest = _shortest_edges(points, cells)
    tree = scipy.spatial.cKDTree(points[ends])
    edge, number = listed_pairs(
        tree.query_ball_point(middles, radii + _SLIT * shortest[ends].max())
    )
    point = ends[number]
    parts = closest_on(points[point], corners[edge])
    apart = np.linalg.norm(points[point] - np.einsum("pk,pki->pi", parts, corners[edge]), axis=1)
    length = 2.0 * radii[edge]
    inside = parts.min(axis=1) * length > _SLIT * shortest[point]
    most = _ON_EDGE * np.minimum(shortest[point], length)
    near = apart < np.where(inside, most, _SLIT * shortest[point])
    torn = np.unique(point[near & (point[:, None] != edges[edge]).all(axis=1)])
    if len(torn):
        raise ValueError(
            f"{name}: the surface is torn: {len(torn)} rim points coincide with others, are within "
            f"{_SLIT:g} of an edge of these, or are on the edges of other facets, the first at "
            f"{_at(points[torn[:1]])}; join them in the program that created the surface, or those "
            f"that coincide by {_REPAIR}"
        )


def _shortest_edges(points: Array, cells: Ints) -> Array:
    """Return the length of the shortest edge at each of the m points, shape (m,)."""
    shortest = np.full(len(points), np.inf)
    corners = points[cells]
    for i in range(cells.shape[1]):
        length = np.linalg.norm(corners[:, i - 1] - corners[:, i], axis=1)
        np.minimum.at(shortest, cells[:, [i - 1, i]], length[:, None])
    return shortest


def _at(x: Array) -> str:
    mean = np.atleast_2d(x).mean(axis=0)
    return f"({', '.join(f'{c:.6g}' for c in mean)})"


# -- connected parts -------------------------------------------------------------------------------


def _fans_of_points(cells: Ints, fans: Ints) -> Ints:
    """Return the number of fans at each of the m points, shape (m,)."""
    return np.bincount(np.unique(np.stack([cells.ravel(), fans], axis=1), axis=0)[:, 0])


# -- geometry --------------------------------------------------------------------------------------


def _volumes(points: Array, cells: Ints) -> Array:
    """Return signed volumes (2D: areas) of cones from the surface centre to facets, shape (k,)."""
    corners = points[cells] - points.mean(axis=0)
    dim = cells.shape[1]
    return dot(corners.mean(axis=1), crossed(corners)) / (dim * (dim - 1))


def _angles(corners: Array) -> Array:
    """Return the angle of each facet at each corner in radians, shape (k, dim); 1 for segments."""
    if corners.shape[1] == 2:
        return np.ones(corners.shape[:2])
    a = np.roll(corners, -1, axis=1) - corners
    b = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(a, b), axis=2)
    return np.arctan2(across, dot(a, b))


def _bends_at_creases(
    corners: Array, normals: Array, ridges: _Ridges, at_crease: Mask, planes: Ints
) -> Array:
    """Return the bend of each facet at its creases, shape (k,).

    The bend is the largest difference of normals across a crease, divided by the width of the facet
    across this crease. Coplanar facets, such as both triangles of a strip, share the largest value.

    Args:
        corners: corners of the facets, shape (k, dim, dim).
        normals: normals of the facets, shape (k, dim).
        ridges: ridges of the facets.
        at_crease: mask of the ridges of two facets that are creases.
        planes: indices of the planes of the facets, shape (k,).
    """
    first, second = ridges.facets
    off = np.linalg.norm(normals[first] - normals[second], axis=1)
    size = np.linalg.norm(crossed(corners), axis=1)
    most = np.zeros(len(normals))
    for ridge in (ridges.first, ridges.second):
        facet, corner = np.divmod(ridge, ridges.dim)
        width = size[facet]
        if ridges.dim == 3:
            ends = [corners[facet, (corner + k) % 3] for k in (1, 2)]
            width = width / np.linalg.norm(ends[1] - ends[0], axis=1)
        np.maximum.at(most, planes[facet], np.where(at_crease, off / width, 0.0))
    return most[planes]
