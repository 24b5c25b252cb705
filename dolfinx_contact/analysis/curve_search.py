# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for curves of folds and events in two parameters, starting from known points.

On a border one contact point is between two statuses, and the load gamma is a function of the
second parameter mu on some intervals (`family`). An interval ends where a second point reaches a
border, or where displacement and force of the first point vanish; other borders contain the same
state. Within an interval, the equations for the statuses on one side of the border may be singular
at some mu. They then have a line of solutions with one gamma, whose other end lies on another
border; on both borders folds turn into events or vice versa. All these meeting points are roots of
rational functions. The curves are followed from one meeting point to the next.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact.analysis.event_curves import EventCurve, EventCurves, Meeting, Segment
from dolfinx_contact.analysis.family import ContactFamily, Frame
from dolfinx_contact.laws.coulomb import BORDERS, FIRST_BORDER
from dolfinx_contact.laws.status import MINUS, OPEN

__all__ = ["follow_events"]


_SAME = 1e-7  # difference of equal states or of equal mu, relative to their size or range
_ONE = 1e-12  # distance of ends that count as one, relative to the range of mu
_HELD = 1e-8  # distance to a border that counts as zero, relative to the size of the state
_MOST_CHOICES = 256  # borders that may meet at one state


def follow_events(
    family: ContactFamily,
    starts: Sequence[tuple[Codes, float]],
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    *,
    folds_only: bool = True,
) -> EventCurves:
    """Follow the curves of folds and events on given borders, and all curves they meet.

    Args:
        family: problem with two parameters.
        starts: statuses of each border (`Frame`), and a mu at which a state on the border exists.
        mu_range: smallest and largest value of the second parameter mu.
        gamma_range: smallest and largest value of the load parameter gamma.
        folds_only: whether only curves of folds are followed, and no events. Default True.

    Raises:
        ValueError: if no state on a border exists at the given mu.
    """
    search = _Search(family, mu_range, gamma_range, folds_only)
    for codes, mu in starts:
        search.begin(np.asarray(codes, dtype=np.int8), mu)
    search.run()
    return search.result()


