# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The operators between a body and its contact points.

Jumps and tractions at the points are weighted sums of nodal vectors,

    j = B u,    t = E l,    B = b (x) I,    E = e (x) I,

with the scalar weights b and e of the nodes of the displacement and of the multiplier. Points come
in groups that share their nodes: those of a facet, or every point by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._entries import Entries, matrix_of

__all__ = ["Stencils", "multiplied", "multiplied_transposed", "rows_of", "weights_matrix"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Stencils:
    """Weights of the nodes at the points of this rank, group by group.

    Attributes:
        points: local numbers of the points of every group (groups, p).
        nodes: global nodes of the displacement (groups, k).
        weights: b (groups, p, k); of a node that is named twice they add up.
        multiplier_nodes: global nodes of the multiplier (groups, l).
        multiplier_weights: e (groups, p, l).
        identity: whether E is the identity: a multiplier node is a point.
    """

    points: npt.NDArray[np.int64]
    nodes: Nodes
    weights: Array
    multiplier_nodes: Nodes
    multiplier_weights: Array
    identity: bool

    @property
    def number(self) -> int:
        """Points of this rank."""
        return int(self.points.size)

    def minus(self, other: Stencils) -> Stencils:
        """Of the difference of two displacements at the same points."""
        return replace(
            self,
            nodes=np.concatenate([self.nodes, other.nodes], axis=1),
            weights=np.concatenate([self.weights, -other.weights], axis=2),
        )

    def jump_matrix(self, comm: MPI.Comm, nodes: int, dim: int) -> PETSc.Mat:
        """B, from displacements to points. Collective.

        Args:
            comm: communicator.
            nodes: of the displacement that this rank owns.
            dim: 2 or 3.
        """
        return weights_matrix(comm, self.points, self.nodes, self.weights, nodes, dim)

    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        """b, from a scalar at nodes to one at points. Collective."""
        return weights_matrix(comm, self.points, self.nodes, self.weights, nodes, 1)

    def traction_matrix(self, comm: MPI.Comm, nodes: int, dim: int) -> PETSc.Mat:
        """E, from multipliers to points. Collective."""
        weights = self.multiplier_weights
        return weights_matrix(comm, self.points, self.multiplier_nodes, weights, nodes, dim)


def weights_matrix(
    comm: MPI.Comm,
    points: npt.NDArray[np.int64],
    nodes: Nodes,
    weights: Array,
    owned_nodes: int,
    dim: int,
) -> PETSc.Mat:
    """The matrix of weights (x) I, from vectors at nodes to vectors at points. Collective."""
    n = int(points.size)
    first = comm.exscan(dim * n) or 0
    rows = np.broadcast_to(points[:, :, None], weights.shape)[..., None]
    columns = np.broadcast_to(nodes[:, None, :], weights.shape)[..., None]
    along = np.arange(dim)
    i, j = (np.asarray(dim * v + along).reshape(-1) for v in (rows, columns))
    entries = Entries(first + i, j)
    A = matrix_of(comm, (dim * n, dim * owned_nodes), entries)
    entries.add(np.repeat(weights.reshape(-1), dim), A)
    return A


def rows_of(product: PETSc.Mat, divisor: Array) -> tuple[Nodes, Array]:
    """Nodes and weights (n, k) of the rows of a matrix, each over a divisor; it is destroyed."""
    indptr, columns, values = product.getValuesCSR()
    product.destroy()
    counts = np.diff(indptr)
    n = len(counts)
    width = int(counts.max(initial=1))
    # Of no weight are copies of the first node of the row.
    place = indptr[:-1, None] + np.minimum(np.arange(width), counts[:, None] - 1)
    nodes = columns[place].astype(np.int64) if n else np.zeros((0, width), dtype=np.int64)
    held = np.arange(width) < counts[:, None]
    return nodes, np.where(held, values[place] if n else 0.0, 0.0) / divisor[:, None]


def multiplied(A: PETSc.Mat, values: Array) -> Array:
    """A times every column of values (n, k). Collective."""
    x, y = A.createVecs()
    found = np.empty((y.getLocalSize(), values.shape[1]))
    for i, column in enumerate(values.T):
        x.array[:] = column
        A.mult(x, y)
        found[:, i] = y.array_r
    x.destroy(), y.destroy()
    return found


def multiplied_transposed(A: PETSc.Mat, values: Array) -> Array:
    """The transpose of A times values, flat. Collective."""
    x, y = A.createVecs()
    y.array[:] = values.reshape(-1)
    A.multTranspose(y, x)
    out = x.array_r.copy()
    x.destroy(), y.destroy()
    return np.asarray(out)
