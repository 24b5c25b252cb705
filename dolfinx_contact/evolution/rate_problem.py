# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The rate problem at an accepted state: the directions in which an evolution can continue.

Where memory is accepted every point that slips is at the border of stick, and every bond that
damages at that of an intact one. The directions that lead out of such a state, memory frozen,
solve the rate problem, whose pieces are the statuses of the points at a border. A direction is
inside its piece if the distances that vanish at the state grow along it.

The statuses of the last step are tried first. Where they fail, points whose distances fall take
the status beyond, until none does: Newton's method for the rate problem. Each direction points to
the side on which det [grad H; t^T] keeps its sign, as it does along a path unless another meets it;
so a path that snaps back is distinguished from one that unloads. Where no such direction is found
all statuses that meet are tried; then several directions lead on, or none.

One of the directions leads *back*: it unloads, no bond that damages and no point that slips does so
on it. It answers to the reverse of the direction by which it was reached, and does not lead on.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.branch import FoundRays, Ray
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ray_finder import Kink, RayFinder, parity
from dolfinx_contact.continuation.system import Events, Piece

__all__ = ["Directions", "RateProblem"]

_PROBE = 1e-4  # length over which rates of distances are taken, either way
_IDLE = 1e-10  # of the largest rate: no rate
_ROUNDS = 40  # of Newton's method
_MOST_PIECES = 256  # that are tried
_ALIKE = 1e-6  # of the steepest fall: as steep but for round-off
_DIGITS = 6  # of cosines that distinguish directions


@dataclass(frozen=True)
class Directions:
    """Directions that lead on from a state.

    Attributes:
        onwards: the one that is taken; None if none was found.
        others: further ones, without the one that leads back.
        method: how they were looked for.
        complete: whether all statuses that meet were tried.
    """

    onwards: Ray | None
    others: tuple[Ray, ...] = ()
    method: str = ""
    complete: bool = False

    @property
    def number(self) -> int | None:
        """Of the directions that lead on; None if not all were looked for."""
        return len(self.others) + (self.onwards is not None) if self.complete else None


