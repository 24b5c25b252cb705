# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a body's boundary and the dofs that live on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, la, mesh

from dolfinx_contact import _geometry
from dolfinx_contact._compat import geometry_dofmap, is_topology_of
from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import SharedValues, anywhere, everywhere, require, same_everywhere
from dolfinx_contact._validate import count, instance, number, one_of
from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags

__all__ = [
    "across_planes",
    "at_global_places",
    "checked_planes",
    "exterior_facets",
    "facet_closures",
    "facet_normals",
    "nodes_on",
    "outward_normals",
    "owned_exterior",
    "point_ids",
    "rounded",
    "tagged_facets",
    "trace_dofs",
    "vertex_numbers",
]


Ids = npt.NDArray[np.int64]
_ON_PLANE = 1e-9  # of the largest coordinate, up to which a node lies on a plane of symmetry


def tagged_facets(
    comm: MPI.Comm, facets: Any, tag: int | str | None, what: str
) -> tuple[Any, int | None]:
    """Return the facets of a surface and the number of their tag, which may be a name. Collective.

    Args:
        comm: communicator.
        facets: GmshMesh, MeshTags or array of local indices.
        tag: number, name of a physical group, or None.
        what: name of the surface in messages.

    Returns:
        MeshTags or array, and the number.

    Raises:
        ValueError: on every rank, if no group has the name, or ranks request different tags.
    """
    tag = int(tag) if isinstance(tag, np.integer) else tag
    same_everywhere(comm, **{f"{what}: tag": tag})
    if isinstance(facets, GmshMesh):
        facets = facets._named_facets
        known = sorted(facets.names)
        require(comm, tag is not None, f"{what}: the facets of a mesh need a tag; names: {known}")
    if not isinstance(tag, str):
        return facets, tag
    message = (
        f"{what}: the tag {tag!r} is a name, and only a GmshMesh and its facet_tags have names"
    )
    require(comm, isinstance(facets, NamedTags), message)
    try:
        return facets, facets.tag(tag)
    except ValueError as error:  # the same on every rank, as names and tag are
        raise ValueError(f"{what}: {error}") from None


