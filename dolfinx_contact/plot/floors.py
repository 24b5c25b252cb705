# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where obstacles are drawn: a plane under the body as it is, and bodies drawn apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dolfinx_contact.io.outside import OuterSurface

__all__ = ["floor_below", "lay_floors", "moved_apart", "on_plane", "parts_of"]

Array = npt.NDArray[np.float64]
_FLAT = 1e-9  # by which the normals of a plane may differ, and of its length a line may bend
_OVER = 0.05  # of the size of the body, by which a floor is at least larger than what is on it
_FACING = 0.2  # mean of the normals of a face that is seen from one side


def on_plane(floor: Array, normals: Array, x: Array) -> Array | None:
    """Points ``x`` on the plane of an obstacle, None of one that is curved.

    Args:
        floor: points of the obstacle (m, 3).
        normals: there, into the obstacle (m, 3).
        x: points of the body as it is drawn (k, 3).
    """
    if not len(floor) or np.ptp(normals, axis=0).max() > _FLAT:
        return None
    n = normals[0] / np.linalg.norm(normals[0])
    return np.asarray(x - np.outer((x - floor[0]) @ n, n))


def floor_below(floor: Array, x: Array) -> Array:
    """Points of a floor; a straight one reaches below all of ``x``, as where a point slipped off.

    Args:
        floor: its points (m, 2), in order.
        x: points of the body as it is drawn (k, 2).
    """
    if len(floor) < 2 or not len(x):
        return floor
    chord = floor[-1] - floor[0]
    length = float(np.linalg.norm(chord))
    across = np.array([-chord[1], chord[0]])
    if length == 0 or np.abs((floor - floor[0]) @ across).max() > _FLAT * length**2:
        return floor
    along = np.concatenate([floor, x]) - floor[0]
    parts = along @ chord / length**2
    return np.asarray(floor[0] + np.outer([parts.min(), parts.max()], chord))


def lay_floors(frames: Sequence[dict[str, Any]], dim: int) -> None:
    """Make plane obstacles of frames pieces of their planes that reach under the body in all.

    Args:
        frames: what is drawn; their ``obstacle_x`` of planes are points on these.
        dim: of the body.
    """
    if not frames or "x" not in frames[0]:
        return
    size = max(float(np.linalg.norm(np.ptp(frame["x"], axis=0))) for frame in frames)
    for i in range(len(frames[0]["obstacle_x"])):
        if not all(frame["obstacle_flat"][i] for frame in frames):
            continue
        every = np.concatenate([frame["obstacle_x"][i] for frame in frames])
        for frame in frames:
            n = frame["obstacle_normals"][i][0]
            n = n / np.linalg.norm(n)
            base = frame["obstacle_x"][i][0]
            points = every - np.outer((every - base) @ n, n)
            corners = _rectangle(points, n, size, dim)
            frame["obstacle_x"][i] = corners
            frame["obstacle_cells"][i] = np.array([[0, 1] if dim == 2 else [0, 1, 3, 2]])
            frame["obstacle_normals"][i] = np.tile(n, (len(corners), 1))


def _rectangle(points: Array, n: Array, size: float, dim: int) -> Array:
    """Corners, in order around it, of a piece of a plane that has points on it; in 2D its ends."""
    axes = _axes(points, n, dim)
    along = points @ axes.T
    low = along.min(axis=0)
    high = along.max(axis=0)
    rim = max((0.1 if dim == 2 else 0.2) * float((high - low).min()), _OVER * size)
    off = (points[0] @ n) * n
    if dim == 2:
        ends = np.array([low - rim, high + rim])
        return np.asarray(ends @ axes + off)
    (a, b), (c, d) = low - rim, high + rim
    return np.asarray(np.array([[a, b], [c, b], [c, d], [a, d]]) @ axes + off)


