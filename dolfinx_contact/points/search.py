# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spatial search among the points of all ranks.

No rank holds all points. Each rank queries the ranks whose bounding boxes may contain the required
points; these search their own points in a tree and send the answers back. Points have named data:
`Columns` maps names to arrays with one entry per point, and ``"x"`` is the position. Data are sent
as numbers in double precision, which is exact for integers below 2^53.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy

from dolfinx_contact._arrays import Array, Ints

__all__ = ["Columns", "around", "near_rays", "nearest"]

#: Data of points by name, arrays of shape (n, ...).
Columns = Mapping[str, npt.NDArray[Any]]
#: Function from a `scipy.spatial.cKDTree` of points and data of questions to pairs of numbers of
#: questions and points. (SciPy loads its trees at the first search.)
Selection = Callable[[Any, Columns], tuple[Ints, Ints]]


def nearest(comm: MPI.Comm, known: Columns, x: Array) -> dict[str, npt.NDArray[Any]]:
    """Return the data of the known point, of any rank, nearest to each place. Collective.

    Args:
        comm: communicator.
        known: points of this rank.
        x: places of this rank, shape (n, dim).

    Returns:
        Data of the nearest points, shape (n, ...); infinite positions if no rank has a point.
    """
    rows = _packed(known)
    dim = x.shape[1]
    boxes = _Boxes(comm, known["x"], x)
    ranks = boxes.near <= np.nanmin(boxes.far, axis=0, initial=np.inf) * (1 + 1e-12)
    places = [np.flatnonzero(asked) for asked in ranks]
    questions = _exchanged(comm, [x[i] for i in places])
    tree = boxes.tree
    answers = [
        rows[tree.query(q)[1]] if tree is not None and len(q) else rows[:0] for q in questions
    ]
    best = np.full((len(x), rows.shape[1]), np.inf)
    distance = np.full(len(x), np.inf)
    for i, part in zip(places, _exchanged(comm, answers), strict=True):
        d = np.linalg.norm(part[:, :dim] - x[i], axis=1)
        closer = d < distance[i]
        best[i[closer]] = part[closer]
        distance[i[closer]] = d[closer]
    return _unpacked(best, known)


def in_balls(tree: scipy.spatial.cKDTree, questions: Columns) -> tuple[Ints, Ints]:
    """Return pairs of questions and points of a tree within their distances."""
    return _pairs(tree.query_ball_point(questions["x"], questions["reach"]))


def around(
    comm: MPI.Comm, known: Columns, wanted: Columns, select: Selection = in_balls
) -> tuple[Ints, dict[str, npt.NDArray[Any]]]:
    """Return the known points, of any rank, within a distance of each place. Collective.

    Args:
        comm: communicator.
        known: points of this rank.
        wanted: places ``"x"`` and distances ``"reach"`` of this rank, and data for ``select``.
        select: function that selects pairs of questions and known points of a rank, on that rank;
            default: all points within the distance.

    Returns:
        Numbers of places, shape (pairs,), and data of points near them, shape (pairs, ...).
    """
    rows, asked = _packed(known), _packed(wanted)
    boxes = _Boxes(comm, known["x"], wanted["x"])
    places = [np.flatnonzero(near <= wanted["reach"]) for near in boxes.near]
    answers = []
    for q in _exchanged(comm, [np.column_stack([i, asked[i]]) for i in places]):
        i: Ints = np.zeros(0, dtype=np.int64)
        k = i
        if boxes.tree is not None and len(q):
            i, k = select(boxes.tree, _unpacked(q[:, 1:], wanted))
        answers.append(np.column_stack([q[i, 0], rows[k]]))
    found = np.concatenate(_exchanged(comm, answers))
    return found[:, 0].astype(np.int64), _unpacked(found[:, 1:], known)


