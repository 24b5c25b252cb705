# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cracks: nodes are duplicated along facets inside a body, whose sides may then separate.

The cells around a node of the crack are connected through facets that do not belong to the crack.
Each fan of connected cells gets its own copy of the node. There are two copies of a node along a
crack and where it reaches the surface, one copy at the front of the crack and at its ends inside
the body, and three copies where an arm meets another crack.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

import basix
from dolfinx import mesh

from dolfinx_contact._arrays import Ints, Mask
from dolfinx_contact._geometry import area_vectors, by_coordinates, connected_parts
from dolfinx_contact._mpi import Arguments, collective, everywhere
from dolfinx_contact._validate import listed
from dolfinx_contact.meshing.gmsh import GmshMesh
from dolfinx_contact.meshing.whole import WholeMesh, distributed, gathered, tagged

__all__ = ["crack"]

logger = logging.getLogger(__name__)


def _check(a: Arguments) -> None:
    untagged = isinstance(a.body, mesh.Mesh) and a.facet_tags is None
    a.body = tagged(a.body, a.facet_tags, "the mesh of a crack")
    a.groups = listed(a.groups, "groups")
    kinds = str | int | np.integer
    if not a.groups or not all(isinstance(g, kinds) and g is not True for g in a.groups):
        raise ValueError(f"a crack needs names or tags of groups, got {a.groups!r}")
    if untagged:
        raise ValueError("a crack needs MeshTags of facets")
    known = a.body.facet_tags.names
    for g in a.groups:
        if isinstance(g, str) and g not in known:
            raise ValueError(f"no group of facets is named {g!r}; names: {sorted(known)}")
    taken = sorted(known.keys() & {f"{g}_opposite" for g in a.groups})
    if taken:
        raise ValueError(f"the crack names its sides {', '.join(taken)}: rename these groups")


@collective("a crack", _check)
def crack(
    body: GmshMesh | mesh.Mesh,
    groups: Iterable[int | str],
    *,
    facet_tags: mesh.MeshTags | None = None,
) -> GmshMesh:
    """Return a mesh in which facets inside the body have two separate sides. Collective.

    The facets of a group keep their tag on one side and get a new tag on the other side. The new
    group is named after the first: ``"fault_opposite"`` after ``"fault"``, ``"5_opposite"`` after
    5. An interface inside a body thus becomes a contact pair with matching meshes::

        body = crack(body, ["fault"])
        fault = ContactPair(u, body, slave="fault", master="fault_opposite", law=Coulomb(0.4))

    The first side has the smaller cell tag if the cell tags differ; otherwise its outward normal
    points towards larger coordinates. The decision is made at the first facet of each connected
    part of the crack, in the order of coordinates (x, then y, then z). Where the crack ends inside
    the body, both sides keep their common nodes. The mesh is rebuilt on rank 0, as when it is read.

    Args:
        body: mesh, or mesh with physical groups.
        groups: names or tags of groups of facets. Each arm of crossing or branching cracks needs
            its own group and its own pair (`ContactPair` describes contact where they meet). If a
            crack ends on another crack, it divides one side of that crack, which must be the slave
            of its pair.
        facet_tags: facet tags of a mesh without groups.

    Returns:
        New mesh with all tags and names.

    Raises:
        ValueError: on every rank, if a group does not exist, a new name is the name of another
            group, a facet lies on the boundary, a group crosses itself or branches, no node of a
            group can be duplicated, the cells are curved, or tags are missing or belong to another
            mesh or to other entities.
    """
    given: Any = body
    domain = given.mesh
    whole = gathered(given)
    with everywhere(domain.comm, "a crack"):
        cracked = None if whole is None else _split(whole, domain.basix_cell(), groups)
    return distributed(domain.comm, cracked, domain.ufl_domain().ufl_coordinate_element())


