# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of given arc length with fixed statuses and the memory of their start.

A step begins at an accepted state y_n = (x_n, gamma_n), in the piece of H (H with fixed statuses of
all points) and along the tangent t_n that solve its rate problem (`rate_problem`). With unknowns x,
load gamma and memory m it solves

    H(x, gamma; m_n) = 0  on the piece,        <y - y_n, t_n> = h,

and ends at the first of the following: arc length h, border of the piece (a change of status),
turning point of gamma, end of the range of gamma. All are located to round-off. The memory m_n
belongs to the start: breaking bonds continue to break, and slipping points to slip.

A step is too long and is shortened if

1. the corrector fails or converges to another part of the solution set (`ExactSteps.lands`),
2. gamma turns twice within the step, or a border is reached and left again,
3. a point that started at a border has crossed it: a bond would heal, or slip would be reversed.

If a bond stops breaking or a point stops slipping within a step, the rate problem at its end
detects the change; the resulting error is of second order in the step length.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact.continuation.branch import BranchPoint, Ray, SpecialPoint
from dolfinx_contact.continuation.steps import ExactSteps
from dolfinx_contact.continuation.system import Piece, matched_distances
from dolfinx_contact.evolution.rate_problem import RateProblem

__all__ = ["ArcSteps", "Arrival"]

#: End of a step with its piece and tangent; folds and bifurcations within the step; length of the
#: next step; whether the end of the range of gamma is reached.
Arrival: TypeAlias = tuple[BranchPoint, list[SpecialPoint], float, bool]

# Distances to borders, relative to the largest distance of the run:
_AT_BORDER = 1e-10  # distance up to which a point is at the border, and its rate decides
_BEYOND = 1e-9  # negative distance from which a point is beyond the border
# Relative to the range of gamma:
_AT_END = 1e-10  # distance up to which gamma is at the end of its range
_IDLE = 1e-7  # rate of gamma that counts as zero

_PROBE = 1e-4  # arc length of central differences
_SAMPLES = 17  # points at which the cubic of a step is sampled


