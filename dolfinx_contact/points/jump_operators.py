# SPDX-License-Identifier: LGPL-3.0-or-later
"""Operator B at a state, which maps displacements to jumps at contact points.

Forces do the work of the tractions t, B^T W t . v = sum W t . (B v) for every displacement v, with
the areas W of the points. B is constant if each point keeps its opposing point. If points slide to
other facets, jumps also change with the opposing points and normals, and the forces of fixed
tractions depend on the displacement.

With a constant B, jumps and tractions are weighted sums of nodal vectors (`Stencils`),

    j = B u,    t = E l,    B = b (x) I,    E = e (x) I,

with displacements u, multipliers l, scalar weights b and e of the nodes, and the Kronecker product
(x). Points form groups sharing their nodes: the points of a facet, or single points.

Code that requires a constant B (matrices that are set up once, condensation onto the contact
points, proofs) obtains it from `DiscreteSurface.constant_operator`, which refuses any other.
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
    "own_nodes",
    "rows_of",
    "rows_with_ghosts",
    "scaled_rows",
]


class Operator(ABC):
    """Operator B of a surface at a state, from displacements to jumps. Methods are collective.

    Displacements belong to the owned nodes, shape (nodes, dim), and are relative to a rigid body
    (`Partner.relative`). Tractions and jumps belong to the contact points of this rank.
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
        """Return the jumps B v at the points, shape (n, dim).

        Args:
            v: displacement of the owned nodes, shape (nodes, dim).
        """

    @abstractmethod
    def rate(self, v: Array) -> Array:
        """Return the derivative along a displacement of the jumps in the laws, shape (n, dim).

        The contribution of normals that turn with the displacement (`normal_rate`) is not included.

        Args:
            v: displacement of the owned nodes, shape (nodes, dim).
        """

    def normal_rate(self, v: Array) -> Array | None:
        """Return the derivative of the normals along a displacement, shape (n, dim).

        None if the normals are not computed by the operator.

        Args:
            v: displacement of the owned nodes, shape (nodes, dim).
        """
        return None

    def mean_around(self, tractions: Array) -> Array:
        """Return for each point the mean of the tractions at surrounding points, shape (n, dim).

        Args:
            tractions: tractions at the points, shape (n, dim).
        """
        return tractions

    @abstractmethod
    def transpose(self, tractions: Array) -> Array:
        """Return the nodal forces of tractions on owned displacement dofs, as a flat array.

        Args:
            tractions: tractions at the points, shape (n, dim).
        """

    @abstractmethod
    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        """Return the derivative of `transpose` (nodal forces) along a displacement.

        Args:
            tractions: fixed tractions at the points, shape (n, dim).
            v: displacement of the owned nodes, shape (nodes, dim).
        """

    @abstractmethod
    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        """Return the matrix of the weights of nodes in jumps, without vector components.

        Args:
            comm: communicator.
            nodes: number of displacement nodes owned by this rank.

        Returns:
            Matrix that maps scalars at the nodes to scalars at the points.
        """


@dataclass(frozen=True, eq=False)
class ConstantOperator(Operator):
    """Operator B that is the same at every state: jumps are B u plus a constant.

    Attributes:
        stencils: weights of displacement and multiplier nodes at the points.
        areas: areas of the points, shape (n,).
        B: matrix from the displacement u to the jumps.
        fixed: mask of the components in which B reads fixed displacements of the node itself
            instead of the weighted displacements of the stencils, shape (n, dim); None if there are
            none.
    """

    stencils: Stencils
    areas: Array
    B: PETSc.Mat
    fixed: Mask | None = None

    def apply(self, v: Array) -> Array:
        return product(self.B, v.reshape(-1)).reshape(-1, v.shape[1])

    def rate(self, v: Array) -> Array:
        return self.apply(v)

    def transpose(self, tractions: Array) -> Array:
        forces = (self.areas[:, None] * tractions).reshape(-1)
        return product(self.B, forces, transposed=True)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        return np.zeros(v.size)

    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        return self.stencils.jump_matrix(comm, nodes, 1)


