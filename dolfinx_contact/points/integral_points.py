# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points that are Gauss points: integral method (`contact_points`).

Between faces that do not match, the points are those of the common parts of a slave facet and a
master facet, where both have smooth bases. Points of whole slave facets fail the patch test: with
some points per facet, the forces on the master are off by percents.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem

from dolfinx_contact._compat import geometry_dofmap
from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.clipping import basis, tabulated
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator, Trace
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluation import (
    PointEvaluator,
    ScatteredEvaluator,
    measure_of,
    point_space,
)
from dolfinx_contact.points.geometry import SurfaceGeometry
from dolfinx_contact.points.held_ends import receiving_vertices
from dolfinx_contact.points.operators import Stencils
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.trace import facet_closures, point_ids, trace_dofs

__all__ = ["CommonFacetPoints", "FacetPoints"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Nodes = npt.NDArray[np.int64]


@dataclass(frozen=True)
class _GaussPoints:
    """Points in groups of equal size, each group on one facet.

    Attributes:
        numbers: local numbers of the points, shape (groups, p).
        cells: cells of the submesh by group.
        x: reference coordinates in the cells, shape (groups, p, dim - 1).
    """

    numbers: Nodes
    cells: npt.NDArray[np.int32]
    x: Array

    def table(self, W: fem.FunctionSpace) -> Array:
        """Return basis functions of a Lagrange space at the points, shape (groups, p, k)."""
        element = W.ufl_element()
        scalar = element.sub_elements[0] if element.block_size > 1 else element
        # groups of whole facets are alike
        alike = self.x.strides[0] == 0 and len(self.x) > 0
        values = tabulated(scalar.basix_element, self.x[:1] if alike else self.x)
        return np.broadcast_to(values, (len(self.x), *values.shape[1:]))


class FacetPoints(ContactPoints):
    """Gauss points of facets."""

    method: ClassVar[ContactMethod] = "integral"

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self._gauss = self._gauss_points(rule_degree, opposite)
        self._hats = self._gauss.table(self.vertices)
        self._corners = self.vertices.dofmap.list[self._gauss.cells]
        self.number = int(self._gauss.numbers.size)
        self.ids, self.vertex_ids = point_ids(self.vertices, self._gauss.cells, self._gauss.numbers)

    def _gauss_points(self, rule_degree: int, opposite: Opposite | None) -> _GaussPoints:
        """Return the points; `space` has one dof for each. Collective."""
        domain = self.submesh.mesh
        self.space = point_space(domain, rule_degree)
        self._rule = measure_of(self._V.mesh, self.submesh.parent_facets, rule_degree)
        cells = np.arange(domain.topology.index_map(domain.topology.dim).size_local, dtype=np.int32)
        points = self.space.ufl_element().custom_quadrature()[0]
        numbers = self.space.dofmap.list[: len(cells)].astype(np.int64)
        return _GaussPoints(numbers, cells, np.broadcast_to(points, (len(cells), *points.shape)))

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        self.areas = self._evaluate.areas[: self.number].copy()
        self._of_vertices = PointEvaluator(
            self.vertices, self._at_nodes, self.given.at_points, self._maps
        )
        return self._geometry(self._of_vertices.areas, opposite)

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return PointEvaluator(self.space, self._rule, expressions, self._maps, self._weight)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return self._of_vertices()

    def from_vertices(self, values: Array) -> Array:
        at_points: Array = np.zeros(self.number)
        at_points[self._gauss.numbers] = np.einsum("gpv,gv->gp", self._hats, values[self._corners])
        return at_points

    @cached_property
    def _vertex_values(self) -> SharedValues:
        return SharedValues(self.vertices.dofmap.index_map)

    def at_vertices(self, values: Array) -> Array:
        width = int(np.prod(values.shape[1:], dtype=int))  # a rank may have no points
        columns = [np.ones(self.number), values.reshape(self.number, width)]
        weighted = self.areas[:, None] * np.column_stack(columns)
        parts = np.einsum("gpv,gpw->gvw", self._hats, weighted[self._gauss.numbers])
        sums = self._vertex_values.sums(self._corners, parts)
        # on partly covered faces some vertices have no point
        means = np.divide(
            sums[:, 1:], sums[:, :1], out=np.zeros_like(sums[:, 1:]), where=sums[:, :1] > 0
        )
        return means.reshape(-1, *values.shape[1:])

    @property
    def cells(self) -> npt.NDArray[np.int32]:
        return np.unique(self._gauss.cells)

    def _stencils(self, trace: Trace) -> Stencils:
        cells = self._gauss.cells
        degree = self._V.ufl_element().degree
        U = self.vertices
        if degree > 1:
            U = fem.functionspace(self.submesh.mesh, ("Lagrange", degree))
        at = trace_dofs(self._V, U, self.submesh.parent_facets)[U.dofmap.list[cells]]
        nodes, shares = trace(at)  # (groups, basis functions, nodes of each)
        mine = self.Q.dofmap.list[cells]
        multipliers = self.Q.dofmap.index_map.local_to_global(mine.reshape(-1)).reshape(mine.shape)
        weights = self._gauss.table(U)[..., None] * shares[:, None]
        groups, p, k, width = weights.shape
        return Stencils(
            self._gauss.numbers,
            nodes.reshape(groups, k * width),
            weights.reshape(groups, p, k * width),
            multipliers.astype(np.int64),
            self._gauss.table(self.Q),
            False,
        )

    def _give(self, given: Mask, idle: Mask) -> Mask:
        # tractions are sums of functions of degree 1, which are given away
        nodes, shares, given = receiving_vertices(self.vertices, given, idle)
        corners = self.Q.dofmap.list[self._gauss.cells]
        groups, p, k = self._weights.multiplier_weights.shape
        width = k * shares.shape[1]
        weights = self._weights.multiplier_weights[..., None] * shares[corners][:, None]
        self._connect(
            replace(
                self._weights,
                multiplier_nodes=nodes[corners].reshape(groups, width),
                multiplier_weights=weights.reshape(groups, p, width),
            )
        )
        return given


class CommonFacetPoints(FacetPoints):
    """Gauss points of the common parts of the facets of two faces that do not match."""

    def _gauss_points(self, rule_degree: int, opposite: Opposite | None) -> _GaussPoints:
        assert opposite is not None
        assert opposite.common is not None
        self.space = self.vertices
        V, domain = self._V, self.submesh.mesh
        cover, slave = opposite.common.cover, opposite.common.cover.slave
        self._cover = cover
        self._cover_rule = rule = cover.rule(rule_degree)
        pieces, p = rule.weights.shape
        hats = basis(rule.mine, slave.corners, 1)
        x = np.einsum("gpk,gkd->gpd", hats, slave.x[cover.facet])
        self._x = x.reshape(-1, self.dim)
        self._piece_areas = rule.weights.reshape(-1)
        if self._weight is not None:
            self._piece_areas = 2 * np.pi * self._x[:, 0] * self._piece_areas
        # cells of the submesh and of the body
        parents = self.submesh.parent_facets
        order = np.argsort(parents)
        facets = opposite.common.facets[cover.facet]
        cells = order[np.searchsorted(parents[order], facets)].astype(np.int32)
        to_cells = V.mesh.topology.connectivity(self.dim - 1, self.dim)
        bodies = to_cells.array[to_cells.offsets[facets]]
        self._body_cells = np.repeat(bodies, p).astype(np.int32)
        # reference coordinates in the submesh, whose corners may be in any order
        corners = node_positions(V)[facet_closures(V, facets)[:, : slave.corners]]
        theirs = domain.geometry.x[geometry_dofmap(domain)[cells]]
        distance = np.linalg.norm(corners[:, :, None] - theirs[:, None], axis=3)
        places = basix.geometry(domain.basix_cell())[np.argmin(distance, axis=2)]
        numbers = np.arange(pieces * p, dtype=np.int64).reshape(pieces, p)
        return _GaussPoints(numbers, cells, np.einsum("gpk,gka->gpa", hats, places))

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return ScatteredEvaluator(
            self._V.mesh, self._body_cells, self._x, self._piece_areas, expressions
        )

    def _opposite_to(self, stencils: Stencils, opposite: Opposite) -> Stencils:
        master = self._cover.master
        degree = int(self._V.ufl_element().degree)
        weights = basis(self._cover_rule.theirs, master.corners, degree)
        return replace(stencils, nodes=master.nodes[self._cover.other], weights=weights)
