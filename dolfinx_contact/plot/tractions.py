# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a contact surface: pressure, shear and status.

A surface in 3D is projected along its mean normal where it touches. A curve in 2D is drawn over a
coordinate if it is straight, otherwise over its arc length.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, depth_first_order

from dolfinx_contact._geometry import area_vectors, unit
from dolfinx_contact._mpi import Arguments, collective, same_everywhere
from dolfinx_contact.io.outside import gather_cells
from dolfinx_contact.laws.status import COLOURS, NAMES
from dolfinx_contact.plot.figures import INK, drawn_on_root, new_figure, save
from dolfinx_contact.plot.in_2d import around, shade
from dolfinx_contact.points.trace import vertex_numbers
from dolfinx_contact.results.fields import STATUS_CODES, contact_fields, vertex_state
from dolfinx_contact.results.outer_surface import Arrays

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dolfinx_contact.equations.state import State
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["picture_of_contact"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]
Marks = npt.NDArray[np.bool_]

#: Statuses in addition to `STATUS_CODES`: slip in 2D with u_t < 0, and slip without a sense.
_BACKWARD, _NO_SENSE = 4, 5
_ZERO_FORCE = 1e-10  # relative to stiffness times displacement
_LITTLE = 1e-6  # relative to the largest traction
_TITLE_PAD = 0.12  # inches between the title and the panels
_STRAIGHT = 0.05  # height over length up to which a curve is drawn over a coordinate
_SEEN = 0.1  # cosine of the angle between the view and the normal of a visible facet
_ALONG = 0.998  # component of a mean normal along a coordinate axis from which on it is this axis


def _check(a: Arguments) -> None:
    a.file = None if a.file is None else Path(a.file)
    if a.surface is not None and not any(a.surface is s for s in a.problem.surfaces):
        name = getattr(a.surface, "name", a.surface)
        raise ValueError(f"the surface {name!r} is not one of the problem")


@collective("a picture", _check)
def picture_of_contact(
    file: str | os.PathLike[str] | None,
    problem: ContactProblem,
    *,
    surface: DiscreteSurface | None = None,
    state: State | None = None,
    title: str | None = None,
) -> Figure | None:
    """Draw pressure, shear and status of a contact surface. Collective.

    In 3D there are two maps of the surface, projected along its mean normal where it touches. In 2D
    the tractions and the friction bound are drawn over the coordinate of a straight surface, and
    over the length along a curved one; for a law with bonds also the frictional part of the shear,
    to which the bound applies. If a small part of the surface touches
    or carries a traction, the picture is limited to its surroundings. Statuses and values are those
    of the vertices (`ContactProblem.contact_fields`).

    Args:
        file: ``.png``, ``.pdf`` or ``.svg``; None writes nothing.
        problem: contact problem, usually solved.
        surface: contact surface of the problem, default the first.
        state: state to draw, default the current Functions.
        title: title of the picture; default: the name of the surface.

    Returns:
        The figure on rank 0, None on other ranks.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        ValueError: on every rank, if the surface is not one of the problem, or arguments differ
            between ranks.
    """
    s = problem.surfaces[0] if surface is None else surface
    same_everywhere(problem.comm, surface=s.name)
    with problem.at(state) as shown:
        values = _values(shown, s)
    owned = s.submesh.mesh.topology.index_map(s.dim - 1).size_local
    V = s.points.vertices
    cells = V.dofmap.list[:owned]
    data = gather_cells(s.comm, V, cells, values, vertex_numbers(V))

    def draw() -> Figure:
        draw_surface = _draw_curve if s.dim == 2 else _draw_map
        figure = draw_surface(data, s)
        name = "Contact surface" if s.name == "contact" else f"Contact surface: {s.name}"
        figure.suptitle(title or name, fontweight="bold")
        figure.get_layout_engine().set(h_pad=_TITLE_PAD)
        save(figure, file)
        return figure

    return drawn_on_root(s.comm, draw)


