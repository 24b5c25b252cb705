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

NO_PRESSURE = "#dfe4ea"
INK = "#22262b"
FLOOR = "#c9ced4"
SHADES = "Spectral_r"
NO_NUMBER = "#9a9a9a"
TINTS = ["#c3d0dc", "#e3d3b4", "#c9dcc3", "#d9cbdf"]  # of bodies, one after the other
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

    shown = [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.5, label=f"{name} ({count})")
        for (name, colour), count in zip(data["statuses"], data["counts"], strict=True)
        if count > 0
    ]
    axes.legend(handles=shown, title="status (vertices)", frameon=False, **where)


def _status_colours(data: Data) -> npt.NDArray[np.str_]:
    """The colour of the status of every vertex."""
    return np.array([colour for _, colour in data["statuses"]])[data["status"].astype(int)]


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
    labels = [_with_unit(str(label), data["units"][0]) for label in data["labels"]]
    whole = zip(x.min(axis=0), x.max(axis=0), strict=True)
    window = np.array([near or ends for near, ends in zip(data["near"], whole, strict=True)])
    extent = window[:, 1] - window[:, 0]
    if extent[1] > _LONG * extent[0]:
        x = x[:, ::-1]
        shear = shear[:, ::-1]
        extent = extent[::-1]
        window = window[::-1]
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
    # Without bonds what is below 0 is an error of the mesh, as of weak conditions.
    pressure = data["pressure"] if data["bonded"] else np.maximum(data["pressure"], 0.0)
    shades = _pressures(left, x, cells, pressure)
    bar = figure.colorbar(shades, cax=below, orientation="horizontal")
    bar.outline.set_linewidth(0.5)
    _statuses(right, x, cells, data)
    right.set_title(f"Status, and shear traction on the {data['body']}")
    inside = ((x >= window[:, 0]) & (x <= window[:, 1])).all(axis=1)
    if inside.any():
        _arrows(right, x[inside], shear[inside], stretch)
    legend.axis("off")
    _status_legend(legend, data, loc="center", ncols=4)
    bar.set_label(_with_unit("pressure", data["units"][1]))
    for axes in (left, right):
        axes.set_aspect(stretch)
        rim = (0.02 if is_long else 0.08) * extent[0]
        axes.set_xlim(window[0, 0] - rim, window[0, 1] + rim)
        axes.set_ylim(window[1, 0] - over * extent[1], window[1, 1] + over * extent[1])
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
    """Shades of the pressure on a map of the surface, blue where it is negative."""
    from matplotlib.colors import LinearSegmentedColormap

    low = min(float(pressure.min()), 0.0)
    high = max(float(pressure.max()), 0.0)
    high = high if high > 0 or low < 0 else 1.0
    shades: list[tuple[float, Any]] = [(0.0, NO_PRESSURE)]  # by the value over the largest
    hot = _pyplot().get_cmap("magma_r")(np.linspace(0.12, 0.95, 12))
    if high > 0:
        shades += zip(np.linspace(0.0, high, 13)[1:], hot, strict=True)
    if low < 0:
        # As dark as a pressure of that size is.
        darkest = 0.95 * min(1.0, -low / high) if high > 0 else 0.95
        cold = _pyplot().get_cmap("Blues")(np.linspace(min(0.12, darkest), darkest, 12))
        shades[:0] = zip(np.linspace(low, 0.0, 13)[:-1], cold[::-1], strict=True)
    axes.set_title("Normal pressure" if low == 0 else "Normal pressure, negative where it pulls")
    stops = [((value - low) / (high - low), colour) for value, colour in shades]
    return axes.tripcolor(
        *x.T,
        _triangles(cells),
        pressure,
        shading="gouraud",
        cmap=LinearSegmentedColormap.from_list("pressure", stops),
        vmin=low,
        vmax=high,
    )


