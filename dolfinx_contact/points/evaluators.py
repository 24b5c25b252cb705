# SPDX-License-Identifier: LGPL-3.0-or-later
"""Evaluators of UFL data at the contact points of a surface.

`PointEvaluator` integrates over facets. At points outside any quadrature rule, `ScatteredEvaluator`
replaces coordinates, Functions and Constants by their values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

import basix
import basix.ufl
import ufl
from dolfinx import fem, la, mesh
from ufl.algorithms import expand_derivatives, extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.classes import Derivative, GeometricQuantity, SpatialCoordinate
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._arrays import Array, Indices
from dolfinx_contact._compat import facet_integration_entities, interpolation_points
from dolfinx_contact._forms import (
    PointValues,
    ScalarList,
    compiled_expression,
    compiled_form,
    point_data,
)
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.body.bulk import checksum
from dolfinx_contact.obstacles import Measured, Obstacle
from dolfinx_contact.points.trace import owned_exterior

__all__ = [
    "Evaluator",
    "GapsAndNormals",
    "Given",
    "PointEvaluator",
    "ScatteredEvaluator",
    "at_nodes",
    "fields_of",
    "measure_of",
]


class _Columns:
    """Arrangement of the components of several UFL expressions as columns of one array.

    Args:
        expressions: UFL scalars, vectors and tensors by name.
        first: UFL scalar of the first column, in front of the components.
    """

    def __init__(self, expressions: Mapping[str, Any], first: Any):
        flat = ScalarList()
        flat.add(first)
        self._places: dict[str, tuple[slice, tuple[int, ...]]] = {}
        for name, e in expressions.items():
            numbers = flat.add(e)
            self._places[name] = slice(numbers[0], numbers[-1] + 1), e.ufl_shape
        self.components = flat.components

    def by_name(self, values: Array) -> dict[str, Array]:
        """Split columns into one array per expression, shape (n, ...).

        Args:
            values: columns, shape (n, number of columns).
        """
        return {
            name: values[:, place].reshape(-1, *shape)
            for name, (place, shape) in self._places.items()
        }


class PointEvaluator:
    """Evaluator of UFL expressions at the points of a space on a facet submesh.

    The value at a point is the integral of the expression times the basis function of the point,
    divided by the integral of the basis function. It is exact at Gauss points and at nodes where
    the expression is continuous, otherwise an area-weighted mean over adjacent facets. All
    expressions are compiled once in one form.

    Args:
        W: scalar space with one dof per point: Lagrange of degree 1 or a quadrature element.
        ds: measure of the surface, whose quadrature points should be the points of ``W``; otherwise
            values are averages.
        expressions: UFL scalars and vectors by name; may contain Functions of the body.
        maps: entity maps of the submesh.
        weight: UFL weight of all integrals; None for 1.

    Attributes:
        areas: integrals of the basis functions, at the local points.
    """

    def __init__(
        self,
        W: fem.FunctionSpace,
        ds: ufl.Measure,
        expressions: Mapping[str, Any],
        maps: Any,
        weight: Any = None,
    ):
        given = {name: ufl.as_ufl(e) for name, e in expressions.items()}
        found = {f for e in given.values() for f in ufl.algorithms.extract_coefficients(e)}
        measured = sorted((f for f in found if isinstance(f, Measured)), key=lambda f: f.count())
        #: Numerically computed data, each with the Function of the points that receives it.
        self._measured = [(m, fem.Function(blocked_space(W, *m.ufl_shape))) for m in measured]
        if measured:
            places = {str(i): m.at for i, m in enumerate(measured)}
            self._places_of = PointEvaluator(W, ds, places, maps, weight)
            known = dict(self._measured)
            given = {name: ufl.replace(expand_derivatives(e), known) for name, e in given.items()}
        one = fem.Constant(ds.ufl_domain(), 1.0) if weight is None else weight
        self._columns = _Columns(
            given if weight is None else {name: weight * e for name, e in given.items()}, one
        )
        self._width = len(self._columns.components)
        self._rows = SharedValues(W.dofmap.index_map)
        v = ufl.TestFunction(blocked_space(W, self._width))
        form = ufl.dot(ufl.as_vector(self._columns.components), v) * ds
        self._form = compiled_form(form, maps)
        self.areas: Array = self._integrals()[:, 0].copy()

    def _integrals(self) -> Array:
        b = self._rows.zeros(self._width)
        fem.assemble_vector(b.array, self._form)
        b.scatter_reverse(la.InsertMode.add)
        b.scatter_forward()
        return b.array.reshape(-1, self._width)

    def __call__(self) -> dict[str, Array]:
        """Return one array per expression at the local points, ghosts included. Collective."""
        if self._measured:
            places = self._places_of()
            for i, (m, f) in enumerate(self._measured):
                f.x.array[:] = m.values(places[str(i)]).reshape(-1)
        return self._columns.by_name(self._integrals() / self.areas[:, None])


def measure_of(
    domain: mesh.Mesh, facets: Indices, degree: int, rule: str = "default"
) -> ufl.Measure:
    """Return the measure of the owned exterior facets among given local facets. Collective."""
    entities = facet_integration_entities(domain, owned_exterior(domain, facets))
    ds = ufl.Measure("ds", domain, subdomain_data=[(1, entities)])
    return ds(1, metadata={"quadrature_rule": rule, "quadrature_degree": degree})


def blocked_space(W: fem.FunctionSpace, width: int) -> fem.FunctionSpace:
    """Return the space of vectors whose components are in a given scalar space.

    Args:
        W: scalar space with one dof per point.
        width: number of components.
    """
    return fem.functionspace(W.mesh, _blocked(W.ufl_element(), width))


@cache
def _blocked(element: Any, width: int) -> Any:
    return basix.ufl.blocked_element(element, shape=(width,))


@cache
def _linear(cell: basix.CellType, dtype: np.dtype[Any]) -> Any:
    return basix.ufl.element("Lagrange", cell, 1, dtype=dtype)


def point_space(domain: mesh.Mesh, degree: int | None) -> fem.FunctionSpace:
    """Return a scalar space with one dof per vertex (degree None) or per Gauss point."""
    if degree is None:
        return fem.functionspace(domain, _linear(domain.basix_cell(), domain.geometry.x.dtype))
    cell = domain.basix_cell()
    element = basix.ufl.quadrature_element(cell, value_shape=(), scheme="default", degree=degree)
    return fem.functionspace(domain, element)


def vertex_function(vertices: fem.FunctionSpace, name: str, values: Array) -> fem.Function:
    """Return a scalar or vector Function with given values at the local vertices. Collective.

    Args:
        vertices: scalar P1 space.
        name: name of the Function.
        values: values, shape (n,) or (n, components); ghosts get the values of their owners.
    """
    f = fem.Function(blocked_space(vertices, *values.shape[1:]) if values.ndim > 1 else vertices)
    f.name = name
    f.x.array[:] = values.reshape(-1)
    f.x.scatter_forward()
    return f


class DataOf(NamedTuple):
    """Functions and Constants in a UFL expression."""

    functions: list[Any]
    constants: list[Any]


@dataclass(frozen=True)
class Given:
    """Data of a contact surface in UFL: gap, normal and fields of the law.

    Attributes:
        gap: signed distance to the obstacle.
        normal: unit normal, from the body into the obstacle.
        fields: fields of the law by name.
    """

    gap: Any
    normal: Any
    fields: Mapping[str, Any]

    @property
    def at_points(self) -> dict[str, Any]:
        """UFL expressions of all data by name; a colon precedes names of fields of the law."""
        fields = {f":{name}": e for name, e in self.fields.items()}
        return {"gap": self.gap, "normal": self.normal, **fields}

    @cached_property
    def data(self) -> dict[str, DataOf]:
        """Functions and Constants in the data, by the names of `at_points`."""
        given = {name: ufl.as_ufl(e) for name, e in self.at_points.items()}
        return {k: DataOf(extract_coefficients(e), extract_constants(e)) for k, e in given.items()}

    @cached_property
    def _arrays(self) -> list[Any]:
        """Functions in the data, each once, in the same order on every rank."""
        every = {f for data in self.data.values() for f in data.functions}
        return sorted((f for f in every if isinstance(f, fem.Function)), key=lambda f: f.count())

    def scatter(self) -> None:
        """Update the ghost values of all Functions in the data. Collective."""
        for f in self._arrays:
            f.x.scatter_forward()

    def checksum(self) -> int:
        """Return a checksum of the values of all data on this rank."""
        constants = [c for data in self.data.values() for c in data.constants]
        return checksum([*self._arrays, *constants])


def fields_of(values: Mapping[str, Array]) -> dict[str, Array]:
    """Return the fields of the law from values named as in `Given.at_points`."""
    return {name[1:]: v for name, v in values.items() if name.startswith(":")}


class GapsAndNormals(NamedTuple):
    """Gaps, shape (n,), and unit normals, shape (n, dim), of an obstacle at n positions."""

    gap: Array
    normal: Array


def at_nodes(W: fem.FunctionSpace, surface: Obstacle) -> GapsAndNormals:
    """Return gap and normal of an obstacle at the local nodes of a P1 space. Collective."""
    gap, normal = surface.on(W.mesh)
    both = ufl.as_vector([gap, *(normal[i] for i in range(W.mesh.geometry.dim))])
    f = fem.Function(blocked_space(W, len(both)))
    f.interpolate(compiled_expression(both, interpolation_points(f.function_space)))
    f.x.scatter_forward()
    values = f.x.array.reshape(-1, len(both))
    return GapsAndNormals(values[:, 0].copy(), values[:, 1:].copy())


class ScatteredEvaluator:
    """Evaluator of UFL expressions at arbitrary points in cells of a mesh.

    Args:
        domain: mesh of the expressions.
        cells: local cells of the points, shape (n,).
        x: points, shape (n, dim).
        areas: areas of the points, shape (n,).
        expressions: UFL scalars and vectors of coordinates, Constants and Functions, by name.

    Attributes:
        x: points, shape (n, dim). They may be replaced if the expressions contain no Functions.

    Raises:
        ValueError: on every rank, if an expression contains derivatives of Functions, geometric
            quantities other than the coordinates, or Functions defined only at quadrature points.
    """

    def __init__(
        self,
        domain: mesh.Mesh,
        cells: Indices,
        x: Array,
        areas: Array,
        expressions: Mapping[str, Any],
    ):
        self.areas = areas
        self.x = x
        self._cells = cells
        every = {name: expand_derivatives(ufl.as_ufl(e)) for name, e in expressions.items()}
        functions: dict[Any, None] = {}
        constants: dict[Any, None] = {}
        for name, e in every.items():
            _check(name.strip(":"), e)
            functions |= dict.fromkeys(ufl.algorithms.extract_coefficients(e))
            constants |= dict.fromkeys(extract_constants(e))
        self._functions, self._constants = list(functions), list(constants)
        # all data of a point as values of a Function
        given = [ufl.SpatialCoordinate(domain), *functions, *constants]
        ends = np.cumsum([int(np.prod(g.ufl_shape, dtype=int)) for g in given])
        w = point_data(int(ends[-1]))
        known = {
            g: ufl.as_tensor(part.reshape(g.ufl_shape).tolist()) if g.ufl_shape else part[0]
            for g, part in zip(given, np.split(np.array(list(w)), ends[:-1]), strict=True)
        }
        # FFCx does not compile expressions of numbers only: the first column prevents them
        self._columns = _Columns({name: ufl.replace(e, known) for name, e in every.items()}, w[0])
        self._values = PointValues(self._columns.components, w, domain.comm)

    def __call__(self) -> dict[str, Array]:
        """Return one array of values per expression at the points of this rank. Not collective."""
        n, dim = self.x.shape
        values: Array = np.empty((0, len(self._columns.components)))
        if n:
            x = np.pad(self.x, ((0, 0), (0, 3 - dim)))
            data = [self.x]
            data += [f.eval(x, self._cells).reshape(n, -1) for f in self._functions]
            sizes = [(np.ravel(c.value), (n, np.size(c.value))) for c in self._constants]
            data += [np.broadcast_to(*size) for size in sizes]
            values = self._values(np.concatenate(data, axis=1))
        return self._columns.by_name(values)


def _check(name: str, e: Any) -> None:
    """Raise ``ValueError`` if an expression needs more than values at its own point."""
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


Evaluator = PointEvaluator | ScatteredEvaluator
