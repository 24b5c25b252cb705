# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of pictures of bodies: fields, view, section, zoom, colours, arrows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypedDict

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._validate import is_number, listed, one_of, positive, vector

__all__ = ["Look", "Options", "checked_units", "options_of"]

Array = npt.NDArray[np.float64]
#: An axis by its name, with a sign, or a vector.
ViewDirection: TypeAlias = str | Sequence[float]

_AXES: dict[str, Array] = {
    sign + name: np.asarray(factor * axis)
    for name, axis in zip("xyz", np.eye(3), strict=True)
    for sign, factor in (("", 1.0), ("-", -1.0))
}
_SIDES = {
    **{"front": -np.eye(3)[1], "back": np.eye(3)[1], "left": -np.eye(3)[0]},
    **{"right": np.eye(3)[0], "above": np.eye(3)[2], "below": -np.eye(3)[2]},
}
_FIELDS = ("displacement", "von Mises stress")


class Look(TypedDict, total=False):
    """Options of pictures and films of bodies.

    Attributes:
        fields: colours of the body, one panel for each field: ``"displacement"`` (its magnitude),
            ``"von Mises stress"`` (requires ``stress``), a sequence of these, or UFL scalars by
            name. Discontinuous fields are averaged at the vertices; values that are not finite are
            grey. The default is the stress if there is one, otherwise no field.
        view: direction from the body to the eye, in 3D: ``"front"`` (the eye is at -y),
            ``"back"``, ``"left"``, ``"right"``, ``"above"``, ``"below"``, an axis such as ``"-x"``,
            or a vector.
        up: direction that points upwards in the picture, in 3D, default ``"z"``.
        clip: plane of a section, in 3D: its normal (then the plane passes through the middle), or a
            point and a normal. The part on the side of the normal is not drawn.
        zoom: factor of magnification, default 1; ``"contact"`` for the contact surfaces; or the
            lower and upper corner of a box.
        cmap: name of a colour map of matplotlib.
        units: units of length and stress, for the labels, default none.
        arrows: arrows by name, each a point and a vector, such as a load or the direction of
            drag. The longest arrow of each name has the same length in the picture, and the legend
            gives its magnitude.
    """

    fields: str | Sequence[str] | Mapping[str, Any] | None
    view: ViewDirection | None
    up: ViewDirection
    clip: ViewDirection | tuple[Sequence[float], ViewDirection] | None
    zoom: float | str | Sequence[Sequence[float]]
    cmap: str
    units: tuple[str, str]
    arrows: Mapping[str, tuple[Any, Any]]


@dataclass(frozen=True)
class Options:
    """Validated entries of a `Look`.

    Attributes:
        fields: UFL scalars by name; None for the displacement and the von Mises stress.
        eye: unit vector from the body to the eye; None for the default.
        up: unit vector that points upwards in the picture.
        clip: point (None for the middle) and unit normal of a section; None without one.
        zoom: factor, ``"contact"``, or corners of a box, shape (2, 3).
        cmap: name of the colour map.
        units: units of length and stress.
        arrows: points and vectors by name, shape (2, n, 3) each.
    """

    fields: dict[str, Any]
    eye: Array | None
    up: Array
    clip: tuple[Array | None, Array] | None
    zoom: float | str | Array
    cmap: str
    units: tuple[str, str]
    arrows: dict[str, Array]


def options_of(
    dim: int,
    stressed: bool,
    *,
    fields: Any = None,
    view: Any = None,
    up: Any = "z",
    clip: Any = None,
    zoom: Any = 1.0,
    cmap: str = "Spectral_r",
    units: Any = ("", ""),
    arrows: Mapping[str, tuple[Any, Any]] | None = None,
) -> Options:
    """Validate a `Look`. Not collective.

    Args:
        dim: dimension of the body.
        stressed: True if there is a stress.
        fields: entry of `Look`, like the following arguments.
        view: see `Look`.
        up: see `Look`.
        clip: see `Look`.
        zoom: see `Look`.
        cmap: see `Look`.
        units: see `Look`.
        arrows: see `Look`.

    Raises:
        ValueError: if a value is not admissible.
    """
    if dim == 2 and not (view is None and clip is None and isinstance(up, str) and up == "z"):
        raise ValueError("view, up and clip are for bodies in 3D")
    plane = None
    if clip is not None:
        pair = not isinstance(clip, str) and len(clip) == 2
        point, normal = clip if pair else (None, clip)
        at = None if point is None else vector(point, "the point of clip", 3)
        plane = at, _direction(normal, "the normal of clip")
    return Options(
        fields=_fields(fields, stressed),
        eye=None if view is None else _direction(view, "the view", _SIDES),
        up=_direction(up, "up"),
        clip=plane,
        zoom=_zoom(zoom, dim),
        cmap=cmap,
        units=checked_units(units),
        arrows={name: _arrows(name, *arrow, dim) for name, arrow in (arrows or {}).items()},
    )


def checked_units(units: Any) -> tuple[str, str]:
    """Return units of length and stress, or raise ``ValueError``. Not collective."""
    pair = isinstance(units, tuple | list) and len(units) == 2
    if not pair or not all(isinstance(unit, str) for unit in units):
        raise ValueError(f"units must be two strings, of length and stress; got {units!r}")
    return units[0], units[1]


def _fields(fields: Any, stressed: bool) -> dict[str, Any]:
    if fields is None:
        return {"von Mises stress": None} if stressed else {}
    if isinstance(fields, Mapping):
        for name, value in fields.items():
            if not isinstance(value, ufl.core.expr.Expr) or value.ufl_shape != ():
                raise ValueError(f"fields must be UFL scalars by name, got {name!r}: {value!r}")
        return dict(fields)
    names = [fields] if isinstance(fields, str) else listed(fields, "fields")
    for name in names:
        if one_of(name, "a field", _FIELDS) == _FIELDS[1] and not stressed:
            raise ValueError("the von Mises stress needs a stress=")
    return dict.fromkeys(names)


def _direction(value: Any, name: str, names: Mapping[str, Array] | None = None) -> Array:
    """Return a unit vector."""
    if isinstance(value, str):
        known = _AXES | dict(names or {})
        return known[one_of(value, name, known)]
    v = vector(value, name, 3, zero=False)
    return np.asarray(v / np.linalg.norm(v))


def _zoom(zoom: Any, dim: int) -> float | str | Array:
    if is_number(zoom):
        return positive(zoom, "zoom")
    if isinstance(zoom, str) and zoom == "contact":
        return zoom
    box = np.array(zoom, dtype=np.float64) if not isinstance(zoom, str) else np.empty(0)
    if box.shape != (2, dim) or not (box[0] < box[1]).all():
        raise ValueError(
            f"zoom must be a factor, 'contact' or two corners of a box in {dim}D, got {zoom!r}"
        )
    return np.pad(box, ((0, 0), (0, 3 - dim)))


def _arrows(name: str, points: Any, vectors: Any, dim: int) -> Array:
    """Return points and vectors of arrows, shape (2, n, 3)."""
    pair = np.broadcast_arrays(np.atleast_2d(points), np.atleast_2d(vectors))
    arrows = np.array(pair, dtype=np.float64)
    if arrows.shape[-1] != dim or not np.isfinite(arrows).all():
        raise ValueError(f"the arrows {name!r} must be finite points and vectors in {dim}D")
    return np.pad(arrows, ((0, 0), (0, 0), (0, 3 - dim)))
