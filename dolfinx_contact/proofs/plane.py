# SPDX-License-Identifier: LGPL-3.0-or-later
"""The search for a proof in 2D, on the statuses of contact points.

A region is closed, in this order, by the solutions of all its pieces, if these are few; by the
proof that it holds no solution other than a known one; or by linear programs (`relaxation.py`).
Otherwise it is branched at the point that contributes most to the failure of the second way.

Linear programs hold each point in each of its statuses in turn. If the relaxation is infeasible,
its multipliers are a proof, usually also for other statuses of other points: everything that they
exclude is taken out. Statuses shown to be possible by a point of a relaxation are not tried.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

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

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]

_FEW = 64  # pieces that are all solved
_NEAR = -0.02  # least eigenvalue, scaled, from which a branch is tried before linear programs
_TRIES = 12
_LEAST, _STARTS = 8, 300  # starts in open regions
_BATCH = 4e5  # entries of the matrices of all these starts
_EFFORTS = (15, 80)  # in the search for weights, before and after linear programs
_NOTHING = 1e-7  # slot that counts as zero


class PlaneSearch(Search[StatusRegion]):
    """See the module."""

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
        """Close a region by its pieces; linear programs examine those that may be singular."""
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
        """Try to prove that a region holds at most one solution.

        Returns:
            Whether it is closed, the contributions of the points to the failure (m,), the least
            eigenvalue, and statuses of a solution (m,).
        """
        starts = [*self._known, *(q.codes for q in self.proved.inside)]
        starts = [c for c in starts if (region.allowed >> c & 1).all()]
        starts += [] if hint is None else [hint]
        # With decided points, any solution serves.
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
        """Take statuses out of a region; return whether it is proved empty."""
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
        """Exclude as long as a vector excludes; return whether nothing is left."""
        while True:
            excluded, empty = self.take_out(region, y)
            if empty or not excluded.any():
                return empty


def _parts(mask: int, which: int) -> list[int]:
    """Return how the statuses of a point are divided."""
    opened = mask & OPENED
    closed = mask & CLOSED
    if opened and closed and bin(mask).count("1") > 2:
        return [opened, closed]
    left = [1 << s for s in range(7) if mask >> s & 1]
    if len(left) == 3:
        # Stick with a slip, and the other slip.
        return [left[0] | left[1 + which], left[2 - which]]
    return left


def _order(region: StatusRegion) -> npt.NDArray[np.int64]:
    """Return the undecided points, from their middle, by halves."""
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


def _see(relaxation: Relaxation, possible: npt.NDArray[np.bool_]) -> None:
    """Mark the statuses in which points of the relaxation are."""
    positive = relaxation.point > _NOTHING
    off = (positive.T[:, None, :] & ~used(relaxation.problem)).any(axis=2)
    possible |= ~off
