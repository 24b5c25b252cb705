# SPDX-License-Identifier: LGPL-3.0-or-later
"""Searches for places that other ranks know: by boxes, trees and messages from rank to rank."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy

__all__ = ["exchanged", "nearest", "ranks_nearby", "within"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


def nearest(comm: MPI.Comm, known: Array, wanted: Array, dim: int) -> Array:
    """The rows of ``known``, of all ranks, whose first columns are nearest to places. Collective.

    Args:
        comm: communicator.
        known: of this rank; places come first.
        wanted: places (n, dim) of this rank.
        dim: 2 or 3.

    Returns:
        A row for every place; infinite places where there are none at all.
    """
    best = np.full((len(wanted), known.shape[1]), np.inf)
    places, tree = ranks_nearby(
        comm,
        known[:, :dim],
        wanted,
        lambda near, far: near <= np.nanmin(far, axis=0, initial=np.inf) * (1 + 1e-12),
    )
    questions = exchanged(comm, [wanted[i] for i in places], (dim,))
    answers = [
        known[tree.query(q)[1]] if tree is not None and len(q) else known[:0] for q in questions
    ]
    distance = np.full(len(wanted), np.inf)
    for i, rows in zip(places, exchanged(comm, answers, known.shape[1:]), strict=True):
        d = np.linalg.norm(rows[:, :dim] - wanted[i], axis=1)
        closer = d < distance[i]
        best[i[closer]] = rows[closer]
        distance[i[closer]] = d[closer]
    return best


def within(comm: MPI.Comm, known: Array, wanted: Array, radius: float) -> Nodes:
    """How many of the known places, of all ranks, lie around the wanted ones. Collective."""
    places, tree = ranks_nearby(comm, known, wanted, lambda near, _: near <= radius)
    questions = exchanged(comm, [wanted[i] for i in places], wanted.shape[1:])
    answers = [
        np.array([float(len(p)) for p in tree.query_ball_point(q, radius)])
        if tree is not None and len(q)
        else np.zeros(len(q))
        for q in questions
    ]
    counts = np.zeros(len(wanted))
    for i, found in zip(places, exchanged(comm, answers, ()), strict=True):
        counts[i] += found
    return counts.astype(np.int64)


def ranks_nearby(
    comm: MPI.Comm,
    known: Array,
    wanted: Array,
    which: Callable[[Array, Array], npt.NDArray[np.bool_]],
) -> tuple[list[npt.NDArray[np.intp]], scipy.spatial.cKDTree | None]:
    """The places about which each rank is queried, and its known ones as a tree. Collective.

    Args:
        comm: communicator.
        known: places of this rank.
        wanted: places (n, dim).
        which: of distances of ``wanted`` to the nearest and farthest point of the box around the
            known places of each rank (ranks, n), NaN of ranks that have none: the ranks to query.
    """
    box = np.full((2, wanted.shape[1]), np.nan)
    if len(known):
        box[:] = known.min(axis=0), known.max(axis=0)
    boxes = np.array(comm.allgather(box))
    low = boxes[:, 0, None]
    high = boxes[:, 1, None]
    below = low - wanted
    above = wanted - high
    outside = np.maximum(below, above).clip(0.0)
    across = np.maximum(np.abs(below), np.abs(above))
    near = np.linalg.norm(outside, axis=2)
    far = np.linalg.norm(across, axis=2)
    tree = scipy.spatial.cKDTree(known) if len(known) else None
    return [np.flatnonzero(marked) for marked in which(near, far)], tree


def exchanged(comm: MPI.Comm, parts: list[Array], shape: tuple[int, ...]) -> list[Array]:
    """What every rank has for this one, of what all have for each other. Collective.

    Args:
        comm: communicator.
        parts: for every rank an array (n, *shape).
        shape: of a row.
    """
    counts = comm.alltoall([len(p) for p in parts])
    received = [np.empty((n, *shape)) for n in counts]
    requests = [comm.Irecv(a, source=r) for r, a in enumerate(received) if len(a)]
    requests += [comm.Isend(np.ascontiguousarray(p), dest=r) for r, p in enumerate(parts) if len(p)]
    MPI.Request.Waitall(requests)
    return received
