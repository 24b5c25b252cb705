# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of curves in Cartesian or polar axes, and of charts over two parameters."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_contact.plot.figures import FILLS, LINES, File, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dolfinx_contact.analysis import Chart, EventCurves

__all__ = ["draw_chart", "draw_curves", "draw_polar"]

#: Abscissae and ordinates.
Curve: TypeAlias = "tuple[npt.ArrayLike, npt.ArrayLike]"

_REFERENCE_STYLES = (":", "--", "-.")
_FEW = 20  # number of points up to which the points of a line are marked
_HATCH = "///"  # hatch of cells without a proof


def draw_curves(
    file: File,
    curves: Mapping[str, Curve],
    *,
    marks: Mapping[str, Curve] | None = None,
    dotted: Mapping[str, Curve] | None = None,
    labels: tuple[str, str] = ("", ""),
    title: str | None = None,
    loglog: bool = False,
) -> Axes:
    """Draw curves in Cartesian axes. Not collective.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        curves: abscissae and ordinates of lines, by name. Names beginning with an underscore are
            not in the legend.
        marks: curves drawn as points, by name.
        dotted: reference curves, drawn in black, dotted or dashed, by name.
        labels: labels of the horizontal and the vertical axis; formulas in TeX between dollars.
        title: title of the picture, default none.
        loglog: True for two logarithmic axes, default False.

    Returns:
        The axes; ``axes.figure`` is the figure.

    Raises:
        OSError: if the file cannot be written; an existing file is then unchanged.
        ValueError: if the curves have no names, or one has different numbers of abscissae and
            ordinates.
    """
    axes = _new_axes(curves, (6.4, 4.4))
    for name, (x, y) in curves.items():
        axes.plot(x, y, "-o" if np.size(x) <= _FEW else "-", ms=3.5, label=name)
    for name, (x, y) in (marks or {}).items():
        axes.plot(x, y, "o", ms=5.5, label=name)
    for (name, (x, y)), style in zip((dotted or {}).items(), cycle(_REFERENCE_STYLES)):
        axes.plot(x, y, style, color="black", label=name)
    if loglog:
        axes.set(xscale="log", yscale="log")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.grid(color="0.92")
    axes.set_axisbelow(True)
    return _finish(axes, file, title)


def draw_polar(
    file: File, curves: Mapping[str, Curve], *, title: str | None = None, label: str = ""
) -> Axes:
    """Draw closed curves in polar axes: radii over angles from 0 to 2 pi. Not collective.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        curves: angles (radians) and radii by name. Infinite radii are omitted.
        title: title of the picture, default none.
        label: label of the radial axis.

    Returns:
        The polar axes.

    Raises:
        OSError: if the file cannot be written; an existing file is then unchanged.
        ValueError: if the curves have no names, or one has different numbers of angles and radii.
    """
    axes = _new_axes(curves, (5.4, 5.4), projection="polar")
    for name, (angles, radii) in curves.items():
        r = np.where(np.isfinite(radii), radii, np.nan)
        closed = np.append(angles, np.ravel(angles)[:1] + 2 * np.pi), np.append(r, r[:1])
        axes.plot(*closed, "-o", ms=3.5, label=name)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(label)
    return _finish(axes, file, title, loc="upper right")


def _new_axes(curves: Any, size: tuple[float, float], **options: Any) -> Axes:
    """Return the axes of a new figure, with a sequence of distinct colours for the curves."""
    if not isinstance(curves, Mapping):
        got = type(curves).__name__
        raise ValueError(f"curves must be a dictionary of curves by name, got a {got}")
    axes = new_figure(size).add_subplot(**options)
    axes.set_prop_cycle(color=LINES, lw=[1.6] * len(LINES))
    return axes


def _finish(axes: Axes, file: File, title: str | None, **legend: Any) -> Axes:
    """Add the legend of the curves and the title to the axes, and write the figure."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False, fontsize=9, **legend)
    axes.set_title(title or "", loc="left")
    save(axes.figure, file)
    return axes


def draw_chart(
    file: File,
    chart: Chart,
    curves: EventCurves | None = None,
    names: Mapping[tuple[str, ...], str] | None = None,
    *,
    labels: tuple[str, str] = ("", ""),
    title: str | None = None,
) -> Axes:
    """Draw a chart of the number of solutions over two parameters. Not collective.

    Each cell is coloured by its number of solutions or, with ``names``, by the set of statuses of
    its solutions. Cells in which the number is not proved are hatched; they have at least this many
    solutions. Curves of folds are thick, curves of events thin, and a dot marks a cusp.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        chart: result of `count_solutions` or `solution_regions`.
        curves: curves of folds and events; default: curves of the chart.
        names: names of the sets of statuses, for the legend; default: numbers of solutions.
        labels: labels of both axes; formulas in TeX between dollars.
        title: title of the picture, default none.

    Returns:
        The axes.

    Raises:
        OSError: if the file cannot be written; an existing file is then unchanged.
        ValueError: if a set of statuses has no name.
    """
    if names is None:
        numbers = sorted({cell.count for cell in chart.cells})
        colours = {_solutions(n): FILLS[n % len(FILLS)] for n in numbers}
        words = [_solutions(cell.count) for cell in chart.cells]
    else:
        unnamed = {c.solutions for c in chart.cells} - set(names)
        if unnamed:
            raise ValueError(f"no names are given for {sorted(unnamed)}")
        colours = dict(zip(names.values(), cycle(FILLS)))
        words = [names[cell.solutions] for cell in chart.cells]
    axes = new_figure((6.4, 6.0)).add_subplot()
    for cell, word in zip(chart.cells, words, strict=True):
        hatch = None if cell.proved else _HATCH
        fill: dict[str, Any] = dict(facecolor=colours[word], hatch=hatch, lw=0, antialiased=False)
        axes.fill_between(*cell.outline(), **fill)
    axes.set(xlim=axes.dataLim.intervalx, ylim=axes.dataLim.intervaly)
    for curve in chart.curves if curves is None else curves.curves:
        axes.plot(*curve.points(32).T, color="black", lw=1.8 if curve.kind == "fold" else 0.7)
    if curves is not None and curves.cusps:
        axes.plot(*np.array(curves.cusps).T, "o", color="black", ms=5)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    shown = {word: colour for word, colour in colours.items() if word in words}
    _add_legend_of_fills(axes, shown, columns=4 if names is None else 2, proved=chart.proved)
    return _finish(axes, file, title)


def _add_legend_of_fills(
    axes: Axes, colours: Mapping[str, str], *, columns: int, proved: bool
) -> None:
    """Add a legend with the colours of cells by name, and the hatch of cells without a proof."""
    from matplotlib.patches import Patch

    fills = {word: dict(facecolor=colour) for word, colour in colours.items()}
    if not proved:
        fills["at least"] = dict(facecolor="white", hatch=_HATCH)
    handles = [Patch(edgecolor="0.4", label=word, **fill) for word, fill in fills.items()]
    place: dict[str, Any] = dict(loc="outside lower center", ncols=columns, frameon=False)
    axes.figure.legend(handles=handles, **place)


def _solutions(n: int) -> str:
    return f"{n} solution{'s' * (n != 1)}"
