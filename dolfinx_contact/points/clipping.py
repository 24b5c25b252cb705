# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of the facets of two faces, divided into simplices with quadrature points.

They are computed in the plane of the slave facet (in 2D, on its line), projecting the master facet
along its normal. Their division does not depend on the numbering of the facets, so that quadrature
points are the same on any number of ranks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

import basix

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import area_vectors, balls, dot, tangential, unit
from dolfinx_contact.points.jump_operators import NodeWeights

__all__ = [
    "Cover",
    "Faces",
    "LinearBasis",
    "QuadratureRule",
    "basis",
    "cover",
    "linear_basis",
    "nodal_points",
    "tabulated",
    "tangents",
]


_LEAST_COVER = 0.05  # covered fraction of a slave facet below which it is dropped
_STEEP = 0.5  # smallest cosine between the normals of facets that face each other
_MORE = 1e-3  # fraction of a facet by which its parts may exceed it
_SLIVER = 1e-10  # fraction of a facet that is round-off
_ON_LINE = 1e-12  # distance of points on a line, relative to the edge
_STEPS = 20
_FOUND = 1e-14  # last step of Newton's method, relative to the facet
_KINDS = {2: basix.CellType.interval, 3: basix.CellType.triangle, 4: basix.CellType.quadrilateral}
_LOOP = {3: [0, 1, 2], 4: [0, 1, 3, 2]}  # corners around a facet


@dataclass(frozen=True)
class Faces:
    """Flat facets: segments, triangles or quadrilaterals.

    Attributes:
        x: corners, shape (n, k, dim), in tensor order for quadrilaterals.
        normals: outward unit normals, shape (n, dim).
        nodes: global nodes of the displacement on each facet, shape (n, m), corners first.
    """

    x: Array
    normals: Array
    nodes: Ints

    @property
    def corners(self) -> int:
        """Number of corners of a facet."""
        return int(self.x.shape[1])

    @property
    def balls(self) -> tuple[Array, Array]:
        """Centres, shape (n, dim), and radii, shape (n,), of balls that contain the facets."""
        return balls(self.x)


@dataclass(frozen=True)
class QuadratureRule:
    """Quadrature points on pieces of facets, the simplices of a `Cover`.

    Attributes:
        weights: quadrature weights, shape (pieces, points).
        on_slave: reference coordinates in the slave facets, shape (pieces, points, dim - 1).
        on_master: reference coordinates in the master facets, shape (pieces, points, dim - 1).
    """

    weights: Array
    on_slave: Array
    on_master: Array


@dataclass(frozen=True)
class Cover:
    """Parts of slave facets covered by master facets, divided into simplices (pieces).

    Coordinates in the plane of a slave facet refer to its centre and unit vectors in the plane.

    Attributes:
        slave: slave facets.
        master: master facets that may oppose some of the slave facets.
        facet: index of the slave facet of each piece, shape (pieces,).
        other: index of the master facet of each piece, shape (pieces,).
        pieces: corners of each piece in the plane of its slave facet, shape (pieces, dim, dim - 1).
        slave_x: k corners of the slave facet of each piece in its plane, shape
            (pieces, k, dim - 1).
        master_x: corners of the master facet of each piece, projected onto this plane, shape
            (pieces, k, dim - 1).
    """

    slave: Faces
    master: Faces
    facet: Ints
    other: Ints
    pieces: Array
    slave_x: Array
    master_x: Array

    def __getitem__(self, chosen: Ints) -> Cover:
        facets = self.facet[chosen], self.other[chosen]
        shapes = self.pieces[chosen], self.slave_x[chosen], self.master_x[chosen]
        return Cover(self.slave, self.master, *facets, *shapes)

    def places(self) -> tuple[Ints, NodeWeights]:
        """Return points on the master opposite to slave corners, once per piece and corner.

        Returns:
            Global slave nodes at the corners, shape (n,); and the k corners of the opposing master
            facet with the values of their linear basis at the opposing point, shape (n, k).
        """
        apart = np.linalg.norm(self.pieces[:, :, None] - self.slave_x[:, None], axis=3)
        size = np.ptp(self.slave_x, axis=1).max(axis=1)
        piece, corner = np.nonzero(apart.min(axis=1) <= _SLIVER * size[:, None])
        at = _reference(self.master_x[piece], self.slave_x[piece, corner][:, None])[:, 0]
        k = self.master.corners
        nodes = self.master.nodes[self.other[piece], :k]
        return self.slave.nodes[self.facet[piece], corner], NodeWeights(nodes, basis(at, k, 1))

    def rule(self, degree: int) -> QuadratureRule:
        """Return a quadrature rule that is exact for products of basis functions of both facets.

        On quadrilaterals, it is exact only if they are parallelograms.

        Args:
            degree: polynomial degree of the products; on quadrilaterals, degree in each direction.
        """
        dim = self.pieces.shape[1]
        flat = {2: basix.CellType.interval, 3: basix.CellType.triangle}[dim]
        total = 2 * degree if 4 in (self.slave.corners, self.master.corners) else degree
        points, weights = basix.make_quadrature(flat, total)
        x = basis(points, dim, 1) @ self.pieces
        sizes = np.abs(np.linalg.det(self.pieces[:, 1:] - self.pieces[:, :1]))
        places = _reference(self.slave_x, x), _reference(self.master_x, x)
        return QuadratureRule(sizes[:, None] * weights, *places)


