# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nodes at which the jumps of pairs form a closed loop, as where cracks cross.

Where cracks cross, k nodes lie at one place, and the pairs have as many jumps between them as there
are arms. The jumps of a closed loop sum to zero,

    (u_1 - u_2) + (u_2 - u_3) + ... + (u_k - u_1) = 0,

so that one of them depends on the others: if all stick, their multipliers are not unique and the
matrix is singular. As at the crosspoints of mortar methods, none of these nodes has a multiplier;
the adjacent nodes take its function (`held_ends`; Wohlmuth, SIAM J. Numer. Anal. 38, 2000, section
2). A node of several pairs whose jumps form no loop, for example of a body on which two others
stand, keeps all of its multipliers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import global_numbers
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.held_ends import resting
from dolfinx_contact.points.trace import at_global_places, sums_at_global_places

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["crossings"]


def crossings(
    V: fem.FunctionSpace,
    surfaces: Sequence[DiscreteSurface],
    fixed: Mask,
) -> tuple[list[Mask], Mask]:
    """Return the places at which jumps of pairs form loops. Collective.

    Args:
        V: displacement space.
        surfaces: surfaces of one problem; only pairs whose faces match are considered.
        fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).

    Returns:
        Mask of the local vertices of each surface, and mask of the local nodes of the displacement
        on both faces.
    """
    comm = V.mesh.comm
    index_map = V.dofmap.index_map
    opposites = [s.obstacle.opposite for s in surfaces]
    if all(opposite is None for opposite in opposites):
        return [_none(s.points.vertices.dofmap.index_map) for s in surfaces], _none(index_map)
    parts: list[Ints] = [np.zeros((0, 4), dtype=np.int64)]
    for i, (s, opposite) in enumerate(zip(surfaces, opposites, strict=True)):
        if opposite is None or not opposite.matching:
            continue
        vertices = np.arange(s.points.vertices.dofmap.index_map.size_local)
        nodes = s.points.vertex_trace_dofs[vertices]
        here = global_numbers(index_map, nodes)
        there = opposite.at(nodes)[0][:, 0]
        number = np.full(len(vertices), i)
        edges = np.column_stack([number, vertices, here, there])
        rests = resting(V, opposite, fixed)[nodes].all(axis=1)
        parts.append(np.asarray(edges[~rests], dtype=np.int64))
    mine: Ints = np.concatenate(parts)
    several = at_global_places(comm, _counts(V, mine), mine[:, 2:]) > 1
    # few are left, since nodes of one pair have one jump
    mine = mine[several.all(axis=1)]
    found = mine[_in_loops(comm.allgather(mine), comm.rank)]
    marks = []
    for i, s in enumerate(surfaces):
        here = found[found[:, 0] == i, 1]
        marked = SharedValues(s.points.vertices.dofmap.index_map).sums(here, np.ones(len(here)))
        marks.append(np.asarray(marked > 0))
    counts = SharedValues(index_map).from_owners(_counts(V, found))
    return marks, np.asarray(counts > 0)


def _none(index_map: Any) -> Mask:
    return np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)


def _counts(V: fem.FunctionSpace, edges: Ints) -> Array:
    """Return the number of edges that end at the owned nodes. Collective."""
    ends = edges[:, 2:].reshape(-1)
    owned = V.dofmap.index_map.size_local
    return sums_at_global_places(V.mesh.comm, owned, ends, np.ones(len(ends)))


def _in_loops(parts: Sequence[Ints], rank: int) -> Mask:
    """Return the mask of the edges of a rank in or between loops, which have no free end."""
    ends = np.concatenate(parts)[:, 2:]
    left: Mask = np.ones(len(ends), dtype=bool)
    _, nodes = np.unique(ends, return_inverse=True)
    nodes = nodes.reshape(ends.shape)
    while True:
        counts = np.bincount(nodes[left].reshape(-1), minlength=int(nodes.max(initial=0)) + 1)
        stays: Mask = left & (counts[nodes] > 1).all(axis=1)
        if (stays == left).all():
            break
        left = stays
    first = sum(len(part) for part in parts[:rank])
    return np.asarray(left[first : first + len(parts[rank])])
