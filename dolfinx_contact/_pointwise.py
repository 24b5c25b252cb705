# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of UFL scalars at points that belong to no quadrature rule.

The points are the cells of a small mesh, with one value of each datum per cell. The code that is
compiled therefore does not depend on a discretisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array
from dolfinx_contact._forms import compiled_expression

__all__ = ["PointValues", "ScalarList", "point_data"]

_CHUNK = 256  # number of points evaluated at once


def point_data(width: int) -> fem.Function:
    """Return a Function with the data of a point in each cell of a small mesh, in columns."""
    points = mesh.create_interval(MPI.COMM_SELF, _CHUNK, (0.0, 1.0))
    element = basix.ufl.element("DG", "interval", 0, shape=(width,))
    return fem.Function(fem.functionspace(points, element))


class ScalarList:
    """List of the scalar components of UFL expressions."""

    def __init__(self) -> None:
        self.components: list[Any] = []

    def add(self, expression: Any) -> list[int]:
        """Append the components of an expression and return their numbers."""
        e = ufl.as_ufl(expression)
        first = len(self.components)
        self.components += [e[i] for i in np.ndindex(e.ufl_shape)] if e.ufl_shape else [e]
        return list(range(first, len(self.components)))


class PointValues:
    """Compiled UFL scalars, evaluated at any number of points. Only construction is collective.

    Several evaluations are made if there are more points than cells.

    Args:
        components: UFL scalars in ``w``.
        w: Function with the data of a point, one component per datum; see `point_data`.
        comm: communicator of the ranks that compile together.
    """

    def __init__(self, components: Sequence[Any], w: fem.Function, comm: MPI.Comm):
        self.components = list(components)
        self._w = w
        self._mesh = w.function_space.mesh
        self._dofs = w.function_space.dofmap.list[:, 0]
        middle = np.array([[0.5]])
        self._compiled = compiled_expression(ufl.as_vector(self.components), middle, comm)

    def __call__(self, columns: Array) -> Array:
        """Return values (n, components) for the data ``columns``, shape (n, components of w)."""
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
