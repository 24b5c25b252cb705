# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies, contact surfaces and obstacles of a page: geometry and recorded states."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import curves
from dolfinx_contact.explorer.packing import Arrays

__all__ = ["add_bodies"]

Cells = Ints

#: Columns of contact tables in a page, besides those of contact laws. Forces follow from tractions.
_COLUMNS = (
    *("x", "area", "un", "ut", "n", "pressure", "shear", "bound", "support", "letters", "bond"),
    "slid",
)
_COLOURED = ("pressure", "shear", "bound", "un", "ut")
_GROUP = 16  # number of states whose tables are decoded together
_CANDIDATES = 8  # number of facets that are tried for a point
_SMALL = 0.03  # motions below this fraction of the size of the body are magnified
_SHOWN = 0.1  # to at most this fraction


def add_bodies(
    arrays: Arrays, surface: Any, states: Sequence[Any], error: float
) -> tuple[dict[str, Any], list[str]]:
    """Add the bodies of a record to a page.

    Args:
        arrays: arrays of the page.
        surface: outer surface before the deformation (`Journal.surface`).
        states: states of that surface (`Journal.surface_at`), at least one.
        error: largest error of a displacement, relative to the largest displacement.

    Returns:
        Items ``body``, ``fields`` and ``surfaces`` of the page; and notes on the errors.
    """
    u = np.array([state.u for state in states])
    fields = {"displacement": _field(arrays, "displacement", "|u|", u, error)}
    strain = np.array([state.strain for state in states])[:, :, None]
    fields["strain"] = _field(arrays, "strain", "equivalent strain", strain, error)
    largest = fields["displacement"]["largest"]
    size = float(np.linalg.norm(np.ptp(surface.x, axis=0)))
    dim = u.shape[2]
    low, high = (
        np.append(v, np.zeros(3 - dim)) for v in np.transpose(fields["displacement"]["ranges"])
    )
    faces = [_face(arrays, surface, states, i, name) for i, name in enumerate(surface.contact)]
    notes = [
        "Errors of packing, relative to the largest value and measured at all vertices of all "
        f"points: displacements {100 * fields['displacement']['error']:.2g} %, strains "
        f"{100 * fields['strain']['error']:.2g} % (allowed: {100 * error:.2g} %). Contact tables "
        "are exact."
    ]
    farthest = largest
    for face in faces:
        if face["name"] in surface.obstacles:
            off, moved = _add_obstacle(arrays, surface, states, face, error * largest)
            farthest = max(farthest, moved)
            if off > error * largest:
                notes.append(f"The obstacle of {face['name']} is drawn with an error of {off:.2g}.")
    pressed = max(faces, key=lambda face: float(face["traction"]))
    body = {
        "dim": dim,
        "size": size,
        "scale": _scale(farthest, size),
        "corners": surface.cells.shape[1],
        "x": arrays.add("body.x", surface.x),
        "cells": arrays.add("body.cells", surface.cells.astype(np.int32)),
        "bounds": np.transpose([surface.x.min(axis=0), surface.x.max(axis=0), low, high]).tolist(),
        "start": pressed["pressed"],
    }
    return {"body": body, "fields": fields, "surfaces": faces}, notes


def _field(
    arrays: Arrays, name: str, label: str, values: npt.NDArray[Any], error: float
) -> dict[str, Any]:
    """Add a field of shape (states, vertices, components) and return its description.

    Raises:
        ValueError: if a value is not finite.
    """
    if not np.isfinite(values).all():
        raise ValueError(f"the {name} of the record has values that are not finite")
    largest = float(np.linalg.norm(values, axis=2).max(initial=0.0))
    field = arrays.add_field(name, values, error * largest)
    field["error"] /= largest or 1.0
    ends = [values.min(axis=(0, 1), initial=0.0), values.max(axis=(0, 1), initial=0.0)]
    return field | {"largest": largest, "label": label, "ranges": np.transpose(ends).tolist()}


def _scale(largest: float, size: float) -> float:
    """Return a factor that makes small displacements visible: 1, 2 or 5 times a power of 10."""
    if largest <= 0 or largest >= _SMALL * size:
        return 1.0
    most = _SHOWN * size / largest
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(power * digit for digit in (1, 2, 5) if power * digit <= most))


