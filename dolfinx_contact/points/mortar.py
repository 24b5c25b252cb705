# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Mortar weights between faces of different meshes, with the biorthogonal basis.

On every facet of the slave the parts that facets of the master cover are found in the plane of the
slave's facet (in 2D, its line), along its normal. One quadrature on these parts gives all integrals
of the facet: its mass M = int N N^T and areas d = int N, the dual basis psi = diag(d) M^-1 N, with
int psi_p N_q = d_p delta_pq, and the coupling int psi_p N_k of the master's basis. With W = sum d
the jump of node p is

    j_p = u_p - 1/W_p sum_k (int psi_p N_k) u_k,

whose weights sum to zero: constants and, on faces that coincide, linear fields are reproduced to
round-off however the faces are cut, and so uniform tractions are (Wohlmuth, SIAM J. Numer. Anal.
38, 2000; Popp, Gee and Wall, Int. J. Numer. Methods Eng. 79, 2009).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import basix

__all__ = ["Coupling", "Faces", "coupling"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_LEAST_COVER = 0.05  # of a slave facet, below which it is dropped
_STEEP = 0.5  # cosine between the normals of opposite facets from which on they do not face
_SLIVER = 1e-10  # of a facet, a part that is round-off
_GAUSS = np.polynomial.legendre.leggauss(2)
_TRIANGLE = basix.make_quadrature(basix.CellType.triangle, 4)
_LOOP = {3: [0, 1, 2], 4: [0, 1, 3, 2]}  # corners around a facet


@dataclass(frozen=True)
class Faces:
    """Flat facets: segments, triangles or quadrilaterals.

    Attributes:
        x: corners (n, k, dim), those of quadrilaterals in tensor order.
        normals: outward (n, dim).
        nodes: global nodes of the corners (n, k).
    """

    x: Array
    normals: Array
    nodes: Nodes


@dataclass(frozen=True)
class Coupling:
    """What the facets of a slave contribute.

    Attributes:
        slave: global nodes of the slave (entries,).
        master: global nodes of the master (entries,).
        values: int psi_p N_k (entries,).
        areas: int N of the covered part, at the corners of the slave's facets (n, k).
    """

    slave: Nodes
    master: Nodes
    values: Array
    areas: Array


@dataclass(frozen=True)
class _Parts:
    """Covered parts of slave facets, with their quadrature points.

    Attributes:
        pair: number of the pair of facets (parts,).
        gap: mean of the gap (parts,).
        weights: (parts, points).
        mine: basis of the slave at the points (parts, points, k).
        theirs: basis of the master there.
    """

    pair: Nodes
    gap: Array
    weights: Array
    mine: Array
    theirs: Array

    def __getitem__(self, chosen: Nodes) -> _Parts:
        values = (v[chosen] for v in (self.gap, self.weights, self.mine, self.theirs))
        return _Parts(self.pair[chosen], *values)


def coupling(slave: Faces, master: Faces, pairs: Nodes, deepest: float) -> Coupling:
    """Integrals over the covered parts of the slave's facets. Not collective.

    Args:
        slave: facets of this rank.
        master: facets that may be opposite to some.
        pairs: numbers of slave and master facets that may be opposite to each other (n, 2).
        deepest: how far the bodies may overlap.
    """
    i, k = pairs.T
    facing = np.sum(slave.normals[i] * master.normals[k], axis=1) < -_STEEP
    i, k = i[facing], k[facing]
    find = _segments if slave.x.shape[2] == 2 else _polygons
    parts, size = find(slave, master, i, k)
    parts = parts[np.flatnonzero(parts.gap > -deepest)]
    parts = parts[_nearest(parts, i, size)]
    i, k = i[parts.pair], k[parts.pair]
    n, corners = slave.nodes.shape
    mass, areas = np.zeros((n, corners, corners)), np.zeros((n, corners))
    np.add.at(mass, i, np.einsum("pq,pqa,pqb->pab", parts.weights, parts.mine, parts.mine))
    np.add.at(areas, i, np.einsum("pq,pqa->pa", parts.weights, parts.mine))
    dropped = areas.sum(axis=1) < _LEAST_COVER * size
    mass[dropped], areas[dropped] = np.eye(corners), 0.0
    dual = np.linalg.solve(mass, areas[:, :, None] * np.eye(corners)).transpose(0, 2, 1)
    psi = np.einsum("pab,pqb->pqa", dual[i], parts.mine)
    values = np.einsum("pq,pqa,pqk->pak", parts.weights, psi, parts.theirs)
    shape = values.shape
    return Coupling(
        np.broadcast_to(slave.nodes[i][:, :, None], shape).reshape(-1),
        np.broadcast_to(master.nodes[k][:, None, :], shape).reshape(-1),
        values.reshape(-1),
        areas,
    )


def _nearest(parts: _Parts, i: Nodes, size: Array) -> Nodes:
    """Which parts count: where several lie over each other, as many as fit, the nearest first."""
    facet, area = i[parts.pair], parts.weights.sum(axis=1)
    total = np.zeros(len(size))
    np.add.at(total, facet, area)
    kept = np.ones(len(facet), dtype=bool)
    several = np.flatnonzero(total > (1 + 1e-6) * size)
    for s in several:
        here = np.flatnonzero(facet == s)
        order = here[np.argsort(np.abs(parts.gap[here]), kind="stable")]
        kept[order[np.cumsum(area[order]) > (1 + 1e-6) * size[s]]] = False
    return np.flatnonzero(kept)


# -- segments --------------------------------------------------------------------------------------


def _segments(slave: Faces, master: Faces, i: Nodes, k: Nodes) -> tuple[_Parts, Array]:
    """Common parts of pairs of segments, and the lengths of the slave's."""
    along = slave.x[:, 1] - slave.x[:, 0]
    length = np.linalg.norm(along, axis=1)
    offset = master.x[k] - slave.x[i, :1]
    s = np.einsum("pjd,pd->pj", offset, along[i]) / length[i, None] ** 2
    low, high = np.maximum(s.min(axis=1), 0.0), np.minimum(s.max(axis=1), 1.0)
    pair = np.flatnonzero(high - low > _SLIVER)
    low, high, s, i = low[pair, None], high[pair, None], s[pair], i[pair]
    at = low + (high - low) * (_GAUSS[0] + 1) / 2
    xi = (at - s[:, :1]) / (s[:, 1:] - s[:, :1])
    theirs = np.stack([1 - xi, xi], axis=2)
    gaps = np.einsum("pjd,pd->pj", offset[pair], slave.normals[i])
    weights = (high - low) * _GAUSS[1] / 2 * length[i, None]
    gap = np.einsum("pqj,pj->p", theirs, gaps) / len(_GAUSS[1])
    return _Parts(pair, gap, weights, np.stack([1 - at, at], axis=2), theirs), length


# -- polygons --------------------------------------------------------------------------------------


def _polygons(slave: Faces, master: Faces, i: Nodes, k: Nodes) -> tuple[_Parts, Array]:
    """Common parts of pairs of polygons, as triangles, and the areas of the slave's."""
    centre = slave.x.mean(axis=1)
    first = slave.x[:, 1] - slave.x[:, 0]
    first -= np.sum(first * slave.normals, axis=1)[:, None] * slave.normals
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(slave.normals, first)], axis=2)  # (n, 3, 2)
    flat = np.einsum("nkd,nda->nka", slave.x - centre[:, None], axes)
    loop = _LOOP[slave.x.shape[1]]
    size = np.abs(_area(flat[:, loop]))
    mine, theirs = flat[i], np.einsum("pkd,pda->pka", master.x[k] - centre[i, None], axes[i])
    gaps = np.einsum("pkd,pd->pk", master.x[k] - centre[i, None], slave.normals[i])
    clip = _anticlockwise(mine[:, loop])
    polygon = _anticlockwise(theirs[:, _LOOP[master.x.shape[1]]])
    count: Nodes = np.full(len(i), polygon.shape[1], dtype=np.int64)
    for edge in range(clip.shape[1]):
        start, end = clip[:, edge], clip[:, (edge + 1) % clip.shape[1]]
        polygon, count = _cut(polygon, count, start, end)
    # Triangles from the first corner.
    pair, corner = np.nonzero(np.arange(2, polygon.shape[1]) < count[:, None])
    triangles = np.stack(
        [polygon[pair, 0], polygon[pair, corner + 1], polygon[pair, corner + 2]], axis=1
    )
    area = _area(triangles)
    kept = area > _SLIVER * size[i[pair]]
    pair, triangles, area = pair[kept], triangles[kept], area[kept]
    points, weights = _TRIANGLE
    hats = np.column_stack([1 - points.sum(axis=1), points])
    x = np.einsum("qv,pva->pqa", hats, triangles)
    ours, others = _basis(mine[pair], x), _basis(theirs[pair], x)
    gap = np.einsum("q,pqk,pk->p", 2 * weights, others, gaps[pair])
    return _Parts(pair, gap, area[:, None] * 2 * weights, ours, others), size


