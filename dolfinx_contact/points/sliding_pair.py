# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs and self-contact in large sliding: their contact points are the nodes of the slave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Indices, Mask
from dolfinx_contact._geometry import node_positions, ratio, transformed
from dolfinx_contact._mpi import all_ranks, count_of, keep, maximum, require
from dolfinx_contact._petsc import triplet_matrix
from dolfinx_contact.body.rigid import diagonal
from dolfinx_contact.laws import LawAtPoints
from dolfinx_contact.laws.symbols import before
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.contact_points import NodePoints
from dolfinx_contact.points.descriptions import ContactMethod, ContactPair, SelfContact
from dolfinx_contact.points.jump_operators import Operator
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, with_memory
from dolfinx_contact.points.opposite import Opposite, Sides
from dolfinx_contact.points.pair import facets_of_sides
from dolfinx_contact.points.sliding_faces import SlidingFaces, SlidingOpposite
from dolfinx_contact.points.sliding_kinematics import Facing, RayRates
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import (
    exterior_facets,
    nodes_on,
    outward_normals,
    unit_field,
)

__all__ = ["SlidingOperator", "SlidingPair", "SlidingPoints"]


_OVERLAP = 1e-3  # overlap of chords of curved faces, relative to a facet
_ALONG = 0.1  # smallest component of a normal along the planes of symmetry of its node
_SHARP = 35.0  # degrees between the normals of a node and of a facet, beyond which it is an edge
_ON_PLANE = 1e-9  # distance from a plane of symmetry, relative to the largest coordinate
_IN_PLACE = 1e-9  # distance of nodes from their plane of symmetry, relative to the body
_REACH = 0.25  # default search distance, relative to the size of the smaller face


