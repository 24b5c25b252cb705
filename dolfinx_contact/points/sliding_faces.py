# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slave and master of a pair in large sliding, at any displacement. Collective throughout.

A rank stores the slave facets that it owns, and the candidates: master facets that may oppose them.
The search for candidates (`sliding_master`) is repeated when nodes have moved, or normals have
turned, so far that other master facets may oppose the slave facets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._geometry import (
    area_vector_rates,
    dot,
    global_numbers,
    node_positions,
    ratio,
    transformed,
    unit,
)
from dolfinx_contact._mpi import SharedValues, maximum, require
from dolfinx_contact._petsc import logged
from dolfinx_contact.body.cells import cells_around
from dolfinx_contact.points.clipping import Cover, cover, linear_basis, tangents
from dolfinx_contact.points.kinematics import rotation
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.revolution import on_axis
from dolfinx_contact.points.sliding_kinematics import Facing, Nodal, cast, spins
from dolfinx_contact.points.sliding_master import Candidates, Master
from dolfinx_contact.points.surface_geometry import SurfaceFacets
from dolfinx_contact.points.trace import sums_at_global_places

__all__ = ["SlidingFaces", "SlidingOpposite"]


_STEEP = 0.1  # cosine of the largest angle at which facets face each other
_STEEP_ITSELF = 0.5  # the same for facets of one face
_NEAR = 4.0  # distance in facets within which facets of one face are neighbours
_BELOW = 1e-3  # depth at which cells behind a facet are searched, relative to the facet
_LEAST_COVER = 1e-6  # covered fraction of a facet below which it has no opposing facet
_LEAST_WEIGHT = 1e-9  # covered fraction of a node below which it has no opposing point
_SAME = 1e-6  # distance of a node from its image on the plane, relative to a facet
_ROUND_OFF = 4e-15  # gap that is round-off, relative to the largest coordinate
_SHARE = 0.05  # covered fraction of a node above which only its law determines its traction
#: Degree of the quadrature by dimension: of products of the bases of slave and master, and more in
#: 2D, where it costs little and normals turn.
_DEGREES = {2: 4, 3: 2}


@dataclass(frozen=True, kw_only=True)
class SlidingOpposite(Opposite):
    """Master in large sliding; inherited nodes and weights are empty, as they depend on the state.

    Attributes:
        depth: search distance in front of the slave and behind it.
        direction: for self-contact, direction along which the slave of two opposing facets lies
            farther in the mesh, shape (dim,); None for two faces.
        across: mask of the components normal to the planes of symmetry on which nodes lie, shape
            (local nodes, dim). Normals and slips at these nodes are means with their mirror images.
        planes: positions of the planes of symmetry by axis. Images of the master lie behind them
            and beyond the axis of bodies of revolution.
    """

    across: Mask
    planes: Mapping[int, float]
    depth: float
    direction: Array | None

    @property
    def matching(self) -> bool:
        return False


class _Corners(NamedTuple):
    """Positions of both faces at a displacement.

    Attributes:
        slave: corners of the slave facets, shape (n, k, dim).
        master: corners of the candidate master facets, shape (m, b, dim).
        vectors: sum of the area vectors of the slave facets around each local vertex, shape
            (vertices, dim).
    """

    slave: Array
    master: Array
    vectors: Array


class _Pieces(NamedTuple):
    """Common parts p of slave and master facets, with q quadrature points each.

    Attributes:
        facet: slave facet of each part, shape (p,).
        master: master facet of each part, an index of the candidates, shape (p,).
        basis: linear basis of the k slave corners at the points, shape (p, q, k).
        weights: quadrature weights in the reference configuration, shape (p, q).
        places: reference coordinates of the opposing points on the master facets, shape
            (p, q, dim - 1).
    """

    facet: Ints
    master: Ints
    basis: Array
    weights: Array
    places: Array


