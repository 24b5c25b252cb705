# SPDX-License-Identifier: LGPL-3.0-or-later
"""Diagrams of branches: functionals over gamma, and the statuses along each branch.

Colours are those of Okabe and Ito, which most colour-blind readers tell apart; kinds of special
points differ in shape as well.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._optional import optional
from dolfinx_contact.analysis import ProvedCount
from dolfinx_contact.continuation import Solutions
from dolfinx_contact.laws import status
from dolfinx_contact.plot.curves import LINES, figure_of, written
from dolfinx_contact.records.journal import Journal

__all__ = ["draw_diagram"]

_ABOVE = 45.0  # points from the frame to the title, with numbers of solutions between them
_DASHES = ("-", "--", "-.", ":")
#: Special points with the marker, its filling and their name, by kind and smoothness.
_MARKS = {
    ("fold", True): ("o", "white", "fold, smooth"),
    ("fold", False): ("D", "white", "fold, nonsmooth"),
    ("bifurcation", True): ("*", "#F0E442", "bifurcation, smooth"),
    ("bifurcation", False): ("P", "#F0E442", "bifurcation, nonsmooth"),
    ("end", False): ("X", "#F0E442", "no way on was found"),
}
_PROVED = "#00694b"  # as on pages
_OPEN = "#9a5b00"
_MOST_ROWS = 400  # of a strip: more cannot be distinguished


def draw_diagram(
    file: str | os.PathLike[str],
    journal: Journal,
    functional: str | Sequence[str] | Mapping[str, str] | None = None,
    *,
    branches: Sequence[int] | None = None,
    label: str | None = None,
    names: Sequence[str] = (),
    title: str | None = None,
    parameter: str = r"$\gamma$",
    strips: int = 4,
    counts: bool = False,
    proved: Iterable[Solutions | ProvedCount] = (),
) -> Path:
    """Draw branches; on this rank alone.

    Above, the functionals over gamma with folds and bifurcations; below, a strip for each of the
    first few branches: the status of every contact point (at its coordinate, or in order of
    coordinates) over the distance along the branch, in units of steps.

    Args:
        file: the picture, of any kind that matplotlib writes.
        journal: what `read_journal` or `journal_of` returned.
        functional: name of a functional, or of a column of the table that is a number, or several,
            each of which gets a panel, perhaps with their labels (TeX between dollars); by default
            the first functional, or ``norm``.
        branches: their numbers, by default all.
        label: of the first functional; by default its name.
        names: of the branches, for the legend; by default their numbers.
        title: above the diagram.
        parameter: label of gamma.
        strips: how many branches get one, at most.
        counts: whether strips show how many points have each status, over gamma where that only
            grows; better for many points, as in 3D.
        proved: solutions at values of gamma (`find_solutions`, `analysis.prove_counts`): dotted
            lines there, with their number and whether it is proved.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
        ValueError: if no point was recorded, a branch or a functional is not known, or there are
            not as many names as branches.
    """
    optional("matplotlib", "pictures")
    chosen = sorted(journal.branches) if branches is None else list(branches)
    chosen = [b for b in chosen if len(journal.columns(b)["gamma"])]
    if not chosen:
        raise ValueError("no point of these branches was recorded")
    labels = _labels(functional or journal.functionals[:1] or "norm", label)
    for name in labels:
        values = journal.columns(chosen[0]).get(name)
        if values is None or values.dtype == object:
            raise ValueError(f"{name!r} is no number that was recorded; {journal.functionals} are")
    words = list(names) or [f"branch {b}" for b in chosen]
    if len(words) != len(chosen):
        raise ValueError(f"{len(chosen)} branches need as many names, got {len(words)}")
    numbers = [c.solutions if isinstance(c, ProvedCount) else c for c in proved]
    shown = chosen[:strips]
    columns = len(labels) if len(labels) < 4 else 2
    rows = -(-len(labels) // columns)
    heights = [
        4.8 if rows == columns == 1 else 3.4 * rows,
        (2.8 if counts else 1.7) * len(shown) + 0.4,
    ]
    figure = figure_of((max(9.0, 4.2 * columns), sum(heights)))
    parts = figure.subfigures(2, 1, height_ratios=heights) if shown else [figure]
    panels = parts[0].subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, text) in zip(panels, labels.items(), strict=False):
        for i, b in enumerate(chosen):
            _curve(axes, journal, b, name, i, words[i])
        _marks(axes, journal, chosen, name)
        _numbers(axes, numbers)
        axes.set(xlabel=parameter, ylabel=text)
        axes.grid(color="0.92")
        axes.set_axisbelow(True)
    for axes in panels[len(labels) :]:
        axes.set_axis_off()
    panels[0].set_title(title or "Solutions", loc="left", pad=_ABOVE if numbers else None)
    panels[0].legend(frameon=False, fontsize=9)
    if shown:
        _strips(parts[1], journal, shown, parameter, counts)
    return written(figure, file)


def _strips(
    figure: Any, journal: Journal, branches: Sequence[int], parameter: str, counts: bool
) -> None:
    """The statuses along branches, one below the other, with a legend."""
    every = figure.subplots(len(branches), 1, squeeze=False)[:, 0]
    for axes, b in zip(every, branches, strict=True):
        (_counts if counts else _strip)(axes, journal, b, parameter)
    if counts:
        every[0].legend(loc="upper left", fontsize=9)
    else:
        every[-1].set_xlabel("distance along the branch")
        _status_legend(figure, journal, branches)


def _labels(names: str | Sequence[str] | Mapping[str, str], first: str | None) -> dict[str, str]:
    """The label of every functional."""
    if isinstance(names, Mapping):
        labels = dict(names)
    else:
        labels = {name: name for name in ([names] if isinstance(names, str) else names)}
    return labels if first is None else {**labels, next(iter(labels)): first}


def _curve(axes: Any, journal: Journal, branch: int, name: str, i: int, word: str) -> None:
    """One branch over gamma, with arrows in the sense in which it was followed."""
    c = journal.columns(branch)
    colour = LINES[i % len(LINES)]
    style = _DASHES[(i // len(LINES)) % len(_DASHES)]
    axes.plot(c["gamma"], c[name], style, color=colour, lw=1.8, label=word)
    axes.plot(c["gamma"][0], c[name][0], ">", color=colour, ms=7, mec="black", mew=0.6)
    axes.plot(c["gamma"][-1], c[name][-1], "s", color=colour, ms=6, mec="black", mew=0.6)


def _numbers(axes: Any, solutions: Sequence[Solutions]) -> None:
    """Lines at values of gamma, green where the number of solutions is proved.

    The numbers stand above the frame, where no curve and no mark of its ends is.
    """
    for found in solutions:
        colour = _PROVED if found.complete else _OPEN
        many = f"{len(found.found)}, proved" if found.complete else f"at least {len(found.found)}"
        axes.axvline(found.gamma, color=colour, lw=1.0, ls=":", zorder=0)
        place = axes.get_xaxis_transform()
        look = dict(rotation=90, fontsize=7, color=colour, ha="center", va="bottom")
        axes.text(found.gamma, 1.02, many, transform=place, **look)


def _marks(axes: Any, journal: Journal, branches: Sequence[int], name: str) -> None:
    """Special points, except events, where the curve passes them."""
    named = set()
    for b in branches:
        c = journal.columns(b)
        points = journal.branches[b].points
        for p in points:
            for s in p.special:
                mark = _MARKS.get((s.kind, s.smooth))
                if mark is None:
                    continue
                # A nonsmooth special point is a point of the branch, a smooth one lies before it.
                i = p.index
                near = c["gamma"][max(i - 1, 0) : i + 1] - s.gamma
                i = i - len(near) + 1 + int(np.argmin(np.abs(near))) if s.smooth else i
                value = c[name][i]
                shape, filling, label = mark
                known = None if label in named else label
                look = dict(ms=10 if shape == "*" else 7, mfc=filling, mec="black", ls="")
                axes.plot(s.gamma, value, shape, zorder=5, label=known, **look)
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
    """Where ``count`` contact points are drawn: at their coordinate where one distinguishes them.

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
    shown = []
    borders = []
    for first, end in zip([0, *ends[:-1]], ends, strict=True):
        mine = np.flatnonzero((chosen >= first) & (chosen < end))
        most = 5 if len(places) == 1 else 3
        shown += np.unique(np.linspace(mine[0], mine[-1], most).round().astype(int)).tolist()
        borders.append(float(mine[-1] + 1))
    ticks = np.array(shown, dtype=int)
    labels = ["(" + ", ".join(f"{c:.3g}" for c in x[chosen[i]]) + ")" for i in ticks]
    title = "contact point" if len(places) == 1 else ", ".join(places)
    return _Rows(chosen, edges, ticks + 0.5, labels, title, borders[:-1])


