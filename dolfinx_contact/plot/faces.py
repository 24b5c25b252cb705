# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact faces laid flat: curves by their length, surfaces as seen from where they touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import area_vectors, unit
from dolfinx_contact.plot.floors import parts_of

__all__ = ["along_curve", "flat_axes", "is_straight", "near_contact", "spacing_of", "turned_to"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]
Marks = npt.NDArray[np.bool_]

_STRAIGHT = 0.05  # sine of the angles between edges of a straight face
_MOST = 0.7  # of a face, from which on all of it is shown
_RIM = 0.25  # of what touches, which is shown beside it
_BETWEEN = 0.05  # of a curve, after which the next one begins
_SEEN = 0.1  # of a normal towards the eye, from which on a cell is seen


def is_straight(x: Array, cells: Cells) -> bool:
    """Whether the edges (k, 2) of a face in 2D are nearly parallel."""
    edges = x[cells[:, 1]] - x[cells[:, 0]]
    edges = edges / np.linalg.norm(edges, axis=1)[:, None]
    return bool(np.abs(edges[:, 0] * edges[0, 1] - edges[:, 1] * edges[0, 0]).max() < _STRAIGHT)


def flat_axes(n: Array, dim: int) -> tuple[Array, list[str]]:
    """Axes (dim, dim - 1) of the plane across ``n`` with labels: coordinate axes if nearly one."""
    size = np.linalg.norm(n)
    names = "xyz"[:dim]
    n = n / size if size > 0.1 else np.eye(dim)[-1]  # a closed surface has no side to be seen from
    across = np.abs(n) < 0.05
    if across.sum() == dim - 1:
        return np.eye(dim)[:, across], [name for name, a in zip(names, across, strict=True) if a]
    if dim == 2:
        return np.array([[-n[1]], [n[0]]]), ["position along the surface"]
    first = np.eye(3)[np.argmin(np.abs(n))]
    first = first - (first @ n) * n
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(first, n)], axis=1), ["along the surface", "across"]


def along_curve(x: Array, cells: Cells, n: Array, touching: Marks) -> tuple[Array, Array, str]:
    """Lengths along the curves of a face in 2D, one after the other.

    They grow along t = (-n_y, n_x), from an end of the curve, or, where it is closed, from the
    middle of what touches; it is cut where that is far.

    Args:
        x: vertices (m, 2).
        cells: edges (k, 2).
        n: normals into the obstacle at the vertices (m, 2).
        touching: of the vertices.

    Returns:
        Lengths at the vertices (m,), at both ends of each edge (k, 2), and what they are.
    """
    at_vertices = np.zeros(len(x))
    at_ends = np.zeros(cells.shape)
    begin = 0.0
    from_contact = False
    for path in _paths(cells):
        edges, nodes = _along_t(path, cells, x, n, touching)
        is_closed = nodes[0] == nodes[-1]
        if is_closed:
            shift = _cut(touching[nodes[:-1]])
            edges = np.roll(edges, -shift)
            nodes = np.append(np.roll(nodes[:-1], -shift), nodes[shift])
        lengths = np.linalg.norm(np.diff(x[nodes], axis=0), axis=1)
        ends = begin + np.concatenate([[0.0], np.cumsum(lengths)])
        touches = ends[touching[nodes]]
        centred = bool(is_closed) and 0 < len(touches) < len(nodes)
        if centred:
            ends = ends - (touches[0] + touches[-1]) / 2
        forward = cells[edges, 0] == nodes[:-1]
        at_ends[edges, np.where(forward, 0, 1)] = ends[:-1]
        at_ends[edges, np.where(forward, 1, 0)] = ends[1:]
        at_vertices[nodes[::-1]] = ends[::-1]
        from_contact |= centred
        begin = float(ends[-1]) + _BETWEEN * float(lengths.sum())
    words = "length along the surface"
    return at_vertices, at_ends, f"{words}, from the middle of contact" if from_contact else words