def near_rays(tree: scipy.spatial.cKDTree, q: Columns, radii: Array) -> tuple[Ints, Ints]:
    """Return pairs of rays and balls of this rank in cylinders around the rays.

    Rays are bisected, and halves without a ball nearby dropped. The cost therefore grows with the
    number of balls along the rays, not within their length.

    Args:
        tree: middles of the balls of this rank.
        q: middles ``"x"`` of the rays, directions ``"normal"``, half lengths ``"depth"``, and radii
            ``"across"`` of the cylinders, to which the radii of the balls are added.
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
    parts, k = _pairs(tree.query_ball_point(middles, reach))
    pairs = np.unique(i[parts] * tree.n + k)
    i, k = pairs // tree.n, pairs % tree.n
    off = tree.data[k] - q["x"][i]
    along = np.sum(off * q["normal"][i], axis=1)
    aside = np.linalg.norm(off - along[:, None] * q["normal"][i], axis=1)
    limit = q["across"][i] + radii[k]
    kept = (np.abs(along) <= q["depth"][i] + limit) & (aside <= limit)
    return i[kept], k[kept]


class _Boxes:
    """Boxes around the known points of every rank, and a tree of the points of this rank.

    Args:
        comm: communicator.
        known: points of this rank, shape (m, dim).
        x: places, shape (n, dim).

    Attributes:
        near: distances of the places to the nearest point of each box, NaN for ranks without
            points, shape (ranks, n).
        far: distances to the farthest point of each box, shape (ranks, n).
        tree: tree of the points of this rank; None without points.
    """

    def __init__(self, comm: MPI.Comm, known: Array, x: Array):
        box = np.full((2, x.shape[1]), np.nan)
        if len(known):
            box[:] = known.min(axis=0), known.max(axis=0)
        boxes = np.array(comm.allgather(box))
        below = boxes[:, 0, None] - x
        above = x - boxes[:, 1, None]
        self.near = np.linalg.norm(np.maximum(below, above).clip(0.0), axis=2)
        self.far = np.linalg.norm(np.maximum(np.abs(below), np.abs(above)), axis=2)
        self.tree = scipy.spatial.cKDTree(known) if len(known) else None


def _pairs(lists: npt.NDArray[np.object_]) -> tuple[Ints, Ints]:
    """Return the pairs (i, k) with k in the list i."""
    i = np.repeat(np.arange(len(lists)), [len(part) for part in lists])
    return i, np.array([k for part in lists for k in part], dtype=np.int64)


def _width(values: npt.NDArray[Any]) -> int:
    return int(np.prod(values.shape[1:], dtype=int))


def _packed(columns: Columns) -> Array:
    """Return named data as columns of one array (n, width), positions first."""
    ordered = [columns["x"], *(v for name, v in columns.items() if name != "x")]
    return np.column_stack([v.reshape(len(v), _width(v)) for v in ordered]).astype(np.float64)


def _unpacked(rows: Array, like: Columns) -> dict[str, npt.NDArray[Any]]:
    """Return named data from rows; ``like`` gives names, shapes and types."""
    names = ["x", *(name for name in like if name != "x")]
    ends = np.cumsum([_width(like[name]) for name in names])
    parts = np.split(rows, ends[:-1], axis=1)
    with np.errstate(invalid="ignore"):  # infinite rows have no integers
        return {
            name: part.reshape(len(rows), *like[name].shape[1:]).astype(like[name].dtype)
            for name, part in zip(names, parts, strict=True)
        }


def _exchanged(comm: MPI.Comm, parts: list[Array]) -> list[Array]:
    """Return the array that each rank has for this one. Collective.

    Args:
        comm: communicator.
        parts: array for every rank, shape (n, columns).
    """
    counts = comm.alltoall([len(p) for p in parts])
    received = [np.empty((n, parts[0].shape[1])) for n in counts]
    requests = [comm.Irecv(a, source=r) for r, a in enumerate(received) if len(a)]
    requests += [comm.Isend(np.ascontiguousarray(p), dest=r) for r, p in enumerate(parts) if len(p)]
    MPI.Request.Waitall(requests)
    return received
