# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps over many kinks at once.

In 3D hundreds of points change their status one by one, and to locate each costs more than it
tells. Here a step is corrected on H itself, with the status that the state determines, so that it
may lead over any number of kinks. It is accepted if the branch is monotone over it, as far as its
two ends show: gamma continues in the same sense and by as much as its rates predict, the tangents
and the chord satisfy the target of their angles, and the determinant of [grad H; t^T], t the
oriented tangent, keeps its sign, so that the parities of the kinks multiply to 1. Every change is
recorded with the values of gamma between which it lies.

Else the step is shortened until it holds a few changes, and these are crossed one by one: so
folds, changes of parity and the events that were selected are located as by `ExactSteps`. What
returns within one step is not seen: a point that changes its status twice, or two folds.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.borders import reached
from dolfinx_contact.continuation.branch import BranchPoint, Change, SpecialPoint
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.steps import ExactSteps
from dolfinx_contact.continuation.system import Piece

__all__ = ["BatchedSteps", "Crossed", "FreeSteps", "Locate"]

logger = logging.getLogger(__name__)

#: Whether a change is to be located; called on the rank that owns the point.
Locate: TypeAlias = Callable[[Change], bool]

_FEW = 3  # changes that are crossed one by one rather than divided by a shorter step
_SHORT_OF = 0.9  # part of the way to an event that was selected, if several are before it
_MOST_HALVINGS = 6


@dataclass(frozen=True)
class Crossed:
    """A step on H itself.

    Attributes:
        new: where it leads; None if it did not converge or turns by too large an angle.
        changes: with the fraction of the step at which each happens if its event is linear.
        turned: whether gamma turns back, at the end or in between.
        parity: product of the parities of the changes; 0 if it was not evaluated.
    """

    new: BranchPoint | None
    changes: tuple[tuple[float, Change], ...] = ()
    turned: bool = False
    parity: int = 0


class FreeSteps(ExactSteps):
    """What steps on H itself have in common.

    Args:
        corrector: on the bordered system that is followed.
    """

    def __init__(self, corrector: Corrector):
        super().__init__(corrector)
        #: A point of the branch, and the sign of det [grad H; t^T] there.
        self._oriented: tuple[PETSc.Vec, float] | None = None

    def within_piece(
        self, point: BranchPoint, step: Crossed, h: float
    ) -> tuple[BranchPoint, list[SpecialPoint], float] | None:
        """A step in one piece, as `step` returns it. Collective.

        Returns:
            None if it leads nowhere or to another piece, or misses a fold.
        """
        new = step.new
        if new is None or step.changes:
            return None
        special = self.smooth_points(point, new)
        if self.lacks_fold(point, new, special):
            return None
        if not any(s.kind == "bifurcation" for s in special):
            self.keep_orientation(point, new)
        return self.rescaled(new), special, self.longer(h, new)

    def try_step(self, point: BranchPoint, h: float) -> Crossed:
        """Go a step ``h`` on H itself. Collective."""
        b = self.bordered
        y = point.y.copy()
        t = point.tangent.copy()
        y.axpy(h, point.tangent)
        ok = self.corrector.moore_penrose(y, t, None)
        t.destroy()
        if not ok:
            return Crossed(None)
        corrections = self.corrector.iterations
        piece = self.system.piece_at(*b.split(y))
        changes = self.changes(point, y, piece)
        before = self._orientation(point) if changes else 0.0
        several = bool(changes)
        tangent = self.corrector.tangent(
            y, point.tangent, piece, start=point.y, factorise=several, precise=False
        )
        if tangent is None or not self.lands(point, h, y, tangent):
            return Crossed(None, changes)
        tau = self.test(accepted=True)
        after = self.corrector.orientation() if several else 0.0
        new = BranchPoint(y, tangent, piece, b.gamma(y), h, corrections, tau)
        turned = self.turned(point.tangent, tangent)
        if several:
            # Two folds in between: gamma continues by less than both rates predict.
            chord = y - point.y
            length = np.sqrt(b.inner(chord, chord))
            chord.destroy()
            rates = b.gamma(point.tangent), b.gamma(tangent)
            slower = min(rates, key=abs)
            turned |= (new.gamma - point.gamma) * np.sign(slower) < abs(slower) * length / 2
            self._oriented = (y, after)
        return Crossed(new, changes, turned, int(before * after))

    def _orientation(self, point: BranchPoint) -> float:
        """Sign of det [grad H; t^T] at ``point``. Collective."""
        if self._oriented is None or self._oriented[0] is not point.y:
            t = self.corrector.tangent(point.y, point.tangent, point.piece, factorise=True)
            self._oriented = (point.y, self.corrector.orientation() if t is not None else 0.0)
        return self._oriented[1]

    def keep_orientation(self, point: BranchPoint, new: BranchPoint) -> None:
        """Remember that no bifurcation lies between two points."""
        if self._oriented is not None and self._oriented[0] is point.y:
            self._oriented = (new.y, self._oriented[1])

    def changes(
        self, point: BranchPoint, y: PETSc.Vec, piece: Piece
    ) -> tuple[tuple[float, Change], ...]:
        """Points whose status differs at ``y``, where ``piece`` is, in order. Collective."""
        comm = self.bordered.comm
        old = point.piece
        changed = np.flatnonzero(old.codes != piece.codes)
        first = np.full(len(old.codes), np.inf)
        ends = []
        for state in (point.y, y):
            x, gamma = self.bordered.split(state)
            ends.append(self.system.events(x, gamma, old))
        np.minimum.at(first, ends[1].point, reached(ends[0], ends[1]))
        mine = [
            (
                float(first[i]) if first[i] <= 1 else 1.0,
                Change(comm.rank, int(i), int(old.codes[i]), int(piece.codes[i])),
            )
            for i in changed
        ]
        whole = [pair for part in comm.allgather(mine) for pair in part]
        return tuple(sorted(whole, key=lambda pair: pair[0]))

    def events(self, point: BranchPoint, new: BranchPoint, step: Crossed) -> list[SpecialPoint]:
        """The changes of a monotone step as events that are not located."""
        ends = min(point.gamma, new.gamma), max(point.gamma, new.gamma)
        return [
            SpecialPoint(
                "event",
                False,
                point.gamma + fraction * (new.gamma - point.gamma),
                new.y,
                0,
                (change,),
                parity=step.parity if len(step.changes) == 1 else 0,
                bracket=ends,
            )
            for fraction, change in step.changes
        ]

    def longer(self, h: float, new: BranchPoint) -> float:
        """The length of the step after an accepted one."""
        control = self.control
        h = h * control.increase if new.corrections <= control.easy else h
        return min(h, control.maximum)

    def piece_between(self, a: BranchPoint, c: BranchPoint) -> Piece | None:
        same = bool(np.array_equal(a.piece.codes, c.piece.codes))
        return a.piece if self.bordered.comm.allreduce(same, op=MPI.LAND) else None

    def end_at(
        self,
        point: BranchPoint,
        new: BranchPoint,
        special: Sequence[SpecialPoint],
        gamma_range: tuple[float, float],
    ) -> tuple[BranchPoint, list[SpecialPoint]]:
        if self.piece_between(point, new) is not None:
            return super().end_at(point, new, special, gamma_range)
        low, high = gamma_range
        special = [s for s in special if s.smooth and low <= s.gamma <= high]
        y, gamma = self.between(point, new, low if new.gamma < low else high)
        if not self.corrector.natural(y, gamma, None):
            return new, special
        b = self.bordered
        piece = self.system.piece_at(*b.split(y))
        tangent = self.corrector.tangent(y, point.tangent, piece)
        end = BranchPoint(
            y, new.tangent if tangent is None else tangent, piece, gamma, new.step, new.corrections
        )
        step = Crossed(end, self.changes(point, y, piece))
        return end, special + self.events(point, end, step)