class SlidingPair(DiscreteSurface):
    """Discretisation of a `ContactPair` in large sliding or `SelfContact`. Methods are collective.

    Args:
        contact: description of the contact.

    Raises:
        ValueError: on every rank, for the reasons listed in `DiscreteSurface`; or if the slave has
            an edge, two faces share a node, the master lies behind the slave, the bodies overlap by
            more than is allowed, or the law needs the total slip.
    """

    points: SlidingPoints

    def __init__(self, contact: ContactPair | SelfContact):
        domain, name = contact.u.function_space.mesh, contact.name
        keep(domain)
        if isinstance(contact, SelfContact):
            slave = master = exterior_facets(domain, contact.facets, contact.tag, name)
        else:
            slave, master = facets_of_sides(contact)
        obstacle = SlidingFacets(contact, slave, master)
        super().__init__(contact, slave, obstacle, SlidingPoints)
        self.start_gaps = self.points.known.facing.nodal.gap[: self.points.number].copy()
        _check_law(self.law_at_points, name)
        self._require_no_edge()
        self._require_apart()
        if self._overlap.removed:
            self.points.remove_overlap_of_mesh()

    def fixed_jumps(self, fixed: Mask) -> Mask:
        # opposing points change, and a gap is a mean over several nodes
        return np.zeros_like(fixed)

    def hold(self, fixed: Mask, crossing: Mask) -> None:
        """Raise ``ValueError`` if Dirichlet data let nodes leave planes of symmetry. Collective."""
        free = (self.points.opposite.across & ~fixed)[: self.owned_nodes]
        count = count_of(self.comm, free.any(axis=1))
        require(
            self.comm,
            count == 0,
            f"{self.name}: Dirichlet data let {count} nodes leave the plane of symmetry on which "
            "they lie; hold them across it",
        )

    def require_in_place(self, prescribed: Array, size: float) -> None:
        opposite = self.points.opposite
        moved = np.abs(np.where(opposite.across, prescribed[: len(opposite.across)], 0.0))
        worst = self.comm.allreduce(moved.max(axis=0, initial=0.0), op=np.maximum)
        axis = int(np.argmax(worst))
        require(
            self.comm,
            bool(worst[axis] <= _IN_PLACE * size),
            f"{self.name}: Dirichlet data move nodes by {worst[axis]:.3g} off the plane of "
            f"symmetry {'xyz'[axis]} = {opposite.planes.get(axis, 0.0):g}, in which the images of "
            "both faces are made: hold them there with the value 0, and move the rest of the model "
            "instead",
        )

    def kinematics(
        self, u: Array, motion: Array | None = None, memory: Memory | None = None
    ) -> Kinematics:
        points = self.points
        operator = points.at(u, None if memory is None else memory.displacement)
        nodal = operator.facing.nodal
        n = points.number
        slipped = np.zeros((n, points.dim))
        if memory is not None:  # turned with the surface since then
            turned = memory.reference(nodal.before[:n])
            slipped = transformed(nodal.rotation[:n], turned)
        data = replace(points.data, n=nodal.normal[:n], gap=np.zeros(n))
        given = with_memory(self.law_at_points.compiled, memory, data)
        return Kinematics(operator, nodal.jump[:n], slipped, given, memory=memory)

    def _require_no_edge(self) -> None:
        """Raise ``ValueError`` if the slave face contains an edge of the body. Collective."""
        angle, place = self.points.faces.sharpest_edge()
        require(
            self.comm,
            angle <= _SHARP,
            f"{self.name}: the slave has an edge at ({', '.join(f'{c:.6g}' for c in place)}), "
            f"where the mean normal is {angle:.0f} degrees off a facet, so that pressure there "
            "would push aside: let its face end at the edge, make the edge round with smaller "
            "facets, or exchange slave and master",
        )

    def _require_apart(self) -> None:
        """Raise ``ValueError`` if faces overlap by more than is allowed in the mesh. Collective."""
        points, overlap = self.points, self._overlap
        allowed = _OVERLAP * points.geometry.facet_size
        words = "or remove_overlap for a start without stress"
        overlap.require(self.comm, self.start_gaps, allowed, self.name, words)
        depth = points.opposite.depth
        if points.opposite.direction is not None:
            lost = count_of(self.comm, points.faces.lost)
            require(
                self.comm,
                lost == 0,
                f"{self.name}: {lost} facets penetrate the body initially by more than the search "
                f"distance {depth:.3g}",
            )
            return
        behind = points.faces.farthest_behind(diagonal(self.comm, self.domain.geometry.x))
        words = "interference=True for a press fit"
        require(
            self.comm,
            behind <= depth,
            f"{self.name}: the master lies {behind:.3g} behind the slave, farther than the search "
            f"distance {depth:.3g}: the bodies overlap, or slave and master do not face each "
            f"other; {'use a larger search_distance' if overlap.most else words}",
        )


def _check_law(law: LawAtPoints, name: str) -> None:
    """Raise ``ValueError`` if a law depends on more than slip increments. Not collective."""
    compiled = law.compiled
    for what, has in (
        ("averages the pressure around points", law.law.averaging is not None),
        ("has bonds", compiled.bonded),
        ("depends on the whole tangential jump", bool({*compiled.names} & {*before(law.dim)})),
        ("bounds the shear of open points", not law.law.needs_pressure),
    ):
        if has:
            raise ValueError(
                f"{name}: the law {law.law.name} {what}: with sliding='large' a point has another "
                "opposing point at every state, and no such memory"
            )


