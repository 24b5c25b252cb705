# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a contact surface: pressure, shear and status.

A surface in 3D is projected along a coordinate axis. A curve in 2D is drawn over a coordinate if
it is straight or if the user names the coordinate, otherwise over its arc length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, as_text
from dolfinx_contact._geometry import (
    along_tangent,
    area_vectors,
    curves,
    plane_tangents,
    tangential,
    unit,
)
from dolfinx_contact._mpi import Arguments, collective, maximum, same_everywhere
from dolfinx_contact._validate import one_of
from dolfinx_contact.io.outside import gather_facets
from dolfinx_contact.laws.status import COLOURS, NAMES
from dolfinx_contact.plot.figures import (
    INK,
    File,
    add_status_legend,
    are_distinct,
    around,
    draw_edges,
    drawn_on_root,
    legend_columns,
    new_figure,
    shade,
    title_of,
    with_unit,
    words_of,
)
from dolfinx_contact.plot.scene import check_units
from dolfinx_contact.results.outer_surface import Arrays, Cells
from dolfinx_contact.results.surface_fields import vertex_state

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dolfinx_contact.equations.state import State
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["check_surface", "contact_data", "draw_contact", "picture_of_contact"]

_ZERO_FORCE = 1e-10  # force that counts as zero, relative to stiffness times displacement
_LITTLE = 1e-6  # traction that counts as zero, relative to the largest one
_TITLE_PAD = 0.12  # inches between the title and the panels
_STRAIGHT = 1e-6  # height over length up to which a curve is drawn over its coordinate
_PANEL = 800.0  # approximate number of pixels along the longer side of a map
_FLAT = 0.3  # smallest height over width of a map; a longer surface is stretched
_ARROWS = 28  # number of arrows along the width of half a figure
_SEEN = 0.1  # cosine of the angle between the view and the normal of a visible facet


def check_surface(a: Arguments) -> None:
    """Raise ``ValueError`` if the surface, ``over`` or ``units`` are invalid for the problem."""
    check_units(a.units)
    if a.surface is not None and not any(a.surface is s for s in a.problem.surfaces):
        name = getattr(a.surface, "name", a.surface)
        raise ValueError(f"the surface {name!r} is not one of the problem")
    if a.over is not None:
        one_of(a.over, "over", ("x", "y"))
        if a.problem.V.mesh.geometry.dim == 3:
            raise ValueError("over is for contact surfaces in 2D")


@collective("a picture", check_surface)
def picture_of_contact(
    file: File,
    problem: ContactProblem,
    *,
    surface: DiscreteSurface | None = None,
    state: State | None = None,
    over: Literal["x", "y"] | None = None,
    title: str | None = None,
    units: Mapping[str, str] | None = None,
    size: tuple[float, float] | None = None,
) -> Figure | None:
    """Draw pressure, shear and status of a contact surface. Collective.

    In 3D there are two maps of the surface, projected along the coordinate axis that is closest to
    the mean normal of the part in contact. In 2D the tractions and the friction bound are drawn
    over the coordinate of a straight surface, and over the arc length of a curved one. For a law
    with bonds, the frictional part of the shear, to which the bound applies, is drawn as well. As
    in `ContactTable.along`, the shear in 2D is positive along t = (-n_y, n_x) with the normal n, to
    -x below an obstacle.

    The picture is limited to the part of the surface that is in contact or carries a traction, with
    a margin. Statuses and values are those of the vertices (`ContactProblem.contact_fields`); the
    legend counts the vertices in the picture.

    Args:
        file: ``.png``, ``.pdf`` or ``.svg``; None writes nothing.
        problem: contact problem, usually solved.
        surface: contact surface of the problem, default its first surface.
        state: state to draw, default the current Functions.
        over: coordinate of the horizontal axis, in 2D; default: the coordinate along a straight
            surface, otherwise the arc length.
        title: title of the picture; default: the name of the surface, with the time or load of the
            state.
        units: units of "length" and "stress" in the labels, such as ``{"length": "mm", "stress":
            "MPa"}``; default: none.
        size: width and height in inches; default: (8.6, 5) in 2D, in 3D from the surface's shape.

    Returns:
        The figure on rank 0, None on other ranks.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        ValueError: on every rank, if the surface is not one of the problem, ``over`` is not a
            coordinate of a plane problem, or arguments differ between ranks.
    """
    s = problem.surfaces[0] if surface is None else surface
    same_everywhere(problem.comm, surface=s.name)
    with problem.at(state) as shown:
        data = contact_data(shown, s)
    if title is None:
        name = "Contact surface" if s.name == "contact" else f"Contact surface: {s.name}"
        title = title_of(name, words_of(state))
    draw = partial(draw_contact, data, [data], s, title, over, units or {}, size)
    return drawn_on_root(s.comm, file, draw)


