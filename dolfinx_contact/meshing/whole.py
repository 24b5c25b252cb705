# SPDX-License-Identifier: LGPL-3.0-or-later
"""A whole mesh on rank 0, to be edited there and then distributed.

Cells and nodes are in the order of the input, so that the result is the same on any number of
ranks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from dolfinx_contact._mpi import Arguments, collective, keep, require
from dolfinx_contact._validate import listed
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags, named_mesh

__all__ = ["WholeMesh", "check_tags", "distributed", "gathered", "join"]


@dataclass(frozen=True)
class WholeMesh:
    """A mesh and its tags.

    Attributes:
        cells: nodes of the cells in the order of DOLFINx, shape (cells, k).
        x: coordinates, shape (nodes, dim).
        tagged_cells: numbers of the cells with a tag.
        cell_values: tags of these cells.
        facets: nodes of the facets with a tag, shape (facets, k).
        facet_values: tags of these facets.
    """

    cells: Ints
    x: Array
    tagged_cells: Ints
    cell_values: Indices
    facets: Ints
    facet_values: Indices


def gathered(
    domain: mesh.Mesh, cell_tags: mesh.MeshTags | None, facet_tags: mesh.MeshTags | None
) -> WholeMesh | None:
    """Return a mesh on rank 0, None on other ranks. Collective.

    Raises:
        ValueError: on every rank, if the cells are curved.
    """
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
    cells, values = _tagged(cell_tags, n)
    number = 0 if facet_tags is None else domain.topology.index_map(tdim - 1).size_local
    facets, facet_values = _tagged(facet_tags, number)
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
    index, all_cells, numbers, all_x, tagged, values, corners, facet_values = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    order, places = np.argsort(index), np.argsort(numbers)
    return WholeMesh(
        np.searchsorted(numbers[places], all_cells[order]),
        all_x[places],
        np.searchsorted(index[order], tagged),
        values,
        np.searchsorted(numbers[places], corners),
        facet_values,
    )


def check_tags(domain: mesh.Mesh, tags: Any, dim: int, what: str) -> None:
    """Raise ``ValueError`` unless tags are MeshTags of entities of a mesh. Not collective.

    Args:
        domain: mesh.
        tags: tags to validate.
        dim: dimension of the entities.
        what: name of the tags in the message.
    """
    if not isinstance(tags, mesh.MeshTags | NamedTags):
        raise ValueError(f"{what} must be MeshTags, got {tags!r}")
    if tags.dim != dim:
        names = {domain.topology.dim: "cells", domain.topology.dim - 1: "facets"}
        found = names.get(tags.dim, f"entities of dimension {tags.dim}")
        raise ValueError(f"{what} must be tags of {names[dim]}, and are tags of {found}")
    if not is_topology_of(domain, tags):
        raise ValueError(f"{what} belong to another mesh")


def _tagged(tags: mesh.MeshTags | None, owned: int) -> tuple[Indices, Indices]:
    """Return the owned entities with a tag, and their tags."""
    if tags is None:
        return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
    mine = tags.indices < owned
    return tags.indices[mine], tags.values[mine].astype(np.int32)


def distributed(
    comm: MPI.Comm, whole: WholeMesh | None, element: Any
) -> tuple[mesh.Mesh, mesh.MeshTags, mesh.MeshTags]:
    """Return the distributed mesh, with tags of cells and facets. Collective.

    Args:
        comm: communicator.
        whole: mesh on rank 0; None on other ranks.
        element: UFL coordinate element.
    """
    shape = comm.bcast(
        None if whole is None else (whole.cells.shape[1], whole.x.shape[1], whole.facets.shape[1])
    )
    if whole is None:
        none = np.empty(0, dtype=np.int64)
        tags = none.astype(np.int32)
        cells = none.reshape(0, shape[0])
        facets = none.reshape(0, shape[2])
        whole = WholeMesh(cells, np.empty((0, shape[1])), none, tags, facets, tags)
    domain = create_mesh(comm, whole.cells, whole.x, element)
    keep(domain)
    tdim = domain.topology.dim
    cell_tags = tags_of_entities(domain, tdim, whole.cells[whole.tagged_cells], whole.cell_values)
    facet_tags = tags_of_entities(domain, tdim - 1, whole.facets, whole.facet_values)
    return domain, cell_tags, facet_tags


def _check(a: Arguments) -> None:
    given = a.meshes
    bodies: list[Any] = list(given) if isinstance(given, list | tuple) else []
    if bodies and all(isinstance(m, GmshMesh) for m in bodies):
        a.cell_tags = a.cell_tags or [m._named_cells for m in bodies]
        a.facet_tags = a.facet_tags or [m._named_facets for m in bodies]
        bodies = [m.mesh for m in bodies]
    if not bodies or not all(isinstance(m, mesh.Mesh) for m in bodies):
        raise ValueError(
            f"a list of meshes is needed, all with groups (see name_groups) or none, got {given!r}"
        )
    kinds = {(m.basix_cell(), m.geometry.dim) for m in bodies}
    if len(kinds) > 1:
        raise ValueError(f"meshes of different kinds cannot be joined: {sorted(map(str, kinds))}")
    tdim = bodies[0].topology.dim
    for what, dim, tags in (("cell", tdim, a.cell_tags), ("facet", tdim - 1, a.facet_tags)):
        if tags is None:
            continue
        if len(listed(tags, f"{what}_tags")) != len(bodies):
            raise ValueError(f"{len(bodies)} meshes need as many tags, got {len(tags)}")
        for i, (m, t) in enumerate(zip(bodies, tags, strict=True), 1):
            check_tags(m, t, dim, f"the {what}_tags of mesh {i}")
    a.meshes = bodies
    a.prefixes = listed(a.prefixes or [""] * len(bodies), "prefixes")
    if len(a.prefixes) != len(bodies):
        raise ValueError(f"{len(bodies)} meshes need as many prefixes, got {a.prefixes}")


@collective("joining meshes", _check)
def join(
    meshes: Sequence[mesh.Mesh] | Sequence[GmshMesh],
    *,
    prefixes: Sequence[str] | None = None,
    cell_tags: Sequence[mesh.MeshTags] | None = None,
    facet_tags: Sequence[mesh.MeshTags] | None = None,
) -> GmshMesh:
    """Return one mesh of several bodies, which do not share nodes. Collective.

    Names of groups are kept. A group keeps its tag unless a group of another name has it already;
    then it gets a new one. Groups of the same name in several meshes are merged::

        upper = name_groups(square, {"top": top, "sole": bottom}, cells="upper")
        lower = read_mesh(comm, "lower.msh")  # groups lower, seat and base
        body = join([upper, lower])
        pair = ContactPair(u, body, slave="sole", master="seat", law=Coulomb(0.4))

    Args:
        meshes: meshes with the same dimension and kind of cells, each on all ranks.
        prefixes: one prefix per mesh for the names of its groups, which keeps groups of the same
            name apart: ``("upper_", "lower_")``; default: none.
        cell_tags: cell tags of every mesh; default: its groups of cells; without groups, 1 for the
            cells of the first body, 2 for those of the second, and so on.
        facet_tags: facet tags of every mesh; default: its groups of facets.

    Raises:
        ValueError: on every rank, if the meshes differ in their kind or dimension or are curved, or
            tags or prefixes are missing, or tags belong to another mesh or to other entities.
    """
    bodies: Sequence[Any] = meshes
    comm = bodies[0].comm
    parts = []
    for i, body in enumerate(bodies):
        keep(body)
        facets = None if facet_tags is None else facet_tags[i]
        part = gathered(body, None if cell_tags is None else cell_tags[i], facets)
        if part is not None and cell_tags is None:
            values = np.full(len(part.cells), i + 1, dtype=np.int32)
            every = np.arange(len(part.cells))
            part = replace(part, tagged_cells=every, cell_values=values)
        parts.append(part)
    names = [
        [
            {prefix + name: tag for name, tag in getattr(tags, "names", {}).items()}
            for tags, prefix in zip(given or [None] * len(bodies), prefixes or (), strict=True)
        ]
        for given in (cell_tags, facet_tags)
    ]
    whole, merged = None, None
    if comm.rank == 0:
        whole, merged = _joined([p for p in parts if p is not None], *names)
    of_cells, of_facets = comm.bcast(merged)
    element = bodies[0].ufl_domain().ufl_coordinate_element()
    domain, cells, facets = distributed(comm, whole, element)
    return named_mesh(domain, NamedTags(cells, of_cells), NamedTags(facets, of_facets))


def _joined(
    parts: Sequence[WholeMesh],
    names_of_cells: Sequence[Mapping[str, int]],
    names_of_facets: Sequence[Mapping[str, int]],
) -> tuple[WholeMesh, tuple[dict[str, int], dict[str, int]]]:
    """Return the mesh of all parts, and its tags of cells and of facets by name."""
    nodes = np.cumsum([0, *(len(p.x) for p in parts)])
    cells = np.cumsum([0, *(len(p.cells) for p in parts)])
    cell_values, of_cells = _merged([p.cell_values for p in parts], names_of_cells)
    facet_values, of_facets = _merged([p.facet_values for p in parts], names_of_facets)
    whole = WholeMesh(
        np.concatenate([p.cells + a for p, a in zip(parts, nodes, strict=False)]),
        np.concatenate([p.x for p in parts]),
        np.concatenate([p.tagged_cells + a for p, a in zip(parts, cells, strict=False)]),
        cell_values,
        np.concatenate([p.facets + a for p, a in zip(parts, nodes, strict=False)]),
        facet_values,
    )
    return whole, (of_cells, of_facets)


def _merged(
    values: Sequence[Indices], names: Sequence[Mapping[str, int]]
) -> tuple[Indices, dict[str, int]]:
    """Return the tags of the entities of all parts, and the tags by name.

    Args:
        values: tags of the entities of every part.
        names: tags by name of every part.
    """
    unnamed = [np.setdiff1d(v, list(own.values())) for v, own in zip(values, names, strict=True)]
    taken = set(np.concatenate(unnamed).tolist())
    tags: dict[str, int] = {}
    merged = []
    for old, own in zip(values, names, strict=True):
        new = old.copy()
        for name, tag in own.items():
            if name not in tags:
                tags[name] = max(taken) + 1 if tag in taken else tag
                taken.add(tags[name])
            new[old == tag] = tags[name]
        merged.append(new)
    return np.concatenate(merged), tags