class _Around:
    """Cells around the nodes of the crack, with the nodes and facets of the cells.

    Attributes:
        near: indices of these cells in the whole mesh.
        cells: nodes of these cells, shape (cells, nodes per cell); `split` replaces duplicated
            nodes.
        corners: local indices of the nodes of each facet of a cell.
        ids: indices of the facets of these cells, shape (cells, facets per cell).
        tagged: index of each tagged facet as in ``ids``; -1 if it belongs to none of these cells.
    """

    def __init__(self, whole: WholeMesh, cell: basix.CellType, marked: Mask):
        self.near = np.flatnonzero(marked[whole.cells].any(axis=1))
        self.cells = whole.cells[self.near].copy()
        self.corners = np.array(basix.topology(cell)[-2])
        every = np.sort(self.cells[:, self.corners], axis=2)
        keys = np.concatenate([every.reshape(-1, every.shape[2]), np.sort(whole.facets, axis=1)])
        ids = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
        self.ids = ids[: every.shape[0] * every.shape[1]].reshape(every.shape[:2])
        self.tagged = np.where(np.isin(ids[self.ids.size :], self.ids), ids[self.ids.size :], -1)

    def nodes(self, cells: Ints, places: Ints) -> Ints:
        """Return the nodes of facets, given by rows of cells and local facet indices."""
        return self.cells[cells[:, None], self.corners[places]]

    def split(self, crack: Ints, marked: Mask) -> tuple[Ints, Mask]:
        """Duplicate the nodes of the crack, so that every fan of connected cells has its own copy.

        Args:
            crack: indices of the facets of the crack, through which cells are not connected.
            marked: mask of the nodes of the crack.

        Returns:
            For each new node, the node of which it is a copy; and a mask of all nodes, old and new,
            that share their position with another node.
        """
        n, k = self.cells.shape
        # a corner of a cell is connected to a node of a facet, and thus to the corner beyond it
        at = np.broadcast_to(np.arange(n)[:, None, None], (*self.ids.shape, self.corners.shape[1]))
        places = np.broadcast_to(self.corners, at.shape)
        used = ~np.isin(self.ids, crack)[:, :, None] & marked[self.cells][at, places]
        corner = (at * k + places)[used]
        facet = np.broadcast_to(self.ids[:, :, None], at.shape)[used]
        pairs = np.stack([self.cells.reshape(-1)[corner], facet])
        link = np.unique(pairs, axis=1, return_inverse=True)[1].reshape(-1)
        fans = connected_parts(n * k + int(link.max(initial=-1)) + 1, corner, n * k + link)[: n * k]
        mine = np.flatnonzero(marked[self.cells].reshape(-1))
        # the fan with the first cell keeps the node
        _, firsts, fan = np.unique(fans[mine], return_index=True, return_inverse=True)
        node = self.cells.reshape(-1)[mine[firsts]]
        order = np.lexsort((mine[firsts], node))
        copies = order[1:][np.diff(node[order]) == 0]
        number = node.copy()
        number[copies] = len(marked) + np.arange(len(copies))
        self.cells.reshape(-1)[mine] = number[fan.reshape(-1)]
        several = np.zeros(len(marked) + len(copies), dtype=bool)
        several[node[copies]] = several[number[copies]] = True
        return node[copies], several


def _split(whole: WholeMesh, cell: basix.CellType, groups: Iterable[int | str]) -> WholeMesh:
    """Return the mesh with separated crack sides, and a new group for the other side of each."""
    values = whole.facet_values
    known = whole.facet_names
    named = {g: known[g] if isinstance(g, str) else int(g) for g in groups}
    tags = list(dict.fromkeys(named.values()))
    for tag in tags:
        if tag not in values:
            raise ValueError(
                f"no facet has the tag {tag}; tags of the mesh: {np.unique(values).tolist()}"
            )
    chosen = np.isin(values, tags)
    marked = np.zeros(len(whole.x), dtype=bool)
    marked[whole.facets[chosen]] = True
    around = _Around(whole, cell, marked)
    crack = around.tagged[chosen]
    alone = np.bincount(around.ids.reshape(-1), minlength=int(crack.max()) + 1)[crack] != 2
    if alone.any():
        raise ValueError(
            f"{int(alone.sum())} facets of the crack lie on the boundary; it needs facets inside "
            "the body"
        )
    copied, several = around.split(crack, marked)
    opens = np.any(several[whole.facets], axis=1)
    _check_groups(whole, tags, opens)
    cells = whole.cells.copy()
    cells[around.near] = around.cells
    # tagged facets that do not belong to the crack follow any of their cells
    numbers, one = np.unique(around.ids, return_index=True)
    facets = whole.facets.copy()
    moved = np.flatnonzero(~chosen & (around.tagged >= 0))
    item = one[np.searchsorted(numbers, around.tagged[moved])]
    facets[moved] = around.nodes(*np.divmod(item, around.ids.shape[1]))
    rows, given = [facets[~chosen]], [values[~chosen]]
    others = {tag: int(values.max()) + 1 + i for i, tag in enumerate(tags)}
    for tag, other in others.items():
        nodes, is_first = _sides(
            whole, around, several, around.tagged[(values == tag) & opens], tag
        )
        rows.append(nodes)
        given.append(np.where(is_first, tag, other).astype(np.int32))
    return replace(
        whole,
        cells=cells,
        x=np.concatenate([whole.x, whole.x[copied]]),
        facets=np.concatenate(rows),
        facet_values=np.concatenate(given),
        facet_names=known | {f"{g}_opposite": others[tag] for g, tag in named.items()},
    )


