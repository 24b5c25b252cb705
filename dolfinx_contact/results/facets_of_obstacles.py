# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a body passes of an obstacle with facets of its own: corners between contact points, rims.

The law holds at contact points. A corner of the obstacle that is between them is in a facet of the
body by a depth that is measured here; where edges cross inside facets and no corner is there,
nothing is seen.
"""

from __future__ import annotations

import logging

import numpy as np
import numpy.typing as npt

from dolfinx_contact.points.surface import ContactSurface
from dolfinx_contact.points.trace import facet_normals
from dolfinx_contact.rigid_surfaces import RigidSurface
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets

__all__ = ["warn_of_facets"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_DEEPEST = 0.1  # of a facet of the body, by which a corner is in it
_ACROSS = 0.9  # cosine with the normal of the facet, above which a corner is below it
_NEAR = 1.0  # facets of the body, beyond which a corner is on the other side of the body


def warn_of_facets(s: ContactSurface, u: Array) -> None:
    """Warn of corners of an obstacle in facets of the body, and of points past a rim. Collective.

    Args:
        s: its obstacle, or the shape of that, is a `RigidSurface`.
        u: displacement of the local nodes (n, dim).
    """
    body = s.rigid_body
    shape = s.obstacle if body is None else body.shape
    assert isinstance(shape, RigidSurface)
    depth, size, corner = _deepest(s, shape, u)
    worst = max(s.comm.allgather((depth / size, depth, size, corner.tolist())))
    if worst[0] > _DEEPEST and s.comm.rank == 0:
        logger.warning(
            "%s: a corner of %s is %.3g deep in a facet of the size %.3g at (%s): the law holds at "
            "contact points alone, and the corner is between them; refine the face there, or take "
            "the integral method",
            s.name,
            shape.name,
            worst[1],
            worst[2],
            ", ".join(f"{c:.4g}" for c in worst[3]),
        )
    if shape.closed:
        return
    n = s.points.vertices.dofmap.index_map.size_local
    nodes = s.points.vertex_trace_dofs[:n]
    motion = None if body is None else body.values
    x = s.node_positions
    seen = (x + s.relative(u[: len(x)], motion))[nodes]
    past = s.comm.allreduce(int(shape.distances(seen).past.sum()))
    if past and s.comm.rank == 0:
        logger.warning(
            "%s: %d nodes of the face are past the rim of %s and behind it, where it has no "
            "contact: an open surface ends at its rim",
            s.name,
            past,
            shape.name,
        )


def _deepest(s: ContactSurface, shape: RigidSurface, u: Array) -> tuple[float, float, Array]:
    """The corner that is deepest in the body for the size of the facet of this rank: depth, size
    of the facet, and where the corner is.
    """
    vertices = s.points.vertices
    m = s.submesh.mesh.topology.index_map(s.dim - 1).size_local
    x = vertices.tabulate_dof_coordinates()[:, : s.dim]
    nowhere = 0.0, 1.0, np.zeros(s.dim)
    if not m:
        return nowhere
    cells = _simplices(vertices.dofmap.list[:m])
    facets = np.repeat(np.arange(m), len(cells) // m)
    out = facet_normals(s.domain, s.submesh.parent_facets[:m])[facets]
    # As the normals of facets turn with their corners, so does the side that is outside.
    side = np.sign(np.einsum("ki,ki->k", _normals(x[cells]), out))
    now = x + u[s.points.vertex_trace_dofs]
    normals = side[:, None] * _normals(now[cells])
    corners: Array = shape.points + s.dragged(shape.points)
    low, high = now[cells].min(axis=(0, 1)), now[cells].max(axis=(0, 1))
    sizes = np.linalg.norm(now[cells] - np.roll(now[cells], 1, axis=1), axis=2).max(axis=1)
    reach = _NEAR * float(sizes.max())
    corners = corners[((corners > low - reach) & (corners < high + reach)).all(axis=1)]
    if not len(corners):
        return nowhere
    found, parts = ClosestFacets(now, cells)(corners)
    feet = np.einsum("nk,nki->ni", parts, now[cells[found]])
    depth = -np.einsum("ni,ni->n", corners - feet, normals[found])
    # What is beside the face, or on the other side of the body, is not in a facet.
    beside = depth < _ACROSS * np.linalg.norm(corners - feet, axis=1)
    depth = np.where(beside | (depth > _NEAR * sizes[found]), 0.0, depth)
    i = int(np.argmax(depth / sizes[found]))
    return float(depth[i]), float(sizes[found[i]]), corners[i]


def _simplices(cells: npt.NDArray[np.int32]) -> Ints:
    """Segments and triangles; quadrilaterals, in the order of tensor products, as two each."""
    if cells.shape[1] < 4:
        return cells.astype(np.int64)
    return cells[:, [0, 1, 2, 1, 3, 2]].reshape(-1, 3).astype(np.int64)


def _normals(corners: Array) -> Array:
    """Unit normals of simplices, to one side as their corners go."""
    along = corners[:, 1:] - corners[:, :1]
    n: Array
    if corners.shape[2] == 2:
        n = np.stack([along[:, 0, 1], -along[:, 0, 0]], axis=1)
    else:
        n = np.asarray(np.cross(along[:, 0], along[:, 1]), dtype=np.float64)
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None])
