# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discrete contact surfaces: contact points, kinematics and evaluation of the law."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives, extract_coefficients

from dolfinx_contact._arrays import Array, Indices, Ints, Mask
from dolfinx_contact._compat import create_facet_submesh
from dolfinx_contact._geometry import Gathered, dot, node_positions, tangential
from dolfinx_contact._mpi import everywhere, keep, require, same_everywhere
from dolfinx_contact._ufl import described, refuse_displacement, refuse_other_mesh
from dolfinx_contact._validate import ReadOnly
from dolfinx_contact.body.rigid import parts
from dolfinx_contact.laws import LawAtPoints, PointData
from dolfinx_contact.obstacles import HalfSpace, Obstacle, known_displaced
from dolfinx_contact.points.contact_points import (
    AveragedPoints,
    ContactPoints,
    Degrees,
    FacetPoints,
    NodePoints,
)
from dolfinx_contact.points.descriptions import Contact, ContactMethod, Overlap, displacement_degree
from dolfinx_contact.points.displaced import DisplacedPoints, TrueGaps, displaced_points, follows
from dolfinx_contact.points.evaluators import Evaluator, GapsAndNormals, Given, ScatteredEvaluator
from dolfinx_contact.points.jump_operators import ConstantOperator
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, with_memory
from dolfinx_contact.points.neighbours import LawAmongPoints
from dolfinx_contact.points.opposite import CURVED_OVERLAP, Opposite
from dolfinx_contact.points.revolution import check_section
from dolfinx_contact.points.rigid_body import Partner, RigidBody, shape_of
from dolfinx_contact.points.trace import edge_of, exterior_facets
from dolfinx_contact.rigid_surfaces import RigidSurface

__all__ = ["DiscreteSurface"]


_TANGENTIAL = 1e-6  # normal component of a tangential direction
_UNIT = 1e-6  # admissible error of the length of a normal

#: Tangential part of the motion of an obstacle that is reported.
_ALONG = 0.1


