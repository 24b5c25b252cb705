# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures, their files, titles and legends, and the colours of fields."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array
from dolfinx_contact._files import part_of
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import on_root
from dolfinx_contact.laws import status
from dolfinx_contact.results.outer_surface import Cells

if TYPE_CHECKING:
    import pyvista
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from dolfinx_contact.equations.state import State

__all__ = [
    *("FILLS", "FLOOR", "INK", "LINES", "NOT_FINITE", "Drawing", "File", "add_status_legend"),
    *("are_distinct", "around", "draw_edges", "drawn_on_root", "legend_columns", "new_figure"),
    *("save", "shade", "title_of", "with_unit", "words_of"),
]

Drawing: TypeAlias = "Figure | pyvista.Plotter"
File: TypeAlias = "str | os.PathLike[str] | None"

#: Colours of lines, by Okabe and Ito, which most colour-blind readers distinguish.
LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
#: Colours of areas.
FILLS = (
    *("#dfe7ef", "#f2d9a6", "#b7d7b0", "#c9b8dc", "#c0392b", "#3b6ea8", "#e07b39", "#111111"),
    *("#8fc1c9", "#9a8f5a"),
)
INK = "#22262b"
FLOOR = "#c9ced4"
NOT_FINITE = "#9a9a9a"
_DPI = 130
_ENTRY = 1.7  # width of an entry of a legend in inches
_DENSE = 20.0  # size of cells in pixels below which their edges would hide the colours
_MOST_TRIANGLES = 40_000  # largest number of triangles of the mesh on which a field is drawn
_FINEST = 3  # number of times that an edge of a cell is halved in it


# -- figures and files -----------------------------------------------------------------------------


def new_figure(size: tuple[float, float], layout: str = "constrained") -> Figure:
    """Return an empty matplotlib figure that is not shown in a window.

    Args:
        size: width and height in inches.
        layout: layout engine of matplotlib; "compressed" for axes with an equal aspect.

    Raises:
        ModuleNotFoundError: if matplotlib is not installed.
    """
    optional("matplotlib", "pictures")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def save(drawing: Drawing, file: File) -> None:
    """Write a figure or the view of a plotter, unless ``file`` is None. Not collective.

    Raises:
        OSError: if the file cannot be written; an existing file is then unchanged.
    """
    if file is None:
        return
    with part_of(Path(file)) as part:
        if hasattr(drawing, "savefig"):
            drawing.savefig(part, dpi=_DPI, bbox_inches="tight", pad_inches=0.1)
        else:  # VTK cannot write PDF or SVG with transparent parts
            from matplotlib.image import imsave

            imsave(part, np.asarray(drawing.screenshot(return_img=True)), dpi=200)


def drawn_on_root(comm: MPI.Comm, file: File, draw: Callable[[], Drawing]) -> Drawing | None:
    """Draw and write on rank 0; raise an error of rank 0 on every rank. Collective.

    Returns:
        The drawing on rank 0, None on other ranks.
    """
    drawings: list[Drawing] = []

    def write() -> None:
        drawings.append(draw())
        save(drawings[0], file)

    on_root(comm, write)
    return drawings[0] if drawings else None


# -- titles and legends ----------------------------------------------------------------------------


def title_of(*parts: str) -> str:
    """Join the parts of a title that are not empty."""
    return ", ".join(filter(None, parts))


def words_of(state: State | None) -> str:
    """Describe the load or the time of a state, for a title; "" if it has neither."""
    if state is None or (state.gamma is None and state.time is None):
        return ""
    return f"time {state.time:.4g}" if state.gamma is None else f"gamma {state.gamma:.4g}"


def with_unit(label: str, unit: str | None) -> str:
    """Return a label with its unit, if there is one."""
    return f"{label} [{unit}]" if unit else label


