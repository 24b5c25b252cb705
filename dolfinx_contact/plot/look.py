# SPDX-License-Identifier: LGPL-3.0-or-later
"""How bodies are shown: side, section, part, colours; what users give, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias, TypedDict

import numpy as np

import ufl

from dolfinx_contact._optional import optional
from dolfinx_contact._validate import is_number, nonnegative, number, one_of, positive, vector

__all__ = ["Fields", "Heading", "Look", "checked_look", "checked_scale", "checked_units"]

#: An axis by its name, with a sign, or a vector.
Heading: TypeAlias = str | Sequence[float]
#: What colours a body: names, or UFL scalars by their names.
Fields: TypeAlias = str | Sequence[str] | Mapping[str, Any]

#: From where a body is seen: where the eye is.
_SIDES = {
    **{"front": (0.0, -1.0, 0.0), "back": (0.0, 1.0, 0.0), "left": (-1.0, 0.0, 0.0)},
    **{"right": (1.0, 0.0, 0.0), "above": (0.0, 0.0, 1.0), "below": (0.0, 0.0, -1.0)},
}
_KNOWN = ("displacement", "von Mises stress")


class Look(TypedDict, total=False):
    """How a body is drawn.

    Attributes:
        fields: what colours it, panel by panel: ``"displacement"`` (its size), ``"von Mises
            stress"`` (which needs ``stress``), several of these, or UFL scalars by names of their
            own, of which those that jump are averaged at the vertices; grey where they are not
            finite. By default the stress if there is one, else nothing.
        view: in 3D where the eye is: ``"front"`` (at -y), ``"back"``, ``"left"``, ``"right"``,
            ``"above"``, ``"below"``, or a vector from the body to the eye.
        up: in 3D the direction that is drawn upwards: ``"z"`` by default, or ``"-z"``, ``"x"``,
            ... or a vector.
        clip: in 3D a plane at which the body is cut open: ``"x"``, ``"-y"``, ..., through the
            middle, or a point and a normal. What lies on the side of the normal is not drawn, and
            unless there is a ``view`` the eye is there. Of a record, which has the surface of the
            body alone, the cut is open.
        zoom: by how much the middle of the picture is enlarged; ``"contact"`` for the contact
            surfaces; or two opposite corners of a box that is to be seen. With nothing of the body
            in it there is no picture, and a warning.
        cmap: colours, a name that matplotlib has.
        apart: by how much of their size bodies of a pair, and obstacles, are drawn apart.
        units: of length and stress, for the labels.
    """

    fields: Fields | None
    view: Heading | None
    up: Heading
    clip: Heading | tuple[Sequence[float], Sequence[float]] | None
    zoom: float | str | Sequence[Sequence[float]]
    cmap: str | None
    apart: float
    units: tuple[str, str]


def checked_scale(scale: Any) -> float:
    """The factor of a displacement as a number, or ``ValueError``. Not collective."""
    return number(scale, "the scale of the displacement")


def checked_look(look: Mapping[str, Any], dim: int, *, stress: bool) -> dict[str, Any]:
    """A look as `render.py` has it, with all its entries, or ``ValueError``. Not collective.

    Args:
        look: entries of `Look`.
        dim: of the body.
        stress: whether there is one.

    Returns:
        The entries; of ``fields`` a dictionary whose values are UFL or None, directions and boxes
        as lists.
    """
    for name, value in look.items():
        one_of(name, "a look", list(Look.__annotations__))
        if dim == 2 and name in ("view", "up", "clip") and value is not None:
            raise ValueError(f"a body in 2D has no {name}")
    view, up, clip = (look.get(name) for name in ("view", "up", "clip"))
    cmap = look.get("cmap")
    if cmap is not None:
        known = optional("matplotlib", "pictures").colormaps
        if cmap not in list(known):
            raise ValueError(f"cmap must be a name of colours that matplotlib has, got {cmap!r}")
    return {
        "fields": _fields(look.get("fields"), stress),
        "view": None if view is None else _direction(view, "the view", _SIDES),
        "up": _direction("z" if up is None else up, "up"),
        "clip": None if clip is None else _plane(clip),
        "zoom": _zoom(look.get("zoom", 1.0), dim),
        "cmap": cmap,
        "apart": nonnegative(look.get("apart", 0.0), "apart"),
        "units": checked_units(look.get("units", ("", ""))),
    }


def checked_units(units: Any) -> tuple[str, str]:
    """Units of length and stress, or ``ValueError``. Not collective."""
    known = isinstance(units, tuple | list) and len(units) == 2
    if not known or not all(isinstance(unit, str) for unit in units):
        raise ValueError(f"units must be those of length and stress, two str, got {units!r}")
    return units[0], units[1]


def _fields(fields: Any, stress: bool) -> dict[str, Any]:
    if fields is None:
        return {"von Mises stress": None} if stress else {}
    if isinstance(fields, Mapping):
        for name, value in fields.items():
            scalar = isinstance(value, ufl.core.expr.Expr) and value.ufl_shape == ()
            if not isinstance(name, str) or not scalar:
                raise ValueError(f"fields must be UFL scalars by names, got {name!r}: {value!r}")
        return dict(fields)
    names = [fields] if isinstance(fields, str) else fields
    if not isinstance(names, Iterable) or not (names := list(names)):
        raise ValueError(f"fields must be names, or UFL scalars by names, got {fields!r}")
    for name in names:
        if name not in _KNOWN:
            raise ValueError(f"no field is named {name!r}: {', '.join(_KNOWN)} are; or give UFL")
        if name == _KNOWN[1] and not stress:
            raise ValueError("the von Mises stress needs a stress=")
    return dict.fromkeys(names)


def _direction(
    value: Any, what: str, names: Mapping[str, Sequence[float]] | None = None
) -> list[float]:
    """A unit vector."""
    axes = {
        sign + name: s * e
        for name, e in zip("xyz", np.eye(3), strict=True)
        for sign, s in (("", 1.0), ("-", -1.0))
    }
    known: dict[str, Any] = axes | dict(names or {})
    if isinstance(value, str):
        return [float(c) + 0.0 for c in known[one_of(value, what, known)]]
    found = vector(value, what, 3, zero=False)
    return [float(c) for c in found / np.linalg.norm(found)]


def _plane(clip: Any) -> dict[str, list[float] | None]:
    """Point (None for the middle) and normal of a section."""
    if isinstance(clip, str):
        return {"point": None, "normal": _direction(clip, "clip")}
    if isinstance(clip, Sequence | np.ndarray) and len(clip) == 2:
        point = vector(clip[0], "the point of clip", 3)
        return {
            "point": [float(c) for c in point],
            "normal": _direction(clip[1], "the normal of clip"),
        }
    return {"point": None, "normal": _direction(clip, "clip")}


def _zoom(zoom: Any, dim: int) -> float | str | list[list[float]]:
    if is_number(zoom):
        return positive(zoom, "the factor of zoom")
    if isinstance(zoom, str) and zoom == "contact":
        return zoom
    try:
        box = np.array(zoom, dtype=np.float64)
    except (TypeError, ValueError):
        box = np.empty(0)
    if box.shape != (2, dim) or not np.isfinite(box).all() or not (box[0] < box[1]).all():
        raise ValueError(
            "zoom must be a factor, 'contact' or the least and largest coordinates of a box in "
            f"{dim}D, got {zoom!r}"
        )
    corners = np.pad(box, ((0, 0), (0, 3 - dim)))
    return [[float(c) for c in corner] for corner in corners]
