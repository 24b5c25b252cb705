# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far bodies enter what they touch: one that gives way, or one that is smaller than a facet.

Obstacles that are smaller than a facet pass between the contact points, where alone the law holds.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._mesh_mark import node_positions
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.obstacles import Cylinder, Sphere, is_uniform
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.results.tables import ContactTable

__all__ = ["Penetration", "penetrations", "warn_of_small_obstacles"]

logger = logging.getLogger(__name__)

_LARGEST = 0.1  # of the size of a facet, above which there is a warning
Array = npt.NDArray[np.float64]
_DEEPEST = 0.1  # of a facet or the radius, by which one is in the other and its corners are not


@dataclass(frozen=True)
class Penetration:
    """Of a compliant surface.

    Attributes:
        largest: a length, 0 where nothing touches.
        mean: over the area that touches, a length.
        where: position of the point with the largest (dim,).
        doubt: that it is more than a tenth of the size of a facet, or "".
    """

    largest: float
    mean: float
    where: npt.NDArray[np.float64]
    doubt: str = ""


def penetrations(eq: ContactEquations, tables: dict[str, ContactTable]) -> dict[str, Penetration]:
    """By name of the surfaces whose law is compliant. Collective."""
    found = {}
    for s in eq.surfaces:
        if not s.law.compliant:
            continue
        size = s.points.mean_width
        table = tables[s.name]
        depth = np.nan_to_num(np.maximum(-table.un, 0.0), nan=0.0)
        area = table.area[depth > 0]
        # Of points with the same depth, up to round-off, the first in the table.
        i = int(np.flatnonzero(depth >= (1 - 1e-9) * depth.max())[0])
        mean = float(depth[depth > 0] @ area / area.sum()) if len(area) else 0.0
        place = ", ".join(f"{c:.6g}" for c in table.x[i])
        doubt = (
            f"the surface gives way by {depth[i]:.3g} at ({place}), {depth[i] / size:.2g} of the "
            "size of a facet: a small stiffness of its NormalCompliance"
        )
        large = depth[i] > _LARGEST * size
        found[s.name] = Penetration(float(depth[i]), mean, table.x[i], doubt if large else "")
    return found


def warn_of_small_obstacles(eq: ContactEquations, state: Evaluation) -> None:
    """Warn of spheres and cylinders that are in a facet of the body. Collective.

    The chord of an arc is in the obstacle by h^2/(8 R): a tenth of the facet h where that is
    nearly as large as the radius R.
    """
    for s in eq.surfaces:
        round_one = _placed(s)
        if round_one is None:
            continue
        depth, size, where = _deepest(s, state.u.reshape(-1, eq.dim), *round_one)
        mine = (depth / min(size, round_one[2]), depth, size, where.tolist())
        worst = max(s.comm.allgather(mine))
        if worst[0] > _DEEPEST and s.comm.rank == 0:
            logger.warning(
                "%s: the obstacle is %.3g deep in a facet of the size %.3g at (%s), whose corners "
                "it does not touch as deep: it is too small for the mesh, and passes between the "
                "contact points, where alone the law holds; refine the face there",
                s.name,
                worst[1],
                worst[2],
                ", ".join(f"{c:.4g}" for c in worst[3]),
            )


def _placed(s: DiscreteSurface) -> tuple[Array, Array | None, float] | None:
    """Centre, axis and radius of a round obstacle as it is now; None of any other."""
    body = s.rigid_body
    shape = s.obstacle if body is None else body.shape
    if not isinstance(shape, Sphere | Cylinder):
        return None
    is_sphere = isinstance(shape, Sphere)
    at = _value(shape.centre if is_sphere else shape.point)  # type: ignore[union-attr]
    axis = None if is_sphere else _value(shape.axis)  # type: ignore[union-attr]
    radius = _value(shape.radius)
    if at is None or radius is None or (axis is None and not is_sphere):
        return None
    centre: Array = at if body is None else at + s.dragged(at[None])[0]
    return centre, axis, float(radius)


def _value(given: Any) -> Array | None:
    """Numbers, Constants or UFL of these as an array, as they are now; None of other UFL."""
    if isinstance(given, fem.Constant):
        return np.asarray(given.value, dtype=np.float64)
    if not is_uniform(given):
        return None
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _deepest(
    s: DiscreteSurface, u: Array, centre: Array, axis: Array | None, radius: float
) -> tuple[float, float, Array]:
    """The facet of this rank that is deepest for its size: depth, size, and where it is.

    A depth is that within the facet less that of its corners.
    """
    m = len(s.submesh.parent_facets)
    vertices = s.points.vertices
    x = node_positions(vertices)[:, : s.dim] + u[s.points.vertex_trace_dofs]
    corners = x[vertices.dofmap.list[:m]]
    if not len(corners):
        return 0.0, 1.0, np.zeros(s.dim)
    from_centre = corners - centre
    if axis is not None:
        unit = axis / np.linalg.norm(axis)
        from_centre = from_centre - (from_centre @ unit)[..., None] * unit
    at_corners = np.linalg.norm(from_centre, axis=2)
    inside = radius - _distances(from_centre)
    off = inside - np.maximum(radius - at_corners.min(axis=1), 0.0)
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    i = int(np.argmax(off / size))
    return float(off[i]), float(size[i]), corners[i].mean(axis=0)


def _distances(corners: Array) -> Array:
    """Distances of facets, by their corners (m, k, dim), from the origin (m,)."""
    k = corners.shape[1]
    if k == 2:
        return _of_edges(corners[:, 0], corners[:, 1])
    # Corners of quadrilaterals are in the order of tensor products.
    triangles = [(0, 1, 2)] if k == 3 else [(0, 1, 2), (1, 3, 2)]
    return np.min([_of_triangles(corners[:, list(t)]) for t in triangles], axis=0)


def _of_edges(a: Array, b: Array) -> Array:
    along = b - a
    square = np.maximum(np.sum(along**2, axis=1), 1e-300)
    part = np.clip(-np.sum(a * along, axis=1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(a + part[:, None] * along, axis=1))


def _of_triangles(corners: Array) -> Array:
    a, b, c = (corners[:, i] for i in range(3))
    edges = np.min([_of_edges(p, q) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    n = np.cross(b - a, c - a)
    double = np.linalg.norm(n, axis=1)
    flat = double <= 1e-12 * np.sum((b - a) ** 2 + (c - a) ** 2, axis=1)
    n = n / np.where(flat, 1.0, double)[:, None]
    height = np.sum(a * n, axis=1)
    foot = height[:, None] * n
    around = ((a, b), (b, c), (c, a))
    sides = [np.sum(np.cross(q - p, foot - p) * n, axis=1) >= 0 for p, q in around]
    over = np.all(sides, axis=0) & ~flat
    return np.where(over, np.abs(height), edges)
