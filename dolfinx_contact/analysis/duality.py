# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What a vector of multipliers proves about statuses, by weak duality.

At every solution 0 = y.(S a - r - p) for any y. Point by point the slots (`energy.py`) lie in the
boxes of the statuses that are still allowed, so that

    0 >= L(y) = sum_i min_s h_is(y) - y.p,    h_is = sum over the slots of s of min(0, c_ij) ub_ij

with the coefficients c of the slots in y.(S a - r). Where L > 0 there is no solution; where L > 0
with point i held in status s, that status is impossible there. The minimum over the statuses is
that over the convex hull of their boxes, so nothing is lost against the linear program from which y
comes; and nothing depends on how y was found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.energy import used
from dolfinx_contact.analysis.reduced_problem import SENSE, Masks, ReducedProblem, has_status
from dolfinx_contact.analysis.rounding import gamma, up

__all__ = ["Dual"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Dual:
    """A vector of multipliers y of the rows S a - r = p.

    Args:
        problem: scaled.
        y: multipliers (2 m,).
    """

    problem: ReducedProblem
    y: Array

    @cached_property
    def _of_a(self) -> Array:
        return self.problem.S @ self.y

    @cached_property
    def coefficients(self) -> Array:
        """Of the slots in y.(S a - r), without what g contributes (6, m)."""
        a, rt, rn = self._of_a, -self._shear, -self._pressure
        return np.stack([a[0::2], -a[0::2], a[1::2], rt + rn, rn - rt, -self.y[1::2]])

    @property
    def _shear(self) -> Array:
        """What y counts of s+ - s- (m,)."""
        return np.where(self.problem.g > 0, 0.0, self.y[0::2] / 2)

    @property
    def _pressure(self) -> Array:
        """What y counts of s+ + s-, which is 2 F rn (m,)."""
        F = self.problem.friction
        return np.divide(self.y[1::2], 2 * F, out=np.zeros_like(F), where=F > 0)

    @cached_property
    def _given(self) -> Array:
        """Minima of -yt rt over shears of a bound given in advance, by point and status."""
        most = (self.problem.g * self.y[0::2])[:, None]
        return np.where(SENSE == 0, -np.abs(most), SENSE * most)

    def least(self, ub: Array, less: tuple[int, int] | None = None) -> Array:
        """The h by point and status (m, 7).

        Args:
            ub: bounds of the slots (6, m).
            less: slot and point from whose coefficient 1 is taken.
        """
        c = self.coefficients
        if less is not None:
            c = c.copy()
            c[less] -= 1.0
        uses, F = used(self.problem).copy(), self.problem.friction
        # rn is (s+ + s-) / 2 F where F > 0, and s+, s- are in g where that is given.
        uses[F > 0, :, 5] = False
        uses[F == 0, :, 3:5] = False
        per_slot = (np.minimum(c, 0) * ub).T
        return np.einsum("msj,mj->ms", uses, per_slot) + self._given

    def round_off(self, ub: Array) -> float:
        """By how much sums of these may be off, and what errors of S and p do to them."""
        problem, y = self.problem, np.abs(self.y)
        n = len(y)
        reach = np.empty(n)
        reach[0::2], reach[1::2] = np.maximum(ub[0], ub[1]), ub[2]
        data = reach @ (gamma(n) * (np.abs(problem.S) @ y) + problem.dS @ y)
        data += problem.dp @ y
        size = np.abs(self.coefficients)
        # These are differences, rounded as their terms are.
        size[3:5] = np.abs(self._shear) + np.abs(self._pressure)
        sums = (size * ub).sum() + np.abs(problem.p) @ y
        sums += 2 * problem.g @ y[0::2]
        return float(up(data + gamma(8 * n) * sums))

    def impossible(self, allowed: Masks, ub: Array, margin: float) -> npt.NDArray[np.bool_]:
        """Which of the allowed statuses y excludes, by point and status (m, 7).

        Args:
            allowed: statuses, masks (m,).
            ub: bounds of the slots (6, m).
            margin: times the round-off that must be left.
        """
        has = has_status(allowed)
        h = self.least(ub)
        lowest = np.where(has, h, np.inf).min(axis=1)
        rest = lowest.sum() - lowest - self.y @ self.problem.p
        return np.asarray(has & (rest[:, None] + h > margin * self.round_off(ub)))

    def most(self, allowed: Masks, ub: Array, slot: int, point: int) -> float:
        """An upper bound of a slot: x = x - y.(S a - r - p)."""
        has = has_status(allowed)
        h = np.where(has, self.least(ub, (slot, point)), np.inf).min(axis=1)
        bound = -h.sum() + self.y @ self.problem.p
        return float(bound + self.round_off(ub) + gamma(8 * len(self.y)) * ub[slot, point])
