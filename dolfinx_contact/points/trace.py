# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets on the boundary of a body, their nodes and normals, and values at global indices."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import basix
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import _geometry
from dolfinx_contact._arrays import Array, Indices, Ints, Mask
from dolfinx_contact._compat import geometry_dofmap, is_topology_of
from dolfinx_contact._geometry import dot, node_positions
from dolfinx_contact._mpi import (
    SharedValues,
    all_ranks,
    everywhere,
    require,
)
from dolfinx_contact._validate import count
from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags

__all__ = [
    "at_global_places",
    "cells_of",
    "edge_of",
    "exterior_facets",
    "facet_closures",
    "facet_normals",
    "nodes_on",
    "outward_normals",
    "owned_exterior",
    "owned_facets",
    "point_ids",
    "sums_at_global_places",
    "trace_nodes",
    "unit_field",
    "vertex_numbers",
]


def owned_facets(domain: mesh.Mesh, facets: Indices) -> Indices:
    """Return those of the given local facets that this rank owns."""
    return facets[facets < domain.topology.index_map(domain.topology.dim - 1).size_local]


def owned_exterior(domain: mesh.Mesh, facets: Indices) -> Indices:
    """Return the given local facets that lie on the boundary and are owned by this rank."""
    exterior = mesh.exterior_facet_indices(domain.topology)
    return np.intersect1d(facets, exterior).astype(np.int32)


def cells_of(domain: mesh.Mesh, facets: Indices) -> Indices:
    """Return for each local facet the index of one cell to which it belongs."""
    dim = domain.topology.dim
    domain.topology.create_connectivity(dim - 1, dim)
    cells = domain.topology.connectivity(dim - 1, dim)
    return cells.array[cells.offsets[facets]]


def edge_of(vertices: fem.FunctionSpace) -> Mask:
    """Return the mask of the local vertices at the edge of a surface. Collective.

    Args:
        vertices: scalar P1 space on the mesh of the facets.
    """
    topology = vertices.mesh.topology
    ends = topology.dim - 1
    topology.create_connectivity(ends, topology.dim)
    open_ends = mesh.exterior_facet_indices(topology)
    index_map = vertices.dofmap.index_map
    at_edge = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
    at_edge[fem.locate_dofs_topological(vertices, ends, open_ends)] = True
    return at_edge


def exterior_facets(domain: mesh.Mesh, facets: Any, tag: int | str | None, name: str) -> Indices:
    """Return the local facets of a surface, ghosts included. Collective.

    A rank may list facets that it does not own, such as ghosts; each listed facet is then returned
    on every rank on which it exists. Local indices from another mesh cannot be detected, because
    indices carry no reference to their mesh.

    Args:
        domain: mesh of the body.
        facets: GmshMesh, MeshTags or array of local indices; the same kind on every rank.
        tag: number of the tag, or name of a physical group; None for indices.
        name: name of the surface for messages.

    Raises:
        ValueError: on every rank, if no facet is found, a facet lies inside the body, no group
            has the name, or the MeshTags belong to another mesh.
    """
    comm = domain.comm
    fdim = domain.topology.dim - 1
    domain.topology.create_connectivity(fdim, fdim + 1)
    domain.topology.create_connectivity(fdim + 1, fdim)
    index_map = domain.topology.index_map(fdim)
    if isinstance(facets, GmshMesh):
        facets = facets.facet_tags
    with everywhere(comm, f"the facets of {name}"):
        try:
            chosen = _chosen(domain, facets, tag)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    found = np.flatnonzero(SharedValues(index_map).marked(chosen)).astype(np.int32)
    owned = owned_facets(domain, found)
    counts = np.array([len(owned), len(owned) - len(owned_exterior(domain, owned))])
    number, inside = comm.allreduce(counts)
    missing = "no facet was given"
    if isinstance(facets, mesh.MeshTags):
        tags = sorted(set().union(*comm.allgather(set(facets.values.tolist()))))
        missing = f"no facet has the tag {tag}; tags of the mesh: {tags}"
    require(comm, number > 0, f"{name}: {missing}")
    words = f"{inside} facets lie inside the body; contact needs facets of its boundary"
    require(comm, inside == 0, f"{name}: {words}")
    return found


