# SPDX-License-Identifier: LGPL-3.0-or-later
r"""By which angle a face has turned over what it touches in a step, about their normals.

Between bodies that slide over each other the slip turns with both, and by half of what one turns
over the other (`points.sliding.facing`). On a rigid obstacle it is the chord of the step as it is,
in the frame of the obstacle: of a spin by the angle psi friction acts off its direction by psi/2,
and works along a chord shorter than the arc,

    torque: cos(psi/2),    work: sin(psi/2) / (psi/2)

of what they are (a disc of the radius R under the pressure p: 2/3 mu p R torque, times psi).

The angle is that of the facets of the face (`points.sliding.spins`) between the last accepted state
and now, both seen from the obstacle, so that nothing spins that turns with it. Their corners are
means of the contact points around them, B X before anything has moved: what B averages of an affine
motion moves as that does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mesh_mark import node_positions
from dolfinx_contact._shared import SharedValues
from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.laws.status import closed
from dolfinx_contact.points.sliding.rays import area_vectors
from dolfinx_contact.points.sliding.spins import spins
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_normals

__all__ = ["LARGEST_SPIN", "spin_by_work", "spin_doubt", "spin_over_obstacle"]

Array = npt.NDArray[np.float64]

LARGEST_SPIN = 35.0  # degrees in a step, whose chord is by 1.5 % shorter than the arc
_LARGEST_OVER_OBSTACLE = 21.0  # degrees in a step, by which the torque is 1.7 % low
_CARRIES = 1e-3  # of all tractions, what a part of a face carries that counts
_NO_TRACTION = 1e-15  # of the stiffness of a facet, that of an open point that is round-off
_NO_WORK = 1e-9  # of what all tractions would do along a facet, what is round-off
_TURNED_ROUND = -0.9  # cosine of the normals before and now, below which a spin is none
_NO_FACET = 1e-6  # of the mean area, below which means of points span no facet


def spin_by_work(s: DiscreteSurface, contact: ContactState, apart: Array) -> float:
    """The largest spin of a connected part of a face, in degrees. Collective.

    That of a part is the mean of the angles at its points, squared, by the work of friction. Parts
    are several bodies, or feet of one, of which others may slide far.

    Args:
        s: the surface.
        contact: at the state.
        apart: angles (n,).
    """
    at = contact.kinematics
    along = contact.traction - np.sum(contact.traction * at.data.n, axis=1)[:, None] * at.data.n
    size = np.linalg.norm(contact.traction, axis=1)
    none = _NO_TRACTION * at.data.r * s.points.mean_width
    areas = np.where(closed(contact.statuses) | (size > none), at.operator.areas, 0.0)
    work = np.abs(np.sum(along * at.increment, axis=1)) * areas
    size = size * areas
    part, number = s.parts
    sums = [np.bincount(part, v, minlength=number) for v in (work * apart**2, work, size)]
    turned, work, size = s.comm.allreduce(np.array(sums))
    carries = size > _CARRIES * size.sum()
    rubs = carries & (work > _NO_WORK * size * s.points.mean_width)
    means = np.divide(turned, work, out=np.zeros_like(work), where=rubs)
    return float(np.degrees(np.sqrt(means.max(initial=0.0))))


def spin_over_obstacle(s: DiscreteSurface, contact: ContactState) -> float:
    """By how many degrees a face has turned over a rigid obstacle in the last step. Collective.

    Args:
        s: the surface, in space.
        contact: at the state.
    """
    at = contact.kinematics
    start = at.operator.apply(s.node_positions[: s.owned_nodes])
    memory = at.memory
    before = np.zeros_like(start)
    if memory is not None:
        before = memory.jump if memory.place is None else memory.place
    return spin_by_work(s, contact, _at_points(s, start + before, start + at.path[0]))


def spin_doubt(s: DiscreteSurface, spin: float) -> str:
    """Why a state is to be doubted that spins by so many degrees on an obstacle, or ""."""
    if not spin > _LARGEST_OVER_OBSTACLE:
        return ""
    body = s.rigid_body
    if body is not None and body.turns and not s.turns:
        return (
            f"the face and {body.name} have turned over each other by {spin:.3g} degrees in one "
            "step, and in small sliding a rigid body turns by small angles: take shorter steps, "
            "and sliding='large', which needs its rotation to be prescribed"
        )
    half = np.radians(spin) / 2
    return (
        f"the face has turned over the obstacle by {spin:.3g} degrees in one step, in which "
        f"friction acts and works along chords: its torque is {1 - np.cos(half):.2g} too low, its "
        f"work {1 - np.sin(half) / half:.2g}; take shorter steps"
    )


def _at_points(s: DiscreteSurface, before: Array, now: Array) -> Array:
    """Angles at the points (n,) between two places of them (n, dim). Collective."""
    points = s.points
    vertices = points.vertices
    m = s.submesh.mesh.topology.index_map(s.dim - 1).size_local
    cells = vertices.dofmap.list[:m]
    reference = node_positions(vertices)[:, : s.dim][cells]
    old, new = (points.at_vertices(x)[cells] for x in (before, now))
    out = facet_normals(s.domain, s.submesh.parent_facets[:m], unit=False)
    sense = np.sign(np.sum(area_vectors(reference) * out, axis=1))
    area = np.linalg.norm(out, axis=1)
    first, second = area_vectors(old), area_vectors(new)
    a, b = (np.linalg.norm(v, axis=1) for v in (first, second))
    wide = np.minimum(a, b) > _NO_FACET * area
    good = wide & (np.sum(first * second, axis=1) > _TURNED_ROUND * a * b)
    angle = np.zeros(m)
    angle[good] = spins(old[good], new[good], sense[good])[0]
    # Means at the vertices by the areas of the facets around them.
    weights = np.where(good, area, 0.0)
    parts = np.stack([weights * angle, weights], axis=1)
    at_corners = np.repeat(parts[:, None], cells.shape[1], axis=1)
    total, weight = SharedValues(vertices.dofmap.index_map).sums(cells, at_corners).T
    means = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)
    return points.from_vertices(means)
