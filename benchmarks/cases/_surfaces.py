# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of facets that demos and tests press into bodies, and STL files of them."""

import numpy as np
from scipy.spatial import ConvexHull

__all__ = ["ball", "brick", "cylinder", "disc", "write_stl"]


def disc(n, radius=1.0, centre=(0.0, 0.0), start=0.0):
    """Points and segments of a circle, counter-clockwise."""
    angle = start + 2 * np.pi * np.arange(n) / n
    points = np.array(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points, np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1)


def outward(points, cells):
    """Triangles of a convex surface, turned outward."""
    corners = points[cells]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ki,ki->k", n, corners.mean(axis=1) - points.mean(axis=0)) < 0
    cells = cells.copy()
    cells[inward] = cells[inward][:, ::-1]
    return cells


def ball(cuts, radius=1.0, centre=(0.0, 0.0, 0.0)):
    """Points and triangles of a sphere: an icosahedron with its edges cut into ``cuts`` parts."""
    golden = (1 + 5**0.5) / 2
    points = np.array([[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)])
    points = np.concatenate([np.roll(points, k, axis=1) for k in range(3)])
    faces = ConvexHull(points).simplices
    found = []
    for a, b, c in points[faces]:
        for i in range(cuts + 1):
            for j in range(cuts + 1 - i):
                found.append((a * i + b * j + c * (cuts - i - j)) / cuts)
    found = np.array(found)
    found /= np.linalg.norm(found, axis=1)[:, None]
    found = found[np.unique(np.round(found, 9), axis=0, return_index=True)[1]]
    cells = outward(found, ConvexHull(found).simplices)
    return np.array(centre) + radius * found, cells


def cylinder(n, radius=1.0, length=4.0, centre=(0.0, 0.0, 0.0)):
    """Points and triangles of a closed cylinder along y."""
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([radius * np.sin(angle), np.zeros(n), radius * np.cos(angle)], axis=1)
    shift = np.array([0.0, length / 2, 0.0])
    points = np.concatenate([ring - shift, ring + shift, [-shift, shift]])
    k, m = np.arange(n), (np.arange(n) + 1) % n
    sides = [np.stack([k, m, n + m], axis=1), np.stack([k, n + m, n + k], axis=1)]
    caps = [np.stack([np.full(n, 2 * n + i), i * n + k, i * n + m], axis=1) for i in (0, 1)]
    return points + np.array(centre), outward(points, np.concatenate([*sides, *caps]))


def brick(low, high):
    """Points and facets of a rectangle or box."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    if len(low) == 2:
        points = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (high - low) + low
        return points, np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    unit = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
    points = unit * (high - low) + low
    squares = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    cells = np.array([t for a, b, c, d in squares for t in ((a, b, c), (a, c, d))])
    return points, outward(points, cells)


def write_stl(path, points, cells, *, binary=True):
    """An STL file."""
    corners = points[cells]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
    if binary:
        kind = np.dtype([("n", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
        facets = np.zeros(len(cells), kind)
        facets["n"] = n
        facets["corners"] = corners
        head = b"binary".ljust(80) + np.uint32(len(cells)).tobytes()
        path.write_bytes(head + facets.tobytes())
        return
    lines = ["solid tool"]
    for one, normal in zip(corners, n, strict=True):
        lines += ["facet normal " + " ".join(map(repr, normal.tolist())), "outer loop"]
        lines += ["vertex " + " ".join(map(repr, v.tolist())) for v in one]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid tool"]))