class _Searched(NamedTuple):
    """Positions and normals at the last search, to decide when the next search is necessary.

    Attributes:
        slave: corners of the slave facets, shape (n, k, dim).
        master: corners of the master facets of this rank, shape (n, b, dim).
        normals: unit normals of the slave facets, shape (n, dim).
    """

    slave: Array
    master: Array
    normals: Array


class SlidingFaces:
    """Slave and master of a pair in large sliding; finds the facets that face each other.

    Args:
        V: displacement space of degree 1.
        slave: facets of the slave.
        opposite: master.
        axisymmetric: whether the bodies are bodies of revolution.

    Attributes:
        vertex_exchange: exchange of values at the local vertices between ranks.
        corners: local vertices of the slave facets of this rank, shape (n, k).
        slave_nodes: global nodes of the displacement at these corners, shape (n, k).
        found: candidates of the last search.
        searches: number of searches.
        kept: 0 for vector components that cancel with their mirror image across a plane of
            symmetry, otherwise 1, shape (vertices, dim).
        images: factors that add the contributions of mirror images to sums of facet vectors around
            vertices, shape (vertices, dim).
        removed: overlaps subtracted from gaps, at the local vertices.
        lost: in self-contact, mask of the slave facets that start inside the body and have no
            opposing facet within the search distance.
    """

    found: Candidates

    def __init__(
        self,
        V: fem.FunctionSpace,
        slave: SurfaceFacets,
        opposite: SlidingOpposite,
        *,
        axisymmetric: bool = False,
    ):
        self.comm: MPI.Comm = V.mesh.comm
        self.dim = V.mesh.geometry.dim
        self._V = V
        self._axisymmetric = axisymmetric
        self._depth = depth = opposite.depth
        self._direction = opposite.direction
        # nodes and mirror images
        trace, across = slave.trace, opposite.across
        self._node_exchange = SharedValues(V.dofmap.index_map)
        self.vertex_exchange = slave.exchange
        self.kept: Array = np.where(across[trace], 0.0, 1.0)
        self.images: Array = self.kept * 2.0 ** across[trace].sum(axis=1, keepdims=True)
        if axisymmetric:
            self.images[on_axis(V)[trace], 0] = 0.0
        # slave and master in the mesh
        self._facets = slave
        self.corners = slave.corners
        self.slave_nodes = slave.nodes
        self._X = node_positions(V)
        self._reference = slave.reference
        axis = {0: 0.0} if axisymmetric else {}
        self.master = Master(V, opposite.master_facets, axis | dict(opposite.planes))
        largest = float(np.max(np.abs(self._X), initial=0.0))
        sizes = np.array([max(slave.size, self.master.size), largest])
        self._skin, largest = map(float, self.comm.allreduce(sizes, op=np.maximum))
        self._no_gap = _ROUND_OFF * largest
        self.searches = 0
        self._searched: _Searched  # positions at the last search
        self._found_before: Array  # corners of the candidates in the mesh
        self.removed: Array = np.zeros(len(trace))
        self.lost: Mask = np.zeros(len(self.corners), dtype=bool)
        #: Largest overlap at each facet; for self-contact not through the body.
        self._deepest: Array = np.full(len(self.corners), depth)
        if self._direction is not None:
            self._deepest = self._deepest_of_itself()

    # -- nodes -----------------------------------------------------------------------------------

    def of_slave(self, values: Array) -> Array:
        """Return nodal values at the corners of the slave facets, shape (n, k, dim).

        Args:
            values: values at the owned nodes, shape (nodes, dim).
        """
        return self._facets.at_corners(self._node_exchange.from_owners(values))

    def sums(self, facet: Ints, values: Array) -> Array:
        """Return sums of values at slave corners over the common parts around each local vertex.

        Args:
            facet: slave facet of each common part of slave and master facets, shape (p,).
            values: values at the corners of these facets, shape (p, k, ...).

        Returns:
            Sums, shape (vertices, ...).
        """
        return self.vertex_exchange.sums(self.corners[facet], values)

    def positions(self, u: Array) -> Array:
        """Return the positions of the corners of the slave facets, shape (n, k, dim).

        Args:
            u: displacement of the owned nodes, shape (nodes, dim).
        """
        return self._facets.at_corners(self._X + self._node_exchange.from_owners(u))

    @property
    def slave_vertices(self) -> Ints:
        """Global vertices at the corners of the slave facets, shape (n, k)."""
        return global_numbers(self.vertex_exchange.index_map, self.corners)

    @cached_property
    def whole(self) -> Candidates | None:
        """Candidates pairing every slave facet with every master facet; None if too many."""
        return self.master.whole(len(self.corners))

    @property
    def free_to_spin(self) -> Array:
        """Factors of the spins about the normals at the vertices, shape (vertices,).

        0 on planes of symmetry, where spins cancel with their mirror images; otherwise 1.
        """
        return self.kept.min(axis=1)

    def normal_rates(self, x: Array) -> Array:
        """Return derivatives of slave area vectors with respect to corners, shape (n, dim, k, dim).

        Args:
            x: corners of the slave facets, shape (n, k, dim).
        """
        return self._facets.sense[:, None, None, None] * area_vector_rates(x)

    def at_nodes(self, of_facets: Array) -> Array:
        """Return sums of facet vectors around the local vertices, including mirror images.

        Args:
            of_facets: vectors of the slave facets, shape (n, dim).
        """
        return self.images * self._facets.around_vertices(of_facets)

    def forces(self, facing: Facing, values: Array) -> Array:
        """Return nodal forces at the owned displacement dofs as a flat array.

        Args:
            facing: common parts of slave and master facets.
            values: forces at the corners of both facets or their images, shape (p, c, dim).
        """
        dofs = self.dim * facing.nodes[:, :, None] + np.arange(self.dim)
        owned = self.dim * self._V.dofmap.index_map.size_local
        values = facing.signs * values
        return sums_at_global_places(self.comm, owned, dofs.reshape(-1), values.reshape(-1))

    # -- search ----------------------------------------------------------------------------------

    def _search(self, x: Array, direction: Array | None) -> None:
        """Search for candidates again if nodes have moved too far since the last search.

        Args:
            x: positions of the local nodes, shape (nodes, dim).
            direction: for self-contact, direction that selects the slave facets (`_select_slave`);
                None to keep all pairs of facets.
        """
        slave = self._facets.faces(self._facets.at_corners(x))
        now = _Searched(slave.x, x[self.master.places], slave.normals)
        if self.searches:
            off = [_largest(v - then) for v, then in zip(now, self._searched, strict=True)]
            far = _Searched(*self.comm.allreduce(np.array(off), op=np.maximum))
            if far.slave + far.master + self._depth * far.normals <= self._skin:
                return
        finite = all(bool(np.isfinite(v).all()) for v in now)
        require(self.comm, finite, "positions of a contact pair are not finite")
        self._searched = now
        with logged("ContactSearch"):
            self.found = self.master.candidates(slave, now.master, self._depth, self._skin)
            self._found_before = self.master.positions(self._X, self.found)
            if direction is not None:
                self._select_slave(direction)
        self.searches += 1

    def _covered(
        self, slave: Array, master: Array, pairs: Ints, deepest: float | Array, **limits: float
    ) -> Cover:
        """Return the parts of slave facets that candidate master facets cover.

        Args:
            slave: corners of the slave facets, shape (n, k, dim).
            master: corners of the candidates, shape (m, b, dim).
            pairs: indices of slave facets and candidates that may oppose each other.
            deepest: largest overlap, see `cover`.
            limits: other limits of `cover`.
        """
        mine, theirs = self._facets.faces(slave), self.found.faces(master)
        limits = {"farthest": self._depth, "steep": _STEEP} | limits
        return cover(mine, theirs, pairs, deepest, least=_LEAST_COVER, **limits)

    def farthest_behind(self, far: float) -> float:
        """Return the largest distance of an opposing master facet behind a slave facet.

        The distance is measured in the undeformed mesh. Collective.

        Args:
            far: largest distance of facets that are considered.
        """
        slave = self._facets.faces(self._reference)
        found = self.master.candidates(slave, self._X[self.master.places], far)
        master = found.faces(self.master.positions(self._X, found))
        common = cover(slave, master, found.pairs, far, farthest=far, least=_LEAST_COVER)
        return maximum(self.comm, -_heights(common))

    def sharpest_edge(self) -> tuple[float, Array]:
        """Return the largest angle in degrees between facet and node normals, and its position.

        Only edges count, where the facets lie behind the plane perpendicular to the node normal.
        """
        x = self._reference
        vectors = self._facets.vectors(x)
        n = unit(self.at_nodes(vectors)[self.corners])
        cosine = dot(n, unit(vectors)[:, None])
        turn = np.degrees(np.arccos(cosine.clip(-1.0, 1.0)))
        back = dot(x.mean(axis=1, keepdims=True) - x, n)
        size = np.ptp(x, axis=1).max(axis=1)[:, None]
        turn = np.where(back < -1e-9 * size, turn, 0.0)
        every = zip(turn.ravel().tolist(), x.reshape(-1, self.dim).tolist(), strict=True)
        worst = max(every, default=(0.0, [0.0] * self.dim))
        angle, place = max(self.comm.allgather(worst))
        return angle, np.array(place)

    # -- self-contact ----------------------------------------------------------------------------

    def _select_slave(self, direction: Array) -> None:
        """Keep the pairs of self-contact in which the slave lies farther along a direction.

        Pairs of neighbours are removed: facets that share a node, or are near each other in the
        mesh without facing each other there. At equal distance, the first differing coordinate
        decides, and pairs with a mirror image are removed, because the facet faces the plane of
        symmetry itself.
        """
        i, k = self.found.pairs.T
        corners = self._found_before
        mine, theirs = self._facets.faces(self._reference), self.found.faces(corners)
        facing = dot(mine.normals[i], theirs.normals[k]) < -_STEEP_ITSELF
        way = self._reference.mean(axis=1)[i] - corners.mean(axis=1)[k]
        near = np.linalg.norm(way, axis=1) < _NEAR * self._skin
        way = np.where(np.abs(way) <= _SAME * self._skin, 0.0, way)
        farther = way @ direction
        level = np.abs(farther) <= _SAME * self._skin
        first = way[np.arange(len(way)), np.argmax(way != 0.0, axis=1)]
        real = np.all(self.found.mirrors[k] > 0, axis=1)
        ahead = np.where(level, real & (first > 0), farther > 0)
        kept = ~self._share_node() & (facing | ~near) & ahead
        self.found = replace(self.found, pairs=self.found.pairs[kept])

    def _share_node(self) -> Mask:
        """Return the mask of facet pairs with a common node; images share nodes on their planes."""
        i, k = self.found.pairs.T
        same = self.slave_nodes[i][:, :, None] == self.found.nodes[k][:, None]
        off = self._reference[i][:, :, None] - self._found_before[k][:, None]
        near = np.linalg.norm(off, axis=3) <= _SAME * self._skin
        return (same & near).any(axis=(1, 2))

    def _deepest_of_itself(self) -> Array:
        """Return the largest overlap of each slave facet in self-contact, shape (n,).

        Beyond it, the facet could meet the far side of its own body. It is half the thickness T of
        the undeformed body behind the facet, or (d + T)/2 for a facet starting inside the body at
        the depth d; at most the search distance.
        """
        self._search(self._X, None)
        self.searches = 0
        # a point below the middle of a facet that starts inside the body lies in two cells
        x = self._reference
        size = np.ptp(x, axis=1).max(axis=1)[:, None]
        below = x.mean(axis=1) - _BELOW * size * unit(self._facets.vectors(x))
        parts = self.comm.allgather(below)
        counts = cells_around(self._V.mesh, np.concatenate(parts))
        first = sum(len(part) for part in parts[: self.comm.rank])
        inside = counts[first : first + len(below)] > 1
        # facets behind those, at the depth d; all other facets behind bound the thickness
        pairs = self.found.pairs[~self._share_node()]
        start = np.zeros(len(self.corners))
        nearest, ways = self._behind(pairs[inside[pairs[:, 0]]])
        np.maximum.at(start, nearest[:, 0], ways)
        self.lost = inside & (start == 0.0)
        numbers = [max(len(self.found.nodes), 1), 1]
        walls, ways = self._behind(pairs[~np.isin(pairs @ numbers, nearest @ numbers)])
        thickness = np.full(len(self.corners), 2 * self._depth)
        np.minimum.at(thickness, walls[:, 0], ways)
        return np.minimum(0.5 * (start + thickness), self._depth)

    def _behind(self, pairs: Ints) -> tuple[Ints, Array]:
        """Return pairs whose master facet lies behind the slave facet in the mesh, and distances.

        ``pairs`` contains indices of slave facets and candidates, shape (pairs, 2).
        """
        corners = self._reference, self._found_before
        common = self._covered(*corners, pairs, self._depth, farthest=0.0)
        return np.stack([common.facet, common.other], axis=1), np.abs(_heights(common))

    # -- a state ---------------------------------------------------------------------------------

    def at(self, u: Array, before: Array | None, areas: Array) -> Facing:
        """Return the common parts of slave and master facets, gaps and slips at a displacement.

        Args:
            u: displacement of the owned nodes, shape (n, dim); further rows are ignored.
            before: displacement of the owned nodes at the last accepted state; None for zero.
            areas: areas of the local vertices in the reference configuration.
        """
        self._search(self._X + self._node_exchange.from_owners(u), self._direction)
        now = self._placed(u)
        then = self._placed(np.zeros_like(u) if before is None else before)
        pieces = self._pieces(now)
        facet, master, shape = pieces.facet, pieces.master, pieces.basis
        at = self.corners[facet]
        # rays along averaged normals
        starts, normals = shape @ now.slave[facet], shape @ now.vectors[at]
        rays = cast(starts, normals, now.master[master], pieces.places)
        # slips since the last accepted state
        normals_then = unit(then.vectors)
        turn = rotation(unit(shape @ then.vectors[at])[:, :, None], normals_then[at][:, None])
        way = rays.weights @ then.master[master] - shape @ then.slave[facet]
        slip = transformed(turn, way[:, :, None])
        along = turn @ tangents(then.master[master], rays.slopes)[:, :, None]
        # spins since then; normals of the master look the other way
        mine = spins(then.slave, now.slave, self._facets.sense)
        theirs = spins(then.master, now.master, self.found.senses)
        spin = 0.5 * (mine.angle[facet] - theirs.angle[master])
        apart = mine.angle[facet] + theirs.angle[master]
        by_corners = [0.5 * mine.by_corners[facet], -0.5 * theirs.by_corners[master]]
        # sums around the nodes
        weighted = (pieces.weights[..., None] * shape).transpose(0, 2, 1)
        weight = weighted.sum(axis=2)
        between = weighted @ shape * (1.0 - np.eye(shape.shape[2]))
        parts = {
            "weight": weight,
            "around": between.sum(axis=2),
            "gap": transformed(weighted, rays.gap),
            "slip": np.einsum("paq,pqad->pad", weighted, slip),
            "spin": weight * spin[:, None],
            "apart": weight * apart[:, None],
        }
        sums = {name: self.sums(facet, part) for name, part in parts.items()}
        nodal = self._nodal(sums, now.vectors, normals_then, areas)
        return Facing(
            found=self.found,
            facet=facet,
            master=master,
            nodes=np.concatenate([self.slave_nodes[facet], self.found.nodes[master]], axis=1),
            signs=self._signs(master),
            basis=shape,
            areas=pieces.weights,
            rays=rays,
            along=along,
            spins=np.concatenate(by_corners, axis=1),
            nodal=nodal,
        )

    def _placed(self, u: Array) -> _Corners:
        """Return the positions of both faces at a displacement of the owned nodes."""
        slave = self.positions(u)
        master = self._found_before + self.master.at_candidates(u, self.found)
        return _Corners(slave, master, self.at_nodes(self._facets.vectors(slave)))

    def _pieces(self, now: _Corners) -> _Pieces:
        """Return the common parts of slave and master facets, with quadrature points."""
        limits = {} if self._direction is None else {"steep": _STEEP_ITSELF}
        common = self._covered(now.slave, now.master, self.found.pairs, self._deepest, **limits)
        facet = common.facet
        rule = common.rule(_DEGREES[self.dim])
        basis = linear_basis(rule.on_slave, self.corners.shape[1])
        reference = self._reference[facet]
        stretch = self._measure(reference, basis.slopes)
        stretch /= self._measure(now.slave[facet], basis.slopes)
        weights = rule.weights * stretch
        if self._axisymmetric:
            weights *= 2 * np.pi * (basis.values @ reference)[..., 0]
        return _Pieces(facet, common.other, basis.values, weights, rule.on_master)

    def _signs(self, master: Ints) -> Array:
        """Return the signs of vector components at the corners of both facets, shape (p, c, dim).

        They are -1 for components that are mirrored, otherwise 1.
        """
        mirrors = self.found.mirrors[master][:, None]
        mine, theirs = self.corners.shape[1], self.found.nodes.shape[1]
        signs = np.repeat(mirrors, mine + theirs, axis=1)
        signs[:, :mine] = 1.0
        return signs

    def _nodal(self, sums: Mapping[str, Array], m: Array, before: Array, areas: Array) -> Nodal:
        """Return weighted gaps, slips, normals and spins at the local vertices.

        Args:
            sums: sums over the common parts around each vertex, by name: weights, products of basis
                functions, and weighted gaps, slips, mean and relative spins (`sliding_kinematics`).
            m: sums of area vectors around the vertices, shape (n, dim).
            before: unit normals of the last accepted state, shape (n, dim).
            areas: areas of the vertices in the reference configuration, shape (n,).
        """
        covered = sums["weight"] > _LEAST_WEIGHT * areas
        weight = np.where(covered, sums["weight"], 0.0)
        around = np.where(covered, sums["around"], 0.0)
        inverse = ratio(np.ones_like(weight), weight)
        # faces on each other in the mesh do not touch yet, whatever the sign of round-off
        gap = inverse * sums["gap"]
        gap = np.where(np.abs(gap) <= self._no_gap, 0.0, gap) + self.removed
        length = np.linalg.norm(m, axis=1)
        return Nodal(
            weight=weight,
            share=np.where(around > 0, np.minimum(weight / (_SHARE * areas), 1.0), 1.0),
            around=around,
            gap=np.where(covered, gap, self._depth),
            slip=self.kept * (inverse[:, None] * sums["slip"]),
            normal=m / length[:, None],
            length=length,
            before=before,
            spin=self.free_to_spin * (inverse * sums["spin"]),
            apart=self.free_to_spin * (inverse * sums["apart"]),
        )

    def _measure(self, x: Array, slopes: Array) -> Array:
        """Return the ratios of areas on facets to areas on the reference facet, shape (p, q).

        Args:
            x: corners, shape (p, k, dim).
            slopes: derivatives of the basis at q points of each facet, shape (p, q, k, dim - 1).
        """
        edges = tangents(x, slopes)
        if self.dim == 2:
            return np.linalg.norm(edges[..., 0], axis=-1)
        return np.linalg.norm(np.cross(edges[..., 0], edges[..., 1]), axis=-1)


def _heights(common: Cover) -> Array:
    """Return distances of master from slave midpoints along slave normals, one per common part."""
    off = common.master.x[common.other].mean(axis=1) - common.slave.x[common.facet].mean(axis=1)
    return dot(off, common.slave.normals[common.facet])


def _largest(off: Array) -> float:
    """Return the largest Euclidean norm of several vectors."""
    return float(np.max(np.linalg.norm(off, axis=-1), initial=0.0))
