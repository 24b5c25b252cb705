# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functionals: functions of the problem that records and journals evaluate at points.

The functionals `leftmost`, `rightmost` and `total` are evaluated at contact points; `ut` and `rt`
are tangential components in 2D and norms in 3D.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import everywhere, require, same_everywhere
from dolfinx_contact._validate import is_number
from dolfinx_contact.laws import status
from dolfinx_contact.results.tables import ContactTable

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = [
    "Functional",
    "Quantity",
    "evaluators",
    "leftmost",
    "rightmost",
    "total",
]

#: Function of the problem that returns a real number, the same on every rank.
Functional: TypeAlias = "Callable[[ContactProblem], float]"
#: Gap and tangential displacement, normal and tangential force.
Quantity: TypeAlias = Literal["un", "ut", "rn", "rt"]

_SAME = 1e-12  # relative difference of sums over the ranks
_COLUMNS = ("branch", "index", "gamma", "step", "corrections", "tau", "norm", "special", "status")


def leftmost(quantity: Quantity, surface: str | None = None) -> Functional:
    """Create a functional: value of a quantity at the leftmost contact point of a surface.

    This is the first point in the order of `ContactTable`: by x, then y, then z.

    Args:
        quantity: column of `ContactTable`: ``"un"``, ``"ut"``, ``"rn"`` or ``"rt"``.
        surface: name of the surface; default: first surface of the problem.

    Raises:
        ValueError: if the quantity is unknown. The evaluation raises it if the surface is unknown.
    """
    return _of_table(quantity, surface, lambda values, _: float(values[0]))


def rightmost(quantity: Quantity, surface: str | None = None) -> Functional:
    """Create a functional: value of a quantity at the rightmost contact point; see `leftmost`."""
    return _of_table(quantity, surface, lambda values, _: float(values[-1]))


def total(quantity: Literal["rn", "rt"], surface: str | None = None) -> Functional:
    """Create a functional: sum of a force over contact points, without support reactions.

    In 3D, the sum of ``rt`` is the norm of the resultant. Arguments and errors are as in
    `leftmost`.
    """
    if quantity not in ("rn", "rt"):
        raise ValueError(f"the quantity must be 'rn' or 'rt', got {quantity!r}")

    def summed(values: Array, t: ContactTable) -> float:
        in_space = t.dim == 3 and quantity == "rt"
        return float(np.linalg.norm(t.rt.sum(axis=0)) if in_space else values.sum())

    return _of_table(quantity, surface, summed)


def _of_table(quantity: str, surface: str | None, value: Callable[[Any, Any], float]) -> Functional:
    """Create a functional from a function of a column of the contact table, and of the table."""
    if quantity not in ("un", "ut", "rn", "rt"):
        raise ValueError(f"the quantity must be un, ut, rn or rt, got {quantity!r}")

    def functional(problem: ContactProblem) -> float:
        surfaces = {s.name: s for s in problem.surfaces}
        name = next(iter(surfaces)) if surface is None else surface
        if name not in surfaces:
            raise ValueError(f"no surface is named {name!r}; there are: {', '.join(surfaces)}")
        t = problem.table(surfaces[name])
        column = getattr(t, quantity)
        return value(t.along(column) if quantity in ("ut", "rt") else column, t)

    return functional


# -- evaluation ------------------------------------------------------------------------------------


def evaluators(
    problem: ContactProblem, functionals: Mapping[str, Functional]
) -> dict[str, Callable[[], float]]:
    """Return functions that evaluate functionals at the present state of the problem. Collective.

    Raises:
        ValueError: on every rank, if a functional is not a function, if its name is empty or the
            name of a column, or if the names or their order differ between ranks.
    """
    with everywhere(problem.comm, "the functionals"):
        for name, functional in functionals.items():
            if not isinstance(name, str) or not name:
                raise ValueError(f"the name of a functional must be a word, got {name!r}")
            if not callable(functional):
                raise ValueError(f"the functional {name!r} must be a function of the problem")
        clash = sorted({*_COLUMNS, *status.KINDS} & set(functionals))
        if clash:
            raise ValueError(f"functionals must not have the names of columns: {', '.join(clash)}")
    same_everywhere(problem.comm, functionals=list(functionals))
    return {name: _evaluator(problem, name, f) for name, f in functionals.items()}


def _evaluator(problem: ContactProblem, name: str, f: Functional) -> Callable[[], float]:
    """Return a function that evaluates a functional; calling it is collective."""
    comm = problem.comm

    def value() -> float:
        with everywhere(comm, f"the functional {name!r}"):
            number = f(problem)
            if not is_number(number):
                raise ValueError(f"the functional {name!r} did not return a number: {number!r}")
        numbers = comm.allgather(float(number))
        same = np.allclose(numbers, numbers[0], rtol=_SAME, atol=0, equal_nan=True)
        message = f"the functional {name!r} differs between ranks ({numbers[:4]}): sum over them"
        require(comm, same, message)
        return numbers[0]

    return value
