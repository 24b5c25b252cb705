# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of the facets of two faces, divided into simplices with quadrature points.

The parts are computed in the plane of the slave facet (in 2D, its line), along its normal. Their
division depends on the facets but not on their numbering, so that points are the same on any number
of ranks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import basix

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import dot

__all__ = [
    "Cover",
    "Faces",
    "QuadratureRule",
    "basis",
    "cover",
    "nodal_points",
    "slopes",
    "tabulated",
]


_LEAST_COVER = 0.05  # covered fraction of a slave facet below which it is dropped
_STEEP = 0.5  # smallest cosine between the normals of facets that face each other
_MORE = 1e-3  # fraction of a facet by which its parts may exceed it
_SLIVER = 1e-10  # fraction of a facet that is round-off
_ON_LINE = 1e-12  # distance of points on a line, relative to the edge
_KINDS = {2: basix.CellType.interval, 3: basix.CellType.triangle, 4: basix.CellType.quadrilateral}
_LOOP = {3: [0, 1, 2], 4: [0, 1, 3, 2]}  # corners around a facet


@dataclass(frozen=True)
class Faces:
    """Flat facets: segments, triangles or quadrilaterals.

    Attributes:
        x: corners, of quadrilaterals in tensor order, shape (n, k, dim).
        normals: outward unit normals, shape (n, dim).
        nodes: global nodes of the displacement, those at the corners first, shape (n, m).
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
        """Middles (n, dim) of the facets, and radii (n,) of balls around them."""
        middles = self.x.mean(axis=1)
        off = np.linalg.norm(self.x - middles[:, None], axis=2)
        return middles, off.max(axis=1, initial=0.0)


@dataclass(frozen=True)
class QuadratureRule:
    """Quadrature points on the pieces.

    Attributes:
        weights: quadrature weights, shape (pieces, points).
        mine: reference coordinates in the slave facets, shape (pieces, points, dim - 1).
        theirs: reference coordinates in the master facets, shape (pieces, points, dim - 1).
    """

    weights: Array
    mine: Array
    theirs: Array


@dataclass(frozen=True)
class Cover:
    """Covered parts of slave facets, in pieces that are simplices.

    Attributes:
        slave: slave facets.
        master: master facets that may oppose some of them.
        facet: slave facet by piece.
        other: master facet by piece.
        pieces: corners in the plane of the slave facet, shape (pieces, dim, dim - 1).
        mine: corners of the slave facet in its plane, shape (pieces, k, dim - 1).
        theirs: corners of the master facet in that plane, shape (pieces, k, dim - 1).
    """

    slave: Faces
    master: Faces
    facet: Ints
    other: Ints
    pieces: Array
    mine: Array
    theirs: Array

    def __getitem__(self, chosen: Ints) -> Cover:
        facets = self.facet[chosen], self.other[chosen]
        shapes = self.pieces[chosen], self.mine[chosen], self.theirs[chosen]
        return Cover(self.slave, self.master, *facets, *shapes)

    def places(self) -> tuple[Ints, Ints, Array]:
        """Return the opposing points of slave corners, one for each piece at the corner.

        Returns:
            Global slave nodes (n,), master nodes (n, k), and their weights of degree 1.
        """
        apart = np.linalg.norm(self.pieces[:, :, None] - self.mine[:, None], axis=3)
        size = np.ptp(self.mine, axis=1).max(axis=1)
        piece, corner = np.nonzero(apart.min(axis=1) <= _SLIVER * size[:, None])
        at = _reference(self.theirs[piece], self.mine[piece, corner][:, None])[:, 0]
        k = self.master.corners
        theirs = self.master.nodes[self.other[piece], :k]
        return self.slave.nodes[self.facet[piece], corner], theirs, basis(at, k, 1)

    def rule(self, degree: int) -> QuadratureRule:
        """Return quadrature points, exact for products of bases on parallelograms.

        Args:
            degree: degree of the products, in each direction of quadrilaterals.
        """
        dim = self.pieces.shape[1]
        flat = {2: basix.CellType.interval, 3: basix.CellType.triangle}[dim]
        total = 2 * degree if 4 in (self.mine.shape[1], self.theirs.shape[1]) else degree
        points, weights = basix.make_quadrature(flat, total)
        x = np.einsum("qv,pva->pqa", basis(points, dim, 1), self.pieces)
        sizes = np.abs(np.linalg.det(self.pieces[:, 1:] - self.pieces[:, :1]))
        return QuadratureRule(
            sizes[:, None] * weights, _reference(self.mine, x), _reference(self.theirs, x)
        )


def _element(corners: int, degree: int) -> basix.finite_element.FiniteElement:
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, _KINDS[corners], degree, variant)


def basis(x: Array, corners: int, degree: int) -> Array:
    """Return the Lagrange basis of facets with 2, 3 or 4 corners at places (..., dim - 1)."""
    return tabulated(_element(corners, degree), x)


def slopes(eta: Array, corners: int) -> Array:
    """Return derivatives of the linear basis at places (..., dim - 1), (..., corners, dim - 1)."""
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


def tabulated(element: basix.finite_element.FiniteElement, x: Array) -> Array:
    """Return values of a scalar element (..., k) at reference coordinates (..., dim - 1)."""
    # Basix aborts without any points.
    points = x.reshape(-1, x.shape[-1]) if x.size else np.zeros((1, x.shape[-1]))
    values = element.tabulate(0, points)[0, : x[..., 0].size, :, 0]
    return np.asarray(values.reshape(*x.shape[:-1], values.shape[1]))


def nodal_points(corners: int, degree: int) -> Array:
    """Return reference coordinates of the nodes of a basis, shape (nodes, dim - 1)."""
    return np.asarray(_element(corners, degree).points)


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
    """Return the covered parts of slave facets. Not collective.

    If master facets lie over each other, the nearest count, as many as fit. Slave facets that are
    hardly covered do not count.

    Args:
        slave: slave facets of this rank.
        master: master facets that may oppose some of them.
        pairs: numbers of slave and master facets that may oppose each other, shape (n, 2).
        deepest: largest overlap of the bodies, one length or one per slave facet.
        farthest: largest distance of the bodies.
        least: covered fraction of a slave facet below which it does not count.
        steep: cosine of the largest angle at which facets face each other.
    """
    i, k = pairs.T
    facing = dot(slave.normals[i], master.normals[k]) < -steep
    i = i[facing]
    k = k[facing]
    centre = slave.x.mean(axis=1)
    axes = _axes(slave)
    flat = np.einsum("nkd,nda->nka", slave.x - centre[:, None], axes)
    mine = flat[i]
    theirs = np.einsum("pkd,pda->pka", master.x[k] - centre[i, None], axes[i])
    if slave.x.shape[2] == 2:
        size = np.abs(flat[:, 1, 0] - flat[:, 0, 0])
        pair, pieces = _segments(mine, theirs, size[i])
    else:
        size = np.abs(_area(flat[:, _LOOP[slave.corners]]))
        pair, pieces = _polygons(mine, theirs, size[i])
    found = Cover(slave, master, i[pair], k[pair], pieces, mine[pair], theirs[pair])
    rule = found.rule(1)
    heights = np.einsum("pkd,pd->pk", master.x[k] - centre[i, None], slave.normals[i])[pair]
    area = rule.weights.sum(axis=1)
    gaps = np.einsum("pqk,pk->pq", basis(rule.theirs, master.corners, 1), heights)
    gap = np.einsum("pq,pq->p", rule.weights, gaps) / area
    limit = np.broadcast_to(deepest, (len(slave.x),))[found.facet]
    kept = np.flatnonzero((gap > -limit) & (gap < farthest))
    kept = kept[_nearest(found.facet[kept], gap[kept], area[kept], size)]
    covered = np.bincount(found.facet[kept], area[kept], len(size))
    return found[kept[covered[found.facet[kept]] >= least * size[found.facet[kept]]]]


def _axes(faces: Faces) -> Array:
    """Return unit vectors in the planes of facets, shape (n, dim, dim - 1)."""
    first = faces.x[:, 1] - faces.x[:, 0]
    first -= dot(first, faces.normals)[:, None] * faces.normals
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    if faces.x.shape[2] == 2:
        return np.asarray(first[:, :, None])
    return np.stack([first, np.cross(faces.normals, first)], axis=2)


def _nearest(facet: Ints, gap: Array, area: Array, size: Array) -> Ints:
    """Return the pieces that count: of several over each other the nearest, as many as fit.

    Master parts that overlap slightly, such as adjacent bodies whose meshes do not quite fit, are
    not layers, and all of them count.
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


