# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following a branch whose pieces are affine: from vertex to vertex by ratio tests.

There is no predictor, no Newton's method and no step length: on a piece the state is affine in
gamma, the first status to change is that of the least ratio, and the change is a low-rank update of
the inverse of a dense matrix of the size of the kinked points (parametric pivoting). Where several
points change at once the tangent cone is solved for all outgoing rays (`rays.py`).
"""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from itertools import pairwise

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.affine import (
    TOLERANCE,
    AffinePiece,
    AffineSystem,
    Array,
    Codes,
    largest,
)
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import (
    Branch,
    BranchPoint,
    Change,
    FoundRays,
    Ray,
    SpecialPoint,
)
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.observer import Stepping
from dolfinx_contact.continuation.parameters import Direction, StepControl, sign_of
from dolfinx_contact.continuation.rays import (
    AffineRay,
    Rays,
    neighbours,
    outgoing,
    same_direction,
)
from dolfinx_contact.continuation.system import Condensed, System
from dolfinx_contact.continuation.walk import Next, Walk, Walker, onwards_from

__all__ = ["Pivoting"]

logger = logging.getLogger(__name__)


class Pivoting(Walker):
    """Follows branches of a system with affine pieces; the counterpart of `Follower`.

    Args:
        system: what is followed.
        condensed: its kinked points, with exact pieces.
        gamma_scale: size of gamma that counts as 1.
    """

    def __init__(self, system: System, condensed: Condensed, *, gamma_scale: float):
        self.system = system
        self.condensed = condensed
        self.control = StepControl()
        self.bordered = Bordered(system, gamma_scale=gamma_scale)
        self._unit = 0.0
        self._recent: list[AffinePiece] = []

    def __enter__(self) -> Pivoting:
        return self

    def __exit__(self, *_: object) -> None:
        self.bordered.destroy()

    def start(
        self, x: PETSc.Vec, gamma: float, *, direction: Direction = "increasing"
    ) -> BranchPoint:
        """The point of the branch near (x, gamma), with its tangent.

        Where pieces meet there it is that of a ray that leads out: in the piece of the state if
        it has one, else the straightest of all.

        Raises:
            ValueError: if there is none, gamma does not appear in H, the tangent is not unique,
                gamma does not go in the direction on any ray, or the direction is unknown.
        """
        sign = sign_of(direction)
        piece = self._piece_of(x, gamma)
        w = piece.at(gamma)
        ray = AffineRay(piece.codes, sign * piece.coefficients[1], sign)
        point = self.point(w, gamma, ray, 0.0)
        cone = self._cone_at(w, ray)
        if cone is None or _is_inside(cone, ray):
            return point
        return onwards_from(self.bordered, point, self._rays_out(cone, w, gamma), sign)

    def departures(self, x: PETSc.Vec, gamma: float) -> FoundRays[BranchPoint]:
        piece = self._piece_of(x, gamma)
        w = piece.at(gamma)
        rays = [AffineRay(piece.codes, s * piece.coefficients[1], s) for s in (1.0, -1.0)]
        passing = tuple(self.point(w, gamma, ray, 0.0) for ray in rays)
        cone = self._cone_at(w, rays[0])
        if cone is None:
            return FoundRays(passing)
        found = self._rays_out(cone, w, gamma)
        return found if found.rays or found.complete else replace(found, rays=passing)

    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        w, ray = self.state(point)
        cone = self._cone_at(w, ray)
        return None if cone is None else self._rays_out(cone, w, point.gamma)

    def _piece_of(self, x: PETSc.Vec, gamma: float) -> AffinePiece:
        """The piece of the solution near (x, gamma); see `start`. Collective."""
        affine = self.condensed.system
        affine.require_finite()
        if not largest(affine.rate) > 0:
            raise ValueError("gamma does not appear in H: its derivative by gamma vanishes")
        codes = affine.solve(gamma, self.condensed.codes(self.system.piece_at(x, gamma)))
        if codes is None:
            raise ValueError(f"no solution near the given state was found at gamma = {gamma}")
        piece = affine.piece(codes)
        if piece is None:
            raise ValueError("the start is a singular point: its tangent is not unique")
        return piece

    def _cone_at(self, w: Array, ray: AffineRay) -> AffineSystem | None:
        """The tangent cone at a state; None where no pieces meet.

        Without load all numbers vanish there, and their size is that of what they become.
        """
        affine = self.condensed.system
        change = self.bordered.gamma_scale * largest(ray.direction)
        cone = affine.tangent_cone(w, TOLERANCE * max(self._unit, change))
        return cone if (cone.allowed.sum(axis=1) > 1).any() else None

    def _rays_out(self, cone: AffineSystem, w: Array, gamma: float) -> FoundRays[BranchPoint]:
        """What leads out of a start at which pieces meet. Collective."""
        found = outgoing(cone, prove=partial(self.system.prove_rays, self.condensed))
        points = tuple(self.point(w, gamma, ray, 0.0) for ray in found.rays)
        return FoundRays(points, found.complete, found.method)

    def branch_off(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """The special point itself, with one of its other rays as the tangent."""
        return BranchPoint(special.y, ray.tangent, ray.piece, special.gamma, 0.0, 0)

    def _walk(
        self,
        start: BranchPoint,
        origin: BranchPoint,
        gamma_range: tuple[float, float],
        stepping: Stepping | None,
    ) -> Walk:
        return _Segments(self, start, origin, gamma_range)

    def restore(self, stepping: Stepping) -> None:
        """Know again what was known at a point that was followed to before."""
        self.bordered.x_scale = stepping.x_scale
        self._unit = stepping.largest_distance

    def stepping(self, index: int) -> Stepping:
        """What is needed to continue from the point of this number."""
        return Stepping(index, 0.0, self.bordered.x_scale, self._unit)

    def passes(
        self, w: Array, ray: AffineRay, length: float, w_start: Array, start: BranchPoint
    ) -> bool:
        """Whether a segment passes the start of the branch."""
        if not np.array_equal(self.condensed.codes(start.piece), ray.codes):
            return False
        d = ray.direction
        along = float(np.sum((w_start - w) * d) / (np.sum(d * d) or 1.0))
        away = np.abs(w + along * d - w_start).max(initial=0.0)
        return bool(0 < along <= length and away <= 1e-8 * self._unit)

    def at(self, branch: Branch, gamma: float, *, skip_missing: bool = False) -> list[BranchPoint]:
        """As `Follower.at`; all are found."""
        found = []
        for a, c in pairwise(branch.points):
            if a.gamma == gamma:
                found.append(a)
            elif (a.gamma - gamma) * (c.gamma - gamma) < 0:
                w, ray = self.state(a)
                length = (gamma - a.gamma) * ray.rate
                found.append(self.point(w + length * ray.direction, gamma, ray, length))
        if branch.points[-1].gamma == gamma:
            found.append(branch.points[-1])
        return found

    # -- vertices --------------------------------------------------------------------------------

    def _piece(self, codes: Codes) -> AffinePiece | None:
        """A piece, factorised once while the branch is on it or has just left it."""
        for piece in self._recent:
            if np.array_equal(piece.codes, codes):
                return piece
        new = self.condensed.system.piece(codes)
        if new is not None:
            self._recent = [new, *self._recent[:1]]
        return new

    def moved(self, w: Array, gamma: float, length: float, ray: AffineRay) -> Array:
        """The state at ``gamma``: that of the piece, so that nothing adds up over the steps.

        A piece that is nearly singular does not know it as well as the segment does.
        """
        piece = self._piece(ray.codes) if ray.rate != 0 else None
        moved = w + length * ray.direction
        exact = moved if piece is None else piece.at(gamma)
        off = largest(exact - moved)
        return exact if off <= TOLERANCE * self._unit else moved

    def cross(
        self, w: Array, gamma: float, ray: AffineRay, length: float
    ) -> tuple[BranchPoint, SpecialPoint, AffineRay | None]:
        """The vertex (w, gamma), what is special about it, and the ray by which to continue."""
        before = self._piece(ray.codes) if ray.rate != 0 else None
        found = self._rays_onwards(w, gamma, ray, before)
        rays = sorted(found.rays, key=lambda r: (r.rate != ray.rate, -_cosine(r, ray)))
        onwards = rays[0] if rays else None
        point = self.point(w, gamma, onwards or ray, length)
        y = point.y
        parity = 0
        if onwards is None:
            end = SpecialPoint(
                "end", False, gamma, y, 0, complete=found.complete, method=found.method
            )
            return point, end, None
        after = self._piece(onwards.codes)
        if before is not None and after is not None:
            parity = self._parity(before, ray, after, onwards.rate)
        turned = onwards.rate * ray.rate < 0
        kind = "bifurcation" if len(rays) > 1 else "fold" if turned else "event"
        changes = tuple(
            Change(*self.condensed.point(int(i)), int(ray.codes[i]), int(onwards.codes[i]))
            for i in np.flatnonzero(onwards.codes != ray.codes)
        )
        others = tuple(
            Ray(self.condensed.piece(r.codes), self._tangent(w, gamma, r)) for r in rays[1:]
        )
        incoming = None
        if others:
            incoming = Ray(self.condensed.piece(ray.codes), self._tangent(w, gamma, ray))
        special = SpecialPoint(
            kind,  # type: ignore[arg-type]
            False,
            gamma,
            y,
            0,
            changes,
            parity,
            others,
            found.complete,
            incoming,
            Ray(point.piece, point.tangent) if others else None,
            found.method,
        )
        return point, special, onwards

    def _rays_onwards(
        self, w: Array, gamma: float, ray: AffineRay, before: AffinePiece | None
    ) -> Rays:
        """The rays that lead out of a vertex, without that which leads back.

        Where one point changes its status and the parity shows that no other branch meets, the
        piece beyond has the only one; else all rays of the tangent cone are looked for.
        """
        affine = self.condensed.system
        tolerance = TOLERANCE * self._unit
        held = affine.statuses_at(w, tolerance)
        kinked = np.flatnonzero(held.sum(axis=1) > 1)
        self._unit = max(self._unit, largest(w))
        if len(kinked) == 1 and before is not None:
            i = int(kinked[0])
            beyond = neighbours(before, w, i, held[i], tolerance)
            if len(beyond) == 1 and self._parity(before, ray, *beyond[0]) > 0:
                piece, sense = beyond[0]
                only = AffineRay(piece.codes, sense * piece.coefficients[1], sense)
                return Rays((only,), False, "")
        back = AffineRay(ray.codes, -ray.direction, -ray.rate)
        prove = partial(self.system.prove_rays, self.condensed)
        found = outgoing(affine.tangent_cone(w, tolerance), [back], prove=prove)
        if self.bordered.comm.rank == 0:
            logger.info("gamma = %.10g: %d rays by %s", gamma, len(found.rays), found.method)
        others = tuple(r for r in found.rays if not same_direction(r, back))
        return replace(found, rays=others)

    @staticmethod
    def _parity(before: AffinePiece, ray: AffineRay, after: AffinePiece, rate: float) -> int:
        """Sign of the ratio of the bordered determinants: det A over gamma' on either side."""
        return int(before.sign * ray.rate * after.sign * rate)

    # -- points ----------------------------------------------------------------------------------

    def point(self, w: Array, gamma: float, ray: AffineRay, length: float) -> BranchPoint:
        b = self.bordered
        self._unit = max(self._unit, largest(w))
        x = self.system.create_vector()
        y = b.vector()
        self.condensed.expand(w, gamma, x)
        b.join(x, gamma, y)
        tangent = self._tangent(w, gamma, ray, x)
        x.destroy()
        return BranchPoint(y, tangent, self.condensed.piece(ray.codes), gamma, length, 0)

    def _tangent(
        self, w: Array, gamma: float, ray: AffineRay, x: PETSc.Vec | None = None
    ) -> PETSc.Vec:
        """The unit tangent of a ray that leaves (w, gamma), whose state is ``x`` if it is known."""
        b = self.bordered
        there = self.system.create_vector()
        here = self.system.create_vector() if x is None else x
        if x is None:
            self.condensed.expand(w, gamma, here)
        self.condensed.expand(w + ray.direction, gamma + ray.rate, there)
        there.axpy(-1.0, here)
        t = b.vector()
        y = b.vector()
        b.join(there, ray.rate, t)
        b.join(here, gamma, y)
        there.destroy()
        if x is None:
            here.destroy()
        b.set_scale(t, y)
        y.destroy()
        if b.x_scale == 0.0 and ray.rate == 0:
            b.require_scale()
        t.scale(1.0 / np.sqrt(b.inner(t, t)))
        return t

    def state(self, point: BranchPoint) -> tuple[Array, AffineRay]:
        """The numbers of a point of a branch and the ray along which it continues."""
        b = self.bordered
        codes: Codes = self.condensed.codes(point.piece)
        x, _ = b.split(point.y)
        w = self.condensed.contract(x)
        there = point.y.copy()
        rate = b.gamma(point.tangent)
        resting = abs(rate) <= 1e-9 * b.gamma_scale
        there.axpy(1.0 if resting else 1.0 / abs(rate), point.tangent)
        x, _ = b.split(there)
        direction = self.condensed.contract(x) - w
        there.destroy()
        sense = 0.0 if resting else float(np.sign(rate))
        piece = self._piece(codes) if sense else None
        if piece is not None:
            direction = sense * piece.coefficients[1]
        return w, AffineRay(codes, direction, sense)