def draw_contact(
    data: Arrays,
    frames: Sequence[Arrays],
    s: DiscreteSurface,
    title: str,
    over: str | None,
    units: Mapping[str, str],
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw pressure, shear and status of a contact surface. Not collective.

    Args:
        data: data of the state to draw, see `contact_data`.
        frames: data of states that share axes and colours, for example in a film.
        s: contact surface to draw.
        title: title of the picture.
        over: see `picture_of_contact`.
        units: see `picture_of_contact`.
        size: see `picture_of_contact`.
    """
    x, cells, labels = _along_curve(data, over) if s.dim == 2 else _projected(data)
    box = np.transpose([_limits(column, data) for column in x.T])
    frame = _Frame(s, x, cells, box, labels, data, frames, units)
    figure = _draw_curve(frame, size) if s.dim == 2 else _draw_map(frame, size)
    visible = np.isin(np.arange(len(x)), cells) & np.all((box[0] <= x) & (x <= box[1]), axis=1)
    names = NAMES | {"d": "without contact" if s.between_bodies else "clamped"}
    letters = ["".join(d["letters"][visible]) for d in (data, *frames)]
    counted = {k: f"{name} ({letters[0].count(k)})" for k, name in names.items()}
    add_status_legend(figure, "".join(letters), counted, "status (vertices)")
    if s.dim == 2:
        # above the axes, where it covers no line in any frame
        look: dict[str, Any] = dict(title_fontproperties={"weight": "bold"}, alignment="left")
        look |= dict(loc="outside upper left", ncols=legend_columns(figure, 4), frameon=False)
        figure.legend(title=title or None, **look)
    else:
        figure.suptitle(title, fontweight="bold")
    figure.get_layout_engine().set(h_pad=_TITLE_PAD)
    return figure


def contact_data(problem: ContactProblem, s: DiscreteSurface) -> Arrays:
    """Gather facets, tractions and statuses of the vertices of a surface on rank 0. Collective.

    Returns:
        The arrays of `gather_facets`, with ``pressure``, ``shear`` (in 2D along (-n_y, n_x) for the
        normal n), the friction bound ``bound``, the status letters ``letters``, the normals ``n``
        of the undeformed body, and the mask ``touching`` of vertices that stick, slip or carry a
        traction; for a law with bonds also the frictional part ``friction`` of the shear. An empty
        dictionary on other ranks.
    """
    number = problem.surfaces.index(s)
    evaluation = problem.evaluate()
    at_vertices = vertex_state(problem.equations, number, evaluation)
    normal, shear = at_vertices["n"], at_vertices["shear"]
    letters = np.array(list("oksd"))[at_vertices["status"].astype(int)]
    if s.dim == 2:
        senses = np.where(at_vertices["minus"] > at_vertices["slip"] / 2, "-", "+")
        letters = np.where(letters == "s", senses, letters)
    # supports are not contact, and tractions within the round-off of forces count as zero
    u = maximum(s.comm, np.abs(s.u.x.array))
    forces = np.linalg.norm(at_vertices["traction"], axis=1) * s.points.geometry.vertex_areas
    carries = forces > _ZERO_FORCE * problem.equations.scaling.stiffness * u
    carries &= letters != "d"
    shears = {"shear": shear}
    if s.law_at_points.compiled.bonded:
        adhesive = evaluation.surfaces[number].answers.bond("traction")
        bond = np.stack([s.points.at_vertices(t) for t in adhesive.T], axis=1)
        shears["friction"] = shear - tangential(bond, normal)
    if s.dim == 2:
        shears = {name: along_tangent(v, normal) for name, v in shears.items()}
    tractions = {"pressure": at_vertices["pressure"], **shears}
    values = {"bound": at_vertices["bound"], "letters": letters, "n": s.points.vertex_normals}
    values |= {name: np.where(carries, v.T, 0.0).T for name, v in tractions.items()}
    data = gather_facets(s, values)
    if data:
        size = np.linalg.norm(np.column_stack([data["pressure"], data["shear"]]), axis=1)
        data["touching"] = ~np.isin(data["letters"], ["o", "d"]) | (size > _LITTLE * size.max())
    return data


@dataclass(frozen=True)
class _Frame:
    """Contact surface in the coordinates of a picture, with the data to draw.

    Attributes:
        surface: drawn contact surface.
        x: positions of the m vertices, shape (m, 1) along a curve and (m, 2) on a map.
        cells: vertices of the facets that are drawn.
        box: lower and upper limits of the axes, shape (2, 1) or (2, 2).
        labels: names of the coordinates along the axes.
        data: data of the state to draw, see `contact_data`.
        every: data of all states that must have the same axes and colours, for example in a film.
        units: units of "length" and "stress".
    """

    surface: DiscreteSurface
    x: Array
    cells: Cells
    box: Array
    labels: Sequence[str]
    data: Arrays
    every: Sequence[Arrays]
    units: Mapping[str, str]

    def label(self, axis: int) -> str:
        """Return the label of an axis: its coordinate with the unit of length."""
        return with_unit(self.labels[axis], self.units.get("length"))

    def stress(self, words: str) -> str:
        """Return the label or title ``words`` with the unit of stress."""
        return with_unit(words, self.units.get("stress"))

    def shear(self) -> str:
        """Return the name of the shear in the labels, with the body on which it acts."""
        return f"shear on the {'slave' if self.surface.between_bodies else 'body'}"


def _limits(x: Array, data: Arrays) -> tuple[float, float]:
    """Return the limits of an axis, with a margin around the part in contact.

    Without contact, the limits include all facets.

    Args:
        x: coordinates of the m vertices along the axis, shape (m,).
        data: data of the state to draw, see `contact_data`.
    """
    cells, touching = data["cells"], data["touching"]
    near = x[cells[touching[cells].any(axis=1)]] if touching.any() else x
    rim = 0.05 * float(np.ptp(x))
    margin = max(0.25 * float(np.ptp(near)), 2 * rim)
    return max(near.min() - margin, x.min() - rim), min(near.max() + margin, x.max() + rim)


# -- curves in 2D --------------------------------------------------------------------------------


def _draw_curve(frame: _Frame, size: tuple[float, float] | None) -> Figure:
    """Draw the tractions on a 2D surface over its arc length or over a coordinate."""
    at, data = frame.x[:, 0], frame.data
    figure = new_figure(size or (8.6, 5.0))
    axes = figure.add_subplot()
    pressure, shear, bound = data["pressure"], data["shear"], data["bound"]
    lines = {
        "pressure": (pressure, "#8c2d19", "-"),
        frame.shear(): (shear, "#2b5d34", "-"),
        "friction bound ±": (bound, "#7d858c", "--"),
        "_": (-bound, "#7d858c", "--"),
    }
    if "friction" in data:
        lines["friction, a part of the shear"] = data["friction"], "#6fa37a", "-"
    for name, (values, colour, style) in lines.items():
        # one facet after the other, separated by NaN
        ends = np.stack([at, values])[:, frame.cells]
        x, y = np.pad(ends, ((0, 0), (0, 0), (0, 1)), constant_values=np.nan).reshape(2, -1)
        axes.plot(x, y, style, color=colour, lw=1.8 if style == "-" else 1.0, label=name)
    colours = [COLOURS[k] for k in data["letters"]]
    look: dict[str, Any] = dict(s=12 if len(at) > 60 else 26, linewidths=0.4, edgecolors=INK)
    for values in (pressure, shear):
        axes.scatter(at, values, c=colours, zorder=3, **look)
    axes.axhline(0, color=INK, lw=0.6)
    bounds = [(d["pressure"], d["shear"], d["bound"], -d["bound"]) for d in frame.every]
    margin = 0.05 * float(np.ptp(bounds)) or 1.0
    axes.set(xlim=frame.box[:, 0], ylim=(np.min(bounds) - margin, np.max(bounds) + margin))
    axes.set(xlabel=frame.label(0), ylabel=frame.stress("traction"))
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _along_curve(data: Arrays, over: str | None) -> tuple[Array, Cells, list[str]]:
    """Return the horizontal positions at which the vertices of a 2D surface are drawn.

    They are coordinates or arc lengths. The arc length grows along the tangent (-n_y, n_x), where n
    is the normal. A closed curve is cut at the facet that is farthest from the part in contact;
    this facet is omitted.

    Args:
        data: data of the state to draw, see `contact_data`.
        over: coordinate to use; default: the coordinate along a straight surface, otherwise the arc
            length.

    Returns:
        Positions of the m vertices, shape (m, 1); vertices of the facets; and label of the axis.
    """
    x, facets = data["x"][:, :2], data["cells"]
    extent = np.ptp(x, axis=0)
    if over is None and extent.min() < _STRAIGHT * extent.max():
        over = "xy"[np.argmax(extent)]
    if over is not None:
        return x[:, ["xy".index(over)]], facets, [over]
    tangents = plane_tangents(data["n"])
    at = np.zeros(len(x))
    kept = []
    begin = 0.0
    for numbers, vertices in curves(facets):
        # open a closed curve at the facet farthest from the contact
        if vertices[0] == vertices[-1]:
            touching = vertices[data["touching"][vertices]]
            middle = x[touching if len(touching) else vertices[:-1]].mean(axis=0)
            far = np.argmax(np.linalg.norm(x[facets[numbers]].mean(axis=1) - middle, axis=1))
            vertices = np.roll(vertices[:-1], -far - 1)
        # follow the tangents
        if np.sum(np.diff(x[vertices], axis=0) * tangents[vertices[:-1]]) < 0:
            vertices = vertices[::-1]
        lengths = np.linalg.norm(np.diff(x[vertices], axis=0), axis=1)
        at[vertices] = begin + np.cumsum([0.0, *lengths])
        kept.append(np.stack([vertices[:-1], vertices[1:]], axis=1))
        begin += 1.05 * float(lengths.sum())
    start = ", ".join(as_text(c, float(np.abs(x).max()), 4) for c in x[np.argmin(at)])
    return at[:, None], np.concatenate(kept), [f"length along the surface, from ({start})"]


# -- maps in 3D ----------------------------------------------------------------------------------


def _draw_map(frame: _Frame, size: tuple[float, float] | None) -> Figure:
    """Draw two maps of a projected 3D surface: the pressure, and the status with the shear."""
    x, cells = frame.x, frame.cells
    wide, tall = frame.box[1] - frame.box[0]
    # panels side by side; those of a long surface are above each other, and stretched
    is_long = bool(tall < _FLAT * wide)
    ratio = _FLAT if is_long else float(tall / wide)
    size = size or (11.2, 22 * ratio + 3 if is_long else 5 * ratio + 2.2)
    figure = new_figure(size, "compressed")
    left, right = figure.subplots(*((2, 1) if is_long else (1, 2)), sharex=True, sharey=True)
    width = 0.15 * are_distinct(x, cells, _PANEL / float(max(wide, tall)))
    # pressure; without bonds negative values are discretisation errors
    least = -np.inf if frame.surface.law_at_points.compiled.bonded else 0.0
    look = _look_of_pressure(np.maximum([d["pressure"] for d in frame.every], least))
    pressure = np.maximum(frame.data["pressure"], least)
    shades = shade(left, x, cells, pressure, **look)
    figure.colorbar(shades, ax=left, location="bottom", aspect=60 if is_long else 30)
    title = "Normal pressure" + ", negative where it pulls" * bool(shades.norm.vmin < 0)
    left.set_title(frame.stress(title), loc="left")
    # statuses and shear
    _draw_statuses(right, x, cells, frame.data["letters"])
    right.set_title(frame.stress(f"Status, and {frame.shear()}"), loc="left")
    columns = ["xyz".index(label) for label in frame.labels]
    largest = max(float(np.linalg.norm(d["shear"][:, columns], axis=1).max()) for d in frame.every)
    spacing = np.array([wide, tall / ratio]) / (2 * _ARROWS if is_long else _ARROWS)
    _draw_arrows(right, x, frame.data["shear"][:, columns], spacing, largest)
    for axes in (left, right):
        draw_edges(axes, x, cells, width, 0.25)
        axes.set(xlim=frame.box[:, 0], ylim=frame.box[:, 1], box_aspect=ratio)
        axes.set(xlabel=frame.label(0), ylabel=frame.label(1) + " (stretched)" * is_long)
        axes.label_outer()
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _look_of_pressure(every: Array) -> dict[str, Any]:
    """Return the colour scale (``norm`` and ``cmap``) of the pressure in all frames.

    Pressures are negative where bonds pull.
    """
    from matplotlib import colormaps
    from matplotlib.colors import CenteredNorm, LinearSegmentedColormap, Normalize

    if every.min() < 0:
        return dict(norm=CenteredNorm(halfrange=np.abs(every).max()), cmap="RdBu_r")
    stops = [COLOURS["o"], *colormaps["magma_r"](np.linspace(0.12, 0.95, 12))]
    colours = LinearSegmentedColormap.from_list("pressure", stops)
    return dict(norm=Normalize(0.0, float(every.max()) or 1.0), cmap=colours)


def _draw_statuses(axes: Axes, x: Array, cells: Cells, letters: npt.NDArray[np.str_]) -> None:
    """Colour the part of the facets around each vertex by the status of the vertex."""
    from matplotlib.collections import PolyCollection

    loop = around(cells)
    corners = x[loop]
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    sides = [(corners + np.roll(corners, k, axis=1)) / 2 for k in (-1, 1)]
    quads = np.stack([corners, sides[0], centre, sides[1]], axis=2).reshape(-1, 4, 2)
    fills = [COLOURS[k] for k in letters[loop.reshape(-1)]]
    axes.add_collection(PolyCollection(quads, facecolors=fills, edgecolors=fills, lw=0.3))


def _projected(data: Arrays) -> tuple[Array, Cells, list[str]]:
    """Project a surface along the coordinate axis closest to the mean normal in contact.

    Facets that face away, such as the far side of a closed surface, are omitted.

    Returns:
        Positions of the m vertices, shape (m, 2); vertices of the facets; and labels of both axes.
    """
    x, cells = data["x"], data["cells"]
    normals = unit(area_vectors(x[cells[:, :3]]))
    normals *= np.sign(np.sum(normals * data["n"][cells].mean(axis=1), axis=1, keepdims=True))
    touches = data["touching"][cells].any(axis=1)
    n = unit(normals[touches if touches.any() else slice(None)].mean(axis=0))
    columns = np.delete(np.arange(3), np.argmax(np.abs(n)))
    wide, tall = np.ptp(x[:, columns], axis=0)
    columns = columns[::-1] if tall > 2.5 * wide else columns
    seen = normals @ n > _SEEN
    return x[:, columns], cells[seen] if seen.any() else cells, ["xyz"[k] for k in columns]


def _draw_arrows(axes: Axes, x: Array, vectors: Array, spacing: Array, largest: float) -> None:
    """Draw at most one arrow per square of a grid, and a key with the largest magnitude."""
    size = np.linalg.norm(vectors, axis=1)
    if not largest:
        return
    order = np.argsort(-size, kind="stable")
    squares = np.floor((x[order] - x.min(axis=0)) / spacing).astype(int)
    chosen = order[np.unique(squares, axis=0, return_index=True)[1]]
    chosen = chosen[size[chosen] > 0.02 * largest]
    look: dict[str, Any] = dict(angles="xy", scale_units="x", pivot="mid", width=0.0032, color=INK)
    look |= dict(scale=largest / (2 * spacing[0]), clip_on=False, zorder=3)
    arrows = axes.quiver(*x[chosen].T, *vectors[chosen].T, **look)
    arrows.set_in_layout(False)  # matplotlib overestimates the extent of arrows
    where: dict[str, Any] = dict(labelpos="W", coordinates="axes")
    axes.quiverkey(arrows, 0.9, 1.02, largest, f"{largest:.3g}", **where)
