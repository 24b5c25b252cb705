# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of another body as what a surface may touch: which of their nodes lies opposite to which.

The surface whose facets carry the contact points is the *slave*, the facets opposite are the
*master*. Where both have the same nodes, each at its place or across a gap, jumps are differences
of two traces, at nodes, at Gauss points and in averages; else the weights are those of a `mortar`.

No rank holds a whole surface: nodes are sent to the ranks in whose bounding boxes the nearest node
may be, and answers come back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._entries import Entries, matrix_of
from dolfinx_contact._errors import require
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.mortar import Faces, coupling
from dolfinx_contact.points.search import asked_ranks, exchanged, nearest, within
from dolfinx_contact.points.trace import (
    at_global_places,
    facet_closures,
    facet_normals,
    outward_normals,
)

__all__ = ["Opposite", "OppositeFacets"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_TANGENTIAL = 1e-6  # of a facet's size, by which nodes may be off across the normal
_OVERLAP = 1e-6  # of a facet's size, an overlap that is round-off
_CURVED_OVERLAP = 0.05  # the same of faces that do not match, whose facets are chords of curves
_ROUND_OFF = 1e-9  # of a facet's size, a gap that is none
_FAR = 10.0  # sizes of the mesh, the gap of a node that has nothing opposite
_ASLANT = 0.5  # cosine between a given normal and that of a facet of the slave, the least


@dataclass(frozen=True)
class Opposite:
    """Weighted means of nodes that move opposite to those of a surface.

    Attributes:
        rows: for every local node of the displacement the row of what follows, -1 off the surface.
        nodes: global nodes (rows, k).
        weights: of them (rows, k); of no weight are copies of any node.
        none: local nodes that have nothing opposite, or themselves.
        areas: of the local nodes, of the covered part; None where faces match.
        sides: which local nodes lie on slave and master.
        master_facets: local, ghosts included.
    """

    rows: Nodes
    nodes: Nodes
    weights: Array
    none: npt.NDArray[np.bool_]
    areas: Array | None
    sides: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]
    master_facets: npt.NDArray[np.int32]

    @property
    def matching(self) -> bool:
        """Whether every node has one opposite to it."""
        return self.areas is None

    def at(self, nodes: npt.NDArray[np.int32]) -> tuple[Nodes, Array]:
        """Nodes and weights (..., k) opposite to local nodes of the surface."""
        return self.nodes[self.rows[nodes]], self.weights[self.rows[nodes]]

    def values(self, comm: MPI.Comm, values: Array, size: int, *, sizes: bool = False) -> Array:
        """Values opposite to the local nodes, 0 off the surface. Collective.

        Args:
            comm: communicator.
            values: at the owned nodes (n, ...).
            size: number of local nodes.
            sizes: whether weights count by their size.
        """
        found = np.zeros((size, *values.shape[1:]))
        on = np.flatnonzero(self.rows >= 0)
        nodes, weights = self.at(on.astype(np.int32))
        every = at_global_places(comm, values, nodes)
        found[on] = np.einsum("nk,nk...->n...", np.abs(weights) if sizes else weights, every)
        return found


