# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions of a chart of two parameters in which the number of solutions is the same.

A chart knows its solutions in cells, and their number changes at curves of folds. Between values
of mu at which curves end or cross, the curves lie one above the other; a region is the area between
two of them in such a strip, joined with adjacent areas that have as many solutions. The solutions
of a region are those in the middles of its cells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csgraph

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact.analysis.charts import Chart, ChartCell, ChartCurve
from dolfinx_contact.analysis.event_curves import EventCurves, layers, strips

__all__ = ["ChartRegion", "ChartScene", "chart_scene"]

Ranges = tuple[tuple[float, float], tuple[float, float]]

_SAME = 1e-9  # fraction of the ranges below which two values are equal
_STEPS = 64  # number of points along the outline of a region


class Area(NamedTuple):
    """Values of mu in a strip, and gamma of the lower and the upper border there."""

    mus: Array
    below: Array
    above: Array

    @property
    def size(self) -> float:
        """Area in units of mu and gamma."""
        return float(np.trapezoid(self.above - self.below, self.mus))

    @property
    def outline(self) -> Array:
        """Corners (mu, gamma) of a polygon, shape (n, 2)."""
        gammas = [*self.below, *self.above[::-1]]
        return np.column_stack([[*self.mus, *self.mus[::-1]], gammas])

    @property
    def place(self) -> tuple[float, float]:
        """Point (mu, gamma) inside, where the area is high, and not close to an end."""
        fine = np.linspace(self.mus[0], self.mus[-1], 33)
        below, above = (np.interp(fine, self.mus, v) for v in (self.below, self.above))
        k = int(np.argmax((above - below) * (1 - np.abs(np.linspace(-0.8, 0.8, 33)))))
        return float(fine[k]), float(below[k] + above[k]) / 2

    def contains(self, points: Array, ranges: Ranges) -> Mask:
        """Return whether points (n, 2) lie inside; points on a curve do not."""
        near = _SAME * (ranges[1][1] - ranges[1][0])
        x, y = points.T
        below, above = (np.interp(x, self.mus, v) for v in (self.below, self.above))
        in_strip = (self.mus[0] <= x) & (x <= self.mus[-1])
        return np.asarray(in_strip & (below + near < y) & (y < above - near))


@dataclass(frozen=True, eq=False)
class ChartRegion:
    """Part of a chart in which the number of solutions is the same.

    Attributes:
        number: number of the region, from 1.
        outlines: (mu, gamma) of the corners of its polygons, shape (n, 2) each.
        solutions: sets of statuses of the solutions, the most frequent first.
        proved: whether the number is proved at all examined places.
        looked: number of examined places.
        place: (mu, gamma) of its label.
    """

    number: int
    outlines: list[Array]
    solutions: list[tuple[str, ...]]
    proved: bool
    looked: int
    place: tuple[float, float]


@dataclass(frozen=True, eq=False)
class ChartScene:
    """Regions and curves of a chart.

    Attributes:
        ranges: smallest and largest mu and gamma.
        regions: regions that fill the ranges.
        curves: curves of folds and events.
        cells: cells of the chart, with solutions in their middles.
        exact: whether regions end at curves instead of cells.
    """

    ranges: Ranges
    regions: list[ChartRegion]
    curves: Sequence[ChartCurve]
    cells: Sequence[ChartCell]
    exact: bool


def chart_scene(chart: Chart, curves: EventCurves | None = None) -> ChartScene:
    """Return the curves of a chart and the regions between them. Not collective.

    Args:
        chart: result of `count_solutions`, `solution_regions` or `Chart.load`.
        curves: curves of folds and events; by default those of the chart.

    Raises:
        ValueError: if the chart has no cells.
    """
    if not chart.cells:
        raise ValueError("the chart has no cells")
    known = chart.curves if curves is None else tuple(map(ChartCurve.of, curves.curves))
    folds = [curve for curve in known if curve.kind == "fold"]
    ends = np.array([[*cell.mu, *cell.gamma] for cell in chart.cells])
    low, high = ends.min(axis=0), ends.max(axis=0)
    ranges = (float(low[0]), float(high[1])), (float(low[2]), float(high[3]))
    rectangles = all(cell.is_rectangle for cell in chart.cells)
    if rectangles and folds:
        areas = [a for strip in strips(folds, ranges[0]) for a in _between(folds, strip, ranges)]
    else:
        areas = [Area(*cell.outline(_STEPS)) for cell in chart.cells]
    exact = bool(folds) or not rectangles
    return ChartScene(ranges, _regions(areas, chart, ranges), known, chart.cells, exact)


