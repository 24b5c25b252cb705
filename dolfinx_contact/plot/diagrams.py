# SPDX-License-Identifier: LGPL-3.0-or-later
"""Diagrams of branches: functionals over the parameter gamma, and statuses along each branch."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_contact._install import optional
from dolfinx_contact.laws import status
from dolfinx_contact.plot.figures import LINES, add_status_legend, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from dolfinx_contact.analysis import ProvedCount
    from dolfinx_contact.continuation import Solutions
    from dolfinx_contact.records.journal import Journal

__all__ = ["draw_diagram"]

_TITLE_PAD = 45.0  # points from the frame to the title, if numbers of solutions are between them
_DASHES = ("-", "--", "-.", ":")
#: Marker, its colour, and name of special points, by kind and smoothness.
_MARKS = {
    ("fold", True): ("o", "white", "fold, smooth"),
    ("fold", False): ("D", "white", "fold, nonsmooth"),
    ("bifurcation", True): ("*", "white", "bifurcation, smooth"),
    ("bifurcation", False): ("*", "#F0E442", "bifurcation, nonsmooth"),
    ("end", False): ("X", "#F0E442", "no continuation was found"),
}
_PROVED = "#00694b"
_OPEN = "#9a5b00"
_LONGEST_NAME = 60  # characters of a name in the legend
_LEGEND_COLUMNS = 2
_LEGEND_ROW = 0.2  # height of a row of the legend, in inches
_MANY = 60  # number of contact points above which strips show counts


def draw_diagram(
    file: str | os.PathLike[str] | None,
    journal: Journal,
    functional: str | Sequence[str] | Mapping[str, str] | None = None,
    *,
    names: Sequence[str] = (),
    title: str | None = None,
    parameter: str = r"$\gamma$",
    strips: int = 4,
    proved: Iterable[Solutions | ProvedCount] = (),
) -> Figure:
    """Draw a diagram of branches. Not collective.

    The upper part shows functionals over the parameter gamma, with folds and bifurcations. The
    lower part has one strip for each of the first branches. It shows the status of every contact
    point over the sum of the step lengths along the branch. Points are numbered from 0 in the order
    of coordinates. With more than 60 points, the number of points of each status is shown instead.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        journal: result of `read_journal` or `journal_of`.
        functional: name of a functional or of a numeric column, or a sequence of names with one
            panel each, or labels by name (formulas in TeX between dollars). The default is the
            first functional, or ``norm``.
        names: names of the branches in the legend, default the statuses at the last point.
        title: title of the diagram.
        parameter: label of the axis of gamma.
        strips: largest number of strips, default 4.
        proved: results of `find_solutions` or `analysis.prove_counts` at values of gamma. Each is
            drawn as a dotted line, labelled by its number of solutions and whether it is proved.

    Returns:
        The figure. Its first axes contain the functionals, the others the strips.

    Raises:
        ModuleNotFoundError: if matplotlib is not installed.
        OSError: if the file cannot be written; an existing file is then unchanged.
        ValueError: if no point was recorded, a functional is not in the journal, or the numbers of
            names and branches differ.
    """
    optional("matplotlib", "pictures")
    branches = [b for b in sorted(journal.branches) if len(journal.columns(b)["gamma"])]
    if not branches:
        raise ValueError("no point of these branches was recorded")
    labels = _labels(journal, branches[0], functional or journal.functionals[:1] or "norm")
    words = list(names) or [_status_name(journal, b) for b in branches]
    if len(words) != len(branches):
        raise ValueError(f"{len(branches)} branches need as many names, got {len(words)}")
    numbers: Iterable[Any] = proved  # of solutions, or with proofs
    solutions: list[Solutions] = [getattr(found, "solutions", found) for found in numbers]
    # panels of functionals above, strips below
    shown = branches[:strips]
    columns = len(labels) if len(labels) < 4 else 2
    rows = -(-len(labels) // columns)
    legend = _LEGEND_ROW * -(-len(branches) // _LEGEND_COLUMNS)
    heights = [(4.8 if rows == columns == 1 else 3.4 * rows) + legend, 2.0 * len(shown) + 0.4]
    figure = new_figure((max(9.0, 4.2 * columns), sum(heights)))
    upper, *lower = figure.subfigures(2, 1, height_ratios=heights) if shown else [figure]
    panels = upper.subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, label) in zip(panels, labels.items(), strict=False):
        axes.set(xlabel=parameter, ylabel=label)
        _draw_functional(axes, journal, name, dict(zip(branches, words, strict=True)), solutions)
    for axes in panels[len(labels) :]:
        axes.set_axis_off()
    panels[0].set_title(title or "Solutions", loc="left", pad=_TITLE_PAD if solutions else None)
    # below the panels, where it covers no branch; branches come first
    handles = panels[0].get_legend_handles_labels()[0]
    handles.sort(key=lambda line: line.get_label() not in words)
    place: dict[str, Any] = dict(loc="outside lower center", ncols=_LEGEND_COLUMNS, fontsize=9)
    upper.legend(handles=handles, frameon=False, **place)
    for part in lower:
        _draw_strips(part, journal, shown)
    save(figure, file)
    return figure


def _labels(
    journal: Journal, branch: int, functional: str | Sequence[str] | Mapping[str, str]
) -> Mapping[str, str]:
    """Return the labels of the columns to be drawn over gamma, by name of the column.

    Raises:
        ValueError: if one of them is not a numeric column of the branch.
    """
    names = [functional] if isinstance(functional, str) else functional
    columns = journal.columns(branch)
    for name in names:
        if name not in columns or columns[name].dtype == object:
            raise ValueError(f"{name!r} is not a recorded number; {journal.functionals} are")
    return names if isinstance(names, Mapping) else {name: name for name in names}


def _status_name(journal: Journal, branch: int) -> str:
    """Return a name of a branch with its last statuses, such as "branch 0: 3 stick, 2 open"."""
    words = status.summary(journal.columns(branch)["status"][-1])
    return f"branch {branch}: {words}" if len(words) <= _LONGEST_NAME else f"branch {branch}"


def _draw_functional(
    axes: Axes,
    journal: Journal,
    name: str,
    branches: Mapping[int, str],
    solutions: Sequence[Solutions],
) -> None:
    """Draw a functional over gamma: a triangle marks the start of a branch, a square its end.

    Args:
        axes: axes in which the functional is drawn.
        journal: journal of the branches.
        name: column of the functional.
        branches: names of the branches by their numbers.
        solutions: results of `find_solutions` or `analysis.prove_counts`, see `draw_diagram`.
    """
    special: dict[tuple[str, bool], list[tuple[float, float]]] = {}
    for i, (branch, word) in enumerate(branches.items()):
        c = journal.columns(branch)
        gamma, values = c["gamma"], c[name]
        colour = LINES[i % len(LINES)]
        style = _DASHES[(i // len(LINES)) % len(_DASHES)]
        axes.plot(gamma, values, style, color=colour, lw=1.8, label=word)
        axes.plot(gamma[0], values[0], ">", color=colour, ms=7, mec="black", mew=0.6)
        axes.plot(gamma[-1], values[-1], "s", color=colour, ms=6, mec="black", mew=0.6)
        for p in journal.branches[branch].points:
            for s in p.special:
                # a nonsmooth special point is a point of the branch, a smooth one lies before it
                first = max(p.index - 1, 0) if s.smooth else p.index
                at = first + int(np.argmin(np.abs(gamma[first : p.index + 1] - s.gamma)))
                special.setdefault((s.kind, s.smooth), []).append((s.gamma, values[at]))
    for kind, (shape, filling, label) in _MARKS.items():
        if kind in special:
            look: dict[str, Any] = dict(ms=10 if shape == "*" else 7, mfc=filling, mec="black")
            axes.plot(*np.transpose(special[kind]), shape, zorder=5, label=label, **look)
    # lines at values of gamma, with the number of solutions above the frame
    for found in solutions:
        colour = _PROVED if found.complete else _OPEN
        many = f"{len(found.found)}, proved" if found.complete else f"at least {len(found.found)}"
        axes.axvline(found.gamma, color=colour, lw=1.0, ls=":", zorder=0)
        look = dict(rotation=90, fontsize=7, color=colour, ha="center", va="bottom")
        axes.text(found.gamma, 1.02, many, transform=axes.get_xaxis_transform(), **look)
    axes.grid(color="0.92")
    axes.set_axisbelow(True)


def _draw_strips(figure: SubFigure, journal: Journal, branches: Sequence[int]) -> None:
    """Draw one strip per branch with the statuses of the contact points along it, and a legend."""
    from matplotlib.colors import ListedColormap

    letters = list(status.NAMES)
    colours = ListedColormap(list(status.COLOURS.values()))
    panels = figure.subplots(len(branches), 1, squeeze=False)[:, 0]
    present = ""
    for axes, b in zip(panels, branches, strict=True):
        c = journal.columns(b)
        codes = np.array([[letters.index(x) for x in word] for word in c["status"]]).T
        present += "".join(c["status"])
        along = np.cumsum(c["step"])
        if len(codes) > _MANY:
            counts = [(codes == k).sum(axis=0) for k in range(len(letters))]
            axes.stackplot(along, counts, colors=colours.colors, ec="0.5", lw=0.2)
            axes.set_ylabel("contact points")
        else:
            # the status of a point of the branch is drawn up to the next one
            edges = np.append(along, along[-1] + (0.01 * along[-1] or 1.0))
            rows = np.arange(len(codes) + 1) - 0.5
            axes.pcolormesh(edges, rows, codes, cmap=colours, vmin=-0.5, vmax=len(letters) - 0.5)
            axes.set_ylabel("contact point")
            axes.yaxis.get_major_locator().set_params(integer=True)
        for p in journal.branches[b].points:
            if any(s.kind != "event" for s in p.special):
                axes.axvline(along[p.index], color="black", lw=1.0, ls=(0, (4, 2)))
        axes.set_title(f"branch {b} (dashed: folds, bifurcations)", loc="left", fontsize=10)
        axes.margins(x=0)
    panels[-1].set_xlabel("distance along the branch")
    add_status_legend(figure, present)
