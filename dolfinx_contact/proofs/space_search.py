# SPDX-License-Identifier: LGPL-3.0-or-later
"""The search for a proof in space: branch and bound on cells of contact points.

A region is closed, in this order, by the proof that it holds no more than one solution, from
quadratic inequalities (`weights.py`) or, with decided types, from an interval matrix; or by linear
programs that leave nothing (`probing.py`), which also bound what is left; arcs are halved where few
are left. Else it is branched at the point where the linear program violates the law most. Every
leaf is taken by the steps of the checker, or left open with the reason. When time is over Newton's
method is started in what is left: what it finds is certain, if not all there is.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.proofs.check_proof import (
    IN_CLOSED,
    IN_OPEN,
    IN_SLIP,
    IN_STICK,
    IS_OPEN,
    Cells,
    Certificate,
    InvalidCertificate,
    OpenCells,
    Proved,
    ReducedProblem,
    SpaceRegion,
    follow_in_space,
    rays,
    solve_in_space,
    space_differences,
)
from dolfinx_contact.proofs.pieces import (
    codes_of,
    piece_at,
    relaxed,
    rounded,
    solved_piece,
    unknowns,
)
from dolfinx_contact.proofs.space_probing import Probing
from dolfinx_contact.proofs.space_weights import find_space_weights
from dolfinx_contact.proofs.starts import many_solutions

__all__ = ["search_in_space"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]
State = tuple[Array, Array]

_PASSES = 12
_FIRST_STARTS, _STARTS = 8, 300
_BATCH = 4e5  # entries of the matrices of a batch of starts, over their number
_EFFORTS = {0: 40, 1: 80, 3: 80}  # in the search for weights, by pass
_NARROW = 2.0**-12  # arcs that are not branched
_FEW = 3  # arcs of a point that are halved
_GAIN = 0.2  # below which a pass has brought nothing
_TIME = "time is over"
_NARROW_WORDS = "arcs are too narrow: a continuum or a border may be there"


@dataclass
class _Node:
    """A region and how deep it is."""

    region: SpaceRegion
    depth: int


class _Search:
    def __init__(self, problem: ReducedProblem, seconds: float, progress: Callable[[str], None]):
        self.certificate = Certificate(problem)
        self.proved = Proved()
        self.problem = problem.scaled
        self._progress = progress
        self._end = time.monotonic() + seconds
        self._random = np.random.default_rng(0)
        self._probing = Probing(self.certificate, self.late)
        self._known: list[State] = []
        self._searched = False

    def late(self) -> bool:
        return time.monotonic() > self._end

    def run(self, known: Iterable[Array]) -> None:
        region = SpaceRegion.whole(self.problem)
        if self._step({"do": "rest"}, region):
            return
        length, force = self.certificate.problem.units
        for state in known:
            self._known.append(
                (np.asarray(state[:, :3] / length), np.asarray(state[:, 3:] / force))
            )
        if not self._known:
            self._look_for_solutions(_FIRST_STARTS)
        waiting = [_Node(region, 0)]
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
        logger.debug("%d regions, %d linear programs", count, self._probing.programs)

    def _look_for_solutions(self, number: int, regions: Sequence[Cells] = ()) -> None:
        most = int(_BATCH / len(self.problem.p) ** 2)
        number = max(8, min(number, most))
        self._known += many_solutions(self.problem, number, self._random, regions)

    def _look_in_open_regions(self) -> None:
        """Add the solutions that are known beside the proof, and what starts in regions find."""
        if self.late():
            cells = [r.cells for r in self.proved.open_regions if isinstance(r, OpenCells)]
            self._look_for_solutions(_STARTS, cells)
        for a, r in self._known:
            piece = piece_at(self.problem, a, r)
            if piece is None or piece.verdict != "inside":
                continue
            try:
                self.proved.add(piece)
            except InvalidCertificate as error:
                logger.debug("a solution is left out: %s", error)

    def _step(self, step: dict[str, Any], region: SpaceRegion) -> bool:
        """Take a step that closes a region, if the checker takes it."""
        try:
            follow_in_space(self.certificate, step, region, self.proved)
        except InvalidCertificate as error:
            logger.debug("a step was refused: %s", error)
            return False
        self.certificate.steps.append(step)
        return True

    def _treat(self, node: _Node) -> list[_Node]:
        """Close a region, or branch it."""
        region = node.region
        point: State | None = None
        for number in range(_PASSES):
            if number in _EFFORTS and self._only(region, point, _EFFORTS[number]):
                return []
            if self.late():
                self._step({"do": "open", "why": _TIME}, region)
                return []
            if number == 0 and not self._searched:
                self._searched = True
                self._look_for_solutions(_STARTS)
                if self._only(region, None, _EFFORTS[1]):
                    return []
            if self._probing.known(region):
                return []
            hull = self._probing.whole(region)
            if hull is None:
                return []
            point = hull.point
            if number == 0 and self._only(region, point, 60):
                return []
            if self._leaf(region, point):
                return []
            before = _measure(region)
            if self._probing.cells(region, hull):
                return []
            shrunk = self._probing.bounds(region, hull, all_points=node.depth == 0)
            gained = before - _measure(region)
            halved = self._halve(region)
            if gained < _GAIN and shrunk < _GAIN and not (halved and number < 1):
                break
        assert point is not None
        return self._branch(node, point)

    # -- leaves -----------------------------------------------------------------------------------

    def _only(self, region: SpaceRegion, point: State | None, effort: int) -> bool:
        """Try to prove that a region holds one solution or none, by quadratic inequalities."""
        for number, (codes, z) in enumerate(self._candidates(region, point)):
            if number == 2 or self.late():
                break
            if z is None:
                continue
            piece = solve_in_space(self.problem, codes, z)
            if piece is None:
                continue
            d = space_differences(piece, region.cells, region.most)
            if d is None:
                continue
            w = find_space_weights(d, effort=effort, until=self._end)
            if w.proves:
                step = {"do": "only", "codes": codes.tolist(), "z": z.tolist(), "mu": w.mu}
                if self._step({**step, "weights": w.weights.tolist()}, region):
                    return True
        return False

    def _candidates(
        self, region: SpaceRegion, point: State | None
    ) -> Iterator[tuple[Codes, Array | None]]:
        """Pieces to try: of known solutions, then what Newton's method makes of the point."""
        kinds = region.kinds
        seen = set()
        for a, r in self._known:
            codes = codes_of(self.problem, a, r)
            fits = all(
                _kind(int(code), F) in allowed
                for code, F, allowed in zip(codes, self.problem.friction, kinds, strict=True)
            )
            if fits and codes.tobytes() not in seen:
                seen.add(codes.tobytes())
                yield codes, solved_piece(self.problem, codes, unknowns(self.problem, codes, a, r))
        if point is None:
            return
        codes = rounded(self.problem, kinds, *point)
        z = solved_piece(self.problem, codes, unknowns(self.problem, codes, *point))
        codes, z = relaxed(self.problem, kinds, codes, z)
        if codes.tobytes() not in seen:
            yield codes, z

    def _leaf(self, region: SpaceRegion, point: State) -> bool:
        """Try to close a region of decided types by the interval matrix."""
        kinds = region.kinds
        if any(len(allowed) > 1 for allowed in kinds) or (self.problem.g > 0).any():
            return False
        codes = rounded(self.problem, kinds, *point)
        z = unknowns(self.problem, codes, *point)
        for i in np.flatnonzero((codes == 2) & (self.problem.friction > 0)):
            z[i, 1] = _within(region, int(i), z[i, 1], *point)
            z[i, 0] = max(z[i, 0], 1e-6)
            z[i, 2] = max(z[i, 2], 1e-6)
        found = solved_piece(self.problem, codes, z)
        if found is None:
            return False
        return self._step({"do": "leaf", "codes": codes.tolist(), "z": found.tolist()}, region)

    # -- arcs and branches ------------------------------------------------------------------------

    def _halve(self, region: SpaceRegion) -> bool:
        """Halve arcs where a point has few of them left."""
        done = False
        for i in range(self.problem.points):
            cells = region.cells
            arcs = cells.ends[(cells.node == i) & (cells.kind == IN_SLIP)]
            width = (arcs[:, 1] - arcs[:, 0]).max(initial=0.0)
            if 0 < len(arcs) <= _FEW and width > 4 * _NARROW:
                self.certificate.steps.append({"do": "halve", "point": i})
                region.cells = cells.halved(i)
                done = True
        return done

    def _branch(self, node: _Node, point: State) -> list[_Node]:
        region = node.region
        scores = _violations(self.problem, region, *point)
        i = int(np.argmax(scores))
        if scores[i] < 0:
            self._step({"do": "open", "why": _NARROW_WORDS}, region)
            return []
        parts = _parts(region, i)
        while parts is None:
            self.certificate.steps.append({"do": "halve", "point": i})
            region.cells = region.cells.halved(i)
            parts = _parts(region, i)
        step = {"do": "branch", "point": i, "parts": parts}
        self.certificate.steps.append(step)
        regions = follow_in_space(self.certificate, step, region, self.proved)
        return [_Node(part, node.depth + 1) for part in regions]


