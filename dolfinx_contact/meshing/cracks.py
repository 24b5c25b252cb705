# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cracks: nodes are doubled along facets inside a body, whose sides may then come apart.

Around a node of the crack cells hang together through facets that are not of the crack. Each of
these fans gets a node of its own: two inside a crack, one at its front and its ends inside the
body, two where it comes to the surface, three where an arm meets another crack.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import basix
from dolfinx import mesh

from dolfinx_contact._mpi import Arguments, collective, keep, on_root
from dolfinx_contact._validate import listed
from dolfinx_contact.meshing.gmsh import GmshMesh, NamedTags
from dolfinx_contact.meshing.whole import WholeMesh, check_tags, distributed, gathered

__all__ = ["crack"]

logger = logging.getLogger(__name__)

Nodes = npt.NDArray[np.int64]


def _check(a: Arguments) -> None:
    known: dict[str, int] = {}
    if isinstance(a.body, GmshMesh):
        _, a.cell_tags, a.facet_tags, _ = a.body
        known = a.body._named_facets.names
    elif not isinstance(a.body, mesh.Mesh):
        raise ValueError(f"a mesh to crack is needed, got {a.body!r}")
    domain = _mesh_of(a.body)
    tdim = domain.topology.dim
    a.groups = _listed(a.groups)
    if a.facet_tags is None:
        raise ValueError("a crack needs MeshTags of facets")
    check_tags(domain, a.facet_tags, tdim - 1, "the facet_tags of a crack")
    if a.cell_tags is not None:
        check_tags(domain, a.cell_tags, tdim, "the cell_tags of a crack")
    for g in a.groups:
        if isinstance(g, str) and g not in known:
            raise ValueError(f"no group of facets is named {g!r}; names: {sorted(known)}")


@collective("a crack", _check)
def crack(
    body: GmshMesh | mesh.Mesh,
    groups: Iterable[int | str],
    *,
    facet_tags: mesh.MeshTags | None = None,
    cell_tags: mesh.MeshTags | None = None,
) -> GmshMesh:
    """A mesh in which the sides of facets inside the body are apart. Collective.

    The facets of a group keep their tag on one side; on the other they get a new one, whose group
    is named after the first, ``"fault_opposite"`` after ``"fault"`` and ``"5_opposite"`` after 5.
    So an interface inside a body becomes a matching pair::

        body = crack(body, ["fault"])
        fault = ContactPair(u, body, slave="fault", master="fault_opposite", law=Coulomb(0.4))

    The first side is that with the smaller cell tag, where these differ, else that whose outward
    normal points towards larger coordinates, at the facet that comes first in order of coordinates
    (x, then y, then z) of every connected piece. Where the crack ends inside the body both sides
    keep their common nodes. The mesh is rebuilt on rank 0, as when it is read.

    Args:
        body: a mesh, or one with physical groups.
        groups: names or tags of groups of facets; each is to have two sides, so that the arms of
            cracks that cross or branch need groups of their own, and pairs: `ContactPair` documents
            what acts where they meet. Of a crack that ends on another only the arm that ends, and
            the side which it divides is then the slave of the other one.
        facet_tags: of a mesh without groups.
        cell_tags: likewise.

    Returns:
        The new mesh with all tags and names.

    Raises:
        ValueError: on every rank, if there is no such group, a facet of it lies on the boundary, a
            group has no two sides, no node of a group can be doubled, the cells are curved, or tags
            are none, of another mesh, or of other entities.
    """
    domain = _mesh_of(body)
    names = body.names if isinstance(body, GmshMesh) else {}
    known = body._named_facets.names if isinstance(body, GmshMesh) else {}
    of_cells = body._named_cells.names if isinstance(body, GmshMesh) else {}
    keep(domain)
    comm = domain.comm
    tdim = domain.topology.dim
    tags = {g: known[g] if isinstance(g, str) else int(g) for g in groups}
    whole = gathered(domain, cell_tags, facet_tags)
    cell = domain.basix_cell()

    result: list[WholeMesh] = []

    def split() -> dict[int, int]:
        assert whole is not None
        new, others = _split(whole, cell, list(dict.fromkeys(tags.values())))
        result.append(new)
        return others

    others = on_root(comm, split)
    element = domain.ufl_domain().ufl_coordinate_element()
    new, cells, facets = distributed(comm, result[0] if result else None, element)
    opposite = {f"{g}_opposite": others[t] for g, t in tags.items()}
    names = names | {name: (tdim - 1, t) for name, t in opposite.items()}
    named = NamedTags(cells, of_cells), NamedTags(facets, known | opposite)
    return GmshMesh(new, *named, names)


def _mesh_of(body: GmshMesh | mesh.Mesh) -> mesh.Mesh:
    return body.mesh if isinstance(body, GmshMesh) else body


def _listed(groups: Iterable[int | str]) -> list[int | str]:
    """Names and tags of groups, or ``ValueError`` if they are none."""
    chosen = listed(groups, "groups")
    kinds = str | int | np.integer
    if not chosen or not all(isinstance(g, kinds) and g is not True for g in chosen):
        raise ValueError(f"a crack needs names or tags of groups, got {chosen!r}")
    return chosen


