# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nodes of a mortar whose jump Dirichlet data fix: their dual functions go to those around them.

Where a node p of the slave is held and so is the master at its place, as at the end of an interface
that meets a support, the jump there is no unknown. Its dual function psi_p reaches as far as the
facets of the slave, and may so meet nodes of the master that are free: a multiplier of its own
would constrain these alone, the harder the smaller int psi_p N_k is, and be of the size of the
inverse. It is removed, and the others take its function,

    psi_q + sum_p a_qp psi_p,    sum_q a_qp = 1,

so that they still sum to 1 everywhere: a uniform traction is transmitted to the master up to the
support. They stay biorthogonal to the free nodes of the slave (Wohlmuth, SIAM J. Numer. Anal. 38,
2000, section 2; in space Puso, Int. J. Numer. Methods Eng. 59, 2004). A node that is held opposite
to a master that is free keeps its multiplier: both still push each other.

Where pairs cross it is the same (`crossings`), of faces that match too; in the integral method the
hat functions N_p of the multiplier are given away so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la

from dolfinx_contact._mpi import SharedValues
from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.points.operators import multiplied, rows_of
from dolfinx_contact.points.opposite import Opposite

__all__ = ["held_in_place", "in_place", "receiving_vertices", "resting", "shared"]

Array = npt.NDArray[np.float64]

_MOVES = 1e-6  # a weight that is none of round-off


def resting(
    V: fem.FunctionSpace, opposite: Opposite, fixed: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Local nodes x dim, True where neither a node nor the point opposite moves. Collective.

    Args:
        V: displacement space.
        opposite: of the nodes; there is no jump where that is nothing.
        fixed: local nodes x dim, by Dirichlet data.
    """
    free = (~fixed[: V.dofmap.index_map.size_local]).astype(float)
    moves = opposite.values(V.mesh.comm, free, len(fixed), sizes=True) > _MOVES
    return np.asarray((fixed & ~moves) | opposite.none[:, None])


def held_in_place(
    V: fem.FunctionSpace, opposite: Opposite, fixed: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Local nodes whose jump is fixed while some of what their function meets moves. Collective.

    Args:
        V: displacement space.
        opposite: of faces that do not match.
        fixed: local nodes x dim, by Dirichlet data.
    """
    assert opposite.common is not None
    places = opposite.common.places
    held: npt.NDArray[np.bool_] = np.asarray(fixed.all(axis=1))
    free = (~held[: V.dofmap.index_map.size_local]).astype(float)
    here, around = (
        of.values(V.mesh.comm, free, len(held), sizes=True) for of in (places, opposite)
    )
    fixed_here = opposite.sides[0] & held & ~places.none & (here <= _MOVES)
    return np.asarray(fixed_here & (around > _MOVES))


def in_place(opposite: Opposite, nodes: npt.NDArray[np.bool_]) -> Opposite:
    """The points opposite, at some of the local nodes at their own places. Not collective."""
    assert opposite.common is not None
    places = opposite.common.places
    chosen = nodes[opposite.rows >= 0][:, None]
    width = max(opposite.nodes.shape[1], places.nodes.shape[1])

    def rows(values: Any, others: Any) -> Any:
        # Nodes are repeated, weights are not.
        mode: Any = "edge" if values.dtype.kind == "i" else "constant"
        padded = (np.pad(v, ((0, 0), (0, width - v.shape[1])), mode) for v in (others, values))
        return np.where(chosen, *padded)

    found = replace(opposite, nodes=rows(opposite.nodes, places.nodes))
    return replace(found, weights=rows(opposite.weights, places.weights))


def shared(
    vertices: fem.FunctionSpace,
    given: npt.NDArray[np.bool_],
    idle: npt.NDArray[np.bool_],
    areas: Array,
) -> tuple[PETSc.Mat, Array, npt.NDArray[np.bool_]]:
    """Means over the functions of a vertex and those that it takes. Collective.

    Args:
        vertices: scalar P1 space of the slave's facets.
        given: local vertices whose function is given away, ghosts included.
        idle: local vertices that take none.
        areas: of the owned vertices.

    Returns:
        The matrix of the means, in which a vertex that is given away has its own row; areas of the
        owned vertices with those that they take; and the local vertices that are given away, none
        whose function nobody can take.
    """
    n = len(areas)
    shares, given = _shares(vertices, given, idle)
    own = _diagonal(vertices, given[:n])
    means = shares.transpose(PETSc.Mat())
    total_areas = multiplied(means, areas[:, None])[:, 0]
    total_areas = np.where(given[:n], areas, total_areas)
    means.axpy(1.0, own)
    columns, rows = means.createVecs()
    columns.array[:] = areas
    rows.array[:] = 1 / total_areas
    means.diagonalScale(rows, columns)
    for part in (shares, own, columns, rows):
        part.destroy()
    return means, total_areas, given


def receiving_vertices(
    vertices: fem.FunctionSpace, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.int64], Array, npt.NDArray[np.bool_]]:
    """Which vertices take the functions of the local vertices, most their own. Collective.

    Args:
        vertices: scalar P1 space of the slave's facets.
        given: local vertices whose function is given away, ghosts included.
        idle: local vertices that take none.

    Returns:
        Global vertices and shares (n, k), of no share are copies of any; and the local vertices
        that are given away, none whose function nobody can take.
    """
    shares, given = _shares(vertices, given, idle)
    index_map = vertices.dofmap.index_map
    comm = vertices.mesh.comm
    nodes, weights = rows_of(shares, np.ones(index_map.size_local))
    width = comm.allreduce(nodes.shape[1], op=max)
    rows = np.zeros((index_map.size_local, 2 * width))
    rows[: len(nodes), : nodes.shape[1]] = nodes
    rows[: len(nodes), width : width + nodes.shape[1]] = weights
    rows = SharedValues(index_map).from_owners(rows)
    return rows[:, :width].astype(np.int64), rows[:, width:].copy(), given


