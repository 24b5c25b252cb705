# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following a branch from point to point: what is the same for every method of finding the next."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TextIO, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import staged
from dolfinx_contact._progress import Progress
from dolfinx_contact.continuation.arguments import leads_out, reason_to_stop
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import Branch, BranchPoint, FoundRays, SpecialPoint
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
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.system import System

__all__ = [
    "BranchProgress",
    "Walk",
    "Walker",
    "leaves_range",
    "onwards_from",
    "require_way",
]

logger = logging.getLogger(__name__)

#: A point, and the special points on the way to it.
Next: TypeAlias = tuple[BranchPoint, list[SpecialPoint]]


#: Rate of gamma along a unit tangent, of its scale, up to which gamma is constant.
_STILL = 1e-9
#: And up to which it stays where it is at the end of its range.
_ALONG = 1e-6


def leaves_range(bordered: Bordered, start: BranchPoint, gamma_range: tuple[float, float]) -> bool:
    """Whether gamma leaves its range at once on a branch that begins at ``start``. Collective."""
    rate = bordered.gamma(start.tangent)
    moves = abs(rate) > _ALONG * bordered.gamma_scale
    return moves and leads_out(start.gamma, rate, gamma_range)


def require_way(bordered: Bordered, start: BranchPoint, gamma_range: tuple[float, float]) -> None:
    """Raise ``ValueError`` where a branch has no way to go within the range. Collective."""
    if leaves_range(bordered, start, gamma_range):
        low, high = gamma_range
        raise ValueError(
            f"gamma leaves its range [{low:g}, {high:g}] at once where the branch starts, at "
            f"gamma = {start.gamma:.10g}: take the other direction, or a wider range"
        )


def onwards_from(
    bordered: Bordered, start: BranchPoint, found: FoundRays[BranchPoint], sign: float
) -> BranchPoint:
    """The ray along which a branch leaves a start at which pieces meet. Collective.

    Of the rays along which gamma changes with the sign ``sign`` it is the one closest to the
    tangent of the piece of the state; if there are none, of those along which gamma is constant. If
    there is neither, and rays may be missing, it is the start itself, whose first step looks for
    a direction.

    Raises:
        ValueError: if it is known that there is neither.
    """
    least = _STILL * bordered.gamma_scale
    for wanted in (lambda rate: sign * rate > least, lambda rate: abs(rate) <= least):
        rays = [p for p in found.rays if wanted(bordered.gamma(p.tangent))]
        if rays:
            return max(rays, key=lambda p: bordered.inner(p.tangent, start.tangent))
    if not found.complete:
        return start
    goes = "increases" if sign > 0 else "decreases"
    raise ValueError(
        f"gamma {goes} on none of the {len(found.rays)} rays that lead out of the start at "
        f"gamma = {start.gamma:.10g}, by {found.method}"
    )


class Walk(ABC):
    """A branch that is being followed. Its methods are collective."""

    @abstractmethod
    def advance(self, branch: Branch, point: BranchPoint) -> Next | None:
        """The point after ``point``, which is the last of ``branch``; None if there is none.

        The branch ends here, with its reason, where it ends by itself.
        """

    @abstractmethod
    def stepping(self, index: int) -> Stepping:
        """What is needed to continue from the point of this number."""