def _statuses(axes: Any, x: Any, cells: Any, data: Data) -> None:
    """The part of the surface around every vertex in the colour of its status."""
    from matplotlib.collections import PolyCollection

    quads, vertex = _shares(x, cells)
    colours = _status_colours(data)[vertex]
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

    s = data["x"]
    cells = data["cells"]
    figure, axes = plt.subplots(figsize=(8.6, 5.0), layout="constrained")
    figure.suptitle(str(data["title"]), fontsize=13, fontweight="bold")
    lines = [
        ("pressure", "pressure", dict(colors="#8c2d19", linewidths=1.8)),
        ("shear", f"shear on the {data['body']}", dict(colors="#2b5d34", linewidths=1.8)),
        ("friction", "friction, a part of that", dict(colors="#6fa37a", linewidths=1.2)),
        ("bound", "friction bound ±", dict(colors="#7d858c", linewidths=1.0, linestyles="--")),
    ]
    lines = [line for line in lines if line[0] in data]
    handles = []
    for key, label, style in lines:
        for sign in (1, -1) if key == "bound" else (1,):
            value = sign * data[key]
            ends = np.stack([data["ends"], value[cells]], axis=2)
            line = LineCollection(ends, label=label, **style)
            axes.add_collection(line)
        handles.append(line)
    colours = _status_colours(data)
    for key in ("pressure", "shear"):
        look = dict(s=26 if len(s) <= 60 else 12, linewidths=_margin(len(s)))
        axes.scatter(s, data[key], c=colours, zorder=3, edgecolors=INK, **look)
    axes.axhline(0, color=INK, lw=0.6)
    shown = [data[key] for key, _, _ in lines]
    low = np.min([*shown, -data["bound"]])
    high = np.max(shown)
    span = high - low
    if span > 0:
        axes.set_ylim(low - 0.06 * span, high + 0.3 * span)  # room for the legends
    if data["near"] is not None:
        axes.set_xlim(*data["near"])
    axes.set_xlabel(_with_unit(str(data["labels"][0]), data["units"][0]))
    axes.set_ylabel(_with_unit("traction", data["units"][1]))
    axes.spines[["top", "right"]].set_visible(False)
    axes.add_artist(axes.legend(handles=handles, frameon=False, loc="upper left"))
    _status_legend(axes, data, loc="upper right")
    figure.savefig(file)


def body_2d(data: Data, file: str) -> None:
    """The deformed plane body in the colours of a field, on the obstacle."""
    _refuse_empty(data)
    if len(data["colours"]) > 1:
        _side_by_side(body_2d, data, file)
        return
    plt = _pyplot()
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import ListedColormap

    x = data["x"][:, :2]
    cells = data["cells"]
    look = data["look"]
    triangles = _triangles(data["cells"])
    length, height = np.ptp(x, axis=0)
    bands = _bands(data, 0.04 * np.hypot(length, height))
    seen = np.concatenate([x, *(band.reshape(-1, 2) for band in bands)])
    seen = data["reach"][:, :2] if "reach" in data else seen
    low, high = _window(data, seen)
    margin = 0.03 * (high - low).max()
    wide, tall = high - low + 2 * margin
    # The body fills the picture: the bar of the colours goes where there is room.
    flat = tall < 0.5 * wide
    room = 8.6 * np.array([wide, tall]) / max(wide, tall)
    size = np.maximum(room, (2.2, 0.9)) + ((0.9, 2.0) if flat else (1.9, 1.1))
    figure, axes = plt.subplots(figsize=size, layout="constrained")
    words = "\n".join(_wrapped(str(data["title"]), size[0]))
    axes.set_title(words, fontsize=13 if size[0] > 5 else 10, pad=8)
    if data["colours"]:
        ((name, values),) = data["colours"].items()
        shade: Data = dict(zip(("vmin", "vmax"), _limits(data, name), strict=False))
        shade |= dict(shading="gouraud", cmap=_shades(look))
        shades = axes.tripcolor(*x.T, triangles, values, **shade)
        where = dict(location="bottom", shrink=0.6) if flat else dict(location="right", shrink=0.8)
        bar = figure.colorbar(shades, ax=axes, aspect=30, pad=0.02, **where)
        bar.set_label(_label(name, data))
        bar.outline.set_linewidth(0.5)
    else:
        of_bodies = ListedColormap(TINTS)
        tint = data["part"][triangles[:, 0]] % len(TINTS)
        axes.tripcolor(*x.T, triangles, tint, cmap=of_bodies, vmin=-0.5, vmax=len(TINTS) - 0.5)
    loop = around(cells)
    edges = np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2)
    # Of a fine mesh lines would hide the colours.
    thin = float(np.clip(20 / np.sqrt(len(cells)), 0.05, 0.3))
    axes.add_collection(LineCollection(x[edges], colors=INK, linewidths=thin, alpha=0.4))
    for quads in bands:
        axes.add_collection(PolyCollection(quads, facecolors=FLOOR, edgecolors=FLOOR, zorder=0))
    for key, width in (("contact", 2.0), ("master", 1.2), ("obstacle", 1.2)):
        for points, segments in zip(data[f"{key}_x"], data[f"{key}_cells"], strict=True):
            axes.add_collection(LineCollection(points[segments, :2], colors=INK, linewidths=width))
    axes.set_aspect("equal")
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.locator_params(axis="y" if flat else "x", nbins=4 if min(room) < 2 else 8)
    axes.set_xlabel(_with_unit("x", data["look"]["units"][0]))
    axes.set_ylabel(_with_unit("y", data["look"]["units"][0]))
    axes.spines[["top", "right"]].set_visible(False)
    # Frames of a film have one size; else nothing is left around what is drawn.
    whole: Data = {} if "reach" in data else dict(bbox_inches="tight", pad_inches=0.12)
    figure.savefig(file, **whole)
    plt.close(figure)


