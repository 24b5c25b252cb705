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
from typing import TYPE_CHECKING

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
    nodes_of = V.dofmap.index_map
    maps = [s.points.vertices.dofmap.index_map for s in surfaces]
    if all(s.obstacle.opposite is None for s in surfaces):
        none = [np.zeros(m.size_local + m.num_ghosts, dtype=bool) for m in (*maps, nodes_of)]
        return none[:-1], none[-1]
    # edges: surface, vertex, and nodes at both ends of the jump there
    surface: list[Ints] = [np.zeros(0, dtype=np.int64)]
    vertex: list[Ints] = [np.zeros(0, dtype=np.int64)]
    both: list[Ints] = [np.zeros((0, 2), dtype=np.int64)]
    for i, s in enumerate(surfaces):
        opposite = s.obstacle.opposite
        if opposite is None or not opposite.matching:
            continue
        nodes = s.points.vertex_trace_dofs[: maps[i].size_local]
        rests = resting(V, opposite, fixed)[nodes].all(axis=1)
        here, there = global_numbers(nodes_of, nodes), opposite.at(nodes)[0][:, 0]
        surface.append(np.full(np.count_nonzero(~rests), i))
        vertex.append(np.flatnonzero(~rests))
        both.append(np.column_stack([here, there])[~rests])
    ends = np.concatenate(both)
    several = at_global_places(comm, _counts(V, ends), ends) > 1
    # few are left, since nodes of one pair have one jump
    left = np.flatnonzero(several.all(axis=1))
    left = left[_in_loops(comm.allgather(ends[left]), comm.rank)]
    numbers, vertices = (np.concatenate(part)[left] for part in (surface, vertex))
    marks = []
    for i, index_map in enumerate(maps):
        at = vertices[numbers == i]
        marks.append(SharedValues(index_map).sums(at, np.ones(len(at))) > 0)
    counts = SharedValues(nodes_of).from_owners(_counts(V, ends[left]))
    return marks, np.asarray(counts > 0)


def _counts(V: fem.FunctionSpace, ends: Ints) -> Array:
    """Return the number of edges with the given ends (n, 2) at the owned nodes. Collective."""
    owned = V.dofmap.index_map.size_local
    return sums_at_global_places(V.mesh.comm, owned, ends.reshape(-1), np.ones(ends.size))


def _in_loops(parts: Sequence[Ints], rank: int) -> Mask:
    """Return the mask of the edges of a rank in or between loops, which have no free end.

    Args:
        parts: ends of the edges by rank, shape (n, 2) each.
        rank: number of the rank.
    """
    ends = np.concatenate(parts)
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
