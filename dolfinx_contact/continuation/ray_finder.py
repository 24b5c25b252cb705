# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outgoing rays of a nonsmooth point, at which several pieces of H meet.

A piece is H with fixed statuses of all points. It has an outgoing ray if its tangent, in one of its
two directions, stays inside the piece. Three methods find rays:

- *by the tangent cone*, where the system can be condensed onto few points (`cone_rays.py`): all
  rays;
- *by enumeration*: every combination of statuses of the kinked points (points at a border) is
  tried. All rays are found if H has a derivative on every piece; the number of pieces must be
  small;
- *led by H*: H = 0 is solved near the point at a slightly larger or smaller gamma, with recomputed
  statuses. One ray is found, for any number of pieces.

The caller of `RayFinder` defines the criterion for a ray to stay inside its piece. Along a branch
the distances to the borders must grow (`KinkRayFinder`, which combines the methods for the start of
a branch and for a kink). In the rate problem of an evolution the distances must not decrease
(`evolution.rate_problem`).
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Indices
from dolfinx_contact.continuation.branch import Change, FoundRays, Ray
from dolfinx_contact.continuation.cone_rays import distinct, outgoing
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.layout import PROBE
from dolfinx_contact.continuation.system import Piece

__all__ = [
    "Crossing",
    "Kink",
    "KinkRayFinder",
    "RayFinder",
    "parity",
]

logger = logging.getLogger(__name__)

_MOST_PIECES = 1024  # largest number of pieces to enumerate
_LENGTHS = (1e-3, 1e-2, 1e-4, 1e-5)  # changes of gamma at which H itself is solved
_SAME = 1e-6  # relative distance of tangents of one ray
_STILL = 1e-12  # change of x along a unit tangent, relative to x, that is round-off
_BENT = 1e-3  # relative nonlinearity of a row without a derivative
_LED = "one step of Newton's method on H"
_ALONG = 0.9  # smallest cosine between a ray and the chord to the solution of H that defines it


@dataclass(frozen=True)
class Kink:
    """Contact point whose status can change at a state (a kinked point).

    Attributes:
        rank: rank owning the point.
        point: local number of the point on this rank.
        code: status with which the branch arrives.
        target: status to which the point is about to change.
        statuses: all statuses that the point can have.
    """

    rank: int
    point: int
    code: int
    target: int
    statuses: tuple[int, ...]


@dataclass(frozen=True)
class Crossing(FoundRays[Ray]):
    """Rays by which a branch can leave a kink; the branch continues along the first ray.

    Attributes:
        kinks: number of kinked points.
        changes: changes of status along the first ray.
        parity: sign of the ratio of the determinants after and before the kink (see the function
            `parity`); 0 if unknown.
    """

    kinks: int = 0
    changes: tuple[Change, ...] = ()
    parity: int = 0


