# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact problem of a single point, the local problem of nonsmooth Gauss-Seidel.

S a = r + b with the stiffness S (dim, dim) of the point and a load b containing the coupling to
the other, fixed points. In 2D the statuses are tried one after the other, each with an explicit
solution. In 3D, slip means rt = -mu at with mu >= 0. A slipping point in contact satisfies
(St + mu) at = bt, and mu |at| = F rn + g is a scalar equation for mu. It is solved in the
eigenvectors of St by Newton's method, safeguarded by bisection.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, sqrt

import numpy as np

from dolfinx_contact._arrays import Array

__all__ = ["OnePoint", "one_point"]

_ROUND_OFF = 1e-14
_MOST = 200  # largest number of steps for the root mu


def one_point(S: Array, friction: float, bound: float) -> OnePoint:
    """Return the solver of a point with stiffness ``S`` of shape (2, 2) or (3, 3)."""
    return InPlane(S, friction, bound) if len(S) == 2 else InSpace(S, friction, bound)


class OnePoint:
    """Solver of the contact problem of one point for varying loads.

    Attributes:
        stuck: whether the point sticks in the last solution.
        closed: whether the point is in contact in the last solution.
    """

    stuck = False
    closed = False

    def solve(self, b: Array) -> tuple[float, ...]:
        """Return the displacement (tangents, normal) under the load ``b`` of shape (dim,)."""
        raise NotImplementedError


@dataclass
class InPlane(OnePoint):
    """A point in 2D; see the module."""

    S: Array
    friction: float
    bound: float

    def __post_init__(self) -> None:
        self.tt, self.tn, self.nn = (float(self.S[i, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
        self.open_tt = self.tt - self.tn**2 / self.nn

    def solve(self, b: Array) -> tuple[float, float]:
        """Return the first admissible solution of: open, stick, slip right, slip left."""
        t = float(b[0])
        n = float(b[1])
        F = self.friction
        g = self.bound
        self.stuck = False
        self.closed = False
        left = t - self.tn * n / self.nn
        ut = (abs(left) - g) / self.open_tt if abs(left) > g else 0.0
        ut = -ut if left < 0 else ut
        un = (n - self.tn * ut) / self.nn
        if un >= 0:
            self.stuck = g > 0 and ut == 0
            return ut, un
        self.closed = True
        if n <= 0 and abs(t) <= g - F * n:
            self.stuck = True
            return 0.0, 0.0
        best = (0.0, 0.0)
        least = inf
        for sign in (1.0, -1.0):
            stiffness = self.tt + sign * F * self.tn
            if stiffness == 0:
                continue
            ut = (t + sign * (F * n - g)) / stiffness
            rn = self.tn * ut - n
            off = max(-sign * ut * self.tt, -rn, 0.0)
            if off == 0:
                return ut, 0.0
            if off < least:
                best = (ut, 0.0)
                least = off
        return best


class InSpace(OnePoint):
    """A point in 3D; see the module."""

    def __init__(self, S: Array, friction: float, bound: float):
        self.friction = friction
        self.bound = bound
        self.nn = float(S[2, 2])
        coupling = S[:2, 2]
        self._coupling = float(coupling[0]), float(coupling[1])
        self._closed = _Slip(S[:2, :2], coupling)
        self._open = _Slip(S[:2, :2] - np.outer(coupling, coupling) / self.nn, np.zeros(2))

    def solve(self, b: Array) -> tuple[float, float, float]:
        """Return the first admissible solution of: open, stick, slip."""
        t = (float(b[0]), float(b[1]))
        n = float(b[2])
        F = self.friction
        g = self.bound
        self.stuck = False
        self.closed = False
        c0, c1 = self._coupling
        left = (t[0] - c0 * n / self.nn, t[1] - c1 * n / self.nn)
        self.stuck = g > 0 and hypot(*left) <= g
        x, y = (0.0, 0.0) if self.stuck else self._open.solve(left, 0.0, 0.0, g)
        un = (n - c0 * x - c1 * y) / self.nn
        if un >= 0:
            return x, y, un
        self.closed = True
        self.stuck = n <= 0 and hypot(*t) <= g - F * n
        x, y = (0.0, 0.0) if self.stuck else self._closed.solve(t, n, F, g)
        return x, y, 0.0


class _Slip:
    """(S + mu) a = b with mu |a| = F (c.a - n) + g, in the eigenvectors of S (2, 2)."""

    def __init__(self, S: Array, coupling: Array):
        values, vectors = np.linalg.eigh(S)
        turned = vectors.T @ coupling
        self._values = float(values[0]), float(values[1])
        self._first = float(vectors[0, 0]), float(vectors[0, 1])
        self._second = float(vectors[1, 0]), float(vectors[1, 1])
        self._coupling = float(turned[0]), float(turned[1])

    def solve(self, b: tuple[float, float], n: float, F: float, g: float) -> tuple[float, float]:
        """Return the slip under the load b; if no root exists, the slip for mu = 0."""
        v00, v01 = self._first
        v10, v11 = self._second
        e0, e1 = self._values
        c0, c1 = self._coupling
        b0 = v00 * b[0] + v10 * b[1]
        b1 = v01 * b[0] + v11 * b[1]
        size = hypot(b0, b1)
        low = 0.0
        high = inf
        mu = 0.0
        x = y = 0.0
        for _ in range(_MOST):
            x = b0 / (e0 + mu)
            y = b1 / (e1 + mu)
            slip = sqrt(x * x + y * y)
            excess = mu * slip - F * (c0 * x + c1 * y - n) - g
            if abs(excess) <= _ROUND_OFF * (size + abs(F * n) + g):
                break
            if excess > 0:
                high = mu
            else:
                low = mu
            if high == 0:
                break  # frictionless slip
            dx = -x / (e0 + mu)
            dy = -y / (e1 + mu)
            slope = slip + (mu * (x * dx + y * dy) / slip if slip > 0 else 0.0)
            slope -= F * (c0 * dx + c1 * dy)
            step = mu - excess / slope if slope > 0 else -1.0
            if not low < step < high:
                step = 0.5 * (low + high) if high < inf else 2.0 * low + e1
            if step == mu:
                break
            mu = step
        return v00 * x + v01 * y, v10 * x + v11 * y