def _kind(code: int, friction: float) -> int:
    """The kind of cell of a status."""
    if friction == 0:
        return IN_OPEN if IS_OPEN[code] else IN_CLOSED
    return {0: IN_OPEN, 1: IN_STICK, 2: IN_SLIP}[int(code)]


def _measure(region: SpaceRegion) -> float:
    """The logarithm of the size of a region, cell by cell."""
    cells = region.cells
    sizes = np.where(cells.kind == IN_SLIP, 0.3 + cells.ends[:, 1] - cells.ends[:, 0], 1.0)
    return float(np.log(np.bincount(cells.node, sizes)).sum())


def _within(region: SpaceRegion, i: int, angle: float, a: Array, r: Array) -> float:
    """The angle, or that of the middle of the arcs if it is not in them."""
    hull = region.cells.hull(i)
    assert hull is not None
    ends = _angle(hull[0]), _angle(hull[0] + hull[1])
    width = (ends[1] - ends[0]) % (2 * np.pi) if hull[1] < 4 else 2 * np.pi
    pull = a[i, :2] - r[i, :2]
    if np.hypot(*pull) > 1e-12:
        angle = float(np.arctan2(pull[1], pull[0]))
    inside = (angle - ends[0]) % (2 * np.pi) <= width
    return angle if inside else ends[0] + width / 2


