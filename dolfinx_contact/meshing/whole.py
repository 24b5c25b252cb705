# SPDX-License-Identifier: LGPL-3.0-or-later
"""A whole mesh on rank 0, to be edited there and then distributed.

Cells and nodes are in the order of the input, so that the edited mesh is the same on any number of
ranks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

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
from dolfinx_contact._validate import instance, listed
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags, named_mesh

__all__ = ["TaggedMesh", "WholeMesh", "distributed", "gathered", "join", "tagged"]


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


class TaggedMesh(NamedTuple):
    """DOLFINx mesh with MeshTags of its cells and facets.

    Attributes:
        mesh: mesh.
        cell_tags: tags of cells; None if there are none.
        facet_tags: tags of facets; None if there are none.
    """

    mesh: mesh.Mesh
    cell_tags: mesh.MeshTags | None
    facet_tags: mesh.MeshTags | None

    @property
    def names(self) -> list[dict[str, int]]:
        """Tags of the named groups: a dictionary for cells and one for facets, by name."""
        return [dict(getattr(tags, "names", {})) for tags in (self.cell_tags, self.facet_tags)]


def tagged(body: Any, cell_tags: Any, facet_tags: Any, what: str) -> TaggedMesh:
    """Return a mesh with its tags of cells and facets. Not collective.

    Args:
        body: mesh, or mesh with groups.
        cell_tags: tags of cells; None to use the groups of the mesh, if it has any.
        facet_tags: tags of facets; None to use the groups of the mesh, if it has any.
        what: name of the mesh in messages.

    Raises:
        ValueError: if tags are not MeshTags of the cells or facets of this mesh.
    """
    if isinstance(body, GmshMesh):
        cell_tags = cell_tags or body._named_cells
        facet_tags = facet_tags or body._named_facets
        body = body.mesh
    if not isinstance(body, mesh.Mesh):
        raise ValueError(f"{what} must be a mesh, with or without groups, got {body!r}")
    tdim = body.topology.dim
    for kind, dim, tags in (("cells", tdim, cell_tags), ("facets", tdim - 1, facet_tags)):
        fits = isinstance(tags, mesh.MeshTags) and tags.dim == dim
        if not (tags is None or (fits and is_topology_of(body, tags))):
            raise ValueError(
                f"tags of {kind} of {what} must be MeshTags of the {kind} of this mesh, got "
                f"{tags!r}{f' of dimension {tags.dim}' if hasattr(tags, 'dim') else ''}"
            )
    return TaggedMesh(body, cell_tags, facet_tags)


def gathered(body: TaggedMesh, tag: int | None = None) -> WholeMesh | None:
    """Gather a mesh with its groups on rank 0; return None on other ranks. Collective.

    Args:
        body: mesh and its tags.
        tag: tag assigned to all cells if the mesh has no cell tags; default: none.

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
    cells, values = _tagged(cell_tags, n)
    if cell_tags is None and tag is not None:
        cells, values = np.arange(n, dtype=np.int32), np.full(n, tag, dtype=np.int32)
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
    index, all_cells, numbers, all_x, with_tag, values, corners, facet_values = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    order, places = np.argsort(index), np.argsort(numbers)
    cell_names, facet_names = body.names
    return WholeMesh(
        np.searchsorted(numbers[places], all_cells[order]),
        all_x[places],
        np.searchsorted(index[order], with_tag),
        values,
        cell_names,
        np.searchsorted(numbers[places], corners),
        facet_values,
        facet_names,
    )


def _tagged(tags: mesh.MeshTags | None, owned: int) -> tuple[Indices, Indices]:
    """Return the indices of the owned entities that have a tag, and their tags."""
    if tags is None:
        return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
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
    return named_mesh(
        domain, NamedTags(cells, whole.cell_names), NamedTags(facets, whole.facet_names)
    )


def _check(a: Arguments) -> None:
    bodies = listed(a.meshes, "meshes")
    if not bodies:
        raise ValueError("a list of meshes is needed, got an empty one")
    given: dict[str, list[Any]] = {}
    for what in ("cell_tags", "facet_tags", "prefixes"):
        default: list[Any] = [""] if what == "prefixes" else [None]
        values = getattr(a, what)
        given[what] = default * len(bodies) if values is None else listed(values, what)
        if len(given[what]) != len(bodies):
            raise ValueError(f"{len(bodies)} meshes need as many {what}, got {values}")
    tags = zip(bodies, given["cell_tags"], given["facet_tags"], strict=True)
    a.meshes = [tagged(*parts, f"mesh {i}") for i, parts in enumerate(tags, 1)]
    a.prefixes = [instance(p, "a prefix", str) for p in given["prefixes"]]
    kinds = {(m.mesh.basix_cell(), m.mesh.geometry.dim) for m in a.meshes}
    if len(kinds) > 1:
        raise ValueError(f"meshes of different kinds cannot be joined: {sorted(map(str, kinds))}")