class OppositeFacets(Obstacle):
    """Facets of the same mesh, of another body or of the other side of a crack.

    Gap and normal are those of the reference configuration. The normal is that of the slave, at
    nodes the mean over its facets around them, or one that is given.

    Args:
        V: displacement space.
        slave: local facets, ghosts included.
        master: likewise.
        gap: UFL or a number; None for that of the geometry.
        normal: a unit vector (dim,) along which the faces look at each other; None for those of the
            slave.
        interference: whether the bodies may overlap, as in a press fit.
        nodal: whether the contact points are nodes, so that faces need not match.
        name: of the pair, for messages.

    Attributes:
        opposite: the nodes opposite to those of the slave.

    Raises:
        ValueError: on every rank, if the faces have facets in common, do not match where they have
            to, look the same way, or the bodies overlap without ``interference``, or if a given
            normal is more than 60 degrees off that of a facet of the slave.
    """

    opposite: Opposite

    def __init__(
        self,
        V: fem.FunctionSpace,
        slave: npt.NDArray[np.int32],
        master: npt.NDArray[np.int32],
        *,
        gap: Any,
        normal: Array | None,
        interference: bool,
        nodal: bool,
        name: str,
    ):
        domain = V.mesh
        comm, dim = domain.comm, domain.geometry.dim
        owned = domain.topology.index_map(dim - 1).size_local
        common = comm.allreduce(int((np.intersect1d(slave, master) < owned).sum()))
        require(comm, common == 0, f"{name}: slave and master have {common} facets in common")
        W = fem.functionspace(domain, ("Lagrange", 1))
        size = comm.allreduce(outward_normals(W, slave)[1], op=min)
        if normal is not None:
            mine = facet_normals(domain, slave[slave < owned])
            aslant = comm.allreduce(int((mine @ normal < _ASLANT).sum()))
            require(
                comm,
                not aslant,
                f"{name}: the given normal is more than 60 degrees off that of {aslant} facets of "
                "the slave; it points from the slave to the master",
            )
        found, objection = _matched(V, slave, master, size, name, normal)
        if found is None:
            reason = f"{name}: the faces do not match: {objection}"
            require(comm, nodal, f"{reason}, as only nodal contact allows")
            found = _mortar(V, slave, master, size, name, normal)
        self.opposite = found
        on_vertices = found
        if V.ufl_element().degree > 1:
            matched, _ = _matched(W, slave, master, size, name, normal)
            assert matched is not None  # its nodes are some of those that do
            on_vertices = matched
        normals = _normals(W, slave, normal)
        field = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (dim,))))
        field.x.array[:] = normals.reshape(-1)
        self._normal = field / ufl.sqrt(ufl.dot(field, field))
        if gap is None:
            gaps = _gaps(W, on_vertices, normals, size)
            allowed = (_OVERLAP if found.matching else _CURVED_OVERLAP) * size
            worst = comm.allreduce(float(np.min(gaps, initial=0.0)), op=min)
            require(
                comm,
                interference or worst >= -allowed,
                f"{name}: the bodies overlap by {-worst:.3g}; interference=True for a press fit, "
                "if slave and master do not look away from each other",
            )
            # What is allowed without being meant is round-off, or the chords of curved faces.
            gaps = gaps if interference else np.maximum(gaps, 0.0)
            self._gap: Any = fem.Function(W)
            self._gap.x.array[:] = gaps
        else:
            self._gap = ufl.as_ufl(gap)

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        return self._gap, self._normal


def _normals(V: fem.FunctionSpace, slave: npt.NDArray[np.int32], given: Array | None) -> Array:
    """Those of the slave at the local nodes (n, dim), or the one that is given. Collective.

    Zero off the slave.
    """
    normals, _ = outward_normals(V, slave)
    if given is not None:
        normals[np.any(normals != 0.0, axis=1)] = given
    return normals


def _gaps(W: fem.FunctionSpace, opposite: Opposite, normals: Array, size: float) -> Array:
    """Gaps at the local nodes, along the normals; large where nothing is opposite. Collective."""
    dim, comm = W.mesh.geometry.dim, W.mesh.comm
    x = W.tabulate_dof_coordinates()[:, :dim]
    there = opposite.values(comm, x[: W.dofmap.index_map.size_local], len(x))
    gaps = np.sum((there - x) * normals, axis=1)
    gaps[np.abs(gaps) <= _ROUND_OFF * size] = 0.0
    extent = comm.allreduce(x.max(axis=0, initial=-np.inf), op=np.maximum)
    extent -= comm.allreduce(x.min(axis=0, initial=np.inf), op=np.minimum)
    if opposite.areas is not None:
        gaps[opposite.none] = _FAR * float(np.linalg.norm(extent))
    return np.asarray(gaps)


