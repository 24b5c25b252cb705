# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mortar weights between faces of different meshes, with the biorthogonal basis.

Let N contain the linear basis functions N_p of the corners p of a slave facet, and let N_k be the
master basis functions. All integrals (int) over the covered part of the facet use the same
quadrature: the mass matrix M = int N N^T, the areas d = int N, and the coupling int psi_p N_k with
the dual basis psi = diag(d) M^-1 N, for which int psi_p N_q = d_p delta_pq. With the sum W_p of the
areas d_p over the facets around p, and the displacements u_p and u_k of the nodes, the jump of a
slave node p at a corner is

    j_p = u_p - 1/W_p sum_k (int psi_p N_k) u_k,

whose weights sum to zero. Constants, uniform tractions and, on faces that coincide, linear fields
are reproduced to round-off, independently of how the facets intersect (Wohlmuth, SIAM J. Numer.
Anal. 38, 2000; Popp, Gee and Wall, Int. J. Numer. Methods Eng. 79, 2009). For bodies of revolution,
all integrals have the weight 2 pi r.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._petsc import triplet_matrix
from dolfinx_contact.points.clipping import Cover, basis, nodal_points
from dolfinx_contact.points.jump_operators import scaled_rows

__all__ = ["Coupling", "between", "coupling"]


@dataclass(frozen=True)
class Coupling:
    """Mortar integrals over pieces of slave facets.

    Attributes:
        slave: global nodes at the k corners of the slave facet of each piece, shape (pieces, k, 1).
        master: b global nodes of the master facet of each piece, shape (pieces, 1, b).
        values: integrals of dual slave basis times master basis, shape (pieces, k, b).
        areas: integrals of the linear basis functions of the k corners over the covered part of
            each slave facet, shape (n, k).
    """

    slave: Ints
    master: Ints
    values: Array
    areas: Array


def coupling(cover: Cover, degree: int, *, axisymmetric: bool) -> Coupling:
    """Return the mortar integrals over the covered parts of slave facets. Not collective.

    Args:
        cover: covered parts.
        degree: degree of the displacement.
        axisymmetric: whether the bodies are bodies of revolution.
    """
    i, corners = cover.facet, cover.slave.corners
    rule = cover.rule(1 + degree + axisymmetric)
    mine = basis(rule.on_slave, corners, 1)
    theirs = basis(rule.on_master, cover.master.corners, degree)
    weighted = (rule.weights[..., None] * mine).transpose(0, 2, 1)
    if axisymmetric:
        weighted *= 2 * np.pi * (mine @ cover.slave.x[i, :, :1]).transpose(0, 2, 1)
    n = len(cover.slave.x)
    mass = np.zeros((n, corners, corners))
    areas = np.zeros((n, corners))
    np.add.at(mass, i, weighted @ mine)
    np.add.at(areas, i, weighted.sum(axis=2))
    mass[areas.sum(axis=1) == 0] = np.eye(corners)
    dual = np.linalg.solve(mass, areas[:, :, None] * np.eye(corners)).transpose(0, 2, 1)
    values = dual[i] @ (weighted @ theirs)
    nodes = cover.slave.nodes[i, :corners, None], cover.master.nodes[cover.other][:, None]
    return Coupling(*nodes, values, areas)


def between(comm: MPI.Comm, A: PETSc.Mat, nodes: Ints, corners: int) -> PETSc.Mat:
    """Interpolate mortar weights at corners to all nodes of facets of degree 2. Collective.

    Args:
        comm: communicator.
        A: matrix with the rows of the corners, which is destroyed.
        nodes: global nodes of facets of degree 2, corners first, shape (n, k).
        corners: number of corners of a facet.
    """
    n = A.getLocalSize()[0]
    scaled_rows(A)
    shares = basis(nodal_points(corners, 2), corners, 1)
    means = triplet_matrix(comm, (n, n), nodes[:, :, None], nodes[:, None, :corners], shares)
    found = means.matMult(A)
    A.destroy(), means.destroy()
    return found