def _area(x: Array) -> Array:
    """Signed areas of polygons (n, k, 2)."""
    y = np.roll(x, -1, axis=1)
    return np.asarray(0.5 * np.sum(x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0], axis=1))


def _anticlockwise(x: Array) -> Array:
    return np.where(_area(x)[:, None, None] < 0, x[:, ::-1], x)


def _cut(polygon: Array, count: Nodes, start: Array, end: Array) -> tuple[Array, Nodes]:
    """What lies to the left of lines, of convex polygons (n, m, 2) with ``count`` corners each."""
    n, m, _ = polygon.shape
    along = end - start
    offset = polygon - start[:, None]
    left = along[:, None, 0] * offset[..., 1] - along[:, None, 1] * offset[..., 0]
    left /= np.sum(along**2, axis=1)[:, None]
    held = np.arange(m) < count[:, None]
    after = np.where(np.arange(1, m + 1) < count[:, None], np.arange(1, m + 1), 0)
    there = np.take_along_axis(left, after, axis=1)
    inside, crosses = left >= 0, (left >= 0) != (there >= 0)
    share = left / np.where(crosses, left - there, 1.0)
    beyond = np.take_along_axis(polygon, after[:, :, None], axis=1)
    crossing = polygon + share[:, :, None] * (beyond - polygon)
    every = np.stack([polygon, crossing], axis=2).reshape(n, 2 * m, 2)
    kept = (np.stack([inside, crosses], axis=2) & held[:, :, None]).reshape(n, 2 * m)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : m + 1]
    return np.take_along_axis(every, order[:, :, None], axis=1), kept.sum(axis=1)


