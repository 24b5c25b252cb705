# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of pictures of bodies, and scenes: bodies and obstacles in one state, as drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, TypedDict

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._geometry import unit
from dolfinx_contact._validate import one_of, vector
from dolfinx_contact.results.outer_surface import OuterSurface, SurfaceState

__all__ = ["DrawnObstacle", "Look", "Options", "Scene", "finite_range", "options_of", "scene_of"]

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


class Look(TypedDict, total=False):
    """Options of pictures and films of bodies.

    Attributes:
        field: colours of the body: ``"displacement"`` (its magnitude) or a UFL scalar. Values of
            discontinuous fields are averaged at the vertices; values that are not finite are grey.
            The default is the von Mises stress if there is a stress, otherwise no field.
        view: direction from the body to the eye, in 3D: an axis such as ``"-y"``, or a vector.
        clip: plane of a section, in 3D: its normal (then the plane passes through the middle), or a
            point and a normal. The part on the side of the normal is not drawn.
        arrows: arrows by name, each a point and a vector, such as a load or the direction of
            drag. The longest arrow of each name has the same length in the picture, and the legend
            gives its magnitude.
    """

    field: Any
    view: ViewDirection | None
    clip: ViewDirection | tuple[Sequence[float], ViewDirection] | None
    arrows: Mapping[str, tuple[Any, Any]]


@dataclass(frozen=True)
class Options:
    """Validated entries of a `Look`.

    Attributes:
        field: ``"displacement"``, a UFL scalar, or None.
        eye: unit vector from the body to the eye; None for the default.
        clip: point (None for the middle) and unit normal of a section; None without one.
        arrows: points and vectors by name, shape (2, n, 3) each.
    """

    field: Any
    eye: Array | None
    clip: tuple[Array | None, Array] | None
    arrows: dict[str, Array]


def options_of(
    dim: int,
    *,
    field: Any = None,
    view: Any = None,
    clip: Any = None,
    arrows: Mapping[str, tuple[Any, Any]] | None = None,
) -> Options:
    """Validate a `Look`. Not collective.

    Args:
        dim: dimension of the body.
        field: entry of `Look`, like the following arguments.
        view: see `Look`.
        clip: see `Look`.
        arrows: see `Look`.

    Raises:
        ValueError: if a value is not admissible.
    """
    if dim == 2 and not (view is None and clip is None):
        raise ValueError("view and clip are for bodies in 3D")
    scalar = isinstance(field, ufl.core.expr.Expr) and field.ufl_shape == ()
    if not (scalar or field is None or (isinstance(field, str) and field == "displacement")):
        raise ValueError(f"field must be 'displacement' or a UFL scalar, got {field!r}")
    plane = None
    if clip is not None:
        pair = not isinstance(clip, str) and len(clip) == 2
        point, normal = clip if pair else (None, clip)
        at = None if point is None else vector(point, "the point of clip", 3)
        plane = at, _direction(normal, "the normal of clip")
    return Options(
        field=field,
        eye=None if view is None else _direction(view, "view"),
        clip=plane,
        arrows={name: _arrows(name, *arrow, dim) for name, arrow in (arrows or {}).items()},
    )


def _direction(value: Any, name: str) -> Array:
    """Return a unit vector."""
    if isinstance(value, str):
        return _AXES[one_of(value, name, _AXES)]
    return unit(vector(value, name, 3, zero=False))


def _arrows(name: str, points: Any, vectors: Any, dim: int) -> Array:
    """Return points and vectors of arrows, shape (2, n, 3)."""
    pair = np.broadcast_arrays(np.atleast_2d(points), np.atleast_2d(vectors))
    arrows = np.array(pair, dtype=np.float64)
    if arrows.shape[-1] != dim or not np.isfinite(arrows).all():
        raise ValueError(f"the arrows {name!r} must be finite points and vectors in {dim}D")
    return np.pad(arrows, ((0, 0), (0, 0), (0, 3 - dim)))


