# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loop over the points of a branch, shared by predictor-corrector steps and pivoting."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Self, TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import as_text
from dolfinx_contact._ending import Ending
from dolfinx_contact._petsc import staged
from dolfinx_contact._progress import Progress
from dolfinx_contact.continuation.arguments import ROUND_OFF, reason_to_stop
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import Branch, BranchPoint, FoundRays, Ray, SpecialPoint
from dolfinx_contact.continuation.observer import (
    BranchStep,
    CollectiveObserver,
    Observer,
    ObserverLike,
    Stepping,
    Stop,
    Task,
)
from dolfinx_contact.continuation.step_control import Direction, StepControl, sign_of
from dolfinx_contact.continuation.system import System

__all__ = ["CONSTANT", "Next", "Tracer", "leaves_range", "require_in_range"]

logger = logging.getLogger(__name__)

#: A point and the special points before it.
Next: TypeAlias = tuple[BranchPoint, list[SpecialPoint]]

CONSTANT = 1e-9  # rate of gamma along a unit tangent, relative to its scale, that counts as zero
_ALONG = 1e-6  # relative rate that counts as zero at an end of the range of gamma


def leaves_range(bordered: Bordered, start: BranchPoint, gamma_range: tuple[float, float]) -> bool:
    """Return True if gamma leaves its range immediately on a branch from ``start``. Collective."""
    low, high = gamma_range
    rate = bordered.gamma(start.tangent)
    if not abs(rate) > _ALONG * bordered.gamma_scale:
        return False
    near = max(ROUND_OFF * (high - low), 4 * float(np.spacing(max(-low, high))))
    return (high - start.gamma if rate > 0 else start.gamma - low) <= near


def require_in_range(
    bordered: Bordered, start: BranchPoint, gamma_range: tuple[float, float]
) -> None:
    """Raise ``ValueError`` if a branch leaves the range of gamma immediately. Collective."""
    if leaves_range(bordered, start, gamma_range):
        low, high = gamma_range
        raise ValueError(
            f"gamma leaves its range [{low:g}, {high:g}] immediately at the start of the branch, "
            f"gamma = {start.gamma:.10g}: reverse the direction or widen the range"
        )


