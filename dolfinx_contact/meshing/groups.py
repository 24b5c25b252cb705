# SPDX-License-Identifier: LGPL-3.0-or-later
"""Named groups of facets on a DOLFINx mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._mpi import Arguments, collective, everywhere, require
from dolfinx_contact._validate import instance, word
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags

__all__ = ["name_groups"]


def _check(a: Arguments) -> None:
    instance(a.domain, "domain", mesh.Mesh)
    instance(a.facets, "facets", dict, 'as {"top": lambda x: numpy.isclose(x[1], 1.0)}')
    for name in (*a.facets, a.cells):
        word(name, "the name of a group")


@collective(
    "groups of a mesh", _check, compare=lambda a: {"groups": list(a.facets)}, local=("facets",)
)
def name_groups(
    domain: mesh.Mesh,
    facets: Mapping[str, Callable[[Array], Mask] | npt.ArrayLike],
    *,
    cells: str = "body",
) -> GmshMesh:
    """Return a mesh with named groups of facets, like a mesh read from gmsh. Collective.

    Args:
        domain: mesh of the bodies.
        facets: groups by name: local indices of facets, or a function that maps coordinates, shape
            (3, n), to a mask of the n points and selects facets of the boundary, as in
            ``mesh.locate_entities_boundary``.
        cells: name of the group of all cells.

    Returns:
        `GmshMesh` with ``domain`` itself, not a copy. The groups of facets have the tags 1, 2, and
        so on, and all cells the tag 1.

    Raises:
        ValueError: on every rank, if a group is empty, a facet is in two groups, or names differ
            between ranks.

    Example:
        ::

            sides = {"contact": lambda x: np.isclose(x[1], 0), "top": lambda x: np.isclose(x[1], 1)}
            body = name_groups(mesh.create_unit_square(comm, 8, 8), sides)
            contact = ContactSurface(u, body, tag="contact", obstacle=floor, law=Coulomb(0.4))
            held = fem.dirichletbc(np.zeros(2), body.dofs(V, "top"), V)
    """
    tdim = domain.topology.dim
    index_map = domain.topology.index_map(tdim)
    every = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    cell_tags = mesh.meshtags(domain, tdim, every, np.ones_like(every))
    return GmshMesh(domain, NamedTags(cell_tags, {cells: 1}), _facet_tags(domain, facets))


def _facet_tags(
    domain: mesh.Mesh, facets: Mapping[str, Callable[[Array], Mask] | npt.ArrayLike]
) -> NamedTags:
    """Return MeshTags of named groups of facets, or raise ``ValueError``. Collective."""
    dim = domain.topology.dim - 1
    domain.topology.create_connectivity(dim, dim + 1)
    index_map = domain.topology.index_map(dim)
    number = index_map.size_local + index_map.num_ghosts
    tags: dict[str, int] = {}
    values = np.zeros(number, dtype=np.int32)  # 0 for facets in no group
    for tag, (name, group) in enumerate(facets.items(), 1):
        with everywhere(domain.comm, f"the facets of {name!r}"):
            found: Any = group
            if callable(group):
                found = mesh.locate_entities_boundary(domain, dim, group)
            indices = np.asarray(found)
            if indices.size and indices.dtype.kind not in "iu":
                raise ValueError(
                    f"the group {name!r} must be indices of facets, got values of type "
                    f"{indices.dtype}; numpy.flatnonzero converts a mask"
                )
            indices = indices.astype(np.int64)
            if not ((indices >= 0) & (indices < number)).all():
                raise ValueError(f"the group {name!r} has indices of facets outside the mesh")
            others = [other for other in tags if (values[indices] == tags[other]).any()]
            if others:
                raise ValueError(
                    f"the groups {others[0]!r} and {name!r} have a common facet, but a facet can "
                    "have only one tag"
                )
        size = domain.comm.allreduce(len(indices))
        require(domain.comm, size > 0, f"no facet belongs to the group {name!r}")
        values[indices] = tags[name] = tag
    chosen = np.flatnonzero(values).astype(np.int32)
    return NamedTags(mesh.meshtags(domain, dim, chosen, values[chosen]), tags)