class SlidingFacets(Obstacle):
    """Obstacle of a pair in large sliding: master facets in the same mesh.

    Args:
        contact: description of the pair, or of self-contact.
        slave: local facets of the slave, ghosts included.
        master: local facets of the master, ghosts included.

    Attributes:
        opposite: master, with its planes of symmetry and search distance.

    Raises:
        ValueError: on every rank, if two faces have nodes in common, or the slave lies in a plane
            of symmetry.
    """

    opposite: SlidingOpposite

    def __init__(self, contact: ContactPair | SelfContact, slave: Indices, master: Indices):
        V, name = contact.u.function_space, contact.name
        planes, depth = contact.symmetry or {}, contact.search_distance
        direction = np.asarray(contact.direction) if isinstance(contact, SelfContact) else None
        comm = V.mesh.comm
        sides = Sides(nodes_on(V, slave), nodes_on(V, master))
        n = V.dofmap.index_map.size_local
        shared = count_of(comm, (sides.slave & sides.master)[:n])
        words = f"{name}: slave and master share {shared} nodes of the mesh"
        require(comm, shared == 0 or direction is not None, words)
        if depth is None:
            x = node_positions(V)
            depth = _REACH * min(diagonal(comm, x[side]) for side in sides)
        self.opposite = SlidingOpposite(
            nodes=np.zeros((1, 1), dtype=np.int64),
            weights=np.zeros((1, 1)),
            none=np.zeros(len(sides.slave), dtype=bool),
            areas=None,
            sides=sides,
            master_facets=master,
            across=_across_planes(V, sides, planes, name),
            planes=planes,
            depth=depth,
            direction=direction,
        )
        # normals, without their parts across planes of symmetry
        normals = outward_normals(V, slave)
        normals[self.opposite.across] = 0.0
        left = np.linalg.norm(normals[sides.slave], axis=1)
        count = count_of(comm, left < _ALONG)
        require(
            comm,
            count == 0,
            f"{name}: the slave lies in a plane of symmetry instead of ending there: its normals "
            f"look across it at {count} nodes",
        )
        _, self._normal = unit_field(V.mesh, normals)

    @property
    def flat(self) -> bool:
        """Always True: opposing points follow the state, so any displacement is admissible."""
        return True

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        return fem.Constant(domain, 0.0), self._normal


def _across_planes(
    V: fem.FunctionSpace, sides: Sides, planes: Mapping[int, float], name: str
) -> Mask:
    """Return the mask of components normal to planes of symmetry on which nodes lie. Collective.

    Shape (local nodes, dim). The slave ends at the planes; the master has images behind them.

    Raises:
        ValueError: on every rank, if no node of the slave lies on a plane, or both faces together
            lie on both sides of it.
    """
    comm = V.mesh.comm
    x = node_positions(V)
    owned = V.dofmap.index_map.size_local
    across: Mask = np.zeros(x.shape, dtype=bool)
    size = maximum(comm, np.abs(x))
    for axis, place in planes.items():
        off = x[:, axis] - place
        near = np.abs(off) <= _ON_PLANE * size
        across[:, axis] = near & (sides.slave | sides.master)
        parts = [near, ~near & (off < 0), ~near & (off > 0)]
        counts = np.array([[int((on & c)[:owned].sum()) for c in parts] for on in sides])
        (there, below, above), (_, under, over) = comm.allreduce(counts)
        require(
            comm,
            there > 0 and not (below + under and above + over),
            f"{name}: the face must end at the symmetry plane {'xyz'[axis]} = {place:g}: {there} "
            f"nodes lie on it, {below} below and {above} above. Both faces lie on one side of it, "
            f"since the master has images behind it: {under} of its nodes are below and {over} "
            "above",
        )
    return across