def _counts(axes: Any, journal: Journal, branch: int, parameter: str) -> None:
    """Numbers of points by status along a branch, with a tick for every event."""
    c = journal.columns(branch)
    grows = bool((np.diff(c["gamma"]) > 0).all())
    along = c["gamma"] if grows else np.cumsum(c["step"])
    letters = {"stick": "k", "slip": "+" if {"+", "-"} & set("".join(c["status"])) else "s"}
    kinds = [k for k in (*letters, "open") if c[k].any()]
    colours = [status.COLOURS[letters.get(k, "o")] for k in kinds]
    axes.stackplot(along, [c[k] for k in kinds], labels=kinds, colors=colours, ec="0.5", lw=0.5)
    for i, p in enumerate(journal.branches[branch].points):
        for s in p.special:
            at = s.gamma if grows else along[i]
            if s.kind == "event" and s.bracket:
                axes.plot(at, 0, "|", color="0.2", ms=9, clip_on=False)
            else:
                axes.axvline(at, color="black", lw=1.0, ls=(0, (4, 2)))
    axes.set(xlabel=parameter if grows else "distance along the branch", ylabel="contact points")
    axes.set_title(f"Statuses along branch {branch} (ticks: events; dashed: located)", loc="left")
    axes.title.set_fontsize(10)
    axes.margins(x=0)


def _strip(axes: Any, journal: Journal, branch: int, _parameter: str) -> None:
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
        for s in p.special:
            if s.kind != "event":
                axes.axvline(along[p.index], color="black", lw=1.0, ls=(0, (4, 2)))
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
