# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curved obstacles in large displacement: gap, normal and slip at the displaced contact points.

A contact point X with the displacement d relative to the obstacle is at x = X + d. There the
obstacle has the gap g(x) and the normal n(x) (Wriggers, Computational Contact Mechanics, 2006,
section 4.1). With the slip s since the last accepted state, the law receives a zero gap and the
jump

    j = -g n + s.

Let x_o be x at the last accepted state, or X without memory. The slip follows the surface of the
obstacle from the point y_o opposite to x_o to the point y opposite to x,

    y = x + g(x) n(x),    y_o = x_o + g(x_o) n(x_o).

It rotates with the normal, but not about it: where a face spins about the normal, the slip is the
chord of the step, and the angle is the indicator `spin`. Points that remain at the same material
point of the obstacle do not slip. For a law without friction, the slip is (I - n n^T) d.

Let theta be the angle between the normals o at y_o and n at y. An arc of constant curvature from
y_o to y is longer than its chord c by the factor (theta/2) / sin(theta/2). Its tangents make the
angle theta/2 with c, in the plane of both normals; components of c perpendicular to this plane are
not rotated. The slip along the surface, rotated into the tangent plane at y by the smallest
rotation from o to n, is therefore

    s = P c - (A c.(n - o) + D c.(n + o)) P o,    c = y - y_o,    P = I - n n^T,
    A = (a - C)/(4 C q),    D = 1/(4 C^2),    q = sin^2(theta/2),    C = cos(theta/2),
    a = theta/2 / sin(theta/2).

On planes, circles, spheres and circular cylinders this is the exact arc, up to half a turn;
elsewhere, a variable curvature causes an error of higher order. The slip is zero if y = y_o.

On a rigid body, positions refer to its frame: with its displacement d_0 and its rotation Q about
X_0, of any angle,

    x = X_0 + Q^T (X + u - X_0 - d_0),

with the displacement u of the contact point, so that points sticking to a rotating body do not
slip; jumps and normals are rotated by Q for the law. If an obstacle is moved by its Constants, y
and y_o are computed for its current position, and its tangential motion causes no slip.

Derivatives of gap, normal and slip with respect to x are exact.

If an overlap o of the reference configuration is removed, j contains g(x) + o. The points y on the
surface do not depend on o.

`TrueGaps` returns the distances of the displaced points to the obstacle, independent of the law.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import dot, node_positions, transformed
from dolfinx_contact._mpi import maximum, require
from dolfinx_contact.laws import LawAtPoints, PointData
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.laws.symbols import before
from dolfinx_contact.obstacles import Obstacle, known_displaced
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.descriptions import SlidingKind
from dolfinx_contact.points.evaluators import (
    Evaluator,
    GapsAndNormals,
    Given,
    blocked_space,
    fields_of,
)
from dolfinx_contact.points.jump_operators import Operator
from dolfinx_contact.points.kinematics import Kinematics, rotation
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.rigid_body import RigidBody, shape_of

__all__ = ["DisplacedPoints", "TrueGaps", "displaced_points", "follows"]

_FACING = 0.5  # smallest cosine between the normals of a face and of the obstacle that it faces
_SAME = 1e-9  # relative excess of a removed overlap that counts as round-off
_ROUND_OFF = 1e-14  # gap that is round-off, relative to the largest coordinate
_SMALL = 3e-3  # q below which the series is exact to round-off
# coefficients of (a - C)/q in powers of q
_SERIES = (2 / 3, 1 / 5, 3 / 28, 5 / 72, 35 / 704)


def follows(obstacle: Obstacle, sliding: SlidingKind | None, *, linear: bool) -> bool:
    """Return whether gap and normal of an obstacle are evaluated at displaced points.

    They are evaluated at reference points for planes, whose gap is exact there, and faces of pairs,
    and by default for linear bodies, rigid bodies that may rotate (rotations are then small), and
    obstacles defined only in the reference configuration.

    Args:
        obstacle: obstacle of the surface.
        sliding: kind of sliding requested by the user; None for the default.
        linear: whether the body is linear.
    """
    if obstacle.flat or obstacle.opposite is not None:
        return False
    if sliding is not None:
        return sliding == "large"
    turns = isinstance(obstacle, RigidBody) and obstacle.turns
    return not (linear or turns) and known_displaced(shape_of(obstacle))


