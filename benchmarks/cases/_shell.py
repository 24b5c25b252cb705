# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hollow half-spheres and their octants, of hexahedra: a cube that is blown up."""

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import mesh

__all__ = ["shell"]


def octant(m):
    """Directions of the nodes of an octant (3, m + 1, m + 1, 3): m x m squares on three faces."""
    t = np.tan(np.linspace(0.0, np.pi / 4, m + 1))
    a, b = np.meshgrid(t, t, indexing="ij")
    face = np.stack([np.ones_like(a), a, b], axis=-1)
    face /= np.linalg.norm(face, axis=-1)[..., None]
    return np.array([np.roll(face, k, axis=-1) for k in range(3)])


def shell(comm: MPI.Comm, radii, m, octants=4):
    """A mesh of some octants of a hollow sphere about the origin, z >= 0. Collective.

    Args:
        comm: communicator.
        radii: of the layers of nodes, rising.
        m: cells along each edge of the three faces of an octant.
        octants: one beside the other, around z, the first of them in x, y >= 0.
    """
    first = octant(m)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    faces = [first @ np.linalg.matrix_power(quarter, k).T for k in range(octants)]
    grid = np.concatenate(faces)
    points = np.multiply.outer(np.asarray(radii), grid)
    number = np.arange(points[..., 0].size).reshape(points.shape[:-1])
    corners = [
        number[k : k - 1 or None, :, j : j - 1 or None, i : i - 1 or None]
        for k in (0, 1)
        for i in (0, 1)
        for j in (0, 1)
    ]
    cells = np.stack(corners, axis=-1).reshape(-1, 8)
    places = np.round(points.reshape(-1, 3) / radii[-1], 9)
    _, one, which = np.unique(places, axis=0, return_index=True, return_inverse=True)
    nodes = points.reshape(-1, 3)[one]
    cells = which.reshape(-1)[cells].astype(np.int64)
    if comm.rank > 0:
        nodes, cells = nodes[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    return mesh.create_mesh(comm, cells=cells, x=nodes, e=ufl.Mesh(element))
