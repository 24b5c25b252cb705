# SPDX-License-Identifier: LGPL-3.0-or-later
"""The loop along a branch, from point to point, for every method that finds the next point."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TextIO, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import staged
from dolfinx_contact._progress import Progress
from dolfinx_contact.continuation.arguments import leads_out, reason_to_stop
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import Branch, BranchPoint, FoundRays, Ray, SpecialPoint
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.continuation.observer import (
    BranchStep,
    CollectiveObserver,
    Observer,
    ObserverLike,
    Observers,
    Stepping,
    Stop,
    Task,
)
from dolfinx_contact.continuation.parameters import Direction, StepControl, sign_of
from dolfinx_contact.continuation.system import System

__all__ = ["BranchProgress", "Next", "Walker", "leaves_range", "require_way"]

logger = logging.getLogger(__name__)

#: A point, and the special points on the way to it.
Next: TypeAlias = tuple[BranchPoint, list[SpecialPoint]]

_CONSTANT = 1e-9  # rate of gamma along a unit tangent, over its scale, that counts as zero
_ALONG = 1e-6  # the same at the end of the range of gamma


def leaves_range(bordered: Bordered, start: BranchPoint, gamma_range: tuple[float, float]) -> bool:
    """Return True if gamma leaves its range at once on a branch from ``start``. Collective."""
    rate = bordered.gamma(start.tangent)
    moves = abs(rate) > _ALONG * bordered.gamma_scale
    return moves and leads_out(start.gamma, rate, gamma_range)


def require_way(bordered: Bordered, start: BranchPoint, gamma_range: tuple[float, float]) -> None:
    """Raise ``ValueError`` if a branch leaves the range of gamma at once. Collective."""
    if leaves_range(bordered, start, gamma_range):
        low, high = gamma_range
        raise ValueError(
            f"gamma leaves its range [{low:g}, {high:g}] at once where the branch starts, at "
            f"gamma = {start.gamma:.10g}: take the other direction, or a wider range"
        )


class Walker(ABC):
    """Traces branches of one system. All methods are collective.

    Attributes:
        system: system H.
        bordered: bordered system.
        control: step lengths.
        next_step: length of the next step.
        largest_distance: largest distance to a border so far, the unit of distances.
    """

    system: System
    bordered: Bordered
    control: StepControl
    next_step: float
    largest_distance: float

    # -- where branches start --------------------------------------------------------------------

    def start(
        self, x: PETSc.Vec, gamma: float, *, direction: Direction = "increasing"
    ) -> BranchPoint:
        """The point of the branch near (x, gamma), with its tangent.

        Where pieces meet, the tangent of the piece of the state is taken if it is an outgoing ray.
        Otherwise it is, of the rays along which gamma changes in the direction, the one closest to
        that tangent; if there are none, of those along which gamma is constant. If there is
        neither but rays may be missing, the tangent stays, and the first step searches a way.

        Args:
            x: approximate solution.
            gamma: parameter.
            direction: direction of gamma at the start.

        Raises:
            ValueError: if there is no solution, gamma does not appear in H, the tangent is not
                unique, gamma provably does not change in the direction, or it is unknown.
        """
        sign = sign_of(direction)
        point = self._point_at(x, gamma, sign)
        found = None if self._leads_out(point) else self.rays_at(point)
        if found is None:
            return point
        b = self.bordered
        rates = [sign * b.gamma(p.tangent) for p in found.rays]
        least = _CONSTANT * b.gamma_scale
        onwards = [p for p, rate in zip(found.rays, rates, strict=True) if rate > least]
        if not onwards:
            onwards = [p for p, rate in zip(found.rays, rates, strict=True) if abs(rate) <= least]
        if onwards:
            return max(onwards, key=lambda p: b.inner(p.tangent, point.tangent))
        if not found.complete:
            return point
        goes = "increases" if sign > 0 else "decreases"
        raise ValueError(
            f"gamma {goes} on none of the {len(found.rays)} rays that lead out of the start at "
            f"gamma = {point.gamma:.10g}, by {found.method}"
        )

    def departures(self, x: PETSc.Vec, gamma: float) -> FoundRays[BranchPoint]:
        """Rays out of the solution near (x, gamma), in both senses of gamma.

        Raises:
            ValueError: on every rank, if there is no solution, gamma does not appear in H, or the
                tangent is not unique.
        """
        passing = []
        smooth = True
        for sign in (1.0, -1.0):
            point = self._point_at(x, gamma, sign)
            found = self.rays_at(point)
            if found is not None and (found.rays or found.complete):
                return found
            smooth = found is None
            passing.append(point)
        return FoundRays(tuple(passing), complete=smooth)

    def correction(self, x: PETSc.Vec, point: BranchPoint) -> float:
        """Largest change of an unknown from an approximate start to the corrected one."""
        change = point.y.array_r[: x.getLocalSize()] - x.array_r
        size = float(np.max(np.abs(change), initial=0.0))
        return float(self.bordered.comm.allreduce(size, op=MPI.MAX))

    @abstractmethod
    def _point_at(self, x: PETSc.Vec, gamma: float, sign: float) -> BranchPoint:
        """The solution near (x, gamma), with its tangent in the sense ``sign`` of gamma."""

    @abstractmethod
    def _leads_out(self, point: BranchPoint) -> bool:
        """Return True if the tangent of a point leads over no border of its piece there."""

    @abstractmethod
    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        """Outgoing rays of a point of a branch at which pieces meet; None elsewhere."""

    @abstractmethod
    def branch_off(self, special: SpecialPoint, ray: Ray) -> BranchPoint:
        """A point from which to trace one of the other rays of a special point.

        Raises:
            ValueError: if no solution is found there.
        """

    # -- along a branch --------------------------------------------------------------------------

    @abstractmethod
    def _walk(
        self, branch: Branch, origin: BranchPoint, gamma_range: tuple[float, float]
    ) -> Iterator[Next]:
        """Trace a branch from its point; ends it with its reason where it ends by itself.

        Args:
            branch: branch with its start.
            origin: first point of the whole branch, at which it may close.
            gamma_range: range of gamma.
        """

    def _stepping(self, index: int) -> Stepping:
        """The data from which a branch continues at the point of this number."""
        return Stepping(index, self.next_step, self.bordered.x_scale, self.largest_distance)

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
        """Trace a branch from ``start`` along its tangent; see `follow`.

        The system is left at the end of the branch.

        Args:
            start: a point of the branch.
            gamma_range: the branch ends where gamma reaches either end.
            max_steps: largest number of steps from the first point of the branch.
            to_node: True to end at the first bifurcation, as branches of a diagram do.
            stop: see `follow`.
            observer: called with every accepted point, ``start`` included, after ``stop``.
            record: see `follow`.
            progress: see `follow`; by default none is shown.
            branch_id: number of the branch, for the observer.
            stepping: data at ``start`` of a branch that was traced to it before.
            origin: first point of that branch, at which it may close; by default ``start``.

        Returns:
            The branch from ``start`` on.

        Raises:
            ValueError: on every rank, if gamma leaves its range at once.
        """
        b = self.bordered
        require_way(b, start, gamma_range)
        branch = Branch([start])
        factorisations, solves = b.work
        first = 0
        self.next_step = self.control.initial
        if stepping is not None:
            first = stepping.index
            self.next_step = stepping.next_step
            b.x_scale = stepping.x_scale
            self.largest_distance = stepping.largest_distance
        steps = self._walk(branch, origin or start, gamma_range)
        point = start

        def put() -> None:
            self.system.put(*b.split(point.y), point.piece)

        observers = Observers(
            CollectiveObserver(b.comm, record, put),
            CollectiveObserver(b.comm, observer, put),
            BranchProgress(b.comm, progress),
        )
        task = Task(gamma_range, b.gamma_scale, self.control, max_steps, to_node, branch_id)
        observers.begin(task, self._stepping(first))
        observers.step(BranchStep(branch_id, first, start), self._stepping(first))
        for index in range(first + 1, max_steps + 1):
            with self.system.undisturbed():
                advance = next(steps, None)
            if advance is None:
                break
            point, special = advance
            special = [replace(s, index=len(branch.points)) for s in special]
            branch.special += special
            if to_node and branch.bifurcations:
                point = _at_node(point, branch.bifurcations[-1])
                branch.end(Ending.STOPPED, "a bifurcation")  # also on the way to another end
            branch.points.append(point)
            step = BranchStep(branch_id, index, point, special)
            if stop is not None and branch.ending is None:
                put()
                reason = reason_to_stop(b.comm, "branch", stop, step)
                if reason:
                    branch.end(Ending.STOPPED, reason)
            # the ending is passed with its point, so that no record lacks it
            state = self._stepping(index)
            if branch.ending is not None:
                state = replace(state, ending=branch.ending, reason=branch.reason)
            observers.step(step, state)
            if branch.ending is not None:
                break
        else:
            branch.end(Ending.BUDGET, f"the budget of {max_steps} steps is exhausted")
        observers.end(branch)
        branch.factorisations = b.work[0] - factorisations
        branch.solves = b.work[1] - solves
        put()
        if b.comm.rank == 0:
            logger.info("branch ended: %s", branch.reason)
        return branch

    def at(self, branch: Branch, gamma: float, *, skip_missing: bool = False) -> list[BranchPoint]:
        """The points of a branch at which its parameter is ``gamma``, in order.

        Between two points of the branch, or a point and a smooth fold, gamma is assumed to pass a
        value once.

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
        """The point with this gamma between two successive points; None if it is not found."""


