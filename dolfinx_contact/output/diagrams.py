# SPDX-License-Identifier: LGPL-3.0-or-later
"""Diagrams of recorded branches: a functional over gamma, and the statuses along each branch.

Colours are those of Okabe and Ito, which most colour-blind readers tell apart; kinds of special
points differ in shape as well.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._optional import optional
from dolfinx_contact.laws import status
from dolfinx_contact.output.disk import part_of
from dolfinx_contact.output.journal import Journal

__all__ = ["draw_diagram"]

_BRANCHES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_DASHES = ("-", "--", "-.", ":")
#: Special points with the marker, its filling and their name, by kind and smoothness.
_MARKS = {
    ("fold", True): ("o", "white", "fold, smooth"),
    ("fold", False): ("D", "white", "fold, nonsmooth"),
    ("bifurcation", True): ("*", "#F0E442", "bifurcation, smooth"),
    ("bifurcation", False): ("P", "#F0E442", "bifurcation, nonsmooth"),
    ("end", False): ("X", "#F0E442", "no way on was found"),
}
_MOST_ROWS = 400  # of a strip: more cannot be told apart


def draw_diagram(
    file: str | os.PathLike[str],
    journal: Journal,
    functional: str | None = None,
    *,
    branches: Sequence[int] | None = None,
    label: str | None = None,
    title: str | None = None,
    strips: int = 4,
) -> Path:
    """Draw recorded branches; on this rank alone.

    Above, the functional over gamma with folds and bifurcations; below, a strip for each of the
    first few branches: the status of every contact point (at its coordinate, or in order of
    coordinates) over the distance along the branch, in units of steps.

    Args:
        file: the picture, of any kind that matplotlib writes.
        journal: what `read_journal` returned.
        functional: name of a functional, or of a column of the table that is a number; by default
            the first functional, or ``norm``.
        branches: their numbers, by default all.
        label: of the functional, TeX between dollars; by default its name.
        title: above the diagram.
        strips: how many branches get one, at most.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
        ValueError: if no point was recorded, or a branch or the functional is not known.
    """
    optional("matplotlib", "output")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen = sorted(journal.branches) if branches is None else list(branches)
    chosen = [b for b in chosen if len(journal.columns(b)["gamma"])]
    if not chosen:
        raise ValueError("no point of these branches was recorded")
    name = functional or (journal.functionals[0] if journal.functionals else "norm")
    values = journal.columns(chosen[0]).get(name)
    if values is None or values.dtype == object:
        raise ValueError(f"{name!r} is no number that was recorded; {journal.functionals} are")
    shown = chosen[:strips]
    figure = Figure(figsize=(9.0, 4.8 + 1.7 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    ratios = [4.2, *[1.5] * len(shown)]
    above, *below = figure.subplots(1 + len(shown), 1, height_ratios=ratios, squeeze=False)[:, 0]
    for i, b in enumerate(chosen):
        _curve(above, journal, b, name, i)
    _marks(above, journal, chosen, name)
    above.set(xlabel=r"$\gamma$", ylabel=label or name)
    above.set_title(title or "Solutions", loc="left")
    above.grid(color="0.92")
    above.set_axisbelow(True)
    above.legend(frameon=False, fontsize=9)
    for axes, b in zip(below, shown, strict=True):
        _strip(axes, journal, b)
    if shown:
        below[-1].set_xlabel("distance along the branch")
        _status_legend(figure, journal, shown)
    path = Path(file)
    with part_of(path) as part:
        figure.savefig(part, dpi=130)
    return path


def _curve(axes: Any, journal: Journal, branch: int, name: str, i: int) -> None:
    """One branch over gamma, with arrows in the sense in which it was followed."""
    c = journal.columns(branch)
    colour = _BRANCHES[i % len(_BRANCHES)]
    style = _DASHES[(i // len(_BRANCHES)) % len(_DASHES)]
    axes.plot(c["gamma"], c[name], style, color=colour, lw=1.8, label=f"branch {branch}")
    axes.plot(c["gamma"][0], c[name][0], ">", color=colour, ms=7, mec="black", mew=0.6)
    axes.plot(c["gamma"][-1], c[name][-1], "s", color=colour, ms=6, mec="black", mew=0.6)


def _marks(axes: Any, journal: Journal, branches: Sequence[int], name: str) -> None:
    """Special points, except events, where the curve passes them."""
    named = set()
    for b in branches:
        c, points = journal.columns(b), journal.branches[b].points
        for p in points:
            for s in p["special"]:
                mark = _MARKS.get((s["kind"], s["smooth"]))
                if mark is None:
                    continue
                # A nonsmooth special point is a point of the branch, a smooth one lies before it.
                i = p["index"]
                near = c["gamma"][max(i - 1, 0) : i + 1] - s["gamma"]
                i = i - len(near) + 1 + int(np.argmin(np.abs(near))) if s["smooth"] else i
                value = c[name][i]
                shape, filling, label = mark
                known = None if label in named else label
                look = dict(ms=10 if shape == "*" else 7, mfc=filling, mec="black", ls="")
                axes.plot(s["gamma"], value, shape, zorder=5, label=known, **look)
                named.add(label)


@dataclass(frozen=True)
class _Rows:
    """Contact points from below to above.

    Attributes:
        chosen: numbers of the points that are shown.
        edges: heights of the borders between them, one more.
        ticks: heights that are labelled.
        labels: of the ticks; None for the heights themselves.
        title: of the axis.
        borders: heights between surfaces.
    """

    chosen: npt.NDArray[np.int64]
    edges: npt.NDArray[Any]
    ticks: npt.NDArray[Any] | None
    labels: list[str] | None
    title: str
    borders: Sequence[float] = ()


def _rows(places: dict[str, npt.NDArray[np.float64]], count: int) -> _Rows:
    """Where ``count`` contact points are drawn: at their coordinate where one tells them apart.

    Else they are rows of the same height, in the order of the journal, with some coordinates.
    """
    chosen = np.arange(0, count, max(1, -(-count // _MOST_ROWS)))
    edges = np.arange(len(chosen) + 1.0)
    if sum(map(len, places.values())) != count or count == 0:
        ticks = np.unique(np.linspace(0, len(chosen) - 1, 4).round().astype(int))
        labels = [str(chosen[i]) for i in ticks]
        return _Rows(chosen, edges, ticks + 0.5, labels, "contact point")
    x = np.concatenate(list(places.values()))
    axis = int(np.argmax(np.ptp(x, axis=0)))
    along = x[chosen, axis]
    if len(places) == 1 and len(chosen) > 1 and (np.diff(along) > 0).all():
        middle = (along[1:] + along[:-1]) / 2
        # Points at the ends have half of an edge, like their areas.
        return _Rows(chosen, np.array([along[0], *middle, along[-1]]), None, None, "xyz"[axis])
    ends = np.cumsum([len(part) for part in places.values()])
    shown, borders = [], []
    for first, end in zip([0, *ends[:-1]], ends, strict=True):
        mine = np.flatnonzero((chosen >= first) & (chosen < end))
        most = 5 if len(places) == 1 else 3
        shown += np.unique(np.linspace(mine[0], mine[-1], most).round().astype(int)).tolist()
        borders.append(float(mine[-1] + 1))
    ticks = np.array(shown, dtype=int)
    labels = ["(" + ", ".join(f"{c:.3g}" for c in x[chosen[i]]) + ")" for i in ticks]
    title = "contact point" if len(places) == 1 else ", ".join(places)
    return _Rows(chosen, edges, ticks + 0.5, labels, title, borders[:-1])


def _strip(axes: Any, journal: Journal, branch: int) -> None:
    """Statuses along a branch: one row a contact point, one column a step."""
    from matplotlib.colors import ListedColormap

    c = journal.columns(branch)
    rows = _rows(journal.places, len(c["status"][0]))
    known = list(status.NAMES)
    codes = np.array([[known.index(x) for x in word] for word in c["status"]]).T
    # A point has its status up to the next one.
    along = np.cumsum(c["step"])
    edges = np.append(along, along[-1] + (0.01 * along[-1] or 1.0))
    colours = ListedColormap(list(status.COLOURS.values()))
    look = dict(cmap=colours, vmin=-0.5, vmax=len(known) - 0.5)
    axes.pcolormesh(edges, rows.edges, codes[rows.chosen], **look)
    if rows.ticks is not None:
        axes.set_yticks(rows.ticks, rows.labels)
    for height in rows.borders:
        axes.axhline(height, color="white", lw=2.0)
    for p in journal.branches[branch].points:
        for s in p["special"]:
            if s["kind"] != "event":
                axes.axvline(along[p["index"]], color="black", lw=1.0, ls=(0, (4, 2)))
    axes.set_ylabel(rows.title)
    axes.set_title(f"Statuses along branch {branch} (dashed: folds, bifurcations)", loc="left")
    axes.title.set_fontsize(10)


def _status_legend(figure: Any, journal: Journal, branches: Sequence[int]) -> None:
    from matplotlib.patches import Patch

    present = set("".join("".join(journal.columns(b)["status"]) for b in branches))
    handles = [
        Patch(facecolor=status.COLOURS[letter], edgecolor="0.5", label=name)
        for letter, name in status.NAMES.items()
        if letter in present
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
