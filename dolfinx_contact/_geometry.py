# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry: nodes of meshes, sorting of points, rowwise vector algebra, area vectors."""

from __future__ import annotations

import weakref
import zlib
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Ints

if TYPE_CHECKING:
    from mpi4py import MPI

    from dolfinx import fem, mesh

__all__ = [
    "Gathered",
    "along_tangent",
    "area_vector_rates",
    "area_vectors",
    "balls",
    "by_coordinates",
    "connected_parts",
    "curves",
    "dot",
    "edges_of",
    "global_numbers",
    "in_space",
    "listed_pairs",
    "mesh_mark",
    "node_positions",
    "plane_tangents",
    "ratio",
    "rounded",
    "tangential",
    "transformed",
    "unit",
    "unit_rates",
    "unit_tangents",
]

T = TypeVar("T", bound=np.generic)

_SAME = 1e-9  # difference, relative to the largest extent, that counts as round-off
_TINY = 1e-300  # length below which a vector is not normalised
#: Node positions of the living spaces, with the checksum of their mesh. DOLFINx visits all cells
#: for them at each call, which takes fifty times as long as the checksum (measured).
_positions: dict[int, tuple[weakref.ref[Any], int, Array]] = {}


def mesh_mark(domain: mesh.Mesh) -> int:
    """Return a checksum of the node coordinates of a mesh on this rank, to detect motion."""
    return zlib.crc32(np.ascontiguousarray(domain.geometry.x))


def node_positions(V: fem.FunctionSpace) -> Array:
    """Return the positions of the local nodes of a space, ghosts included, shape (nodes, dim).

    Not collective. The array is read-only and cached.
    """
    key = id(V)
    space, mark, x = _positions.get(key, (None, 0, np.zeros((0, 3))))
    now = mesh_mark(V.mesh)
    if space is None or space() is not V or mark != now:
        x = np.ascontiguousarray(V.tabulate_dof_coordinates()[:, : V.mesh.geometry.dim])
        x.flags.writeable = False
        _positions[key] = weakref.ref(V, lambda _: _positions.pop(key, None)), now, x
    return x


def rounded(x: Array) -> Array:
    """Round coordinates to nine digits, relative to the largest coordinate."""
    size = 10.0 ** np.ceil(np.log10(np.max(np.abs(x), initial=1e-300)))
    return np.round(x / size, 9) * size + 0.0


def global_numbers(index_map: Any, local: npt.NDArray[Any]) -> Ints:
    """Return the global indices of local indices of an index map, in the same shape."""
    numbers = index_map.local_to_global(local.reshape(-1).astype(np.int32))
    return np.asarray(numbers, dtype=np.int64).reshape(local.shape)


def listed_pairs(lists: Sequence[Sequence[int]]) -> tuple[Ints, Ints]:
    """Return all pairs (i, k) for which k is in ``lists[i]``, as an array of i and one of k."""
    sizes = [len(part) for part in lists]
    numbers = np.fromiter(chain.from_iterable(lists), dtype=np.int64, count=sum(sizes))
    return np.repeat(np.arange(len(sizes)), sizes), numbers


def connected_parts(count: int, first: Ints, second: Ints) -> Ints:
    """Return, for each vertex of a graph, the index of its connected component, shape (count,).

    Args:
        count: number of vertices.
        first: vertex at one end of each link.
        second: vertex at the other end.
    """
    from scipy import sparse  # a static solve does not need it

    links = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    found = sparse.csgraph.connected_components(links, directed=False)[1]
    return np.asarray(found, dtype=np.int64)


