# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How far the bodies of a pair have slid and turned since the reference configuration.

In small sliding a contact point keeps the point opposite to it in the reference configuration,
along the normal n there, so that its gap changes by -j.n, j the jump of the displacement from that
opposing point. The displaced facets of the master show which point is opposite now: the nearest
place on them, the distance from it, and whether that is their edge. Facets of degree 2 and
quadrilaterals are taken apart into simplices. Normals, means over the facets around a node, have
turned by as much as the angle between them and that of the law has grown: that of two round faces
which flatten each other becomes less.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

import basix
from dolfinx import fem

from dolfinx_contact._mesh_mark import node_positions
from dolfinx_contact._shared import SharedValues
from dolfinx_contact.points.clipping import basis, nodal_points
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator
from dolfinx_contact.points.search import exchanged, nearest, ranks_nearby
from dolfinx_contact.points.trace import facet_closures, facet_normals

__all__ = ["Moved", "PairMotion"]

Array = npt.NDArray[np.float64]

_SAME = 1e-9  # relative, of distances that are the same
_LEAST_COSINE = 0.5  # between the normal of the law and that of the master


@dataclass(frozen=True)
class Moved:
    """What has happened to the contact points of this rank since the reference configuration.

    Attributes:
        distance: along the surface, relative to the point that was opposite (n,).
        facet: width of the facet of the master that was opposite (n,).
        beyond: how far the point is beyond the edge of the master, more than it was (n,).
        turn: by how much the normal of slave or master there is farther from that of the law, an
            angle in radians (n,).
        opened: by how much the point is farther from the master, along its normal (n,).
        linear: the same of the law, -j.n (n,).
        facing: whether a facet of the master is opposite now (n,).
    """

    distance: Array
    facet: Array
    beyond: Array
    turn: Array
    opened: Array
    linear: Array
    facing: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class _Places:
    """The nearest places on the master to points (n,).

    Attributes:
        gap: along the normals of the master.
        aside: distance across them, of points beyond an edge; of others 0, round-off left out.
        normal: of the master (n, dim).
        moved: displacement of the place (n, dim).
        mean: mean normal of the facets around it (n, dim).
        facet: width.
    """

    gap: Array
    aside: Array
    normal: Array
    moved: Array
    mean: Array
    facet: Array


