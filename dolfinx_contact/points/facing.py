# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a face, and the facets of another face, of any rank, that may oppose them."""

from __future__ import annotations

from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._geometry import global_numbers, node_positions
from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.search import Columns, around, near_rays, nearest
from dolfinx_contact.points.trace import facet_closures, facet_normals

__all__ = ["candidates", "faces_of", "facets_along_normals"]


def faces_of(V: fem.FunctionSpace, facets: Indices) -> Faces:
    """Return the facets owned by this rank."""
    domain = V.mesh
    dim = V.mesh.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    closures = facet_closures(V, owned)
    corners = len(basix.topology(domain.basix_cell())[dim - 1][0])
    x = node_positions(V)[:, :dim][closures[:, :corners]]
    nodes = global_numbers(V.dofmap.index_map, closures)
    return Faces(x, facet_normals(domain, owned), nodes)


def facets_along_normals(
    comm: MPI.Comm,
    slave: Faces,
    master: Columns,
    radii: Array,
    depth: Array,
    skin: float = 0.0,
) -> tuple[dict[str, npt.NDArray[Any]], Ints]:
    """Return master facets, of any rank, that the normals of slave facets may meet. Collective.

    A facet counts if it lies at most at a distance before or behind the slave facet along the
    normal, and across the normal not farther than both facets reach.

    Args:
        comm: communicator.
        slave: slave facets of this rank.
        master: middles ``"x"`` of the master facets of this rank, ``"key"`` that identifies a
            facet, shape (m, k), and other data.
        radii: radii of balls around the middles containing the facets, shape (m,).
        depth: distance along the normal by slave facet, shape (n,).
        skin: additional distance.

    Returns:
        Data of the facets, each once in the order of the keys, and pairs of numbers of slave and
        master facets in ascending order, shape (pairs, 2).
    """
    middles, across = slave.balls
    across = across + skin
    largest = comm.allreduce(float(np.max(radii, initial=0.0)), op=max)
    reach = np.hypot(depth + across + largest, across + largest)
    wanted = {"x": middles, "normal": slave.normals, "across": across, "depth": depth}
    select = partial(near_rays, radii=radii)
    i, found = around(comm, master, wanted | {"reach": reach}, select)
    _, first, k = np.unique(found["key"], axis=0, return_index=True, return_inverse=True)
    pairs = np.column_stack([i, k.reshape(-1)])
    facets = {name: values[first] for name, values in found.items()}
    return facets, pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def candidates(comm: MPI.Comm, slave: Faces, master: Faces) -> tuple[Faces, Ints]:
    """Return facets of the master, of any rank, that may oppose slave facets. Collective.

    An opposing facet at an angle of less than 60 degrees is at most twice as far as the nearest one
    plus half the sizes of both.

    Returns:
        Facets, and pairs of numbers of slave and master facets.
    """
    middles, radius = slave.balls
    others, theirs = master.balls
    largest = comm.allreduce(float(np.max(theirs, initial=0.0)), op=max)
    distance = np.linalg.norm(nearest(comm, {"x": others}, middles)["x"] - middles, axis=1)
    reach = 2 * (distance + largest) + radius
    known = {"x": others, "key": master.nodes, "corners": master.x, "normal": master.normals}
    found, pairs = facets_along_normals(comm, slave, known, theirs, reach)
    i, k = pairs.T
    near = np.linalg.norm(found["x"][k] - middles[i], axis=1) <= reach[i]
    return Faces(found["corners"], found["normal"], found["key"]), pairs[near]
