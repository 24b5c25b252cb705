# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parametric pivoting: branches with affine pieces, traced from vertex to vertex by ratio tests.

As long as no status changes, the state is affine in gamma. The smallest ratio of the distance to a
border and its rate determines the first point that changes its status. A change of status costs the
inverse of a dense matrix of the size of the condensed problem. Pivoting requires no predictor, no
Newton iteration and no step length. If several points change simultaneously, the branch continues
along a ray of the tangent cone (`cone_rays.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact._ending import Ending
from dolfinx_contact.continuation.affine import (
    TOLERANCE,
    AffinePiece,
    AffineSystem,
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
    kind_of_kink,
)
from dolfinx_contact.continuation.cone_rays import (
    AffineRay,
    Rays,
    neighbours,
    outgoing,
    same_direction,
)
from dolfinx_contact.continuation.observer import Stepping
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.continuation.system import Condensed, System
from dolfinx_contact.continuation.tracing import CONSTANT, Next, Tracer

__all__ = ["Pivoting"]

logger = logging.getLogger(__name__)


class Pivoting(Tracer):
    """Tracing of the branches of a system that is affine for fixed statuses.

    Args:
        system: system H(x, gamma) = 0.
        condensed: the system after exact elimination of all unknowns except those of its points.
        gamma_scale: unit of gamma.
    """

    def __init__(self, system: System, condensed: Condensed, *, gamma_scale: float):
        self.system = system
        self.condensed = condensed
        self.control = StepControl()
        self.bordered = Bordered(system, gamma_scale=gamma_scale)
        self.first_step = self.next_step = 0.0  # steps end at vertices
        self.largest_distance = 0.0
        self._recent: list[AffinePiece] = []
        self._prove = partial(system.prove_rays, condensed)

    # -- where branches start --------------------------------------------------------------------

    def _point_at(self, x: PETSc.Vec, gamma: float, sign: float) -> BranchPoint:
        affine = self.condensed.system
        affine.require_finite()
        if not largest(affine.rate) > 0:
            raise ValueError("gamma does not appear in H: dH/dgamma vanishes")
        codes = affine.solve(gamma, self.condensed.codes(self.system.piece_at(x, gamma)))
        if codes is None:
            raise ValueError(f"no solution near the given state was found at gamma = {gamma}")
        piece = affine.piece(codes)
        if piece is None:
            raise ValueError("the start is a singular point: its tangent is not unique")
        ray = AffineRay(piece.codes, sign * piece.coefficients[1], sign)
        return self._point(piece.at(gamma), gamma, ray, 0.0)

    def _leads_out(self, point: BranchPoint) -> bool:
        w, ray = self.state(point)
        cone = self._cone_at(w, ray)
        if cone is None:
            return True
        slack = cone.slacks(ray.codes, ray.direction)
        least = float(np.min(slack[np.isfinite(slack)], initial=np.inf))
        return least >= -TOLERANCE * largest(ray.direction)

    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        w, ray = self.state(point)
        cone = self._cone_at(w, ray)
        if cone is None:
            return None
        found = outgoing(cone, prove=self._prove)
        points = tuple(self._point(w, point.gamma, r, 0.0) for r in found.rays)
        return FoundRays(points, found.complete, found.method)

    def _cone_at(self, w: Array, ray: AffineRay) -> AffineSystem | None:
        """Return the tangent cone at a state; None if every point can have one status only.

        The tolerance is relative to the largest variable so far. In a state without load all
        variables vanish; then their change along the ray is used instead.
        """
        change = self.bordered.gamma_scale * largest(ray.direction)
        tolerance = TOLERANCE * max(self.largest_distance, change)
        cone = self.condensed.system.tangent_cone(w, tolerance)
        return cone if (cone.allowed.sum(axis=1) > 1).any() else None

    def branch_off(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        return BranchPoint(special.y, ray.tangent, ray.piece, special.gamma)

    # -- from vertex to vertex -------------------------------------------------------------------

    def _stepping(self, index: int) -> Stepping:
        return Stepping(index, self.next_step, self.bordered.x_scale, self.largest_distance)

    def _resume(self, stepping: Stepping) -> None:
        super()._resume(stepping)
        self.largest_distance = stepping.largest_distance

    def _trace(
        self, branch: Branch, origin: BranchPoint, gamma_range: tuple[float, float]
    ) -> Iterator[Next]:
        low, high = gamma_range
        point = branch.points[-1]
        w, ray = self.state(point)
        w_origin, _ = self.state(origin)
        while branch.ending is None:
            length = self.condensed.system.step(ray.codes, w, ray.direction)
            if not np.isfinite(length) and ray.rate == 0:
                where = f"the branch goes to infinity at gamma = {point.gamma:.10g}"
                branch.end(Ending.UNBOUNDED, where)
                return
            if point is not origin and self._passes(w, ray, length, w_origin, origin):
                branch.end(Ending.CLOSED)
                yield origin, []
                return
            ahead = high - point.gamma if ray.rate > 0 else point.gamma - low
            if ray.rate != 0 and length >= ahead:
                gamma = high if ray.rate > 0 else low
                w = self._moved(w, gamma, ahead, ray)
                branch.end(Ending.REACHED)
                yield self._point(w, gamma, ray, ahead), []
                return
            gamma = point.gamma + length * ray.rate
            w = self._moved(w, gamma, length, ray)
            point, vertex, onwards = self._cross(w, gamma, ray, length)
            if onwards is None:
                reason = f"no continuation was found from gamma = {gamma:.10g}"
                branch.end(Ending.NOT_FOUND, reason)
            else:
                ray = onwards
            yield point, [vertex]

    def _moved(self, w: Array, gamma: float, length: float, ray: AffineRay) -> Array:
        """Return the variables at ``gamma``, at the distance ``length`` along a ray from ``w``.

        They are computed with the statuses of the ray, so that round-off does not accumulate. If
        the system is nearly singular, the sum along the ray is used, which is more accurate.
        """
        piece = self._piece(ray.codes) if ray.rate != 0 else None
        moved = w + length * ray.direction
        exact = moved if piece is None else piece.at(gamma)
        return exact if largest(exact - moved) <= TOLERANCE * self.largest_distance else moved

    def _passes(
        self, w: Array, ray: AffineRay, length: float, w_origin: Array, origin: BranchPoint
    ) -> bool:
        """Return True if a segment passes through the start of the branch, which is then closed.

        Args:
            w: state at the start of the segment.
            ray: ray of the segment.
            length: length of the segment.
            w_origin: state at the start of the branch.
            origin: start of the branch.
        """
        if not np.array_equal(self.condensed.codes(origin.piece), ray.codes):
            return False
        d = ray.direction
        along = float(np.sum((w_origin - w) * d) / (np.sum(d * d) or 1.0))
        away = largest(w + along * d - w_origin)
        return 0 < along <= length and away <= 1e-8 * self.largest_distance

    def _cross(
        self, w: Array, gamma: float, ray: AffineRay, length: float
    ) -> tuple[BranchPoint, SpecialPoint, AffineRay | None]:
        """Continue beyond the vertex (w, gamma), at which a segment of the branch ends.

        The branch continues along the straightest ray that keeps the direction of gamma; if none
        exists, along the straightest ray.

        Returns:
            Branch point; special point; and next ray, None if the branch ends.
        """
        before = self._piece(ray.codes) if ray.rate != 0 else None
        search = self._rays_onwards(w, gamma, ray, before)
        rays = sorted(search.rays, key=lambda r: (r.rate != ray.rate, -_cosine(r, ray)))
        onwards = rays[0] if rays else None
        point = self._point(w, gamma, onwards or ray, length)
        complete, method = search.complete, search.method
        if onwards is None:
            end = SpecialPoint("end", False, gamma, point.y, complete=complete, method=method)
            return point, end, None
        others = tuple(self._ray(w, gamma, r) for r in rays[1:])
        vertex = SpecialPoint(
            kind_of_kink(bool(others), onwards.rate * ray.rate < 0),
            False,
            gamma,
            point.y,
            changes=tuple(
                Change(*self.condensed.point(int(i)), int(ray.codes[i]), int(onwards.codes[i]))
                for i in np.flatnonzero(onwards.codes != ray.codes)
            ),
            parity=self._parity(before, ray, self._piece(onwards.codes), onwards.rate),
            others=others,
            incoming=self._ray(w, gamma, ray) if others else None,
            onwards=Ray(point.piece, point.tangent) if others else None,
            complete=complete,
            method=method,
        )
        return point, vertex, onwards

    def _rays_onwards(
        self, w: Array, gamma: float, ray: AffineRay, before: AffinePiece | None
    ) -> Rays:
        """Return the outgoing rays of a vertex, without the reverse of the incoming ray.

        If a single point changes its status and the bordered determinant keeps its sign, no other
        branch meets there, and the only ray is that with the new status. Otherwise the rays of the
        tangent cone are computed.
        """
        affine = self.condensed.system
        tolerance = TOLERANCE * self.largest_distance
        possible = affine.statuses_at(w, tolerance)
        kinked = np.flatnonzero(possible.sum(axis=1) > 1)
        self.largest_distance = max(self.largest_distance, largest(w))
        if len(kinked) == 1 and before is not None:
            i = int(kinked[0])
            beyond = neighbours(before, w, i, possible[i], tolerance)
            if len(beyond) == 1 and self._parity(before, ray, *beyond[0]) > 0:
                piece, sense = beyond[0]
                self._recent = [piece, *self._recent[:1]]
                return Rays((AffineRay(piece.codes, sense * piece.coefficients[1], sense),), False)
        back = AffineRay(ray.codes, -ray.direction, -ray.rate)
        found = outgoing(affine.tangent_cone(w, tolerance), [back], prove=self._prove)
        if self.bordered.comm.rank == 0:
            logger.info("gamma = %.10g: %d rays by %s", gamma, len(found.rays), found.method)
        return replace(found, rays=tuple(r for r in found.rays if not same_direction(r, back)))

    @staticmethod
    def _parity(
        before: AffinePiece | None, ray: AffineRay, after: AffinePiece | None, rate: float
    ) -> int:
        """Return the sign of the ratio of the bordered determinants after and before a vertex.

        On each side the bordered determinant has the sign of the determinant of the affine system
        times the rate of gamma. The result is 0 if a system is singular.
        """
        if before is None or after is None:
            return 0
        return int(before.sign * ray.rate * after.sign * rate)

    def _piece(self, codes: Codes) -> AffinePiece | None:
        """Return the affine system with the given statuses; None if it is singular.

        The last two results are cached with their inverses.
        """
        for piece in self._recent:
            if np.array_equal(piece.codes, codes):
                return piece
        new = self.condensed.system.piece(codes)
        if new is not None:
            self._recent = [new, *self._recent[:1]]
        return new

    def _between(self, a: BranchPoint, c: BranchPoint, gamma: float) -> BranchPoint:
        w, ray = self.state(a)
        length = (gamma - a.gamma) * ray.rate
        return self._point(w + length * ray.direction, gamma, ray, length)

    # -- numbers and points ----------------------------------------------------------------------

    def _point(self, w: Array, gamma: float, ray: AffineRay, length: float) -> BranchPoint:
        """Return the branch point with the state ``w`` from which a ray starts."""
        b = self.bordered
        self.largest_distance = max(self.largest_distance, largest(w))
        y = self._joined(w, gamma)
        t = self._joined(w + ray.direction, gamma + ray.rate) - y
        b.join(b.split(t)[0], ray.rate, t)  # without round-off of gamma
        b.set_scale(t, y)
        if ray.rate == 0:
            b.require_scale()
        t.scale(1.0 / b.length(t))
        return BranchPoint(y, t, self.condensed.piece(ray.codes), gamma, length)

    def _ray(self, w: Array, gamma: float, ray: AffineRay) -> Ray:
        """Return the `Ray` with unit tangent of an affine ray that leaves the state ``w``."""
        point = self._point(w, gamma, ray, 0.0)
        return Ray(point.piece, point.tangent)

    def _joined(self, w: Array, gamma: float) -> PETSc.Vec:
        """Return the vector (x, gamma) for the variables ``w`` of the points."""
        x = self.system.create_vector()
        self.condensed.expand(w, gamma, x)
        return self.bordered.joined(x, gamma)

    def state(self, point: BranchPoint) -> tuple[Array, AffineRay]:
        """Return the variables w of the points at a branch point, and the ray it continues on."""
        b = self.bordered
        codes: Codes = self.condensed.codes(point.piece)
        w = self.condensed.contract(b.split(point.y)[0])
        rate = b.gamma(point.tangent)
        if abs(rate) > CONSTANT * b.gamma_scale:
            sense = float(np.sign(rate))
            piece = self._piece(codes)
            if piece is not None:
                return w, AffineRay(codes, sense * piece.coefficients[1], sense)
        else:
            sense = 0.0
            rate = 1.0
        ahead = b.moved(point.y, 1.0 / abs(rate), point.tangent)
        direction = self.condensed.contract(b.split(ahead)[0]) - w
        return w, AffineRay(codes, direction, sense)


def _cosine(a: AffineRay, b: AffineRay) -> float:
    product = float(np.sum(a.direction * b.direction))
    return product / float(np.linalg.norm(a.direction) * np.linalg.norm(b.direction) or 1.0)
