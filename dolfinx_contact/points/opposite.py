# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of another body that a surface may touch: which of their nodes is opposite to which.

The surface whose facets carry the contact points is the *slave*, the facets opposite are the
*master*. Where both have the same nodes, each at its place or across a gap, jumps are differences
of two traces, at nodes, at Gauss points and in averages; else the weights of nodes are those of a
`mortar`, and Gauss points lie on what the faces have in common.

No rank holds a whole surface: nodes are sent to the ranks in whose bounding boxes the nearest node
may be, and answers come back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import SharedValues, require
from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.clipping import Cover, cover
from dolfinx_contact.points.descriptions import Overlap
from dolfinx_contact.points.evaluation import at_nodes
from dolfinx_contact.points.facing import (
    candidates,
    faces_of,
    measured,
    projected,
    projected_faces,
    refuse_aslant,
)
from dolfinx_contact.points.mortar import between, coupling
from dolfinx_contact.points.revolution import mirrored
from dolfinx_contact.points.search import nearest, within
from dolfinx_contact.points.trace import (
    at_global_places,
    nodes_on,
    outward_normals,
)

__all__ = ["CURVED_OVERLAP", "Common", "Opposite", "OppositeFacets"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_TANGENTIAL = 1e-6  # of a facet's size, by which nodes may be off across the normal
_OVERLAP = 1e-6  # of a facet's size, an overlap that is round-off
#: The same of faces that do not match, whose facets are chords of curves.
CURVED_OVERLAP = 0.05
_ROUND_OFF = 1e-9  # of a facet's size, a gap that is none
_FACING = 0.5  # cosine between the normal of a given surface and that of the slave, the least
_FAR = 10.0  # sizes of the mesh, the gap of a node that has nothing opposite


@dataclass(frozen=True)
class Common:
    """What two faces that do not match have in common.

    Attributes:
        facets: local, of the slave, that this rank owns.
        cover: of these.
        places: the points opposite to the nodes at their own places; none where there are none.
    """

    facets: npt.NDArray[np.int32]
    cover: Cover
    places: Opposite


@dataclass(frozen=True)
class Opposite:
    """Weighted means of nodes that move opposite to those of a surface.

    Attributes:
        rows: for every local node of the displacement the row of what follows, -1 off the surface.
        nodes: global nodes (rows, k).
        weights: of them (rows, k); of no weight are copies of any node.
        none: local nodes without a point opposite, or with themselves.
        areas: of the local nodes at corners of facets, of the covered part; None where faces
            match.
        sides: which local nodes lie on slave and master.
        master_facets: local, ghosts included.
        common: what the faces have in common; None where they match.
    """

    rows: Nodes
    nodes: Nodes
    weights: Array
    none: npt.NDArray[np.bool_]
    areas: Array | None
    sides: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]
    master_facets: npt.NDArray[np.int32]
    common: Common | None = None

    @property
    def points(self) -> type[Any] | None:
        """What the contact points are, whatever the method; None: the method decides."""
        return None

    @property
    def matching(self) -> bool:
        """Whether every node has one opposite to it."""
        return self.common is None

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
        surface: the true shape of the master, of which gap and normal are taken at the nodes; None
            for that of its facets.
        normal: a unit vector (dim,) along which the faces face each other; None for those of the
            slave.
        overlap: what becomes of bodies that start in each other.
        axisymmetric: whether these are bodies of revolution.
        name: of the pair, for messages.

    Attributes:
        opposite: the nodes opposite to those of the slave.

    Raises:
        ValueError: on every rank, if the faces have facets in common, do not match where they have
            to, look the same way, or the bodies overlap by more than is allowed, or if a given
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
        surface: Obstacle | None,
        normal: Array | None,
        overlap: Overlap,
        axisymmetric: bool,
        name: str,
    ):
        domain = V.mesh
        comm = domain.comm
        dim = domain.geometry.dim
        owned = domain.topology.index_map(dim - 1).size_local
        common = comm.allreduce(int((np.intersect1d(slave, master) < owned).sum()))
        require(comm, common == 0, f"{name}: slave and master have {common} facets in common")
        W = fem.functionspace(domain, ("Lagrange", 1))
        size = comm.allreduce(outward_normals(W, slave)[1], op=min)
        if normal is not None:
            refuse_aslant(domain, slave[slave < owned], normal, name)
        of_nodes = partial(_normals, slave=slave, given=normal, axisymmetric=axisymmetric)
        found = _matched(V, slave, master, size, name, of_nodes(V), normal)
        if found is None:
            found = _mortar(V, slave, master, size, name, normal, axisymmetric=axisymmetric)
        self.opposite = found
        normals = of_nodes(W)
        field = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (dim,))))
        field.x.array[:] = normals.reshape(-1)
        self._normal = field / ufl.sqrt(ufl.dot(field, field))
        if gap is not None:
            self._gap: Any = ufl.as_ufl(gap)
            return
        if surface is not None:
            gaps, shape = _to_surface(W, surface, slave, normals, size, name)
            field.x.array[:] = shape.reshape(-1)
        else:
            corners: npt.NDArray[np.int32] = np.zeros(len(normals), dtype=np.int32)
            corners[W.dofmap.list] = V.dofmap.list[:, : W.dofmap.list.shape[1]]
            gaps = _gaps(V, found, of_nodes(V), size)[corners]
            allowed = (_OVERLAP if found.matching else CURVED_OVERLAP) * size
            worst = comm.allreduce(float(np.min(gaps, initial=0.0)), op=min)
            unless = "if slave and master do not look away from each other"
            overlap.require(comm, worst, allowed, name, unless)
            # What is allowed without being meant is round-off, or the chords of curved faces.
            gaps = gaps if overlap.presses else np.maximum(gaps, 0.0)
        self._gap = fem.Function(W)
        self._gap.x.array[:] = gaps

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        return self._gap, self._normal


