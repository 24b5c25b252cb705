# SPDX-License-Identifier: LGPL-3.0-or-later
"""Draws one picture: ``python render.py KIND PICTURE.png``, with pickled data on standard input.

A program of its own, started by `pictures.py`: VTK may end its process when there is no display,
which must not end a solve. It imports nothing of the package, and so neither MPI nor PETSc.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Data = dict[str, Any]

#: Status by code: name, colour.
STATUS = [("open", "#dfe3e8"), ("stick", "#2f6db3"), ("slip", "#f08a24"), ("clamped", "#3d3d3d")]
INK = "#22262b"


# -- matplotlib ----------------------------------------------------------------------------------


def _pyplot() -> Any:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update(
        {
            "font.size": 10,
            "axes.titlesize": 11,
            "axes.titleweight": "bold",
            "axes.edgecolor": INK,
            "axes.linewidth": 0.8,
            "axes.labelcolor": INK,
            "text.color": INK,
            "xtick.color": INK,
            "ytick.color": INK,
            "savefig.dpi": 160,
        }
    )
    return plt


def _status_legend(axes: Any, counts: npt.NDArray[np.int64], **where: Any) -> None:
    """Colours of the statuses, with the number of vertices that have each."""
    from matplotlib.patches import Patch

    shown = [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.5, label=f"{name} ({count})")
        for (name, colour), count in zip(STATUS, counts, strict=True)
        if count > 0
    ]
    axes.legend(handles=shown, frameon=False, **where)


def _triangles(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Triangles of triangular or (in tensor order) quadrilateral cells."""
    if cells.shape[1] == 3:
        return cells
    return np.vstack([cells[:, [0, 1, 2]], cells[:, [1, 3, 2]]])