class _Around:
    """The cells around the nodes of the crack, and how they hang together.

    Attributes:
        near: numbers of the cells.
        cells: their nodes, the new ones after `split`.
        ids: numbers of their facets (cells, facets of a cell).
        tagged: numbers of the facets with a tag, -1 where no cell of these has it.
        corners: places of the nodes of a cell's facets.
    """

    def __init__(self, whole: WholeMesh, cell: basix.CellType, marked: npt.NDArray[np.bool_]):
        self.near = np.flatnonzero(marked[whole.cells].any(axis=1))
        self.cells = whole.cells[self.near].copy()
        self._marked = marked
        self.corners = np.array(basix.topology(cell)[-2])
        every = np.sort(self.cells[:, self.corners], axis=2)
        given = np.sort(whole.facets, axis=1)
        keys = np.concatenate([every.reshape(-1, every.shape[2]), given])
        ids = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
        self.ids = ids[: every.shape[0] * every.shape[1]].reshape(every.shape[:2])
        self.tagged = np.where(np.isin(ids[self.ids.size :], self.ids), ids[self.ids.size :], -1)

    def items(self, facets: Nodes) -> tuple[Nodes, Nodes]:
        """Cells and places in them of the given facets."""
        cells, places = np.nonzero(np.isin(self.ids, facets))
        return cells, places

    def split(self, crack: Nodes, first: int) -> tuple[Nodes, npt.NDArray[np.bool_]]:
        """Give every fan of cells a node of its own.

        Args:
            crack: numbers of facets through which cells do not hang together.
            first: number of the first new node.

        Returns:
            The nodes of which new ones are copies, and which nodes have several, old and new.
        """
        n, k = self.cells.shape
        marked = self._marked[self.cells]
        whole = ~np.isin(self.ids, crack)
        # A corner of a cell hangs on a node of a facet, and so on the corner beyond it.
        at = np.broadcast_to(np.arange(n)[:, None, None], (*self.ids.shape, self.corners.shape[1]))
        places = np.broadcast_to(self.corners, at.shape)
        used = whole[:, :, None] & marked[at, places]
        corner = (at * k + places)[used]
        facet = np.broadcast_to(self.ids[:, :, None], at.shape)[used]
        pairs = np.stack([self.cells.reshape(-1)[corner], facet])
        held = np.unique(pairs, axis=1, return_inverse=True)[1].reshape(-1)
        size = n * k + int(held.max(initial=-1)) + 1
        graph = coo_array((np.ones(len(corner)), (corner, n * k + held)), shape=(size, size))
        fans = connected_components(graph, directed=False)[1][: n * k]
        mine = np.flatnonzero(marked.reshape(-1))
        # The fan with the first cell keeps the node.
        _, firsts, fan = np.unique(fans[mine], return_index=True, return_inverse=True)
        node = self.cells.reshape(-1)[mine[firsts]]
        order = np.lexsort((mine[firsts], node))
        keeps = np.empty(len(node), dtype=bool)
        keeps[order] = np.concatenate([[True], np.diff(node[order]) > 0])
        number = node.copy()
        copies = order[~keeps[order]]
        number[copies] = first + np.arange(len(copies))
        self.cells.reshape(-1)[mine] = number[fan.reshape(-1)]
        several = np.zeros(first + len(copies), dtype=bool)
        several[node[copies]] = several[number[copies]] = True
        return node[copies], several


def _check_opening(
    opens: npt.NDArray[np.bool_], values: npt.NDArray[np.int32], tags: list[int]
) -> None:
    """Raise ``ValueError`` if no facet of a group opens; warn of facets that do not."""
    for tag in tags:
        here = values == tag
        if not opens[here].any():
            raise ValueError(
                f"no node can be doubled along the {int(here.sum())} facets with the tag {tag}: at "
                "all of them the crack ends inside the body; refine the mesh"
            )
    closed = np.isin(values, tags) & ~opens
    if closed.any():
        logger.warning(
            "%d facets of the crack have all their nodes on its front and cannot open; they lose "
            "their tag",
            int(closed.sum()),
        )