def _axes(points: Array, n: Array, dim: int) -> Array:
    """Unit vectors of a plane, those of coordinates where it is across one, (dim - 1, 3)."""
    if dim == 2:
        return np.array([[-n[1], n[0], 0.0]])
    nearest = int(np.argmax(np.abs(n)))
    if abs(n[nearest]) > 1 - _FLAT:
        return np.delete(np.eye(3), nearest, axis=0)
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][:2]
    first = axes[0] - (axes[0] @ n) * n
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(n, first)])


def parts_of(cells: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    """Numbers of the connected parts of cells at their vertices (count,)."""
    first = np.repeat(cells[:, :1], cells.shape[1], axis=1).ravel()
    links = coo_array((np.ones(first.size), (first, cells.ravel())), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def moved_apart(
    surface: OuterSurface, x: Array, normals: Mapping[str, Array], apart: float
) -> tuple[Array, dict[str, Array]]:
    """How far the vertices of bodies, and obstacles, are moved to be drawn apart.

    A slave is moved off its master, an obstacle off its body, across their faces; along an axis
    where a face surrounds the other.

    Args:
        surface: of the bodies.
        x: where their vertices are drawn (n, 3).
        normals: of obstacles, by the names of their surfaces (m, 3).
        apart: the distance over the size of all.

    Returns:
        Of the vertices (n, 3), and of obstacles by the names of their surfaces (3,).
    """
    part = parts_of(surface.cells, len(x))
    distance = apart * float(np.linalg.norm(np.ptp(x, axis=0)))
    flat = bool(np.ptp(x[:, 2]) == 0)
    shift: dict[int, Array] = {int(k): np.zeros(3) for k in np.unique(part)}
    pairs: list[tuple[int, int, Array]] = []
    for name, cells in surface.opposite.items():
        slave, master = (int(part[c.ravel()[0]]) for c in (surface.contact[name], cells))
        if slave != master:
            centre = x[part == slave].mean(axis=0)
            pairs.append((slave, master, _across(x, surface.contact[name], centre, flat)))
    for slave, master, n in pairs:
        # What is already held together with the slave goes with it.
        moved = -distance * n + shift[master] - shift[slave]
        joined = _joined(slave, master, pairs)
        for k in joined:
            shift[k] = shift[k] + moved
    offsets = np.array([shift[int(k)] for k in part]).reshape(-1, 3)
    of_obstacles = {}
    for name, n in normals.items():
        mean = n.mean(axis=0) if len(n) else np.zeros(3)
        facing = float(np.linalg.norm(mean)) > _FACING
        n = mean / np.linalg.norm(mean) if facing else _axis(flat)
        cells = surface.contact[name]
        own = shift[int(part[cells.ravel()[0]])] if cells.size else np.zeros(3)
        of_obstacles[name] = own + distance * n
    return offsets, of_obstacles


def _joined(slave: int, master: int, pairs: Sequence[tuple[int, int, Array]]) -> set[int]:
    """Parts that touch the slave other than through its master."""
    found = {slave}
    grows = True
    while grows:
        more = {
            k for a, b, _ in pairs for k in (a, b) if ({a, b} & found) and k not in (*found, master)
        }
        grows = bool(more)
        found |= more
    return found


def _across(x: Array, cells: npt.NDArray[np.int64], centre: Array, flat: bool) -> Array:
    """Unit vector out of a face of a body, or an axis where the face goes around it."""
    corners = x[cells]
    edge = corners[:, 1] - corners[:, 0]
    n = np.cross(edge, np.eye(3)[2]) if flat else np.cross(edge, corners[:, 2] - corners[:, 0])
    outward = np.sign(np.sum(n * (corners.mean(axis=1) - centre), axis=1))
    total = float(np.linalg.norm(n, axis=1).sum())
    mean = (outward[:, None] * n).sum(axis=0) / total
    size = float(np.linalg.norm(mean))
    return np.asarray(mean / size) if size > _FACING else _axis(flat)


def _axis(flat: bool) -> Array:
    """Along which bodies are drawn apart that surround each other."""
    return np.eye(3)[0 if flat else 2]
