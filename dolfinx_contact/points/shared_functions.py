# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nodes without a multiplier of their own: crossings, clamped ends, planes of symmetry.

*Crossings.* Where cracks cross, k nodes have the same position, and the pairs have one jump between
them for each arm. The jumps of a closed loop sum to zero,

    (u_1 - u_2) + (u_2 - u_3) + ... + (u_k - u_1) = 0,

so that one of them depends on the others: if all stick, their multipliers are not unique and the
matrix is singular. As at the crosspoints of mortar methods, none of these nodes has a multiplier
(Wohlmuth, SIAM J. Numer. Anal. 38, 2000, section 2). A node of several pairs whose jumps form no
loop, for example of a body on which two others stand, keeps all of its multipliers.

*Clamped ends.* If a mortar node p and the master at its position are both clamped, for example
where an interface ends at a support, the jump is not an unknown. The dual function psi_p covers the
adjacent slave facets and may overlap free master nodes. A multiplier at p would constrain only
these nodes, and its size would be proportional to the inverse of int psi_p N_k, which may be small.
Therefore it is removed. A clamped node opposite to a free master keeps its multiplier, because it
still transmits forces.

*Planes of symmetry.* In a half model, Dirichlet data fix the displacement across the plane at a
node p on the edge of the surface and at the master there, if any. If the weighted jump of p
contains free nodes, as for mortars and quadratic displacements, its component across the plane does
not vanish. In the whole model it vanishes, and so does the traction across the plane. This
multiplier component is removed, and the jump across the plane is that of p itself
(`ContactPoints.mirror`). Since the stress tensor is symmetric, the shear also vanishes at other
edges where a support holds the adjacent face along its own normal only.

The functions of multipliers removed at crossings and clamped ends are added to the functions of
adjacent nodes,

    psi_q + sum_p a_qp psi_p,    sum_q a_qp = 1,

so that they still sum to 1 everywhere, and a uniform traction is transmitted to the master up to
the support. They remain biorthogonal to the free slave nodes (Wohlmuth, as above; in 3D Puso, Int.
J. Numer. Methods Eng. 59, 2004). With ``method="integral"``, the hat functions N_p of the
multiplier are distributed instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import global_numbers
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact._petsc import triplet_matrix
from dolfinx_contact.points.jump_operators import (
    NodeWeights,
    rows_of,
    rows_with_ghosts,
    scaled_rows,
)
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.surface_geometry import SurfaceFacets
from dolfinx_contact.points.trace import at_global_places, sums_at_global_places

__all__ = ["clamped_ends", "crossings", "in_place", "receiving_vertices", "resting", "shared"]

_MOVES = 1e-6  # weight that is not round-off


def crossings(
    V: fem.FunctionSpace,
    surfaces: Sequence[tuple[SurfaceFacets, Opposite | None]],
    fixed: Mask,
) -> tuple[list[Mask], Mask]:
    """Return the nodes where pairs meet so that their jumps depend on each other. Collective.

    Args:
        V: displacement space.
        surfaces: facets and opposing points of the surfaces of one problem; only pairs whose faces
            match are considered.
        fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).

    Returns:
        Mask of these nodes among the local vertices of each surface, and among the local nodes of
        the displacement, on both faces.
    """
    comm = V.mesh.comm
    nodes_of = V.dofmap.index_map
    # edges: surface, vertex, and nodes at both ends of the jump there
    parts: list[Ints] = [np.zeros((0, 4), dtype=np.int64)]
    for i, (facets, opposite) in enumerate(surfaces):
        if opposite is None or not opposite.matching:
            continue
        nodes = facets.trace[: facets.exchange.index_map.size_local]
        moving = ~resting(V, opposite, fixed)[nodes].all(axis=1)
        ends = global_numbers(nodes_of, nodes), opposite.at(nodes).nodes[:, 0]
        columns = [np.full(len(nodes), i), np.arange(len(nodes)), *ends]
        parts.append(np.column_stack(columns)[moving])
    edges = np.concatenate(parts)
    several = at_global_places(comm, _counts(V, edges[:, 2:]), edges[:, 2:]) > 1
    # few are left, since nodes of one pair have one jump
    edges = edges[several.all(axis=1)]
    edges = edges[_in_loops(comm.allgather(edges[:, 2:]), comm.rank)]
    marks = [
        facets.exchange.marked(edges[edges[:, 0] == i, 1]) for i, (facets, _) in enumerate(surfaces)
    ]
    counts = SharedValues(nodes_of).from_owners(_counts(V, edges[:, 2:]))
    return marks, counts > 0


def _counts(V: fem.FunctionSpace, ends: Ints) -> Array:
    """Return the number of edges of a graph at each owned node. Collective.

    Args:
        V: displacement space, whose nodes are the nodes of the graph.
        ends: global nodes at the ends of the edges of this rank, shape (n, 2).
    """
    owned = V.dofmap.index_map.size_local
    return sums_at_global_places(V.mesh.comm, owned, ends.reshape(-1), np.ones(ends.size))


