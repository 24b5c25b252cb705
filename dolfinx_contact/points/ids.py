# SPDX-License-Identifier: LGPL-3.0-or-later
"""What distinguishes points of a surface that are at one place, on any number of ranks.

Nodes of bodies that touch, and of the sides of a crack, share their coordinates. What they do not
share is the number of the node in the mesh as it was given to DOLFINx.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._compat import geometry_dofmap
from dolfinx_contact.points.gauss import GaussPoints

__all__ = ["point_ids", "vertex_numbers"]

Ids = npt.NDArray[np.int64]


def vertex_numbers(vertices: fem.FunctionSpace) -> Ids:
    """The input nodes of all local vertices (n,). Not collective.

    Args:
        vertices: scalar P1 space on a mesh, or on a facet submesh.
    """
    corners = vertices.dofmap.list
    domain = vertices.mesh
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    index_map = vertices.dofmap.index_map
    numbers: Ids = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    numbers[corners] = nodes[geometry_dofmap(domain)[:, : corners.shape[1]]]
    return numbers


def point_ids(vertices: fem.FunctionSpace, gauss: GaussPoints | None) -> tuple[Ids, Ids]:
    """The input nodes of points (n, k), of vertices (n, k). Not collective.

    Args:
        vertices: scalar P1 space on a facet submesh.
        gauss: the points, if they are not the vertices.

    Returns:
        Of the points of this rank: the node of a vertex and zeros, or the sorted nodes of the facet
        of a Gauss point. Of all local vertices, likewise.
    """
    corners = vertices.dofmap.list
    numbers = vertex_numbers(vertices)
    of_facets = numbers[corners]
    of_vertices: Ids = np.zeros((len(numbers), corners.shape[1]), dtype=np.int64)
    of_vertices[:, 0] = numbers
    if gauss is None:
        return of_vertices[: vertices.dofmap.index_map.size_local], of_vertices
    of_points: Ids = np.zeros((gauss.numbers.size, corners.shape[1]), dtype=np.int64)
    of_points[gauss.numbers] = np.sort(of_facets[gauss.cells], axis=1)[:, None]
    return of_points, of_vertices