def _segments(mine: Array, theirs: Array, size: Array) -> tuple[Ints, Array]:
    """Return common parts of pairs of segments: numbers of the pairs, ends (parts, 2, 1)."""
    low = np.maximum(mine.min(axis=1), theirs.min(axis=1))[:, 0]
    high = np.minimum(mine.max(axis=1), theirs.max(axis=1))[:, 0]
    pair = np.flatnonzero(high - low > _SLIVER * size)
    return pair, np.stack([low[pair], high[pair]], axis=1)[:, :, None]


def _polygons(mine: Array, theirs: Array, size: Array) -> tuple[Ints, Array]:
    """Return common parts of pairs of polygons, as triangles around their centres."""
    clip = _anticlockwise(mine[:, _LOOP[mine.shape[1]]])
    polygon = _anticlockwise(theirs[:, _LOOP[theirs.shape[1]]])
    count: Ints = np.full(len(mine), polygon.shape[1], dtype=np.int64)
    for edge in range(clip.shape[1]):
        start = clip[:, edge]
        end = clip[:, (edge + 1) % clip.shape[1]]
        polygon, count = _cut(polygon, count, start, end)
    polygon, count = _without_copies(polygon, count, size)
    pair, corner = np.nonzero(np.arange(polygon.shape[1]) < count[:, None])
    held = (count[pair] > 3) | ((count[pair] == 3) & (corner == 0))
    pair = pair[held]
    corner = corner[held]
    after = (corner + 1) % count[pair]
    middle = _centre(polygon, count)[pair]
    apex = np.where((count[pair] == 3)[:, None], polygon[pair, 2], middle)
    triangles = np.stack([polygon[pair, corner], polygon[pair, after], apex], axis=1)
    kept = _area(triangles) > _SLIVER * size[pair]
    return pair[kept], triangles[kept]