def owned_exterior(domain: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Those of the local ``facets`` that this rank owns and that lie on the boundary."""
    exterior = mesh.exterior_facet_indices(domain.topology)
    return np.intersect1d(facets, exterior).astype(np.int32)


def exterior_facets(
    domain: mesh.Mesh, facets: mesh.MeshTags | npt.NDArray[np.int32], tag: int | None, name: str
) -> npt.NDArray[np.int32]:
    """Facets of a surface on this rank, ghosts included, whichever rank the user named them on.

    Every rank gives facets of the same kind, MeshTags or indices. Indices do not tell which mesh
    they number: those of another one would be read as facets of this one.

    Raises:
        ValueError: on every rank, if there is no such facet, one lies inside the body, or the
            MeshTags are those of another mesh.
    """
    fdim = domain.topology.dim - 1
    comm = domain.comm
    domain.topology.create_connectivity(fdim, fdim + 1)
    domain.topology.create_connectivity(fdim + 1, fdim)
    index_map = domain.topology.index_map(fdim)
    size = index_map.size_local + index_map.num_ghosts
    with everywhere(comm, f"the facets of {name}"):
        chosen = _chosen(domain, facets, tag, name)
        if not ((chosen >= 0) & (chosen < size)).all():
            raise ValueError(f"{name}: facet indices outside the mesh")
        chosen = chosen.astype(np.int32)
    if isinstance(facets, mesh.MeshTags):
        tags = sorted(set().union(*comm.allgather(set(facets.values.tolist()))))
        missing = f"no facet has the tag {tag}; tags of the mesh: {tags}"
    else:
        missing = "no facet was given"
    marks = la.vector(index_map, 1)
    marks.array[:] = 0.0
    marks.array[chosen] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    owned = np.flatnonzero(marks.array[: index_map.size_local] > 0).astype(np.int32)
    require(comm, comm.allreduce(len(owned)) > 0, f"{name}: {missing}")
    count = comm.allreduce(len(owned) - len(owned_exterior(domain, owned)))
    require(
        comm,
        count == 0,
        f"{name}: {count} facets lie inside the body; contact needs facets of its boundary",
    )
    marks.scatter_forward()
    return np.flatnonzero(marks.array > 0).astype(np.int32)


def _chosen(
    domain: mesh.Mesh, facets: mesh.MeshTags | npt.NDArray[np.int32], tag: int | None, name: str
) -> npt.NDArray[np.int64]:
    """The local facets that the user names, as they are named. Not collective."""
    fdim = domain.topology.dim - 1
    if isinstance(facets, mesh.MeshTags):
        if facets.dim != fdim:
            raise ValueError(f"{name}: the MeshTags must be of dimension {fdim}, not {facets.dim}")
        if not is_topology_of(domain, facets):
            raise ValueError(f"{name}: the MeshTags are those of another mesh")
        if tag is None:
            raise ValueError(f"{name}: MeshTags of facets need a tag")
        if isinstance(tag, bool) or not isinstance(tag, int | np.integer):
            raise ValueError(f"{name}: the tag must be a whole number, got {tag!r}")
        return np.asarray(facets.indices[facets.values == tag], dtype=np.int64)
    given = np.asarray(facets).reshape(-1)
    if given.size > 0 and not np.issubdtype(given.dtype, np.integer):
        raise ValueError(f"{name}: facets must be MeshTags or an array of integer indices")
    return given.astype(np.int64)


def facet_closures(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Local nodes of ``V`` in the closure of each of the local ``facets``, one row a facet."""
    topology = V.mesh.topology
    tdim = topology.dim
    to_cells = topology.connectivity(tdim - 1, tdim)
    to_facets = topology.connectivity(tdim, tdim - 1)
    layout = V.dofmap.dof_layout
    per_cell = len(basix.topology(V.mesh.basix_cell())[tdim - 1])
    closures = np.array([layout.entity_closure_dofs(tdim - 1, i) for i in range(per_cell)])
    if len(facets) == 0:
        return np.zeros((0, closures.shape[1]), dtype=np.int32)
    cells = to_cells.array[to_cells.offsets[facets]]
    facets_of_cell = to_facets.array[to_facets.offsets[cells][:, None] + np.arange(per_cell)]
    local_facet = np.argmax(facets_of_cell == facets[:, None], axis=1)
    nodes = np.take_along_axis(V.dofmap.list[cells], closures[local_facet], axis=1)
    return np.asarray(nodes, dtype=np.int32)


def trace_dofs(
    V: fem.FunctionSpace, Q: fem.FunctionSpace, parent_facets: npt.NDArray[np.int32]
) -> npt.NDArray[np.int32]:
    """For every local node of ``Q`` (on a facet submesh) the local node of ``V`` at its place."""
    index_map = Q.dofmap.index_map
    nodes = np.full(index_map.size_local + index_map.num_ghosts, -1, dtype=np.int32)
    candidates = facet_closures(V, parent_facets)
    wanted = Q.dofmap.list[: len(parent_facets)]
    X = node_positions(V)
    Y = node_positions(Q)
    distance = np.linalg.norm(X[candidates][:, None, :, :] - Y[wanted][:, :, None, :], axis=3)
    if len(parent_facets):
        nodes[wanted] = np.take_along_axis(candidates, np.argmin(distance, axis=2), axis=1)
    return nodes


def outward_normals(
    V: fem.FunctionSpace, facets: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.float64], float]:
    """Unit normals at the local nodes, means over the facets around them by area. Collective.

    Args:
        V: a Lagrange space.
        facets: local exterior facets, ghosts included.

    Returns:
        Normals (nodes, dim), zero off the facets, and the size of the smallest facet of this rank.
    """
    domain = V.mesh
    dim = V.mesh.geometry.dim
    owned = facets[facets < domain.topology.index_map(dim - 1).size_local]
    normals = facet_normals(domain, owned, unit=False)
    nodes = facet_closures(V, owned)
    at_nodes = np.repeat(normals[:, None], nodes.shape[1], axis=1)
    values = SharedValues(V.dofmap.index_map).sums(nodes, at_nodes)
    areas = np.linalg.norm(normals, axis=1)
    size = float(np.min(areas, initial=np.inf) ** (1 / (dim - 1)))
    length = np.linalg.norm(values, axis=1, keepdims=True)
    return np.divide(values, length, out=np.zeros_like(values), where=length > 0), size


