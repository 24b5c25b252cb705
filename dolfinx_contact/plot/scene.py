# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes: data of a picture of bodies and obstacles in one state, gathered on rank 0."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import unwrap
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import by_coordinates, connected_parts, unit
from dolfinx_contact._mpi import everywhere
from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import flag, number, one_of, vector
from dolfinx_contact.io.fields import check_stress, of_cells, von_mises
from dolfinx_contact.io.outside import Outside, VertexMeans
from dolfinx_contact.plot.drawn_obstacles import DrawnObstacle, obstacle_of
from dolfinx_contact.plot.figures import NOT_FINITE, are_distinct, title_of, with_unit
from dolfinx_contact.results.outer_surface import Arrays, Cells

if TYPE_CHECKING:
    from dolfinx import mesh

    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = ["Look", "Scene", "check_look", "check_units", "framed", "scene_of"]

#: An axis by its name, with a sign, or a vector.
ViewDirection: TypeAlias = str | Sequence[float]

_AXES: dict[str, Array] = {
    sign + name: np.asarray(factor * axis)
    for name, axis in zip("xyz", np.eye(3), strict=True)
    for sign, factor in (("", 1.0), ("-", -1.0))
}
_TINTS = ["#c3d0dc", "#e3d3b4", "#c9dcc3", "#d9cbdf"]  # colours of bodies without a field
_FIELD = "Spectral_r"  # colour map of fields
_ARROW = 0.2  # length of the longest arrow, relative to the diagonal of the picture
_RIM = 0.1  # width of the visible rim around the bodies, relative to their size
_LARGE = 1.2  # size of an obstacle, relative to the bodies, above which parts may be invisible


class Look(TypedDict, total=False):
    """Options of pictures and films of bodies.

    Attributes:
        field: colours of the body: ``"displacement"`` (its magnitude) or a UFL scalar. Values of
            discontinuous fields are averaged at the vertices; values that are not finite are grey.
            The default is the von Mises stress if there is a stress, otherwise no field.
        view: direction from the body to the viewer, in 3D: an axis such as ``"-y"``, or a vector.
        clip: plane of a section, in 3D: its normal, or a point and a normal. Without a point, the
            plane passes through the middle of the bodies or of the region. The part on the side to
            which the normal points is not drawn, and the default view is from that side: x points
            to the right with ``"-y"``, to the left with ``"y"``.
        arrows: arrows by name, each a point and a vector, such as a load or the direction of
            drag. The longest arrow of each name has the same length in the picture, and the legend
            gives its magnitude.
        region: opposite corners of the box that fills the picture, to enlarge a detail, shape
            (2, dim); default: bodies and obstacles.
        edges: whether the edges of the cells are drawn; default: only if the cells are large enough
            in the picture.
        units: names of the units in the labels, such as ``{"length": "mm", "stress": "MPa"}``;
            default: none.
    """

    field: Any
    view: ViewDirection | None
    clip: ViewDirection | tuple[Sequence[float], ViewDirection] | None
    arrows: Mapping[str, tuple[Any, Any]]
    region: Sequence[Sequence[float]] | None
    edges: bool | None
    units: Mapping[str, str]


@dataclass(frozen=True)
class View:
    """Validated options of a picture, see `Look`.

    Attributes:
        field: UFL scalar, "displacement", or None.
        eye: unit vector from the body towards the viewer; None for the default.
        clip: point (None for the middle) and unit normal of a section; None for no section.
        arrows: start points and vectors of k arrows by name, shape (2, k, dim) each.
        region: lower and upper corner of the visible box, shape (2, dim); None for everything.
        edges: whether the edges of the cells are drawn; None for the default.
        units: names of the units of "length" and "stress".
    """

    field: Any
    eye: Array | None
    clip: tuple[Array | None, Array] | None
    arrows: Mapping[str, Array]
    region: Array | None
    edges: bool | None
    units: Mapping[str, str]


