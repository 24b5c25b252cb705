# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of another body as what a surface may touch: which of their nodes lies opposite to which.

The surface whose facets carry the contact points is the *slave*, the facets opposite are the
*master*. Here both have the same nodes, each at its place or across a gap. Jumps are then
differences of two traces, at nodes, at Gauss points and in averages.

No rank holds a whole surface: nodes are sent to the ranks in whose bounding boxes the nearest node
may be, and answers come back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._errors import require
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.trace import facet_closures, outward_normals

__all__ = ["OppositeFacets"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_TANGENTIAL = 1e-6  # of a facet's size, by which nodes may be off across the normal
_OVERLAP = 1e-6  # of a facet's size, an overlap that is round-off


class OppositeFacets(Obstacle):
    """Facets of the same mesh, of another body or of the other side of a crack.

    Gap and normal are those of the reference configuration. The normal is that of the slave, at
    nodes the mean over its facets around them.

    Args:
        V: displacement space.
        slave: local facets, ghosts included.
        master: likewise.
        gap: UFL or a number; None for that of the geometry.
        interference: whether the bodies may overlap, as in a press fit.
        name: of the pair, for messages.

    Attributes:
        nodes: for every local node of ``V`` on the slave the global node opposite to it, -1
            elsewhere.

    Raises:
        ValueError: on every rank, if the faces have facets in common, a node has none opposite to
            it, both faces look the same way, or the bodies overlap without ``interference``.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        slave: npt.NDArray[np.int32],
        master: npt.NDArray[np.int32],
        *,
        gap: Any,
        interference: bool,
        name: str,
    ):
        self._name, domain = name, V.mesh
        self.comm, dim = domain.comm, domain.geometry.dim
        owned = domain.topology.index_map(dim - 1).size_local
        common = self.comm.allreduce(int((np.intersect1d(slave, master) < owned).sum()))
        require(self.comm, common == 0, f"{name}: slave and master have {common} facets in common")
        found = _matched(V, slave, master, name)
        self.nodes: Nodes = found.nodes
        W = fem.functionspace(domain, ("Lagrange", 1))
        at_vertices = found if V.ufl_element().degree == 1 else _matched(W, slave, master, name)
        normal = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (dim,))))
        normal.x.array[:] = at_vertices.normals.reshape(-1)
        self._normal = normal / ufl.sqrt(ufl.dot(normal, normal))
        if gap is None:
            self._refuse_overlap(at_vertices, interference)
            self._gap: Any = fem.Function(W)
            self._gap.x.array[:] = at_vertices.gaps
        else:
            self._gap = ufl.as_ufl(gap)

    def _refuse_overlap(self, found: _Matched, interference: bool) -> None:
        deep = found.gaps < -_OVERLAP * found.size
        worst = self.comm.allreduce(float(np.min(found.gaps[deep], initial=0.0)), op=min)
        require(
            self.comm,
            interference or worst == 0.0,
            f"{self._name}: the bodies overlap by {-worst:.3g}; interference=True for a press fit",
        )

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        return self._gap, self._normal


@dataclass(frozen=True)
class _Matched:
    """What lies opposite to the local nodes of a space; zeros, -1 off the slave."""

    nodes: Nodes
    gaps: Array
    normals: Array
    size: float  # of a facet


def _matched(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    master: npt.NDArray[np.int32],
    name: str,
) -> _Matched:
    """The global node of the master nearest to each local node of the slave. Collective."""
    comm, dim = V.mesh.comm, V.mesh.geometry.dim
    index_map, x = V.dofmap.index_map, V.tabulate_dof_coordinates()[:, :dim]
    normals, size = outward_normals(V, slave)
    theirs, _ = outward_normals(V, master)
    size = comm.allreduce(size, op=min)
    on_slave = _nodes_on(V, slave)
    on_master = np.flatnonzero(_nodes_on(V, master)[: index_map.size_local])
    mine = np.flatnonzero(on_slave)
    first = index_map.local_range[0]
    known = np.column_stack([x[on_master], theirs[on_master], first + on_master])
    found = _nearest(comm, known, x[mine], dim)
    offset = found[:, :dim] - x[mine]
    n = normals[mine]
    gap = np.sum(offset * n, axis=1)
    aside = np.linalg.norm(offset - gap[:, None] * n, axis=1)
    gap[np.abs(gap) <= 1e-9 * size] = 0.0
    unmatched = ~(aside <= _TANGENTIAL * size)
    # Every node once, by its owner.
    missing = comm.allreduce(int(unmatched[mine < index_map.size_local].sum()))
    total = comm.allreduce(int((mine < index_map.size_local).sum()))
    far = comm.allreduce(float(np.max(aside[unmatched], initial=0.0)), op=max)
    require(
        comm,
        missing == 0,
        f"{name}: the faces do not match: {missing} of {total} nodes of the slave have no node of "
        f"the master opposite to them (the nearest is {far:.3g} aside)",
    )
    same = np.sum(found[:, dim : 2 * dim] * n, axis=1)
    ids = found[:, 2 * dim].astype(np.int64)
    apart = ids != index_map.local_to_global(mine.astype(np.int32))
    turned = comm.allreduce(int((apart & (same > 0.5)).sum()))
    require(
        comm,
        turned == 0,
        f"{name}: slave and master look the same way, and not at each other",
    )
    nodes = np.full(len(x), -1, dtype=np.int64)
    nodes[mine] = ids
    gaps = np.zeros(len(x))
    gaps[mine] = gap
    return _Matched(nodes, gaps, normals, size)


def _nodes_on(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Which local nodes lie on facets of any rank. Collective."""
    marks = la.vector(V.dofmap.index_map, 1)
    marks.array[:] = 0.0
    marks.array[facet_closures(V, facets).reshape(-1)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    marks.scatter_forward()
    return np.asarray(marks.array > 0)


def _nearest(comm: MPI.Comm, known: Array, wanted: Array, dim: int) -> Array:
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
    box = np.full((2, dim), np.nan)
    if len(known):
        box[:] = known[:, :dim].min(axis=0), known[:, :dim].max(axis=0)
    boxes = np.array(comm.allgather(box))
    low, high = boxes[:, 0, None], boxes[:, 1, None]
    # Distances from places to the nearest and the farthest point of the boxes, (ranks, n).
    near = np.linalg.norm(np.maximum(np.maximum(low - wanted, wanted - high), 0.0), axis=2)
    far = np.linalg.norm(np.maximum(np.abs(wanted - low), np.abs(high - wanted)), axis=2)
    least = np.nanmin(far, axis=0, initial=np.inf)
    asked = [np.flatnonzero(d <= least * (1 + 1e-12)) for d in near]
    questions = exchanged(comm, [wanted[i] for i in asked], (dim,))
    tree = cKDTree(known[:, :dim]) if len(known) else None
    answers = [
        known[tree.query(q)[1]] if tree is not None and len(q) else known[:0] for q in questions
    ]
    distance = np.full(len(wanted), np.inf)
    for i, rows in zip(asked, exchanged(comm, answers, known.shape[1:]), strict=True):
        d = np.linalg.norm(rows[:, :dim] - wanted[i], axis=1)
        closer = d < distance[i]
        best[i[closer]], distance[i[closer]] = rows[closer], d[closer]
    return best


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
