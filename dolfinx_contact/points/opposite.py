# SPDX-License-Identifier: LGPL-3.0-or-later
"""Opposing faces in small sliding: facets of another body, and points opposite to slave nodes.

The surface whose facets carry the contact points is the *slave*; the facets opposite to it are the
*master*. If their facets match, at the same positions or across a gap, jumps are differences of the
displacements of opposing nodes, interpolated to the contact points. Otherwise a `mortar` gives the
weights of the nodes, and Gauss points lie on the common parts of the faces.

No rank stores a whole surface: each query for the nearest node is sent to the ranks in whose
bounding boxes it may lie, and these ranks send the result back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Indices, Ints, Mask
from dolfinx_contact._geometry import (
    area_vectors,
    dot,
    global_numbers,
    node_positions,
    tangential,
)
from dolfinx_contact._mpi import SharedValues, count_of, minimum, require
from dolfinx_contact._petsc import triplet_matrix
from dolfinx_contact.body.rigid import diagonal
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.clipping import Cover, Faces, cover
from dolfinx_contact.points.descriptions import ContactPair, Overlap
from dolfinx_contact.points.evaluators import at_nodes
from dolfinx_contact.points.jump_operators import (
    NodeWeights,
    rows_of,
    rows_with_ghosts,
    scaled_rows,
)
from dolfinx_contact.points.mortar import between, coupling
from dolfinx_contact.points.revolution import mirrored
from dolfinx_contact.points.spatial_search import around, faces_of, nearest, opposing_facets
from dolfinx_contact.points.trace import (
    at_global_places,
    nodes_on,
    outward_normals,
    owned_facets,
    unit_field,
)

__all__ = ["CURVED_OVERLAP", "Common", "Opposite", "OppositeFacets", "Sides"]


# relative to the size of a facet
_TANGENTIAL = 1e-6  # distance of opposing nodes across the normal
_OVERLAP = 1e-6  # overlap that is round-off
#: Admissible overlap of faces that do not match, whose facets are chords of curves.
CURVED_OVERLAP = 0.05
_ROUND_OFF = 1e-9  # gap that is round-off
_FACING = 0.5  # smallest cosine between the normals of a given surface and of the slave
_ASLANT = 0.5  # smallest cosine between a given normal and the normal of a facet
_FAR = 10.0  # sizes of the mesh, the gap of a node that has nothing opposite


class Sides(NamedTuple):
    """Masks of the local displacement nodes on the slave and on the master."""

    slave: Mask
    master: Mask


@dataclass(frozen=True)
class Common:
    """Common parts of two faces that do not match.

    Attributes:
        facets: local slave facets owned by this rank.
        cover: covered parts of these facets.
        places: points of the master opposite to the positions of the slave nodes, without mortar
            averaging; nodes without such a point are marked in ``places.none``.
    """

    facets: Indices
    cover: Cover
    places: Opposite


@dataclass(frozen=True)
class Opposite:
    """Points opposite to the nodes of a slave, as weighted means of master nodes.

    Attributes:
        nodes: global master nodes opposite to the local slave nodes, in their order, shape (m, k).
        weights: weights of these nodes, shape (m, k); rows are padded with arbitrary nodes of
            weight 0.
        none: mask of the local nodes that have no opposing point or are their own opposing node, as
            at the front of a crack.
        areas: covered areas of the local nodes at corners of facets; None if faces match.
        sides: masks of the local nodes on slave and master.
        master_facets: local master facets, ghosts included.
        common: common parts of the faces; None if they match.
    """

    nodes: Ints
    weights: Array
    none: Mask
    areas: Array | None
    sides: Sides
    master_facets: Indices
    common: Common | None = None

    @property
    def matching(self) -> bool:
        """Whether the faces match, so that every slave node has one opposing node."""
        return self.common is None

    @property
    def places(self) -> Opposite:
        """Points opposite to the positions of the slave nodes, without mortar averaging."""
        return self if self.common is None else self.common.places

    def at(self, nodes: Indices) -> NodeWeights:
        """Return the master nodes and weights opposite to given slave nodes, shape (..., k) each.

        Args:
            nodes: local slave nodes, shape (...).
        """
        rows = np.cumsum(self.sides.slave)[nodes] - 1
        return NodeWeights(self.nodes[rows], self.weights[rows])

    def values(self, comm: MPI.Comm, values: Array, *, sizes: bool = False) -> Array:
        """Return values at the points opposite to the local nodes, 0 off the slave. Collective.

        Args:
            comm: communicator.
            values: values at the owned nodes, shape (n, ...).
            sizes: whether to use the absolute values of the weights.
        """
        slave = self.sides.slave
        found = np.zeros((len(slave), *values.shape[1:]))
        every = at_global_places(comm, values, self.nodes)
        weights = np.abs(self.weights) if sizes else self.weights
        found[slave] = np.einsum("nk,nk...->n...", weights, every)
        return found


class OppositeFacets(Obstacle):
    """Obstacle of a pair: facets of another body in the mesh, or of the other side of a crack.

    Gap and normal refer to the reference configuration. The normal is the one given in the
    description, if any; otherwise it is the slave normal, which at a node is the mean over the
    adjacent slave facets.

    Args:
        pair: description of the pair.
        slave: local slave facets, ghosts included.
        master: local master facets, ghosts included.

    Attributes:
        opposite: opposing points of the nodes of the slave.

    Raises:
        ValueError: on every rank, if faces do not match although their elements require it, if the
            normals of both faces point in the same direction, if the bodies overlap by more than is
            allowed, or if a given normal deviates by more than 60 degrees from a facet normal of
            the slave.
    """

    opposite: Opposite

    def __init__(self, pair: ContactPair, slave: Indices, master: Indices):
        faces = _BothFaces(pair, slave, master)
        V, name, normal = faces.V, faces.name, faces.normal
        domain, comm = V.mesh, V.mesh.comm
        W = fem.functionspace(domain, ("Lagrange", 1))
        if normal is not None:
            count = count_of(comm, faces.facets.normals @ normal < _ASLANT)
            require(
                comm,
                count == 0,
                f"{name}: the given normal is more than 60 degrees off {count} facet normals of "
                "the slave; it points from the slave to the master",
            )
        self.opposite = found = _matched(faces) or _mortar(faces)
        normals = faces.normals(W)
        field, self._normal = unit_field(domain, normals)
        if pair.gap is not None:
            self._gap: Any = ufl.as_ufl(pair.gap)
            return
        if pair.surface is not None:
            gaps, shape = _to_surface(W, pair.surface, normals, faces)
            field.x.array[:] = shape.reshape(-1)
        else:
            corners: Indices = np.zeros(len(normals), dtype=np.int32)
            corners[W.dofmap.list] = V.dofmap.list[:, : W.dofmap.list.shape[1]]
            gaps = _gaps(faces, found)[corners]
            overlap = Overlap.of(pair)
            allowed = (_OVERLAP if found.matching else CURVED_OVERLAP) * faces.size
            unless = "if slave and master do not look away from each other"
            overlap.require(comm, gaps, allowed, name, unless)
            # without a press fit, an admissible overlap is round-off or due to chords of curves
            gaps = gaps if overlap.presses else np.maximum(gaps, 0.0)
        self._gap = fem.Function(W)
        self._gap.x.array[:] = gaps

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        return self._gap, self._normal


@dataclass(frozen=True)
class _BothFaces:
    """Slave and master face of a pair in the mesh. All properties are collective.

    Attributes:
        pair: description of the pair.
        slave: local slave facets, ghosts included.
        master: local master facets, ghosts included.
    """

    pair: ContactPair
    slave: Indices
    master: Indices

    @property
    def V(self) -> fem.FunctionSpace:
        """Displacement space."""
        return self.pair.u.function_space

    @property
    def name(self) -> str:
        """Name of the pair for messages."""
        return self.pair.name

    @property
    def normal(self) -> Array | None:
        """Normal given by the user, shape (dim,); None if the normals of the slave are used."""
        return None if self.pair.normal is None else np.asarray(self.pair.normal)

    @cached_property
    def sides(self) -> Sides:
        """Masks of the local nodes on slave and master."""
        return Sides(nodes_on(self.V, self.slave), nodes_on(self.V, self.master))

    @cached_property
    def facets(self) -> Faces:
        """Slave facets owned by this rank."""
        return faces_of(self.V, self.slave)

    @cached_property
    def size(self) -> float:
        """Size of the smallest slave facet: its length in 2D, the root of its area in 3D."""
        areas = np.linalg.norm(area_vectors(self.facets.x), axis=1)
        least = minimum(self.V.mesh.comm, areas, np.inf)
        return float(least ** (1 / (self.V.mesh.geometry.dim - 1)))

    @property
    def x(self) -> Array:
        """Positions of the local nodes, shape (n, dim)."""
        return node_positions(self.V)

    def normals(self, V: fem.FunctionSpace) -> Array:
        """Return normals of the slave at the local nodes of a space, 0 elsewhere. Collective."""
        normals = outward_normals(V, self.slave)
        if self.normal is not None:
            normals[np.any(normals != 0.0, axis=1)] = self.normal
        return mirrored(V, normals) if self.pair.axisymmetric else normals


def _to_surface(
    W: fem.FunctionSpace, surface: Obstacle, normals: Array, faces: _BothFaces
) -> tuple[Array, Array]:
    """Return gaps and normals of a given obstacle at the slave nodes, 0 elsewhere. Collective.

    Raises:
        ValueError: on every rank, if an obstacle normal deviates too much from the slave normal.
    """
    gaps, shape = at_nodes(W, surface)
    on_slave = nodes_on(W, faces.slave)
    turned = on_slave & (dot(shape, normals) < _FACING)
    count = count_of(W.mesh.comm, turned[: W.dofmap.index_map.size_local])
    require(
        W.mesh.comm,
        count == 0,
        f"{faces.name}: at {count} nodes the normal of the given surface deviates from the slave "
        "normal",
    )
    gaps = np.where(on_slave & (np.abs(gaps) > _ROUND_OFF * faces.size), gaps, 0.0)
    return gaps, np.where(on_slave[:, None], shape, 0.0)


def _gaps(faces: _BothFaces, opposite: Opposite) -> Array:
    """Return gaps at the local nodes, measured along the slave normals. Collective.

    Nodes without an opposing point get a large gap.
    """
    V, x = faces.V, faces.x
    there = opposite.values(V.mesh.comm, x[: V.dofmap.index_map.size_local])
    gaps = dot(there - x, faces.normals(V))
    gaps[np.abs(gaps) <= _ROUND_OFF * faces.size] = 0.0
    if not opposite.matching:
        gaps[opposite.none] = _FAR * diagonal(V.mesh.comm, x)
    return gaps


def _matched(faces: _BothFaces) -> Opposite | None:
    """Return the master node opposite to each slave node; None if faces do not match. Collective.

    It is the nearest master node; if the user gives a normal, the nearest in the projection along
    this normal among the nodes whose own normals point against it.
    """
    V, name, given = faces.V, faces.name, faces.normal
    comm = V.mesh.comm
    index_map = V.dofmap.index_map
    x = faces.x
    theirs = outward_normals(V, faces.master)
    against = faces.sides.master
    if given is not None:
        x = tangential(x, given)
        against = against & (theirs @ given < 0)
    on_master = np.flatnonzero(against[: index_map.size_local])
    mine = np.flatnonzero(faces.sides.slave)
    first = index_map.local_range[0]
    known = {"x": x[on_master], "normal": theirs[on_master], "node": first + on_master}
    found = nearest(comm, known, x[mine])
    nodes = found["node"]
    n = faces.normals(V)[mine]
    aside = np.linalg.norm(tangential(found["x"] - x[mine], n), axis=1)
    unmatched = ~(aside <= _TANGENTIAL * faces.size)
    owned = mine < index_map.size_local
    there = np.zeros_like(x)
    there[mine] = found["x"]
    if count_of(comm, unmatched & owned) or _facets_differ(faces, there):
        return None
    itself = nodes == global_numbers(index_map, mine)
    turned = dot(found["normal"], n) > 0.5
    require(
        comm,
        not (turned & ~itself).any(),
        f"{name}: the normals of slave and master point in the same direction; they must face "
        "each other",
    )
    radius = np.full(len(mine), _TANGENTIAL * faces.size)
    near, _ = around(comm, {"x": x[on_master]}, {"x": found["x"], "reach": radius})
    double = np.bincount(near, minlength=len(mine)) > 1
    ambiguous = count_of(comm, double & owned & ~itself)
    require(
        comm,
        not ambiguous,
        f"{name}: {ambiguous} nodes of the slave have two or more of the master opposite, as where "
        "an arm of a crack ends on the other side: exchange slave and master; where cracks cross, "
        "or both sides have an arm, each arm needs a group of its own",
    )
    none = np.zeros(len(x), dtype=bool)
    none[mine] = itself
    return Opposite(
        nodes=nodes[:, None],
        weights=np.ones((len(mine), 1)),
        none=none,
        areas=None,
        sides=faces.sides,
        master_facets=faces.master,
    )


def _facets_differ(faces: _BothFaces, there: Array) -> bool:
    """Return whether any slave facet differs from the master facet opposite to it. Collective.

    If they differ in area, one mesh is finer, and its additional nodes have no opposing node. If
    their corners are not opposite to each other, the meshes may have the same nodes, but divide
    squares along different diagonals; each mesh then has other nodal forces for the same traction.

    Args:
        faces: slave and master.
        there: positions of the nodes opposite to the local slave nodes, shape (n, dim); if the user
            has given a normal, in the projection along it.
    """
    V, comm, normal = faces.V, faces.V.mesh.comm, faces.normal
    sides = []
    for facets, sense, x in ((faces.slave, 1.0, there), (faces.master, -1.0, faces.x)):
        side = faces_of(V, facets)
        nodes = side.nodes[:, : side.corners]
        corners = x[V.dofmap.index_map.global_to_local(nodes.reshape(-1))].reshape(side.x.shape)
        area = np.linalg.norm(area_vectors(side.x), axis=1)
        if normal is not None:
            seen = sense * (side.normals @ normal) > 0
            corners, area = tangential(corners, normal)[seen], area[seen]
        sides.append({"x": corners.mean(axis=1), "corners": corners, "area": area})
    ours, theirs = sides
    facing = nearest(comm, theirs, ours["x"])
    finer = np.abs(facing["area"] / ours["area"] - 1) > _TANGENTIAL
    between = np.linalg.norm(facing["corners"][:, :, None] - ours["corners"][:, None], axis=3)
    turned = between.min(axis=2).max(axis=1) > _TANGENTIAL * faces.size
    return bool(count_of(comm, finer | turned))


def _mortar(faces: _BothFaces) -> Opposite:
    """Return the mortar weights of faces that do not match (`mortar`). Collective.

    For degree 2, the mortar gives the weights at the corners of facets; other nodes get means of
    these weights.
    """
    V, name, size = faces.V, faces.name, faces.size
    comm = V.mesh.comm
    index_map = V.dofmap.index_map
    n = index_map.size_local
    degree = V.ufl_element().degree
    curved = V.mesh.ufl_domain().ufl_coordinate_element().degree > 1
    require(comm, not curved, f"{name}: cells are curved where faces do not match")
    shared = count_of(comm, (faces.sides.slave & faces.sides.master)[:n])
    require(comm, shared == 0, f"{name}: slave and master touch at {shared} nodes of the mesh")
    facets = owned_facets(V.mesh, faces.slave)
    mine = faces.facets
    if faces.normal is not None:
        require(comm, degree == 1, f"{name}: a given normal needs degree 1 here")
        # in planes across it
        middles = mine.x.mean(axis=1, keepdims=True)
        normals = np.broadcast_to(faces.normal, mine.normals.shape)
        mine = Faces(middles + tangential(mine.x - middles, faces.normal), normals, mine.nodes)
    theirs, pairs = opposing_facets(comm, mine, faces_of(V, faces.master))
    common = cover(mine, theirs, pairs, deepest=size)
    marked = np.unique(common.facet)
    require(comm, bool(comm.allreduce(len(marked))), f"{name}: no facet is opposite")
    found = coupling(common, degree, axisymmetric=faces.pair.axisymmetric)
    local = index_map.global_to_local(mine.nodes[:, : mine.corners].reshape(-1))
    sums = SharedValues(index_map).sums(local, found.areas.reshape(-1))
    # without an opposing point there is no traction, and any area serves
    areas = np.where(sums > 0, sums, size ** (V.mesh.geometry.dim - 1))

    means = triplet_matrix(comm, (n, n), found.slave, found.master, found.values)
    if degree > 1:
        means = between(comm, means, mine.nodes[marked], mine.corners)
    nodes, there = common.places()
    places = triplet_matrix(comm, (n, n), nodes[:, None], there.nodes, there.weights)
    at_places = _by_rows(faces, places, areas)
    return _by_rows(faces, means, areas, Common(facets, common, at_places))


def _by_rows(
    faces: _BothFaces, A: PETSc.Mat, areas: Array, common: Common | None = None
) -> Opposite:
    """Return opposing points whose weights are the rows of a matrix. Collective.

    The matrix is scaled and destroyed. Its row sums are the areas, except for round-off.
    """
    comm, index_map = faces.V.mesh.comm, faces.V.dofmap.index_map
    slave = faces.sides.slave
    # a node without an opposing point is opposite to itself, and has no jump
    alone = scaled_rows(A) == 0
    rows = rows_of(A)
    rows.nodes[alone, 0] = index_map.local_range[0] + np.flatnonzero(alone)
    rows.weights[alone, 0] = 1.0
    rows = rows_with_ghosts(comm, index_map, rows)
    none = SharedValues(index_map).from_owners(alone.astype(np.float64)) > 0
    return Opposite(
        nodes=rows.nodes[slave],
        weights=rows.weights[slave],
        none=slave & none,
        areas=areas,
        sides=faces.sides,
        master_facets=faces.master,
        common=common,
    )
