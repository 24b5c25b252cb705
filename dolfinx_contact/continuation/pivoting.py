# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following a branch whose pieces are affine: from vertex to vertex by ratio tests.

There is no predictor, no Newton's method and no step length: on a piece the state is affine in
gamma, the first status to change is that of the least ratio, and the change is a low-rank update of
the inverse of a dense matrix of the size of the kinked points (parametric pivoting). Where several
points change at once the tangent cone is solved for all the ways out (`rays.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from itertools import pairwise

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.affine import TOLERANCE, AffinePiece, Array, Codes
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import Branch, BranchPoint, Change, Ray, SpecialPoint
from dolfinx_contact.continuation.rays import (
    AffineRay,
    neighbours,
    outgoing,
    same_direction,
    step,
)
from dolfinx_contact.continuation.system import Condensed, System

__all__ = ["Pivoting"]

logger = logging.getLogger(__name__)


class Pivoting:
    """Follows branches of a system with affine pieces; the counterpart of `Follower`.

    Args:
        system: what is followed.
        condensed: its kinked points, with exact pieces.
        gamma_scale: size of gamma that counts as 1.
    """

    def __init__(self, system: System, condensed: Condensed, *, gamma_scale: float):
        self.system, self.condensed = system, condensed
        self.bordered = Bordered(system, gamma_scale=gamma_scale)
        self._unit = 0.0

    def __enter__(self) -> Pivoting:
        return self

    def __exit__(self, *_: object) -> None:
        self.bordered.destroy()

    def start(self, x: PETSc.Vec, gamma: float, *, increasing: bool = True) -> BranchPoint:
        """The point of the branch near (x, gamma), with its tangent.

        Raises:
            ValueError: if there is none, gamma does not appear in H, or the tangent is not unique.
        """
        affine = self.condensed.system
        if not np.abs(affine.rate).max(initial=0.0) > 0:
            raise ValueError("gamma does not appear in H: its derivative by gamma vanishes")
        codes = affine.solve(gamma, self.condensed.codes(self.system.piece_at(x, gamma)))
        if codes is None:
            raise ValueError(f"there is no solution near the given state at gamma = {gamma}")
        piece = affine.piece(codes)
        if piece is None:
            raise ValueError("the start is a singular point: its tangent is not unique")
        sense = 1.0 if increasing else -1.0
        ray = AffineRay(codes, sense * piece.coefficients[1], sense)
        return self._point(piece.at(gamma), gamma, ray, 0.0)

    def branch_off(self, special: SpecialPoint, ray: Ray, distance: float = 0.0) -> BranchPoint:
        """The special point itself, with one of its other rays as the tangent."""
        del distance  # there is nothing to correct
        return BranchPoint(special.y, ray.tangent, ray.piece, special.gamma, 0.0, 0)

    def run(
        self,
        start: BranchPoint,
        gamma_range: tuple[float, float],
        *,
        max_steps: int = 1000,
        observer: Callable[[BranchPoint], None] | None = None,
    ) -> Branch:
        """Follow from ``start`` along its tangent; a step is a segment between two vertices.

        The system is left at the end of the branch.
        """
        branch, point = Branch([start]), start
        b, (w, ray) = self.bordered, self._state(point)
        low, high = gamma_range
        for _ in range(max_steps):
            length = step(self.condensed.system, ray.codes, w, ray.direction)
            ahead = (high - point.gamma) if ray.rate > 0 else (point.gamma - low)
            if not np.isfinite(length) and ray.rate == 0:
                branch.reason = f"the branch goes to infinity at gamma = {point.gamma:.10g}"
                break
            last = ray.rate != 0 and length >= ahead
            if last:
                length = ahead
            gamma = point.gamma + length * ray.rate
            if last:
                gamma = high if ray.rate > 0 else low
            w = self._moved(w, gamma, length, ray)
            self._unit = max(self._unit, float(np.abs(w).max(initial=0.0)))
            if last:
                point = self._point(w, gamma, ray, length)
                branch.points.append(point)
                branch.reason = "gamma reached the end of its range"
                if observer is not None:
                    observer(point)
                break
            point, special, onwards = self._cross(w, gamma, ray, length)
            branch.special.append(SpecialPoint(**{**special.__dict__, "index": len(branch.points)}))
            branch.points.append(point)
            if observer is not None:
                observer(point)
            if onwards is None:
                branch.reason = f"no way on was found from gamma = {gamma:.10g}"
                break
            ray = onwards
        else:
            branch.reason = f"the budget of {max_steps} steps is exhausted"
        self.system.piece_at(*b.split(branch.points[-1].y))
        logger.info("branch ended: %s", branch.reason)
        return branch

    def at(self, branch: Branch, gamma: float) -> list[BranchPoint]:
        """The points of ``branch`` at which its parameter is ``gamma``, in order."""
        found = []
        for a, c in pairwise(branch.points):
            if a.gamma == gamma:
                found.append(a)
            elif (a.gamma - gamma) * (c.gamma - gamma) < 0:
                w, ray = self._state(a)
                length = (gamma - a.gamma) * ray.rate
                found.append(self._point(w + length * ray.direction, gamma, ray, length))
        if branch.points[-1].gamma == gamma:
            found.append(branch.points[-1])
        return found

    # -- vertices --------------------------------------------------------------------------------

    def _moved(self, w: Array, gamma: float, length: float, ray: AffineRay) -> Array:
        piece = self.condensed.system.piece(ray.codes) if ray.rate != 0 else None
        return w + length * ray.direction if piece is None else piece.at(gamma)

    def _cross(
        self, w: Array, gamma: float, ray: AffineRay, length: float
    ) -> tuple[BranchPoint, SpecialPoint, AffineRay | None]:
        """The vertex (w, gamma), what is special about it, and the ray by which to go on."""
        affine, tolerance = self.condensed.system, TOLERANCE * self._unit
        held = affine.statuses_at(w, tolerance)
        kinked = np.flatnonzero(held.sum(axis=1) > 1)
        before = affine.piece(ray.codes) if ray.rate != 0 else None
        rays, complete, found = [], False, []
        if len(kinked) == 1 and before is not None:
            i = int(kinked[0])
            found = neighbours(before, w, i, held[i], tolerance)
            rays = [AffineRay(p.codes, s * p.coefficients[1], s) for p, s in found]
        if len(found) != 1 or self._parity(before, ray, found[0][0], found[0][1]) <= 0:
            back = AffineRay(ray.codes, -ray.direction, -ray.rate)
            ways = outgoing(affine.tangent_cone(w, tolerance), [back])
            rays = [r for r in ways.rays if not same_direction(r, back)]
            complete = ways.complete
            logger.info("gamma = %.10g: %d rays by %s", gamma, len(ways.rays), ways.method)
        rays.sort(key=lambda r: (r.rate != ray.rate, -_cosine(r, ray)))
        onwards = rays[0] if rays else None
        point = self._point(w, gamma, onwards or ray, length)
        y, parity = point.y, 0
        if onwards is None:
            return point, SpecialPoint("end", False, gamma, y, 0, complete=complete), None
        after = affine.piece(onwards.codes)
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
        special = SpecialPoint(kind, False, gamma, y, 0, changes, parity, others, complete)  # type: ignore[arg-type]
        return point, special, onwards

    @staticmethod
    def _parity(before: AffinePiece | None, ray: AffineRay, after: AffinePiece, rate: float) -> int:
        """Sign of the ratio of the bordered determinants: det A over gamma' on either side."""
        return 0 if before is None else int(before.sign * ray.rate * after.sign * rate)

    # -- points ----------------------------------------------------------------------------------

    def _point(self, w: Array, gamma: float, ray: AffineRay, length: float) -> BranchPoint:
        b = self.bordered
        self._unit = max(self._unit, float(np.abs(w).max(initial=0.0)))
        x, y = self.system.create_vector(), b.vector()
        self.condensed.expand(w, gamma, x)
        b.join(x, gamma, y)
        x.destroy()
        tangent = self._tangent(w, gamma, ray)
        return BranchPoint(y, tangent, self.condensed.piece(ray.codes), gamma, length, 0)

    def _tangent(self, w: Array, gamma: float, ray: AffineRay) -> PETSc.Vec:
        """The unit tangent of a ray that leaves (w, gamma)."""
        b = self.bordered
        x, there = self.system.create_vector(), self.system.create_vector()
        self.condensed.expand(w, gamma, x)
        self.condensed.expand(w + ray.direction, gamma + ray.rate, there)
        there.axpy(-1.0, x)
        t = b.vector()
        b.join(there, ray.rate, t)
        x.destroy(), there.destroy()
        b.set_scale(t)
        if b.x_scale == 0.0 and ray.rate == 0:
            b.require_scale()
        t.scale(1.0 / np.sqrt(b.inner(t, t)))
        return t

    def _state(self, point: BranchPoint) -> tuple[Array, AffineRay]:
        """The numbers of a point of a branch and the ray along which it goes on."""
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
        piece = self.condensed.system.piece(codes) if sense else None
        if piece is not None:
            direction = sense * piece.coefficients[1]
        return w, AffineRay(codes, direction, sense)


def _cosine(a: AffineRay, b: AffineRay) -> float:
    product = float(np.sum(a.direction * b.direction))
    return product / float(np.linalg.norm(a.direction) * np.linalg.norm(b.direction) or 1.0)
