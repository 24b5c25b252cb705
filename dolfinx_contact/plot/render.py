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
_LONG = 2.5  # a surface that is so many times longer than wide lies along the page
_THINNEST = 0.1  # height over width to which a surface is stretched across


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


def _status_legend(axes: Any, data: Data, **where: Any) -> None:
    """Colours of the statuses, with the number of vertices that have each."""
    from matplotlib.patches import Patch

    names = [*(name for name, _ in STATUS[:-1]), data["clamped"]]
    shown = [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.5, label=f"{name} ({count})")
        for name, (_, colour), count in zip(names, STATUS, data["counts"], strict=True)
        if count > 0
    ]
    axes.legend(handles=shown, frameon=False, **where)


def _triangles(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Triangles of triangular or (in tensor order) quadrilateral cells."""
    if cells.shape[1] == 3:
        return cells
    return np.vstack([cells[:, [0, 1, 2]], cells[:, [1, 3, 2]]])


def around(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Vertices of each cell in the order around it."""
    return cells if cells.shape[1] == 3 else cells[:, [0, 1, 3, 2]]


def _shares(x: npt.NDArray[Any], cells: npt.NDArray[np.int64]) -> tuple[Any, Any]:
    """The part of each cell nearest to each of its vertices: quadrilaterals, and their vertex."""
    loop = around(cells)
    corners = x[loop]
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    after = np.roll(corners, -1, axis=1)
    before = np.roll(corners, 1, axis=1)
    quads = np.stack([corners, (corners + after) / 2, centre, (corners + before) / 2], axis=2)
    return quads.reshape(-1, 4, x.shape[1]), loop.reshape(-1)


def _margin(count: int) -> float:
    """Width of the black rims of ``count`` marks."""
    return 0.5 if count <= 60 else 0.2


def contact_3d(data: Data, file: str) -> None:
    """Pressure, and status with the shear traction, on the flattened surface.

    Side by side, or one above the other where the surface is long: it then lies along the page, and
    is stretched across if it would be too thin to be seen.
    """
    plt = _pyplot()
    x = data["x"]
    cells = data["cells"]
    shear = data["shear"]
    labels = [str(label) for label in data["labels"]]
    extent = np.ptp(x, axis=0)
    if extent[1] > _LONG * extent[0]:
        x = x[:, ::-1]
        shear = shear[:, ::-1]
        extent = extent[::-1]
        labels = labels[::-1] if len(labels[0]) == 1 else labels  # along is where it is long
    ratio = extent[1] / extent[0]
    is_long = ratio < 1 / _LONG
    stretch = max(1.0, _THINNEST / ratio)
    if stretch > 1:
        labels[1] += f" (x{stretch:.2g})"
    width = 10.0 if is_long else 5.0
    over = 0.25 if is_long else 0.08  # room for arrows over the rim
    height = width * ratio * stretch * ((1 + 2 * over) if is_long else 1.0)
    if is_long:  # the legends lie below their panels
        size = (width + 1.2, 2 * height + 3.4)
        ratios = (height, 0.14, height, 0.14)
        figure = plt.figure(figsize=size, layout="constrained")
        grid = figure.add_gridspec(4, 1, height_ratios=ratios)
        cells_of_grid = [grid[i, 0] for i in (0, 2, 1, 3)]
    else:
        size = (2 * width + 1.2, height + 1.9)
        figure = plt.figure(figsize=size, layout="constrained")
        grid = figure.add_gridspec(2, 2, height_ratios=(height, 0.12))
        cells_of_grid = [grid[i, j] for i in (0, 1) for j in (0, 1)]
    figure.suptitle(str(data["title"]), fontsize=14, fontweight="bold")
    left, right, below, legend = (figure.add_subplot(c) for c in cells_of_grid)
    shades = _pressures(left, x, cells, data["pressure"])
    bar = figure.colorbar(shades, cax=below, orientation="horizontal")
    bar.outline.set_linewidth(0.5)
    _statuses(right, x, cells, data["status"].astype(int))
    right.set_title(f"Status, and shear traction on the {data['body']}")
    _arrows(right, x, shear, stretch)
    legend.axis("off")
    _status_legend(legend, data, loc="center", ncols=4)
    for axes in (left, right):
        axes.set_aspect(stretch)
        rim = (0.02 if is_long else 0.08) * extent[0]
        axes.set_xlim(x[:, 0].min() - rim, x[:, 0].max() + rim)
        axes.set_ylim(x[:, 1].min() - over * extent[1], x[:, 1].max() + over * extent[1])
        axes.triplot(*x.T, _triangles(cells), color=INK, lw=0.15, alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        axes.locator_params(axis="y", nbins=4 if is_long else 6)
        if is_long:
            axes.set_ylabel(labels[1].replace(" ", "\n"), fontsize=9)
    if is_long:
        left.set_xticklabels([])
        right.set_xlabel(labels[0])
    else:
        left.set_ylabel(labels[1])
        right.set_yticklabels([])
        left.set_xlabel(labels[0])
        right.set_xlabel(labels[0])
    figure.savefig(file)


def _pressures(axes: Any, x: Any, cells: Any, pressure: Any) -> Any:
    """Shades of the pressure on a map of the surface."""
    from matplotlib.colors import LinearSegmentedColormap

    hot = _pyplot().get_cmap("magma_r")(np.linspace(0.12, 0.95, 12))
    axes.set_title("Normal pressure")
    return axes.tripcolor(
        *x.T,
        _triangles(cells),
        np.maximum(pressure, 0.0),
        shading="gouraud",
        cmap=LinearSegmentedColormap.from_list("pressure", [STATUS[0][1], *hot]),
        vmin=0.0,
        vmax=max(pressure.max(), 0.0) or 1.0,
    )


def _statuses(axes: Any, x: Any, cells: Any, status: Any) -> None:
    """The part of the surface around every vertex in the colour of its status."""
    from matplotlib.collections import PolyCollection

    quads, vertex = _shares(x, cells)
    colours = np.array([colour for _, colour in STATUS])[status[vertex]]
    axes.add_collection(PolyCollection(quads, facecolors=colours, edgecolors=colours, lw=0.3))


def _arrows(
    axes: Any, x: npt.NDArray[Any], vectors: npt.NDArray[Any], stretch: float = 1.0
) -> None:
    """Arrows at the vertices, spread evenly if they are many, ``stretch`` times longer across."""
    size = np.linalg.norm(vectors, axis=1)
    if size.max() == 0:
        return
    # The largest of each square of a grid, so that the arrows do not lie on each other.
    spacing = np.ptp(x, axis=0).max() / 28
    order = np.argsort(-size, kind="stable")
    scale = np.array([1.0, stretch])
    squares = np.floor(scale * (x[order] - x.min(axis=0)) / spacing).astype(int)
    chosen = order[np.unique(squares, axis=0, return_index=True)[1]]
    chosen = chosen[size[chosen] > 0.02 * size.max()]
    longest = min(2.2 * spacing, 0.5 * np.ptp(x, axis=0).min())
    arrows = longest / size.max() * vectors[chosen]
    look: Data = dict(angles="xy", scale_units="xy", scale=1, width=0.0032, color=INK)
    drawn = axes.quiver(*x[chosen].T, *arrows.T, pivot="mid", clip_on=False, zorder=3, **look)
    drawn.set_in_layout(False)


def contact_2d(data: Data, file: str) -> None:
    """Pressure and shear with the friction bound, against the position along the surface."""
    plt = _pyplot()
    from matplotlib.collections import LineCollection

    s = data["x"][:, 0]
    cells = data["cells"]
    status = data["status"].astype(int)
    figure, axes = plt.subplots(figsize=(8.6, 5.0), layout="constrained")
    figure.suptitle(str(data["title"]), fontsize=13, fontweight="bold")
    lines = [
        ("pressure", "pressure", dict(colors="#8c2d19", linewidths=1.8)),
        ("shear", f"shear on the {data['body']}", dict(colors="#2b5d34", linewidths=1.8)),
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
        look = dict(s=26 if len(s) <= 60 else 12, linewidths=_margin(len(s)))
        axes.scatter(s, data[key], c=colours, zorder=3, edgecolors=INK, **look)
    axes.axhline(0, color=INK, lw=0.6)
    low = np.min([data["shear"], -data["bound"]])
    high = np.max([data["pressure"], data["bound"]])
    span = high - low
    if span > 0:
        axes.set_ylim(low - 0.06 * span, high + 0.3 * span)  # room for the legends
    axes.set_xlabel(str(data["labels"][0]))
    axes.set_ylabel("traction")
    axes.spines[["top", "right"]].set_visible(False)
    axes.add_artist(axes.legend(handles=handles, frameon=False, loc="upper left"))
    _status_legend(axes, data, loc="upper right")
    figure.savefig(file)


def body_2d(data: Data, file: str) -> None:
    """The deformed plane body in the colours of its von Mises stress, on the obstacle."""
    plt = _pyplot()
    from matplotlib.collections import LineCollection, PolyCollection

    x = data["x"][:, :2]
    cells = data["cells"]
    triangles = _triangles(data["cells"])
    length, height = np.ptp(x, axis=0)
    bands = _bands(data, 0.04 * np.hypot(length, height))
    seen = np.concatenate([x, *(band.reshape(-1, 2) for band in bands)])
    seen = data["reach"][:, :2] if "reach" in data else seen
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    margin = 0.03 * (high - low).max()
    wide, tall = high - low + 2 * margin
    # The body fills the picture: the bar of the colours goes where there is room.
    flat = tall < 0.5 * wide
    room = 8.6 * np.array([wide, tall]) / max(wide, tall)
    size = np.maximum(room, (2.2, 0.9)) + ((0.9, 2.0) if flat else (1.9, 1.1))
    figure, axes = plt.subplots(figsize=size, layout="constrained")
    figure.suptitle(str(data["title"]), fontsize=13 if size[0] > 5 else 10, fontweight="bold")
    if "von_mises" in data:
        look = dict(zip(("vmin", "vmax"), data.get("colours", ()), strict=False))
        look |= dict(shading="gouraud", cmap="Spectral_r")
        shades = axes.tripcolor(*x.T, triangles, data["von_mises"], **look)
        where = dict(location="bottom", shrink=0.6) if flat else dict(location="right", shrink=0.8)
        bar = figure.colorbar(shades, ax=axes, aspect=30, pad=0.02, **where)
        bar.set_label("von Mises stress")
        bar.outline.set_linewidth(0.5)
    else:
        axes.tripcolor(*x.T, triangles, np.zeros(len(x)), cmap="Greys", vmin=-1, vmax=3)
    loop = around(cells)
    edges = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2)
    axes.add_collection(LineCollection(x[edges], colors=INK, linewidths=0.2, alpha=0.4))
    for key, width in (("contact", 2.4), ("master", 1.2), ("obstacle", 1.2)):
        for points, segments in zip(data[f"{key}_x"], data[f"{key}_cells"], strict=True):
            axes.add_collection(LineCollection(points[segments, :2], colors=INK, linewidths=width))
    for quads in bands:
        axes.add_collection(PolyCollection(quads, facecolors="#c9ced4", edgecolors="#c9ced4"))
    axes.set_aspect("equal")
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.locator_params(axis="y" if flat else "x", nbins=4 if min(room) < 2 else 8)
    axes.set_xlabel("x")
    axes.set_ylabel("y")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file)


def _bands(data: Data, depth: float) -> list[npt.NDArray[Any]]:
    """Quadrilaterals of the obstacles' skin, ``depth`` thick."""
    bands = []
    for points, segments, n in zip(
        data["obstacle_x"], data["obstacle_cells"], data["obstacle_normals"], strict=True
    ):
        inside = points + depth * n
        bands.append(np.concatenate([points[segments], inside[segments[:, ::-1]]], axis=1)[..., :2])
    return bands


# -- pyvista -------------------------------------------------------------------------------------


def _surface(x: npt.NDArray[Any], cells: npt.NDArray[np.int64]) -> Any:
    import pyvista

    loop = around(cells)
    return pyvista.PolyData(x, np.insert(loop, 0, loop.shape[1], axis=1).reshape(-1))


def _floor(points: npt.NDArray[Any], normal: npt.NDArray[Any], size: float) -> Any:
    """A rectangle in the plane across ``normal``, somewhat larger than ``points`` on it."""
    import pyvista

    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2][:2]
    axes -= np.outer(axes @ normal, normal) / (normal @ normal)
    low = (centred @ axes.T).min(axis=0)
    high = (centred @ axes.T).max(axis=0)
    rim = max(0.3 * float((high - low).min()), 0.05 * size)
    a, b = low - rim
    c, d = high + rim
    corners = np.array([[a, b], [c, b], [c, d], [a, d]]) @ axes + points.mean(axis=0)
    return pyvista.PolyData(corners, [4, 0, 1, 2, 3])