@dataclass(frozen=True)
class Scene:
    """Data of a picture of bodies and obstacles in one state.

    Attributes:
        x: coordinates of the n displaced vertices, shape (n, dim).
        cells: vertices of all cells in 2D or if there is a section; otherwise vertices of the
            boundary facets.
        slaves: vertices of the facets of each contact surface.
        masters: vertices of the facets of the master surface of each pair.
        obstacles: facets of the rigid obstacles.
        values: field at the vertices, shape (n,); None without a field.
        label: label of the field.
        title: title of the picture.
        view: options of the picture.
        points: positions of the m drawn contact points, shape (m, dim); only points of surfaces
            whose contact points are vertices.
        letters: status letters of these points.
        visible: positions of k points that must be visible, shape (k, dim); see `framed`.
        limits: smallest and largest field value of the colour map; see `framed`.
    """

    x: Array
    cells: Cells
    slaves: Sequence[Cells]
    masters: Sequence[Cells]
    obstacles: Sequence[DrawnObstacle]
    values: Array | None
    label: str
    title: str
    view: View
    points: Array
    letters: str
    visible: Array
    limits: tuple[float, float] = (0.0, 1.0)

    def colours(self) -> tuple[npt.NDArray[Any], Any, tuple[float, float]]:
        """Return the coloured values at the vertices, their colour map, and its limits.

        The limits are the smallest and the largest value. Without a field, connected parts have
        different tints, and the values are the indices of the tints.
        """
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        if self.values is not None:
            return self.values, colormaps[_FIELD].with_extremes(bad=NOT_FINITE), self.limits
        links = self.cells[:, :-1].ravel(), self.cells[:, 1:].ravel()
        tints = connected_parts(len(self.x), *links) % len(_TINTS)
        return tints, ListedColormap(_TINTS), (-0.5, len(_TINTS) - 0.5)

    def shows_edges(self, pixels: float) -> bool:
        """Return whether to draw the edges of the cells, for a number of pixels per length."""
        edges = self.view.edges
        return are_distinct(self.x, self.cells, pixels) if edges is None else edges


def framed(scenes: Sequence[Scene]) -> list[Scene]:
    """Return scenes with a common frame and common colours, and with the visible obstacles.

    The bodies of all scenes fill the picture. Obstacles of similar size are visible completely,
    larger obstacles only near the bodies. The longest arrow of each name has the same length.
    """
    x = np.concatenate([scene.x for scene in scenes])
    low, high = x.min(axis=0), x.max(axis=0)
    size = float(np.max(high - low))
    scenes = [replace(s, obstacles=[o.around(x) for o in s.obstacles]) for s in scenes]
    # points that must be visible
    view = scenes[0].view
    parts = [x]
    for part in [o.x for scene in scenes for o in scene.obstacles]:
        is_large = bool(np.max(np.ptp(part, axis=0)) > _LARGE * size)
        parts.append(np.clip(part, low - _RIM * size, high + _RIM * size) if is_large else part)
    if view.region is not None:
        parts = [np.array(list(product(*view.region.T)))]
    # scale the arrows to the picture; their names contain the magnitude of the longest one
    length = _ARROW * float(np.linalg.norm(np.ptp(np.concatenate(parts), axis=0)))
    arrows = {}
    for name, (points, vectors) in view.arrows.items():
        longest = float(np.linalg.norm(vectors, axis=1).max())
        scaled = length / (longest or 1.0) * vectors
        arrows[f"{name} ({longest:.3g})"] = np.stack([points, scaled])
        if view.region is None:
            parts += [points, points + scaled]
    values = [scene.values for scene in scenes if scene.values is not None]
    common: dict[str, Any] = dict(
        view=replace(view, arrows=arrows),
        visible=np.concatenate(parts),
        limits=_limits(np.concatenate(values)) if values else (0.0, 1.0),
    )
    return [replace(scene, **common) for scene in scenes]


