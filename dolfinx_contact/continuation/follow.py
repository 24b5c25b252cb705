# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following a branch of H(x, gamma) = 0 through kinks and folds.

The branch is followed by predictor and corrector, from kink to kink (`steps.py`), several kinks at
a time (`batch.py`) or by stepping over each (`passage.py`).
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from itertools import pairwise
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._validate import one_of, positive
from dolfinx_contact.continuation.arguments import (
    check_listeners,
    check_states,
    check_steps,
    check_system,
    check_vectors,
    checked_gamma,
    checked_range,
    require_smooth,
    samples_of,
)
from dolfinx_contact.continuation.batch import BatchedSteps, Locate
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import (
    Branch,
    BranchPoint,
    FoundRays,
    Ray,
    SpecialPoint,
)
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.observer import BranchStep, Observer, ObserverLike, Stepping, Stop
from dolfinx_contact.continuation.parameters import Direction, StepControl, sign_of
from dolfinx_contact.continuation.passage import SteppingSteps
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.continuation.ray_finder import (
    Kink,
    finder_at,
    kinks_at,
    rays_out,
    reach_of_events,
)
from dolfinx_contact.continuation.steps import AT_BORDER, ExactSteps
from dolfinx_contact.continuation.system import (
    Piece,
    System,
)
from dolfinx_contact.continuation.walk import Next, Walk, Walker, onwards_from

__all__ = ["Follower", "Route", "follow", "follower_for"]

Route: TypeAlias = Literal["auto", "pivoting", "steps"]

logger = logging.getLogger(__name__)

_HAIR = 1e-9  # of the scale of gamma: beside a gamma at which borders begin
_HOP = 1e-6  # of the scale of gamma, over a kink of the data
_BESIDE = 0.1  # of the length of a step, the distance from its start at which a branch closes
_ASIDE = 1e-3  # length of the first step along a ray out of a bifurcation
_FURTHER = 4.0  # times the length by the slopes on both sides: no continuous branch


def _check(a: Arguments) -> None:
    check_system(a.system)
    a.gamma = checked_gamma(a.gamma)
    a.gamma_range = checked_range(a.gamma_range, [a.gamma])
    sign_of(a.direction)
    check_vectors([a.x], "x")
    check_steps(a.control, a.max_steps)
    check_listeners(observer=a.observer, record=a.record, progress=a.progress, stop=a.stop)


