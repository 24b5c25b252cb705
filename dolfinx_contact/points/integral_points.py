# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points that are Gauss points: of the integral method (`contact_points`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator, Trace
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluation import (
    PointEvaluator,
    ScatteredEvaluator,
    measure_of,
    point_space,
)
from dolfinx_contact.points.gauss import CommonPoints, GaussPoints
from dolfinx_contact.points.held_ends import receiving_vertices
from dolfinx_contact.points.operators import Stencils
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.trace import point_ids, trace_dofs

__all__ = ["CommonFacetPoints", "FacetPoints"]

Array = npt.NDArray[np.float64]


class FacetPoints(ContactPoints):
    """The Gauss points of facets."""

    method: ClassVar[ContactMethod] = "integral"

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self._gauss = self._gauss_points(rule_degree, opposite)
        self._hats = self._gauss.table(self.vertices)
        self.number = int(self._gauss.numbers.size)
        self.ids, self.vertex_ids = point_ids(self.vertices, self._gauss.cells, self._gauss.numbers)

    def _gauss_points(self, rule_degree: int, opposite: Opposite | None) -> GaussPoints:
        """The points, of which `space` has a dof each. Collective."""
        self.space = point_space(self.submesh.mesh, rule_degree)
        self._rule = measure_of(self._V.mesh, self.submesh.parent_facets, rule_degree)
        return GaussPoints.of_facets(self.space, self._owned_cells)

    def _measure(self, opposite: Opposite | None) -> None:
        self.areas = self._evaluate.areas[: self.number].copy()
        self._of_vertices = PointEvaluator(
            self.vertices, self._at_nodes, self.given.at_points, self._maps
        )
        self.vertex_areas = self._of_vertices.areas
        self.circumferences = np.ones(len(self.vertex_areas))
        if self._weight is not None:
            sections = self.vertex_areas
            self.vertex_areas = self._swept()
            self.circumferences = self.vertex_areas / sections
        if opposite is not None and opposite.areas is not None:
            self.vertex_areas = opposite.areas[self.vertex_trace_dofs]
            self._covered_areas = self.vertex_areas

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return PointEvaluator(self.space, self._rule, expressions, self._maps, self._weight)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return self._of_vertices()

    def from_vertices(self, values: Array) -> Array:
        found: Array = np.zeros(self.number)
        corners = values[self.vertices.dofmap.list[self._gauss.cells]]
        found[self._gauss.numbers] = np.einsum("gpv,gv->gp", self._hats, corners)
        return found

    @cached_property
    def _of_corners(self) -> SharedValues:
        return SharedValues(self.vertices.dofmap.index_map)

    def at_vertices(self, values: Array) -> Array:
        width = int(np.prod(values.shape[1:], dtype=int))  # a rank may have no points
        columns = [np.ones(self.number), values.reshape(self.number, width)]
        weighted = self.areas[:, None] * np.column_stack(columns)
        corners = self.vertices.dofmap.list[self._gauss.cells]
        parts = np.einsum("gpv,gpw->gvw", self._hats, weighted[self._gauss.numbers])
        sums = self._of_corners.sums(corners, parts)
        # Of faces in part opposite to nothing some vertices have no point.
        means = np.divide(
            sums[:, 1:], sums[:, :1], out=np.zeros_like(sums[:, 1:]), where=sums[:, :1] > 0
        )
        return means.reshape(-1, *values.shape[1:])

    @property
    def cells(self) -> npt.NDArray[np.int32]:
        return np.unique(self._gauss.cells)

    def _stencils(self, trace: Trace) -> Stencils:
        sub = self.submesh.mesh
        cells = self._gauss.cells
        u_element = self._V.ufl_element()
        U = point_space(sub, None)
        if u_element.degree > 1:
            U = fem.functionspace(sub, ("Lagrange", u_element.degree))
        at = trace_dofs(self._V, U, self.submesh.parent_facets)[U.dofmap.list[cells]]
        nodes, shares = trace(at)  # (groups, basis functions, nodes of each)
        mine = self.Q.dofmap.list[cells]
        known = self.Q.dofmap.index_map.local_to_global(mine.reshape(-1)).reshape(mine.shape)
        b = self._gauss.table(U)
        groups, p, k = b.shape
        weights = b[..., None] * shares[:, None]
        return Stencils(
            self._gauss.numbers,
            nodes.reshape(groups, k * shares.shape[2]),
            weights.reshape(groups, p, k * shares.shape[2]),
            known.astype(np.int64),
            self._gauss.table(self.Q),
            False,
        )

    def _give(
        self, alone: Stencils, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        # Tractions are sums of functions of degree 1: those are given.
        nodes, shares, given = receiving_vertices(self.vertices, given, idle)
        corners = self.Q.dofmap.list[self._gauss.cells]
        groups, p, k = alone.multiplier_weights.shape
        width = k * shares.shape[1]
        weights = alone.multiplier_weights[..., None] * shares[corners][:, None]
        self._disconnect()
        self._connect(
            replace(
                alone,
                multiplier_nodes=nodes[corners].reshape(groups, width),
                multiplier_weights=weights.reshape(groups, p, width),
            )
        )
        return given


class CommonFacetPoints(FacetPoints):
    """The Gauss points of what the facets of two faces that do not match have in common."""

    def _gauss_points(self, rule_degree: int, opposite: Opposite | None) -> GaussPoints:
        assert opposite is not None
        assert opposite.common is not None
        self.space = self.vertices
        self._common = CommonPoints(
            self._V,
            self.submesh,
            opposite.common,
            rule_degree,
            axisymmetric=self._weight is not None,
        )
        return self._common.gauss

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        at = self._common
        return ScatteredEvaluator(self._V.mesh, at.cells, at.positions, at.areas, expressions)

    def _opposite_to(self, stencils: Stencils, opposite: Opposite) -> Stencils:
        return self._common.opposite(stencils)
