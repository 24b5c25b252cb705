# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of revolution about x = 0: half of a section is meshed, with r = x >= 0 and z = y.

Forces act on the whole circumference. The area of a point is the integral of 2 pi r times its basis
function, which is also positive for points on the axis. Resultants are axial, because the radial
forces at opposite points of the circumference cancel.
"""

from __future__ import annotations

import numpy as np

from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Indices, Mask
from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import maximum, minimum, require
from dolfinx_contact.points.trace import owned_facets

__all__ = ["axis_condition", "check_section", "mirrored", "on_axis"]


_NEAR = 1e-9  # distance of points on the axis from it, relative to the size of the mesh


def on_axis(V: fem.FunctionSpace) -> Mask:
    """Return the mask of the local nodes on the axis. Collective."""
    domain = V.mesh
    r = domain.geometry.x[:, 0]
    largest = maximum(domain.comm, r)
    return np.abs(node_positions(V)[:, 0]) <= _NEAR * largest


def check_section(domain: mesh.Mesh, facets: Indices, name: str) -> None:
    """Raise ``ValueError`` unless a mesh is half of a section and no facet lies on the axis.

    Collective.
    """
    comm = domain.comm
    require(comm, domain.geometry.dim == 2, f"{name}: an axisymmetric body is meshed in 2D")
    r = domain.geometry.x[:, 0]
    smallest = minimum(comm, r, np.inf)
    largest = maximum(comm, r, -np.inf)
    require(
        comm,
        smallest >= -_NEAR * largest,
        f"{name}: an axisymmetric body is meshed in x >= 0, the mesh reaches to x = {smallest:.3g}",
    )
    owned = owned_facets(domain, facets)
    count = 0
    if len(owned):  # DOLFINx divides by their number
        ends = mesh.entities_to_geometry(domain, 1, owned)[:, :2]
        count = int((np.abs(r[ends]) <= _NEAR * largest).all(axis=1).sum())
    count = comm.allreduce(count)
    require(comm, count == 0, f"{name}: {count} facets lie on the axis, and have no area")


def mirrored(V: fem.FunctionSpace, normals: Array) -> Array:
    """Return normals averaged with their mirror images (no radial part) on the axis. Collective.

    Args:
        V: displacement space.
        normals: normals at the local nodes, shape (n, 2).
    """
    axis = on_axis(V) & (normals[:, 1] != 0)
    along = np.stack([np.zeros(len(normals)), np.sign(normals[:, 1])], axis=1)
    return np.where(axis[:, None], along, normals)


def axis_condition(V: fem.FunctionSpace) -> list[fem.DirichletBC]:
    """Return the condition u_r = 0 on the axis as a list, empty without nodes there. Collective."""
    nodes = np.flatnonzero(on_axis(V)).astype(np.int32)
    if not V.mesh.comm.allreduce(len(nodes)):
        return []
    return [fem.dirichletbc(0.0, V.dofmap.index_map_bs * nodes, V.sub(0))]
