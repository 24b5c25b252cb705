# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plain pictures: curves and marks over one axis, and charts of two parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_contact._files import part_of
from dolfinx_contact._optional import optional
from dolfinx_contact.analysis import Chart, EventCurves, Regions
from dolfinx_contact.plot.page.of_charts import chart_scene

__all__ = ["FILLS", "LINES", "draw_chart", "draw_curves", "draw_polar", "figure_of", "written"]

_BLACK = (":", "--", "-.")  # styles of curves to compare with
_FEW = 20  # points of a curve that are marked
#: Abscissae and ordinates.
Curve: TypeAlias = "tuple[npt.ArrayLike, npt.ArrayLike]"

#: Those of Okabe and Ito, and light ones for what fills a map.
LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
FILLS = (
    *("#dfe7ef", "#f2d9a6", "#b7d7b0", "#c9b8dc", "#c0392b", "#3b6ea8", "#e07b39", "#111111"),
    *("#8fc1c9", "#9a8f5a"),
)


def draw_curves(
    file: str | os.PathLike[str],
    curves: Mapping[str, Curve],
    *,
    marks: Mapping[str, Curve] | None = None,
    dotted: Mapping[str, Curve] | None = None,
    labels: tuple[str, str] = ("", ""),
    title: str | None = None,
    loglog: bool = False,
) -> Path:
    """Draw curves in one picture; on this rank alone.

    Args:
        file: the picture, of any kind that matplotlib writes.
        curves: lines by name, those of few points with dots; a name that begins with an underscore
            is not in the legend.
        marks: the same, as dots alone.
        dotted: the same, black, dotted or dashed, to compare with.
        labels: of the axes, TeX between dollars.
        title: above the picture.
        loglog: whether both axes are logarithmic.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
        ValueError: if there is nothing to draw, or a curve has not as many ordinates as abscissae.
    """
    drawn = [(name, curve, "-") for name, curve in curves.items()]
    drawn += [(name, curve, "o") for name, curve in (marks or {}).items()]
    references = enumerate((dotted or {}).items())
    drawn += [(name, curve, _BLACK[i % len(_BLACK)]) for i, (name, curve) in references]
    if not drawn:
        raise ValueError("there is nothing to draw")
    for name, (x, y), _ in drawn:
        if np.ndim(x) != 1 or np.shape(x) != np.shape(y):
            raise ValueError(f"{name!r} has {np.shape(x)} abscissae and {np.shape(y)} ordinates")
    figure = figure_of((6.4, 4.4))
    axes = figure.subplots()
    for i, (name, (x, y), style) in enumerate(drawn):
        style += "o" if style == "-" and np.size(x) <= _FEW else ""
        colour = "black" if style in _BLACK else LINES[i % len(LINES)]
        size = 5.5 if style == "o" else 3.5
        axes.plot(x, y, style, color=colour, lw=1.6, ms=size, label=name)
    if loglog:
        axes.set(xscale="log", yscale="log")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_title(title or "", loc="left")
    axes.grid(color="0.92")
    axes.set_axisbelow(True)
    if any(not name.startswith("_") for name, *_ in drawn):
        axes.legend(frameon=False, fontsize=9)
    return written(figure, file)


def draw_polar(
    file: str | os.PathLike[str],
    curves: Mapping[str, Curve],
    *,
    title: str | None = None,
    label: str = "",
) -> Path:
    """Draw closed curves over a circle of directions; on this rank alone.

    Args:
        file: the picture, of any kind that matplotlib writes.
        curves: angles and radii by name; what is infinite is left out.
        title: above the picture.
        label: of the radius.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
        ValueError: if there is nothing to draw, or a curve has not as many radii as angles.
    """
    if not curves:
        raise ValueError("there is nothing to draw")
    figure = figure_of((5.4, 5.4))
    axes = figure.add_subplot(projection="polar")
    for i, (name, (angles, radii)) in enumerate(curves.items()):
        theta = np.asarray(angles, dtype=np.float64)
        r = np.asarray(radii, dtype=np.float64)
        if theta.ndim != 1 or theta.shape != r.shape:
            raise ValueError(f"{name!r} has {theta.shape} angles and {r.shape} radii")
        r = np.where(np.isfinite(r), r, np.nan)
        closed = np.append(theta, theta[:1] + 2 * np.pi), np.append(r, r[:1])
        axes.plot(*closed, "-o", color=LINES[i % len(LINES)], lw=1.6, ms=3.5, label=name)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(label)
    axes.set_title(title or "", loc="left")
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    return written(figure, file)


