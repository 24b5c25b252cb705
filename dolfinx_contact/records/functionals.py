# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functionals of contact points, for records, journals and diagrams of branches.

Scalars are those of the tables: in 2D along the tangent, in 3D norms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_contact.results.tables import ContactTable

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["Quantity", "leftmost", "rightmost", "total"]

#: Gap and tangential displacement, normal and tangential force.
Quantity: TypeAlias = Literal["un", "ut", "rn", "rt"]
OfProblem: TypeAlias = "Callable[[ContactProblem], float]"


def leftmost(quantity: Quantity, surface: str | None = None) -> OfProblem:
    """The value at the first contact point in order of coordinates.

    Args:
        quantity: ``"un"``, ``"ut"``, ``"rn"`` or ``"rt"``, as in `ContactTable`.
        surface: its name, by default the first of the problem.

    Raises:
        ValueError: if there is no such quantity; when it is evaluated, if there is no such surface.
    """
    return _of_table(quantity, surface, lambda values, _: float(values[0]))


def rightmost(quantity: Quantity, surface: str | None = None) -> OfProblem:
    """The value at the last contact point in order of coordinates; see `leftmost`."""
    return _of_table(quantity, surface, lambda values, _: float(values[-1]))


def total(quantity: Literal["rn", "rt"], surface: str | None = None) -> OfProblem:
    """The sum over contact points, of contact alone; in 3D of ``rt`` the size of the resultant.

    Arguments and errors as in `leftmost`.
    """
    if quantity not in ("rn", "rt"):
        raise ValueError(f"forces are summed, 'rn' or 'rt', got {quantity!r}")

    def summed(values: npt.NDArray[np.float64], t: ContactTable) -> float:
        in_space = t.dim == 3 and quantity == "rt"
        return float(np.linalg.norm(t.rt.sum(axis=0)) if in_space else values.sum())

    return _of_table(quantity, surface, summed)


def _of_table(quantity: str, surface: str | None, value: Callable[[Any, Any], float]) -> OfProblem:
    """A function of a problem: ``value`` of a column of a table, and of the table."""
    if quantity not in ("un", "ut", "rn", "rt"):
        raise ValueError(f"the quantity must be un, ut, rn or rt, got {quantity!r}")

    def functional(problem: ContactProblem) -> float:
        known = {s.name: s for s in problem.surfaces}
        if surface is not None and surface not in known:
            raise ValueError(f"no surface is named {surface!r}; there are: {', '.join(known)}")
        s = problem.surfaces[0] if surface is None else known[surface]
        t = problem.table(s)
        column = getattr(t, quantity)
        return value(t.along(column) if quantity in ("ut", "rt") else column, t)

    return functional
