# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for a proof in 3D by branch and bound on cells of the contact points.

A cell (`check_proof.Cells`) restricts the status and the slip direction of a point. A region of
cells of all points is closed, its proof finished, by the first of these methods that succeeds:

1. quadratic inequalities (`weights.py`) prove that it contains at most one solution;
2. linear programs (`hull.py`) prove that it is empty; they also bound the quantities of the points;
3. an interval matrix proves that it contains at most one solution, if the cells of every point have
   a single kind.

Slip cells are arcs of directions, halved at points with few remaining arcs. Otherwise the region is
branched at the point where the solution of the linear program violates the law most. The reason why
a region is left open is stored.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.proofs.check_proof import (
    IN_CLOSED,
    IN_OPEN,
    IN_SLIP,
    IN_STICK,
    IS_OPEN,
    OF_RK,
    OF_RN,
    OF_S,
    OF_UN,
    Cells,
    InvalidCertificate,
    OpenCells,
    ReducedProblem,
    SpaceDual,
    SpacePiece,
    SpaceRegion,
    rays,
    solve_in_space,
)
from dolfinx_contact.proofs.hull import Hull
from dolfinx_contact.proofs.pieces import (
    codes_of,
    piece_at,
    relaxed,
    rounded,
    solved_piece,
    unknowns,
)
from dolfinx_contact.proofs.search import Search, SearchNode
from dolfinx_contact.proofs.starts import many_solutions

__all__ = ["SpaceSearch"]

logger = logging.getLogger(__name__)

State = tuple[Array, Array]

_PASSES = 12
_FIRST_STARTS, _STARTS = 8, 300
_BATCH = 4e5  # largest number of matrix entries of a batch of starts
_EFFORTS = {0: 40, 1: 80, 3: 80}  # iterations of the search for weights in each pass
_NARROW = 2.0**-12  # width of arcs that are not bisected, in diamond angles
_FEW = 3  # largest number of arcs of a point that are all bisected
_GAIN = 0.2  # smallest useful gain of a pass
_KEPT = 40  # vectors of earlier regions that are tried first
_WIDE = 1.2  # arcs, in diamond angles, beyond which slips are not bounded
_LOWER = 1e-3  # smallest useful decrease of a bound, relative
_TIME = "time is over"
_NARROW_WORDS = "arcs are too narrow: a continuum or a border may be there"