def facet_normals(
    domain: mesh.Mesh, facets: npt.NDArray[np.int32], *, unit: bool = True
) -> npt.NDArray[np.float64]:
    """Outward normals of local exterior facets (n, dim), of unit length or that of the area."""
    dim = domain.geometry.dim
    if not len(facets):  # DOLFINx divides by their number
        return np.zeros((0, dim))
    domain.topology.create_connectivity(dim - 1, dim)
    x = domain.geometry.x[mesh.entities_to_geometry(domain, dim - 1, facets)][:, :, :dim]
    normals = _geometry.area_vectors(x)
    to_cells = domain.topology.connectivity(dim - 1, dim)
    inside = midpoints(domain, to_cells.array[to_cells.offsets[facets]]) - x.mean(axis=1)
    normals[np.sum(inside * normals, axis=1) > 0] *= -1.0
    return _geometry.unit(normals) if unit else normals


def rounded(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Coordinates to nine digits of the largest."""
    size = 10.0 ** np.ceil(np.log10(np.max(np.abs(x), initial=1e-300)))
    return np.round(x / size, 9) * size + 0.0


def checked_planes(symmetry: Any, dim: int, name: str) -> dict[int, float]:
    """Planes of symmetry, by their axis, or ``ValueError`` if these are none. Not collective."""
    if symmetry is None:
        return {}
    instance(symmetry, f"{name}: symmetry", dict, "planes by their axis, as {0: 0.0} for x = 0")
    what = f"{name}: an axis of symmetry"
    planes = {
        one_of(count(axis, what, 0), what, range(dim)): number(
            place, f"{name}: a plane of symmetry"
        )
        for axis, place in symmetry.items()
    }
    return dict(sorted(planes.items()))


def across_planes(
    V: fem.FunctionSpace,
    slave: npt.NDArray[np.bool_],
    master: npt.NDArray[np.bool_],
    planes: Mapping[int, float],
    name: str,
) -> npt.NDArray[np.bool_]:
    """Local nodes x dim, True along axes across planes of symmetry on which nodes lie. Collective.

    Args:
        V: a Lagrange space.
        slave: which local nodes lie on the face that ends at the planes.
        master: which lie on the other face, which has images behind them.
        planes: of symmetry, where they are by their axis.
        name: of the surface.

    Raises:
        ValueError: on every rank, if no node of the slave lies on a plane, or some of the slave, or
            of both faces, lie on either side of it.
    """
    dim = V.mesh.geometry.dim
    comm = V.mesh.comm
    x = node_positions(V)[:, :dim]
    owned = V.dofmap.index_map.size_local
    across: npt.NDArray[np.bool_] = np.zeros(x.shape, dtype=bool)
    size = comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=max)
    for axis, place in planes.items():
        off = x[:, axis] - place
        near = np.abs(off) <= _ON_PLANE * size
        across[:, axis] = near & (slave | master)
        sides = [near, ~near & (off < 0), ~near & (off > 0)]
        counts = np.array([int((on & c)[:owned].sum()) for on in (slave, master) for c in sides])
        there, below, above, _, under, over = comm.allreduce(counts)
        where = f"the plane of symmetry {'xyz'[axis]} = {place:g}"
        require(
            comm,
            there > 0 and not (below and above),
            f"{name}: {where} does not end the face: {there} of its nodes lie on it, {below} "
            f"below and {above} above",
        )
        require(
            comm,
            not (below + under and above + over),
            f"{name}: images of the master lie behind {where}, so that both faces lie on one side "
            f"of it; below are {below} nodes of the slave and {under} of the master, above "
            f"{above} and {over}",
        )
    return across


def nodes_on(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Which local nodes lie on facets of any rank. Collective."""
    nodes = facet_closures(V, facets)
    counts = SharedValues(V.dofmap.index_map).sums(nodes, np.ones(nodes.shape))
    return np.asarray(counts > 0)


def at_global_places(
    comm: MPI.Comm, values: npt.NDArray[np.float64], places: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Values of any rank. Collective.

    Args:
        comm: communicator.
        values: of this rank (n, ...).
        places: among those of all ranks, of any shape.

    Returns:
        Of shape (*places.shape, ...).
    """
    first: int = comm.exscan(len(values)) or 0
    mine = (first <= places) & (places < first + len(values))
    if not anywhere(comm, not mine.all())[0]:
        return np.asarray(values[places - first])
    shape = values.shape[1:]
    width = int(np.prod(shape, dtype=int))
    given = PETSc.Vec().createMPI((values.size, None), comm=comm)
    given.array[:] = values.reshape(-1)
    entries = width * places.reshape(-1, 1) + np.arange(width)
    wanted = PETSc.IS().createGeneral(entries.reshape(-1).astype(PETSc.IntType), comm=comm)
    here = PETSc.Vec().createSeq(entries.size, comm=PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(given, wanted, here, None)
    scatter.scatter(given, here)
    found = here.array_r.copy()
    for thing in (given, wanted, here, scatter):
        thing.destroy()
    return np.asarray(found.reshape(*places.shape, *shape))


# -- keys of points --------------------------------------------------------------------------------


def vertex_numbers(vertices: fem.FunctionSpace) -> Ids:
    """Return the numbers of all local vertices in the input of the mesh, shape (n,).

    Nodes of touching bodies, and of the two sides of a crack, share their coordinates but not these
    numbers, which do not depend on the number of ranks.

    Args:
        vertices: scalar P1 space on a mesh, or on a facet submesh.
    """
    corners = vertices.dofmap.list
    domain = vertices.mesh
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    index_map = vertices.dofmap.index_map
    numbers: Ids = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    numbers[corners] = nodes[geometry_dofmap(domain)[:, : corners.shape[1]]]
    return numbers


def point_ids(
    vertices: fem.FunctionSpace,
    cells: npt.NDArray[np.int32] | None = None,
    numbers: Ids | None = None,
) -> tuple[Ids, Ids]:
    """Return keys that distinguish contact points at one place, on any number of ranks.

    Args:
        vertices: scalar P1 space on a facet submesh.
        cells: local facets with Gauss points, shape (n,); None if the points are the vertices.
        numbers: numbers of the Gauss points of these facets, shape (n, k).

    Returns:
        Keys of the points of this rank and of all local vertices, shape (n, k) each: the input
        number of a vertex followed by zeros, or the sorted numbers of the facet of a Gauss point.
    """
    corners = vertices.dofmap.list
    vertex = vertex_numbers(vertices)
    of_vertices: Ids = np.zeros((len(vertex), corners.shape[1]), dtype=np.int64)
    of_vertices[:, 0] = vertex
    if cells is None or numbers is None:
        return of_vertices[: vertices.dofmap.index_map.size_local], of_vertices
    of_points: Ids = np.zeros((numbers.size, corners.shape[1]), dtype=np.int64)
    of_points[numbers] = np.sort(vertex[corners[cells]], axis=1)[:, None]
    return of_points, of_vertices
