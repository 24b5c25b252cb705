# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compatibility layer for DOLFINx 0.9, 0.10 and 0.11.

Features are detected; version numbers are not compared. No other module may depend on the version
of DOLFINx. Code for a version is removed when it leaves the table in `docs/install.md`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import default_scalar_type, fem, graph, io, mesh

from dolfinx_contact._arrays import Array, Indices, Ints

try:  # DOLFINx >= 0.10
    from dolfinx.io import gmsh as gmsh_io
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as gmsh_io

__all__ = [
    "FacetSubmesh",
    "create_facet_submesh",
    "create_mesh",
    "dirichlet_value",
    "facet_integration_entities",
    "geometry_dofmap",
    "gmsh_io",
    "instantiated",
    "interpolation_points",
    "is_mesh_of",
    "is_topology_of",
    "is_value_of",
    "merge_entity_maps",
    "tags_of_entities",
]

# Debian's ADIOS2 takes its serial Python bindings in a process without mpirun, once and for all at
# its first import; checkpoints need the others.
os.environ.setdefault("ADIOS2_ALWAYS_USE_MPI", "1")

_HAS_ENTITY_MAP = hasattr(mesh, "EntityMap")  # 0.10


@dataclass(frozen=True)
class FacetSubmesh:
    """Mesh of facets, with the maps between its entities and those of the parent mesh."""

    mesh: mesh.Mesh
    parent_facets: Indices  # parent facet of each submesh cell, ghosts included
    entity_map: Any


def create_facet_submesh(domain: mesh.Mesh, facets: Indices) -> FacetSubmesh:
    """Create the codimension-one submesh of ``facets`` (local indices, ghosts included)."""
    fdim = domain.topology.dim - 1
    submesh, cell_map, _, _ = mesh.create_submesh(domain, fdim, facets)
    if _HAS_ENTITY_MAP:
        cells = submesh.topology.index_map(fdim)
        local = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        parents = cell_map.sub_topology_to_topology(local, inverse=False)
        return FacetSubmesh(submesh, np.asarray(parents, dtype=np.int32), cell_map)
    parents = np.asarray(cell_map, dtype=np.int32)
    index_map = domain.topology.index_map(fdim)
    to_submesh = np.full(index_map.size_local + index_map.num_ghosts, -1, dtype=np.int32)
    to_submesh[parents] = np.arange(len(parents), dtype=np.int32)
    return FacetSubmesh(submesh, parents, to_submesh)


def create_mesh(comm: MPI.Comm, cells: Ints, x: Array, element: Any) -> mesh.Mesh:
    """Create a mesh with a ghost layer from the cells and nodes on each rank. Collective."""
    mode = mesh.GhostMode.shared_facet
    try:  # since 0.11 with the number of cells that a facet may have
        partitioner = mesh.create_cell_partitioner(mode, 2)
    except TypeError:
        partitioner = mesh.create_cell_partitioner(mode)
    return mesh.create_mesh(comm, cells=cells, x=x, e=element, partitioner=partitioner)


def tags_of_entities(
    domain: mesh.Mesh,
    dim: int,
    entities: Ints,
    values: Indices,
) -> mesh.MeshTags:
    """Create MeshTags of entities given on any rank by their input node numbers. Collective."""
    domain.topology.create_entities(dim)
    vertices, tags = io.distribute_entity_data(domain, dim, entities, values)
    domain.topology.create_connectivity(dim, 0)
    domain.topology.create_connectivity(dim, domain.topology.dim)
    lists = graph.adjacencylist(np.asarray(vertices, dtype=np.int32))
    return mesh.meshtags_from_entities(domain, dim, lists, np.asarray(tags, dtype=np.int32))


def merge_entity_maps(submeshes: Sequence[FacetSubmesh]) -> Any:
    """Return the argument ``entity_maps`` of ``fem.form`` for forms on the given submeshes."""
    if _HAS_ENTITY_MAP:
        return [s.entity_map for s in submeshes]
    return {s.mesh: s.entity_map for s in submeshes}


