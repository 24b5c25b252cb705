# SPDX-License-Identifier: LGPL-3.0-or-later
"""Charts: number of solutions of a contact problem in cells of two parameters.

All solutions at the midpoint of each cell are searched for, with a proof of completeness
(`proofs`).

`count_solutions` begins with equal rectangles. A cell is divided if a curve of folds passes through
it, or if the number of solutions differs from a neighbouring cell without a known curve between
them. Proofs hold at the midpoints; changes within a cell are not excluded.

In `solution_regions`, curves of folds and of events (`event_curves`, with ``folds_only=False``)
divide the plane into cells. The values of the second parameter at which curves end, meet or cross
define strips. Within a strip the curves lie one above the other, and a cell lies between two of
them. If no curve is missing, the number and statuses of the solutions are constant in a cell.

Completeness of the curves is not proved. A missing curve is detected as a change of the solutions
between neighbouring cells without a curve between them (`Chart.explained`), unless the curve lies
inside a single cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._mpi import Arguments, collective, everywhere
from dolfinx_contact._progress import Progress
from dolfinx_contact._validate import count, positive
from dolfinx_contact.analysis.event_curves import EventCurve, EventCurves, layers, strips
from dolfinx_contact.analysis.family import ContactFamily
from dolfinx_contact.continuation.arguments import checked_range
from dolfinx_contact.laws import status
from dolfinx_contact.proofs import prove_solutions

__all__ = [
    "Chart",
    "ChartCell",
    "count_solutions",
    "solution_regions",
]

#: Statuses of all points of each solution, as bytes.
Statuses = tuple[bytes, ...]

_SAME = 1e-9  # distance to the end of a cell that counts as zero, relative to the range of mu
_NEAR = 1e-9  # distance of curves that count as one, relative to the range of gamma
_SIDE = 1e-6  # shortest part of a side that cells share, relative to the range of gamma


@dataclass(frozen=True)
class ChartCell:
    """Cell of a chart over (mu, gamma): a rectangle, or the area between two curves.

    Attributes:
        mu: smallest and largest mu of the cell.
        gamma: smallest and largest gamma; for a cell between curves, the range of the chart.
        solutions: statuses of the solutions at the midpoint, as sorted strings with one letter per
            contact point.
        proved: whether the solutions are provably complete; False if the slips of a solution exceed
            the range of small sliding (`ContactFamily.reach`).
        below: curves bounding the cell from below, more than one if they coincide; empty if the
            cell ends at ``gamma[0]``.
        above: curves bounding the cell from above; empty if the cell ends at ``gamma[1]``.
    """

    mu: tuple[float, float]
    gamma: tuple[float, float]
    solutions: tuple[str, ...] = ()
    proved: bool = False
    below: tuple[EventCurve, ...] = ()
    above: tuple[EventCurve, ...] = ()

    @property
    def count(self) -> int:
        """Number of solutions at the midpoint; a lower bound if it is not proved."""
        return len(self.solutions)

    @property
    def middle(self) -> tuple[float, float]:
        """Midpoint (mu, gamma) of the cell, at which its solutions were determined."""
        mu = (self.mu[0] + self.mu[1]) / 2
        return mu, sum(self.ends(mu)) / 2

    @property
    def is_rectangle(self) -> bool:
        """Whether no curve bounds the cell."""
        return not (self.below or self.above)

    def ends(self, mu: float) -> tuple[float, float]:
        """Return the smallest and the largest gamma of the cell at a given mu."""
        low, high = self.mu
        # At its own end a curve may have no gamma.
        inside = float(np.clip(mu, low + _SAME * (high - low), high - _SAME * (high - low)))
        least = self.below[0].at(inside) if self.below else self.gamma[0]
        most = self.above[0].at(inside) if self.above else self.gamma[1]
        return least, most

    def outline(self, number: int = 16) -> tuple[Array, Array, Array]:
        """Return the outline of the cell: values of mu, and the smallest and largest gamma at each.

        Args:
            number: number of values of mu; a rectangle always has two. Default 16.
        """
        mus: Array = np.asarray(np.linspace(*self.mu, 2 if self.is_rectangle else number))
        ends: Array = np.array([self.ends(float(mu)) for mu in mus])
        return mus, ends[:, 0], ends[:, 1]


@dataclass(frozen=True, eq=False)
class Chart:
    """Numbers of solutions over two parameters.

    Attributes:
        cells: cells filling the ranges of mu and gamma without overlap, ordered by mu and gamma.
        curves: curves along which cells were divided, or which bound the cells.
        explained: whether the solutions change across each curve as its kind requires, and nowhere
            else; None for a chart of `count_solutions`.
    """

    cells: tuple[ChartCell, ...]
    curves: tuple[EventCurve, ...] = ()
    explained: bool | None = None

    @property
    def proved(self) -> bool:
        """Whether the number of solutions is proved in all cells."""
        return all(c.proved for c in self.cells)

    def at(self, mu: float, gamma: float) -> ChartCell:
        """Return the cell that contains the parameters (mu, gamma).

        Raises:
            ValueError: if the point lies outside all cells.
        """
        for c in self.cells:
            if c.mu[0] <= mu <= c.mu[1]:
                low, high = c.ends(mu)
                if low <= gamma <= high:
                    return c
        raise ValueError(f"({mu:g}, {gamma:g}) is outside the cells")


def _solutions_at(
    family: ContactFamily,
    places: Sequence[tuple[float, float]],
    known: Sequence[Statuses],
    seconds: float,
    what: str,
) -> list[tuple[Statuses, bool]]:
    """Find the solutions at pairs (mu, gamma), with proofs. Collective; ranks share the pairs.

    Args:
        family: problem with two parameters.
        places: pairs (mu, gamma) at which the solutions are computed.
        known: for each pair, statuses of known solutions, from which the search starts.
        seconds: time limit of one proof in seconds.
        what: name of the task, for the progress line and error messages.

    Returns:
        For each pair, the sorted statuses of the solutions and whether they are provably complete.
    """
    comm = family.comm
    mine = {}
    line = Progress(comm)
    with everywhere(comm, what):
        for number in range(comm.rank, len(places), comm.size):
            if line.due:
                line.update(f"solutions in {what}: {number + 1} of {len(places)}")
            starts = [np.frombuffer(codes, dtype=np.int8) for codes in known[number]]
            problem = family.problem(*places[number])
            proof = prove_solutions(problem, known=starts, proof_seconds=seconds, progress=False)
            small = family.are_small(s.state[:, 0] for s in proof.solutions)
            codes = tuple(sorted(s.codes.tobytes() for s in proof.solutions))
            mine[number] = codes, proof.verdict == "complete" and small
    line.clear()
    every = {number: found for part in comm.allgather(mine) for number, found in part.items()}
    return [every[number] for number in range(len(places))]


def _letters(solutions: Statuses) -> tuple[str, ...]:
    """Return the sorted statuses of solutions as strings, with one letter per contact point."""
    return tuple(sorted(status.word(np.frombuffer(codes, np.int8)) for codes in solutions))


def _check(a: Arguments) -> None:
    a.mu_range = checked_range(a.mu_range, [], "mu")
    a.gamma_range = checked_range(a.gamma_range, [])
    a.cells = tuple(a.cells)
    if len(a.cells) != 2:
        raise ValueError(f"cells must be two integers, got {a.cells!r}")
    for cells in a.cells:
        count(cells, "cells")
    count(a.depth, "depth", least=0)
    positive(a.proof_seconds, "proof_seconds", infinite=True)


@collective("a chart", _check)
def count_solutions(
    family: ContactFamily,
    *,
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    cells: tuple[int, int] = (6, 6),
    depth: int = 2,
    curves: EventCurves | None = None,
    proof_seconds: float = 20.0,
) -> Chart:
    """Count the solutions in cells of two parameters, with refinement where their number changes.

    Collective; ranks share the cells.

    Args:
        family: problem with two parameters, the same on all ranks of its communicator.
        mu_range: smallest and largest value of the second parameter mu.
        gamma_range: smallest and largest value of the load parameter gamma.
        cells: initial number of cells along mu and gamma. Default (6, 6).
        depth: largest number of subdivisions of a cell. Default 2.
        curves: curves of folds and events, which are included in the chart. Cells crossed by a
            fold are divided, too. Default: no curves.
        proof_seconds: time limit of the proof in each cell, in seconds. Default 20.

    Raises:
        ValueError: on every rank, if an argument is not valid or differs between ranks.
    """
    counting = _Counting(family, (mu_range, gamma_range), cells, depth, proof_seconds)
    return counting.run(curves)


@dataclass(frozen=True)
class _Leaf:
    """Square cell of the adaptive grid, measured in numbers of the finest cells.

    Attributes:
        i, j: indices of the first finest cell along mu and gamma.
        size: number of finest cells along an edge.
        codes: statuses of the known solutions.
        proved: whether the known solutions are provably complete.
    """

    i: int
    j: int
    size: int
    codes: Statuses = ()
    proved: bool = False

    def parts(self) -> list[_Leaf]:
        """Return the four quarters of this cell, with its solutions as their known solutions."""
        half = self.size // 2
        return [
            _Leaf(i, j, half, self.codes)
            for i in (self.i, self.i + half)
            for j in (self.j, self.j + half)
        ]

    def place(self, more: int = 0) -> tuple[slice, slice]:
        """Return the slices of `_Counting.raster` covered by this cell.

        Args:
            more: number of finest cells by which the slices are widened on each side.
        """
        i, j = (slice(max(k - more, 0), k + self.size + more) for k in (self.i, self.j))
        return i, j


class _Counting:
    """Adaptive count of solutions: cells are divided where the number changes.

    Attributes:
        raster: for each finest cell, the number of solutions in the cell that contains it.
    """

    def __init__(
        self,
        family: ContactFamily,
        ranges: tuple[tuple[float, float], tuple[float, float]],
        cells: tuple[int, int],
        depth: int,
        seconds: float,
    ):
        self._family = family
        self._ranges = ranges
        self._seconds = seconds
        self._size = 2**depth
        self.raster = np.zeros([n * self._size for n in cells], dtype=int)

    def run(self, curves: EventCurves | None) -> Chart:
        """Count the solutions and divide cells until the largest depth is reached."""
        size = self._size
        across, along = self.raster.shape
        first = [_Leaf(i, j, size) for i in range(0, across, size) for j in range(0, along, size)]
        level = self._counted(first)
        leaves: list[_Leaf] = []
        passed = self._passed(curves)
        while size > 1:
            divided = self._at_border(level, passed)
            leaves += [leaf for leaf in level if leaf not in divided]
            level = self._counted([part for leaf in divided for part in leaf.parts()])
            size //= 2
        leaves = sorted(leaves + level, key=lambda leaf: (leaf.i, leaf.j))
        kept = () if curves is None else curves.curves
        cells = (
            replace(self._cell(v), solutions=_letters(v.codes), proved=v.proved) for v in leaves
        )
        return Chart(tuple(cells), kept)

    def _cell(self, leaf: _Leaf) -> ChartCell:
        def ends(k: int, axis: int) -> tuple[float, float]:
            low, high = self._ranges[axis]
            step = (high - low) / self.raster.shape[axis]
            return low + k * step, low + (k + leaf.size) * step

        return ChartCell(ends(leaf.i, 0), ends(leaf.j, 1))

    def _counted(self, leaves: Sequence[_Leaf]) -> list[_Leaf]:
        """Return cells with their solutions, using the known solutions as initial states."""
        places = [self._cell(leaf).middle for leaf in leaves]
        known = [leaf.codes for leaf in leaves]
        found = _solutions_at(self._family, places, known, self._seconds, "cells")
        for leaf, (codes, _) in zip(leaves, found, strict=True):
            self.raster[leaf.place()] = len(codes)
        return [replace(v, codes=c, proved=p) for v, (c, p) in zip(leaves, found, strict=True)]

    def _at_border(self, level: Sequence[_Leaf], passed: Mask) -> list[_Leaf]:
        """Return the cells of one level that must be divided.

        These are the cells crossed by a fold, and the cells at whose edges the number of solutions
        changes although no fold is known there.

        Args:
            level: cells of one size.
            passed: mask of the finest cells crossed by folds.
        """
        at_border = [leaf for leaf in level if passed[leaf.place()].any()]
        explained = np.zeros_like(passed)
        for leaf in at_border:
            explained[leaf.place()] = True
        for leaf in level:
            other = self.raster[leaf.place(1)] != len(leaf.codes)
            if leaf not in at_border and (other & ~explained[leaf.place(1)]).any():
                at_border.append(leaf)
        return at_border

    def _passed(self, curves: EventCurves | None) -> Mask:
        """Return a mask of the finest cells crossed by curves of folds."""
        passed = np.zeros(self.raster.shape, dtype=bool)
        if curves is None:
            return passed
        (low, high), (least, most) = self._ranges
        across, along = passed.shape
        for number, mu in enumerate(np.linspace(low, high, 8 * across + 1)):
            for gamma in curves.folds_at(float(mu)):
                j = int((gamma - least) / (most - least) * along)
                if 0 <= j < along:
                    passed[min(number // 8, across - 1), j] = True
        return passed


# -- cells between curves --------------------------------------------------------------------------


def _check_regions(a: Arguments) -> None:
    a.mu_range = checked_range(a.mu_range, [], "mu")
    a.gamma_range = checked_range(a.gamma_range, [])
    positive(a.proof_seconds, "proof_seconds", infinite=True)


@collective("regions", _check_regions)
def solution_regions(
    family: ContactFamily,
    curves: EventCurves,
    *,
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    proof_seconds: float = 20.0,
) -> Chart:
    """Find the solutions in each cell between curves. Collective; ranks share the cells.

    Args:
        family: problem with two parameters, the same on all ranks of its communicator.
        curves: all curves of folds and events, found with the same ranges.
        mu_range: smallest and largest value of the second parameter mu.
        gamma_range: smallest and largest value of the load parameter gamma.
        proof_seconds: time limit of the proof in each cell, in seconds. Default 20.

    Raises:
        ValueError: on every rank, if an argument is not valid.
    """
    low, high = gamma_range
    near = _NEAR * (high - low)
    bare = []
    for span in strips(curves.curves, mu_range):
        middle = (span[0] + span[1]) / 2
        inside = [
            g
            for g in layers(curves.curves, span, near)
            if low + near < g[0].at(middle) < high - near
        ]
        for below, above in pairwise([(), *inside, ()]):
            bare.append(ChartCell(span, gamma_range, below=below, above=above))
    none = [()] * len(bare)
    found = _solutions_at(family, [cell.middle for cell in bare], none, proof_seconds, "regions")
    cells = tuple(
        replace(cell, solutions=_letters(statuses), proved=proved)
        for cell, (statuses, proved) in zip(bare, found, strict=True)
    )
    bounds = dict.fromkeys(curve for cell in cells for curve in (*cell.below, *cell.above))
    return Chart(cells, tuple(bounds), _are_explained(cells))


def _are_explained(cells: Sequence[ChartCell]) -> bool:
    """Return whether the solutions of neighbouring cells differ only as curves require."""
    stacked = [(a, b) for a, b in pairwise(cells) if a.mu == b.mu]
    neighbours = [(a, b) for a, b in combinations(cells, 2) if a.mu[1] == b.mu[0] and _touch(a, b)]
    return all(_differ_as_required(a, b) for a, b in stacked) and all(
        a.solutions == b.solutions for a, b in neighbours
    )


def _touch(left: ChartCell, right: ChartCell) -> bool:
    """Return whether two cells in neighbouring strips share a part of an edge."""
    low, high = left.ends(left.mu[1])
    least, most = right.ends(right.mu[0])
    return min(high, most) - max(low, least) > _SIDE * (left.gamma[1] - left.gamma[0])


def _differ_as_required(below: ChartCell, above: ChartCell) -> bool:
    """Return whether the solutions of two cells differ as the curves between them require.

    Two solutions appear or vanish across a fold; one solution changes its statuses across an event.
    """
    mu = below.middle[0]
    lower = set(below.solutions)
    upper = set(above.solutions)
    if len(below.above) == 1:
        (curve,) = below.above
        statuses = set(curve.statuses_at(mu))
        sides = (statuses <= lower, statuses <= upper)
        # a fold has both solutions on one side, an event has one on each side
        fits = any(sides) if curve.kind == "fold" else not any(sides)
        return lower ^ upper == statuses and fits
    return lower ^ upper <= set().union(*(curve.statuses_at(mu) for curve in below.above))
