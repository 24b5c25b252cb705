# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of a path whose memory is accepted at every point.

A step begins at an accepted state, in the piece and along the direction that solve its rate problem
(`rate_problem.py`), and stays on that piece with the memory of its start: so a bond that damages
continues to, and a point that slips keeps slipping. It ends where the state first comes to another
border, or where gamma turns back, both located to round-off. A step is too long in which a bond
would heal or a slip be taken back, in the end; one whose end is elsewhere on the piece than where
it leads to (`ExactSteps.lands`); and one in which gamma turns twice, or a border is reached and
left. Where a bond ceases to damage, or a point to slip, somewhere in a step, the rate problem at
its end shows it: what that misses is of second order in the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.borders import again
from dolfinx_contact.continuation.branch import BranchPoint, Ray, SpecialPoint
from dolfinx_contact.continuation.steps import ExactSteps
from dolfinx_contact.continuation.system import Events, Piece
from dolfinx_contact.evolution.path_state import Known
from dolfinx_contact.evolution.rate_problem import RateProblem

__all__ = ["ArcSteps", "Arrival"]

_AT_BORDER = 1e-10  # of the largest distance: a point whose rate decides
_BEYOND = 1e-9  # of the largest distance: beyond round-off
_AT_END = 1e-10  # of the range of gamma: an end that is reached
_PROBE = 1e-4  # length over which rates of distances are taken, either way
_IDLE = 1e-7  # of the range of gamma: no rate
_SAMPLES = 17  # of what happens within a step


@dataclass(frozen=True)
class Arrival:
    """Where a step ends.

    Attributes:
        point: with piece and tangent of the step.
        at: what it ends at: nothing special, a ``"kink"``, a smooth ``"fold"``, the ``"end"`` of
            the range of gamma.
        bifurcations: smooth ones on the way.
        next_h: length of the step after it.
    """

    point: BranchPoint
    at: Literal["", "kink", "fold", "end"]
    bifurcations: tuple[SpecialPoint, ...]
    next_h: float


