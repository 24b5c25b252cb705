# SPDX-License-Identifier: LGPL-3.0-or-later
"""Volumes of cells, and determinants of the deformation gradient in cells."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, geometry, mesh

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._compat import geometry_dofmap
from dolfinx_contact._mpi import require

__all__ = [
    "basis",
    "cells_around",
    "check_cells",
    "chunks",
    "determinants",
    "is_affine",
    "midpoints",
    "reference_points",
    "smallest_jacobian",
    "vertex_moments",
]


_CHUNK = 8192  # number of cells processed together, chosen so that their data fit into the cache
_ROUND_OFF = 16 * np.finfo(np.float64).eps
_OFF_AXIS = 1e-6  # relative shift of points from the axis towards the midpoint of a cell


def check_cells(domain: mesh.Mesh) -> None:
    """Validate coordinates and volumes of cells. Collective.

    Raises:
        ValueError: on every rank, if a coordinate is not finite, or if the volume of a cell is zero
            up to round-off.
    """
    finite = bool(np.isfinite(domain.geometry.x).all())
    require(domain.comm, finite, "the mesh has a coordinate that is not finite")
    number = domain.topology.index_map(domain.topology.dim).size_local
    empty = np.zeros(number, dtype=bool)
    for part, J, corners in _jacobians(domain):
        volumes, lengths, distances = (np.abs(v) for v in (determinants(J), J, corners))
        # one bound for all cells of the chunk, which is faster, decides for nearly every mesh
        if volumes.min() > _round_off(lengths.max(), distances.max(), J.shape[-1]):
            continue
        most = _round_off(lengths.max(axis=(1, 2, 3)), distances.max(axis=(1, 2)), J.shape[-1])
        empty[part] = volumes.max(axis=1) <= most
    cells = np.flatnonzero(empty)
    counts = domain.comm.allgather(len(cells))
    if sum(counts):
        index, x = _first(domain, cells)
        place = ", ".join(f"{c:.6g}" for c in x)
        raise ValueError(
            f"cells without volume: {sum(counts)}, the first is cell {index} (in the order of the "
            f"input), at ({place}); mesh the body again"
        )


def _first(domain: mesh.Mesh, cells: Ints) -> tuple[int, Array]:
    """Find the cell with the smallest input index among given cells of all ranks. Collective.

    Returns:
        Index of the cell in the input, and midpoint of the cell.
    """
    topology = domain.topology
    try:
        numbers = np.asarray(topology.original_cell_index)[cells]
    except RuntimeError:  # DOLFINx does not store the input of a submesh
        numbers = topology.index_map(topology.dim).local_to_global(cells.astype(np.int32))
    mine = []
    if len(cells):
        i = int(np.argmin(numbers))
        mine = [(int(numbers[i]), midpoints(domain, cells[i : i + 1])[0])]
    return min((c for part in domain.comm.allgather(mine) for c in part), key=lambda c: c[0])


# -- geometry ------------------------------------------------------------------------------------


def _is_simplex(domain: mesh.Mesh) -> bool:
    return domain.basix_cell() in (basix.CellType.triangle, basix.CellType.tetrahedron)


def is_affine(domain: mesh.Mesh) -> bool:
    """Return whether all cells of a mesh are affine images of the reference cell."""
    return _is_simplex(domain) and domain.ufl_domain().ufl_coordinate_element().degree == 1


def midpoints(domain: mesh.Mesh, cells: npt.NDArray[Any]) -> Array:
    """Return the midpoints (means of the vertices) of local ``cells``, shape (n, dim)."""
    corners = geometry_dofmap(domain)[cells][:, : len(basix.geometry(domain.basix_cell()))]
    return np.asarray(domain.geometry.x[corners].mean(axis=1)[:, : domain.geometry.dim])


def vertex_moments(domain: mesh.Mesh) -> tuple[Array, Array, Array]:
    """Return centroid, volume and mean square distance to the centroid of each owned cell.

    Each cell is replaced by the simplex or parallelepiped spanned by the edges at its first vertex.
    The shapes are (dim, n), (n,) and (n,) for n cells.
    """
    dim = domain.geometry.dim
    n = domain.topology.index_map(dim).size_local
    corners = len(basix.geometry(domain.basix_cell()))
    nodes = geometry_dofmap(domain)[:n, :corners]
    columns = np.ascontiguousarray(domain.geometry.x[:, :dim].T)
    ends = np.arange(1, dim + 1) if _is_simplex(domain) else 2 ** np.arange(dim)
    share = corners * (dim + 2 if _is_simplex(domain) else 3)
    middle, volume, spread = np.empty((dim, n)), np.empty(n), np.empty(n)
    for part in chunks(n):
        x = columns[:, np.ascontiguousarray(nodes[part].T)]
        middle[:, part] = x.mean(axis=1)
        volume[part] = np.abs(determinants((x[:, ends] - x[:, :1]).transpose(2, 0, 1)))
        x -= middle[:, None, part]
        spread[part] = np.einsum("ikn,ikn->n", x, x) / share
    return middle, volume, spread


def cells_around(domain: mesh.Mesh, points: Array) -> Ints:
    """Return the number of cells, of all ranks, that contain each point, shape (n,). Collective.

    Args:
        domain: mesh whose cells are counted.
        points: points, the same on every rank, shape (n, dim).
    """
    dim = domain.topology.dim
    owned = np.arange(domain.topology.index_map(dim).size_local, dtype=np.int32)
    x = np.zeros((len(points), 3))
    x[:, : points.shape[1]] = points
    counts: Ints = np.zeros(len(x), dtype=np.int64)
    if len(owned) and len(x):
        tree = geometry.bb_tree(domain, dim, entities=owned)
        near = geometry.compute_collisions_points(tree, x)
        counts += np.diff(geometry.compute_colliding_cells(domain, near, x).offsets)
    domain.comm.Allreduce(MPI.IN_PLACE, counts)
    return counts


@lru_cache(maxsize=32)
def reference_points(cell: basix.CellType, degree: int, *, vertices: bool = True) -> Array:
    """Return quadrature points of a reference cell and, optionally, its vertices.

    For degree 0 the only quadrature point is the midpoint. From degree 4 on, the midpoints of edges
    are included.
    """
    corners = basix.geometry(cell)
    if degree == 0:
        return np.asarray(corners.mean(axis=0, keepdims=True))
    points = basix.make_quadrature(cell, degree)[0]
    if not vertices:
        return np.asarray(points)
    if degree >= 4:
        corners = basix.create_lattice(cell, 2, basix.LatticeType.equispaced, True)
    return np.vstack([corners, points])


def basis(element: Any, points: Array) -> tuple[Array, Array]:
    """Evaluate a Lagrange basis and its gradients at points of the reference cell.

    The values have the shape (nodes, points), the gradients the shape (nodes, points * dim).

    Args:
        element: blocked Lagrange element.
        points: points of the reference cell, shape (points, dim).
    """
    table = element.sub_elements[0].basix_element.tabulate(1, points)[..., 0]
    slopes = table[1:].transpose(2, 1, 0)
    return table[0].T, np.ascontiguousarray(slopes.reshape(len(slopes), -1))


def determinants(J: Array) -> Array:
    """Return the determinants of matrices, shape (..., 2, 2) or (..., 3, 3)."""
    a = [[J[..., i, j] for j in range(J.shape[-1])] for i in range(J.shape[-1])]
    if len(a) == 2:
        return np.asarray(a[0][0] * a[1][1] - a[0][1] * a[1][0])
    minors = [a[1][i] * a[2][j] - a[1][j] * a[2][i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return np.asarray(a[0][0] * minors[0] + a[0][1] * minors[1] + a[0][2] * minors[2])


def chunks(number: int) -> Iterator[slice]:
    """Yield slices that divide ``range(number)`` into chunks of at most `_CHUNK` = 8192 cells."""
    for start in range(0, number, _CHUNK):
        yield slice(start, min(start + _CHUNK, number))


def _round_off(length: Any, distance: Any, dim: int) -> Any:
    """Return a bound of the round-off in det J, which grows with the distance from the origin.

    Args:
        length: largest entry of J, a number or one for each cell.
        distance: largest coordinate of the nodes, likewise.
        dim: dimension, 2 or 3.
    """
    return _ROUND_OFF * length ** (dim - 1) * (length + distance)


def _jacobians(domain: mesh.Mesh) -> Iterator[tuple[slice, Array, Array]]:
    """Yield the Jacobian matrices J of the owned cells, in chunks of n cells.

    Each item is the slice of the chunk; J at the reference points, shape (n, points, dim, dim); and
    the positions of the nodes of the cells, shape (n, nodes, dim).
    """
    dim = domain.geometry.dim
    nodes = geometry_dofmap(domain)
    x = domain.geometry.x[:, :dim]
    degree = 0 if is_affine(domain) else 2 * domain.ufl_domain().ufl_coordinate_element().degree
    points = reference_points(domain.basix_cell(), degree)
    _, table = basis(domain.ufl_domain().ufl_coordinate_element(), points)
    for part in chunks(domain.topology.index_map(dim).size_local):
        corners = x[nodes[part]]
        yield part, _gradients_of(corners, table), corners


def _gradients_of(values: Array, table: Array) -> Array:
    """Return the reference gradients of a vector field at points of n cells.

    Shape (n, points, dim, dim).

    Args:
        values: values at the nodes of the cells, shape (n, nodes, dim).
        table: gradients of the basis functions (`basis`).
    """
    n, nodes, dim = values.shape
    flat = np.ascontiguousarray(values.transpose(0, 2, 1)).reshape(-1, nodes) @ table
    return np.asarray(flat.reshape(n, dim, -1, dim).transpose(0, 2, 1, 3))


# -- deformed cells --------------------------------------------------------------------------------


def smallest_jacobian(
    V: fem.FunctionSpace, u: Array, *, vertices: bool = True, axisymmetric: bool = False
) -> tuple[float, Array]:
    """Return the smallest det(I + grad u), and the midpoint of its cell. Collective.

    The determinant is evaluated at quadrature points and, optionally, at the vertices of the cells;
    on linear simplices it is constant. The result is the same on every rank. It is NaN if the
    displacement is not finite, so accept a state only if it is ``> 0``.

    Args:
        V: space of the displacement.
        u: displacement at all local dofs, including ghosts.
        vertices: whether the determinant is also evaluated at the vertices.
        axisymmetric: whether the body is a body of revolution, with the hoop stretch 1 + u_r / r.
    """
    domain = V.mesh
    dim = domain.geometry.dim
    degree = V.ufl_element().degree
    n = domain.topology.index_map(dim).size_local
    order = 0 if is_affine(domain) and degree == 1 and not axisymmetric else 2 * degree
    points = reference_points(domain.basix_cell(), order, vertices=vertices)
    if axisymmetric:  # move points off the axis
        points = points + _OFF_AXIS * (points.mean(axis=0) - points)
    x = domain.geometry.x[:, :dim]
    fields = (geometry_dofmap(domain), x), (V.dofmap.list, u.reshape(-1, dim))
    elements = domain.ufl_domain().ufl_coordinate_element(), V.ufl_element()
    shapes, tables = zip(*(basis(element, points) for element in elements), strict=True)
    values = np.empty(n)
    for part in chunks(n):
        cells = [f[nodes[part]] for nodes, f in fields]
        dX, du = (_gradients_of(c, table) for c, table in zip(cells, tables, strict=True))
        # The gradient is undefined at corners of degenerate quadrilaterals.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            J = determinants(dX)
            ratio = np.where(J == 0, np.inf, determinants(dX + du) / J)
        if axisymmetric:
            r, u_r = (c[:, :, 0] @ shape for c, shape in zip(cells, shapes, strict=True))
            ratio *= 1 + u_r / r
        values[part] = ratio.min(axis=1)
    return _least(domain, values)


def _least(domain: mesh.Mesh, values: Array) -> tuple[float, Array]:
    """Return the smallest value over all cells, and the midpoint of its cell. Collective."""
    smallest = domain.comm.allreduce(float(values.min(initial=np.inf)), op=np.minimum)
    # Among equal values, choose the first cell in the order of the input.
    tolerance = 1e-9 * abs(smallest) if np.isfinite(smallest) else 0.0
    cells = np.flatnonzero((values <= smallest + tolerance) | np.isnan(values))
    return float(smallest), _first(domain, cells)[1]