def _matched(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    master: npt.NDArray[np.int32],
    size: float,
    name: str,
    normal: Array | None,
) -> tuple[Opposite | None, str]:
    """The node of the master opposite to each of the slave, or why there is none. Collective."""
    comm, dim = V.mesh.comm, V.mesh.geometry.dim
    index_map, x = V.dofmap.index_map, V.tabulate_dof_coordinates()[:, :dim]
    normals = _normals(V, slave, normal)
    theirs, _ = outward_normals(V, master)
    on_master = np.flatnonzero(_nodes_on(V, master)[: index_map.size_local])
    mine = np.flatnonzero(_nodes_on(V, slave))
    first = index_map.local_range[0]
    known = np.column_stack([x[on_master], theirs[on_master], first + on_master])
    found = nearest(comm, known, x[mine], dim)
    offset, n = found[:, :dim] - x[mine], normals[mine]
    gap = np.sum(offset * n, axis=1)
    aside = np.linalg.norm(offset - gap[:, None] * n, axis=1)
    unmatched: npt.NDArray[np.bool_] = np.asarray(~(aside <= _TANGENTIAL * size))
    # Every node once, by its owner.
    owned = mine < index_map.size_local
    missing, total = comm.allreduce(np.array([int((unmatched & owned).sum()), int(owned.sum())]))
    if missing:
        return None, f"{missing} of {total} nodes of the slave have none of the master opposite"
    # Nodes of finer facets lie between those that have one opposite.
    ours, others = (_measured(V.mesh, facets) for facets in (slave, master))
    facing = nearest(comm, others, ours[:, :dim], dim)
    off = np.abs(facing[:, dim] / ours[:, dim] - 1) > _TANGENTIAL
    missing, total = comm.allreduce(np.array([int(off.sum()), len(ours)]))
    if missing:
        return None, f"{missing} of {total} facets of the slave have no like one opposite"
    ids = found[:, 2 * dim].astype(np.int64)
    itself = ids == index_map.local_to_global(mine.astype(np.int32))
    turned = np.sum(found[:, dim : 2 * dim] * n, axis=1) > 0.5
    require(
        comm,
        not comm.allreduce(int((turned & ~itself).sum())),
        f"{name}: slave and master look the same way, and not at each other",
    )
    double = within(comm, x[on_master], found[:, :dim], _TANGENTIAL * size) > 1
    ambiguous = comm.allreduce(int((double & owned & ~itself).sum()))
    require(
        comm,
        not ambiguous,
        f"{name}: {ambiguous} nodes of the slave have two or more of the master opposite, as where "
        "an arm of a crack ends on the other side; exchange slave and master",
    )
    rows, none = np.full(len(x), -1, dtype=np.int64), np.zeros(len(x), dtype=bool)
    rows[mine], none[mine] = np.arange(len(mine)), itself
    sides = _nodes_on(V, slave), _nodes_on(V, master)
    return Opposite(rows, ids[:, None], np.ones((len(mine), 1)), none, None, sides, master), ""


def _measured(domain: mesh.Mesh, facets: npt.NDArray[np.int32]) -> Array:
    """Means of the nodes and areas of the facets that this rank owns (n, dim + 1)."""
    dim = domain.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    if not len(owned):
        return np.zeros((0, dim + 1))
    x = domain.geometry.x[mesh.entities_to_geometry(domain, dim - 1, owned)][:, :, :dim]
    areas = np.linalg.norm(facet_normals(domain, owned, unit=False), axis=1)
    return np.column_stack([x.mean(axis=1), areas])


def _mortar(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    master: npt.NDArray[np.int32],
    size: float,
    name: str,
    normal: Array | None,
) -> Opposite:
    """The weights of a mortar; see `mortar`. Collective."""
    comm, index_map = V.mesh.comm, V.dofmap.index_map
    both = _nodes_on(V, slave) & _nodes_on(V, master)
    shared = comm.allreduce(int(both[: index_map.size_local].sum()))
    require(comm, shared == 0, f"{name}: slave and master touch at {shared} nodes of the mesh")
    mine = _faces(V, slave)
    if normal is not None:  # facets are seen along it
        aside = (mine.x - mine.x.mean(axis=1, keepdims=True)) @ normal
        x = mine.x - aside[:, :, None] * normal
        mine = Faces(x, np.broadcast_to(normal, mine.normals.shape), mine.nodes)
    theirs, pairs = _candidates(comm, mine, _faces(V, master))
    found = coupling(mine, theirs, pairs, deepest=size)
    n = index_map.size_local
    sums = la.vector(index_map, 1)
    sums.array[:] = 0.0
    local = index_map.global_to_local(mine.nodes.reshape(-1)).reshape(mine.nodes.shape)
    np.add.at(sums.array, local.reshape(-1), found.areas.reshape(-1))
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    covered = sums.array > 0
    require(comm, bool(comm.allreduce(int(covered.any()))), f"{name}: nothing is opposite")
    A = matrix_of(comm, (n, n), entries := Entries(found.slave, found.master))
    entries.add(found.values, A)
    indptr, columns, values = A.getValuesCSR()
    A.destroy()
    counts = np.diff(indptr)
    width = comm.allreduce(int(counts.max(initial=1)), op=max)
    # By way of a vector, so that the ghosts have them too: nodes, then weights.
    table = la.vector(index_map, 2 * width)
    rows = table.array.reshape(-1, 2 * width)
    rows[:] = 0.0
    on_slave = _nodes_on(V, slave)
    for i in np.flatnonzero(on_slave[:n]):
        here = slice(indptr[i], indptr[i + 1])
        # What has nothing opposite is opposite to itself, and has no jump.
        rows[i, :width], rows[i, width] = index_map.local_range[0] + i, 1.0
        if covered[i]:
            rows[i, : counts[i]] = columns[here]
            # The sum is the area, but for round-off.
            rows[i, width : width + counts[i]] = values[here] / values[here].sum()
    table.scatter_forward()
    on = np.flatnonzero(on_slave)
    places = np.full(len(covered), -1, dtype=np.int64)
    places[on] = np.arange(len(on))
    nodes, weights = rows[on, :width].astype(np.int64), rows[on, width:].copy()
    # There any area serves, as there is no traction.
    areas = np.where(covered, sums.array, size)
    sides = on_slave, _nodes_on(V, master)
    return Opposite(places, nodes, weights, on_slave & ~covered, areas, sides, master)


