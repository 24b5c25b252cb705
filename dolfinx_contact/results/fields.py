# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields on a contact surface, for users, files and pictures.

Linear Functions on a mesh of the surface alone, at the vertices: displacement, contact traction on
the body, its normal and tangential parts, gap, slip (the tangential displacement), status, and
apart from contact the support, the force per area by which Dirichlet data hold the body there.

The status is a number, `STATUS_CODES`: 0 open, 1 stick, 2 slip, 3 clamped by Dirichlet data. In the
integral method the contact points are Gauss points; a vertex then has the status of the largest
share of the surface around it (weighted by its hat function), while traction, gap and slip are
values at the vertex.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.points.evaluation import vertex_function
from dolfinx_contact.points.surface import ContactSurface
from dolfinx_contact.points.vertex_state import vertex_state

__all__ = ["STATUS_CODES", "contact_fields"]

#: Number of each status letter of the tables.
STATUS_CODES = {"o": 0, "k": 1, "+": 2, "-": 2, "s": 2, "d": 3}


def contact_fields(
    eq: ContactEquations, number: int, supports: npt.NDArray[np.float64]
) -> dict[str, fem.Function]:
    """What is known on a contact surface at the state in the Functions. Collective.

    Args:
        eq: the contact problem.
        number: of the surface.
        supports: reactions of Dirichlet data on the body at the local vertices (n, dim).

    Returns:
        As `ContactProblem.contact_fields`.
    """
    s = eq.surfaces[number]
    state = vertex_state(s)
    shares = np.stack([state["open"], 1 - state["open"] - state["slip"], state["slip"]])
    status = np.argmax(np.round(shares, 9), axis=0).astype(float)
    clamped = _at_vertices(s, eq.constraints.clamped[number])
    status[clamped] = STATUS_CODES["d"]
    if s.method != "integral":
        for name in ("traction", "pressure", "shear"):
            state[name][clamped] = 0.0  # as in the table
    values = {
        "displacement": s.u.x.array.reshape(-1, s.dim)[s.points.vertex_trace_dofs],
        "traction": state["traction"],
        "pressure": state["pressure"],
        "shear": state["shear"],
        "gap": state["un"],
        "slip": state["ut"],
        "status": status,
        "support": supports / s.points.whole_areas[:, None],
    }
    for name, inner in s.law.variables(s.dim).items():
        values[name] = s.points.at_vertices(s.bond(f"after.{inner}"))
    return {name: vertex_function(s.points.vertices, name, v) for name, v in values.items()}


def _at_vertices(s: ContactSurface, marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Local vertices among the ``marked`` multiplier nodes."""
    f = fem.Function(s.points.Q)
    f.x.array[:] = np.repeat(marked.astype(float), s.dim)
    vertices = fem.Function(fem.functionspace(s.submesh.mesh, ("Lagrange", 1, (s.dim,))))
    vertices.interpolate(f)
    vertices.x.scatter_forward()
    return np.asarray(vertices.x.array[:: s.dim] > 0.5)