def add_status_legend(
    figure: Figure | SubFigure,
    letters: str,
    names: Mapping[str, str] = status.NAMES,
    title: str | None = None,
) -> None:
    """Add a legend with the statuses of contact points below a figure.

    Args:
        figure: figure to which the legend is added.
        letters: status letters of all points.
        names: names of the statuses in the legend, by letter.
        title: title of the legend.
    """
    from matplotlib.patches import Patch

    look: dict[str, Any] = dict(edgecolor=INK, lw=0.5)
    present = {k: name for k, name in names.items() if k in letters}
    handles = [Patch(facecolor=status.COLOURS[k], label=v, **look) for k, v in present.items()]
    columns = legend_columns(figure, max(len(handles), 1))
    place: dict[str, Any] = dict(loc="outside lower center", ncols=columns)
    figure.legend(handles=handles, frameon=False, title=title, **place)


def legend_columns(figure: Figure | SubFigure, entries: int) -> int:
    """Return the number of columns of a legend that fit into the width of a figure.

    Args:
        figure: figure with the legend.
        entries: number of entries, at least 1.
    """
    return min(entries, max(int(figure.bbox.width / figure.dpi / _ENTRY), 1))


# -- fields ----------------------------------------------------------------------------------------


def around(cells: Cells) -> Cells:
    """Reorder the vertices of each cell (segment, triangle, quadrilateral) along its boundary."""
    return cells[:, [0, 1, 3, 2]] if cells.shape[1] == 4 else cells


def are_distinct(x: Array, cells: Cells, pixels: float) -> bool:
    """Return whether cells are so large that lines along their edges do not hide the colours.

    Args:
        x: positions of the vertices.
        cells: vertices of the cells.
        pixels: number of pixels per length.
    """
    sides = x[cells[:, 0]] - x[cells[:, 1]]
    return bool(np.linalg.norm(sides, axis=1).mean() * pixels > _DENSE)


def draw_edges(axes: Axes, x: Array, cells: Cells, width: float, alpha: float) -> None:
    """Draw the edges of triangles or quadrilaterals in 2D.

    Args:
        axes: axes in which the edges are drawn.
        x: positions of the vertices, shape (n, 2).
        cells: vertices of the cells.
        width: line width; 0 for no edges.
        alpha: opacity of the lines.
    """
    from matplotlib.collections import PolyCollection

    look = dict(facecolors="none", edgecolors=INK, linewidths=width, alpha=alpha)
    axes.add_collection(PolyCollection(x[around(cells)], **look))


def shade(axes: Axes, x: Array, cells: Cells, values: npt.NDArray[Any], **look: Any) -> Any:
    """Colour 2D cells by a field; return the matplotlib object for a colour bar.

    The cells are triangles or quadrilaterals. Matplotlib interpolates colours instead of values,
    which on coarse meshes gives colours that are not in the colour bar. The field is therefore
    interpolated on a finer mesh. Quadrilaterals are divided at their midpoints, because division by
    a diagonal would make a symmetric field asymmetric.

    Args:
        axes: axes in which the field is drawn.
        x: positions of the vertices, shape (n, 2).
        cells: vertices of the cells.
        values: field at the vertices, shape (n,).
        **look: options of ``Axes.tripcolor``.
    """
    from matplotlib import tri

    loop = around(cells)
    if loop.shape[1] == 4:
        middle = np.broadcast_to(len(x) + np.arange(len(loop))[:, None, None], (len(loop), 4, 1))
        x = np.concatenate([x, x[loop].mean(axis=1)])
        values = np.concatenate([values, values[loop].mean(axis=1)])
        sides = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2)
        loop = np.dstack([sides, middle]).reshape(-1, 3)
    mesh = tri.Triangulation(*x.T, loop)
    halved = int(np.clip(np.log(_MOST_TRIANGLES / len(loop)) / np.log(4), 0, _FINEST))
    # bodies may overlap, so triangles are not searched
    linear = tri.LinearTriInterpolator(mesh, values, tri.TriFinder(mesh))
    mesh, field = tri.UniformTriRefiner(mesh).refine_field(values, linear, subdiv=halved)
    return axes.tripcolor(mesh, np.ma.filled(field, np.nan), shading="gouraud", **look)
