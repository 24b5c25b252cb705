# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps from kink to kink.

A step stays on one piece, which is smooth, by predictor and corrector. Then the events of the piece
are checked: if one has become negative, the first change of status is located along the branch to
round-off, and the branch continues in the piece beyond (`ray_finder.py`), its tangent oriented into
it.

A corrector ends somewhere on the solutions of the piece, be it far from where it began, or behind
it, with a tangent alike. So it is seen where it landed: a point is refused, and the step shortened,
where its advance along the tangent differs from the length of the step by more than a share, or it
lies aside of both tangents, or further from the prediction than the step is long.

An event at which a step begins is zero there. Where it grows along the tangent and is negative at
the end of the step it vanishes a second time on the way, as where a point sticks for a moment: then
the step is shortened until it ends before that. If it counted as the first zero, the start would be
crossed once more, and the branch would go back by the piece that it came by.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.bifurcation import BifurcationTest
from dolfinx_contact.continuation.borders import again, reached
from dolfinx_contact.continuation.branch import BranchPoint, Ray, SpecialPoint
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ray_finder import cross
from dolfinx_contact.continuation.system import Events, Piece, System

__all__ = ["AT_BORDER", "ExactSteps"]

AT_BORDER = 1e-9  # of the largest distance: an event that counts as located
_PROBE = 1e-6  # length over which it is seen whether an event grows
_IDLE = 1e-7  # of the largest rate of an event: no rate
_NO_STEP = 1e-9  # a step that is round-off
_SHARE = 0.5  # of the length of a step, by which its advance may differ from it


