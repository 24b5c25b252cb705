# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discrete contact surfaces: contact points, kinematics and evaluation of the law."""

from __future__ import annotations

import zlib
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact._compat import create_facet_submesh
from dolfinx_contact._geometry import area_vectors, node_positions
from dolfinx_contact._mpi import everywhere, keep, require, same_everywhere
from dolfinx_contact._ufl import described, refuse_displacement, refuse_other_mesh
from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.body.rigid import parts
from dolfinx_contact.laws import Answers, Law, LawAtPoints, PointData
from dolfinx_contact.laws.status import closed
from dolfinx_contact.obstacles import Obstacle, fields_within, require_uniform
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator, Given
from dolfinx_contact.points.descriptions import (
    Contact,
    ContactMethod,
    ContactSurface,
    Overlap,
    SlidingKind,
    displacement_degree,
)
from dolfinx_contact.points.displaced import (
    DisplacedPoints,
    TrueGaps,
    displaced_points,
)
from dolfinx_contact.points.integral_points import CommonFacetPoints, FacetPoints
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, with_memory
from dolfinx_contact.points.neighbours import LawAmongPoints
from dolfinx_contact.points.node_points import AveragedPoints, NodePoints
from dolfinx_contact.points.operators import ConstantOperator
from dolfinx_contact.points.opposite import CURVED_OVERLAP, Opposite
from dolfinx_contact.points.revolution import check_section
from dolfinx_contact.points.rigid_body import RigidBody, number
from dolfinx_contact.points.trace import exterior_facets, rounded, tagged_facets

__all__ = ["DiscreteSurface"]

Array = npt.NDArray[np.float64]


_NO_OVERLAP = 1e-9  # of a facet, an overlap that is none; and a cosine of normals that is none
_UNIT = 1e-6  # by which the length of a normal may be off


