# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points at nodes, at Gauss points, and at nodes with averages (`contact_points`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluation import Evaluator, Given, PointEvaluator
from dolfinx_contact.points.gauss_points import GaussPoints
from dolfinx_contact.points.geometry import SurfaceGeometry
from dolfinx_contact.points.operators import (
    Stencils,
    multiplied,
    rows_of,
    scaled_rows,
    trace_of,
)
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.shared_functions import receiving_vertices, shared
from dolfinx_contact.points.trace import point_ids

__all__ = ["AveragedPoints", "FacetPoints", "NodePoints"]


class NodePoints(ContactPoints):
    """Mesh nodes of a surface with the vertex rule."""

    method: ClassVar[ContactMethod] = "nodal"

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self.space = self.vertices
        self.number = int(self.vertices.dofmap.index_map.size_local)
        self.ids, self.vertex_ids = point_ids(self.vertices)

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        geometry = self._geometry(opposite, self._evaluate.areas)
        self.areas = geometry.vertex_areas[: self.number].copy()
        return geometry

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        # the vertex rule gives the values also on the axis of a body of revolution
        return PointEvaluator(self.space, self._at_nodes, expressions, self._maps)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return values

    def from_vertices(self, values: Array) -> Array:
        return values[: self.number]

    def at_vertices(self, values: Array) -> Array:
        return self.exchange.from_owners(values)

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        nodes = self.trace_dofs[: self.number]
        here = self._each_alone(*trace_of(self._V)(nodes))
        return here if opposite is None else here.minus(self._each_alone(*opposite.at(nodes)))

    def _each_alone(self, nodes: Ints, weights: Array) -> Stencils:
        """Return the stencils of points that are multiplier nodes."""
        n = self.number
        mine = np.arange(n, dtype=np.int64)[:, None]
        first = self.Q.dofmap.index_map.local_range[0]
        return Stencils(mine, nodes, weights[:, None, :], first + mine, np.ones((n, 1, 1)), True)

    def _give(self, given: Mask, idle: Mask) -> Mask:
        D, self.areas, given = shared(self.vertices, given, idle, self.areas)
        self.geometry.vertex_areas = self.exchange.from_owners(self.areas)
        plain = self._weights.jump_matrix(self.comm, self._owned_nodes, 1)
        means = self._each_alone(*rows_of(D.matMult(plain)))
        plain.destroy()
        self._connect(means)
        self._shared = D
        self.update()
        return given


class AveragedPoints(NodePoints):
    """Vertices in the mixed method, at which jumps and gaps are weighted means.

    The weights are the hat functions of the multiplier, integrated over the surface by Gauss
    points.
    """

    method: ClassVar[ContactMethod] = "mixed"
    _gauss: GaussPoints

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        super()._place(rule_degree, opposite)
        self._gauss = self._gauss_points(rule_degree, opposite)

    def evaluators(self, given: Given, offset: Any) -> tuple[Evaluator, Evaluator | None]:
        here, _ = super().evaluators(given, offset)
        return here, self._gauss.evaluator({"offset": offset})

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        assert self._average is not None
        areas = self._average.areas[: self._gauss.number]
        self._at_gauss = self._gauss.jumps(self.Q, opposite)
        hats = self._at_gauss.traction_matrix(self.comm, self.number, 1)
        #: Matrix of the weighted means, from Gauss points to the owned vertices.
        self._means = hats.transpose(PETSc.Mat())
        hats.destroy()
        points = self._means.createVecs(side="right")
        points.array[:] = areas
        self._means.diagonalScale(None, points)
        points.destroy()
        self.areas = scaled_rows(self._means)
        if opposite is not None and opposite.areas is not None:
            # vertices of uncovered facets have no traction, so that any area serves
            whole = opposite.areas[self.vertex_trace_dofs[: self.number]]
            self.areas = np.where(self.areas > 0.0, self.areas, whole)
        averaged = self.exchange.from_owners(self.areas)
        return self._geometry(opposite, self._evaluate.areas, averaged)

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        at_gauss = self._at_gauss.jump_matrix(self.comm, self._owned_nodes, 1)
        rows = rows_of(self._means.matMult(at_gauss))
        at_gauss.destroy()
        return self._each_alone(*rows)

    def _averaged(self, average: Evaluator | None, offset: Array, normal: Array) -> Array | None:
        assert average is not None
        means = multiplied(self._means, average()["offset"][: self._gauss.number])
        if self.removed_overlap is not None:
            means = means + self.removed_overlap.x.array[: self.number, None] * normal
        return means if self._shared is None else super()._averaged(None, means, normal)

    def destroy(self) -> None:
        super().destroy()
        self._means.destroy()


class FacetPoints(ContactPoints):
    """Gauss points of facets, or of the common parts of two faces that do not match."""

    method: ClassVar[ContactMethod] = "integral"
    _gauss: GaussPoints

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self._gauss = self._gauss_points(rule_degree, opposite)
        self.space = self._gauss.space
        self.number = self._gauss.number
        self.ids, self.vertex_ids = point_ids(self.vertices, self._gauss.cells, self._gauss.numbers)

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        self.areas = self._evaluate.areas[: self.number].copy()
        self._of_vertices = PointEvaluator(
            self.vertices, self._at_nodes, self.given.at_points, self._maps
        )
        return self._geometry(opposite, self._of_vertices.areas)

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return self._gauss.evaluator(expressions)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return self._of_vertices()

    def from_vertices(self, values: Array) -> Array:
        return self._gauss.from_vertices(values)

    def at_vertices(self, values: Array) -> Array:
        return self._gauss.at_vertices(values, self.areas)

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        return self._gauss.jumps(self.Q, opposite)

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