def facet_integration_entities(domain: mesh.Mesh, facets: Indices) -> Indices:
    """Return a flat array of (cell, local facet) of owned exterior facets for UFL measures."""
    args: tuple[Any, ...] = (fem.IntegralType.exterior_facet, domain.topology, facets)
    if not _HAS_ENTITY_MAP:
        args += (domain.topology.dim - 1,)
    return np.asarray(fem.compute_integration_domains(*args), dtype=np.int32).reshape(-1)


def instantiated(
    ufcx: Any,
    module: Any,
    spaces: Sequence[fem.FunctionSpace],
    functions: Sequence[fem.Function],
    constants: Sequence[fem.Constant],
    original: ufl.Form,
    entity_maps: Any,
) -> fem.Form | None:
    """Return a DOLFINx form that uses compiled code, as ``fem.form`` creates it.

    Functions, Constants and mesh may differ from those for which the code was compiled.

    Args:
        ufcx: compiled form of FFCx.
        module: Python module of the compiled form, as returned by the JIT compiler.
        spaces: function spaces of the arguments.
        functions: Functions in the order of ``ufcx``.
        constants: Constants in the order of ``ufcx``.
        original: UFL form with the same integrals as the compiled form; its mesh is used.
        entity_maps: entity maps (`merge_entity_maps`), or None.

    Returns:
        DOLFINx form; None for DOLFINx 0.10 and later, whose constructor differs.
    """
    if _HAS_ENTITY_MAP:
        return None
    ((domain, data),) = original.subdomain_data().items()
    numbers: dict[str, list[int]] = {kind: [] for kind in data}
    for integral in original.integrals():
        number = integral.subdomain_id()
        if integral.subdomain_data() is not None:
            each = number if isinstance(number, tuple) else (number,)
            numbers[integral.integral_type()] += [n for n in each if n != "everywhere"]
    kinds = {kind: getattr(fem.IntegralType, kind) for kind in data}
    subdomains = {
        kinds[kind]: fem.forms.get_integration_domains(kinds[kind], tags[0], sorted(numbers[kind]))
        for kind, tags in data.items()
    }
    maps = {m._cpp_object: entities for m, entities in (entity_maps or {}).items()}
    made = fem.form_cpp_class(default_scalar_type)(
        module.ffi.cast("uintptr_t", module.ffi.addressof(ufcx)),
        [V._cpp_object for V in spaces],
        [f._cpp_object for f in functions],
        [c._cpp_object for c in constants],
        subdomains,
        maps,
        domain.ufl_cargo(),
    )
    return fem.Form(made, ufcx, module=module)


def interpolation_points(V: fem.FunctionSpace) -> Array:
    """Return the reference interpolation points (a method in 0.9, a property since 0.10)."""
    points = V.element.interpolation_points
    return points() if callable(points) else points


def is_topology_of(domain: mesh.Mesh, tags: mesh.MeshTags) -> bool:
    """Return whether MeshTags refer to the topology of the given mesh object."""
    mine = domain.topology
    theirs = tags.topology
    return getattr(mine, "_cpp_object", mine) is getattr(theirs, "_cpp_object", theirs)


def is_mesh_of(domain: mesh.Mesh, space: Any) -> bool:
    """Return whether a function space, in Python or C++, is defined on the given mesh object."""
    theirs = space.mesh
    return domain._cpp_object is getattr(theirs, "_cpp_object", theirs)


def dirichlet_value(bc: fem.DirichletBC) -> Any:
    """Return the C++ Constant or Function that holds the values of a Dirichlet condition."""
    value = bc.g
    return getattr(value, "_cpp_object", value)


def is_value_of(f: fem.Function | fem.Constant, bc: fem.DirichletBC) -> bool:
    """Return whether a Dirichlet condition uses the values of this Function or Constant object."""
    return f._cpp_object is dirichlet_value(bc)


def geometry_dofmap(domain: mesh.Mesh) -> Indices:
    """Return the geometry dofmap of the local cells (called ``dofmaps`` in DOLFINx 0.11)."""
    geometry = domain.geometry
    several = getattr(geometry, "dofmaps", None)
    if several is None:
        return np.asarray(geometry.dofmap)
    return np.asarray(several(0) if callable(several) else several[0])
