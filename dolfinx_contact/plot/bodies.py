# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of deformed bodies with their obstacles, and of several states side by side.

The visible part is gathered to rank 0 (`scene_of`), which draws with matplotlib in 2D and with
PyVista in 3D.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.laws import status
from dolfinx_contact.plot.figures import (
    Drawing,
    File,
    add_status_legend,
    drawn_on_root,
    new_figure,
)
from dolfinx_contact.plot.in_2d import draw_2d, draw_body
from dolfinx_contact.plot.scene import Array, Look, Scene, check_look, scene_of, words_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dolfinx_contact.continuation import BranchPoint, Solution
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = ["draw_scene", "picture_of_body", "picture_of_states"]


def _check_options(a: Arguments) -> None:
    check_look(picture_of_body, a.look)


@collective("a picture", _check_options)
def picture_of_body(
    file: File,
    problem: ContactProblem,
    *,
    state: State | None = None,
    stress: Any = None,
    scale: float = 1.0,
    title: str | None = None,
    **look: Unpack[Look],
) -> Drawing | None:
    """Draw the deformed body with its obstacles and the rims of its contact surfaces. Collective.

    The rim of a slave surface is thick, that of a master thin. A plane is drawn as a rectangle
    below the body. Another obstacle that is much larger than the body is drawn only around it.
    Obstacles between the viewer and the body are transparent.

    Args:
        file: ``.png``, ``.pdf`` or ``.svg`` (in 3D the latter two contain an image); None writes
            nothing.
        problem: contact problem.
        state: state to draw, default the current Functions.
        stress: 3 x 3 UFL stress (``material.full_stress(u)``), or one for each cell tag as in
            `write_fields`. The colours are the von Mises stress, averaged to the vertices.
        scale: factor of the displacement and of the motion of obstacles, default 1; other factors
            are added to the title. The initial gap is not magnified: a warning is logged if the
            body is drawn through an obstacle.
        title: title of the picture; default: "Deformed body", with the time or load of the state.
        **look: field, view, clip, arrows, region, edges, units: see `Look`.

    Returns:
        On rank 0 the matplotlib ``Figure`` in 2D and the ``pyvista.Plotter`` in 3D, which can be
        changed and written again; None on other ranks. Close a plotter that is not needed.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib or PyVista is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        RuntimeError: on every rank, if VTK needs a display and there is none.
        TypeError: on every rank, if an option does not exist.
        ValueError: on every rank, if an argument is not admissible or differs between ranks.

    Example:
        ::

            plot.picture_of_body("block.pdf", problem, stress=steel.full_stress(u), view="-y")
            plot.picture_of_body("drag.png", problem, clip="-y", arrows={"drag": (top, motion)})
            look = dict(units={"length": "mm", "stress": "MPa"}, region=[(0, 0, 0), (1, 1, 1)])
            plot.picture_of_body("detail.png", problem, stress=steel.full_stress(u), **look)
    """
    if title is None:
        title = ", ".join(filter(None, ["Deformed body", words_of(state)]))
    with problem.at(state) as shown:
        scene = scene_of(shown, stress, scale, title, look)

    def draw() -> Drawing:
        assert scene is not None
        return draw_scene(scene.with_obstacles_around(scene.x))

    return drawn_on_root(problem.comm, file, draw)


def draw_scene(
    scene: Scene,
    visible: Array | None = None,
    limits: tuple[float, float] | None = None,
    width: int = 1600,
) -> Drawing:
    """Draw a scene. Not collective.

    Args:
        scene: bodies and obstacles.
        visible: points that must be visible, shape (k, dim); default: bodies and obstacles.
        limits: ends of the colours, default those of the scene.
        width: approximate width in pixels.
    """
    visible = scene.visible_points() if visible is None else visible
    if scene.x.shape[1] == 2:
        return draw_2d(scene, visible, limits, width)
    optional("pyvista", "pictures")
    from dolfinx_contact.plot.in_3d import draw_3d

    return draw_3d(scene, visible, limits, width)


