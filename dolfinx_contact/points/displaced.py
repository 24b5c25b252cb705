# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Curved obstacles in large displacement: gap, normal and slip where the contact points are now.

A contact point X with the displacement d, as the obstacle sees it, is at x = X + d. There the
obstacle has the gap g(x) and the normal n(x) (Wriggers, Computational Contact Mechanics, 2006,
section 4.1). With the slip s since the last accepted state the law is given no gap, and the jump

    j = -g n + s.

The slip is that along the surface between the two points of it that are opposite to x, and were to
x_o of the last accepted state, or of the reference configuration where nothing is remembered,

    y = x + g(x) n(x),    y_o = x_o + g(x_o) n(x_o),

turned with the normal (`arcs`), and not about it: where a face spins about the normal it is the
chord of the step, whose angle is the indicator `spin`. Points that stay where they are on
the obstacle do not slip. Of a law without friction it is the whole (I - n n^T) d.

What a rigid body sees are points in its own frame: with its displacement d_0 and its rotation Q
about X_0, of any angle,

    x = X_0 + Q^T (X + u - X_0 - d_0),

so that what sticks to a body that turns does not slip; jumps and normals are turned by Q for the
law. Of an obstacle that is moved by Constants shape and place alone change, not its material: both
y and y_o are those of the obstacle as it is now. Functions of the user in an obstacle are taken
where the body was.

Derivatives by x are exact, those of the gap, the normal and the slip.

An overlap o of the reference configuration that is removed is no part of the gap, g(x) + o in j;
places y on the surface are as they are.

Whatever a law is given, `TrueGaps` has how far the points are from the obstacle where they are now.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._compat import merge_entity_maps
from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import require
from dolfinx_contact.laws import LawAtPoints, PointData
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.laws.symbols import before
from dolfinx_contact.obstacles import Obstacle, gap_at, known_displaced
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator, Given
from dolfinx_contact.points.descriptions import SlidingKind
from dolfinx_contact.points.evaluation import PointEvaluator, blocked_space, fields_of, measure_of
from dolfinx_contact.points.kinematics import rotation
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.rigid_body import RigidBody

__all__ = ["DisplacedPoints", "TrueGaps", "displaced_points"]

Array = npt.NDArray[np.float64]
_FACING = 0.5  # cosine of the normals of a face and of what it faces, the least
_SAME = 1e-9  # of an overlap that is removed, by which one is that still
_ROUND_OFF = 1e-14  # of the largest coordinate, a gap that is none


def displaced_points(
    points: ContactPoints,
    domain: mesh.Mesh,
    obstacle: Obstacle,
    law: LawAtPoints,
    sliding: SlidingKind | None,
    *,
    linear: bool,
    name: str,
) -> DisplacedPoints | None:
    """What follows the displacement of a surface; None if gap and normal stay. Collective.

    Nothing of a plane follows: its gap is exact as it is. Nor, by default, of obstacles that linear
    bodies touch, of rigid bodies that turn, whose motions are small then, and of obstacles that are
    known in the reference configuration alone.

    Args:
        points: of the surface.
        domain: mesh of the body.
        obstacle: that it may touch.
        law: at the points.
        sliding: as the user requires it; None for the default.
        linear: whether the body is linear.
        name: of the surface.

    Raises:
        ValueError: if large sliding is not possible there.
    """
    body = obstacle if isinstance(obstacle, RigidBody) else None
    known = known_displaced(obstacle if body is None else body.shape)
    free = body is not None and body.turns_freely
    if obstacle.flat or sliding == "small":
        return None
    turns = body is not None and body.turns
    if sliding is None and (linear or turns or not known):
        return None
    friction = STICK in law.codes
    given = f"there is no friction with the law {law.law.name}, which"
    for good, why in (
        (obstacle.opposite is None, "between bodies sliding is small"),
        (known, "the obstacle is known in the reference configuration alone: it needs a method at"),
        (not free, "a rigid body that turns freely turns little; hold or prescribe its rotation"),
        (points.method != "mixed", "gaps of mixed contact are averages around nodes; take another"),
        (law.law.averaging is None, f"{given} averages the pressure around points"),
        (not (friction and law.compiled.bonded), f"{given} has bonds"),
        (
            not (turns and law.compiled.bonded),
            f"a rigid body does not turn with the law {law.law.name}, which has bonds",
        ),
        (
            not (friction and set(law.compiled.names) & set(before(law.dim))),
            f"{given} depends on the whole tangential jump",
        ),
    ):
        message = f"{name}: in large sliding on a curved obstacle {why}, or sliding='small'"
        require(points.comm, good, message)
    return DisplacedPoints(points, domain, obstacle, friction=friction)


