# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 2D, drawn with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dolfinx_contact.laws.status import COLOURS
from dolfinx_contact.plot.figures import FIELD, FLOOR, INK, LINES, NOT_FINITE, TINTS, new_figure
from dolfinx_contact.plot.scene import Options, Scene, finite_range

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["around", "connected_parts", "draw_2d", "draw_body", "shade"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

_DPI = 100
_MOST_TRIANGLES = 40_000  # of the mesh on which a field is drawn
_FINEST = 8  # divisions of an edge of a cell in it


def draw_2d(
    scene: Scene, options: Options, reach: Array, limits: tuple[float, float] | None, width: int
) -> Figure:
    """Draw bodies in 2D; arguments as of `draw_scene`."""
    # obstacles are bands with a depth
    depth = 0.05 * float(np.sqrt(np.prod(np.ptp(reach[:, :2], axis=0))))
    points = np.concatenate([reach - depth, reach + depth]) if scene.obstacles else reach
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    wide, tall = 1.06 * (high - low)
    is_flat = bool(tall < 0.5 * wide)
    size = 0.55 * width / _DPI / max(1.0, tall / wide) * np.array([1.0, tall / wide])
    size = np.maximum(size, (2.4, 1.0)) + ((0.9, 1.9) if is_flat else (1.9, 1.1))
    figure = new_figure((size[0], size[1]))
    figure.suptitle(scene.title, fontweight="bold", wrap=True)
    axes = figure.add_subplot()
    shades = draw_body(axes, scene, low, high, limits)
    if scene.values is not None:
        where = dict(location="bottom" if is_flat else "right", shrink=0.7, aspect=30)
        figure.colorbar(shades, ax=axes, **where).set_label(scene.label)
    _draw_arrows(axes, options, 0.2 * float(np.hypot(wide, tall)))
    axes.set(xlabel="x", ylabel="y")
    axes.locator_params(axis="x", nbins=3 if tall > 3 * wide else 8)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_body(
    axes: Axes, scene: Scene, low: Array, high: Array, limits: tuple[float, float] | None
) -> Any:
    """Draw bodies, obstacles, rims and contact points; return the colours of the field.

    Args:
        axes: axes.
        scene: bodies and obstacles.
        low: lower corner of the visible box, shape (2,).
        high: upper corner.
        limits: ends of the colours, default those of the scene.
    """
    from matplotlib.colors import ListedColormap

    if scene.values is not None:
        ends = limits or finite_range(scene.values)
        shades = _draw_field(axes, scene, scene.values, ends, FIELD)
    else:
        tint = connected_parts(scene.cells, len(scene.x)) % len(TINTS)
        shades = _draw_field(axes, scene, tint, (-0.5, len(TINTS) - 0.5), ListedColormap(TINTS))
    _draw_outlines(axes, scene, 0.05 * float(np.sqrt(np.prod(high - low))))
    if scene.marks is not None:
        x, letters = scene.marks
        look: dict[str, Any] = dict(edgecolors="0.2", linewidths=0.2, zorder=3)
        axes.scatter(*x.T, s=14 if len(x) <= 40 else 8, c=[COLOURS[k] for k in letters], **look)
    margin = 0.03 * (high - low).max()
    low, high = low - margin, high + margin
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return shades


def _draw_field(
    axes: Axes, scene: Scene, values: npt.NDArray[Any], limits: tuple[float, float], cmap: Any
) -> Any:
    """Draw the cells of a body in 2D in the colours of a field, and their edges.

    Args:
        axes: axes.
        scene: bodies.
        values: field at the vertices (n,).
        limits: ends of the colours.
        cmap: colour map or its name.
    """
    from matplotlib import colormaps

    colours = colormaps.get_cmap(cmap).with_extremes(bad=NOT_FINITE)
    look: dict[str, Any] = dict(cmap=colours, vmin=limits[0], vmax=limits[1])
    thin = float(np.clip(20 / np.sqrt(len(scene.cells)), 0.05, 0.3))  # coloured cells stay visible
    return shade(axes, scene.x[:, :2], scene.cells, values, width=thin, alpha=0.4, **look)


def shade(
    axes: Axes,
    x: npt.NDArray[np.float64],
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
    diagonal would make a symmetric field unsymmetric.

    Args:
        axes: axes.
        x: positions of the vertices, shape (n, 2).
        cells: vertices of the cells.
        values: field at the vertices, shape (n,).
        width: line width of the edges.
        alpha: opacity of the edges.
        **look: options of ``Axes.tripcolor``.
    """
    from matplotlib.collections import LineCollection

    loop = around(cells)
    edges = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2)
    triangles = loop
    if cells.shape[1] == 4:
        middle = len(x) + np.arange(len(loop))
        x = np.concatenate([x, x[loop].mean(axis=1)])
        values = np.concatenate([values, values[loop].mean(axis=1)])
        sides = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2)
        triangles = np.dstack([sides, np.broadcast_to(middle[:, None, None], (*loop.shape, 1))])
        triangles = triangles.reshape(-1, 3)
    # barycentric coordinates of a finer mesh of each triangle, row by row
    n = int(np.clip(np.sqrt(_MOST_TRIANGLES / max(len(triangles), 1)), 1, _FINEST))
    grid = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)])
    number = {(i, j): k for k, (i, j, _) in enumerate(grid)}
    up = [[(i, j), (i + 1, j), (i, j + 1)] for i, j, k in grid if k > 0]
    down = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j, k in grid if k > 1]
    parts = np.array([[number[corner] for corner in part] for part in up + down])
    finer = (parts + len(grid) * np.arange(len(triangles))[:, None, None]).reshape(-1, 3)
    places = np.einsum("qc,tcd->tqd", grid / n, x[triangles]).reshape(-1, 2)
    field = np.einsum("qc,tc->tq", grid / n, values[triangles]).ravel()
    shades = axes.tripcolor(*places.T, finer, field, shading="gouraud", **look)
    axes.add_collection(LineCollection(x[edges], colors=INK, linewidths=width, alpha=alpha))
    return shades


def _draw_outlines(axes: Axes, scene: Scene, depth: float) -> None:
    """Draw obstacles with their depth, and the rims of contact surfaces."""
    from matplotlib.collections import LineCollection, PolyCollection

    for o in scene.obstacles:
        band = np.concatenate([o.x[o.cells], (o.x + depth * o.n)[o.cells[:, ::-1]]], axis=1)
        look = dict(facecolors=FLOOR, edgecolors=FLOOR, zorder=0)
        axes.add_collection(PolyCollection(band[..., :2], **look))
    lines = [(scene.x, cells, 2.0) for cells in scene.slaves]
    lines += [(scene.x, cells, 1.2) for cells in scene.masters]
    lines += [(o.x, o.cells, 1.2) for o in scene.obstacles]
    for x, cells, width in lines:
        axes.add_collection(LineCollection(x[cells, :2], colors=INK, linewidths=width))


def _draw_arrows(axes: Axes, options: Options, length: float) -> None:
    """Draw the arrows of a look, with the magnitude of the longest one in the legend."""
    for i, (name, (points, vectors)) in enumerate(options.arrows.items()):
        longest = float(np.linalg.norm(vectors, axis=1).max())
        arrows = length / (longest or 1.0) * vectors
        look: dict[str, Any] = dict(angles="xy", scale_units="xy", scale=1, width=0.006, zorder=5)
        look |= dict(color=LINES[i % len(LINES)], label=f"{name} ({longest:.3g})")
        axes.quiver(*points[:, :2].T, *arrows[:, :2].T, **look)
    if options.arrows:
        axes.legend(frameon=False, loc="upper right")


def around(cells: Cells) -> Cells:
    """Vertices of segments, triangles or quadrilaterals in the order around the cell."""
    return cells[:, [0, 1, 3, 2]] if cells.shape[1] == 4 else cells


def connected_parts(cells: Cells, count: int) -> npt.NDArray[np.int32]:
    """Number of the connected part of each vertex of cells (k, corners), shape (count,)."""
    first = np.repeat(cells[:, :1], cells.shape[1], axis=1).ravel()
    graph = coo_array((np.ones(first.size), (first, cells.ravel())), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
