# SPDX-License-Identifier: LGPL-3.0-or-later
"""B of faces that slide, at a state (`facing`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import ratio, transformed
from dolfinx_contact._petsc import triplet_matrix
from dolfinx_contact.points.operators import Operator
from dolfinx_contact.points.sliding.faces import SlidingFaces
from dolfinx_contact.points.sliding.facing import Facing, RayRates

__all__ = ["SlidingOperator"]


class _Change(NamedTuple):
    """Change of both faces.

    Attributes:
        corners: displacements of the corners of both facets at p parts, shape (p, c, dim).
        vectors: changes of the sums m of area vectors around vertices, shape (vertices, dim).
    """

    corners: Array
    vectors: Array


@dataclass(frozen=True, eq=False)
class SlidingOperator(Operator):
    """Operator B from displacements to jumps, for faces that slide, at one displacement.

    Attributes:
        faces: facets of slave and master.
        facing: opposing parts of both faces.
        number: number of contact points, the owned vertices of the slave.
        x: positions of the corners of the slave facets, shape (n, k, dim).
    """

    faces: SlidingFaces
    facing: Facing
    number: int
    x: Array

    @property
    def areas(self) -> Array:  # type: ignore[override]
        return self.facing.nodal.weight[: self.number]

    @cached_property
    def absent(self) -> Mask:  # type: ignore[override]
        """Mask of points without an opposing point, shape (n,)."""
        return self.areas == 0.0

    @property
    def facets_passed(self) -> Array:
        """Slips since the last accepted state in facets that were opposite then, shape (n,)."""
        facing = self.facing
        sizes = np.linalg.norm(facing.along, axis=3).mean(axis=3)
        size = self._means(np.einsum("paq,pqa->pa", facing.weighted, sizes))
        return ratio(np.linalg.norm(facing.nodal.slip, axis=1), size)[: self.number]

    @cached_property
    def share(self) -> Array:  # type: ignore[override]
        return self.facing.nodal.share[: self.number]

    def mean_around(self, tractions: Array) -> Array:
        facing = self.facing
        sums = self.faces.sums(facing.facet, facing.mass @ self._at_corners(tractions))
        around = facing.nodal.around
        by = ratio(np.ones_like(around), around)
        return (self.faces.kept * by[:, None] * sums)[: self.number]

    def _at_corners(self, tractions: Array) -> Array:
        """Return tractions at corners of pieces (p, a, dim) from those at the owned points."""
        alive = np.where(self.absent[:, None], 0.0, tractions)
        alive = self.faces.vertices.from_owners(alive)
        return alive[self.faces.corners[self.facing.facet]]

    def _change(self, v: Array) -> _Change:
        """Return the change of both faces along a displacement."""
        faces, facing = self.faces, self.facing
        mine = faces.of_slave(v)
        theirs = faces.master.vectors(v, facing.found)
        m = faces.at_nodes(np.einsum("nikj,nkj->ni", faces.normal_rates(self.x), mine))
        return _Change(np.concatenate([mine[facing.facet], theirs[facing.master]], axis=1), m)

    def _moved(self, change: _Change) -> RayRates:
        """Return the changes of the rays; see `Facing.moved`."""
        m = change.vectors[self.faces.corners[self.facing.facet]]
        return self.facing.moved(change.corners, m)

    def _means(self, parts: Array) -> Array:
        """Return weighted means at the local vertices, from parts at corners (p, a, ...)."""
        sums = self.faces.sums(self.facing.facet, parts)
        return (self.facing.nodal.inverse * sums.T).T

    def apply(self, v: Array) -> Array:
        facing = self.facing
        corners = self._change(v).corners
        return self._means(facing.weighted @ (facing.jumps @ corners))[: self.number]

    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        facing, faces = self.facing, self.faces
        inverse = facing.nodal.inverse[faces.corners[facing.facet]]
        values = inverse[:, :, None] * (facing.weighted @ facing.jumps)
        rows = faces.slave_vertices[facing.facet][:, :, None]
        return triplet_matrix(comm, (self.number, nodes), rows, facing.nodes[:, None], values)

    def rate(self, v: Array) -> Array:
        """Return the derivative of the jumps along v, without the part due to turning normals.

        Shape (n, dim).
        """
        facing, faces, nodal = self.facing, self.faces, self.facing.nodal
        change = self._change(v)
        rays = self._moved(change)
        gaps = self._means(transformed(facing.weighted, rays.gap))
        slip = np.einsum(
            "paq,pqadi,pqi->pad", facing.weighted, facing.along, rays.place, optimize=True
        )
        slips = transformed(nodal.rotation, faces.kept * self._means(slip))
        turned = transformed(nodal.by_turning, transformed(nodal.by_normal, change.vectors))
        spun = np.sum(facing.spins * change.corners, axis=(1, 2))[:, None]
        spun = faces.free_to_spin * self._means(facing.weighted.sum(axis=2) * spun)
        slips = slips + turned + spun[:, None] * nodal.by_spin
        return (slips - gaps[:, None] * nodal.normal)[: self.number]

    def normal_rate(self, v: Array) -> Array:
        return transformed(self.facing.nodal.by_normal, self._change(v).vectors)[: self.number]

    def at_quadrature(self, tractions: Array) -> Array:
        """Return tractions times areas at the points (p, q, dim) from those at the owned points."""
        return self.facing.weighted.transpose(0, 2, 1) @ self._at_corners(tractions)

    def transpose(self, tractions: Array) -> Array:
        forces = self.facing.jumps.transpose(0, 2, 1) @ self.at_quadrature(tractions)
        return self.faces.forces(self.facing, forces)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        slopes = self.facing.rays.slopes
        moving = transformed(slopes, self._moved(self._change(v)).place)
        forces = np.zeros(self.facing.signs.shape)
        forces[:, -slopes.shape[2] :] -= moving.transpose(0, 2, 1) @ self.at_quadrature(tractions)
        return self.faces.forces(self.facing, forces)
