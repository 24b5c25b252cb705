# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Smooth bifurcations: the bordered test function, and the direction in which to branch off.

With J = [grad H; t^T] and borders B and C fixed once, tau in

    [ J   B ] [ V   ]   [ 0 ]
    [ C^T 0 ] [ tau ] = [ 1 ]

has the sign of det J over that of the whole matrix, which is regular at a simple bifurcation. So
tau vanishes there, and V tends to the kernel of J: the direction of the other branch that is
orthogonal to t. With J^{-1} at hand from the tangent, tau = -1/(C^T J^{-1} B) costs one solve.

Where the whole matrix is singular tau changes its sign through infinity, and in one step with a
bifurcation the two changes would hide each other. So there are three pairs of borders, and the
median of their values decides: at a bifurcation all three vanish, elsewhere one is outvoted.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.bordered import Bordered

__all__ = ["BifurcationTest"]

_PAIRS = 3


class BifurcationTest:
    """The test function tau_BP on a bordered system.

    Args:
        bordered: whose last factorisation is that of J at the point to test.
    """

    def __init__(self, bordered: Bordered):
        self._bordered = bordered
        self._borders = [self._border(seed) for seed in range(1, 2 * _PAIRS + 1)]
        self._V = [bordered.vector() for _ in range(_PAIRS)]
        self._signs, self._chosen = np.ones(_PAIRS), 0

    def _border(self, seed: int) -> PETSc.Vec:
        v, probe = self._bordered.vector(), self._bordered.system.probe(seed)
        probe.scale(1.0 / probe.norm())
        self._bordered.join(probe, 0.6180339887 * np.cos(seed), v)
        probe.destroy()
        return v

    def __call__(self, *, accepted: bool = False) -> float:
        """Tau at the point at which J was factorised last; 0 if J is singular there.

        Args:
            accepted: the point belongs to the branch: a pair that was outvoted there changes sides.
        """
        values = np.empty(_PAIRS)
        for k, V in enumerate(self._V):
            B, C = self._borders[2 * k : 2 * k + 2]
            if not self._bordered.solve(B, V):
                return 0.0
            product = float(C.dot(V))
            values[k] = -self._signs[k] / product if product != 0 else np.inf
        self._chosen = int(np.argsort(values)[_PAIRS // 2])
        tau = float(values[self._chosen])
        if accepted:
            self._signs *= np.where(values * tau < 0, -1.0, 1.0)
        return tau

    def kernel(self) -> PETSc.Vec:
        """The unit vector V of the last call: the kernel of J where tau vanishes."""
        self._bordered.require_scale()
        v = self._V[self._chosen].copy()
        v.scale(1.0 / np.sqrt(self._bordered.inner(v, v)))
        return v

    def destroy(self) -> None:
        """Free the vectors."""
        for v in (*self._borders, *self._V):
            v.destroy()
