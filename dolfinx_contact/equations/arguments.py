# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the arguments of a contact problem fit together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._agreement import refuse_other_condition, refuse_other_mesh
from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.materials import Axisymmetric, materials_in
from dolfinx_contact.points.descriptions import Contact, is_axisymmetric
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["check", "fit", "listed", "lists"]


def fit(surfaces: Sequence[DiscreteSurface], statuses: Statuses) -> bool:
    """Whether statuses are some of these contact points. Not collective."""
    return len(statuses) == len(surfaces) and all(
        np.shape(codes) == (s.points.number,) and np.isin(codes, s.law_at_points.codes).all()
        for s, codes in zip(surfaces, statuses, strict=True)
    )


def lists(surfaces: Any, bcs: Any) -> tuple[list[Contact], list[fem.DirichletBC]]:
    """Return descriptions of contact and Dirichlet conditions as lists, or raise ``ValueError``."""
    try:
        surfaces = list(surfaces)
        bcs = list(bcs)
    except TypeError:
        raise ValueError("surfaces and bcs must be lists") from None
    if not all(isinstance(s, Contact) for s in surfaces):
        raise ValueError("surfaces must be a list of ContactSurface, ContactPair or SelfContact")
    if not all(isinstance(bc, fem.DirichletBC) for bc in bcs):
        raise ValueError("bcs must be a list of Dirichlet conditions")
    return surfaces, bcs


def check(bulk: Any, u: fem.Function, surfaces: list[Contact], bcs: list[fem.DirichletBC]) -> None:
    """Raise ``ValueError`` if the arguments of a problem do not fit together. Not collective."""
    domain = u.function_space.mesh
    if not surfaces:
        raise ValueError("a contact problem needs at least one contact surface")
    if any(s.u is not u for s in surfaces):
        raise ValueError("every contact surface must be made with the displacement u")
    names = [s.name for s in surfaces]
    if len(set(names)) < len(names):
        raise ValueError(f"contact surfaces need different names, got {names}")
    plane = [s.name for s in surfaces if not is_axisymmetric(s)]
    if 0 < len(plane) < len(surfaces):
        raise ValueError(f"all contact surfaces are axisymmetric or none is, unlike {plane}")
    if not isinstance(bulk, ufl.Form):
        density = isinstance(bulk, ufl.core.expr.Expr)
        hint = ": multiply the energy density by ufl.dx" if density else ""
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}{hint}")
    around = is_axisymmetric(surfaces[0])
    for material in materials_in(bulk):
        if isinstance(material, Axisymmetric) != around:
            given, other = "axisymmetric", "a plane body"
            if not around:
                given, other = "plane", "a body of revolution"
            raise ValueError(
                f"the contact surfaces are {given}, but the bulk is that of {other}: a body of "
                "revolution needs surfaces with axisymmetric=True and materials.Axisymmetric"
            )
    refuse_other_mesh(bulk, domain, "the bulk")
    for bc in bcs:
        refuse_other_condition(bc, domain)


def listed(expected: Any) -> list[Statuses]:
    """Statuses that are expected as lists, or ``ValueError``. Not collective."""
    try:
        return [list(statuses) for statuses in expected]
    except TypeError:
        raise ValueError(
            "expected must be a list of statuses, each a list of arrays, surface by surface; got "
            f"{expected!r}"
        ) from None