class RateProblem:
    """Directions out of a state y = (x, gamma), with the memory of the surfaces. Collective.

    Args:
        corrector: on the bordered system.
        y: the state.
        tolerance: distances that count as zero.
        outside: distances beyond a border, below zero, that are no round-off.
    """

    def __init__(self, corrector: Corrector, y: PETSc.Vec, tolerance: float, outside: float):
        self._corrector = corrector
        self._y = y
        self._tolerance = tolerance
        self._outside = outside
        self._b = corrector.bordered
        self._comm = self._b.comm
        self._finder = RayFinder(corrector, y, self._leads_out, self._size)

    def onwards(self, piece: Piece, t: PETSc.Vec, *, every: bool = False) -> Directions:
        """The directions for a path that arrived on ``piece`` along ``t``.

        Args:
            piece: of the last step.
            t: its direction at the state.
            every: whether all statuses that meet are tried where those of the last step fail, also
                if a direction was found.
        """
        ray = Ray(piece, t)
        if self._leads_out(ray):
            return Directions(ray, method="the statuses of the last step")
        found = self._by_newton(piece, t)
        if found is not None and not every:
            return Directions(found, method="Newton's method for the rate problem")
        every_ray = self._enumerated(piece, t)
        complete = every_ray.complete
        rays = [*([found] if found is not None else []), *every_ray.rays]
        rays = rays or self._led_by_H(t)
        back = self._by_newton(piece, self._reversed(t))
        if back is not None:
            rays = [r for r in rays if not self._finder.same(r, back)]
        rays = self._finder.distinct(rays)
        method = "all statuses that meet" if complete else "some of the statuses that meet"
        if not rays:
            return Directions(None, (), method, complete)
        if found is None:
            # Those that are alike keep their order.
            rays.sort(key=lambda r: -round(self._b.inner(r.tangent, t), _DIGITS))
        first, *others = rays
        return Directions(first, tuple(others), method, complete)

    def back(self, piece: Piece, t: PETSc.Vec) -> Directions:
        """The direction that unloads, for a path that arrived on ``piece`` along ``t``."""
        ray = self._by_newton(piece, self._reversed(t))
        return Directions(ray, method="Newton's method for the rate problem")

    def begun(self, piece: Piece, towards: PETSc.Vec) -> Directions:
        """The directions from a start, on the side of ``towards``."""
        ray = self._by_newton(piece, towards, oriented=False)
        rays = [ray] if ray is not None else self._led_by_H(towards)
        return Directions(rays[0] if rays else None, method="Newton's method for the rate problem")

    # -- one piece -------------------------------------------------------------------------------

    def _leads_out(self, ray: Ray) -> bool:
        """Whether a direction leads no point over a border."""
        return not self._any(self._falling(ray)[0])

    def _falling(
        self, ray: Ray
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int8], npt.NDArray[np.float64]]:
        """Local points that a direction leads over a border, their statuses beyond; how steeply.

        A point is there as often as it is at a border, the steepest last.
        """
        here = self._distances(ray, 0.0)
        slope = _slopes(here, self._distances(ray, _PROBE), self._distances(ray, -_PROBE))
        largest = self._comm.allreduce(float(np.max(np.abs(slope), initial=0.0)), op=max)
        at_border = np.abs(here.distance) <= self._tolerance
        over = (at_border & (slope < -_IDLE * largest)) | (here.distance < -self._outside)
        falling = np.flatnonzero(over)
        falling = falling[np.argsort(-slope[falling], kind="stable")]
        fall = np.asarray(-slope[falling], dtype=np.float64)
        return here.point[falling], here.target[falling], fall

    def _distances(self, ray: Ray, away: float) -> Events:
        """To the borders of the piece of a direction, at a distance along it."""
        y = self._y.copy()
        y.axpy(away, ray.tangent)
        events = self._b.system.events(*self._b.split(y), ray.piece)
        y.destroy()
        return events

    def _by_newton(self, piece: Piece, t: PETSc.Vec, *, oriented: bool = True) -> Ray | None:
        """A direction inside its piece, from a piece and a direction. None if none is found.

        Where all points that fall at once lead round in circles they change one by one.

        Args:
            piece: by which the path came along ``t``; or to begin with.
            t: its direction; or one that the result must not oppose.
            oriented: whether [grad H; t^T] keeps the sign of its determinant, as it does along a
                path on which no other meets it.
        """
        for at_once in (True, False):
            found = self._pivoted(piece, t, oriented, at_once)
            if found is not None:
                return found
        return None

    def _pivoted(self, first: Piece, t: PETSc.Vec, oriented: bool, at_once: bool) -> Ray | None:
        seen: set[bytes] = set()
        incoming = Ray(first, t)
        piece = first
        for _ in range(_ROUNDS):
            known = b"".join(self._comm.allgather(piece.codes.tobytes()))
            if known in seen:
                return None
            seen.add(known)
            tangent = self._corrector.tangent(self._y, t, piece)
            if tangent is None:
                return None
            if oriented and len(seen) > 1 and self._parity(incoming, Ray(piece, tangent)) < 0:
                tangent.scale(-1.0)
            ray = Ray(piece, tangent)
            points, targets, fall = self._falling(ray)
            if not self._any(points):
                return ray
            if not at_once:
                points, targets = self._steepest(points, targets, fall)
            piece = piece.with_codes(points, targets)
        return None

    def _steepest(
        self,
        points: npt.NDArray[np.int32],
        targets: npt.NDArray[np.int8],
        fall: npt.NDArray[np.float64],
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int8]]:
        """One of the points of all ranks: the steepest; of several the first by its place."""
        steepest = self._comm.allreduce(float(np.max(fall, initial=-np.inf)), op=max)
        least = steepest - _ALIKE * abs(steepest)
        places = self._b.system.order()[points]
        mine = [
            (int(places[k]), int(targets[k]), self._comm.rank, int(k))
            for k in np.flatnonzero(fall >= least)
        ]
        *_, rank, k = min(one for part in self._comm.allgather(mine) for one in part)
        number = int(self._comm.rank == rank)
        return points[k:][:number], targets[k:][:number]

    def _parity(self, a: Ray, c: Ray) -> int:
        return parity(self._corrector, self._y, a.piece, a.tangent, c)

    # -- several ---------------------------------------------------------------------------------

    def _enumerated(self, piece: Piece, t: PETSc.Vec) -> FoundRays[Ray]:
        """Directions by all statuses of the points at a border, unless these are too many."""
        rank = self._comm.rank
        mine = []
        order = self._b.system.order()
        x, gamma = self._b.split(self._y)
        events = self._b.system.events(x, gamma, piece)
        at_border = np.abs(events.distance) <= self._tolerance
        for i in np.unique(events.point[at_border]):
            targets = [int(c) for c in events.target[at_border & (events.point == i)]]
            code = int(piece.codes[i])
            every = tuple(sorted({code, *targets}))
            mine.append((int(order[i]), Kink(rank, int(i), code, targets[0], every)))
        placed = [pair for part in self._comm.allgather(mine) for pair in part]
        kinks = [kink for _, kink in sorted(placed, key=lambda pair: pair[0])]
        return self._finder.enumerated(piece, kinks, t, most=_MOST_PIECES)

    def _led_by_H(self, t: PETSc.Vec) -> list[Ray]:
        """The direction in which H itself, statuses recomputed, has a solution nearby."""
        sense = 1.0 if self._b.gamma(t) >= 0 else -1.0
        found = self._finder.led_by_H(
            (sense,), lambda ray, _away: self._leads_out(ray), tangent_at_point=True
        )
        return list(found.rays)

    # -- tools -----------------------------------------------------------------------------------

    def _any(self, points: npt.NDArray[np.int32]) -> bool:
        return bool(self._comm.allreduce(len(points)))

    def _reversed(self, t: PETSc.Vec) -> PETSc.Vec:
        back = t.copy()
        back.scale(-1.0)
        return back

    def _size(self, t: PETSc.Vec) -> float:
        """In the measure of a path."""
        return float(np.sqrt(self._b.inner(t, t)))


