# SPDX-License-Identifier: LGPL-3.0-or-later
"""A whole mesh on rank 0, to be edited there and then distributed.

Cells and nodes are in the order of the input, so that the edited mesh is the same on any number of
ranks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from mpi4py import MPI

import numpy as np

import basix
from dolfinx import mesh

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._compat import (
    create_mesh,
    geometry_dofmap,
    is_topology_of,
    tags_of_entities,
)
from dolfinx_contact._mpi import Arguments, collective, everywhere, keep, require
from dolfinx_contact._validate import listed
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags, no_tags

__all__ = ["WholeMesh", "distributed", "gathered", "join", "tagged"]


@dataclass(frozen=True)
class WholeMesh:
    """Mesh with groups, stored as arrays on rank 0 in the order of the input.

    Attributes:
        cells: nodes of the cells in DOLFINx order, shape (cells, nodes per cell).
        x: coordinates, shape (nodes, dim).
        tagged_cells: indices of the cells with a tag.
        cell_values: tags of these cells.
        cell_names: tag of each named group of cells, by name.
        facets: nodes of the facets with a tag, shape (facets, nodes per facet).
        facet_values: tags of these facets.
        facet_names: tag of each named group of facets, by name.
    """

    cells: Ints
    x: Array
    tagged_cells: Ints
    cell_values: Indices
    cell_names: dict[str, int]
    facets: Ints
    facet_values: Indices
    facet_names: dict[str, int]


def tagged(body: Any, facet_tags: Any, what: str) -> GmshMesh:
    """Return a mesh with its groups. Not collective.

    Args:
        body: mesh, or mesh with groups.
        facet_tags: tags of facets; None to use the groups of the mesh, if it has any.
        what: name of the mesh in messages.

    Raises:
        ValueError: if the tags are not MeshTags of the facets of this mesh.
    """
    if isinstance(body, mesh.Mesh):
        dim = body.topology.dim
        body = GmshMesh(body, no_tags(body, dim), no_tags(body, dim - 1))
    if not isinstance(body, GmshMesh):
        raise ValueError(f"{what} must be a mesh, with or without groups, got {body!r}")
    if facet_tags is None:
        return body
    fits = isinstance(facet_tags, mesh.MeshTags) and facet_tags.dim == body.facet_tags.dim
    if not (fits and is_topology_of(body.mesh, facet_tags)):
        of_dim = f" of dimension {facet_tags.dim}" if hasattr(facet_tags, "dim") else ""
        raise ValueError(
            f"tags of facets of {what} must be MeshTags of the facets of this mesh, got "
            f"{facet_tags!r}{of_dim}"
        )
    return body._replace(facet_tags=NamedTags(facet_tags, getattr(facet_tags, "names", {})))


def gathered(body: GmshMesh) -> WholeMesh | None:
    """Gather a mesh with its groups on rank 0; return None on other ranks. Collective.

    Raises:
        ValueError: on every rank, if the cells are curved.
    """
    domain, cell_tags, facet_tags = body
    keep(domain)
    comm = domain.comm
    tdim = domain.topology.dim
    degree = domain.ufl_domain().ufl_coordinate_element().degree
    require(comm, degree == 1, "the cells are curved: only meshes of first order can be split")
    n = domain.topology.index_map(tdim).size_local
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    owned = domain.geometry.index_map().size_local
    try:
        index = np.asarray(domain.topology.original_cell_index[:n], dtype=np.int64)
    except RuntimeError:  # a submesh has none
        index = (comm.exscan(n) or 0) + np.arange(n)
    domain.topology.create_entities(tdim - 1)
    cells, values = _owned(cell_tags, n)
    facets, facet_values = _owned(facet_tags, domain.topology.index_map(tdim - 1).size_local)
    corners = np.empty((0, len(basix.topology(domain.basix_cell())[-2][0])), dtype=np.int64)
    if len(facets):
        domain.topology.create_connectivity(tdim - 1, tdim)
        corners = nodes[mesh.entities_to_geometry(domain, tdim - 1, facets)]
    x = domain.geometry.x[:owned, : domain.geometry.dim]
    of_cells = nodes[geometry_dofmap(domain)[:n]]
    parts = comm.gather(
        (index, of_cells, nodes[:owned], x, index[cells], values, corners, facet_values)
    )
    if parts is None:
        return None
    index, all_cells, numbers, all_x, with_tag, values, corners, facet_values = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    order, places = np.argsort(index), np.argsort(numbers)
    return WholeMesh(
        np.searchsorted(numbers[places], all_cells[order]),
        all_x[places],
        np.searchsorted(index[order], with_tag),
        values,
        cell_tags.names,
        np.searchsorted(numbers[places], corners),
        facet_values,
        facet_tags.names,
    )


def _owned(tags: mesh.MeshTags, owned: int) -> tuple[Indices, Indices]:
    """Return the indices of the owned entities that have a tag, and their tags."""
    mine = tags.indices < owned
    return tags.indices[mine], tags.values[mine].astype(np.int32)


def distributed(comm: MPI.Comm, whole: WholeMesh | None, element: Any) -> GmshMesh:
    """Distribute a mesh with its groups from rank 0. Collective.

    Args:
        comm: communicator of the mesh.
        whole: mesh on rank 0; None on other ranks.
        element: UFL coordinate element of the mesh.
    """
    empty = None
    if whole is not None:
        values = {f.name: getattr(whole, f.name) for f in fields(whole)}
        none: dict[str, Any] = {k: v[:0] for k, v in values.items() if isinstance(v, np.ndarray)}
        empty = replace(whole, **none)
    received: WholeMesh = comm.bcast(empty)
    whole = received if whole is None else whole
    domain = create_mesh(comm, whole.cells, whole.x, element)
    keep(domain)
    tdim = domain.topology.dim
    cells = tags_of_entities(domain, tdim, whole.cells[whole.tagged_cells], whole.cell_values)
    facets = tags_of_entities(domain, tdim - 1, whole.facets, whole.facet_values)
    return GmshMesh(
        domain, NamedTags(cells, whole.cell_names), NamedTags(facets, whole.facet_names)
    )


def _check(a: Arguments) -> None:
    bodies = listed(a.meshes, "meshes")
    if not bodies:
        raise ValueError("a list of meshes is needed, got an empty one")
    given = [None] * len(bodies) if a.facet_tags is None else listed(a.facet_tags, "facet_tags")
    if len(given) != len(bodies):
        raise ValueError(f"{len(bodies)} meshes need as many facet_tags, got {a.facet_tags}")
    tags = zip(bodies, given, strict=True)
    a.meshes = [tagged(*parts, f"mesh {i}") for i, parts in enumerate(tags, 1)]
    kinds = {(m.mesh.basix_cell(), m.mesh.geometry.dim) for m in a.meshes}
    if len(kinds) > 1:
        raise ValueError(f"meshes of different kinds cannot be joined: {sorted(map(str, kinds))}")


@collective("joining meshes", _check)
def join(
    meshes: Sequence[mesh.Mesh] | Sequence[GmshMesh],
    *,
    facet_tags: Sequence[mesh.MeshTags] | None = None,
) -> GmshMesh:
    """Return one mesh of several bodies, which do not share nodes. Collective.

    Names of groups are kept. A group keeps its tag unless a group of another name already has this
    tag; then it gets a new tag. Groups of the same name in several meshes are merged. The cells of
    a mesh without groups of cells get the tag 1 in the first mesh, 2 in the second, and so on::

        upper = name_groups(square, {"top": top, "sole": bottom}, cells="upper")
        lower = read_mesh(comm, "lower.msh")  # groups lower, seat and base
        body = join([upper, lower])
        pair = ContactPair(u, body, slave="sole", master="seat", law=Coulomb(0.4))

    Args:
        meshes: meshes with the same dimension and kind of cells, each on all ranks.
        facet_tags: facet tags of every mesh; default: tags of its groups of facets.

    Raises:
        ValueError: on every rank, if the meshes differ in dimension or kind of cells, cells are
            curved, tags are missing, or tags belong to another mesh or to other entities.
    """
    bodies: Sequence[Any] = meshes
    comm = bodies[0].mesh.comm
    parts = [gathered(body) for body in bodies]
    with everywhere(comm, "joining meshes"):
        whole = _joined([p for p in parts if p is not None])
    element = bodies[0].mesh.ufl_domain().ufl_coordinate_element()
    return distributed(comm, whole, element)


def _joined(parts: list[WholeMesh]) -> WholeMesh | None:
    """Return the union of several meshes; None if there are no meshes on this rank."""
    if not parts:
        return None
    for i, p in enumerate(parts):
        if not len(p.tagged_cells):
            n = len(p.cells)
            parts[i] = replace(
                p, tagged_cells=np.arange(n), cell_values=np.full(n, i + 1, np.int32)
            )
    nodes = np.cumsum([0, *(len(p.x) for p in parts)])
    cells = np.cumsum([0, *(len(p.cells) for p in parts)])
    shifted = [
        (p.cells + node, p.x, p.tagged_cells + cell, p.facets + node)
        for p, node, cell in zip(parts, nodes, cells, strict=False)
    ]
    all_cells, x, tagged_cells, facets = (
        np.concatenate(column) for column in zip(*shifted, strict=True)
    )
    of_cells = _merged([(p.cell_values, p.cell_names) for p in parts])
    of_facets = _merged([(p.facet_values, p.facet_names) for p in parts])
    return WholeMesh(all_cells, x, tagged_cells, *of_cells, facets, *of_facets)


def _merged(
    parts: Sequence[tuple[Indices, Mapping[str, int]]],
) -> tuple[Indices, dict[str, int]]:
    """Return the tags of the entities of all meshes together, and the tag of each group by name.

    Args:
        parts: for each mesh, the tags of its entities and the tag of each group by name.
    """
    unnamed = [np.setdiff1d(values, list(names.values())) for values, names in parts]
    taken = set(np.concatenate(unnamed).tolist())
    tags: dict[str, int] = {}
    merged = []
    for old, names in parts:
        new = old.copy()
        for name, tag in names.items():
            if name not in tags:
                tags[name] = max(taken) + 1 if tag in taken else tag
                taken.add(tags[name])
            new[old == tag] = tags[name]
        merged.append(new)
    return np.concatenate(merged), tags
