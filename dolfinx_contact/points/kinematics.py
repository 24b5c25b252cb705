# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Gap, slip and B of a surface or pair at a state, and how they change with the displacement.

With the jump j that laws see, the normal n and the gap g_0 that the law is given,

    gap = g_0 - j.n,    slip = j - (j.n) n.

On a curved obstacle j and n may follow the displacement of the points (`points.displaced`). Along a
displacement v, with the change dx of the points (`points.operators`), dj = (dj/dx) dx, elsewhere
dx itself, and dn = (dn/dx) dx,

    d gap  = -(dj.n + j.dn),
    d slip = dj - (dj.n + j.dn) n - (j.n) dn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws import PointData
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.operators import Operator

__all__ = ["Kinematics", "rotation"]

Array = npt.NDArray[np.float64]
_OPPOSITE = 1e-16  # 1 plus the cosine between normals, below which they are opposite


@dataclass(frozen=True, eq=False)
class Kinematics:
    """The contact points of this rank at a state.

    Attributes:
        operator: B there.
        jump: j of the displacement as laws see it (n, dim).
        reference: what laws do not see of it, as memory has it (n, dim).
        data: what the law is given, normals and gaps there.
        place: displacement of points that follow a curved obstacle, in its frame (n, dim); None of
            others.
        frame: rotation of that frame (dim, dim); None where it does not turn.
        motion: of the rigid body that it turns with (k,); None where it does not.
        memory: memory of the points by which this was evaluated; None under the static law.
    """

    operator: Operator
    jump: Array
    reference: Array
    data: PointData
    place: Array | None = None
    frame: Array | None = None
    motion: Array | None = None
    memory: Memory | None = None

    @property
    def gap(self) -> Array:
        """Gaps (n,), in the mixed method averages."""
        return np.asarray(self.data.gap - np.sum(self.jump * self.data.n, axis=1))

    @property
    def increment(self) -> Array:
        """Slips since the last accepted step (n, dim); all of them under the static law."""
        n = self.data.n
        return np.asarray(self.jump - np.sum(self.jump * n, axis=1)[:, None] * n)

    @property
    def slip(self) -> Array:
        """Slips since the reference configuration (n, dim)."""
        return self.increment + self.reference

    @property
    def whole(self) -> Array:
        """The jump as laws see it and what they do not see, in the frame of the obstacle."""
        jump = self.jump + self.reference
        return jump if self.frame is None else jump @ self.frame

    @property
    def path(self) -> tuple[Array, Array]:
        """Displacements of the points and normals, in the frame of the obstacle (n, dim)."""
        if self.place is None:
            return self.whole, self.data.n
        return self.place, self.data.n if self.frame is None else self.data.n @ self.frame

    @property
    def gap_slope(self) -> Array:
        """Derivatives of the gaps by the displacement of the points (n, dim)."""
        data = self.data
        if data.turn is None or data.moved is None:
            return -data.n
        by_jump = np.einsum("nij,ni->nj", data.moved, data.n)
        return np.asarray(-by_jump - np.einsum("nij,ni->nj", data.turn, self.jump))

    def jump_rate(self, v: Array) -> Array:
        """The derivative of the jumps along a displacement (n, dim). Collective.

        Args:
            v: as for `gap_rate`.
        """
        step = self.operator.rate(v)
        if self.data.moved is None:
            return step
        return np.einsum("nij,nj->ni", self.data.moved, step)

    def gap_rate(self, v: Array) -> Array:
        """The derivative of the gaps along a displacement (n,). Collective.

        Args:
            v: at the owned nodes, seen from the rigid body if there is one (nodes, dim).
        """
        return np.asarray(np.sum(self.gap_slope * self.operator.rate(v), axis=1))

    def slip_rate(self, v: Array) -> Array:
        """The derivative of the slips along a displacement (n, dim). Collective.

        Args:
            v: as for `gap_rate`.
        """
        n = self.data.n
        step = self.operator.rate(v)
        if self.data.turn is None or self.data.moved is None:
            return np.asarray(step - np.sum(step * n, axis=1)[:, None] * n)
        turned = np.einsum("nij,nj->ni", self.data.turn, step)
        seen = self.jump_rate(v)
        along = np.sum(seen * n, axis=1) + np.sum(self.jump * turned, axis=1)
        depth = np.sum(self.jump * n, axis=1)
        return np.asarray(seen - along[:, None] * n - depth[:, None] * turned)


def rotation(o: Array, n: Array) -> Array:
    """The smallest rotations from unit vectors o to n (..., dim), of vectors across o.

    From one to its opposite, where none is the smallest, vectors across it stay what they are.
    """
    dim = n.shape[-1]
    c = np.maximum(1.0 + np.sum(n * o, axis=-1), _OPPOSITE)
    along = np.eye(dim) - o[..., :, None] * o[..., None, :]
    turned = np.eye(dim) - ((n + o) / c[..., None])[..., :, None] * n[..., None, :]
    return np.asarray(turned @ along)