class DisplacedPoints:
    """What an obstacle is at displaced contact points. Collective, as all its methods are.

    Displacements, gaps and normals are those in the frame of the obstacle.

    Args:
        points: nodes or Gauss points.
        obstacle: known at displaced points (`obstacles.Obstacle.at`).
        friction: whether slips are counted from the last accepted state.

    Attributes:
        friction: as given.
        shape: what the obstacle is to the points, in its frame.
        ended: whether that is more than the obstacle itself, past its rim.
        given: gap and normal at the displaced points in UFL, and the fields of the law, which are
            those of the reference configuration.
        seen: j in UFL.
    """

    def __init__(
        self, points: ContactPoints, domain: mesh.Mesh, obstacle: Obstacle, *, friction: bool
    ):
        self._points = points
        self._domain = domain
        shape = obstacle.shape if isinstance(obstacle, RigidBody) else obstacle
        self._whole = shape
        self.shape = shape.ended(lambda: (points.facet_widths, _taken(points.removed_overlap)))
        self.ended = self.shape is not shape
        self.friction = friction
        space = blocked_space(points.space, points.dim)
        self._moved = fem.Function(space)
        self._moved_before = fem.Function(space)
        start = ufl.SpatialCoordinate(domain)
        x = ufl.variable(start + self._moved)
        gap, normal = self.shape.at(domain, x)
        left = _without(gap, points.removed_overlap)
        self.given = Given(left, normal, points.given.fields)
        expressions = {"gap": left, "normal": normal}
        if friction:
            from dolfinx_contact.points.arcs import slip_along

            there = start + self._moved_before
            gap_before, normal_before = self.shape.at(domain, there)
            way = x + gap * normal - there - gap_before * normal_before
            slip = slip_along(way, normal_before, normal)
            expressions["normal_before"] = normal_before
        else:
            slip = x - start - ufl.dot(x - start, normal) * normal
        self.seen = slip - left * normal
        expressions |= {"seen": self.seen, "turn": ufl.diff(normal, x)}
        expressions["moved"] = ufl.diff(self.seen, x)
        self._evaluate = points.evaluator(expressions)
        self._at_vertices: tuple[fem.Function, Evaluator] | None = None
        largest = float(np.max(np.abs(points.positions), initial=0.0))
        self._no_gap = _ROUND_OFF * points.comm.allreduce(largest, op=max)

    def starts(self, most: float) -> tuple[Array, Array, Array]:
        """Gaps of the undeformed body on an obstacle that ends. Collective.

        What is below its rim and past it has its height over the rim as its gap, as the face beside
        it, where that is an overlap that is removed; what the obstacle does not hold there only
        where the face looks to it.

        Args:
            most: the largest overlap that is removed; 0 for none.

        Returns:
            Gaps at the points of this rank (n,) and at the local vertices, and the normals at the
            points (n, dim).
        """
        points = self._points
        out = ufl.FacetNormal(self._domain)
        given = {"width": points.facet_widths, "out": out}
        here = points.evaluator(given | {"taken": _taken(points.removed_overlap)})()
        mine = {name: values[: points.number] for name, values in here.items()}
        gap, normal = self._started(points.positions, mine, most)
        there = self._evaluator_at_vertices(given | {"taken": _taken(points.removed_at_vertices)})
        x = node_positions(points.vertices)[:, : points.dim]
        return gap, self._started(x, there(), most)[0], normal

    def _started(self, x: Array, of_face: Mapping[str, Array], most: float) -> tuple[Array, Array]:
        """Gaps (n,) and normals (n, dim) as `starts` has them at points x (n, dim)."""
        start = self.shape.starts(x, of_face["width"])
        facing = np.sum(start.normal * of_face["out"], axis=1) > _FACING
        removed = (
            (start.height < 0.0) & (start.height >= -most * (1.0 + _SAME)) & (start.held | facing)
        )
        return np.where(removed, start.height, start.gap) + of_face["taken"], start.normal

    def _place(self, place: Array, before: Array | None) -> None:
        """Let the points be, and have been, where these displacements (n, dim) bring them."""
        self._moved.x.array[:] = self._points.with_ghosts(place).reshape(-1)
        there = np.zeros_like(place) if before is None else before
        self._moved_before.x.array[:] = self._points.with_ghosts(there).reshape(-1)

    def at(
        self, place: Array, memory: Memory | None, frame: Array | None
    ) -> tuple[PointData, Array, Array]:
        """What the law is given, the jump that it sees, and what it does not see of it (n, dim).

        Args:
            place: displacements of the points (n, dim).
            memory: of the last accepted state.
            frame: Q (dim, dim); None for the identity.
        """
        self._place(place, None if memory is None else memory.place)
        found = {name: v[: self._points.number] for name, v in self._evaluate().items()}
        reference = np.zeros_like(place)
        if self.friction and memory is not None:  # turned with the surface since then
            before = found["normal_before"]
            slipped = memory.reference(before)
            reference = np.einsum("nij,nj->ni", rotation(before, found["normal"]), slipped)
        normal, seen = found["normal"], found["seen"]
        if self._points.removed_overlap is not None:
            # What lies on the obstacle does not touch yet, whatever the sign of round-off.
            gap = -np.sum(seen * normal, axis=1)
            none_yet = np.where(np.abs(gap) <= self._no_gap, gap, 0.0)
            seen = seen + none_yet[:, None] * normal
        turn, moved = found["turn"], found["moved"]
        if frame is not None:
            normal, seen, reference = (v @ frame.T for v in (normal, seen, reference))
            turn, moved = (frame @ a @ frame.T for a in (turn, moved))
        plain = self._points.data
        none = np.zeros(self._points.number)
        return PointData(normal, none, plain.r, plain.fields, turn, moved), seen, reference

    def rates(
        self, evaluate: Evaluator, place: Array, memory: Memory | None, frame: Array | None
    ) -> tuple[PointData, Array]:
        """Rates of what the law is given and of the jump (n, dim), where points stay.

        Args:
            evaluate: the evaluator of rates, that of the jump under the name seen.
            place: displacements of the points (n, dim).
            memory: of the last accepted state.
            frame: Q (dim, dim); None for the identity.
        """
        self._place(place, None if memory is None else memory.place)
        values = {name: v[: self._points.number] for name, v in evaluate().items()}
        turn = np.eye(self._points.dim) if frame is None else frame
        none = np.zeros(self._points.number)
        data = PointData(values["normal"] @ turn.T, none, none, fields_of(values))
        return data, values["seen"] @ turn.T

    def gaps_and_normals(self, place: Array) -> tuple[Array, Array]:
        """Gaps (n,) and normals (n, dim) of the points, in the frame of the obstacle.

        Args:
            place: displacements of the points (n, dim).
        """
        self._place(place, None)
        found = self._evaluate()
        return found["gap"][: self._points.number], found["normal"][: self._points.number]

    def at_vertices(self, place: Array) -> tuple[Array, Array]:
        """Gaps (n,) and normals (n, dim) at the local vertices.

        Args:
            place: displacements of the local vertices (n, dim).
        """
        if self._at_vertices is None:
            nodal = self._points.space is self._points.vertices
            self._at_vertices = (self._moved, self._evaluate) if nodal else self._vertices()
        moved, evaluate = self._at_vertices
        moved.x.array[:] = place.reshape(-1)
        values = evaluate()
        return values["gap"], values["normal"]

    def _vertices(self) -> tuple[fem.Function, PointEvaluator]:
        domain = self._domain
        moved = fem.Function(blocked_space(self._points.vertices, self._points.dim))
        taken = self._points.removed_at_vertices
        shape = self._whole.ended(lambda: (self._points.facet_widths, _taken(taken)))
        gap, normal = shape.at(domain, ufl.SpatialCoordinate(domain) + moved)
        gap = _without(gap, taken)
        return moved, self._evaluator_at_vertices({"gap": gap, "normal": normal})

    def _evaluator_at_vertices(self, expressions: dict[str, Any]) -> PointEvaluator:
        submesh = self._points.submesh
        ds = measure_of(self._domain, submesh.parent_facets, 1, "vertex")
        return PointEvaluator(self._points.vertices, ds, expressions, merge_entity_maps([submesh]))


