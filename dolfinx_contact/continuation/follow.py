# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tracing of solution branches of H(x, gamma) = 0 through kinks and folds.

Branches of systems with affine pieces are traced from vertex to vertex (`pivoting.py`), all others
by predictor and corrector (`steps.py`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal, TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._ending import OTHER_CAUSE, Ending
from dolfinx_contact._mpi import Arguments, collective, require, same_everywhere
from dolfinx_contact._validate import number, one_of, positive
from dolfinx_contact.continuation.arguments import (
    check_listeners,
    check_states,
    check_steps,
    check_system,
    checked_range,
    require_smooth,
    samples_of,
)
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import (
    Branch,
    BranchPoint,
    FoundRays,
    Ray,
    SpecialPoint,
)
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.locate import AT_BORDER
from dolfinx_contact.continuation.observer import (
    BranchStep,
    Observer,
    ObserverLike,
    Stepping,
    Stop,
)
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.continuation.ray_finder import KinkRayFinder
from dolfinx_contact.continuation.step_control import Direction, StepControl, sign_of
from dolfinx_contact.continuation.steps import (
    BatchedSteps,
    ExactSteps,
    Locate,
    SteppingSteps,
)
from dolfinx_contact.continuation.system import (
    Piece,
    ResidualScales,
    System,
)
from dolfinx_contact.continuation.tracing import Next, Tracer

__all__ = ["Follower", "Route", "follow", "follower_for", "points_at", "require_solutions"]

Route: TypeAlias = Literal["auto", "pivoting", "steps"]

logger = logging.getLogger(__name__)

_ALLOWED = 1e-6  # relative residual of a solution
_HAIR = 1e-9  # shift of gamma to detect borders that begin at gamma, relative to its scale
_HOP = 1e-6  # change of gamma across a kink of the data, relative to the scale of gamma
_BESIDE = 0.1  # largest distance from the start of a closed branch, relative to the step length
_ASIDE = 1e-3  # length of the first step along a ray out of a bifurcation
_FURTHER = 4.0  # largest distance across a kink of the data, relative to its prediction by slopes


def _check(a: Arguments) -> None:
    check_system(a.system)
    a.gamma = number(a.gamma, "gamma")
    a.gamma_range = checked_range(a.gamma_range, [a.gamma])
    sign_of(a.direction)
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
    """Trace the branch through (x, gamma) until gamma leaves its range. Collective.

    Args:
        system: H with its pieces.
        x: approximate solution at ``gamma``, corrected at fixed gamma; `Branch.start_correction`
            reports the change.
        gamma: parameter at the start.
        gamma_range: range of gamma, at whose ends the branch ends.
        direction: direction of gamma at the start, ``"increasing"`` or ``"decreasing"``.
        control: step lengths.
        max_steps: largest number of steps, after which the incomplete branch is returned.
        route: ``"pivoting"`` from vertex to vertex of affine pieces; ``"steps"`` by predictor and
            corrector; ``"auto"`` by pivoting where possible.
        stop: function of every accepted step returning the reason to end the branch there, or "" to
            continue. During the call the problem is in the state of the point: Functions, statuses,
            gamma and data driven by gamma (`System.put`). The function is not called for the last
            point of a branch that ends for another reason.
        observer: function of every step, start and end included, or an `Observer`.
        record: observer storing every point before ``observer`` is called, such as a
            `records.BranchRecord`.
        progress: True to show the progress on the standard error stream of rank 0; by default after
            some seconds.

    Returns:
        Points, special points, and the reason for the end of the branch.

    Raises:
        ValueError: on every rank, if an argument is invalid or differs between ranks, if H does not
            depend on gamma, if gamma leaves its range immediately, if no solution is found near the
            start, or if H has kinks within its pieces.
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
) -> Tracer:
    """Return the object that traces branches of a system. Collective.

    Args:
        system: piecewise smooth system H(x, gamma) = 0.
        x: state at ``gamma``.
        gamma: parameter.
        control: step lengths of predictor and corrector.
        gamma_scale: unit of gamma in the lengths of steps.
        route: ``"pivoting"`` traces systems that are affine for fixed statuses from one change of
            status to the next; ``"steps"`` uses predictor and corrector; ``"auto"`` (default) uses
            pivoting where possible.

    Raises:
        ValueError: if the scale of gamma is not positive, H has kinks where no status changes, or
            pivoting is requested for a system that is not affine for fixed statuses.
    """
    require_smooth(system)
    positive(gamma_scale, "gamma_scale")
    one_of(route, "route", ("auto", "pivoting", "steps"))
    if route != "steps" and system.is_piecewise_affine:
        condensed = system.condensed(x, gamma)
        if condensed is not None:
            return Pivoting(system, condensed, gamma_scale=gamma_scale)
    if route == "pivoting":
        raise ValueError("the pieces of this system are not affine: pivoting is not applicable")
    return Follower(system, control or StepControl(), gamma_scale=gamma_scale)


class Follower(Tracer):
    """Predictor-corrector tracing of the branches of one system. All methods are collective.

    Args:
        system: piecewise smooth system H(x, gamma) = 0.
        control: step lengths, and the policy for kinks.
        gamma_scale: unit of gamma in the lengths of steps.
        locate: function of a `Change` that returns True if batched steps must locate it, in
            addition to folds and points where the sign of the determinant changes; default: none.
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
        self.first_step = self.next_step = control.initial
        kinks = control.kinks or ("batched" if system.has_many_pieces else "exact")
        if locate is not None and kinks != "batched":
            raise ValueError(f"kinks={kinks!r} leaves nothing to locate: use kinks='batched'")
        self._steps = (
            BatchedSteps(self.corrector, locate)
            if kinks == "batched"
            else {"exact": ExactSteps, "stepping": SteppingSteps}[kinks](self.corrector)
        )

    # -- where branches start --------------------------------------------------------------------

    def _point_at(self, x: PETSc.Vec, gamma: float, sign: float) -> BranchPoint:
        b = self.bordered
        y = b.joined(x, gamma)
        piece = self._piece_from(y, sign)
        self._require_parameter(y, piece)
        if not self.corrector.natural(y, gamma, piece):
            raise ValueError(f"no solution near the given state was found at gamma = {gamma}")
        tangent = self.corrector.tangent(y, b.last_unit(sign * b.gamma_scale), piece)
        if tangent is None:
            raise ValueError("the start is a singular point: its tangent is not unique")
        return self._steps.rescaled(BranchPoint(y, tangent, piece, b.gamma(y)))

    def _piece_from(self, y: PETSc.Vec, sign: float) -> Piece:
        """Return the piece of H (statuses of all points) on which a branch leaves a point.

        It is the piece determined by the state. However, if another change of status becomes
        possible just beyond the present gamma, as with a friction coefficient that grows from zero,
        the piece just beyond this gamma is used.

        Args:
            y: point (x, gamma).
            sign: direction of gamma, 1 or -1.
        """
        x, gamma = self.bordered.split(y)
        piece = self.system.piece_at(x, gamma)
        beyond = gamma + sign * _HAIR * self.bordered.gamma_scale
        now, then = (len(self.system.events(x, g, piece).point) for g in (gamma, beyond))
        return self.system.piece_at(x, beyond) if self.bordered.anywhere(then > now) else piece

    def _require_parameter(self, y: PETSc.Vec, piece: Piece) -> None:
        """Raise ``ValueError`` unless H or the borders of ``piece`` depend on gamma near ``y``."""
        system = self.system
        x, gamma = self.bordered.split(y)
        c = system.create_vector()
        # the derivative may vanish at one gamma, or on the branch, although gamma appears
        probe = system.probe(3)
        probe = self.bordered.moved(x, (1e-3 * x.norm() or 1e-8) / probe.norm(), probe)
        shift = 1e-3 * self.bordered.gamma_scale
        for state, g in ((x, gamma), (x, gamma + shift), (x, gamma - shift), (probe, gamma)):
            system.parameter_derivative(state, g, c, piece)
            if c.norm() > 0:
                return
        # gamma may appear in the borders of the piece only
        low, high = (system.events(x, g, piece).distance for g in (gamma, gamma + shift))
        if self.bordered.anywhere(not np.array_equal(low, high)):
            return
        raise ValueError("gamma does not appear in H: dH/dgamma vanishes")

    def _leads_out(self, point: BranchPoint) -> bool:
        finder = self._finder(point)
        return not finder.kinks or finder.inside(Ray(point.piece, point.tangent))

    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        finder = self._finder(point)
        if not finder.kinks:
            return None
        found = finder.rays_out(point.tangent)
        points = (
            BranchPoint(point.y.copy(), ray.tangent, ray.piece, point.gamma) for ray in found.rays
        )
        return FoundRays(tuple(map(self._steps.rescaled, points)), found.complete, found.method)

    def _finder(self, point: BranchPoint) -> KinkRayFinder:
        """Return the search for outgoing rays at a point where a branch starts or ends."""
        b = self.bordered
        events, rates = b.events_along(point.y, point.piece, point.tangent)
        # at a start without load all distances vanish, but the rates do not
        tolerance = AT_BORDER * max(b.largest(events.distance), b.largest(rates))
        return KinkRayFinder(self.corrector, point.y, point.piece, tolerance, idle=True)

    def branch_off(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """Return a point from which to trace a ray that a branch has not taken.

        The point lies at a small distance along the ray. If a status changes within this distance,
        the nonsmooth point itself is returned, at which the tangent of the ray is exact.

        Raises:
            ValueError: if no solution is found there.
        """
        try:
            aside = self._aside(special, ray)
            if special.smooth or not self._steps.is_outside(aside):
                return aside
        except ValueError:
            if special.smooth:
                raise
        kink = BranchPoint(special.y.copy(), ray.tangent, ray.piece, special.gamma)
        return self._steps.rescaled(kink)

    def _aside(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """Return the point at a small distance along a ray."""
        y = self.bordered.moved(special.y, _ASIDE, ray.tangent)
        if not self.corrector.pseudo_arclength(y, special.y, ray.tangent, _ASIDE, ray.piece):
            raise ValueError("no solution was found along the ray")
        tangent = self.corrector.tangent(y, ray.tangent, ray.piece)
        if tangent is None:
            raise ValueError("the branch is singular next to the bifurcation")
        point = BranchPoint(y, tangent, ray.piece, self.bordered.gamma(y), _ASIDE)
        return self._steps.rescaled(point)

    # -- along a branch --------------------------------------------------------------------------

    def _stepping(self, index: int) -> Stepping:
        return Stepping(
            index,
            self.next_step,
            self.bordered.x_scale,
            self._steps.largest_distance,
            self.corrector.scales,
        )

    def _resume(self, stepping: Stepping) -> None:
        super()._resume(stepping)
        self._steps.largest_distance = stepping.largest_distance
        self.corrector.scales = stepping.scales

    def _trace(
        self, branch: Branch, origin: BranchPoint, gamma_range: tuple[float, float]
    ) -> Iterator[Next]:
        low, high = gamma_range
        point = branch.points[-1]
        while branch.ending is None:
            # a step, or a hop over a kink of the data in gamma
            step = self._steps.step(point, self.next_step)
            if step is not None:
                new, special, self.next_step = step
            else:
                beyond = self._beyond_kink(point, gamma_range)
                if beyond is None:
                    length = f"no step of at least {self.control.minimum:g} succeeds"
                    branch.end(Ending.NOT_SOLVED, f"{length}{OTHER_CAUSE}")
                    return
                new = beyond
                special = []
                self.next_step = self.control.initial
            # where the branch ends
            node = any(s.kind == "bifurcation" for s in special)
            if not node and self._is_closed(origin, point, new):
                new = origin
                special = [s for s in special if s.smooth]
                branch.end(Ending.CLOSED)
            elif not low <= new.gamma <= high:
                new, special = self._steps.end_at(point, new, special, gamma_range)
                if not low <= new.gamma <= high:
                    reason = "the point at the end of the range of gamma was not solved for"
                    branch.end(Ending.NOT_SOLVED, reason)
                    return
                branch.end(Ending.REACHED)
            if any(s.kind == "end" for s in special):
                branch.end(Ending.NOT_FOUND, self._steps.dead_end)
            point = new
            yield new, special

    def _beyond_kink(
        self, point: BranchPoint, gamma_range: tuple[float, float]
    ) -> BranchPoint | None:
        """Return the point just beyond a gamma at which the data have a kink.

        None if the branch ends there. The branch continues if the statuses are the same on both
        sides, and the distance between the points is not larger than expected from the tangents.
        """
        b = self.bordered
        slope = b.gamma(point.tangent)
        if slope == 0:
            return None
        low, high = gamma_range
        # the kink lies within the shortest step that failed
        failed = self.control.minimum / self.control.decrease * abs(slope)
        hop = math.copysign(max(_HOP * b.gamma_scale, failed), slope)
        gamma = min(max(point.gamma + hop, low), high)
        if gamma == point.gamma:
            return None
        scales = self.corrector.scales
        try:
            direction: Direction = "increasing" if slope > 0 else "decreasing"
            new = self.start(b.split(point.y)[0], gamma, direction=direction)
        except ValueError as error:
            if b.comm.rank == 0:
                logger.info("no continuation beyond gamma = %g: %s", point.gamma, error)
            return None
        onwards = b.gamma(new.tangent)
        distance = b.length(new.y - point.y)
        most = abs(gamma - point.gamma) * (1 / abs(slope) + 1 / abs(onwards)) if onwards else 0.0
        if b.is_same_piece(new.piece, point.piece) and distance <= _FURTHER * most:
            return new
        self.corrector.scales = scales
        return None

    def _is_closed(self, start: BranchPoint, point: BranchPoint, new: BranchPoint) -> bool:
        """Return True if the step to ``new`` passes ``start`` in the direction of its tangent."""
        b = self.bordered
        if point is start or not b.is_same_piece(start.piece, point.piece):
            return False
        chord = new.y - point.y
        back = start.y - point.y
        square = b.inner(chord, chord)
        if square == 0:  # the previous step ended at the kink that this step crosses
            return False
        part = b.inner(back, chord) / square
        if not -_HAIR <= part <= 1:
            return False
        # the parabola through both points with the tangent of the first
        onwards = point.tangent.copy()
        onwards.scale(math.sqrt(square))
        bend = chord - onwards
        back.axpy(-part, onwards)
        back.axpy(-(part**2), bend)
        onwards.axpy(2 * part, bend)
        slope = b.inner(onwards, start.tangent) / b.length(onwards)
        return b.inner(back, back) <= _BESIDE**2 * square and slope > self.control.cosine

    def _between(self, a: BranchPoint, c: BranchPoint, gamma: float) -> BranchPoint | None:
        b = self.bordered
        piece = self._steps.piece_between(a, c)
        # along the secant, because the stored tangent of a point may belong to the previous piece
        secant = c.y - a.y
        secant.scale(1.0 / b.length(secant))
        located = self._steps.locate(
            replace(a, tangent=secant),
            c.y,
            (a.gamma - gamma, c.gamma - gamma),
            lambda y, _t: b.gamma(y) - gamma,
            piece=piece,
        )
        if located is None or not self.corrector.natural(located[1], gamma, piece):
            return None
        s, y = located
        own = piece or b.piece_at(y)
        return BranchPoint(y, a.tangent, own, gamma, s)


# -- points of a branch ----------------------------------------------------------------------------


def _check_points(a: Arguments) -> None:
    check_system(a.system)
    a.gamma = number(a.gamma, "gamma")
    a.gamma_range = checked_range(a.gamma_range, [a.gamma])
    if not isinstance(a.branch, Branch) or not a.branch.points:
        raise ValueError(f"a Branch with points is required, got {type(a.branch).__name__}")


@collective("points_at", _check_points)
def points_at(
    system: System,
    branch: Branch,
    gamma: float,
    *,
    gamma_range: tuple[float, float],
    control: StepControl | None = None,
    route: Route = "auto",
) -> list[BranchPoint]:
    """Return the points of a branch at which the parameter is ``gamma``, in order. Collective.

    The data of the system are restored. If the branch was traced by predictor-corrector steps,
    points between a bifurcation and the first point of a branch leaving it, which is close to the
    bifurcation, are missed.

    Args:
        system: system of the branch.
        branch: complete branch.
        gamma: parameter, assumed to be monotone between neighbouring points of the branch and
            smooth folds.
        gamma_range: range of gamma of the branch.
        control: parameters of the corrector.
        route: method by which the branch was traced.

    Raises:
        ValueError: on every rank, if an argument is invalid or differs between ranks, or a point of
            the branch does not solve the present system.
        RuntimeError: on every rank, if a point that must exist is not found.
    """
    same_everywhere(system.comm, points_of_the_branch=len(branch.points))
    require_solutions(system, branch)
    system.check_parameter([gamma])
    low, high = gamma_range
    first = branch.points[0]
    x, _ = Layout(system).split(first.y)
    scale = high - low
    with (
        system.restored(always=True),
        follower_for(system, x, first.gamma, control, gamma_scale=scale, route=route) as follower,
    ):
        for point in branch.points:  # the first tangent that moves x sets its scale
            follower.bordered.set_scale(point.tangent, point.y)
        follower.bordered.require_scale()
        return follower.at(branch, gamma)


def require_solutions(system: System, branch: Branch) -> None:
    """Raise ``ValueError`` if a branch does not solve the present system. Collective.

    The residual is evaluated with recomputed statuses. With the recorded statuses it may vanish
    even if the friction coefficient has changed.
    """
    layout = Layout(system)
    b = system.create_vector()
    scales: ResidualScales = ()
    with system.restored(always=True):
        for _ in range(2):  # repeated, because the scales grow with the load
            worst = 0.0
            for point in branch.points:
                size, scales = system.measure(*layout.split(point.y), b, None, scales)
                worst = max(worst, size)
            if worst <= _ALLOWED:
                break
    require(
        system.comm,
        worst <= _ALLOWED,
        f"not a solution of the problem as it is now: residual {worst:.1e} (allowed {_ALLOWED:g})",
    )