def _slopes(here: Events, ahead: Events, behind: Events) -> npt.NDArray[np.float64]:
    """Derivatives of distances to borders along a direction, by what is `_PROBE` ahead and behind.

    A border may exist on one side alone, as that at which a bond is whole again: then it is the
    derivative on that side; 0 if it is on neither.
    """
    same = all(
        np.array_equal(here.point, other.point) and np.array_equal(here.target, other.target)
        for other in (ahead, behind)
    )
    if same:
        return np.asarray((ahead.distance - behind.distance) / (2 * _PROBE))
    after = _by_border(ahead)
    before = _by_border(behind)
    slopes = []
    for border, distance in _by_border(here).items():
        sides = [s for s in (before.get(border), after.get(border)) if s is not None]
        width = len(sides) * _PROBE
        last = after.get(border, distance)
        first = before.get(border, distance)
        slopes.append((last - first) / width if sides else 0.0)
    return np.array(slopes, dtype=np.float64)


def _by_border(events: Events) -> dict[tuple[int, int, int], float]:
    """Distances by point, status beyond, and number among those of both."""
    found: dict[tuple[int, int, int], float] = {}
    known: Counter[tuple[int, int]] = Counter()
    for k, distance in enumerate(events.distance):
        border = int(events.point[k]), int(events.target[k])
        found[*border, known[border]] = float(distance)
        known[border] += 1
    return found