def _without(gap: Any, taken: fem.Function | None) -> Any:
    """A gap in UFL without the overlap that is taken from it."""
    return gap if taken is None else gap + taken


def _taken(overlap: fem.Function | None) -> Any:
    """The overlap that is removed, in UFL."""
    return ufl.as_ufl(0.0) if overlap is None else overlap


class TrueGaps:
    """Distances of displaced contact points, compiled at first use.

    Args:
        u: displacement of the body.
        points: of a surface.
        obstacle: that it may touch.
    """

    def __init__(
        self,
        u: fem.Function,
        points: ContactPoints,
        obstacle: Obstacle,
    ):
        self._u = u
        self._points = points
        self._body = obstacle if isinstance(obstacle, RigidBody) else None
        self._shape = obstacle if self._body is None else self._body.shape
        self._evaluate: Evaluator | None = None

    def __call__(self) -> npt.NDArray[np.float64] | None:
        """Distances of the points of this rank (n,), negative inside. Collective.

        None if the obstacle does not define it (`obstacles.gap_at`).
        """
        body = self._body
        shape = self._shape
        if self._evaluate is None:
            domain = self._u.function_space.mesh
            x = ufl.SpatialCoordinate(domain) + self._u
            at = gap_at(shape, domain, x) if body is None else body.gap_of(shape, domain, x)
            if at is None:
                return None
            self._evaluate = self._points.evaluator(
                {"gap": _without(at, self._points.removed_overlap)}
            )
        if body is not None:
            body.place()
        return self._evaluate()["gap"][: self._points.number]
