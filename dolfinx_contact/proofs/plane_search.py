# SPDX-License-Identifier: LGPL-3.0-or-later
"""The search for a proof: branch and bound on the statuses of contact points.

A region is closed, in this order, by the solution of all its pieces, where these are few; by the
proof that no solution is other than one that is known (`check_proof.py`); or by linear programs
that leave nothing (`probing.py`). Else it is branched at the point that counts most where the
second fell short. Every leaf is taken by the steps of the checker, or left open. In leaves that are
left open Newton's method is started: what it finds is certain, if not all there is.
"""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.proofs.candidates import candidates, within
from dolfinx_contact.proofs.check_proof import (
    CLOSED,
    OPENED,
    Certificate,
    InvalidCertificate,
    OpenCells,
    Proved,
    ReducedProblem,
    StatusRegion,
    differences,
    follow,
    restricted,
    solve_piece,
)
from dolfinx_contact.proofs.plane_probing import probe, prove_empty
from dolfinx_contact.proofs.plane_weights import find_weights

__all__ = ["search"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]

_FEW = 64  # pieces that are all solved
_NEAR = -0.02  # least eigenvalue, scaled, from which a branch is tried before linear programs
_TRIES = 12
_LEAST, _STARTS = 8, 300  # in regions that are left open
_BATCH = 4e5  # entries of the matrices of all these starts
_EFFORTS = (15, 80)  # in the search for weights, before and after linear programs


@dataclass
class _Node:
    """A region with what its parent found."""

    region: StatusRegion
    depth: int
    hint: Codes | None


class _Search:
    def __init__(self, problem: ReducedProblem, seconds: float, progress: Callable[[str], None]):
        self.certificate = Certificate(problem)
        self.proved = Proved()
        self.problem = problem.scaled
        self._progress = progress
        self._end = time.monotonic() + seconds
        self._random = np.random.default_rng(0)

    def late(self) -> bool:
        return time.monotonic() > self._end

    def run(self, known: Iterable[Codes]) -> None:
        self._known = [np.asarray(codes, dtype=np.int8) for codes in known]
        whole = StatusRegion.whole(self.problem)
        if self._step({"do": "rest"}, whole):
            return
        waiting = [_Node(whole, 0, None)]
        count = 0
        while waiting:
            node = waiting.pop()
            count += 1
            self._progress(
                f"region {count}, {len(waiting)} waiting, {len(self.proved.inside)} solutions"
            )
            waiting += self._treat(node)
        if self.proved.open_regions:
            self._look_in_open_regions()

    def _look_in_open_regions(self) -> None:
        """Add the solutions that starts in the regions that are left find."""
        regions = [r for r in self.proved.open_regions if not isinstance(r, OpenCells)]
        number = max(_LEAST, min(_STARTS, int(_BATCH / len(self.problem.p) ** 2)))
        starts = within(regions, number, self._random)
        for codes in candidates(self.problem, self.problem.statuses, starts, self._random, 0):
            piece = solve_piece(self.problem, codes)
            if piece is not None and piece.verdict == "inside":
                self.proved.add(piece)

    def _step(self, step: dict[str, Any], region: StatusRegion) -> bool:
        """Take a step that closes a region, if the checker takes it."""
        try:
            follow(self.certificate, step, region, self.proved)
        except InvalidCertificate as error:
            logger.debug("a step was refused: %s", error)
            return False
        self.certificate.steps.append(step)
        return True

    def _treat(self, node: _Node) -> list[_Node]:
        """Close a region, or branch it."""
        region = node.region
        scores = None
        solution = node.hint
        for attempt in range(2):
            if region.pieces <= _FEW:
                self._pieces(region)
                return []
            if self.late():
                break
            closed, scores, least, solution = self._only(region, solution, _EFFORTS[attempt])
            if closed:
                return []
            if attempt == 1 or (least > _NEAR and node.depth % 2):
                break
            before = region.pieces
            if probe(region, self.certificate, self.late):
                return []
            if region.pieces == before:
                break
        if self.late():
            self._step({"do": "open"}, region)
            return []
        return self._branch(node, scores, solution)

    def _pieces(self, region: StatusRegion) -> None:
        """Close a region by its pieces; linear programs examine those that may be singular."""
        singular = []
        for codes in itertools.product(*region.choices):
            if solve_piece(self.problem, np.array(codes, dtype=np.int8)) is None:
                allowed = np.array([1 << s for s in codes], dtype=np.int64)
                held = StatusRegion(
                    self.problem, allowed, restricted(self.problem, allowed, region.ub)
                )
                number = prove_empty(held, self.certificate)
                if number is not None:
                    singular.append([list(codes), number])
        proved = self._step({"do": "pieces", "singular": singular}, region)
        assert proved

    def _only(
        self, region: StatusRegion, hint: Codes | None, effort: int
    ) -> tuple[bool, Array | None, float, Codes | None]:
        """Try to prove that a region holds one solution or none."""
        starts = [c for c in self._known if (region.allowed >> c & 1).all()]
        starts += [q.codes for q in self.proved.inside if (region.allowed >> q.codes & 1).all()]
        starts += [] if hint is None else [hint]
        # Of a problem with decided points any solution does, the first.
        found = candidates(self.problem, region.allowed, starts, self._random, _TRIES)
        for codes in itertools.islice(found, 2):
            piece = solve_piece(self.problem, codes)
            if piece is None:
                continue
            if piece.verdict == "inside":
                self.proved.add(piece)
            d = differences(piece, region.allowed, region.ub)
            if d is None:
                continue
            w = find_weights(d, effort=effort)
            if w.proves:
                step: dict[str, Any] = {"do": "only", "codes": codes.tolist(), "mu": w.mu}
                step |= {"weights": w.weights.tolist(), "theta": w.theta.tolist()}
                if self._step(step, region):
                    return True, None, w.least, codes
            return False, w.bad, w.least, codes
        return False, None, -np.inf, hint

    def _branch(self, node: _Node, scores: Array | None, solution: Codes | None) -> list[_Node]:
        region = node.region
        undecided = np.array([len(c) > 1 for c in region.choices])
        rated: Array = np.asarray(np.linspace(1.0, 0.5, len(undecided)))
        if scores is not None and scores[undecided].max(initial=0.0) > 0:
            rated = scores
        point = int(np.argmax(np.where(undecided, rated, -1.0)))
        parts = _parts(int(region.allowed[point]), int(self._random.integers(2)))
        self.certificate.steps.append({"do": "branch", "point": point, "parts": parts})
        return [
            _Node(region.part(point, mask), node.depth + 1, solution) for mask in reversed(parts)
        ]


def _parts(mask: int, which: int) -> list[int]:
    """How the statuses of a point are parted."""
    opened = mask & OPENED
    closed = mask & CLOSED
    if opened and closed and bin(mask).count("1") > 2:
        return [opened, closed]
    left = [1 << s for s in range(7) if mask >> s & 1]
    if len(left) == 3:
        # Stick with a slip, and the other slip.
        return [left[0] | left[1 + which], left[2 - which]]
    return left


def search(
    problem: ReducedProblem,
    known: Iterable[Codes],
    *,
    seconds: float,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Certificate, Proved]:
    """Look for a proof of what all solutions are.

    Args:
        problem: the reduced problem.
        known: statuses of solutions that are known.
        seconds: after which regions are left open.
        progress: called with where the search is.

    Returns:
        The certificate, with all that was proved, and what it proves.
    """
    searched = _Search(problem, seconds, progress)
    searched.run(known)
    return searched.certificate, searched.proved
