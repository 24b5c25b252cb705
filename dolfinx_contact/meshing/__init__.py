# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes from gmsh with named groups, bodies joined in one mesh, and cracks."""

from dolfinx_contact.meshing.cracks import crack
from dolfinx_contact.meshing.gmsh import (
    GmshMesh,
    NamedTags,
    draw_polygon,
    mesh_from_gmsh,
    read_mesh,
    tagged_facets,
)
from dolfinx_contact.meshing.whole import join

__all__ = [
    "GmshMesh",
    "NamedTags",
    "crack",
    "draw_polygon",
    "join",
    "mesh_from_gmsh",
    "read_mesh",
    "tagged_facets",
]
