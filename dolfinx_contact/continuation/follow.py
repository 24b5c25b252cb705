# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following a branch of H(x, gamma) = 0 through kinks and folds.

The branch is followed on one piece at a time, which is smooth, by predictor and corrector. After
every step the events of the piece are looked at: if one has become negative, the first change of
status is located along the branch to round-off, and the branch goes on in the piece beyond
(`crossing.py`), its tangent oriented into it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Literal, TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.bifurcation import BifurcationTest
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import CLOSED, Branch, BranchPoint, Ray, SpecialPoint, Stop
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.crossing import cross
from dolfinx_contact.continuation.observer import Observer, Stepping, Task
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.continuation.system import Condensable, Piece, System

__all__ = ["Follower", "Route", "follow", "follower_for"]

Route: TypeAlias = Literal["auto", "pivoting", "steps"]

logger = logging.getLogger(__name__)

_AT_BORDER = 1e-9  # of the largest distance: an event that counts as located


def follow(
    system: System,
    x: PETSc.Vec,
    gamma: float,
    *,
    gamma_range: tuple[float, float],
    increasing: bool = True,
    control: StepControl | None = None,
    max_steps: int = 1000,
    observer: Observer | None = None,
    stop: Stop | None = None,
    route: Route = "auto",
) -> Branch:
    """Follow the branch through (x, gamma) until gamma leaves its range.

    Args:
        system: H with its pieces.
        x: a solution at ``gamma``, corrected if it is one approximately.
        gamma: where to start.
        gamma_range: the branch ends where gamma reaches either end.
        increasing: whether gamma is to grow at the start.
        control: step lengths.
        max_steps: budget; when it is exhausted what was found is returned, and said.
        observer: told of every accepted point.
        stop: asked at every accepted point, with the special points on the way to it, whether the
            branch ends there: it answers with the reason, or "" to go on. A branch that comes back
            to its start ends in any case.
        route: see `follower_for`.

    Returns:
        Points and special points, and why the branch ended.

    Raises:
        ValueError: if the range is empty or does not contain ``gamma``, if gamma does not appear in
            H, or if there is no solution near the start.
    """
    low, high = gamma_range
    if not low < high or not low <= gamma <= high:
        raise ValueError(f"gamma = {gamma} must lie in the range [{low}, {high}], not empty")
    if max_steps < 1:
        raise ValueError(f"the budget of steps must be positive, got {max_steps}")
    scale = high - low
    with follower_for(system, x, gamma, control, gamma_scale=scale, route=route) as follower:
        start = follower.start(x, gamma, increasing=increasing)
        return follower.run(start, (low, high), max_steps=max_steps, observer=observer, stop=stop)


def follower_for(
    system: System,
    x: PETSc.Vec,
    gamma: float,
    control: StepControl | None = None,
    *,
    gamma_scale: float,
    route: Route = "auto",
) -> Follower | Pivoting:
    """What follows the branches of a system.

    Args:
        system: H with its pieces.
        x: a state at ``gamma``.
        gamma: parameter.
        control: step lengths of the general route.
        gamma_scale: size of gamma that counts as 1.
        route: ``"pivoting"`` from vertex to vertex, for affine pieces; ``"steps"`` by predictor and
            corrector; ``"auto"`` by pivoting where that is possible.

    Raises:
        ValueError: if the pieces are not affine and pivoting is asked for.
    """
    if route not in ("auto", "pivoting", "steps"):
        raise ValueError(f"the route must be auto, pivoting or steps, got {route!r}")
    if route != "steps" and isinstance(system, Condensable) and system.is_piecewise_affine:
        condensed = system.condensed(x, gamma)
        if condensed is not None:
            return Pivoting(system, condensed, gamma_scale=gamma_scale)
    if route == "pivoting":
        raise ValueError("the pieces of this system are not affine: pivoting cannot follow it")
    return Follower(system, control or StepControl(), gamma_scale=gamma_scale)


