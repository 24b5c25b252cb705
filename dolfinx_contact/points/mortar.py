# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Mortar weights between faces of different meshes, with the biorthogonal basis.

One quadrature on the covered parts of a facet of the slave gives all integrals of the facet: its
mass M = int N N^T and areas d = int N, the dual basis psi = diag(d) M^-1 N, with int psi_p N_q =
d_p delta_pq, and the coupling int psi_p N_k of the master's basis; N of the slave is of degree 1.
With W = sum d the jump of a node at a corner is

    j_p = u_p - 1/W_p sum_k (int psi_p N_k) u_k,

whose weights sum to zero. Constants, uniform tractions and, on faces that coincide, linear fields
are reproduced to round-off however the faces are cut (Wohlmuth, SIAM J. Numer. Anal. 38, 2000;
Popp, Gee and Wall, Int. J. Numer. Methods Eng. 79, 2009). All integrals of a body of revolution
have the weight 2 pi r.
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
    """Integrals over slave facets.

    Attributes:
        slave: global nodes at the k corners of the slave facet of each piece, shape (pieces, k, 1).
        master: b global nodes of the master facet of each piece, shape (pieces, 1, b).
        values: integrals of psi_p N_k, shape (pieces, k, b).
        areas: integral of N over the covered part of each slave facet, per corner, shape (n, k).
    """

    slave: Ints
    master: Ints
    values: Array
    areas: Array


def coupling(cover: Cover, degree: int, *, axisymmetric: bool) -> Coupling:
    """Return integrals over the covered parts of slave facets. Not collective.

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
    """Return rows for all nodes of facets, as means of the rows of their corners. Collective.

    Args:
        comm: communicator.
        A: rows of the corners; destroyed.
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
