# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Two-parameter contact problems in the plane, and states with one point at a border.

At m contact points w = (a, r) are displacements a = (ut, un) and forces r = (rt, rn), with

    S a - r = p + gamma q + mu v,        F = F_0 + mu F_1 >= 0

and Coulomb's law at every point. mu is the friction coefficient, or a second load. In a piece every
point has a status; on a *border* one point is between two statuses (`laws.coulomb`). There the
state is w = B(mu) z with 2 m - 1 unknowns z. Let M w = S a - r. For every mu, z and gamma solve

    [M B(mu), -q] (z, gamma) = p + mu v,

a system of 2 m equations whose matrix is affine in mu. Hence gamma and the slacks of all
inequalities are rational functions of mu. At mu = c + t, let G + t E be the matrix and h + t h' the
right-hand side. A function (s + t s') (z, gamma) - b vanishes where

    det (P_0 + t P_1) = det [[G + t E, h + t h'], [s + t s', b]] = 0,

that is, where 1/t is an eigenvalue of - P_0^{-1} P_1, if the function does not vanish at c. Thus
all ends of a border are found without stepping along it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.linalg import block_diag

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact.laws.coulomb import BASES, BORDERS, FIRST_BORDER, INSIDE, WITHOUT_FRICTION
from dolfinx_contact.laws.status import OPEN, PLUS
from dolfinx_contact.proofs.check_proof import ReducedProblem

__all__ = ["ContactFamily", "Frame"]


_REAL = 1e-6  # relative imaginary part of an eigenvalue that may be real
_ROUND_OFF = 2.0**-50  # relative error bound of a sum of three products
_SINGULAR = 1e13  # condition number from which on a matrix counts as singular
# Trial centres, as fractions of an interval.
_PARTS = (0.6180339887, 0.3819660113, 0.7320508076, 0.2679491924)
_POLISH = 6  # steps of Newton's method


@dataclass(frozen=True, eq=False)
class ContactFamily:
    """Contact problem at m points with two parameters, in the notation of the module.

    Attributes:
        S: stiffness (2 m, 2 m), ordered ut, un point by point.
        p: load at gamma = mu = 0, shape (2 m,).
        q: derivative of the load with respect to gamma, shape (2 m,).
        v: derivative of the load with respect to mu, shape (2 m,).
        friction: friction coefficients at mu = 0, shape (m,).
        friction_rate: derivatives of the friction coefficients with respect to mu, shape (m,).
        S_error: error bounds of S, shape (2 m, 2 m); None for an exact S.
        p_error: error bounds of the load, shape (2 m,).
        q_error: increase of the error bounds of the load per unit of |gamma|, shape (2 m,).
        reach: largest slips for which small sliding is accurate, shape (m,); infinite on flat
            obstacles (`reduced.gathered.GatheredPoints`). None means infinite at all points.
        comm: communicator of the ranks holding the same family and sharing the work.
    """

    S: Array
    p: Array
    q: Array
    v: Array
    friction: Array
    friction_rate: Array
    S_error: Array | None = None
    p_error: Array | None = None
    q_error: Array | None = None
    reach: Array | None = None
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_SELF)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickling without the communicator; an unpickled copy is local."""
        return {name: value for name, value in vars(self).items() if name != "comm"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, comm=MPI.COMM_SELF)

    def are_small(self, slips: Iterable[Array]) -> bool:
        """Return whether all slips are within `reach`.

        Args:
            slips: slips of each solution, shape (m,) each.
        """
        reach = self.reach
        return reach is None or all(bool(np.all(np.abs(slip) <= reach)) for slip in slips)

    @property
    def points(self) -> int:
        """Number m of contact points."""
        return len(self.friction)

    @cached_property
    def frictionless(self) -> Mask:
        """Mask of the points without friction at every mu, shape (m,).

        If closed, such a point has the status `PLUS`, as if it slipped.
        """
        return np.asarray((self.friction == 0) & (self.friction_rate == 0))

    @cached_property
    def size(self) -> float:
        """Mean diagonal entry of the stiffness, by which displacements are compared with forces."""
        return float(np.abs(np.diag(self.S)).mean())

    def problem(self, mu: float, gamma: float) -> ReducedProblem:
        """Return the reduced problem at (mu, gamma), with error bounds.

        Raises:
            ValueError: if the stiffness, within its bounds, is not proved to be positive definite.
        """
        parts = self.p, gamma * self.q, mu * self.v
        p_error = _ROUND_OFF * np.sum(np.abs(parts), axis=0)
        if self.p_error is not None and self.q_error is not None:
            p_error = p_error + self.p_error + abs(gamma) * self.q_error
        friction = self.friction + mu * self.friction_rate
        p = np.asarray(np.sum(parts, axis=0))
        return ReducedProblem(self.S, p, friction, None, self.S_error, np.asarray(p_error))

    def basis(self, i: int, code: int, mu: float) -> Array:
        """Return the matrix from the free unknowns of a point to its state, shape (4, unknowns).

        The status or border ``code`` selects the free components of (ut, un, rt, rn).
        """
        F = self.friction[i] + mu * self.friction_rate[i]
        constant, slope = BASES[code]
        return np.array(constant).T + F * np.array(slope).T

    def bases(self, codes: Codes, mu: float) -> Array:
        """Return the matrices from all free unknowns to the states, shape (m, 4, unknowns).

        The statuses ``codes``, with at most one border, select the free components.
        """
        parts = [self.basis(i, int(code), mu) for i, code in enumerate(codes)]
        return np.asarray(block_diag(*parts).reshape(self.points, 4, -1))

    def inequalities(self, i: int, code: int) -> list[tuple[Array, Array, int]]:
        """Return the inequalities (C_0 + mu C_1) w >= 0 of a status or border at point ``i``.

        Each is a tuple of C_0, C_1, and the status that the point takes instead if its state
        w = (ut, un, rt, rn) violates the inequality.
        """
        if self.frictionless[i]:
            return WITHOUT_FRICTION[code]
        F = self.friction[i]
        rate = self.friction_rate[i]
        return [(c + F * slope, rate * slope, target) for c, slope, target in INSIDE[code]]

    def columns(self, codes: Codes) -> tuple[Array, Array]:
        """Return E_0 and E_1 of the equilibrium S a - r = (E_0 + mu E_1) z, shape (2 m, unknowns).

        The unknowns z, left free by the statuses, determine displacements a and forces r.
        """
        at_0, at_1 = (
            self.S @ B[:, :2].reshape(len(self.S), -1) - B[:, 2:].reshape(len(self.S), -1)
            for B in (self.bases(codes, 0.0), self.bases(codes, 1.0))
        )
        return at_0, at_1 - at_0

    def state(self, codes: Codes, z: Array, mu: float) -> Array:
        """Return the states (ut, un, rt, rn) of all points for free unknowns z, shape (m, 4)."""
        return np.asarray(self.bases(codes, mu) @ z)

    def held(self, i: int, w: Array, mu: float, tolerance: float) -> list[int]:
        """Return the codes of all statuses and borders whose conditions a point satisfies.

        Args:
            i: index of the point.
            w: state (ut, un, rt, rn) of the point, shape (4,).
            mu: second parameter.
            tolerance: largest violation of a condition that counts as zero, as a force.
        """
        units = np.array([self.size, self.size, 1.0, 1.0])
        found = []
        for code in range(FIRST_BORDER + len(BORDERS)):
            if self.frictionless[i] and code not in (OPEN, PLUS, FIRST_BORDER):
                continue
            B = self.basis(i, code, mu) * units[:, None]
            scaled = w * units
            off = scaled - B @ np.linalg.lstsq(B, scaled, rcond=None)[0]
            if np.abs(off).max() > tolerance:
                continue
            rows = [(c + mu * d) / units for c, d, _ in self.inequalities(i, code)]
            if all(row @ scaled >= -tolerance * np.abs(row).max() for row in rows):
                found.append(code)
        return found


class Frame:
    """Border of a family, on which the state and the load gamma are functions of mu.

    Args:
        family: problem with two parameters.
        codes: statuses of the points, exactly one of them a border, shape (m,).
    """

    def __init__(self, family: ContactFamily, codes: Codes):
        self.family = family
        self.codes = codes
        (self.point,) = (int(i) for i in np.flatnonzero(codes >= FIRST_BORDER))
        self.pair = BORDERS[codes[self.point] - FIRST_BORDER]
        A, E = family.columns(codes)
        self._G = np.column_stack([A, -family.q])
        self._E = np.column_stack([E, np.zeros(len(A))])
        self._slacks = self._functions()

    def _functions(self) -> tuple[Array, Array]:
        """Return s_0 and s_1 of the slacks (s_0 + mu s_1) y with y from `solve`.

        Shape (slacks, 2 m) each.
        """
        f = self.family
        B_0 = f.bases(self.codes, 0.0)
        B_1 = f.bases(self.codes, 1.0) - B_0
        # Inequality and basis of a status never both depend on the friction.
        rows = [
            (C_0 @ B_0[i], C_0 @ B_1[i] + C_1 @ B_0[i])
            for i, code in enumerate(self.codes)
            for C_0, C_1, _ in f.inequalities(i, int(code))
        ]
        n = len(self._G)
        both = np.pad(np.array(rows).reshape(-1, 2, n - 1), ((0, 0), (0, 0), (0, 1)))
        return both[:, 0], both[:, 1]

    def solve(self, mu: float) -> Array | None:
        """Return the unknowns and gamma at mu, shape (2 m,); None if the equations are singular."""
        f = self.family
        try:
            y = np.asarray(np.linalg.solve(self._G + mu * self._E, f.p + mu * f.v), dtype=float)
        except np.linalg.LinAlgError:
            return None
        return y if np.isfinite(y).all() else None

    def gamma(self, mu: float) -> float:
        """Return gamma at mu; NaN if the equations of the border are singular."""
        y = self.solve(mu)
        return float("nan") if y is None else float(y[-1])

    def state(self, mu: float) -> Array | None:
        """Return the states (ut, un, rt, rn) at mu, shape (m, 4); None as for `solve`."""
        y = self.solve(mu)
        return None if y is None else self.family.state(self.codes, y[:-1], mu)

    def slacks(self, mu: float) -> Array:
        """Return the slacks of all inequalities at mu; NaN if the equations are singular."""
        y = self.solve(mu)
        s_0, s_1 = self._slacks
        return np.full(len(s_0), np.nan) if y is None else np.asarray((s_0 + mu * s_1) @ y)

    def is_inside(self, mu: float) -> bool:
        """Return whether the state at mu strictly satisfies all inequalities."""
        slacks = self.slacks(mu)
        return bool(np.isfinite(slacks).all() and slacks.min(initial=np.inf) > 0)

    # -- ends ------------------------------------------------------------------------------------

    def ends(self, span: tuple[float, float], gammas: tuple[float, float]) -> Array:
        """Return all mu in an interval at which the border may end, in increasing order.

        There a slack vanishes, gamma reaches an end of its range, or the equations are singular.

        Args:
            span: interval of mu.
            gammas: range of gamma.
        """
        f = self.family
        s_0, s_1 = self._slacks
        n = len(self._G)
        unit = np.zeros((2, n))
        unit[:, -1] = 1.0
        rows = np.concatenate([s_0, unit]), np.concatenate([s_1, np.zeros((2, n))])
        targets = np.concatenate([np.zeros(len(s_0)), gammas])
        pencil = _Pencil.within(self._G, self._E, span)
        if pencil is None:
            return np.zeros(0)
        found = pencil.singular(span)
        for s, slope, target in zip(*rows, targets, strict=True):
            roots = pencil.roots(f.p, f.v, s, slope, target, span)
            found += [self._polished(mu, s, slope, target) for mu in roots]
        inside = [mu for mu in found if span[0] < mu < span[1]]
        return np.array(sorted(inside), dtype=float)

    def _polished(self, mu: float, s_0: Array, s_1: Array, target: float) -> float:
        """Improve a root mu of (s_0 + mu s_1) y = target by Newton's method.

        y is the solution of `solve` at mu. The value with the smallest error is returned.
        """
        f = self.family
        best = mu
        least = np.inf
        for _ in range(_POLISH):
            y = self.solve(mu)
            if y is None:
                return best
            value = float((s_0 + mu * s_1) @ y - target)
            if not abs(value) < least:
                return best
            best = mu
            least = abs(value)
            dy = np.linalg.solve(self._G + mu * self._E, f.v - self._E @ y)
            slope = float(s_1 @ y + (s_0 + mu * s_1) @ dy)
            if value == 0 or slope == 0:
                return best
            mu -= value / slope
        return best

    # -- the pieces on either side ---------------------------------------------------------------

    def piece(self, which: int) -> Codes:
        """Return the statuses of the piece on one side of the border (0 or 1), shape (m,)."""
        codes = self.codes.copy()
        codes[self.point] = self.pair[which]
        return codes

    def turns(self, which: int, span: tuple[float, float]) -> Array:
        """Return the mu in an interval at which the equations on one side are singular.

        They are in increasing order. ``which`` is the side, 0 or 1.
        """
        A, E = self.family.columns(self.piece(which))
        pencil = _Pencil.within(A, E, span)
        return np.array(sorted(pencil.singular(span)) if pencil is not None else [], dtype=float)

    def sense(self, which: int, mu: float) -> float:
        """Return the sign of dgamma along the solutions entering one side (0 or 1) of the border.

        It is 0 if the equations on this side are singular.
        """
        f = self.family
        codes = self.piece(which)
        A, E = f.columns(codes)
        mine = int(codes[self.point])
        other = self.pair[1 - which]
        # The slip of a closing point has the sign of its ut.
        C_0, C_1 = next(
            (constant, slope)
            for constant, slope, beyond in f.inequalities(self.point, mine)
            if beyond == other or mine == OPEN
        )
        try:
            dz = np.asarray(np.linalg.solve(A + mu * E, f.q), dtype=float)
        except np.linalg.LinAlgError:
            return 0.0
        dw = f.state(codes, dz, mu)[self.point]
        return float(np.sign((C_0 + mu * C_1) @ dw))

    def kind(self, mu: float) -> str:
        """Return the kind of a status change: ``"fold"`` if branches turn back, or ``"event"``."""
        return "fold" if self.sense(0, mu) == self.sense(1, mu) else "event"


class _Pencil:
    """Matrix pencil G + mu E, in which E has few nonzero columns.

    Args:
        E: derivative of the matrix with respect to mu.
        inverse: inverse of the matrix at ``center``.
        center: value of mu at which the matrix is regular.
    """

    def __init__(self, E: Array, inverse: Array, center: float):
        self.E = E
        self.inverse = inverse
        self.center = center
        self.columns = np.flatnonzero(np.abs(E).max(axis=0) > 0)
        self._by = inverse @ E

    @classmethod
    def within(cls, G: Array, E: Array, span: tuple[float, float]) -> _Pencil | None:
        """Return the pencil G + mu E about a regular mu of an interval; None if none is found."""
        for part in _PARTS:
            center = span[0] + part * (span[1] - span[0])
            A = G + center * E
            unit = np.abs(A).max(axis=0)
            if unit.min() > 0:
                try:
                    inverse = np.linalg.inv(A / unit)
                except np.linalg.LinAlgError:
                    continue
                size = np.abs(A / unit).sum(axis=1).max() * np.abs(inverse).sum(axis=1).max()
                if size < _SINGULAR:
                    return cls(E, inverse / unit[:, None], center)
        return None

    def _shifts(self, X: Array, span: tuple[float, float]) -> list[float]:
        """Return all mu in the interval for which 1 / (mu - center) is an eigenvalue of X."""
        values = np.linalg.eigvals(X)
        near = np.abs(values) * (span[1] - span[0]) >= 1
        real = values[near & (np.abs(values.imag) <= _REAL * np.abs(values))].real
        found = (self.center + 1.0 / float(x) for x in real)
        return [mu for mu in found if span[0] < mu < span[1]]

    def singular(self, span: tuple[float, float]) -> list[float]:
        """Return all mu in an interval at which the matrix of the pencil is singular."""
        return self._shifts(-self._by[np.ix_(self.columns, self.columns)], span)

    def roots(
        self, p: Array, v: Array, s: Array, slope: Array, target: float, span: tuple[float, float]
    ) -> list[float]:
        """Return all mu in an interval with (s + mu slope) y = target, (G + mu E) y = p + mu v."""
        y = self.inverse @ (p + self.center * v)
        row = s + self.center * slope
        value = float(row @ y - target)
        if abs(value) <= 1e-13 * float(np.abs(row) @ np.abs(y) + abs(target)):
            return []  # it vanishes everywhere
        used = np.union1d(self.columns, np.flatnonzero(slope))
        right = np.column_stack([self._by[:, used], self.inverse @ v])
        last = (np.append(slope[used], 0.0) - row @ right) / -value
        X = np.vstack([(right - np.outer(y, last))[used], last])
        return self._shifts(-X, span)