def _values(problem: ContactProblem, s: DiscreteSurface) -> Arrays:
    """Values at the local vertices of a surface. Collective."""
    number = problem.surfaces.index(s)
    evaluation = problem.evaluate()
    fields = contact_fields(problem.equations, number, evaluation)
    at_vertices = vertex_state(problem.equations, number, evaluation)
    pressure = fields["pressure"].x.array
    status = fields["status"].x.array
    traction = fields["traction"].x.array.reshape(-1, s.dim)
    normal = at_vertices["n"]
    if s.dim == 2:
        # the two senses of slip have their own colours, and so has slip without a sense
        slips = status == STATUS_CODES["-"]
        plus, minus = at_vertices["plus"], at_vertices["minus"]
        status = np.where(slips & (minus > plus), _BACKWARD, status)
        status = np.where(slips & (plus == 0) & (minus == 0), _NO_SENSE, status)
    # supports are not contact, and tractions of the size of the round-off of forces are none
    u = s.comm.allreduce(float(np.max(np.abs(s.u.x.array), initial=0.0)), op=max)
    force = np.linalg.norm(traction, axis=1) * s.points.geometry.vertex_areas
    carries = force > _ZERO_FORCE * problem.equations.stiffness_scale * u
    carries &= status != STATUS_CODES["d"]
    values = {
        "pressure": np.where(carries, pressure, 0.0),
        "status": status,
        "shear": np.where(carries[:, None], traction + pressure[:, None] * normal, 0.0),
        "bound": at_vertices["bound"],
        "n": s.points.vertex_normals,
    }
    if s.law_at_points.compiled.bonded:
        adhesive = evaluation.surfaces[number].answers.bond("traction")
        bond = np.stack([s.points.at_vertices(t) for t in adhesive.T], axis=1)
        bond -= np.sum(bond * normal, axis=1)[:, None] * normal
        values["friction"] = values["shear"] - np.where(carries[:, None], bond, 0.0)
    return values


def _touching(data: Arrays) -> Marks:
    """Vertices that stick or slip, or carry a traction."""
    closed = np.isin(data["status"], [STATUS_CODES["k"], STATUS_CODES["s"], _BACKWARD, _NO_SENSE])
    size = np.hypot(data["pressure"], np.linalg.norm(data["shear"], axis=1))
    return np.asarray(closed | (size > _LITTLE * size.max(initial=0.0)))


def _near_contact(x: Array, touching: Marks, rim: float) -> tuple[float, float]:
    """Limits of an axis: the surroundings of the touching part, or everything if that is most.

    Args:
        x: positions (m,).
        touching: True for touching vertices (m,).
        rim: width of the rim around everything, relative to its length.
    """
    low, high = float(x.min()), float(x.max())
    limits = low - rim * (high - low), high + rim * (high - low)
    if touching.any():
        first, last = float(x[touching].min()), float(x[touching].max())
        rim = max(0.25 * (last - first), 2.0 * rim * (high - low))
        if last - first + 2 * rim < 0.7 * (high - low):
            limits = max(first - rim, limits[0]), min(last + rim, limits[1])
    return limits


def _statuses(data: Arrays, s: DiscreteSurface) -> tuple[Array, list[Any]]:
    """Colours of the statuses of the vertices, and handles for the legend with their numbers."""
    from matplotlib.patches import Patch

    names = NAMES | {"d": "without contact" if s.between_bodies else "clamped"}
    letters = "ok+d-" if s.dim == 2 else "oksd"
    statuses = [(names[k], COLOURS[k]) for k in letters] + [("slip", "#999933")]
    codes = data["status"].astype(int)
    handles = [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.5, label=f"{name} ({count})")
        for (name, colour), count in zip(statuses, np.bincount(codes, minlength=6), strict=False)
        if count > 0
    ]
    return np.array([colour for _, colour in statuses])[codes], handles


# -- curves in 2D --------------------------------------------------------------------------------


def _draw_curve(data: Arrays, s: DiscreteSurface) -> Figure:
    """Draw the tractions over the position along a curve."""
    touching = _touching(data)
    at, path, label, tangents = _positions(data, touching)
    axes = new_figure((8.6, 5.0)).add_subplot()
    lines = {"pressure": (data["pressure"], "-", "#8c2d19")}
    for name, colour in (("shear", "#2b5d34"), ("friction", "#6fa37a")):
        if name in data:
            lines[name] = np.sum(data[name] * tangents, axis=1), "-", colour
    lines["friction bound ±"] = data["bound"], "--", "#7d858c"
    lines["_"] = -data["bound"], "--", "#7d858c"
    body = "slave" if s.between_bodies else "body"
    words = {"shear": f"shear on the {body}", "friction": "friction, a part of the shear"}
    for name, (values, style, colour) in lines.items():
        line = (np.append(v, np.nan)[path] for v in (at, values))
        axes.plot(
            *line,
            style,
            color=colour,
            lw=1.0 if "--" in style else 1.8,
            label=words.get(name, name),
        )
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.25 * (high - low))  # room for the legends
    axes.set_xlim(*_near_contact(at, touching, 1.0 / len(at)))
    colours, handles = _statuses(data, s)
    place = dict(title="status (vertices)", loc="upper right", frameon=False)
    axes.add_artist(axes.legend(handles=handles, **place))
    for values, *_ in (lines["pressure"], lines["shear"]):
        look = dict(s=12 if len(at) > 60 else 26, linewidths=0.4, edgecolors=INK, zorder=3)
        axes.scatter(at, values, c=colours, **look)
    axes.axhline(0, color=INK, lw=0.6)
    axes.set(xlabel=label, ylabel="traction")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper left")
    return axes.figure


