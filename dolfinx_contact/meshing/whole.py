# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whole meshes, on rank 0, as meshes are when they are read: to be changed and distributed anew.

Cells and nodes are in the order of the input, so that what comes out is the same on any number of
ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import mesh

from dolfinx_contact._compat import (
    create_mesh,
    geometry_dofmap,
    is_topology_of,
    tags_of_entities,
)
from dolfinx_contact._mpi import Arguments, collective, keep, require
from dolfinx_contact._validate import listed
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags

__all__ = ["WholeMesh", "check_tags", "distributed", "gathered", "join"]

Nodes = npt.NDArray[np.int64]
Tags = npt.NDArray[np.int32]


@dataclass(frozen=True)
class WholeMesh:
    """A mesh and its tags.

    Attributes:
        cells: nodes of every cell (cells, k), in the order of DOLFINx.
        x: coordinates (nodes, dim).
        tagged_cells: numbers of cells with a tag.
        cell_values: their tags.
        facets: nodes of facets with a tag (facets, k).
        facet_values: their tags.
    """

    cells: Nodes
    x: npt.NDArray[np.float64]
    tagged_cells: Nodes
    cell_values: Tags
    facets: Nodes
    facet_values: Tags


def gathered(
    domain: mesh.Mesh, cell_tags: mesh.MeshTags | None, facet_tags: mesh.MeshTags | None
) -> WholeMesh | None:
    """A mesh on rank 0, None elsewhere. Collective.

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
    parts = comm.gather(
        (
            index,
            nodes[geometry_dofmap(domain)[:n]],
            nodes[:owned],
            domain.geometry.x[:owned, : domain.geometry.dim],
            index[cells],
            values,
            corners,
            facet_values,
        )
    )
    if parts is None:
        return None
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(columns[0])
    places = np.argsort(columns[2])
    known = columns[2][places]
    return WholeMesh(
        np.searchsorted(known, columns[1][order]),
        columns[3][places],
        np.searchsorted(columns[0][order], columns[4]),
        columns[5],
        np.searchsorted(known, columns[6]),
        columns[7],
    )


def check_tags(domain: mesh.Mesh, tags: Any, dim: int, what: str) -> None:
    """Raise ``ValueError`` if these are no MeshTags of entities of this mesh. Not collective.

    Args:
        domain: the mesh.
        tags: should be of it.
        dim: of the entities.
        what: they are, for the message.
    """
    if not isinstance(tags, mesh.MeshTags | NamedTags):
        raise ValueError(f"{what} must be MeshTags, got {tags!r}")
    if tags.dim != dim:
        names = {domain.topology.dim: "cells", domain.topology.dim - 1: "facets"}
        found = names.get(tags.dim, f"entities of dimension {tags.dim}")
        raise ValueError(f"{what} must be those of {names[dim]}, and are those of {found}")
    if not is_topology_of(domain, tags):
        raise ValueError(f"{what} are those of another mesh")


def _tagged(tags: mesh.MeshTags | None, owned: int) -> tuple[npt.NDArray[np.int32], Tags]:
    """Owned entities with a tag, and their tags."""
    if tags is None:
        return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
    mine = tags.indices < owned
    return tags.indices[mine], tags.values[mine].astype(np.int32)


def distributed(
    comm: MPI.Comm, whole: WholeMesh | None, element: Any
) -> tuple[mesh.Mesh, mesh.MeshTags, mesh.MeshTags]:
    """The mesh of what rank 0 has, with tags of cells and facets. Collective.

    Args:
        comm: communicator.
        whole: on rank 0.
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
        a.cell_tags = a.cell_tags or [m.cell_tags for m in bodies]
        a.facet_tags = a.facet_tags or [m.facet_tags for m in bodies]
        bodies = [m.mesh for m in bodies]
    if not bodies or not all(isinstance(m, mesh.Mesh) for m in bodies):
        raise ValueError(f"a list of meshes is needed, all of one kind, got {given!r}")
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


@collective("joining meshes", _check)
def join(
    meshes: Sequence[mesh.Mesh] | Sequence[GmshMesh],
    *,
    cell_tags: Sequence[mesh.MeshTags] | None = None,
    facet_tags: Sequence[mesh.MeshTags] | None = None,
) -> GmshMesh:
    """One mesh of several bodies, which share no nodes. Collective.

    Args:
        meshes: of one kind of cells and one dimension, each on all ranks; or such with physical
            groups, of which the tags count and the names are lost.
        cell_tags: of every mesh; by default the cells of the first body get 1, of the second 2, and
            so on.
        facet_tags: of every mesh, by default none.

    Returns:
        Mesh, cell tags and facet tags; no group has a name.

    Raises:
        ValueError: on every rank, if the meshes differ in their kind or dimension, or are curved,
            or tags are none, of another mesh, or of other entities.
    """
    bodies: Sequence[Any] = meshes
    for body in bodies:
        keep(body)
    comm = bodies[0].comm
    none = [None] * len(bodies)
    parts = [
        gathered(m, c, f)
        for m, c, f in zip(bodies, cell_tags or none, facet_tags or none, strict=True)
    ]
    whole = None
    if comm.rank == 0:
        wholes = [p for p in parts if p is not None]
        if cell_tags is None:
            wholes = [
                replace(
                    p,
                    tagged_cells=np.arange(len(p.cells)),
                    cell_values=np.full(len(p.cells), i + 1, dtype=np.int32),
                )
                for i, p in enumerate(wholes)
            ]
        whole = _joined(wholes)
    element = bodies[0].ufl_domain().ufl_coordinate_element()
    domain, cells, facets = distributed(comm, whole, element)
    return GmshMesh(domain, cells, NamedTags(facets, {}), {})


def _joined(parts: Sequence[WholeMesh]) -> WholeMesh:
    nodes = np.cumsum([0, *(len(p.x) for p in parts)])
    cells = np.cumsum([0, *(len(p.cells) for p in parts)])
    return WholeMesh(
        np.concatenate([p.cells + a for p, a in zip(parts, nodes, strict=False)]),
        np.concatenate([p.x for p in parts]),
        np.concatenate([p.tagged_cells + a for p, a in zip(parts, cells, strict=False)]),
        np.concatenate([p.cell_values for p in parts]),
        np.concatenate([p.facets + a for p, a in zip(parts, nodes, strict=False)]),
        np.concatenate([p.facet_values for p in parts]),
    )
