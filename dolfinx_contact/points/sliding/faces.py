# SPDX-License-Identifier: LGPL-3.0-or-later
"""The faces of a pair that slide over each other, wherever they are. Collective throughout.

A rank has the facets of the slave that it owns, and of the master those that may be opposite to
these. What may be opposite is searched for anew when nodes have moved, or normals turned, so far
that others may be (`candidates`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from itertools import product

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._compat import FacetSubmesh
from dolfinx_contact._geometry import area_vector_rates, area_vectors, node_positions, unit
from dolfinx_contact._mpi import SharedValues, require
from dolfinx_contact._petsc import logged
from dolfinx_contact.body.cells import cells_around
from dolfinx_contact.points.clipping import Faces, basis, cover
from dolfinx_contact.points.facing import faces_of
from dolfinx_contact.points.kinematics import rotation
from dolfinx_contact.points.revolution import on_axis
from dolfinx_contact.points.sliding.candidates import Candidates, candidates, from_rows, marks_of
from dolfinx_contact.points.sliding.facing import Facing, Nodal
from dolfinx_contact.points.sliding.rays import cast, slopes
from dolfinx_contact.points.sliding.spins import spins
from dolfinx_contact.points.trace import at_global_places, facet_normals

__all__ = ["SlidingFaces"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_STEEP = 0.1  # cosine of the largest angle at which facets face each other
_STEEP_ITSELF = 0.5  # the same of one face
_NEAR = 4.0  # facets of one face, within which they are neighbours
#: Pairs of facets up to which the Jacobian has places for all of them, and the same pattern always.
_FEW_PAIRS = 20_000
_BELOW = 1e-3  # of a facet, a depth at which the body is looked for behind it
_LEAST_COVER = 1e-6  # of a facet, below which it has nothing opposite
_LEAST_WEIGHT = 1e-9  # of the area of a node, below which it has nothing opposite
_SAME = 1e-6  # of a facet, a distance of a node from its image on the plane
_ROUND_OFF = 4e-15  # of the largest coordinate, a gap that is none
_SHARE = 0.05  # of the area of a node, that has to be covered for the law to count alone
#: Degree of the quadrature, by dimension: of products of the bases of slave and master, and more in
#: the plane, where it costs little and normals turn.
_DEGREES = {2: 4, 3: 2}


class SlidingFaces:
    """Slave and master, and who faces whom at a displacement.

    Args:
        V: displacement space of degree 1.
        submesh: of the facets of the slave.
        vertices: scalar P1 space on it.
        trace: for every local vertex the local node of `V` at its place.
        master: local facets of the master, ghosts included.
        depth: how far rays reach, before the slave and behind it.
        across: local nodes of `V` x dim, True across planes of symmetry, on which normals and slips
            are means with their mirror images.
        planes: of symmetry, where they are by their axis: what lies behind them, or beyond the axis
            of bodies of revolution, is the image of the master.
        direction: of a face that is slave and master, along which slaves lie farther in the mesh
            (dim,); None of two faces.
        axisymmetric: whether these are faces of bodies of revolution.

    Attributes:
        corners: local vertices of the facets of the slave that this rank owns (n, k).
        searches: how often candidates were searched for.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        vertices: fem.FunctionSpace,
        trace: npt.NDArray[np.int32],
        master: npt.NDArray[np.int32],
        depth: float,
        *,
        across: npt.NDArray[np.bool_],
        planes: Mapping[int, float],
        direction: Array | None = None,
        axisymmetric: bool = False,
    ):
        domain = V.mesh
        self.comm: MPI.Comm = domain.comm
        self._axisymmetric = axisymmetric
        self.dim = domain.geometry.dim
        self._V = V
        self._trace = trace
        self._nodes = SharedValues(V.dofmap.index_map)
        self._vertices = SharedValues(vertices.dofmap.index_map)
        #: Of vectors at the local vertices what a mean with a mirror image leaves (n, dim).
        self.kept: Array = np.where(across[trace], 0.0, 1.0)
        #: Of sums around them what the mirror images make of these: each plane doubles them.
        self.images: Array = self.kept * 2.0 ** across[trace].sum(axis=1, keepdims=True)
        if axisymmetric:
            self.images[on_axis(V)[trace], 0] = 0.0
        self._depth = depth
        owned = submesh.mesh.topology.index_map(submesh.mesh.topology.dim).size_local
        self.corners: Nodes = vertices.dofmap.list[:owned].astype(np.int64)
        self._size = self.dim * V.dofmap.index_map.size_local
        self._X = node_positions(V)[:, : self.dim].copy()
        largest = self.comm.allreduce(float(np.max(np.abs(self._X), initial=0.0)), op=max)
        self._no_gap = _ROUND_OFF * largest
        mine = facet_normals(domain, submesh.parent_facets[:owned])
        self._sense = np.sign(np.sum(area_vectors(self._of_slave(self._X)) * mine, axis=1))
        self._reference = self._of_slave(self._X)
        across_axis = {0: 0.0} if axisymmetric else {}
        behind = across_axis | dict(planes)
        #: Images in planes of symmetry and in several of these, itself first (m, dim).
        self._mirrors = _mirrors(behind, self.dim)
        self._planes: Array = np.array([behind.get(i, 0.0) for i in range(self.dim)])
        facets = master[master < domain.topology.index_map(self.dim - 1).size_local]
        theirs = faces_of(V, facets)
        self._master = V.dofmap.index_map.global_to_local(theirs.nodes.reshape(-1)).reshape(
            theirs.nodes.shape
        )
        self._master_nodes = theirs.nodes
        self._master_sense = np.sign(np.sum(area_vectors(theirs.x) * theirs.normals, axis=1))
        sizes = [np.ptp(x, axis=1).max(axis=1) for x in (self._reference, theirs.x)]
        of_facets = max(float(np.max(s, initial=0.0)) for s in sizes)
        self._skin: float = self.comm.allreduce(of_facets, op=max)
        self.searches = 0
        self._then: tuple[Array, Array, Array]  # positions and normals at the last search
        self._found: Candidates
        self._direction = direction
        #: Of the local vertices, overlaps of the mesh that are no gaps.
        self.removed: Array = np.zeros(len(trace))
        #: Of facets of one face that start within the body, those with nothing to meet in reach.
        self.lost: npt.NDArray[np.bool_] = np.zeros(len(self.corners), dtype=bool)
        #: How far the bodies may overlap at each facet: of one face not through the body.
        self._deepest: Array = np.full(len(self.corners), depth)
        if direction is not None:
            self._deepest = self._deepest_of_itself()
        self._found_before: Array  # where the mesh has their corners

    # -- nodes -----------------------------------------------------------------------------------

    def _of_slave(self, values: Array) -> Array:
        """Values of local nodes at the corners of the slave (n, k, dim)."""
        return values[self._trace[self.corners]]

    def of_slave(self, values: Array) -> Array:
        """Values of the owned nodes (n, dim) at the corners of the slave (n, k, dim)."""
        return self._of_slave(self.spread(values))

    def spread(self, u: Array) -> Array:
        """Values at all local nodes from those at the owned ones (n, dim)."""
        return self._nodes.from_owners(u)

    def sums(self, facet: Nodes, values: Array) -> Array:
        """Values of corners (p, k, ...) of facets, added up at the local vertices (n, ...)."""
        return self._vertices.sums(self.corners[facet], values)

    def ghosted(self, values: Array) -> Array:
        """Values at the local vertices from those at the owned ones (n, ...)."""
        return self._vertices.from_owners(values)

    def positions(self, u: Array) -> Array:
        """Where the corners of the slave's facets are at a displacement (n, k, dim)."""
        return self._of_slave(self._X + self.spread(u))

    @property
    def _all(self) -> Nodes:
        return np.arange(len(self.corners))

    def _area_vectors(self, x: Array) -> Array:
        """Outward area vectors of the facets of the slave (n, dim)."""
        return np.asarray(self._sense[:, None] * area_vectors(x))

    def normal_rates(self, x: Array) -> Array:
        """Derivatives of the vectors of facets by their corners (n, dim, k, dim)."""
        return np.asarray(self._sense[:, None, None, None] * area_vector_rates(x))

    def at_nodes(self, of_facets: Array) -> Array:
        """Sums of vectors of facets (n, dim) around the local vertices, with mirror images."""
        k = self.corners.shape[1]
        return self.images * self.sums(self._all, np.repeat(of_facets[:, None], k, axis=1))

    def of_master(self, values: Array, found: Candidates) -> Array:
        """Vectors of the owned nodes (n, dim) at the corners of candidates (m, b, dim)."""
        n = self._V.dofmap.index_map.size_local
        at = at_global_places(self.comm, np.ascontiguousarray(values[:n]), found.known)
        return np.asarray(at[found.places] * found.mirrors[:, None])

    def _before(self, found: Candidates) -> Array:
        """Where the mesh has the corners of candidates (m, b, dim)."""
        behind = self._behind_planes(found.mirrors)
        return np.asarray(self.of_master(self._X, found) + behind[:, None])

    def _behind_planes(self, mirrors: Array) -> Array:
        """By how much images are farther than vectors to what they are of say (m, dim)."""
        return np.where(mirrors < 0, 2.0 * self._planes, 0.0)

    def forces(self, facing: Facing, mine: Array, theirs: Array) -> Array:
        """Forces at the owned displacement dofs, flat.

        Args:
            facing: whose pieces they act on.
            mine: at the corners of the slave's facets (p, k, dim).
            theirs: at the nodes of the master's, or of images of these (p, b, dim).
        """
        theirs = theirs * facing.mirrors[:, None]
        nodes = np.concatenate(
            [self.slave_nodes()[facing.facet].reshape(-1), facing.master_nodes.reshape(-1)]
        )
        values = np.concatenate([mine.reshape(-1, self.dim), theirs.reshape(-1, self.dim)])
        sums = PETSc.Vec().createMPI((self._size, None), comm=self.comm)
        dofs = (self.dim * nodes[:, None] + np.arange(self.dim)).reshape(-1)
        sums.setValues(
            dofs.astype(PETSc.IntType), values.reshape(-1), addv=PETSc.InsertMode.ADD_VALUES
        )
        sums.assemble()
        found = sums.array_r.copy()
        sums.destroy()
        return np.asarray(found)

    # -- search ----------------------------------------------------------------------------------

    def _search(self, x: Array) -> None:
        """Search for candidates where nodes have moved too far since the last time.

        Args:
            x: positions of the local nodes.
        """
        slave = self._slave_at(x)
        mine, normals, theirs = slave.x, slave.normals, x[self._master]
        if self.searches:
            then, before, others = self._then
            moved = [_largest(mine - then), _largest(theirs - others)]
            turned = self._depth * _largest(normals - before)
            far = self.comm.allreduce(np.array([*moved, turned]), op=np.maximum)
            if far.sum() <= self._skin:
                return
        finite = bool(np.isfinite(mine).all() and np.isfinite(theirs).all())
        require(self.comm, finite, "positions of a contact pair are not finite")
        self._then = mine, normals, theirs
        with logged("ContactSearch"):
            depth, skin = self._depth, self._skin
            sought = self._masters(theirs, depth + skin)
            self._found = candidates(self.comm, slave, *sought, depth, skin)
            if self._direction is not None:
                self._found = self._of_itself(self._found, self._direction)
            self._found_before = self._before(self._found)
        self.searches += 1

    def _slave_at(self, x: Array) -> Faces:
        """The slave of this rank at positions of the local nodes."""
        mine = self._of_slave(x)
        none = np.zeros((len(mine), 0), dtype=np.int64)
        return Faces(mine, unit(self._area_vectors(mine)), none)

    def _masters(self, x: Array, reach: float) -> tuple[Faces, Array]:
        """The master of this rank, and its images that reach behind planes by less than a length.

        Args:
            x: positions of its corners (n, b, dim).
            reach: the length.

        Returns:
            The facets, and their marks (m,).
        """
        parts = []
        for mirror in self._mirrors:
            far = np.abs(x - self._planes).min(axis=1)[:, mirror < 0] > reach
            near = np.flatnonzero(~far.any(axis=1))
            image = mirror * x[near] + self._behind_planes(mirror)
            senses = np.prod(mirror) * self._master_sense[near]
            parts.append((image, self._master_nodes[near], marks_of(senses, mirror)))
        places, nodes, marks = (np.concatenate(p) for p in zip(*parts, strict=True))
        return Faces(places, unit(np.sign(marks)[:, None] * area_vectors(places)), nodes), marks

    def _of_itself(self, found: Candidates, direction: Array) -> Candidates:
        """Candidates of one face: those that lie behind along a direction and are no neighbours.

        Neighbours share a node, or are near in the mesh and do not face each other there. What lies
        as far is behind if it is by its first coordinate that differs, and an image not at all: it
        is that of what faces its plane.
        """
        i, k = found.pairs.T
        corners = self._before(found)
        slave, master = self._faces(found, self._reference, corners)
        mine = self._reference.mean(axis=1)[i]
        theirs = corners.mean(axis=1)[k]
        facing = np.sum(slave.normals[i] * master.normals[k], axis=1) < -_STEEP_ITSELF
        near = np.linalg.norm(theirs - mine, axis=1) < _NEAR * self._skin
        way = mine - theirs
        way = np.where(np.abs(way) <= _SAME * self._skin, 0.0, way)
        farther = way @ direction
        level = np.abs(farther) <= _SAME * self._skin
        first = way[np.arange(len(way)), np.argmax(way != 0.0, axis=1)]
        real = np.all(found.mirrors[k] > 0, axis=1)
        ahead = np.where(level, real & (first > 0), farther > 0)
        kept = ~self._shares_node(found) & (facing | ~near) & ahead
        return replace(found, pairs=found.pairs[kept])

    def _shares_node(self, found: Candidates) -> npt.NDArray[np.bool_]:
        """Which candidates have a node in common with the facet of the slave.

        Images have those in common that lie on their planes.
        """
        i, k = found.pairs.T
        same = self.slave_nodes()[i][:, :, None] == found.nodes[k][:, None]
        places = self._before(found)
        off = self._reference[i][:, :, None] - places[k][:, None]
        near: npt.NDArray[np.bool_] = np.linalg.norm(off, axis=3) <= _SAME * self._skin
        return np.asarray((same & near).any(axis=(1, 2)))

    def _deepest_of_itself(self) -> Array:
        """How far each facet may be overlapped before its face is met through the body (n,).

        Half the thickness T of the body behind it in the mesh, and (d + T)/2 where it starts within
        the body at the depth d.
        """
        direction = self._direction
        self._direction = None
        self._search(self._X)
        self._direction = direction
        self.searches = 0
        found = self._found
        pairs = found.pairs[~self._shares_node(found)]
        within = self._within_the_body()
        start = np.zeros(len(self.corners))
        nearest, ways = self._behind(pairs[within[pairs[:, 0]]])
        np.maximum.at(start, nearest[:, 0], ways)
        self.lost = within & (start == 0.0)
        number = max(len(found.nodes), 1)
        used = np.isin(pairs @ [number, 1], nearest @ [number, 1])
        walls, ways = self._behind(pairs[~used])
        thickness = np.full(len(self.corners), 2 * self._depth)
        np.minimum.at(thickness, walls[:, 0], ways)
        return np.minimum(0.5 * (start + thickness), self._depth)

    def _behind(self, pairs: Nodes) -> tuple[Nodes, Array]:
        """Which of some pairs of facets lie behind each other in the mesh, and how far."""
        slave, master = self._faces(self._found, self._reference, self._before(self._found))
        common = cover(
            slave, master, pairs, self._depth, farthest=0.0, least=_LEAST_COVER, steep=_STEEP
        )
        off = master.x[common.other].mean(axis=1) - slave.x[common.facet].mean(axis=1)
        ways = np.abs(np.sum(off * slave.normals[common.facet], axis=1))
        return np.stack([common.facet, common.other], axis=1), ways

    def _within_the_body(self) -> npt.NDArray[np.bool_]:
        """Which facets start within the body: a point below their middle lies in two cells (n,)."""
        x = self._reference
        below = x.mean(axis=1) - _BELOW * np.ptp(x, axis=1).max(axis=1)[:, None] * unit(
            self._area_vectors(x)
        )
        parts = self.comm.allgather(below)
        counts = cells_around(self._V.mesh, np.concatenate(parts))
        first = sum(len(part) for part in parts[: self.comm.rank])
        return np.asarray(counts[first : first + len(below)] > 1)

    @property
    def candidates(self) -> Candidates:
        """What the last search has found."""
        return self._found

    @cached_property
    def whole(self) -> Candidates | None:
        """Every facet of the master for every one of the slave; None where these are too many.

        Images have the nodes of what they are images of.
        """
        counts = np.array([len(self.corners), len(self._master_nodes)])
        slave, master = self.comm.allreduce(counts)
        if slave * master > _FEW_PAIRS:
            return None
        rows = np.column_stack([self._master_sense, self._master_nodes])
        parts = self.comm.allgather(rows)
        return from_rows(np.concatenate(parts).astype(np.int64), len(self.corners), self.dim)

    def slave_nodes(self) -> Nodes:
        """Global nodes of the displacement at the corners of the facets of the slave (n, k)."""
        local = self._trace[self.corners]
        found = self._V.dofmap.index_map.local_to_global(local.reshape(-1).astype(np.int32))
        return np.asarray(found, dtype=np.int64).reshape(local.shape)

    def slave_vertices(self) -> Nodes:
        """Global vertices there (n, k)."""
        found = self._vertices.index_map.local_to_global(self.corners.reshape(-1).astype(np.int32))
        return np.asarray(found, dtype=np.int64).reshape(self.corners.shape)

    # -- the mesh --------------------------------------------------------------------------------

    def sharpest_edge(self) -> tuple[float, Array]:
        """The largest angle in degrees of a facet with the normal of a node at an edge, and where.

        An edge is where the facets around a node fall back behind its normal.
        """
        x = self._reference
        vectors = self._area_vectors(x)
        m = self.at_nodes(vectors)[self.corners]
        n = unit(m)
        facet = unit(vectors)
        cosine = np.sum(n * facet[:, None], axis=2)
        turn = np.degrees(np.arccos(cosine.clip(-1.0, 1.0)))
        back = np.sum((x.mean(axis=1, keepdims=True) - x) * n, axis=2)
        size = np.ptp(x, axis=1).max(axis=1)[:, None]
        turn = np.where(back < -1e-9 * size, turn, 0.0)
        worst = (0.0, np.zeros(self.dim).tolist())
        if turn.size:
            at = np.unravel_index(int(np.argmax(turn)), turn.shape)
            worst = float(turn[at]), x[at].tolist()
        angle, place = max(self.comm.allgather(worst))
        return angle, np.array(place)

    def farthest_behind(self, far: float) -> float:
        """How far the nearest facet that faces one of the slave lies behind it in the mesh.

        Args:
            far: a length, beyond which nothing is looked for.
        """
        sought = self._masters(self._X[self._master], far)
        found = candidates(self.comm, self._slave_at(self._X), *sought, far, 0.0)
        slave, master = self._faces(found, self._reference, self._before(found))
        common = cover(slave, master, found.pairs, far, farthest=far, least=_LEAST_COVER)
        off = master.x[common.other].mean(axis=1) - slave.x[common.facet].mean(axis=1)
        behind = -np.sum(off * slave.normals[common.facet], axis=1)
        return self.comm.allreduce(float(np.max(behind, initial=0.0)), op=max)

    # -- a state ---------------------------------------------------------------------------------

    def at(self, u: Array, before: Array | None, areas: Array) -> Facing:
        """Who faces whom.

        Args:
            u: displacement at the first local nodes, at least the owned ones (n, dim).
            before: of the owned nodes at the last accepted state; None: they were where the mesh
                is.
            areas: of the local vertices in the reference configuration.
        """
        x = self._X + self.spread(u)
        self._search(x)
        mine = self._of_slave(x)
        vectors = self._area_vectors(mine)
        theirs = self._found_before + self.of_master(u, self._found)
        facet, master, shape, weights, eta = self._pieces(mine, theirs)
        m = self.at_nodes(vectors)
        at = self.corners[facet]
        start = np.einsum("pqa,pad->pqd", shape, mine[facet])
        normal = np.einsum("pqa,pad->pqd", shape, m[at])
        rays = cast(start, normal, theirs[master], eta)
        old, old_m, old_theirs = self._last(before)
        (mine_spun, by_mine), (theirs_spun, by_theirs) = (
            spins(old, mine, self._sense),
            spins(old_theirs, theirs, self._found.senses),
        )
        # Normals of the master look the other way.
        both_spun = mine_spun[facet], -theirs_spun[master]
        spun = np.stack([0.5 * sum(both_spun), both_spun[0] - both_spun[1]], axis=1)
        by_corners = 0.5 * by_mine[facet], -0.5 * by_theirs[master]
        way = np.einsum("pqb,pbd->pqd", rays.weights, old_theirs[master])
        way -= np.einsum("pqa,pad->pqd", shape, old[facet])
        o = unit(np.einsum("pqa,pad->pqd", shape, old_m[at]))
        edges = np.einsum("pqbi,pbd->pqdi", rays.slopes, old_theirs[master])
        old_normals = unit(old_m)
        turn = rotation(o[:, :, None], old_normals[at][:, None])
        along = turn @ edges[:, :, None]
        slips = np.einsum("pqaij,pqj->pqai", turn, way)
        weighted = shape * weights[..., None]
        mass = np.einsum("pqa,pqb->pab", weighted, shape)
        around = mass.sum(axis=2) - np.einsum("paa->pa", mass)
        nodal = self._nodal(
            facet, weighted, around, rays.gap, slips, spun, m=m, before=old_normals, areas=areas
        )
        return Facing(self._found, facet, master, shape, weights, rays, along, by_corners, nodal)

    @property
    def free_to_spin(self) -> Array:
        """1 of the local vertices, 0 on planes of symmetry, where images spin against them (n,)."""
        return np.asarray(self.kept.min(axis=1))

    def _last(self, before: Array | None) -> tuple[Array, Array, Array]:
        """Slave, vectors at its nodes, and candidates at the last accepted state."""
        if before is None:
            mine = self._reference
            theirs = self._found_before
        else:
            mine = self._of_slave(self._X + self.spread(before))
            theirs = self._found_before + self.of_master(before, self._found)
        return mine, self.at_nodes(self._area_vectors(mine)), theirs

    def _pieces(self, mine: Array, theirs: Array) -> tuple[Nodes, Nodes, Array, Array, Array]:
        """Parts that face each other: facets, basis, weights, and places on the master."""
        common = cover(
            *self._faces(self._found, mine, theirs),
            self._found.pairs,
            self._deepest,
            farthest=self._depth,
            least=_LEAST_COVER,
            steep=_STEEP if self._direction is None else _STEEP_ITSELF,
        )
        rule = common.rule(_DEGREES[self.dim])
        k = self.corners.shape[1]
        facet = common.facet
        shape = basis(rule.mine, k, 1)
        stretch = self._measure(self._reference[facet], rule.mine)
        stretch /= self._measure(mine[facet], rule.mine)
        if self._axisymmetric:
            stretch *= 2 * np.pi * np.einsum("pqa,pa->pq", shape, self._reference[facet, :, 0])
        return facet, common.other, shape, rule.weights * stretch, rule.theirs

    def _faces(self, found: Candidates, mine: Array, theirs: Array) -> tuple[Faces, Faces]:
        """Slave and candidates at places of their corners."""
        none = np.zeros((len(mine), 0), dtype=np.int64)
        n = unit(found.senses[:, None] * area_vectors(theirs))
        return Faces(mine, unit(self._area_vectors(mine)), none), Faces(theirs, n, found.nodes)

    def _measure(self, x: Array, at: Array) -> Array:
        """Area of facets (p, k, dim) by that of the reference facet, at places (p, q)."""
        edges = np.einsum("pqai,pad->pqdi", slopes(at, x.shape[1]), x)
        if self.dim == 2:
            return np.linalg.norm(edges[..., 0], axis=-1)
        return np.linalg.norm(np.cross(edges[..., 0], edges[..., 1]), axis=-1)

    def _nodal(
        self,
        facet: Nodes,
        weighted: Array,
        around: Array,
        gap: Array,
        slip: Array,
        spin: Array,
        *,
        m: Array,
        before: Array,
        areas: Array,
    ) -> Nodal:
        """Means at the local vertices."""
        weight = self.sums(facet, weighted.sum(axis=1))
        weight = np.where(weight > _LEAST_WEIGHT * areas, weight, 0.0)
        by = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
        gaps = by * self.sums(facet, np.einsum("pqa,pq->pa", weighted, gap))
        # Faces that lie on each other in the mesh do not touch yet, whatever the sign of round-off.
        gaps = np.where(np.abs(gaps) <= self._no_gap, 0.0, gaps)
        gaps = np.where(weight > 0, gaps + self.removed, self._depth)
        slips = by[:, None] * self.sums(facet, np.einsum("pqa,pqad->pad", weighted, slip))
        slips = self.kept * slips
        turns = self.sums(facet, weighted.sum(axis=1)[..., None] * spin[:, None])
        turns = (by * self.free_to_spin)[:, None] * turns
        length = np.linalg.norm(m, axis=1)
        others = np.where(weight > 0, self.sums(facet, around), 0.0)
        share = np.where(others > 0, np.minimum(weight / (_SHARE * areas), 1.0), 1.0)
        normal = m / length[:, None]
        return Nodal(weight, share, others, gaps, slips, normal, length, before, *turns.T)


def _mirrors(planes: Mapping[int, float], dim: int) -> Array:
    """1, or -1 along axes across planes: of nothing, of each plane, and of several (m, dim)."""
    signs = [[1.0, -1.0] if axis in planes else [1.0] for axis in range(dim)]
    return np.array(list(product(*signs)))


def _largest(off: Array) -> float:
    """The longest of some vectors."""
    return float(np.max(np.linalg.norm(off, axis=-1), initial=0.0))
