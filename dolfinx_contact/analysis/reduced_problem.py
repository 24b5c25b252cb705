# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The reduced problem in the plane, whose solutions are to be counted.

At m contact points live a = (ut, un) and the forces r = (rt, rn) on the body, with

    S a = r + p,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn + g,  rt = -(F rn + g) sign(ut)

where ut is not 0. S is symmetric and positive definite; initial gaps are in p. A point has either
Coulomb friction (F > 0, g = 0), a friction bound given in advance (F = 0, g > 0), or none. What is
proved holds for all S and p within `S_error` and `p_error` of those given, entry by entry.

Statuses are those of `laws.status`: 0 open, 1 stick, 2 and 3 slip with ut > 0 and < 0, and 4 to 6
the same at open points under a bound given in advance. Sets of statuses are bit masks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.rounding import gamma, least_eigenvalue

__all__ = [
    "CLOSED",
    "FREE",
    "IS_FREE",
    "IS_OPEN",
    "OPENED",
    "SENSE",
    "ReducedProblem",
    "has_status",
]

Array = npt.NDArray[np.float64]
Masks = npt.NDArray[np.int64]

#: Of every status: whether ut is free, whether un is, and the sense of the slip.
IS_FREE = np.array([True, False, True, True, False, True, True])
IS_OPEN = np.array([True, False, False, False, True, True, True])
SENSE = np.array([0, 0, 1, -1, 0, 1, -1])
#: Sets of statuses: with ut free, open and closed.
FREE = sum(1 << s for s in range(7) if IS_FREE[s])
OPENED = sum(1 << s for s in range(7) if IS_OPEN[s])
CLOSED = 0b1110


def has_status(allowed: Masks) -> npt.NDArray[np.bool_]:
    """Which statuses are in the sets, by point and status (m, 7)."""
    return np.asarray((allowed[:, None] >> np.arange(7)) & 1 > 0)


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """S a = r + p with contact and friction at m points; see the module.

    Args:
        S: stiffness, symmetric (2 m, 2 m), ordered ut, un point by point. What it is off from its
            transpose is added to its error.
        p: load (2 m,).
        friction: coefficients F >= 0 (m,).
        bound: forces g >= 0, where F = 0 (m,).
        S_error: by which entries of S may be off (2 m, 2 m).
        p_error: the same of p (2 m,).

    Raises:
        ValueError: if shapes do not fit, a number is not finite or negative that must not be, a
            point has both F and g, or S is not certainly positive definite.
    """

    S: Array
    p: Array
    friction: Array
    bound: Array | None = None
    S_error: Array | None = None
    p_error: Array | None = None

    def __post_init__(self) -> None:
        m = len(self.friction)
        n = 2 * m
        none = np.zeros
        parts = {
            "S": (self.S, (n, n)),
            "p": (self.p, (n,)),
            "friction": (self.friction, (m,)),
            "bound": (none(m) if self.bound is None else self.bound, (m,)),
            "S_error": (none((n, n)) if self.S_error is None else self.S_error, (n, n)),
            "p_error": (none(n) if self.p_error is None else self.p_error, (n,)),
        }
        for name, (given, shape) in parts.items():
            value = np.asarray(given, dtype=np.float64)
            if m == 0 or value.shape != shape:
                raise ValueError(f"{name} must have the shape {shape}, got {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} is not finite")
            if name not in ("S", "p") and (value < 0).any():
                raise ValueError(f"{name} must not be negative")
            object.__setattr__(self, name, value)
        if ((self.friction > 0) & (self.g > 0)).any():
            raise ValueError("a point has either a coefficient of friction or a bound")
        away = np.abs(self.S - self.S.T) + gamma(1) * np.abs(self.S) * (self.S != self.S.T)
        object.__setattr__(self, "S_error", np.maximum(self.dS, self.dS.T) + away)
        object.__setattr__(self, "S", (self.S + self.S.T) / 2)
        if not self.least > 0:
            raise ValueError("the reduced stiffness is not positive definite beyond its error")

    @property
    def g(self) -> Array:
        """Bounds of the shear given in advance (m,)."""
        assert self.bound is not None
        return self.bound

    @property
    def dS(self) -> Array:
        """Errors of S."""
        assert self.S_error is not None
        return self.S_error

    @property
    def dp(self) -> Array:
        """Errors of p."""
        assert self.p_error is not None
        return self.p_error

    @property
    def points(self) -> int:
        """Number m of contact points."""
        return len(self.friction)

    @cached_property
    def least(self) -> float:
        """A lower bound of the eigenvalues of S; 0 if there is none."""
        return least_eigenvalue(self.S, self.dS)

    @cached_property
    def statuses(self) -> Masks:
        """All statuses that the points can have, as masks (m,)."""
        masks = np.full(self.points, 0b1111, dtype=np.int64)
        masks[self.friction == 0] = 0b0101
        masks[self.g > 0] = 0b1111110
        return masks

    @cached_property
    def units(self) -> tuple[float, float]:
        """Powers of two that are typical of displacements and forces."""
        force = max(float(np.abs(self.p).max()), float(self.g.max()), 1e-290)
        stiffness = 2.0 ** round(float(np.log2(np.diag(self.S).mean())))
        force = 2.0 ** round(float(np.log2(force)))
        return force / stiffness, force

    @cached_property
    def scaled(self) -> ReducedProblem:
        """The same problem in its `units`: powers of two are exact."""
        length, force = self.units
        k = force / length
        S, dS = (np.asarray(v / k) for v in (self.S, self.dS))
        p, g, dp = (np.asarray(v / force) for v in (self.p, self.g, self.dp))
        return replace(self, S=S, p=p, bound=g, S_error=dS, p_error=dp)
