# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Primal-dual interior-point method for the mixed complementarity problem, in 2D and 3D.

With displacements a = (at, un), contact forces r = (rt, rn), and multipliers l and slacks s of
friction, Signorini's and Coulomb's conditions at a point are

    y = un >= 0 complementary to rn >= 0,    s >= 0 complementary to l >= 0,
    at + sum_j l_j n_j = 0,
    2D: s = b -+ rt, n = +-1;    3D: s = (b^2 - |rt|^2)/(2 b), n = rt/b;    b = F rn + g,

where n_j are outward vectors in the friction disc, F the friction coefficient and g a prescribed
bound. The forces r are the unknowns, and a = A r + c with the compliance A and the displacements c
without contact. On the central path, the complementarity products equal mu instead of 0. Newton's
method follows this path while mu decreases, with Mehrotra's predictor and corrector (SIAM J. Optim.
2, 1992) and steps ending before the boundary.

For F = 0 (Tresca's problem) the method is the convex primal-dual method with its convergence
theory. No theory is available for Coulomb's law: for large F the path may turn back, and the method
then fails. The method stops when the relative residual of Coulomb's law is below the tolerance. Of
an initial guess, only the normal forces are used, and small ones are increased.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["InteriorPoint"]

_Direction: TypeAlias = tuple[Array, Array, Array, Array]  # changes of r, y, l and s
_BOUNDARY = 0.9  # largest step, relative to the distance to the boundary
_LONG = 0.3  # step length at which no stronger centring is tried
_LEAST = 1e-290
_TINY = 1e-12  # friction bound that counts as zero, relative to the largest one
_SHORTEST = 1e-10  # step length at which the method fails


@dataclass(frozen=True)
class InteriorPoint(Algorithm):
    """Primal-dual interior-point method; one iteration is one Newton step."""

    name: ClassVar[str] = "interior-point"
    max_iterations: int = 200

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        nothing = np.zeros_like(r)
        free = iteration.measure(contact.free, nothing).worst <= iteration.tolerance
        if free and not np.any(contact.p):
            iteration.stops(contact.free, nothing, gap=0.0)
            return
        state = _Interior(contact, r)
        while not iteration.stops(state.a, state.r, gap=state.mu):
            if not state.step():
                if free:  # without contact forces the solution is at the boundary
                    iteration.stops(contact.free, nothing, gap=0.0)
                    return
                iteration.fails(
                    f"the central path turns back: step length zero at a gap of {state.mu:.1e}"
                )
                return


class _Interior:
    """Current interior point of the scaled problem, with methods for Newton steps."""

    def __init__(self, contact: PointProblem, r: Array):
        problem, stiffness, self._length = contact.scaled()
        self._force = stiffness * self._length
        self._problem = problem
        self._A = problem.A
        m = problem.number
        d = problem.dim
        self._F = problem.friction
        self._g = problem.bound
        #: Mask of the points with friction.
        self._grips = (self._F > 0) | (self._g > _TINY * self._g.max())
        self._count = m + (2 if d == 2 else 1) * int(self._grips.sum())
        rn = np.maximum(r[:, -1] / self._force, max(float(np.abs(problem.p).max()), 1e-3))
        self._r = np.column_stack([np.zeros((m, d - 1)), rn])
        # Start with half of the admissible friction, opposite to the slip.
        slip = self._displacement()[:, :-1]
        size = np.maximum(np.linalg.norm(slip, axis=1), 1e-300)
        self._r[:, :-1] = -(0.5 * self._grips * self._radius / size)[:, None] * slip
        a = self._displacement()
        self._y = np.maximum(a[:, -1], 0.1 * np.abs(a).max())
        self._s = np.where(self._grips[:, None], self._slacks()[0], 1.0)
        self._l = np.where(self._grips[:, None], float(self._y @ rn) / m / self._s, 0.0)

    @property
    def r(self) -> Array:
        """Contact forces, shape (m, dim)."""
        return self._r * self._force

    @property
    def a(self) -> Array:
        """Displacements under the current forces, shape (m, dim)."""
        return self._displacement() * self._length

    @property
    def mu(self) -> float:
        """Mean product of complementary variables, which is 0 at a solution."""
        products = self._y @ self._r[:, -1] + np.sum(self._l * self._s)
        return float(products) / self._count

    @property
    def _radius(self) -> Array:
        return self._problem.radius(self._r[:, -1])

    def _displacement(self) -> Array:
        return self._problem.displacements(self._r)

    def _slacks(self) -> tuple[Array, Array, Array]:
        """Return the k friction slacks (distances of rt from the bound) and their derivatives.

        Returns:
            Slacks s, shape (m, k); -ds/drt, shape (m, k, dim - 1); and ds/drn, shape (m, k).
        """
        rt = self._r[:, :-1]
        radius = self._radius[:, None]
        if rt.shape[1] == 1:
            outward = np.broadcast_to(np.array([[[1.0], [-1.0]]]), (len(rt), 2, 1))
            by_rn = np.broadcast_to(self._F[:, None], (len(rt), 2))
            return radius - outward[:, :, 0] * rt, outward, by_rn
        inner = rt / np.maximum(radius, _LEAST)
        square = np.sum(inner**2, axis=1, keepdims=True)
        by_rn = 0.5 * self._F[:, None] * (1 + square)
        return 0.5 * radius * (1 - square), inner[:, None], by_rn

    @property
    def _state(self) -> _Direction:
        return self._r, self._y, self._l, self._s

    def step(self) -> bool:
        """Take a predictor-corrector step; return False if its length is zero up to round-off."""
        self._linearise()
        forecast = self._direction(0.0)
        part = self._longest(forecast, 1.0)
        best = forecast
        length = 0.0
        for centring, curved in ((max((1.0 - part) ** 2, 1e-4), True), (0.3, True), (0.8, False)):
            direction = self._direction(centring, forecast if curved else None, part)
            possible = self._longest(direction, _BOUNDARY)
            if possible > length:
                best = direction
                length = possible
            if length > _LONG:
                break
        if not length > _SHORTEST:
            return False
        moved = (v + length * dv for v, dv in zip(self._state, best, strict=True))
        self._r, self._y, self._l, self._s = moved
        return True

    def _linearise(self) -> None:
        """Eliminate slacks and multipliers from the Newton equations.

        The remaining matrix is the compliance plus one diagonal block per point.
        """
        m, d = self._r.shape
        _, self._out, self._by_rn = self._slacks()
        stiff = self._l / self._s
        D = np.zeros((m, d, d))
        D[:, -1, -1] = self._y / self._r[:, -1]
        D[:, :-1, :-1] = np.einsum("ij,ijp,ijq->ipq", stiff, self._out, self._out)
        D[:, :-1, -1] = -np.einsum("ij,ij,ijp->ip", stiff, self._by_rn, self._out)
        if d == 3:
            bent = self._l / np.maximum(self._radius, _LEAST)[:, None]
            D[:, :-1, :-1] += bent[:, :, None] * np.eye(2)
            D[:, :-1, -1] -= (bent * self._F[:, None]) * self._out[:, 0]
        J = self._A.reshape(m, d, m, d).copy()
        every = np.arange(m)
        J[every, :, every] += D
        square = J.reshape(m * d, m * d)
        held = np.zeros((m, d), dtype=bool)
        held[~self._grips, :-1] = True  # no shear without friction
        self._held = held.reshape(-1)
        square[self._held] = 0.0
        square[self._held, self._held] = 1.0
        self._J: Array = square

    def _direction(
        self, centring: float, forecast: _Direction | None = None, ahead: float = 1.0
    ) -> _Direction:
        """Return a Newton step that reduces the complementarity products and the infeasibility.

        Args:
            centring: target value of the complementarity products, relative to their present mean;
                the step reduces the infeasibility by the fraction ``1 - centring``.
            forecast: predictor step, whose second-order terms are subtracted; None for the
                predictor.
            ahead: step length of the predictor.
        """
        a = self._displacement()
        r = self._r
        y = self._y
        s = self._s
        multiplier = self._l
        rn = r[:, -1]
        part = 1.0 - centring
        aim = centring * self.mu
        product_n = aim - y * rn
        product_t = aim - multiplier * s
        gap = part * (a[:, -1] - y)
        slack = part * (self._slacks()[0] - s)
        slip = part * (a[:, :-1] + np.einsum("ij,ijp->ip", multiplier, self._out))
        if forecast is not None:
            dr, dy, dl, ds = (ahead * v for v in forecast)
            product_n = product_n - dy * dr[:, -1]
            product_t = product_t - dl * ds
            if r.shape[1] == 3:
                turned = dr[:, :-1] - self._out[:, 0] * (self._F * dr[:, -1])[:, None]
                radius = np.maximum(self._radius, _LEAST)[:, None]
                slip = slip + dl * turned / radius
                bent = np.sum(turned**2, axis=1, keepdims=True)
                slack = slack - 0.5 * bent / radius
        right = np.zeros_like(r)
        right[:, -1] = product_n / rn - gap
        right[:, :-1] = -slip - np.einsum(
            "ij,ijp->ip", (product_t - multiplier * slack) / s, self._out
        )
        flat = right.reshape(-1)
        flat[self._held] = 0.0
        dr = np.where(self._held, 0.0, np.linalg.solve(self._J, flat)).reshape(r.shape)
        da = (self._A @ dr.reshape(-1)).reshape(r.shape)
        along = np.einsum("ijp,ip->ij", self._out, dr[:, :-1])
        ds = self._by_rn * dr[:, -1:] - along + slack
        dl = (product_t - multiplier * ds) / s
        grips = self._grips[:, None]
        return dr, da[:, -1] + gap, np.where(grips, dl, 0.0), np.where(grips, ds, 0.0)

    def _longest(self, direction: _Direction, boundary: float) -> float:
        """Return the length of a step: a fraction of the distance to the boundary, at most 1.

        At the boundary a normal force, gap, multiplier or slack vanishes; ``boundary`` is the
        fraction.
        """
        dr, dy, dl, ds = direction
        part = 1.0
        rn = self._r[:, -1]
        for v, dv in ((rn, dr[:, -1]), (self._y, dy), (self._l, dl), (self._s, ds)):
            falls = dv < 0
            if falls.any():
                part = min(part, boundary * float(np.min(-v[falls] / dv[falls])))
        return part
