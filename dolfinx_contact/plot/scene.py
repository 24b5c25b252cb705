# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes: bodies and obstacles in one state, as they are drawn, gathered on rank 0."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from inspect import Parameter, signature
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._geometry import by_coordinates, dot, unit
from dolfinx_contact._mpi import everywhere
from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import flag, number, one_of, vector
from dolfinx_contact.io.fields import check_stress, of_cells, von_mises
from dolfinx_contact.io.outside import Outside, VertexMeans, obstacle_facets
from dolfinx_contact.plot.drawn_obstacles import DrawnObstacle, Formula, formula_of
from dolfinx_contact.results.outer_surface import Arrays

if TYPE_CHECKING:
    from dolfinx import mesh

    from dolfinx_contact.equations.state import State
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = [
    *("Look", "Scene", "are_distinct", "around", "check_look", "check_units", "scene_of"),
    *("with_unit", "words_of"),
]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]
#: An axis by its name, with a sign, or a vector.
ViewDirection: TypeAlias = str | Sequence[float]

_AXES: dict[str, Array] = {
    sign + name: np.asarray(factor * axis)
    for name, axis in zip("xyz", np.eye(3), strict=True)
    for sign, factor in (("", 1.0), ("-", -1.0))
}
_PLANE = 1e-9  # difference of the normals of an obstacle up to which it is a plane
_OVERLAP = 0.005  # visible overlap of a magnified body and an obstacle, relative to the body
_DENSE = 20.0  # size of cells in pixels below which their edges would hide the colours
_ARROW = 0.2  # length of the longest arrow, relative to the diagonal of the picture
_DRAWN_THROUGH = (
    "%r is drawn through its obstacle: the displacement is magnified %g times, the initial gap is "
    "not"
)


class Look(TypedDict, total=False):
    """Options of pictures and films of bodies.

    Attributes:
        field: colours of the body: ``"displacement"`` (its magnitude) or a UFL scalar. Values of
            discontinuous fields are averaged at the vertices; values that are not finite are grey.
            The default is the von Mises stress if there is a stress, otherwise no field.
        view: direction from the body to the viewer, in 3D: an axis such as ``"-y"``, or a vector.
        clip: plane of a section, in 3D: its normal (then the plane passes through the middle of the
            bodies or of the region), or a point and a normal. The part on the side of the normal is
            not drawn, and the default view is from that side: x points to the right with ``"-y"``,
            to the left with ``"y"``.
        arrows: arrows by name, each a point and a vector, such as a load or the direction of
            drag. The longest arrow of each name has the same length in the picture, and the legend
            gives its magnitude.
        region: opposite corners of the box that fills the picture, to enlarge a detail, shape
            (2, dim); default: bodies and obstacles.
        edges: whether the edges of the cells are drawn; default: if they are not too dense.
        units: units of "length" and "stress" in the labels, such as ``{"length": "mm", "stress":
            "MPa"}``; default: none.
    """

    field: Any
    view: ViewDirection | None
    clip: ViewDirection | tuple[Sequence[float], ViewDirection] | None
    arrows: Mapping[str, tuple[Any, Any]]
    region: Sequence[Sequence[float]] | None
    edges: bool | None
    units: Mapping[str, str]


@dataclass(frozen=True)
class Scene:
    """Bodies and obstacles in one state, as they are drawn.

    Attributes:
        x: coordinates of the displaced vertices, shape (n, dim).
        cells: vertices of the cells in 2D or for a section, otherwise of the boundary facets.
        slaves: vertices of the facets of each contact surface.
        masters: vertices of the facets of each opposite surface of a pair.
        obstacles: rigid obstacles.
        values: field at the vertices, shape (n,); None without a field.
        label: label of the field.
        title: title of the picture.
        points: positions of the contact points of tables that are vertices, shape (m, dim).
        letters: letters of their statuses.
        eye: unit vector from the body towards the viewer; None for the default.
        clip: point (None for the middle) and unit normal of a section; None for no section.
        arrows: points and vectors by name, shape (2, k, dim) each.
        region: opposite corners of the visible box, shape (2, dim); None for everything.
        edges: whether the edges of the cells are drawn; None for the default.
        unit: unit of lengths; "" without one.
    """

    x: Array
    cells: Cells
    slaves: list[Cells]
    masters: list[Cells]
    obstacles: list[DrawnObstacle]
    values: Array | None
    label: str
    title: str
    points: Array
    letters: str = ""
    eye: Array | None = None
    clip: tuple[Array | None, Array] | None = None
    arrows: dict[str, Array] = field(default_factory=dict)
    region: Array | None = None
    edges: bool | None = None
    unit: str = ""

    def with_obstacles_around(self, points: Array) -> Scene:
        """Return the scene with its obstacles drawn around points (n, dim)."""
        return replace(self, obstacles=[o.around(points) for o in self.obstacles])

    def visible_points(self) -> Array:
        """Return the points that must be visible, shape (m, dim)."""
        if self.region is not None:
            return np.array(list(product(*self.region.T)))
        return np.concatenate([self.x, *(o.x for o in self.obstacles)])

    def shows_edges(self, pixels: float) -> bool:
        """Return whether the edges of the cells are drawn, given the pixels per length."""
        return are_distinct(self.x, self.cells, pixels) if self.edges is None else self.edges

    def scaled_arrows(self, visible: Array) -> dict[str, Array]:
        """Return points and vectors of the arrows in the lengths of the picture, by legend."""
        length = _ARROW * float(np.linalg.norm(np.ptp(visible, axis=0)))
        found = {}
        for name, (points, vectors) in self.arrows.items():
            longest = float(np.linalg.norm(vectors, axis=1).max())
            scaled = np.stack([points, length / (longest or 1.0) * vectors])
            found[f"{name} ({longest:.3g})"] = scaled
        return found


