# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Surfaces of segments (2D) or triangles (3D): checked, oriented, and with their normals.

What two facets have in common is a *ridge*: a point of segments, an edge of triangles. A ridge of
one facet is the rim of an open surface; one of three or more is refused.

Normals at corners are those of `normals`, averaged over the facets that no crease parts. Which side
a point is on is known by the sum of normals by the angles of facets (Baerentzen and Aanaes, IEEE
Trans. Vis. Comput. Graph. 11, 2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import scipy

from dolfinx_contact.rigid_surfaces.normals import corner_normals, crossed, without_tips

__all__ = ["Triangulation", "angles_of", "mended", "merged", "triangulated"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

_SAME = 1e-7  # of the extent, up to which two points of a file are one: those have single precision
_ON_EDGE = 1e-3  # of it, within which a point of a rim is on an edge of another
_SLIT = 0.01  # of the edges of two points on rims, within which these are meant to be one
_COPLANAR = 1e-4  # difference of unit normals below which facets lie in one plane
_FLAT = 1e-10  # of the longest edge squared, up to which a facet has no area


@dataclass(frozen=True)
class Triangulation:
    """A surface of facets, oriented, with what is known of its ridges and points.

    Attributes:
        points: (m, dim).
        cells: facets by their points (k, dim).
        normals: of the facets, out of the obstacle (k, dim).
        ridges: numbers of the ridges opposite to the corners of facets (k, dim).
        ridge_normals, point_normals: which side of them is outside, of any length.
        ridge_creases, point_creases: whether normals of facets there are not averaged.
        ridge_rims, point_rims: whether the surface ends there.
        corner_normals: averaged normals at the corners of facets (k, dim, dim).
    """

    points: Array
    cells: Ints
    normals: Array
    ridges: Ints
    ridge_normals: Array
    point_normals: Array
    ridge_creases: Bools
    point_creases: Bools
    ridge_rims: Bools
    point_rims: Bools
    corner_normals: Array

    @property
    def closed(self) -> bool:
        """Whether it has no rim."""
        return not bool(self.ridge_rims.any())

    @property
    def parts(self) -> Ints:
        """Numbers of the connected parts of facets (k,)."""
        facets = np.repeat(np.arange(len(self.cells)), self.cells.shape[1])
        first = np.full(len(self.points), -1, dtype=np.int64)
        first[self.cells.ravel()] = facets
        return _parts(len(self.cells), facets, first[self.cells.ravel()])

    def part(self, facets: Bools) -> Triangulation:
        """That of some of the facets alone, which are whole parts."""
        used, cells = np.unique(self.cells[facets], return_inverse=True)
        cells = cells.reshape(-1, self.points.shape[1])
        return triangulated(self.points[used], cells, 0.0, "a part")

    @property
    def edges(self) -> Ints:
        """Edges that are creases or rims, by their points (k, 2); of segments there are none."""
        if self.points.shape[1] == 2:
            return np.zeros((0, 2), dtype=np.int64)
        first = np.unique(self.ridges, return_index=True)[1]
        facet, corner = np.divmod(first[self.ridge_creases | self.ridge_rims], 3)
        ends = [self.cells[facet, (corner + k) % 3] for k in (1, 2)]
        return np.stack(ends, axis=1)

    @property
    def size(self) -> float:
        """Its extent, a length."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def merged(points: Array, cells: Ints) -> tuple[Array, Ints]:
    """Points that are one, up to 1e-7 of the extent, made one; those of no facet left out."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = scipy.spatial.cKDTree(points).query_pairs(_SAME * size, output_type="ndarray")
    links = scipy.sparse.coo_array(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points))
    )
    group = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    used, renumbered = np.unique(group[cells], return_inverse=True)
    first = np.unique(group, return_index=True)[1]
    return points[first[used]], renumbered.reshape(cells.shape).astype(np.int64)