class Walker(ABC):
    """Follows branches of one system.

    Attributes:
        system: what is followed.
        bordered: the bordered system.
        control: step lengths.
    """

    system: System
    bordered: Bordered
    control: StepControl

    def correction(self, x: PETSc.Vec, point: BranchPoint) -> float:
        """Largest change of an unknown from a given start to the corrected one. Collective."""
        change = point.y.array_r[: x.getLocalSize()] - x.array_r
        size = float(np.max(np.abs(change), initial=0.0))
        return float(self.bordered.comm.allreduce(size, op=MPI.MAX))

    @abstractmethod
    def departures(self, x: PETSc.Vec, gamma: float) -> FoundRays[BranchPoint]:
        """How branches leave the solution near (x, gamma), in either sense of gamma.

        Raises:
            ValueError: on every rank, if there is no solution there, gamma does not appear in H, or
                the tangent is not unique.
        """

    @abstractmethod
    def rays_at(self, point: BranchPoint) -> FoundRays[BranchPoint] | None:
        """What leads out of a point of a branch at which pieces meet; None where they do not."""

    @abstractmethod
    def _walk(
        self,
        start: BranchPoint,
        origin: BranchPoint,
        gamma_range: tuple[float, float],
        stepping: Stepping | None,
    ) -> Walk:
        """A walk from ``start`` on, of a branch that begins at ``origin``."""

    @abstractmethod
    def restore(self, stepping: Stepping) -> None:
        """Know again what was known at a point that was followed to before."""

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
        """Follow from ``start`` along its tangent; see `follow`.

        The system is left at the end of the branch.

        Args:
            start: a point of the branch.
            gamma_range: the branch ends where gamma reaches either end.
            max_steps: budget, from the first point of the branch.
            to_node: whether the branch ends at its first bifurcation, as those of a diagram do.
            stop: see `follow`.
            observer: called with every accepted point, ``start`` included, after ``stop``.
            record: see `follow`.
            progress: see `follow`; by default none is shown.
            branch_id: number by which the observer knows the branch.
            stepping: known at ``start`` if the branch was followed to it before.
            origin: then its first point, at which it may close.

        Returns:
            The branch from ``start`` on.

        Raises:
            ValueError: on every rank, if gamma leaves its range at once.
        """
        branch = Branch([start])
        b = self.bordered
        require_way(b, start, gamma_range)
        factorisations, solves = b.work
        first = 0
        if stepping is not None:
            first = stepping.index
            self.restore(stepping)
        walk = self._walk(start, origin or start, gamma_range, stepping)
        point = start

        def put() -> None:
            self.system.put(*b.split(point.y), point.piece)

        observers = Observers(
            CollectiveObserver(b.comm, record, put),
            CollectiveObserver(b.comm, observer, put),
            BranchProgress(b.comm, progress),
        )
        low, high = gamma_range
        task = Task((low, high), b.gamma_scale, self.control, max_steps, to_node, branch_id)
        known = walk.stepping(first)
        observers.begin(task, known)
        observers.step(BranchStep(branch_id, first, start), known)
        for index in range(first + 1, max_steps + 1):
            with self.system.undisturbed():
                found = walk.advance(branch, point)
            if found is None:
                break
            point, special = found
            special = [replace(s, index=len(branch.points)) for s in special]
            branch.special += special
            if to_node and branch.bifurcations:
                point = _at_node(point, branch.bifurcations[-1])
                branch.end(Ending.STOPPED, "a bifurcation")  # also on the way to another end
            branch.points.append(point)
            step = BranchStep(branch_id, index, point, special)
            if stop is not None and branch.ending is None:
                put()
                words = reason_to_stop(b.comm, "branch", stop, step)
                if words:
                    branch.end(Ending.STOPPED, words)
            known = walk.stepping(index)
            if branch.ending is not None:  # known with the point, so that no record lacks it
                known = replace(known, ending=branch.ending, reason=branch.reason)
            observers.step(step, known)
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


def _at_node(point: BranchPoint, node: SpecialPoint) -> BranchPoint:
    """The end of a branch at a bifurcation, on its own piece, in place of the point beyond."""
    if node.incoming is None:
        return point
    incoming = node.incoming
    return replace(
        point, y=node.y, gamma=node.gamma, tangent=incoming.tangent, piece=incoming.piece
    )


class BranchProgress(Observer):
    """The line of progress: branch, point, gamma, length of the step, special points so far.

    Folds and bifurcations get a line each.

    Args:
        comm: only rank 0 writes.
        wanted: see `follow`.
        stream: where to, by default the standard error stream.
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