def _normals(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    given: Array | None,
    *,
    axisymmetric: bool,
) -> Array:
    """Of the slave at the local nodes, or the one that is given; zero elsewhere. Collective."""
    normals, _ = outward_normals(V, slave)
    if given is not None:
        normals[np.any(normals != 0.0, axis=1)] = given
    return mirrored(V, normals) if axisymmetric else normals


def _to_surface(
    W: fem.FunctionSpace,
    surface: Obstacle,
    slave: npt.NDArray[np.int32],
    normals: Array,
    size: float,
    name: str,
) -> tuple[Array, Array]:
    """Gaps to a given surface, and its normals, at the local nodes of the slave. Collective.

    Zero elsewhere.
    """
    gaps, shape = at_nodes(W, surface)
    on_slave = nodes_on(W, slave)
    turned = (np.sum(shape * normals, axis=1) < _FACING)[: W.dofmap.index_map.size_local]
    count = W.mesh.comm.allreduce(int((turned & on_slave[: len(turned)]).sum()))
    require(
        W.mesh.comm,
        count == 0,
        f"{name}: at {count} nodes of the slave the normal of the given surface is another",
    )
    gaps = np.where(on_slave & (np.abs(gaps) > _ROUND_OFF * size), gaps, 0.0)
    return gaps, np.where(on_slave[:, None], shape, 0.0)


def _gaps(V: fem.FunctionSpace, opposite: Opposite, normals: Array, size: float) -> Array:
    """Gaps at the local nodes, along the normals; large where nothing is opposite. Collective."""
    dim = V.mesh.geometry.dim
    comm = V.mesh.comm
    x = node_positions(V)[:, :dim]
    there = opposite.values(comm, x[: V.dofmap.index_map.size_local], len(x))
    gaps = np.sum((there - x) * normals, axis=1)
    gaps[np.abs(gaps) <= _ROUND_OFF * size] = 0.0
    low, high = bounding_box(comm, x)
    if not opposite.matching:
        gaps[opposite.none] = _FAR * float(np.linalg.norm(high - low))
    return np.asarray(gaps)


def _matched(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    master: npt.NDArray[np.int32],
    size: float,
    name: str,
    normals: Array,
    given: Array | None,
) -> Opposite | None:
    """The node of the master opposite to each of the slave; None if one has none. Collective.

    Along a given normal that is the nearest as it is seen in its direction, of those that look
    against it; else the nearest of all.
    """
    comm = V.mesh.comm
    dim = V.mesh.geometry.dim
    index_map = V.dofmap.index_map
    x = node_positions(V)[:, :dim]
    theirs, _ = outward_normals(V, master)
    against = nodes_on(V, master)
    if given is not None:
        x = projected(given, x)
        against = against & (theirs @ given < 0)
    on_master = np.flatnonzero(against[: index_map.size_local])
    mine = np.flatnonzero(nodes_on(V, slave))
    first = index_map.local_range[0]
    known = np.column_stack([x[on_master], theirs[on_master], first + on_master])
    found = nearest(comm, known, x[mine], dim)
    offset = found[:, :dim] - x[mine]
    n = normals[mine]
    gap = np.sum(offset * n, axis=1)
    aside = np.linalg.norm(offset - gap[:, None] * n, axis=1)
    unmatched: npt.NDArray[np.bool_] = np.asarray(~(aside <= _TANGENTIAL * size))
    # Every node once, by its owner.
    owned = mine < index_map.size_local
    missing = comm.allreduce(int((unmatched & owned).sum()))
    if missing or _unlike_facets(V, slave, master, given):
        return None
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
        "an arm of a crack ends on the other side: exchange slave and master; where cracks cross, "
        "or both sides have an arm, each arm needs a group of its own",
    )
    rows = np.full(len(x), -1, dtype=np.int64)
    none = np.zeros(len(x), dtype=bool)
    rows[mine] = np.arange(len(mine))
    none[mine] = itself
    sides = nodes_on(V, slave), nodes_on(V, master)
    return Opposite(rows, ids[:, None], np.ones((len(mine), 1)), none, None, sides, master)