class ArcSteps(ExactSteps):
    """Solver of the steps of a path, with the memory at the start of each step.

    The caller advances the memory after an accepted step.
    """

    @property
    def known(self) -> dict[str, Any]:
        """Scales and signs that the steps of the run have determined, by name.

        ================  =========================================================================
        x_scale           square of the length of x that counts as much as one unit of gamma; 0
                          before a tangent has moved x
        largest_distance  largest distance of a state to a change of status so far
        scales            scales of the residuals (`System.measure`)
        signs             signs of the test for bifurcations
        ================  =========================================================================
        """
        b = self.bordered
        return {
            "x_scale": b.x_scale / b.gamma_scale**2,
            "largest_distance": self.largest_distance,
            "scales": self.corrector.scales,
            "signs": tuple(map(float, self.test.signs)),
        }

    def restore(self, known: Mapping[str, Any]) -> None:
        """Restore the scales and signs of a run that is resumed, see `known`."""
        self.bordered.x_scale = known["x_scale"] * self.bordered.gamma_scale**2
        self.largest_distance = known["largest_distance"]
        self.corrector.scales = tuple(known["scales"])
        if len(known["signs"]) == len(self.test.signs):
            self.test.signs[:] = known["signs"]

    def rate_problem(self, y: PETSc.Vec, piece: Piece) -> RateProblem:
        """Return the rate problem at y = (x, gamma) after a step on ``piece``. Collective."""
        unit = self.unit(self.bordered.events(y, piece))
        return RateProblem(self.corrector, y, _AT_BORDER * unit, _BEYOND * unit)

    def leave(self, point: BranchPoint, ray: Ray) -> BranchPoint:
        """Return a branch point with the statuses and tangent of an outgoing ray. Collective."""
        if ray.tangent is point.tangent:
            return point
        new = BranchPoint(point.y, ray.tangent, ray.piece, point.gamma, point.step, 0)
        return self.rescaled(new)

    def arrive(
        self, point: BranchPoint, h: float, gamma_range: tuple[float, float]
    ) -> Arrival | None:
        """Take a step of at most a given arc length. Collective.

        Args:
            point: start of the step, with the statuses and the tangent of the step.
            h: largest arc length.
            gamma_range: range of gamma.

        Returns:
            End of the step; None if no step of at least the shortest length succeeds.
        """
        events = self.bordered.events(point.y, point.piece)
        at_border = np.abs(events.distance) <= _AT_BORDER * self.unit(events)
        while h >= self.control.minimum:
            arrival = self._step_of(point, h, at_border, gamma_range)
            if arrival is not None:
                return arrival
            h *= self.control.decrease
        return None

    def _step_of(
        self,
        point: BranchPoint,
        h: float,
        at_border: Mask,
        gamma_range: tuple[float, float],
    ) -> Arrival | None:
        """Take a step of arc length h, or a shorter one up to a change of status. Collective.

        The step also ends where gamma turns back or its range ends. None if h is too long (see the
        module).

        Args:
            point: start of the step, with the statuses and the tangent of the step.
            h: arc length.
            at_border: mask of the distances to changes of status that are zero at the start of the
                step, one entry per distance on this rank.
            gamma_range: range of gamma.
        """
        new = self._corrected(point, h)
        if new is None or self._turns_twice(point, new):
            return None
        next_h = self._next_length(h, new)
        # the first border of the piece
        events = self.bordered.events(new.y, new.piece)
        beyond = events.distance < -_BEYOND * self.unit(events)
        if self.bordered.anywhere(beyond):
            if self.bordered.anywhere(beyond & at_border):
                return None
            crossing = self.first_event(point, new.y)
            border = None if crossing is None else self.point_at(point, *crossing)
            if border is None:
                return None
            new, next_h = border, h
        # folds and bifurcations on the piece
        special = self.smooth_points(point, new)
        if self.lacks_fold(point, new, special):
            return None
        folds = [s for s in special if s.kind == "fold"]
        if folds:
            new = self.point_at(point, self._distance(point, folds[0].y), folds[0].y) or new
            next_h = h
        # the end of the range
        end = _reached_end(point.gamma, new.gamma, gamma_range)
        if end is not None:
            new = self._at_end(point, new, end)
        return new, special, next_h, end is not None

    def _corrected(self, point: BranchPoint, h: float) -> BranchPoint | None:
        """Return the point at arc length ``h`` on the piece; None if the corrector fails."""
        corrected = self.corrected_step(point, h, point.piece)
        new = None
        if corrected is not None:
            new = self.new_point(point, h, corrected, point.piece, precise=True)
        return None if new is None else self.rescaled(new)

    def _turns_twice(self, point: BranchPoint, new: BranchPoint) -> bool:
        """Return whether gamma turns twice, or a status changes and changes back. Collective.

        Both decisions use cubic interpolants of values and rates at the two ends of the step. If an
        interpolant turns although the solution does not, the step is shortened unnecessarily.
        """
        b = self.bordered
        ends = (point, new)
        length = self._distance(point, new.y)
        # gamma
        rates = [b.gamma(p.tangent) / b.length(p.tangent) for p in ends]
        if min(rates) * max(rates) > 0 and min(map(abs, rates)) > _IDLE * b.gamma_scale:
            _, slopes = _cubic([p.gamma for p in ends], rates, length)
            if np.any(slopes * rates[0] < 0):
                return True
        # distances to the borders of the piece
        events = self.bordered.events(point.y, point.piece)

        def distances(p: BranchPoint, shift: float) -> Array:
            y = b.moved(p.y, shift, p.tangent)
            return matched_distances(events, b.events(y, p.piece))

        at_ends = [distances(p, 0.0) for p in ends]
        growth = [(distances(p, _PROBE) - distances(p, -_PROBE)) / (2 * _PROBE) for p in ends]
        inside, _ = _cubic(at_ends, growth, length)
        dips = (growth[0] < 0) & (growth[1] > 0) & (np.minimum(*at_ends) >= 0)
        unit = self.unit(b.events(new.y, new.piece))
        dips &= inside.min(axis=0) < -_BEYOND * unit
        return b.anywhere(dips)

    def _at_end(self, point: BranchPoint, new: BranchPoint, gamma: float) -> BranchPoint:
        """Return the point of a step at which ``gamma``, an end of its range, is reached."""
        end, _ = self.end_at(point, new, (), (gamma, gamma))
        if end is not new:
            x, _ = self.bordered.split(end.y)
            self.bordered.join(x, gamma, end.y)  # remove the round-off of the corrector
        return self.point_at(point, self._distance(point, end.y), end.y) or end

    def _distance(self, point: BranchPoint, y: PETSc.Vec) -> float:
        """Return the distance between a branch point and a vector ``y``, as an arc length."""
        return self.bordered.length(y - point.y)


def _cubic(values: npt.ArrayLike, rates: npt.ArrayLike, length: float) -> tuple[Array, Array]:
    """Sample the cubic Hermite interpolant of a step.

    Args:
        values: values at both ends of the step, shape (2,) or (2, n).
        rates: derivatives with respect to arc length at both ends, of the same shape.
        length: length of the step.

    Returns:
        Values and derivatives at points inside the step, shape (samples, 1) or (samples, n) each.
    """
    a, c = np.asarray(values)
    da, dc = np.asarray(rates) * length
    s = np.linspace(0.0, 1.0, _SAMPLES)[1:-1, np.newaxis]
    value = a + (c - a) * s**2 * (3 - 2 * s) + s * (1 - s) * (da * (1 - s) - dc * s)
    slope = 6 * (c - a) * s * (1 - s) + da * (1 - s) * (1 - 3 * s) + dc * s * (3 * s - 2)
    return value, slope / length


def _reached_end(before: float, gamma: float, gamma_range: tuple[float, float]) -> float | None:
    """Return the end of the range of gamma that a step reaches; None if it stays inside.

    A kink at an end of the range, for example where all bonds close without load, may be located on
    either side of this end. Hence an end counts as reached within round-off, unless the step
    started there.

    Args:
        before: gamma at the start of the step.
        gamma: gamma at its end.
        gamma_range: range of gamma.
    """
    low, high = gamma_range
    if not low <= gamma <= high:
        return low if gamma < low else high
    near = _AT_END * (high - low)
    ends = [end for end in gamma_range if abs(gamma - end) <= near < abs(before - end)]
    return ends[0] if ends else None
