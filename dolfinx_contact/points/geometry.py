# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a surface at any displacement, areas of its vertices, and sizes of its facets."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._compat import FacetSubmesh
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._geometry import area_vectors, dot, node_positions
from dolfinx_contact.points.trace import facet_normals

__all__ = ["SurfaceFacets", "SurfaceGeometry"]


class SurfaceFacets:
    """Facets of a surface that this rank owns, at any displacement. Not collective.

    Args:
        V: displacement space.
        submesh: mesh of the facets.
        vertices: scalar P1 space on it.
        trace: local node of `V` at each local vertex.

    Attributes:
        trace: local node of `V` at each local vertex.
        corners: local vertices of the facets, shape (n, k).
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        vertices: fem.FunctionSpace,
        trace: Indices,
    ):
        self._V = V
        owned = submesh.mesh.topology.index_map(submesh.mesh.topology.dim).size_local
        self._facets = submesh.parent_facets[:owned]
        self.trace = trace
        self.corners: Ints = vertices.dofmap.list[:owned].astype(np.int64)

    def at_corners(self, values: Array) -> Array:
        """Return values at the corners (n, k, dim) from those at the local nodes (nodes, dim)."""
        return np.asarray(values[self.trace[self.corners]])

    @cached_property
    def reference(self) -> Array:
        """Positions of the corners in the mesh, shape (n, k, dim)."""
        return self.at_corners(node_positions(self._V)[:, : self._V.mesh.geometry.dim])

    @cached_property
    def sense(self) -> Array:
        """Signs of the area vectors of the corners, 1 if they point outward, shape (n,)."""
        outward = facet_normals(self._V.mesh, self._facets)
        return np.sign(dot(area_vectors(self.reference), outward))

    def vectors(self, x: Array) -> Array:
        """Return outward area vectors (n, dim) for positions of the corners (n, k, dim)."""
        return np.asarray(self.sense[:, None] * area_vectors(x))


class SurfaceGeometry:
    """Areas at the local vertices, ghosts included. Collective, like its methods.

    Areas are lengths in 2D, and swept areas of bodies of revolution.

    Args:
        vertices: scalar P1 space on the facets.
        vertex_areas: areas, shape (n,).
        circumferences: ratios of swept areas to areas of the section, shape (n,); 1 for bodies that
            are not bodies of revolution.
        whole: function returning the areas with and without an opposing point.

    Attributes:
        vertex_areas: areas with an opposing point, and those taken over from other vertices.
        circumferences: ratios of swept areas to areas of the section, shape (n,).
        covered_areas: areas with an opposing point; None if all areas have one.
    """

    def __init__(
        self,
        vertices: fem.FunctionSpace,
        vertex_areas: Array,
        circumferences: Array,
        whole: Callable[[], Array],
    ):
        self._vertices = vertices
        self._whole = whole
        self._at_start = vertex_areas
        self.vertex_areas = vertex_areas
        self.circumferences = circumferences
        self.covered_areas: Array | None = None

    def cover(self, areas: Array) -> None:
        """Set the areas with an opposing point, shape (n,)."""
        self.vertex_areas = self.covered_areas = areas

    @cached_property
    def whole_areas(self) -> Array:
        """Areas with and without an opposing point, shape (n,)."""
        return self._at_start if self.covered_areas is None else self._whole()

    @property
    def covered(self) -> Array:
        """Fractions of the areas with an opposing point, shape (n,)."""
        if self.covered_areas is None:
            return np.ones(len(self.vertex_areas))
        return np.asarray(np.minimum(self.covered_areas / self.whole_areas, 1.0))

    @property
    def facet_size(self) -> float:
        """Mean size of a facet: the mean area of a vertex in 2D, its square root in 3D."""
        mean = self.mean(self.vertex_areas / self.circumferences)
        return float(mean ** (1 / self._vertices.mesh.topology.dim))

    @cached_property
    def facet_widths(self) -> fem.Function:
        """Sizes of the facets (lengths in 2D, roots of areas in 3D) on their mesh."""
        W = fem.functionspace(self._vertices.mesh, ("DG", 0))
        widths = fem.Function(W)
        fem.assemble_vector(widths.x.array, compiled_form(ufl.TestFunction(W) * ufl.dx))
        widths.x.array[:] **= 1 / W.mesh.topology.dim
        widths.x.scatter_forward()
        return widths

    def mean(self, values: Array) -> float:
        """Return the mean of values (n,) over the vertices of all ranks."""
        index_map = self._vertices.dofmap.index_map
        total = self._vertices.mesh.comm.allreduce(float(np.sum(values[: index_map.size_local])))
        return float(total / index_map.size_global)
