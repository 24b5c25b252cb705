# SPDX-License-Identifier: LGPL-3.0-or-later
"""States that solve the equations and that no body can be in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dolfinx_contact.checks import smallest_jacobian

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["inverted"]


def inverted(problem: ContactProblem) -> str:
    """Where a hyperelastic body is turned inside out, in words; "" if nowhere. Collective."""
    if problem.bulk.linear:
        return ""
    smallest, place = smallest_jacobian(problem, vertices=False)
    if smallest > 0:
        return ""
    where = ", ".join(f"{c:.4g}" for c in place)
    return f"its solution has det F = {smallest:.3g} at ({where})"
