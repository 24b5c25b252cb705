# SPDX-License-Identifier: LGPL-3.0-or-later
"""Diagrams of branches: functionals over gamma, and the statuses along each branch."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws import status
from dolfinx_contact.plot.figures import LINES, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dolfinx_contact.analysis import ProvedCount
    from dolfinx_contact.continuation import Solutions
    from dolfinx_contact.records.journal import Journal

__all__ = ["draw_diagram"]

Array = npt.NDArray[np.float64]

_TITLE_PAD = 45.0  # points from the frame to the title, if numbers of solutions are between them
_DASHES = ("-", "--", "-.", ":")
#: Marker, its colour, and name of special points, by kind and smoothness.
_MARKS = {
    ("fold", True): ("o", "white", "fold, smooth"),
    ("fold", False): ("D", "white", "fold, nonsmooth"),
    ("bifurcation", True): ("*", "#F0E442", "bifurcation, smooth"),
    ("bifurcation", False): ("P", "#F0E442", "bifurcation, nonsmooth"),
    ("end", False): ("X", "#F0E442", "no continuation was found"),
}
_PROVED = "#00694b"
_OPEN = "#9a5b00"
_LONGEST_NAME = 60  # characters of a name in the legend
_DASHED = dict(color="black", lw=1.0, ls=(0, (4, 2)))


def draw_diagram(
    file: str | os.PathLike[str] | None,
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
) -> Figure:
    """Draw branches. Not collective.

    The upper part shows the functionals over gamma with folds and bifurcations. The lower part has
    a strip for each of the first branches: the status of every contact point (at its coordinate, or
    in the order of coordinates) over the distance along the branch, in units of steps.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        journal: result of `read_journal` or `journal_of`.
        functional: name of a functional or of a numeric column, or a sequence of names with one
            panel each, or labels by name (TeX between dollars). The default is the first
            functional, or ``norm``.
        branches: numbers of the branches, default all.
        label: label of the first functional, default its name.
        names: names of the branches in the legend, default the statuses at the last point.
        title: title of the diagram.
        parameter: label of gamma.
        strips: largest number of branches with a strip, default 4.
        counts: True if strips show the number of points of each status, over gamma as long as it
            grows along the branch; preferable for many points, as in 3D. Default False.
        proved: solutions at values of gamma (`find_solutions`, `analysis.prove_counts`), drawn as
            dotted lines with the number of solutions and whether it is proved.

    Returns:
        The figure. The first axes have the functionals, the others the strips.

    Raises:
        ModuleNotFoundError: if matplotlib is not installed.
        OSError: with the path, if it cannot be written; an existing file is then unchanged.
        ValueError: if no point was recorded, a branch or a functional is not in the journal, or the
            numbers of names and branches differ.
    """
    new_figure((1.0, 1.0))  # names a missing package before other errors
    chosen = sorted(journal.branches) if branches is None else list(branches)
    chosen = [b for b in chosen if len(journal.columns(b)["gamma"])]
    if not chosen:
        raise ValueError("no point of these branches was recorded")
    labels = _labels(functional or journal.functionals[:1] or "norm", label)
    for name in labels:
        values = journal.columns(chosen[0]).get(name)
        if values is None or values.dtype == object:
            raise ValueError(f"{name!r} is not a recorded number; {journal.functionals} are")
    words = list(names) or [_status_name(journal, b) for b in chosen]
    if len(words) != len(chosen):
        raise ValueError(f"{len(chosen)} branches need as many names, got {len(words)}")
    numbers: Iterable[Any] = proved  # of solutions, or with proofs
    solutions: list[Solutions] = [getattr(found, "solutions", found) for found in numbers]
    # panels of functionals above, strips below
    shown = chosen[:strips]
    columns = len(labels) if len(labels) < 4 else 2
    rows = -(-len(labels) // columns)
    heights = [4.8 if rows == columns == 1 else 3.4 * rows]
    heights.append((2.8 if counts else 1.7) * len(shown) + 0.4)
    figure = new_figure((max(9.0, 4.2 * columns), sum(heights)))
    parts = figure.subfigures(2, 1, height_ratios=heights) if shown else [figure]
    panels = parts[0].subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, text) in zip(panels, labels.items(), strict=False):
        for i, b in enumerate(chosen):
            _draw_branch(axes, journal, b, name, i, words[i])
        _draw_special_points(axes, journal, chosen, name)
        _draw_numbers(axes, solutions)
        axes.set(xlabel=parameter, ylabel=text)
        axes.grid(color="0.92")
        axes.set_axisbelow(True)
    for axes in panels[len(labels) :]:
        axes.set_axis_off()
    panels[0].set_title(title or "Solutions", loc="left", pad=_TITLE_PAD if solutions else None)
    panels[0].legend(frameon=False, fontsize=9)
    if shown:
        _draw_strips(parts[1], journal, shown, parameter, counts)
    save(figure, file)
    return figure


def _labels(names: str | Sequence[str] | Mapping[str, str], first: str | None) -> dict[str, str]:
    """Labels of the functionals by name."""
    if isinstance(names, Mapping):
        labels = dict(names)
    else:
        labels = {name: name for name in ([names] if isinstance(names, str) else names)}
    return labels if first is None else {**labels, next(iter(labels)): first}


def _status_name(journal: Journal, branch: int) -> str:
    """Name of a branch by the statuses at its last point, such as "branch 0: 3 stick, 2 open"."""
    letters = journal.columns(branch)["status"][-1]
    counts = {name: letters.count(k) for k, name in status.NAMES.items() if k in letters}
    words = ", ".join(f"{count} {name}" for name, count in counts.items())
    return f"branch {branch}: {words}" if len(words) <= _LONGEST_NAME else f"branch {branch}"


def _draw_branch(axes: Axes, journal: Journal, branch: int, name: str, i: int, word: str) -> None:
    """Draw a branch over gamma: a triangle marks its start, a square its end."""
    c = journal.columns(branch)
    colour = LINES[i % len(LINES)]
    style = _DASHES[(i // len(LINES)) % len(_DASHES)]
    axes.plot(c["gamma"], c[name], style, color=colour, lw=1.8, label=word)
    axes.plot(c["gamma"][0], c[name][0], ">", color=colour, ms=7, mec="black", mew=0.6)
    axes.plot(c["gamma"][-1], c[name][-1], "s", color=colour, ms=6, mec="black", mew=0.6)


def _draw_special_points(axes: Axes, journal: Journal, branches: Sequence[int], name: str) -> None:
    """Mark folds, bifurcations and unexpected ends on the curves."""
    named = set()
    for b in branches:
        c = journal.columns(b)
        for p in journal.branches[b].points:
            for s in p.special:
                if (s.kind, s.smooth) not in _MARKS:
                    continue
                # a nonsmooth special point is a point of the branch, a smooth one lies before it
                i = p.index
                if s.smooth:
                    first = max(i - 1, 0)
                    i = first + int(np.argmin(np.abs(c["gamma"][first : i + 1] - s.gamma)))
                shape, filling, label = _MARKS[s.kind, s.smooth]
                look = dict(ms=10 if shape == "*" else 7, mfc=filling, mec="black", ls="")
                text = None if label in named else label
                axes.plot(s.gamma, c[name][i], shape, zorder=5, label=text, **look)
                named.add(label)


def _draw_numbers(axes: Axes, solutions: Sequence[Solutions]) -> None:
    """Draw lines at values of gamma, with the number of solutions above the frame."""
    for found in solutions:
        colour = _PROVED if found.complete else _OPEN
        many = f"{len(found.found)}, proved" if found.complete else f"at least {len(found.found)}"
        axes.axvline(found.gamma, color=colour, lw=1.0, ls=":", zorder=0)
        look: dict[str, Any] = dict(rotation=90, fontsize=7, color=colour, ha="center", va="bottom")
        axes.text(found.gamma, 1.02, many, transform=axes.get_xaxis_transform(), **look)


# -- strips --------------------------------------------------------------------------------------


def _draw_strips(
    figure: Any, journal: Journal, branches: Sequence[int], parameter: str, counts: bool
) -> None:
    """Draw the statuses along branches, one below the other, with a legend."""
    from matplotlib.patches import Patch

    panels = figure.subplots(len(branches), 1, squeeze=False)[:, 0]
    for axes, b in zip(panels, branches, strict=True):
        if counts:
            _draw_counts(axes, journal, b, parameter)
        else:
            _draw_strip(axes, journal, b)
        axes.title.set_fontsize(10)
    if counts:
        panels[0].legend(loc="upper left", fontsize=9)
        return
    panels[-1].set_xlabel("distance along the branch")
    present = set("".join("".join(journal.columns(b)["status"]) for b in branches))
    handles = [
        Patch(facecolor=status.COLOURS[letter], edgecolor="0.5", label=name)
        for letter, name in status.NAMES.items()
        if letter in present
    ]
    place: dict[str, Any] = dict(loc="outside lower center", ncols=len(handles), frameon=False)
    figure.legend(handles=handles, **place)


def _draw_counts(axes: Axes, journal: Journal, branch: int, parameter: str) -> None:
    """Draw the numbers of points by status along a branch, with a tick for every event."""
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
                axes.axvline(at, **_DASHED)
    axes.set(xlabel=parameter if grows else "distance along the branch", ylabel="contact points")
    axes.set_title(f"Statuses along branch {branch} (ticks: events; dashed: located)", loc="left")
    axes.margins(x=0)


def _draw_strip(axes: Axes, journal: Journal, branch: int) -> None:
    """Draw the statuses along a branch, one row for each contact point."""
    from matplotlib.colors import ListedColormap

    c = journal.columns(branch)
    letters = list(status.NAMES)
    codes = np.array([[letters.index(x) for x in word] for word in c["status"]]).T
    # the status of a point of the branch is drawn up to the next one
    along = np.cumsum(c["step"])
    edges = np.append(along, along[-1] + (0.01 * along[-1] or 1.0))
    colours = ListedColormap(list(status.COLOURS.values()))
    look = dict(cmap=colours, vmin=-0.5, vmax=len(letters) - 0.5)
    axes.pcolormesh(edges, _set_rows(axes, journal.places, len(codes)), codes, **look)
    for p in journal.branches[branch].points:
        for s in p.special:
            if s.kind != "event":
                axes.axvline(along[p.index], **_DASHED)
    axes.set_title(f"Statuses along branch {branch} (dashed: folds, bifurcations)", loc="left")


def _set_rows(axes: Axes, places: dict[str, Array], count: int) -> Array:
    """Label the rows of contact points, and return the heights of their ends.

    Rows are at the coordinate of the point if it is unique, otherwise of equal height.

    Args:
        axes: axes of a strip.
        places: coordinates of the contact points by surface.
        count: number of contact points.
    """
    x = np.concatenate(list(places.values())) if places else np.empty((0, 1))
    axes.set_ylabel(", ".join(places) if len(places) > 1 else "contact point")
    if len(x) == count > 1:
        axis = int(np.argmax(np.ptp(x, axis=0)))
        along: Array = x[:, axis]
        if len(places) == 1 and (np.diff(along) > 0).all():
            axes.set_ylabel("xyz"[axis])
            middle = np.asarray(along[1:] + along[:-1], dtype=np.float64) / 2
            return np.concatenate([along[:1], middle, along[-1:]])
        rows = np.unique(np.linspace(0, count - 1, 5).round().astype(int))
        axes.set_yticks(rows + 0.5, ["(" + ", ".join(f"{c:.3g}" for c in x[i]) + ")" for i in rows])
    for height in np.cumsum([len(part) for part in places.values()])[:-1]:
        axes.axhline(height, color="white", lw=2.0)
    return np.arange(count + 1, dtype=np.float64)
