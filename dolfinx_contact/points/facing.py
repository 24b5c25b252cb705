# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a face, and those of another one, of any rank, that may be opposite to them."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, mesh

from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import require
from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.search import exchanged, nearest, ranks_nearby
from dolfinx_contact.points.trace import facet_closures, facet_normals

__all__ = ["candidates", "faces_of", "measured", "projected", "projected_faces", "refuse_aslant"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_ASLANT = 0.5  # cosine between a given normal and that of a facet, the least


def faces_of(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> Faces:
    """The facets that this rank owns."""
    domain = V.mesh
    dim = V.mesh.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    closures = facet_closures(V, owned)
    corners = len(basix.topology(domain.basix_cell())[dim - 1][0])
    x = node_positions(V)[:, :dim][closures[:, :corners]]
    nodes = V.dofmap.index_map.local_to_global(closures.reshape(-1)).reshape(closures.shape)
    return Faces(x, facet_normals(domain, owned), nodes.astype(np.int64))


def candidates(comm: MPI.Comm, slave: Faces, master: Faces) -> tuple[Faces, Nodes]:
    """Facets of the master, of any rank, that may be opposite to those of the slave. Collective.

    A facet that lies opposite at an angle of less than 60 degrees is at most twice as far as the
    nearest, and half the sizes of both.

    Returns:
        The facets, and pairs of numbers of slave and master facets.
    """
    middles = slave.x.mean(axis=1)
    others = master.x.mean(axis=1)
    dim = middles.shape[1]
    radius, theirs = (
        np.linalg.norm(f.x - f.x.mean(axis=1, keepdims=True), axis=2).max(axis=1, initial=0.0)
        for f in (slave, master)
    )
    largest = comm.allreduce(float(np.max(theirs, initial=0.0)), op=max)
    closest = nearest(comm, others, middles, dim)
    distance = np.linalg.norm(closest - middles, axis=1)
    reach = 2 * (distance + largest) + radius
    places, tree = ranks_nearby(comm, others, middles, lambda near, _: near <= reach)
    sent: Any = [np.column_stack([middles[i], reach[i], i]) for i in places]
    answers: list[Array] = []
    corners = master.corners
    nodes = master.nodes.shape[1]
    width = 1 + corners * dim + dim + nodes
    for q in exchanged(comm, sent, (dim + 2,)):
        found = tree.query_ball_point(q[:, :dim], q[:, dim]) if tree is not None and len(q) else []
        k = np.array([j for part in found for j in part], dtype=np.int64)
        i = np.repeat(q[:, dim + 1], [len(part) for part in found]) if len(k) else np.empty(0)
        x = master.x[k].reshape(-1, corners * dim)
        columns = [i[:, None], x, master.normals[k], master.nodes[k]]
        answers.append(np.column_stack(columns) if len(k) else np.empty((0, width)))
    rows = np.concatenate(exchanged(comm, answers, (width,)))
    a = 1 + corners * dim
    b = 1 + (corners + 1) * dim
    faces = Faces(
        rows[:, 1:a].reshape(-1, corners, dim), rows[:, a:b], rows[:, b:].astype(np.int64)
    )
    return faces, np.column_stack([rows[:, 0].astype(np.int64), np.arange(len(rows))])


def projected_faces(normal: Array, faces: Faces) -> Faces:
    """Facets as they are seen in the direction of a unit vector: in planes across it."""
    off = (faces.x - faces.x.mean(axis=1, keepdims=True)) @ normal
    x = faces.x - off[:, :, None] * normal
    return Faces(x, np.broadcast_to(normal, faces.normals.shape), faces.nodes)


def projected(direction: Array, x: Array) -> Array:
    """Points (n, dim) as they are seen in the direction of a unit vector: in a plane across it."""
    return np.asarray(x - np.outer(x @ direction, direction))


def measured(
    domain: mesh.Mesh, facets: npt.NDArray[np.int32], direction: Array | None = None
) -> Array:
    """Means of the nodes and areas of the facets that this rank owns (n, dim + 1).

    Args:
        domain: mesh.
        facets: local.
        direction: in which they are seen; those that look against it are left out.
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
    """``ValueError`` if a normal does not fit the owned facets of the slave. Collective."""
    count = domain.comm.allreduce(int((facet_normals(domain, slave) @ normal < _ASLANT).sum()))
    require(
        domain.comm,
        not count,
        f"{name}: the given normal is more than 60 degrees off that of {count} facets of the "
        "slave; it points from the slave to the master",
    )