class SpaceSearch(Search[SpaceRegion]):
    """Search for a proof in 3D by branch and bound on cells of the contact points."""

    def _begin(self, known: Iterable[Array]) -> None:
        length, force = self.certificate.problem.units
        self._pool: list[Array] = []
        self._searched = False
        self._known: list[State] = [
            (np.asarray(state[:, :3] / length), np.asarray(state[:, 3:] / force)) for state in known
        ]
        if not self._known:
            self._look_for_solutions(_FIRST_STARTS)

    def _look_for_solutions(self, number: int, regions: Sequence[Cells] = ()) -> None:
        most = int(_BATCH / len(self.problem.p) ** 2)
        number = max(8, min(number, most))
        self._known += many_solutions(self.problem, number, self._random, regions)

    def _look_in_open_regions(self) -> None:
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

    def _treat(self, node: SearchNode[SpaceRegion]) -> list[SearchNode[SpaceRegion]]:
        region = node.region
        point: State | None = None
        for number in range(_PASSES):
            if number in _EFFORTS and self._any_only(region, point, _EFFORTS[number]):
                return []
            if self.late():
                self.step(region, do="open", why=_TIME)
                return []
            if number == 0 and not self._searched:
                self._searched = True
                self._look_for_solutions(_STARTS)
                if self._any_only(region, None, _EFFORTS[1]):
                    return []
            # Vectors of earlier regions may exclude cells here too.
            if any(self.take_out(region, y)[1] for y in self._pool[-_KEPT:]):
                return []
            hull = self._hull(region)
            if hull is None:
                return []
            point = hull.point
            if number == 0 and self._any_only(region, point, 60):
                return []
            if self._leaf(region, point):
                return []
            before = _measure(region)
            if self._exclude_cells(region, hull):
                return []
            shrunk = self._lower_bounds(region, hull, all_points=node.depth == 0)
            gained = before - _measure(region)
            halved = self._halve(region)
            if gained < _GAIN and shrunk < _GAIN and not (halved and number < 1):
                break
        assert point is not None
        return self._branch(node, point)

    # -- leaves -----------------------------------------------------------------------------------

    def _any_only(self, region: SpaceRegion, point: State | None, effort: int) -> bool:
        """Try to prove by quadratic inequalities that a region has at most one solution.

        All solutions are compared with the solution for one status per point, for up to two choices
        of statuses. ``point`` contains displacements and forces from which statuses are derived,
        shape (m, 3) each; None for known solutions only.
        """
        for number, piece in enumerate(self._candidates(region, point)):
            if number == 2 or self.late():
                break
            if piece is not None and self.only(region, piece, effort)[0]:
                return True
        return False

    def _candidates(self, region: SpaceRegion, point: State | None) -> Iterator[SpacePiece | None]:
        """Yield known solutions in a region, then one by Newton's method from ``point``.

        None is yielded if no solution is proved to exist.
        """
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
                yield piece_at(self.problem, a, r)
        if point is None:
            return
        codes = rounded(self.problem, kinds, *point)
        z = solved_piece(self.problem, codes, unknowns(self.problem, codes, *point))
        codes, z = relaxed(self.problem, kinds, codes, z)
        if codes.tobytes() not in seen:
            yield None if z is None else solve_in_space(self.problem, codes, z)

    def _leaf(self, region: SpaceRegion, point: State) -> bool:
        """Try to prove by an interval matrix that a region has at most one solution.

        This is possible only if all cells of each point have one kind.
        """
        kinds = region.kinds
        if any(len(allowed) > 1 for allowed in kinds) or (self.problem.g > 0).any():
            return False
        codes = rounded(self.problem, kinds, *point)
        z = unknowns(self.problem, codes, *point)
        for i in np.flatnonzero((codes == 2) & (self.problem.friction > 0)):
            z[i, 1] = _within(region, int(i), z[i, 1], *point)
            z[i, 0] = max(z[i, 0], 1e-6)
            z[i, 2] = max(z[i, 2], 1e-6)
        solved = solved_piece(self.problem, codes, z)
        if solved is None:
            return False
        return self.step(region, do="leaf", codes=codes.tolist(), z=solved.tolist()) is not None

    # -- linear programs --------------------------------------------------------------------------

    def _hull(self, region: SpaceRegion) -> Hull | None:
        """Return the linear program of a region; None if the region is proved empty."""
        while True:
            hull = Hull(region.problem, region.cells, region.most)
            y = hull.empty()
            if y is None:
                return hull
            excluded, empty = self.take_out(region, y)
            if not excluded.any():
                return hull
            self._pool.append(y)
            if empty:
                return None

    def _exclude_cells(self, region: SpaceRegion, hull: Hull) -> bool:
        """Try to exclude each cell of undecided points; return whether the region is empty."""
        cells, alive = hull.cells, hull.alive
        for k in np.argsort(-cells.kind, kind="stable"):
            if not alive[k] or (alive & (cells.node == cells.node[k])).sum() == 1:
                continue
            if self.late():
                return False
            y = hull.empty(int(k))
            if y is None:
                continue
            before = np.flatnonzero(alive)
            excluded, empty = self.take_out(region, y)
            if excluded.any():
                self._pool.append(y)
                alive[before[excluded]] = False
            if empty:
                return True
        return False

    def _lower_bounds(self, region: SpaceRegion, hull: Hull, *, all_points: bool) -> float:
        """Lower the bounds of quantities (`check_proof.bounded_in_space`) by linear programs.

        Without ``all_points``, only points with cells of one kind are treated.

        Returns:
            Sum of the logarithms of the ratios of old to new bounds.
        """
        gained = 0.0
        for i, kinds in enumerate(region.kinds):
            if len(kinds) > 1 and not all_points:
                continue
            for quantity, of_kinds in _quantities(region, i, kinds):
                if self.late():
                    return gained
                gained += self._bound(region, hull, quantity, i, of_kinds)
        return gained

    def _bound(
        self, region: SpaceRegion, hull: Hull, quantity: int, i: int, kinds: tuple[int, ...]
    ) -> float:
        y = hull.most(quantity, i, kinds)
        if y is None:
            return 0.0
        duals = (SpaceDual(region.problem, y), SpaceDual(region.problem, -y))
        value, y = min(
            ((d.most(region.cells, region.most, quantity, i), d.y) for d in duals),
            key=lambda pair: pair[0],
        )
        old = float(region.most[quantity, i])
        size = float(np.abs(region.most[:, i]).max())
        if not value < old - _LOWER * size:
            return 0.0
        number = self.certificate.vector(y)
        step = {"do": "bound", "y": number, "quantity": quantity, "point": i, "value": value}
        self.certificate.steps.append(step)
        region.limit(quantity, i, value)
        if quantity in (OF_RN, OF_S) or old <= 0:
            return 0.0
        return float(np.clip(np.log((old + 1e-9) / (max(value, 0.0) + 1e-9)), 0.0, 2.0))

    # -- arcs and branches ------------------------------------------------------------------------

    def _halve(self, region: SpaceRegion) -> bool:
        """Halve the slip arcs of points with few arcs; return whether any were halved."""
        done = False
        for i in range(self.problem.points):
            cells = region.cells
            arcs = cells.ends[(cells.node == i) & (cells.kind == IN_SLIP)]
            width = (arcs[:, 1] - arcs[:, 0]).max(initial=0.0)
            if 0 < len(arcs) <= _FEW and width > 4 * _NARROW:
                self._halve_at(region, i)
                done = True
        return done

    def _halve_at(self, region: SpaceRegion, point: int) -> None:
        halved = self.step(region, do="halve", point=point)
        assert halved is not None
        region.cells = halved[0].cells

    def _branch(self, node: SearchNode[SpaceRegion], point: State) -> list[SearchNode[SpaceRegion]]:
        region = node.region
        scores = _violations(self.problem, region, *point)
        i = int(np.argmax(scores))
        if scores[i] < 0:
            self.step(region, do="open", why=_NARROW_WORDS)
            return []
        parts = _parts(region, i)
        while parts is None:
            self._halve_at(region, i)
            parts = _parts(region, i)
        regions = self.step(region, do="branch", point=i, parts=parts)
        assert regions is not None
        return [SearchNode(part, node.depth + 1) for part in regions]


