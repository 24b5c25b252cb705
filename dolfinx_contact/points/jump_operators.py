# SPDX-License-Identifier: LGPL-3.0-or-later
r"""B at a state: from displacements to jumps at contact points, and from tractions to forces.

Forces do the work of tractions, B^T W t . v = sum W t . (B v), with the areas W of the points. B is
constant if each point keeps its opposing point. If points slide to other facets, the jumps in the
laws may change by more than B v, and the forces of fixed tractions change with the displacement.

With a constant B, jumps and tractions are weighted sums of nodal vectors (`Stencils`),

    j = B u,    t = E l,    B = b (x) I,    E = e (x) I,

with the scalar weights b and e of the nodes of the displacement and of the multiplier. Points form
groups sharing their nodes: the points of a facet, or single points.

Code that needs a constant B (matrices that are set up once, condensation onto the contact points,
proofs) takes it from `DiscreteSurface.constant_operator`, which refuses any other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints, Mask
from dolfinx_contact._geometry import global_numbers
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact._petsc import product, triplet_matrix

__all__ = [
    "ConstantOperator",
    "NodeWeights",
    "Operator",
    "Stencils",
    "multiplied",
    "multiplied_transposed",
    "own_nodes",
    "rows_of",
    "rows_with_ghosts",
    "scaled_rows",
]


class Operator(ABC):
    """B of a surface at a state. Collective, like all its methods.

    Displacements belong to the owned nodes (n, dim) and are relative to a rigid body
    (`Partner.relative`); tractions and jumps belong to the contact points of this rank.
    """

    #: Areas W of the points, shape (n,).
    areas: Array
    #: Mask (n,) of points without an opposing point, which carry nothing; None if there are none.
    absent: Mask | None = None
    #: Weights (n,) of the laws of the points; the remainder of a traction is `mean_around`. None if
    #: all weights are 1.
    share: Array | None = None

    @abstractmethod
    def apply(self, v: Array) -> Array:
        """Return B v at the points, shape (n, dim)."""

    @abstractmethod
    def rate(self, v: Array) -> Array:
        """Return the derivative of the jumps in the laws along v, shape (n, dim).

        The part from normals that turn with the displacement (`normal_rate`) is not included.
        """

    def normal_rate(self, v: Array) -> Array | None:
        """Return the derivative of the normals along v, shape (n, dim).

        None if B does not change the normals.
        """
        return None

    def mean_around(self, tractions: Array) -> Array:
        """Return means of the tractions of the points around each point, shape (n, dim)."""
        return tractions

    @abstractmethod
    def transpose(self, tractions: Array) -> Array:
        """Return B^T W t, the forces of tractions on owned displacement dofs, as a flat array."""

    @abstractmethod
    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        """Return the derivative of B^T W t along v at fixed tractions t, as a flat array."""

    @abstractmethod
    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        """Return the scalar matrix b of B = b (x) I.

        Args:
            comm: communicator.
            nodes: number of displacement nodes owned by this rank.

        Returns:
            Matrix from a scalar at the nodes to one at the points.
        """


@dataclass(frozen=True, eq=False)
class ConstantOperator(Operator):
    """B that is the same at every state: jumps are B u plus a constant.

    Attributes:
        stencils: weights of displacement and multiplier nodes at the points.
        areas: areas W of the points, shape (n,).
        B: matrix.
    """

    stencils: Stencils
    areas: Array
    B: PETSc.Mat

    def apply(self, v: Array) -> Array:
        return product(self.B, v.reshape(-1)).reshape(-1, v.shape[1])

    def rate(self, v: Array) -> Array:
        return self.apply(v)

    def transpose(self, tractions: Array) -> Array:
        return multiplied_transposed(self.B, self.areas[:, None] * tractions)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        return np.zeros(v.size)

    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        return self.stencils.jump_matrix(comm, nodes, 1)


@dataclass(frozen=True)
class Stencils:
    """Weights of the nodes at the points of this rank, group by group.

    Attributes:
        points: local numbers of the p points of each group, shape (groups, p).
        nodes: k global nodes of the displacement per group, shape (groups, k).
        weights: weights b, shape (groups, p, k); weights of a repeated node add up.
        multiplier_nodes: l global nodes of the multiplier per group, shape (groups, l).
        multiplier_weights: weights e, shape (groups, p, l).
        identity: whether E is the identity, since the points are multiplier nodes.
    """

    points: Ints
    nodes: Ints
    weights: Array
    multiplier_nodes: Ints
    multiplier_weights: Array
    identity: bool

    def minus(self, other: Stencils) -> Stencils:
        """Return the stencils of the difference between these values and those of ``other``."""
        return replace(
            self,
            nodes=np.concatenate([self.nodes, other.nodes], axis=1),
            weights=np.concatenate([self.weights, -other.weights], axis=2),
        )

    def jump_matrix(self, comm: MPI.Comm, nodes: int, dim: int) -> PETSc.Mat:
        """Return B, from displacements to points. Collective.

        Args:
            comm: communicator.
            nodes: number of displacement nodes owned by this rank.
            dim: number of components; 1 for the matrix b of weights.
        """
        return self._matrix(comm, self.nodes, self.weights, nodes, dim)

    def traction_matrix(self, comm: MPI.Comm, nodes: int, dim: int) -> PETSc.Mat:
        """Return the matrix E, which maps multipliers to tractions at the points. Collective."""
        return self._matrix(comm, self.multiplier_nodes, self.multiplier_weights, nodes, dim)

    def _matrix(
        self, comm: MPI.Comm, nodes: Ints, weights: Array, owned_nodes: int, dim: int
    ) -> PETSc.Mat:
        """Return the matrix weights (x) I, from vectors at nodes to the points. Collective."""
        n = int(self.points.size)
        along = np.arange(dim)
        rows = (comm.exscan(dim * n) or 0) + dim * self.points[:, :, None, None] + along
        columns = dim * nodes[:, None, :, None] + along
        return triplet_matrix(comm, (dim * n, dim * owned_nodes), rows, columns, weights[..., None])


# -- weighted sums of nodal values ----------------------------------------------------------------


class NodeWeights(NamedTuple):
    """Weighted sums of nodal values.

    Attributes:
        nodes: global nodes, shape (..., k).
        weights: their weights, shape (..., k); nodes of weight 0 are copies of any node.
    """

    nodes: Ints
    weights: Array


def own_nodes(V: fem.FunctionSpace, nodes: Indices) -> NodeWeights:
    """Return each local node with the weight 1, the stencil of its own displacement."""
    numbers = global_numbers(V.dofmap.index_map, nodes[..., None])
    return NodeWeights(numbers, np.ones(numbers.shape))


def scaled_rows(A: PETSc.Mat) -> Array:
    """Divide each row of a matrix by its sum, if positive; return the sums. Collective."""
    by = A.getRowSum()
    sums: Array = by.array.copy()
    by.array[:] = 1 / np.where(sums > 0, sums, 1.0)
    A.diagonalScale(by)
    by.destroy()
    return sums


def rows_of(A: PETSc.Mat) -> NodeWeights:
    """Return the column indices and entries of each row as `NodeWeights`; destroy the matrix."""
    indptr, columns, values = A.getValuesCSR()
    A.destroy()
    counts = np.diff(indptr)
    width = int(counts.max(initial=1))
    entry = np.arange(width)
    present = entry < counts[:, None]
    # shorter rows repeat their last entry with the weight 0
    last = np.maximum(counts[:, None] - 1, 0)
    place = indptr[:-1, None] + np.minimum(entry, last)
    nodes = np.append(columns, 0)[place].astype(np.int64)
    return NodeWeights(nodes, np.where(present, np.append(values, 0.0)[place], 0.0))


def rows_with_ghosts(comm: MPI.Comm, index_map: Any, owned: NodeWeights) -> NodeWeights:
    """Return nodes and weights of the owned and ghost rows from the owned ones. Collective."""
    k = owned.nodes.shape[1]
    padding = (0, 0), (0, comm.allreduce(k, op=max) - k)
    rows = np.stack([np.pad(part, padding) for part in owned], axis=2, dtype=np.float64)
    nodes, weights = np.moveaxis(SharedValues(index_map).from_owners(rows), 2, 0)
    return NodeWeights(nodes.astype(np.int64), weights.copy())


def multiplied(A: PETSc.Mat, values: Array) -> Array:
    """Return A times values with k columns, shape (n, k). Collective."""
    return np.stack([product(A, column) for column in values.T], axis=1)


def multiplied_transposed(A: PETSc.Mat, values: Array) -> Array:
    """Return the transpose of A times values, as a flat array. Collective."""
    x, y = A.createVecs()
    y.array[:] = values.reshape(-1)
    A.multTranspose(y, x)
    out = x.array_r.copy()
    x.destroy(), y.destroy()
    return out
