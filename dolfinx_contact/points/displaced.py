# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Curved obstacles in large displacement: gap and normal where the contact points are now.

A contact point X with the jump j is at x = X + j. There the obstacle has the gap g(x) and the
normal n(x), and the penetration of the law is u_n = -g(x). The law takes it as j.n - gap (`laws`),
and so is given

    gap = g(x) + j.n,    d gap / dj = dg/dx + n + (dn/dx)^T j,    d n / dj = dn/dx,

in which dg/dx = -n where g is a distance, and dn/dx is then minus the Hessian of the distance
(Wriggers, Computational Contact Mechanics, 2006, section 4.1). On a plane this is the gap of the
reference configuration, for every jump. The tangential jump is j - (j.n) n at the present normal:
of a point that has moved around a curve that is no slip, which is why friction is refused.
Functions of the user in an obstacle are taken where the body was.

Whatever a law is given, `TrueGaps` has how far the points are from the obstacle where they are now.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._compat import merge_entity_maps
from dolfinx_contact._errors import require
from dolfinx_contact.laws import LawAtPoints, PointData
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.obstacles import Obstacle, gap_at, known_displaced
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator, Given
from dolfinx_contact.points.evaluation import PointEvaluator, blocked_space, fields_of, measure_of
from dolfinx_contact.points.rigid_body import RigidBody

__all__ = ["DisplacedPoints", "SlidingKind", "TrueGaps", "check_sliding", "displaced_points"]

Array = npt.NDArray[np.float64]
#: How far points are expected to slide: small beside the curvature of the obstacle, or any way.
SlidingKind: TypeAlias = Literal["small", "large"]


def check_sliding(name: str, sliding: Any) -> None:
    """Raise ``ValueError`` if that is no `SlidingKind`. Not collective."""
    if sliding not in ("small", "large", None):
        raise ValueError(f"{name}: sliding must be 'small', 'large' or None, got {sliding!r}")


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
    bodies touch, of rigid bodies that turn, whose motions are small, and of obstacles that are
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
    turns = body is not None and body.turns
    if obstacle.flat or sliding == "small":
        return None
    if sliding is None and (linear or turns or not known):
        return None
    for good, why in (
        (obstacle.opposite is None, "between bodies sliding is small"),
        (known, "the obstacle is known in the reference configuration alone: it needs a method at"),
        (not turns, "the rotation of the rigid body is small; hold it"),
        (points.method != "mixed", "gaps of mixed contact are averages around nodes; take another"),
        (
            STICK not in law.codes,
            "there is no friction yet. The slip of a point is the distance that it has moved along "
            "a normal that has turned meanwhile, and needs to be summed up in increments. Take "
            "Frictionless() or a HalfSpace",
        ),
    ):
        message = f"{name}: in large sliding on a curved obstacle {why}, or sliding='small'"
        require(points.comm, good, message)
    return DisplacedPoints(points, domain, obstacle)


class DisplacedPoints:
    """What an obstacle is at displaced contact points. Collective, as all its methods are.

    Args:
        points: nodes or Gauss points.
        obstacle: known at displaced points (`obstacles.Obstacle.at`).

    Attributes:
        given: gap and normal at the displaced points in UFL, and the fields of the law, which are
            those of the reference configuration.
    """

    def __init__(self, points: ContactPoints, domain: mesh.Mesh, obstacle: Obstacle):
        self._points = points
        self._domain = domain
        self._obstacle = obstacle
        self._jump = fem.Function(blocked_space(points.space, points.dim))
        x = ufl.variable(ufl.SpatialCoordinate(self._domain) + self._jump)
        gap, normal = obstacle.at(self._domain, x)
        self.given = Given(gap, normal, points.given.fields)
        slopes = {"by_gap": ufl.diff(gap, x), "by_normal": ufl.diff(normal, x)}
        self._evaluate = points.evaluator({"gap": gap, "normal": normal, **slopes})
        self._at_vertices: tuple[fem.Function, Evaluator] | None = None

    def _place(self, jump: Array) -> None:
        """Let the points be where these jumps (n, dim) bring them."""
        self._jump.x.array[:] = self._points.with_ghosts(jump).reshape(-1)

    def data(self, jump: Array) -> PointData:
        """What the law is given at jumps (n, dim), and how that changes with them."""
        self._place(jump)
        found = {name: v[: self._points.number] for name, v in self._evaluate().items()}
        normal = found["normal"]
        turn = found["by_normal"]
        plain = self._points.data
        along = np.sum(jump * normal, axis=1)
        slope = found["by_gap"] + normal + np.einsum("nij,ni->nj", turn, jump)
        return PointData(normal, found["gap"] + along, plain.r, plain.fields, turn, slope)

    def rates(self, evaluate: Evaluator, jump: Array) -> PointData:
        """Rates of what the law is given at held jumps (n, dim), from the evaluator of rates."""
        self._place(jump)
        values = {name: v[: self._points.number] for name, v in evaluate().items()}
        normal = values["normal"]
        gap = values["gap"] + np.sum(jump * normal, axis=1)
        return PointData(normal, gap, np.zeros(self._points.number), fields_of(values))

    def at_vertices(self, jump: Array) -> tuple[Array, Array]:
        """Gaps (n,) and normals (n, dim) at the local vertices.

        Args:
            jump: at the local vertices (n, dim).
        """
        if self._at_vertices is None:
            nodal = self._points.space is self._points.vertices
            self._at_vertices = (self._jump, self._evaluate) if nodal else self._vertices()
        moved, evaluate = self._at_vertices
        moved.x.array[:] = jump.reshape(-1)
        values = evaluate()
        return values["gap"], values["normal"]

    def _vertices(self) -> tuple[fem.Function, PointEvaluator]:
        W = self._points.vertices
        submesh = self._points.submesh
        domain = self._domain
        ds = measure_of(domain, submesh.parent_facets, 1, "vertex")
        moved = fem.Function(blocked_space(W, self._points.dim))
        at = self._obstacle.at(domain, ufl.SpatialCoordinate(domain) + moved)
        expressions: dict[str, Any] = dict(zip(("gap", "normal"), at, strict=True))
        maps = merge_entity_maps([submesh])
        return moved, PointEvaluator(W, ds, expressions, maps)


class TrueGaps:
    """Distances of displaced contact points, compiled at first use.

    Args:
        u: displacement of the body.
        points: of a surface.
        obstacle: that it may touch.
    """

    def __init__(self, u: fem.Function, points: ContactPoints, obstacle: Obstacle):
        self._u = u
        self._points = points
        self._obstacle = obstacle
        self._evaluate: Evaluator | None = None

    def __call__(self) -> npt.NDArray[np.float64] | None:
        """Distances of the points of this rank (n,), negative inside. Collective.

        None if the obstacle does not define it (`obstacles.gap_at`).
        """
        body = self._obstacle if isinstance(self._obstacle, RigidBody) else None
        if self._evaluate is None:
            domain = self._u.function_space.mesh
            x = ufl.SpatialCoordinate(domain) + self._u
            at = gap_at(self._obstacle, domain, x) if body is None else body.gap_of(domain, x)
            if at is None:
                return None
            self._evaluate = self._points.evaluator({"gap": at})
        if body is not None:
            body.place()
        return self._evaluate()["gap"][: self._points.number]