class RayFinder:
    """Search for the outgoing rays of a point. All methods are collective.

    Args:
        corrector: corrector on the bordered system.
        y: point (x, gamma).
        inside: function returning whether the statuses of a ray remain correct along the ray.
    """

    def __init__(
        self,
        corrector: Corrector,
        y: PETSc.Vec,
        inside: Callable[[Ray], bool],
    ):
        self._corrector = corrector
        self._bordered = corrector.bordered
        self._y = y
        self.inside = inside

    def by_tangent_cone(self, tolerance: float) -> FoundRays[Ray] | None:
        """Return the rays of the tangent cone; None if the system cannot be condensed.

        Args:
            tolerance: distance to a change of status that counts as zero.
        """
        b = self._bordered
        x, gamma = b.split(self._y)
        x = x.copy()
        condensed = b.system.condensed(x, gamma)
        if condensed is None:
            return None
        w = condensed.contract(x)
        condensed.expand(w, gamma, x)
        base = b.joined(x, gamma)
        cone = condensed.system.tangent_cone(w, tolerance)
        found = outgoing(cone, prove=partial(b.system.prove_rays, condensed))
        rays = []
        for ray in found.rays:
            condensed.expand(w + ray.direction, gamma + ray.rate, x)
            tangent = b.joined(x, gamma + ray.rate) - base
            tangent.scale(1.0 / b.length(tangent))
            rays.append(Ray(condensed.piece(ray.codes), tangent))
        if not condensed.exact:
            condensed.destroy()
        if b.comm.rank == 0:
            logger.info("gamma = %.10g: %d rays by %s", gamma, len(rays), found.method)
        return FoundRays(tuple(rays), found.complete, found.method)

    def enumerated(
        self,
        piece: Piece,
        kinks: Sequence[Kink],
        towards: PETSc.Vec,
        *,
        most: int = _MOST_PIECES,
        tried: tuple[int, ...] | None = None,
    ) -> FoundRays[Ray]:
        """Return the rays for all combinations of statuses; none if there are too many.

        Args:
            piece: statuses of all other points.
            kinks: contact points whose statuses are varied.
            towards: direction in which tangents are tried first.
            most: largest number of combinations that are tried.
            tried: statuses of the kinked points that have been tried and are skipped; default:
                none.
        """
        number = math.prod(len(k.statuses) for k in kinks)
        if number > most:
            return FoundRays((), False, f"{number} pieces meet there, too many to be tried")
        rays = tuple(
            ray
            for codes in itertools.product(*(k.statuses for k in kinks))
            if codes != tried
            for ray in self.of_statuses(piece, kinks, codes, towards)
        )
        return FoundRays(rays, True, f"enumeration of {number} pieces")

    def of_statuses(
        self, piece: Piece, kinks: Sequence[Kink], codes: Sequence[int], towards: PETSc.Vec
    ) -> list[Ray]:
        """Return the rays, at most two, for given statuses ``codes`` of the kinked points.

        The piece gives the other statuses; the tangent is tried along ``towards`` first.
        """
        rank = self._bordered.comm.rank
        own = [c for k, c in zip(kinks, codes, strict=True) if k.rank == rank]
        new = piece.with_codes(self._own_points(kinks), own)
        tangent = self._corrector.tangent(self._y, towards, new)
        if tangent is None:
            return []
        return [ray for ray in (Ray(new, tangent), Ray(new, -tangent)) if self.inside(ray)]

    def _own_points(self, kinks: Sequence[Kink]) -> Indices:
        """Return the local numbers of those kinked points that this rank owns."""
        rank = self._bordered.comm.rank
        return np.array([k.point for k in kinks if k.rank == rank], dtype=np.int32)

    def led_by_H(
        self,
        senses: Sequence[float],
        leads: Callable[[Ray, PETSc.Vec], bool],
        *,
        tangent_at_point: bool,
    ) -> Ray | None:
        """Solve H = 0 at a slightly different gamma; return the ray towards the solution.

        The statuses are recomputed. The result is None without a solution or an acceptable ray.

        Args:
            senses: signs of the changes of gamma that are tried, in this order.
            leads: function that decides whether to accept a ray, called with the ray and the vector
                from the point to the solution.
            tangent_at_point: True for tangents at the point, False for tangents at the solution.
        """
        b = self._bordered
        gamma = b.gamma(self._y)
        for length, sense in itertools.product(_LENGTHS, senses):
            y = self._y.copy()
            if not self._corrector.natural(y, gamma + sense * length * b.gamma_scale, None):
                continue
            away = y - self._y
            piece = b.piece_at(y)
            at = self._y if tangent_at_point else y
            tangent = self._corrector.tangent(at, away, piece)
            if tangent is not None and leads(ray := Ray(piece, tangent), away):
                return ray
        return None

    def rough_statuses(self, piece: Piece, kinks: Sequence[Kink]) -> set[int]:
        """Return the statuses for which H has no derivative at the point.

        Trying all combinations of statuses may miss rays with these statuses. In 3D, for example,
        the slip direction of a point without slip and shear is undefined. The test compares the
        change of H due to two small changes of x with the sum of the changes due to each.
        """
        b = self._bordered
        points = self._own_points(kinks)
        x, gamma = b.split(self._y)
        x = x.copy()
        out = x.copy()
        changes = [b.system.probe(seed) for seed in (1, 2)]
        changes.append(changes[0] + changes[1])
        rough = set()
        for status in sorted({s for k in kinks for s in k.statuses}):
            uniform = piece.with_codes(points, [status] * len(points))
            rows = []
            for state in (x, *(b.moved(x, PROBE, change) for change in changes)):
                b.system.residual(state, gamma, out, uniform)
                rows.append(out.array_r.copy())
            base, first, second, total = rows
            bent = np.abs(total - first - second + base)
            if b.anywhere(bent > _BENT * (np.abs(first - base) + np.abs(second - base))):
                rough.add(status)
        return rough

    def same(self, a: Ray, other: Ray) -> bool:
        """Return True if two rays coincide, which is possible even if their statuses differ."""
        b = self._bordered
        return b.length(a.tangent - other.tangent) <= _SAME * b.length(a.tangent)

    def distinct(self, rays: Sequence[Ray]) -> list[Ray]:
        """Return the rays without duplicates."""
        return distinct(rays, self.same)


