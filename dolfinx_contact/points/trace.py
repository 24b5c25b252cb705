# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a body's boundary and the dofs that live on them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la, mesh

from dolfinx_contact._compat import is_topology_of
from dolfinx_contact._errors import everywhere, require

__all__ = ["exterior_facets", "facet_closures", "owned_exterior", "trace_dofs"]


def owned_exterior(domain: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Those of the local ``facets`` that this rank owns and that lie on the boundary."""
    exterior = mesh.exterior_facet_indices(domain.topology)
    return np.intersect1d(facets, exterior).astype(np.int32)


def exterior_facets(
    domain: mesh.Mesh, facets: mesh.MeshTags | npt.NDArray[np.int32], tag: int | None, name: str
) -> npt.NDArray[np.int32]:
    """Facets of a surface on this rank, ghosts included, whichever rank the user named them on.

    Every rank gives facets of the same kind, MeshTags or indices. Indices do not tell which mesh
    they number: those of another one are taken for facets of this one.

    Raises:
        ValueError: on every rank, if there is no such facet, one lies inside the body, or the
            MeshTags are those of another mesh.
    """
    fdim, comm = domain.topology.dim - 1, domain.comm
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
    per_cell = to_facets.offsets[1] - to_facets.offsets[0] if len(to_facets.offsets) > 1 else 0
    closures = np.array([layout.entity_closure_dofs(tdim - 1, i) for i in range(per_cell)])
    if len(facets) == 0:
        return np.zeros((0, closures.shape[1] if per_cell else 0), dtype=np.int32)
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
    X, Y = V.tabulate_dof_coordinates(), Q.tabulate_dof_coordinates()
    distance = np.linalg.norm(X[candidates][:, None, :, :] - Y[wanted][:, :, None, :], axis=3)
    if len(parent_facets):
        nodes[wanted] = np.take_along_axis(candidates, np.argmin(distance, axis=2), axis=1)
    return nodes