class DiscreteSurface:
    """The contact points of a surface and everything that is evaluated at them. Collective.

    A `ContactProblem` makes one for each description and owns it.

    Args:
        contact: description of the surface.

    Attributes:
        description: description from which the surface was made (`surfaces`).
        multiplier: traction on the body, a vector Function of the facet submesh.
        points: contact points of this rank and the operators that lead to them.
        law_at_points: compiled law.

    Raises:
        ValueError: on every rank, if facets, obstacle or law do not fit the mesh, obstacles differ
            between ranks, or points start too far inside the obstacle.
    """

    def __init__(self, contact: ContactSurface):
        u = contact.u
        domain = u.function_space.mesh
        name = contact.name
        keep(domain)
        self.description: Contact = contact
        self.u = u
        self.domain = domain
        self.name = name
        self.dim = domain.geometry.dim
        self.comm = domain.comm
        assert contact.quadrature_degree is not None
        #: Number of nodes of the displacement that this rank owns.
        self.owned_nodes = int(u.function_space.dofmap.index_map.size_local)
        self.degrees = (displacement_degree(u), contact.multiplier_degree)
        self.axisymmetric = contact.axisymmetric
        self._law: Law = contact.law
        self._obstacle: Obstacle = contact.obstacle
        assert contact.method is not None
        self._method: ContactMethod = contact.method
        self._sliding: SlidingKind | None = contact.sliding
        #: Obstacle that is a rigid body which moves; None otherwise.
        self.rigid_body = contact.obstacle if isinstance(contact.obstacle, RigidBody) else None
        #: Whether the obstacle is a face of a deformable body.
        self.between_bodies = contact.obstacle.opposite is not None
        with everywhere(self.comm, "a contact surface"):
            self._bind()
        same_everywhere(
            self.comm,
            name,
            obstacle=lambda: (
                f"{type(self.obstacle).__name__} {described(self.gap, domain)}{self.obstacle.mark}"
            ),
            normal=lambda: described(self.normal, domain),
        )
        tagged = tagged_facets(self.comm, contact.facets, contact.tag, name)
        local = exterior_facets(domain, *tagged, name)
        if self.axisymmetric:
            check_section(domain, local, name)
        self._create_points(local, contact.quadrature_degree)
        self._overlap = Overlap.of(name, contact.interference, contact.remove_overlap)
        self._settle_overlap(self.points.data.gap, self.points.vertex_gaps, self.points.data.n)
        #: Gap and normal at displaced points; None in small sliding.
        self.displaced: DisplacedPoints | None = None
        self._slid = False
        #: Distances to the obstacle of the contact points in their present positions.
        self.true_gaps = TrueGaps(u, self.points, self.obstacle)
        #: Arrays of the Functions and Constants in law and obstacle.
        self._values = [f.x.array for f in self._functions]
        self._values += [c.value for c in self.given.constants]
        self._mark = self._marked()

    def _bind(self) -> None:
        """Evaluate obstacle and law as UFL on the mesh. Not collective.

        Raises:
            ValueError: if they depend on the displacement or belong to another mesh.
        """
        self.gap, self.normal = self.obstacle.on(self.domain)
        fields = self.law.given.values()
        self.given = Given(self.gap, self.normal, self.law.given)
        of_obstacle = [f for part in ("gap", "normal") for f in self.given.data[part][0]]
        refuse_displacement(self.u, f"{self.name}: the obstacle", *of_obstacle)
        refuse_displacement(self.u, f"{self.name}: the law", *self.given.functions)
        for what, e in [("obstacle", self.gap), *(("law", e) for e in fields)]:
            refuse_other_mesh(e, self.domain, f"{self.name}: the {what}")
        self._uniform = fields_within(self.obstacle, self.domain, f"{self.name}: the obstacle")
        #: Functions of the user in law and obstacle.
        functions = {f for f in self.given.functions if isinstance(f, fem.Function)}
        self._functions = sorted(functions, key=lambda f: f.count())

    def _create_points(self, facets: npt.NDArray[np.int32], rule_degree: int) -> None:
        """Find the contact points on exterior facets of this rank. Collective."""
        self.submesh = create_facet_submesh(self.domain, facets)
        keep(self.submesh.mesh)
        self._scatter()
        points_class = _points_class(self.method, self.obstacle.opposite)
        self.points: ContactPoints = points_class(
            self.u.function_space,
            self.submesh,
            self.degrees,
            rule_degree,
            self.given,
            self.obstacle.opposite,
            axisymmetric=self.axisymmetric,
        )
        #: Whether the face slides over a face of a deformable body by any distance.
        self.slides = self.points.slides
        number = self.points.number
        self.law_at_points = (
            LawAtPoints(self.law, self.dim, number, self.comm)
            if self.law.averaging is None
            else LawAmongPoints(self.law, self.points, self.name)
        )
        self.multiplier = fem.Function(self.points.Q, name=f"{self.name}_traction")

    # What users would assign in vain is read-only.

    @property
    def law(self) -> Law:
        """Law of the description."""
        return self._law

    @property
    def obstacle(self) -> Obstacle:
        """Obstacle of the description."""
        return self._obstacle

    @property
    def method(self) -> ContactMethod:
        """Discretisation of contact."""
        return self._method

    @property
    def sliding(self) -> SlidingKind | None:
        """Kind of sliding."""
        return self._sliding

    def _settle_overlap(
        self, gaps: Array, vertex_gaps: Array, normals: Array, where: str = ""
    ) -> None:
        """Refuse a start too far within the obstacle, or take the overlap away. Collective.

        Args:
            gaps: at the points of this rank (n,).
            vertex_gaps: at the local vertices.
            normals: from the body into the obstacle, at the points (n, dim).
            where: part of the message, where that is.

        Raises:
            ValueError: if points begin too far within the obstacle, or where its normals have
                turned round and an overlap is to be removed.
        """
        overlap = self._overlap
        if np.isfinite(overlap.most):
            worst = self.comm.allreduce(float(np.min(gaps, initial=0.0)), op=min)
            # A length that is given is meant as it is.
            allowed = 0.0 if overlap.most > 0.0 else CURVED_OVERLAP * self.points.mean_width
            unless = (
                "or remove_overlap for a start without stress, if the normals of the obstacle "
                "point to the body"
            )
            overlap.require(self.comm, worst, allowed, f"{self.name}{where}", unless)
        if overlap.removed:
            self._require_this_side(gaps, normals, where)
            self.points.remove_overlap(gaps, vertex_gaps)

    def _require_this_side(self, gaps: Array, normals: Array, where: str) -> None:
        """Refuse what begins beyond the middle of the obstacle, which would pull it. Collective.

        Args:
            gaps: at the points of this rank (n,).
            normals: from the body into the obstacle, at the points (n, dim).
            where: part of the message, where that is.
        """
        out = self.points.evaluator({"out": ufl.FacetNormal(self.domain)})()["out"]
        cosine = np.sum(out[: self.points.number] * normals, axis=1)
        deep = gaps < -_NO_OVERLAP * self.points.mean_width
        turned = np.where(deep, cosine, 1.0)
        i = int(np.argmin(turned)) if len(turned) else 0
        mine = (turned[i], self.positions[i].tolist()) if len(turned) else (1.0, [])
        least, place = min(self.comm.allgather(mine))
        require(
            self.comm,
            bool(least > _NO_OVERLAP),
            f"{self.name}{where}: a contact point at ({', '.join(f'{c:.4g}' for c in place)}) "
            "begins so deep within the obstacle that its nearest side is behind the body, or "
            "beside it: an overlap is removed where the normals of both face each other; begin "
            "nearer to the surface, or leave these facets out",
        )

    def _scatter(self) -> None:
        for f in self._functions:
            f.x.scatter_forward()

    def _marked(self) -> int:
        """A checksum of what is given on the surface, on this rank."""
        mark = 0
        for values in self._values:
            mark = zlib.crc32(np.ascontiguousarray(values), mark)
        return mark

    @property
    def has_changed(self) -> bool:
        """Whether on this rank what is given is not what it was when it was evaluated."""
        return self._marked() != self._mark

    def update_geometry(self) -> None:
        """Evaluate what is given on the surface anew, after an obstacle has moved. Collective.

        The equations do it by themselves, so that only what is evaluated without them (gaps,
        normals) needs it. The ghosts of Functions in law and obstacle follow their owners.
        """
        self._scatter()
        self.points.update()
        self._mark = self._marked()

    def check_gaps(self) -> None:
        """Raise ``ValueError`` if gaps that were given are none as they are now. Collective."""
        require_uniform(self.comm, self._uniform, f"{self.name}: the obstacle")
        radius = _least(self.obstacle.radius_given)
        require(
            self.comm,
            not radius <= 0.0,  # what is no number is refused as a gap that is none
            f"{self.name}: the radius of the obstacle must be positive, and is {radius:.6g} now",
        )
        if self.between_bodies:
            return
        lengths = np.linalg.norm(self.points.vertex_normals, axis=1)
        off = lengths[np.abs(lengths - 1.0) > _UNIT]  # not what is no number: a solve refuses it
        worst = float(off[np.argmax(np.abs(off - 1.0))]) if len(off) else 1.0
        require(
            self.comm,
            not len(off),
            f"{self.name}: normals of the obstacle must have the length 1, and one has {worst:.6g}",
        )

    def hold(self, fixed: npt.NDArray[np.bool_], crossing: npt.NDArray[np.bool_]) -> None:
        """Store which nodes have no multiplier of their own. Collective.

        Args:
            fixed: local nodes x dim, by Dirichlet data.
            crossing: local vertices at which pairs cross.
        """

    # -- gap, slip and B -------------------------------------------------------------------------

    def kinematics(
        self, u: Array, motion: Array | None = None, memory: Memory | None = None
    ) -> Kinematics:
        """Gap, slip and B at the contact points of this rank at a state. Collective.

        Args:
            u: displacement at the first local nodes, at least the owned ones (n, dim).
            motion: of the rigid body; None where there is none.
            memory: memory of the points at the beginning of the step; None under the static law.
        """
        if self.slides:
            from dolfinx_contact.points.sliding.points import kinematics

            return kinematics(self.points, self.law_at_points.compiled, memory, u)
        operator = self.points.operator
        seen = operator.apply(self.relative(u[: self.owned_nodes], motion))
        if self.displaced is not None:
            frame = self._frame(motion)
            data, jump, reference = self.displaced.at(seen, memory, frame)
            data = with_memory(self.law_at_points.compiled, memory, data)
            turning = None if frame is None else motion
            return Kinematics(operator, jump, reference, data, seen, frame, turning, memory)
        n = self.points.data.n
        reference = np.zeros_like(n) if memory is None else memory.reference(n)
        jump = seen - self.points.aside - reference
        return Kinematics(operator, jump, reference, self.point_data(memory), memory=memory)

    def constant_operator(self, needed_by: str) -> ConstantOperator:
        """B, for what needs it to be the same at every state.

        Args:
            needed_by: what needs it, for the message.

        Raises:
            ValueError: on every rank, if B changes with the displacement.
        """
        operator = self.points.operator
        if not isinstance(operator, ConstantOperator):
            raise ValueError(
                f"{self.name}: {needed_by} needs contact points that keep what is opposite to "
                "them; here that changes with the displacement"
            )
        return operator

    @property
    def linear(self) -> bool:
        """Whether gap and slip are linear in the displacement."""
        return self.displaced is None and isinstance(self.points.operator, ConstantOperator)

    def slide(self, *, linear: bool) -> None:
        """Choose small or large sliding for a linear or nonlinear body. Collective, once.

        Raises:
            ValueError: on every rank, if sliding must be large and cannot be, or if points start
                inside the part of an open obstacle past its rim.
        """
        if self._slid:
            return
        self._slid = True
        given = self.points, self.domain, self.obstacle, self.law_at_points, self.sliding
        self.displaced = displaced_points(*given, linear=linear, name=self.name)
        if self.displaced is not None and self.displaced.ended:
            # A point below a rim, and within a facet past it, is held like one that slid there.
            past = ", also past the rim, which holds a face that slides up to a facet"
            most = self._overlap.most if self._overlap.removed else 0.0
            self._settle_overlap(*self.displaced.starts(most), past)

    # -- nodes and points ------------------------------------------------------------------------

    @property
    def opposite_nodes(self) -> Opposite | None:
        """The points opposite to the nodes; None without another body.

        Of faces that slide over each other those of the reference configuration.
        """
        if self.between_bodies and not self.slides:
            self.constant_operator("the map to opposite nodes")
        opposite: Opposite | None = self.obstacle.opposite
        return opposite

    def opposite(self, values: Array) -> Array:
        """Values opposite to the local nodes, 0 where there is nothing. Collective.

        Args:
            values: at the nodes of the displacement (n, ...), of which the owned ones count.
        """
        opposite = self.opposite_nodes
        if opposite is None:
            return np.zeros_like(values)
        return opposite.values(self.comm, values[: self.owned_nodes], len(values))

    def relative(self, u: Array, motion: Array | None) -> Array:
        """Displacements seen from the rigid body; as they are where there is none.

        Args:
            u: at the first local nodes of the displacement (n, dim).
            motion: of the rigid body.
        """
        body = self.rigid_body
        if body is None:
            return u
        assert motion is not None
        x = self.node_positions[: len(u)]
        if self.turns:
            return np.asarray(body.seen(x + u, motion) - x)
        return np.asarray(u - body.field(x, motion))

    def relative_rate(self, u: Array, motion: Array, du: Array, change: Array) -> Array:
        """The derivative of `relative` along a displacement and a motion, turned as the body is.

        Args:
            u: at the first local nodes of the displacement (n, dim).
            motion: of the rigid body.
            du: displacement there (n, dim).
            change: of the motion.
        """
        body = self.rigid_body
        if body is None or not self.turns:
            return self.relative(du, change)
        x = self.node_positions[: len(u)] + u
        return np.asarray(du - body.rate(x, motion, change))

    @property
    def turns(self) -> bool:
        """Whether it follows a rigid body that turns by any angle."""
        body = self.rigid_body
        return self.displaced is not None and body is not None and body.turns

    def _frame(self, motion: Array | None) -> Array | None:
        """The rotation of what is touched (dim, dim); None where it does not turn."""
        body = self.rigid_body
        if not self.turns or body is None or motion is None:
            return None
        return body.frame(motion)

    def dragged(self, x: Array) -> Array:
        """Displacements of the rigid body as it is now at its points x (n, dim); 0 without one."""
        body = self.rigid_body
        if body is None:
            return np.zeros_like(x)
        return body.carried(x, body.values) if self.turns else body.field(x, body.values)

    @cached_property
    def node_positions(self) -> Array:
        """Positions of the local nodes of the displacement (n, dim)."""
        return node_positions(self.u.function_space)[:, : self.dim].copy()

    @cached_property
    def facet_sides(self) -> tuple[npt.NDArray[np.int32], Array, Array]:
        """Of the local facets the vertices, and on which side the body is not.

        Returns:
            Local vertices (facets, k); places of all of these without the round-off in them, so
            that the first of several is the same everywhere (n, dim); signs by which
            `area_vectors` point out of the body (facets,).
        """
        facets = self.submesh.parent_facets
        corners = self.points.vertices.dofmap.list[: len(facets)]
        x = rounded(node_positions(self.points.vertices)[:, : self.dim])
        to_cells = self.domain.topology.connectivity(self.dim - 1, self.dim)
        inside = midpoints(self.domain, to_cells.array[to_cells.offsets[facets]])
        N = area_vectors(x[corners])
        return corners, x, np.sign(np.sum(N * (x[corners[:, 0]] - inside), axis=1))

    @cached_property
    def parts(self) -> tuple[npt.NDArray[np.int64], int]:
        """The connected part of the face that each point is on (n,), and how many there are.

        Collective the first time.
        """
        at_vertices = parts(self.points.vertices)
        number = self.comm.allreduce(int(at_vertices.max(initial=-1)), op=MPI.MAX) + 1
        at_points = self.points.from_vertices(at_vertices.astype(np.float64))
        return np.rint(at_points).astype(np.int64), number

    def displacements(self, u: Array) -> Array:
        """Displacements (n, dim) of the contact points of this rank. Collective.

        Args:
            u: displacement of the local nodes (nodes, dim), the same as in the Function.
        """
        if self.method != "integral":
            return u[self.points.vertex_trace_dofs[: self.points.number]]
        return self._displacement_at_points()["u"][: self.points.number]

    @cached_property
    def _displacement_at_points(self) -> Evaluator:
        return self.points.evaluator({"u": self.u})

    @property
    def positions(self) -> Array:
        """Positions of the contact points of this rank (n, dim)."""
        return self.points.positions

    # -- what was found --------------------------------------------------------------------------

    def point_data(self, memory: Memory | None = None) -> PointData:
        """Data of the law at the points of this rank in the reference configuration.

        Args:
            memory: memory of the points at the beginning of the step; None under the static law.
        """
        return with_memory(self.law_at_points.compiled, memory, self.points.data)

    def state_of(
        self, at: Kinematics, traction: Array, answers: Answers | None = None
    ) -> dict[str, Array]:
        """Values at the contact points of this rank. Collective.

        Args:
            at: kinematics of the points.
            traction: traction on the body (n, dim), a stress.
            answers: answers of the law to these, computed by default.

        Returns:
            ``x`` position (n, dim), ``area``, ``un`` gap, ``ut`` tangential displacement (n, dim),
            ``increment`` of the displacement since the last accepted step (n, dim), ``n`` normal
            (n, dim), ``traction`` on the body (n, dim), ``pressure``, ``shear`` (n, dim), and
            ``bound``, the radius of the friction disc at the pressure of the law.
        """
        if answers is None:
            answers = self.law_at_points(at.jump, traction, at.data)
        points = self.points
        n = at.data.n
        pressure = -np.sum(traction * n, axis=1)
        return {
            "x": points.positions,
            "area": at.operator.areas,
            "un": at.gap,
            "ut": at.slip,
            "increment": at.increment,
            "n": n,
            "traction": traction,
            "pressure": pressure,
            "shear": traction + pressure[:, None] * n,
            "bound": self._bound(answers),
        }

    def _bound(self, answers: Answers) -> Array:
        """Radius of the friction disc (n,); 0 where nothing grips."""
        acts = closed(answers.required) | (not self.law.needs_pressure)
        return np.where(acts, np.maximum(answers.bound, 0.0), 0.0)

    def at_vertices(self, jump: Array) -> tuple[Array, Array]:
        """Gaps (n,) and normals (n, dim) at the local vertices where jumps lead them. Collective.

        Args:
            jump: at the local vertices (n, dim).
        """
        if self.displaced is not None:
            body = self.rigid_body
            frame = self._frame(None if body is None else body.values)
            gap, normal = self.displaced.at_vertices(jump)
            return gap, normal if frame is None else normal @ frame.T
        normal = self.points.vertex_normals
        return self.points.vertex_gaps - np.sum(jump * normal, axis=1), normal


def _least(radius: Any) -> float:
    """The least value that a radius has now; infinite of none, and of UFL in which Functions are.

    Not collective.
    """
    if isinstance(radius, fem.Function):
        return float(np.min(radius.x.array, initial=np.inf))
    known = isinstance(radius, ufl.core.expr.Expr) and not ufl.algorithms.extract_coefficients(
        radius
    )
    return number(ufl.algorithms.expand_derivatives(radius)) if known else np.inf


def _points_class(method: ContactMethod, opposite: Opposite | None) -> type[ContactPoints]:
    """What contact points of a method are."""
    if opposite is not None and opposite.points is not None:
        return opposite.points
    if method == "nodal":
        return NodePoints
    if method == "mixed":
        return AveragedPoints
    matches = opposite is None or opposite.matching
    return FacetPoints if matches else CommonFacetPoints