class _Search:
    """Search that follows curves segment by segment, through the points where segments meet.

    Attributes:
        meetings: meeting points found so far, states at which segments end (`Meeting`).
    """

    def __init__(
        self,
        family: ContactFamily,
        mus: tuple[float, float],
        gammas: tuple[float, float],
        folds_only: bool,
    ):
        self.family = family
        self.mus = mus
        self.gammas = gammas
        self.folds_only = folds_only
        self.near = _SAME * (mus[1] - mus[0])
        self.meetings: list[Meeting] = []
        self._segments: dict[bytes, list[Segment]] = {}
        self._waiting: list[Segment] = []
        self._done: dict[Segment, None] = {}  # in the order of the search
        self._met: set[tuple[Segment, int]] = set()  # segments and sides of all meetings

    # -- segments --------------------------------------------------------------------------------

    def of(self, codes: Codes) -> list[Segment]:
        """Return all segments of curves that lie on a border, given by its statuses (`Frame`)."""
        key = codes.tobytes()
        if key not in self._segments:
            frame = Frame(self.family, codes)
            found = self._segments[key] = []
            for low, high in self._intervals(frame):
                turns = {t for which in (0, 1) for t in frame.turns(which, (low, high))}
                for a, b in itertools.pairwise([low, *sorted(turns), high]):
                    found.append(Segment(frame, float(a), float(b), frame.kind((a + b) / 2)))
        return self._segments[key]

    def _intervals(self, frame: Frame) -> list[tuple[float, float]]:
        """Return the intervals of mu in which states on the border exist."""
        cuts = [self.mus[0]]
        one = _ONE * (self.mus[1] - self.mus[0])
        for mu in frame.ends(self.mus, self.gammas):
            # At an apex, functions of several points vanish at values that differ by round-off.
            if cuts[-1] + one < mu < self.mus[1] - one:
                cuts.append(float(mu))
        cuts.append(self.mus[1])
        found: list[tuple[float, float]] = []
        for a, b in itertools.pairwise(cuts):
            middle = (a + b) / 2
            low, high = self.gammas
            if a < b and frame.is_inside(middle) and low < frame.gamma(middle) < high:
                if found and found[-1][1] == a:
                    found[-1] = found[-1][0], b
                else:
                    found.append((a, b))
        return found

    def begin(self, codes: Codes, mu: float) -> None:
        """Queue the segments of a border whose intervals contain a given mu."""
        segments = [s for s in self.of(codes) if s.low - self.near <= mu <= s.high + self.near]
        if not segments:
            raise ValueError(f"the border to be followed has no state at mu = {mu:g}")
        self._add(segments)

    def _add(self, segments: Iterable[Segment]) -> None:
        for s in segments:
            if s not in self._done and (s.kind == "fold" or not self.folds_only):
                self._done[s] = None
                self._waiting.append(s)

    def run(self) -> None:
        """Follow all queued segments and the segments that they meet."""
        while self._waiting:
            s = self._waiting.pop()
            for side, mu in ((-1, s.low), (1, s.high)):
                meeting = None if (s, side) in self._met else self._meeting(s, mu)
                if meeting is not None:
                    self.meetings.append(meeting)
                    self._met |= {(t, 1) for t in meeting.left} | {(t, -1) for t in meeting.right}
                    self._add([*meeting.left, *meeting.right])

    # -- meetings --------------------------------------------------------------------------------

    def _meeting(self, s: Segment, mu: float) -> Meeting | None:
        """Return the meeting point at an end of a segment; None at the ends of the ranges."""
        if mu in self.mus:
            return None
        w = s.frame.state(mu)
        gamma = s.frame.gamma(mu)
        if w is None or min(abs(gamma - g) for g in self.gammas) <= 1e-9 * np.ptp(self.gammas):
            return None
        singular = [
            k
            for k in (0, 1)
            if np.min(abs(s.frame.turns(k, self.mus) - mu), initial=1e300) <= self.near * 1e-3
        ]
        borders = [(s.frame.codes, w)]
        choices: list[Codes] | None = []
        if singular:
            borders += [end for k in singular for end in self._far_end(s.frame, k, mu, w)]
        else:
            choices = self._borders_at(w, mu)
            borders += [(codes, w) for codes in choices or []]
        ends = {end: None for border in borders for end in self._ends_at(border[0], mu, border[1])}
        left, right = (tuple(t for t, side in ends if side == one) for one in (1, -1))
        return Meeting(mu, gamma, left, right, bool(singular), choices is not None)

    def _ends_at(self, codes: Codes, mu: float, w: Array) -> Iterator[tuple[Segment, int]]:
        """Yield the segments of a border that end at the state ``w``.

        Each is paired with -1 if its lower end is at this state, 1 if its upper end is.
        """
        for s in self.of(codes):
            for side, end in ((-1, s.low), (1, s.high)):
                if abs(end - mu) <= self.near and self._is_at(s.frame, end, w):
                    yield s, side

    def _is_at(self, frame: Frame, mu: float, w: Array) -> bool:
        there = frame.state(mu)
        if there is None:
            return False
        return bool(self._size(there - w) <= 10 * _SAME * self._size(w))

    def _size(self, w: Array) -> float:
        k = self.family.size
        return float(max(k * np.abs(w[:, :2]).max(), np.abs(w[:, 2:]).max()))

    def _borders_at(self, w: Array, mu: float) -> list[Codes] | None:
        """Return the statuses of all borders that contain a state, shape (m,) each.

        None if there are too many, or if the state of a point satisfies no status.
        """
        f = self.family
        tolerance = _HELD * self._size(w)
        held = [f.held(i, w[i], mu, tolerance) for i in range(f.points)]
        whole = [[c for c in these if c < FIRST_BORDER] for these in held]
        kinked = [i for i in range(f.points) if len(whole[i]) > 1]
        codes = np.array([these[0] if these else -1 for these in whole], dtype=np.int8)
        if (codes < 0).any():
            return None
        found = []
        for i in kinked:
            others = [k for k in kinked if k != i]
            choices = [whole[k] for k in others]
            if np.prod([len(c) for c in choices]) > _MOST_CHOICES:
                return None
            for border in (c for c in held[i] if c >= FIRST_BORDER):
                for chosen in itertools.product(*choices):
                    new = codes.copy()
                    new[i] = border
                    new[others] = chosen
                    found.append(new)
        return found

    def _far_end(
        self, frame: Frame, which: int, mu: float, w: Array
    ) -> Iterator[tuple[Codes, Array]]:
        """Yield the border at the other end of a line of states, and the state there.

        The states on the line solve the singular equations on one side of a border.

        Args:
            frame: border at this end of the line.
            which: side of this border (0 or 1) on which the equations are singular.
            mu: second parameter.
            w: state at this end, shape (m, 4).
        """
        f = self.family
        codes = frame.piece(which)
        A, E = f.columns(codes)
        kernel = np.linalg.svd(A + mu * E)[2][-1]
        direction = f.state(codes, kernel, mu)
        rows = [
            (i, beyond, C_0 + mu * C_1)
            for i, code in enumerate(codes)
            for C_0, C_1, beyond in f.inequalities(i, int(code))
        ]
        slack, rate = (np.array([row @ v[i] for i, _, row in rows]) for v in (w, direction))
        own = next(
            k
            for k, (i, beyond, _) in enumerate(rows)
            if i == frame.point and (beyond == frame.pair[1 - which] or codes[i] == OPEN)
        )
        # Move away from this border until the first other slack vanishes.
        sense = np.sign(rate[own])
        falling = np.flatnonzero((sense * rate < 0) & (np.arange(len(rows)) != own))
        if not len(falling):
            return
        lengths = -slack[falling] / (sense * rate[falling])
        i, beyond, _ = rows[falling[lengths.argmin()]]
        there = w + lengths.min() * sense * direction
        if codes[i] == OPEN and there[i, 0] < 0 and not f.frictionless[i]:
            beyond = MINUS
        pair = sorted((int(codes[i]), beyond))
        codes[i] = FIRST_BORDER + BORDERS.index((pair[0], pair[1]))
        yield codes, there

    # -- curves ----------------------------------------------------------------------------------

    def result(self) -> EventCurves:
        """Join consecutive segments into curves."""
        after = dict(pair for meeting in self.meetings for pair in self._pairs(meeting))
        curves = []
        for first in [s for s in self._done if s not in after.values()]:
            chain = [first]
            while chain[-1] in after:
                chain.append(after[chain[-1]])
            curves.append(EventCurve(first.kind, tuple(chain)))
        curves.sort(key=lambda c: (c.kind != "fold", c.span[0], c.at(sum(c.span) / 2)))
        meetings = sorted(self.meetings, key=lambda m: (m.mu, m.gamma))
        return EventCurves(tuple(curves), tuple(meetings))

    def _pairs(self, meeting: Meeting) -> Iterator[tuple[Segment, Segment]]:
        """Yield pairs (left, right) of segments that form one curve through a meeting point."""
        left, right = (
            [s for s in part if s in self._done] for part in (meeting.left, meeting.right)
        )
        folds = [[s for s in part if s.kind == "fold"] for part in (left, right)]
        if len(folds[0]) == len(folds[1]) == 1:
            yield folds[0][0], folds[1][0]
            left, right = ([s for s in part if s.kind != "fold"] for part in (left, right))
        for s, t in itertools.product(left, right):
            same = s.frame.point == t.frame.point and s.frame.pair == t.frame.pair
            if same and s.kind == t.kind:
                yield s, t