class ExactSteps:
    """Steps that end at every event.

    Args:
        corrector: on the bordered system that is followed.
    """

    def __init__(self, corrector: Corrector):
        self.corrector = corrector
        self.control = corrector.control
        self.bordered = corrector.bordered
        self.test = BifurcationTest(self.bordered)
        #: Of all events so far.
        self.largest_distance = 0.0
        #: Why the branch cannot be followed further.
        self.dead_end = ""
        #: The kink that was crossed last, and the ray by which the branch came to it.
        self._incoming: tuple[PETSc.Vec, Ray] | None = None

    @property
    def system(self) -> System:
        """The system that is followed."""
        return self.bordered.system

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.test.destroy()

    def piece_between(self, a: BranchPoint, c: BranchPoint) -> Piece | None:
        """The piece on which the branch runs from ``a`` to the next point ``c``; None if several.

        Collective.
        """
        return a.piece

    def step(
        self, point: BranchPoint, h: float
    ) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        """The next point, special points on the way to it, and the next step length."""
        control = self.control
        b = self.bordered
        while h >= control.minimum:
            y = point.y.copy()
            t = point.tangent.copy()
            y.axpy(h, point.tangent)
            if not self.corrector.moore_penrose(y, t, point.piece):
                h *= control.decrease
                continue
            corrections = self.corrector.iterations
            t.destroy()
            tangent = self.corrector.tangent(
                y, point.tangent, point.piece, start=point.y, precise=False
            )
            if tangent is None or not self.lands(point, h, y, tangent):
                if h * control.decrease >= control.minimum:
                    h *= control.decrease
                    continue
                return None, [], h
            next_h = h * control.increase if corrections <= control.easy else h
            next_h = min(next_h, control.maximum)
            # The factorisation of the tangent serves the test function as well.
            tau = self.test(accepted=True)
            new = BranchPoint(y, tangent, point.piece, b.gamma(y), h, corrections, tau)
            if self._least_distance(new) < 0:
                shorter = h * control.decrease
                if shorter >= control.minimum and self._there_and_back(point, y):
                    h = shorter
                    continue
                crossed = self._to_the_border(point, h, y)
                if crossed[0] is not None or shorter < control.minimum:
                    return crossed
                h = shorter
                continue
            special = self.smooth_points(point, new)
            if self.lacks_fold(point, new, special):
                h *= control.decrease
                continue
            return self.rescaled(new), special, next_h
        return None, [], h

    def lacks_fold(
        self, point: BranchPoint, new: BranchPoint, special: Sequence[SpecialPoint]
    ) -> bool:
        """Whether gamma turns back between two points of a piece at a fold that was not located.

        Args:
            point: where a step begins.
            new: where it ends.
            special: what was located in between.
        """
        turned = self.turned(point.tangent, new.tangent)
        return turned and not any(s.kind == "fold" for s in special)

    def lands(self, point: BranchPoint, h: float, y: PETSc.Vec, tangent: PETSc.Vec) -> bool:
        """Whether a corrector ended where a step leads, or elsewhere. Collective.

        Args:
            point: where the step begins.
            h: its length.
            y: where the corrector ended.
            tangent: there.
        """
        b = self.bordered
        away = y - point.y
        row = b.vector()
        b.dual(away, row)
        length = np.sqrt(float(row.dot(away)))
        beyond = float(row.dot(tangent))
        b.dual(point.tangent, row)
        along = float(row.dot(away))
        least = self.control.cosine
        turns = float(row.dot(tangent)) < least
        aside = min(along, beyond) < least * length
        away.axpy(-h, point.tangent)
        off = self._length(away)
        for v in (away, row):
            v.destroy()
        landed = not (turns or aside or abs(along - h) > _SHARE * h or off > h)
        if not landed:
            self.corrector.reject()
        return landed

    def _events(self, y: PETSc.Vec, piece: Piece) -> Events:
        x, gamma = self.bordered.split(y)
        found = self.system.events(x, gamma, piece)
        return replace(found, distance=np.array(found.distance))

    def _distances(self, y: PETSc.Vec, piece: Piece) -> np.ndarray:
        x, gamma = self.bordered.split(y)
        return self.system.events(x, gamma, piece).distance

    def _unit(self, y: PETSc.Vec, piece: Piece) -> float:
        """The largest distance so far: at a degenerate point all distances vanish. Collective."""
        largest = float(np.max(np.abs(self._distances(y, piece)), initial=self.largest_distance))
        self.largest_distance = float(self.bordered.comm.allreduce(largest, op=max))
        return self.largest_distance or 1.0

    def is_outside(self, point: BranchPoint) -> bool:
        """Whether a point lies beyond a border of its piece, by more than round-off. Collective."""
        return self._least_distance(point) < 0

    def _least_distance(self, point: BranchPoint) -> float:
        """The least event distance if it is beyond round-off, else 0. Collective."""
        distance = self._distances(point.y, point.piece)
        least = self.bordered.comm.allreduce(float(np.min(distance, initial=np.inf)), op=min)
        return least if least < -AT_BORDER * self._unit(point.y, point.piece) else 0.0

    def _there_and_back(self, point: BranchPoint, y_high: PETSc.Vec) -> bool:
        """Whether an event that is zero at ``point`` grows and is negative at the end. Collective.

        It vanishes twice, the second time at a distance from ``point``.
        """
        border = AT_BORDER * self._unit(point.y, point.piece)
        probe = point.y.copy()
        probe.axpy(_PROBE, point.tangent)
        low, high = (self._events(y, point.piece) for y in (point.y, y_high))
        before = again(high, low, np.full_like(high.distance, np.inf))
        ahead = again(high, self._events(probe, point.piece), before)
        probe.destroy()
        known = np.isfinite(before)
        slope = np.subtract(ahead, before, out=np.zeros_like(before), where=known) / _PROBE
        rate = float(np.max(np.abs(slope), initial=0.0))
        least = _IDLE * self.bordered.comm.allreduce(rate, op=max)
        twice = (high.distance < -border) & (np.abs(before) <= border) & (slope > least)
        return bool(self.bordered.comm.allreduce(int(twice.any())))

    def _to_the_border(
        self, point: BranchPoint, h: float, y_high: PETSc.Vec
    ) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        """Go to the first event between ``point`` and ``y_high``, a step ``h`` away; cross it."""
        b = self.bordered
        found = self._first_event(point, y_high)
        if found is None:
            return None, [], h
        s, y = found
        tangent = self.corrector.tangent(y, point.tangent, point.piece)
        if tangent is None:
            return None, [], h
        corrections = self.corrector.iterations
        here = BranchPoint(y, tangent, point.piece, b.gamma(y), s, corrections, self.test())
        special = self.smooth_points(point, here)
        tolerance = AT_BORDER * self._unit(y, point.piece)
        crossing = cross(self.corrector, y, point.piece, tangent, tolerance)
        onwards, *others = crossing.rays or (None,)
        if onwards is None or self._leads_nowhere(here, onwards):
            tried = "all pieces were tried" if crossing.complete else "too many pieces to try"
            self.dead_end = (
                f"no way on was found from gamma = {here.gamma:.10g}, where {crossing.kinks} "
                f"points are at a kink at once ({tried})"
            )
            special.append(SpecialPoint("end", False, here.gamma, y, 0, complete=crossing.complete))
            return here, special, h
        if self._goes_back(here, onwards, point):
            return None, [], h
        self._incoming = (y, Ray(point.piece, tangent))
        turned = self.turned(tangent, onwards.tangent)
        kind = "bifurcation" if others else "fold" if turned else "event"
        special.append(
            SpecialPoint(
                kind,  # type: ignore[arg-type]
                False,
                here.gamma,
                y,
                0,
                crossing.changes,
                crossing.parity,
                tuple(others),
                crossing.complete,
                Ray(point.piece, tangent),
                onwards,
                crossing.method,
            )
        )
        new = BranchPoint(y, onwards.tangent, onwards.piece, here.gamma, s, here.corrections)
        return self.rescaled(new), special, h

    def _goes_back(self, here: BranchPoint, ray: Ray, point: BranchPoint) -> bool:
        """Whether ``ray`` leads back from the kink that was crossed last. Collective.

        It is then, reversed, the ray by which the branch came to ``point``, where ``here`` is too.
        """
        if self._incoming is None or self._incoming[0] is not point.y:
            return False
        incoming = self._incoming[1]
        same = bool(np.array_equal(incoming.piece.codes, ray.piece.codes))
        same = self.bordered.comm.allreduce(same, op=min) and here.step <= _NO_STEP
        return same and self.bordered.inner(incoming.tangent, ray.tangent) < 0

    def _leads_nowhere(self, here: BranchPoint, ray: Ray) -> bool:
        """Whether ``ray`` is in the piece that was left after no step at all. Collective.

        Where a piece is singular the direction to continue need not be a tangent of its own.
        """
        same = bool(np.array_equal(here.piece.codes, ray.piece.codes))
        same = self.bordered.comm.allreduce(same, op=min)
        return same and here.step < self.control.minimum

    def _first_event(self, point: BranchPoint, y_high: PETSc.Vec) -> tuple[float, PETSc.Vec] | None:
        """Where the first event between ``point`` and ``y_high`` vanishes. Collective.

        The first zero if all distances were linear between the two ends; an end that stays twice
        counts half (Illinois), so that the bracket shrinks from both sides; one that begins between
        them is looked for by halving the bracket. Points are corrected from the line between the
        ends.
        """
        b = self.bordered
        comm = self.bordered.comm
        y_low = point.y
        piece = point.piece
        low = 0.0
        high = b.inner(point.tangent, y_high) - b.inner(point.tangent, point.y)
        reach = self._length(y_high - point.y)
        e_low, e_high = (self._events(y, piece) for y in (y_low, y_high))
        w_low = 1.0
        w_high = 1.0
        end = high
        s = high
        y = y_high
        side = 0
        least = np.inf
        for number in range(60):
            fraction = reached(e_low, e_high, (w_low, w_high))
            first = comm.allreduce(float(np.min(fraction, initial=np.inf)), op=min)
            s = low + first * (high - low)
            y = y_low.copy()
            y.axpy(first, y_high - y_low)
            if not self.corrector.pseudo_arclength(
                y, point.y, point.tangent, s, piece, polish=True, keep=number > 0
            ):
                return None
            if self._strays(point, y, reach):
                return None
            events = self._events(y, piece)
            least = comm.allreduce(float(np.min(events.distance, initial=np.inf)), op=min)
            if abs(least) <= 1e-13 * self._unit(y, piece) or high - low <= 1e-15 * end:
                break
            if least < 0:
                w_low = w_low / 2 if side > 0 else w_low
                high = s
                e_high = events
                w_high = 1.0
                y_high = y
                side = 1
            else:
                w_high = w_high / 2 if side < 0 else w_high
                low = s
                e_low = events
                w_low = 1.0
                y_low = y
                side = -1
        # Where two solutions of the piece are near each other a distance may jump over zero.
        return (s, y) if abs(least) <= AT_BORDER * self._unit(y, piece) else None

    def _length(self, away: PETSc.Vec) -> float:
        return float(np.sqrt(self.bordered.inner(away, away)))

    def _strays(self, point: BranchPoint, y: PETSc.Vec, reach: float) -> bool:
        """Whether ``y`` is further aside of the tangent at ``point`` than a step is long."""
        away = y - point.y
        away.axpy(-self.bordered.inner(away, point.tangent), point.tangent)
        aside = self._length(away)
        away.destroy()
        return aside > reach

    def turned(self, t: PETSc.Vec, new: PETSc.Vec) -> bool:
        """Whether gamma turns back between two tangents."""
        a = self.bordered.gamma(t)
        c = self.bordered.gamma(new)
        return a * c < 0 and min(abs(a), abs(c)) > 1e-9 * self.bordered.gamma_scale

    def smooth_points(self, point: BranchPoint, new: BranchPoint) -> list[SpecialPoint]:
        """Folds and bifurcations between two points of a piece, in order."""
        b = self.bordered
        special = []
        if self.turned(point.tangent, new.tangent):
            slopes = b.gamma(point.tangent), b.gamma(new.tangent)
            found = self.locate(point, new.y, slopes, lambda _y, t: b.gamma(t), piece=point.piece)
            if found is not None:
                special.append(
                    (found[0], SpecialPoint("fold", True, b.gamma(found[1]), found[1], 0))
                )
        if point.tau * new.tau < 0:
            found = self.locate(
                point, new.y, (point.tau, new.tau), lambda _y, _t: self.test(), piece=point.piece
            )
            if found is not None:
                kernel = self.test.kernel()
                opposite = kernel.copy()
                opposite.scale(-1.0)
                others = (Ray(point.piece, kernel), Ray(point.piece, opposite))
                at = b.gamma(found[1])
                crossing = SpecialPoint(
                    "bifurcation",
                    True,
                    at,
                    found[1],
                    0,
                    parity=-1,
                    others=others,
                    incoming=Ray(point.piece, self._secant(point, found[1], point.tangent)),
                    onwards=Ray(point.piece, self._secant(found[1], new, new.tangent)),
                )
                special.append((found[0], crossing))
        return [s for _, s in sorted(special, key=lambda pair: pair[0])]

    def _secant(
        self, start: BranchPoint | PETSc.Vec, end: BranchPoint | PETSc.Vec, t: PETSc.Vec
    ) -> PETSc.Vec:
        """The unit vector from one point of a branch to another; ``t`` where they coincide."""
        a, c = (p.y if isinstance(p, BranchPoint) else p for p in (start, end))
        secant = c - a
        size = np.sqrt(self.bordered.inner(secant, secant))
        if size < self.control.minimum:
            return t.copy()
        secant.scale(1.0 / size)
        return secant

    def locate(
        self,
        point: BranchPoint,
        y_high: PETSc.Vec,
        values: tuple[float, float],
        function: Callable[[PETSc.Vec, PETSc.Vec], float],
        *,
        piece: Piece | None,
    ) -> tuple[float, PETSc.Vec] | None:
        """Where between ``point`` and ``y_high`` a function of y and tangent vanishes.

        ``function`` is called when J at the point has been factorised; ``values`` are those at the
        ends. Secant steps; an end that stays twice counts half (Illinois), so that the bracket
        shrinks from both sides. Every point is corrected from the line between the ends of the
        bracket (at first a parabola), whose distance from the branch falls with its square: so none
        is found on another branch that crosses nearby.
        """
        b = self.bordered
        y_low = point.y
        end = b.inner(point.tangent, y_high) - b.inner(point.tangent, y_low)
        low = 0.0
        high = end
        f_low, f_high = values
        reach = self._length(y_high - y_low)
        y = None
        s = 0.0
        f = np.inf
        side = 0
        for _ in range(100):
            fraction = -f_low / (f_high - f_low)
            s = low + fraction * (high - low)
            found = y_low.copy()
            if side == 0:  # a parabola, whose tangent at the start is known
                found.axpy(s - end * fraction**2, point.tangent)
                found.axpy(fraction**2, y_high - y_low)
            else:
                found.axpy(fraction, y_high - y_low)
            if not self.corrector.pseudo_arclength(found, point.y, point.tangent, s, piece):
                break
            if self._strays(point, found, reach):
                break
            tangent = self.corrector.tangent(found, point.tangent, piece)
            if tangent is None:
                break
            y = found
            f = function(found, tangent)
            if not np.isfinite(f):
                break
            if abs(f) <= b.solver.precision * max(
                abs(v) for v in values
            ) or high - low <= 1e-13 * abs(end):
                break
            if f * f_low > 0:
                low = s
                f_low = f
                y_low = y
                f_high = f_high / (2 if side < 0 else 1)
                side = -1
            else:
                high = s
                f_high = f
                y_high = y
                f_low = f_low / (2 if side > 0 else 1)
                side = 1
        # A change of sign through infinity is no zero.
        return (s, y) if y is not None and abs(f) < 1e-3 * min(abs(v) for v in values) else None

    def rescaled(self, point: BranchPoint) -> BranchPoint:
        """The point once the scale of x has been taken from the first tangent that moves it."""
        b = self.bordered
        if b.x_scale == 0.0:
            b.set_scale(point.tangent, point.y)
        point.tangent.scale(1.0 / np.sqrt(b.inner(point.tangent, point.tangent)))
        if b.x_scale_is_new or np.isnan(point.tau):
            # Another border row, another test function.
            b.x_scale_is_new = False
            self.corrector.tangent(point.y, point.tangent, point.piece)
            return replace(point, tau=self.test(accepted=True))
        return point

    def end_at(
        self,
        point: BranchPoint,
        new: BranchPoint,
        special: Sequence[SpecialPoint],
        gamma_range: tuple[float, float],
    ) -> tuple[BranchPoint, list[SpecialPoint]]:
        """The point between ``point`` and ``new`` where gamma leaves its range.

        And those of the special points between the two that lie before it.
        """
        low, high = gamma_range
        special = [s for s in special if s.smooth and low <= s.gamma <= high]
        y, gamma = self.between(point, new, low if new.gamma < low else high)
        if not self.corrector.natural(y, gamma, point.piece):
            return new, special
        b = self.bordered
        tangent = new.tangent
        same = bool(np.array_equal(point.piece.codes, new.piece.codes))
        if b.comm.allreduce(int(not same)):
            # A kink is there to round-off, and what is kept is the ray by which the branch came.
            tangent = self.corrector.tangent(y, point.tangent, point.piece) or tangent
        end = BranchPoint(y, tangent, point.piece, b.gamma(y), new.step, new.corrections)
        return end, special

    def between(
        self, point: BranchPoint, new: BranchPoint, gamma: float
    ) -> tuple[PETSc.Vec, float]:
        """The state between two points where gamma has this value if all were linear; gamma."""
        y = point.y.copy()
        y.axpy((gamma - point.gamma) / (new.gamma - point.gamma), new.y - point.y)
        return y, gamma