class KinkRayFinder(RayFinder):
    """Search for rays leaving a kink, along which distances to changes of status grow.

    Args:
        corrector: corrector on the bordered system.
        y: kink of a branch (x, gamma).
        piece: statuses with which the branch arrives.
        tolerance: distance to a change of status that counts as zero.
        idle: whether to accept rays along which the distances of all kinked points remain zero.

    Attributes:
        kinks: points of all ranks whose status can change (kinked points).
    """

    def __init__(
        self,
        corrector: Corrector,
        y: PETSc.Vec,
        piece: Piece,
        tolerance: float,
        *,
        idle: bool = False,
    ):
        super().__init__(corrector, y, self._stays_inside)
        self._piece = piece
        self._tolerance = tolerance
        self._idle = idle
        b = self._bordered
        events = b.events(y, piece)
        targets: dict[int, int] = {}
        for i in np.flatnonzero(np.abs(events.distance) <= tolerance):
            targets.setdefault(int(events.point[i]), int(events.target[i]))
        own = []
        for point, target in targets.items():
            statuses = tuple(map(int, b.system.statuses(point)))
            own.append(Kink(b.comm.rank, point, int(piece.codes[point]), target, statuses))
        self.kinks = tuple(k for part in b.comm.allgather(own) for k in part)

    def same(self, a: Ray, other: Ray) -> bool:
        # x and gamma have different units and are compared separately. The length of `Bordered`
        # does not serve: some unknowns do not count in it, and none until a tangent has moved x.
        b = self._bordered
        tangents = (a.tangent, other.tangent, a.tangent - other.tangent)
        moves = [b.split(t)[0].norm() for t in tangents]
        still = _STILL * b.split(self._y)[0].norm()
        together = moves[2] <= max(_SAME * max(moves[:2]), still)
        return together and abs(b.gamma(tangents[2])) <= _SAME * b.gamma_scale

    def rays_out(self, t: PETSc.Vec) -> FoundRays[Ray]:
        """Return all outgoing rays of a point at which a branch begins or ends.

        Args:
            t: direction that is tried first.
        """
        found = self.by_tangent_cone(100 * self._tolerance)
        if found is None or not (found.rays or found.complete):
            found = self.enumerated(self._piece, self.kinks, t)
            rough = self.rough_statuses(self._piece, self.kinks) if found.complete else set()
            if rough:
                smooth = [r for r in found.rays if rough.isdisjoint(self._codes(r.piece))]
                method = f"{found.method}, some of which have no tangent there"
                found = FoundRays(tuple(smooth), False, method)
        if not found.complete:
            led = [
                self.led_by_H((sense,), self._is_along, tangent_at_point=False)
                for sense in (1.0, -1.0)
                if not any(sense * self._bordered.gamma(ray.tangent) > 0 for ray in found.rays)
            ]
            method = f"{found.method}; {_LED}" if led else found.method
            found = FoundRays((*found.rays, *(r for r in led if r is not None)), False, method)
        return replace(found, rays=tuple(self.distinct(found.rays)))

    def cross(self, t: PETSc.Vec) -> Crossing:
        """Find the outgoing rays of a kink, without the reverse of the incoming ray.

        For one kinked point the status to which it is about to change is tried first. Other
        statuses are tried if this fails, or if the bordered determinant changes its sign, as other
        branches then meet there. For several points the rays of the tangent cone are computed, or
        all statuses are tried.

        Args:
            t: unit tangent of the incoming branch.
        """
        b = self._bordered
        kinks = self.kinks
        sign = 0
        found = self.by_tangent_cone(100 * self._tolerance) if len(kinks) > 1 else None
        if found is not None:
            rays = [r for r in self.distinct(found.rays) if b.inner(r.tangent, t) > -1 + 1e-6]
            rays.sort(key=lambda r: -b.inner(r.tangent, t))  # the straightest first
        else:
            natural = tuple(k.target for k in kinks)

            def leads_on(ray: Ray) -> bool:
                return not (b.is_same_piece(ray.piece, self._piece) and b.inner(ray.tangent, t) < 0)

            rays = [r for r in self.of_statuses(self._piece, kinks, natural, t) if leads_on(r)]
            if len(rays) == 1:
                sign = parity(self._corrector, self._y, self._piece, t, rays[0])
            found = FoundRays((), False, "")
            if len(kinks) > 1 or len(rays) != 1 or sign <= 0:
                found = self.enumerated(self._piece, kinks, t, tried=natural)
                rays += [r for r in found.rays if leads_on(r)]
            if not rays and not found.complete:
                forwards = 1.0 if b.gamma(t) >= 0 else -1.0
                led = self.led_by_H(
                    (forwards, -forwards),
                    lambda ray, away: self._is_along(ray, away) and leads_on(ray),
                    tangent_at_point=False,
                )
                found = FoundRays((), False, _LED)
                rays = [] if led is None else [led]
            rays = self.distinct(rays)
        after = self._codes(rays[0].piece) if rays else []
        changes = tuple(
            Change(k.rank, k.point, k.code, code)
            for k, code in zip(kinks, after, strict=bool(rays))
            if code != k.code
        )
        return Crossing(tuple(rays), found.complete, found.method, len(kinks), changes, sign)

    def _codes(self, piece: Piece) -> list[int]:
        """Return the statuses of the kinked points of all ranks in the given piece."""
        comm = self._bordered.comm
        own = [int(c) for c in piece.codes[self._own_points(self.kinks)]]
        parts = [iter(part) for part in comm.allgather(own)]
        return [next(parts[k.rank]) for k in self.kinks]

    def _is_along(self, ray: Ray, away: PETSc.Vec) -> bool:
        b = self._bordered
        return bool(b.inner(ray.tangent, away) > _ALONG * b.length(away))

    def _stays_inside(self, ray: Ray) -> bool:
        """Return True if a ray does not leave the piece at a kinked point.

        The distances of the kinked points to changes of status must not decrease; unless idle rays
        are accepted, at least one must grow.
        """
        b = self._bordered
        events, slope = b.events_along(self._y, ray.piece, ray.tangent)
        chosen = np.isin(events.point, self._own_points(self.kinks))
        rate = b.largest(slope)
        least = 1e-7 * rate
        # Distances count as zero up to a hundredth of their change along the probe, and round-off.
        # An event at its border must grow; the other events must be inside.
        border = max(1e-2 * rate * PROBE, 1e-11 * b.largest(events.distance))
        at_border = chosen & (np.abs(events.distance) <= border)
        if b.anywhere(np.where(at_border, slope < -least, chosen & (events.distance < 0))):
            return False
        return self._idle or b.anywhere(at_border & (np.abs(slope) > least))


def parity(corrector: Corrector, y: PETSc.Vec, piece: Piece, t: PETSc.Vec, ray: Ray) -> int:
    """Return the sign of the ratio of bordered determinants across a kink. Collective.

    The determinant of [grad H; t^T] is evaluated after the kink with the tangent of ``ray``, and
    before it with the incoming unit tangent ``t``. A negative result shows that other branches meet
    there.
    """
    b = corrector.bordered
    signs = []
    for row, on in ((ray.tangent, ray.piece), (t, piece)):
        b.solver.assemble(y, b.dual(row), on)
        signs.append(b.solver.determinant_sign())
    return int(signs[0] * signs[1])
