# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of deformed bodies with their obstacles, and of several states side by side.

The visible part is gathered to rank 0 (`scene_of`), which draws with matplotlib in 2D and with
PyVista in 3D (`draw_3d`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.laws import status
from dolfinx_contact.plot.figures import (
    FLOOR,
    INK,
    LINES,
    Drawing,
    File,
    add_status_legend,
    around,
    draw_edges,
    drawn_on_root,
    new_figure,
    shade,
    title_of,
    with_unit,
    words_of,
)
from dolfinx_contact.plot.scene import Look, Scene, check_look, framed, scene_of
from dolfinx_contact.results.outer_surface import Cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dolfinx_contact.continuation import BranchPoint, Solution
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = ["draw_scene", "picture_of_body", "picture_of_states"]

_PIXELS = 180  # pixels per inch of a picture
_ACROSS = 1600.0  # approximate number of pixels along the longer side of a picture


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

    The bodies fill the picture; a larger obstacle may be cut off at the edge of the picture. The
    rim of a slave surface is drawn as a thick line, the rim of a master surface as a thin line. A
    plane is drawn as a rectangle below the body. Other obstacles that are much larger than the body
    are drawn only near it. Obstacles between the viewer and the body are transparent.

    Args:
        file: ``.png``, ``.pdf`` or ``.svg`` (in 3D the latter two contain an image); None writes
            nothing.
        problem: contact problem.
        state: state to draw, default the current Functions.
        stress: 3 x 3 UFL stress (``material.full_stress(u)``), or one for each cell tag as in
            `write_fields`. The colours show the von Mises stress, averaged to the vertices.
        scale: factor by which the displacement and the motion of obstacles are multiplied, default
            1; a factor other than 1 is added to the title. The initial gap is not magnified; hence
            a magnified body may overlap an obstacle in the picture.
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
        title = title_of("Deformed body", words_of(state))
    with problem.at(state) as shown:
        scene = scene_of(shown, stress, scale, title, look)

    def draw() -> Drawing:
        assert scene is not None
        return draw_scene(framed([scene])[0])

    return drawn_on_root(problem.comm, file, draw)


def draw_scene(scene: Scene, width: int = 1600) -> Drawing:
    """Draw bodies and obstacles in one state. Not collective.

    Args:
        scene: bodies and obstacles, with the frame and the colours determined by `framed`.
        width: approximate width in pixels.
    """
    if scene.x.shape[1] == 2:
        return _draw_2d(scene, width)
    optional("pyvista", "pictures")
    from dolfinx_contact.plot.in_3d import draw_3d

    return draw_3d(scene, width)


def _draw_2d(scene: Scene, width: int) -> Figure:
    """Draw bodies and obstacles in 2D with matplotlib, see `draw_scene`."""
    extent = np.ptp(scene.visible, axis=0)
    is_flat = bool(extent[1] < 0.5 * extent[0])
    size = np.maximum(width / _PIXELS * extent / extent.max(), (2.4, 1.0))
    figure = new_figure(tuple(size + ((1.0, 1.9) if is_flat else (1.9, 1.1))), "compressed")
    figure.suptitle(scene.title, fontweight="bold", wrap=True)
    axes = figure.add_subplot()
    shades = _draw_body(axes, scene)
    if scene.values is not None:
        place = "bottom" if is_flat else "right"
        figure.colorbar(shades, ax=axes, location=place, aspect=30).set_label(scene.label)
    arrows = scene.view.arrows
    look: dict[str, Any] = dict(angles="xy", scale_units="xy", scale=1, width=0.006, zorder=5)
    for (name, (points, vectors)), colour in zip(arrows.items(), cycle(LINES), strict=False):
        axes.quiver(*points.T, *vectors.T, color=colour, label=name, **look)
    if arrows:
        axes.legend(frameon=False, loc="upper right")
    unit = scene.view.units.get("length")
    axes.set(xlabel=with_unit("x", unit), ylabel=with_unit("y", unit))
    axes.locator_params(axis="x", nbins=3 if extent[1] > 3 * extent[0] else 8)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_body(axes: Axes, scene: Scene) -> Any:
    """Draw bodies, obstacles and rims; return the coloured matplotlib object for a colour bar."""
    from matplotlib.collections import LineCollection, PathCollection, PolyCollection
    from matplotlib.path import Path

    x, cells = scene.x, scene.cells
    low, high = scene.visible.min(axis=0), scene.visible.max(axis=0)
    size = float(np.max(high - low))
    values, colours, ends = scene.colours()
    thin = float(np.clip(20 / np.sqrt(len(cells)), 0.05, 0.3))  # coloured cells stay visible
    thin *= scene.shows_edges(_ACROSS / size)
    shades = shade(axes, x, cells, values, cmap=colours, vmin=ends[0], vmax=ends[1])
    draw_edges(axes, x, cells, thin, 0.4)
    # obstacles are areas or bands with a depth
    depth = 0.05 * float(np.sqrt(np.prod(high - low)))
    for o in scene.obstacles:
        band = np.concatenate([o.x[o.cells], (o.x + depth * o.n)[o.cells[:, ::-1]]], axis=1)
        fill: Any = PolyCollection(band)
        if o.inside:
            fill = PathCollection([Path(*path) for path in o.inside])
        fill.set(facecolors=FLOOR, edgecolors=FLOOR, zorder=0)
        axes.add_collection(fill)
    lines = [(x, _boundary(cells), 0.8), *((x, face, 2.0) for face in scene.slaves)]
    lines += [(x, face, 1.2) for face in scene.masters]
    lines += [(o.x, o.cells, 1.2) for o in scene.obstacles]
    for points, face, width in lines:
        axes.add_collection(LineCollection(points[face], colors=INK, linewidths=width))
    margin = 0.0 if scene.view.region is not None else 0.03 * size
    low, high = low - margin, high + margin
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return shades


def _boundary(cells: Cells) -> Cells:
    """Return the boundary edges of a 2D mesh, given by the vertices of its cells."""
    loop = around(cells)
    sides = np.sort(np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    return np.asarray(edges[count == 1])


# -- states side by side ---------------------------------------------------------------------------


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
    """Return gamma and time of each point, by which the points are compared between ranks."""
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
        system: system to which the points belong, whose Functions contain the last point
            afterwards; or the contact problem, if states are drawn.
        points: points of branches or of `Solutions.found`, for a system; states or evolution steps,
            for a contact problem.
        titles: titles of the panels; default: gamma or the time, and the numbers of contact points
            of each status.
        scale: factor by which the displacement is multiplied, default 1.

    Returns:
        The figure on rank 0, None on other ranks.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        ValueError: on every rank, if the body is not 2D, there are no points, a point has another
            type, the scale is not finite, or arguments differ between ranks.
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
                add(shown, words_of(point), shown.tables().values())
        else:
            tables = of.result_at(point).tables
            add(of.problem, rf"$\gamma$ = {point.gamma:.4g}", tables.values())

    def draw() -> Figure:
        panels = framed([scene for scene in scenes if scene is not None])
        return _draw_states(panels, titles or captions, scale)

    return drawn_on_root(system.comm, file, draw)


def _draw_states(scenes: Sequence[Scene], titles: Sequence[str], scale: float) -> Figure:
    """Draw scenes side by side, with a common colour bar and a legend of the statuses."""
    # slender bodies in a column or a row, others in a square
    extent = np.ptp(scenes[0].visible, axis=0)
    ratio = float(extent[1] / extent[0])
    columns = int(np.clip(np.ceil(np.sqrt(len(scenes) * ratio)), 1, len(scenes)))
    rows = -(-len(scenes) // columns)
    width = min(12.0 / columns, 9.0 / rows / ratio)
    size = max(columns * width + 1.3, 4.5), rows * (width * ratio + 0.4) + 0.9
    figure = new_figure(size, "compressed")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, scene, title in zip(panels, scenes, titles, strict=False):
        shades = _draw_body(axes, scene)
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