# -- scenes --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DrawnObstacle:
    """An obstacle, as it is drawn.

    Attributes:
        x: coordinates of its vertices (m, 3).
        cells: vertices of its facets.
        n: normals at the vertices, into the obstacle (m, 3).
        is_plane: True if the obstacle is a plane that is still to be replaced by a rectangle.
    """

    x: Array
    cells: Cells
    n: Array
    is_plane: bool

    def below(self, points: Array) -> DrawnObstacle:
        """Replace a plane by a rectangle, in 2D a segment, below points (n, 3)."""
        if not self.is_plane:
            return self
        n = self.n[0]
        is_flat = not points[:, 2].any()
        first = np.eye(3)[2] if is_flat else np.eye(3)[np.argmin(np.abs(n))]
        first = unit(np.cross(n, first))
        axes = np.array([first] if is_flat else [first, np.cross(n, first)])
        along = points @ axes.T
        rim = 0.1 * float(np.ptp(along, axis=0).max())
        ends = np.stack([along.min(axis=0) - rim, along.max(axis=0) + rim], axis=1)
        grid = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(axes))
        corners = grid @ axes + (self.x[0] @ n) * n
        cells = np.arange(len(corners))[None]
        return DrawnObstacle(corners, cells, np.tile(n, (len(corners), 1)), False)


@dataclass(frozen=True)
class Scene:
    """Bodies and obstacles in one state, as they are drawn.

    Attributes:
        x: coordinates of the displaced vertices (n, 3).
        cells: vertices of the cells of a body in 2D, of the facets of the boundary in 3D.
        slaves: vertices of the facets of each contact surface.
        masters: vertices of the facets of each opposite surface of a pair.
        obstacles: rigid obstacles.
        values: field at the vertices (n,); None without a field.
        label: label of the field.
        inside: coordinates, cells, and field of the whole body, for a section.
        marks: positions of contact points in 2D (m, 2) and the letters of their statuses.
        title: title of the picture.
    """

    x: Array
    cells: Cells
    slaves: list[Cells]
    masters: list[Cells]
    obstacles: list[DrawnObstacle]
    values: Array | None = None
    label: str = ""
    inside: tuple[Array, Cells, Array | None] | None = None
    marks: tuple[Array, str] | None = None
    title: str = ""

    @property
    def coloured(self) -> Array | None:
        """Field of the drawn part, the interior in a section."""
        return self.values if self.inside is None else self.inside[2]

    def above(self, points: Array) -> Scene:
        """Return the scene with plane obstacles as rectangles below points (n, 3)."""
        return replace(self, obstacles=[o.below(points) for o in self.obstacles])


def scene_of(surface: OuterSurface, state: SurfaceState, scale: float) -> Scene:
    """Place bodies and obstacles at a state. Not collective.

    Args:
        surface: outer surface of the bodies.
        state: displacement, and position and motion of the obstacles.
        scale: factor of the displacement and of the motion.
    """
    obstacles = []
    for name, cells in surface.obstacles.items():
        floor, motion, n = (in_space(values) for values in state.obstacles[name])
        # an obstacle with facets of its own (a rigid surface) is drawn with these
        at_points = 0 < len(n) == len(np.unique(surface.contact[name]))
        is_plane = at_points and bool(np.ptp(n, axis=0).max() < _PLANE)
        obstacles.append(DrawnObstacle(floor + scale * motion, cells, unit(n), is_plane))
    return Scene(
        x=surface.x + scale * in_space(state.u),
        cells=surface.cells,
        slaves=list(surface.contact.values()),
        masters=list(surface.opposite.values()),
        obstacles=obstacles,
    )


def in_space(vectors: npt.NDArray[Any]) -> Array:
    """Append zeros to vectors in 2D."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def finite_range(values: Array) -> tuple[float, float]:
    """Smallest and largest finite value, as different ends of a range of colours."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    low = 0.0 if abs(low) < 1e-9 * high else low  # no digits of round-off at a bar
    return (low, high) if high > low else (low, low + (abs(low) or 1.0))