@dataclass(frozen=True)
class Stencils:
    """Weights of nodes in jumps and tractions, by groups of points with the same nodes.

    Attributes:
        points: local numbers of the p points of each group, shape (groups, p).
        nodes: k global nodes of the displacement per group, shape (groups, k).
        weights: weights of these nodes in the jumps, shape (groups, p, k); weights of a repeated
            node add up.
        multiplier_nodes: l global nodes of the multiplier per group, shape (groups, l).
        multiplier_weights: weights of these nodes in the tractions, shape (groups, p, l).
        identity: whether each point is a multiplier node, so that its traction is the multiplier.
    """

    points: Ints
    nodes: Ints
    weights: Array
    multiplier_nodes: Ints
    multiplier_weights: Array
    identity: bool

    def minus(self, other: Stencils) -> Stencils:
        """Return the stencils of this displacement minus another one at the same points."""
        return replace(
            self,
            nodes=np.concatenate([self.nodes, other.nodes], axis=1),
            weights=np.concatenate([self.weights, -other.weights], axis=2),
        )

    def jump_matrix(self, comm: MPI.Comm, nodes: int, dim: int) -> PETSc.Mat:
        """Return the matrix B from displacements to jumps at the points. Collective.

        Args:
            comm: communicator.
            nodes: number of displacement nodes owned by this rank.
            dim: number of components; 1 for the scalar matrix of the weights.
        """
        return self._matrix(comm, self.nodes, self.weights, nodes, dim)

    def traction_matrix(self, comm: MPI.Comm, nodes: int, dim: int) -> PETSc.Mat:
        """Return the matrix E from multipliers to tractions at the points. Collective.

        Args:
            comm: communicator.
            nodes: number of multiplier nodes owned by this rank.
            dim: number of components; 1 for the scalar matrix of the weights.
        """
        return self._matrix(comm, self.multiplier_nodes, self.multiplier_weights, nodes, dim)

    def _matrix(
        self, comm: MPI.Comm, nodes: Ints, weights: Array, owned_nodes: int, dim: int
    ) -> PETSc.Mat:
        """Return a matrix of weights that acts on each component of nodal vectors. Collective."""
        n = int(self.points.size)
        along = np.arange(dim)
        rows = (comm.exscan(dim * n) or 0) + dim * self.points[:, :, None, None] + along
        columns = dim * nodes[:, None, :, None] + along
        return triplet_matrix(comm, (dim * n, dim * owned_nodes), rows, columns, weights[..., None])


# -- weighted sums of nodal values ----------------------------------------------------------------


class NodeWeights(NamedTuple):
    """Nodes and weights of weighted sums of nodal values.

    Attributes:
        nodes: global nodes, shape (..., k).
        weights: weights of the nodes, shape (..., k); 0 for nodes that only pad the array.
    """

    nodes: Ints
    weights: Array


def own_nodes(V: fem.FunctionSpace, nodes: Indices) -> NodeWeights:
    """Return local nodes themselves as `NodeWeights`, each with weight 1."""
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
    """Return column indices and entries of the rows of a matrix, and destroy the matrix."""
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
    """Return nodes and weights of the rows of owned and ghost nodes. Collective.

    Args:
        comm: communicator.
        index_map: index map of the rows.
        owned: nodes and weights of the owned rows.
    """
    k = owned.nodes.shape[1]
    padding = (0, 0), (0, comm.allreduce(k, op=max) - k)
    rows = np.stack([np.pad(part, padding) for part in owned], axis=2, dtype=np.float64)
    nodes, weights = np.moveaxis(SharedValues(index_map).from_owners(rows), 2, 0)
    return NodeWeights(nodes.astype(np.int64), weights.copy())


def multiplied(A: PETSc.Mat, values: Array) -> Array:
    """Return the product of a matrix with owned entries of k vectors, shape (n, k). Collective."""
    return np.stack([product(A, column) for column in values.T], axis=1)
