# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields on a contact surface, for users, files and pictures.

The fields are piecewise linear Functions on the mesh of the surface: displacement, contact traction
on the body with its normal and tangential parts, gap, slip (the tangential displacement), status,
and the support, i.e. the reaction of Dirichlet data per area, which is not a contact traction.

The status is a number, `STATUS_CODES`: 0 open, 1 stick, 2 slip, 3 clamped by Dirichlet data. With
``method="integral"`` the contact points are Gauss points; a vertex then has the status that
prevails on the surface around it (weighted by its hat function), while traction, gap and slip are
values at the vertex.
"""

from __future__ import annotations

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import along_tangent, dot, tangential
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.laws.status import MINUS, PLUS, closed, senses
from dolfinx_contact.points.evaluators import blocked_space, vertex_function
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.results.tables import (
    forces_at_vertices,
    friction_bound,
    support_at_nodes,
)

__all__ = ["STATUS_CODES", "contact_fields", "vertex_state"]


#: Number of each status letter of the tables.
STATUS_CODES = {"o": 0, "k": 1, "+": 2, "-": 2, "s": 2, "d": 3}
_FORCES = ("traction", "pressure", "shear", "bound")


def contact_fields(
    eq: ContactEquations, number: int, evaluation: Evaluation
) -> dict[str, fem.Function]:
    """Return the fields on a contact surface at the state in the Functions. Collective.

    Args:
        eq: contact problem.
        number: index of the surface.
        evaluation: evaluation of the state, with reactions.

    Returns:
        Functions by name, see `ContactProblem.contact_fields`.
    """
    s = eq.surfaces[number]
    at_vertices = vertex_state(eq, number, evaluation)
    if not s.is_weak:
        clamped = at_vertices["status"] == STATUS_CODES["d"]
        for name in ("traction", "pressure", "shear"):
            at_vertices[name][clamped] = 0.0  # as in the table
    trace = s.points.vertex_nodes
    supports = forces_at_vertices(eq.V, s.submesh, trace, support_at_nodes(eq, evaluation))
    values = {
        "displacement": evaluation.u.reshape(-1, s.dim)[trace],
        "traction": at_vertices["traction"],
        "pressure": at_vertices["pressure"],
        "shear": at_vertices["shear"],
        "gap": at_vertices["un"],
        "slip": at_vertices["ut"],
        "status": at_vertices["status"],
        "support": supports / s.points.geometry.whole_areas[:, None],
    }
    answers = evaluation.surfaces[number].answers
    for name, inner in s.law.variables(s.dim).items():
        values[name] = s.points.at_vertices(answers.bond(f"after.{inner}"))
    return {name: vertex_function(s.points.vertices, name, v) for name, v in values.items()}


def vertex_state(eq: ContactEquations, number: int, evaluation: Evaluation) -> dict[str, Array]:
    """Return values at the local vertices of a surface, for fields and pictures. Collective.

    Owned vertices come first.

    Args:
        eq: contact problem.
        number: index of the surface.
        evaluation: evaluation of the state in the Functions.

    Returns:
        Gap ``un``, slip ``ut``, normal ``n``, ``traction`` on the body, ``pressure``, ``shear``,
        radius ``bound`` of the friction disc, and ``status``, a number of `STATUS_CODES`. Forces
        are divided by the whole vertex areas, including parts without an opposing surface. ``open``
        and ``slip`` are the fractions of the area around a vertex with that status (0 or 1 if the
        vertices are the contact points); in 2D, ``minus`` is the fraction that slips with u_t < 0.
    """
    s = eq.surfaces[number]
    contact = evaluation.surfaces[number]
    points = s.points
    at = contact.kinematics
    bound = friction_bound(s, contact)
    friction = senses(contact.statuses)
    slips = closed(contact.statuses) & ((friction == PLUS) | (friction == MINUS))
    shares = {"open": ~closed(contact.statuses), "slip": slips}
    if s.dim == 2:
        # Without friction the status has no sign of slip: use the motion.
        moved = along_tangent(at.increment, at.data.n)
        shares["minus"] = slips & np.where(bound > 0, friction == MINUS, moved < 0)
    values = {k: points.at_vertices(v.astype(float)) for k, v in shares.items()}
    if s.is_weak:
        values |= _interpolated(eq, s, evaluation, at.slip)
        values["bound"] = points.at_vertices(bound)
    else:
        at_points = {"un": at.gap, "ut": at.slip, "n": at.data.n, "traction": contact.traction}
        at_points["bound"] = bound
        values |= {k: points.exchange.from_owners(v) for k, v in at_points.items()}
    values["pressure"] = -dot(values["traction"], values["n"])
    values["shear"] = tangential(values["traction"], values["n"])
    for name in _FORCES:
        values[name] = (points.geometry.covered * values[name].T).T
    values["status"] = _statuses(eq, number, values["open"], values["slip"])
    return values


def _statuses(eq: ContactEquations, number: int, is_open: Array, slips: Array) -> Array:
    """Return the numbers of the prevailing statuses at the local vertices, shape (n,).

    ``is_open`` and ``slips`` are the open and slipping fractions of the area around a vertex.
    """
    s = eq.surfaces[number]
    shares = np.stack([is_open, 1 - is_open - slips, slips])
    statuses = np.argmax(np.round(shares, 9), axis=0).astype(float)
    clamped = fem.Function(s.points.Q)
    at_nodes = eq.constraints.surfaces[number].clamped
    clamped.x.array[:] = np.repeat(at_nodes.astype(float), s.dim)
    statuses[_at_vertices(s, clamped)[:, 0] > 0.5] = STATUS_CODES["d"]
    return statuses


def _interpolated(
    eq: ContactEquations, s: DiscreteSurface, evaluation: Evaluation, slip_at_points: Array
) -> dict[str, Array]:
    """Return gap, slip, normal and traction at the vertices (``method="integral"``). Collective.

    They are values at the vertices, not means around them, except for the slip in large sliding.
    """
    u = eq.terms[eq.surfaces.index(s)].relative(evaluation.u, evaluation.q)
    u = (u - s.opposite(u))[s.points.vertex_nodes]
    gap, n = s.at_vertices(u)
    slip = tangential(u, n) if s.displaced is None else s.points.at_vertices(slip_at_points)
    return {"un": gap, "ut": slip, "n": n, "traction": _at_vertices(s, s.multiplier)}


def _at_vertices(s: DiscreteSurface, multiplier: fem.Function) -> Array:
    """Return the values of a multiplier Function at the local vertices, shape (n, dim)."""
    f = fem.Function(blocked_space(s.points.vertices, s.dim))
    f.interpolate(multiplier)
    f.x.scatter_forward()
    return f.x.array.reshape(-1, s.dim)