def _basis(corners: Array, x: Array) -> Array:
    """The basis of facets (n, k, 2) at points (n, q, 2) of their plane: (n, q, k)."""
    if corners.shape[1] == 3:
        edges = corners[:, 1:] - corners[:, :1]
        offset = (x - corners[:, :1])[..., None]
        along = np.linalg.solve(edges.transpose(0, 2, 1)[:, None], offset)[..., 0]
        return np.concatenate([1 - along.sum(axis=2, keepdims=True), along], axis=2)
    xi: Array = np.full(x.shape, 0.5)
    for _ in range(20):
        values, slopes = _bilinear(xi)
        off = np.einsum("nqk,nka->nqa", values, corners) - x
        jacobian = np.einsum("nqkb,nka->nqab", slopes, corners)
        step = np.linalg.solve(jacobian, off[..., None])[..., 0]
        xi -= step
        if np.max(np.abs(step), initial=0.0) < 1e-14:
            break
    return _bilinear(xi)[0]


def _bilinear(xi: Array) -> tuple[Array, Array]:
    """The bilinear basis in tensor order, and its derivatives (..., 4, 2)."""
    a, b = xi[..., 0], xi[..., 1]
    values = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=-1)
    by_a = np.stack([b - 1, 1 - b, -b, b], axis=-1)
    by_b = np.stack([a - 1, -a, 1 - a, a], axis=-1)
    return values, np.stack([by_a, by_b], axis=-1)