class PairMotion:
    """How the bodies of a pair have moved against each other.

    Args:
        u: displacement of all bodies.
        points: of the slave.
        slave: local facets, ghosts included.
        master: likewise.
    """

    def __init__(
        self,
        u: fem.Function,
        points: ContactPoints,
        slave: npt.NDArray[np.int32],
        master: npt.NDArray[np.int32],
    ):
        self._u = u
        self._points = points
        self._slave = slave
        domain = u.function_space.mesh
        V = u.function_space
        owned = domain.topology.index_map(domain.topology.dim - 1).size_local
        self._master = master[master < owned]
        self._V = V
        self._comm = domain.comm
        self._dim = domain.geometry.dim
        self._corners = len(basix.topology(domain.basix_cell())[self._dim - 1][0])
        self._samples, self._simplices = _simplices(self._corners, V.ufl_element().degree)
        self._normals: tuple[fem.Function, fem.Function] | None = None
        self._evaluate: Evaluator | None = None

    def __call__(self) -> Moved:
        """What has happened in the displacement in the Function. Collective."""
        u = self._u.x.array.reshape(-1, self._dim)
        x, y, mine = self._points_at(u, self._turning(self._slave, u))
        rows = self._rows(u, self._turning(self._master, u))
        before = self._nearest(x, rows, now=False)
        after = self._nearest(y, rows, now=True)
        n = self._points.data.n
        turn = _angle(n, mine[:, self._dim :]) - _angle(n, mine[:, : self._dim])
        turn = np.maximum(turn, _angle(n, -after.mean) - _angle(n, -before.mean))
        jump = (y - x) - before.moved
        along = np.sum(jump * n, axis=1)
        cosine = np.clip(-np.sum(n * before.normal, axis=1), _LEAST_COSINE, 1.0)
        return Moved(
            np.linalg.norm(jump - along[:, None] * n, axis=1),
            before.facet,
            np.maximum(after.aside - before.aside, 0.0),
            np.maximum(turn, 0.0),
            (after.gap - before.gap) / cosine,
            -along,
            (np.sum(n * after.normal, axis=1) < -_LEAST_COSINE) & (after.aside == 0.0),
        )

    def _points_at(self, u: Array, normals: Array) -> tuple[Array, Array, Array]:
        """Positions of the points, those in the displacement, and normals at them. Collective."""
        x = self._points.positions
        n = self._points.number
        dim = self._dim
        if self._points.method != "integral":
            nodes = self._points.vertex_trace_dofs[:n]
            return x, x + u[nodes], normals[nodes]
        if self._evaluate is None or self._normals is None:
            W = fem.functionspace(self._V.mesh, ("Lagrange", 1, (dim,)))
            self._normals = fem.Function(W), fem.Function(W)
            names = dict(zip(("before", "after"), self._normals, strict=True))
            self._evaluate = self._points.evaluator({"moved": self._u, **names})
        for f, at_nodes in zip(self._normals, np.hsplit(normals, 2), strict=True):
            nodes = f.function_space.dofmap.list
            vertices = self._V.dofmap.list[:, : nodes.shape[1]]
            f.x.array.reshape(-1, dim)[nodes.reshape(-1)] = at_nodes[vertices.reshape(-1)]
        values = self._evaluate()
        both = np.hstack([values["before"][:n], values["after"][:n]])
        return x, x + values["moved"][:n], both

    def _turning(self, facets: npt.NDArray[np.int32], u: Array) -> Array:
        """Normals of a face at the local nodes, before and after (nodes, 2 dim). Collective."""
        V = self._V
        dim = self._dim
        domain = self._V.mesh
        owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
        closures = facet_closures(V, owned)
        corners = closures[:, : self._corners]
        X = node_positions(V)[:, :dim]
        before, after = (_area_vectors(v[corners]) for v in (X, X + u))
        outward = np.sign(np.sum(before * facet_normals(domain, owned), axis=1))[:, None]
        both = np.hstack([outward * before, outward * after])
        at_nodes = np.repeat(both[:, None], closures.shape[1], axis=1)
        parts = np.hsplit(SharedValues(V.dofmap.index_map).sums(closures, at_nodes), 2)
        return np.hstack([_unit(v) for v in parts])

    # -- the master ------------------------------------------------------------------------------

    def _rows(self, u: Array, normals: Array) -> Array:
        """Simplices of the owned facets: corners, displacements, normals there, width, sense."""
        dim = self._dim
        facets = self._master
        closures = facet_closures(self._V, facets)
        X = node_positions(self._V)[:, :dim][closures]
        values = np.concatenate([X, u[closures], normals[closures]], axis=2)
        values = np.einsum("sn,fnc->fsc", self._samples, values)[:, self._simplices]
        outward = facet_normals(self._V.mesh, facets, unit=False)
        width = np.linalg.norm(outward, axis=1) ** (1 / (dim - 1))
        n = len(facets)
        k = len(self._simplices)
        values = values.reshape(n * k, dim, 4 * dim)
        sense = np.sum(_area_vectors(values[:, :, :dim]) * np.repeat(outward, k, axis=0), axis=1)
        columns = [values.reshape(n * k, 4 * dim**2), np.repeat(width, k), np.sign(sense)]
        return np.column_stack(columns)

    def _nearest(self, wanted: Array, rows: Array, *, now: bool) -> _Places:
        """The nearest places on the master. Collective.

        Args:
            wanted: points of this rank (n, dim).
            rows: of the master.
            now: whether it is displaced, or in the reference configuration.
        """
        comm = self._comm
        dim = self._dim
        corners = _corners(_values(rows, dim), now=now)
        middles = corners.mean(axis=1)
        radius = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1, initial=0.0)
        largest = comm.allreduce(float(np.max(radius, initial=0.0)), op=max)
        near = np.linalg.norm(nearest(comm, middles, wanted, dim) - wanted, axis=1)
        reach = near * (1 + _SAME)
        places, _ = ranks_nearby(comm, middles, wanted, lambda low, _: low <= reach + largest)
        sent: Any = [np.column_stack([wanted[i], reach[i], i]) for i in places]
        search = _Search(middles, radius)
        answers: list[Array] = []
        for q in exchanged(comm, sent, (dim + 2,)):
            i, k = search(q[:, :dim], q[:, dim])
            answers.append(np.column_stack([q[i, dim + 1], rows[k]]))
        found = np.concatenate(exchanged(comm, answers, (rows.shape[1] + 1,)))
        return _places(wanted, found[:, 0].astype(np.int64), found[:, 1:], now=now)


