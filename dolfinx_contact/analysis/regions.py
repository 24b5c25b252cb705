# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions of two parameters with the same number and statuses of solutions.

Curves of folds and of events (`event_curves`, with ``folds_only=False``) divide the plane of two
parameters into cells. Between the values of the second parameter at which curves end, meet or
cross, the curves lie one above the other, and a cell lies between two of them. If no curve is
missing, the number of solutions and their statuses are constant in a cell. They are determined in
its middle, with a proof of completeness (`solutions`).

Completeness of the curves is not proved. A missing curve shows as a change of the solutions between
neighbouring cells without a curve between them, unless it lies inside a single cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._validate import positive
from dolfinx_contact.analysis.charts import ChartCell, ChartCells, letters, solutions_at
from dolfinx_contact.analysis.event_curves import EventCurve, EventCurves, layers, strips
from dolfinx_contact.analysis.family import ContactFamily
from dolfinx_contact.continuation.arguments import checked_range

__all__ = ["Region", "Regions", "solution_regions"]

Array = npt.NDArray[np.float64]

_SAME = 1e-9  # of the range of gamma: curves so close are one; of that of mu: cuts


@dataclass(frozen=True)
class Region(ChartCell):
    """Cell between two curves or ends of the range of gamma.

    Attributes:
        mu: least and largest mu.
        gamma: range of gamma of the plane.
        solutions: statuses of the solutions in the middle, as letters of the points, sorted.
        proved: whether this list of solutions is proved to be complete.
        below: curves that bound the cell from below, more than one if they coincide.
        above: curves that bound it from above.
    """

    below: tuple[EventCurve, ...] = ()
    above: tuple[EventCurve, ...] = ()

    def ends(self, mu: float) -> tuple[float, float]:
        """Return the least and the largest gamma at mu."""
        low, high = self.mu
        # At its own end a curve may have no gamma.
        inside = float(np.clip(mu, low + _SAME * (high - low), high - _SAME * (high - low)))
        least = self.below[0].at(inside) if self.below else self.gamma[0]
        most = self.above[0].at(inside) if self.above else self.gamma[1]
        return least, most

    def outline(self, number: int = 16) -> tuple[Array, Array, Array]:
        """Return values of mu (number,), and the least and the largest gamma there."""
        return super().outline(number)


@dataclass(frozen=True, eq=False)
class Regions(ChartCells[Region]):
    """Cells between curves.

    Attributes:
        cells: cells covering the ranges, sorted by mu and gamma.
    """

    cells: tuple[Region, ...]

    @property
    def explained(self) -> bool:
        """Whether the number of solutions changes across each curve as required, and only there."""
        return all(_changes_at(*pair) for pair in self._one_above_the_other()) and all(
            a.solutions == b.solutions for a, b in self._side_by_side()
        )

    def _one_above_the_other(self) -> Iterator[tuple[Region, Region]]:
        for a, b in pairwise(self.cells):
            if a.mu == b.mu:
                yield a, b

    def _side_by_side(self) -> Iterator[tuple[Region, Region]]:
        for a, b in combinations(self.cells, 2):
            if a.mu[1] == b.mu[0]:
                low, high = a.ends(a.mu[1])
                least, most = b.ends(b.mu[0])
                if min(high, most) - max(low, least) > 1e-6 * (a.gamma[1] - a.gamma[0]):
                    yield a, b


def _changes_at(below: Region, above: Region) -> bool:
    """Return whether two cells differ as the curves between them require.

    Across a fold, two solutions appear or vanish; across an event, one solution is replaced.
    """
    mu = below.middle[0]
    lower = set(below.solutions)
    upper = set(above.solutions)
    if len(below.above) == 1:
        (curve,) = below.above
        statuses = set(curve.statuses_at(mu))
        changed = lower ^ upper
        sides = (statuses <= lower, statuses <= upper)
        mine = any(sides) if curve.kind == "fold" else not any(sides)
        return changed == statuses and mine
    every = set().union(*(curve.statuses_at(mu) for curve in below.above))
    return lower ^ upper <= every


def _check(a: Arguments) -> None:
    a.mu_range = checked_range(a.mu_range, [], "mu")
    a.gamma_range = checked_range(a.gamma_range, [])
    positive(a.proof_seconds, "proof_seconds", infinite=True)


@collective("regions", _check)
def solution_regions(
    family: ContactFamily,
    curves: EventCurves,
    *,
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    proof_seconds: float = 20.0,
) -> Regions:
    """Find the solutions in each cell between curves. Collective; ranks share the cells.

    Args:
        family: problem with two parameters, the same on all ranks of its communicator.
        curves: all its curves of folds and events in the ranges, found with the same ranges.
        mu_range: least and largest mu.
        gamma_range: least and largest gamma.
        proof_seconds: time of the proof in a cell.

    Raises:
        ValueError: on every rank, if an argument is not valid.
    """
    low, high = gamma_range
    near = _SAME * (high - low)
    bare = []
    for span in strips(curves.curves, mu_range):
        middle = (span[0] + span[1]) / 2
        inside = [
            g
            for g in layers(curves.curves, span, near)
            if low + near < g[0].at(middle) < high - near
        ]
        for below, above in pairwise([(), *inside, ()]):
            bare.append(Region(span, gamma_range, below=below, above=above))
    none = [()] * len(bare)
    found = solutions_at(family, [cell.middle for cell in bare], none, proof_seconds, "regions")
    cells = zip(bare, found, strict=True)
    return Regions(tuple(replace(c, solutions=letters(s), proved=p) for c, (s, p) in cells))
