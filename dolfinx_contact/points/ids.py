# SPDX-License-Identifier: LGPL-3.0-or-later
"""What tells points of a surface apart that are at one place, on any number of ranks.

Nodes of bodies that touch, and of the sides of a crack, share their coordinates. What they do not
share is the number of the node in the mesh as it was given to DOLFINx.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._compat import geometry_dofmap

__all__ = ["point_ids"]

Ids = npt.NDArray[np.int64]


def point_ids(space: fem.FunctionSpace, vertices: fem.FunctionSpace) -> tuple[Ids, Ids]:
    """The input nodes of points (n, k), of vertices (n, k). Not collective.

    Args:
        space: scalar, on a facet submesh, with one dof per point: the vertices or Gauss points.
        vertices: scalar P1 space there.

    Returns:
        Of the owned points: the node of a vertex and zeros, or the sorted nodes of the facet of a
        Gauss point. Of all local vertices, likewise.
    """
    domain, corners = vertices.mesh, vertices.dofmap.list
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    of_facets = nodes[geometry_dofmap(domain)[:, : corners.shape[1]]]
    index_map, owned = vertices.dofmap.index_map, space.dofmap.index_map.size_local
    size = index_map.size_local + index_map.num_ghosts
    of_vertices: Ids = np.zeros((size, corners.shape[1]), dtype=np.int64)
    of_vertices[corners, 0] = of_facets
    if space is vertices:
        return of_vertices[:owned], of_vertices
    points = space.dofmap.list
    of_points: Ids = np.zeros((int(points.max(initial=-1)) + 1, corners.shape[1]), dtype=np.int64)
    of_points[points] = np.sort(of_facets, axis=1)[:, None]
    return of_points[:owned], of_vertices
