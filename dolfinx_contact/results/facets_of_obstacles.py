# SPDX-License-Identifier: LGPL-3.0-or-later
"""What contact points do not see of the edges of an obstacle.

The law holds at contact points. A corner or an edge of an obstacle with facets that is between them
is in a facet of the body by a depth that is measured here. What is beside an edge is pressed
sideways by the face of the obstacle there, across the face of the body. A body bends around an edge
instead, so that normals of both are one; nodes beside a sharp edge stay there however fine the face
is, and what slides pushes them ahead. Gauss points do not: nodes pass under the edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mesh_mark import node_positions
from dolfinx_contact._shared import SharedValues
from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_normals, simplex_normals
from dolfinx_contact.rigid_surfaces import RigidSurface
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets
from dolfinx_contact.rigid_surfaces.triangulation import angles_of

__all__ = ["Passed", "passed_of", "pressed_across"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Marks = npt.NDArray[np.bool_]

#: Of a facet of the body, by which a corner is in it. Several Gauss points of a facet see it.
_DEEPEST = {"nodal": 0.1, "mixed": 0.1, "integral": 0.5}
_ACROSS = 0.9  # cosine with the normal of the facet, above which a corner is below it
_NEAR = 1.0  # facets of the body, beyond which a corner is on the other side of the body
_PARTS = 4.0  # of a facet of the body, by which points follow one another along an edge
_ASIDE = 0.4  # cosine of the normals of body and obstacle, below which one is across the other
_SHARE = 0.02  # of the normal forces, above which it counts what is pressed across


@dataclass(frozen=True)
class Passed:
    """Of an obstacle with facets.

    Attributes:
        depth: by which a corner or an edge is in a facet of the body, a length.
        reasons: why that is to be doubted, in words.
    """

    depth: float = 0.0
    reasons: tuple[str, ...] = ()


def passed_of(s: DiscreteSurface, u: Array) -> Passed:
    """Corners and edges in facets of the body, and points past a rim. Collective.

    Args:
        s: a surface with a curved obstacle; of one without facets nothing is found.
        u: displacement of the local nodes (n, dim).
    """
    shape = _shape(s)
    if not isinstance(shape, RigidSurface):
        return Passed()
    depth, size, corner = _deepest(s, shape, u)
    worst = max(s.comm.allgather((depth / size, depth, size, corner.tolist())))
    other = "" if s.method == "integral" else ", or take the integral method"
    reasons = []
    if worst[0] > _DEEPEST[s.method]:
        reasons.append(
            f"a corner or edge of {shape.name} is {worst[1]:.3g} deep in a facet of the size "
            f"{worst[2]:.3g} at {_shown(worst[3])}: the law holds at contact points alone, and it "
            f"is between them; refine the face there{other}"
        )
    past = 0 if shape.closed else s.comm.allreduce(_past(s, shape, u))
    if past:
        reasons.append(
            f"{past} nodes of the face are past the rim of {shape.name} and behind it, where it "
            "has no contact: an open surface ends at its rim"
        )
    deepest = max(s.comm.allgather(depth))
    return Passed(deepest, tuple(reasons))


def pressed_across(s: DiscreteSurface, contact: ContactState, u: Array, held: Marks) -> str:
    """That points are pressed across the face of the body, or "". Collective.

    Args:
        s: a surface with a curved obstacle.
        contact: at the state.
        u: displacement of the local nodes (n, dim), by which the face has moved.
        held: points that Dirichlet data hold.
    """
    points = s.points
    at_vertices = _outward(s, u).T
    out = np.stack([points.from_vertices(component) for component in at_vertices], axis=1)
    n = contact.data.n
    force = np.maximum(-np.sum(contact.traction * n, axis=1), 0.0) * points.areas
    force[held] = 0.0
    cosine = np.sum(n * out, axis=1) / np.maximum(np.linalg.norm(out, axis=1), 1e-300)
    aside = np.where(cosine < _ASIDE, force, 0.0)
    sums = s.comm.allreduce(np.array([aside.sum(), force.sum()]))
    if not sums[0] > _SHARE * sums[1]:
        return ""
    i = int(np.argmax(aside)) if len(aside) else 0
    mine = (aside[i], s.positions[i].tolist(), cosine[i]) if len(aside) else (0.0, [], 1.0)
    _, place, least = max(s.comm.allgather(mine))
    angle = np.degrees(np.arccos(np.clip(least, -1.0, 1.0)))
    integral = "" if s.method == "integral" else "take method='integral', or "
    return (
        f"{sums[0] / sums[1]:.2g} of the normal forces act across the face of the body, most at "
        f"the point which was at {_shown(place)}, where normals of both are {angle:.0f} degrees "
        "apart: it is beside an edge of the obstacle, whose side pushes it, so that the edge "
        f"ploughs where the body would bend around it; {integral}make the edge round by some "
        "facets of the face; a finer face alone is no remedy"
    )


def _shape(s: DiscreteSurface) -> Obstacle:
    body = s.rigid_body
    shape: Obstacle = s.obstacle if body is None else body.shape
    return shape


def _past(s: DiscreteSurface, shape: RigidSurface, u: Array) -> int:
    """Nodes that this rank owns past the rim of an open surface, where they have left it."""
    n = s.points.vertices.dofmap.index_map.size_local
    nodes = s.points.vertex_trace_dofs[:n]
    body = s.rigid_body
    x = s.node_positions
    seen = (x + s.relative(u[: len(x)], None if body is None else body.values))[nodes]
    found = shape.distances(seen)
    within = np.zeros(n) if s.displaced is None else np.full(n, s.points.mean_width)
    taken = s.points.removed_at_vertices
    if taken is not None:  # what is that far below the rim is on it
        within = within + taken.x.array[:n]
    return int((found.past & (found.distance > within)).sum())


def _shown(x: npt.ArrayLike) -> str:
    return f"({', '.join(f'{c:.4g}' for c in np.asarray(x))})"


def _face(s: DiscreteSurface, u: Array) -> tuple[Array, Ints, Array]:
    """Vertices of the face as they are now, simplices of facets of this rank by these, and their
    outward normals.
    """
    vertices = s.points.vertices
    m = s.submesh.mesh.topology.index_map(s.dim - 1).size_local
    x = node_positions(vertices)[:, : s.dim]
    now = x + u[s.points.vertex_trace_dofs]
    cells = _simplices(vertices.dofmap.list[:m])
    if not m:
        return now, cells, np.zeros((0, s.dim))
    facets = np.repeat(np.arange(m), len(cells) // m)
    out = facet_normals(s.domain, s.submesh.parent_facets[:m])[facets]
    # As the normals of facets turn with their corners, so does the side that is outside.
    side = np.sign(np.einsum("ki,ki->k", simplex_normals(x[cells]), out))
    return now, cells, side[:, None] * simplex_normals(now[cells])


def _outward(s: DiscreteSurface, u: Array) -> Array:
    """Outward normals at the local vertices, sums by the angles of facets (n, dim)."""
    now, cells, normals = _face(s, u)
    shares = angles_of(now[cells])[..., None] * normals[:, None]
    return SharedValues(s.points.vertices.dofmap.index_map).sums(cells, shares)


def _deepest(s: DiscreteSurface, shape: RigidSurface, u: Array) -> tuple[float, float, Array]:
    """What of corners and edges is deepest in a facet of this rank, for its size.

    Returns:
        The depth, the size of the facet, and where the corner is.
    """
    now, cells, normals = _face(s, u)
    nowhere = 0.0, 1.0, np.zeros(s.dim)
    if not len(cells):
        return nowhere
    low, high = now[cells].min(axis=(0, 1)), now[cells].max(axis=(0, 1))
    sizes = np.linalg.norm(now[cells] - np.roll(now[cells], 1, axis=1), axis=2).max(axis=1)
    reach = _NEAR * float(sizes.max())
    points: Array = shape.points + s.dragged(shape.points)
    box = low - reach, high + reach
    corners = points[((points > box[0]) & (points < box[1])).all(axis=1)]
    along = _along(points[shape.edges], box, float(np.median(sizes)) / _PARTS)
    corners = np.concatenate([corners, along])
    if not len(corners):
        return nowhere
    found, parts = ClosestFacets(now, cells)(corners)
    feet = np.einsum("nk,nki->ni", parts, now[cells[found]])
    depth = -np.einsum("ni,ni->n", corners - feet, normals[found])
    # What is beside the face, or on the other side of the body, is not in a facet.
    beside = depth < _ACROSS * np.linalg.norm(corners - feet, axis=1)
    depth = np.where(beside | (depth > _NEAR * sizes[found]), 0.0, depth)
    taken = s.points.removed_at_vertices
    if taken is not None:  # an overlap that is removed is none
        depth = np.maximum(depth - np.sum(parts * taken.x.array[cells[found]], axis=1), 0.0)
    i = int(np.argmax(depth / sizes[found]))
    return float(depth[i]), float(sizes[found[i]]), corners[i]


def _along(edges: Array, box: tuple[Array, Array], spacing: float) -> Array:
    """Points (n, dim) along the parts of edges (k, 2, dim) that are in a box, that far apart."""
    start = edges[:, 0]
    way = edges[:, 1] - start
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(side - start) / way for side in box], axis=0)
    # Along an axis in which an edge does not go it is in the box everywhere, or nowhere.
    still = way == 0.0
    inside = (start >= box[0]) & (start <= box[1])
    ends[0][still] = np.where(inside[still], 0.0, 2.0)
    ends[1][still] = 1.0
    first = np.maximum(ends[0].max(axis=1), 0.0)
    last = np.minimum(ends[1].min(axis=1), 1.0)
    there = first < last
    start, way, first, last = start[there], way[there], first[there], last[there]
    parts = np.ceil((last - first) * np.linalg.norm(way, axis=1) / spacing).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)
    part = first[edge] + (number / (parts[edge] - 1)) * (last - first)[edge]
    return np.asarray(start[edge] + part[:, None] * way[edge])


def _simplices(cells: npt.NDArray[np.int32]) -> Ints:
    """Segments and triangles; quadrilaterals, in the order of tensor products, as two each."""
    if cells.shape[1] < 4:
        return cells.astype(np.int64)
    return cells[:, [0, 1, 2, 1, 3, 2]].reshape(-1, 3).astype(np.int64)
