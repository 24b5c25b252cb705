# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is known of contact at the vertices of a surface, for fields and pictures."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.laws.status import MINUS, PLUS, closed, senses
from dolfinx_contact.points.evaluation import blocked_space
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["vertex_state"]

Array = npt.NDArray[np.float64]
_OF_FORCES = ("traction", "pressure", "shear", "bound")


def vertex_state(s: ContactSurface) -> dict[str, Array]:
    """What is known at the local vertices (owned, then ghosts), for pictures. Collective.

    Keys ``un``, ``ut``, ``n``, ``traction``, ``pressure``, ``shear``, ``bound`` as in
    `ContactSurface.state`, but forces over the whole areas of vertices, of which only a part may
    have something opposite; and ``open``, ``slip``: how much of the area around a vertex has that
    status (0 or 1 where the vertices are the points). In 2D also ``plus`` and ``minus``, slip with
    u_t > 0 and < 0: neither without friction where nothing has moved since the last step.
    """
    points = s.points
    kept = ("un", "ut", "n", "traction", "pressure", "shear", "bound")
    state = s.state()
    friction = senses(s.statuses)
    slips = closed(s.statuses) & ((friction == PLUS) | (friction == MINUS))
    shares = {"open": ~closed(s.statuses), "slip": slips}
    if s.dim == 2:
        # Where friction does nothing the status has no sense of its own, and the motion shows it.
        moved = state["increment"]
        n = state["n"]
        along = moved[:, 1] * n[:, 0] - moved[:, 0] * n[:, 1]
        grips = state["bound"] > 0
        shares["plus"] = slips & np.where(grips, friction == PLUS, along > 0)
        shares["minus"] = slips & np.where(grips, friction == MINUS, along < 0)
    found = {k: points.at_vertices(v.astype(float)) for k, v in shares.items()}
    if s.method == "integral":
        found |= _of_functions(s, state)
    else:
        found |= {k: points.with_ghosts(state[k]) for k in kept}
    for name in _OF_FORCES:
        found[name] = (points.covered * found[name].T).T
    return found


def _of_functions(s: ContactSurface, state: dict[str, Array]) -> dict[str, Array]:
    """Of Functions the values at the vertices, not the means around them. Collective."""
    motion = None if s.rigid_body is None else s.rigid_body.values
    u = s.relative(s.u.x.array.reshape(-1, s.dim), motion)
    u = (u - s.opposite(u))[s.points.vertex_trace_dofs]
    gap, n = s.at_vertices(u)
    traction = _multiplier_at_vertices(s)
    along = np.sum(u * n, axis=1)
    pressure = -np.sum(traction * n, axis=1)
    slip = u - along[:, None] * n
    if s.displaced is not None:
        slip = s.points.at_vertices(state["ut"])
    return {
        "un": gap,
        "ut": slip,
        "n": n,
        "traction": traction,
        "pressure": pressure,
        "shear": traction + pressure[:, None] * n,
        "bound": s.points.at_vertices(state["bound"]),
    }


def _multiplier_at_vertices(s: ContactSurface) -> Array:
    if s.degrees[1] == 1:
        return s.multiplier.x.array.reshape(-1, s.dim)
    f = fem.Function(blocked_space(s.points.vertices, s.dim))
    f.interpolate(s.multiplier)
    f.x.scatter_forward()
    return f.x.array.reshape(-1, s.dim)
