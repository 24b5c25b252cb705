# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes with named groups, from gmsh or DOLFINx; bodies joined in one mesh, and cracks."""

from typing import TYPE_CHECKING

from dolfinx_contact._install import loads
from dolfinx_contact.meshing.gmsh import (
    GmshMesh,
    NamedTags,
    draw_polygon,
    mesh_from_gmsh,
    read_mesh,
)

if TYPE_CHECKING:
    from dolfinx_contact.meshing.cracks import crack
    from dolfinx_contact.meshing.groups import name_groups
    from dolfinx_contact.meshing.whole import join

__all__ = [
    "GmshMesh",
    "NamedTags",
    "crack",
    "draw_polygon",
    "join",
    "mesh_from_gmsh",
    "name_groups",
    "read_mesh",
]

#: Functions that make new meshes from others are loaded when they are used.
__getattr__ = loads(
    __name__, {"cracks": ("crack",), "groups": ("name_groups",), "whole": ("join",)}
)


def __dir__() -> list[str]:
    return __all__
