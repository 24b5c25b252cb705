# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures, their files, and colours."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from mpi4py import MPI

import numpy as np

from dolfinx_contact._files import part_of
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import on_root
from dolfinx_contact.laws import status

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure, SubFigure

__all__ = [
    *("FIELD", "FILLS", "FLOOR", "INK", "LINES", "NOT_FINITE", "TINTS", "Drawing", "File"),
    *("add_status_legend", "drawn_on_root", "new_figure", "save"),
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
TINTS = ["#c3d0dc", "#e3d3b4", "#c9dcc3", "#d9cbdf"]  # colours of bodies without a field
NOT_FINITE = "#9a9a9a"
FIELD = "Spectral_r"  # colour map of fields
_DPI = 130


def new_figure(size: tuple[float, float], layout: str = "constrained") -> Figure:
    """Return an empty figure without a window.

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
    """Write a figure or the view of a plotter; without a file do nothing. Not collective.

    Raises:
        OSError: with the path, if it cannot be written; an existing file is then unchanged.
    """
    if file is None:
        return
    with part_of(Path(file)) as part:
        if hasattr(drawing, "savefig"):
            drawing.savefig(part, dpi=_DPI, bbox_inches="tight", pad_inches=0.1)
        else:  # VTK cannot write PDF or SVG with transparent parts
            from matplotlib.image import imsave

            imsave(part, np.asarray(drawing.screenshot(None, return_img=True)), dpi=200)


def add_status_legend(
    figure: Figure | SubFigure,
    letters: str,
    names: dict[str, str] = status.NAMES,
    title: str | None = None,
) -> None:
    """Add a legend with the statuses of contact points below a figure.

    Args:
        figure: figure.
        letters: letters of all points.
        names: names of the letters.
        title: title of the legend.
    """
    from matplotlib.patches import Patch

    look: dict[str, Any] = dict(edgecolor=INK, lw=0.5)
    handles = [
        Patch(facecolor=status.COLOURS[k], label=name, **look)
        for k, name in names.items()
        if k in letters
    ]
    place: dict[str, Any] = dict(loc="outside lower center", ncols=max(len(handles), 1))
    figure.legend(handles=handles, frameon=False, title=title, **place)


def drawn_on_root(comm: MPI.Comm, file: File, draw: Callable[[], Drawing]) -> Drawing | None:
    """Draw and write on rank 0, whose error is raised on every rank. Collective.

    Returns:
        The drawing on rank 0, None on other ranks.
    """
    drawings: list[Drawing] = []

    def write() -> None:
        drawings.append(draw())
        save(drawings[0], file)

    on_root(comm, write)
    return drawings[0] if drawings else None