def are_distinct(x: Array, cells: Cells, pixels: float) -> bool:
    """Return whether the edges of cells are so far apart that they do not hide the colours.

    Args:
        x: positions of the vertices.
        cells: vertices of the cells.
        pixels: number of pixels per length.
    """
    sides = x[cells[:, 0]] - x[cells[:, 1]]
    return bool(np.linalg.norm(sides, axis=1).mean() * pixels > _DENSE)


def around(cells: Cells) -> Cells:
    """Return vertices of segments, triangles or quadrilaterals in the order around the cell."""
    return cells[:, [0, 1, 3, 2]] if cells.shape[1] == 4 else cells


def words_of(state: State | None) -> str:
    """Return the load or the time of a state for a title; "" if there is none."""
    if state is None or (state.gamma is None and state.time is None):
        return ""
    return f"time {state.time:.4g}" if state.gamma is None else f"gamma {state.gamma:.4g}"


def with_unit(label: str, unit: str | None) -> str:
    """Return a label with its unit, if there is one."""
    return f"{label} [{unit}]" if unit else label


# -- validation ----------------------------------------------------------------------------------


def check_units(units: Mapping[str, str] | None) -> None:
    """Raise ``ValueError`` for units of other quantities than lengths and stresses."""
    for quantity in units or {}:
        one_of(quantity, "the quantity of a unit", ("length", "stress"))


def check_look(function: Callable[..., Any], look: Mapping[str, Any]) -> None:
    """Raise ``TypeError`` if a function of pictures has no option of a name."""
    own = signature(function).parameters.values()
    options = [p.name for p in own if p.kind is Parameter.KEYWORD_ONLY]
    options += Look.__annotations__
    for name in look:
        if name not in options:
            known = ", ".join(options)
            raise TypeError(f"{function.__name__} has no option {name!r}; its options are {known}")


def _direction(value: Any, name: str) -> Array:
    """Return a unit vector."""
    if isinstance(value, str):
        return _AXES[one_of(value, name, _AXES)]
    return unit(vector(value, name, 3, zero=False))


def _plane(clip: Any) -> tuple[Array | None, Array]:
    """Return point and normal of a section."""
    pair = not isinstance(clip, str) and len(clip) == 2
    point, normal = clip if pair else (None, clip)
    at = None if point is None else vector(point, "the point of clip", 3)
    return at, _direction(normal, "the normal of clip")


def _box(region: Any, dim: int) -> Array:
    """Return the lower and upper corner of a box, shape (2, dim)."""
    corners = np.array([vector(corner, "a corner of region", dim) for corner in region])
    if corners.shape != (2, dim) or not np.all(np.ptp(corners, axis=0) > 0):
        raise ValueError(f"region must be two opposite corners of a box, got {region!r}")
    return np.sort(corners, axis=0)


def _arrows(name: str, points: Any, vectors: Any, dim: int) -> Array:
    """Return points and vectors of arrows, shape (2, k, dim)."""
    pair = np.broadcast_arrays(np.atleast_2d(points), np.atleast_2d(vectors))
    arrows = np.array(pair, dtype=np.float64)
    if arrows.shape[-1] != dim or not np.isfinite(arrows).all():
        raise ValueError(f"the arrows {name!r} must be finite points and vectors in {dim}D")
    return arrows


def _check_field(field: Any, domain: mesh.Mesh) -> None:
    """Raise ``ValueError`` if a field is neither "displacement" nor a UFL scalar of the mesh."""
    if field is None or (isinstance(field, str) and field == "displacement"):
        return
    if not isinstance(field, ufl.core.expr.Expr) or field.ufl_shape != ():
        raise ValueError(f"field must be 'displacement' or a UFL scalar, got {field!r}")
    refuse_other_mesh(field, domain, "the field")


# -- gathering -----------------------------------------------------------------------------------


