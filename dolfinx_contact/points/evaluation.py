# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values at contact points of what is given on the body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._compat import facet_integration_entities
from dolfinx_contact._forms import compiled_form
from dolfinx_contact.points.trace import owned_exterior

__all__ = ["PointEvaluator", "measure_of", "require_same_numbering"]

Array = npt.NDArray[np.float64]


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
        one = fem.Constant(ds.ufl_domain(), 1.0) if weight is None else weight
        components = [one]
        self._places: dict[str, tuple[int, tuple[int, ...]]] = {}
        for name, e in expressions.items():
            e = ufl.as_ufl(e) if weight is None else weight * ufl.as_ufl(e)
            self._places[name] = len(components), e.ufl_shape
            components += [e[i] for i in np.ndindex(e.ufl_shape)] if e.ufl_shape else [e]
        self._index_map = W.dofmap.index_map
        self._width = len(components)
        Q = blocked_space(W, self._width)
        require_same_numbering(W, Q)
        tested = ufl.dot(ufl.as_vector(components), ufl.TestFunction(Q)) * ds
        self._form = compiled_form(tested, maps)
        self.areas: Array = self._integrals()[:, 0].copy()

    def _integrals(self) -> Array:
        b = la.vector(self._index_map, self._width)
        b.array[:] = 0.0
        fem.assemble_vector(b.array, self._form)
        b.scatter_reverse(la.InsertMode.add)
        b.scatter_forward()
        return b.array.reshape(-1, self._width)

    def __call__(self) -> dict[str, Array]:
        """One array per expression over the local points, ghosts included. Collective."""
        values = self._integrals() / self.areas[:, None]
        return {
            name: values[:, first : first + int(np.prod(shape, dtype=int))].reshape(-1, *shape)
            for name, (first, shape) in self._places.items()
        }


def measure_of(
    domain: mesh.Mesh, facets: npt.NDArray[np.int32], degree: int, rule: str = "default"
) -> ufl.Measure:
    """The measure of the exterior facets among ``facets`` that this rank owns. Collective."""
    entities = facet_integration_entities(domain, owned_exterior(domain, facets))
    ds = ufl.Measure("ds", domain, subdomain_data=[(1, entities)])
    return ds(1, metadata={"quadrature_rule": rule, "quadrature_degree": degree})


def blocked_space(W: fem.FunctionSpace, width: int) -> fem.FunctionSpace:
    """The space of vectors over a scalar space of points."""
    element = W.ufl_element()
    domain = W.mesh
    return fem.functionspace(domain, basix.ufl.blocked_element(element, shape=(width,)))


def point_space(domain: mesh.Mesh, degree: int | None) -> fem.FunctionSpace:
    """Scalar space with one dof per vertex, or per Gauss point of a degree."""
    if degree is None:
        return fem.functionspace(domain, ("Lagrange", 1))
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
