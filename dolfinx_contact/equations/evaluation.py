# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values found by one evaluation of H."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws import Answers, PointData
from dolfinx_contact.points.kinematics import Kinematics

__all__ = ["ContactState", "Evaluated", "Evaluation", "Statuses", "differs"]

Array = npt.NDArray[np.float64]
#: Numbers of the statuses of the contact points of this rank, surface by surface.
Statuses = Sequence[npt.NDArray[np.int8]]


@dataclass(frozen=True, eq=False)
class ContactState:
    """A surface at a state: its contact points of this rank.

    Attributes:
        kinematics: gap, slip and B.
        traction: t on the body (n, dim).
        statuses: by which the law was taken (n,).
        answers: of the law to jump and traction.
    """

    kinematics: Kinematics
    traction: Array
    statuses: npt.NDArray[np.int8]
    answers: Answers

    @property
    def jump(self) -> Array:
        """The jump j as the law sees it (n, dim)."""
        return self.kinematics.jump

    @property
    def data(self) -> PointData:
        """What the law was given, normals and gaps there."""
        return self.kinematics.data

    @cached_property
    def answer(self) -> Array:
        """The traction that the law allows (n, dim)."""
        return self._present(self.answers.traction(self.statuses))

    @cached_property
    def off(self) -> Array:
        """By how much the tractions are off what is required of them (n, dim). Collective."""
        operator = self.kinematics.operator
        off = self.traction - self.answer
        if operator.share is None:
            return off
        share = operator.share[:, None]
        rest = self.traction - operator.mean_around(self.traction)
        return self._present(share * off + (1.0 - share) * rest, self.traction)

    @cached_property
    def by_jump(self) -> Array:
        """Its derivatives by the jump (n, dim, dim)."""
        return self._present(self.answers.by_jump(self.statuses))

    @cached_property
    def by_traction(self) -> Array:
        """Its derivatives by the traction (n, dim, dim)."""
        return self._present(self.answers.by_traction(self.statuses))

    @cached_property
    def by_normal(self) -> Array:
        """Its derivatives by the normal, with which the jump turns (n, dim, dim).

        A law does not know directions in space, tau(R j, R t; R n) = R tau, so that of the rotation
        w x, w = n x dn, that goes with dn

            dtau = w x tau - dtau/dt (w x t).
        """
        n = self.data.n
        turned = _turning(n, self.answer) - self.by_traction @ _turning(n, self.traction)
        return np.asarray(turned)

    def _present(self, values: Array, other: Array | float = 0.0) -> Array:
        """Values at the points, others where nothing is opposite."""
        absent = self.kinematics.operator.absent
        if absent is None:
            return values
        return np.where(absent.reshape(-1, *np.ones(values.ndim - 1, dtype=int)), other, values)

    @cached_property
    def by_around(self) -> Array:
        """Its derivatives by what the points around spread, of a law that is not local (n, dim)."""
        return self.answers.by_around(self.statuses)

    @property
    def spread_by(self) -> tuple[Array, Array]:
        """Derivatives of what points spread by jump and traction (n, dim)."""
        assert self.answers.spreading is not None
        return self.answers.spreading.by_jump, self.answers.spreading.by_traction

    def along(self, step: Array) -> Array:
        """The derivative of the answer along a step of the jumps, (n, dim) both. Collective."""
        rate = np.einsum("nij,nj->ni", self.by_jump, step)
        if self.answers.spreading is not None:
            around = self.answers.spreading(np.sum(self.spread_by[0] * step, axis=1))
            rate += self.by_around * around[:, None]
        return rate

    def change(self, v: Array) -> Array:
        """The derivative of -`off` along a displacement v (nodes, dim). Collective."""
        operator = self.kinematics.operator
        rate = self.along(operator.rate(v))
        turned = operator.normal_rate(v)
        if turned is not None:
            rate += np.einsum("nij,nj->ni", self.by_normal, turned)
        return rate if operator.share is None else operator.share[:, None] * rate


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Body, contact points and rows of H at one set of unknowns.

    Attributes:
        u: displacement, all local values, ghosts included.
        q: unknowns of the rigid bodies, on every rank (`rigid_bodies`).
        surfaces: their contact points.
        rows: owned rows of H, the displacement's first, then surface by surface, those of the rigid
            bodies last; Dirichlet rows and those of removed multipliers included.
        reactions: owned rows of the displacement before Dirichlet rows were put in: forces of the
            support on Dirichlet dofs.
        pushes: contact forces on the rigid bodies, in the units of their rows, on every rank.
    """

    u: Array
    q: Array
    surfaces: Sequence[ContactState]
    rows: Sequence[Array] = ()
    reactions: Array | None = None
    pushes: Array | None = None

    @property
    def statuses(self) -> Statuses:
        """Those by which the laws were taken."""
        return [s.statuses for s in self.surfaces]


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A state that was evaluated with the data as they are, by the statuses that it determines.

    Attributes:
        unknowns: where (owned).
        state: with the rows of H.
    """

    unknowns: Array
    state: Evaluation


def _turning(n: Array, v: Array) -> Array:
    """Matrices of (n x dn) x v = dn (n.v) - n (dn.v), by dn (n, dim, dim)."""
    along = np.sum(n * v, axis=1)[:, None, None]
    return np.asarray(along * np.eye(n.shape[1]) - n[:, :, None] * v[:, None])


def differs(a: Statuses, b: Statuses) -> list[npt.NDArray[np.bool_]]:
    """Where two statuses are not the same, surface by surface."""
    return [np.asarray(x != y) for x, y in zip(a, b, strict=True)]
