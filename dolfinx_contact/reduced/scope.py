# SPDX-License-Identifier: LGPL-3.0-or-later
"""Conditions under which a problem can be reduced to its contact points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_contact._mpi import any_rank, anywhere, require
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.laws.cones import is_polyhedral
from dolfinx_contact.laws.status import STICK

__all__ = ["can_condense", "check_reducible", "why_not_reducible"]

_MOST_POINTS = 1024


def check_reducible(eq: ContactEquations) -> None:
    """Raise `ValueError` if a problem cannot be reduced to a `PointProblem`. Collective."""
    laws = [s.law for s in eq.surfaces]
    known = all(law.bound_kind in ("proportional", "given") for law in laws)
    alone = not eq.is_weak
    parts = [
        (c.removed.any(axis=1) & ~c.clamped)[: s.points.number]
        for s, c in zip(eq.surfaces, eq.constraints.surfaces, strict=True)
    ]
    guided = any_rank(eq.comm, [part.any() for part in parts])
    along = eq.dim == 2 and all(s.method == "nodal" for s in eq.surfaces)
    for ok, what in (
        (known, "the law of Coulomb or Tresca, or frictionless contact"),
        (alone, "contact at the nodes (nodal or mixed)"),
        (eq.bulk.linear, "a linear body"),
        (eq.linear or not eq.bulk.linear, "small sliding, on curved obstacles and between bodies"),
        (len(eq.scaling.loose) == 0, "a body held by Dirichlet data"),
        (along or not guided, "contact nodes without partial Dirichlet data"),
        (not _share_nodes(eq), "surfaces without common nodes"),
        (eq.rigid.size == 0, "obstacles without unknowns"),
    ):
        require(eq.comm, ok, f'the reduced problem needs {what}; use algorithm="newton"')


def can_condense(
    system: ParametricEquations, *, partly: bool = False, bounded: bool = False
) -> bool:
    """Return whether a 2D problem can be condensed to an affine system. Collective.

    The equations at the contact points must be affine for fixed statuses. False in 3D.

    Args:
        system: contact problem with a parameter.
        partly: whether contact points with prescribed tangential displacements are admissible.
            Their statuses in the reduced problem differ from those in the full problem.
        bounded: whether Tresca's law is admissible, whose equations are affine but not conic.
    """
    eq = system.equations
    if eq.dim != 2 or _obstacle_at_points(system):
        return False
    partly_fixed = _partly_fixed(system)
    other_laws = [
        not (bounded and s.law.bound_kind == "given")
        and not is_polyhedral(s.law_at_points, s.point_data(memory))
        for s, memory in zip(eq.surfaces, eq.memory, strict=True)
    ]
    return not any_rank(eq.comm, other_laws) and not (
        partly_fixed.oblique if partly else partly_fixed.some
    )


def why_not_reducible(system: ParametricEquations) -> str:
    """Return the reason why a problem cannot be reduced; "" if it can. Collective.

    Args:
        system: contact problem with a parameter; in 3D its laws are not considered.
    """
    if not system.is_linear:
        return "the body, its loads or its motions are not linear"
    obstacle = _obstacle_at_points(system)
    if obstacle:
        return obstacle
    if system.equations.dim == 2:
        fits = can_condense(system, bounded=True)
        words = "a law is not polyhedral, or Dirichlet data hold contact nodes in part"
        return "" if fits else words
    partly_fixed = _partly_fixed(system)
    if partly_fixed.oblique:
        return "Dirichlet data hold a component of contact nodes that is not a tangential one"
    if partly_fixed.rubbed:
        return "Dirichlet data hold one tangential displacement of contact nodes with friction"
    return ""


def _obstacle_at_points(system: ParametricEquations) -> str:
    """Return the reason why a problem cannot be condensed onto its contact points.

    The reason is "" if the points permit it. Collective.
    """
    eq = system.equations
    points = eq.comm.allreduce(int((~system.clamped).sum()))
    for obstructs, what in (
        (not system._fixed_laws, "a law or an obstacle depends on gamma"),
        (eq.is_weak, "contact is not at nodes"),
        (not all(s.linear for s in eq.surfaces), "sliding is not small"),
        (points > _MOST_POINTS, f"there are more than {_MOST_POINTS} contact points"),
        (points == 0, "no contact point is free"),
        (_share_nodes(eq), "surfaces have nodes in common"),
    ):
        if obstructs:
            return what
    return ""


def _share_nodes(eq: ContactEquations) -> bool:
    """Return whether two surfaces have a node in common. Collective."""
    nodes = np.concatenate([s.points.vertex_nodes for s in eq.surfaces])
    return any_rank(eq.comm, len(np.unique(nodes)) < len(nodes))


class _PartlyFixed(NamedTuple):
    """Properties of contact nodes with Dirichlet data in some directions only.

    Attributes:
        some: whether such nodes exist.
        oblique: whether a fixed direction has a normal component.
        rubbed: whether friction acts at such a node along a tangent without Dirichlet data.
    """

    some: bool
    oblique: bool
    rubbed: bool


def _partly_fixed(system: ParametricEquations) -> _PartlyFixed:
    """Return properties of contact nodes with Dirichlet data in some directions. Collective."""
    eq = system.equations
    some = oblique = rubbed = False
    for s, constraints in zip(eq.surfaces, eq.constraints.surfaces, strict=True):
        fixed = constraints.fixed_jumps
        one = fixed.any(axis=1) & ~constraints.clamped
        normal = np.abs(np.where(fixed, s.points.vertex_normals, 0.0)).max(axis=1, initial=0.0)
        friction = STICK in s.law_at_points.codes
        some |= bool((fixed.any(axis=1) & ~fixed.all(axis=1)).any())
        oblique |= bool((one & (normal > 1e-6)).any())
        rubbed |= friction and bool((one & (fixed.sum(axis=1) == 1)).any())
    return _PartlyFixed(*anywhere(eq.comm, some, oblique, rubbed))