@cache
def _element(corners: int, degree: int) -> basix.finite_element.FiniteElement:
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, _KINDS[corners], degree, variant)


def tabulated(element: basix.finite_element.FiniteElement, x: Array, order: int = 0) -> Array:
    """Return the basis functions of a scalar element at reference coordinates.

    Args:
        element: element with k basis functions.
        x: reference coordinates, shape (..., dim - 1).
        order: order of the derivatives, 0 or 1.

    Returns:
        Values and, for order 1, derivatives in each direction, stacked along the first axis; shape
        (1, ..., k) or (dim, ..., k).
    """
    # Basix aborts without any points.
    points = x.reshape(-1, x.shape[-1]) if x.size else np.zeros((1, x.shape[-1]))
    table = element.tabulate(order, points)[:, : x[..., 0].size, :, 0]
    return table.reshape(len(table), *x.shape[:-1], table.shape[2])


def basis(x: Array, corners: int, degree: int) -> Array:
    """Return values of the k Lagrange basis functions of a facet, shape (..., k).

    Args:
        x: reference coordinates, shape (..., dim - 1).
        corners: number of corners of the facet, 2, 3 or 4.
        degree: polynomial degree.
    """
    return tabulated(_element(corners, degree), x)[0]


class LinearBasis(NamedTuple):
    """Values and derivatives of the k Lagrange basis functions of degree 1 at given points.

    Attributes:
        values: values, shape (..., k).
        slopes: derivatives with respect to the reference coordinates, shape (..., k, dim - 1).
    """

    values: Array
    slopes: Array


def linear_basis(x: Array, corners: int) -> LinearBasis:
    """Return values and derivatives of the linear Lagrange basis of a facet.

    Args:
        x: reference coordinates, shape (..., dim - 1).
        corners: number of corners of the facet, 2, 3 or 4.
    """
    table = tabulated(_element(corners, 1), x, 1)
    return LinearBasis(table[0], np.moveaxis(table[1:], 0, -1))


def tangents(corners: Array, slopes: Array) -> Array:
    """Return derivatives of positions on facets with respect to the reference coordinates.

    Shape (n, q, dim, dim - 1).

    Args:
        corners: corners of facets, shape (n, k, dim).
        slopes: derivatives of the linear basis at q reference points, shape (n, q, k, dim - 1).
    """
    return corners.transpose(0, 2, 1)[:, None] @ slopes


def nodal_points(corners: int, degree: int) -> Array:
    """Return reference coordinates of the nodes of a Lagrange facet, shape (nodes, dim - 1).

    Args:
        corners: number of corners of the facet, 2, 3 or 4.
        degree: polynomial degree.
    """
    return _element(corners, degree).points


