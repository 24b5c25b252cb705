# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points that are nodes: of the nodal and of the mixed method (`contact_points`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl

from dolfinx_contact._forms import compiled_form
from dolfinx_contact.body.bulk import circumference
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator, Trace
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluation import Given, PointEvaluator
from dolfinx_contact.points.held_ends import shared
from dolfinx_contact.points.operators import Stencils, rows_of
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.trace import point_ids

__all__ = ["AveragedPoints", "NodePoints"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


class NodePoints(ContactPoints):
    """The mesh nodes of a surface, with the vertex rule."""

    method: ClassVar[ContactMethod] = "nodal"

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self.space = self.vertices
        self.number = int(self.vertices.dofmap.index_map.size_local)
        self.ids, self.vertex_ids = point_ids(self.vertices)

    def _measure(self, opposite: Opposite | None) -> None:
        self.vertex_areas = self._evaluate.areas
        self.circumferences = np.ones(len(self.vertex_areas))
        if self._weight is not None:
            sections = self.vertex_areas
            self.vertex_areas = self._swept()
            self.circumferences = self.vertex_areas / sections
        if opposite is not None and opposite.areas is not None:
            self.vertex_areas = opposite.areas[self.vertex_trace_dofs]
            self._covered_areas = self.vertex_areas
        self.areas = self.vertex_areas[: self.number].copy()

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        # Values are those of the vertex rule, on the axis of a body of revolution too.
        return PointEvaluator(self.space, self._at_nodes, expressions, self._maps)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return values

    def from_vertices(self, values: Array) -> Array:
        return values[: self.number]

    def at_vertices(self, values: Array) -> Array:
        return self.with_ghosts(values)

    @property
    def cells(self) -> npt.NDArray[np.int32]:
        return np.arange(self._owned_cells, dtype=np.int32)

    def _stencils(self, trace: Trace) -> Stencils:
        return self._each_alone(*trace(self.trace_dofs[: self.number]))

    def _each_alone(self, nodes: Nodes, weights: Array) -> Stencils:
        """Points that are multiplier nodes."""
        n = self.number
        mine = np.arange(n, dtype=np.int64)[:, None]
        first = self.Q.dofmap.index_map.local_range[0]
        return Stencils(mine, nodes, weights[:, None, :], first + mine, np.ones((n, 1, 1)), True)

    def _give(
        self, alone: Stencils, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        _, areas = self._apart
        D, self.areas, given = shared(self.vertices, given, idle, areas[: self.number])
        self.vertex_areas = self.with_ghosts(self.areas)
        plain = alone.scalar_matrix(self.comm, self._owned_nodes)
        means = self._each_alone(*rows_of(D.matMult(plain), np.ones(self.number)))
        plain.destroy()
        self.destroy()
        self._shared = D
        self._connect(means)
        self.update()
        return given


class AveragedPoints(NodePoints):
    """The nodes of the mixed method, at which gaps and slips are averages."""

    method: ClassVar[ContactMethod] = "mixed"

    def evaluators(self, given: Given, offset: Any) -> tuple[Evaluator, PointEvaluator | None]:
        here, _ = super().evaluators(given, offset)
        average = {"offset": offset}
        return here, PointEvaluator(self.space, self._exact, average, self._maps, self._weight)

    def _measure(self, opposite: Opposite | None) -> None:
        assert self._average is not None
        self.vertex_areas = self._average.areas
        self.circumferences = np.ones(len(self.vertex_areas))
        if self._weight is not None:
            self.circumferences = self.vertex_areas / self._evaluate.areas
        self.areas = self.vertex_areas[: self.number].copy()

    def _stencils(self, trace: Trace) -> Stencils:
        W = self.vertices
        p = ufl.TrialFunction(W)
        q = ufl.TestFunction(W)
        dx = ufl.dx(domain=self.submesh.mesh, metadata={"quadrature_degree": 2})
        product = p * q * dx
        if self._weight is not None:
            exact = {"quadrature_degree": 3}
            product = circumference(self.submesh.mesh) * p * q * dx(metadata=exact)
        consistent = dolfinx.fem.petsc.assemble_matrix(compiled_form(product))
        consistent.assemble()
        at_nodes = super()._stencils(trace).scalar_matrix(self.comm, self._owned_nodes)
        means = consistent.matMult(at_nodes)
        consistent.destroy(), at_nodes.destroy()
        return self._each_alone(*rows_of(means, self.areas))
