# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Primal simplex method for linear programs with columns in groups.

    minimise c.x    with    A x = b,  x >= 0,

where the variables of every group add up to 1. Instead of an upper bound 0, excluded columns get a
unit cost. Each program therefore starts from a feasible point, and an infeasible program ends with
a positive cost and multipliers y that prove infeasibility. With v = y.A,

    y.b - sum over groups of max v  >  0,

with the maxima over the columns that are not excluded, is a sufficient condition, which usually
holds long before the optimum is reached (`Simplex.solve`). The inverse of the basis is stored, and
b is slightly perturbed to avoid degenerate steps. Nothing is proved here.
"""

from __future__ import annotations

import numpy as np

from dolfinx_contact._arrays import Array, Ints, Mask

__all__ = ["Simplex"]


_PIVOT = 1e-9
_CHEAP = 1e-9  # reduced cost that counts as zero
_FEASIBLE = 1e-7  # cost that counts as zero
_FRESH = 64  # pivots between inversions of the basis
_SCATTER = 1e-8  # relative perturbation of b
_STALLED = 40  # pivots without improvement after which a bound is accepted


class Simplex:
    """Linear program A x = b, x >= 0, with warm starts from the last basis.

    Args:
        A: matrix of the n constraints on k variables, shape (n, k).
        b: right-hand side, shape (n,).
        groups: increasing indices of the first column of each group of variables adding up to 1.
    """

    def __init__(self, A: Array, b: Array, groups: Ints):
        n = len(b)
        signs = np.where(b >= 0, 1.0, -1.0)
        self._A = np.ascontiguousarray(np.concatenate([A, np.diag(signs)], axis=1))
        self._columns = A.shape[1]
        self._groups = groups
        scatter = np.random.default_rng(0).uniform(0.5, 1.0, n) * signs
        self._b = b + _SCATTER * scatter * max(1.0, float(np.abs(b).max()))
        self._basis = self._columns + np.arange(n)
        self._inverse = np.diag(signs)
        self._x = np.abs(self._b)
        self._size = np.sqrt(1.0 + (A**2).sum(axis=0))
        self._pivots = 0

    def solve(self, usable: Mask) -> Array | None:
        """Return multipliers of the n constraints proving infeasibility, shape (n,), or None.

        Args:
            usable: mask of the columns that are not excluded, shape (k,).
        """
        cost = np.ones(self._A.shape[1])
        cost[: self._columns][usable] = 0.0
        for _ in range(40 * len(self._b)):
            y = cost[self._basis] @ self._inverse
            if float(cost[self._basis] @ self._x) <= _FEASIBLE:
                return None
            v = y @ self._A[:, : self._columns]
            if self._bound(y, v, usable) > _FEASIBLE:
                return y
            if not self._step(cost[: self._columns] - v, usable):
                return y
        return None

    def least(self, cost: Array, usable: Mask) -> Array | None:
        """Minimise a cost, and return the multipliers of a nearly optimal lower bound.

        They have the shape (n,) for n constraints. None if the program is infeasible.

        Args:
            cost: cost of the k columns, shape (k,).
            usable: mask of the columns that are not excluded, shape (k,).
        """
        if self.solve(usable) is not None:
            return None
        whole = np.full(self._A.shape[1], 10.0 * max(1.0, float(np.abs(cost).max())))
        whole[: self._columns][usable] = cost[usable]
        best = -np.inf
        found = None
        idle = 0
        for _ in range(20 * len(self._b)):
            y = whole[self._basis] @ self._inverse
            v = y @ self._A[:, : self._columns]
            bound = self._bound(y, v - whole[: self._columns], usable)
            idle = 0 if bound > best + 1e-4 * (abs(best) + 1e-3) else idle + 1
            if bound > best:
                best, found = bound, y
            if idle > _STALLED or not self._step(whole[: self._columns] - v, usable):
                break
        return found

    @property
    def point(self) -> Array:
        """Values of the k variables at the end of the last program, shape (k,)."""
        x = np.zeros(self._A.shape[1])
        x[self._basis] = self._x
        return np.maximum(x[: self._columns], 0.0)

    def _bound(self, y: Array, v: Array, usable: Mask) -> float:
        """Return a lower bound of the cost by weak duality; ``v`` is y A minus the cost, if any."""
        best = np.maximum.reduceat(np.where(usable, v, -np.inf), self._groups)
        return float(y @ self._b - best.sum())

    def _step(self, reduced: Array, usable: Mask) -> bool:
        """Perform one pivot; return whether it was possible."""
        rated = np.where(usable, reduced / self._size, 0.0)
        j = int(np.argmin(rated))
        if not rated[j] < -_CHEAP:
            return False
        w = self._inverse @ self._A[:, j]
        rises = np.flatnonzero(w > _PIVOT)
        if len(rises) == 0:
            return False
        ratios = np.maximum(self._x[rises], 0.0) / w[rises]
        near = rises[ratios <= ratios.min() * (1 + 1e-9) + 1e-14]
        r = int(near[np.argmax(w[near])])
        theta = max(float(self._x[r]), 0.0) / float(w[r])
        self._x -= theta * w
        self._x[r] = theta
        self._basis[r] = j
        row = self._inverse[r] / w[r]
        self._inverse -= np.outer(w, row)
        self._inverse[r] = row
        self._pivots += 1
        if self._pivots % _FRESH == 0:
            self._refresh()
        return True

    def _refresh(self) -> None:
        try:
            self._inverse = np.linalg.inv(self._A[:, self._basis])
        except np.linalg.LinAlgError:
            return
        self._x = self._inverse @ self._b