# -- contact faces -----------------------------------------------------------------------------


def _face(
    arrays: Arrays, surface: Any, states: Sequence[Any], number: int, name: str
) -> dict[str, Any]:
    """Add a contact face, with its contact tables in all states, and return its description."""
    facets = surface.contact[name]
    key = f"face.{number}"
    x = states[0].tables[name]["x"]
    points = np.pad(x, ((0, 0), (0, 3 - x.shape[1])))
    on_facet, weights = _closest(surface.x[facets], points)
    # Each corner of a facet is drawn in the colour of the contact point nearest to it.
    corners = surface.x[facets]
    parts = 0.6 * corners + 0.4 * corners.mean(axis=1, keepdims=True)
    nearest = cKDTree(points).query(parts)[1] if len(points) else np.zeros_like(facets)
    place = np.zeros(len(points))
    if facets.shape[1] == 2 and len(points):
        place = (weights * _distances(surface.x, facets)[on_facet]).sum(axis=1)
    face = {
        "name": name,
        "points": len(points),
        "corners": facets.shape[1],
        "cells": arrays.add(f"{key}.cells", facets.astype(np.int32)),
        "anchors": arrays.add(f"{key}.anchors", facets[on_facet].astype(np.int32)),
        "weights": arrays.add(f"{key}.weights", weights.astype(np.float32)),
        "nearest_points": arrays.add(f"{key}.nearest", nearest.astype(np.int32)),
        "place": arrays.add(f"{key}.place", place),
        "obstacle": None,
    }
    return face | _tables(arrays, states, name, key)


def _closest(corners: Array, points: Array) -> tuple[Cells, Array]:
    """Find the closest facet to each point, and the closest point on this facet.

    Args:
        corners: corners of m facets, k per facet, shape (m, k, 3).
        points: points, shape (n, 3).

    Returns:
        Indices of the facets, shape (n,); and nonnegative barycentric weights of their corners at
        the closest points, shape (n, k).
    """
    count = min(_CANDIDATES, len(corners))
    candidates = cKDTree(corners.mean(axis=1)).query(points, range(1, count + 1))[1].reshape(-1)
    own = np.repeat(np.arange(len(points)), count)
    facets = corners[candidates]
    best = np.full(len(own), np.inf)
    weights = np.zeros(facets.shape[:2])
    k = facets.shape[1]
    # The closest point lies inside a triangle, on an edge or at a corner.
    for chosen in (c for n in range(1, min(k, 3) + 1) for c in combinations(range(k), n)):
        origin = facets[:, chosen[0]]
        edges = facets[:, chosen[1:]] - origin[:, None]
        inner = np.einsum("nij,nj->ni", np.linalg.pinv(edges.swapaxes(1, 2)), points[own] - origin)
        trial = np.column_stack([1 - inner.sum(axis=1), inner])
        place = origin + np.einsum("ni,nij->nj", inner, edges)
        distance = np.linalg.norm(place - points[own], axis=1)
        better = (trial.min(axis=1) >= -1e-12) & (distance < best)
        best[better] = distance[better]
        weights[better] = 0.0
        weights[np.ix_(better, chosen)] = trial[better]
    choice = np.arange(len(points)) * count + best.reshape(-1, count).argmin(axis=1)
    return candidates[choice], weights[choice]


def _distances(x: Array, facets: Cells) -> Array:
    """Return the arc lengths at both ends of the f edges of a 2D surface, shape (f, 2).

    The arc length continues from one connected part of the surface to the next.
    """
    distances = np.zeros(facets.shape)
    begin = 0.0
    for numbers, vertices in curves(facets):
        # begin at the end with the smaller coordinates
        if tuple(x[vertices[-1]]) < tuple(x[vertices[0]]):
            numbers, vertices = numbers[::-1], vertices[::-1]
        lengths = np.linalg.norm(np.diff(x[vertices], axis=0), axis=1)
        at = begin + np.cumsum([0.0, *lengths])
        forward = facets[numbers, 0] == vertices[:-1]
        distances[numbers, 0] = np.where(forward, at[:-1], at[1:])
        distances[numbers, 1] = np.where(forward, at[1:], at[:-1])
        begin = at[-1]
    return distances