def _is_inside(cone: AffineSystem, ray: AffineRay) -> bool:
    """Whether a ray of one piece of a tangent cone leads over none of its borders."""
    slack = cone.slacks(ray.codes, ray.direction)
    least = float(np.min(slack[np.isfinite(slack)], initial=np.inf))
    return least >= -TOLERANCE * largest(ray.direction)


def _cosine(a: AffineRay, b: AffineRay) -> float:
    product = float(np.sum(a.direction * b.direction))
    return product / float(np.linalg.norm(a.direction) * np.linalg.norm(b.direction) or 1.0)


class _Segments(Walk):
    """A branch from vertex to vertex, a segment a step.

    Args:
        pivoting: of the system.
        start: the point from which it is followed.
        origin: where the branch begins, and may close.
        gamma_range: in which it is followed.
    """

    def __init__(
        self,
        pivoting: Pivoting,
        start: BranchPoint,
        origin: BranchPoint,
        gamma_range: tuple[float, float],
    ):
        self._pivoting = pivoting
        self._origin = origin
        self._range = gamma_range
        self._w, self._ray = pivoting.state(start)
        self._w_origin = pivoting.state(origin)[0]

    def advance(self, branch: Branch, point: BranchPoint) -> Next | None:
        pivoting = self._pivoting
        w = self._w
        ray = self._ray
        low, high = self._range
        length = pivoting.condensed.system.step(ray.codes, w, ray.direction)
        if not np.isfinite(length) and ray.rate == 0:
            where = f"the branch goes to infinity at gamma = {point.gamma:.10g}"
            branch.end(Ending.UNBOUNDED, where)
            return None
        ahead = high - point.gamma if ray.rate > 0 else point.gamma - low
        passes = pivoting.passes(w, ray, length, self._w_origin, self._origin)
        if passes and point is not self._origin:
            branch.end(Ending.CLOSED)
            return self._origin, []
        if ray.rate != 0 and length >= ahead:
            gamma = high if ray.rate > 0 else low
            self._w = pivoting.moved(w, gamma, ahead, ray)
            branch.end(Ending.REACHED)
            return pivoting.point(self._w, gamma, ray, ahead), []
        gamma = point.gamma + length * ray.rate
        self._w = pivoting.moved(w, gamma, length, ray)
        new, vertex, onwards = pivoting.cross(self._w, gamma, ray, length)
        if onwards is None:
            branch.end(Ending.NOT_FOUND, f"no way on was found from gamma = {gamma:.10g}")
        else:
            self._ray = onwards
        return new, [vertex]

    def stepping(self, index: int) -> Stepping:
        return self._pivoting.stepping(index)
