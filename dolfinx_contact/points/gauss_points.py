# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss points of facets, or of the common parts of the facets of two faces.

If two faces do not match, the points are Gauss points of the common parts of slave and master
facets, on which the basis functions of both are smooth. Gauss points of whole slave facets fail the
patch test: with a few points per facet, forces on the master are wrong by several percent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import basix
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._compat import FacetSubmesh
from dolfinx_contact._geometry import global_numbers, ratio, transformed
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.clipping import basis, tabulated
from dolfinx_contact.points.evaluators import (
    Evaluator,
    PointEvaluator,
    ScatteredEvaluator,
    measure_of,
    point_space,
)
from dolfinx_contact.points.jump_operators import NodeWeights, Stencils, own_nodes
from dolfinx_contact.points.opposite import Common, Opposite
from dolfinx_contact.points.trace import cells_of, trace_nodes

__all__ = ["CommonGaussPoints", "GaussPoints"]


class GaussPoints:
    """Gauss points of whole facets, in groups of one facet each.

    Args:
        V: displacement space.
        submesh: mesh of the facets.
        vertices: scalar P1 space on the submesh.
        degree: quadrature degree.
        maps: entity maps of the submesh.
        weight: UFL weight of all integrals; None for 1.

    Attributes:
        space: scalar space with one dof per point; P1 space of the vertices if points lie on
            common parts of two faces.
        numbers: local numbers of the p points of each group, shape (groups, p).
        cells: cell of the submesh that contains each group, shape (groups,).
        corners: local vertices at the k corners of the facet of each group, shape (groups, k).
    """

    space: fem.FunctionSpace
    numbers: Ints
    cells: Indices
    _x: Array  # reference coordinates in the cells, shape (groups, p, dim - 1)

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        vertices: fem.FunctionSpace,
        degree: int,
        maps: Any,
        weight: Any,
    ):
        self._V = V
        self._submesh = submesh
        self._vertices = vertices
        self._maps = maps
        self._weight = weight
        self._place(degree)
        self._hats = self._table(vertices)
        self.corners = vertices.dofmap.list[self.cells]
        self._sums = SharedValues(vertices.dofmap.index_map)

    def _place(self, degree: int) -> None:
        """Set `space`, `numbers`, `cells` and reference coordinates of the points. Collective."""
        domain = self._submesh.mesh
        self.space = point_space(domain, degree)
        self._rule = measure_of(self._V.mesh, self._submesh.parent_facets, degree)
        owned = domain.topology.index_map(domain.topology.dim).size_local
        self.cells = np.arange(owned, dtype=np.int32)
        points = self.space.ufl_element().custom_quadrature()[0]
        self.numbers = self.space.dofmap.list[:owned].astype(np.int64)
        self._x = np.broadcast_to(points, (owned, *points.shape))

    @property
    def number(self) -> int:
        """Number of points of this rank."""
        return int(self.numbers.size)

    def _table(self, W: fem.FunctionSpace) -> Array:
        """Return the k basis functions of a Lagrange space at the points, shape (groups, p, k)."""
        element = W.ufl_element()
        scalar = element.sub_elements[0] if element.block_size > 1 else element
        # groups of whole facets are alike
        alike = self._x.strides[0] == 0 and len(self._x) > 0
        values = tabulated(scalar.basix_element, self._x[:1] if alike else self._x)[0]
        return np.broadcast_to(values, (len(self._x), *values.shape[1:]))

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        """Return an evaluator of UFL expressions on the body at the points."""
        return PointEvaluator(self.space, self._rule, expressions, self._maps, self._weight)

    def from_vertices(self, values: Array) -> Array:
        """Return values interpolated from the local vertices to the points, shape (n,)."""
        at_points: Array = np.zeros(self.number)
        at_points[self.numbers] = transformed(self._hats, values[self.corners])
        return at_points

    def at_vertices(self, values: Array, areas: Array) -> Array:
        """Return area-weighted means of values at the points around local vertices. Collective.

        Args:
            values: values at the points, shape (n, ...).
            areas: areas of the points, shape (n,).
        """
        width = int(np.prod(values.shape[1:], dtype=int))  # a rank may have no points
        columns = [np.ones(self.number), values.reshape(self.number, width)]
        weighted = areas[:, None] * np.column_stack(columns)
        parts = self._hats.transpose(0, 2, 1) @ weighted[self.numbers]
        sums = self._sums.sums(self.corners, parts)
        # on partly covered faces some vertices have no point
        whole = np.broadcast_to(sums[:, :1], (len(sums), width))
        return ratio(sums[:, 1:], whole).reshape(len(sums), *values.shape[1:])

    def jumps(self, Q: fem.FunctionSpace, opposite: Opposite | None) -> Stencils:
        """Return the weights of nodes in jumps, and of multiplier nodes in tractions. Collective.

        Args:
            Q: space of the multiplier.
            opposite: opposing points of the nodes; None without another body.
        """
        here = self._stencils(Q, partial(own_nodes, self._V))
        return here if opposite is None else here.minus(self._opposing(Q, here, opposite))

    def _opposing(self, Q: fem.FunctionSpace, here: Stencils, opposite: Opposite) -> Stencils:
        """Return weights of master nodes in displacements opposite to the points. Collective."""
        return self._stencils(Q, opposite.at)

    def _stencils(self, Q: fem.FunctionSpace, trace: Callable[[Indices], NodeWeights]) -> Stencils:
        """Return the weights of nodes in a displacement at the points. Collective."""
        degree = self._V.ufl_element().degree
        U = self._vertices
        if degree > 1:
            U = fem.functionspace(self._submesh.mesh, ("Lagrange", degree))
        at = trace_nodes(self._V, U, self._submesh.parent_facets)[U.dofmap.list[self.cells]]
        displacing = trace(at)  # (groups, basis functions, nodes of each)
        weights = self._table(U)[..., None] * displacing.weights[:, None]
        groups, p, k, width = weights.shape
        return Stencils(
            points=self.numbers,
            nodes=displacing.nodes.reshape(groups, k * width),
            weights=weights.reshape(groups, p, k * width),
            multiplier_nodes=global_numbers(Q.dofmap.index_map, Q.dofmap.list[self.cells]),
            multiplier_weights=self._table(Q),
            identity=False,
        )


