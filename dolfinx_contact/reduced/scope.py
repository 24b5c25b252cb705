# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scope of the reduction of problems to their contact points."""

from __future__ import annotations

import numpy as np

from dolfinx_contact._mpi import require
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.laws.cones import is_polyhedral
from dolfinx_contact.laws.status import STICK

__all__ = ["can_condense", "check_reducible", "obstacle_in_space"]

_MOST_POINTS = 1024


def check_reducible(eq: ContactEquations) -> None:
    """Raise ``ValueError`` unless a problem can be reduced to a `PointProblem`. Collective."""
    laws = [s.law for s in eq.surfaces]
    known = all(law.bound_kind in ("proportional", "given") for law in laws)
    alone = all(s.points.E is None for s in eq.surfaces)
    parts = [
        (r[: s.points.number].any(axis=1) & ~c[: s.points.number])
        for s, r, c in zip(eq.surfaces, eq.constraints.removed, eq.constraints.clamped, strict=True)
    ]
    guided = eq.comm.allreduce(int(any(part.any() for part in parts)))
    along = eq.dim == 2 and all(s.method == "nodal" for s in eq.surfaces)
    trace = np.concatenate([s.points.vertex_trace_dofs for s in eq.surfaces])
    shared = eq.comm.allreduce(int(len(np.unique(trace)) < len(trace)))
    for ok, what in (
        (known, "the law of Coulomb or Tresca, or none of friction"),
        (alone, "contact at the nodes (nodal or mixed)"),
        (eq.bulk.linear, "a body that is linear"),
        (eq.linear or not eq.bulk.linear, "small sliding, on curved obstacles and between bodies"),
        (len(eq.scaling.loose.of_body) == 0, "a body that Dirichlet data hold"),
        (along or not guided, "contact nodes that Dirichlet data do not hold in part"),
        (not shared, "surfaces without common nodes"),
        (eq.rigid.size == 0, "obstacles without unknowns of their own"),
    ):
        require(eq.comm, ok, f'the reduced problem needs {what}; use algorithm="newton"')


def can_condense(
    system: ParametricEquations, *, partly: bool = False, bounded: bool = False
) -> bool:
    """Return whether a problem has affine pieces at its contact points. Collective.

    Args:
        system: contact problem with a parameter.
        partly: whether tangential displacements of contact points may be prescribed; such points
            have other statuses than in the problem.
        bounded: whether Tresca's law, whose pieces are not cones, is admissible.
    """
    eq = system.equations
    points = eq.comm.allreduce(int((~system.clamped).sum()))
    if eq.dim != 2 or not 0 < points <= _MOST_POINTS or not system._held_laws:
        return False
    nodes = []
    mixed = False
    polyhedral = True
    known = eq.memory, eq.constraints.clamped, eq.constraints.fixed_jumps
    for s, memory, clamped, fixed in zip(eq.surfaces, *known, strict=True):
        if s.points.E is not None or not s.linear:
            return False
        conic = is_polyhedral(s.law_at_points, s.point_data(memory))
        polyhedral = polyhedral and (conic or (bounded and s.law.bound_kind == "given"))
        nodes.append(s.points.vertex_trace_dofs)
        some = fixed.any(axis=1) & ~fixed.all(axis=1)
        if partly:
            # A part of a normal that is not along an axis would be prescribed.
            normal = np.where(fixed, s.points.vertex_normals, 0.0)
            some &= ~clamped & (np.abs(normal).max(axis=1, initial=0.0) > 1e-6)
        mixed = mixed or bool(some.any())
    flat = np.concatenate(nodes)
    shared = len(np.unique(flat)) < len(flat)
    return not eq.comm.allreduce(int(mixed or shared or not polyhedral))


def obstacle_in_space(system: ParametricEquations) -> str:
    """Return the reason why a 3D problem cannot be reduced to its points; "" if it can. Collective.

    Args:
        system: contact problem with a parameter; its laws are not considered.
    """
    eq = system.equations
    points = eq.comm.allreduce(int((~system.clamped).sum()))
    nodes = np.concatenate([s.points.vertex_trace_dofs for s in eq.surfaces])
    shared = bool(eq.comm.allreduce(int(len(np.unique(nodes)) < len(nodes))))
    oblique, rubbed = (bool(eq.comm.allreduce(int(v))) for v in _partly_held(system))
    for obstructs, what in (
        (eq.dim != 3, "the problem is not one in 3D"),
        (not system.is_linear, "the body, its loads or its motions are not linear"),
        (not system._held_laws, "a law or an obstacle depends on gamma"),
        (any(s.points.E is not None for s in eq.surfaces), "contact is not at nodes"),
        (not all(s.linear for s in eq.surfaces), "sliding is not small"),
        (points > _MOST_POINTS, f"there are more than {_MOST_POINTS} contact points"),
        (points == 0, "there is no contact point that is free"),
        (shared, "surfaces have nodes in common"),
        (oblique, "Dirichlet data hold a component of contact nodes that is not a tangential one"),
        (rubbed, "Dirichlet data hold one tangential displacement of contact nodes with friction"),
    ):
        if obstructs:
            return what
    return ""


def _partly_held(system: ParametricEquations) -> tuple[bool, bool]:
    """Return properties of the partly held contact nodes of this rank.

    Returns:
        Whether a normal displacement is held, and whether friction acts along a free tangent.
    """
    eq = system.equations
    oblique = False
    rubbed = False
    for s, clamped, fixed in zip(
        eq.surfaces, eq.constraints.clamped, eq.constraints.fixed_jumps, strict=True
    ):
        some = fixed.any(axis=1) & ~clamped[: len(fixed)]
        normal = np.where(fixed, s.points.vertex_normals, 0.0)
        oblique = oblique or bool((some & (np.abs(normal).max(axis=1, initial=0.0) > 1e-6)).any())
        one = some & (fixed.sum(axis=1) == 1)
        rubbed = rubbed or bool(one.any() and STICK in s.law_at_points.codes)
    return oblique, rubbed