def _frame(
    plotter: Any, x: npt.NDArray[Any], position: npt.NDArray[Any], up: npt.NDArray[Any]
) -> None:
    """Look at ``x`` from ``position`` so that it fills the picture between title and colour bar."""
    ahead = x.mean(axis=0) - position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    above = np.cross(right, ahead)
    depth = (x - position) @ ahead
    seen = np.stack([(x - position) @ right, (x - position) @ above], axis=1) / depth[:, None]
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    wide, tall = high - low
    # Of the picture the body takes 88 % of the width or 68 % of the height, whatever is reached.
    height = np.clip(1600 * 0.88 * tall / wide / 0.68, 700, 1300)
    width = np.clip(height * 0.68 * wide / tall / 0.88, 900, 1600)
    plotter.window_size = round(width), round(height)
    field = max(tall / 0.68, wide / 0.88 * height / width)  # tangents over the picture's height
    middle = (low + high) / 2 - (0.0, 0.05 * field)
    focus = position + ahead + middle[0] * right + middle[1] * above
    plotter.camera_position = [position, focus, above]
    plotter.camera.view_angle = 2 * np.degrees(np.arctan(field / 2))
    plotter.camera.clipping_range = 0.2 * depth.min(), 3 * depth.max()


def body_3d(data: Data, file: str) -> None:
    """The deformed body in the colours of its von Mises stress, on the obstacle."""
    import pyvista

    pyvista.OFF_SCREEN = True
    body = _surface(data["x"], data["cells"])
    reach = data.get("reach", data["x"])
    box = pyvista.PolyData(reach)
    centre = np.array(box.center)
    size = box.length
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
        look["clim"] = data.get("colours")
        plotter.add_mesh(body, cmap="Spectral_r", scalar_bar_args=bar, **look)
        plotter.add_text("von Mises stress", (0.437, 0.09), viewport=True, font_size=13, color=INK)
    else:
        plotter.add_mesh(body, color="#9db4c8", **look)
    for key, width in (("contact", 0.0025), ("master", 0.0012)):
        for points, cells in zip(data[f"{key}_x"], data[f"{key}_cells"], strict=True):
            rim = _surface(points, cells).extract_feature_edges(
                boundary_edges=True,
                feature_edges=False,
                manifold_edges=False,
                non_manifold_edges=False,
            )
            plotter.add_mesh(rim.tube(radius=width * size), color=INK, ambient=0.4)
    up = np.zeros(3)
    for points, cells, normals in zip(
        data["obstacle_x"], data["obstacle_cells"], data["obstacle_normals"], strict=True
    ):
        mean = normals.mean(axis=0)
        up -= mean
        is_flat = np.ptp(normals, axis=0).max() < 1e-9
        patch = _floor(points, mean, size) if is_flat else _surface(points, cells)
        plotter.add_mesh(patch, color="#c9ced4", opacity=0.75, specular=0.0, ambient=0.25)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0.1 else np.eye(3)[2]
    extent = np.ptp(reach, axis=0)
    along = np.eye(3)[np.argmax(extent * (1 - np.abs(up)))]
    along = (along - (along @ up) * up) / np.linalg.norm(along - (along @ up) * up)
    across = np.cross(up, along)
    eye = 0.5 * along - across + 0.33 * up
    _frame(plotter, reach, centre + 2.3 * size * eye, up)
    plotter.enable_anti_aliasing("ssaa")
    plotter.add_text(str(data["title"]), position="upper_edge", font_size=16, color=INK)
    plotter.screenshot(file)
    plotter.close()