class ArcSteps(ExactSteps):
    """Steps with the memory of the surfaces; it is for the caller to accept it at their ends."""

    @property
    def known(self) -> Known:
        """What has been found out on the way."""
        b = self.bordered
        x_scale = b.x_scale / b.gamma_scale**2
        signs = tuple(map(float, self.test.signs))
        return Known(x_scale, self.largest_distance, tuple(self.system.scales), signs)

    def know(self, known: Known) -> None:
        """Know what was found out before."""
        self.bordered.x_scale = known.x_scale * self.bordered.gamma_scale**2
        self.largest_distance = known.largest_distance
        self.system.scales = tuple(known.scales)
        if len(known.signs) == len(self.test.signs):
            self.test.signs[:] = known.signs

    def rate_problem(self, y: PETSc.Vec, piece: Piece) -> RateProblem:
        """The rate problem at a state, with the memory of the surfaces. Collective."""
        unit = self._unit(y, piece)
        return RateProblem(self.corrector, y, _AT_BORDER * unit, _BEYOND * unit)

    def go_on(self, point: BranchPoint, ray: Ray) -> BranchPoint:
        """The point with another piece and tangent to leave it by. Collective."""
        if ray.tangent is point.tangent:
            return point
        new = BranchPoint(point.y, ray.tangent, ray.piece, point.gamma, point.step, 0)
        return self.rescaled(new)

    def arrive(
        self, point: BranchPoint, h: float, gamma_range: tuple[float, float]
    ) -> Arrival | None:
        """The end of a step no longer than ``h``; None if no step succeeds. Collective."""
        control = self.control
        started = self._distances(point.y, point.piece)
        at_start = np.abs(started) <= _AT_BORDER * self._unit(point.y, point.piece)
        while h >= control.minimum:
            new = self._corrected(point, h)
            if new is None:
                h *= control.decrease
                continue
            if self._turns_twice(point, new):
                h *= control.decrease
                continue
            easy = new.corrections <= control.easy
            next_h = min(h * control.increase if easy else h, control.maximum)
            beyond = self._distances(new.y, new.piece)
            beyond = beyond < -_BEYOND * self._unit(new.y, new.piece)
            at: Literal["", "kink", "fold", "end"] = ""
            if self._any(beyond):
                border = None
                if not self._any(beyond & at_start):
                    border = self._border(point, new)
                if border is None:
                    h *= control.decrease
                    continue
                new = border
                at = "kink"
                next_h = h
            special = self.smooth_points(point, new)
            folds = [s for s in special if s.kind == "fold"]
            if self.lacks_fold(point, new, special):
                h *= control.decrease
                continue
            if folds:
                new = self._at_fold(point, new, folds[0])
                at = "fold"
                next_h = h
            end = _end_reached(point.gamma, new.gamma, gamma_range)
            if end is not None:
                new = self._at_end(point, new, end)
                at = "end"
            before = [s for s in special if s.kind == "bifurcation"]
            return Arrival(new, at, tuple(before), next_h)
        return None

    def _corrected(self, point: BranchPoint, h: float) -> BranchPoint | None:
        """The point a step ``h`` away on the piece of ``point``."""
        b = self.bordered
        y = point.y.copy()
        t = point.tangent.copy()
        y.axpy(h, point.tangent)
        if not self.corrector.moore_penrose(y, t, point.piece):
            return None
        corrections = self.corrector.iterations
        t.destroy()
        tangent = self.corrector.tangent(y, point.tangent, point.piece)
        if tangent is None or not self.lands(point, h, y, tangent):
            return None
        tau = self.test(accepted=True)
        return self.rescaled(BranchPoint(y, tangent, point.piece, b.gamma(y), h, corrections, tau))

    def _turns_twice(self, point: BranchPoint, new: BranchPoint) -> bool:
        """Whether gamma turns twice in a step, or a border is reached and left again. Collective.

        As far as the cubics through values and rates at the two ends show: a shorter step decides.
        """
        b = self.bordered
        ends = (point, new)
        away = new.y - point.y
        length = self._length(away)
        away.destroy()
        rates = [b.gamma(p.tangent) / self._length(p.tangent) for p in ends]
        if min(rates) * max(rates) > 0 and min(map(abs, rates)) > _IDLE * b.gamma_scale:
            _, slopes = _cubic([p.gamma for p in ends], rates, length)
            if np.any(slopes * rates[0] < 0):
                return True
        events = self._events(point.y, point.piece)
        here, before, after = (
            [self._again(events, p, shift) for p in ends] for shift in (0.0, -_PROBE, _PROBE)
        )
        rises = [(c - a) / (2 * _PROBE) for a, c in zip(before, after, strict=True)]
        values, _ = _cubic(here, rises, length)
        dips = (rises[0] < 0) & (rises[1] > 0) & (np.minimum(*here) >= 0)
        dips &= values.min(axis=0) < -_BEYOND * self._unit(new.y, new.piece)
        return self._any(dips)

    def _again(self, events: Events, point: BranchPoint, away: float) -> np.ndarray:
        """Distances to the borders of a piece, away from a point along its tangent."""
        y = point.y.copy()
        y.axpy(away, point.tangent)
        there = self._events(y, point.piece)
        y.destroy()
        return again(events, there)

    def _border(self, point: BranchPoint, new: BranchPoint) -> BranchPoint | None:
        """Where the first other border is, between two points."""
        found = self._first_event(point, new.y)
        if found is None:
            return None
        s, y = found
        return self._there(point, s, y)

    def _there(self, point: BranchPoint, s: float, y: PETSc.Vec) -> BranchPoint | None:
        tangent = self.corrector.tangent(y, point.tangent, point.piece)
        if tangent is None:
            return None
        corrections = self.corrector.iterations
        return BranchPoint(
            y, tangent, point.piece, self.bordered.gamma(y), s, corrections, self.test()
        )

    def _at_fold(self, point: BranchPoint, new: BranchPoint, fold: SpecialPoint) -> BranchPoint:
        away = fold.y - point.y
        s = float(np.sqrt(self.bordered.inner(away, away)))
        return self._there(point, s, fold.y) or new

    def _at_end(self, point: BranchPoint, new: BranchPoint, gamma: float) -> BranchPoint:
        end, _ = self.end_at(point, new, (), (gamma, gamma))
        if end is not new:
            x, _ = self.bordered.split(end.y)
            self.bordered.join(x, gamma, end.y)  # without the round-off of the corrector
        away = end.y - point.y
        s = float(np.sqrt(self.bordered.inner(away, away)))
        return self._there(point, s, end.y) or end

    def _any(self, which: np.ndarray) -> bool:
        return bool(self.bordered.comm.allreduce(int(which.any())))


def _cubic(
    values: npt.ArrayLike, rates: npt.ArrayLike, length: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Values and derivatives within a step of the cubic that fits its ends (Hermite)."""
    a, c = np.asarray(values)
    da, dc = np.asarray(rates) * length
    s = np.linspace(0.0, 1.0, _SAMPLES)[1:-1, np.newaxis]
    value = a + (c - a) * s**2 * (3 - 2 * s) + s * (1 - s) * (da * (1 - s) - dc * s)
    slope = 6 * (c - a) * s * (1 - s) + da * (1 - s) * (1 - 3 * s) + dc * s * (3 * s - 2)
    return value, slope / length


def _end_reached(before: float, gamma: float, gamma_range: tuple[float, float]) -> float | None:
    """The end of the range that a step from ``before`` to ``gamma`` reaches; None if it does not.

    A kink at the very end, as where all bonds close without load, is found on either side of it.
    """
    low, high = gamma_range
    if not low <= gamma <= high:
        return low if gamma < low else high
    near = _AT_END * (high - low)
    ends = [end for end in gamma_range if abs(gamma - end) <= near < abs(before - end)]
    return ends[0] if ends else None
