# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Kinematics of rigid bodies.

A rigid body has a displacement d and a rotation theta about a reference point X_0. If both are
small, its material point X moves by

    Phi(X) q = d + theta x (X - X_0),    q = (d, theta).

In large sliding (`displaced`) it moves to X_0 + d + Q(theta) (X - X_0), where Q is the rotation,
of any angle, with the rotation vector theta. If theta changes at the rate dtheta, the spin is

    w = L(theta) dtheta,    L = I + (1 - cos a)/a^2 S + (a - sin a)/a^3 S^2,    a = |theta|,

with S v = theta x v, and L = 1 in 2D (Simo and Vu-Quoc, CMAME 58, 1986, section 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from dolfinx_contact._arrays import Array

__all__ = ["RigidKinematics"]


_SMALL_ANGLE = 1e-4  # angle up to which L is a series


@dataclass(frozen=True, eq=False)
class RigidKinematics:
    """Motions of a rigid body about a reference point.

    Motions are arrays (k,) of the displacement and the rotation, k = 3 in 2D and 6 in 3D.

    Attributes:
        about: reference point, shape (dim,).
    """

    about: Array

    @property
    def dim(self) -> int:
        """Dimension, 2 or 3."""
        return len(self.about)

    # -- motions of any size ---------------------------------------------------------------------

    def rotation(self, motion: Array) -> Array:
        """Return the rotation Q (dim, dim) of a motion (k,), or of each motion (n, k)."""
        angles = motion[..., self.dim :]
        vector = np.zeros((*angles.shape[:-1], 3))
        if not vector.size:
            return np.zeros((0, self.dim, self.dim))
        vector[..., 3 - angles.shape[-1] :] = angles
        turned = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
        return turned[..., : self.dim, : self.dim]

    def seen(self, x: Array, motion: Array) -> Array:
        """Return positions (n, dim) in the frame of the moved body.

        Args:
            x: positions in space, shape (n, dim).
            motion: motion of the body, shape (k,), or one for each point, shape (n, k).
        """
        arm = x - self.about - motion[..., : self.dim]
        return self.about + (arm[:, None] @ self.rotation(motion))[:, 0]

    def carried(self, x: Array, motion: Array) -> Array:
        """Return displacements (n, dim) of material points x by a motion of any size."""
        arm = x - self.about
        return motion[: self.dim] + arm @ self.rotation(motion).T - arm

    def spin(self, motion: Array) -> Array:
        """Return L (k, k), which maps rates of the rotation vector to the spin of the body."""
        if self.dim == 2:
            return np.eye(1)
        vector = motion[self.dim :]
        angle = float(np.linalg.norm(vector))
        S = np.cross(np.eye(3), vector)
        if angle < _SMALL_ANGLE:
            return np.eye(3) + S / 2 + S @ S / 6
        first = (1 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
        return np.eye(3) + first * S + second * S @ S

    def velocity(self, x: Array, motion: Array, rate: Array) -> Array:
        """Return velocities (n, dim) of the material points at x for a rate of the motion (k,)."""
        turning = self.spin(motion) @ rate[self.dim :]
        arm = x - self.about - motion[: self.dim]
        return rate[: self.dim] + self.crossed(turning, arm)

    def crossed(self, turning: Array, v: Array) -> Array:
        """Return the products w x v of a spin w with vectors v, shape (n, dim)."""
        if self.dim == 2:
            return turning * np.stack([-v[:, 1], v[:, 0]], axis=1)
        return np.asarray(np.cross(turning, v))

    # -- small motions and forces ----------------------------------------------------------------

    def field(self, x: Array, motion: Array) -> Array:
        """Return Phi q, displacements (n, dim) at points (n, dim) by a small motion q."""
        return motion[: self.dim] + self.crossed(motion[self.dim :], x - self.about)

    def resultant(self, x: Array, forces: Array, moved: Array | None = None) -> Array:
        """Return Phi^T f, the resultant force and the moment about the reference point, (k,).

        Args:
            x: points of action, shape (n, dim).
            forces: forces, shape (n, dim).
            moved: displacement of the reference point, shape (dim,); None for zero.
        """
        arm = x - (self.about if moved is None else self.about + moved)
        if self.dim == 2:
            moments: Array = (arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0])[:, None]
        else:
            moments = np.asarray(np.cross(arm, forces), dtype=np.float64)
        return np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])