def _faces(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> Faces:
    """The facets that this rank owns."""
    domain, dim = V.mesh, V.mesh.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    closures = facet_closures(V, owned)
    x = V.tabulate_dof_coordinates()[:, :dim][closures]
    nodes = V.dofmap.index_map.local_to_global(closures.reshape(-1)).reshape(closures.shape)
    return Faces(x, facet_normals(domain, owned), nodes.astype(np.int64))


def _candidates(comm: MPI.Comm, slave: Faces, master: Faces) -> tuple[Faces, Nodes]:
    """Facets of the master, of any rank, that may be opposite to those of the slave. Collective.

    A facet that lies opposite at an angle of less than 60 degrees is at most twice as far as the
    nearest, and half the sizes of both.

    Returns:
        The facets, and pairs of numbers of slave and master facets.
    """
    middles, others = slave.x.mean(axis=1), master.x.mean(axis=1)
    dim = middles.shape[1]
    radius, theirs = (
        np.linalg.norm(f.x - f.x.mean(axis=1, keepdims=True), axis=2).max(axis=1, initial=0.0)
        for f in (slave, master)
    )
    largest = comm.allreduce(float(np.max(theirs, initial=0.0)), op=max)
    closest = nearest(comm, others, middles, dim)
    distance = np.linalg.norm(closest - middles, axis=1)
    reach = 2 * (distance + largest) + radius
    asked, tree = asked_ranks(comm, others, middles, lambda near, _: near <= reach)
    sent: Any = [np.column_stack([middles[i], reach[i], i]) for i in asked]
    answers: list[Array] = []
    corners = master.x.shape[1]
    width = 1 + corners * dim + dim + corners
    for q in exchanged(comm, sent, (dim + 2,)):
        found = tree.query_ball_point(q[:, :dim], q[:, dim]) if tree is not None and len(q) else []
        k = np.array([j for part in found for j in part], dtype=np.int64)
        i = np.repeat(q[:, dim + 1], [len(part) for part in found]) if len(k) else np.empty(0)
        x = master.x[k].reshape(-1, corners * dim)
        columns = [i[:, None], x, master.normals[k], master.nodes[k]]
        answers.append(np.column_stack(columns) if len(k) else np.empty((0, width)))
    rows = np.concatenate(exchanged(comm, answers, (width,)))
    a, b = 1 + corners * dim, 1 + (corners + 1) * dim
    faces = Faces(
        rows[:, 1:a].reshape(-1, corners, dim), rows[:, a:b], rows[:, b:].astype(np.int64)
    )
    return faces, np.column_stack([rows[:, 0].astype(np.int64), np.arange(len(rows))])


def _nodes_on(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Which local nodes lie on facets of any rank. Collective."""
    marks = la.vector(V.dofmap.index_map, 1)
    marks.array[:] = 0.0
    marks.array[facet_closures(V, facets).reshape(-1)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    marks.scatter_forward()
    return np.asarray(marks.array > 0)