def _check_groups(whole: WholeMesh, tags: list[int], opens: Mask) -> None:
    """Raise ``ValueError`` if a crack branches or cannot open; warn if single facets cannot.

    ``opens`` is a mask of the tagged facets that have a duplicated node.
    """
    rims = {2: [[0], [1]], 3: [[0, 1], [1, 2], [2, 0]], 4: [[0, 1], [1, 3], [3, 2], [2, 0]]}
    rim = np.array(rims[whole.facets.shape[1]])
    for tag in tags:
        here = whole.facet_values == tag
        every = np.sort(whole.facets[here][:, rim].reshape(-1, rim.shape[1]))
        meeting = np.unique(every, axis=0, return_counts=True)[1]
        if (meeting > 2).any():
            raise ValueError(
                f"the crack with the tag {tag} crosses itself or branches: more than two of its "
                f"facets meet at {int((meeting > 2).sum())} places; tag each arm as a group of its "
                "own, and use a pair for each"
            )
        if not opens[here].any():
            raise ValueError(
                f"no node can be doubled along the {int(here.sum())} facets with the tag {tag}: at "
                "all of them the crack ends inside the body; refine the mesh"
            )
    closed = int((np.isin(whole.facet_values, tags) & ~opens).sum())
    if closed:
        logger.warning(
            "%d facets of the crack have all their nodes on its front and cannot open; they lose "
            "their tag",
            closed,
        )


def _sides(
    whole: WholeMesh, around: _Around, several: Mask, facets: Ints, tag: int
) -> tuple[Ints, Mask]:
    """Return the facets on both sides of a crack, and a mask of the facets on the first side.

    Each facet occurs twice, once per adjacent cell, as a row of node indices. ``several`` is a mask
    of the nodes sharing their position with another node.
    """
    cells, places = np.nonzero(np.isin(around.ids, facets))
    nodes = around.nodes(cells, places)
    number = np.unique(around.ids[cells, places], return_inverse=True)[1]
    m = len(cells)
    # items with a common duplicated node are on one side
    item, node = np.nonzero(several[nodes])
    patch = connected_parts(m + len(several), item, m + nodes[item, node])[:m]
    by_facet = np.argsort(number, kind="stable").reshape(-1, 2)
    a, b = patch[by_facet].T
    # every patch twice, as the first side and as the second
    count = int(patch.max()) + 1
    label = connected_parts(
        2 * count, np.concatenate([a, a + count]), np.concatenate([b + count, b])
    )
    if (label[patch] == label[patch + count]).any():
        raise ValueError(
            f"the facets with the tag {tag} have no two sides: a crack must not meet itself"
        )
    piece = connected_parts(count, a, b)[patch]
    # the first side at the first facet of every piece, in order of coordinates
    materials = np.full(len(whole.cells), np.iinfo(np.int32).min, dtype=np.int64)
    materials[whole.tagged_cells] = whole.cell_values
    of_items = materials[around.near[cells]]
    old = whole.cells[around.near[cells]]
    corners = whole.x[old[np.arange(m)[:, None], around.corners[places]]]
    middle = corners.mean(axis=1)
    is_first = np.zeros(m, dtype=bool)
    for p in np.unique(piece):
        here = by_facet[piece[by_facet[:, 0]] == p]
        at = middle[here[:, 0]]
        one, two = here[by_coordinates(at)[0]]
        outward = area_vectors(corners[[one]])[0]
        outward *= np.sign(outward @ (middle[one] - whole.x[old[one]].mean(axis=0)))
        leading = outward[np.flatnonzero(np.abs(outward) > 1e-9 * np.abs(outward).max())[0]]
        swap = leading <= 0 if of_items[one] == of_items[two] else of_items[one] > of_items[two]
        mine = np.flatnonzero(piece == p)
        is_first[mine] = label[patch[mine]] == label[patch[two if swap else one]]
    return nodes, is_first