def _shades(look: Data) -> Any:
    """Colours of a field, with that of what is no number."""
    shades = _pyplot().get_cmap(look["cmap"] or SHADES).copy()
    shades.set_bad(NO_NUMBER)
    return shades


def _refuse_empty(data: Data) -> None:
    """End if a box of zoom has nothing of the body; of films other frames may have some."""
    zoom = data["look"]["zoom"]
    if not isinstance(zoom, list) or "reach" in data:
        return
    x = data["x"]
    flat = data["cells"].shape[1] > 2 and np.ptp(x[:, 2]) == 0
    # In space a box within a body has no part of its surface.
    parts = x[data["cells"]] if flat else x[None]
    first, last = (np.array(corner) for corner in zoom)
    overlaps = (parts.min(axis=1) <= last) & (parts.max(axis=1) >= first)
    seen = overlaps[:, :2] if flat else overlaps
    if not seen.all(axis=1).any():
        raise SystemExit("the box of zoom has nothing of the body to be seen")


def _window(data: Data, seen: npt.NDArray[Any]) -> tuple[Any, Any]:
    """Least and largest coordinates of what a picture shows, as the zoom has it."""
    zoom = data["look"]["zoom"]
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    if isinstance(zoom, list):
        low, high = (np.array(corner)[: len(low)] for corner in zoom)
    elif zoom == "contact":
        faces = np.concatenate([*data["contact_x"], *data["master_x"]])[:, : len(low)]
        rim = 0.15 * np.ptp(faces, axis=0).max()
        low = np.maximum(low, faces.min(axis=0) - rim)
        high = np.minimum(high, faces.max(axis=0) + rim)
    else:
        middle = (low + high) / 2
        low, high = (middle + (end - middle) / zoom for end in (low, high))
    return low, high


def known_range(values: npt.NDArray[Any]) -> tuple[float, float]:
    """The least and the largest of the values that are numbers; 0 and 0 if none is."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)


def _limits(data: Data, name: str) -> tuple[float, float]:
    """Ends of the colours of a field, those of all frames of a film."""
    values = data["colours"][name]
    low, high = data.get("limits", {}).get(name) or known_range(values)
    return (low, high) if high > low else (low, low + (abs(low) or 1.0))


def _label(name: str, data: Data) -> str:
    """A field with its unit, which is known of those of this package."""
    length, stress = data["look"]["units"]
    known = {"displacement": length, "von Mises stress": stress}
    label = _with_unit(name, known.get(name, ""))
    return label if np.isfinite(data["colours"][name]).all() else f"{label} (grey: no number)"


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _wrapped(text: str, width: float) -> list[str]:
    """A title in lines that are not wider than a figure of a width in inches."""
    import textwrap

    letters = max(12, int(width * (9 if width > 5 else 11)))
    return [line for part in text.split("\n") for line in textwrap.wrap(part, letters)]


def _bands(data: Data, depth: float) -> list[npt.NDArray[Any]]:
    """Quadrilaterals of the obstacles' skin, ``depth`` thick."""
    bands = []
    for points, segments, n in zip(
        data["obstacle_x"], data["obstacle_cells"], data["obstacle_normals"], strict=True
    ):
        inside = points + depth * n
        bands.append(np.concatenate([points[segments], inside[segments[:, ::-1]]], axis=1)[..., :2])
    return bands


