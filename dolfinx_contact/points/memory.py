# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What contact points remember from the last accepted state.

In a quasi-static evolution friction resists slip as it happens, not displacement as it is: the law
of a step from t_n to t_n+1 sees the jump

    j - (I - n n^T) j_n,

whose normal part is total and whose tangential part is the increment since the accepted state n
(implicit Euler in the slip velocity, to which rate-independent friction does not ask for the time).
n is the normal of now, and j the motion relative to what is touched, so that a rigid body that
moves is subtracted.

A memory is frozen: H reads it, nothing in a solve writes it. Accepting a step makes a new one,
rejecting a step keeps the old one. Laws with more to remember (the intensity of an adhesion) have
their arrays here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Memory"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Memory:
    """What the contact points of a surface remember, on this rank.

    Attributes:
        jump: j_n, the total jump at the last accepted state (n, dim), a length. Read-only.
    """

    jump: Array

    def __post_init__(self) -> None:
        jump = np.array(self.jump, dtype=np.float64)
        jump.flags.writeable = False
        object.__setattr__(self, "jump", jump)

    def reference(self, n: Array) -> Array:
        """The part of j_n along the surface whose normals are ``n`` (n, dim)."""
        return np.asarray(self.jump - np.sum(self.jump * n, axis=1)[:, None] * n)

    def reference_rate(self, n: Array, rate: Array) -> Array:
        """The rate of `reference` while the normals ``n`` turn at a rate (n, dim)."""
        along, turning = (np.sum(self.jump * v, axis=1)[:, None] for v in (n, rate))
        return np.asarray(-turning * n - along * rate)