class DiscreteSurface(ReadOnly):
    """Discretised contact surface: contact points, multiplier, kinematics and law.

    A `ContactProblem` creates and owns one for each description. Methods are collective.

    Args:
        contact: description of the surface.
        facets: local indices of the slave facets; default: facets of the `ContactSurface`.
        obstacle: master face of a pair; default: obstacle of a `ContactSurface`.
        points_class: class of the contact points; default: determined by the method.
        linear: whether the body is linear; determines the default method and kind of sliding.

    Attributes:
        description: description of the surface.
        u: displacement.
        domain: mesh of the body.
        law: law of contact and friction.
        obstacle: rigid obstacle or opposing face.
        method: ``"nodal"``, ``"integral"`` or ``"mixed"``.
        rigid_body: obstacle if it is a `RigidBody`; None otherwise.
        partner: frame of reference of the displacements, which moves with a rigid obstacle.
        between_bodies: whether the obstacle is the master face of a pair.
        slides: whether the pair is in large sliding.
        degrees: degrees of displacement and multiplier.
        owned_nodes: number of displacement nodes owned by this rank.
        given: gap, normal and fields of the law in UFL.
        multiplier: traction on the body, a vector Function of the facet submesh.
        points: contact points of this rank, with the operators from displacements to jumps and from
            multipliers to tractions.
        law_at_points: compiled law, evaluated at the contact points.
        displaced: evaluator of gap and normal of a curved obstacle at displaced points; None in
            small sliding.
        true_gaps: function returning distances of the displaced points to the obstacle.
        moved_along: whether the obstacle moved along its surface when its Constants last changed.
        start_gaps: initial gaps of the points, negative inside the obstacle, before
            ``remove_overlap`` is applied, shape (n,).

    Raises:
        ValueError: on every rank, if facets, obstacle or law do not fit the mesh, obstacles differ
            between ranks, points start too far inside the obstacle, or large sliding is requested
            and not possible.
    """

    _may_be_set = ("moved_along",)

    points: ContactPoints

    def __init__(
        self,
        contact: Contact,
        facets: Indices | None = None,
        obstacle: Obstacle | None = None,
        points_class: type[ContactPoints] | None = None,
        *,
        linear: bool = True,
    ):
        self.description: Contact = contact
        self.u = u = contact.u
        self.domain = domain = u.function_space.mesh
        self.name = name = contact.name
        keep(domain)
        self.dim = domain.geometry.dim
        self.comm = domain.comm
        self.owned_nodes = int(u.function_space.dofmap.index_map.size_local)
        self.degrees = Degrees(displacement_degree(u), contact.multiplier_degree)
        self.axisymmetric = contact.axisymmetric
        self.law = contact.law
        self.obstacle: Obstacle = obstacle or getattr(contact, "obstacle")  # noqa: B009
        self.rigid_body = self.obstacle if isinstance(self.obstacle, RigidBody) else None
        self.between_bodies = self.obstacle.opposite is not None
        with everywhere(self.comm, "a contact surface"):
            self._bind()
        kind = type(self.obstacle).__name__
        same_everywhere(
            self.comm,
            name,
            obstacle=lambda: f"{kind} {described(self.given.gap, domain)}{self.obstacle.mark}",
            normal=lambda: described(self.given.normal, domain),
        )
        if facets is None:
            facets = exterior_facets(domain, contact.facets, getattr(contact, "tag", None), name)
        if self.axisymmetric:
            check_section(domain, facets, name)
        self.submesh = create_facet_submesh(domain, facets)
        keep(self.submesh.mesh)
        self.given.scatter()
        moves = follows(self.obstacle, getattr(contact, "sliding", None), linear=linear)
        if points_class is None:
            points_class = _POINTS[contact.method or ("integral" if moves else "mixed")]
        self._place_points(points_class)
        # initial overlap, and gap and normal at displaced points
        self._overlap = Overlap.of(contact)
        self.start_gaps: Array = self.points.gaps.copy()
        if not self.between_bodies:
            self._settle_overlap(self.points.data.gap, self.points.vertex_gaps)
        self.displaced = self._displaced_points() if moves else None
        turns = moves and self.rigid_body is not None and self.rigid_body.turns
        self.partner = Partner(self.rigid_body, self.node_positions, turns)
        self.true_gaps = TrueGaps(u, self.points, self.obstacle)
        self._mark = self.given.checksum()
        self._place = self._place_of_obstacle()
        self.moved_along = False

    def __repr__(self) -> str:
        where = f" on rank {self.comm.rank}" if self.comm.size > 1 else ""
        return (
            f"<{type(self).__name__} {self.name!r}: {self.points.number} contact points{where}, "
            f"{self.points.method}, law {type(self.law).__name__}, obstacle "
            f"{type(self.obstacle).__name__}>"
        )

    def _place_points(self, points_class: type[ContactPoints]) -> None:
        """Create the contact points, the law at them, and the multiplier. Collective."""
        self.points = points_class(
            self.u.function_space,
            self.submesh,
            self.degrees,
            self.description.quadrature_degree or 0,
            self.given,
            self.obstacle.opposite,
            axisymmetric=self.axisymmetric,
        )
        self.method = self.points.method
        self.slides = self.points.slides
        self.law_at_points = (
            LawAtPoints(self.law, self.dim, self.points.number, self.comm)
            if self.law.averaging is None
            else LawAmongPoints(self.law, self.points)
        )
        self.multiplier = fem.Function(self.points.Q, name=f"{self.name}_traction")

    def _displaced_points(self) -> DisplacedPoints:
        """Return the evaluator of a curved obstacle at displaced points. Collective.

        Initial overlaps beyond the rim are removed or refused.
        """
        displaced = displaced_points(
            self.points, self.domain, self.obstacle, self.law_at_points, self.name
        )
        if displaced.ended:
            # a point below a rim and within a facet past it is held like one that slid there
            past = ", also past the rim, which holds a face that slides up to a facet"
            most = self._overlap.most if self._overlap.removed else 0.0
            self._settle_overlap(*displaced.starts(most), past)
        return displaced

    def _bind(self) -> None:
        """Set `given`, the data of obstacle and law as UFL on the mesh. Not collective.

        Raises:
            ValueError: if they depend on the displacement or belong to another mesh.
        """
        self.given = Given(*self.obstacle.on(self.domain), self.law.given)
        for key, e in self.given.at_points.items():
            what = f"{self.name}: the {'law' if key.startswith(':') else 'obstacle'}"
            refuse_displacement(self.u, what, *self.given.data[key].functions)
            if key != "normal":
                refuse_other_mesh(e, self.domain, what)

    def _settle_overlap(self, gaps: Array, vertex_gaps: Array, where: str = "") -> None:
        """Remove an initial overlap, or raise ``ValueError`` if it is too large. Collective.

        Args:
            gaps: gaps at the points of this rank, shape (n,).
            vertex_gaps: gaps at the local vertices.
            where: text appended to the name of the surface in the message.
        """
        overlap = self._overlap
        if np.isfinite(overlap.most):
            # a given length is exact
            allowed = (
                0.0 if overlap.most > 0.0 else CURVED_OVERLAP * self.points.geometry.facet_size
            )
            unless = (
                "or remove_overlap for a start without stress, if the normals of the obstacle "
                "point to the body"
            )
            overlap.require(self.comm, gaps, allowed, f"{self.name}{where}", unless)
        if overlap.removed:
            self.points.remove_overlap(gaps, vertex_gaps)

    # -- data ------------------------------------------------------------------------------------

    @property
    def has_changed(self) -> bool:
        """Whether data of law and obstacle have changed on this rank since they were evaluated."""
        return self.given.checksum() != self._mark

    def update_geometry(self) -> None:
        """Evaluate the data of obstacle and law again after they have changed. Collective.

        `ContactEquations.read_data` calls it. Evaluations of gaps and normals without equations
        need a direct call.
        """
        before = self.points.vertex_gaps, self.points.vertex_normals
        self.given.scatter()
        self.points.update()
        self._mark = self.given.checksum()
        after = self.points.vertex_gaps, self.points.vertex_normals
        place = self._place_of_obstacle()
        motion = place - self._place
        if self._anchor is None:
            kept = all(np.allclose(a, b, 1e-12, 1e-12) for a, b in zip(before, after, strict=True))
            self.moved_along = kept and bool(motion.any())
        else:
            normal = self._nearest_normal()
            along = np.linalg.norm(tangential(motion, normal))
            self.moved_along = bool(along > _ALONG * np.linalg.norm(motion))
        self._place = place

    @property
    def _anchor(self) -> fem.Constant | None:
        """Constant that is the centre or a point of the obstacle; None if there is none."""
        anchor = getattr(self.obstacle, "centre", getattr(self.obstacle, "point", None))
        return anchor if isinstance(anchor, fem.Constant) else None

    def _nearest_normal(self) -> Array:
        """Return the normal at the vertex with the smallest gap, shape (dim,). Collective."""
        gaps, normals = self.points.vertex_gaps, self.points.vertex_normals
        mine: tuple[float, list[float]] = np.inf, []
        if len(gaps):
            nearest = int(np.argmin(gaps))
            mine = float(gaps[nearest]), list(normals[nearest])
        return np.array(min(self.comm.allgather(mine))[1])

    def _place_of_obstacle(self) -> Array:
        """Return the position of the obstacle if it is a Constant (`_anchor`), or its Constants."""
        if self._anchor is not None:
            return np.array(self._anchor.value)
        data = self.given.data
        constants = [*data["gap"].constants, *data["normal"].constants]
        return np.array([v for c in constants for v in np.ravel(c.value)])

    def check_gaps(self) -> None:
        """Raise ``ValueError`` if a current normal does not have unit length. Collective."""
        lengths = np.linalg.norm(self.points.vertex_normals, axis=1)
        off = lengths[np.abs(lengths - 1.0) > _UNIT]  # NaN is an error of a solve
        worst = float(off[np.argmax(np.abs(off - 1.0))]) if len(off) else 1.0
        require(
            self.comm,
            not len(off),
            f"{self.name}: normals of the obstacle must have the length 1, and one has {worst:.6g}",
        )

    def fixed_jumps(self, fixed: Mask) -> Mask:
        """Return the mask of the fixed components of the jump, shape (local nodes, dim).

        A component is fixed if neither a node nor its opposing point can move along it. Collective.

        Args:
            fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).
        """
        if self.rigid_body is None:
            return fixed
        return np.asarray(fixed & ~self.rigid_body.moves(self.node_positions))

    def hold(self, fixed: Mask, crossing: Mask) -> None:
        """Determine the nodes where the multiplier, or a component of it, is removed. Collective.

        Args:
            fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).
            crossing: mask of the local vertices at which pairs cross.
        """
        self._mirror(self.fixed_jumps(fixed), None)

    def _mirror(self, fixed: Mask, opposite: Opposite | None) -> None:
        """Remove multipliers across planes of symmetry (`shared_functions`). Collective.

        Args:
            fixed: mask of the components in which neither a node nor the master at its position,
                if there is one, can move, shape (local nodes, dim).
            opposite: points opposite to the positions of the nodes; None without another body.
        """
        turning = self.displaced is not None and not self.displaced.friction
        if self.degrees.multiplier > 1 or turning:
            return
        points = self.points
        held = fixed[points.vertex_nodes] & edge_of(points.vertices)[:, None]
        along = np.linalg.norm(np.where(held, points.vertex_normals, 0.0), axis=1)
        points.mirror(held & (along < _TANGENTIAL)[:, None], opposite)

    def require_in_place(self, prescribed: Array, size: float) -> None:
        """Raise ``ValueError`` if Dirichlet data move nodes off planes of symmetry. Collective.

        Args:
            prescribed: Dirichlet values at the local nodes, 0 at free dofs, shape (nodes, dim).
            size: extent of the body, a length.
        """

    # -- gap, slip and B -------------------------------------------------------------------------

    def kinematics(
        self, u: Array, motion: Array | None = None, memory: Memory | None = None
    ) -> Kinematics:
        """Return gaps, jumps and operator at the contact points of this rank. Collective.

        Args:
            u: displacement of the owned nodes, shape (n, dim); further rows are ignored.
            motion: motion of the rigid body; None if the obstacle is not a rigid body.
            memory: memory of the points at the beginning of the step; None under the static law.
        """
        operator = self.points.operator
        seen = operator.apply(self.partner.relative(u[: self.owned_nodes], motion))
        if self.displaced is not None:
            turning = motion if self.partner.turns else None
            frame = self.partner.rotation(motion)
            found = self.displaced.kinematics(operator, seen, turning, frame, memory)
            data = with_memory(self.law_at_points.compiled, memory, found.data)
            return replace(found, data=data)
        n = self.points.data.n
        reference = np.zeros_like(n) if memory is None else memory.reference(n)
        jump = seen - self.points.aside - reference
        return Kinematics(operator, jump, reference, self.point_data(memory), memory=memory)

    def constant_operator(self, needed_by: str) -> ConstantOperator:
        """Return the operator from displacements to jumps if it is constant.

        Args:
            needed_by: description of the caller for the message.

        Raises:
            ValueError: on every rank, if the operator changes with the displacement.
        """
        operator = self.points.operator
        if not isinstance(operator, ConstantOperator):
            raise ValueError(
                f"{self.name}: {needed_by} needs contact points that keep their opposing points; "
                "here these change with the displacement"
            )
        return operator

    @property
    def is_weak(self) -> bool:
        """Whether the law holds weakly, at Gauss points, instead of at each node."""
        return self.method == "integral"

    @property
    def linear(self) -> bool:
        """Whether gap and slip are linear functions of the displacement."""
        return self.displaced is None and isinstance(self.points.operator, ConstantOperator)

    # -- nodes and points ------------------------------------------------------------------------

    def opposite(self, values: Array) -> Array:
        """Return nodal values at points opposite to the local nodes, 0 without one. Collective.

        Args:
            values: values at the nodes of the displacement, shape (n, ...), of which the owned ones
                are used.
        """
        opposite = self.obstacle.opposite
        if opposite is None:
            return np.zeros_like(values)
        return opposite.values(self.comm, values[: self.owned_nodes])

    @cached_property
    def node_positions(self) -> Array:
        """Positions of the local nodes of the displacement, shape (n, dim)."""
        return node_positions(self.u.function_space)

    @cached_property
    def parts(self) -> tuple[Ints, int]:
        """Index of the connected part of the face to which each point belongs; number of parts.

        The indices have shape (n,). The first call is collective.
        """
        at_vertices = parts(self.points.vertices)
        number = self.comm.allreduce(int(at_vertices.max(initial=-1)), op=MPI.MAX) + 1
        at_points = self.points.from_vertices(at_vertices.astype(np.float64))
        return np.rint(at_points).astype(np.int64), number

    def gaps_at(self, x: Array) -> Array | None:
        """Return gaps at arbitrary positions in the frame of the obstacle. Collective.

        None if the obstacle can be evaluated only at the contact points.

        Args:
            x: positions, shape (n, dim).
        """
        shape = shape_of(self.obstacle)
        if isinstance(shape, RigidSurface):
            return shape.distances(x).distance - shape.rounding
        if shape.flat:
            normal, height = self._plane
            return height - x @ normal
        if self._gap_anywhere is None:
            return None
        self._gap_anywhere.x = x
        return self._gap_anywhere()["gap"]

    @property
    def _plane(self) -> tuple[Array, float]:
        """Unit normal n of a flat obstacle, and the value of n.x on its plane. Collective."""
        points = self.points
        n = points.vertex_normals[:1]
        removed = points.removed_at_vertices
        gap = points.vertex_gaps[:1] - (0.0 if removed is None else removed.x.array[:1])
        height = gap + dot(n, self.node_positions[points.vertex_nodes[:1]])
        first = np.concatenate(self.comm.allgather(np.column_stack([n, height])))[0]
        return first[:-1], float(first[-1])

    @cached_property
    def _gap_anywhere(self) -> ScatteredEvaluator | None:
        shape, domain = shape_of(self.obstacle), self.domain
        if not known_displaced(shape) or isinstance(shape, HalfSpace):  # of each point
            return None
        gap = expand_derivatives(shape.at(domain, ufl.SpatialCoordinate(domain))[0])
        if extract_coefficients(gap):
            return None
        none = np.zeros(0)
        return ScatteredEvaluator(
            domain, none.astype(np.int32), np.zeros((0, self.dim)), none, {"gap": gap}
        )

    def displacements(self, u: Array) -> Array:
        """Return displacements of the contact points of this rank, shape (n, dim). Collective.

        Args:
            u: displacement of the local nodes, equal to the values of the displacement Function,
                shape (nodes, dim).
        """
        if not self.is_weak:
            return u[self.points.vertex_nodes[: self.points.number]]
        return self.points.own(self._displacement_at_points)["u"]

    @cached_property
    def _displacement_at_points(self) -> Evaluator:
        return self.points.evaluator({"u": self.u})

    @property
    def positions(self) -> Array:
        """Positions of the contact points of this rank, shape (n, dim)."""
        return self.points.positions

    @cached_property
    def in_order(self) -> Gathered:
        """Contact points of all ranks in the order of the table. The first use is collective.

        Points with equal coordinates, such as on both sides of a crack, are sorted by the input
        numbers of their nodes.
        """
        return Gathered(self.comm, self.positions, self.points.ids)

    # -- states ----------------------------------------------------------------------------------

    def point_data(self, memory: Memory | None = None) -> PointData:
        """Return data of the law at the contact points, with gaps of the undeformed body.

        Args:
            memory: memory of the points at the beginning of the step; None under the static law.
        """
        return with_memory(self.law_at_points.compiled, memory, self.points.data)

    def at_vertices(self, jump: Array) -> GapsAndNormals:
        """Return gaps and normals at the local vertices for given jumps. Collective.

        Args:
            jump: displacements of the local vertices relative to the obstacle, shape (n, dim).
        """
        if self.displaced is not None:
            body = self.rigid_body
            frame = self.partner.rotation(None if body is None else body.values)
            gap, normal = self.displaced.at_vertices(jump)
            return GapsAndNormals(gap, normal if frame is None else normal @ frame.T)
        normal = self.points.vertex_normals
        return GapsAndNormals(self.points.vertex_gaps - dot(jump, normal), normal)


_POINTS: dict[ContactMethod, type[ContactPoints]] = {
    "nodal": NodePoints,
    "integral": FacetPoints,
    "mixed": AveragedPoints,
}
