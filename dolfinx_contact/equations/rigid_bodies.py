# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Unknowns of rigid bodies and their rows of H.

Unknowns q are displacements, and rotations times a length, the largest distance of a contact point
from the reference point. All unknowns are thus lengths and all rows forces. Rank 0 owns them, after
its other unknowns. With the forces f = B^T W t of the surfaces that touch a body,

    H_q = Phi^T f - F    where q is free,    H_q = k (q - q_prescribed)    elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._mpi import require
from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.points.rigid_body import RigidBody, number
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["RigidBodies"]

Array = npt.NDArray[np.float64]
_ASIDE = 1e-6  # cosine of motion and normal below which a body slides past a point
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
        start: unknowns at the start of a ramped motion; None outside of ramps.

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
        self._units = np.ones(self.size)  # ratio of unknowns to values
        for b, part in zip(self.bodies, self.slices, strict=True):
            self._units[part][b.dim :] = self._reach(b) or body_size
        self.start: Array | None = None

    def _reach(self, body: RigidBody) -> float:
        """Return the largest distance of a contact point from the reference point. Collective."""
        mine = [
            float(np.max(np.linalg.norm(s.positions - body.about, axis=1), initial=0.0))
            for s in self.surfaces
            if s.rigid_body is body
        ]
        return float(self.comm.allreduce(max(mine, default=0.0), op=max))

    def _number(self, body: RigidBody | None) -> int | None:
        return next((i for i, b in enumerate(self.bodies) if b is body), None)

    def slice_of(self, body: RigidBody | None) -> slice:
        """Return the slice of the unknowns of a body; empty for None."""
        number = self._number(body)
        return slice(0, 0) if number is None else self.slices[number]

    # -- values ----------------------------------------------------------------------------------

    @property
    def given(self) -> Array:
        """Unknowns of the present motions of the bodies."""
        return self._units * np.concatenate([np.zeros(0), *(b.values for b in self.bodies)])

    def show(self, q: Array) -> None:
        """Copy unknowns into the motions of the bodies."""
        for b, part in zip(self.bodies, self.slices, strict=True):
            b.values = (q / self._units)[part].copy()

    def everywhere(self, mine: Array) -> Array:
        """Return the unknowns on every rank from the owned ones. Collective."""
        if not self.size:
            return np.zeros(0)
        return np.asarray(self.comm.bcast(np.array(mine) if self.owned else None))

    def here(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Return the entries of this rank."""
        return values[: self.owned]

    def of_body(self, q: Array, body: RigidBody | None) -> Array:
        """Return displacement and rotation of a body; empty for None."""
        return np.asarray((q / self._units)[self.slice_of(body)])

    def forces_of_body(self, rows: Array, body: RigidBody) -> Array:
        """Return force and moment on a body from rows."""
        return np.asarray((rows * self._units)[self.slice_of(body)])

    # -- kinematics ------------------------------------------------------------------------------

    def relative(self, s: DiscreteSurface, u: Array, q: Array) -> Array:
        """Return displacements of local nodes (n, dim) relative to the obstacle of ``s``."""
        body = s.rigid_body
        return u if body is None else s.relative(u, self.of_body(q, body))

    def relative_rate(self, s: DiscreteSurface, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """Return the derivative of `relative` along ``du`` (n, dim) and ``dq`` at a state."""
        body = s.rigid_body
        motions = self.of_body(q, body), du, self.of_body(dq, body)
        return s.relative_rate(u, *motions)

    def spin(self, s: DiscreteSurface, q: Array, dq: Array) -> Array | None:
        """Return the spin of the frame of ``s`` along ``dq``; None if it does not turn."""
        body = s.rigid_body
        if body is None or not s.turns:
            return None
        return np.asarray(body.spin(self.of_body(q, body)) @ self.of_body(dq, body)[s.dim :])

    def conjugate(self, q: Array, pushes: Array) -> Array:
        """Return forces conjugate to the unknowns from forces and moments in their rows."""
        found = pushes.copy()
        for b, part in zip(self.bodies, self.slices, strict=True):
            if any(s.turns and s.rigid_body is b for s in self.surfaces):
                found[part][b.dim :] = b.spin(self.of_body(q, b)).T @ pushes[part][b.dim :]
        return found

    def reactions(self, s: DiscreteSurface, forces: Array, u: Array, q: Array) -> Array:
        """Return the part of this rank of Phi^T f for the forces f of ``s`` on owned nodes.

        On a curved obstacle in large sliding, moments are taken in the displaced position.
        """
        rows = np.zeros(self.size)
        body = s.rigid_body
        if body is not None:
            x = s.node_positions[: s.owned_nodes]
            part = self.slice_of(body)
            moved = None
            if s.displaced is not None:
                x = x + u.reshape(-1, s.dim)[: s.owned_nodes]
                moved = self.of_body(q, body)[: s.dim]
            found = body.resultant(x, forces.reshape(-1, s.dim), moved)
            rows[part] = found / self._units[part]
            if s.axisymmetric:  # other components cancel around the axis
                rows[part][[0, 2]] = 0.0
        return rows

    def at_points(self, s: DiscreteSurface) -> Array:
        """Return Phi, motions of the points of ``s`` by unknown, shape (n, dim, k). Collective."""
        body = s.rigid_body
        part = self.slice_of(body)
        width = part.stop - part.start
        moved = np.zeros((s.points.number, s.dim, width))
        if body is None:
            return moved
        operator = s.constant_operator("a rigid body that moves")
        x = s.node_positions[: s.owned_nodes]
        for k, unit in enumerate(np.diag(1.0 / self._units[part])):
            moved[:, :, k] = operator.apply(body.field(x, unit))
        return moved

    def nearest(self, gaps: Sequence[Array]) -> list[float]:
        """Return for each surface the smallest gap to its rigid body. Collective.

        It is minus infinity without a rigid body or if the motion is prescribed.
        """
        smallest = []
        for b in self.bodies:
            mine = [
                float(np.min(gap, initial=np.inf))
                for s, gap in zip(self.surfaces, gaps, strict=True)
                if s.rigid_body is b
            ]
            found = self.comm.allreduce(min(mine), op=min)
            smallest.append(-np.inf if b.fixed.all() else found)
        number = [self._number(s.rigid_body) for s in self.surfaces]
        return [-np.inf if i is None else smallest[i] for i in number]

    def directions(self) -> Array:
        """Return unit translations along the loads on free components, 0 without loads."""
        loads = self.loads()
        found = np.zeros(self.size)
        for b, part in zip(self.bodies, self.slices, strict=True):
            along = loads[part][: b.dim]
            size = float(np.linalg.norm(along))
            if size > 0:
                found[part][: b.dim] = along / size
        return found

    def free_distances(self, gaps: Sequence[Array], rates: Sequence[Array]) -> Array:
        """Return for each unknown the distance to contact: 0 in contact or without an obstacle.

        Collective.

        Args:
            gaps: gaps at the points of every surface.
            rates: rates at which a unit motion closes the gaps.
        """
        distances = np.zeros(self.size)
        for b, part in zip(self.bodies, self.slices, strict=True):
            nearest = np.inf
            least = np.inf
            for s, gap, rate in zip(self.surfaces, gaps, rates, strict=True):
                if s.rigid_body is b:
                    nearest = min(nearest, float(np.min(gap, initial=np.inf)))
                    ahead = rate > _ASIDE
                    least = min(least, float(np.min(gap[ahead] / rate[ahead], initial=np.inf)))
            nearest, least = (self.comm.allreduce(v, op=min) for v in (nearest, least))
            if nearest > 0 and np.isfinite(least):
                distances[part] = least
        return distances

    def jump_matrix(self, s: DiscreteSurface) -> PETSc.Mat:
        """Return -Phi as a matrix from all unknowns to jumps at points of ``s``. Collective."""
        moved = self.at_points(s)
        part = self.slice_of(s.rigid_body)
        n = s.points.number * s.dim
        first = s.constant_operator("the condensed problem").B.getOwnershipRange()[0]
        columns = np.arange(part.start, part.stop)
        rows = np.broadcast_to(first + np.arange(n)[:, None], (n, len(columns)))
        places = np.broadcast_to(columns, rows.shape)
        entries = Entries(rows.reshape(-1), places.reshape(-1))
        A = matrix_of(self.comm, (n, self.owned), entries)
        entries.add(-moved.reshape(-1), A)
        return A

    def diagonal(self, value: float) -> PETSc.Mat:
        """Return a diagonal matrix with ``value`` at prescribed unknowns, else 0. Collective."""
        mine = np.arange(self.owned)
        entries = Entries(mine, mine)
        A = matrix_of(self.comm, (self.owned, self.owned), entries)
        entries.add(np.where(self.here(self.fixed), value, 0.0), A)
        return A

    # -- data ------------------------------------------------------------------------------------

    def numbers(self) -> Array:
        """Return the loads and motions prescribed by the user."""
        return np.concatenate([np.zeros(0), *(b.numbers() for b in self.bodies)])

    def loads(self) -> Array:
        """Return the loads F, 0 where the motion is prescribed."""
        return np.where(self.fixed, 0.0, self.numbers() / self._units)

    def prescribed(self, part: float) -> Array:
        """Return the prescribed unknowns, 0 where they are free.

        Args:
            part: part of the way from `start` to the user's motion, if there is a start.
        """
        values = self.numbers() * self._units
        if self.start is not None:
            values = self.start + part * (values - self.start)
        return np.where(self.fixed, values, 0.0)

    def rates(self, expressions: Sequence[object]) -> tuple[Array, Array]:
        """Return the rates of `loads` and of `prescribed` from those of all expressions."""
        values = np.array([number(e) for e in expressions])
        loads = np.where(self.fixed, 0.0, values / self._units)
        return loads, np.where(self.fixed, values * self._units, 0.0)

    def names(self, motions: Array) -> str:
        """Return the names of the components that take part in motions (k, size)."""
        size = np.abs(motions).max(axis=0, initial=0.0)
        words = [
            f"{'translation' if len(c) == 1 else 'rotation about'} {c[-1]} of {b.name}"
            for b in self.bodies
            for c in b.components
        ]
        return ", ".join(w for w, v in zip(words, size, strict=True) if v > 1e-6)
