# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points that are Gauss points: integral method (`contact_points`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from dolfinx_contact._arrays import Array, Indices, Mask
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluation import Evaluator, PointEvaluator
from dolfinx_contact.points.geometry import SurfaceGeometry
from dolfinx_contact.points.held_ends import receiving_vertices
from dolfinx_contact.points.operators import Stencils
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.trace import point_ids

__all__ = ["FacetPoints"]


class FacetPoints(ContactPoints):
    """Gauss points of facets, or of the common parts of two faces that do not match."""

    method: ClassVar[ContactMethod] = "integral"

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
        return self._geometry(self._of_vertices.areas, opposite)

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return self._gauss.evaluator(expressions)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return self._of_vertices()

    def from_vertices(self, values: Array) -> Array:
        return self._gauss.from_vertices(values)

    def at_vertices(self, values: Array) -> Array:
        return self._gauss.at_vertices(values, self.areas)

    @property
    def cells(self) -> Indices:
        return np.unique(self._gauss.cells)

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
