# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves of folds and events in two parameters, and the strips between their meeting points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.analysis.family import Frame
from dolfinx_contact.laws import status

__all__ = [
    "EventCurve",
    "EventCurves",
    "Meeting",
    "Segment",
    "layers",
    "strips",
]


_SAME = 1e-9  # fraction of the range of mu below which two values are equal


@dataclass(frozen=True, eq=False)
class Segment:
    """Part of a curve of folds or events on which all statuses are constant.

    Attributes:
        frame: border of the segment, with one contact point between two statuses (`family`).
        low: smallest value of the second parameter mu.
        high: largest value of mu.
        kind: ``"fold"`` if branches turn back in gamma at the curve, ``"event"`` if they continue.
    """

    frame: Frame
    low: float
    high: float
    kind: str

    @property
    def statuses(self) -> tuple[str, str]:
        """Statuses on both sides of the curve, as strings with one letter per contact point."""
        return status.word(self.frame.piece(0)), status.word(self.frame.piece(1))


@dataclass(frozen=True, eq=False)
class Meeting:
    """Meeting point: a state at which several segments end.

    Attributes:
        mu: value of the second parameter.
        gamma: value of the load parameter.
        left: segments ending here, at smaller mu.
        right: segments ending here, at larger mu.
        singular: True if the segments end at the two ends of a line of states with this mu and
            gamma, on which no status changes; False if they end at a single state in which two
            points are at a border.
        complete: False if too many points are at a border to follow all segments.
    """

    mu: float
    gamma: float
    left: tuple[Segment, ...]
    right: tuple[Segment, ...]
    singular: bool
    complete: bool = True

    @property
    def is_cusp(self) -> bool:
        """Whether two curves of folds end here and lie on the same side."""
        counts = sorted(sum(s.kind == "fold" for s in side) for side in (self.left, self.right))
        return counts == [0, 2]


@dataclass(frozen=True, eq=False)
class EventCurve:
    """Curve of folds or events: a chain of segments with increasing second parameter mu.

    Attributes:
        kind: kind of all segments, "fold" or "event".
        segments: consecutive segments; each begins at the end of the preceding one.
    """

    kind: str
    segments: tuple[Segment, ...]

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest value of the second parameter mu on the curve."""
        return self.segments[0].low, self.segments[-1].high

    def at(self, mu: float) -> float:
        """Return gamma on the curve at a given mu; NaN outside the span."""
        segment = self._segment_at(mu)
        return float("nan") if segment is None else segment.frame.gamma(mu)

    def statuses_at(self, mu: float) -> tuple[str, str]:
        """Return the statuses on both sides at mu, as strings with one letter per contact point.

        Raises:
            ValueError: if mu is outside the span.
        """
        segment = self._segment_at(mu)
        if segment is None:
            raise ValueError(f"the curve does not reach {mu:g}: {self.span}")
        return segment.statuses

    def _segment_at(self, mu: float) -> Segment | None:
        """Return the segment whose span contains mu; None outside the span of the curve."""
        return next((s for s in self.segments if s.low <= mu <= s.high), None)

    @property
    def breaks(self) -> Array:
        """Values of mu, sixteen per segment, between which two curves should cross at most once."""
        return np.asarray(self.points(16)[:, 0])

    def points(self, number: int = 8) -> Array:
        """Return n points (mu, gamma), with ``number`` intervals per segment, shape (n, 2)."""
        first, _ = self.span
        mus = [np.linspace(s.low, s.high, number + 1)[1:] for s in self.segments]
        return np.array([(mu, self.at(mu)) for mu in (first, *np.concatenate(mus))])

    def crossings(self, other: EventCurve) -> list[float]:
        """Return all mu at which this curve crosses another one, in increasing order.

        Between two neighbouring `breaks` of either curve, the curves cross if their order at these
        two values differs. Crossings are exact up to round-off.
        """
        low = max(self.span[0], other.span[0])
        high = min(self.span[1], other.span[1])
        mus = np.union1d(self.breaks, other.breaks)
        mus = mus[(low < mus) & (mus < high)]
        apart = np.array([self.at(mu) - other.at(mu) for mu in mus])
        places = np.flatnonzero(apart[:-1] * apart[1:] < 0)
        found = [_crossing(self, other, mus[k], mus[k + 1]) for k in places]
        return sorted([*found, *mus[apart == 0].tolist()])


@dataclass(frozen=True, eq=False)
class EventCurves:
    """Curves of folds and events in the parameters (mu, gamma), and their meeting points.

    Attributes:
        curves: curves of folds, then of events, sorted by mu and gamma.
        meetings: ends of the followed segments, sorted by mu and gamma.
    """

    curves: tuple[EventCurve, ...]
    meetings: tuple[Meeting, ...]

    @property
    def folds(self) -> tuple[EventCurve, ...]:
        """Curves of folds, at which branches turn back in gamma."""
        return tuple(c for c in self.curves if c.kind == "fold")

    @property
    def cusps(self) -> tuple[tuple[float, float], ...]:
        """Points (mu, gamma) at which two curves of folds end."""
        return tuple((m.mu, m.gamma) for m in self.meetings if m.is_cusp)

    @property
    def crossings(self) -> tuple[tuple[float, float], ...]:
        """Points (mu, gamma) at which two curves of folds cross, ordered by mu."""
        found = []
        for a, b in combinations(self.folds, 2):
            found += [(mu, a.at(mu)) for mu in a.crossings(b)]
        return tuple(sorted(found))

    def folds_at(self, mu: float) -> list[float]:
        """Return the values of gamma on all curves of folds at mu, in decreasing order."""
        there = (c.at(mu) for c in self.folds)
        return sorted((g for g in there if np.isfinite(g)), reverse=True)


def strips(curves: Sequence[EventCurve], mus: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the intervals of mu in which the set and the order of the curves are constant."""
    cuts = {mu for curve in curves for mu in curve.span}
    cuts |= {mu for a, b in combinations(curves, 2) for mu in a.crossings(b)}
    near = _SAME * (mus[1] - mus[0])
    inside = [mus[0]]
    for mu in sorted(cuts):
        if inside[-1] + near < mu < mus[1] - near:
            inside.append(mu)
    return list(pairwise([*inside, mus[1]]))


def layers(
    curves: Sequence[EventCurve], strip: tuple[float, float], near: float
) -> list[tuple[EventCurve, ...]]:
    """Return the curves in a strip from bottom to top, with coinciding curves grouped.

    Args:
        curves: curves in any order.
        strip: interval of mu from `strips`.
        near: difference of gamma up to which curves coincide.
    """
    middle = (strip[0] + strip[1]) / 2
    there = [(curve.at(middle), curve) for curve in curves]
    there = sorted(((g, c) for g, c in there if np.isfinite(g)), key=lambda pair: pair[0])
    cuts = np.flatnonzero(np.diff([g for g, _ in there]) > near) + 1
    ends = [0, *map(int, cuts), len(there)] if there else []
    return [tuple(c for _, c in there[a:b]) for a, b in pairwise(ends)]


def _crossing(a: EventCurve, b: EventCurve, low: float, high: float) -> float:
    """Return the mu between ``low`` and ``high`` at which two curves cross, by bisection."""
    above = a.at(low) > b.at(low)
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if (a.at(middle) > b.at(middle)) == above else (low, middle)
    return float(middle)