def _split(
    whole: WholeMesh, cell: basix.CellType, tags: list[int]
) -> tuple[WholeMesh, dict[int, int]]:
    """The mesh with a crack, and the tags of the other sides by those of the first."""
    chosen = np.isin(whole.facet_values, tags)
    for tag in tags:
        if tag not in whole.facet_values:
            known = np.unique(whole.facet_values).tolist()
            raise ValueError(f"no facet has the tag {tag}; tags of the mesh: {known}")
    marked = np.zeros(len(whole.x), dtype=bool)
    marked[whole.facets[chosen]] = True
    around = _Around(whole, cell, marked)
    crack = around.tagged[chosen]
    cells_of = np.bincount(around.ids.reshape(-1), minlength=int(crack.max()) + 1)[crack]
    if (cells_of != 2).any():
        raise ValueError(
            f"{int((cells_of != 2).sum())} facets of the crack lie on the boundary; it needs "
            "facets inside the body"
        )
    copied, several = around.split(crack, len(whole.x))
    for tag in tags:
        _refuse_branches(whole.facets[whole.facet_values == tag], tag)
    opens: npt.NDArray[np.bool_] = np.any(several[whole.facets], axis=1)
    _check_opening(opens, whole.facet_values, tags)
    cells = whole.cells.copy()
    cells[around.near] = around.cells
    x = np.concatenate([whole.x, whole.x[copied]])
    sides = _Sides(whole, around, several)
    # Other facets follow any cell that has them.
    at, place = np.nonzero(np.ones_like(around.ids, dtype=bool))
    known, one = np.unique(around.ids.reshape(-1), return_index=True)
    facets = whole.facets.copy()
    moved = np.flatnonzero(~chosen & (around.tagged >= 0))
    item = one[np.searchsorted(known, around.tagged[moved])]
    facets[moved] = around.cells[at[item][:, None], around.corners[place[item]]]
    values = whole.facet_values
    rows = [facets[~chosen]]
    given = [values[~chosen]]
    others = {}
    free = int(values.max()) + 1
    for i, tag in enumerate(tags):
        others[tag] = free + i
        items, is_first = sides.of(around.tagged[(values == tag) & opens], tag)
        rows.append(items)
        given.append(np.where(is_first, tag, free + i).astype(np.int32))
    new = replace(
        whole, cells=cells, x=x, facets=np.concatenate(rows), facet_values=np.concatenate(given)
    )
    return new, others


def _refuse_branches(facets: Nodes, tag: int) -> None:
    """Raise ``ValueError`` if more than two facets of a group meet at a node (3D: an edge)."""
    rims = {2: [[0], [1]], 3: [[0, 1], [1, 2], [2, 0]], 4: [[0, 1], [1, 3], [3, 2], [2, 0]]}
    every = np.sort(facets[:, rims[facets.shape[1]]].reshape(-1, len(rims[facets.shape[1]][0])))
    meeting = np.unique(every, axis=0, return_counts=True)[1]
    if (meeting > 2).any():
        raise ValueError(
            f"more than two facets with the tag {tag} meet at {int((meeting > 2).sum())} places: a "
            "branched or crossing crack needs a group for each arm"
        )


class _Sides:
    """The two sides of groups of facets."""

    def __init__(self, whole: WholeMesh, around: _Around, several: npt.NDArray[np.bool_]):
        self._x = whole.x
        self._around = around
        self._several = several
        self._old = whole.cells[around.near]
        self._materials = np.full(len(whole.cells), np.iinfo(np.int32).min, dtype=np.int64)
        self._materials[whole.tagged_cells] = whole.cell_values

    def of(self, facets: Nodes, tag: int) -> tuple[Nodes, npt.NDArray[np.bool_]]:
        """Nodes of both sides of facets (items, k), and which are of the first side."""
        around = self._around
        cells, places = around.items(facets)
        nodes = around.cells[cells[:, None], around.corners[places]]
        number = np.unique(around.ids[cells, places], return_inverse=True)[1]
        m = len(cells)
        # What has a doubled node in common is of one side.
        held, node = np.nonzero(self._several[nodes])
        links = coo_array(
            (np.ones(len(held)), (held, m + nodes[held, node])),
            shape=(m + len(self._several),) * 2,
        )
        patch = connected_components(links, directed=False)[1][:m]
        by_facet = np.argsort(number, kind="stable").reshape(-1, 2)
        a, b = patch[by_facet].T
        # Every patch twice, as the first side and as the second.
        count = int(patch.max()) + 1
        rows = np.concatenate([a, a + count])
        columns = np.concatenate([b + count, b])
        doubled = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * count,) * 2)
        label = connected_components(doubled, directed=False)[1]
        if (label[patch] == label[patch + count]).any():
            raise ValueError(
                f"the facets with the tag {tag} have no two sides: arms of a branched crack need "
                "groups of their own, and a crack must not meet itself"
            )
        piece = connected_components(
            coo_array((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False
        )[1][patch]
        is_first = np.zeros(m, dtype=bool)
        middle = self._x[self._old[cells[:, None], around.corners[places]]].mean(axis=1)
        for p in np.unique(piece):
            here = by_facet[piece[by_facet[:, 0]] == p]
            at = middle[here[:, 0]]
            one = here[np.lexsort(np.round(at - at.min(axis=0), 12).T[::-1])[0]]
            start = self._first_of(one, cells, middle)
            mine = np.flatnonzero(piece == p)
            is_first[mine] = label[patch[mine]] == label[patch[start]]
        return nodes, is_first

    def _first_of(self, pair: Nodes, cells: Nodes, middle: npt.NDArray[np.float64]) -> int:
        """Which of the two sides of a facet is the first."""
        materials = self._materials[self._around.near[cells[pair]]]
        if materials[0] != materials[1]:
            return int(pair[np.argmin(materials)])
        nodes = self._old[cells[pair[0]]]
        inside = self._x[nodes].mean(axis=0)
        outward = middle[pair[0]] - inside
        size = np.abs(outward).max()
        leading = outward[np.flatnonzero(np.abs(outward) > 1e-9 * size)[0]]
        return int(pair[0] if leading > 0 else pair[1])