@collective("joining meshes", _check)
def join(
    meshes: Sequence[mesh.Mesh] | Sequence[GmshMesh],
    *,
    prefixes: Sequence[str] | None = None,
    cell_tags: Sequence[mesh.MeshTags] | None = None,
    facet_tags: Sequence[mesh.MeshTags] | None = None,
) -> GmshMesh:
    """Return one mesh of several bodies, which do not share nodes. Collective.

    Names of groups are kept. A group keeps its tag unless a group of another name already has this
    tag; then it gets a new tag. Groups of the same name in several meshes are merged::

        upper = name_groups(square, {"top": top, "sole": bottom}, cells="upper")
        lower = read_mesh(comm, "lower.msh")  # groups lower, seat and base
        body = join([upper, lower])
        pair = ContactPair(u, body, slave="sole", master="seat", law=Coulomb(0.4))

    Args:
        meshes: meshes with the same dimension and kind of cells, each on all ranks.
        prefixes: one prefix per mesh for the names of its groups, such as ``("upper_", "lower_")``.
            With different prefixes, groups of the same name are not merged. Default: none.
        cell_tags: cell tags of every mesh; default: tags of its groups of cells, or, for meshes
            without groups, 1 for the first body, 2 for the second, and so on.
        facet_tags: facet tags of every mesh; default: tags of its groups of facets.

    Raises:
        ValueError: on every rank, if the meshes differ in dimension or kind of cells, cells are
            curved, tags or prefixes are missing, or tags belong to another mesh or to other
            entities.
    """
    bodies: Sequence[Any] = meshes
    comm = bodies[0].mesh.comm
    parts = [gathered(body, tag=i) for i, body in enumerate(bodies, 1)]
    with everywhere(comm, "joining meshes"):
        whole = _joined([p for p in parts if p is not None], prefixes or ())
    element = bodies[0].mesh.ufl_domain().ufl_coordinate_element()
    return distributed(comm, whole, element)


def _joined(parts: Sequence[WholeMesh], prefixes: Sequence[str]) -> WholeMesh | None:
    """Return the union of several meshes; None if there are no meshes on this rank.

    Args:
        parts: meshes to be joined.
        prefixes: for each mesh, the prefix of the names of its groups.
    """
    if not parts:
        return None
    nodes = np.cumsum([0, *(len(p.x) for p in parts)])
    cells = np.cumsum([0, *(len(p.cells) for p in parts)])
    shifted = [
        (p.cells + node, p.x, p.tagged_cells + cell, p.facets + node)
        for p, node, cell in zip(parts, nodes, cells, strict=False)
    ]
    all_cells, x, tagged_cells, facets = (
        np.concatenate(column) for column in zip(*shifted, strict=True)
    )
    of_cells = _merged([(p.cell_values, p.cell_names) for p in parts], prefixes)
    of_facets = _merged([(p.facet_values, p.facet_names) for p in parts], prefixes)
    return WholeMesh(all_cells, x, tagged_cells, *of_cells, facets, *of_facets)


def _merged(
    parts: Sequence[tuple[Indices, Mapping[str, int]]], prefixes: Sequence[str]
) -> tuple[Indices, dict[str, int]]:
    """Return the tags of the entities of all meshes together, and the tag of each group by name.

    Args:
        parts: for each mesh, the tags of its entities and the tag of each group by name.
        prefixes: for each mesh, the prefix of the names of its groups.
    """
    unnamed = [np.setdiff1d(values, list(names.values())) for values, names in parts]
    taken = set(np.concatenate(unnamed).tolist())
    tags: dict[str, int] = {}
    merged = []
    for (old, names), prefix in zip(parts, prefixes, strict=True):
        new = old.copy()
        for name, tag in names.items():
            full = prefix + name
            if full not in tags:
                tags[full] = max(taken) + 1 if tag in taken else tag
                taken.add(tags[full])
            new[old == tag] = tags[full]
        merged.append(new)
    return np.concatenate(merged), tags