def _in_loops(parts: Sequence[Ints], rank: int) -> Mask:
    """Return the mask of the edges of a graph that belong to loops or connect loops.

    Other edges are found by repeatedly removing edges with a free end.

    Args:
        parts: nodes at the ends of the edges of each rank, shape (n, 2) each.
        rank: rank whose edges are returned.
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
    return left[first : first + len(parts[rank])]


# -- fixed nodes -----------------------------------------------------------------------------------


def resting(V: fem.FunctionSpace, opposite: Opposite, fixed: Mask) -> Mask:
    """Return the mask of components in which neither a node nor its opposing point can move.

    Nodes without an opposing point, which have no jump, are included. Shape (local nodes, dim).
    Collective.

    Args:
        V: displacement space.
        opposite: opposing points of the nodes.
        fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).
    """
    free = (~fixed[: V.dofmap.index_map.size_local]).astype(float)
    moves = opposite.values(V.mesh.comm, free, sizes=True) > _MOVES
    return (fixed & ~moves) | opposite.none[:, None]


def clamped_ends(V: fem.FunctionSpace, opposite: Opposite, fixed: Mask) -> Mask:
    """Return the mask of mortar nodes with a fixed jump that overlap free master nodes.

    Dirichlet data fix such a node and the master at its position, but its dual basis function
    overlaps basis functions of free master nodes. Collective.

    Args:
        V: displacement space.
        opposite: opposing points of faces that do not match.
        fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).
    """
    places = opposite.places
    clamped: Mask = np.asarray(fixed.all(axis=1))
    free = (~clamped[: V.dofmap.index_map.size_local]).astype(float)
    here, around = (of.values(V.mesh.comm, free, sizes=True) for of in (places, opposite))
    fixed_here = opposite.sides.slave & clamped & ~places.none & (here <= _MOVES)
    return fixed_here & (around > _MOVES)


def in_place(opposite: Opposite, nodes: Mask) -> Opposite:
    """Return opposing points that are not mortar averages at marked nodes.

    Args:
        opposite: opposing points of all nodes.
        nodes: mask of the local nodes that get the opposing point of their own position.
    """
    places = opposite.places
    chosen = nodes[opposite.sides.slave][:, None]
    weights = np.where(chosen, 0.0, opposite.weights), np.where(chosen, places.weights, 0.0)
    return replace(
        opposite,
        nodes=np.concatenate([opposite.nodes, places.nodes], axis=1),
        weights=np.concatenate(weights, axis=1),
    )


# -- functions that other nodes take ---------------------------------------------------------------


def shared(
    vertices: fem.FunctionSpace,
    given: Mask,
    idle: Mask,
    areas: Array,
) -> tuple[PETSc.Mat, Array, Mask]:
    """Return the matrix of means weighted with enlarged basis functions of vertices. Collective.

    Functions of given vertices are added to functions of surrounding vertices.

    Args:
        vertices: scalar P1 space of the slave facets.
        given: mask of the local vertices whose basis function is distributed to their neighbours,
            ghosts included.
        idle: mask of the local vertices that receive no basis function.
        areas: areas of the owned vertices, shape (n,).

    Returns:
        Matrix of the means, with rows of the identity for distributed functions; areas of the
        enlarged functions of the owned vertices, shape (n,); and mask of the vertices whose basis
        function could be distributed.
    """
    receivers, given = receiving_vertices(vertices, given, idle)
    n = len(areas)
    own = vertices.dofmap.index_map.local_range[0] + np.arange(n, dtype=np.int64)
    rows = np.column_stack([receivers.nodes[:n], own])
    weights = areas[:, None] * np.column_stack([receivers.weights[:n], given[:n]])
    vertex, place = np.nonzero(weights)
    entries = rows[vertex, place], own[vertex], weights[vertex, place]
    means = triplet_matrix(vertices.mesh.comm, (n, n), *entries)
    return means, scaled_rows(means), given


def receiving_vertices(
    vertices: fem.FunctionSpace, given: Mask, idle: Mask
) -> tuple[NodeWeights, Mask]:
    """Return vertices that receive equal parts of given basis functions. Collective.

    Args:
        vertices: scalar P1 space of the slave facets.
        given: mask of the local vertices whose basis function is distributed to their neighbours,
            ghosts included.
        idle: mask of the local vertices that receive no basis function.

    Returns:
        Receiving vertices and their shares, shape (n, k) each, padded with shares of 0; and the
        mask of the vertices whose basis function could be distributed.
    """
    index_map = vertices.dofmap.index_map
    exchange = SharedValues(index_map)
    comm = vertices.mesh.comm
    n = index_map.size_local
    topology = vertices.mesh.topology
    cells = vertices.dofmap.list[: topology.index_map(topology.dim).size_local]
    a = np.repeat(cells, cells.shape[1], axis=1)
    b = np.tile(cells, cells.shape[1])
    # in equal parts to the vertices around; parts of these that are given away are passed on
    known = ~given & ~idle
    shares = _diagonal(vertices, ~given[:n])
    while True:
        takes = (given & ~known)[a] & known[b]
        rows, columns = (global_numbers(index_map, v[takes]) for v in (a, b))
        if not comm.allreduce(len(rows)):
            break
        step = triplet_matrix(comm, (n, n), rows, columns, np.ones(len(rows)))
        known |= exchange.from_owners(scaled_rows(step)) > 0
        passed = step.matMult(shares)
        shares.axpy(1.0, passed)
        step.destroy(), passed.destroy()
    # a function that no vertex can receive is kept
    own = _diagonal(vertices, (given & ~known)[:n])
    shares.axpy(1.0, own)
    own.destroy()
    return rows_with_ghosts(comm, index_map, rows_of(shares)), given & known


def _diagonal(vertices: fem.FunctionSpace, marked: Mask) -> PETSc.Mat:
    """Return the diagonal matrix with 1 at marked owned vertices, 0 elsewhere. Collective."""
    at = vertices.dofmap.index_map.local_range[0] + np.flatnonzero(marked).astype(np.int64)
    shape = len(marked), len(marked)
    return triplet_matrix(vertices.mesh.comm, shape, at, at, np.ones(len(at)))
