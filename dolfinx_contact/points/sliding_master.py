# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search, on all ranks, for master facets that may oppose slave facets in large sliding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._geometry import area_vectors, balls, unit
from dolfinx_contact.points.clipping import Faces
from dolfinx_contact.points.spatial_search import facets_along_normals
from dolfinx_contact.points.surface_geometry import MovingFacets
from dolfinx_contact.points.trace import at_global_places, facet_closures, owned_facets

__all__ = ["Candidates", "Master"]


#: Pairs of facets up to which the Jacobian has entries for all of them, so that its pattern does
#: not change and branches can be followed.
_FEW_PAIRS = 20_000


@dataclass(frozen=True, eq=False)
class Candidates:
    """Master facets that may oppose slave facets; mirror images count as separate facets.

    Attributes:
        nodes: global nodes at the b corners of the master facets, each facet once, shape (n, b).
        senses: factors 1 or -1 that make the area vectors computed from the corners point outward,
            shape (n,).
        mirrors: factor of each axis, -1 if the facet is the mirror image of the facet with these
            nodes across a plane normal to the axis, otherwise 1, shape (n, dim).
        pairs: indices of slave and master facets that may oppose each other, shape (pairs, 2).
    """

    nodes: Ints
    senses: Array
    mirrors: Array
    pairs: Ints

    def faces(self, x: Array) -> Faces:
        """Return the master facets with corners at positions x, shape (n, b, dim)."""
        return Faces(x, unit(self.senses[:, None] * area_vectors(x)), self.nodes)


def _candidates(keys: Ints, pairs: Ints, dim: int) -> Candidates:
    """Return candidates from keys of master facets and pairs of facets.

    Args:
        keys: keys as returned by `Master._keys`, shape (n, dim + 1 + b) for b corners.
        pairs: indices of slave and master facets, shape (pairs, 2).
        dim: spatial dimension.
    """
    signs = keys[:, : dim + 1].astype(np.float64)
    return Candidates(keys[:, dim + 1 :], signs[:, dim], signs[:, :dim], pairs)


class Master(MovingFacets):
    """Master facets owned by this rank, and their images behind planes of symmetry.

    Args:
        V: displacement space of degree 1.
        facets: local facets of the master, ghosts included.
        planes: positions of the planes of symmetry by axis, and of the axis of a body of
            revolution.
    """

    def __init__(self, V: fem.FunctionSpace, facets: Indices, planes: Mapping[int, float]):
        owned = owned_facets(V.mesh, facets)
        super().__init__(V, owned, facet_closures(V, owned))
        self._dim = V.mesh.geometry.dim
        self._planes: Array = np.array([planes.get(i, 0.0) for i in range(self._dim)])
        signs = [[1.0, -1.0] if axis in planes else [1.0] for axis in range(self._dim)]
        #: Signs of the axes of the facets themselves and of their images, shape (m, dim).
        self._mirrors: Array = np.array(list(product(*signs)))

    def candidates(self, slave: Faces, x: Array, depth: float, skin: float = 0.0) -> Candidates:
        """Return the master facets and mirror images that slave normals may meet. Collective.

        Args:
            slave: slave facets of this rank.
            x: positions of the corners of the master, shape (n, b, dim).
            depth: distance in front of the slave and behind it up to which facets are found.
            skin: additional distance, so that the result remains valid while bodies move by less.
        """
        places, keys = [], []
        for mirror in self._mirrors:
            # images that are too far behind their planes are left out
            far = np.abs(x - self._planes).min(axis=1)[:, mirror < 0] > depth + skin
            near = np.flatnonzero(~far.any(axis=1))
            places.append(mirror * x[near] + self._behind(mirror))
            keys.append(self._keys(near, mirror))
        middles, radii = balls(np.concatenate(places))
        known = {"x": middles, "key": np.concatenate(keys)}
        depths = np.full(len(slave.x), depth)
        found, pairs = facets_along_normals(self._V.mesh.comm, slave, known, radii, depths, skin)
        return _candidates(found["key"], pairs, self._dim)

    def _keys(self, facets: Ints, mirror: Array) -> Ints:
        """Return integer keys that identify master facets or their mirror images, one row each.

        The columns are the sign of each axis (-1 if mirrored), the sign of the area vector, and the
        global nodes of the corners.
        """
        signs = np.broadcast_to(mirror, (len(facets), self._dim))
        senses = np.prod(mirror) * self.sense[facets]
        return np.column_stack([signs, senses, self.nodes[facets]]).astype(np.int64)

    def _behind(self, mirrors: Array) -> Array:
        """Return the vectors that shift mirrored positions behind their planes of symmetry."""
        return np.where(mirrors < 0, 2.0 * self._planes, 0.0)

    def whole(self, slave: int) -> Candidates | None:
        """Return candidates that pair every slave facet with every master facet. Collective.

        None if there are too many pairs. Mirror images, which have the nodes of their facets, are
        not included.

        Args:
            slave: number of slave facets of this rank.
        """
        comm = self._V.mesh.comm
        counts = comm.allreduce(np.array([slave, len(self.nodes)]))
        if counts.prod() > _FEW_PAIRS:
            return None
        every = np.arange(len(self.nodes))
        parts = comm.allgather(self._keys(every, np.ones(self._dim)))
        facets = np.unique(np.concatenate(parts), axis=0)
        pairs = np.indices((slave, len(facets))).reshape(2, -1).T
        return _candidates(facets, pairs.astype(np.int64), self._dim)

    def at_candidates(self, values: Array, found: Candidates) -> Array:
        """Return nodal vectors at corners of candidates, mirrored for mirror images. Collective.

        Args:
            values: vectors at the owned nodes, shape (n, dim); further rows are ignored.
            found: candidates.
        """
        owned = np.ascontiguousarray(values[: self._V.dofmap.index_map.size_local])
        at = at_global_places(self._V.mesh.comm, owned, found.nodes)
        return at * found.mirrors[:, None]

    def positions(self, x: Array, found: Candidates) -> Array:
        """Return positions of the corners of candidate facets, shape (m, b, dim). Collective.

        Args:
            x: positions of the owned nodes, shape (n, dim); further rows are ignored.
            found: candidates.
        """
        return self.at_candidates(x, found) + self._behind(found.mirrors)[:, None]
