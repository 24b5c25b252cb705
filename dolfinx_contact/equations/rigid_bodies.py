# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Rigid bodies: their unknowns, their rows of H, and the terms of the surfaces that touch them.

Unknowns q are displacements, and rotations times a length, the largest distance of a contact point
from the reference point. All unknowns are thus lengths and all rows forces. Rank 0 owns them, after
its other unknowns. With the forces f = B^T W t of the surfaces touching a body,

    H_q = Phi^T f - F    where q is free,    H_q = k (q - q_prescribed)    elsewhere,

where column k of Phi is the motion of the nodes for a unit of the unknown k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import maximum, require
from dolfinx_contact.equations.evaluation import Evaluation, Rows, SurfaceTerm
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["RigidBodies", "RigidTerm"]

T = TypeVar("T", bound=np.generic)


class RigidBodies:
    """Rigid bodies that surfaces touch. Their values are the same on every rank.

    Args:
        V: space of the displacement.
        surfaces: discretisations of the contact surfaces.
        body_size: size of the deformable bodies, a length for bodies without another one.

    Attributes:
        bodies: rigid bodies, in the order of the surfaces.
        size: number of unknowns.
        owned: number of unknowns on this rank.
        fixed: mask of the prescribed unknowns, shape (size,).
        units: ratios of unknowns to displacements and rotations, shape (size,).
        numbers: loads and motions prescribed by the user, as read by `read_data`, shape (size,).
        loads: loads F among them, in the units of their rows, 0 where the motion is prescribed.

    Raises:
        ValueError: on every rank, if two bodies have one name.
    """

    def __init__(self, V: fem.FunctionSpace, surfaces: Sequence[DiscreteSurface], body_size: float):
        self.comm = V.mesh.comm
        self.surfaces = list(surfaces)
        self.bodies: list[RigidBody] = []
        for s in surfaces:
            if s.rigid_body is not None and not any(s.rigid_body is b for b in self.bodies):
                self.bodies.append(s.rigid_body)
        names = [b.name for b in self.bodies]
        unique = len(set(names)) == len(names)
        require(self.comm, unique, f"rigid bodies need different names, got {names}")
        sizes = [len(b.components) for b in self.bodies]
        ends = np.cumsum([0, *sizes])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.size = int(ends[-1])
        self.owned = self.size if self.comm.rank == 0 else 0
        none = np.zeros(0, dtype=bool)
        self.fixed = np.concatenate([none, *(b.fixed for b in self.bodies)])
        self.units = np.ones(self.size)
        for b, part in zip(self.bodies, self.slices, strict=True):
            self.units[part][b.dim :] = self._reach(b) or body_size
        self.read_data()

    def _reach(self, body: RigidBody) -> float:
        """Return the largest distance of a contact point from the reference point. Collective."""
        touching = [s.positions for s in self.surfaces if s.rigid_body is body]
        return maximum(self.comm, np.linalg.norm(np.concatenate(touching) - body.about, axis=1))

    def slice_of(self, body: RigidBody) -> slice:
        """Return the places of the unknowns of a body."""
        pairs = zip(self.bodies, self.slices, strict=True)
        return next(part for b, part in pairs if b is body)

    # -- values ----------------------------------------------------------------------------------

    @property
    def given(self) -> Array:
        """Unknowns of the present motions of the bodies."""
        return self.units * np.concatenate([np.zeros(0), *(b.values for b in self.bodies)])

    def show(self, q: Array) -> None:
        """Copy unknowns into the motions of the bodies."""
        for b, part in zip(self.bodies, self.slices, strict=True):
            b.values = (q / self.units)[part].copy()

    def everywhere(self, mine: Array) -> Array:
        """Return the unknowns on every rank from the owned ones. Collective."""
        if not self.size:
            return np.zeros(0)
        return np.asarray(self.comm.bcast(np.array(mine) if self.owned else None))

    def here(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Return the entries of this rank."""
        return values[: self.owned]

    def of_body(self, q: Array, body: RigidBody) -> Array:
        """Return displacement and rotation of a body."""
        return np.asarray((q / self.units)[self.slice_of(body)])

    def forces_of_body(self, rows: Array, body: RigidBody) -> Array:
        """Return force and moment on a body from rows."""
        return np.asarray((rows * self.units)[self.slice_of(body)])

    def conjugate(self, q: Array, pushes: Array) -> Array:
        """Return forces conjugate to the unknowns from forces and moments in their rows."""
        found = pushes.copy()
        for b, part in zip(self.bodies, self.slices, strict=True):
            if any(s.partner.turns and s.rigid_body is b for s in self.surfaces):
                found[part][b.dim :] = (
                    b.kinematics.spin(self.of_body(q, b)).T @ pushes[part][b.dim :]
                )
        return found

    # -- data ------------------------------------------------------------------------------------

    def read_data(self) -> None:
        """Read the present loads and motions of the user."""
        self.numbers = np.concatenate([np.zeros(0), *(b.numbers() for b in self.bodies)])
        self.loads = np.where(self.fixed, 0.0, self.numbers / self.units)

    def names(self, motions: Array) -> str:
        """Return the names of the components that take part in motions (k, size)."""
        size = np.abs(motions).max(axis=0, initial=0.0)
        words = [
            f"{'translation' if len(c) == 1 else 'rotation about'} {c[-1]} of {b.name}"
            for b in self.bodies
            for c in b.components
        ]
        return ", ".join(w for w, v in zip(words, size, strict=True) if v > 1e-6)


@dataclass(frozen=True, eq=False)
class RigidTerm(SurfaceTerm):
    """Term of a surface that touches a rigid body. Methods are collective unless noted otherwise.

    It also pushes the body, H_q += Phi^T B^T W t.

    Attributes:
        bodies: rigid bodies of the problem.
    """

    bodies: RigidBodies = field(kw_only=True)

    @cached_property
    def body(self) -> RigidBody:
        """Rigid body that the surface touches."""
        assert self.surface.rigid_body is not None
        return self.surface.rigid_body

    @cached_property
    def motion_slice(self) -> slice:
        """Places of the motion of the rigid body among the unknowns q."""
        return self.bodies.slice_of(self.body)

    def motion(self, q: Array) -> Array:
        return self.bodies.of_body(q, self.body)

    def relative(self, u: Array, q: Array) -> Array:
        return self.surface.partner.relative(super().relative(u, q), self.motion(q))

    def relative_rate(self, u: Array, q: Array, du: Array, dq: Array) -> Array:
        s = self.surface
        at, step = (v.reshape(-1, s.dim)[: s.owned_nodes] for v in (u, du))
        return s.partner.relative_rate(at, self.motion(q), step, self.motion(dq))

    def motions_at_points(self) -> Array:
        """Return B Phi, motions of the points by unknown of the body, shape (n, dim, k)."""
        s = self.surface
        operator = s.constant_operator("a rigid body that moves")
        x = s.node_positions[: s.owned_nodes]
        units = np.diag(1.0 / self.bodies.units[self.motion_slice])
        fields = [operator.apply(self.body.kinematics.field(x, unit)) for unit in units]
        return np.stack(fields, axis=2)

    def pushes(self, forces: Array, u: Array, q: Array) -> Array:
        """Return the part of this rank of Phi^T f, forces on rigid bodies. Not collective.

        On a curved obstacle in large sliding, moments are taken in the displaced position.

        Args:
            forces: contact forces f on the owned nodes, shape (dim n,).
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        x = s.node_positions[: s.owned_nodes]
        moved = None
        if s.displaced is not None:
            x = x + u.reshape(-1, s.dim)[: s.owned_nodes]
            moved = self.motion(q)[: s.dim]
        found = self.body.kinematics.resultant(x, forces.reshape(-1, s.dim), moved)
        rows = np.zeros(self.bodies.size)
        rows[self.motion_slice] = found / self.bodies.units[self.motion_slice]
        if s.axisymmetric:  # other components cancel around the axis
            rows[self.motion_slice][[0, 2]] = 0.0
        return rows

    def add_forces(self, at: Evaluation, rows: Rows) -> Array:
        forces = super().add_forces(at, rows)
        rows.pushed += self.pushes(forces, at.u, at.q)
        return forces

    def add_rate(self, at: Evaluation, du: Array, dq: Array, rows: Rows) -> None:
        """See `SurfaceTerm.add_rate`.

        Jump and normal turn with the frame of the body. Laws are objective, so a rotation w adds
        w x tau - dtau/dt (w x t).
        """
        super().add_rate(at, du, dq, rows)
        if not self.surface.partner.turns:
            return
        found, rigid = at.surfaces[self.number], self.body.kinematics
        turning = rigid.spin(self.motion(at.q)) @ self.motion(dq)[self.surface.dim :]
        turned = rigid.crossed(turning, found.traction)
        back = np.einsum("nij,nj->ni", found.by_traction, turned)
        rows.laws[self.number] = (
            rows.laws[self.number] - rigid.crossed(turning, found.answer) + back
        )