def draw_chart(
    file: str | os.PathLike[str],
    chart: Chart | Regions,
    curves: EventCurves | None = None,
    names: Mapping[tuple[str, ...], str] | None = None,
    *,
    labels: tuple[str, str] = ("", ""),
    title: str | None = None,
) -> Path:
    """Draw the solutions over two parameters; on this rank alone.

    Without ``names`` it is drawn by regions of as many solutions, whose borders are the curves of
    folds where they are known, and their numbers are shown; with ``names`` cell by cell. Where the
    number of solutions is not proved it is hatched: there are at least so many. Curves of folds are
    drawn thick, of events thin, and where two curves of folds end there is a dot.

    Args:
        file: the picture, of any kind that matplotlib writes.
        chart: what `count_solutions` or `solution_regions` returned.
        curves: of folds and events; by default those that the chart has.
        names: of sets of statuses, for the legend; by default numbers of solutions are shown.
        labels: of the axes, TeX between dollars.
        title: above the picture.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
        ValueError: if a set of statuses has no name, or the chart has no cells.
    """
    scene = chart_scene(chart, curves)
    figure = figure_of((6.4, 6.0))
    from matplotlib.patches import Patch

    axes = figure.subplots()
    if names is None:
        counts = sorted({len(region.solutions[0]) for region in scene.regions})
        words = {n: f"{n} solution" + "s" * (n != 1) for n in counts}
        colours = {words[n]: FILLS[n % len(FILLS)] for n in counts}
        shown = set(colours)
        for region in scene.regions:
            colour = colours[words[len(region.solutions[0])]]
            for outline in region.outlines:
                axes.fill(*outline.T, lw=0, antialiased=False, **_filling(colour, region.proved))
    else:
        present = {c.solutions for c in chart.cells}
        if present - set(names):
            raise ValueError(f"no names are given for {sorted(present - set(names))}")
        colours = {word: FILLS[i % len(FILLS)] for i, word in enumerate(names.values())}
        shown = {names[solutions] for solutions in present}
        for c in chart.cells:
            look = _filling(colours[names[c.solutions]], c.proved)
            axes.fill_between(*c.outline(), lw=0, antialiased=False, **look)
    for curve in scene.curves:
        width = 1.8 if curve.kind == "fold" else 0.7
        axes.plot(*curve.points.T, color="black", lw=width)
    if curves is not None and curves.cusps:
        axes.plot(*np.array(curves.cusps).T, "o", color="black", ms=5)
    axes.set_xlim(*scene.ranges[0])
    axes.set_ylim(*scene.ranges[1])
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_title(title or "", loc="left")
    handles = [
        Patch(facecolor=colour, edgecolor="0.4", label=word)
        for word, colour in colours.items()
        if word in shown
    ]
    if not chart.proved:
        handles.append(Patch(facecolor="white", edgecolor="0.4", hatch="///", label="at least"))
    columns = 4 if names is None else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return written(figure, file)


def _filling(colour: str, proved: bool) -> dict[str, Any]:
    return dict(facecolor=colour, hatch=None if proved else "///")


def figure_of(size: tuple[float, float]) -> Any:
    """An empty figure of a size in inches, without a window.

    Raises:
        ModuleNotFoundError: if matplotlib is not installed.
    """
    optional("matplotlib", "pictures")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def written(figure: Any, file: str | os.PathLike[str]) -> Path:
    """Write a figure; the path.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
    """
    path = Path(file)
    with part_of(path) as part:
        figure.savefig(part, dpi=130)
    return path