def _quantities(
    region: SpaceRegion, i: int, kinds: frozenset[int]
) -> list[tuple[int, tuple[int, ...]]]:
    """Return the quantities to be bounded at point ``i``, with the kinds of their cells."""
    wanted: list[tuple[int, tuple[int, ...]]] = []
    coulomb = region.problem.friction[i] > 0
    if IN_OPEN in kinds or not coulomb:
        of = (IN_OPEN,) if coulomb else (IN_OPEN, IN_CLOSED)
        wanted += [(q, of) for q in range(OF_UN)]
    if IN_OPEN in kinds:
        wanted.append((OF_UN, (IN_OPEN,)))
    if IN_STICK in kinds:
        wanted.append((OF_RK, (IN_STICK,)))
    if IN_SLIP in kinds or IN_CLOSED in kinds:
        wanted += [(q, (IN_SLIP, IN_CLOSED)) for q in (OF_RN + 1, OF_RN)]
    hull = region.cells.hull(i)
    if hull is not None and hull[1] < _WIDE:
        wanted += [(OF_S + 1, (IN_SLIP,)), (OF_S, (IN_SLIP,))]
    return wanted


def _kind(code: int, friction: float) -> int:
    """Return the kind of the cell (`check_proof.Cells`) that contains a status."""
    if friction == 0:
        return IN_OPEN if IS_OPEN[code] else IN_CLOSED
    return {0: IN_OPEN, 1: IN_STICK, 2: IN_SLIP}[code]


def _measure(region: SpaceRegion) -> float:
    """Return the logarithm of the product over all points of their summed cell sizes.

    A cell has the size 1; a slip cell 0.3 plus the width of its arc in diamond angles.
    """
    cells = region.cells
    sizes = np.where(cells.kind == IN_SLIP, 0.3 + cells.ends[:, 1] - cells.ends[:, 0], 1.0)
    return float(np.log(np.bincount(cells.node, sizes)).sum())


def _within(region: SpaceRegion, i: int, angle: float, a: Array, r: Array) -> float:
    """Return the slip angle of point ``i``, or the middle of the hull of its arcs if outside.

    ``angle`` is used if the displacements a and the forces r define no direction.
    """
    hull = region.cells.hull(i)
    assert hull is not None
    x, y = rays(np.array([hull[0], hull[0] + hull[1]])).T
    ends = np.arctan2(y, x)
    width = (ends[1] - ends[0]) % (2 * np.pi) if hull[1] < 4 else 2 * np.pi
    pull = a[i, :2] - r[i, :2]
    if np.hypot(*pull) > 1e-12:
        angle = float(np.arctan2(pull[1], pull[0]))
    inside = (angle - ends[0]) % (2 * np.pi) <= width
    return angle if inside else float(ends[0] + width / 2)


def _violations(problem: ReducedProblem, region: SpaceRegion, a: Array, r: Array) -> Array:
    """Return the violation of the law by point, -1 if it cannot be branched, shape (m,)."""
    cells = region.cells
    F = problem.friction
    slid = np.hypot(a[:, 0], a[:, 1])
    limit = F * r[:, 2]
    along = r[:, :2] * slid[:, None] + limit[:, None] * a[:, :2]
    violation = a[:, 2] * r[:, 2] + np.hypot(along[:, 0], along[:, 1])
    violation += slid * np.abs(limit - np.hypot(r[:, 0], r[:, 1]))
    violation = np.where(F > 0, violation, a[:, 2] * r[:, 2])
    width = np.bincount(cells.node, cells.ends[:, 1] - cells.ends[:, 0], problem.points)
    kinds = np.array([len(k) for k in region.kinds])
    violation += 1e-3 * (kinds - 1) + 1e-6 * width
    return np.where((kinds > 1) | (width > _NARROW), violation, -1.0)


def _parts(region: SpaceRegion, i: int) -> list[list[int]] | None:
    """Divide the cells of point ``i`` for branching; None if a single arc must be halved first."""
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