def _chosen(domain: mesh.Mesh, facets: Any, tag: int | str | None) -> Indices:
    """Return the local facets selected by the user. Not collective.

    Raises:
        ValueError: if the selection is not valid.
    """
    fdim = domain.topology.dim - 1
    if isinstance(tag, str):
        if not isinstance(facets, NamedTags):
            raise ValueError(
                f"the tag {tag!r} is a name, and only a GmshMesh and its facet_tags have names"
            )
        tag = facets.tag(tag)
    if isinstance(facets, mesh.MeshTags):
        if facets.dim != fdim:
            raise ValueError(f"the MeshTags must be of dimension {fdim}, not {facets.dim}")
        if not is_topology_of(domain, facets):
            raise ValueError("the MeshTags belong to another mesh")
        if tag is None:
            known = f"; names: {sorted(facets.names)}" if isinstance(facets, NamedTags) else ""
            raise ValueError(f"MeshTags of facets need a tag{known}")
        count(tag, "the tag", np.iinfo(np.int32).min)
        return np.asarray(facets.indices[facets.values == tag], dtype=np.int32)
    chosen = np.asarray(facets).reshape(-1)
    if chosen.size > 0 and not np.issubdtype(chosen.dtype, np.integer):
        raise ValueError("facets must be MeshTags or an array of integer indices")
    if tag is not None:
        raise ValueError(
            f"facets are given by their indices or by MeshTags with a tag, not by indices with the "
            f"tag {tag!r}; omit the tag"
        )
    index_map = domain.topology.index_map(fdim)
    if not ((chosen >= 0) & (chosen < index_map.size_local + index_map.num_ghosts)).all():
        raise ValueError("facet indices outside the mesh")
    return chosen.astype(np.int32)


def facet_closures(V: fem.FunctionSpace, facets: Indices) -> Indices:
    """Return the local nodes of ``V`` in the closure of each local facet, one row per facet."""
    topology = V.mesh.topology
    tdim = topology.dim
    to_facets = topology.connectivity(tdim, tdim - 1)
    layout = V.dofmap.dof_layout
    per_cell = len(basix.topology(V.mesh.basix_cell())[tdim - 1])
    closures = np.array([layout.entity_closure_dofs(tdim - 1, i) for i in range(per_cell)])
    cells = cells_of(V.mesh, facets)
    facets_of_cell = to_facets.array[to_facets.offsets[cells][:, None] + np.arange(per_cell)]
    local_facet = np.argmax(facets_of_cell == facets[:, None], axis=1)
    nodes = np.take_along_axis(V.dofmap.list[cells], closures[local_facet], axis=1)
    return np.asarray(nodes, dtype=np.int32)


def trace_nodes(V: fem.FunctionSpace, Q: fem.FunctionSpace, parent_facets: Indices) -> Indices:
    """Return the local node of ``V`` at each local node of ``Q`` (on a facet submesh)."""
    index_map = Q.dofmap.index_map
    nodes = np.full(index_map.size_local + index_map.num_ghosts, -1, dtype=np.int32)
    candidates = facet_closures(V, parent_facets)
    wanted = Q.dofmap.list[: len(parent_facets)]
    X = node_positions(V)
    Y = node_positions(Q)
    distance = np.linalg.norm(X[candidates][:, None, :, :] - Y[wanted][:, :, None, :], axis=3)
    nodes[wanted] = np.take_along_axis(candidates, np.argmin(distance, axis=2), axis=1)
    return nodes


def outward_normals(V: fem.FunctionSpace, facets: Indices) -> Array:
    """Return unit normals at local nodes, area-weighted means of exterior facets. Collective.

    Args:
        V: Lagrange space.
        facets: local exterior facets, ghosts included.

    Returns:
        Normals, zero at nodes that lie on no such facet, shape (nodes, dim).
    """
    owned = owned_facets(V.mesh, facets)
    nodes = facet_closures(V, owned)
    vectors = facet_normals(V.mesh, owned, unit=False)
    parts = np.repeat(vectors[:, None], nodes.shape[1], axis=1)
    return _geometry.unit(SharedValues(V.dofmap.index_map).sums(nodes, parts))


def facet_normals(domain: mesh.Mesh, facets: Indices, *, unit: bool = True) -> Array:
    """Return outward normals of local exterior facets, shape (n, dim).

    Args:
        domain: mesh of the body.
        facets: local exterior facets.
        unit: True for unit vectors, False for area vectors.
    """
    dim = domain.geometry.dim
    if not len(facets):  # DOLFINx divides by their number
        return np.zeros((0, dim))
    x = domain.geometry.x[mesh.entities_to_geometry(domain, dim - 1, facets)][:, :, :dim]
    normals = _geometry.area_vectors(x)
    inside = midpoints(domain, cells_of(domain, facets)) - x.mean(axis=1)
    normals[dot(inside, normals) > 0] *= -1.0
    return _geometry.unit(normals) if unit else normals