def _along_t(
    path: Sequence[int], cells: Cells, x: Array, n: Array, touching: Marks
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Edges of a path and its vertices, one more, in the direction of t where it touches."""
    edges = np.array(path, dtype=np.int64)
    first, second = cells[edges[0]]
    turns = len(edges) > 1 and first in cells[edges[1]] and second not in cells[edges[1]]
    nodes = [int(second), int(first)] if turns else [int(first), int(second)]
    for e in edges[1:]:
        a, b = (int(v) for v in cells[e])
        nodes.append(b if a == nodes[-1] else a)
    order = np.array(nodes)
    t = np.stack([-n[order[:-1], 1], n[order[:-1], 0]], axis=1)
    ahead = np.sum(np.diff(x[order], axis=0) * t, axis=1)
    touches = touching[order[:-1]]
    if np.sum(ahead[touches] if touches.any() else ahead) < 0:
        return edges[::-1], order[::-1]
    return edges, order


def _cut(touching: Marks) -> int:
    """Number of the vertex of a closed curve that is farthest from those that touch."""
    count = len(touching)
    marked = np.flatnonzero(touching)
    if not len(marked):
        return 0
    after = np.append(marked[1:], marked[0] + count)
    k = int(np.argmax(after - marked))
    return int((marked[k] + after[k]) // 2 % count)


def _paths(cells: Cells) -> list[list[int]]:
    """Numbers of edges one after the other.

    Paths begin at ends and forks; what is left is closed.
    """
    at: dict[int, list[tuple[int, int]]] = {}
    for e in range(len(cells)):
        for side in (0, 1):
            at.setdefault(int(cells[e, side]), []).append((e, side))
    left = set(range(len(cells)))
    starts = [node for node, edges in sorted(at.items()) if len(edges) != 2]
    found: list[list[int]] = []
    for node in [*starts, *sorted(at)]:
        while any(e in left for e, _ in at[node]):
            path: list[int] = []
            here = node
            while True:
                free = [(e, side) for e, side in at[here] if e in left]
                if not free or (path and len(at[here]) != 2):
                    break
                e, side = free[0]
                left.discard(e)
                path.append(e)
                here = int(cells[e, 1 - side])
            found.append(path)
    return found


def turned_to(x: Array, cells: Cells, n: Array, touching: Marks) -> tuple[Array, Cells]:
    """The direction from which a surface is seen best where it touches, and the cells seen so.

    Args:
        x: vertices (m, 3).
        cells: of the surface (k, vertices of each).
        n: normals into the obstacle at the vertices (m, 3).
        touching: of the vertices.
    """
    normals = unit(area_vectors(x[cells[:, :3]]))
    at_cells = n[cells].mean(axis=1)
    normals = np.where(np.sum(normals * at_cells, axis=1)[:, None] < 0, -normals, normals)
    touches = touching[cells].any(axis=1)
    mean = normals[touches].mean(axis=0) if touches.any() else normals.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if size < _SEEN:
        return mean, cells
    # What lies behind has the same directions: it is not joined with what touches.
    seen = np.flatnonzero(np.abs(normals @ (mean / size)) > _SEEN)
    part = parts_of(cells[seen], len(x))
    chosen = np.isin(part, part[touching]) if touches.any() else np.ones(len(x), dtype=bool)
    kept = cells[seen][chosen[cells[seen][:, 0]]]
    return mean, kept if len(kept) else cells


def near_contact(x: Array, touching: Marks, spacing: float) -> tuple[float, float] | None:
    """Ends of what is shown of positions (m,), None for all of them: what touches, with a rim."""
    if not touching.any():
        return None
    low, high = float(x[touching].min()), float(x[touching].max())
    rim = max(_RIM * (high - low), 2.0 * spacing)
    if high - low + 2 * rim > _MOST * float(np.ptp(x)):
        return None
    return max(low - rim, float(x.min())), min(high + rim, float(x.max()))


def spacing_of(x: Array, cells: Cells) -> float:
    """Mean length of an edge of cells, from the first to the second vertex."""
    return float(np.linalg.norm(x[cells[:, 1]] - x[cells[:, 0]], axis=1).mean())
