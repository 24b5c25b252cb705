# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spatial search among the points and facets of all ranks.

No rank stores all points. Each rank queries the ranks whose bounding boxes may contain the required
points; these ranks search their own points in a tree and send the results back. Points have named
data: `Columns` maps names to arrays with one entry per point; ``"x"`` is the name of the positions.

Facets are found by balls around them. Small sliding searches once, around the nearest facets
(`opposing_facets`); large sliding searches again after large displacements, within a given distance
(`facets_along_normals`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy

import basix
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._geometry import (
    dot,
    global_numbers,
    listed_pairs,
    node_positions,
    tangential,
)
from dolfinx_contact._mpi import maximum
from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.trace import facet_closures, facet_normals, owned_facets

__all__ = ["Columns", "around", "faces_of", "facets_along_normals", "nearest", "opposing_facets"]

#: Data of points by name, arrays of shape (n, ...).
Columns = Mapping[str, npt.NDArray[Any]]
#: Function from a `scipy.spatial.cKDTree` of points and data of queries to pairs of indices of
#: queries and points. (SciPy loads its trees at the first search.)
Selection = Callable[[Any, Columns], tuple[Ints, Ints]]


def _in_balls(tree: scipy.spatial.cKDTree, questions: Columns) -> tuple[Ints, Ints]:
    """Return pairs of a query and a point of the tree within the distance of the query.

    Queries have positions ``"x"`` and distances ``"reach"``. The pairs are two arrays of indices.
    """
    return listed_pairs(tree.query_ball_point(questions["x"], questions["reach"]))


def _nearest_in(tree: scipy.spatial.cKDTree, questions: Columns) -> tuple[Ints, Ints]:
    """Return indices of the queries (positions ``"x"``) and of their nearest points in a tree."""
    found = tree.query(questions["x"])[1]
    return np.arange(len(found)), found


def nearest(comm: MPI.Comm, known: Columns, x: Array) -> dict[str, npt.NDArray[Any]]:
    """Return the data of the nearest point, of any rank, for each query position. Collective.

    Args:
        comm: communicator.
        known: points of this rank with their data.
        x: query positions of this rank, shape (n, dim).

    Returns:
        Data of the nearest points, shape (n, ...); infinite positions if no rank has a point.
    """
    _, far = _distances_of_boxes(comm, known["x"], x)
    reach = np.nanmin(far, axis=0, initial=np.inf) * (1 + 1e-12)
    i, found = around(comm, known, {"x": x, "reach": reach}, _nearest_in)
    order = np.lexsort((np.linalg.norm(found["x"] - x[i], axis=1), i))
    places, first = np.unique(i[order], return_index=True)
    best = {name: np.zeros((len(x), *v.shape[1:]), v.dtype) for name, v in found.items()}
    best["x"] += np.inf
    for name, values in found.items():
        best[name][places] = values[order[first]]
    return best


def around(
    comm: MPI.Comm, known: Columns, wanted: Columns, select: Selection = _in_balls
) -> tuple[Ints, dict[str, npt.NDArray[Any]]]:
    """Return all points, of any rank, within a distance of each query position. Collective.

    Args:
        comm: communicator.
        known: points of this rank with their data.
        wanted: queries of this rank: positions ``"x"``, distances ``"reach"``, and further data for
            ``select``.
        select: function returning pairs of queries and known points, called on the rank of the
            points; default: all points within the distance.

    Returns:
        Pairs of a query and a point: indices of the queries, shape (pairs,), and data of the
        points, shape (pairs, ...).
    """
    questions = []
    for near in _distances_of_boxes(comm, known["x"], wanted["x"])[0]:
        asked = np.flatnonzero(near <= wanted["reach"])
        questions.append({"place": asked} | {name: v[asked] for name, v in wanted.items()})
    tree = scipy.spatial.cKDTree(known["x"]) if len(known["x"]) else None
    answers = []
    for q in comm.alltoall(questions):
        i: Ints = np.zeros(0, dtype=np.int64)
        k = i
        if tree is not None and len(q["x"]):
            i, k = select(tree, q)
        answers.append({"place": q["place"][i]} | {name: v[k] for name, v in known.items()})
    parts = comm.alltoall(answers)
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return found.pop("place"), found


def _distances_of_boxes(comm: MPI.Comm, known: Array, x: Array) -> tuple[Array, Array]:
    """Return distances of positions from the bounding boxes of all ranks. Collective.

    Args:
        comm: communicator.
        known: points in the bounding box of this rank, shape (m, dim).
        x: positions, shape (n, dim).

    Returns:
        Distances to the nearest and to the farthest point of each box, shape (ranks, n); NaN for
        ranks without points.
    """
    box = np.full((2, x.shape[1]), np.nan)
    if len(known):
        box[:] = known.min(axis=0), known.max(axis=0)
    boxes = np.array(comm.allgather(box))
    below = boxes[:, 0, None] - x
    above = x - boxes[:, 1, None]
    near = np.linalg.norm(np.maximum(below, above).clip(0.0), axis=2)
    return near, np.linalg.norm(np.maximum(np.abs(below), np.abs(above)), axis=2)


def faces_of(V: fem.FunctionSpace, facets: Indices) -> Faces:
    """Return the owned facets among ``facets``, with their corners, normals and nodes."""
    domain = V.mesh
    dim = V.mesh.geometry.dim
    owned = owned_facets(domain, facets)
    closures = facet_closures(V, owned)
    corners = len(basix.topology(domain.basix_cell())[dim - 1][0])
    x = node_positions(V)[closures[:, :corners]]
    nodes = global_numbers(V.dofmap.index_map, closures)
    return Faces(x, facet_normals(domain, owned), nodes)


def facets_along_normals(
    comm: MPI.Comm,
    slave: Faces,
    master: Columns,
    radii: Array,
    depth: Array,
    skin: float = 0.0,
) -> tuple[dict[str, npt.NDArray[Any]], Ints]:
    """Return master facets, of any rank, that the normals of slave facets may meet. Collective.

    A master facet is returned if it lies within a given distance in front of or behind a slave
    facet along its normal, and both facets may overlap perpendicular to this normal.

    Args:
        comm: communicator.
        slave: slave facets of this rank.
        master: midpoints ``"x"`` of the master facets of this rank, ``"key"`` that identifies a
            facet, shape (m, k), and other data.
        radii: radii of balls around the midpoints that contain the facets, shape (m,).
        depth: search distance along the normal of each slave facet, shape (n,).
        skin: additional distance.

    Returns:
        Data of the facets, each once in the order of the keys, and pairs of indices of slave and
        master facets in ascending order, shape (pairs, 2).
    """
    middles, across = slave.balls
    across = across + skin
    largest = maximum(comm, radii)
    reach = np.hypot(depth + across + largest, across + largest)
    wanted = {"x": middles, "normal": slave.normals, "across": across, "depth": depth}
    select = partial(_near_rays, radii=radii)
    i, found = around(comm, master, wanted | {"reach": reach}, select)
    _, first, k = np.unique(found["key"], axis=0, return_index=True, return_inverse=True)
    pairs = np.column_stack([i, k.reshape(-1)])
    facets = {name: values[first] for name, values in found.items()}
    return facets, pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def opposing_facets(comm: MPI.Comm, slave: Faces, master: Faces) -> tuple[Faces, Ints]:
    """Return facets of the master, of any rank, that may oppose slave facets. Collective.

    A master facet opposing a slave facet at an angle of less than 60 degrees is at most twice as
    far away as the nearest facet, plus half the sizes of both.

    Returns:
        Master facets, and pairs of indices of slave and master facets, shape (pairs, 2).
    """
    middles, radius = slave.balls
    others, theirs = master.balls
    largest = maximum(comm, theirs)
    distance = np.linalg.norm(nearest(comm, {"x": others}, middles)["x"] - middles, axis=1)
    reach = 2 * (distance + largest) + radius
    known = {"x": others, "key": master.nodes, "corners": master.x, "normal": master.normals}
    found, pairs = facets_along_normals(comm, slave, known, theirs, reach)
    i, k = pairs.T
    near = np.linalg.norm(found["x"][k] - middles[i], axis=1) <= reach[i]
    return Faces(found["corners"], found["normal"], found["key"]), pairs[near]


# -- search on a rank ------------------------------------------------------------------------------


def _near_rays(tree: scipy.spatial.cKDTree, q: Columns, radii: Array) -> tuple[Ints, Ints]:
    """Return the pairs of a ray and a ball of this rank that reaches into a cylinder around it.

    Rays are bisected, and parts without a ball nearby are discarded, so that the cost grows with
    the number of balls along the rays, not within their length.

    Args:
        tree: centres of the balls of this rank.
        q: rays: midpoints ``"x"``, directions ``"normal"``, half lengths ``"depth"``, and radii
            ``"across"`` of the cylinders around them.
        radii: radii of the balls, shape (m,).
    """
    across = q["across"] + float(radii.max())
    half = q["depth"] + across
    i = np.arange(len(across))
    at = np.zeros(len(across))
    while True:
        middles = q["x"][i] + at[:, None] * q["normal"][i]
        reach = np.hypot(half, across)[i]
        near = tree.query(middles)[0] <= reach
        i, at, middles, reach = i[near], at[near], middles[near], reach[near]
        if np.all(half <= across):
            break
        half = half / 2
        at = np.concatenate([at - half[i], at + half[i]])
        i = np.concatenate([i, i])
    parts, k = listed_pairs(tree.query_ball_point(middles, reach))
    pairs = np.unique(i[parts] * tree.n + k)
    i, k = pairs // tree.n, pairs % tree.n
    off = tree.data[k] - q["x"][i]
    along = dot(off, q["normal"][i])
    aside = np.linalg.norm(tangential(off, q["normal"][i]), axis=1)
    limit = q["across"][i] + radii[k]
    kept = (np.abs(along) <= q["depth"][i] + limit) & (aside <= limit)
    return i[kept], k[kept]