class SlidingPoints(NodePoints):
    """Nodes of a slave in large sliding, with weighted mean gaps and slips (`sliding_kinematics`).

    Attributes:
        faces: slave and master.
        opposite: master, with its planes of symmetry and search distance.
        known: operator from displacements to jumps at the displacement of the last evaluation.
    """

    method: ClassVar[ContactMethod] = "mixed"
    slides: ClassVar[bool] = True
    known: SlidingOperator
    opposite: SlidingOpposite

    def _set_operators(self, opposite: Opposite | None) -> None:
        assert isinstance(opposite, SlidingOpposite)
        self.opposite = opposite
        axisymmetric = self._weight is not None
        self.faces = SlidingFaces(self._V, self.facets, opposite, axisymmetric=axisymmetric)
        self.mirrored = self.faces.kept == 0.0
        self._last: tuple[Array, Array | None] | None = None
        self.operator = self.at(np.zeros((self._owned_nodes, self.dim)), None)

    def remove_overlap_of_mesh(self) -> None:
        """Subtract overlaps of both faces in the mesh from all later gaps. Collective."""
        self.faces.removed = -np.minimum(self.known.facing.nodal.gap, 0.0)
        self._last = None
        self.operator = self.at(np.zeros((self._owned_nodes, self.dim)), None)

    @property
    def choices(self) -> list[float]:
        """Search distance, planes of symmetry and largest removed overlap. Collective."""
        taken = maximum(self.comm, self.faces.removed)
        planes = [float(v) for plane in sorted(self.opposite.planes.items()) for v in plane]
        # without the digits that depend on the number of ranks
        return [self.opposite.depth, *planes, float(f"{taken:.6g}")]

    def at(self, u: Array, before: Array | None) -> SlidingOperator:
        """Return the operator from displacements to jumps, cached in `known`. Collective.

        Args:
            u: displacement of the owned nodes, shape (n, dim); further rows are ignored.
            before: displacement of the owned nodes at the last accepted state; None for zero.
        """
        mine = u[: self._owned_nodes]
        last = self._last
        same = last is not None and last[1] is before and np.array_equal(last[0], mine)
        if not all_ranks(self.comm, same):
            facing = self.faces.at(mine, before, self.geometry.vertex_areas)
            x = self.faces.positions(mine)
            self.known = SlidingOperator(self.faces, facing, self.number, x)
            self.geometry.covered_areas = facing.nodal.weight
            self._last = mine.copy(), before
        return self.known


# -- B at a state --------------------------------------------------------------------------------


class _Change(NamedTuple):
    """Change of the positions of both faces.

    Attributes:
        corners: displacements of the c corners of the slave and master facet of each of p common
            parts, shape (p, c, dim).
        vectors: changes of the sums of area vectors around vertices, shape (vertices, dim).
    """

    corners: Array
    vectors: Array


