# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method for the equations of a law, at all contact points simultaneously."""

from __future__ import annotations

from collections.abc import Hashable, Mapping

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._forms import PointValues, ScalarList
from dolfinx_contact.laws.law import Equations
from dolfinx_contact.laws.symbols import Solved

__all__ = ["Roots"]

_MOST_STEPS = 100
_MOST_CUTS = 30
_ENOUGH = 1e-10  # relative size of the last step; the error is about its square
_MOST_GROWN = 60
_MOST_HALVED = 120
_TO_THE_END = 0.9  # fraction of the distance to the end to which a step is shortened


class Roots:
    """Solutions of the nonlinear equations of a law, and the inverses of the Jacobian matrices.

    Args:
        equations: equations of the law, by any keys.
        solved: symbols for the solutions, by the same keys.
        w: Function with the data of a point; the last components are for the solutions.
        comm: communicator of the ranks that compile the equations together.
    """

    def __init__(
        self,
        equations: Mapping[Hashable, Equations],
        solved: Mapping[Hashable, Solved],
        w: fem.Function,
        comm: MPI.Comm,
    ):
        self._width = w.function_space.dofmap.bs
        self._each = [_Root(e, solved[name], w, comm) for name, e in equations.items()]

    def __call__(self, columns: Array) -> Array:
        """Append solutions and inverse Jacobians to point data (rows). Not collective."""
        full = np.zeros((len(columns), self._width))
        full[:, : columns.shape[1]] = columns
        with np.errstate(all="ignore"):  # a failed solution is NaN
            for root in self._each:
                root(full)
        return full


