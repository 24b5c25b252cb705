# SPDX-License-Identifier: LGPL-3.0-or-later
"""Faces of bodies at a displacement: their simplices, outward normals and closest points.

Facets of degree 2 and quadrilaterals of a master are divided into simplices. A master is gathered
on every rank, as rigid surfaces are, so that one search serves both.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import area_vectors, dot, unit
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_closures, facet_normals
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets

__all__ = ["Closest", "closest_on_face", "master_simplices", "outward_at_points", "slave_triangles"]


#: Simplices of the nodes of a facet, by dimension and number of nodes, in the order of Basix.
_SIMPLICES: dict[tuple[int, int], Any] = {
    (2, 2): [[0, 1]],
    (2, 3): [[0, 2], [2, 1]],
    (3, 3): [[0, 1, 2]],
    (3, 4): [[0, 1, 2], [1, 3, 2]],
    (3, 6): [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
    (3, 9): [[i, j, 8] for i, j in pairwise((0, 4, 1, 6, 3, 7, 2, 5, 0))],
}


class Closest(NamedTuple):
    """The closest points of a face to given points.

    Attributes:
        gap: signed distances along the normals of the face, positive outside (n,).
        beyond: distances beyond the edge of the face (n,).
        normal: outward unit normals of the face (n, dim).
        feet: the closest points (n, dim).
    """

    gap: Array
    beyond: Array
    normal: Array
    feet: Array


def master_simplices(s: DiscreteSurface, u: Array) -> tuple[Array, float]:
    """Return simplices of a master in the mesh and displaced, on every rank. Collective.

    Args:
        s: pair of bodies.
        u: displacement of the local nodes (nodes, dim).

    Returns:
        Corners (2, n, dim, dim) in the mesh and displaced, ordered so that `area_vectors` of the
        mesh point outward; and the mean size of a facet.
    """
    domain, dim = s.domain, s.dim
    facets = s.obstacle.opposite.master_facets
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    closures = facet_closures(s.u.function_space, owned)
    X = s.node_positions
    simplices = _SIMPLICES[dim, closures.shape[1]]
    both = np.stack([X[closures], (X + u)[closures]])[:, :, simplices].reshape(2, -1, dim, dim)
    outward = np.repeat(facet_normals(domain, owned), len(simplices), axis=0)
    inward = dot(area_vectors(both[0]), outward) < 0.0
    both[:, inward] = both[:, inward, ::-1]
    both = np.concatenate(domain.comm.allgather(both), axis=1)
    area = np.linalg.norm(area_vectors(both[0]), axis=1).mean() * len(simplices)
    return both, float(area) ** (1 / (dim - 1))


def closest_on_face(corners: Array, x: Array) -> Closest:
    """Return the closest points of simplices (n, dim, dim) to points (m, dim). Not collective."""
    cells = np.arange(corners.shape[0] * corners.shape[1]).reshape(corners.shape[:2])
    found, parts = ClosestFacets(corners.reshape(-1, corners.shape[2]), cells)(x)
    normal = unit(area_vectors(corners[found]))
    feet = np.einsum("nk,nkd->nd", parts, corners[found])
    gap = dot(x - feet, normal)
    beyond = np.linalg.norm(x - feet - gap[:, None] * normal, axis=1)
    return Closest(gap, beyond, normal, feet)


def slave_triangles(s: DiscreteSurface, u: Array) -> tuple[Array, Ints, Array]:
    """Return the face of a surface at a displacement of the local nodes (nodes, dim).

    Returns:
        Positions of its local vertices (n, dim), simplices of the facets that this rank owns by
        these (m, dim), and their outward unit normals (m, dim).
    """
    facets = s.points.facets
    now = (s.node_positions + u)[facets.trace]
    simplices = _SIMPLICES[s.dim, facets.corners.shape[1]]
    triangles = facets.corners[:, simplices].reshape(-1, s.dim)
    normals = area_vectors(now[triangles])
    sense = np.repeat(facets.vectors(now[facets.corners]), len(simplices), axis=0)
    return now, triangles, unit(normals * np.sign(dot(normals, sense))[:, None])


def outward_at_points(s: DiscreteSurface, u: Array) -> Array:
    """Return outward unit normals of a face at its contact points (n, dim). Collective.

    They are means of the area vectors around the vertices.

    Args:
        s: contact surface.
        u: displacement of the local nodes (nodes, dim).
    """
    facets = s.points.facets
    vectors = facets.vectors(facets.at_corners(s.node_positions + u))
    parts = np.repeat(vectors[:, None], facets.corners.shape[1], axis=1)
    at_vertices = SharedValues(s.points.vertices.dofmap.index_map).sums(facets.corners, parts)
    return unit(np.stack([s.points.from_vertices(v) for v in at_vertices.T], axis=1))