def _limits(values: Array) -> tuple[float, float]:
    """Return the smallest and largest finite value; the latter is increased if they are equal."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    low = 0.0 if abs(low) < 1e-9 * high else low  # the colour bar shows no round-off
    return (low, high) if high > low else (low, low + (abs(low) or 1.0))


# -- validation ----------------------------------------------------------------------------------


def check_units(units: Mapping[str, str] | None) -> None:
    """Raise ``ValueError`` for units of quantities other than length and stress."""
    for quantity in units or {}:
        one_of(quantity, "the quantity of a unit", ("length", "stress"))


def check_look(function: Any, look: Mapping[str, Any]) -> None:
    """Raise ``TypeError`` if an option belongs neither to ``function`` nor to `Look`."""
    options = [*unwrap(function).__kwdefaults__, *Look.__annotations__]
    for name in look:
        if name not in options:
            known = ", ".join(options)
            raise TypeError(f"{function.__name__} has no option {name!r}; its options are {known}")


def _view_of(look: Mapping[str, Any], domain: mesh.Mesh) -> View:
    """Validate the options of a picture and return them as a `View`."""
    dim = domain.geometry.dim
    field, view, clip = look.get("field"), look.get("view"), look.get("clip")
    region, edges, units = look.get("region"), look.get("edges"), look.get("units") or {}
    if dim == 2 and not (view is None and clip is None):
        raise ValueError("view and clip are for bodies in 3D")
    if not (field is None or (isinstance(field, str) and field == "displacement")):
        if not isinstance(field, ufl.core.expr.Expr) or field.ufl_shape != ():
            raise ValueError(f"field must be 'displacement' or a UFL scalar, got {field!r}")
        refuse_other_mesh(field, domain, "the field")
    if edges is not None:
        flag(edges, "edges")
    check_units(units)
    arrows: Mapping[str, tuple[Any, Any]] = look.get("arrows") or {}
    return View(
        field=field,
        eye=None if view is None else _direction(view, "view"),
        clip=None if clip is None else _plane(clip),
        arrows={name: _arrows(name, *arrow, dim) for name, arrow in arrows.items()},
        region=None if region is None else _box(region, dim),
        edges=edges,
        units=units,
    )


def _direction(value: Any, name: str) -> Array:
    """Return the unit vector of an axis such as "-y" or of a vector given by the user."""
    if isinstance(value, str):
        return _AXES[one_of(value, name, _AXES)]
    return unit(vector(value, name, 3, zero=False))


def _plane(clip: Any) -> tuple[Array | None, Array]:
    """Return a point (None for the middle) and the unit normal of the section ``clip``."""
    pair = not isinstance(clip, str) and len(clip) == 2
    point, normal = clip if pair else (None, clip)
    at = None if point is None else vector(point, "the point of clip", 3)
    return at, _direction(normal, "the normal of clip")


def _box(region: Any, dim: int) -> Array:
    """Return the lower and upper corner of the box ``region`` (`Look`), shape (2, dim)."""
    corners = np.array([vector(corner, "a corner of region", dim) for corner in region])
    if corners.shape != (2, dim) or not np.all(np.ptp(corners, axis=0) > 0):
        raise ValueError(f"region must be two opposite corners of a box, got {region!r}")
    return np.sort(corners, axis=0)


def _arrows(name: str, points: Any, vectors: Any, dim: int) -> Array:
    """Return the start points and the vectors of k arrows, shape (2, k, dim)."""
    pair = np.broadcast_arrays(np.atleast_2d(points), np.atleast_2d(vectors))
    arrows = np.array(pair, dtype=np.float64)
    if arrows.shape[-1] != dim or not np.isfinite(arrows).all():
        raise ValueError(f"the arrows {name!r} must be finite points and vectors in {dim}D")
    return arrows


# -- gathering -----------------------------------------------------------------------------------


def scene_of(
    problem: ContactProblem,
    stress: Any,
    scale: float,
    title: str,
    look: Look,
    tables: Iterable[ContactTable] = (),
) -> Scene | None:
    """Gather bodies and obstacles in the current state of the Functions. Collective.

    Args:
        problem: contact problem.
        stress: see `picture_of_body`.
        scale: factor by which the displacement and the motion of obstacles are multiplied.
        title: title of the picture; a factor other than 1 is added to it.
        look: options of the picture, see `Look`; their names have already been checked.
        tables: contact tables of the surfaces whose contact points are drawn.

    Returns:
        The scene on rank 0, None on other ranks.

    Raises:
        ValueError: on every rank, if an argument is not admissible.
    """
    with everywhere(problem.comm, "the look of a picture"):
        scale = number(scale, "the scale of the displacement")
        view = _view_of(look, problem.V.mesh)
    outside = Outside(problem)
    label, local = _field_at_vertices(problem, outside, stress, view)
    body = outside.gather(local, whole=view.clip is not None)
    slaves, masters = outside.faces(body)
    rigid = [s for s in problem.surfaces if not s.between_bodies]
    obstacles = [obstacle_of(s, scale) for s in rigid]
    if not body:
        return None
    x = body["x"][:, : problem.V.mesh.geometry.dim] + scale * body["u"]
    if scale != 1:
        title = title_of(title, f"displacement x {scale:g}")
    values = body.get("field")
    if values is not None and not np.isfinite(values).all():
        label += " (grey: not a number)"
    points, letters = _points_at_vertices(body, x, slaves, tables)
    return Scene(
        x=x,
        cells=body["cells"],
        slaves=list(slaves.values()),
        masters=list(masters.values()),
        obstacles=obstacles,
        values=values,
        label=label,
        title=title,
        view=view,
        points=points,
        letters=letters,
        visible=x,
    )


def _points_at_vertices(
    body: Arrays, x: Array, slaves: Mapping[str, Cells], tables: Iterable[ContactTable]
) -> tuple[Array, str]:
    """Return positions and status letters of contact points that are vertices.

    Surfaces whose contact points are not vertices are skipped.

    Args:
        body: gathered body, see `Outside.gather`.
        x: positions of its n displaced vertices, shape (n, dim).
        slaves: vertices of the facets of each contact surface, by name.
        tables: contact tables of the surfaces whose points are drawn.
    """
    points: list[Array] = [np.zeros((0, x.shape[1]))]
    letters = ""
    for table in tables:
        vertices = np.unique(slaves[table.name])
        if len(vertices) == len(table.letters):
            order = by_coordinates(body["x"][vertices], body["nodes"][vertices, None])
            points.append(x[vertices[order]])
            letters += "".join(table.letters)
    return np.concatenate(points), letters


def _field_at_vertices(
    problem: ContactProblem, outside: Outside, stress: Any, view: View
) -> tuple[str, dict[str, Array]]:
    """Return the label of the field of a picture, and its local vertex values. Collective.

    The values are in a dictionary with the key "field", which is empty without a field. Values that
    are not finite are NaN.
    """
    tags = check_stress(problem, stress)
    rule: dict[str, Any] = {"quadrature_rule": "vertex"}
    scalars: dict[int | None, Any] = {None: view.field}
    if isinstance(view.field, str):
        label = with_unit(view.field, view.units.get("length"))
        scalars = {None: ufl.sqrt(ufl.dot(problem.u, problem.u))}
    elif view.field is not None:
        label = getattr(view.field, "name", "field")
    elif stress is not None:
        label = with_unit("von Mises stress", view.units.get("stress"))
        rule = {"quadrature_degree": 2}
        stresses = stress if isinstance(stress, Mapping) else {None: stress}
        scalars = {tag: von_mises(stresses[tag]) for tag in sorted(stresses)}
    else:
        return "", {}
    scalars = {tag: of_cells(e, problem.V.mesh) for tag, e in scalars.items()}
    means = VertexMeans(outside.V, scalars, tags if view.field is None else None, **rule)()
    return label, {"field": np.where(np.isfinite(means), means, np.nan)}
