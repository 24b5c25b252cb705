# SPDX-License-Identifier: LGPL-3.0-or-later
"""B of faces that slide, at a state (`facing`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import ratio
from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.points.operators import Operator
from dolfinx_contact.points.sliding.faces import SlidingFaces
from dolfinx_contact.points.sliding.facing import Facing

__all__ = ["SlidingOperator"]


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
        return np.asarray(self.areas == 0.0)

    @property
    def facets_passed(self) -> Array:
        """Slips since the last accepted state in facets that were opposite then, shape (n,)."""
        facing = self.facing
        sizes = np.linalg.norm(facing.along, axis=3).mean(axis=3)
        size = self._means((facing.weighted * sizes).sum(axis=1))
        return ratio(np.linalg.norm(facing.nodal.slip, axis=1), size)[: self.number]

    @cached_property
    def share(self) -> Array:  # type: ignore[override]
        return self.facing.nodal.share[: self.number]

    def mean_around(self, tractions: Array) -> Array:
        facing = self.facing
        at = self._at_corners(tractions)
        sums = self.faces.sums(facing.facet, np.einsum("pab,pbd->pad", facing.mass, at))
        around = facing.nodal.around
        by = ratio(np.ones_like(around), around)
        return np.asarray(self.faces.kept * by[:, None] * sums)[: self.number]

    def _at_corners(self, tractions: Array) -> Array:
        """Return tractions at corners of pieces (p, a, dim) from those at the owned points."""
        alive = np.where(self.absent[:, None], 0.0, tractions)
        alive = self.faces.vertices.from_owners(alive)
        return np.asarray(alive[self.faces.corners[self.facing.facet]])

    def _parts(self, v: Array) -> tuple[Array, Array, Array]:
        """Return displacements of slave and master at pieces, and changes of nodal vectors m."""
        faces = self.faces
        facing = self.facing
        mine = faces.of_slave(v)
        by_facet = np.einsum("nikj,nkj->ni", faces.normal_rates(self.x), mine)
        m = faces.at_nodes(by_facet)
        theirs = faces.master.vectors(v, facing.found)
        return mine[facing.facet], m, theirs[facing.master]

    def _means(self, parts: Array) -> Array:
        """Return weighted means at local vertices of weighted parts at corners (p, a, ...)."""
        sums = self.faces.sums(self.facing.facet, parts)
        return np.asarray((self.facing.nodal.inverse * sums.T).T)

    def apply(self, v: Array) -> Array:
        facing = self.facing
        mine, _, theirs = self._parts(v)
        jump = np.einsum("pqa,pad->pqd", facing.basis, mine)
        jump -= np.einsum("pqb,pbd->pqd", facing.rays.weights, theirs)
        parts = np.einsum("pqa,pqd->pad", facing.weighted, jump)
        return self._means(parts)[: self.number]

    def scalar_matrix(self, comm: MPI.Comm, nodes: int) -> PETSc.Mat:
        facing = self.facing
        faces = self.faces
        both = np.concatenate([facing.basis, -facing.rays.weights], axis=2)
        values = facing.nodal.inverse[faces.corners[facing.facet]][:, :, None] * (
            facing.weighted.transpose(0, 2, 1) @ both
        )
        vertices = faces.slave_vertices[facing.facet][:, :, None]
        bodies = np.concatenate([faces.slave_nodes[facing.facet], facing.master_nodes], axis=1)
        rows = np.broadcast_to(vertices, values.shape).reshape(-1)
        columns = np.broadcast_to(bodies[:, None], values.shape).reshape(-1)
        entries = Entries(rows, columns)
        B = matrix_of(comm, (self.number, nodes), entries)
        entries.add(values.reshape(-1), B)
        return B

    def rate(self, v: Array) -> Array:
        """Return the derivative of the jumps without the turning normals, shape (n, dim)."""
        nodal = self.facing.nodal
        mine, m, theirs = self._parts(v)
        facing = self.facing
        place, gap = facing.moved(mine, m[self.faces.corners[facing.facet]], theirs)
        gaps = self._means(np.einsum("pqa,pq->pa", facing.weighted, gap))
        slip = np.einsum("pqa,pqadi,pqi->pad", facing.weighted, facing.along, place, optimize=True)
        slips = np.einsum("nij,nj->ni", nodal.rotation, self.faces.kept * self._means(slip))
        turned = np.einsum("nij,nj->ni", nodal.by_turning, self._normal_rate(m))
        changes = facing.weighted.sum(axis=1) * facing.spun(mine, theirs)[:, None]
        spun = self.faces.free_to_spin * self._means(changes)
        slips = slips + turned + spun[:, None] * nodal.by_spin
        return np.asarray(slips - gaps[:, None] * nodal.normal)[: self.number]

    def _normal_rate(self, m: Array) -> Array:
        return np.einsum("nij,nj->ni", self.facing.nodal.by_normal, m)

    def normal_rate(self, v: Array) -> Array:
        _, m, _ = self._parts(v)
        return self._normal_rate(m)[: self.number]

    def at_quadrature(self, tractions: Array) -> Array:
        """Return tractions (p, q, dim) from those at the owned points."""
        return np.einsum("pqa,pad->pqd", self.facing.basis, self._at_corners(tractions))

    def transpose(self, tractions: Array) -> Array:
        facing = self.facing
        t = facing.areas[..., None] * self.at_quadrature(tractions)
        mine = np.einsum("pqa,pqd->pad", facing.basis, t)
        theirs = -np.einsum("pqb,pqd->pbd", facing.rays.weights, t)
        return self.faces.forces(facing, mine, theirs)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        facing = self.facing
        mine, m, theirs = self._parts(v)
        place, _ = facing.moved(mine, m[self.faces.corners[facing.facet]], theirs)
        t = facing.areas[..., None] * self.at_quadrature(tractions)
        moving = np.einsum("pqbi,pqi->pqb", facing.rays.slopes, place)
        on_master = -np.einsum("pqb,pqd->pbd", moving, t)
        return self.faces.forces(facing, np.zeros_like(mine), on_master)

    def destroy(self) -> None:
        """Do nothing: the operator has no matrices."""
