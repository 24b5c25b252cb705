# SPDX-License-Identifier: LGPL-3.0-or-later
"""States that solve the equations and that no body can be in."""

from __future__ import annotations

from petsc4py import PETSc

from dolfinx_contact.body.deformation import smallest_jacobian
from dolfinx_contact.equations.contact import ContactEquations

__all__ = ["inverted"]


def inverted(equations: ContactEquations, x: PETSc.Vec) -> str:
    """Where a hyperelastic body is turned inside out, in words; "" if nowhere. Collective."""
    if equations.bulk.linear:
        return ""
    u = equations.displacement(x)
    smallest, place = smallest_jacobian(equations.V, u, vertices=False)
    if smallest > 0:
        return ""
    where = ", ".join(f"{c:.4g}" for c in place)
    return f"its solution has det F = {smallest:.3g} at ({where})"