def film(data: Data, file: str) -> None:
    """Pictures of one kind one after the other, as many a second as are wanted: .gif or .mp4."""
    from imageio import v2 as imageio

    frames = []
    for frame in data["frames"]:
        KINDS[data["kind"]](frame, f"{file}.png")
        picture = np.asarray(imageio.imread(f"{file}.png"))[..., :3]
        tall, wide = (2 * (n // 2) for n in picture.shape[:2])
        quarters = picture[:tall, :wide].reshape(tall // 2, 2, wide // 2, 2, 3)
        frames.append(quarters.mean(axis=(1, 3)).round().astype(np.uint8))
    gif = dict(duration=1000 / data["rate"], loop=0)
    imageio.mimwrite(file, frames, **(gif if file.endswith(".gif") else dict(fps=data["rate"])))


KINDS: dict[str, Callable[[Data, str], None]] = {
    f.__name__: f for f in (body_2d, body_3d, contact_2d, contact_3d, film)
}


if __name__ == "__main__":
    kind, file = sys.argv[1:]
    try:
        KINDS[kind](pickle.load(sys.stdin.buffer), file)
    except ModuleNotFoundError as error:
        extra = "python3 -m pip install 'signorini-coulomb[output]'"
        sys.exit(f"{error.name} is not installed: {extra}, or python3-{error.name} of Debian")
