# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions of a chart of two parameters in which the number of solutions is the same.

A chart knows its solutions in cells, and their number changes at curves of folds. Between values
of mu at which curves end or cross, the curves lie one above the other; a region is the area between
two of them in such a strip, joined with adjacent areas that have as many solutions. The solutions
of a region are those in the middles of its cells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt
from scipy.sparse import csgraph

from dolfinx_contact.analysis.charts import Chart, ChartCell, ChartCurve
from dolfinx_contact.analysis.event_curves import EventCurves, strips
from dolfinx_contact.analysis.regions import Region, Regions

__all__ = ["ChartRegion", "ChartScene", "chart_scene"]

Array = npt.NDArray[np.float64]
Ranges = tuple[tuple[float, float], tuple[float, float]]
#: Values of mu in a strip, and gamma of its lower and upper border there.
Area = tuple[Array, Array, Array]

_SAME = 1e-9  # fraction of the ranges below which two values are equal
_STEPS = 64  # number of points along the outline of a region


@dataclass(frozen=True, eq=False)
class ChartRegion:
    """A part of a chart in which the number of solutions is the same.

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
    """The regions and curves of a chart.

    Attributes:
        ranges: smallest and largest mu and gamma.
        regions: regions that fill the ranges.
        curves: curves of folds and events.
        cells: cells of the chart, with solutions in their middles.
        exact: whether regions end at curves instead of cells.
    """

    ranges: Ranges
    regions: list[ChartRegion]
    curves: list[ChartCurve]
    cells: Sequence[ChartCell | Region]
    exact: bool


def chart_scene(chart: Chart | Regions, curves: EventCurves | None = None) -> ChartScene:
    """Return the curves of a chart and the regions between them. Not collective.

    Args:
        chart: result of `count_solutions`, `solution_regions` or `Chart.load`.
        curves: curves of folds and events; by default those of the chart.

    Raises:
        ValueError: if the chart has no cells.
    """
    if not chart.cells:
        raise ValueError("the chart has no cells")
    if curves is not None:
        known = [ChartCurve.of(curve) for curve in curves.curves]
    elif isinstance(chart, Chart):
        known = list(chart.curves)
    else:
        bounds = {id(c): c for cell in chart.cells for c in (*cell.below, *cell.above)}
        known = [ChartCurve.of(curve) for curve in bounds.values()]
    folds = [curve for curve in known if curve.kind == "fold"]
    ends = np.array([[*cell.mu, *cell.gamma] for cell in chart.cells])
    low, high = ends.min(axis=0), ends.max(axis=0)
    ranges = (float(low[0]), float(high[1])), (float(low[2]), float(high[3]))
    areas: list[Area]
    if isinstance(chart, Regions):
        areas = [cell.outline(_STEPS) for cell in chart.cells]
    elif folds:
        areas = [a for strip in strips(folds, ranges[0]) for a in _between(folds, strip, ranges)]
    else:
        areas = [cell.outline() for cell in chart.cells]
    exact = bool(folds) or isinstance(chart, Regions)
    return ChartScene(ranges, _regions(areas, chart, ranges), known, chart.cells, exact)


def _between(
    curves: Sequence[ChartCurve], strip: tuple[float, float], ranges: Ranges
) -> Iterator[Area]:
    """The areas between curves in a strip, from below."""
    low, high = strip
    near = _SAME * (ranges[0][1] - ranges[0][0])
    across = [c for c in curves if c.span[0] <= low + near and c.span[1] >= high - near]
    across.sort(key=lambda curve: curve.at((low + high) / 2))
    mus = np.unique(np.concatenate([[low, high], *(c.breaks for c in across)]))
    mus = mus[(low <= mus) & (mus <= high)]
    least, most = ranges[1]
    borders = [np.clip(np.interp(mus, *np.array(curve.points).T), least, most) for curve in across]
    borders = [np.full_like(mus, least), *borders, np.full_like(mus, most)]
    for below, above in pairwise(borders):
        if (above - below).max() > _SAME * (most - least):
            yield mus, below, above


def _regions(areas: Sequence[Area], chart: Chart | Regions, ranges: Ranges) -> list[ChartRegion]:
    """Join areas that touch and have as many solutions."""
    middles = np.array([cell.middle for cell in chart.cells])
    sets = [tuple(cell.solutions) for cell in chart.cells]
    scale = [high - low for low, high in ranges]
    inside = np.array([_inside(area, middles, ranges) for area in areas])
    places = [_place(area) for area in areas]

    def sets_in(k: int, cells: npt.NDArray[np.bool_]) -> list[tuple[str, ...]]:
        """Sets of statuses in cells, the most frequent first; without cells, in the nearest one."""
        if not cells.any():
            away = np.linalg.norm((middles - places[k]) / scale, axis=1)
            return [sets[int(np.argmin(away))]]
        return [one for one, _ in Counter(sets[i] for i in np.flatnonzero(cells)).most_common()]

    counts = []
    for k, cells in enumerate(inside):
        numbers = Counter(len(sets[i]) for i in np.flatnonzero(cells))
        counts.append(numbers.most_common(1)[0][0] if numbers else len(sets_in(k, cells)[0]))
    n = len(areas)
    joined = np.zeros((n, n), dtype=bool)
    for a, b in combinations(range(n), 2):
        joined[a, b] = counts[a] == counts[b] and _touch(areas[a], areas[b], ranges)
    number, label = csgraph.connected_components(joined, directed=False)
    regions: list[ChartRegion] = []
    for members in (np.flatnonzero(label == k) for k in range(number)):
        examined = np.asarray(inside[members].any(axis=0))
        sizes = [float(np.trapezoid(areas[k][2] - areas[k][1], areas[k][0])) for k in members]
        widest = int(members[np.argmax(sizes)])
        solutions = sets_in(widest, examined)
        looked = int(examined.sum())
        proved = looked > 0 and len({len(one) for one in solutions}) == 1
        proved = proved and all(chart.cells[i].proved for i in np.flatnonzero(examined))
        outlines = [
            np.column_stack([[*mus, *mus[::-1]], [*below, *above[::-1]]])
            for mus, below, above in (areas[k] for k in members)
        ]
        regions.append(ChartRegion(0, outlines, solutions, proved, looked, places[widest]))
    regions.sort(key=lambda region: region.place)
    return [replace(region, number=number) for number, region in enumerate(regions, 1)]


def _inside(area: Area, places: Array, ranges: Ranges) -> npt.NDArray[np.bool_]:
    """Whether places (n, 2) lie in an area; those on a curve lie in none."""
    mus, below, above = area
    near = _SAME * (ranges[1][1] - ranges[1][0])
    x, y = places.T
    between = (np.interp(x, mus, below) + near < y) & (y < np.interp(x, mus, above) - near)
    return np.asarray((mus[0] <= x) & (x <= mus[-1]) & between)


def _touch(a: Area, b: Area, ranges: Ranges) -> bool:
    """Whether two areas share a part of a side between strips or of a border."""
    wide, tall = (_SAME * (high - low) for low, high in ranges)
    for one, other in ((a, b), (b, a)):
        if abs(one[0][-1] - other[0][0]) <= wide:
            common = min(one[2][-1], other[2][0]) - max(one[1][-1], other[1][0])
            if common > tall:
                return True
        left = max(one[0][0], other[0][0])
        overlap = min(one[0][-1], other[0][-1]) - left
        if overlap > wide:
            middle = left + overlap / 2
            above = np.interp(middle, one[0], one[2])
            below = np.interp(middle, other[0], other[1])
            if abs(float(above - below)) <= tall:
                return True
    return False


def _place(area: Area) -> tuple[float, float]:
    """A place inside an area: where it is high, and not close to an end."""
    mus, below, above = area
    fine = np.linspace(mus[0], mus[-1], 33)
    heights = np.interp(fine, mus, above) - np.interp(fine, mus, below)
    mu = fine[np.argmax(heights * (1 - np.abs(np.linspace(-0.8, 0.8, 33))))]
    return float(mu), float(np.interp(mu, mus, below) + np.interp(mu, mus, above)) / 2