def scene_of(
    problem: ContactProblem,
    stress: Any,
    scale: float,
    title: str,
    look: Look,
    tables: Iterable[ContactTable] = (),
) -> Scene | None:
    """Gather bodies and obstacles at the present Functions. Collective.

    Args:
        problem: contact problem.
        stress: see `picture_of_body`.
        scale: factor of the displacement and of the motion of obstacles.
        title: title of the picture, to which a factor other than 1 is added.
        look: options with known names.
        tables: contact tables of the surfaces whose points are drawn.

    Returns:
        The scene on rank 0, None on other ranks.

    Raises:
        ValueError: on every rank, if an argument is not admissible.
    """
    domain = problem.V.mesh
    dim = domain.geometry.dim
    field, view, clip = look.get("field"), look.get("view"), look.get("clip")
    region, edges, units = look.get("region"), look.get("edges"), look.get("units") or {}
    with everywhere(problem.comm, "the look of a picture"):
        scale = number(scale, "the scale of the displacement")
        if dim == 2 and not (view is None and clip is None):
            raise ValueError("view and clip are for bodies in 3D")
        eye = None if view is None else _direction(view, "view")
        plane = None if clip is None else _plane(clip)
        vectors = look.get("arrows") or {}
        arrows = {name: _arrows(name, *arrow, dim) for name, arrow in vectors.items()}
        box = None if region is None else _box(region, dim)
        if edges is not None:
            flag(edges, "edges")
        check_units(units)
        _check_field(field, domain)
    # gather bodies, contact surfaces and obstacles
    outside = Outside(problem)
    label, local = _field_at_vertices(problem, outside, stress, field, units)
    body = outside.gather(local, whole=clip is not None)
    slaves, masters = outside.faces()
    rigid = [s for s in problem.surfaces if not s.between_bodies]
    facets = {s.name: (obstacle_facets(s), formula_of(domain, s, scale)) for s in rigid}
    if not body:
        return None
    # draw them at their displaced positions
    if scale != 1:
        title = ", ".join(filter(None, [title, f"displacement x {scale:g}"]))
    x = body["x"][:, :dim] + scale * body["u"]
    size = float(np.max(np.ptp(body["x"], axis=0)))
    values = body.get("field")
    if values is not None and not np.isfinite(values).all():
        label += " (grey: not a number)"
    slaves, masters = (
        {name: np.searchsorted(body["nodes"], corners) for name, corners in faces.items()}
        for faces in (slaves, masters)
    )
    obstacles = [
        _obstacle(name, face, formula, x[np.unique(slaves[name])], scale, size)
        for name, (face, formula) in facets.items()
    ]
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
        points=points,
        letters=letters,
        eye=eye,
        clip=plane,
        arrows=arrows,
        region=box,
        edges=edges,
        unit=units.get("length", ""),
    )


def _points_at_vertices(
    body: Arrays, x: Array, slaves: Mapping[str, Cells], tables: Iterable[ContactTable]
) -> tuple[Array, str]:
    """Return positions and letters of the contact points of surfaces whose points are vertices.

    Args:
        body: gathered body, see `Outside.gather`.
        x: positions of its displaced vertices, shape (n, dim).
        slaves: vertices of the facets of each contact surface, by name.
        tables: contact tables.
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


def _obstacle(
    name: str, face: Arrays, formula: Formula | None, opposite: Array, scale: float, size: float
) -> DrawnObstacle:
    """Return an obstacle as it is drawn; warn if a magnified body is drawn through it.

    Args:
        name: name of the contact surface.
        face: facets of the obstacle, see `obstacle_facets`.
        formula: its formula, see `formula_of`.
        opposite: positions of the vertices of the contact surface, shape (k, dim).
        scale: factor of the motion.
        size: size of the body.
    """
    n = unit(face["n"])
    x = face["floor"][:, : n.shape[1]] + scale * face["moved"]
    if len(n) != len(opposite) or not len(n):  # a rigid surface with facets of its own
        return DrawnObstacle(x, face["cells"], n)
    if scale != 1 and np.max(dot(opposite - x, n)) > _OVERLAP * size:
        logger.warning(_DRAWN_THROUGH, name, scale)
    is_plane = bool(np.ptp(n, axis=0).max() < _PLANE)
    return DrawnObstacle(x, face["cells"], n, is_plane, formula)


def _field_at_vertices(
    problem: ContactProblem, outside: Outside, stress: Any, field: Any, units: Mapping[str, str]
) -> tuple[str, dict[str, Array]]:
    """Return the label of the field, and its values at the local vertices as "field". Collective.

    Values that are not finite are NaN. Without a field, the dictionary is empty.
    """
    tags = check_stress(problem, stress)
    rule: dict[str, Any] = {"quadrature_rule": "vertex"}
    scalars: dict[int | None, Any]
    if isinstance(field, str):
        label = with_unit(field, units.get("length"))
        scalars = {None: ufl.sqrt(ufl.dot(problem.u, problem.u))}
    elif field is not None:
        label = getattr(field, "name", "field")
        scalars = {None: field}
    elif stress is not None:
        label = with_unit("von Mises stress", units.get("stress"))
        rule = {"quadrature_degree": 2}
        stresses = stress if isinstance(stress, Mapping) else {None: stress}
        scalars = {tag: von_mises(stresses[tag]) for tag in sorted(stresses)}
    else:
        return "", {}
    scalars = {tag: of_cells(e, problem.V.mesh) for tag, e in scalars.items()}
    means = VertexMeans(outside.V, scalars, tags if field is None else None, **rule)()
    return label, {"field": np.where(np.isfinite(means), means, np.nan)}
