# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quantities derived from the stiffness of a body: typical size, augmentation, loose motions.

Loose motions are rigid motions of bodies without supports, and of rigid bodies, that contact must
restrain.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import dot, tangential
from dolfinx_contact._mpi import require, total
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.body.rigid import Parts, loose
from dolfinx_contact.equations.evaluation import (
    Evaluation,
    RigidTerm,
    Statuses,
    SurfaceTerm,
)
from dolfinx_contact.equations.unknowns import RigidBodies
from dolfinx_contact.laws.status import STICK, closed, senses
from dolfinx_contact.points.surface import DiscreteSurface

if TYPE_CHECKING:
    from dolfinx_contact.body.moving import MovingBody

__all__ = ["Scaling"]

_ROUND_OFF = 1e-12  # shear, relative to the traction, that has no direction
#: Ratio of r to the stiffness of a node for sliding faces, whose slips of a facet per step are far
#: beyond those of small sliding. Shallow ironing: between 0.17 and 1.7 steps take 6 iterations,
#: below 0.1 points change status in a cycle (measured).
_SLIDING = 0.5
_SHARE = 1e-6  # part of a motion below which a component does not take part in it


class Scaling:
    """Typical stiffness, augmentation parameters and loose motions. Methods are collective.

    Args:
        bulk: discrete body.
        V: space of its displacement.
        terms: terms of the contact surfaces, which receive their r.
        fixed: mask of components fixed by Dirichlet data, shape (local nodes, dim).
        bodies: rigid bodies.
        forced_r: augmentation parameter; None for the automatic one.

    Attributes:
        stiffness: mean diagonal entry of the stiffness, factor of the Dirichlet rows.
        softness: smallest softness of a connected part of the body (`Parts.softness`).
        automatic_r: automatic r at the local vertices of each surface.
        at_vertices: stiffness per area of the nodes at the local vertices of each surface.
        parts: connected parts of the body.
        loose: rigid motions of deformable bodies restrained neither by stiffness nor by Dirichlet
            data, at the local nodes, shape (motions, nodes, dim).

    Raises:
        ValueError: on every rank, if the stiffness is zero or not finite.
    """

    def __init__(
        self,
        bulk: Bulk | MovingBody,
        V: fem.FunctionSpace,
        terms: Sequence[SurfaceTerm],
        fixed: Mask,
        bodies: RigidBodies,
        forced_r: float | None,
    ):
        self._bulk = bulk
        self._V = V
        self._terms = list(terms)
        self._surfaces = [term.surface for term in terms]
        self._fixed = fixed
        self._bodies = bodies
        self.parts = Parts(V, axisymmetric=self._surfaces[0].axisymmetric)
        self._extents = self.parts.extents()[self.parts.of_nodes]
        self._forced = forced_r
        self._mark = -1
        self.follow(bulk.displacement.x.array.copy())

    def follow(self, u: Array) -> bool:
        """Compute the scales again if the data of the stiffness have changed.

        For a nonlinear body, the scales are computed at ``u``, the displacement at all local dofs.

        Returns:
            Whether the scales, and with them H, have changed.
        """
        if self._bulk.stiffness_mark == self._mark:
            return False
        K = self._bulk.stiffness(u)
        self.parts.require_hoop_stiffness(K)
        # the augmentation parameter, from the softness of every connected part
        soft = self.parts.softness(K)
        self.softness = float(soft.min())
        self._measure(K, soft[self.parts.of_nodes])
        self._augment(self._forced)
        # loose motions, rigid bodies last, and the jumps at the points by each of them
        self.loose = np.zeros((0, *self._fixed.shape))
        if not self._bulk.has_mass:  # mass resists all motions
            self.loose = self.parts.free_motions(K, self._fixed)
        self._jumps = [self._jumps_at(term) for term in self._terms]
        self._mark = self._bulk.stiffness_mark
        return True

    # -- augmentation ----------------------------------------------------------------------------

    @contextmanager
    def automatic(self) -> Iterator[None]:
        """Context manager that applies the automatic augmentation parameter within the context."""
        self._augment(None)
        try:
            yield
        finally:
            self._augment(self._forced)

    def _augment(self, forced: float | None) -> None:
        """Set the augmentation parameter on all surfaces; None: the automatic parameter."""
        for s, r in zip(self._surfaces, self.automatic_r, strict=True):
            s.points.set_augmentation(r if forced is None else np.full_like(r, forced))

    def _measure(self, K: PETSc.Mat, soft: Array) -> None:
        """Compute the typical stiffness, and r and stiffness at the vertices.

        The stiffness of a vertex is the stiffness of its node, with all other nodes fixed, divided
        by the area: a traction divided by this stiffness is the displacement that the traction
        would cause.

        The automatic r is close to Young's modulus divided by the size of the touching part of the
        body, taken from the diagonal of the stiffness; in a pair, both bodies act in series. With a
        small r, a point slipping in the wrong direction sticks in the next iterate; with a large r
        (such as the nodal stiffness) it slips in the opposite direction, and Newton's method
        cycles. For a nearly incompressible body the diagonal of the stiffness is dominated by the
        bulk modulus, whereas contact mainly causes shear. Above a Poisson's ratio of 0.4, r
        therefore decreases with the square root of the softness, to a value between the two
        stiffnesses. At 0.499, full steps then converge that cycled otherwise (measured). Sliding
        faces need an r close to the stiffness of a node.

        Raises:
            ValueError: if the stiffness is zero or not finite.
        """
        V = self._V
        bs = V.dofmap.index_map_bs
        n = V.dofmap.index_map.size_local * bs
        diagonal = fem.Function(V)
        diagonal.x.array[:n] = np.abs(K.getDiagonal().array)
        diagonal.x.scatter_forward()
        size = float(total(V.mesh.comm, np.sum(diagonal.x.array[:n])))
        require(
            V.mesh.comm,
            bool(np.isfinite(size)) and size > 0,
            "the stiffness of the bulk is zero or not finite at the starting displacement",
        )
        self.stiffness = size / (V.dofmap.index_map.size_global * bs)
        per_node = diagonal.x.array.reshape(-1, bs).mean(axis=1)
        share = np.sqrt(np.minimum(2.0 * soft, 1.0))
        self.automatic_r: list[Array] = []
        self.at_vertices: list[Array] = []
        for s in self._surfaces:
            geometry = s.points.geometry
            nodes = s.points.vertex_nodes
            stiffness = _in_series(per_node, s)[nodes] / geometry.vertex_areas
            self.at_vertices.append(stiffness)
            if s.slides:
                self.automatic_r.append(_SLIDING * stiffness)
                continue
            width = (geometry.vertex_areas / geometry.circumferences) ** (1 / (s.dim - 1))
            whole = _in_series(share * per_node / self._extents, s)[nodes]
            self.automatic_r.append(width * whole / geometry.vertex_areas)

    # -- loose motions ---------------------------------------------------------------------------

    def _jumps_at(self, term: SurfaceTerm) -> Array:
        """Return the jumps at the points for each loose motion, shape (motions, n, dim).

        Loose motions of deformable bodies precede free components of rigid bodies.
        """
        s = term.surface
        number = len(self.loose)
        jumps = np.zeros((number + self._bodies.size, s.points.number, s.dim))
        for i in range(number):
            jumps[i] = s.points.operator.apply(self.loose[i, : s.owned_nodes])
        if isinstance(term, RigidTerm):
            jumps[number:][term.motion_slice] = -np.moveaxis(term.motions_at_points(), 2, 0)
        return np.delete(jumps, number + np.flatnonzero(self._bodies.fixed), axis=0)

    def unrestrained_motions(self, statuses: Statuses, evaluation: Evaluation | None = None) -> str:
        """Return the names of rigid motions not prevented by contact with given statuses, or "".

        In 3D a slipping point resists motions perpendicular to its shear, because the shear turns
        with them. With creeping friction, every closed point resists tangential motions.

        Args:
            statuses: statuses of the points.
            evaluation: evaluation containing the shear; None: only sticking points resist
                tangential motions.
        """
        count = len(self.loose)
        free = np.flatnonzero(~self._bodies.fixed)
        number = count + len(free)
        if number == 0:
            return ""
        gram = np.zeros((number, number))
        for i, (s, codes, jumps) in enumerate(
            zip(self._surfaces, statuses, self._jumps, strict=True)
        ):
            n = s.points.data.n if evaluation is None else evaluation.surfaces[i].data.n
            normal = dot(jumps, n)
            along = tangential(jumps, n)
            grips = closed(codes) if s.law.creeps else senses(codes) == STICK
            if evaluation is not None and s.dim == 3:
                shear = _direction(evaluation.surfaces[i].law_traction, n)
                slips = ~grips & closed(codes) & shear.any(axis=1)
                across = np.where(slips[:, None], shear, 0.0)
                along = tangential(along, across)
                grips |= slips
            along *= grips[None, :, None]
            gram += (normal * closed(codes)) @ normal.T + np.einsum("and,bnd->ab", along, along)
        moving = loose(total(self._V.mesh.comm, gram))
        words = []
        if np.any(np.abs(moving[:, :count]) > _SHARE):
            body = np.einsum("ab,bnd->and", moving[:, :count], self.loose)
            words.append(self.parts.describe(body))
        rest = np.zeros((len(moving), self._bodies.size))
        rest[:, free] = moving[:, count:]
        if np.any(np.abs(rest) > _SHARE):
            words.append(self._bodies.names(rest))
        return ", ".join(words)


def _in_series(stiffness: Array, s: DiscreteSurface) -> Array:
    """Return the stiffness of each local node in series with its opposing point, shape (nodes,).

    The stiffness of the opposing point is a sum over nodes with the sizes of their weights: some
    weights of a mortar are negative, and with them the sum may vanish.
    """
    opposite = s.obstacle.opposite
    if opposite is None:
        return stiffness
    other = opposite.values(s.comm, stiffness[: s.owned_nodes], sizes=True)
    return np.divide(stiffness * other, stiffness + other, where=other > 0, out=stiffness.copy())


def _direction(traction: Array, n: Array) -> Array:
    """Return unit vectors along the shear of tractions, 0 without shear, shape (n, dim)."""
    shear = tangential(traction, n)
    size = np.linalg.norm(shear, axis=1, keepdims=True)
    least = _ROUND_OFF * np.linalg.norm(traction, axis=1, keepdims=True)
    return np.divide(shear, size, out=np.zeros_like(shear), where=size > least)