def displaced_points(
    points: ContactPoints,
    domain: mesh.Mesh,
    obstacle: Obstacle,
    law: LawAtPoints,
    name: str,
) -> DisplacedPoints:
    """Return the evaluator of gap, normal and slip at displaced contact points. Collective.

    Args:
        points: contact points.
        domain: mesh of the body.
        obstacle: curved rigid obstacle.
        law: law at the points.
        name: name of the surface for messages.

    Raises:
        ValueError: on every rank, if large sliding is not possible.
    """
    free = isinstance(obstacle, RigidBody) and obstacle.turns_freely
    turns = isinstance(obstacle, RigidBody) and obstacle.turns
    friction = STICK in law.codes
    bonded = law.compiled.bonded
    whole = bool(set(law.compiled.names) & set(before(law.dim)))
    given = f"there is no friction with the law {law.law.name}, which"
    conditions = (
        (
            known_displaced(shape_of(obstacle)),
            "the obstacle is known only in the reference configuration: it needs a method at",
        ),
        (not free, "a rigid body that turns freely turns little; hold or prescribe its rotation"),
        (points.method != "mixed", "gaps of mixed contact are averages; use another method"),
        (law.law.averaging is None, f"{given} averages the pressure around points"),
        (not (friction and bonded), f"{given} has bonds"),
        (
            not (turns and bonded),
            f"a rigid body does not turn with the law {law.law.name}, which has bonds",
        ),
        (not (friction and whole), f"{given} depends on the whole tangential jump"),
    )
    why = next((reason for good, reason in conditions if not good), "")
    message = f"{name}: in large sliding on a curved obstacle {why}, or sliding='small'"
    require(points.comm, not why, message)
    return DisplacedPoints(points, domain, obstacle, friction=friction)