def mended(points: Array, cells: Ints, name: str) -> Ints:
    """Facets that have no two corners in one and are there once, turned like their neighbours.

    Of two that look to different sides both stay, as those of a plate without thickness.
    Facets are cut where a point of a rim is on their edge, so that they meet those beyond it. Of
    each connected part the orientation of most of its area is kept, and it encloses a positive
    volume where it is closed.

    Raises:
        ValueError: if a part has one side alone, as a Moebius strip.
    """
    cells = _cut_at_points(points, _once(cells[~_collapsed(cells)]), name)
    ridges, signs, _, pairs = _ridges(cells, name)
    first, second = pairs
    unlike = (signs[first] == signs[second]).astype(np.int64)
    dim = cells.shape[1]
    turned, part = _turned(len(cells), first // dim, second // dim, unlike)
    if np.any(turned[first // dim] ^ turned[second // dim] ^ unlike.astype(bool)):
        raise ValueError(f"{name}: the surface has one side alone, as a Moebius strip has")
    area = np.linalg.norm(crossed(points[cells]), axis=1)
    volume = _volumes(points, _flipped(cells, turned))
    rims = np.bincount(ridges.ravel())[ridges] == 1
    for k in range(part.max(initial=-1) + 1):
        mine = part == k
        if rims[mine].any():
            wrong = area[mine & turned].sum() > area[mine & ~turned].sum()
        else:
            wrong = volume[mine].sum() < 0
        turned[mine] ^= wrong
    return _flipped(cells, turned)


def triangulated(
    points: Array, cells: Ints, crease: float, name: str, *, inward: bool = False
) -> Triangulation:
    """A surface whose facets agree about its sides.

    Args:
        points: (m, dim).
        cells: facets by their points (k, dim).
        crease: the angle (radians) between normals of facets above which they are not averaged.
        name: for messages.
        inward: whether closed parts may enclose a negative volume.

    Raises:
        ValueError: if facets are degenerate, three of them have a ridge in common, parts touch at
            a point alone, neighbours look to different sides, a closed part encloses a negative
            volume, or points of rims are nearly in one place.
    """
    dim = cells.shape[1]
    _check_facets(points, cells, name)
    across = crossed(points[cells])
    normals = across / np.linalg.norm(across, axis=1)[:, None]
    ridges, signs, nodes, (first, second) = _ridges(cells, name)
    _check_sides(points, nodes, signs, ridges, (first, second), name)
    if not inward:
        _check_volume(points, cells, (first // dim, second // dim), ridges, name)
    count = int(ridges.max()) + 1
    rims = np.bincount(ridges.ravel(), minlength=count) == 1
    cosine = np.einsum("pi,pi->p", normals[first // dim], normals[second // dim])
    creases = np.zeros(count, dtype=bool)
    creases[ridges.ravel()[first]] = cosine < np.cos(crease)
    planes = _planes(normals, (first // dim, second // dim))
    at_creases = creases[ridges.ravel()[first]]
    turns = _turns(points[cells], normals, (first, second), at_creases, planes)
    ridge_normals = np.zeros((count, dim))
    np.add.at(ridge_normals, ridges, normals[:, None])
    fans = without_tips(points[cells], _fans(cells, nodes, ridges, (first, second), ~creases))
    _check_joints(points, cells, ridges, nodes, name)
    _check_fans(points, cells, _fans(cells, nodes, ridges, (first, second), ~rims), name)
    point_normals = np.zeros_like(points)
    np.add.at(point_normals, cells, angles_of(points[cells])[..., None] * normals[:, None])
    parts_of_points = np.bincount(np.unique(np.stack([cells.ravel(), fans], 1), axis=0)[:, 0])
    point_rims = np.zeros(len(points), dtype=bool)
    point_rims[nodes.reshape(len(ridges), dim, -1)[rims[ridges]]] = True
    _check_slits(points, cells, point_rims, name)
    return Triangulation(
        points,
        cells,
        normals,
        ridges,
        ridge_normals,
        point_normals,
        creases,
        parts_of_points > 1,
        rims,
        point_rims,
        corner_normals(points[cells], fans, planes, turns),
    )


# -- checks ----------------------------------------------------------------------------------------


def _collapsed(cells: Ints) -> Bools:
    ordered = np.sort(cells, axis=1)
    return np.asarray((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))


def _once(cells: Ints) -> Ints:
    """Facets without those that are there before, with the same corners the same way round."""
    dim = cells.shape[1]
    first = np.argmin(cells, axis=1)[:, None] if dim == 3 else np.zeros((len(cells), 1), int)
    turned = np.take_along_axis(cells, (first + np.arange(dim)) % dim, axis=1)
    return cells[np.sort(np.unique(turned, axis=0, return_index=True)[1])]


def _check_facets(points: Array, cells: Ints, name: str) -> None:
    same = _collapsed(cells)
    if same.any():
        raise ValueError(
            f"{name}: {same.sum()} facets have two corners in one place, the first at "
            f"{_at(points[cells[same][0]])}: mend=True leaves them out"
        )
    corners = points[cells]
    area = np.linalg.norm(crossed(corners), axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = area <= _FLAT * longest ** (cells.shape[1] - 1)
    if flat.any():
        raise ValueError(
            f"{name}: {flat.sum()} facets have no area, the first at {_at(corners[flat][0])}; "
            "repair the surface in the program that made it"
        )
    twice = len(cells) - len(np.unique(np.sort(cells, axis=1), axis=0))
    if twice:
        raise ValueError(
            f"{name}: {twice} facets are there twice: mend=True leaves out those that look to the "
            "same side"
        )


def _check_sides(
    points: Array, nodes: Ints, signs: Ints, ridges: Ints, pairs: tuple[Ints, Ints], name: str
) -> None:
    unlike = signs[pairs[0]] == signs[pairs[1]]
    if unlike.any():
        raise ValueError(
            f"{name}: the facets at {unlike.sum()} of {len(unlike)} "
            f"{'points' if ridges.shape[1] == 2 else 'edges'} between two look to different "
            f"sides, first at {_at(points[nodes[pairs[0][unlike][0]]])}: mend=True turns them"
        )


def _check_volume(
    points: Array, cells: Ints, pairs: tuple[Ints, Ints], ridges: Ints, name: str
) -> None:
    part = _parts(len(cells), *pairs)
    rims = (np.bincount(ridges.ravel())[ridges] == 1).any(axis=1)
    volume = np.bincount(part, _volumes(points, cells))
    inward = (volume < 0) & (np.bincount(part, rims) == 0)
    if inward.any():
        first = cells[part == np.flatnonzero(inward)[0]][0]
        raise ValueError(
            f"{name}: a closed surface has its normals inward, at {_at(points[first])}: mend=True "
            "turns them outward; reverse=True is for a body that is inside the surface"
        )


def _check_fans(points: Array, cells: Ints, fans: Ints, name: str) -> None:
    """Refuse points around which facets are not one fan."""
    each = np.unique(np.stack([cells.ravel(), fans], axis=1), axis=0)[:, 0]
    several = np.flatnonzero(np.bincount(each, minlength=len(points)) > 1)
    if len(several):
        raise ValueError(
            f"{name}: parts of the surface touch in {len(several)} points alone, the first at "
            f"{_at(points[several[:1]])}"
        )


def _check_slits(points: Array, cells: Ints, rims: Bools, name: str) -> None:
    """Refuse rims that have points in one place, or nearly so, as facets that do not meet have."""
    shortest = _shortest_edges(points, cells)
    ends = np.flatnonzero(rims)
    if len(ends) < 2:
        return
    away = scipy.spatial.cKDTree(points[ends]).query(points[ends], k=2)[0][:, 1]
    near = ends[away < _SLIT * shortest[ends]]
    if len(near):
        raise ValueError(
            f"{name}: the surface is torn: {len(near)} points of rims are in one place with "
            f"others, or within {_SLIT:g} of an edge of these, the first at "
            f"{_at(points[near[:1]])}; mend=True joins those that are in one place; else repair it "
            "in the program that made it"
        )


def _check_joints(points: Array, cells: Ints, ridges: Ints, nodes: Ints, name: str) -> None:
    """Refuse points of rims that are on an edge of another rim, where facets do not meet."""
    _, on = _points_on_rims(points, cells, ridges, nodes)
    if len(on):
        flat = ridges.shape[1] == 2
        how = "join them in the program that made them" if flat else "mend=True cuts these there"
        raise ValueError(
            f"{name}: the surface is torn: {len(np.unique(on))} points of rims are on the "
            f"{'segments' if flat else 'edges of facets'} of others, the first at "
            f"{_at(points[on[:1]])}: {how}"
        )


def _points_on_rims(points: Array, cells: Ints, ridges: Ints, nodes: Ints) -> tuple[Ints, Ints]:
    """Points of rims that are between the ends of edges of rims, or in 2D of segments.

    Returns:
        The edges, by facet and corner the way round (in 2D segments), and the points, by edge and
        along it.
    """
    dim = ridges.shape[1]
    rims = np.flatnonzero((np.bincount(ridges.ravel())[ridges] == 1).ravel())
    ends = np.unique(nodes[rims])
    if not len(ends):
        return np.zeros(0, dtype=np.int64), ends
    edges = nodes[rims] if dim == 3 else cells
    shortest = _shortest_edges(points, cells)
    start = points[edges[:, 0]]
    way = points[edges[:, 1]] - start
    length = np.linalg.norm(way, axis=1)
    tree = scipy.spatial.cKDTree(points[ends])
    near = tree.query_ball_point(start + way / 2, (0.5 + _ON_EDGE) * length)
    edge = np.repeat(np.arange(len(edges)), [len(n) for n in near])
    point = ends[np.concatenate([np.asarray(n, dtype=np.int64) for n in near])]
    other = (point[:, None] != edges[edge]).all(axis=1)
    edge, point = edge[other], point[other]
    offset = points[point] - start[edge]
    along = np.sum(offset * way[edge], axis=1) / length[edge]
    apart = np.linalg.norm(offset - (along / length[edge])[:, None] * way[edge], axis=1)
    size = np.minimum(shortest[point], length[edge])
    on = (apart < _ON_EDGE * size) & (np.minimum(along, length[edge] - along) > _SLIT * size)
    edge, point, along = edge[on], point[on], along[on]
    order = np.lexsort((along, edge))
    return (rims if dim == 3 else np.arange(len(cells)))[edge[order]], point[order]


def _cut_at_points(points: Array, cells: Ints, name: str) -> Ints:
    """Triangles that are cut where points of rims are on their edges."""
    if cells.shape[1] == 2:
        return cells
    while True:
        ridges, _, nodes, _ = _ridges(cells, name)
        edges, on = _points_on_rims(points, cells, ridges, nodes)
        # One edge of a facet after the other.
        facets, first = np.unique(edges // 3, return_index=True)
        if not len(facets):
            return cells
        cut = []
        for facet, edge in zip(facets, edges[first], strict=True):
            apex = cells[facet, edge % 3]
            chain = [nodes[edge, 0], *on[edges == edge], nodes[edge, 1]]
            cut += [(apex, a, b) for a, b in pairwise(chain)]
        cells = np.concatenate([np.delete(cells, facets, axis=0), np.array(cut, dtype=np.int64)])


def _shortest_edges(points: Array, cells: Ints) -> Array:
    """Of the facets at points (m,)."""
    shortest = np.full(len(points), np.inf)
    for i in range(cells.shape[1]):
        a, b = cells[:, i - 1], cells[:, i]
        length = np.linalg.norm(points[a] - points[b], axis=1)
        np.minimum.at(shortest, a, length)
        np.minimum.at(shortest, b, length)
    return shortest


def _at(x: Array) -> str:
    mean = np.atleast_2d(x).mean(axis=0)
    return f"({', '.join(f'{c:.6g}' for c in mean)})"


# -- facets and their neighbours -------------------------------------------------------------------


def _ridges(cells: Ints, name: str) -> tuple[Ints, Ints, Ints, tuple[Ints, Ints]]:
    """Ridges of facets: numbers (k, dim), then by facet and corner the way round (k dim,) and
    points (k dim, dim - 1), and the pairs of these that are one ridge.
    """
    k, dim = cells.shape
    if dim == 2:
        nodes = cells[:, [1, 0]].reshape(-1, 1)
        signs = np.tile([1, -1], k)
    else:
        nodes = cells[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2)
        signs = np.where(nodes[:, 0] < nodes[:, 1], 1, -1)
    numbers = np.unique(np.sort(nodes, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    order = np.argsort(numbers, kind="stable")
    counts = np.bincount(numbers)
    if counts.max(initial=0) > 2:
        raise ValueError(
            f"{name}: no manifold: {np.sum(counts > 2)} {'points' if dim == 2 else 'edges'} have "
            f"more than two facets (up to {counts.max()})"
        )
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])[counts == 2]
    pairs = order[starts], order[starts + 1]
    return numbers.reshape(k, dim), signs, nodes, pairs


def _parts(count: int, first: Ints, second: Ints) -> Ints:
    links = scipy.sparse.coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    found = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return np.asarray(found, dtype=np.int64)


def _turned(count: int, first: Ints, second: Ints, unlike: Ints) -> tuple[Bools, Ints]:
    """Which facets are to be turned to be like the first of their part, and the parts."""
    part = _parts(count, first, second)
    # A link of weight 2 turns, one of weight 1 does not.
    links = scipy.sparse.csr_array((unlike + 1, (first, second)), shape=(count, count))
    both = links + links.T
    turned = np.zeros(count, dtype=bool)
    for start in np.unique(part, return_index=True)[1]:
        order, before = scipy.sparse.csgraph.breadth_first_order(both, start, directed=False)
        for facet in order[1:]:
            turned[facet] = turned[before[facet]] ^ (both[before[facet], facet] == 2)
    return turned, part


def _flipped(cells: Ints, turned: Bools) -> Ints:
    found = cells.copy()
    found[turned, :2] = found[turned, 1::-1]
    return found


def _fans(cells: Ints, nodes: Ints, ridges: Ints, pairs: tuple[Ints, Ints], joined: Bools) -> Ints:
    """Numbers of the fans of facets around points, by facet and corner (k dim,).

    Corners at one point belong to one fan where their facets have a ridge that joins.
    """
    k, dim = cells.shape
    first, second = (p[joined[ridges.ravel()[pairs[0]]]] for p in pairs)
    links = []
    for column in range(dim - 1):
        node = nodes[first, column]
        ends = [
            p // dim * dim + np.argmax(cells[p // dim] == node[:, None], axis=1)
            for p in (first, second)
        ]
        links.append(np.stack(ends, axis=1))
    every = np.concatenate(links)
    return _parts(k * dim, every[:, 0], every[:, 1])


# -- geometry --------------------------------------------------------------------------------------


def _volumes(points: Array, cells: Ints) -> Array:
    """Of the cones from the centre of the surface to its facets (k,)."""
    corners = points[cells] - points.mean(axis=0)
    dim = cells.shape[1]
    return np.einsum("ki,ki->k", corners.mean(axis=1), crossed(corners)) / (dim * (dim - 1))


def angles_of(corners: Array) -> Array:
    """Of facets at their corners (k, dim); 1 of segments."""
    k, dim = corners.shape[:2]
    if dim == 2:
        return np.ones((k, 2))
    found = np.empty((k, 3))
    for i in range(3):
        a, b = (corners[:, (i + j) % 3] - corners[:, i] for j in (1, 2))
        across = np.linalg.norm(np.cross(a, b), axis=1)
        found[:, i] = np.arctan2(across, np.einsum("ki,ki->k", a, b))
    return found


def _planes(normals: Array, pairs: tuple[Ints, Ints]) -> Ints:
    """Numbers of the planes that facets which meet have in common (k,).

    Args:
        normals: of facets (k, dim).
        pairs: of facets that meet.
    """
    first, second = pairs
    same = np.linalg.norm(normals[first] - normals[second], axis=1) < _COPLANAR
    return _parts(len(normals), first[same], second[same])


def _turns(
    corners: Array, normals: Array, pairs: tuple[Ints, Ints], creases: Bools, planes: Ints
) -> Array:
    """How much facets bend if they turn at their creases (k,): the difference of normals there, the
    most, over the width of the facet across it.

    Facets that lie in one plane, as both triangles of a strip, have all the same.

    Args:
        corners: of facets (k, dim, dim).
        normals: of these (k, dim).
        pairs: of facets and corners the way round, opposite to what two of them share (p,).
        creases: whether that is one (p,).
        planes: that facets have in common (k,).
    """
    dim = normals.shape[1]
    first, second = (p // dim for p in pairs)
    off = np.linalg.norm(normals[first] - normals[second], axis=1)
    size = np.linalg.norm(crossed(corners), axis=1)
    most = np.zeros(len(normals))
    for ridge in pairs:
        facet, corner = np.divmod(ridge, dim)
        width = size[facet]
        if dim == 3:
            ends = [corners[facet, (corner + k) % 3] for k in (1, 2)]
            width = width / np.linalg.norm(ends[1] - ends[0], axis=1)
        np.maximum.at(most, planes[facet], np.where(creases, off / width, 0.0))
    return np.asarray(most[planes])
