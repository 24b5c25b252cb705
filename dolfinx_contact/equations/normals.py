# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displaced contact points at which a curved obstacle has no normal."""

from __future__ import annotations

import numpy as np

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.state import State
from dolfinx_contact.laws.status import closed

__all__ = ["without_normal"]

#: How steeply a gap falls along the normal at a point on the obstacle, at least: 1 where a level
#: set has a gradient, 1/m where it vanishes like the m-th power of the distance.
_STEEPEST = -0.75


def without_normal(eq: ContactEquations, state: State) -> str:
    """Where a displaced point has no normal, in words; "" if all have one. Collective."""
    for s, found in zip(eq.surfaces, state.surfaces, strict=True):
        data = found.data
        if data.turn is None:
            continue
        fall = np.sum(found.kinematics.gap_slope * data.n, axis=1)
        lost = ~np.isfinite(fall + data.gap) | (closed(found.statuses) & (fall > _STEEPEST))
        mine = sorted(np.round((s.positions + found.jump)[lost] / eq.body_size, 9).tolist())
        places = sorted(place for part in eq.comm.allgather(mine) for place in part)
        if places:
            where = ", ".join(f"{c * eq.body_size:.6g}" for c in places[0])
            return (
                f"{s.name}: the obstacle has no normal at a contact point that is at ({where}) or "
                "next to it: the gradient of a level set vanishes there, or it is the centre of a "
                "sphere"
            )
    return ""
