# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of charts: curves of two parameters and the regions between them.

A chart knows its solutions in cells; its curves of folds are where their number changes. Between
the values of mu at which curves end or cross they lie one above the other, so that the regions are
what lies between two of them in such a strip, joined with those beside where nothing lies between.
A region is described by what is found in the middles of its cells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis import Chart, ChartCurve, EventCurves, Regions
from dolfinx_contact.plot.page.scene import Array, ChartScene, CurveShown, RegionShown, Scene

__all__ = ["chart_scene", "scene_of_chart"]

_SAME = 1e-9  # of the ranges: ends of strips and curves so close are one
_STEPS = 64  # of the outline of a region

Ranges = tuple[tuple[float, float], tuple[float, float]]
#: Values of mu in a strip, and gamma of its lower and upper border there.
Cell = tuple[Array, Array, Array]


def scene_of_chart(chart: Chart | Regions, curves: EventCurves | None = None) -> Scene:
    """The scene of a chart, on this rank alone; what it raises is that of `chart_scene`."""
    scene = Scene("a chart")
    scene.chart = chart_scene(chart, curves)
    if not scene.chart.exact:
        scene.notes.append(
            "The chart has no curves: regions end at cells. count_solutions(..., curves=) keeps "
            "the curves beside the cells."
        )
    return scene