def _with_folds(branch: Branch) -> list[BranchPoint]:
    """The points of a branch and its smooth folds, which lie between two of them."""
    folds = [s for s in branch.special if s.kind == "fold" and s.smooth]
    points: list[BranchPoint] = []
    for number, point in enumerate(branch.points):
        for fold in folds:
            if fold.index == number and number > 0 and fold.gamma != point.gamma:
                points.append(replace(points[-1], y=fold.y, gamma=fold.gamma))
        points.append(point)
    return points


def _at_node(point: BranchPoint, node: SpecialPoint) -> BranchPoint:
    """The end of a branch at a bifurcation, on its own piece, in place of the point beyond."""
    if node.incoming is None:
        return point
    incoming = node.incoming
    return replace(
        point, y=node.y, gamma=node.gamma, tangent=incoming.tangent, piece=incoming.piece
    )


class BranchProgress(Observer):
    """Progress line: branch, point, gamma, length of the step, number of special points.

    Folds and bifurcations get a line of their own.

    Args:
        comm: communicator; rank 0 writes.
        wanted: see `follow`.
        stream: output stream, by default the standard error stream.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None = None, *, stream: TextIO | None = None):
        self._progress = Progress(comm, wanted, stream=stream)
        self._special = 0
        self._branch = 0

    def begin(self, task: Task, state: Stepping) -> None:
        self._branch = task.branch

    def step(self, step: BranchStep, state: Stepping) -> None:
        self._special += len(step.special)
        if not self._progress.due:
            return
        for s in step.special:
            if s.kind != "event":
                smooth = "smooth" if s.smooth else "nonsmooth"
                where = f"branch {step.branch}: {smooth} {s.kind} at gamma {s.gamma:.10g}"
                self._progress.write(where)
        self._progress.update(
            f"branch {step.branch}  point {step.index}  gamma {step.point.gamma:+.6f}  "
            f"step {step.point.step:.1e}  special {self._special}"
        )

    def end(self, ended: Ends) -> None:
        self._progress.close(f"branch {self._branch}: {ended.reason}")