class DisplacedPoints:
    """Gap, normal and slip at displaced contact points. All methods are collective.

    Displacements, gaps and normals are in the frame of the obstacle.

    Args:
        points: nodes or Gauss points.
        domain: mesh of the body.
        obstacle: obstacle that can be evaluated at displaced points (`obstacles.Obstacle.at`).
        friction: whether slips are measured from the last accepted state.

    Attributes:
        friction: whether slips are measured from the last accepted state.
        ended: whether the obstacle ends at a rim, beyond which a face loses contact gradually.
        given: gap and normal at the displaced points in UFL, and the fields of the law in the
            reference configuration.
        seen: jump passed to the law, in UFL.
    """

    def __init__(
        self, points: ContactPoints, domain: mesh.Mesh, obstacle: Obstacle, *, friction: bool
    ):
        self._points = points
        self._domain = domain
        self._whole = shape_of(obstacle)
        shape = self._shape(points.removed_overlap)
        self.ended = shape is not self._whole
        self.friction = friction
        space = blocked_space(points.space, points.dim)
        self._moved = fem.Function(space)
        self._moved_before = fem.Function(space)
        start = ufl.SpatialCoordinate(domain)
        x = ufl.variable(start + self._moved)
        gap, normal = shape.at(domain, x)
        left = gap + _removed(points.removed_overlap)
        self.given = Given(left, normal, points.given.fields)
        expressions = {"gap": left, "normal": normal}
        if friction:
            there = start + self._moved_before
            gap_before, normal_before = shape.at(domain, there)
            way = x + gap * normal - there - gap_before * normal_before
            slip = _slip_along(way, normal_before, normal)
            expressions["normal_before"] = normal_before
        else:
            slip = x - start - ufl.dot(x - start, normal) * normal
        self.seen = slip - left * normal
        expressions |= {"seen": self.seen, "turn": ufl.diff(normal, x)}
        expressions["moved"] = ufl.diff(self.seen, x)
        self._evaluate = points.evaluator(expressions)
        self._at_vertices: tuple[fem.Function, Evaluator] | None = None
        self._no_gap = _ROUND_OFF * maximum(points.comm, np.abs(points.positions))

    def _shape(self, removed: fem.Function | None) -> Obstacle:
        """Return the obstacle; its continuation beyond a rim depends on the removed overlap."""
        return self._whole.ended(lambda: (self._points.geometry.facet_widths, _removed(removed)))

    def starts(self, most: float) -> tuple[Array, Array]:
        """Return gaps of the undeformed body on an obstacle that ends at a rim. Collective.

        If overlaps are removed, a point beyond the rim and at most ``most`` below it has a negative
        gap, its height above the rim, like the adjacent part of the face. A point that has left the
        obstacle has this gap only if the face is turned towards the obstacle.

        Args:
            most: largest removed overlap; 0 for none.

        Returns:
            Gaps at the points of this rank and at the local vertices.
        """
        points = self._points
        given = {"width": points.geometry.facet_widths, "out": ufl.FacetNormal(self._domain)}
        here, there = points.own(points.evaluator(given)), points.vertex_evaluator(given)()
        x = node_positions(points.vertices)
        gaps = self._started(points.positions, here, points.removed_overlap, most)
        return gaps, self._started(x, there, points.removed_at_vertices, most)

    def _started(
        self, x: Array, of_face: Mapping[str, Array], taken: fem.Function | None, most: float
    ) -> Array:
        """Return gaps at given positions of the undeformed face, as described in `starts`.

        Args:
            x: positions, shape (n, dim).
            of_face: facet size ``width`` and outward normal ``out`` of the face at these positions.
            taken: overlaps removed so far; None if there are none.
            most: largest removed overlap.
        """
        start = self._whole.starts(x, of_face["width"])
        facing = dot(start.normal, of_face["out"]) > _FACING
        removed = (start.height < 0.0) & (start.height >= -most * (1.0 + _SAME))
        removed &= start.on_obstacle | facing
        gap = np.where(removed, start.height, start.gap)
        return gap if taken is None else gap + taken.x.array[: len(x)]

    def _place(self, place: Array, before: Array | None) -> None:
        """Set the displacements of the points now and at the last accepted state, (n, dim) each."""
        there = np.zeros_like(place) if before is None else before
        for f, values in ((self._moved, place), (self._moved_before, there)):
            f.x.array[:] = self._points.exchange.from_owners(values).reshape(-1)

    def kinematics(
        self,
        operator: Operator,
        place: Array,
        motion: Array | None,
        frame: Array | None,
        memory: Memory | None,
    ) -> Kinematics:
        """Return jumps, and data of the law without its memory, at displaced points.

        Args:
            operator: operator B from displacements to jumps.
            place: displacements of the points, shape (n, dim).
            motion: motion of the rigid body with which the frame rotates; None if it does not
                rotate.
            frame: rotation of the frame, shape (dim, dim); None for the identity.
            memory: memory at the last accepted state.
        """
        self._place(place, None if memory is None else memory.place)
        found = self._points.own(self._evaluate)
        reference = np.zeros_like(place)
        if self.friction and memory is not None:  # turned with the surface since then
            before = found["normal_before"]
            slipped = memory.reference(before)
            reference = transformed(rotation(before, found["normal"]), slipped)
        normal, seen = found["normal"], found["seen"]
        if self._points.removed_overlap is not None:
            # points on the obstacle do not touch yet, whatever the sign of round-off
            gap = -dot(seen, normal)
            none_yet = np.where(np.abs(gap) <= self._no_gap, gap, 0.0)
            seen = seen + none_yet[:, None] * normal
        Q = np.eye(self._points.dim) if frame is None else frame
        normal, seen, reference = (v @ Q.T for v in (normal, seen, reference))
        turn, moved = (Q @ found[name] @ Q.T for name in ("turn", "moved"))
        plain = self._points.data
        none = np.zeros(self._points.number)
        data = PointData(normal, none, plain.r, plain.fields, turn, moved)
        return Kinematics(operator, seen, reference, data, place, frame, motion, memory)

    def rates(
        self, evaluate: Evaluator, place: Array, memory: Memory | None, frame: Array | None
    ) -> tuple[PointData, Array]:
        """Return rates of the data of the law, and of the jumps (n, dim) at fixed displacements.

        Args:
            evaluate: evaluator of rates, including ``seen``, the rate of the jump.
            place: displacements of the points, shape (n, dim).
            memory: memory at the last accepted state.
            frame: rotation of the frame, shape (dim, dim); None for the identity.
        """
        self._place(place, None if memory is None else memory.place)
        values = self._points.own(evaluate)
        turn = np.eye(self._points.dim) if frame is None else frame
        none = np.zeros(self._points.number)
        data = PointData(values["normal"] @ turn.T, none, none, fields_of(values))
        return data, values["seen"] @ turn.T

    def gaps_and_normals(self, place: Array) -> GapsAndNormals:
        """Return gaps and normals of the points, in the frame of the obstacle.

        Args:
            place: displacements of the points, shape (n, dim).
        """
        self._place(place, None)
        found = self._points.own(self._evaluate)
        return GapsAndNormals(found["gap"], found["normal"])

    def at_vertices(self, place: Array) -> GapsAndNormals:
        """Return gaps and normals at the local vertices, in the frame of the obstacle.

        Args:
            place: displacements of the local vertices, shape (n, dim).
        """
        points = self._points
        if self._at_vertices is None and points.space is points.vertices:
            self._at_vertices = self._moved, self._evaluate
        if self._at_vertices is None:
            moved = fem.Function(blocked_space(points.vertices, points.dim))
            removed = points.removed_at_vertices
            x = ufl.SpatialCoordinate(self._domain) + moved
            gap, normal = self._shape(removed).at(self._domain, x)
            given = {"gap": gap + _removed(removed), "normal": normal}
            self._at_vertices = moved, points.vertex_evaluator(given)
        moved, evaluate = self._at_vertices
        moved.x.array[:] = place.reshape(-1)
        values = evaluate()
        return GapsAndNormals(values["gap"], values["normal"])