class Follower:
    """Follows branches of one system; holds the bordered matrix and the corrector.

    Args:
        system: what is followed.
        control: step lengths.
        gamma_scale: size of gamma that counts as 1.
    """

    def __init__(self, system: System, control: StepControl, *, gamma_scale: float):
        self.system, self.control = system, control
        self.bordered = Bordered(system, gamma_scale=gamma_scale)
        self.corrector = Corrector(self.bordered, control)
        self._test = BifurcationTest(self.bordered)
        self._largest_distance = 0.0
        self._dead_end = ""

    def __enter__(self) -> Follower:
        return self

    def __exit__(self, *_: object) -> None:
        self._test.destroy()
        self.corrector.destroy()
        self.bordered.destroy()

    def start(self, x: PETSc.Vec, gamma: float, *, increasing: bool = True) -> BranchPoint:
        """The point of the branch near (x, gamma), with its tangent.

        Raises:
            ValueError: if there is none, or gamma does not appear in H.
        """
        b = self.bordered
        y = b.vector()
        b.join(x, gamma, y)
        piece = self.system.piece_at(*b.split(y))
        self._require_parameter(y, piece)
        if not self.corrector.natural(y, gamma, piece):
            raise ValueError(f"there is no solution near the given state at gamma = {gamma}")
        sense = b.last_unit()
        sense.scale((1.0 if increasing else -1.0) * b.gamma_scale)
        tangent = self.corrector.tangent(y, sense, piece)
        if tangent is None:
            raise ValueError("the start is a singular point: its tangent is not unique")
        sense.destroy()
        return self._rescaled(BranchPoint(y, tangent, piece, b.gamma(y), 0.0, 0))

    def branch_off(self, special: SpecialPoint, ray: Ray, distance: float = 1e-3) -> BranchPoint:
        """A point at a small distance from a special point along one of its other rays.

        Raises:
            ValueError: if no solution is found there.
        """
        b = self.bordered
        y, t = special.y.copy(), ray.tangent.copy()
        y.axpy(distance, ray.tangent)
        if not self.corrector.pseudo_arclength(y, special.y, ray.tangent, distance, ray.piece):
            raise ValueError("no solution was found along the ray; try another distance")
        tangent = self.corrector.tangent(y, t, ray.piece)
        if tangent is None:
            raise ValueError("the branch is singular beside the bifurcation; try another distance")
        t.destroy()
        return self._rescaled(BranchPoint(y, tangent, ray.piece, b.gamma(y), distance, 0))

    def run(
        self,
        start: BranchPoint,
        gamma_range: tuple[float, float],
        *,
        max_steps: int = 1000,
        observer: Observer | None = None,
        stop: Stop | None = None,
        branch_id: int = 0,
        stepping: Stepping | None = None,
    ) -> Branch:
        """Follow from ``start`` along its tangent; see `follow`.

        The system is left at the end of the branch.

        Args:
            start: a point of the branch.
            gamma_range: the branch ends where gamma reaches either end.
            max_steps: budget, from the first point of the branch.
            observer: told of every accepted point, ``start`` included.
            stop: see `follow`.
            branch_id: number by which the observer knows the branch.
            stepping: known at ``start`` if the branch was followed to it before.

        Returns:
            The branch from ``start`` on.
        """
        branch, b, first = Branch([start]), self.bordered, 0
        before = b.factorisations, b.solves
        h, low, high = self.control.initial, *gamma_range
        if stepping is not None:
            first, h = stepping.index, stepping.next_step
            b.x_scale, self._largest_distance = stepping.x_scale, stepping.largest_distance
        observer = observer or Observer()
        observer.begin(branch_id, Task((low, high), b.gamma_scale, self.control, max_steps))
        observer.point(branch_id, first, start, (), self._stepping(first, h))
        point = start
        for index in range(first + 1, max_steps + 1):
            new, special, h = self._step(point, h)
            if new is None:
                branch.reason = f"no step of at least {self.control.minimum:g} succeeds"
                break
            node = any(s.kind == "bifurcation" for s in special)
            if not node and self._is_closed(start, point, new):
                new, special = start, [s for s in special if s.smooth]
                branch.reason = CLOSED
            elif not low <= new.gamma <= high:
                special = [s for s in special if s.smooth and low <= s.gamma <= high]
                new = self._end_at(point, new, low if new.gamma < low else high)
                branch.reason = "gamma reached the end of its range"
            special = [replace(s, index=len(branch.points)) for s in special]
            branch.special += special
            branch.points.append(new)
            point = new
            observer.point(branch_id, index, point, special, self._stepping(index, h))
            if any(s.kind == "end" for s in special):
                branch.reason = self._dead_end
            branch.reason = branch.reason or (stop(point, special) if stop is not None else "")
            if branch.reason:
                break
        else:
            branch.reason = f"the budget of {max_steps} steps is exhausted"
        observer.end(branch_id, branch.reason)
        branch.factorisations, branch.solves = b.factorisations - before[0], b.solves - before[1]
        self.system.piece_at(*b.split(branch.points[-1].y))
        logger.info("branch ended: %s", branch.reason)
        return branch

    def _is_closed(self, start: BranchPoint, point: BranchPoint, new: BranchPoint) -> bool:
        """Whether the step from ``point`` to ``new`` passes the start in the sense of the start."""
        b, comm = self.bordered, self.bordered.comm
        same = bool(np.array_equal(start.piece.codes, point.piece.codes))
        if point is start or not comm.allreduce(same, op=_all):
            return False
        back = start.y - point.y
        along, size = b.inner(point.tangent, back), b.inner(back, back)
        end = b.inner(point.tangent, new.y) - b.inner(point.tangent, point.y)
        beside = max(size - along**2, 0.0)
        forwards = b.inner(point.tangent, start.tangent) > self.control.cosine
        return bool(0 < along <= end and beside <= (0.1 * end) ** 2 and forwards)

    def _stepping(self, index: int, h: float) -> Stepping:
        return Stepping(index, h, self.bordered.x_scale, self._largest_distance)

    def at(self, branch: Branch, gamma: float) -> list[BranchPoint]:
        """The points of ``branch`` at which its parameter is ``gamma``, in order.

        Between two points of the branch gamma is taken to pass a value once.
        """
        b, found = self.bordered, []
        for a, c in pairwise(branch.points):
            if a.gamma == gamma:
                found.append(a)
            elif (a.gamma - gamma) * (c.gamma - gamma) < 0:
                values = a.gamma - gamma, c.gamma - gamma
                located = self._locate(a, c.y, values, lambda y, _t: b.gamma(y) - gamma)
                if located is not None and self.corrector.natural(located[1], gamma, a.piece):
                    found.append(BranchPoint(located[1], a.tangent, a.piece, gamma, located[0], 0))
        if branch.points[-1].gamma == gamma:
            found.append(branch.points[-1])
        return found

    # -- one step --------------------------------------------------------------------------------

    def _step(
        self, point: BranchPoint, h: float
    ) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        """The next point, special points on the way to it, and the next step length."""
        control, b = self.control, self.bordered
        while h >= control.minimum:
            y, t = point.y.copy(), point.tangent.copy()
            y.axpy(h, point.tangent)
            if not self.corrector.moore_penrose(y, t, point.piece):
                h *= control.decrease
                continue
            corrections = self.corrector.iterations
            t.destroy()
            tangent = self.corrector.tangent(y, point.tangent, point.piece)
            if tangent is None or b.inner(tangent, point.tangent) < control.cosine:
                if h * control.decrease >= control.minimum:
                    h *= control.decrease
                    continue
                return None, [], h
            next_h = h * control.increase if corrections <= control.easy else h
            next_h = min(next_h, control.maximum)
            # The factorisation of the tangent serves the test function as well.
            tau = self._test(accepted=True)
            new = BranchPoint(y, tangent, point.piece, b.gamma(y), h, corrections, tau)
            if self._least_distance(new) < 0:
                return self._to_the_border(point, h)
            special = self._smooth_points(point, new)
            return self._rescaled(new), special, next_h
        return None, [], h

    def _along(self, point: BranchPoint, s: float) -> PETSc.Vec | None:
        """The point of the piece at distance ``s`` along the tangent of ``point``."""
        y = point.y.copy()
        y.axpy(s, point.tangent)
        if self.corrector.pseudo_arclength(y, point.y, point.tangent, s, point.piece):
            return y
        y.destroy()
        return None

    def _distances(self, y: PETSc.Vec, piece: Piece) -> np.ndarray:
        x, gamma = self.bordered.split(y)
        return self.system.events(x, gamma, piece).distance

    def _unit(self, y: PETSc.Vec, piece: Piece) -> float:
        """The largest distance so far: at a degenerate point all distances vanish. Collective."""
        largest = float(np.max(np.abs(self._distances(y, piece)), initial=self._largest_distance))
        self._largest_distance = float(self.bordered.comm.allreduce(largest, op=max))
        return self._largest_distance or 1.0

    def _least_distance(self, point: BranchPoint) -> float:
        """The least event distance if it is beyond round-off, else 0. Collective."""
        distance = self._distances(point.y, point.piece)
        least = self.bordered.comm.allreduce(float(np.min(distance, initial=np.inf)), op=min)
        return least if least < -_AT_BORDER * self._unit(point.y, point.piece) else 0.0

    def _to_the_border(
        self, point: BranchPoint, h: float
    ) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        """Go to the first event between ``point`` and the step ``h``, and cross it."""
        b, comm = self.bordered, self.bordered.comm
        d_low = self._distances(point.y, point.piece)
        s_low, s_high = 0.0, h
        y_high = self._along(point, h)
        if y_high is None:
            return None, [], h
        d_high = self._distances(y_high, point.piece)
        y, s = y_high, h
        for _ in range(60):
            # The first zero if distances were linear between the two ends.
            falling = d_high < 0
            slope = np.where(falling, np.maximum(d_low, 0.0) - d_high, 1.0)
            fraction = np.where(falling, np.maximum(d_low, 0.0) / slope, np.inf)
            first = comm.allreduce(float(np.min(fraction, initial=np.inf)), op=min)
            s = s_low + first * (s_high - s_low)
            y_new = self._along(point, s)
            if y_new is None:
                return None, [], h
            y = y_new
            d = self._distances(y, point.piece)
            unit = self._unit(y, point.piece)
            least = comm.allreduce(float(np.min(d, initial=np.inf)), op=min)
            if abs(least) <= 1e-13 * unit or s_high - s_low <= 1e-15 * h:
                break
            if least < 0:
                s_high, d_high = s, d
            else:
                s_low, d_low = s, d
        tangent = self.corrector.tangent(y, point.tangent, point.piece)
        if tangent is None:
            return None, [], h
        taken = self.corrector.iterations
        here = BranchPoint(y, tangent, point.piece, b.gamma(y), s, taken, self._test())
        special = self._smooth_points(point, here)
        tolerance = _AT_BORDER * self._unit(y, point.piece)
        crossing = cross(self.corrector, y, point.piece, tangent, tolerance)
        onwards = crossing.onwards
        if onwards is None:
            tried = "all pieces were tried" if crossing.complete else "too many pieces to try"
            self._dead_end = (
                f"no way on was found from gamma = {here.gamma:.10g}, where {crossing.kinks} "
                f"points are at a kink at once ({tried})"
            )
            special.append(SpecialPoint("end", False, here.gamma, y, 0, complete=crossing.complete))
            return here, special, h
        turned = self._turned(tangent, onwards.tangent)
        kind = "bifurcation" if crossing.others else "fold" if turned else "event"
        special.append(
            SpecialPoint(
                kind,  # type: ignore[arg-type]
                False,
                here.gamma,
                y,
                0,
                crossing.changes,
                crossing.parity,
                crossing.others,
                crossing.complete,
                Ray(point.piece, tangent),
                onwards,
                crossing.method,
            )
        )
        new = BranchPoint(y, onwards.tangent, onwards.piece, here.gamma, s, here.corrections)
        return self._rescaled(new), special, h

    def _turned(self, t: PETSc.Vec, new: PETSc.Vec) -> bool:
        """Whether gamma turns back between two tangents."""
        a, c = self.bordered.gamma(t), self.bordered.gamma(new)
        return a * c < 0 and min(abs(a), abs(c)) > 1e-9 * self.bordered.gamma_scale

    def _smooth_points(self, point: BranchPoint, new: BranchPoint) -> list[SpecialPoint]:
        """Folds and bifurcations between two points of a piece, in order."""
        b, special = self.bordered, []
        if self._turned(point.tangent, new.tangent):
            slopes = b.gamma(point.tangent), b.gamma(new.tangent)
            found = self._locate(point, new.y, slopes, lambda _y, t: b.gamma(t))
            if found is not None:
                special.append(
                    (found[0], SpecialPoint("fold", True, b.gamma(found[1]), found[1], 0))
                )
        if point.tau * new.tau < 0:
            found = self._locate(point, new.y, (point.tau, new.tau), lambda _y, _t: self._test())
            if found is not None:
                kernel = self._test.kernel()
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

    def _locate(
        self,
        point: BranchPoint,
        y_high: PETSc.Vec,
        values: tuple[float, float],
        function: Callable[[PETSc.Vec, PETSc.Vec], float],
    ) -> tuple[float, PETSc.Vec] | None:
        """Where between ``point`` and ``y_high`` a function of y and tangent vanishes.

        ``function`` is called when J at the point has been factorised; ``values`` are those at the
        ends. Secant steps; an end that stays twice counts half (Illinois), so that the bracket
        shrinks from both sides. Every point is corrected from the line between the ends of the
        bracket (at first a parabola), whose distance from the branch falls with its square: so none
        is found on another branch that crosses nearby.
        """
        b, y_low = self.bordered, point.y
        end = b.inner(point.tangent, y_high) - b.inner(point.tangent, y_low)
        low, high, (f_low, f_high) = 0.0, end, values
        y, s, f, side = None, 0.0, np.inf, 0
        for _ in range(100):
            fraction = -f_low / (f_high - f_low)
            s = low + fraction * (high - low)
            found = y_low.copy()
            if side == 0:  # a parabola, whose tangent at the start is known
                found.axpy(s - end * fraction**2, point.tangent)
                found.axpy(fraction**2, y_high - y_low)
            else:
                found.axpy(fraction, y_high - y_low)
            if not self.corrector.pseudo_arclength(found, point.y, point.tangent, s, point.piece):
                break
            tangent = self.corrector.tangent(found, point.tangent, point.piece)
            if tangent is None:
                break
            y, f = found, function(found, tangent)
            if not np.isfinite(f):
                break
            if abs(f) <= 1e-12 * max(abs(v) for v in values) or high - low <= 1e-13 * abs(end):
                break
            if f * f_low > 0:
                low, f_low, y_low, f_high = s, f, y, f_high / (2 if side < 0 else 1)
                side = -1
            else:
                high, f_high, y_high, f_low = s, f, y, f_low / (2 if side > 0 else 1)
                side = 1
        # A change of sign through infinity is no zero.
        return (s, y) if y is not None and abs(f) < 1e-3 * min(abs(v) for v in values) else None

    def _rescaled(self, point: BranchPoint) -> BranchPoint:
        """The point once the scale of x has been taken from the first tangent that moves it."""
        b = self.bordered
        if b.x_scale == 0.0:
            b.set_scale(point.tangent)
        point.tangent.scale(1.0 / np.sqrt(b.inner(point.tangent, point.tangent)))
        if b.x_scale_is_new or np.isnan(point.tau):
            # Another border row, another test function.
            b.x_scale_is_new = False
            self.corrector.tangent(point.y, point.tangent, point.piece)
            return replace(point, tau=self._test(accepted=True))
        return point

    def _end_at(self, point: BranchPoint, new: BranchPoint, gamma: float) -> BranchPoint:
        """The point between ``point`` and ``new`` at which gamma has the given value."""
        b = self.bordered
        y = point.y.copy()
        y.axpy((gamma - point.gamma) / (new.gamma - point.gamma), new.y - point.y)
        if not self.corrector.natural(y, gamma, point.piece):
            return new
        return BranchPoint(y, new.tangent, point.piece, b.gamma(y), new.step, new.corrections)

    def _require_parameter(self, y: PETSc.Vec, piece: Piece) -> None:
        x, gamma = self.bordered.split(y)
        c, probe, size = self.system.create_vector(), self.system.probe(3), 0.0
        # It may vanish at one gamma, or on the branch, without being absent.
        probe.scale((1e-3 * x.norm() or 1e-8) / probe.norm())
        probe.axpy(1.0, x)
        for state, shift in ((x, 0.0), (x, 1e-3), (x, -1e-3), (probe, 0.0)):
            at = gamma + shift * self.bordered.gamma_scale
            self.system.parameter_derivative(state, at, c, piece)
            size += float(np.nan_to_num(c.norm(), nan=0.0))
        c.destroy()
        probe.destroy()
        if not size > 0:
            raise ValueError("gamma does not appear in H: its derivative by gamma vanishes")


def _all(a: bool, b: bool) -> bool:
    return a and b
