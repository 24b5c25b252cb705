# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gap, slip and operator B of a surface or pair at a state, and their derivatives.

With the jump j passed to the law, the normal n and the initial gap g_0,

    gap = g_0 - j.n,    slip = j - (j.n) n.

On a curved obstacle j and n may depend on the positions x of the displaced points
(`points.displaced`). A displacement changes x by dx (`points.jump_operators`), j by dj = (dj/dx) dx
(dx where normals do not turn), n by dn = (dn/dx) dx, and the gap by

    d gap = -(dj.n + j.dn).

Displacements are relative to the obstacle of the surface (`rigid_body.Partner`), which may be a
moving rigid body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import dot, tangential
from dolfinx_contact.laws import PointData
from dolfinx_contact.points.jump_operators import Operator
from dolfinx_contact.points.memory import Memory

__all__ = ["Kinematics", "rotation"]

_OPPOSITE = 1e-16  # 1 plus the cosine of normals below which they count as opposite


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Gaps, jumps and data of the contact points of this rank at a state.

    Attributes:
        operator: operator B at the state, from displacements to jumps.
        jump: jump passed to the law, shape (n, dim).
        reference: slip until the last accepted state, already subtracted from `jump`, shape
            (n, dim); 0 under the static law.
        data: data of the law, with normals and gaps at the state.
        place: displacement of the points in the frame of a curved obstacle in large sliding, shape
            (n, dim); None otherwise.
        frame: rotation of this frame, shape (dim, dim); None if it does not rotate.
        motion: motion of the rigid body to which the frame belongs, shape (k,); None if the frame
            does not rotate.
        memory: memory of the points at the beginning of the step; None under the static law.
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
        """Gaps in the law, shape (n,); averages around the nodes with ``method="mixed"``."""
        return self.data.gap - dot(self.jump, self.data.n)

    @property
    def increment(self) -> Array:
        """Slips since the last accepted step, shape (n, dim); total slips under the static law."""
        n = self.data.n
        return tangential(self.jump, n)

    @property
    def slip(self) -> Array:
        """Slips since the reference configuration, shape (n, dim)."""
        return self.increment + self.reference

    @property
    def whole(self) -> Array:
        """Jumps since the reference configuration in the frame of the obstacle, shape (n, dim)."""
        jump = self.jump + self.reference
        return jump if self.frame is None else jump @ self.frame

    @property
    def path(self) -> tuple[Array, Array]:
        """Displacements of the points, and normals at the displaced points.

        Both are in the frame of the obstacle and have shape (n, dim).
        """
        if self.place is None:
            return self.whole, self.data.n
        return self.place, self.data.n if self.frame is None else self.data.n @ self.frame

    @property
    def gap_slope(self) -> Array:
        """Derivatives of the gaps with respect to displacements of the points, shape (n, dim)."""
        data = self.data
        if data.turn is None or data.moved is None:
            return -data.n
        by_jump = np.einsum("nij,ni->nj", data.moved, data.n)
        return -by_jump - np.einsum("nij,ni->nj", data.turn, self.jump)

    def gap_rate(self, v: Array) -> Array:
        """Return the derivative of the gaps along a displacement, shape (n,). Collective.

        Args:
            v: displacement of the owned nodes relative to the rigid body, shape (nodes, dim).
        """
        return dot(self.gap_slope, self.operator.rate(v))


def rotation(o: Array, n: Array) -> Array:
    """Return the smallest rotations from unit vectors o to unit vectors n, shape (..., dim, dim).

    They act on vectors perpendicular to o. If n = -o, the smallest rotation is not unique, and such
    vectors remain unchanged.

    Args:
        o: unit vectors, shape (..., dim).
        n: unit vectors, shape (..., dim).
    """
    dim = n.shape[-1]
    c = np.maximum(1.0 + dot(n, o), _OPPOSITE)
    along = np.eye(dim) - o[..., :, None] * o[..., None, :]
    turned = np.eye(dim) - ((n + o) / c[..., None])[..., :, None] * n[..., None, :]
    return turned @ along
