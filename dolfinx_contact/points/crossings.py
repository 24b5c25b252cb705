# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nodes at which pairs meet so that their jumps go around, as where cracks cross.

Where cracks cross k nodes lie at one place, and between them the pairs have as many jumps as there
are arms. Those of a closed loop sum to zero,

    (u_1 - u_2) + (u_2 - u_3) + ... + (u_k - u_1) = 0,

so that one of them depends on the others: multipliers of all of them are not unique where all
stick, and the matrix is singular. As at the crosspoints of mortar methods none of these nodes has a
multiplier; the nodes beside it take its function (`held_ends`; Wohlmuth, SIAM J. Numer. Anal. 38,
2000, section 2). Where a node is of several pairs but their jumps make no loop, as that of a body
on which two others stand, all of them are independent and stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.held_ends import resting
from dolfinx_contact.points.trace import at_global_places

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["crossings"]

Edges = npt.NDArray[np.int64]


def crossings(
    V: fem.FunctionSpace,
    surfaces: Sequence[DiscreteSurface],
    fixed: npt.NDArray[np.bool_],
) -> tuple[list[npt.NDArray[np.bool_]], npt.NDArray[np.bool_]]:
    """Where jumps of pairs go around. Collective.

    Args:
        V: displacement space.
        surfaces: of one problem; only pairs whose faces match are considered.
        fixed: local nodes x dim, by Dirichlet data.

    Returns:
        Which local vertices of every surface are there, and which local nodes of the displacement,
        of both faces.
    """
    comm = V.mesh.comm
    index_map = V.dofmap.index_map
    opposites = [s.opposite_nodes for s in surfaces]
    if all(opposite is None for opposite in opposites):
        return [_none(s.points.vertices.dofmap.index_map) for s in surfaces], _none(index_map)
    parts: list[Edges] = [np.zeros((0, 4), dtype=np.int64)]
    for i, (s, opposite) in enumerate(zip(surfaces, opposites, strict=True)):
        if opposite is None or not opposite.matching:
            continue
        vertices = np.arange(s.points.vertices.dofmap.index_map.size_local)
        nodes = s.points.vertex_trace_dofs[vertices]
        here = index_map.local_to_global(nodes.astype(np.int32))
        there = opposite.at(nodes)[0][:, 0]
        number = np.full(len(vertices), i)
        edges = np.column_stack([number, vertices, here, there])
        rests = resting(V, opposite, fixed)[nodes].all(axis=1)
        parts.append(np.asarray(edges[~rests], dtype=np.int64))
    mine: Edges = np.concatenate(parts)
    several = at_global_places(comm, _counts(V, mine), mine[:, 2:]) > 1
    # Few are left: nodes of one pair have one jump.
    mine = mine[several.all(axis=1)]
    found = mine[_in_loops(comm.allgather(mine), comm.rank)]
    marks = []
    for i, s in enumerate(surfaces):
        here = found[found[:, 0] == i, 1]
        marked = SharedValues(s.points.vertices.dofmap.index_map).sums(here, np.ones(len(here)))
        marks.append(np.asarray(marked > 0))
    counts = SharedValues(index_map).from_owners(_counts(V, found))
    return marks, np.asarray(counts > 0)


def _none(index_map: Any) -> npt.NDArray[np.bool_]:
    return np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)


def _counts(V: fem.FunctionSpace, edges: Edges) -> npt.NDArray[np.float64]:
    """How many edges end at the owned nodes. Collective."""
    counts = PETSc.Vec().createMPI((V.dofmap.index_map.size_local, None), comm=V.mesh.comm)
    ends = edges[:, 2:].reshape(-1).astype(PETSc.IntType)
    counts.setValues(ends, np.ones(len(ends)), addv=PETSc.InsertMode.ADD_VALUES)
    counts.assemble()
    found = counts.array_r.copy()
    counts.destroy()
    return np.asarray(found)


def _in_loops(parts: Sequence[Edges], rank: int) -> npt.NDArray[np.bool_]:
    """Which edges of a rank are of loops, or between such: no end of theirs is free."""
    ends = np.concatenate(parts)[:, 2:]
    left: npt.NDArray[np.bool_] = np.ones(len(ends), dtype=bool)
    _, nodes = np.unique(ends, return_inverse=True)
    nodes = nodes.reshape(ends.shape)
    while True:
        counts = np.bincount(nodes[left].reshape(-1), minlength=int(nodes.max(initial=0)) + 1)
        stays: npt.NDArray[np.bool_] = left & (counts[nodes] > 1).all(axis=1)
        if (stays == left).all():
            break
        left = stays
    first = sum(len(part) for part in parts[:rank])
    return np.asarray(left[first : first + len(parts[rank])])