def _between(
    curves: Sequence[ChartCurve], strip: tuple[float, float], ranges: Ranges
) -> list[Area]:
    """Return the areas between curves in a strip, from below."""
    least, most = ranges[1]
    near = _SAME * (most - least)
    across = [group[0] for group in layers(curves, strip, near)]
    mus = np.unique(np.concatenate([strip, *(c.breaks for c in across)]))
    mus = mus[(strip[0] <= mus) & (mus <= strip[1])]
    heights = [np.interp(mus, *np.array(curve.points).T) for curve in across]
    borders = np.clip([np.full_like(mus, least), *heights, np.full_like(mus, most)], least, most)
    return [Area(mus, a, b) for a, b in pairwise(borders) if (b - a).max() > near]


def _regions(areas: Sequence[Area], chart: Chart, ranges: Ranges) -> list[ChartRegion]:
    """Join touching areas with equal numbers of solutions."""
    middles = np.array([cell.middle for cell in chart.cells])
    proofs = np.array([cell.proved for cell in chart.cells])
    sets = [tuple(cell.solutions) for cell in chart.cells]
    inside = np.array([area.contains(middles, ranges) for area in areas])
    places = [area.place for area in areas]
    # The solutions of an area without a middle are those of the nearest cell.
    known = inside.copy()
    scale = [high - low for low, high in ranges]
    for k in np.flatnonzero(~inside.any(axis=1)):
        known[k, np.linalg.norm((middles - places[k]) / scale, axis=1).argmin()] = True

    def by_frequency(cells: Mask) -> list[tuple[str, ...]]:
        return [one for one, _ in Counter(sets[i] for i in np.flatnonzero(cells)).most_common()]

    counts = [Counter(len(sets[i]) for i in np.flatnonzero(cells)) for cells in known]
    usual = [numbers.most_common(1)[0][0] for numbers in counts]
    joined = np.zeros((len(areas), len(areas)), dtype=bool)
    for a, b in combinations(range(len(areas)), 2):
        joined[a, b] = usual[a] == usual[b] and _touch(areas[a], areas[b], ranges)
    number, label = csgraph.connected_components(joined, directed=False)
    regions: list[ChartRegion] = []
    for members in (np.flatnonzero(label == k) for k in range(number)):
        examined = np.asarray(inside[members].any(axis=0))
        looked = int(examined.sum())
        widest = int(max(members, key=lambda k: areas[int(k)].size))
        solutions = by_frequency(examined if looked else known[widest])
        proved = looked > 0 and len({len(s) for s in solutions}) == 1 and proofs[examined].all()
        outlines = [areas[k].outline for k in members]
        regions.append(ChartRegion(0, outlines, solutions, bool(proved), looked, places[widest]))
    regions.sort(key=lambda region: region.place)
    return [replace(region, number=number) for number, region in enumerate(regions, 1)]


def _touch(a: Area, b: Area, ranges: Ranges) -> bool:
    """Return whether two areas share a part of a side between strips or of a border."""
    wide, tall = (_SAME * (high - low) for low, high in ranges)
    for one, other in ((a, b), (b, a)):
        side = min(one.above[-1], other.above[0]) - max(one.below[-1], other.below[0])
        if abs(one.mus[-1] - other.mus[0]) <= wide and side > tall:
            return True
        left = max(one.mus[0], other.mus[0])
        overlap = min(one.mus[-1], other.mus[-1]) - left
        if overlap > wide:
            middle = left + overlap / 2
            above = np.interp(middle, one.mus, one.above)
            if abs(float(above - np.interp(middle, other.mus, other.below))) <= tall:
                return True
    return False