def chart_scene(chart: Chart | Regions, curves: EventCurves | None = None) -> ChartScene:
    """Curves of a chart, and the regions between them; on this rank alone.

    Args:
        chart: what `count_solutions` or `solution_regions` returned, or `Chart.load`.
        curves: of folds and events; by default those that the chart has.

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
    shown = [CurveShown(curve.kind, np.array(curve.points)) for curve in known]
    ranges = _ranges(chart)
    middles = np.array([[*c.middle, c.count, c.proved] for c in chart.cells], dtype=float)
    words = [tuple(c.solutions) for c in chart.cells]
    folds = [curve for curve in shown if curve.kind == "fold"]
    if isinstance(chart, Regions):
        cells = [cell.outline(_STEPS) for cell in chart.cells]
    elif folds:
        cells = [
            cell for span in _strips(folds, ranges[0]) for cell in _between(folds, span, ranges)
        ]
    else:
        cells = [cell.outline() for cell in chart.cells]
    exact = bool(folds) or isinstance(chart, Regions)
    regions = _regions(cells, middles, words, ranges)
    return ChartScene(ranges, regions, shown, chart.cells, exact)


def _ranges(chart: Chart | Regions) -> Ranges:
    ends = np.array([[*cell.mu, *cell.gamma] for cell in chart.cells])
    low = ends.min(axis=0)
    high = ends.max(axis=0)
    return (float(low[0]), float(high[1])), (float(low[2]), float(high[3]))


def _strips(curves: Sequence[CurveShown], mus: tuple[float, float]) -> list[tuple[float, float]]:
    """Intervals of mu in which the same curves lie in the same order."""
    cuts = {float(mu) for curve in curves for mu in curve.points[[0, -1], 0]}
    for i, a in enumerate(curves):
        for b in curves[:i]:
            cuts |= set(_crossings(a, b))
    near = _SAME * (mus[1] - mus[0])
    within = [mus[0]]
    for mu in sorted(cuts):
        if within[-1] + near < mu < mus[1] - near:
            within.append(mu)
    return list(pairwise([*within, mus[1]]))


def _crossings(a: CurveShown, b: CurveShown) -> Iterator[float]:
    """All mu at which two polylines cross."""
    low = max(a.points[0, 0], b.points[0, 0])
    high = min(a.points[-1, 0], b.points[-1, 0])
    mus = np.unique(np.concatenate([a.points[:, 0], b.points[:, 0]]))
    mus = mus[(low <= mus) & (mus <= high)]
    apart = _at(a, mus) - _at(b, mus)
    for k in np.flatnonzero(apart[:-1] * apart[1:] < 0):
        part = apart[k] / (apart[k] - apart[k + 1])
        yield float(mus[k] + part * (mus[k + 1] - mus[k]))
    yield from mus[1:-1][apart[1:-1] == 0].tolist()


def _at(curve: CurveShown, mus: Array) -> Array:
    return np.asarray(np.interp(mus, curve.points[:, 0], curve.points[:, 1]))


def _between(
    curves: Sequence[CurveShown], span: tuple[float, float], ranges: Ranges
) -> Iterator[Cell]:
    """What lies between curves in a strip, from below."""
    low, high = span
    near = _SAME * (ranges[0][1] - ranges[0][0])
    there = [c for c in curves if c.points[0, 0] <= low + near and c.points[-1, 0] >= high - near]
    inner = [c.points[:, 0] for c in there]
    between = [m[(m > low) & (m < high)] for m in inner]
    mus = np.unique(np.concatenate([np.array([low, high]), *between]))
    middle = np.array([(low + high) / 2])
    there.sort(key=lambda curve: float(_at(curve, middle)[0]))
    least, most = ranges[1]
    borders = [np.full_like(mus, least)]
    borders += [np.clip(_at(curve, mus), least, most) for curve in there]
    borders += [np.full_like(mus, most)]
    for below, above in pairwise(borders):
        if (above - below).max() > _SAME * (most - least):
            yield mus, below, above


def _regions(
    cells: Sequence[Cell], middles: Array, words: Sequence[tuple[str, ...]], ranges: Ranges
) -> list[RegionShown]:
    """Cells that touch and have as many solutions, as one region each."""
    inside = [_inside(cell, middles, ranges) for cell in cells]
    found = [Counter(words[i] for i in np.flatnonzero(those)) for those in inside]
    near = [int(np.argmin(_apart(cell, middles, ranges))) for cell in cells]
    counts = []
    for cell_words, nearest in zip(found, near, strict=True):
        # A cell too small to have been examined takes the state of the nearest place.
        sets = cell_words or Counter([words[nearest]])
        sizes: Counter[int] = Counter()
        for one, times in sets.items():
            sizes[len(one)] += times
        counts.append(sizes.most_common(1)[0][0])
    joined = _joined(cells, counts, ranges)
    regions = []
    for members in joined:
        every: Counter[tuple[str, ...]] = Counter()
        places: npt.NDArray[np.bool_] = np.zeros(len(middles), dtype=bool)
        for k in members:
            every.update(found[k])
            places |= inside[k]
        if not every:
            every[words[near[members[0]]]] = 0
        same = len({len(one) for one in every}) == 1
        proved = bool(places.any() and middles[places, 3].all() and same)
        outlines = [_outline(cells[k]) for k in members]
        widest = max(members, key=lambda k: _area(cells[k]))
        regions.append(
            (counts[members[0]], outlines, every, proved, int(places.sum()), _centre(cells[widest]))
        )
    regions.sort(key=lambda r: (r[5], r[0]))
    return [
        RegionShown(i, outlines, [one for one, _ in every.most_common()], proved, looked, place)
        for i, (_, outlines, every, proved, looked, place) in enumerate(regions, 1)
    ]


def _inside(cell: Cell, places: Array, ranges: Ranges) -> npt.NDArray[np.bool_]:
    """Which places lie in a cell; those on a curve lie in none."""
    mus, below, above = cell
    near = _SAME * (ranges[1][1] - ranges[1][0])
    x, y = places[:, 0], places[:, 1]
    between = (np.interp(x, mus, below) + near < y) & (y < np.interp(x, mus, above) - near)
    return np.asarray((mus[0] <= x) & (x <= mus[-1]) & between)


def _apart(cell: Cell, places: Array, ranges: Ranges) -> Array:
    """Distances of places from the middle of a cell, in units of the ranges."""
    scale = [high - low for low, high in ranges]
    return np.asarray(np.linalg.norm((places[:, :2] - _centre(cell)) / scale, axis=1))


def _joined(cells: Sequence[Cell], counts: Sequence[int], ranges: Ranges) -> list[list[int]]:
    """Cells that touch and have as many solutions, together."""
    group = list(range(len(cells)))

    def root(k: int) -> int:
        while group[k] != k:
            k = group[k]
        return k

    for a in range(len(cells)):
        for b in range(a):
            if counts[a] == counts[b] and root(a) != root(b) and _touch(cells[a], cells[b], ranges):
                group[root(a)] = root(b)
    members: dict[int, list[int]] = {}
    for k in range(len(cells)):
        members.setdefault(root(k), []).append(k)
    return list(members.values())


def _touch(a: Cell, b: Cell, ranges: Ranges) -> bool:
    """Whether two cells have more than a corner in common: a side of one strip, or a border."""
    wide, tall = (_SAME * (high - low) for low, high in ranges)
    for one, other in ((a, b), (b, a)):
        if abs(one[0][-1] - other[0][0]) <= wide:
            common = min(one[2][-1], other[2][0]) - max(one[1][-1], other[1][0])
            if common > tall:
                return True
        overlap = min(one[0][-1], other[0][-1]) - max(one[0][0], other[0][0])
        if overlap > wide:
            middle = np.array([max(one[0][0], other[0][0]) + overlap / 2])
            apart = np.interp(middle, *one[::2]) - np.interp(middle, *other[:2])
            if abs(float(apart[0])) <= tall:
                return True
    return False


def _outline(cell: Cell) -> Array:
    mus, below, above = cell
    return np.column_stack([np.append(mus, mus[::-1]), np.append(below, above[::-1])])


def _area(cell: Cell) -> float:
    mus, below, above = cell
    return float(np.trapezoid(above - below, mus))


def _centre(cell: Cell) -> tuple[float, float]:
    """A place well inside of a cell: in the middle where it is highest."""
    mus, below, above = cell
    fine = np.linspace(mus[0], mus[-1], 33)
    heights = np.interp(fine, mus, above) - np.interp(fine, mus, below)
    best = heights >= heights.max() * (1 - 1e-9)
    mu = (
        float(fine[best].mean())
        if heights.min() > 0.9 * heights.max()
        else float(fine[int(np.argmax(heights * (1 - np.abs(np.linspace(-0.8, 0.8, 33)))))])
    )
    return mu, float(np.interp(mu, mus, below) + np.interp(mu, mus, above)) / 2