def _side_by_side(draw: Callable[[Data, str], None], data: Data, file: str) -> None:
    """Pictures of the same body in the colours of several fields, as one."""
    pictures = []
    for name, values in data["colours"].items():
        part = data | {"colours": {name: values}}
        if "inside" in data:
            inside = data["inside"]
            part["inside"] = inside | {"colours": {name: inside["colours"][name]}}
        draw(part, f"{file}.png")
        pictures.append(_read(f"{file}.png"))
    wide = max(p.shape[1] for p in pictures)
    tall = max(p.shape[0] for p in pictures)
    below = wide > 1.4 * tall
    joined = []
    for picture in pictures:
        missing = (wide - picture.shape[1], 0) if below else (0, tall - picture.shape[0])
        sides = [(m // 2, m - m // 2) for m in reversed(missing)]
        joined.append(np.pad(picture, [*sides, (0, 0)], constant_values=255))
    _save(np.concatenate(joined, axis=0 if below else 1), file)


def _read(file: str) -> npt.NDArray[Any]:
    """A picture as bytes (height, width, 3)."""
    from matplotlib import image

    return np.asarray(np.round(image.imread(file)[..., :3] * 255), dtype=np.uint8)


def _save(picture: npt.NDArray[Any], file: str) -> None:
    """Write a picture, also as the whole of a page of .pdf or .svg."""
    if file.endswith(".png"):
        from matplotlib import image

        image.imsave(file, np.ascontiguousarray(picture))
        return
    plt = _pyplot()
    tall, wide = picture.shape[:2]
    figure = plt.figure(figsize=(wide / 200, tall / 200))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(picture, interpolation="none")
    axes.set_axis_off()
    figure.savefig(file, dpi=200)
    plt.close(figure)


# -- pyvista -------------------------------------------------------------------------------------


def _surface(x: npt.NDArray[Any], cells: npt.NDArray[np.int64]) -> Any:
    import pyvista

    loop = around(cells)
    return pyvista.PolyData(x, np.insert(loop, 0, loop.shape[1], axis=1).reshape(-1))


def _solid(x: npt.NDArray[Any], cells: npt.NDArray[np.int64]) -> Any:
    """Tetrahedra, or hexahedra in tensor order."""
    import pyvista

    kind = 10 if cells.shape[1] == 4 else 12
    around = cells if kind == 10 else cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    every = np.insert(around, 0, around.shape[1], axis=1).reshape(-1)
    return pyvista.UnstructuredGrid(every, np.full(len(cells), kind, dtype=np.uint8), x)


def _framed(
    plotter: Any,
    x: npt.NDArray[Any],
    position: npt.NDArray[Any],
    up: npt.NDArray[Any],
    zoom: float,
) -> None:
    """Look at ``x`` from ``position`` so that it fills the picture."""
    ahead = x.mean(axis=0) - position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    above = np.cross(right, ahead)
    depth = (x - position) @ ahead
    seen = np.stack([(x - position) @ right, (x - position) @ above], axis=1) / depth[:, None]
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    wide, tall = high - low
    share = 0.96  # of the picture
    height = np.clip(1600 * tall / wide, 350, 1200)
    width = np.clip(height * wide / tall, 500, 1600)
    plotter.window_size = round(width), round(height)
    field = max(tall, wide * height / width) / share / zoom  # tangents over the picture's height
    middle = (low + high) / 2
    focus = position + ahead + middle[0] * right + middle[1] * above
    plotter.camera_position = [position, focus, above]
    plotter.camera.view_angle = 2 * np.degrees(np.arctan(field / 2))
    plotter.camera.clipping_range = 0.1 * depth.min(), 4 * depth.max()


def _eye(look: Data, extent: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Where a body is seen from, and what is drawn upwards: unit vectors."""
    up = np.array(look["up"])
    along = np.eye(3)[np.argmax(extent * (1 - np.abs(up)))]
    along = (along - (along @ up) * up) / np.linalg.norm(along - (along @ up) * up)
    across = np.cross(up, along)
    eye = 0.5 * along - across + 0.33 * up
    if look["view"] is not None:
        eye = np.array(look["view"])
    elif look["clip"] is not None:
        n = np.array(look["clip"]["normal"])
        if abs(n @ up) > 0.9:  # a section across the vertical is seen from above, or below
            eye = 1.2 * n + 0.25 * along - 0.7 * across
        else:
            side = np.cross(n, up) / np.linalg.norm(np.cross(n, up))
            eye = n + 0.35 * side + 0.33 * up
    eye = eye / np.linalg.norm(eye)
    if abs(eye @ up) > 0.99:  # then another one is up: y from above
        up = np.eye(3)[1] if abs(eye[1]) < 0.9 else np.eye(3)[0]
    return eye, up


def body_3d(data: Data, file: str) -> None:
    """The deformed body in the colours of a field, on the obstacle."""
    _refuse_empty(data)
    if len(data["colours"]) > 1:
        _side_by_side(body_3d, data, file)
        return
    import pyvista

    pyvista.OFF_SCREEN = True
    look = data["look"]
    reach = data.get("reach", data["x"])
    if look["apart"] > 0:
        reach = np.concatenate([reach, *data["obstacle_x"]])
    box = pyvista.PolyData(reach)
    centre = np.array(box.center)
    size = float(box.length)
    extent = np.ptp(reach, axis=0)
    eye, up = _eye(look, extent)
    cut = look["clip"]

    def clipped(part: Any) -> Any:
        if cut is None:
            return part
        point = centre if cut["point"] is None else np.array(cut["point"])
        return part.clip(normal=cut["normal"], origin=point)

    body = _surface(data["x"], data["cells"])
    colours = data["colours"]
    if "inside" in data:
        body = _solid(data["inside"]["x"], data["inside"]["cells"])
        colours = data["inside"]["colours"]
    for name, values in colours.items():
        body.point_data[name] = values
    body = clipped(body)
    if "inside" in data:
        body = body.extract_surface()
    plotter = pyvista.Plotter(off_screen=True, window_size=(1600, 1200), lighting="light kit")
    plotter.set_background("white")
    style: Data = dict(smooth_shading=True, split_sharp_edges=True, feature_angle=35)
    # Little shade, so that colours are those of the bar.
    style |= dict(specular=0.0, ambient=0.72, diffuse=0.32)
    if len(data["cells"]) < 20000:
        style |= dict(show_edges=True, edge_color=INK, edge_opacity=0.3, line_width=1.5)
    if body.n_points == 0:
        raise SystemExit("the section leaves nothing of the body to be seen")
    if colours:
        (name,) = colours
        if cut is not None:
            # Of what is seen: the section is not in the values of the surface.
            data = data | {"colours": {name: np.asarray(body.point_data[name])}}
        style["clim"] = _limits(data, name)
        style |= dict(cmap=look["cmap"] or SHADES, nan_color=NO_NUMBER)
        plotter.add_mesh(body, scalars=name, show_scalar_bar=False, **style)
    else:
        if "inside" not in data:
            tints = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in TINTS], np.uint8)
            whole = _surface(data["x"], data["cells"])
            whole.point_data["tint"] = tints[data["part"] % len(TINTS)]
            plotter.add_mesh(clipped(whole), scalars="tint", rgb=True, **style)
        else:
            plotter.add_mesh(body, color=TINTS[0], **style)
    for key, width in (("contact", 0.0025), ("master", 0.0012)):
        for points, cells in zip(data[f"{key}_x"], data[f"{key}_cells"], strict=True):
            rim = _surface(points, cells).extract_feature_edges(
                boundary_edges=True,
                feature_edges=False,
                manifold_edges=False,
                non_manifold_edges=False,
            )
            rim = clipped(rim)
            if rim.n_points:
                tube = rim.tube(radius=width * size / max(1.0, _factor(look)))
                plotter.add_mesh(tube, color=INK, ambient=0.4)
    floors = []
    for points, cells, normals in zip(
        data["obstacle_x"], data["obstacle_cells"], data["obstacle_normals"], strict=True
    ):
        patch = clipped(_surface(points, cells))
        floors.append(np.asarray(patch.points))
        if not patch.n_points:
            continue
        # What is seen through its obstacle is not to be hidden by it.
        through = float(normals.mean(axis=0) @ eye) > 0.05
        plotter.add_mesh(
            patch, color=FLOOR, opacity=0.18 if through else 0.75, specular=0.0, ambient=0.25
        )
        edge = patch.extract_feature_edges(feature_edges=False, non_manifold_edges=False)
        edge = edge if edge.n_points else patch
        plotter.add_mesh(edge, color="#7d858c", line_width=2.5, style="wireframe")
    zoom = look["zoom"]
    framed = reach
    if isinstance(zoom, list) or zoom == "contact":
        low, high = _window(data, reach)
        framed = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
        centre = framed.mean(axis=0)
    elif "reach" not in data:
        floors = [x for x, flat in zip(floors, data["obstacle_flat"], strict=True) if flat]
        framed = np.concatenate([np.asarray(body.points), *floors])
    position = centre + 2.7 * size * eye
    _framed(plotter, framed, position, up, _factor(look))
    plotter.enable_anti_aliasing("ssaa")
    picture = np.asarray(plotter.screenshot(None, return_img=True))[..., :3]
    plotter.close()
    _composed(picture, data, file)


def _composed(picture: npt.NDArray[Any], data: Data, file: str) -> None:
    """A picture of a body under its title and above the bar of its colours."""
    plt = _pyplot()
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    tall, wide = picture.shape[:2]
    width = wide / 180
    height = tall / 180
    bar_height = 0.75 if data["colours"] else 0.0
    lines = _wrapped(str(data["title"]), width)
    head = 0.1 + 0.24 * len(lines)
    figure = plt.figure(figsize=(width, height + head + bar_height))
    whole = height + head + bar_height
    axes = figure.add_axes((0.0, bar_height / whole, 1.0, height / whole))
    axes.imshow(picture, interpolation="none", aspect="auto")
    axes.set_axis_off()
    middle = 1 - head / 2 / whole
    words = dict(ha="center", va="center", fontsize=13 if width > 5 else 10, fontweight="bold")
    figure.text(0.5, middle, "\n".join(lines), **words)
    if data["colours"]:
        ((name, _),) = data["colours"].items()
        shades = ScalarMappable(Normalize(*_limits(data, name)), data["look"]["cmap"] or SHADES)
        share = min(0.6, 5.0 / width) if width > 4 else 0.8
        place = ((1 - share) / 2, (bar_height - 0.18) / whole, share, 0.14 / whole)
        bar = figure.colorbar(shades, cax=figure.add_axes(place), orientation="horizontal")
        bar.set_label(_label(name, data))
        bar.outline.set_linewidth(0.5)
        bar.ax.locator_params(nbins=6)
    figure.savefig(file, dpi=180)
    plt.close(figure)


def _factor(look: Data) -> float:
    """By which the picture is enlarged about its middle."""
    return look["zoom"] if isinstance(look["zoom"], float) else 1.0


def film(data: Data, file: str) -> None:
    """Pictures of one kind one after the other, as many a second as are wanted: .gif or .mp4."""
    from imageio import v2 as imageio

    frames = []
    for frame in data["frames"]:
        KINDS[data["kind"]](frame, f"{file}.png")
        picture = _read(f"{file}.png")
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
        extra = "python3 -m pip install 'signorini-coulomb[pictures]'"
        sys.exit(f"{error.name} is not installed: {extra}, or python3-{error.name} of Debian")
