# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL scalars of what is given at contact points, compiled, and evaluated at any number of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact._forms import compiled_expression

__all__ = ["Flat", "Values"]

Array = npt.NDArray[np.float64]


class Flat:
    """UFL expressions of any shape, component by component."""

    def __init__(self) -> None:
        self.components: list[Any] = []

    def add(self, expression: Any) -> list[int]:
        """The columns that the expression will have."""
        e = ufl.as_ufl(expression)
        first = len(self.components)
        self.components += [e[i] for i in np.ndindex(e.ufl_shape)] if e.ufl_shape else [e]
        return list(range(first, len(self.components)))


class Values:
    """UFL scalars at points, the cells of a mesh with one value per cell. Collective.

    Args:
        components: UFL in ``w``.
        w: what is given at a point, a column each, for as many points at once as there are cells.
        comm: of the ranks that compile together.
    """

    def __init__(self, components: Sequence[Any], w: fem.Function, comm: MPI.Comm):
        self.components = list(components)
        self._w = w
        self._mesh = w.function_space.mesh
        self._dofs = w.function_space.dofmap.list[:, 0]
        middle = np.array([[0.5]])
        self._compiled = compiled_expression(ufl.as_vector(self.components), middle, comm)

    def __call__(self, columns: Array) -> Array:
        """Values (n, components) where ``columns`` (n, columns of w) are given. Not collective."""
        n = len(columns)
        chunk = len(self._dofs)
        width = len(self.components)
        given = self._w.x.array.reshape(chunk, -1)
        found = np.empty((n, width))
        for a in range(0, n, chunk):
            part = columns[a : a + chunk]
            given[self._dofs[: len(part)]] = part
            cells = np.arange(len(part), dtype=np.int32)
            found[a : a + chunk] = self._compiled.eval(self._mesh, cells).reshape(len(part), width)
        return found
