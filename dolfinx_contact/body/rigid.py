# SPDX-License-Identifier: LGPL-3.0-or-later
"""Connected parts of a body: their rigid motions, sizes, and stiffness under uniform strains."""

from __future__ import annotations

from itertools import combinations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy

from dolfinx import fem, la

from dolfinx_contact._arrays import Array, Indices, Mask
from dolfinx_contact._geometry import connected_parts, dot, in_space, node_positions, transformed
from dolfinx_contact._mpi import largest, maximum, require, total
from dolfinx_contact._petsc import product
from dolfinx_contact.body.cells import vertex_moments

__all__ = ["Parts", "bounding_box", "combine", "diagonal", "loose", "parts", "sums_of_parts"]

_NO_HOOP = 1e-12  # resistance, relative to the stiffness, that counts as zero
_NAMES = {
    2: ("translation x", "translation y", "rotation"),
    3: (
        "translation x",
        "translation y",
        "translation z",
        "rotation about x",
        "rotation about y",
        "rotation about z",
    ),
}


def parts(V: fem.FunctionSpace) -> Indices:
    """Return the index of the connected part that contains each local node. Collective.

    Connected parts of the mesh are determined on each rank and merged through ghost nodes.
    """
    index_map = V.dofmap.index_map
    comm = V.mesh.comm
    owned = index_map.size_local
    size = index_map.size_local + index_map.num_ghosts
    cells = V.dofmap.list
    number, nodes = cells.shape
    # Graph of nodes, then cells; a cell is connected to its nodes.
    starts = np.concatenate([np.zeros(size, dtype=np.int32), nodes * np.arange(number + 1)])
    rows = np.ones(cells.size), cells.reshape(-1), starts.astype(np.int32)
    graph = scipy.sparse.csr_array(rows, shape=(size + number, size + number))
    count, mine = scipy.sparse.csgraph.connected_components(graph, directed=False)
    mine = mine[:size]
    if comm.size == 1:
        return np.asarray(mine, dtype=np.int32)
    counts = comm.allgather(count)
    mine = mine + sum(counts[: comm.rank])
    owners = la.vector(index_map, 1)
    owners.array[:] = mine
    owners.scatter_forward()
    joined = np.stack([mine[owned:], owners.array[owned:].astype(np.int64)])
    pairs = np.hstack(comm.allgather(np.unique(joined, axis=1)))
    whole = connected_parts(sum(counts), *pairs)[mine]
    # Ghosts without a cell on this rank form separate parts. These have no owned node and are
    # dropped by renumbering the others.
    present = np.unique(np.concatenate(comm.allgather(np.unique(whole[:owned]))))
    return np.searchsorted(present, whole).astype(np.int32)


