# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 2D, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dolfinx_contact.plot.figures import INK, LINES, new_figure, with_unit
from dolfinx_contact.plot.look import Options
from dolfinx_contact.plot.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "FLOOR",
    "NOT_FINITE",
    "TINTS",
    "around",
    "connected_parts",
    "draw_2d",
    "draw_field",
    "field_label",
    "finite_range",
    "framed",
    "triangles",
]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

FLOOR = "#c9ced4"
TINTS = ["#c3d0dc", "#e3d3b4", "#c9dcc3", "#d9cbdf"]  # colours of bodies without a field
NOT_FINITE = "#9a9a9a"
_DPI = 100


def draw_2d(
    scene: Scene,
    options: Options,
    reach: Array,
    limits: Mapping[str, tuple[float, float]],
    width: int,
) -> Figure:
    """Draw bodies in 2D; arguments as of `draw_scene`."""
    figure = new_figure((1.0, 1.0))
    from matplotlib.colors import ListedColormap

    # obstacles are bands with a depth
    depth = 0.05 * float(np.sqrt(np.prod(np.ptp(reach[:, :2], axis=0))))
    points = np.concatenate([reach - depth, reach + depth]) if scene.obstacles else reach
    low, high = framed(scene, options, points[:, :2])
    # panels one above the other, beside each other if the body is tall
    wide, tall = high - low
    names = list(scene.values) or [""]
    is_flat = bool(tall < 0.5 * wide)
    rows, columns = (1, len(names)) if tall > wide else (len(names), 1)
    panel = 0.55 * width / _DPI / max(columns, tall / wide) * np.array([1.0, tall / wide])
    panel = np.maximum(panel, (2.4, 1.0)) + ((0.9, 1.9) if is_flat and names[0] else (1.9, 1.1))
    figure.set_size_inches(columns * panel[0], rows * panel[1])
    figure.suptitle(scene.title, fontweight="bold", wrap=True)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=True):
        if name:
            ends = limits.get(name) or finite_range(scene.values[name])
            shades = draw_field(axes, scene, scene.values[name], ends, options.cmap)
            where = dict(location="bottom" if is_flat else "right", shrink=0.7, aspect=30)
            bar = figure.colorbar(shades, ax=axes, **where)
            bar.set_label(field_label(name, scene.values[name], options))
        else:
            colours = ListedColormap(TINTS)
            tint = connected_parts(scene.cells, len(scene.x)) % len(TINTS)
            draw_field(axes, scene, tint, (-0.5, len(TINTS) - 0.5), colours)
        _draw_outlines(axes, scene, depth)
        _draw_arrows(axes, options, 0.2 * float(np.hypot(wide, tall)))
        axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_xlabel(with_unit("x", options.units[0]))
        axes.set_ylabel(with_unit("y", options.units[0]))
        axes.locator_params(axis="x", nbins=3 if tall > 3 * wide else 8)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_field(
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
    from matplotlib.collections import LineCollection

    x = scene.x[:, :2]
    colours = colormaps.get_cmap(cmap).with_extremes(bad=NOT_FINITE)
    look: dict[str, Any] = dict(shading="gouraud", cmap=colours, vmin=limits[0], vmax=limits[1])
    shades = axes.tripcolor(*x.T, triangles(scene.cells), values, **look)
    loop = around(scene.cells)
    edges = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2)
    thin = float(np.clip(20 / np.sqrt(len(loop)), 0.05, 0.3))  # fine meshes would hide the colours
    axes.add_collection(LineCollection(x[edges], colors=INK, linewidths=thin, alpha=0.4))
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
        xy = points[:, :2].T, arrows[:, :2].T
        colour = LINES[i % len(LINES)]
        axes.quiver(*xy[0], *xy[1], color=colour, label=f"{name} ({longest:.3g})", **look)
    if options.arrows:
        axes.legend(frameon=False, loc="upper right")


def framed(scene: Scene, options: Options, points: Array) -> tuple[Array, Array]:
    """Corners of the box that a picture shows, with a margin.

    Args:
        scene: bodies and obstacles.
        options: options of the picture, of which the zoom is used.
        points: points that are visible without a zoom, shape (n, 2) or (n, 3).
    """
    dim = points.shape[1]
    low, high = points.min(axis=0), points.max(axis=0)
    zoom = options.zoom
    if isinstance(zoom, np.ndarray):
        low, high = zoom[:, :dim]
    elif zoom == "contact":
        cells = [c.ravel() for c in (*scene.slaves, *scene.masters)]
        face = scene.x[np.concatenate(cells), :dim]
        rim = 0.15 * np.ptp(face, axis=0).max()
        low = np.maximum(low, face.min(axis=0) - rim)
        high = np.minimum(high, face.max(axis=0) + rim)
    else:
        middle = (low + high) / 2
        low, high = (middle + (end - middle) / float(zoom) for end in (low, high))
    margin = 0.03 * (high - low).max()
    return low - margin, high + margin


def finite_range(values: Array) -> tuple[float, float]:
    """Smallest and largest finite value, as different ends of a range of colours."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    low = 0.0 if abs(low) < 1e-9 * high else low  # no digits of round-off at a bar
    return (low, high) if high > low else (low, low + (abs(low) or 1.0))


def field_label(name: str, values: Array, options: Options) -> str:
    """Label of a field, with the unit of the fields of this package."""
    length, stress = options.units
    label = with_unit(name, {"displacement": length, "von Mises stress": stress}.get(name, ""))
    return label if np.isfinite(values).all() else f"{label} (grey: not a number)"


def around(cells: Cells) -> Cells:
    """Vertices of segments, triangles or quadrilaterals in the order around the cell."""
    return cells[:, [0, 1, 3, 2]] if cells.shape[1] == 4 else cells


def triangles(cells: Cells) -> Cells:
    """Triangles of triangular or quadrilateral cells."""
    return cells if cells.shape[1] == 3 else np.vstack([cells[:, :3], cells[:, [1, 3, 2]]])


def connected_parts(cells: Cells, count: int) -> npt.NDArray[np.int32]:
    """Number of the connected part of each vertex of cells (k, corners), shape (count,)."""
    first = np.repeat(cells[:, :1], cells.shape[1], axis=1).ravel()
    graph = coo_array((np.ones(first.size), (first, cells.ravel())), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
