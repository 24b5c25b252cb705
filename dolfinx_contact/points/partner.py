# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacements relative to the obstacle of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.points.rigid_body import RigidBody

__all__ = ["Partner"]


@dataclass(frozen=True, eq=False)
class Partner:
    """Obstacle of a surface as the frame of reference of its displacements.

    Attributes:
        body: rigid body; None if the obstacle is not a rigid body.
        x: positions of the local nodes of the displacement, shape (nodes, dim).
        turns: whether the surface follows a rigid body rotating by any angle.
    """

    body: RigidBody | None
    x: Array
    turns: bool

    def relative(self, u: Array, motion: Array | None) -> Array:
        """Return displacements relative to the rigid body; unchanged without one.

        Args:
            u: displacement at the first local nodes, shape (n, dim).
            motion: motion of the rigid body, shape (k,).
        """
        if self.body is None:
            return u
        assert motion is not None
        x = self.x[: len(u)]
        rigid = self.body.kinematics
        return np.asarray(
            rigid.seen(x + u, motion) - x if self.turns else u - rigid.field(x, motion)
        )

    def relative_rate(self, u: Array, motion: Array, du: Array, change: Array) -> Array:
        """Return the derivative of `relative`, rotated with the body.

        Args:
            u: displacement at the first local nodes, shape (n, dim).
            motion: motion of the rigid body, shape (k,).
            du: direction of the displacement, shape (n, dim).
            change: direction of the motion, shape (k,).
        """
        if self.body is None or not self.turns:
            return self.relative(du, change)
        x = self.x[: len(u)] + u
        return np.asarray(du - self.body.kinematics.velocity(x, motion, change))

    def rotation(self, motion: Array | None) -> Array | None:
        """Return the rotation of the frame, shape (dim, dim); None if it does not rotate."""
        if self.body is None or motion is None or not self.turns:
            return None
        return self.body.kinematics.rotation(motion)

    def dragged(self, x: Array) -> Array:
        """Return present displacements of the rigid body at points (n, dim); 0 without one."""
        if self.body is None:
            return np.zeros_like(x)
        rigid, motion = self.body.kinematics, self.body.values
        return rigid.carried(x, motion) if self.turns else rigid.field(x, motion)
