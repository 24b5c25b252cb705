# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid motions of a body, and free motions of its connected parts."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy

from dolfinx import fem, la

from dolfinx_contact._arrays import Array, Indices, Mask
from dolfinx_contact._geometry import connected_parts, dot, in_space, node_positions
from dolfinx_contact._mpi import largest, total
from dolfinx_contact._petsc import product
from dolfinx_contact.body.cells import vertex_moments

__all__ = [
    "bounding_box",
    "combine",
    "describe",
    "differences",
    "extents",
    "free_motions",
    "largest_turn",
    "loose",
    "number_of_parts",
    "parts",
    "rigid_motions",
    "sums_of_parts",
]

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
    """Return the index of the connected part of the mesh for each local node. Collective.

    Parts are determined on each rank and merged through ghost nodes.
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


def extents(V: fem.FunctionSpace, part: Indices) -> Array:
    """Return the size of every connected part, a rotation-invariant length. Collective.

    The size is sqrt(12) times the root mean square distance from the centre of mass: the diagonal
    of a rectangle or box, or 1.22 times the diameter of a disc. Curved or warped cells are
    replaced by simplices or parallelepipeds (`cells.vertex_moments`).

    Args:
        V: space of the displacement.
        part: index of the connected part of each local node (`parts`).
    """
    domain = V.mesh
    comm = domain.comm
    n = domain.topology.index_map(domain.topology.dim).size_local
    number = number_of_parts(comm, part[: V.dofmap.index_map.size_local])
    middle, volume, spread = vertex_moments(domain)
    p = part[V.dofmap.list[:n, 0]]
    sums = sums_of_parts(comm, number, p, np.column_stack([volume, *(volume * middle)]))
    size = sums[:, 0]
    middle -= (sums[:, 1:].T / size)[:, p]
    about = volume * (spread + np.einsum("in,in->n", middle, middle))
    return np.asarray(np.sqrt(12.0 * sums_of_parts(comm, number, p, about) / size))


def number_of_parts(comm: MPI.Comm, part: Indices) -> int:
    """Return the number of connected parts, given the part of each owned node. Collective."""
    return int(comm.allreduce(int(part.max(initial=-1)), op=max)) + 1


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


def rigid_motions(V: fem.FunctionSpace, part: Indices, *, axisymmetric: bool = False) -> Array:
    """Return infinitesimal rigid motions of every connected part. Collective.

    Rotations are about the centre of the part and divided by its size, so that all motions are
    lengths. A body of revolution has the axial translation only.

    Args:
        V: space of the displacement.
        part: index of the connected part of each local node (`parts`).
        axisymmetric: whether the body is a body of revolution.

    Returns:
        Motions at the local nodes, ordered by part, shape (motions, nodes, dim).
    """
    comm = V.mesh.comm
    dim = V.mesh.geometry.dim
    x = node_positions(V)[:, :dim]
    owned = V.dofmap.index_map.size_local
    number = number_of_parts(comm, part[:owned])
    axes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((number, dim + len(axes), len(x), dim))
    for p in range(number):
        inside = part == p
        here = x[inside]
        low, high = bounding_box(comm, here)
        here = (here - (low + high) / 2) / np.linalg.norm(high - low)
        for i in range(dim):
            modes[p, i, inside, i] = 1.0
        for k, (i, j) in enumerate(axes):
            modes[p, dim + k, inside, i] = -here[:, j]
            modes[p, dim + k, inside, j] = here[:, i]
    if axisymmetric:
        modes = modes[:, 1:2]
    return modes.reshape(number * modes.shape[1], len(x), dim)


def largest_turn(
    V: fem.FunctionSpace,
    nodes: Array,
    u: Array,
    part: Indices,
) -> float:
    """Return the largest linearised mean rotation of the connected parts, in radians. Collective.

    The rotation belongs to the rigid motion that is closest to the nodal displacement in the
    least-squares sense.

    Args:
        V: space of the displacement.
        nodes: positions of the local nodes, shape (n, dim).
        u: local values of the displacement.
        part: index of the connected part of each local node (`parts`).
    """
    comm = V.mesh.comm
    dim = V.mesh.geometry.dim
    n = V.dofmap.index_map.size_local
    x = nodes[:n]
    u = u.reshape(-1, dim)[:n]
    p = part[:n]
    number = number_of_parts(comm, p)
    sums = sums_of_parts(comm, number, p, np.hstack([np.ones((n, 1)), x, u]))
    means = sums[:, 1:] / sums[:, :1]
    here, moved = in_space(x - means[p, :dim]), in_space(u - means[p, dim:])
    squares = dot(here, here)[:, None, None] * np.eye(3)
    inertia = sums_of_parts(comm, number, p, squares - here[:, :, None] * here[:, None, :])
    momentum = sums_of_parts(comm, number, p, np.asarray(np.cross(here, moved), np.float64))
    turns = np.einsum("pij,pj->pi", np.linalg.pinv(inertia, hermitian=True), momentum)
    return float(np.linalg.norm(turns, axis=1).max(initial=0.0))


def differences(V: fem.FunctionSpace, nodes: Array, u: Array, part: Indices) -> tuple[Array, Array]:
    """Return displacement differences and extents of connected parts. Collective.

    Args:
        V: space of the displacement.
        nodes: positions of the local nodes, shape (n, dim).
        u: local values of the displacement.
        part: index of the connected part of each local node (`parts`).

    Returns:
        The largest difference of a displacement component between two nodes of each part, shape
        (parts,), and its extents along the coordinate axes, shape (parts, dim).
    """
    dim = V.mesh.geometry.dim
    n = V.dofmap.index_map.size_local
    p = part[:n]
    values = np.hstack([u.reshape(-1, dim)[:n], nodes[:n]])
    ends = np.full((2, number_of_parts(V.mesh.comm, p), 2 * dim), -np.inf)
    np.maximum.at(ends[0], p, values)
    np.maximum.at(ends[1], p, -values)
    ranges = np.sum(largest(V.mesh.comm, ends), axis=0)
    return ranges[:, :dim].max(axis=1), ranges[:, dim:]


def bounding_box(comm: MPI.Comm, x: Array) -> tuple[Array, Array]:
    """Return the lowest and highest coordinates of points (n, dim) over all ranks. Collective."""
    ends = np.stack([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    opposite, high = largest(comm, ends)
    return -opposite, high


def free_motions(
    K: PETSc.Mat,
    V: fem.FunctionSpace,
    part: Indices,
    fixed: Mask,
    *,
    axisymmetric: bool = False,
) -> Array:
    """Return the rigid motions resisted neither by the stiffness nor by Dirichlet conditions.

    Collective.

    Args:
        K: stiffness of the body without Dirichlet conditions.
        V: space of the displacement.
        part: index of the connected part of each local node (`parts`).
        fixed: mask of components with Dirichlet conditions, shape (local nodes, dim).
        axisymmetric: whether the body is a body of revolution.

    Returns:
        Motions at the local nodes, shape (free motions, nodes, dim).
    """
    modes = rigid_motions(V, part, axisymmetric=axisymmetric)
    n = V.dofmap.index_map.size_local
    held = np.where(fixed[None, :n], modes[:, :n], 0.0).reshape(len(modes), n * modes.shape[2])
    by_data = total(V.mesh.comm, held @ held.T)
    if not len(loose(by_data)):
        return modes[:0]
    scale = K.norm(PETSc.NormType.NORM_INFINITY)
    resisting = np.array([product(K, mode[:n].reshape(-1)) for mode in modes]) / scale
    return combine(by_data + total(V.mesh.comm, resisting @ resisting.T), modes)


def combine(gram: Array, modes: Array) -> Array:
    """Return the linear combinations of ``modes`` in the null space of a Gram matrix."""
    return np.einsum("ab,bnd->and", loose(gram), modes)


def loose(gram: Array) -> Array:
    """Return the null space of a Gram matrix, up to a relative tolerance of 1e-14."""
    values, vectors = np.linalg.eigh(gram)
    return np.asarray(vectors[:, values < 1e-14].T)


def describe(
    free: Array,
    V: fem.FunctionSpace,
    part: Indices,
    *,
    axisymmetric: bool = False,
) -> str:
    """Return the names of the rigid motions that contribute to ``free``. Collective."""
    modes = rigid_motions(V, part, axisymmetric=axisymmetric)
    n = V.dofmap.index_map.size_local
    comm = V.mesh.comm
    A = modes[:, :n].reshape(len(modes), n * modes.shape[2])
    B = free[:, :n].reshape(len(free), n * modes.shape[2])
    coefficients = np.linalg.solve(total(comm, A @ A.T), total(comm, A @ B.T))
    size = np.abs(coefficients).max(axis=1)
    names = ("axial translation",) if axisymmetric else _NAMES[V.mesh.geometry.dim]
    number = len(size) // len(names)
    if number > 1:
        names = tuple(
            f"{name} of part {p + 1} of {number}" for p in range(number) for name in names
        )
    return ", ".join(name for name, s in zip(names, size, strict=True) if s > 1e-6 * size.max())
