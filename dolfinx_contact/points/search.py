# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spatial search among the points of all ranks.

No rank holds all points. Each rank queries the ranks in whose bounding boxes the points it needs
may lie; these search their own points in a tree and send the answers back.
"""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy

__all__ = ["around", "nearest"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


def nearest(comm: MPI.Comm, known: Array, wanted: Array, dim: int) -> Array:
    """Return the row of ``known``, of all ranks, nearest to each place. Collective.

    Args:
        comm: communicator.
        known: rows of this rank, which begin with their places, shape (m, columns).
        wanted: places of this rank, shape (n, dim).
        dim: dimension, 2 or 3.

    Returns:
        Rows, shape (n, columns); infinite if no rank has any.
    """
    best = np.full((len(wanted), known.shape[1]), np.inf)
    places, tree = _ranks_nearby(
        comm,
        known[:, :dim],
        wanted,
        lambda near, far: near <= np.nanmin(far, axis=0, initial=np.inf) * (1 + 1e-12),
    )
    questions = _exchanged(comm, [wanted[i] for i in places])
    answers = [
        known[tree.query(q)[1]] if tree is not None and len(q) else known[:0] for q in questions
    ]
    distance = np.full(len(wanted), np.inf)
    for i, rows in zip(places, _exchanged(comm, answers), strict=True):
        d = np.linalg.norm(rows[:, :dim] - wanted[i], axis=1)
        closer = d < distance[i]
        best[i[closer]] = rows[closer]
        distance[i[closer]] = d[closer]
    return best


def in_balls(questions: Array, tree: scipy.spatial.cKDTree) -> tuple[Nodes, Nodes]:
    """Return pairs of questions and points of a tree within their distances."""
    return pairs_of(tree.query_ball_point(questions[:, : tree.m], questions[:, -2]))


def pairs_of(lists: npt.NDArray[np.object_]) -> tuple[Nodes, Nodes]:
    """Return the pairs (i, k) with k in the list i."""
    i = np.repeat(np.arange(len(lists)), [len(part) for part in lists])
    return i, np.array([k for part in lists for k in part], dtype=np.int64)


def around(
    comm: MPI.Comm,
    known: Array,
    wanted: Array,
    reach: Array,
    dim: int,
    pairs: Callable[[Array, scipy.spatial.cKDTree], tuple[Nodes, Nodes]] = in_balls,
) -> tuple[Nodes, Array]:
    """Return the rows of ``known``, of all ranks, within a distance of each place. Collective.

    Args:
        comm: communicator.
        known: rows of this rank, which begin with their places, shape (m, columns).
        wanted: rows of this rank, which begin with their places, shape (n, more columns).
        reach: distance by place, shape (n,).
        dim: dimension, 2 or 3.
        pairs: function that selects pairs of rows of ``wanted``, followed by two columns of which
            the first is the distance, and points of the tree; default: all within the distance.

    Returns:
        Numbers of places, shape (pairs,), and rows near them, shape (pairs, columns).
    """
    places, tree = _ranks_nearby(
        comm, known[:, :dim], wanted[:, :dim], lambda near, _: near <= reach
    )
    answers = []
    for q in _exchanged(comm, [np.column_stack([wanted[i], reach[i], i]) for i in places]):
        i: Nodes = np.zeros(0, dtype=np.int64)
        k = i
        if tree is not None and len(q):
            i, k = pairs(q, tree)
        answers.append(np.column_stack([q[i, -1], known[k]]))
    rows = np.concatenate(_exchanged(comm, answers))
    return rows[:, 0].astype(np.int64), rows[:, 1:]


def _ranks_nearby(
    comm: MPI.Comm,
    known: Array,
    wanted: Array,
    which: Callable[[Array, Array], npt.NDArray[np.bool_]],
) -> tuple[list[npt.NDArray[np.intp]], scipy.spatial.cKDTree | None]:
    """Return the numbers of the places to ask each rank about, and a tree of own ones. Collective.

    Args:
        comm: communicator.
        known: places of this rank.
        wanted: places, shape (n, dim).
        which: function from the distances of ``wanted`` to the nearest and the farthest point of
            the boxes around the known places of the ranks (ranks, n), NaN for ranks without any, to
            the mask of the ranks to ask.
    """
    box = np.full((2, wanted.shape[1]), np.nan)
    if len(known):
        box[:] = known.min(axis=0), known.max(axis=0)
    boxes = np.array(comm.allgather(box))
    below = boxes[:, 0, None] - wanted
    above = wanted - boxes[:, 1, None]
    near = np.linalg.norm(np.maximum(below, above).clip(0.0), axis=2)
    far = np.linalg.norm(np.maximum(np.abs(below), np.abs(above)), axis=2)
    tree = scipy.spatial.cKDTree(known) if len(known) else None
    return [np.flatnonzero(marked) for marked in which(near, far)], tree


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