def _positions(data: Arrays, touching: Marks) -> tuple[Array, Cells, str, Array]:
    """Positions along the curves of a face in 2D, which grow along t = (-n_y, n_x).

    Returns:
        Positions of the vertices (m,), the vertices in the order along the curves, each of which
        ends with -1, the label, and the tangents (m, 2).
    """
    x, cells = data["x"][:, :2], data["cells"]
    tangents = np.stack([-data["n"][:, 1], data["n"][:, 0]], axis=1)
    graph = coo_array((np.ones(len(cells)), tuple(cells.T)), shape=(len(x), len(x))).tocsr()
    degrees = np.bincount(cells.ravel(), minlength=len(x))
    parts = connected_components(graph, directed=False)[1]
    at = np.zeros(len(x))
    curves = []
    begin = 0.0
    for part in np.unique(parts):
        # from an end; a closed curve is cut opposite to the middle of the touching part
        nodes = np.flatnonzero(parts == part)
        is_closed = bool((degrees[nodes] == 2).all())
        start = nodes[np.argmin(degrees[nodes])]
        order = depth_first_order(graph, start, directed=False)[0]
        if is_closed and touching[order].any():
            turns = np.exp(2j * np.pi * np.arange(len(order)) / len(order))
            middle = np.angle(np.mean(turns[touching[order]])) / (2 * np.pi) * len(order)
            order = np.roll(order, len(order) // 2 - round(middle))
        steps = np.diff(x[order], axis=0)
        if np.sum(steps * tangents[order[:-1]]) < 0:
            order, steps = order[::-1], -steps[::-1]
        lengths = np.cumsum(np.append(0.0, np.linalg.norm(steps, axis=1)))
        at[order] = begin + lengths
        begin += 1.05 * float(lengths[-1])
        curves.append(np.append(order, -1))
    path = np.concatenate(curves)
    # a straight face has its coordinate
    axis = int(np.argmax(np.ptp(x, axis=0)))
    if np.ptp(x[:, 1 - axis]) < _STRAIGHT * np.ptp(x[:, axis]):
        return x[:, axis], path, "xy"[axis], np.tile(np.eye(2)[axis], (len(x), 1))
    first = ", ".join(f"{c:.4g}" for c in x[curves[0][0]])
    return at, path, f"length along the surface, from ({first})", tangents


# -- maps in 3D ----------------------------------------------------------------------------------


def _draw_map(data: Arrays, s: DiscreteSurface) -> Figure:
    """Draw pressure, and status with the shear traction, on the projected surface."""
    figure = new_figure((1.0, 1.0))
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import CenteredNorm, LinearSegmentedColormap, Normalize

    x, cells, across, labels = _projected(data)
    touching = _touching(data)
    low, high = np.transpose([_near_contact(x[:, k], touching, 0.05) for k in range(2)])
    wide, tall = high - low
    is_long = bool(tall < 0.3 * wide)  # then it is stretched, in panels above each other
    figure.set_size_inches(
        (11.0, 22 * tall / wide + 3) if is_long else (11.2, 5 * tall / wide + 2.2)
    )
    left, right = figure.subplots(*((2, 1) if is_long else (1, 2)), sharex=True, sharey=True)
    # pressure; without bonds negative values are discretisation errors
    pressure = data["pressure"]
    if not s.law_at_points.compiled.bonded:
        pressure = np.maximum(pressure, 0.0)
    pulls = bool(pressure.min() < 0)
    norm = CenteredNorm() if pulls else Normalize(0.0, float(pressure.max()) or 1.0)
    stops = [COLOURS["o"], *colormaps["magma_r"](np.linspace(0.12, 0.95, 12))]
    shades = "RdBu_r" if pulls else LinearSegmentedColormap.from_list("pressure", stops)
    shades = shade(left, x, cells, pressure, width=0.15, alpha=0.25, norm=norm, cmap=shades)
    left.set_title(
        "Normal pressure, negative where it pulls" if pulls else "Normal pressure", loc="left"
    )
    bar = figure.colorbar(shades, ax=left, location="bottom", aspect=60 if is_long else 30)
    bar.set_label("pressure")
    # status: each vertex colours the adjacent part of the facets
    loop = around(cells)
    corners = x[loop]
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    sides = [(corners + np.roll(corners, k, axis=1)) / 2 for k in (-1, 1)]
    thin = dict(lw=0.15, alpha=0.25)
    quads = np.stack([corners, sides[0], centre, sides[1]], axis=2).reshape(-1, 4, 2)
    colours, handles = _statuses(data, s)
    place = dict(title="status (vertices)", loc="outside lower center", ncols=4, frameon=False)
    figure.legend(handles=handles, **place)
    colours = colours[loop.reshape(-1)]
    right.add_collection(PolyCollection(quads, facecolors=colours, edgecolors=colours, lw=0.3))
    right.add_collection(PolyCollection(corners, facecolors="none", edgecolors=INK, **thin))
    right.set_title(
        f"Status, and shear on the {'slave' if s.between_bodies else 'body'}", loc="left"
    )
    spacing = np.array([wide / 28, tall / 6 if is_long else wide / 28])
    _draw_arrows(right, x, data["shear"] @ across, spacing)
    for axes in (left, right):
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set(xlabel=labels[0], ylabel=labels[1] + " (stretched)" * is_long)
        axes.set_aspect("auto" if is_long else "equal")
        axes.label_outer()
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _projected(data: Arrays) -> tuple[Array, Cells, Array, list[str]]:
    """Project a surface along its mean normal where it touches.

    Facets that are turned away, as behind a closed surface, are left out.

    Returns:
        Positions (m, 2), facets, and the axes of the picture (3, 2) with their labels.
    """
    x, cells = data["x"], data["cells"]
    normals = unit(area_vectors(x[cells[:, :3]]))
    normals *= np.sign(np.sum(normals * data["n"][cells].mean(axis=1), axis=1, keepdims=True))
    touches = _touching(data)[cells].any(axis=1)
    n = unit(normals[touches if touches.any() else slice(None)].mean(axis=0))
    # coordinate axes if the normal is close to one, the longer axis first
    axes = np.delete(np.eye(3), np.argmax(np.abs(n)), axis=0).T
    labels = ["xyz"[k] for k in np.argmax(axes, axis=0)]
    if np.max(np.abs(n)) < _ALONG:
        first = unit(axes[:, 0] - (axes[:, 0] @ n) * n)
        axes = np.stack([first, np.cross(n, first)], axis=1)
        labels = ["along the surface", "across"]
    if np.ptp(x @ axes[:, 1]) > 2.5 * np.ptp(x @ axes[:, 0]):
        axes, labels = axes[:, ::-1], labels[::-1]
    visible = normals @ n > _SEEN
    return x @ axes, cells[visible] if visible.any() else cells, axes, labels


def _draw_arrows(axes: Axes, x: Array, vectors: Array, spacing: Array) -> None:
    """Draw arrows at the vertices, one in each square of a grid, with a reference arrow."""
    size = np.linalg.norm(vectors, axis=1)
    if not size.any():
        return
    order = np.argsort(-size, kind="stable")
    squares = np.floor((x[order] - x.min(axis=0)) / spacing).astype(int)
    chosen = order[np.unique(squares, axis=0, return_index=True)[1]]
    chosen = chosen[size[chosen] > 0.02 * size.max()]
    look: dict[str, Any] = dict(angles="xy", scale_units="x", pivot="mid", width=0.0032, color=INK)
    look |= dict(scale=size.max() / (2 * spacing[0]), clip_on=False, zorder=3)
    arrows = axes.quiver(*x[chosen].T, *vectors[chosen].T, **look)
    arrows.set_in_layout(False)  # matplotlib overestimates the extent of arrows
    where: dict[str, Any] = dict(labelpos="W", coordinates="axes")
    axes.quiverkey(arrows, 0.9, 1.02, size.max(), f"{size.max():.3g}", **where)
