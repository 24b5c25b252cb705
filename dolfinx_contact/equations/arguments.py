# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the arguments of a contact problem fit together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._agreement import refuse_other_condition, refuse_other_mesh
from dolfinx_contact._validate import listed as as_list
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
    if isinstance(surfaces, Contact) or isinstance(bcs, fem.DirichletBC):
        raise ValueError("surfaces and bcs must be lists")
    surfaces, bcs = as_list(surfaces, "surfaces"), as_list(bcs, "bcs")
    if not all(isinstance(s, Contact) for s in surfaces):
        raise ValueError("surfaces must be a list of ContactSurface, ContactPair or SelfContact")
    if not all(isinstance(bc, fem.DirichletBC) for bc in bcs):
        raise ValueError("bcs must be a list of Dirichlet conditions")
    return surfaces, bcs


def check(bulk: Any, u: fem.Function, surfaces: list[Contact], bcs: list[fem.DirichletBC]) -> None:
    """Raise ``ValueError`` if the arguments of a problem do not fit together. Not collective."""
    domain = u.function_space.mesh
    names = [s.name for s in surfaces]
    plane = [s.name for s in surfaces if not is_axisymmetric(s)]
    if not isinstance(bulk, ufl.Form):
        density = isinstance(bulk, ufl.core.expr.Expr)
        hint = ": multiply the energy density by ufl.dx" if density else ""
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}{hint}")
    turned = [isinstance(m, Axisymmetric) for m in materials_in(bulk)]
    for wrong, message in (
        (not surfaces, "a contact problem needs at least one contact surface"),
        (
            any(s.u is not u for s in surfaces),
            "every contact surface must be made with the displacement u",
        ),
        (len(set(names)) < len(names), f"contact surfaces need different names, got {names}"),
        (
            0 < len(plane) < len(surfaces),
            f"all contact surfaces are axisymmetric or none is, unlike {plane}",
        ),
        (
            any(turned) and plane,
            "the contact surfaces are plane, but the bulk is that of a body of revolution, whose "
            "surfaces need axisymmetric=True",
        ),
        (
            not all(turned) and not plane,
            "the contact surfaces are axisymmetric, but the bulk is that of a plane body: use "
            "materials.Axisymmetric",
        ),
    ):
        if wrong:
            raise ValueError(message)
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