@dataclass(frozen=True, eq=False)
class SlidingOperator(Operator):
    """Operator B from displacements to jumps for sliding faces, at one displacement.

    Attributes:
        faces: facets of slave and master.
        facing: common parts of slave and master facets.
        number: number of contact points, which are the owned vertices of the slave.
        x: positions of the corners of the slave facets, shape (n, k, dim).
    """

    faces: SlidingFaces
    facing: Facing
    number: int
    x: Array

    @property
    def areas(self) -> Array:  # type: ignore[override]
        return self.facing.nodal.weight[: self.number]

    @cached_property
    def absent(self) -> Mask:  # type: ignore[override]
        """Mask of points without an opposing point, shape (n,)."""
        return self.areas == 0.0

    @property
    def facets_passed(self) -> Array:
        """Slips since the last accepted state, divided by the size of master facets, shape (n,).

        The facets are those that are opposite now, with their sizes in that state.
        """
        facing = self.facing
        sizes = np.linalg.norm(facing.along, axis=3).mean(axis=3)
        size = self._means(np.einsum("paq,pqa->pa", facing.weighted, sizes))
        return ratio(np.linalg.norm(facing.nodal.slip, axis=1), size)[: self.number]

    @cached_property
    def share(self) -> Array:  # type: ignore[override]
        return self.facing.nodal.share[: self.number]

    def mean_around(self, tractions: Array) -> Array:
        facing = self.facing
        sums = self.faces.sums(facing.facet, facing.mass @ self._at_corners(tractions))
        around = facing.nodal.around
        by = ratio(np.ones_like(around), around)
        return (self.faces.kept * by[:, None] * sums)[: self.number]

    def _at_corners(self, tractions: Array) -> Array:
        """Return tractions at the slave corners of each of p common parts, shape (p, a, dim).

        Args:
            tractions: tractions at the owned points, shape (n, dim).
        """
        alive = np.where(self.absent[:, None], 0.0, tractions)
        alive = self.faces.vertex_exchange.from_owners(alive)
        return alive[self.faces.corners[self.facing.facet]]

    def _change(self, v: Array) -> _Change:
        """Return the change of the positions of both faces along a displacement."""
        faces, facing = self.faces, self.facing
        mine = faces.of_slave(v)
        theirs = faces.master.at_candidates(v, facing.found)
        m = faces.at_nodes(np.einsum("nikj,nkj->ni", faces.normal_rates(self.x), mine))
        return _Change(np.concatenate([mine[facing.facet], theirs[facing.master]], axis=1), m)

    def _moved(self, change: _Change) -> RayRates:
        """Return the changes of the rays between both faces (`Facing.moved`)."""
        m = change.vectors[self.faces.corners[self.facing.facet]]
        return self.facing.moved(change.corners, m)

    def _means(self, parts: Array) -> Array:
        """Return means at the local vertices, weighted with the covered areas.

        Args:
            parts: weighted contributions of the a slave corners of p common parts, shape
                (p, a, ...).
        """
        sums = self.faces.sums(self.facing.facet, parts)
        return (self.facing.nodal.inverse * sums.T).T

    def apply(self, v: Array) -> Array:
        facing = self.facing
        corners = self._change(v).corners
        return self._means(facing.weighted @ (facing.jumps @ corners))[: self.number]

    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        facing, faces = self.facing, self.faces
        inverse = facing.nodal.inverse[faces.corners[facing.facet]]
        values = inverse[:, :, None] * (facing.weighted @ facing.jumps)
        rows = faces.slave_vertices[facing.facet][:, :, None]
        return triplet_matrix(comm, (self.number, nodes), rows, facing.nodes[:, None], values)

    def rate(self, v: Array) -> Array:
        """Return the derivative of the jumps along a displacement, shape (n, dim).

        The contribution of changing normals (`normal_rate`) is not included.

        Args:
            v: displacement of the owned nodes, shape (nodes, dim).
        """
        facing, faces, nodal = self.facing, self.faces, self.facing.nodal
        change = self._change(v)
        rays = self._moved(change)
        gaps = self._means(transformed(facing.weighted, rays.gap))
        slip = np.einsum(
            "paq,pqadi,pqi->pad", facing.weighted, facing.along, rays.place, optimize=True
        )
        slips = transformed(nodal.rotation, faces.kept * self._means(slip))
        turned = transformed(nodal.by_turning, transformed(nodal.by_normal, change.vectors))
        spun = np.sum(facing.spins * change.corners, axis=(1, 2))[:, None]
        spun = faces.free_to_spin * self._means(facing.weighted.sum(axis=2) * spun)
        slips = slips + turned + spun[:, None] * nodal.by_spin
        return (slips - gaps[:, None] * nodal.normal)[: self.number]

    def normal_rate(self, v: Array) -> Array:
        return transformed(self.facing.nodal.by_normal, self._change(v).vectors)[: self.number]

    def at_quadrature(self, tractions: Array) -> Array:
        """Return tractions times areas at the quadrature points, shape (p, q, dim).

        Args:
            tractions: tractions at the owned contact points, shape (n, dim).
        """
        return self.facing.weighted.transpose(0, 2, 1) @ self._at_corners(tractions)

    def transpose(self, tractions: Array) -> Array:
        forces = self.facing.jumps.transpose(0, 2, 1) @ self.at_quadrature(tractions)
        return self.faces.forces(self.facing, forces)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        slopes = self.facing.rays.slopes
        moving = transformed(slopes, self._moved(self._change(v)).place)
        forces = np.zeros(self.facing.signs.shape)
        forces[:, -slopes.shape[2] :] -= moving.transpose(0, 2, 1) @ self.at_quadrature(tractions)
        return self.faces.forces(self.facing, forces)