def curves(facets: Ints) -> list[tuple[Ints, Ints]]:
    """Return the curves formed by facets in 2D, sorted by the smallest vertex number of each.

    An open curve begins at the end with the smaller number. A closed curve begins and ends at its
    vertex with the smallest number.

    Args:
        facets: vertices of the facets, shape (n, 2).

    Returns:
        Indices of the k facets of each curve in order, shape (k,), and vertices, shape (k + 1,).
    """
    at_vertex: dict[int, list[int]] = {}
    for number in range(len(facets)):
        for v in facets[number]:
            at_vertex.setdefault(int(v), []).append(number)
    used = np.zeros(len(facets), dtype=bool)
    found = []
    # open curves first, from their ends
    for start in sorted(at_vertex, key=lambda v: (len(at_vertex[v]) > 1, v)):
        numbers: list[int] = []
        vertices = [start]
        while following := [k for k in at_vertex[vertices[-1]] if not used[k]]:
            numbers.append(following[-1])
            used[numbers[-1]] = True
            vertices.append(int(facets[numbers[-1]].sum()) - vertices[-1])
        if numbers:
            found.append((np.array(numbers), np.array(vertices)))
    return sorted(found, key=lambda curve: int(curve[1].min()))


def by_coordinates(x: Array, ids: Ints | None = None) -> npt.NDArray[np.intp]:
    """Return the indices that sort points by x, then y, then z, ignoring round-off.

    Args:
        x: positions, shape (n, dim).
        ids: integer keys that distinguish points with equal coordinates, such as both sides of a
            crack, independent of the ranks, shape (n, k); default: none.
    """
    ids = np.zeros((len(x), 0), dtype=np.int64) if ids is None else ids
    least = _SAME * np.ptp(x, axis=0).max(initial=0.0)
    keys = [_grouped(column, least) for column in x.T]
    return np.lexsort([*ids.T[::-1], *keys[::-1]])


def _grouped(values: Array, least: float) -> Ints:
    """Return the rank of each value in increasing order; steps up to ``least`` share a rank."""
    order = np.argsort(values)
    steps = np.diff(values[order]) > least
    places: Ints = np.zeros(len(values), dtype=np.int64)
    places[order[1:]] = np.cumsum(steps)
    return places


