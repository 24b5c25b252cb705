# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a master, of any rank, that may come to lie opposite to those of a slave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.search import exchanged, ranks_nearby

__all__ = ["Candidates", "candidates", "from_rows", "marks_of"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Candidates:
    """What a search has found.

    Attributes:
        nodes: global nodes of the facets of the master, every facet once (n, b).
        senses: 1 or -1, of their area vectors (n,).
        mirrors: 1, or -1 along axes across which they are images of the facets of the nodes (n,
            dim).
        pairs: numbers of facets of slave and master (pairs, 2).
        known: their global nodes, every one once (m,).
        places: of the corners of the facets among these (n, b).
    """

    nodes: Nodes
    senses: Array
    mirrors: Array
    pairs: Nodes
    known: Nodes
    places: Nodes


def candidates(
    comm: MPI.Comm, slave: Faces, master: Faces, marks: Array, depth: float, skin: float
) -> Candidates:
    """Facets that the rays of the slave may meet, here or within a skin. Collective.

    A ray goes along the normal of its facet, so that facets count that lie at most `depth` before
    or behind it, and across the normal no farther than both reach.

    Args:
        comm: communicator.
        slave: facets of this rank.
        master: facets of this rank, and images of these.
        marks: of the master's (n,), see `marks_of`.
        depth: distance along the normal.
        skin: by which facets may be farther.
    """
    middles, radii = _balls(slave)
    others, theirs = _balls(master)
    dim = middles.shape[1]
    largest = comm.allreduce(float(np.max(theirs, initial=0.0)), op=max)
    across = radii + largest + skin
    reach = np.hypot(depth + across, across)
    places, tree = ranks_nearby(comm, others, middles, lambda near, _: near <= reach)
    n = slave.normals
    sent: Any = [np.column_stack([middles[i], n[i], radii[i], reach[i], i]) for i in places]
    answers = []
    for q in exchanged(comm, sent, (2 * dim + 3,)):
        i, k = _near(q, others, theirs, tree, depth, skin)
        answers.append(np.column_stack([q[i, -1], marks[k], master.nodes[k]]))
    width = 2 + master.nodes.shape[1]
    rows = np.concatenate(exchanged(comm, answers, (width,)))
    found = rows[:, 1:].astype(np.int64)
    facets, inverse = np.unique(found, axis=0, return_inverse=True)
    pairs = np.column_stack([rows[:, 0].astype(np.int64), inverse.reshape(-1)])
    # In the order of the facets, whichever rank an answer comes from.
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return _found(facets, pairs, dim)


def from_rows(facets: Nodes, number: int, dim: int) -> Candidates:
    """All facets of a master (n, 1 + b), marks first, for each facet of the slave."""
    facets = np.unique(facets, axis=0)
    pairs = np.indices((number, len(facets))).reshape(2, -1).T
    return _found(facets, pairs.astype(np.int64), dim)


def marks_of(senses: Array, mirror: Array) -> Array:
    """Senses (n,) times 1 + a number of the axes across which facets are images (dim,)."""
    axes = 2 ** np.arange(len(mirror))
    number = (mirror < 0) @ axes
    return np.asarray(senses * (1 + number))


def _found(facets: Nodes, pairs: Nodes, dim: int) -> Candidates:
    nodes = facets[:, 1:]
    known, corners = np.unique(nodes, return_inverse=True)
    senses = np.sign(facets[:, 0]).astype(np.float64)
    across = (np.abs(facets[:, :1]) - 1) >> np.arange(dim) & 1
    mirrors = 1.0 - 2.0 * across
    return Candidates(nodes, senses, mirrors, pairs, known, corners.reshape(nodes.shape))


def _balls(faces: Faces) -> tuple[Array, Array]:
    """Middles of facets, and the radii of balls around them."""
    middles = faces.x.mean(axis=1)
    off = np.linalg.norm(faces.x - middles[:, None], axis=2)
    return middles, off.max(axis=1, initial=0.0)


def _near(
    q: Array, others: Array, theirs: Array, tree: Any, depth: float, skin: float
) -> tuple[Nodes, Nodes]:
    """Numbers of questions and of facets of this rank that are near each other."""
    dim = others.shape[1]
    if tree is None or not len(q):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    i, k = _around_rays(q, tree, depth, float(theirs.max()) + skin)
    off = others[k] - q[i, :dim]
    n = q[i, dim : 2 * dim]
    along = np.sum(off * n, axis=1)
    across = np.linalg.norm(off - along[:, None] * n, axis=1)
    reach = q[i, 2 * dim] + theirs[k] + skin
    kept = (np.abs(along) <= depth + reach) & (across <= reach)
    return i[kept], k[kept]


def _around_rays(q: Array, tree: Any, depth: float, more: float) -> tuple[Nodes, Nodes]:
    """Numbers of questions and of middles of facets in cylinders around their rays, and some more.

    Rays are bisected, and halves without a facet nearby dropped, so that what is examined is what
    lies along them, and not all that is as near as they are long.
    """
    dim = tree.m
    across = q[:, 2 * dim] + more
    half = depth + across
    i = np.arange(len(q))
    at = np.zeros(len(q))
    while True:
        middles = q[i, :dim] + at[:, None] * q[i, dim : 2 * dim]
        radius = np.hypot(half, across)[i]
        near = tree.query(middles)[0] <= radius
        i, at, middles, radius = i[near], at[near], middles[near], radius[near]
        if np.all(half <= across):
            break
        half = half / 2
        at = np.concatenate([at - half[i], at + half[i]])
        i = np.concatenate([i, i])
    found = tree.query_ball_point(middles, radius)
    i = np.repeat(i, [len(part) for part in found])
    k = np.array([j for part in found for j in part], dtype=np.int64)
    pairs = np.unique(i * tree.n + k)
    return pairs // tree.n, pairs % tree.n
