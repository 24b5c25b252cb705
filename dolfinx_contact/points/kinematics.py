# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Gap, slip and B of a surface or pair at a state, and how they change with the displacement.

With the jump j that laws see, the normal n and the gap g_0 that the law is given, both of which may
follow j on a curved obstacle (`points.displaced`),

    gap = g_0 - j.n,    slip = j - (j.n) n,

and along a displacement v, with the change dj of the jump (`points.operators`),

    d gap  = (dg_0/dj - n - (dn/dj)^T j) . dj,
    d slip = dj - (dj.n + j.dn) n - (j.n) dn,    dn = (dn/dj) dj.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws import PointData
from dolfinx_contact.points.operators import Operator

__all__ = ["Kinematics"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Kinematics:
    """The contact points of this rank at a state.

    Attributes:
        operator: B there.
        jump: j of the displacement as laws see it (n, dim).
        reference: what laws do not see of it, as memory has it (n, dim).
        data: what the law is given, normals and gaps there.
    """

    operator: Operator
    jump: Array
    reference: Array
    data: PointData

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
    def gap_slope(self) -> Array:
        """Derivatives of the gaps by the jumps (n, dim)."""
        data = self.data
        if data.turn is None or data.slope is None:
            return -data.n
        return np.asarray(data.slope - data.n - np.einsum("nij,ni->nj", data.turn, self.jump))

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
        along = np.sum(step * n, axis=1)
        if self.data.turn is None:
            return np.asarray(step - along[:, None] * n)
        turned = np.einsum("nij,nj->ni", self.data.turn, step)
        along += np.sum(self.jump * turned, axis=1)
        depth = np.sum(self.jump * n, axis=1)
        return np.asarray(step - along[:, None] * n - depth[:, None] * turned)
