# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes from gmsh with named groups, bodies joined in one mesh, and cracks."""

from importlib import import_module
from typing import TYPE_CHECKING

from dolfinx_contact.meshing.gmsh import (
    GmshMesh,
    NamedTags,
    draw_polygon,
    mesh_from_gmsh,
    read_mesh,
)

if TYPE_CHECKING:
    from dolfinx_contact.meshing.cracks import crack
    from dolfinx_contact.meshing.whole import join

__all__ = [
    "GmshMesh",
    "NamedTags",
    "crack",
    "draw_polygon",
    "join",
    "mesh_from_gmsh",
    "read_mesh",
]

#: What makes new meshes of others is loaded when it is used.
_LATER = {"crack": "dolfinx_contact.meshing.cracks", "join": "dolfinx_contact.meshing.whole"}


def __getattr__(name: str) -> object:
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
