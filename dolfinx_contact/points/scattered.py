# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of UFL at any points of the body, which are those of no quadrature rule.

In the expressions the coordinates, Functions and Constants give way to their values at the points:
what is compiled is evaluated on the cells of a small mesh, with one value of everything per cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import fem, mesh
from ufl.algorithms import expand_derivatives
from ufl.algorithms.analysis import extract_constants
from ufl.classes import Derivative, GeometricQuantity, SpatialCoordinate
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._forms import compiled_expression

__all__ = ["ScatteredEvaluator"]

Array = npt.NDArray[np.float64]

_CHUNK = 256  # points that are evaluated at once


class ScatteredEvaluator:
    """Values of UFL expressions at points in cells of a mesh; as `evaluation.PointEvaluator`.

    Args:
        domain: of the expressions.
        cells: local, of the points (n,).
        x: the points (n, dim).
        areas: of the points (n,).
        expressions: UFL scalars and vectors by name, of coordinates, Constants and Functions.

    Raises:
        ValueError: on every rank, if there are derivatives of Functions in an expression, a
            geometric quantity but the coordinates, or a Function that only quadrature points have.
    """

    def __init__(
        self,
        domain: mesh.Mesh,
        cells: npt.NDArray[np.int32],
        x: Array,
        areas: Array,
        expressions: Mapping[str, Any],
    ):
        self.areas = areas
        self._cells = cells
        self._dim = x.shape[1]
        self._x = np.zeros((len(x), 3))
        self._x[:, : self._dim] = x
        every = {name: expand_derivatives(ufl.as_ufl(e)) for name, e in expressions.items()}
        for name, e in every.items():
            _check(name.strip(":"), e)
        parts = list(every.values())
        self._functions = _once(f for e in parts for f in ufl.algorithms.extract_coefficients(e))
        self._constants = _once(c for e in parts for c in extract_constants(e))
        given = [ufl.SpatialCoordinate(domain), *self._functions, *self._constants]
        ends = np.cumsum([int(np.prod(g.ufl_shape, dtype=int)) for g in given])
        little = mesh.create_interval(MPI.COMM_SELF, _CHUNK, (0.0, 1.0))
        element = basix.ufl.element("DG", "interval", 0, shape=(int(ends[-1]),))
        self._w = w = fem.Function(fem.functionspace(little, element))
        self._dofs = w.function_space.dofmap.list[:, 0]
        columns = np.split(np.array(list(w)), ends[:-1])
        known = {
            g: ufl.as_tensor(part.reshape(g.ufl_shape).tolist()) if g.ufl_shape else part[0]
            for g, part in zip(given, columns, strict=True)
        }
        # FFCx compiles no expression in which nothing but numbers occurs.
        components = [w[0]]
        self._places = dict[str, tuple[int, tuple[int, ...]]]()
        for name, e in every.items():
            self._places[name] = len(components), e.ufl_shape
            e = ufl.replace(e, known)
            components += [e[i] for i in np.ndindex(e.ufl_shape)] if e.ufl_shape else [e]
        self._compiled = compiled_expression(
            ufl.as_vector(components), np.array([[0.5]]), domain.comm
        )
        self._width = len(components)

    def __call__(self) -> dict[str, Array]:
        """One array per expression over the points of this rank. Not collective."""
        n = len(self._cells)
        columns = [self._x[:, : self._dim]]
        for f in self._functions:
            columns.append(f.eval(self._x, self._cells).reshape(n, -1) if n else np.empty((0, 0)))
        columns += [
            np.broadcast_to(np.ravel(c.value), (n, np.size(c.value))) for c in self._constants
        ]
        values = np.empty((n, self._width))
        if n:
            given = np.concatenate(columns, axis=1)
            mine = self._w.x.array.reshape(_CHUNK, -1)
            little = self._w.function_space.mesh
            for a in range(0, n, _CHUNK):
                part = given[a : a + _CHUNK]
                mine[self._dofs[: len(part)]] = part
                found = self._compiled.eval(little, np.arange(len(part), dtype=np.int32))
                values[a : a + _CHUNK] = found.reshape(len(part), -1)
        return {
            name: values[:, first : first + int(np.prod(shape, dtype=int))].reshape(-1, *shape)
            for name, (first, shape) in self._places.items()
        }


def _once(things: Any) -> list[Any]:
    return list(dict.fromkeys(things))


def _check(name: str, e: Any) -> None:
    """Raise ``ValueError`` if an expression is not one of values at its point alone."""
    where = f"the {name} of faces that do not match"
    for part in unique_pre_traversal(e):
        if isinstance(part, Derivative):
            raise ValueError(f"{where} may not depend on derivatives: interpolate them first")
        if isinstance(part, GeometricQuantity) and not isinstance(part, SpatialCoordinate):
            raise ValueError(
                f"{where} may depend on coordinates, Functions and Constants, not on {part}"
            )
        if isinstance(part, fem.Function) and part.ufl_element().has_custom_quadrature:
            raise ValueError(f"{where} may not depend on values at quadrature points")
