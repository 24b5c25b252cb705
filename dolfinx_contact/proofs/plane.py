# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for a proof in 2D by branch and bound on the statuses of the contact points.

A region is a set of allowed statuses for every point. It is closed, i.e. needs no further steps, by
the first of the following methods that succeeds:

1. the equations are solved for every choice of one status per point, if these choices are few;
2. it is proved to contain no solution other than a known one;
3. linear programs (`relaxation.py`) prove that it is empty.

Otherwise it is branched at the point that contributes most to the failure of method 2.

Method 3 restricts each point to each of its statuses in turn. If the resulting relaxation is
infeasible, its multipliers prove that this status is impossible, and usually they also exclude
statuses of other points; all excluded statuses are removed. A status attained by a feasible point
of a relaxation is not tested.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Ints, Mask
from dolfinx_contact.proofs.candidates import candidates, within
from dolfinx_contact.proofs.check_proof import (
    CLOSED,
    OPENED,
    OpenCells,
    StatusRegion,
    solve_piece,
    used,
)
from dolfinx_contact.proofs.relaxation import Relaxation
from dolfinx_contact.proofs.search import MARGIN, Search, SearchNode

__all__ = ["PlaneSearch"]


_FEW = 64  # number of pieces up to which all are solved
_NEAR = -0.02  # least eigenvalue, scaled, from which a branch is tried before linear programs
_TRIES = 12
_LEAST, _STARTS = 8, 300  # smallest and largest number of starts in open regions
_BATCH = 4e5  # entries of the matrices of all these starts
_EFFORTS = (15, 80)  # iterations of the search for weights, before and after linear programs
_NOTHING = 1e-7  # size of a bounded quantity that counts as zero


class PlaneSearch(Search[StatusRegion]):
    """Search for a proof in 2D by branch and bound on the statuses of the contact points."""

    def _begin(self, known: Iterable[Codes]) -> None:
        self._known = list(known)

    def _look_in_open_regions(self) -> None:
        regions = [r for r in self.proved.open_regions if not isinstance(r, OpenCells)]
        number = max(_LEAST, min(_STARTS, int(_BATCH / len(self.problem.p) ** 2)))
        starts = within(regions, number, self._random)
        for codes in candidates(self.problem, self.problem.statuses, starts, self._random, 0):
            piece = solve_piece(self.problem, codes)
            if piece is not None and piece.verdict == "inside":
                self.proved.add(piece)

    def _treat(self, node: SearchNode[StatusRegion]) -> list[SearchNode[StatusRegion]]:
        region = node.region
        scores = None
        solution = node.hint
        for attempt in range(2):
            if region.pieces <= _FEW:
                self._pieces(region)
                return []
            if self.late():
                break
            closed, scores, least, solution = self._any_only(region, solution, _EFFORTS[attempt])
            if closed:
                return []
            if attempt == 1 or (least > _NEAR and node.depth % 2):
                break
            before = region.pieces
            if self._probe(region):
                return []
            if region.pieces == before:
                break
        if self.late():
            self.step(region, do="open")
            return []
        return self._branch(node, scores, solution)

    def _pieces(self, region: StatusRegion) -> None:
        """Finish a region by solving the equations for every allowed choice of statuses.

        If the equations are singular, a linear program tries to prove that they have no solution.
        """
        singular = []
        for choice in itertools.product(*region.choices):
            codes = np.array(choice, dtype=np.int8)
            if solve_piece(self.problem, codes) is None:
                held = region.held(1 << codes.astype(np.int64))
                y = Relaxation(self.problem, held.allowed, held.ub).infeasible()
                if y is not None and held.excluded(y, MARGIN).any():
                    singular.append([list(choice), self.certificate.vector(y)])
        closed = self.step(region, do="pieces", singular=singular)
        assert closed is not None

    def _any_only(
        self, region: StatusRegion, hint: Codes | None, effort: int
    ) -> tuple[bool, Array | None, float, Codes | None]:
        """Try to prove that a region contains at most one solution.

        All solutions are compared with the solution for one status per point. Up to two such
        choices are tried: known solutions first, then solutions computed by Newton's method.

        Args:
            region: region.
            hint: statuses at which Newton's method starts, shape (m,) for m points, or None.
            effort: iterations of each search for weights.

        Returns:
            Whether this is proved; contributions of the points to the failure, shape (m,), or None;
            least eigenvalue of the weighted sum of inequalities; statuses of the solution used for
            comparison, or the hint, shape (m,).
        """
        starts = [*self._known, *(q.codes for q in self.proved.inside)]
        starts = [c for c in starts if (region.allowed >> c & 1).all()]
        starts += [] if hint is None else [hint]
        # At decided points a candidate may violate the inequalities: the proof does not use them.
        tried = candidates(self.problem, region.allowed, starts, self._random, _TRIES)
        for codes in itertools.islice(tried, 2):
            piece = solve_piece(self.problem, codes)
            if piece is None:
                continue
            if piece.verdict == "inside":
                self.proved.add(piece)
            closed, w = self.only(region, piece, effort)
            if w is not None:
                return closed, w.bad, w.least, codes
        return False, None, -np.inf, hint

    def _branch(
        self, node: SearchNode[StatusRegion], scores: Array | None, solution: Codes | None
    ) -> list[SearchNode[StatusRegion]]:
        region = node.region
        undecided = np.array([len(c) > 1 for c in region.choices])
        rated: Array = np.asarray(np.linspace(1.0, 0.5, len(undecided)))
        if scores is not None and scores[undecided].max(initial=0.0) > 0:
            rated = scores
        point = int(np.argmax(np.where(undecided, rated, -1.0)))
        parts = _parts(int(region.allowed[point]), int(self._random.integers(2)))
        regions = self.step(region, do="branch", point=point, parts=parts)
        assert regions is not None
        return [SearchNode(part, node.depth + 1, solution) for part in regions]

    # -- linear programs --------------------------------------------------------------------------

    def _probe(self, region: StatusRegion) -> bool:
        """Exclude statuses by linear programs that restrict one point to one status at a time.

        All points are tested repeatedly until no further status is excluded or the time limit is
        reached.

        Args:
            region: region, modified in place.

        Returns:
            Whether the region is proved empty.
        """
        changed = True
        while changed:
            changed = False
            relaxation = Relaxation(region.problem, region.allowed, region.ub)
            y = relaxation.infeasible()
            if y is not None and self._take_all_out(region, y):
                return True
            possible = np.zeros((region.problem.points, 7), dtype=bool)
            _see(relaxation, possible)
            for i in _order(region):
                for s in range(7):
                    mask = int(region.allowed[i])
                    if not mask >> s & 1 or mask == 1 << s or possible[i, s]:
                        continue
                    if self.late():
                        return False
                    relaxation.hold(i, 1 << s)
                    y = relaxation.infeasible()
                    if y is None:
                        possible[i, s] = True
                        _see(relaxation, possible)
                    before = region.allowed.copy()
                    if y is not None and self._take_all_out(region, y):
                        return True
                    for k in {i, *map(int, np.flatnonzero(before != region.allowed))}:
                        relaxation.hold(k, int(region.allowed[k]))
                    changed |= bool((before != region.allowed).any())
        return False

    def _take_all_out(self, region: StatusRegion, y: Array) -> bool:
        """Exclude all statuses that a vector of multipliers proves to be impossible.

        Every exclusion lowers bounds, so that the same vector may exclude further statuses. It is
        applied until it excludes nothing.

        Args:
            region: region, modified in place.
            y: multipliers (`check_proof.Dual`), shape (2 m,) for m points.

        Returns:
            Whether the region is proved empty.
        """
        while True:
            excluded, empty = self.take_out(region, y)
            if empty or not excluded.any():
                return empty