def _angle(q: float) -> float:
    """The angle of a diamond angle."""
    x, y = rays(np.array(q))
    return float(np.arctan2(y, x))


def _violations(problem: ReducedProblem, region: SpaceRegion, a: Array, r: Array) -> Array:
    """By how much a state violates the law; -1 at points that cannot be branched (m,)."""
    cells = region.cells
    F = problem.friction
    slid = np.hypot(a[:, 0], a[:, 1])
    limit = F * r[:, 2]
    along = r[:, :2] * slid[:, None] + limit[:, None] * a[:, :2]
    found = a[:, 2] * r[:, 2] + np.hypot(along[:, 0], along[:, 1])
    found += slid * np.abs(limit - np.hypot(r[:, 0], r[:, 1]))
    found = np.where(F > 0, found, a[:, 2] * r[:, 2])
    width = np.bincount(cells.node, cells.ends[:, 1] - cells.ends[:, 0], problem.points)
    kinds = np.array([len(k) for k in region.kinds])
    found += 1e-3 * (kinds - 1) + 1e-6 * width
    return np.where((kinds > 1) | (width > _NARROW), found, -1.0)


def _parts(region: SpaceRegion, i: int) -> list[list[int]] | None:
    """Numbers of the cells of the parts of a point; None if its arc is to be halved first."""
    cells = region.cells
    here = np.flatnonzero(cells.node == i)
    parts = [[int(k)] for k in here if cells.kind[k] != IN_SLIP]
    arcs = [int(k) for k in here if cells.kind[k] == IN_SLIP]
    if not arcs:
        return parts
    total = float((cells.ends[arcs, 1] - cells.ends[arcs, 0]).sum())
    if parts and (len(arcs) == 1 or total < 1.0):
        return [*parts, arcs]
    if len(arcs) == 1:
        return None
    half = len(arcs) // 2
    return [*parts, arcs[:half], arcs[half:]]


def search_in_space(
    problem: ReducedProblem,
    known: Iterable[Array],
    *,
    seconds: float,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Certificate, Proved]:
    """Look for a proof of what all solutions are.

    Args:
        problem: the reduced problem, in space.
        known: states (ut1, ut2, un, rt1, rt2, rn) of solutions that are known (m, 6).
        seconds: after which regions are left open.
        progress: called with where the search is.

    Returns:
        The certificate, with all that was proved, and what it proves.
    """
    searched = _Search(problem, seconds, progress)
    searched.run(known)
    return searched.certificate, searched.proved