class Gathered:
    """Points of all ranks in the order of their coordinates, on every rank. Collective.

    Args:
        comm: communicator.
        x: positions of the points of this rank, shape (n, dim).
        ids: integer keys distinguishing equal coordinates (`by_coordinates`), shape (n, k).

    Attributes:
        positions: positions of all points, in order, shape (number of points, dim).
        mine: indices of the points of this rank among all points, shape (n,).
    """

    def __init__(self, comm: MPI.Comm, x: Array, ids: Ints) -> None:
        self._comm = comm
        parts = comm.allgather((x, ids))
        everywhere = np.concatenate([places for places, _ in parts])
        self._order = by_coordinates(everywhere, np.concatenate([names for _, names in parts]))
        self._starts = np.concatenate([[0], np.cumsum([len(places) for places, _ in parts])])
        self.positions = everywhere[self._order]
        places = np.argsort(self._order)
        first = self._starts[comm.rank]
        self.mine: Ints = places[first : first + len(x)]

    def __len__(self) -> int:
        """Number of points of all ranks."""
        return len(self.positions)

    def __call__(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Return values of all ranks in the order of all points. Collective.

        ``values`` contains one value or row for each point of this rank.
        """
        return np.concatenate(self._comm.allgather(values))[self._order]

    def columns(self, values: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Return arrays of all ranks, by name, each in the order of all points. Collective."""
        parts = self._comm.allgather(dict(values))
        return {k: np.concatenate([part[k] for part in parts])[self._order] for k in values}

    def owner(self, i: int) -> tuple[int, int]:
        """Return the rank owning point ``i``, and the index of the point on that rank."""
        place = int(self._order[i])
        rank = int(np.searchsorted(self._starts, place, side="right") - 1)
        return rank, place - int(self._starts[rank])


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products of vectors of shape (..., dim)."""
    return np.einsum("...i,...i->...", a, b)  # twice as fast as a sum of products


def tangential(v: Array, n: Array) -> Array:
    """Return the parts of vectors v perpendicular to unit normals n, shape (..., dim)."""
    return v - dot(v, n)[..., None] * n


def transformed(A: Array, v: Array) -> Array:
    """Return products of matrices, shape (..., i, j), and vectors, shape (..., j)."""
    return (A @ v[..., None])[..., 0]


def unit(v: Array) -> Array:
    """Normalise vectors of shape (..., dim); zero vectors remain zero."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), _TINY)


def unit_rates(n: Array, length: Array) -> Array:
    """Return derivatives of unit vectors n = m / |m| with respect to m, shape (..., dim, dim).

    Args:
        n: unit vectors, shape (..., dim).
        length: norms of the vectors m, shape (...,).
    """
    normal_part = n[..., :, None] * n[..., None, :]
    return (np.eye(n.shape[-1]) - normal_part) / length[..., None, None]


def plane_tangents(n: Array) -> Array:
    """Return the tangents t = (-n_y, n_x) for m unit normals n in 2D, shape (m, 2)."""
    return np.stack([-n[:, 1], n[:, 0]], axis=1)


def unit_tangents(n: Array) -> Array:
    """Return orthonormal tangents for m unit normals, as columns, shape (m, dim, dim - 1)."""
    if n.shape[1] == 2:
        return plane_tangents(n)[:, :, None]
    axis = np.eye(3)[np.abs(n).argmin(axis=1)]
    first = unit(np.cross(n, axis))
    return np.stack([first, np.cross(n, first)], axis=2)


def along_tangent(v: Array, n: Array) -> Array:
    """Return the components of m vectors in 2D along the `plane_tangents` of n, shape (m,)."""
    return v[:, 1] * n[:, 0] - v[:, 0] * n[:, 1]


def in_space(vectors: Array) -> Array:
    """Return m vectors with three components, shape (m, 3); in 2D the z-component is 0."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def ratio(a: Array, b: Array) -> Array:
    """Return a/b for arrays of the same shape; 0 where b is not positive."""
    return np.divide(a, b, out=np.zeros_like(b), where=b > 0)


def balls(x: Array) -> tuple[Array, Array]:
    """Return a ball around each of n facets, centred at the mean of the corners.

    Args:
        x: corners of the facets, k per facet, shape (n, k, dim).

    Returns:
        Centres, shape (n, dim), and radii, shape (n,).
    """
    middles = x.mean(axis=1)
    return middles, np.linalg.norm(x - middles[:, None], axis=2).max(axis=1, initial=0.0)


def area_vectors(x: Array) -> Array:
    """Return the area vectors of n facets, normals with the area as norm, shape (n, dim).

    The order of the corners determines the orientation.

    Args:
        x: corners of the facets, k per facet, shape (n, k, dim).
    """
    if x.shape[2] == 2:
        along = x[:, 1] - x[:, 0]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    first, second = edges_of(x)
    return 0.5 * np.cross(first, second)


def area_vector_rates(x: Array) -> Array:
    """Return derivatives of `area_vectors` with respect to the corners, shape (n, dim, k, dim)."""
    n, k, dim = x.shape
    rates = np.zeros((n, dim, k, dim))
    if dim == 2:
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        rates[:, :, 0] = -turn
        rates[:, :, 1] = turn
        return rates
    first, second = edges_of(x)
    (a, b), (c, d) = ((1, 0), (2, 0)) if k == 3 else ((3, 0), (2, 1))
    by_first = -0.5 * _crossing(second)
    by_second = 0.5 * _crossing(first)
    rates[:, :, a] += by_first
    rates[:, :, b] -= by_first
    rates[:, :, c] += by_second
    rates[:, :, d] -= by_second
    return rates


def edges_of(x: Array) -> tuple[Array, Array]:
    """Return two edges of each 3D triangle, or both diagonals of each quadrilateral.

    The corners of quadrilaterals, shape (n, 4, 3), are in tensor-product order.
    """
    if x.shape[1] == 3:
        return x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    return x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]


def _crossing(v: Array) -> Array:
    """Return the matrices C of cross products C w = v x w with n vectors v, shape (n, 3, 3)."""
    upper = np.zeros((len(v), 3, 3))
    upper[:, 0, 1] = -v[:, 2]
    upper[:, 0, 2] = v[:, 1]
    upper[:, 1, 2] = -v[:, 0]
    return upper - upper.transpose(0, 2, 1)
