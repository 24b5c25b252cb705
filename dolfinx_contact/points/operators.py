# SPDX-License-Identifier: LGPL-3.0-or-later
r"""B at a state: from displacements to jumps at contact points, and from tractions to forces.

Forces do the work of tractions, B^T W t . v = sum W t . (B v), with the areas W of the points. As
long as each point keeps the same point opposite to it B is the same at every state. Where points
slide
on to other facets it is not: then the jumps that laws see may change by more than B v, and the
forces of held tractions change with the displacement.

With B the same at every state jumps and tractions are weighted sums of nodal vectors (`Stencils`),

    j = B u,    t = E l,    B = b (x) I,    E = e (x) I,

with the scalar weights b and e of the nodes of the displacement and of the multiplier. Points come
in groups that share their nodes: those of a facet, or every point by itself.

What needs B to be the same everywhere (matrices that are set up once, condensation onto the contact
points, proofs) takes it from `DiscreteSurface.constant_operator`, which refuses any other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._petsc import Entries, matrix_of

__all__ = [
    "ConstantOperator",
    "Operator",
    "Stencils",
    "multiplied",
    "multiplied_transposed",
    "rows_of",
    "weights_matrix",
]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


class Operator(ABC):
    """B of a surface at a state. Collective, as all its methods are.

    Displacements are those of the owned nodes (n, dim), seen from the rigid body where there is one
    (`DiscreteSurface.relative`); tractions and jumps those at the contact points of this rank.
    """

    #: W of the points (n,), by which tractions become forces.
    areas: Array
    #: Mask (n,) of points without an opposing point, which carry nothing; None if there are none.
    absent: npt.NDArray[np.bool_] | None = None
    #: Weights (n,) of the laws of the points; the remainder of a traction is `mean_around`. None if
    #: all weights are 1.
    share: Array | None = None

    @abstractmethod
    def apply(self, v: Array) -> Array:
        """B v at the points (n, dim)."""

    @abstractmethod
    def rate(self, v: Array) -> Array:
        """The derivative along v of the jumps that laws see (n, dim).

        Where normals turn with the displacement without what turns with them (`normal_rate`).
        """

    def normal_rate(self, v: Array) -> Array | None:
        """The derivative along v of the normals (n, dim); None where jumps alone turn them."""
        return None

    def mean_around(self, tractions: Array) -> Array:
        """Means of the tractions of the points around each (n, dim)."""
        return tractions

    @abstractmethod
    def transpose(self, tractions: Array) -> Array:
        """B^T W t: forces on the owned displacement dofs, flat."""

    @abstractmethod
    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        """The derivative along v of the forces of held tractions, flat."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the matrices."""


@dataclass(frozen=True, eq=False)
class ConstantOperator(Operator):
    """B that is the same at every state: jumps are B u, but for a constant.

    Attributes:
        stencils: weights of the nodes at the points, of B and of the multipliers.
        areas: W of the points (n,).
        B: the matrix.
    """

    stencils: Stencils
    areas: Array
    B: PETSc.Mat

    def apply(self, v: Array) -> Array:
        x, y = self.B.createVecs()
        x.array[:] = v.reshape(-1)
        self.B.mult(x, y)
        values = y.array_r.reshape(-1, v.shape[1]).copy()
        x.destroy(), y.destroy()
        return np.asarray(values)

    def rate(self, v: Array) -> Array:
        return self.apply(v)

    def transpose(self, tractions: Array) -> Array:
        return multiplied_transposed(self.B, self.areas[:, None] * tractions)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        return np.zeros(v.size)

    def destroy(self) -> None:
        self.B.destroy()


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
