# SPDX-License-Identifier: LGPL-3.0-or-later
"""Predictor-corrector steps along a branch, with three policies for kinks (`StepControl.kinks`).

A step predicts along the tangent and corrects; a failed step is shortened. The policies differ in
the equation of the corrector and in the treatment of kinks:

- *Exact* (`ExactSteps`): a step is corrected on one piece. If the distance to a border of the piece
  has become negative, the first such event is located to round-off, and the branch continues on the
  piece beyond (`KinkRayFinder.cross`). If the distance is zero at the start, grows along the
  tangent and is negative at the end, it must vanish in between, for example if a point sticks
  briefly; then the step is shortened.
- *Batched* (`BatchedSteps`): a step is corrected on H itself and may pass any number of kinks. In
  3D hundreds of points change their status one by one, so locating each is too expensive. The step
  is accepted if the branch is monotone: gamma changes by as much as its rates predict, tangents and
  chord satisfy the bound on their angles, and det [grad H; t^T] keeps its sign. Otherwise the step
  is shortened until it contains few changes, which are crossed exactly. Two changes of one point
  within a step, or two folds, are not detected.
- *Stepping* (`SteppingSteps`; T. Ligursky and Y. Renard, Comput. Mech. 56, 2015): as batched, but
  if no step of at least the minimum length succeeds, the next piece is that of a state on the
  tangent, slightly more than the minimum length ahead. Its tangent is tried in both directions.
  Kinks are located up to the minimum length; no other rays are searched for.

The corrector may converge to another part of the solution set. Therefore a point is rejected if its
advance along the tangent differs too much from the step length, if the angle between the chord and
one of the tangents is too large, or if its distance from the prediction exceeds the step length.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.branch import (
    BranchPoint,
    Change,
    Ray,
    SpecialPoint,
    kind_of_kink,
)
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.locate import AT_BORDER, Locator
from dolfinx_contact.continuation.ray_finder import KinkRayFinder
from dolfinx_contact.continuation.system import (
    Piece,
    ResidualScales,
    fractions_to_borders,
    matched_distances,
)

__all__ = ["BatchedSteps", "ExactSteps", "Locate", "SteppingSteps"]

#: Selects the changes to locate in batched steps; called on the rank that owns the point.
Locate: TypeAlias = Callable[[Change], bool]
#: Changes with the fraction of a step at which each occurs if its event is linear.
Changes: TypeAlias = tuple[tuple[float, Change], ...]
#: A corrected state, and the scales of residuals with which it is accepted.
Corrected: TypeAlias = tuple[PETSc.Vec, ResidualScales]
#: The next point, the special points on the way to it, and the length of the step after it.
Advance: TypeAlias = tuple[BranchPoint, list[SpecialPoint], float]

_IDLE = 1e-7  # negligible rate of an event, relative to the largest rate
_NO_STEP = 1e-9  # length of a step that is round-off
_SHARE = 0.5  # largest relative deviation of the advance from the length of a step
_FEW = 3  # number of changes that are crossed exactly instead of shortening the step
_SHORT_OF = 0.9  # fraction of the way to a change to be located, if other changes precede it
_MOST_ATTEMPTS = 6  # number of trial lengths of a batched step before kinks are crossed exactly
_BEYOND = (2.0, 4.0, 8.0)  # ratios h_1 / h_min
_LONGER = (2.0, 8.0, 32.0)  # steps along the tangent beyond a kink, relative to h_1


@dataclass(frozen=True)
class _Trial:
    """Trial step after correction.

    Attributes:
        new: end of the step; None if the step failed.
        changes: changes of status in order, each with the fraction of the step at which it occurs.
            Distances to changes of status are assumed to be linear.
        monotone: True if gamma does not turn back within the step and the parity is positive.
        parity: sign of the ratio of bordered determinants at end and start; 0 if unknown.
    """

    new: BranchPoint | None
    changes: Changes = ()
    monotone: bool = False
    parity: int = 0


class ExactSteps(Locator):
    """Steps ending at every change of status; base class of the other policies.

    Args:
        corrector: corrector on the bordered system.

    Attributes:
        dead_end: reason why the branch cannot be traced further; "" if it can.
    """

    def __init__(self, corrector: Corrector):
        super().__init__(corrector)
        self.dead_end = ""
        #: State of the last kink that was crossed, and the incoming ray there.
        self._incoming: tuple[PETSc.Vec, Ray] | None = None

    def step(self, point: BranchPoint, h: float) -> Advance | None:
        """Take a step of at most the length ``h``; None if no admissible length succeeds."""
        while h >= self.control.minimum:
            result = self._attempt(point, h)
            if not isinstance(result, float):
                return result
            h = result
        return self._over_kink(point)

    def _attempt(self, point: BranchPoint, h: float) -> Advance | float:
        """Try a step of length ``h``; return the length of the next attempt if it fails."""
        shorter = h * self.control.decrease
        corrected = self.corrected_step(point, h, point.piece)
        new = None if corrected is None else self.new_point(point, h, corrected, point.piece)
        if new is None:
            return shorter
        if not self.is_outside(new):
            return self._within_piece(point, new, h) or shorter
        if shorter >= self.control.minimum and self._there_and_back(point, new.y):
            return shorter
        return self._to_the_border(point, h, new.y) or shorter

    def _over_kink(self, point: BranchPoint) -> Advance | None:
        """Continue beyond a kink after all steps have failed; return None if this is impossible."""
        return None

    def piece_between(self, a: BranchPoint, c: BranchPoint) -> Piece | None:
        """Return the statuses between successive points; None if they change in between."""
        return a.piece

    # -- one step --------------------------------------------------------------------------------

    def corrected_step(self, point: BranchPoint, h: float, piece: Piece | None) -> Corrected | None:
        """Return the state after a step of length ``h``; None if it fails.

        On a piece the statuses are fixed; otherwise they follow from the state.
        """
        y = self.bordered.moved(point.y, h, point.tangent)
        scales = self.corrector.moore_penrose(y, point.tangent.copy(), piece)
        return None if scales is None else (y, scales)

    def new_point(
        self,
        point: BranchPoint,
        h: float,
        corrected: Corrected,
        piece: Piece,
        *,
        factorise: bool = False,
        precise: bool = False,
    ) -> BranchPoint | None:
        """Return the end of a step with its tangent; None if the corrected state is rejected.

        Args:
            point: start of the step.
            h: length of the step.
            corrected: corrected state.
            piece: statuses of the corrected state.
            factorise: whether to factorise the matrix of the tangent in any case.
            precise: False if the tangent is used only as the direction of the next step.
        """
        y, scales = corrected
        corrections = self.corrector.iterations
        start = None if precise else point.y
        tangent = self.corrector.tangent(
            y, point.tangent, piece, start=start, factorise=factorise, precise=precise
        )
        if tangent is None or not self.lands(point, h, y, tangent):
            return None
        self.corrector.scales = scales
        # the factorisation of the tangent serves the test function as well
        tau = self.test(tangent, accepted=True)
        return BranchPoint(y, tangent, piece, self.bordered.gamma(y), h, corrections, tau)

    def point_at(self, point: BranchPoint, s: float, y: PETSc.Vec) -> BranchPoint | None:
        """Return the branch point at a located state ``y``; None if the tangent is not unique."""
        tangent = self.corrector.tangent(y, point.tangent, point.piece)
        if tangent is None:
            return None
        corrections = self.corrector.iterations
        gamma = self.bordered.gamma(y)
        return BranchPoint(y, tangent, point.piece, gamma, s, corrections, self.test(tangent))

    def lands(self, point: BranchPoint, h: float, y: PETSc.Vec, tangent: PETSc.Vec) -> bool:
        """Return True if a corrected state continues the branch.

        The advance along the tangent, the angles between the chord and both tangents, and the
        distance from the prediction are bounded, because the corrector may converge to another part
        of the solution set.

        Args:
            point: start of the step.
            h: length of the step.
            y: corrected state.
            tangent: unit tangent at the corrected state.
        """
        b = self.bordered
        away = y - point.y
        chord, start = b.dual(away), b.dual(point.tangent)
        along = float(start.dot(away))
        least = self.control.cosine
        turns = float(start.dot(tangent)) < least
        shortest = least * np.sqrt(float(chord.dot(away)))
        aside = min(along, float(chord.dot(tangent))) < shortest
        off = b.length(b.moved(away, -h, point.tangent))
        return not (turns or aside or abs(along - h) > _SHARE * h or off > h)

    def _within_piece(self, point: BranchPoint, new: BranchPoint, h: float) -> Advance | None:
        """Accept a step without a change of status; return None if a fold in it was not located."""
        special = self.smooth_points(point, new)
        if self.lacks_fold(point, new, special):
            return None
        return self.rescaled(new), special, self._next_length(h, new)

    def _next_length(self, h: float, new: BranchPoint) -> float:
        """Return the length of the next step after an accepted step."""
        control = self.control
        return min(h * control.increase if new.corrections <= control.easy else h, control.maximum)

    # -- kinks -----------------------------------------------------------------------------------

    def _there_and_back(self, point: BranchPoint, y_high: PETSc.Vec) -> bool:
        """Return True if a point that has just changed its status changes it again in a step.

        Its distance to a change is then 0 at the start, grows along the tangent, and is negative at
        the end ``y_high``.
        """
        b = self.bordered
        low, rate = b.events_along(point.y, point.piece, point.tangent)
        border = AT_BORDER * self.unit(low)
        beyond = matched_distances(low, b.events(y_high, point.piece))
        twice = (beyond < -border) & (np.abs(low.distance) <= border)
        return b.anywhere(twice & (rate > _IDLE * b.largest(rate)))

    def _to_the_border(self, point: BranchPoint, h: float, y_high: PETSc.Vec) -> Advance | None:
        """Step to the first change of status before ``y_high`` and cross it; None if this fails."""
        b = self.bordered
        first = self.first_event(point, y_high)
        if first is None:
            return None
        s, y = first
        kink = self.point_at(point, s, y)
        if kink is None:
            return None
        tangent, gamma = kink.tangent, kink.gamma
        special = self.smooth_points(point, kink)
        incoming = Ray(point.piece, tangent)
        tolerance = AT_BORDER * self.unit(b.events(y, point.piece))
        crossing = KinkRayFinder(self.corrector, y, point.piece, tolerance).cross(tangent)
        onwards, *others = crossing.rays or (None,)
        # Reject a ray on the old piece directly after the start: on a singular piece the computed
        # direction is not necessarily a tangent.
        stays = onwards is not None and b.is_same_piece(onwards.piece, point.piece)
        if onwards is None or (stays and s < self.control.minimum):
            tried = "all pieces were tried" if crossing.complete else "too many pieces to try"
            self.dead_end = (
                f"no continuation was found from gamma = {gamma:.10g}, where {crossing.kinks} "
                f"points are at a kink at once ({tried})"
            )
            special.append(SpecialPoint("end", False, gamma, y, complete=crossing.complete))
            return kink, special, h
        if s <= _NO_STEP and self._goes_back(onwards, point):
            return None
        self._incoming = (y, incoming)
        vertex = SpecialPoint(
            kind_of_kink(bool(others), self.turned(tangent, onwards.tangent)),
            False,
            gamma,
            y,
            changes=crossing.changes,
            parity=crossing.parity,
            others=tuple(others),
            complete=crossing.complete,
            incoming=incoming,
            onwards=onwards,
            method=crossing.method,
        )
        new = BranchPoint(y, onwards.tangent, onwards.piece, gamma, s, kink.corrections)
        return self.rescaled(new), [*special, vertex], h

    def _goes_back(self, ray: Ray, point: BranchPoint) -> bool:
        """Return True if a ray leads back along the ray by which the branch reached ``point``."""
        if self._incoming is None or self._incoming[0] is not point.y:
            return False
        incoming = self._incoming[1]
        same = self.bordered.is_same_piece(incoming.piece, ray.piece)
        return same and self.bordered.inner(incoming.tangent, ray.tangent) < 0

    # -- the end of the range --------------------------------------------------------------------

    def end_at(
        self,
        point: BranchPoint,
        new: BranchPoint,
        special: Sequence[SpecialPoint],
        gamma_range: tuple[float, float],
    ) -> tuple[BranchPoint, list[SpecialPoint]]:
        """Compute the point at which gamma leaves its range, and the special points before it.

        Args:
            point: last point inside the range.
            new: first point outside the range.
            special: special points between the two.
            gamma_range: range of gamma.
        """
        low, high = gamma_range
        before = [s for s in special if s.smooth and low <= s.gamma <= high]
        piece = self.piece_between(point, new)
        # interpolate linearly, and correct at fixed gamma
        end = low if new.gamma < low else high
        part = (end - point.gamma) / (new.gamma - point.gamma)
        y = self.bordered.moved(point.y, part, new.y - point.y)
        if not self.corrector.natural(y, end, piece):
            return new, before
        tangent = new.tangent
        own = piece or self.bordered.piece_at(y)
        if not self.bordered.is_same_piece(point.piece, new.piece):
            # at a kink within round-off keep the incoming ray
            tangent = self.corrector.tangent(y, point.tangent, own) or tangent
        last = BranchPoint(y, tangent, own, end, new.step, new.corrections)
        if piece is None:
            before += self._unlocated(point, last, self._changes(point, y, own))
        return last, before

    # -- changes that are not located ------------------------------------------------------------

    def _changes(self, point: BranchPoint, y: PETSc.Vec, piece: Piece) -> Changes:
        """Return the changes of status up to ``y``, each with its fraction of the way, in order."""
        b = self.bordered
        old = point.piece
        low, high = (b.events(state, old) for state in (point.y, y))
        first = np.full(len(old.codes), np.inf)
        np.minimum.at(first, high.point, fractions_to_borders(low, high))
        own = []
        for i in np.flatnonzero(old.codes != piece.codes):
            change = Change(b.comm.rank, int(i), int(old.codes[i]), int(piece.codes[i]))
            own.append((min(float(first[i]), 1.0), change))
        every = [pair for part in b.comm.allgather(own) for pair in part]
        return tuple(sorted(every, key=lambda pair: pair[0]))

    def _unlocated(
        self, point: BranchPoint, new: BranchPoint, changes: Changes, parity: int = 0
    ) -> list[SpecialPoint]:
        """Return one event for each change of status within a step, without locating it."""
        bracket = min(point.gamma, new.gamma), max(point.gamma, new.gamma)
        parity = parity if len(changes) == 1 else 0
        events = []
        for fraction, change in changes:
            gamma = point.gamma + fraction * (new.gamma - point.gamma)
            event = SpecialPoint(
                "event", False, gamma, new.y, changes=(change,), parity=parity, bracket=bracket
            )
            events.append(event)
        return events


class _StepsOnH(ExactSteps):
    """Steps on H itself: the statuses are recomputed from the state, not fixed."""

    def __init__(self, corrector: Corrector):
        super().__init__(corrector)
        #: State of a point of the branch, and the sign of det [grad H; t^T] there.
        self._oriented: tuple[PETSc.Vec, float] | None = None

    def _attempt(self, point: BranchPoint, h: float) -> Advance | float:
        trial = self._trial(point, h)
        new = trial.new
        if new is not None and not trial.changes:
            within = self._within_piece(point, new, h)
            if within is not None:
                if not any(s.kind == "bifurcation" for s in within[1]):
                    self._keep_orientation(point, new)
                return within
        elif new is not None and trial.monotone and self._first_located(trial) > 1:
            special = self._unlocated(point, new, trial.changes, trial.parity)
            return self.rescaled(new), special, self._next_length(h, new)
        return self._shortened(point, trial, h)

    def _first_located(self, trial: _Trial) -> float:
        """Return the fraction of the step at which the first change to be located occurs.

        It is inf if there is none.
        """
        return np.inf

    def _shortened(self, point: BranchPoint, trial: _Trial, h: float) -> Advance | float:
        """Return the length of the next attempt after a rejected trial."""
        return h * self.control.decrease

    def piece_between(self, a: BranchPoint, c: BranchPoint) -> Piece | None:
        return a.piece if self.bordered.is_same_piece(a.piece, c.piece) else None

    def _trial(self, point: BranchPoint, h: float) -> _Trial:
        """Try a step of length ``h`` on H, with statuses recomputed from the state."""
        b = self.bordered
        corrected = self.corrected_step(point, h, None)
        if corrected is None:
            return _Trial(None)
        y, _ = corrected
        piece = b.piece_at(y)
        changes = self._changes(point, y, piece)
        before = self._orientation(point) if changes else 0.0
        new = self.new_point(point, h, corrected, piece, factorise=bool(changes))
        if new is None or not changes:
            return _Trial(new, changes)
        after = b.orientation(new.tangent)
        self._oriented = (y, after)
        parity = int(before * after)
        # gamma continues by less than both rates predict if there are two folds in between
        slower = min(b.gamma(point.tangent), b.gamma(new.tangent), key=abs)
        advance = (new.gamma - point.gamma) * np.sign(slower)
        least = abs(slower) * b.length(y - point.y) / 2
        turned = self.turned(point.tangent, new.tangent) or advance < least
        return _Trial(new, changes, not turned and parity > 0, parity)

    def _orientation(self, point: BranchPoint) -> float:
        """Return the sign of the bordered determinant at a point; 0 if the matrix is singular."""
        if self._oriented is None or self._oriented[0] is not point.y:
            t = self.corrector.tangent(point.y, point.tangent, point.piece, factorise=True)
            self._oriented = (point.y, 0.0 if t is None else self.bordered.orientation(t))
        return self._oriented[1]

    def _keep_orientation(self, point: BranchPoint, new: BranchPoint) -> None:
        """Reuse the sign of the determinant at ``new``, as no bifurcation lies in between."""
        if self._oriented is not None and self._oriented[0] is point.y:
            self._oriented = (new.y, self._oriented[1])


class BatchedSteps(_StepsOnH):
    """Steps that may pass any number of kinks as long as the branch is monotone.

    Args:
        corrector: corrector on the bordered system.
        locate: function of a `Change` that returns True if it must be located, in addition to folds
            and points where the sign of the determinant changes; None for no additional ones.
    """

    def __init__(self, corrector: Corrector, locate: Locate | None):
        super().__init__(corrector)
        self._locate = locate
        self._attempts = 0  # number of trial lengths of this step
        self._exact = False  # whether the kinks of this step are crossed exactly
        #: Length of the step that was refused first, to resume beyond the kink.
        self._refused = 0.0

    def step(self, point: BranchPoint, h: float) -> Advance | None:
        self._attempts = 0
        self._exact = False
        return super().step(point, h)

    def _attempt(self, point: BranchPoint, h: float) -> Advance | float:
        self._exact = self._exact or self._attempts >= _MOST_ATTEMPTS
        self._attempts += 1
        if not self._exact:
            result = super()._attempt(point, h)
            if not self._exact:
                return result
        crossed = ExactSteps._attempt(self, point, h)
        if not isinstance(crossed, float) and any(not s.smooth for s in crossed[1]):
            new, special, h = crossed
            crossed = new, special, max(h, self._refused)
            self._refused = 0.0
        return crossed

    def _shortened(self, point: BranchPoint, trial: _Trial, h: float) -> Advance | float:
        """Return the length of a step that ends before the first change to be located.

        If only a few changes of status remain, the next attempt crosses them one by one.
        """
        self._refused = max(self._refused, h)
        first = self._first_located(trial) if trial.monotone else 1.0
        before = sum(fraction <= first for fraction, _ in trial.changes)
        shorter = h * min(_SHORT_OF * first, self.control.decrease)
        self._exact = 0 < before <= _FEW or shorter < self.control.minimum
        return shorter

    def _first_located(self, trial: _Trial) -> float:
        if self._locate is None:
            return np.inf
        rank = self.bordered.comm.rank
        own = [f for f, change in trial.changes if change.rank == rank and self._locate(change)]
        return self.bordered.least(own)


class SteppingSteps(_StepsOnH):
    """Steps that shrink to the minimum length before a kink and cross it by trial tangents.

    Args:
        corrector: corrector on the bordered system.
    """

    def _over_kink(self, point: BranchPoint) -> Advance | None:
        """Continue beyond a kink that lies within the minimum step length ahead of ``point``."""
        b = self.bordered
        for factor in _BEYOND:
            # the tangent of the piece beyond
            h_1 = factor * self.control.minimum
            beyond = b.moved(point.y, h_1, point.tangent)
            piece = b.piece_at(beyond)
            if b.is_same_piece(piece, point.piece):
                continue
            tangent = self.corrector.tangent(beyond, point.tangent, piece)
            if tangent is None:
                continue
            for t, longer in itertools.product((tangent, -tangent), _LONGER):
                new = self._along(point, t, longer * h_1)
                if new is not None:
                    kink = self._kink(point, new, h_1)
                    return self.rescaled(new), [kink], self.control.initial
        return None

    def _along(self, point: BranchPoint, t: PETSc.Vec, h: float) -> BranchPoint | None:
        """Return the branch point at the distance ``h`` along ``t``; None if there is none."""
        b = self.bordered
        start = replace(point, tangent=t)
        corrected = self.corrected_step(start, h, None)
        if corrected is None:
            return None
        y, _ = corrected
        piece = b.piece_at(y)
        if b.is_same_piece(piece, point.piece) and b.inner(y - point.y, point.tangent) < 0:
            return None
        return self.new_point(start, h, corrected, piece, factorise=True, precise=True)

    def _kink(self, point: BranchPoint, new: BranchPoint, h_1: float) -> SpecialPoint:
        """Return the kink between ``point`` and ``new``, within ``h_1`` of ``point``."""
        parity = int(self._orientation(point) * self._orientation(new))
        changes = tuple(change for _, change in self._changes(point, new.y, new.piece))
        reach = abs(h_1 * self.bordered.gamma(point.tangent))
        bracket = (point.gamma - reach, point.gamma + reach)
        kind = kind_of_kink(parity < 0, self.turned(point.tangent, new.tangent))
        return SpecialPoint(
            kind, False, point.gamma, point.y, changes=changes, parity=parity, bracket=bracket
        )