class BatchedSteps(FreeSteps):
    """Steps over any number of kinks along which the branch is monotone.

    Args:
        corrector: on the bordered system that is followed.
        locate: selects the changes that are to be located; folds and changes of parity are anyway.
    """

    def __init__(self, corrector: Corrector, locate: Locate | None = None):
        super().__init__(corrector)
        self._locate = locate
        #: The step that was first refused, to be tried again beyond what it was refused for.
        self._refused = 0.0

    def step(
        self, point: BranchPoint, h: float
    ) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        for _ in range(_MOST_HALVINGS):
            step = self.try_step(point, h)
            new = step.new
            within = self.within_piece(point, step, h)
            if within is not None:
                return within
            monotone = new is not None and not step.turned and step.parity > 0
            first = self._first_located(step) if monotone else 1.0
            if new is not None and monotone and first > 1:
                number = len(step.changes)
                if self.bordered.comm.rank == 0:
                    logger.info("gamma = %.10g: %d changes in one step", new.gamma, number)
                return self.rescaled(new), self.events(point, new, step), self.longer(h, new)
            self._refused = max(self._refused, h)
            before = sum(fraction <= first for fraction, _ in step.changes)
            factor = min(_SHORT_OF * first, self.control.decrease)
            if 0 < before <= _FEW or h * factor < self.control.minimum:
                break
            h *= factor
        crossed, special, h = super().step(point, h)
        if any(not s.smooth for s in special):
            h = max(h, self._refused)
            self._refused = 0.0
        return crossed, special, h

    def _first_located(self, step: Crossed) -> float:
        """The fraction of the step at the first change to be located; inf if none. Collective."""
        comm = self.bordered.comm
        locate = self._locate
        if locate is None:
            return np.inf
        mine = [f for f, change in step.changes if change.rank == comm.rank and locate(change)]
        return float(comm.allreduce(min(mine, default=np.inf), op=min))
