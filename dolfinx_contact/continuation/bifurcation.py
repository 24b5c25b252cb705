# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Smooth bifurcations: the bordered test function, and the direction in which to branch off.

With J = [grad H; t^T] and borders B and C fixed once, tau in

    [ J   B ] [ V   ]   [ 0 ]
    [ C^T 0 ] [ tau ] = [ 1 ]

has the sign of det J over that of the whole matrix, which is regular at a simple bifurcation. So
tau vanishes there, and V tends to the kernel of J: the direction of the other branch that is
orthogonal to t. With J^{-1} at hand from the tangent, tau = -1/(C^T J^{-1} B) costs one solve. The
whole matrix may be singular elsewhere: there tau changes its sign through infinity, which is no
bifurcation.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.bordered import Bordered

__all__ = ["BifurcationTest"]


class BifurcationTest:
    """The test function tau_BP on a bordered system.

    Args:
        bordered: whose last factorisation is that of J at the point to test.
    """

    def __init__(self, bordered: Bordered):
        self._bordered = bordered
        self._B, self._C = bordered.vector(), bordered.vector()
        for v, seed in ((self._B, 1), (self._C, 2)):
            probe = bordered.system.probe(seed)
            bordered.join(probe, 0.6180339887 * seed, v)
            v.scale(1.0 / v.norm())
            probe.destroy()
        self._V = bordered.vector()

    def __call__(self) -> float:
        """Tau at the point at which J was factorised last; 0 if J is singular there."""
        if not self._bordered.solve(self._B, self._V):
            return 0.0
        product = float(self._C.dot(self._V))
        return -1.0 / product if product != 0 else np.inf

    def kernel(self) -> PETSc.Vec:
        """The unit vector V of the last call: the kernel of J where tau vanishes."""
        self._bordered.require_scale()
        v = self._V.copy()
        v.scale(1.0 / np.sqrt(self._bordered.inner(v, v)))
        return v

    def destroy(self) -> None:
        """Free the vectors."""
        for v in (self._B, self._C, self._V):
            v.destroy()
