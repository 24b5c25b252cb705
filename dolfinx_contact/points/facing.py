# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a face, and the facets of another face, of any rank, that may oppose them."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, mesh

from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import require
from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.search import around, nearest
from dolfinx_contact.points.trace import facet_closures, facet_normals

__all__ = ["candidates", "faces_of", "measured", "projected", "projected_faces", "refuse_aslant"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_ASLANT = 0.5  # cosine between a given normal and that of a facet, the least


def faces_of(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> Faces:
    """Return the facets owned by this rank."""
    domain = V.mesh
    dim = V.mesh.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    closures = facet_closures(V, owned)
    corners = len(basix.topology(domain.basix_cell())[dim - 1][0])
    x = node_positions(V)[:, :dim][closures[:, :corners]]
    nodes = V.dofmap.index_map.local_to_global(closures.reshape(-1)).reshape(closures.shape)
    return Faces(x, facet_normals(domain, owned), nodes.astype(np.int64))


def candidates(comm: MPI.Comm, slave: Faces, master: Faces) -> tuple[Faces, Nodes]:
    """Return facets of the master, of any rank, that may oppose those of the slave. Collective.

    An opposing facet at an angle of less than 60 degrees is at most twice as far as the nearest one
    plus half the sizes of both.

    Returns:
        Facets, and pairs of numbers of slave and master facets.
    """
    middles, radius = slave.balls
    others, theirs = master.balls
    dim, corners = middles.shape[1], master.corners
    largest = comm.allreduce(float(np.max(theirs, initial=0.0)), op=max)
    distance = np.linalg.norm(nearest(comm, others, middles, dim) - middles, axis=1)
    columns = [others, master.x.reshape(len(others), corners * dim), master.normals, master.nodes]
    reach = 2 * (distance + largest) + radius
    i, rows = around(comm, np.column_stack(columns), middles, reach, dim)
    _, x, normals, nodes = np.split(rows, np.cumsum([dim, corners * dim, dim]), axis=1)
    faces = Faces(x.reshape(-1, corners, dim), normals, nodes.astype(np.int64))
    return faces, np.column_stack([i, np.arange(len(i))])


def projected_faces(normal: Array, faces: Faces) -> Faces:
    """Return facets projected along a unit vector, in planes across it."""
    off = (faces.x - faces.x.mean(axis=1, keepdims=True)) @ normal
    x = faces.x - off[:, :, None] * normal
    return Faces(x, np.broadcast_to(normal, faces.normals.shape), faces.nodes)


def projected(direction: Array, x: Array) -> Array:
    """Return points (n, dim) projected along a unit vector, in a plane across it."""
    return np.asarray(x - np.outer(x @ direction, direction))


def measured(
    domain: mesh.Mesh, facets: npt.NDArray[np.int32], direction: Array | None = None
) -> Array:
    """Return node means and areas of the facets owned by this rank, shape (n, dim + 1).

    Args:
        domain: mesh.
        facets: local facets.
        direction: direction of projection, without the facets that look against it; default: no
            projection.
    """
    dim = domain.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    if not len(owned):
        return np.zeros((0, dim + 1))
    x = domain.geometry.x[mesh.entities_to_geometry(domain, dim - 1, owned)][:, :, :dim]
    normals = facet_normals(domain, owned, unit=False)
    means = x.mean(axis=1)
    found = np.column_stack([means, np.linalg.norm(normals, axis=1)])
    if direction is None:
        return found
    found[:, :dim] = projected(direction, means)
    return found[normals @ direction > 0]


def refuse_aslant(
    domain: mesh.Mesh, slave: npt.NDArray[np.int32], normal: Array, name: str
) -> None:
    """Raise ``ValueError`` if a given normal does not fit the slave facets. Collective."""
    count = domain.comm.allreduce(int((facet_normals(domain, slave) @ normal < _ASLANT).sum()))
    require(
        domain.comm,
        not count,
        f"{name}: the given normal is more than 60 degrees off that of {count} facets of the "
        "slave; it points from the slave to the master",
    )
