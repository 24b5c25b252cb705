# SPDX-License-Identifier: LGPL-3.0-or-later
"""One figure of several states of a body in 2D, with the statuses of its contact points."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import by_coordinates
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._validate import number
from dolfinx_contact.io.outside import patch
from dolfinx_contact.laws.status import COLOURS, NAMES
from dolfinx_contact.plot.bodies import body_scene
from dolfinx_contact.plot.figures import drawn_on_root, new_figure, save
from dolfinx_contact.plot.in_2d import draw_body
from dolfinx_contact.plot.scene import Scene, options_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dolfinx_contact.continuation import BranchPoint, Solution
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["picture_of_states"]


def _check(a: Arguments) -> None:
    a.file = None if a.file is None else Path(a.file)
    a.points = list(a.points)
    a.scale = number(a.scale, "the scale of the displacement")
    if a.system.problem.V.mesh.geometry.dim != 2 or not a.points:
        raise ValueError("picture_of_states requires a body in 2D and at least one point")


@collective("a picture of states", _check)
def picture_of_states(
    file: str | os.PathLike[str] | None,
    system: ParametricContact,
    points: Sequence[BranchPoint | Solution],
    *,
    titles: Sequence[str] = (),
    scale: float = 1.0,
) -> Figure | None:
    """Draw states of a body in 2D side by side. Collective.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        system: system of the points; its Functions are those of the last point afterwards.
        points: points of branches, or `Solutions.found`.
        titles: titles of the panels, default none.
        scale: factor of the displacement, default 1.

    Returns:
        The figure on rank 0, None on other ranks.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        ValueError: on every rank, if the body is not 2D, there is no point, the scale is not
            finite, or arguments differ between ranks.
    """
    optional("matplotlib", "pictures")
    options = options_of(2, field="displacement")
    scenes = []
    for point in points:
        tables = system.result_at(point).tables.values()
        scene = body_scene(system.problem, None, scale, options, "")
        places: npt.NDArray[np.float64] = np.zeros((0, 2))
        letters = ""
        for s, table in zip(system.problem.surfaces, tables, strict=True):
            face = patch(s)
            if face and len(face["x"]) == len(table.letters):  # Gauss points have no vertex
                order = by_coordinates(face["x"], face["ids"])
                x = face["x"][order, :2] + scale * face["u"][order]
                places = np.concatenate([places, x])
                letters += "".join(table.letters)
        if scene is not None:
            scenes.append(replace(scene, marks=(places, letters)))

    def draw() -> Figure:
        figure = _draw(scenes, list(titles) or [""] * len(scenes))
        figure.legends[0].set_title(f"displacement x {scale:.3g}")
        save(figure, file)
        return figure

    return drawn_on_root(system.comm, draw)


def _draw(scenes: Sequence[Scene], titles: Sequence[str]) -> Figure:
    """Draw scenes side by side, with one scale of colours and a legend of statuses."""
    from matplotlib.lines import Line2D

    # slender bodies in a column or a row, others in a square
    every = np.concatenate([scene.x[:, :2] for scene in scenes])
    low, high = every.min(axis=0), every.max(axis=0)
    ratio = float((high[1] - low[1]) / (high[0] - low[0]))
    columns = int(np.clip(np.ceil(np.sqrt(len(scenes) * ratio)), 1, len(scenes)))
    rows = -(-len(scenes) // columns)
    width = min(12.0 / columns, 9.0 / rows / ratio)
    figure = new_figure((max(columns * width + 1.3, 4.5), rows * (width * ratio + 0.4) + 0.9))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    corners = np.pad([low, high], ((0, 0), (0, 1)))
    fields = [scene.values for scene in scenes if scene.values is not None]
    limits = 0.0, max(float(values.max()) for values in fields) or 1.0
    for axes, scene, title in zip(panels, scenes, titles, strict=False):
        shades = draw_body(axes, scene.above(corners), low, high, limits)
        axes.set_title(title, fontsize=10)
    figure.colorbar(shades, ax=list(panels), shrink=0.8, pad=0.01, aspect=30).set_label("|u|")
    letters = "".join(scene.marks[1] for scene in scenes if scene.marks)
    handles = [
        Line2D([], [], marker="o", ls="", color=COLOURS[k], mec="0.2", mew=0.3, label=NAMES[k])
        for k in NAMES
        if k in letters
    ]
    place: dict[str, Any] = dict(loc="outside lower center", ncols=max(len(handles), 1))
    figure.legend(handles=handles, title=" ", frameon=False, **place)
    return figure