def _loop(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Vertices of each cell in the order around it."""
    return cells if cells.shape[1] == 3 else cells[:, [0, 1, 3, 2]]


def _shares(x: npt.NDArray[Any], cells: npt.NDArray[np.int64]) -> tuple[Any, Any]:
    """The part of each cell nearest to each of its vertices: quadrilaterals, and their vertex."""
    loop = _loop(cells)
    corners = x[loop]
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    after, before = np.roll(corners, -1, axis=1), np.roll(corners, 1, axis=1)
    quads = np.stack([corners, (corners + after) / 2, centre, (corners + before) / 2], axis=2)
    return quads.reshape(-1, 4, x.shape[1]), loop.reshape(-1)


def contact_3d(data: Data, file: str) -> None:
    """Pressure, and status with the shear traction, side by side on the flattened surface."""
    plt = _pyplot()
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LinearSegmentedColormap

    x, cells, status = data["x"], data["cells"], data["status"].astype(int)
    width, height = np.ptp(x, axis=0)
    panel = 5.0 * np.array([1.0, np.clip(height / width, 0.35, 1.5)])
    figure = plt.figure(figsize=(2 * panel[0] + 1.2, panel[1] + 1.9), layout="constrained")
    figure.suptitle(str(data["title"]), fontsize=14, fontweight="bold")
    grid = figure.add_gridspec(2, 2, height_ratios=(panel[1], 0.12))
    left, right = (figure.add_subplot(grid[0, i]) for i in range(2))

    top = max(data["pressure"].max(), 0.0) or 1.0
    hot = plt.get_cmap("magma_r")(np.linspace(0.12, 0.95, 12))
    shades = left.tripcolor(
        *x.T,
        _triangles(cells),
        np.maximum(data["pressure"], 0.0),
        shading="gouraud",
        cmap=LinearSegmentedColormap.from_list("pressure", [STATUS[0][1], *hot]),
        vmin=0.0,
        vmax=top,
    )
    bar = figure.colorbar(shades, cax=figure.add_subplot(grid[1, 0]), orientation="horizontal")
    bar.outline.set_linewidth(0.5)
    left.set_title("Normal pressure")

    quads, vertex = _shares(x, cells)
    colours = np.array([colour for _, colour in STATUS])[status[vertex]]
    right.add_collection(PolyCollection(quads, facecolors=colours, edgecolors=colours, lw=0.3))
    right.set_title("Status, and shear traction on the body")
    _arrows(right, x, data["shear"])
    legend = figure.add_subplot(grid[1, 1])
    legend.axis("off")
    _status_legend(legend, data["counts"], loc="center", ncols=4)
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.margins(0.08)
        axes.autoscale_view()
        axes.triplot(*x.T, _triangles(cells), color=INK, lw=0.15, alpha=0.25)
        axes.set_xlabel(str(data["labels"][0]))
        axes.spines[["top", "right"]].set_visible(False)
    left.set_ylabel(str(data["labels"][1]))
    right.set_yticklabels([])
    figure.savefig(file)


def _arrows(axes: Any, x: npt.NDArray[Any], vectors: npt.NDArray[Any]) -> None:
    """Arrows at the vertices, spread evenly if they are many."""
    size = np.linalg.norm(vectors, axis=1)
    if size.max() == 0:
        return
    # The largest of each square of a grid, so that the arrows do not lie on each other.
    spacing = np.ptp(x, axis=0).max() / 28
    order = np.argsort(-size, kind="stable")
    squares = np.floor((x[order] - x.min(axis=0)) / spacing).astype(int)
    chosen = order[np.unique(squares, axis=0, return_index=True)[1]]
    chosen = chosen[size[chosen] > 0.02 * size.max()]
    arrows = 2.2 * spacing / size.max() * vectors[chosen]
    look: Data = dict(angles="xy", scale_units="xy", scale=1, width=0.0032, color=INK)
    drawn = axes.quiver(*x[chosen].T, *arrows.T, pivot="mid", clip_on=False, zorder=3, **look)
    drawn.set_in_layout(False)


def contact_2d(data: Data, file: str) -> None:
    """Pressure and shear with the friction bound, against the position along the surface."""
    plt = _pyplot()
    from matplotlib.collections import LineCollection

    s, cells, status = data["x"][:, 0], data["cells"], data["status"].astype(int)
    figure, axes = plt.subplots(figsize=(8.6, 5.0), layout="constrained")
    figure.suptitle(str(data["title"]), fontsize=13, fontweight="bold")
    lines = [
        ("pressure", "pressure", dict(colors="#8c2d19", linewidths=1.8)),
        ("shear", "shear on the body", dict(colors="#2b5d34", linewidths=1.8)),
        ("bound", "friction bound ±", dict(colors="#7d858c", linewidths=1.0, linestyles="--")),
    ]
    handles = []
    for key, label, style in lines:
        for sign in (1, -1) if key == "bound" else (1,):
            value = sign * data[key]
            line = LineCollection(np.stack([s, value], axis=1)[cells], label=label, **style)
            axes.add_collection(line)
        handles.append(line)
    colours = np.array([colour for _, colour in STATUS])[status]
    for key in ("pressure", "shear"):
        axes.scatter(s, data[key], c=colours, s=26, zorder=3, edgecolors=INK, linewidths=0.5)
    axes.axhline(0, color=INK, lw=0.6)
    low, high = np.min([data["shear"], -data["bound"]]), np.max([data["pressure"], data["bound"]])
    span = high - low
    if span > 0:
        axes.set_ylim(low - 0.06 * span, high + 0.3 * span)  # room for the legends
    axes.set_xlabel(str(data["labels"][0]))
    axes.set_ylabel("traction")
    axes.spines[["top", "right"]].set_visible(False)
    axes.add_artist(axes.legend(handles=handles, frameon=False, loc="upper left"))
    _status_legend(axes, data["counts"], loc="upper right")
    figure.savefig(file)


def body_2d(data: Data, file: str) -> None:
    """The deformed plane body in the colours of its von Mises stress, on the obstacle."""
    plt = _pyplot()
    from matplotlib.collections import LineCollection, PolyCollection

    x, cells, triangles = data["x"][:, :2], data["cells"], _triangles(data["cells"])
    length, height = np.ptp(x, axis=0)
    figure, axes = plt.subplots(
        figsize=(8.0, np.clip(8.0 * height / length, 2.6, 8.0) + 1.2), layout="constrained"
    )
    figure.suptitle(str(data["title"]), fontsize=13, fontweight="bold")
    if "von_mises" in data:
        shades = axes.tripcolor(
            *x.T, triangles, data["von_mises"], shading="gouraud", cmap="Spectral_r"
        )
        bar = figure.colorbar(shades, ax=axes, shrink=0.8, aspect=30, pad=0.02)
        bar.set_label("von Mises stress")
        bar.outline.set_linewidth(0.5)
    else:
        axes.tripcolor(*x.T, triangles, np.zeros(len(x)), cmap="Greys", vmin=-1, vmax=3)
    loop = _loop(cells)
    edges = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2)
    axes.add_collection(LineCollection(x[edges], colors=INK, linewidths=0.2, alpha=0.4))
    for key, width in (("contact", 2.4), ("obstacle", 1.2)):
        for points, segments in zip(data[f"{key}_x"], data[f"{key}_cells"], strict=True):
            axes.add_collection(LineCollection(points[segments, :2], colors=INK, linewidths=width))
    for points, segments, n in zip(
        data["obstacle_x"], data["obstacle_cells"], data["obstacle_normals"], strict=True
    ):
        inside = points + 0.04 * np.hypot(length, height) * n
        quads = np.concatenate([points[segments], inside[segments[:, ::-1]]], axis=1)[..., :2]
        axes.add_collection(PolyCollection(quads, facecolors="#c9ced4", edgecolors="#c9ced4"))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("x")
    axes.set_ylabel("y")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file)


# -- pyvista -------------------------------------------------------------------------------------


def _surface(x: npt.NDArray[Any], cells: npt.NDArray[np.int64]) -> Any:
    import pyvista

    loop = _loop(cells)
    return pyvista.PolyData(x, np.insert(loop, 0, loop.shape[1], axis=1).reshape(-1))


def body_3d(data: Data, file: str) -> None:
    """The deformed body in the colours of its von Mises stress, on the obstacle."""
    import pyvista

    pyvista.OFF_SCREEN = True
    body = _surface(data["x"], data["cells"])
    centre, size = np.array(body.center), body.length
    plotter = pyvista.Plotter(off_screen=True, window_size=(1600, 1200), lighting="light kit")
    plotter.set_background("white")
    look: Data = dict(smooth_shading=True, split_sharp_edges=True, feature_angle=35)
    look |= dict(specular=0.1, ambient=0.4, diffuse=0.7)
    if len(data["cells"]) < 20000:
        look |= dict(show_edges=True, edge_color=INK, edge_opacity=0.3, line_width=1.5)
    if "von_mises" in data:
        body.point_data["von_mises"] = data["von_mises"]
        bar = dict(title="", n_labels=5, fmt="%.3g", color=INK, label_font_size=26)
        bar |= dict(position_x=0.25, position_y=0.02, width=0.5, height=0.06)
        plotter.add_mesh(body, cmap="Spectral_r", scalar_bar_args=bar, **look)
        plotter.add_text("von Mises stress", (0.437, 0.09), viewport=True, font_size=13, color=INK)
    else:
        plotter.add_mesh(body, color="#9db4c8", **look)
    for points, cells in zip(data["contact_x"], data["contact_cells"], strict=True):
        rim = _surface(points, cells).extract_feature_edges(
            boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=False
        )
        plotter.add_mesh(rim.tube(radius=0.0025 * size), color=INK, ambient=0.4)
    up = np.zeros(3)
    for points, cells, normals in zip(
        data["obstacle_x"], data["obstacle_cells"], data["obstacle_normals"], strict=True
    ):
        mean = normals.mean(axis=0)
        up -= mean
        if np.ptp(normals, axis=0).max() < 1e-9:
            patch = pyvista.Plane(points.mean(axis=0), mean, 0.95 * size, 0.95 * size)
        else:
            patch = _surface(points, cells)
        plotter.add_mesh(patch, color="#c9ced4", opacity=0.75, specular=0.0, ambient=0.25)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0.1 else np.eye(3)[2]
    along = np.eye(3)[np.argmin(np.abs(up))]
    along = (along - (along @ up) * up) / np.linalg.norm(along - (along @ up) * up)
    across = np.cross(up, along)
    eye = 0.5 * along - across + 0.33 * up
    target = centre - 0.1 * size * up
    plotter.camera_position = [target + 2.3 * size * eye, target, up]
    plotter.camera.zoom(1.42)
    plotter.enable_anti_aliasing("ssaa")
    plotter.add_text(str(data["title"]), position="upper_edge", font_size=16, color=INK)
    plotter.screenshot(file)
    plotter.close()


KINDS: dict[str, Callable[[Data, str], None]] = {
    f.__name__: f for f in (body_2d, body_3d, contact_2d, contact_3d)
}


if __name__ == "__main__":
    kind, file = sys.argv[1:]
    KINDS[kind](pickle.load(sys.stdin.buffer), file)