def cover(
    slave: Faces,
    master: Faces,
    pairs: Ints,
    deepest: float | Array,
    *,
    farthest: float = np.inf,
    least: float = _LEAST_COVER,
    steep: float = _STEEP,
) -> Cover:
    """Return the parts of slave facets covered by master facets. Not collective.

    Where several layers of master facets lie above a slave facet, only the nearest parts are used,
    up to the area of the slave facet. Slave facets that are barely covered are omitted.

    Args:
        slave: slave facets of this rank.
        master: master facets that may oppose some of the slave facets.
        pairs: indices of slave and master facets that may oppose each other, shape (n, 2).
        deepest: largest depth at which a master facet may lie behind a slave facet; a length, or
            one length per slave facet.
        farthest: largest distance at which a master facet may lie in front of a slave facet.
        least: covered fraction of its area below which a slave facet is omitted.
        steep: cosine of the largest angle between the slave normal and the reversed master normal
            of opposing facets.
    """
    facing = dot(slave.normals[pairs[:, 0]], master.normals[pairs[:, 1]]) < -steep
    i, k = pairs[facing].T
    # common parts in the planes of the slave facets
    centres = slave.x.mean(axis=1, keepdims=True)
    axes = _axes(slave)
    slave_x = (slave.x[i] - centres[i]) @ axes[i]
    master_x = (master.x[k] - centres[i]) @ axes[i]
    size = np.linalg.norm(area_vectors(slave.x), axis=1)
    divided = _segments if slave.x.shape[2] == 2 else _polygons
    pair, pieces = divided(slave_x, master_x, size[i])
    found = Cover(
        slave=slave,
        master=master,
        facet=i[pair],
        other=k[pair],
        pieces=pieces,
        slave_x=slave_x[pair],
        master_x=master_x[pair],
    )
    # mean gaps of the pieces
    rule = found.rule(1)
    area = rule.weights.sum(axis=1)
    offset = master.x[found.other] - centres[found.facet]
    heights = offset @ slave.normals[found.facet][:, :, None]
    gaps = basis(rule.on_master, master.corners, 1) @ heights
    gap = dot(rule.weights, gaps[..., 0]) / area
    limit = np.broadcast_to(deepest, (len(slave.x),))[found.facet]
    kept = np.flatnonzero((gap > -limit) & (gap < farthest))
    kept = kept[_nearest(found.facet[kept], gap[kept], area[kept], size)]
    covered = np.bincount(found.facet[kept], area[kept], len(size))
    return found[kept[covered[found.facet[kept]] >= least * size[found.facet[kept]]]]


def _axes(faces: Faces) -> Array:
    """Return orthonormal vectors in the planes of facets, shape (n, dim, dim - 1)."""
    first = unit(tangential(faces.x[:, 1] - faces.x[:, 0], faces.normals))
    if faces.x.shape[2] == 2:
        return first[:, :, None]
    return np.stack([first, np.cross(faces.normals, first)], axis=2)


def _nearest(facet: Ints, gap: Array, area: Array, size: Array) -> Ints:
    """Return the indices of the nearest pieces of each slave facet, up to the area of the facet.

    A slight excess, as between adjacent master bodies whose meshes do not quite fit, does not
    indicate several layers of master facets; then all pieces are returned.
    """
    total = np.bincount(facet, area, len(size))
    kept = np.ones(len(facet), dtype=bool)
    most = (1 + _MORE) * size
    several = np.flatnonzero(total > most)
    for s in several:
        here = np.flatnonzero(facet == s)
        order = here[np.argsort(np.abs(gap[here]), kind="stable")]
        kept[order[np.cumsum(area[order]) > most[s]]] = False
    return np.flatnonzero(kept)


def _segments(slave: Array, master: Array, size: Array) -> tuple[Ints, Array]:
    """Return the common part of each pair of segments on a line.

    Returns:
        Index of the pair of each part, and ends of the part, shape (parts, 2, 1).
    """
    low = np.maximum(slave.min(axis=1), master.min(axis=1))[:, 0]
    high = np.minimum(slave.max(axis=1), master.max(axis=1))[:, 0]
    pair = np.flatnonzero(high - low > _SLIVER * size)
    return pair, np.stack([low[pair], high[pair]], axis=1)[:, :, None]


