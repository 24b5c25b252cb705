# SPDX-License-Identifier: LGPL-3.0-or-later
"""Location of events, folds and bifurcations between two points of a branch.

A change of sign of a scalar function is located along the branch to round-off by secant steps with
the Illinois rule: the value at an end that stays twice in a row counts half, so that the bracket
shrinks from both sides. Each trial point is corrected from a point on the chord of the bracket. Its
distance from the branch decreases with the square of the length of the bracket, so that the
corrector does not converge to another branch that crosses nearby.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.bifurcation import BifurcationTest
from dolfinx_contact.continuation.branch import BranchPoint, Ray, SpecialPoint
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.system import Events, Piece, fractions_to_borders

__all__ = ["AT_BORDER", "Locator"]

V = TypeVar("V")
#: A point of a step: its state, and its distance from the start of the step along the tangent.
Place = tuple[float, PETSc.Vec]

AT_BORDER = 1e-9  # distance of a located event, relative to the largest distance


@dataclass
class _End(Generic[V]):
    """End of a bracket.

    Attributes:
        s: distance from the start of the step, measured along the tangent at the start.
        y: state (x, gamma).
        value: value of the function to be zeroed, or distances to borders, at this end.
        weight: factor of ``value`` in the next secant step.
        stayed: True if the last step moved the other end.
    """

    s: float
    y: PETSc.Vec
    value: V
    weight: float = 1.0
    stayed: bool = False


def _shrunk(low: _End[V], high: _End[V], new: _End[V], *, beyond: bool) -> tuple[_End[V], _End[V]]:
    """Return the ends of the bracket that remains after a trial point.

    The trial point replaces the end ``high`` if it lies beyond the zero, otherwise ``low``.
    """
    staying = low if beyond else high
    staying.weight /= 2 if staying.stayed else 1
    staying.stayed = True
    return (low, new) if beyond else (new, high)


class Locator:
    """Location of special points on a branch. All methods are collective.

    Args:
        corrector: corrector on the bordered system.

    Attributes:
        test: test function of smooth bifurcations.
        largest_distance: largest distance to a change of status so far, the unit of distances.
    """

    def __init__(self, corrector: Corrector):
        self.corrector = corrector
        self.control = corrector.control
        self.bordered = corrector.bordered
        self.test = BifurcationTest(self.bordered)
        self.largest_distance = 0.0

    # -- events ----------------------------------------------------------------------------------

    def unit(self, events: Events) -> float:
        """Return the largest distance to a change of status so far, the unit of such distances.

        The present distances are not sufficient: all of them may vanish.

        Args:
            events: distances at the present point.
        """
        largest = self.bordered.largest(events.distance)
        self.largest_distance = max(self.largest_distance, largest)
        return self.largest_distance or 1.0

    def is_outside(self, point: BranchPoint) -> bool:
        """Return True if a distance to a change of status is negative by more than round-off."""
        events = self.bordered.events(point.y, point.piece)
        return self.bordered.least(events.distance) < -AT_BORDER * self.unit(events)

    def first_event(self, point: BranchPoint, y_high: PETSc.Vec) -> Place | None:
        """Locate the first change of status between a point and a state; None if this fails.

        The next trial point is the first zero of the linear interpolations of all
        `Events.distance`. A change whose distance is defined only at the far end is located by
        bisection.
        """
        b = self.bordered
        piece = point.piece
        values = b.events(point.y, piece), b.events(y_high, piece)
        low, high, reach = self._bracket(point, y_high, values)
        end = high.s
        for number in range(60):
            weights = low.weight, high.weight
            first = b.least(fractions_to_borders(low.value, high.value, weights))
            s = low.s + first * (high.s - low.s)
            y = b.moved(low.y, first, high.y - low.y)
            if not self._along_chord(point, y, s, piece, reach, polish=True, keep=number > 0):
                return None
            events = b.events(y, piece)
            least = b.least(events.distance)
            unit = self.unit(events)
            if abs(least) <= 1e-13 * unit or high.s - low.s <= 1e-15 * end:
                break
            low, high = _shrunk(low, high, _End(s, y, events), beyond=least < 0)
        # a distance may jump over zero if two solutions of the piece are close to each other
        return (s, y) if abs(least) <= AT_BORDER * unit else None

    def _bracket(
        self, point: BranchPoint, y_high: PETSc.Vec, values: tuple[V, V]
    ) -> tuple[_End[V], _End[V], float]:
        """Return both ends of a bracket, and the distance between them."""
        b = self.bordered
        end = b.inner(point.tangent, y_high) - b.inner(point.tangent, point.y)
        low, high = _End(0.0, point.y, values[0]), _End(end, y_high, values[1])
        return low, high, b.length(y_high - point.y)

    # -- functions of the state and the tangent ----------------------------------------------------

    def locate(
        self,
        point: BranchPoint,
        y_high: PETSc.Vec,
        values: tuple[float, float],
        function: Callable[[PETSc.Vec, PETSc.Vec], float],
        *,
        piece: Piece | None,
    ) -> Place | None:
        """Locate a zero of a function between two points; None if this fails.

        Args:
            point: point at the beginning of the bracket.
            y_high: state at the end of the bracket.
            values: values of the function at both ends of the bracket.
            function: function of a state and its tangent, called after the bordered matrix has been
                assembled there.
            piece: fixed statuses of all points; None to determine them from the state.
        """
        b = self.bordered
        low, high, reach = self._bracket(point, y_high, values)
        end = high.s
        zero: Place | None = None
        f = np.inf
        for number in range(100):
            f_low = low.value * low.weight
            fraction = -f_low / (high.value * high.weight - f_low)
            s = low.s + fraction * (high.s - low.s)
            trial = low.y.copy()
            if number == 0:  # a parabola, since the tangent at the start is available
                trial.axpy(s - end * fraction**2, point.tangent)
            trial.axpy(fraction if number else fraction**2, high.y - low.y)
            if not self._along_chord(point, trial, s, piece, reach):
                break
            tangent = self.corrector.tangent(trial, point.tangent, piece)
            if tangent is None:
                break
            zero = s, trial
            f = function(trial, tangent)
            exact = abs(f) <= b.solver.precision * max(map(abs, values))
            if not np.isfinite(f) or exact or high.s - low.s <= 1e-13 * abs(end):
                break
            low, high = _shrunk(low, high, _End(s, trial, f), beyond=f * low.value <= 0)
        # a change of sign through infinity is not a zero
        return zero if abs(f) < 1e-3 * min(map(abs, values)) else None

    def _along_chord(
        self,
        point: BranchPoint,
        y: PETSc.Vec,
        s: float,
        piece: Piece | None,
        reach: float,
        *,
        polish: bool = False,
        keep: bool = False,
    ) -> bool:
        """Correct ``y``; return False if this fails or leaves the neighbourhood of the tangent.

        Args:
            point: point at the beginning of the bracket.
            y: trial state, corrected in place.
            s: distance from the point along its tangent.
            piece: fixed statuses of all points; None to determine them from the state.
            reach: largest admissible distance of the result from the tangent.
            polish: whether to add a correction after the tolerance has been reached.
            keep: whether to start with the matrix of the previous correction, which must have used
                the same tangent and statuses.
        """
        t = point.tangent
        if not self.corrector.pseudo_arclength(y, point.y, t, s, piece, polish=polish, keep=keep):
            return False
        away = y - point.y
        away.axpy(-self.bordered.inner(away, t), t)
        return self.bordered.length(away) <= reach

    # -- folds and smooth bifurcations -------------------------------------------------------------

    def turned(self, t: PETSc.Vec, new: PETSc.Vec) -> bool:
        """Return True if gamma changes in opposite directions along two tangents."""
        rates = self.bordered.gamma(t), self.bordered.gamma(new)
        least = 1e-9 * self.bordered.gamma_scale
        return rates[0] * rates[1] < 0 and min(map(abs, rates)) > least

    def smooth_points(self, point: BranchPoint, new: BranchPoint) -> list[SpecialPoint]:
        """Return the folds and bifurcations between two points with the same statuses, in order."""
        b = self.bordered
        piece = point.piece
        special: list[tuple[float, SpecialPoint]] = []
        if self.turned(point.tangent, new.tangent):
            rates = b.gamma(point.tangent), b.gamma(new.tangent)
            zero = self.locate(point, new.y, rates, lambda _y, t: b.gamma(t), piece=piece)
            if zero is not None:
                s, y = zero
                special.append((s, SpecialPoint("fold", True, b.gamma(y), y)))
        if point.tau * new.tau < 0:
            taus = point.tau, new.tau
            zero = self.locate(point, new.y, taus, lambda _y, t: self.test(t), piece=piece)
            if zero is not None:
                s, y = zero
                kernel = self.test.kernel()
                crossing = SpecialPoint(
                    "bifurcation",
                    True,
                    b.gamma(y),
                    y,
                    parity=-1,
                    others=(Ray(piece, kernel), Ray(piece, -kernel)),
                    incoming=Ray(piece, self._secant(point.y, y, point.tangent)),
                    onwards=Ray(piece, self._secant(y, new.y, new.tangent)),
                )
                special.append((s, crossing))
        return [s for _, s in sorted(special, key=lambda pair: pair[0])]

    def lacks_fold(self, point: BranchPoint, new: BranchPoint, special: list[SpecialPoint]) -> bool:
        """Return True if gamma turns back between two points although no fold was located.

        Args:
            point: point at the beginning of a step.
            new: point at the end of the step.
            special: special points located within the step.
        """
        turned = self.turned(point.tangent, new.tangent)
        return turned and not any(s.kind == "fold" for s in special)

    def _secant(self, start: PETSc.Vec, end: PETSc.Vec, t: PETSc.Vec) -> PETSc.Vec:
        """Return the unit vector from ``start`` to ``end``; ``t`` if they almost coincide."""
        secant = end - start
        size = self.bordered.length(secant)
        if size < self.control.minimum:
            return t.copy()
        secant.scale(1.0 / size)
        return secant

    def rescaled(self, point: BranchPoint) -> BranchPoint:
        """Return the point with a unit tangent, after setting the scale of x if necessary.

        The scale of x is set from the first tangent that moves x.
        """
        b = self.bordered
        b.set_scale(point.tangent, point.y)
        point.tangent.scale(1.0 / b.length(point.tangent))
        if b.x_scale_is_new or np.isnan(point.tau):
            # the border row has changed, and with it the test function
            b.x_scale_is_new = False
            self.corrector.tangent(point.y, point.tangent, point.piece)
            return replace(point, tau=self.test(point.tangent, accepted=True))
        return point
