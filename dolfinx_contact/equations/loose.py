# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid motions that contact has to hold: of bodies without supports, and of rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.body import rigid
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.equations.state import State, Statuses
from dolfinx_contact.laws.status import STICK, closed, senses
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["LooseMotions"]

Array = npt.NDArray[np.float64]


class LooseMotions:
    """Motions that neither stiffness nor prescribed data resist, and which of them statuses hold.

    Args:
        K: stiffness of the body without Dirichlet rows; None if its mass resists all motions.
        V: displacement space.
        surfaces: where contact may hold.
        fixed: local nodes x dim, components that Dirichlet data fix.
        bodies: the rigid bodies. Collective, as everything here.
        axisymmetric: whether the body is one of revolution.

    Attributes:
        of_body: motions of elastic bodies, at the local nodes (motions, nodes, dim).
    """

    def __init__(
        self,
        K: PETSc.Mat | None,
        V: fem.FunctionSpace,
        surfaces: Sequence[ContactSurface],
        fixed: npt.NDArray[np.bool_],
        bodies: RigidBodies,
        *,
        axisymmetric: bool = False,
    ):
        self._V = V
        self._surfaces = list(surfaces)
        self._bodies = bodies
        self._axisymmetric = axisymmetric
        none = np.zeros((0, *fixed.shape))
        self.of_body = (
            none if K is None else rigid.free_motions(K, V, fixed, axisymmetric=axisymmetric)
        )
        self._free = np.flatnonzero(~bodies.fixed)
        #: Jumps at the points by each motion (motions, n, dim), those of the rigid bodies last.
        self._jumps = [
            np.concatenate([self._by_body(s), self._by_rigid_bodies(s)]) for s in surfaces
        ]

    def _by_body(self, s: ContactSurface) -> Array:
        jumps = np.zeros((len(self.of_body), s.points.number, s.dim))
        if not len(self.of_body):
            return jumps
        operator = s._constant_operator("a body that Dirichlet data do not hold")
        for i in range(len(self.of_body)):
            jumps[i] = operator.apply(self.of_body[i, : s.owned_nodes])
        return jumps

    def _by_rigid_bodies(self, s: ContactSurface) -> Array:
        jumps = np.zeros((self._bodies.size, s.points.number, s.dim))
        jumps[self._bodies.slice_of(s.rigid_body)] = -np.moveaxis(self._bodies.at_points(s), 2, 0)
        return jumps[self._free]

    def not_held(self, statuses: Statuses, state: State | None = None) -> str:
        """The motions that these statuses do not hold, in words; "" if there are none.

        A point that slips in 3D holds across the direction of its shear, which turns with the
        motion; where friction creeps every closed point holds.

        Args:
            statuses: of the points.
            state: that has the shear; without one only points that stick hold.
        """
        count = len(self.of_body)
        number = count + len(self._free)
        if number == 0:
            return ""
        gram = np.zeros((number, number))
        for i, (s, codes, jumps) in enumerate(
            zip(self._surfaces, statuses, self._jumps, strict=True)
        ):
            n = s.points.data.n if state is None else state.surfaces[i].data.n
            normal = np.einsum("and,nd->an", jumps, n)
            along = jumps - normal[:, :, None] * n[None]
            grips = closed(codes) if s.law.creeps else senses(codes) == STICK
            if state is not None and s.dim == 3:
                shear = _direction(state.surfaces[i].traction, n)
                slips = ~grips & closed(codes) & shear.any(axis=1)
                across = np.where(slips[:, None], shear, 0.0)
                along -= np.einsum("and,nd->an", along, across)[:, :, None] * across[None]
                grips |= slips
            along *= grips[None, :, None]
            gram += (normal * closed(codes)) @ normal.T + np.einsum("and,bnd->ab", along, along)
        loose = rigid.loose(self._V.mesh.comm.allreduce(gram))
        words = []
        if np.any(np.abs(loose[:, :count]) > _SHARE):
            body = np.einsum("ab,bnd->and", loose[:, :count], self.of_body)
            words.append(rigid.describe(body, self._V, axisymmetric=self._axisymmetric))
        rest = np.zeros((len(loose), self._bodies.size))
        rest[:, self._free] = loose[:, count:]
        if np.any(np.abs(rest) > _SHARE):
            words.append(self._bodies.names(rest))
        return ", ".join(words)


def _direction(traction: Array, n: Array) -> Array:
    """Unit vectors along the shear (n, dim), zero where there is none."""
    shear = traction - np.sum(traction * n, axis=1)[:, None] * n
    size = np.linalg.norm(shear, axis=1, keepdims=True)
    least = _ROUND_OFF * np.linalg.norm(traction, axis=1, keepdims=True)
    return np.divide(shear, size, out=np.zeros_like(shear), where=size > least)


_ROUND_OFF = 1e-12  # of the traction, a shear that has no direction
_SHARE = 1e-6  # of a motion, below which a component has no part in it