def _polygons(slave: Array, master: Array, size: Array) -> tuple[Ints, Array]:
    """Return the common part of each pair of polygons, divided into triangles around its centre.

    Returns:
        Index of the pair of each triangle, and its corners, shape (triangles, 3, 2).
    """
    clip = _anticlockwise(slave[:, _LOOP[slave.shape[1]]])
    polygon = _anticlockwise(master[:, _LOOP[master.shape[1]]])
    ends = np.roll(clip, -1, axis=1)
    for edge in range(clip.shape[1]):
        polygon = _cut(polygon, clip[:, edge], ends[:, edge])
    # corners that coincide with the next one are left out
    step = np.roll(polygon, -1, axis=1) - polygon
    far = np.linalg.norm(step, axis=2) > _SLIVER * np.sqrt(size)[:, None]
    polygon, count = _kept(polygon, far)
    apex = np.where(count[:, None] == 3, polygon[:, 2], _centre(polygon))
    sides = polygon, np.roll(polygon, -1, axis=1), np.broadcast_to(apex[:, None], polygon.shape)
    triangles = np.stack(sides, axis=2)
    kept = _area(triangles) > _SLIVER * size[:, None]
    return np.nonzero(kept)[0], triangles[kept]


def _crossed(a: Array, b: Array) -> Array:
    """Return the cross products a x b of plane vectors, shape (...)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _area(x: Array) -> Array:
    """Return signed areas, shape (...), of polygons with corners of shape (..., k, 2)."""
    return 0.5 * _crossed(x, np.roll(x, -1, axis=-2)).sum(axis=-1)


def _centre(polygon: Array) -> Array:
    """Return centroids of polygons, shape (n, 2).

    They do not depend on the order of the corners, nor on whether corners are repeated.
    """
    first = polygon[:, :1]
    x = polygon - first
    y = np.roll(x, -1, axis=1)
    double = _crossed(x, y)[..., None]
    moment = np.sum(double * (x + y), axis=1) / 3
    total = double.sum(axis=1)
    offset = np.divide(moment, total, out=np.zeros_like(moment), where=total > 0)
    return first[:, 0] + offset


def _anticlockwise(x: Array) -> Array:
    return np.where(_area(x)[:, None, None] < 0, x[:, ::-1], x)


def _cut(polygon: Array, start: Array, end: Array) -> Array:
    """Return the parts of convex polygons to the left of one line each, in the form of `_kept`.

    Args:
        polygon: corners, shape (n, m, 2).
        start: a point of the line of each polygon, shape (n, 2).
        end: a second point of each line, shape (n, 2).
    """
    along = end - start
    left = _crossed(along[:, None], polygon - start[:, None]) / dot(along, along)[:, None]
    inside = left >= -_ON_LINE
    crosses = inside != np.roll(inside, -1, axis=1)
    # An edge along the line, one end of which is within the tolerance, is cut at that end.
    step = np.where(crosses, left - np.roll(left, -1, axis=1), 1.0)
    share = np.clip(left / step, 0.0, 1.0)[..., None]
    crossing = polygon + share * (np.roll(polygon, -1, axis=1) - polygon)
    n, m, _ = polygon.shape
    corners = np.stack([polygon, crossing], axis=2).reshape(n, 2 * m, 2)
    return _kept(corners, np.stack([inside, crosses], axis=2).reshape(n, 2 * m))[0]


def _kept(corners: Array, kept: Mask) -> tuple[Array, Ints]:
    """Return polygons without unmarked corners, and their numbers of distinct corners.

    The order of the corners is preserved. The last corner is repeated, so that all polygons have
    equally many corners.
    """
    count = kept.sum(axis=1)
    place = np.minimum(np.arange(count.max(initial=3)), np.maximum(count - 1, 0)[:, None])
    order = np.take_along_axis(np.argsort(~kept, axis=1, kind="stable"), place, axis=1)
    return np.take_along_axis(corners, order[:, :, None], axis=1), count


def _reference(corners: Array, x: Array) -> Array:
    """Return reference coordinates of points in the planes of facets.

    Args:
        corners: corners of the facets in their planes, shape (n, k, dim - 1).
        x: points in these planes, shape (n, q, dim - 1).
    """
    k, width = corners.shape[1:]
    xi: Array = np.full(x.shape, 0.5)
    for _ in range(1 if k == width + 1 else _STEPS):  # one step is exact in simplices
        weights, slopes = linear_basis(xi, k)
        off = (weights @ corners - x)[..., None]
        step = np.linalg.solve(tangents(corners, slopes), off)[..., 0]
        xi -= step
        if np.max(np.abs(step), initial=0.0) < _FOUND:
            break
    return xi