def _unlike_facets(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    master: npt.NDArray[np.int32],
    given: Array | None,
) -> bool:
    """Whether facets of the slave differ in size from the opposing ones. Collective.

    Nodes of finer facets lie between those that have one opposite.
    """
    comm = V.mesh.comm
    dim = V.mesh.geometry.dim
    ours = measured(V.mesh, slave, given)
    others = measured(V.mesh, master, None if given is None else -given)
    facing = nearest(comm, others, ours[:, :dim], dim)
    off = np.abs(facing[:, dim] / ours[:, dim] - 1) > _TANGENTIAL
    return bool(comm.allreduce(int(off.sum())))


def _mortar(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.int32],
    master: npt.NDArray[np.int32],
    size: float,
    name: str,
    normal: Array | None,
    *,
    axisymmetric: bool,
) -> Opposite:
    """The weights of a mortar; see `mortar`. Collective.

    Of degree 2 these are the weights at the corners of facets; nodes between them have the means.
    """
    comm = V.mesh.comm
    index_map = V.dofmap.index_map
    dim = V.mesh.geometry.dim
    degree = V.mesh.ufl_domain().ufl_coordinate_element().degree
    require(comm, degree == 1, f"{name}: cells are curved where faces do not match")
    on_slave = nodes_on(V, slave)
    on_master = nodes_on(V, master)
    shared = comm.allreduce(int((on_slave & on_master)[: index_map.size_local].sum()))
    require(comm, shared == 0, f"{name}: slave and master touch at {shared} nodes of the mesh")
    facets = slave[slave < V.mesh.topology.index_map(dim - 1).size_local]
    mine = faces_of(V, facets)
    if normal is not None:
        require(comm, V.ufl_element().degree == 1, f"{name}: a given normal needs degree 1 here")
        mine = projected_faces(normal, mine)
    theirs, pairs = candidates(comm, mine, faces_of(V, master))
    common = cover(mine, theirs, pairs, deepest=size)
    marked = np.unique(common.facet)
    require(comm, bool(comm.allreduce(len(marked))), f"{name}: nothing is opposite")
    degree = V.ufl_element().degree
    found = coupling(common, degree, axisymmetric=axisymmetric)
    corners = mine.nodes[:, : mine.corners]
    local = index_map.global_to_local(corners.reshape(-1))
    sums = SharedValues(index_map).sums(local, found.areas.reshape(-1))
    n = index_map.size_local
    A = matrix_of(comm, (n, n), entries := Entries(found.slave, found.master))
    entries.add(found.values, A)
    if degree > 1:
        A = between(comm, A, mine.nodes[marked], mine.corners)
    # There any area serves, as there is no traction.
    areas = np.where(sums > 0, sums, size ** (dim - 1))
    sides = on_slave, on_master

    def opposite(A: PETSc.Mat, common: Common | None) -> Opposite:
        rows, nodes, weights, none = _means(V, A, on_slave)
        return Opposite(rows, nodes, weights, none, areas, sides, master, common)

    nodes, others, shares = common.places()
    at = np.repeat(nodes, shares.shape[1]), others.reshape(-1)
    P = matrix_of(comm, (n, n), entries := Entries(*at))
    entries.add(shares.reshape(-1), P)
    return opposite(A, Common(facets, common, opposite(P, None)))


def _means(
    V: fem.FunctionSpace, A: PETSc.Mat, on_slave: npt.NDArray[np.bool_]
) -> tuple[Nodes, Nodes, Array, npt.NDArray[np.bool_]]:
    """The rows of a matrix as weighted means, as in `Opposite`; the matrix is destroyed."""
    index_map = V.dofmap.index_map
    comm = V.mesh.comm
    indptr, columns, values = A.getValuesCSR()
    A.destroy()
    counts = np.diff(indptr)
    width = comm.allreduce(int(counts.max(initial=1)), op=max)
    # By way of a vector, so that the ghosts have them too: nodes, then weights, whether there are.
    rows = np.zeros((index_map.size_local, 2 * width + 1))
    for i in np.flatnonzero(on_slave[: index_map.size_local]):
        here = slice(indptr[i], indptr[i + 1])
        # A node without a partner is its own partner, and has no jump.
        rows[i, :width] = index_map.local_range[0] + i
        rows[i, width] = 1.0
        if counts[i]:
            rows[i, : counts[i]] = columns[here]
            # The sum is the area, but for round-off.
            rows[i, width : width + counts[i]] = values[here] / values[here].sum()
            rows[i, -1] = 1.0
    rows = SharedValues(index_map).from_owners(rows)
    on = np.flatnonzero(on_slave)
    places = np.full(len(on_slave), -1, dtype=np.int64)
    places[on] = np.arange(len(on))
    none = np.asarray(on_slave & (rows[:, -1] == 0))
    return places, rows[on, :width].astype(np.int64), rows[on, width:-1].copy(), none
