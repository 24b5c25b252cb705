# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is given on a contact surface, and its values at the contact points.

At points of no quadrature rule the coordinates, Functions and Constants in an expression give way
to their values there: what is compiled is evaluated on the cells of a small mesh, with one value of
everything per cell (`ScatteredEvaluator`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
import basix.ufl
import ufl
from dolfinx import fem, la, mesh
from ufl.algorithms import expand_derivatives
from ufl.algorithms.analysis import extract_constants
from ufl.classes import Derivative, GeometricQuantity, SpatialCoordinate
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._compat import facet_integration_entities, interpolation_points
from dolfinx_contact._forms import Part, compiled_expression, content_by, derived_form
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact._ufl import data_of
from dolfinx_contact.obstacles import Measured, Obstacle, fields_within, require_uniform
from dolfinx_contact.points.trace import owned_exterior

__all__ = [
    "Given",
    "PointEvaluator",
    "ScatteredEvaluator",
    "at_nodes",
    "fields_of",
    "measure_of",
    "require_same_numbering",
]

Array = npt.NDArray[np.float64]
_CHUNK = 256  # points that are evaluated at once


class PointEvaluator:
    """Values of UFL expressions at the points of a space on a facet submesh.

    The value at a point is the integral of the expression against the point's basis function over
    that of the basis function alone: exact for Gauss points, and for nodes as well where the
    expression has one value there (else the area-weighted mean of the adjacent facets). All
    expressions make one form, compiled once.

    Args:
        W: scalar space with one dof per point: Lagrange degree 1 or a quadrature element.
        ds: measure of the surface; where its quadrature points are those of ``W`` values are local.
        expressions: UFL scalars and vectors by name; may contain Functions of the body.
        maps: of the submesh.
        weight: of all integrals, a UFL scalar; None for 1.

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
        self._measured = measured_in(expressions)
        if self._measured:
            places = {str(i): m.at for i, m in enumerate(self._measured)}
            self._places_of = PointEvaluator(W, ds, places, maps, weight)
            expressions = self._with_functions(W, expressions)
        one = fem.Constant(ds.ufl_domain(), 1.0) if weight is None else weight
        given = [ufl.as_ufl(e) for e in expressions.values()]
        self._places: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._width = 1
        for name, e in zip(expressions, given, strict=True):
            self._places[name] = self._width, e.ufl_shape
            self._width += int(np.prod(e.ufl_shape, dtype=int))
        self._rows = SharedValues(W.dofmap.index_map)
        Q = blocked_space(W, self._width)
        require_same_numbering(W, Q)
        test = ufl.TestFunction(Q)

        def tested() -> ufl.Form:
            components = [one]
            for e in given:
                e = e if weight is None else weight * e
                components += [e[i] for i in np.ndindex(e.ufl_shape)] if e.ufl_shape else [e]
            return ufl.dot(ufl.as_vector(components), test) * ds

        what = "at points" if weight is None else "at points, weighted"
        content = content_by([one, *given, test], [Part.of(ds)])
        self._form = derived_form(what, content, tested, [Q], comm=W.mesh.comm, entity_maps=maps)
        self.areas: Array = self._integrals()[:, 0].copy()

    def _with_functions(
        self, W: fem.FunctionSpace, expressions: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Expressions in which Functions of points stand for what is measured there."""
        self._of_points = [fem.Function(blocked_space(W, *m.ufl_shape)) for m in self._measured]
        known = dict(zip(self._measured, self._of_points, strict=True))
        plain = {name: expand_derivatives(ufl.as_ufl(e)) for name, e in expressions.items()}
        return {name: ufl.replace(e, known) for name, e in plain.items()}

    def _measure(self) -> None:
        """Measure anew what is to be measured. Collective."""
        if self._measured:
            places = self._places_of()
            for i, (m, f) in enumerate(zip(self._measured, self._of_points, strict=True)):
                f.x.array[:] = m.values(places[str(i)]).reshape(-1)

    def _integrals(self) -> Array:
        b = self._rows.zeros(self._width)
        fem.assemble_vector(b.array, self._form)
        b.scatter_reverse(la.InsertMode.add)
        b.scatter_forward()
        return b.array.reshape(-1, self._width)

    def __call__(self) -> dict[str, Array]:
        """One array per expression over the local points, ghosts included. Collective."""
        self._measure()
        values = self._integrals() / self.areas[:, None]
        return {
            name: values[:, first : first + int(np.prod(shape, dtype=int))].reshape(-1, *shape)
            for name, (first, shape) in self._places.items()
        }


def measured_in(expressions: Mapping[str, Any]) -> list[Measured]:
    """What is to be measured at points in UFL expressions, in the order in which it was made."""
    every = map(ufl.as_ufl, expressions.values())
    found = {f for e in every for f in ufl.algorithms.extract_coefficients(e)}
    return sorted((f for f in found if isinstance(f, Measured)), key=lambda f: f.count())


def measure_of(
    domain: mesh.Mesh, facets: npt.NDArray[np.int32], degree: int, rule: str = "default"
) -> ufl.Measure:
    """The measure of the exterior facets among ``facets`` that this rank owns. Collective."""
    entities = facet_integration_entities(domain, owned_exterior(domain, facets))
    ds = ufl.Measure("ds", domain, subdomain_data=[(1, entities)])
    return ds(1, metadata={"quadrature_rule": rule, "quadrature_degree": degree})


def blocked_space(W: fem.FunctionSpace, width: int) -> fem.FunctionSpace:
    """The space of vectors over a scalar space of points."""
    return fem.functionspace(W.mesh, _blocked(W.ufl_element(), width))


@cache
def _blocked(element: Any, width: int) -> Any:
    return basix.ufl.blocked_element(element, shape=(width,))


@cache
def _linear(cell: basix.CellType, dtype: np.dtype[Any]) -> Any:
    return basix.ufl.element("Lagrange", cell, 1, dtype=dtype)


def point_space(domain: mesh.Mesh, degree: int | None) -> fem.FunctionSpace:
    """Scalar space with one dof per vertex, or per Gauss point of a degree."""
    if degree is None:
        return fem.functionspace(domain, _linear(domain.basix_cell(), domain.geometry.x.dtype))
    cell = domain.basix_cell()
    element = basix.ufl.quadrature_element(cell, value_shape=(), scheme="default", degree=degree)
    return fem.functionspace(domain, element)


def require_same_numbering(W: fem.FunctionSpace, Q: fem.FunctionSpace) -> None:
    """Raise ``RuntimeError`` if two spaces of a surface differ in the numbering of their dofs."""
    if not np.array_equal(W.dofmap.list, Q.dofmap.list):
        raise RuntimeError("scalar and vector spaces of a contact surface are numbered differently")


def vertex_function(
    vertices: fem.FunctionSpace, name: str, values: npt.NDArray[np.float64]
) -> fem.Function:
    """A scalar or vector Function by its values at the local vertices. Collective.

    Args:
        vertices: scalar P1 space.
        name: of the Function.
        values: (n,) or (n, components); ghosts get those of their owners.
    """
    shape = values.shape[1:]
    f = fem.Function(blocked_space(vertices, shape[0]) if shape else vertices, name=name)
    f.x.array[:] = values.reshape(-1)
    f.x.scatter_forward()
    return f


@dataclass(frozen=True)
class Given:
    """What is given on the surface, in UFL on the body.

    Attributes:
        gap: signed distance to the obstacle.
        normal: unit normal, from the body into the obstacle.
        fields: of the law, by name.
    """

    gap: Any
    normal: Any
    fields: Mapping[str, Any]

    @property
    def all(self) -> tuple[Any, ...]:
        """All of it."""
        return self.gap, self.normal, *self.fields.values()

    @cached_property
    def data(self) -> dict[str, tuple[list[Any], list[Any]]]:
        """Functions and Constants in everything, by the names of `at_points`."""
        return {name: data_of(ufl.as_ufl(e))[:2] for name, e in self.at_points.items()}

    @property
    def functions(self) -> list[Any]:
        """Functions in everything, as `constants`."""
        return [f for functions, _ in self.data.values() for f in functions]

    @property
    def constants(self) -> list[Any]:
        """Constants in everything, one that is in several places several times."""
        return [c for _, constants in self.data.values() for c in constants]

    @property
    def at_points(self) -> dict[str, Any]:
        """Everything by name; the fields of the law with a colon before theirs."""
        fields = {f":{name}": e for name, e in self.fields.items()}
        return {"gap": self.gap, "normal": self.normal, **fields}


def fields_of(values: Mapping[str, Array]) -> dict[str, Array]:
    """The fields of the law among values by the names of `Given.at_points`."""
    return {name[1:]: v for name, v in values.items() if name.startswith(":")}


def at_nodes(W: fem.FunctionSpace, surface: Obstacle) -> tuple[Array, Array]:
    """Gap and normal of an obstacle at the local nodes of a scalar P1 space. Collective."""
    domain = W.mesh
    found = []
    x = ufl.SpatialCoordinate(domain)
    # FFCx compiles no expression in which nothing but constants occurs.
    nothing = fem.Constant(domain, 0.0) * x
    gap, normal = surface.on(domain)
    what = "the true shape of the master"
    require_uniform(domain.comm, fields_within(surface, domain, what), what)
    for e, shape in ((gap + nothing[0], ()), (normal + nothing, (domain.geometry.dim,))):
        V = fem.functionspace(domain, ("Lagrange", 1, shape)) if shape else W
        f = fem.Function(V)
        f.interpolate(compiled_expression(e, interpolation_points(V)))
        f.x.scatter_forward()
        found.append(f.x.array.reshape(-1, *shape))
    return found[0], found[1]


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