def _tables(arrays: Arrays, states: Sequence[Any], name: str, key: str) -> dict[str, Any]:
    """Add the contact tables of a surface at all states, in groups; describe the groups."""
    first = states[0].tables[name]
    columns: dict[str, npt.NDArray[Any]] = {}
    for column in first:
        if column in _COLUMNS or column.startswith("internal."):
            values = np.array([state.tables[name][column] for state in states])
            if values.dtype.kind == "U":  # letters
                values = np.vectorize(ord, otypes=[np.uint8])(values)
            columns[column] = values
    groups = []
    for start in range(0, len(states) if len(first["x"]) else 0, _GROUP):
        stored = {
            column: arrays.add(f"{key}.{start}.{column}", values[start : start + _GROUP], xor=True)
            for column, values in columns.items()
        }
        groups.append({"first": start, "arrays": stored})
    lengths = {c: np.linalg.norm(v, axis=2) if v.ndim > 2 else v for c, v in columns.items()}
    # The friction bound of records is a force; the page shows it as a traction.
    area = columns["area"]
    lengths["bound"] = np.divide(lengths["bound"], area, out=np.zeros_like(area), where=area > 0)
    names = [*_COLOURED, *(c for c in columns if c == "slid" or c.startswith("internal."))]
    ranges = {}
    for column in names:
        finite = lengths[column][np.isfinite(lengths[column])]
        ranges[column] = [float(finite.min(initial=0.0)), float(finite.max(initial=0.0))]
    traction_at_points = np.hypot(lengths["shear"], lengths["pressure"])
    traction = traction_at_points.max(axis=1, initial=0.0)
    return {
        "groups": groups,
        "components": {c: v.shape[2] if v.ndim > 2 else 1 for c, v in columns.items()},
        "ranges": ranges,
        "traction": float(traction.max(initial=0.0)),
        "force": float((traction_at_points * area).max(initial=0.0)),
        "pressed": int(traction.argmax()) if traction.any() else len(states) - 1,
    }


# -- obstacles ---------------------------------------------------------------------------------


def _add_obstacle(
    arrays: Arrays, surface: Any, states: Sequence[Any], face: dict[str, Any], allowed: float
) -> tuple[float, float]:
    """Add the obstacle of a contact surface to a page.

    The page stores the vectors from points of the undeformed face to the vertices of the obstacle.
    They are magnified like displacements, so that a closed gap stays closed. In the first state
    they are stored exactly; later changes are compressed. An obstacle given by the points opposite
    to the face has one vertex per vertex of the face. A `RigidSurface` has vertices of its own, and
    their vectors start at the closest points of the face.

    Returns:
        Largest error of a vertex position; and largest displacement of a vertex since the first
        state.
    """
    name = face["name"]
    facets = surface.contact[name]
    places = np.array([np.sum(state.obstacles[name][:2], axis=0) for state in states])
    vertices = np.pad(places[0], ((0, 0), (0, 3 - places.shape[2])))
    nodes = np.unique(facets)
    opposite = surface.obstacles[name].shape == facets.shape and len(vertices) == len(nodes)
    if opposite:
        start = surface.x[nodes]
    else:
        on_facet, weights = _closest(surface.x[facets], np.nan_to_num(vertices))
        start = np.einsum("ni,nij->nj", weights, surface.x[facets[on_facet]])
    vectors = places - start[:, : places.shape[2]]
    # A vertex that is not finite at some state is not drawn.
    first = np.where(np.isfinite(vectors).all(axis=0), vectors[0], np.nan)
    changes = np.nan_to_num(vectors - first)
    key = f"obstacle.{name}"
    field = arrays.add_field(f"{key}.field", changes, allowed)
    face["obstacle"] = {
        "corners": surface.obstacles[name].shape[1],
        "opposite": opposite,
        "x": arrays.add(f"{key}.x", start),
        "cells": arrays.add(f"{key}.cells", surface.obstacles[name].astype(np.int32)),
        "way": arrays.add(f"{key}.way", first),
        "field": field,
    }
    return float(field["error"]), float(np.linalg.norm(changes, axis=2).max(initial=0.0))