def _centre(polygon: Array, count: Ints) -> Array:
    """Return centres of area (n, 2), independent of the order and repetition of corners."""
    first = polygon[:, :1]
    places = np.minimum(np.arange(polygon.shape[1]), np.maximum(count - 1, 0)[:, None])
    x = np.take_along_axis(polygon, places[:, :, None], axis=1) - first
    y = np.roll(x, -1, axis=1)
    double = x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0]
    total = double.sum(axis=1)
    moment = np.einsum("nk,nka->na", double, x + y) / 3
    offset = np.divide(moment, total[:, None], out=np.zeros_like(moment), where=total[:, None] > 0)
    return np.asarray(first[:, 0] + offset)


def _area(x: Array) -> Array:
    """Return signed areas of polygons (n, k, 2)."""
    y = np.roll(x, -1, axis=1)
    double = x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0]
    return np.asarray(0.5 * double.sum(axis=1))


def _anticlockwise(x: Array) -> Array:
    return np.where(_area(x)[:, None, None] < 0, x[:, ::-1], x)


def _after(count: Ints, m: int) -> Ints:
    """Return the places of the next corners of polygons, shape (n, m)."""
    places = np.arange(1, m + 1)
    return np.where(places < count[:, None], places, 0)


def _cut(polygon: Array, count: Ints, start: Array, end: Array) -> tuple[Array, Ints]:
    """Return the parts of convex polygons (n, m, 2) to the left of lines.

    The polygons have ``count`` corners each.
    """
    n, m, _ = polygon.shape
    along = end - start
    offset = polygon - start[:, None]
    left = along[:, None, 0] * offset[..., 1] - along[:, None, 1] * offset[..., 0]
    left /= np.sum(along**2, axis=1)[:, None]
    held = np.arange(m) < count[:, None]
    after = _after(count, m)
    there = np.take_along_axis(left, after, axis=1)
    inside = left >= -_ON_LINE
    crosses = inside != (there >= -_ON_LINE)
    # An edge along the line, one end of which is within the tolerance, is cut at that end.
    share = np.clip(left / np.where(crosses, left - there, 1.0), 0.0, 1.0)
    beyond = np.take_along_axis(polygon, after[:, :, None], axis=1)
    crossing = polygon + share[:, :, None] * (beyond - polygon)
    every = np.stack([polygon, crossing], axis=2).reshape(n, 2 * m, 2)
    return _kept(every, (np.stack([inside, crosses], axis=2) & held[:, :, None]).reshape(n, 2 * m))


def _without_copies(polygon: Array, count: Ints, size: Array) -> tuple[Array, Ints]:
    """Return polygons without corners at the place of the next one."""
    m = polygon.shape[1]
    after = _after(count, m)
    step = np.take_along_axis(polygon, after[:, :, None], axis=1) - polygon
    far = np.linalg.norm(step, axis=2) > _SLIVER * np.sqrt(size)[:, None]
    return _kept(polygon, far & (np.arange(m) < count[:, None]))


def _kept(corners: Array, kept: Mask) -> tuple[Array, Ints]:
    """Return polygons of the kept corners, in their order, and the numbers of corners."""
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : int(count.max(initial=3))]
    return np.take_along_axis(corners, order[:, :, None], axis=1), count


def _reference(corners: Array, x: Array) -> Array:
    """Return reference coordinates in facets (n, k, dim - 1) of points of their plane (n, q)."""
    k, width = corners.shape[1:]
    if k == width + 1:
        edges = corners[:, 1:] - corners[:, :1]
        offset = (x - corners[:, :1])[..., None]
        return np.asarray(np.linalg.solve(edges.transpose(0, 2, 1)[:, None], offset)[..., 0])
    xi: Array = np.full(x.shape, 0.5)
    for _ in range(20):
        off = np.einsum("nqk,nka->nqa", basis(xi, k, 1), corners) - x
        jacobian = np.einsum("nqkb,nka->nqab", slopes(xi, k), corners)
        step = np.linalg.solve(jacobian, off[..., None])[..., 0]
        xi -= step
        if np.max(np.abs(step), initial=0.0) < 1e-14:
            break
    return xi