def _shares(
    vertices: fem.FunctionSpace, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
) -> tuple[PETSc.Mat, npt.NDArray[np.bool_]]:
    """The shares a, by rows of all functions and columns of those that are kept, and the given.

    Of a vertex that is given away those around it take equal parts; where these are given as well,
    the parts continue to where they are taken. What nobody can take is kept.
    """
    index_map = vertices.dofmap.index_map
    comm = vertices.mesh.comm
    n = index_map.size_local
    topology = vertices.mesh.topology
    cells = vertices.dofmap.list[: topology.index_map(topology.dim).size_local]
    a = np.repeat(cells, cells.shape[1], axis=1)
    b = np.tile(cells, cells.shape[1])
    known = la.vector(index_map, 1)
    known.array[:] = ~given & ~idle
    shares = _diagonal(vertices, ~given[:n])
    while True:
        takes = given[a] & (known.array[a] == 0) & (known.array[b] > 0)
        rows, columns = (index_map.local_to_global(v[takes]).astype(np.int64) for v in (a, b))
        if not comm.allreduce(len(rows)):
            break
        step = matrix_of(comm, (n, n), entries := Entries(rows, columns))
        entries.add(np.ones(len(rows)), step)
        counts = step.getRowSum()
        known.array[:n][counts.array_r > 0] = 1.0
        known.scatter_forward()
        counts.array[:] = 1 / np.maximum(counts.array_r, 1.0)
        step.diagonalScale(counts)
        passed = step.matMult(shares)
        shares.axpy(1.0, passed)
        for part in (step, counts, passed):
            part.destroy()
    lost = given & (known.array == 0)
    own = _diagonal(vertices, lost[:n])
    shares.axpy(1.0, own)
    own.destroy()
    return shares, given & ~lost


def _diagonal(vertices: fem.FunctionSpace, marked: npt.NDArray[np.bool_]) -> PETSc.Mat:
    """1 at the owned vertices that are marked. Collective."""
    at = vertices.dofmap.index_map.local_range[0] + np.flatnonzero(marked).astype(np.int64)
    shape = len(marked), len(marked)
    A = matrix_of(vertices.mesh.comm, shape, entries := Entries(at, at))
    entries.add(np.ones(len(at)), A)
    return A
