# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The unknowns of rigid bodies, and their rows of H.

Unknowns q are displacements and rotations times a length, the largest distance of a contact point
from the reference point: so all have one unit, and all rows that of a force. Rank 0 has them, after
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

from dolfinx_contact._entries import Entries, matrix_of
from dolfinx_contact._errors import require
from dolfinx_contact.points.rigid_body import RigidBody, number
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["RigidBodies"]

Array = npt.NDArray[np.float64]
_ASIDE = 1e-6  # cosine of motion and normal, below which a body slides past a point
T = TypeVar("T", bound=np.generic)


class RigidBodies:
    """The rigid bodies that surfaces touch. What they know is the same on every rank.

    Args:
        V: displacement space.
        surfaces: of the contact problem.
        body_size: of the deformable bodies, the length where no other is known.

    Attributes:
        bodies: in the order of the surfaces.
        size: number of unknowns.
        owned: of these on this rank.
        fixed: which of them are prescribed.
        start: unknowns from which a part of the prescribed motion is counted; None without one.

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
        self._units = np.ones(self.size)  # unknowns over values
        for b, part in zip(self.bodies, self.slices, strict=True):
            self._units[part][b.dim :] = self._reach(b) or body_size
        self.start: Array | None = None

    def _reach(self, body: RigidBody) -> float:
        """Largest distance of a contact point from the reference point. Collective."""
        mine = [
            float(np.max(np.linalg.norm(s.positions - body.about, axis=1), initial=0.0))
            for s in self.surfaces
            if s.rigid_body is body
        ]
        return float(self.comm.allreduce(max(mine, default=0.0), op=max))

    def _number(self, body: RigidBody | None) -> int | None:
        return next((i for i, b in enumerate(self.bodies) if b is body), None)

    def slice_of(self, body: RigidBody | None) -> slice:
        """Places of the unknowns of a body; empty for None."""
        number = self._number(body)
        return slice(0, 0) if number is None else self.slices[number]

    # -- values ----------------------------------------------------------------------------------

    @property
    def given(self) -> Array:
        """Unknowns that stand in the bodies."""
        return self._units * np.concatenate([np.zeros(0), *(b.values for b in self.bodies)])

    def show(self, q: Array) -> None:
        """Put unknowns into the bodies."""
        for b, part in zip(self.bodies, self.slices, strict=True):
            b.values = (q / self._units)[part].copy()

    def everywhere(self, mine: Array) -> Array:
        """Unknowns on every rank, of those of this rank. Collective."""
        if not self.size:
            return np.zeros(0)
        return np.asarray(self.comm.bcast(np.array(mine) if self.owned else None))

    def here(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Those of this rank."""
        return values[: self.owned]

    def of_body(self, q: Array, body: RigidBody | None) -> Array:
        """Displacement and rotation of a body; nothing for None."""
        return np.asarray((q / self._units)[self.slice_of(body)])

    def forces_of_body(self, rows: Array, body: RigidBody) -> Array:
        """Force and moment on a body, of rows."""
        return np.asarray((rows * self._units)[self.slice_of(body)])

    # -- kinematics ------------------------------------------------------------------------------

    def relative(self, s: DiscreteSurface, u: Array, q: Array) -> Array:
        """Displacements (n, dim) at the first local nodes, seen from what ``s`` touches."""
        body = s.rigid_body
        return u if body is None else s.relative(u, self.of_body(q, body))

    def relative_rate(self, s: DiscreteSurface, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """The derivative of `relative` along ``du`` (n, dim) and ``dq``, at a state."""
        body = s.rigid_body
        motions = self.of_body(q, body), du, self.of_body(dq, body)
        return s.relative_rate(u, *motions)

    def spin(self, s: DiscreteSurface, q: Array, dq: Array) -> Array | None:
        """At what rate the frame of ``s`` turns along ``dq``; None where frames do not."""
        body = s.rigid_body
        if body is None or not s.turns:
            return None
        return np.asarray(body.spin(self.of_body(q, body)) @ self.of_body(dq, body)[s.dim :])

    def conjugate(self, q: Array, pushes: Array) -> Array:
        """What does work on changes of the unknowns, of forces and moments in their rows."""
        found = pushes.copy()
        for b, part in zip(self.bodies, self.slices, strict=True):
            if any(s.turns and s.rigid_body is b for s in self.surfaces):
                found[part][b.dim :] = b.spin(self.of_body(q, b)).T @ pushes[part][b.dim :]
        return found

    def reactions(self, s: DiscreteSurface, forces: Array, u: Array, q: Array) -> Array:
        """This rank's part of Phi^T f by the forces B^T W t of ``s`` on its owned nodes.

        On a curved obstacle in large sliding moments are those where the body is.
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
            if s.axisymmetric:  # around the axis all else cancels
                rows[part][[0, 2]] = 0.0
        return rows

    def at_points(self, s: DiscreteSurface) -> Array:
        """Phi by the unknowns of what ``s`` touches, at its points (n, dim, k). Collective."""
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
        """By surface, the smallest gap of all that touch its rigid body. Collective.

        Minus infinity where there is none, or its motion is prescribed.
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
        """Unit translations along the loads on free components, zero where there are none."""
        loads = self.loads()
        found = np.zeros(self.size)
        for b, part in zip(self.bodies, self.slices, strict=True):
            along = loads[part][: b.dim]
            size = float(np.linalg.norm(along))
            if size > 0:
                found[part][: b.dim] = along / size
        return found

    def free_distances(self, gaps: Sequence[Array], rates: Sequence[Array]) -> Array:
        """How far each body may go before it touches, by unknown: 0 if it does, or never will.

        Args:
            gaps: at the points of every surface.
            rates: at which a unit motion closes them. Collective.
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
        """-Phi: jumps at the points of ``s`` by all unknowns. Collective."""
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
        """A diagonal matrix with ``value`` where the motion is prescribed, else 0. Collective."""
        mine = np.arange(self.owned)
        entries = Entries(mine, mine)
        A = matrix_of(self.comm, (self.owned, self.owned), entries)
        entries.add(np.where(self.here(self.fixed), value, 0.0), A)
        return A

    # -- what is given ---------------------------------------------------------------------------

    def numbers(self) -> Array:
        """Loads and motions as the user gives them."""
        return np.concatenate([np.zeros(0), *(b.numbers() for b in self.bodies)])

    def loads(self) -> Array:
        """F, zero where the motion is prescribed."""
        return np.where(self.fixed, 0.0, self.numbers() / self._units)

    def prescribed(self, part: float) -> Array:
        """Unknowns that are prescribed, zero where they are free.

        Args:
            part: of the way from `start` to what the user prescribes, if there is a start.
        """
        values = self.numbers() * self._units
        if self.start is not None:
            values = self.start + part * (values - self.start)
        return np.where(self.fixed, values, 0.0)

    def rates(self, expressions: Sequence[object]) -> tuple[Array, Array]:
        """Rates of `loads` and of `prescribed`, by those of all expressions."""
        values = np.array([number(e) for e in expressions])
        loads = np.where(self.fixed, 0.0, values / self._units)
        return loads, np.where(self.fixed, values * self._units, 0.0)

    def names(self, motions: Array) -> str:
        """Which components take part in motions (k, size), in words."""
        size = np.abs(motions).max(axis=0, initial=0.0)
        words = [
            f"{'translation' if len(c) == 1 else 'rotation about'} {c[-1]} of {b.name}"
            for b in self.bodies
            for c in b.components
        ]
        return ", ".join(w for w, v in zip(words, size, strict=True) if v > 1e-6)
