# SPDX-License-Identifier: LGPL-3.0-or-later
"""Obstacles behind the face of the body: a reversed plane, a sphere inside the body."""

from __future__ import annotations

import logging

import numpy as np

from dolfinx_contact.body.cells import cells_around
from dolfinx_contact.points.displaced_faces import outward_at_points
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import rounded

__all__ = ["warn_of_obstacle"]

logger = logging.getLogger(__name__)

_AGAINST = -0.5  # cosine of the contact normal and the outward normal, below which they disagree
_BESIDE = 1e-3  # facets from a contact point, where the body is looked for
_TIED = 8  # contact points nearest to an obstacle that are examined, by rank
_FAR = 10.0  # body sizes from which an obstacle is far away


def warn_of_obstacle(s: DiscreteSurface, size: float, reported: set[str]) -> None:
    """Warn of an obstacle on the wrong side, and of a friction bound far from one. Collective.

    An obstacle is on the wrong side if at the contact point nearest to it the contact normal points
    against the outward normal of the face and into the body. The solution is wrong then without any
    other sign. The reference configuration is compared, so that this is for small sliding and the
    static law; in an evolution `results.indicators` has the passing of a step.

    Args:
        s: surface that is new or has new data.
        size: size of the body, a length.
        reported: names of the surfaces whose obstacle is known to be on the wrong side; updated.
    """
    gaps = np.abs(s.points.gaps)
    nearest = s.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=min)
    if s.between_bodies or not np.isfinite(nearest):
        return
    n = s.points.data.n
    outward = outward_at_points(s, np.zeros_like(s.node_positions))
    against = np.sum(n * outward, axis=1) < _AGAINST
    tied = np.flatnonzero(against & (gaps <= nearest + 1e-9 * size))
    # in the order of coordinates, so that the place is the same on any number of ranks
    tied = tied[np.lexsort(rounded(s.positions[tied]).T[::-1])][:_TIED]
    into = s.positions[tied] + _BESIDE * s.points.mean_width * n[tied]
    x = np.concatenate(s.comm.allgather(np.stack([s.positions[tied], into])), axis=1)
    inside = cells_around(s.domain, x[1]) > 0
    if not inside.any():
        reported.discard(s.name)
    elif s.name not in reported and s.comm.rank == 0:
        first = min(tuple(p) for p in rounded(x[0])[inside])
        logger.warning(
            "%s: the obstacle is on the wrong side: at (%s), where the body comes nearest to "
            "it, the contact normal points into the body; reverse the normal of a plane, or "
            "move a sphere out of the body",
            s.name,
            ", ".join(f"{c:.6g}" for c in first),
        )
    if inside.any():
        reported.add(s.name)
    given = not s.law.needs_pressure and s.law.averaging is None
    if given and nearest > _FAR * size:
        at_rest = np.zeros_like(n)
        slope = s.law_at_points(at_rest, at_rest, s.point_data()).unit_bound
        bound = float(np.nanmax(slope, initial=0.0))
        if s.comm.allreduce(bound, op=max) > 0 and s.comm.rank == 0:
            logger.warning(
                "%s: the friction bound of Tresca acts on the whole surface, and the obstacle "
                "is %.3g away, more than ten times the size of the body",
                s.name,
                nearest,
            )