def unit_field(domain: mesh.Mesh, vectors: Array) -> tuple[fem.Function, Any]:
    """Return a P1 Function with given vectors at the vertices, and its unit direction in UFL.

    Args:
        domain: mesh.
        vectors: values, shape (vertices, dim).
    """
    field = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (domain.geometry.dim,))))
    field.x.array[:] = vectors.reshape(-1)
    return field, field / ufl.sqrt(ufl.dot(field, field))


def nodes_on(V: fem.FunctionSpace, facets: Indices) -> Mask:
    """Return the mask of the local nodes on given facets of any rank. Collective."""
    return SharedValues(V.dofmap.index_map).marked(facet_closures(V, facets))


def at_global_places(comm: MPI.Comm, values: Array, places: Ints) -> Array:
    """Return entries of a distributed array at global indices. Collective.

    Args:
        comm: communicator.
        values: entries owned by this rank, shape (n, ...).
        places: global indices of the requested entries, owned by any rank; an array of any shape.

    Returns:
        Entries, shape (*places.shape, ...).
    """
    first: int = comm.exscan(len(values)) or 0
    mine = (first <= places) & (places < first + len(values))
    if all_ranks(comm, mine):
        return values[places - first]
    shape = values.shape[1:]
    entries = np.empty((*places.shape, *shape))
    entries[mine] = values[places[mine] - first]
    # entries of other ranks
    width = int(np.prod(shape, dtype=int))
    once, numbers = np.unique(places[~mine], return_inverse=True)
    given = PETSc.Vec().createMPI((values.size, None), comm=comm)
    given.array[:] = values.reshape(-1)
    wanted = PETSc.IS().createBlock(width, once.astype(PETSc.IntType), comm=comm)
    here = PETSc.Vec().createSeq(width * once.size, comm=PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(given, wanted, here, None)
    scatter.scatter(given, here)
    found = here.array_r.copy()
    for thing in (given, wanted, here, scatter):
        thing.destroy()
    entries[~mine] = found.reshape(once.size, *shape)[numbers]
    return entries


def sums_at_global_places(comm: MPI.Comm, owned: int, places: Ints, values: Array) -> Array:
    """Return the sums of values at equal global indices, for the owned indices. Collective.

    Args:
        comm: communicator.
        owned: number of indices owned by this rank.
        places: global indices of the values, owned by any rank, shape (n,).
        values: values at these indices, shape (n,).
    """
    sums = PETSc.Vec().createMPI((owned, None), comm=comm)
    sums.setValues(places.astype(PETSc.IntType), values, addv=PETSc.InsertMode.ADD_VALUES)
    sums.assemble()
    found = np.array(sums.array_r)
    sums.destroy()
    return found


# -- keys of points --------------------------------------------------------------------------------


def vertex_numbers(vertices: fem.FunctionSpace) -> Ints:
    """Return the number in the input mesh of each local vertex, shape (n,).

    Nodes of touching bodies, and of the two sides of a crack, have equal coordinates but different
    numbers. The numbers do not depend on the number of ranks.

    Args:
        vertices: scalar P1 space on a mesh, or on a facet submesh.
    """
    corners = vertices.dofmap.list
    domain = vertices.mesh
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    index_map = vertices.dofmap.index_map
    numbers: Ints = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    numbers[corners] = nodes[geometry_dofmap(domain)[:, : corners.shape[1]]]
    return numbers


def point_ids(
    vertices: fem.FunctionSpace, cells: Indices | None = None, numbers: Ints | None = None
) -> Ints:
    """Return keys that distinguish contact points with equal coordinates, on any number of ranks.

    Args:
        vertices: scalar P1 space on a facet submesh.
        cells: local facets with Gauss points, shape (n,); None if the points are the vertices.
        numbers: numbers of the Gauss points of these facets, shape (n, k).

    Returns:
        Keys of the points of this rank, shape (n, k): the input number of a vertex followed by
        zeros, or the sorted input numbers of the vertices of the facet of a Gauss point.
    """
    corners = vertices.dofmap.list
    vertex = vertex_numbers(vertices)
    if cells is None or numbers is None:
        owned = vertex[: vertices.dofmap.index_map.size_local, None]
        return np.pad(owned, ((0, 0), (0, corners.shape[1] - 1)))
    ids: Ints = np.zeros((numbers.size, corners.shape[1]), dtype=np.int64)
    ids[numbers] = np.sort(vertex[corners[cells]], axis=1)[:, None]
    return ids