@collective("follow", _check)
def follow(
    system: System,
    x: PETSc.Vec,
    gamma: float,
    *,
    gamma_range: tuple[float, float],
    direction: Direction = "increasing",
    control: StepControl | None = None,
    max_steps: int = 1000,
    route: Route = "auto",
    stop: Stop[BranchStep] | None = None,
    observer: ObserverLike[BranchStep] | None = None,
    record: Observer | None = None,
    progress: bool | None = None,
) -> Branch:
    """Follow the branch through (x, gamma) until gamma leaves its range.

    Args:
        system: H with its pieces.
        x: approximate solution at ``gamma``. It is corrected at fixed gamma;
            `Branch.start_correction` reports the change.
        gamma: where to start.
        gamma_range: the branch ends where gamma reaches either end.
        direction: in which gamma goes at the start, ``"increasing"`` or ``"decreasing"``.
        control: step lengths.
        max_steps: budget; when it is exhausted what was found is returned, with the reason.
        route: see `follower_for`.
        stop: called with every accepted step, its point and the special points on the way to it:
            it returns the reason to end the branch there, or "" to continue. The problem is in the
            state of the point then: its Functions, statuses, gamma and what gamma drives are those
            of the point (`System.put`). It is not called where the branch ends by itself.
        observer: a function that is called likewise with every step, start and end included, or an
            `Observer`, which is given more.
        record: keeps every point before the observer is called, as `records.BranchRecord` does.
        progress: whether rank 0 shows the progress on the standard error stream; by default once it
            takes more than some seconds.

    Returns:
        Points and special points, and why the branch ended.

    Raises:
        ValueError: on every rank, if an argument does not fit or differs between ranks, the range
            is empty or does not contain ``gamma``, gamma does not appear in H or leaves its range
            at once, no solution is found near the start, or H has kinks within its pieces, as where
            those of a bulk are.
    """
    check_states(system, [x], "x")
    low, high = gamma_range
    system.check_parameter(samples_of(low, high))
    scale = high - low
    with (
        system.restored(),
        follower_for(system, x, gamma, control, gamma_scale=scale, route=route) as follower,
    ):
        start = follower.start(x, gamma, direction=direction)
        branch = follower.run(
            start,
            gamma_range=(low, high),
            max_steps=max_steps,
            stop=stop,
            observer=observer,
            record=record,
            progress=progress,
        )
        branch.start_correction = follower.correction(x, start)
        return branch


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
        ValueError: if the pieces are not affine and pivoting is required, the scale of gamma is
            not positive, or H is not smooth on its pieces: folds, events and branch points are not
            distinguished from kinks there.
    """
    require_smooth(system)
    positive(gamma_scale, "gamma_scale")
    one_of(route, "route", ("auto", "pivoting", "steps"))
    if route != "steps" and system.is_piecewise_affine:
        condensed = system.condensed(x, gamma)
        if condensed is not None:
            return Pivoting(system, condensed, gamma_scale=gamma_scale)
    if route == "pivoting":
        raise ValueError("the pieces of this system are not affine: pivoting cannot follow it")
    return Follower(system, control or StepControl(), gamma_scale=gamma_scale)


class Follower(Walker):
    """Follows branches of one system; holds the bordered matrix and the corrector.

    Args:
        system: what is followed.
        control: step lengths, and how kinks are passed.
        gamma_scale: size of gamma that counts as 1.
        locate: see `BatchedSteps`.
    """

    def __init__(
        self,
        system: System,
        control: StepControl,
        *,
        gamma_scale: float,
        locate: Locate | None = None,
    ):
        self.system = system
        self.control = control
        self.bordered = Bordered(system, gamma_scale=gamma_scale)
        self.corrector = Corrector(self.bordered, control)
        self._steps = _steps(self.corrector, locate)

    def __enter__(self) -> Follower:
        return self

    def __exit__(self, *_: object) -> None:
        self._steps.destroy()
        self.corrector.destroy()
        self.bordered.destroy()

    def start(
        self, x: PETSc.Vec, gamma: float, *, direction: Direction = "increasing"
    ) -> BranchPoint:
        """The point of the branch near (x, gamma), with its tangent.

        Where pieces meet there it is that of a ray that leads out: in the piece of the state if
        it has one, else the straightest of all.

        Raises:
            ValueError: if there is none, gamma does not appear in H, it does not go in the
                direction on any ray, or the direction is unknown.
        """
        sign = sign_of(direction)
        point = self._tangent_at(x, gamma, sign)
        kinks, _ = self._kinks(point)
        if not kinks or self._leads_out(point, kinks):
            return point
        found = self.rays_at(point)
        return point if found is None else onwards_from(self.bordered, point, found, sign)

    def departures(self, x: PETSc.Vec, gamma: float) -> FoundRays[BranchPoint]:
        passing = []
        for sign in (1.0, -1.0):
            point = self._tangent_at(x, gamma, sign)
            found = self.rays_at(point)
            if found is not None and (found.rays or found.complete):
                return found
            passing.append(point)
        return FoundRays(tuple(passing), complete=found is None)

    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        kinks, tolerance = self._kinks(point)
        if not kinks:
            return None
        y, t, piece = point.y, point.tangent, point.piece
        found = rays_out(self.corrector, y, piece, t, kinks, tolerance)
        points = []
        for ray in found.rays:
            leaving = BranchPoint(y.copy(), ray.tangent, ray.piece, point.gamma, 0.0, 0)
            points.append(self._steps.rescaled(leaving))
        return FoundRays(tuple(points), found.complete, found.method)

    def _kinks(self, point: BranchPoint) -> tuple[tuple[Kink, ...], float]:
        """Contact points at a border, and the distance that counts as zero. Collective."""
        tolerance = AT_BORDER * reach_of_events(self.corrector, point.y, point.piece, point.tangent)
        return kinks_at(self.corrector, point.y, point.piece, tolerance), tolerance

    def _leads_out(self, point: BranchPoint, kinks: tuple[Kink, ...]) -> bool:
        """Whether the tangent of a point leads over none of the borders there. Collective."""
        finder = finder_at(self.corrector, point.y, kinks, idle=True)
        return finder.inside(Ray(point.piece, point.tangent))

    def _tangent_at(self, x: PETSc.Vec, gamma: float, sign: float) -> BranchPoint:
        """The solution near (x, gamma) with the tangent of its piece. Collective."""
        b = self.bordered
        y = b.vector()
        b.join(x, gamma, y)
        piece = self._piece_from(y, sign)
        self._require_parameter(y, piece)
        if not self.corrector.natural(y, gamma, piece):
            raise ValueError(f"no solution near the given state was found at gamma = {gamma}")
        sense = b.last_unit()
        sense.scale(sign * b.gamma_scale)
        tangent = self.corrector.tangent(y, sense, piece)
        if tangent is None:
            raise ValueError("the start is a singular point: its tangent is not unique")
        sense.destroy()
        return self._steps.rescaled(BranchPoint(y, tangent, piece, b.gamma(y), 0.0, 0))

    def _piece_from(self, y: PETSc.Vec, sign: float) -> Piece:
        """The piece on which a branch leaves ``y``. Collective.

        Where borders begin at this very gamma (friction that grows from zero) that at ``y`` is one
        of several, which it does not show: then the piece just beyond.
        """
        x, gamma = self.bordered.split(y)
        piece = self.system.piece_at(x, gamma)
        beyond = gamma + sign * _HAIR * self.bordered.gamma_scale
        here, there = (len(self.system.events(x, g, piece).point) for g in (gamma, beyond))
        begin = self.system.comm.allreduce(int(there > here), op=max)
        return self.system.piece_at(x, beyond) if begin else piece

    def branch_off(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """A point from which to follow one of the other rays of a special point.

        It lies at a small distance along the ray. Where the piece of the ray ends before that it is
        the nonsmooth point itself, at which the tangent of the ray is exact.

        Raises:
            ValueError: if no solution is found there.
        """
        try:
            aside = self._aside(special, ray)
        except ValueError:
            if special.smooth:
                raise
            aside = None
        if aside is not None and (special.smooth or not self._steps.is_outside(aside)):
            return aside
        here = BranchPoint(special.y.copy(), ray.tangent, ray.piece, special.gamma, 0.0, 0)
        return self._steps.rescaled(here)

    def _aside(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """The point at a small distance along a ray. Collective."""
        b = self.bordered
        y = special.y.copy()
        t = ray.tangent.copy()
        y.axpy(_ASIDE, ray.tangent)
        if not self.corrector.pseudo_arclength(y, special.y, ray.tangent, _ASIDE, ray.piece):
            raise ValueError("no solution was found along the ray")
        tangent = self.corrector.tangent(y, t, ray.piece)
        if tangent is None:
            raise ValueError("the branch is singular beside the bifurcation")
        t.destroy()
        return self._steps.rescaled(BranchPoint(y, tangent, ray.piece, b.gamma(y), _ASIDE, 0))

    def _walk(
        self,
        start: BranchPoint,
        origin: BranchPoint,
        gamma_range: tuple[float, float],
        stepping: Stepping | None,
    ) -> Walk:
        length = self.control.initial if stepping is None else stepping.next_step
        return _Corrected(self, self._steps, origin, gamma_range, length)

    def beyond_kink(
        self, point: BranchPoint, gamma_range: tuple[float, float]
    ) -> BranchPoint | None:
        """The branch just beyond a kink of the data in gamma, at which steps end. Collective.

        None if there is none, or it does not continue the branch with the same statuses.
        """
        b = self.bordered
        slope = self.bordered.gamma(point.tangent)
        if not self.system.kinks_in_gamma or slope == 0:
            return None
        low, high = gamma_range
        # The kink lies within the shortest step that failed.
        control = self.control
        failed = control.minimum / control.decrease * abs(slope)
        hop = math.copysign(max(_HOP * b.gamma_scale, failed), slope)
        gamma = min(max(point.gamma + hop, low), high)
        if gamma == point.gamma:
            return None
        try:
            direction: Direction = "increasing" if slope > 0 else "decreasing"
            new = self.start(b.split(point.y)[0], gamma, direction=direction)
        except ValueError as error:
            logger.info("no way beyond gamma = %g: %s", point.gamma, error)
            return None
        moved = new.y - point.y
        onwards = b.gamma(new.tangent)
        distance = math.sqrt(b.inner(moved, moved))
        moved.destroy()
        most = abs(gamma - point.gamma) * (1 / abs(slope) + 1 / abs(onwards)) if onwards else 0.0
        same = bool(np.array_equal(new.piece.codes, point.piece.codes))
        same = b.comm.allreduce(same, op=MPI.LAND)
        if same and distance <= _FURTHER * most:
            return new
        self.corrector.reject()
        return None

    def restore(self, stepping: Stepping) -> None:
        """Know again what was known at a point that was followed to before."""
        self.bordered.x_scale = stepping.x_scale
        self._steps.largest_distance = stepping.largest_distance

    def is_closed(self, start: BranchPoint, point: BranchPoint, new: BranchPoint) -> bool:
        """Whether the step from ``point`` to ``new`` passes the start in the sense of the start."""
        b = self.bordered
        comm = self.bordered.comm
        same = bool(np.array_equal(start.piece.codes, point.piece.codes))
        if point is start or not comm.allreduce(same, op=MPI.LAND):
            return False
        chord = new.y - point.y
        back = start.y - point.y
        square = b.inner(chord, chord)
        part = b.inner(back, chord) / square
        if not -_HAIR <= part <= 1:
            return False
        # The parabola through both points, with the tangent of the first.
        onwards = point.tangent.copy()
        onwards.scale(math.sqrt(square))
        bend = chord - onwards
        back.axpy(-part, onwards)
        back.axpy(-(part**2), bend)
        onwards.axpy(2 * part, bend)
        slope = b.inner(onwards, start.tangent) / math.sqrt(b.inner(onwards, onwards))
        return b.inner(back, back) <= _BESIDE**2 * square and slope > self.control.cosine

    def at(self, branch: Branch, gamma: float, *, skip_missing: bool = False) -> list[BranchPoint]:
        """The points of ``branch`` at which its parameter is ``gamma``, in order.

        Between two points of the branch, or a point and a smooth fold, gamma is taken to pass a
        value once.

        Args:
            branch: of the system.
            gamma: parameter.
            skip_missing: whether points that are not found are left out.

        Raises:
            RuntimeError: on every rank, for a point that is not found, unless ``skip_missing``.
        """
        b = self.bordered
        found = []
        for a, c in pairwise(_with_folds(branch)):
            if a.gamma == gamma:
                found.append(a)
            elif (a.gamma - gamma) * (c.gamma - gamma) < 0:
                values = a.gamma - gamma, c.gamma - gamma
                piece = self._steps.piece_between(a, c)
                # Along the secant: the tangent that a point keeps may be that of the piece before.
                secant = c.y - a.y
                secant.scale(1.0 / math.sqrt(b.inner(secant, secant)))
                located = self._steps.locate(
                    replace(a, tangent=secant),
                    c.y,
                    values,
                    lambda y, _t: b.gamma(y) - gamma,
                    piece=piece,
                )
                secant.destroy()
                if located is None or not self.corrector.natural(located[1], gamma, piece):
                    if skip_missing:
                        continue
                    raise RuntimeError(
                        f"the point at gamma = {gamma:.10g}, between {a.gamma:.10g} and "
                        f"{c.gamma:.10g}, was not found: follow the branch in shorter steps there"
                    )
                s, y = located
                there = piece or self.system.piece_at(*b.split(y))
                found.append(BranchPoint(y, a.tangent, there, gamma, s, 0))
        if branch.points[-1].gamma == gamma:
            found.append(branch.points[-1])
        return found

    def _require_parameter(self, y: PETSc.Vec, piece: Piece) -> None:
        x, gamma = self.bordered.split(y)
        c = self.system.create_vector()
        probe = self.system.probe(3)
        size = 0.0
        # It may vanish at one gamma, or on the branch, without being absent.
        probe.scale((1e-3 * x.norm() or 1e-8) / probe.norm())
        probe.axpy(1.0, x)
        for state, shift in ((x, 0.0), (x, 1e-3), (x, -1e-3), (probe, 0.0)):
            at = gamma + shift * self.bordered.gamma_scale
            self.system.parameter_derivative(state, at, c, piece)
            size += float(np.nan_to_num(c.norm(), nan=0.0))
        c.destroy()
        probe.destroy()
        if not size > 0:  # it may decide on the borders of the piece alone
            at = gamma + 1e-3 * self.bordered.gamma_scale
            here, there = (self.system.events(x, g, piece).distance for g in (gamma, at))
            moved = len(here) != len(there) or bool(np.any(here != there))
            size = float(self.system.comm.allreduce(int(moved)))
        if not size > 0:
            where = self.system.kinks_in_gamma
            raise ValueError(
                f"the derivative of H by gamma vanishes here; {where}"
                if where
                else "gamma does not appear in H: its derivative by gamma vanishes"
            )


def _with_folds(branch: Branch) -> list[BranchPoint]:
    """The points of a branch, and its smooth folds, which lie between two of them."""
    folds = [s for s in branch.special if s.kind == "fold" and s.smooth]
    points: list[BranchPoint] = []
    for number, point in enumerate(branch.points):
        for fold in folds:
            if fold.index == number and number > 0 and fold.gamma != point.gamma:
                points.append(replace(points[-1], y=fold.y, gamma=fold.gamma))
        points.append(point)
    return points


class _Corrected(Walk):
    """A branch by predictor and corrector.

    Args:
        follower: of the system.
        steps: its steps.
        origin: where the branch begins, and may close.
        gamma_range: in which it is followed.
        length: of the next step.
    """

    def __init__(
        self,
        follower: Follower,
        steps: ExactSteps,
        origin: BranchPoint,
        gamma_range: tuple[float, float],
        length: float,
    ):
        self._follower = follower
        self._steps = steps
        self._origin = origin
        self._range = gamma_range
        self._length = length

    def advance(self, branch: Branch, point: BranchPoint) -> Next | None:
        follower = self._follower
        low, high = self._range
        new, special, self._length = self._steps.step(point, self._length)
        if new is None:
            new = follower.beyond_kink(point, self._range)
            special = []
            self._length = follower.control.initial
        if new is None:
            reason = f"no step of at least {follower.control.minimum:g} succeeds"
            if follower.system.kinks_in_gamma:
                reason += f"; {follower.system.kinks_in_gamma}"
            branch.end(Ending.NOT_SOLVED, reason)
            return None
        node = any(s.kind == "bifurcation" for s in special)
        if not node and follower.is_closed(self._origin, point, new):
            new = self._origin
            special = [s for s in special if s.smooth]
            branch.end(Ending.CLOSED)
        elif not low <= new.gamma <= high:
            new, special = self._steps.end_at(point, new, special, self._range)
            if not low <= new.gamma <= high:
                where = "the point at the end of the range of gamma was not solved for"
                branch.end(Ending.NOT_SOLVED, where)
                return None
            branch.end(Ending.REACHED)
        if any(s.kind == "end" for s in special):
            branch.end(Ending.NOT_FOUND, self._steps.dead_end)
        return new, special

    def stepping(self, index: int) -> Stepping:
        scale = self._follower.bordered.x_scale
        return Stepping(index, self._length, scale, self._steps.largest_distance)


def _steps(corrector: Corrector, locate: Locate | None) -> ExactSteps:
    """Steps that pass kinks as `StepControl.kinks` selects."""
    system = corrector.bordered.system
    kinks = corrector.control.kinks
    if kinks is None:
        kinks = "batched" if system.has_many_pieces else "exact"
    if kinks == "batched":
        return BatchedSteps(corrector, locate)
    if locate is not None:
        raise ValueError(f"kinks that are {kinks} leave nothing to locate: only batched ones do")
    return ExactSteps(corrector) if kinks == "exact" else SteppingSteps(corrector)