def _removed(overlap: fem.Function | None) -> Any:
    """Return a removed overlap as a UFL expression, 0 if none was removed."""
    return ufl.as_ufl(0.0) if overlap is None else overlap


class TrueGaps:
    """Function that returns distances of displaced contact points from the obstacle.

    Compiled when first called.

    Args:
        u: displacement of the body.
        points: contact points.
        obstacle: obstacle.
    """

    def __init__(self, u: fem.Function, points: ContactPoints, obstacle: Obstacle):
        self._u = u
        self._points = points
        self._body = obstacle if isinstance(obstacle, RigidBody) else None
        self._shape = shape_of(obstacle)
        domain, dim = u.function_space.mesh, points.dim
        #: Displacement and rotation of the rigid body.
        self._shift = fem.Constant(domain, np.zeros(dim))
        self._turn = fem.Constant(domain, np.eye(dim))
        self._evaluate: Evaluator | None = None

    def __call__(self) -> Array | None:
        """Return distances of the points of this rank from the obstacle, shape (n,). Collective.

        Distances are negative inside the obstacle. The result is None if the obstacle is defined
        only in the reference configuration.
        """
        if not known_displaced(self._shape):
            return None
        body = self._body
        if self._evaluate is None:
            domain = self._u.function_space.mesh
            x = ufl.SpatialCoordinate(domain) + self._u
            if body is not None:  # in the frame of the body
                about = ufl.as_vector(body.about.tolist())
                x = about + self._turn * (x - about - self._shift)
            gap = self._shape.at(domain, x)[0] + _removed(self._points.removed_overlap)
            self._evaluate = self._points.evaluator({"gap": gap})
        if body is not None:
            self._shift.value = body.displacement
            self._turn.value = body.kinematics.rotation(body.values).T
        return self._points.own(self._evaluate)["gap"]


def _slip_along(way: Any, before: Any, normal: Any) -> Any:
    """Return the slip along an obstacle, a UFL vector perpendicular to the current ``normal``.

    ``way`` is the chord c of the module docstring, ``before`` the earlier normal.
    """
    turned = normal - before
    both = normal + before
    q = ufl.dot(turned, turned) / 4
    cosine = ufl.sqrt(1.0 - q)
    # The branch that does not apply is differentiated as well, and must be finite.
    large = ufl.conditional(ufl.gt(q, _SMALL), q, _SMALL)
    sine = ufl.sqrt(large)
    exact = (ufl.asin(sine) / sine - ufl.sqrt(1.0 - large)) / large
    series = sum(c * q**k for k, c in enumerate(_SERIES) if k) + _SERIES[0]
    stretch = ufl.conditional(ufl.gt(q, _SMALL), exact, series)
    part = stretch / (4 * cosine) * ufl.dot(way, turned)
    part += ufl.dot(way, both) / (4 * (1.0 - q))
    along = before - ufl.dot(before, normal) * normal
    return way - ufl.dot(way, normal) * normal - part * along