def _parts(mask: int, which: int) -> list[int]:
    """Divide the remaining statuses of a point for branching.

    If more than two statuses remain, both open and closed ones, the open ones are separated from
    the closed ones. Otherwise three statuses are divided into two parts: stick with one slip, and
    the other slip. Two statuses are divided into single statuses.

    Args:
        mask: remaining statuses as a bit mask.
        which: slip that remains with stick: 0 for positive, 1 for negative tangential displacement.

    Returns:
        Bit masks of the parts.
    """
    opened = mask & OPENED
    closed = mask & CLOSED
    if opened and closed and bin(mask).count("1") > 2:
        return [opened, closed]
    left = [1 << s for s in range(7) if mask >> s & 1]
    if len(left) == 3:
        # Stick and one slip in one part, the other slip in the second.
        return [left[0] | left[1 + which], left[2 - which]]
    return left


def _order(region: StatusRegion) -> Ints:
    """Return the undecided points: the middle one first, then both halves in the same way."""
    left = [i for i, c in enumerate(region.choices) if len(c) > 1]
    order: list[int] = []
    spans = [(0, len(left))]
    while spans:
        a, b = spans.pop(0)
        if a < b:
            k = (a + b) // 2
            order.append(left[k])
            spans += [(a, k), (k + 1, b)]
    return np.array(order, dtype=np.int64)


def _see(relaxation: Relaxation, possible: Mask) -> None:
    """Mark the statuses attained by the feasible point of a linear program.

    The program cannot exclude these statuses.

    Args:
        relaxation: feasible linear program for m contact points.
        possible: mask by point and status, to which the statuses are added, shape (m, 7).
    """
    positive = relaxation.point > _NOTHING
    off = (positive.T[:, None, :] & ~used(relaxation.problem)).any(axis=2)
    possible |= ~off