class _Root:
    """Solver for a system of equations F(z) = 0 at each point; the first unknown may be monotone.

    If a monotone unknown would leave the interval between its start and end, it is set to the
    nearer of the two, and the remaining unknowns are computed.
    """

    def __init__(self, equations: Equations, solved: Solved, w: fem.Function, comm: MPI.Comm):
        self._n = len(solved.numbers)
        self._first = solved.first
        self._sense = equations.sense
        flat = ScalarList()
        for f in equations.residual:
            flat.add(f)
        for f in equations.residual:
            for z in solved.numbers:
                flat.add(ufl.diff(ufl.as_ufl(f), z))
        self._system = PointValues(flat.components, w, comm)
        known = ScalarList()
        for start in equations.start:
            known.add(start)
        self._ends = equations.end is not None
        if self._ends:
            known.add(equations.end)
        self._known = PointValues(known.components, w, comm)

    def __call__(self, full: Array) -> None:
        """Solve at all points; write solutions and inverse Jacobians into columns of ``full``."""
        n = self._n
        first = self._first
        known = self._known(full)
        start = known[:, :n]
        end = known[:, n] if self._ends else np.full(len(full), self._sense * np.inf)
        if not self._sense:
            z = self._solved(full, start, start)
        else:
            z = self._with_first_prescribed(full, start, start[:, 0])
            moves = self._force(full, z) < 0
            if self._ends:
                some = full[moves]
                last = self._with_first_prescribed(some, start[moves], end[moves])
                z[moves] = last
                moves[moves] = self._force(some, last) > 0
            z[moves] = self._between(full[moves], z[moves], start[moves], end[moves])
        inverse = _inverse(self._at(full, z)[1])
        full[:, first : first + n] = z
        # A singular Jacobian is replaced by 0, so that the solution is constant to first order.
        inverse = np.where(np.isfinite(inverse), inverse, 0.0)
        full[:, first + n : first + n + n * n] = inverse.reshape(len(full), n * n)

    def _at(self, full: Array, z: Array) -> tuple[Array, Array]:
        """Return the residual F, shape (m, n), and its Jacobian matrix, shape (m, n, n)."""
        n = self._n
        full[:, self._first : self._first + n] = z
        found = self._system(full)
        return found[:, :n], found[:, n:].reshape(len(full), n, n)

    def _force(self, full: Array, z: Array) -> Array:
        """Return the first residual, negative while the monotone first unknown changes further."""
        return self._sense * self._at(full, z)[0][:, 0]

    def _with_first_prescribed(self, full: Array, start: Array, value: Array) -> Array:
        """Solve for the remaining unknowns with the first unknown prescribed."""
        z = start.copy()
        z[:, 0] = value
        if self._n == 1:
            return z
        return self._solved(full, z, start, first_prescribed=True)

    def _between(self, full: Array, z: Array, start: Array, end: Array) -> Array:
        """Return the solution whose first unknown lies between its initial and final values."""
        begin = z.copy()
        if self._ends:
            begin[:, 0] = (start[:, 0] + end) / 2
        else:  # as far as one step of Newton's method
            step = np.abs(self._force(full, start) / self._at(full, z)[1][:, 0, 0])
            good = np.isfinite(step) & (step > 0)
            away = np.where(good, step, 1e-3 * (1.0 + np.abs(start[:, 0])))
            begin[:, 0] = start[:, 0] + self._sense * away
        found = self._solved(full, begin, start, end=end)
        lost = ~np.isfinite(found).all(axis=1)
        if lost.any():
            found[lost] = self._bisected(full[lost], start[lost], begin[lost, 0], end[lost])
        # Stay one floating-point number below the end, where the driving force may be unbounded.
        beyond = self._sense * (end - found[:, 0]) <= 0
        found[beyond, 0] = np.nextafter(end[beyond], start[beyond, 0])
        return found

    def _bisected(self, full: Array, start: Array, first: Array, end: Array) -> Array:
        """Return the solution of `_between` by bisection; NaN where this fails too.

        Newton's method fails, for example, if the first unknown changes from 0 by less than the
        round-off of its equation. No correction is then small relative to the unknown.
        """
        low = start[:, 0].copy()
        high = end.copy()
        if not self._ends:
            high = first.copy()
            for _ in range(_MOST_GROWN):
                short = self._force(full, self._with_first_prescribed(full, start, high)) < 0
                if not short.any():
                    break
                low[short] = high[short]
                high[short] += 2.0 * (high[short] - start[short, 0])
        for _ in range(_MOST_HALVED):
            middle = low + (high - low) / 2
            short = self._force(full, self._with_first_prescribed(full, start, middle)) < 0
            low = np.where(short, middle, low)
            high = np.where(short, high, middle)
        return self._with_first_prescribed(full, start, high)

    def _solved(
        self,
        full: Array,
        z: Array,
        start: Array,
        *,
        first_prescribed: bool = False,
        end: Array | None = None,
    ) -> Array:
        """Solve by a damped Newton method; return NaN where it fails.

        Steps are reduced until the next correction is smaller, the natural monotonicity test of
        Deuflhard (Newton Methods for Nonlinear Problems, 2004, section 3.3), which does not depend
        on units. They are also limited by the final value ``end`` of the first unknown.
        """
        z = z.copy()
        n = self._n
        active = np.arange(len(full))
        F, J = self._system_at(full, z, first_prescribed)
        for _ in range(_MOST_STEPS):
            inverse = _inverse(J)
            step = -np.einsum("pij,pj->pi", inverse, F)
            size = np.abs(z[active]) + np.abs(z[active] - start[active])
            ready = np.all(np.abs(step) <= _ENOUGH * size, axis=1)
            failed = ~np.isfinite(step).all(axis=1)
            z[active[failed]] = np.nan
            z[active[ready]] += step[ready]
            go = ~(ready | failed)
            active, step, inverse, size = (v[go] for v in (active, step, inverse, size))
            if not len(active):
                return z
            scale = size + np.abs(step) + np.finfo(float).tiny
            measure = np.max(np.abs(step) / scale, axis=1)
            cut: Array = np.ones(len(active))
            if end is not None:
                ends = start[active, 0], end[active]
                cut = _cut(z[active, 0], step[:, 0], *ends)
            F = np.zeros((len(active), n))
            J = np.zeros((len(active), n, n))
            left: Ints = np.arange(len(active))
            for _ in range(_MOST_CUTS):
                trial = z[active[left]] + cut[left, None] * step[left]
                F[left], J[left] = self._system_at(full[active[left]], trial, first_prescribed)
                next_ = np.abs(np.einsum("pij,pj->pi", inverse[left], F[left])) / scale[left]
                good = np.max(next_, axis=1) <= (1.0 - cut[left] / 2) * measure[left]
                left = left[~good]
                if not len(left):
                    break
                cut[left] /= 2
            z[active] += cut[:, None] * step
            z[active[left]] = F[left] = np.nan
        z[active] = np.nan
        return z

    def _system_at(self, full: Array, z: Array, first_prescribed: bool) -> tuple[Array, Array]:
        """Return residual and Jacobian; the equation of a fixed first unknown is replaced."""
        F, J = self._at(full, z)
        if first_prescribed:
            F[:, 0] = 0.0
            J[:, 0, :] = 0.0
            J[:, :, 0] = 0.0
            J[:, 0, 0] = 1.0
        return F, J


def _cut(z: Array, step: Array, start: Array, end: Array) -> Array:
    """Return factors shortening Newton steps to keep the first unknown between start and end."""
    parts = [
        np.where(step * (e - z) > 0, _TO_THE_END * (e - z) / step, np.inf) for e in (start, end)
    ]
    return np.fmin(1.0, np.fmin(*parts))


def _inverse(J: Array) -> Array:
    """Return the inverses of m matrices, shape (m, n, n); NaN for singular matrices."""
    if J.shape[1] == 1:
        return np.where(J == 0.0, np.nan, 1.0 / J)
    found = np.full_like(J, np.nan)
    good: Mask = np.asarray(np.isfinite(J).all(axis=(1, 2)))
    good[good] = np.abs(np.linalg.det(J[good])) > 0
    found[good] = np.linalg.inv(J[good])
    return found
