# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a surface at any displacement, areas of its vertices, and sizes of its facets.

Facets of degree 2 and quadrilaterals are divided into simplices. To measure distances from a master
face, its simplices are gathered on every rank, like the facets of rigid surfaces, so that both use
the same search.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._compat import FacetSubmesh
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._geometry import (
    area_vectors,
    dot,
    global_numbers,
    node_positions,
    tangential,
    unit,
)
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.trace import facet_closures, facet_normals, owned_facets
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets

__all__ = ["MovingFacets", "SurfaceFacets", "SurfaceGeometry", "distance_from_face", "simplices_of"]

#: Simplices of the nodes of a facet, by dimension and number of nodes, in the order of Basix.
_SIMPLICES: dict[tuple[int, int], Any] = {
    (2, 2): [[0, 1]],
    (2, 3): [[0, 2], [2, 1]],
    (3, 3): [[0, 1, 2]],
    (3, 4): [[0, 1, 2], [1, 3, 2]],
    (3, 6): [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
    (3, 9): [[i, j, 8] for i, j in pairwise((0, 4, 1, 6, 3, 7, 2, 5, 0))],
}


class MovingFacets:
    """Boundary facets of a body owned by this rank, with their geometry at any displacement.

    Args:
        V: displacement space.
        facets: local facets owned by this rank.
        places: local nodes of ``V`` at the k corners of each facet, shape (n, k).

    Attributes:
        places: local nodes of the displacement at the k corners of each facet, shape (n, k).
    """

    def __init__(self, V: fem.FunctionSpace, facets: Indices, places: Indices):
        self._V = V
        self._facets = facets
        self.places = places

    def at_corners(self, values: Array) -> Array:
        """Return nodal values at the corners of the facets, shape (n, k, dim).

        Args:
            values: values at the local nodes, shape (nodes, dim).
        """
        return values[self.places]

    @cached_property
    def nodes(self) -> Ints:
        """Global nodes of the displacement at the corners, shape (n, k)."""
        return global_numbers(self._V.dofmap.index_map, self.places)

    @cached_property
    def reference(self) -> Array:
        """Positions of the corners in the mesh, shape (n, k, dim)."""
        return self.at_corners(node_positions(self._V))

    @property
    def size(self) -> float:
        """Maximum over facets and coordinate axes of the extent of a facet in the mesh."""
        return float(np.max(np.ptp(self.reference, axis=1), initial=0.0))

    @cached_property
    def sense(self) -> Array:
        """Signs of the area vectors computed from the corners, 1 if outward, shape (n,)."""
        outward = facet_normals(self._V.mesh, self._facets)
        return np.sign(dot(area_vectors(self.reference), outward))

    def vectors(self, x: Array) -> Array:
        """Return outward area vectors of the facets, shape (n, dim).

        Args:
            x: positions of the corners, shape (n, k, dim).
        """
        return self.sense[:, None] * area_vectors(x)

    def faces(self, x: Array) -> Faces:
        """Return the facets with corners at positions x, shape (n, k, dim)."""
        return Faces(x, unit(self.vectors(x)), self.nodes)


class SurfaceFacets(MovingFacets):
    """Facets of a contact surface owned by this rank.

    Args:
        V: displacement space.
        submesh: mesh of the facets.
        vertices: scalar P1 space on the mesh of the facets.
        trace: local node of the displacement at each local vertex.

    Attributes:
        trace: local node of the displacement at each local vertex.
        corners: local vertices of the facets, shape (n, k).
        exchange: exchange of values at the local vertices between ranks.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        vertices: fem.FunctionSpace,
        trace: Indices,
    ):
        owned = submesh.mesh.topology.index_map(submesh.mesh.topology.dim).size_local
        self.trace = trace
        self.corners: Ints = vertices.dofmap.list[:owned].astype(np.int64)
        self.exchange = SharedValues(vertices.dofmap.index_map)
        super().__init__(V, submesh.parent_facets[:owned], trace[self.corners])

    def around_vertices(self, of_facets: Array) -> Array:
        """Return sums of facet vectors around the local vertices. Collective.

        Args:
            of_facets: vectors of the owned facets, shape (n, dim).
        """
        parts = np.repeat(of_facets[:, None], self.corners.shape[1], axis=1)
        return self.exchange.sums(self.corners, parts)

    def simplices(self, u: Array) -> tuple[Array, Ints, Array]:
        """Return the displaced facets, divided into simplices.

        Args:
            u: displacement of the local nodes, shape (nodes, dim).

        Returns:
            Positions of the local vertices, shape (n, dim); local vertices of the m simplices,
            shape (m, dim); and outward unit normals of the simplices, shape (m, dim).
        """
        now = (node_positions(self._V) + u)[self.trace]
        pieces = _SIMPLICES[now.shape[1], self.corners.shape[1]]
        simplices = self.corners[:, pieces].reshape(-1, now.shape[1])
        normals = area_vectors(now[simplices])
        return now, simplices, unit(np.repeat(self.sense, len(pieces))[:, None] * normals)


class SurfaceGeometry:
    """Areas of the local vertices of a surface, ghosts included. All methods are collective.

    Areas are lengths in 2D, and swept areas for bodies of revolution.

    Args:
        vertices: scalar P1 space on the facets.
        vertex_areas: areas of the vertices, shape (n,).
        circumferences: ratios of swept areas to areas (lengths) in the section of a body of
            revolution, shape (n,); 1 for other bodies.
        whole: function returning the full areas of the vertices, covered or not.
        covered: areas covered by an opposing face, shape (n,); None if all are covered.

    Attributes:
        vertex_areas: covered areas, including areas taken over from other vertices, shape (n,).
        circumferences: ratios of swept areas to areas in the section, shape (n,).
        covered_areas: areas covered by an opposing face, shape (n,); None if all are covered.
    """

    def __init__(
        self,
        vertices: fem.FunctionSpace,
        vertex_areas: Array,
        circumferences: Array,
        whole: Callable[[], Array],
        covered: Array | None = None,
    ):
        self._vertices = vertices
        self._whole = whole
        self._at_start = vertex_areas
        self.vertex_areas = vertex_areas if covered is None else covered
        self.circumferences = circumferences
        self.covered_areas = covered

    @cached_property
    def whole_areas(self) -> Array:
        """Areas of the vertices, including parts that no opposing face covers, shape (n,)."""
        return self._at_start if self.covered_areas is None else self._whole()

    @property
    def covered(self) -> Array:
        """Fraction of the area of each vertex that an opposing face covers, shape (n,)."""
        if self.covered_areas is None:
            return np.ones(len(self.vertex_areas))
        return np.minimum(self.covered_areas / self.whole_areas, 1.0)

    @property
    def facet_size(self) -> float:
        """Mean facet size: mean length per vertex in 2D, square root of the mean area in 3D."""
        mean = self.mean(self.vertex_areas / self.circumferences)
        return float(mean ** (1 / self._vertices.mesh.topology.dim))

    @cached_property
    def facet_widths(self) -> fem.Function:
        """DG0 Function of the sizes of the facets: lengths in 2D, square roots of areas in 3D."""
        W = fem.functionspace(self._vertices.mesh, ("DG", 0))
        widths = fem.Function(W)
        fem.assemble_vector(widths.x.array, compiled_form(ufl.TestFunction(W) * ufl.dx))
        widths.x.array[:] **= 1 / W.mesh.topology.dim
        widths.x.scatter_forward()
        return widths

    def mean(self, values: Array) -> float:
        """Return the mean of vertex values over all ranks.

        Args:
            values: values at the local vertices, shape (n,).
        """
        index_map = self._vertices.dofmap.index_map
        total = self._vertices.mesh.comm.allreduce(float(np.sum(values[: index_map.size_local])))
        return float(total / index_map.size_global)


# -- distances from a master -----------------------------------------------------------------------


class DistanceFromFace(NamedTuple):
    """Signed distances of n points from a face.

    Attributes:
        gap: signed distances along the normals of the face, positive outside, shape (n,).
        beyond: tangential distances from the face, nonzero beyond its edge, shape (n,).
        normal: outward unit normals of the face at the closest points, shape (n, dim).
    """

    gap: Array
    beyond: Array
    normal: Array


def simplices_of(V: fem.FunctionSpace, facets: Indices, u: Array) -> tuple[Array, float]:
    """Return undeformed and displaced simplices of facets, on every rank. Collective.

    Args:
        V: displacement space.
        facets: local facets, ghosts included.
        u: displacement of the local nodes, shape (nodes, dim).

    Returns:
        Undeformed and displaced corners, shape (2, n, dim, dim), ordered so that the undeformed
        `area_vectors` point outward; and the mean size of a facet.
    """
    domain, dim = V.mesh, V.mesh.geometry.dim
    owned = owned_facets(domain, facets)
    closures = facet_closures(V, owned)
    X = node_positions(V)
    pieces = _SIMPLICES[dim, closures.shape[1]]
    both = np.stack([X[closures], (X + u)[closures]])[:, :, pieces].reshape(2, -1, dim, dim)
    outward = np.repeat(facet_normals(domain, owned), len(pieces), axis=0)
    inward = dot(area_vectors(both[0]), outward) < 0.0
    both[:, inward] = both[:, inward, ::-1]
    both = np.concatenate(domain.comm.allgather(both), axis=1)
    area = np.linalg.norm(area_vectors(both[0]), axis=1).mean() * len(pieces)
    return both, float(area) ** (1 / (dim - 1))


def distance_from_face(corners: Array, x: Array) -> DistanceFromFace:
    """Return distances of points from a face that consists of simplices. Not collective.

    Args:
        corners: corners of the simplices, shape (n, dim, dim).
        x: points, shape (m, dim).
    """
    cells = np.arange(corners.shape[0] * corners.shape[1]).reshape(corners.shape[:2])
    closest = ClosestFacets(corners.reshape(-1, corners.shape[2]), cells)(x)
    normal = unit(area_vectors(corners[closest.facets]))
    away = x - closest.feet
    beyond = np.linalg.norm(tangential(away, normal), axis=1)
    return DistanceFromFace(dot(away, normal), beyond, normal)
