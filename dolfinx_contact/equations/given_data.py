# SPDX-License-Identifier: LGPL-3.0-or-later
"""What users may change between two solves: the Functions and Constants of a contact problem."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact.equations.contact import ContactEquations

__all__ = ["GivenData", "given_data", "numbers_of"]


def given_data(eq: ContactEquations) -> list[Any]:
    """Functions and Constants in bulk, obstacles, laws, rigid bodies and Dirichlet conditions.

    None of them is the displacement; one that is in several places is there several times.
    """
    found = [*eq.bulk.residual.coefficients(), *extract_constants(eq.bulk.residual)]
    for s in eq.surfaces:
        for e in s.given.all:
            found += [*ufl.algorithms.extract_coefficients(e), *extract_constants(e)]
    for body in eq.rigid.bodies:
        for e in body.expressions:
            found += extract_constants(e)
    found += [dirichlet_value(bc) for bc in eq.bcs]
    return [f for f in found if f is not eq.bulk.displacement]


class GivenData:
    """The values of what users may change, as they are when this is made.

    Args:
        eq: the contact problem.
    """

    def __init__(self, eq: ContactEquations):
        self._values = [(f, _values(f).copy()) for f in given_data(eq)]

    def stands(self) -> bool:
        """Whether all values are those still, on this rank. Not collective."""
        return all(np.array_equal(_values(f), values) for f, values in self._values)

    def restore(self) -> None:
        """Put the values back, bit by bit. Not collective."""
        for f, values in self._values:
            _values(f)[...] = values


def numbers_of(eq: ContactEquations) -> list[list[float]]:
    """What the data are known by, on any number of ranks. Collective.

    Returns:
        The values of every Constant; mean and root of the mean square of every Function.
    """
    found: list[list[float]] = []
    for f in given_data(eq):
        if not hasattr(f, "x"):
            found.append([float(v) for v in np.real(np.ravel(f.value))])
            continue
        V = f.function_space
        owned = f.x.array[: V.dofmap.index_map.size_local * V.dofmap.index_map_bs]
        sums = [float(len(owned)), float(np.sum(owned)), float(np.sum(owned**2))]
        n, total, squares = eq.comm.allreduce(np.array(sums))
        found.append([float(total / n), float(np.sqrt(squares / n))])
    return found


def _values(f: fem.Function | fem.Constant) -> npt.NDArray[np.float64]:
    return np.asarray(f.x.array if hasattr(f, "x") else f.value)