class Parts:
    """Connected parts of a mesh, and their rigid motions. All methods are collective.

    Args:
        V: space of the displacement.
        axisymmetric: whether the body is a body of revolution.
        joined: whether to treat the whole mesh as one part.

    Attributes:
        of_nodes: for each local node, the index of the part that contains it.
        of_owned: for each owned node, the index of the part that contains it.
        number: number of parts.
    """

    def __init__(self, V: fem.FunctionSpace, *, axisymmetric: bool = False, joined: bool = False):
        self.V = V
        self.comm = V.mesh.comm
        self.axisymmetric = axisymmetric
        self._dim = V.mesh.geometry.dim
        index_map = V.dofmap.index_map
        self._n = index_map.size_local
        size = self._n + index_map.num_ghosts
        self.of_nodes = np.zeros(size, dtype=np.int32) if joined else parts(V)
        self.of_owned = self.of_nodes[: self._n]
        self.number = int(largest(self.comm, self.of_owned.max(initial=-1))) + 1

    def extents(self) -> Array:
        """Return the size of each part, shape (number of parts,).

        The size, invariant under rotations, is sqrt(12) times the root mean square distance from
        the centre of mass: the diagonal of a rectangle or box, or 1.22 times the diameter of a
        disc. Curved or warped cells are replaced by simplices or parallelepipeds
        (`cells.vertex_moments`).
        """
        domain = self.V.mesh
        n = domain.topology.index_map(domain.topology.dim).size_local
        middle, volume, spread = vertex_moments(domain)
        p = self.of_nodes[self.V.dofmap.list[:n, 0]]
        sums = self.sums(np.column_stack([volume, *(volume * middle)]), p)
        size = sums[:, 0]
        middle -= (sums[:, 1:].T / size)[:, p]
        about = volume * (spread + np.einsum("in,in->n", middle, middle))
        return np.asarray(np.sqrt(12.0 * self.sums(about, p) / size))

    def sums(self, values: Array, part: Indices | None = None) -> Array:
        """Return sums over the nodes or cells of each part, shape (number of parts, ...).

        Args:
            values: values at nodes or cells of this rank, shape (n, ...).
            part: index of the part that contains each node or cell; default: parts of the owned
                nodes.
        """
        return sums_of_parts(
            self.comm, self.number, self.of_owned if part is None else part, values
        )

    def motions(self) -> Array:
        """Return the infinitesimal rigid motions of all parts.

        Translations have unit length. Rotations are about the centre of the bounding box of the
        part and divided by its diagonal. A body of revolution has the axial translation only.

        Returns:
            Motions at the local nodes, ordered by part, shape (motions, nodes, dim).
        """
        dim = self._dim
        x = node_positions(self.V)
        axes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
        modes = np.zeros((self.number, dim + len(axes), len(x), dim))
        for p in range(self.number):
            inside = self.of_nodes == p
            here = x[inside]
            low, high = bounding_box(self.comm, here)
            here = (here - (low + high) / 2) / np.linalg.norm(high - low)
            for i in range(dim):
                modes[p, i, inside, i] = 1.0
            for k, (i, j) in enumerate(axes):
                modes[p, dim + k, inside, i] = -here[:, j]
                modes[p, dim + k, inside, j] = here[:, i]
        if self.axisymmetric:
            modes = modes[:, 1:2]
        return modes.reshape(self.number * modes.shape[1], len(x), dim)

    def free_motions(self, K: PETSc.Mat, fixed: Mask) -> Array:
        """Return the rigid motions resisted neither by the stiffness nor by Dirichlet conditions.

        Args:
            K: stiffness of the body without Dirichlet conditions.
            fixed: mask of components with Dirichlet conditions, shape (local nodes, dim).

        Returns:
            Motions at the local nodes, shape (free motions, nodes, dim).
        """
        modes = self.motions()
        owned = self._owned(modes)
        by_data = self.gram_at_fixed(modes, fixed)
        if not len(loose(by_data)):
            return modes[:0]
        scale = K.norm(PETSc.NormType.NORM_INFINITY)
        resisting = np.array([product(K, mode) for mode in owned]) / scale
        return combine(by_data + total(self.comm, resisting @ resisting.T), modes)

    def gram_at_fixed(self, motions: Array, fixed: Mask) -> Array:
        """Return the Gram matrix of motions at Dirichlet components, shape (motions, motions).

        Dirichlet conditions permit combinations of motions in its null space.

        Args:
            motions: motions at the local nodes, shape (motions, nodes, dim).
            fixed: mask of components with Dirichlet conditions, shape (local nodes, dim).
        """
        restricted = self._owned(np.where(fixed, motions, 0.0))
        return total(self.comm, restricted @ restricted.T)

    def describe(self, free: Array) -> str:
        """Name the translations and rotations that occur in given rigid motions.

        Args:
            free: rigid motions at the local nodes, shape (free motions, nodes, dim).
        """
        A = self._owned(self.motions())
        B = self._owned(free)
        coefficients = np.linalg.solve(total(self.comm, A @ A.T), total(self.comm, A @ B.T))
        size = np.abs(coefficients).max(axis=1)
        names = ("axial translation",) if self.axisymmetric else _NAMES[self._dim]
        if self.number > 1:
            names = tuple(
                f"{name} of part {p + 1} of {self.number}"
                for p in range(self.number)
                for name in names
            )
        return ", ".join(name for name, s in zip(names, size, strict=True) if s > 1e-6 * size.max())

    def _owned(self, motions: Array) -> Array:
        """Return motions restricted to the owned dofs, shape (motions, owned dofs)."""
        return motions[:, : self._n].reshape(len(motions), self._n * self._dim)

    # -- stiffness -------------------------------------------------------------------------------

    def require_hoop_stiffness(self, K: PETSc.Mat) -> None:
        """Raise ``ValueError`` if a body of revolution does not resist radial translation.

        This happens if the form is that of a plane body, without hoop strain.
        """
        if not self.axisymmetric:
            return
        radial = np.tile([1.0, 0.0], K.getLocalSize()[0] // 2)
        resistance = maximum(self.comm, np.abs(product(K, radial)))
        require(
            self.comm,
            resistance > _NO_HOOP * K.norm(PETSc.NormType.NORM_INFINITY),
            "the contact surfaces are axisymmetric, but the bulk is that of a plane body: its "
            "energy must contain the hoop strain u[0]/r, as that of materials.Axisymmetric does",
        )

    def softness(self, K: PETSc.Mat) -> Array:
        """Return the ratio of shear to bulk stiffness of each part, shape (number of parts,).

        This ratio is the median divided by the mean of the eigenvalues of the energies of uniform
        strains; 1 for unstable or rigid parts. The energies are those of Voigt's average of the
        elasticity tensor (Hill, Proc. Phys. Soc. A 65, 1952). For an isotropic body in 3D with the
        Lame coefficients lambda and mu, the eigenvalues are 2 mu (five times) and 3 lambda + 2 mu.
        The ratio 4 mu / (4 mu + lambda) is 0.73 for Poisson's ratio 0.3 and 0.008 for 0.499.

        Args:
            K: stiffness of the body without Dirichlet conditions.
        """
        return np.array([_softness(energies) for energies in self._energies(K)])

    def _energies(self, K: PETSc.Mat) -> Array:
        """Return the energy of each part as a bilinear form of k uniform strains, (parts, k, k).

        The k displacements E x at positions x have constant, symmetric, orthonormal gradients E. In
        a body of revolution the displacements are, up to factors, (r, 0), which has equal radial
        and hoop strains, (0, z) and (0, r).
        """
        p = self.of_owned
        dim = self._dim
        x = node_positions(self.V)[: self._n]
        # Relative to the centre of the part: far from the origin, strains are lost in round-off.
        sums = self.sums(np.column_stack([np.ones(self._n), x]))
        middle = sums[:, 1:] / sums[:, :1]
        if self.axisymmetric:
            middle[:, 0] = 0.0
        x = x - middle[p]
        gradients = [np.diag(row) for row in np.eye(dim)]
        for i, j in combinations(range(dim), 2):
            gradients.append(np.zeros((dim, dim)))
            gradients[-1][i, j] = gradients[-1][j, i] = np.sqrt(0.5)
        if self.axisymmetric:
            gradients = [np.diag([np.sqrt(0.5), 0.0]), gradients[1], np.sqrt(2.0) * np.eye(2, k=1)]
        # moments of the forces that cause the strains; an energy is a moment times a gradient
        order = np.argsort(p, kind="stable")
        ends = np.searchsorted(p[order], np.arange(1, self.number))
        places = np.split(x[order], ends)
        moments = []
        for gradient in gradients:
            forces = product(K, (x @ gradient).reshape(-1)).reshape(-1, dim)
            pairs = zip(places, np.split(forces[order], ends), strict=True)
            moments.append([a.T @ b for a, b in pairs])
        return np.einsum("aij,bpij->pab", gradients, total(self.comm, moments))

    # -- displacements ---------------------------------------------------------------------------

    def largest_turn(self, u: Array) -> float:
        """Return the largest mean rotation of any part, linearised, in radians.

        The mean rotation of a part is that of the rigid motion closest to the nodal displacements
        in the least-squares sense.

        Args:
            u: local values of the displacement.
        """
        dim = self._dim
        x = node_positions(self.V)[: self._n]
        u = u.reshape(-1, dim)[: self._n]
        p = self.of_owned
        sums = self.sums(np.hstack([np.ones((self._n, 1)), x, u]))
        means = sums[:, 1:] / sums[:, :1]
        here, moved = in_space(x - means[p, :dim]), in_space(u - means[p, dim:])
        squares = dot(here, here)[:, None, None] * np.eye(3)
        inertia = self.sums(squares - here[:, :, None] * here[:, None, :])
        momentum = self.sums(np.asarray(np.cross(here, moved), np.float64))
        inverse = np.asarray(np.linalg.pinv(inertia, hermitian=True), dtype=np.float64)
        turns = transformed(inverse, momentum)
        return float(np.linalg.norm(turns, axis=1).max(initial=0.0))

    def differences(self, u: Array) -> tuple[Array, Array]:
        """Return the displacement difference and the extents of each part.

        Args:
            u: local values of the displacement.

        Returns:
            Largest difference of a displacement component between any two nodes of the part, shape
            (number of parts,); and extents of the part along the coordinate axes, shape (number of
            parts, dim).
        """
        dim = self._dim
        x = node_positions(self.V)
        columns = *u.reshape(-1, dim)[: self._n].T, *x[: self._n].T
        ends = np.full((2, 2 * dim, self.number), -np.inf)
        for k, column in enumerate(columns):  # NumPy is ten times slower with all columns at once
            np.maximum.at(ends[0, k], self.of_owned, column)
            np.maximum.at(ends[1, k], self.of_owned, -column)
        ranges = np.sum(largest(self.comm, ends), axis=0).T
        return ranges[:, :dim].max(axis=1), ranges[:, dim:]


def _softness(energies: Array) -> float:
    """Return the ratio of shear to bulk stiffness of one part; see `Parts.softness`."""
    if not np.isfinite(energies).all() or not energies.any():
        return 1.0
    eigenvalues = np.linalg.eigvalsh(0.5 * (energies + energies.T))  # in their order
    last = len(eigenvalues) - 1
    median = 0.5 * (eigenvalues[last // 2] + eigenvalues[-(last // 2) - 1])
    # An unstable body has no typical stiffness in this sense.
    return float(max(median / eigenvalues.mean(), 1e-4)) if eigenvalues[0] > 0 else 1.0


def sums_of_parts(comm: MPI.Comm, number: int, part: Indices, values: Array) -> Array:
    """Return sums over the nodes or cells of every connected part. Collective.

    Args:
        comm: communicator.
        number: number of parts.
        part: index of the part of each node or cell of this rank, shape (n,).
        values: values at nodes or cells, shape (n, ...).

    Returns:
        Sums over all ranks, shape (number, ...).
    """
    columns = values.reshape(len(part), np.prod(values.shape[1:], dtype=int)).T
    sums = np.array([np.bincount(part, column, number) for column in columns])
    return total(comm, sums.T).reshape(number, *values.shape[1:])


def diagonal(comm: MPI.Comm, x: Array) -> float:
    """Return the diagonal of the bounding box of points on all ranks. Collective.

    Args:
        comm: communicator.
        x: points of this rank, shape (n, dim).
    """
    low, high = bounding_box(comm, x)
    return float(np.linalg.norm(high - low))


def bounding_box(comm: MPI.Comm, x: Array) -> tuple[Array, Array]:
    """Return the lowest and highest coordinates of points on all ranks. Collective.

    Args:
        comm: communicator.
        x: points of this rank, shape (n, dim).
    """
    ends = np.stack([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    opposite, high = largest(comm, ends)
    return -opposite, high


def combine(gram: Array, modes: Array) -> Array:
    """Return the linear combinations of motions in the null space of a Gram matrix.

    Args:
        gram: Gram matrix, shape (motions, motions).
        modes: motions, shape (motions, nodes, dim).
    """
    return np.einsum("ab,bnd->and", loose(gram), modes)


def loose(gram: Array) -> Array:
    """Return an orthonormal basis of a Gram matrix's null space (eigenvalues < 1e-14), as rows."""
    values, vectors = np.linalg.eigh(gram)
    return np.asarray(vectors[:, values < 1e-14].T)