class Tracer(ABC):
    """Base class for tracing branches of one system. All methods are collective.

    Attributes:
        system: system H(x, gamma) = 0.
        bordered: bordered system.
        control: step lengths.
        first_step: length of the first step of a branch; 0 if steps have no prescribed length.
        next_step: length of the next step.
    """

    system: System
    bordered: Bordered
    control: StepControl
    first_step: float
    next_step: float

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.bordered.destroy()

    # -- where branches start --------------------------------------------------------------------

    def start(
        self, x: PETSc.Vec, gamma: float, *, direction: Direction = "increasing"
    ) -> BranchPoint:
        """Return the point of the branch near (x, gamma), with its tangent.

        Where statuses can change, the tangent is the first existing one of

        1. the tangent t with the statuses of the state, if these remain correct along t;
        2. the ray closest to t along which gamma changes in the requested direction;
        3. the ray closest to t along which gamma is constant;
        4. t, if rays may be missing. The first step then searches for the continuation.

        Args:
            x: approximate solution.
            gamma: parameter.
            direction: direction of gamma at the start.

        Raises:
            ValueError: on every rank, if no solution is found near the state, gamma does not appear
                in H, the tangent is not unique, or gamma provably changes in the opposite direction
                along every outgoing ray.
        """
        sign = sign_of(direction)
        point = self._point_at(x, gamma, sign)
        outgoing = None if self._leads_out(point) else self.rays_at(point)
        if outgoing is None:
            return point
        onwards = self.rays_with_gamma(outgoing, sign)
        if onwards:
            return max(onwards, key=lambda p: self.bordered.inner(p.tangent, point.tangent))
        if not outgoing.complete:
            return point
        goes = "increases" if sign > 0 else "decreases"
        raise ValueError(
            f"gamma {goes} on none of the {len(outgoing.rays)} rays that lead out of the start at "
            f"gamma = {point.gamma:.10g}, by {outgoing.method}"
        )

    def departures(self, x: PETSc.Vec, gamma: float) -> FoundRays[BranchPoint]:
        """Return the outgoing rays of the solution near (x, gamma), in both directions of gamma.

        Args:
            x: approximate solution.
            gamma: parameter.

        Raises:
            ValueError: on every rank, if no solution is found near the state, gamma does not appear
                in H, or the tangent is not unique.
        """
        passing = []
        smooth = True
        for sign in (1.0, -1.0):
            point = self._point_at(x, gamma, sign)
            outgoing = self.rays_at(point)
            if outgoing is not None and (outgoing.rays or outgoing.complete):
                return outgoing
            smooth = outgoing is None
            passing.append(point)
        return FoundRays(tuple(passing), complete=smooth)

    def rays_with_gamma(self, outgoing: FoundRays[BranchPoint], sign: float) -> list[BranchPoint]:
        """Return the rays along which gamma changes with the given sign.

        If no such ray exists, return the rays along which gamma is constant.
        """
        least = CONSTANT * self.bordered.gamma_scale
        rates = [(p, sign * self.bordered.gamma(p.tangent)) for p in outgoing.rays]
        changing = [p for p, rate in rates if rate > least]
        return changing or [p for p, rate in rates if abs(rate) <= least]

    def correction(self, x: PETSc.Vec, point: BranchPoint) -> float:
        """Return the largest difference of an unknown between a state and a branch point."""
        return self.bordered.largest(point.y.array_r[: x.getLocalSize()] - x.array_r)

    @abstractmethod
    def _point_at(self, x: PETSc.Vec, gamma: float, sign: float) -> BranchPoint:
        """Return the solution near (x, gamma), with a tangent whose gamma has the given sign."""

    @abstractmethod
    def _leads_out(self, point: BranchPoint) -> bool:
        """Return True if the statuses of a point remain correct along its tangent."""

    @abstractmethod
    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        """Return the outgoing rays of a branch point; None if no status can change there."""

    @abstractmethod
    def branch_off(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """Return a point from which to trace a ray of a special point that no branch has taken.

        Raises:
            ValueError: if no solution is found there.
        """

    # -- along a branch --------------------------------------------------------------------------

    @abstractmethod
    def _trace(
        self, branch: Branch, origin: BranchPoint, gamma_range: tuple[float, float]
    ) -> Iterator[Next]:
        """Yield the points of a branch while tracing it, and record how the branch ends.

        Args:
            branch: branch that contains only its start.
            origin: first point of the branch, to which a closed branch returns.
            gamma_range: range of gamma.
        """

    @abstractmethod
    def _stepping(self, index: int) -> Stepping:
        """Return the data from which a branch can be resumed at the point ``index``."""

    def _resume(self, stepping: Stepping) -> None:
        """Restore the data from which a branch is resumed."""
        self.next_step = stepping.next_step
        self.bordered.x_scale = stepping.x_scale

    @staged("Continuation")
    def run(
        self,
        start: BranchPoint,
        *,
        gamma_range: tuple[float, float],
        max_steps: int = 1000,
        to_node: bool = False,
        stop: Stop[BranchStep] | None = None,
        observer: ObserverLike[BranchStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = False,
        branch_id: int = 0,
        stepping: Stepping | None = None,
        origin: BranchPoint | None = None,
    ) -> Branch:
        """Trace a branch from ``start`` along the tangent there.

        Afterwards the user's data are those of the last point.

        Args:
            start: first point of this trace.
            gamma_range: range of gamma; the branch ends at either end.
            max_steps: largest number of steps from the first point of the branch.
            to_node: True to end the branch at its first bifurcation, as in a diagram.
            stop: function of every accepted step returning the reason to end the branch there,
                or "" to continue; default: the branch is not stopped.
            observer: observer of every accepted point, ``start`` included; called after ``stop``.
            record: observer storing every point before ``observer`` is called; default: none.
            progress: True to show the progress on the standard error stream of rank 0, None to show
                it after some seconds; default: False.
            branch_id: number of the branch, for the observer.
            stepping: data from which a branch is resumed at ``start``; default: a new branch.
            origin: first point of a resumed branch, at which a closed branch ends; default:
                ``start``.

        Returns:
            The branch from ``start`` on.

        Raises:
            ValueError: on every rank, if gamma leaves its range immediately.
        """
        b = self.bordered
        require_in_range(b, start, gamma_range)
        branch = Branch([start])
        work = b.solver.factorisations, b.solver.solves
        first = 0
        self.next_step = self.first_step
        if stepping is not None:
            first = stepping.index
            self._resume(stepping)
        steps = self._trace(branch, origin or start, gamma_range)

        def put() -> None:
            last = branch.points[-1]
            self.system.put(*b.split(last.y), last.piece)

        observers = CollectiveObserver(b.comm, put, record, observer)
        line = Progress(b.comm, progress)
        # the start
        task = Task(gamma_range, b.gamma_scale, self.control, max_steps, to_node, branch_id)
        observers.begin(task, self._stepping(first))
        step = BranchStep(branch_id, first, start)
        observers.step(step, self._stepping(first))
        _show(line, step, 0, b.gamma_scale)
        # accepted steps
        for index in range(first + 1, max_steps + 1):
            with self.system.undisturbed():
                following = next(steps, None)
            if following is None:
                break
            special = _add(branch, *following, to_node=to_node)
            step = BranchStep(branch_id, index, branch.points[-1], special)
            if stop is not None and branch.ending is None:
                put()
                reason = reason_to_stop(b.comm, "branch", stop, step)
                if reason:
                    branch.end(Ending.STOPPED, reason)
            # pass the ending together with its point, so that every record contains it
            state = self._stepping(index)
            if branch.ending is not None:
                state = replace(state, ending=branch.ending, reason=branch.reason)
            observers.step(step, state)
            _show(line, step, len(branch.special), b.gamma_scale)
            if branch.ending is not None:
                break
        else:
            branch.end(Ending.BUDGET, f"the budget of {max_steps} steps is exhausted")
        # the end
        observers.end(branch)
        line.close(f"branch {branch_id}: {branch.reason}")
        branch.factorisations = b.solver.factorisations - work[0]
        branch.solves = b.solver.solves - work[1]
        put()
        if b.comm.rank == 0:
            logger.info("branch ended: %s", branch.reason)
        return branch

    def at(self, branch: Branch, gamma: float, *, skip_missing: bool = False) -> list[BranchPoint]:
        """Return the points of a branch at which the parameter is ``gamma``, in order.

        Gamma is assumed to be monotone between neighbouring points of the branch and smooth folds.

        Args:
            branch: branch of the system.
            gamma: parameter.
            skip_missing: True to omit points that are not found.

        Raises:
            RuntimeError: on every rank, for a point that is not found, unless ``skip_missing``.
        """
        points = []
        for a, c in pairwise(_with_folds(branch)):
            if a.gamma == gamma:
                points.append(a)
            elif (a.gamma - gamma) * (c.gamma - gamma) < 0:
                between = self._between(a, c, gamma)
                if between is not None:
                    points.append(between)
                elif not skip_missing:
                    raise RuntimeError(
                        f"the point at gamma = {gamma:.10g}, between {a.gamma:.10g} and "
                        f"{c.gamma:.10g}, was not found: follow the branch in shorter steps there"
                    )
        last = branch.points[-1]
        return [*points, last] if last.gamma == gamma else points

    @abstractmethod
    def _between(self, a: BranchPoint, c: BranchPoint, gamma: float) -> BranchPoint | None:
        """Return the point at ``gamma`` between two successive points; None if not found."""


def _with_folds(branch: Branch) -> list[BranchPoint]:
    """Return the points of a branch, with its smooth folds inserted between them."""
    folds = [s for s in branch.special if s.kind == "fold" and s.smooth]
    points: list[BranchPoint] = []
    for number, point in enumerate(branch.points):
        for fold in folds:
            if fold.index == number and number > 0 and fold.gamma != point.gamma:
                points.append(replace(points[-1], y=fold.y, gamma=fold.gamma))
        points.append(point)
    return points


def _add(
    branch: Branch, point: BranchPoint, special: Sequence[SpecialPoint], *, to_node: bool
) -> list[SpecialPoint]:
    """Add a point to a branch; return the special points before it with `index` set.

    Args:
        branch: branch up to the previous point.
        point: next point.
        special: special points between the previous point and this one.
        to_node: True to end the branch at a bifurcation, before its statuses change.
    """
    special = [replace(s, index=len(branch.points)) for s in special]
    branch.special += special
    if to_node and branch.bifurcations:
        # a bifurcation before another end of the branch takes precedence
        branch.end(Ending.STOPPED, "a bifurcation")
        node = branch.bifurcations[-1]
        if node.incoming is not None:
            tangent, piece = node.incoming.tangent, node.incoming.piece
            point = replace(point, y=node.y, gamma=node.gamma, tangent=tangent, piece=piece)
    branch.points.append(point)
    return special


def _show(progress: Progress, step: BranchStep, number: int, scale: float) -> None:
    """Show the progress of a branch on one line, and its folds and bifurcations on others.

    Args:
        progress: progress line.
        step: accepted step.
        number: number of special points on the branch so far.
        scale: unit of gamma; values below the round-off of this unit are shown as 0.
    """
    if not progress.due:
        return
    for s in step.special:
        if s.kind != "event":
            smooth = "smooth" if s.smooth else "nonsmooth"
            gamma = as_text(s.gamma, scale, 10)
            progress.write(f"branch {step.branch}: {smooth} {s.kind} at gamma {gamma}")
    progress.update(
        f"branch {step.branch}  point {step.index}  gamma {step.point.gamma:+.6f}  "
        f"step {step.point.step:.1e}  special {number}"
    )