def _check_states(a: Arguments) -> None:
    problem = getattr(a.system, "problem", a.system)
    a.points = [point.state if isinstance(point, EvolutionStep) else point for point in a.points]
    if problem.V.mesh.geometry.dim != 2 or not a.points:
        raise ValueError("picture_of_states requires a body in 2D and at least one point")
    of_states = problem is a.system
    if any(isinstance(point, State) != of_states for point in a.points):
        kind = "States of a ContactProblem" if of_states else "points of a ParametricContact"
        raise ValueError(f"picture_of_states takes {kind}, got {a.points}")


def _loads(a: Arguments) -> dict[str, Any]:
    """Return gamma and time of the points, whose arrays belong to one rank."""
    loads = [[getattr(point, name, None) for name in ("gamma", "time")] for point in a.points]
    return {"points": loads}


@collective("a picture of states", _check_states, compare=_loads)
def picture_of_states(
    file: File,
    system: ParametricContact | ContactProblem,
    points: Sequence[BranchPoint | Solution | State | EvolutionStep],
    *,
    titles: Sequence[str] = (),
    scale: float = 1.0,
) -> Figure | None:
    """Draw states of a body in 2D side by side, with the statuses of contact points. Collective.

    Args:
        file: picture in any format of matplotlib; None writes nothing.
        system: system of the points, whose Functions hold the last point afterwards; or problem of
            the states.
        points: points of branches, or `Solutions.found`; for a problem its states or steps.
        titles: titles of the panels, default gamma or the time, and the numbers of points of each
            status.
        scale: factor of the displacement, default 1.

    Returns:
        The figure on rank 0, None on other ranks.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        ValueError: on every rank, if the body is not 2D, there is no point or one of another
            kind, the scale is not finite, or arguments differ between ranks.
    """
    optional("matplotlib", "pictures")
    scenes = []
    captions = []

    def add(shown: ContactProblem, at: str, tables: Collection[ContactTable]) -> None:
        words = status.summary("".join(table.status for table in tables))
        captions.append(": ".join(filter(None, [at, words])))
        scenes.append(scene_of(shown, None, scale, "", Look(field="displacement"), tables))

    of: Any = system
    checked: Sequence[Any] = points
    for point in checked:
        if isinstance(point, State):
            with of.at(point) as shown:
                add(shown, words_of(point), [shown.table(s) for s in shown.surfaces])
        else:
            tables = of.result_at(point).tables
            add(of.problem, rf"$\gamma$ = {point.gamma:.4g}", tables.values())

    def draw() -> Figure:
        panels = [scene for scene in scenes if scene is not None]
        return _draw_states(panels, titles or captions, scale)

    return drawn_on_root(system.comm, file, draw)


def _draw_states(scenes: Sequence[Scene], titles: Sequence[str], scale: float) -> Figure:
    """Draw scenes side by side, with one scale of colours and a legend of statuses."""
    # slender bodies in a column or a row, others in a square
    every = np.concatenate([scene.x for scene in scenes])
    low, high = every.min(axis=0), every.max(axis=0)
    ratio = float(np.divide(*(high - low)[::-1]))
    columns = int(np.clip(np.ceil(np.sqrt(len(scenes) * ratio)), 1, len(scenes)))
    rows = -(-len(scenes) // columns)
    width = min(12.0 / columns, 9.0 / rows / ratio)
    size = max(columns * width + 1.3, 4.5), rows * (width * ratio + 0.4) + 0.9
    figure = new_figure(size, "compressed")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    highest = max(float(np.max(s.values)) for s in scenes if s.values is not None)
    limits = 0.0, highest or 1.0
    for axes, scene, title in zip(panels, scenes, titles, strict=False):
        shades = draw_body(axes, scene.with_obstacles_around(every), np.stack([low, high]), limits)
        look: dict[str, Any] = dict(edgecolors="0.2", linewidths=0.2, zorder=3)
        colours = [status.COLOURS[k] for k in scene.letters]
        axes.scatter(*scene.points.T, s=14 if len(colours) <= 40 else 8, c=colours, **look)
        axes.set_title(title, fontsize=10, wrap=True)
    for axes in panels:
        axes.set_axis_off()
    label = "|u|" if scale == 1 else f"|u|, drawn x {scale:.3g}"
    figure.colorbar(shades, ax=list(panels), aspect=30, pad=0.01).set_label(label)
    add_status_legend(figure, "".join(scene.letters for scene in scenes))
    return figure
