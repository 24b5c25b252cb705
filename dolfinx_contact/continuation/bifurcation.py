# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Test function of smooth bifurcations, and the tangent of the bifurcating branch.

With J = [grad H; t^T], the unit tangent t of the branch and constant vectors (borders) B and C, tau
in

    [ J   B ] [ V   ]   [ 0 ]
    [ C^T 0 ] [ tau ] = [ 1 ]

has the sign of det J divided by the determinant of the whole matrix, which is regular at a simple
bifurcation. Hence tau vanishes there, and V tends to the kernel of J, the tangent of the other
branch orthogonal to t. Using the factorisation of J for the tangent, tau = -1/(C^T J^{-1} B) costs
one solve.

Where the whole matrix is singular, tau changes its sign through infinity, which could cancel the
change of sign at a bifurcation in the same step. Therefore the median over three pairs of borders
is used: all three values vanish at a bifurcation; where the matrix of one pair is singular, the
other two pairs decide. With a Krylov method, where every right-hand side costs a solve, one pair is
used: tau = sign(det J) / |C^T J^{-1} B| with the sign of det J from the solve.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.bordered import Bordered

__all__ = ["BifurcationTest"]

_PAIRS = 3


class BifurcationTest:
    """Test function tau of a bordered system. All methods are collective.

    Args:
        bordered: bordered system with the matrix J.

    Attributes:
        signs: factor 1 or -1 of each pair of borders that makes all values agree in sign on the
            branch so far, shape (pairs,).
    """

    def __init__(self, bordered: Bordered):
        self._bordered = bordered
        self._several = bordered.solver.is_direct
        pairs = _PAIRS if self._several else 1
        self._borders = [self._border(seed) for seed in range(1, 2 * pairs + 1)]
        self._V = [bordered.vector() for _ in range(pairs)]
        self.signs = np.ones(pairs)
        self._chosen = 0

    def _border(self, seed: int) -> PETSc.Vec:
        probe = self._bordered.system.probe(seed)
        probe.scale(1.0 / probe.norm())
        last = 0.6180339887 * np.cos(seed) if self._several else 0.0
        return self._bordered.joined(probe, last)

    def __call__(self, t: PETSc.Vec, *, accepted: bool = False) -> float:
        """Return tau at the state of J; 0 if J is singular.

        Args:
            t: unit tangent of the branch at this state.
            accepted: whether the point belongs to the branch; pairs with a sign different from the
                median then change their factor in `signs`.
        """
        solver = self._bordered.solver
        products = np.empty(len(self._V))
        for k, V in enumerate(self._V):
            B, C = self._borders[2 * k : 2 * k + 2]
            if not solver.probe(B, V):
                return 0.0
            products[k] = float(C.dot(V))
        with np.errstate(divide="ignore"):
            values = -self.signs / products
        if not self._several:
            return self._bordered.orientation(t) * float(np.abs(values[0]))
        self._chosen = int(np.argsort(values)[_PAIRS // 2])
        tau = float(values[self._chosen])
        if accepted:
            self.signs *= np.where(values * tau < 0, -1.0, 1.0)
        return tau

    def kernel(self) -> PETSc.Vec:
        """Return the normalised vector V of the last evaluation (see the module).

        Where the test function tau vanishes, V spans the kernel of J.
        """
        self._bordered.require_scale()
        v = self._V[self._chosen].copy()
        v.scale(1.0 / self._bordered.length(v))
        return v
