# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 2D, drawn with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import connected_parts
from dolfinx_contact.plot.figures import FIELD, FLOOR, INK, LINES, NOT_FINITE, TINTS, new_figure
from dolfinx_contact.plot.scene import Array, Cells, Scene, around, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["colours_of", "draw_2d", "draw_body", "range_of", "shade"]

_PIXELS = 180  # of the width of a picture in an inch of the body
_ACROSS = 1600.0  # pixels of the longer side of a picture, about
_MOST_TRIANGLES = 40_000  # of the mesh on which a field is drawn
_FINEST = 3  # times that an edge of a cell is halved in it


def draw_2d(scene: Scene, visible: Array, limits: tuple[float, float] | None, width: int) -> Figure:
    """Draw bodies in 2D; arguments as of `draw_scene`."""
    extent = np.ptp(visible, axis=0)
    is_flat = bool(extent[1] < 0.5 * extent[0])
    size = np.maximum(width / _PIXELS * extent / extent.max(), (2.4, 1.0))
    figure = new_figure(tuple(size + ((1.0, 1.9) if is_flat else (1.9, 1.1))), "compressed")
    figure.suptitle(scene.title, fontweight="bold", wrap=True)
    axes = figure.add_subplot()
    arrows = scene.scaled_arrows(visible)
    for i, (name, (points, vectors)) in enumerate(arrows.items()):
        look: dict[str, Any] = dict(angles="xy", scale_units="xy", scale=1, width=0.006, zorder=5)
        axes.quiver(*points.T, *vectors.T, color=LINES[i % len(LINES)], label=name, **look)
        if scene.region is None:
            visible = np.concatenate([visible, points, points + vectors])
    shades = draw_body(axes, scene, visible, limits)
    if scene.values is not None:
        place = "bottom" if is_flat else "right"
        figure.colorbar(shades, ax=axes, location=place, aspect=30).set_label(scene.label)
    if arrows:
        axes.legend(frameon=False, loc="upper right")
    axes.set(xlabel=with_unit("x", scene.unit), ylabel=with_unit("y", scene.unit))
    axes.locator_params(axis="x", nbins=3 if extent[1] > 3 * extent[0] else 8)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_body(axes: Axes, scene: Scene, visible: Array, limits: tuple[float, float] | None) -> Any:
    """Draw bodies, obstacles and rims; return the colours of the field.

    Args:
        axes: axes.
        scene: bodies and obstacles.
        visible: points that must be visible, shape (k, 2).
        limits: ends of the colours, default those of the scene.
    """
    from matplotlib.collections import LineCollection, PathCollection, PolyCollection
    from matplotlib.path import Path

    x, cells = scene.x, scene.cells
    low, high = visible.min(axis=0), visible.max(axis=0)
    values, colours, ends = colours_of(cells, len(x), scene.values, limits)
    thin = float(np.clip(20 / np.sqrt(len(cells)), 0.05, 0.3))  # coloured cells stay visible
    look: dict[str, Any] = dict(cmap=colours, vmin=ends[0], vmax=ends[1])
    thin *= scene.shows_edges(_ACROSS / float(np.max(high - low)))
    shades = shade(axes, x, cells, values, width=thin, alpha=0.4, **look)
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
    margin = 0.03 * (high - low).max() + depth * bool(scene.obstacles)
    margin *= scene.region is None
    low, high = low - margin, high + margin
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return shades


def colours_of(
    cells: Cells, count: int, values: Array | None, limits: tuple[float, float] | None
) -> tuple[npt.NDArray[Any], Any, tuple[float, float]]:
    """Return values at the vertices, their colour map, and the ends of the colours.

    Without a field, the values are numbers of tints of connected parts.

    Args:
        cells: vertices of the cells.
        count: number of vertices.
        values: field at the vertices; None for the tints of connected parts.
        limits: ends of the colours; None for the smallest and largest finite value.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    if values is None:
        links = cells[:, :-1].ravel(), cells[:, 1:].ravel()
        tints = connected_parts(count, *links) % len(TINTS)
        return tints, ListedColormap(TINTS), (-0.5, len(TINTS) - 0.5)
    colours = colormaps[FIELD].with_extremes(bad=NOT_FINITE)
    return values, colours, limits or range_of(values)


def _boundary(cells: Cells) -> Cells:
    """Return the edges of the boundary of bodies in 2D."""
    loop = around(cells)
    sides = np.sort(np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    return np.asarray(edges[count == 1])


def range_of(values: Array) -> tuple[float, float]:
    """Return the smallest and largest finite value as limits of colours, made different."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    low = 0.0 if abs(low) < 1e-9 * high else low  # no digits of round-off at a bar
    return (low, high) if high > low else (low, low + (abs(low) or 1.0))


def shade(
    axes: Axes,
    x: Array,
    cells: Cells,
    values: npt.NDArray[Any],
    *,
    width: float,
    alpha: float,
    **look: Any,
) -> Any:
    """Draw a field on triangles or quadrilaterals in 2D, and the edges of the cells.

    Matplotlib interpolates colours, which on coarse meshes are not those of the colour bar. So the
    field is interpolated on a finer mesh. Quadrilaterals are divided at their midpoints, since a
    diagonal would make a symmetric field asymmetric.

    Args:
        axes: axes.
        x: positions of the vertices, shape (n, 2).
        cells: vertices of the cells.
        values: field at the vertices, shape (n,).
        width: line width of the edges; 0 for none.
        alpha: opacity of the edges.
        **look: options of ``Axes.tripcolor``.
    """
    from matplotlib import tri
    from matplotlib.collections import PolyCollection

    loop = around(cells)
    outlines = dict(facecolors="none", edgecolors=INK, linewidths=width, alpha=alpha)
    edges = PolyCollection(x[loop], **outlines)
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
    shades = axes.tripcolor(mesh, np.ma.filled(field, np.nan), shading="gouraud", **look)
    axes.add_collection(edges)
    return shades
