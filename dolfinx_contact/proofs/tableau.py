# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dual simplex method for bounded variables with a persistent tableau.

All variables lie between 0 and an upper bound. Basic variables are affine functions of the nonbasic
variables, x_B = T x_N + start. Successive programs differ in a few bounds. The objective is random,
which prevents cycling. If a program is infeasible, a row of the tableau proves it.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dger

from dolfinx_contact._arrays import Array, Ints

__all__ = ["Tableau"]


_FEASIBLE = 1e-9
_PIVOT = 1e-9


class Tableau:
    """Tableau of a linear program: basic variables, their rows, and the values of all variables.

    Args:
        rows: matrix T in x_B = T x_N + start for k basic and n nonbasic variables, shape (k, n).
        start: values of the basic variables if all nonbasic variables vanish, shape (k,).
        basic: indices of the basic variables, shape (k,).
        free: number n of the nonbasic variables, which have the indices 0 to n - 1.
        up: upper bounds of all variables.
        sure: least violation of a row proving infeasibility; by default 0.

    Attributes:
        lost: whether the last program ended undecided, at the limit of iterations.
    """

    def __init__(
        self,
        rows: Array,
        start: Array,
        basic: Ints,
        free: int,
        up: Array,
        sure: float = 0.0,
    ):
        self._T = np.ascontiguousarray(rows)
        self._basic = basic
        self._nonbasic = np.arange(free)
        self._values = start
        self._at = np.zeros(free)
        self._costs = np.random.default_rng(0).uniform(0.5, 1.0, free)  # reduced, of the nonbasic
        self._up = up
        self._sure = sure
        self.lost = False

    @property
    def _all_values(self) -> Array:
        x = np.zeros(len(self._up))
        x[self._nonbasic] = self._at
        x[self._basic] = self._values
        return x

    def _identity(self, r: int, sign: float) -> Array:
        """Return the coefficients of the linear identity between all variables in row ``r``.

        They are multiplied by ``sign``.
        """
        v = np.zeros(len(self._up))
        v[self._nonbasic] = -sign * self._T[r]
        v[self._basic[r]] += sign
        return v

    def _set(self, columns: Ints, to: Array) -> None:
        """Set nonbasic variables to new values and update the basic variables."""
        moved = to != self._at[columns]
        if moved.any():
            columns = columns[moved]
            to = to[moved]
            self._values += self._T[:, columns] @ (to - self._at[columns])
            self._at[columns] = to

    def _repair(self) -> Array | None:
        """Pivot until all variables satisfy their bounds.

        Returns:
            None if the program is feasible, or if it is undecided at the limit of iterations
            (`lost`). Otherwise the coefficients of an identity between all variables that cannot
            hold within their bounds, which proves infeasibility.
        """
        self.lost = False
        for _ in range(40 + 4 * self._T.shape[1]):
            below = -self._values
            above = self._values - self._up[self._basic]
            worst = np.maximum(below, above)
            wrong = np.flatnonzero(worst > _FEASIBLE)
            if len(wrong) == 0:
                return None
            # Select the row with the largest violation relative to its norm.
            norms = np.sqrt(np.einsum("ij,ij->i", self._T[wrong], self._T[wrong]))
            r = int(wrong[np.argmax(worst[wrong] / (1e-12 + norms))])
            off = float(worst[r])
            sign = 1.0 if below[r] >= above[r] else -1.0
            row = sign * self._T[r]
            most = self._up[self._nonbasic]
            room = np.where(row > 0, most - self._at, self._at)
            room[np.abs(row) <= _PIVOT] = 0.0
            gain = np.abs(row) * np.where(np.isfinite(room), room, 1e100)
            if gain.sum() < off - self._sure:
                return self._identity(r, sign)
            j = self._entering(row, gain, off)
            self._pivot(r, j, 0.0 if sign > 0 else float(self._up[self._basic[r]]))
        self.lost = True
        return None

    def _entering(self, row: Array, gain: Array, off: float) -> int:
        """Return the variable entering the basis by the bound-flipping ratio test.

        Variables that precede it in the test, and whose ranges cannot repair the row, flip to their
        opposite bounds.
        """
        free = np.flatnonzero(gain > 0)
        order = free[np.argsort(np.abs(self._costs[free]) / np.abs(row[free]))]
        last = min(int(np.searchsorted(np.cumsum(gain[order]), off)), len(order) - 1)
        flips = order[:last]
        self._set(flips, np.where(row[flips] > 0, self._up[self._nonbasic[flips]], 0.0))
        return int(order[last])

    def _pivot(self, r: int, j: int, to: float) -> None:
        T = self._T
        element = float(self._T[r, j])
        across = T[r] / element
        down = T[:, j].copy()
        step = (to - float(self._values[r])) / element
        dger(-1.0, across, down, a=T.T, overwrite_a=True)
        T[r] = -across
        T[:, j] = down / element
        T[r, j] = 1.0 / element
        cost = float(self._costs[j])
        self._costs -= cost * across
        self._costs[j] = cost / element
        self._values += down * step
        self._values[r] = self._at[j] + step
        self._at[j] = to
        self._basic[r], self._nonbasic[j] = self._nonbasic[j], self._basic[r]
