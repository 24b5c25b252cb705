# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact problem of a single point, the local problem of nonsmooth Gauss-Seidel.

The problem is S a = r + b with the stiffness S (dim, dim), the displacement a = (at, an), the force
r = (rt, rn) and a load b containing the coupling to the other, fixed points. The friction bound is
F rn + g, with the coefficient F and a prescribed bound g. The statuses are tried in the order open,
stick, slip. Slip means rt = -mu at with mu >= 0. Hence mu |at| = F rn + g and (St + mu) at = bt for
a slipping point in contact, with the tangential parts St and bt. In 2D each sense of slip has an
explicit solution. In 3D, mu is the root of a scalar equation in the eigenvectors of St, computed up
to round-off by Newton's method safeguarded by bisection.

A solution exists for every F (`lemke`). The first of several solutions is returned. In 3D with
positive g and large F, the computed slip may violate the law; Gauss-Seidel then does not converge.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, sqrt

import numpy as np

from dolfinx_contact._arrays import Array

__all__ = ["OnePoint"]

_ROUND_OFF = 1e-14
_MOST = 200  # largest number of steps for the root mu


class OnePoint:
    """Solver of the contact problem of one point for varying loads.

    Args:
        S: stiffness, shape (2, 2) or (3, 3).
        friction: friction coefficient F.
        bound: prescribed friction bound g.

    Attributes:
        stuck: whether the point sticks in the last solution.
        closed: whether the point is in contact in the last solution.
    """

    def __init__(self, S: Array, friction: float, bound: float):
        self.stuck = False
        self.closed = False
        self._friction = float(friction)
        self._bound = float(bound)
        coupling = S[:-1, -1]
        self._normal = float(S[-1, -1])
        self._coupling = [float(c) for c in coupling]
        self._no_slip = (0.0,) * len(coupling)
        slip = _SlipInPlane if len(S) == 2 else _SlipInSpace
        self._if_closed = slip(S[:-1, :-1], coupling)
        eliminated = S[:-1, :-1] - np.outer(coupling, coupling) / self._normal
        self._if_open = slip(eliminated, np.zeros(len(coupling)))

    def solve(self, b: Array) -> tuple[float, ...]:
        """Return the displacement under the load ``b``, tangential part first, shape (dim,)."""
        *t, n = map(float, b)
        F = self._friction
        g = self._bound
        # open, with the normal displacement eliminated; a bound g > 0 acts without contact, too
        shear = [load - c * n / self._normal for load, c in zip(t, self._coupling, strict=True)]
        self.closed = False
        self.stuck = g > 0 and hypot(*shear) <= g
        slip = self._no_slip if self.stuck else self._if_open.solve(shear, 0.0, 0.0, g)
        opening = n
        for c, ut in zip(self._coupling, slip, strict=True):
            opening -= c * ut
        if opening >= 0:
            return *slip, opening / self._normal
        # closed: stick or slip
        self.closed = True
        self.stuck = n <= 0 and hypot(*t) <= g - F * n
        slip = self._no_slip if self.stuck else self._if_closed.solve(t, n, F, g)
        return *slip, 0.0


class _SlipInPlane:
    """Solver for the slip a in 2D: (S + mu) a = b with mu |a| = F (c a - n) + g.

    A slip a causes the shear S a and the normal force c a; b is the tangential load, -n the normal
    force without slip.
    """

    def __init__(self, S: Array, coupling: Array):
        self._stiffness = float(S[0, 0])
        self._coupling = float(coupling[0])

    def solve(self, b: Sequence[float], n: float, F: float, g: float) -> tuple[float, ...]:
        """Return the slip under a tangential load b and a normal load n.

        The friction bound has the coefficient F and the prescribed part g. Slips to both sides are
        computed; the one with the smaller violation of the law is returned.
        """
        best = 0.0
        least = inf
        for sign in (1.0, -1.0):
            stiffness = self._stiffness + sign * F * self._coupling
            if stiffness == 0:
                continue
            ut = (b[0] + sign * (F * n - g)) / stiffness
            off = max(-sign * ut * self._stiffness, n - self._coupling * ut, 0.0)
            if off < least:
                best = ut
                least = off
        return (best,)


class _SlipInSpace:
    """Solver for the slip a in 3D: (S + mu) a = b with mu |a| = F (c.a - n) + g.

    As `_SlipInPlane`, in the eigenvectors of the matrix S, shape (2, 2), with vectors a, b and c.
    """

    def __init__(self, S: Array, coupling: Array):
        values, vectors = np.linalg.eigh(S)
        turned = vectors.T @ coupling
        self._values = float(values[0]), float(values[1])
        self._first = float(vectors[0, 0]), float(vectors[0, 1])
        self._second = float(vectors[1, 0]), float(vectors[1, 1])
        self._coupling = float(turned[0]), float(turned[1])

    def solve(self, b: Sequence[float], n: float, F: float, g: float) -> tuple[float, ...]:
        """Return the slip under a tangential load b and a normal load n.

        The friction bound has the coefficient F and the prescribed part g.
        """
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