class CommonGaussPoints(GaussPoints):
    """Gauss points of the common parts of the facets of two faces that do not match.

    Args:
        common: common parts of the faces.
        args: positional arguments of `GaussPoints`.
    """

    def __init__(self, common: Common, *args: Any):
        self._common = common
        super().__init__(*args)

    def _place(self, degree: int) -> None:
        self.space = self._vertices
        V, domain = self._V, self._submesh.mesh
        dim = V.mesh.geometry.dim
        cover = self._common.cover
        slave = cover.slave
        self._rule_on_pieces = rule = cover.rule(degree)
        pieces, p = rule.weights.shape
        hats = basis(rule.on_slave, slave.corners, 1)
        self._positions = (hats @ slave.x[cover.facet]).reshape(-1, dim)
        self._areas: Array = rule.weights.reshape(-1)
        if self._weight is not None:
            self._areas = 2 * np.pi * self._positions[:, 0] * self._areas
        # cells of the submesh and of the body
        parents = self._submesh.parent_facets
        order = np.argsort(parents)
        facets = self._common.facets[cover.facet]
        self.cells = order[np.searchsorted(parents, facets, sorter=order)].astype(np.int32)
        self._body_cells = np.repeat(cells_of(V.mesh, facets), p)
        # reference coordinates in the submesh, whose corners may be in any order
        trace = trace_nodes(V, self._vertices, parents)
        nodes = trace[self._vertices.dofmap.list[self.cells]]
        theirs = global_numbers(V.dofmap.index_map, nodes)[:, None]
        mine = slave.nodes[cover.facet, : slave.corners, None]
        places = basix.geometry(domain.basix_cell())[np.argmax(mine == theirs, axis=2)]
        self.numbers = np.arange(pieces * p, dtype=np.int64).reshape(pieces, p)
        self._x = hats @ places

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return ScatteredEvaluator(
            self._V.mesh, self._body_cells, self._positions, self._areas, expressions
        )

    def _opposing(self, Q: fem.FunctionSpace, here: Stencils, opposite: Opposite) -> Stencils:
        cover = self._common.cover
        degree = int(self._V.ufl_element().degree)
        weights = basis(self._rule_on_pieces.on_master, cover.master.corners, degree)
        return replace(here, nodes=cover.master.nodes[cover.other], weights=weights)
