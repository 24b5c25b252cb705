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

__all__ = ["ContactState", "Evaluation", "Statuses", "differs"]

Array = npt.NDArray[np.float64]
#: Status codes of the contact points of this rank, surface by surface.
Statuses = Sequence[npt.NDArray[np.int8]]


@dataclass(frozen=True, eq=False)
class ContactState:
    """Evaluation of one contact surface: its n contact points on this rank.

    The *answer* tau of the law is the traction that it requires for jump j and traction t.

    Attributes:
        kinematics: gap, slip and operator B.
        traction: contact traction t on the body, a stress, shape (n, dim).
        statuses: status codes with which the law was evaluated, shape (n,).
        answers: answers of the law for every status.
    """

    kinematics: Kinematics
    traction: Array
    statuses: npt.NDArray[np.int8]
    answers: Answers

    @property
    def jump(self) -> Array:
        """Jump j in the law, after subtracting the memory of the slip, shape (n, dim)."""
        return self.kinematics.jump

    @property
    def data(self) -> PointData:
        """Data of the law at the points, including normals and gaps."""
        return self.kinematics.data

    @cached_property
    def answer(self) -> Array:
        """Traction tau required by the law, shape (n, dim)."""
        return self._present(self.answers.traction(self.statuses))

    @cached_property
    def off(self) -> Array:
        """Residual of the tractions, shape (n, dim). Collective.

        It is t - tau. At a hardly covered slave node, where the law has the weight c
        (`Operator.share`), it is c (t - tau) + (1 - c) (t - mean of t around the node).
        """
        operator = self.kinematics.operator
        off = self.traction - self.answer
        if operator.share is None:
            return off
        share = operator.share[:, None]
        rest = self.traction - operator.mean_around(self.traction)
        return self._present(share * off + (1.0 - share) * rest, self.traction)

    @cached_property
    def by_jump(self) -> Array:
        """Derivatives of the answer by the jump, shape (n, dim, dim)."""
        return self._present(self.answers.by_jump(self.statuses))

    @cached_property
    def by_traction(self) -> Array:
        """Derivatives of the answer by the traction, shape (n, dim, dim)."""
        return self._present(self.answers.by_traction(self.statuses))

    @cached_property
    def by_normal(self) -> Array:
        """Derivatives of the answer by the normal if the jump turns with it, shape (n, dim, dim).

        Laws are objective, tau(R j, R t; R n) = R tau. Hence for the rotation vector w = n x dn of
        a change dn of the normal

            dtau = w x tau - dtau/dt (w x t).
        """
        n = self.data.n
        turned = _turning(n, self.answer) - self.by_traction @ _turning(n, self.traction)
        return np.asarray(turned)

    def _present(self, values: Array, other: Array | float = 0.0) -> Array:
        """Values, replaced by ``other`` at points without an opposing point."""
        absent = self.kinematics.operator.absent
        if absent is None:
            return values
        return np.where(absent.reshape(-1, *np.ones(values.ndim - 1, dtype=int)), other, values)

    @cached_property
    def by_around(self) -> Array:
        """Derivatives of the answer of a nonlocal law by the averaged quantity, shape (n, dim)."""
        return self.answers.by_around(self.statuses)

    @property
    def spread_by(self) -> tuple[Array, Array]:
        """Derivatives of the averaged quantity by jump and traction, shape (n, dim) each."""
        assert self.answers.spreading is not None
        return self.answers.spreading.by_jump, self.answers.spreading.by_traction

    def along(self, step: Array) -> Array:
        """Derivative of the answer along a step of the jumps, shape (n, dim). Collective."""
        rate = np.einsum("nij,nj->ni", self.by_jump, step)
        if self.answers.spreading is not None:
            around = self.answers.spreading(np.sum(self.spread_by[0] * step, axis=1))
            rate += self.by_around * around[:, None]
        return rate

    def change(self, v: Array) -> Array:
        """Derivative of -`off` along a displacement v, shape (nodes, dim). Collective."""
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
        unknowns: owned unknowns, in the units of the PETSc vectors.
        u: displacement at all local dofs, including ghosts, a length.
        q: unknowns of the rigid bodies, on every rank (`rigid_bodies`).
        surfaces: evaluations of the contact surfaces.
        rows: owned rows of H: displacement, surface by surface, rigid bodies; including Dirichlet
            rows and rows of removed multipliers.
        reactions: owned rows of the displacement before Dirichlet rows are inserted, i.e. support
            forces on Dirichlet dofs.
        pushes: contact forces on the rigid bodies, in the units of their rows, on every rank.
    """

    unknowns: Array
    u: Array
    q: Array
    surfaces: Sequence[ContactState]
    rows: Sequence[Array] = ()
    reactions: Array | None = None
    pushes: Array | None = None

    @property
    def statuses(self) -> Statuses:
        """Status codes with which the laws were evaluated."""
        return [s.statuses for s in self.surfaces]


def _turning(n: Array, v: Array) -> Array:
    """Matrices of dn -> (n x dn) x v = dn (n.v) - n (dn.v), shape (n, dim, dim)."""
    along = np.sum(n * v, axis=1)[:, None, None]
    return np.asarray(along * np.eye(n.shape[1]) - n[:, :, None] * v[:, None])


def differs(a: Statuses, b: Statuses) -> list[npt.NDArray[np.bool_]]:
    """Return masks of the points whose statuses differ, surface by surface."""
    return [np.asarray(x != y) for x, y in zip(a, b, strict=True)]
