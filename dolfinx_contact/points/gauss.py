# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss points of the integral method: of whole facets, or of what faces have in common.

Between faces that do not match the points are those of the common parts of a facet of the slave and
one of the master, where both have smooth bases. Points of whole facets of the slave fail the patch
test: with some per facet the forces on the master are off by percents.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem

from dolfinx_contact._compat import FacetSubmesh, geometry_dofmap
from dolfinx_contact._geometry import node_positions
from dolfinx_contact.points.clipping import basis, tabulated
from dolfinx_contact.points.operators import Stencils
from dolfinx_contact.points.opposite import Common
from dolfinx_contact.points.trace import facet_closures

__all__ = ["CommonPoints", "GaussPoints"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


@dataclass(frozen=True)
class GaussPoints:
    """Points in groups of as many each, a group on one facet.

    Attributes:
        numbers: local, of the points of every group (groups, p).
        cells: of the submesh of the facets, by group.
        x: reference coordinates in the cells (groups, p, dim - 1).
    """

    numbers: Nodes
    cells: npt.NDArray[np.int32]
    x: Array

    @staticmethod
    def of_facets(space: fem.FunctionSpace, cells: int) -> GaussPoints:
        """The points of a quadrature space, on the first cells of its mesh."""
        points = space.ufl_element().custom_quadrature()[0]
        numbers = space.dofmap.list[:cells].astype(np.int64)
        x = np.broadcast_to(points, (cells, *points.shape))
        return GaussPoints(numbers, np.arange(cells, dtype=np.int32), x)

    def table(self, W: fem.FunctionSpace) -> Array:
        """Basis functions of a Lagrange space on the submesh at the points (groups, p, k)."""
        element = W.ufl_element()
        scalar = element.sub_elements[0] if element.block_size > 1 else element
        # Of whole facets all groups are alike.
        alike = self.x.strides[0] == 0 and len(self.x) > 0
        values = tabulated(scalar.basix_element, self.x[:1] if alike else self.x)
        return np.broadcast_to(values, (len(self.x), *values.shape[1:]))


class CommonPoints:
    """Contact points on the common parts of two faces.

    Args:
        V: displacement space.
        submesh: of the slave's facets.
        common: of slave and master.
        degree: of the quadrature.
        axisymmetric: whether areas are those of a body of revolution.

    Attributes:
        areas: of the points (n,).
        positions: on the slave (n, dim).
        cells: of the body, at the slave, of the points (n,).
        gauss: the points, a group to every piece.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        common: Common,
        degree: int,
        *,
        axisymmetric: bool,
    ):
        self._cover = common.cover
        dim = V.mesh.geometry.dim
        self._degree = int(V.ufl_element().degree)
        rule = self._rule = common.cover.rule(degree)
        slave = common.cover.slave
        pieces, p = rule.weights.shape
        numbers = np.arange(pieces * p, dtype=np.int64).reshape(pieces, p)
        self.areas = rule.weights.reshape(-1)
        hats = basis(rule.mine, slave.corners, 1)
        x = np.einsum("gpk,gkd->gpd", hats, slave.x[common.cover.facet])
        self.positions = x.reshape(-1, dim)
        if axisymmetric:
            self.areas = 2 * np.pi * self.positions[:, 0] * self.areas
        parents = submesh.parent_facets
        order = np.argsort(parents)
        facets = common.facets[common.cover.facet]
        cells = order[np.searchsorted(parents[order], facets)].astype(np.int32)
        to_cells = V.mesh.topology.connectivity(dim - 1, dim)
        self.cells = np.repeat(to_cells.array[to_cells.offsets[facets]], p).astype(np.int32)
        self.gauss = GaussPoints(numbers, cells, self._in_submesh(V, submesh, facets, cells, hats))

    def _in_submesh(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        facets: npt.NDArray[np.int32],
        cells: npt.NDArray[np.int32],
        hats: Array,
    ) -> Array:
        """Reference coordinates in the cells of the submesh, whose corners may be in any order."""
        k = hats.shape[2]
        corners = node_positions(V)[facet_closures(V, facets)[:, :k]]
        theirs = submesh.mesh.geometry.x[geometry_dofmap(submesh.mesh)[cells]]
        distance = np.linalg.norm(corners[:, :, None] - theirs[:, None], axis=3)
        reference = basix.geometry(submesh.mesh.basix_cell())
        places = reference[np.argmin(distance, axis=2)]
        return np.einsum("gpk,gka->gpa", hats, places)

    def opposite(self, slave: Stencils) -> Stencils:
        """Those of the master, at the points of those of the slave."""
        nodes = self._cover.master.nodes[self._cover.other]
        weights = basis(self._rule.theirs, self._cover.master.corners, self._degree)
        return replace(slave, nodes=nodes, weights=weights)
