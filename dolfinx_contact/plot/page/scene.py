# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a page shows: series of points with columns, states of a body, counts, a chart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dolfinx_contact._validate import is_number
from dolfinx_contact.analysis import ChartCell, Region
from dolfinx_contact.io.outside import OuterSurface, SurfaceState

__all__ = [
    "ChartScene",
    "CurveShown",
    "Mark",
    "RegionShown",
    "Scene",
    "SeriesShown",
    "SolutionCount",
]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Mark:
    """A special point of a series.

    Attributes:
        index: of the point of the series at which it is shown.
        kind: of special point, as ``"fold"``.
        text: its description, shown beside it.
        at: values of columns that are known, by name.
        share: where it lies between the point before (0) and its own (1).
    """

    index: int
    kind: str
    text: str = ""
    at: dict[str, float] = field(default_factory=dict)
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class SeriesShown:
    """Points in order: a branch, a history, a path.

    Attributes:
        name: for people.
        columns: numbers by name, those of `Scene.columns` that are known, a value a point; NaN
            where there is none.
        statuses: letters of all contact points, a word a point.
        states: number of the state of each point in `Scene.states`, -1 of one that has none.
        marks: special points.
        ending: how it ended, in words; "" if it has not.
    """

    name: str
    columns: dict[str, Array]
    statuses: list[str]
    states: list[int]
    marks: list[Mark] = field(default_factory=list)
    ending: str = ""


@dataclass(frozen=True)
class SolutionCount:
    """How many solutions there are at one gamma, and whether that is proved.

    Attributes:
        gamma: parameter.
        count: number of solutions that are known.
        proved: whether it is proved that there are no others.
        method: how they were looked for.

    Raises:
        ValueError: if gamma is no finite number, or the count no whole one from 0.
    """

    gamma: float
    count: int
    proved: bool
    method: str = ""

    def __post_init__(self) -> None:
        if not is_number(self.gamma) or not np.isfinite(self.gamma):
            raise ValueError(f"gamma of a count must be a finite number, got {self.gamma!r}")
        whole = isinstance(self.count, int | np.integer) and not isinstance(self.count, bool)
        if not whole or self.count < 0:
            raise ValueError(f"a count must be a whole number from 0, got {self.count!r}")


@dataclass(frozen=True, eq=False)
class CurveShown:
    """A curve of folds or events in a chart.

    Attributes:
        kind: ``"fold"`` or ``"event"``.
        points: (mu, gamma) of points (n, 2), mu rising.
    """

    kind: str
    points: Array


@dataclass(frozen=True, eq=False)
class RegionShown:
    """A part of a chart in which the number of solutions is the same.

    Attributes:
        number: by which it is called, from 1.
        outlines: (mu, gamma) of the corners (n, 2) of the polygons that it consists of.
        solutions: sets of statuses that were found in it, the most frequent first.
        proved: whether it is proved at all places examined that there are no others.
        looked: at how many places.
        place: (mu, gamma) of its number.
    """

    number: int
    outlines: list[Array]
    solutions: list[tuple[str, ...]]
    proved: bool
    looked: int
    place: tuple[float, float]


@dataclass(frozen=True, eq=False)
class ChartScene:
    """A chart of two parameters.

    Attributes:
        ranges: least and largest mu, and gamma.
        regions: that fill the ranges.
        curves: between them.
        cells: in whose middles solutions were looked for.
        exact: whether regions end at the curves; else at cells.
    """

    ranges: tuple[tuple[float, float], tuple[float, float]]
    regions: list[RegionShown]
    curves: list[CurveShown]
    cells: Sequence[ChartCell | Region]
    exact: bool


@dataclass(eq=False)
class Scene:
    """All that a page shows.

    Attributes:
        kind: of the record, in words.
        along: name of the column over which a series is plotted: gamma, time, length.
        columns: names of all columns, those that are shown first in front.
        functionals: those of them that the user requested.
        series: in order.
        body: outer surface before anything moves; None if no displacement was recorded.
        states: where it is at the states, each read when it is called.
        counts: of solutions.
        chart: of two parameters, for a scene of nothing else.
        package: version that recorded it.
        unfinished: whether the record is still being written, or was cut off.
        notes: remarks shown beside it.
    """

    kind: str
    along: str = ""
    columns: list[str] = field(default_factory=list)
    functionals: list[str] = field(default_factory=list)
    series: list[SeriesShown] = field(default_factory=list)
    body: OuterSurface | None = None
    states: list[Callable[[], SurfaceState]] = field(default_factory=list)
    counts: list[SolutionCount] = field(default_factory=list)
    chart: ChartScene | None = None
    package: str = ""
    unfinished: bool = False
    notes: list[str] = field(default_factory=list)
