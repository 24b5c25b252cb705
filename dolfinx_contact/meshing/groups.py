# SPDX-License-Identifier: LGPL-3.0-or-later
"""Named groups of facets on a mesh of DOLFINx."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from dolfinx_contact._arrays import Array, Indices, Mask
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
    """Return a mesh with named groups of facets, as if it came from gmsh. Collective.

    Args:
        domain: mesh.
        facets: groups by name: local indices of facets, or a function of the coordinates (3, n)
            returning a mask of points, as for ``mesh.locate_entities_boundary``, which selects
            facets of the boundary.
        cells: name of the group of all cells.

    Returns:
        The same mesh. The groups of facets have the tags 1, 2, and so on, the cells the tag 1.

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
    topology = domain.topology
    dim = topology.dim - 1
    topology.create_connectivity(dim, topology.dim)
    groups: dict[str, Indices] = {}
    with everywhere(domain.comm, "groups of facets"):
        for name, group in facets.items():
            found: Any = group
            if callable(group):
                found = mesh.locate_entities_boundary(domain, dim, group)
            groups[name] = np.unique(found).astype(np.int32)
    for name, group in groups.items():
        size = domain.comm.allreduce(len(group))
        require(domain.comm, size > 0, f"no facet belongs to the group {name!r}")
    indices = np.concatenate([np.empty(0, dtype=np.int32), *groups.values()])
    tags = np.arange(1, len(groups) + 1, dtype=np.int32)
    values = np.repeat(tags, [len(group) for group in groups.values()])
    order = np.argsort(indices, kind="stable")
    indices, values = indices[order], values[order]
    twice = np.flatnonzero(np.diff(indices) == 0)[:1]
    names = " and ".join(repr(list(groups)[values[i] - 1]) for i in (*twice, *(twice + 1)))
    require(domain.comm, not names, f"a facet belongs to the groups {names}, and can have one tag")
    of_facets = dict(zip(groups, tags.tolist(), strict=True))
    index_map = topology.index_map(topology.dim)
    every = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    cell_tags = mesh.meshtags(domain, topology.dim, every, np.ones_like(every))
    facet_tags = mesh.meshtags(domain, dim, indices, values)
    return GmshMesh(
        domain,
        NamedTags(cell_tags, {cells: 1}),
        NamedTags(facet_tags, of_facets),
        {cells: (topology.dim, 1)} | {name: (dim, tag) for name, tag in of_facets.items()},
    )