class _Search:
    """Which of some simplices may be nearest to a point: in trees of those of like size."""

    def __init__(self, middles: Array, radius: Array):
        size = np.frexp(radius)[1]
        self._parts = []
        for power in np.unique(size):
            mine = np.flatnonzero(size == power)
            tree = scipy.spatial.cKDTree(middles[mine])
            self._parts.append((mine, float(radius[mine].max()), tree))

    def __call__(self, x: Array, reach: Array) -> tuple[Any, Any]:
        """Numbers of points and of simplices, the middles of which are within reach and a radius.

        Args:
            x: points (n, dim).
            reach: an upper bound of their distances to the nearest simplex (n,).
        """
        points: list[npt.NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
        simplices = list(points)
        for mine, radius, tree in self._parts if len(x) else []:
            for i, found in enumerate(tree.query_ball_point(x, reach + radius)):
                points.append(np.full(len(found), i, dtype=np.int64))
                simplices.append(mine[np.asarray(found, dtype=np.int64)].astype(np.int64))
        return np.concatenate(points), np.concatenate(simplices)


def _places(wanted: Array, point: npt.NDArray[np.int64], rows: Array, *, now: bool) -> _Places:
    """The nearest places to points, of which every one has some rows. Not collective."""
    dim = wanted.shape[1]
    values = _values(rows, dim)
    corners = _corners(values, now=now)
    weights = _closest(corners, wanted[point])
    off = wanted[point] - np.einsum("nk,nkd->nd", weights, corners)
    normal = _area_vectors(corners) * rows[:, -1:]
    normal = _unit(normal)
    gap = np.sum(off * normal, axis=1)
    distance = np.linalg.norm(off, axis=1)
    aside = np.linalg.norm(off - gap[:, None] * normal, axis=1)
    least: Array = np.full(len(wanted), np.inf)
    np.minimum.at(least, point, distance)
    width = rows[:, -2]
    tied = distance <= least[point] * (1 + _SAME) + _SAME * width
    # Of several at one distance, as around a corner, the one that is most opposite.
    order = np.lexsort((aside, ~tied, point))
    first = order[np.searchsorted(point[order], np.arange(len(wanted)))]
    moved = np.einsum("nk,nkd->nd", weights, values[:, :, dim : 2 * dim])
    means = values[:, :, 3 * dim :] if now else values[:, :, 2 * dim : 3 * dim]
    mean = _unit(np.einsum("nk,nkd->nd", weights, means))
    # Round-off is no distance.
    aside = np.where(aside <= _SAME * width, 0.0, aside)
    found = gap, aside, normal, moved, mean, width
    return _Places(*(np.asarray(v[first]) for v in found))


def _values(rows: Array, dim: int) -> Array:
    """What is known at the corners of simplices (n, dim, 4 dim)."""
    return rows[:, :-2].reshape(len(rows), dim, 4 * dim)


def _corners(values: Array, *, now: bool) -> Array:
    """Corners of simplices (n, dim, dim), displaced or not."""
    dim = values.shape[1]
    x = values[:, :, :dim]
    return np.asarray(x + values[:, :, dim : 2 * dim] if now else x)


def _unit(v: Array) -> Array:
    """Vectors (n, dim) of length one, zero where they vanish."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1), 1e-300)[:, None])


def _angle(a: Array, b: Array) -> Array:
    """Angles between unit vectors (n, dim)."""
    half = np.linalg.norm(_unit(b) - a, axis=1) / 2
    return np.asarray(2 * np.arcsin(np.minimum(half, 1.0)))


def _area_vectors(x: Array) -> Array:
    """Normals of facets or simplices (n, k, dim), as long as they are large, of either sense."""
    if x.shape[2] == 2:
        along = x[:, 1] - x[:, 0]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    if x.shape[1] == 3:
        first, second = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    else:
        first, second = x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]
    return np.asarray(0.5 * np.cross(first, second))


def _closest(corners: Array, y: Array) -> Array:
    """Barycentric coordinates (n, k) of the places of simplices that are nearest to points."""
    if corners.shape[1] == 2:
        return _on_edge(corners[:, 0], corners[:, 1], y)
    a, b, c = corners.transpose(1, 0, 2)
    p = b - a
    q = c - a
    r = y - a
    pp = np.sum(p * p, axis=1)
    pq = np.sum(p * q, axis=1)
    qq = np.sum(q * q, axis=1)
    rp = np.sum(r * p, axis=1)
    rq = np.sum(r * q, axis=1)
    det = np.maximum(pp * qq - pq**2, 1e-300)
    s = (qq * rp - pq * rq) / det
    t = (pp * rq - pq * rp) / det
    best = np.stack([1 - s - t, s, t], axis=1)
    least = np.where((best >= 0).all(axis=1), -np.inf, np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        on = _on_edge(corners[:, i], corners[:, j], y)
        weights = np.zeros_like(best)
        weights[:, i] = on[:, 0]
        weights[:, j] = on[:, 1]
        square = np.sum((np.einsum("nk,nkd->nd", weights, corners) - y) ** 2, axis=1)
        closer = square < least
        best[closer] = weights[closer]
        least[closer] = square[closer]
    return best


def _on_edge(a: Array, b: Array, y: Array) -> Array:
    """Weights (n, 2) of the ends of segments, of the places that are nearest to points."""
    along = b - a
    square = np.maximum(np.sum(along**2, axis=1), 1e-300)
    t = np.clip(np.sum((y - a) * along, axis=1) / square, 0.0, 1.0)
    return np.stack([1 - t, t], axis=1)


def _simplices(corners: int, degree: int) -> tuple[Array, npt.NDArray[np.int64]]:
    """Samples of a facet, as weights of its nodes (samples, nodes), and simplices of them."""
    points = nodal_points(corners, degree)
    samples = np.eye(len(points))
    if corners == 2:
        order = np.argsort(points[:, 0])
        return samples, np.stack([order[:-1], order[1:]], axis=1).astype(np.int64)
    if corners == 3 and degree == 1:
        return samples, np.array([[0, 1, 2]], dtype=np.int64)
    middle = points[:corners].mean(axis=0)
    at = np.flatnonzero(np.linalg.norm(points - middle, axis=1) < 1e-9)
    around = np.setdiff1d(np.arange(len(points)), at)
    if len(at) == 0:
        samples = np.vstack([samples, basis(middle, corners, degree)])
        at = np.array([len(points)])
    direction = points[around] - middle
    loop = around[np.argsort(np.arctan2(direction[:, 1], direction[:, 0]))]
    fan = [[at[0], a, b] for a, b in zip(loop, np.roll(loop, -1), strict=True)]
    return samples, np.array(fan, dtype=np.int64)
