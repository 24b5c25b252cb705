# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Which quadratic inequalities a solution satisfies beside a known one.

Let b solve a piece, xi_b be such that rt_b = -F xi_b rn_b with xi_b in the sign of ut_b, and a be
any solution whose statuses are in given sets; d = a - b, e = S d. Then, point by point,

    dt (et + F xi_b en) = -F rn_a (xi_a - xi_b) dt <= 0,
    dn (en + theta et) = -un_a (rn_b + theta rt_b) - un_b (rn_a + theta rt_a) <= 0, |theta| <= 1/F,

since the graph of the sign is monotone, rn_a >= 0, and gap and force exclude each other; with a
bound g given in advance F is 0 in them. This is Renard's criterion of uniqueness (SIAM J. Math.
Anal. 38, 2006), with a weight of its own for every inequality. Strict complementarity of b and the
bounds of a (`energy.py`) strengthen them:

    dn (en + theta et) <= -(1 - F |theta|) rn_b / Un dn^2        where b is closed,
                       <= -(1 - F |theta|) un_b / Rn en^2        where b is open,
    dt f <= -|ut_b| / S f^2     of a slip, f = et +- F en, which is the slack s+- of a (bound S).

Where sets of statuses hold equalities for a and b alike (both slip to the right, say) these are
rows f = 0; of stick and one slip the product of slack and slip vanishes for a and b, and gives
dt f <= -s_b / U dt^2 or -|ut_b| / S f^2. In no case is b itself required to be a solution: its
inequalities at points whose statuses are decided are not used.

**If a weighted sum of the left sides, with any weights of the squares of the rows f = 0, is a
positive definite form of d, then d = 0: no solution with these statuses is other than b.**
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.pieces import Piece
from dolfinx_contact.analysis.reduced_problem import (
    CLOSED,
    FREE,
    IS_FREE,
    IS_OPEN,
    OPENED,
    SENSE,
    Masks,
)
from dolfinx_contact.analysis.rounding import down, gamma, positive_definite, up

__all__ = ["Differences", "differences"]

Array = npt.NDArray[np.float64]


@dataclass
class _Row:
    """d_v (S_v d + x S_w d + k1 d_v) + k2 f^2 <= 0, or f = S_v d + x S_w d = 0."""

    unknown: int
    x: float = 0.0
    x_off: float = 0.0
    equal: bool = False
    k1: float = 0.0
    k2: float = 0.0
    theta: bool = False


@dataclass(frozen=True, eq=False)
class Differences:
    """The inequalities as a form of the unknown components d of a difference.

    Attributes:
        piece: of b.
        unknown: components that may differ (n,), of 2 m.
        R: rows f = R d (n, n).
        off: by how much R may be off.
        T: rows that theta adds (n, n), and by how much they may be off.
        equal: rows f = 0.
        k1, k2: as above.
    """

    piece: Piece
    unknown: npt.NDArray[np.int64]
    R: Array
    off: Array
    T: Array
    T_off: Array
    equal: npt.NDArray[np.bool_]
    k1: Array
    k2: Array

    @property
    def tilted(self) -> npt.NDArray[np.bool_]:
        """Rows that take a theta."""
        return np.any(self.T != 0, axis=1)

    def prove(self, weights: Array, theta: Array, mu: float) -> bool:
        """Whether the weighted sum is positive definite, whatever the errors.

        Args:
            weights: nonnegative (n,), those of rows f = 0 not used.
            theta: |theta| <= 1 / F (n,), used where `tilted`.
            mu: >= 0, weight of the squares of the rows f = 0.
        """
        n = len(self.unknown)
        if n == 0:
            return True
        F = self.piece.problem.friction[self.unknown // 2]
        theta = np.where(self.tilted, theta, 0.0)
        keeps = 1.0 - F * np.abs(theta) - gamma(4)
        if (weights < 0).any() or not mu >= 0 or (keeps[self.tilted] < 0).any():
            return False
        keeps = np.where(self.tilted, keeps, 1.0)
        w = np.where(self.equal, 0.0, weights)
        # Of the rows f = 0 the weight of the square is made dimensionless.
        size = np.abs(np.diag(self.R))
        square = np.where(self.equal, mu / np.where(size > 0, size, 1.0), down(w * self.k2 * keeps))
        linear = self.R + theta[:, None] * self.T
        off = (
            self.off
            + np.abs(theta)[:, None] * self.T_off
            + gamma(2) * (np.abs(self.R) + np.abs(theta[:, None] * self.T))
        )
        half = w[:, None] * linear
        half_off = w[:, None] * (off + gamma(2) * np.abs(linear))
        form = (half + half.T) / 2 + np.diag(down(w * self.k1 * keeps))
        product = self.R.T @ (square[:, None] * self.R)
        form += (product + product.T) / 2
        size = np.abs(self.R)
        products = size.T @ (square[:, None] * (self.off + gamma(n + 4) * size))
        products += self.off.T @ (square[:, None] * (size + self.off))
        error = (half_off + half_off.T) / 2 + products + gamma(4) * np.abs(form)
        return positive_definite(form, up(error))


def differences(piece: Piece, allowed: Masks, ub: Array) -> Differences | None:
    """The inequalities; None if b does not certainly satisfy what they need.

    Args:
        piece: of b, with statuses in the sets of points where they are decided.
        allowed: sets of statuses of a, masks (m,).
        ub: bounds of the slots of a (6, m).
    """
    rows: list[_Row] = []
    for i in range(len(allowed)):
        found = _rows_of(piece, i, int(allowed[i]), ub[:, i])
        if found is None:
            return None
        rows += found
    problem = piece.problem
    v = np.array([row.unknown for row in rows], dtype=np.int64)
    other = v ^ 1
    x, x_off = np.array([r.x for r in rows]), np.array([r.x_off for r in rows])
    S, dS = problem.S[np.ix_(v, v)], problem.dS[np.ix_(v, v)]
    cross, dcross = problem.S[np.ix_(other, v)], problem.dS[np.ix_(other, v)]
    tilted = np.array([r.theta for r in rows], dtype=bool)[:, None]
    R = S + x[:, None] * cross
    off = dS + np.abs(x)[:, None] * dcross + x_off[:, None] * (np.abs(cross) + dcross)
    off = up(off + gamma(2) * (np.abs(S) + np.abs(x[:, None] * cross)))
    return Differences(
        piece,
        v,
        R,
        off,
        np.where(tilted, cross, 0.0),
        np.where(tilted, dcross, 0.0),
        np.array([r.equal for r in rows], dtype=bool),
        np.array([r.k1 for r in rows]),
        np.array([r.k2 for r in rows]),
    )


def _rows_of(piece: Piece, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """The rows of one point; None if b does not fit."""
    code = int(piece.codes[i])
    opens, closes = bool(allowed & OPENED), bool(allowed & CLOSED)
    if (IS_OPEN[code] and not opens) or (not IS_OPEN[code] and not closes):
        return None
    F, g = float(piece.problem.friction[i]), float(piece.problem.g[i])
    if F > 0:
        tangential = _coulomb(piece, i, allowed, ub)
    elif g > 0:
        tangential = _bounded(piece, i, allowed, ub)
    else:
        tangential = [_Row(2 * i, equal=True)]
    if tangential is None:
        return None
    if not opens:
        return tangential
    row = _Row(2 * i + 1, equal=not closes)
    if closes:
        gap, force = float(piece.un.low[i]), float(piece.rn.low[i])
        slips_one_way = F > 0 and allowed in (0b0101, 0b1001)
        if not (gap >= 0 if IS_OPEN[code] else force >= 0):
            return None
        most = min(ub[5], (ub[3] + ub[4]) / (2 * F)) if F > 0 else ub[5]
        row.k1 = 0.0 if IS_OPEN[code] else _ratio(force, ub[2])
        row.k2 = _ratio(gap, float(up(most))) if IS_OPEN[code] else 0.0
        row.theta = F > 0 and not slips_one_way
    return [*tangential, row]


def _ratio(part: float, most: float) -> float:
    """A lower bound of a quotient of positive numbers; 0 if it is not sure to be one."""
    return float(down(np.float64(part / most))) if part > 0 and most > 0 else 0.0


def _coulomb(piece: Piece, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """Of a point with a coefficient of friction."""
    code, F, t = int(piece.codes[i]), float(piece.problem.friction[i]), 2 * i
    if allowed == 0b0001:
        return [_Row(t, equal=True)]
    if allowed == 0b0010:
        return [] if code == 1 else None
    for sense, slip in ((1, 0b0100), (-1, 0b1000)):
        if allowed in (slip, slip | 1):
            # The status is open, or this slip.
            return [_Row(t, sense * F, equal=True)] if 1 << code & (slip | 1) else None
        if allowed == slip | 2:
            k = _one_way(piece, i, sense, ub)
            return None if k is None else [_Row(t, sense * F, k1=k[0], k2=k[1])]
    plus, minus = (float(s.low[i]) for s in piece.slacks)
    if code == 1:
        rn, rt = piece.rn, piece.rt
        pressed = plus >= 0 and minus >= 0
        # With the status known to be closed the law may hold for a negative rn.
        drawn = not allowed & 1 and max(float(s.high[i]) for s in piece.slacks) <= 0
        least = float(rn.low[i] if pressed else -rn.high[i])
        if not (pressed or drawn) or least <= 0:
            return None
        ratio = float(-rt.value[i] / rn.value[i])
        away = (rt.away[i] + abs(ratio) * rn.away[i]) / least + gamma(4) * abs(ratio)
        return [_Row(t, ratio, float(up(away)))]
    return _slip(piece, i, ub)


def _slip(piece: Piece, i: int, ub: Array) -> list[_Row] | None:
    """Of a point that slips in b, or is open."""
    ut, sense, F = piece.ut, int(SENSE[piece.codes[i]]), float(piece.problem.friction[i])
    right, left = float(ut.low[i]), float(-ut.high[i])
    for way, slid, slack in ((1, right, ub[3]), (-1, left, ub[4])):
        if sense in (0, way) and slid >= 0:
            return [_Row(2 * i, way * F, k2=_ratio(slid, slack))]
    return None


def _one_way(piece: Piece, i: int, sense: int, ub: Array) -> tuple[float, float] | None:
    """k1 and k2 where only stick and the slip of one sense are left; None if b does not fit."""
    code, k = int(piece.codes[i]), 0 if sense > 0 else 1
    slack = float(piece.slacks[k].low[i])
    slid = float(piece.ut.low[i] if sense > 0 else -piece.ut.high[i])
    if not IS_FREE[code]:
        return (_ratio(slack, ub[k]), 0.0) if slack >= 0 else None
    if SENSE[code] != sense or not slid >= 0:
        return None
    return 0.0, _ratio(slid, ub[3 + k])


def _bounded(piece: Piece, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """Of a point whose shear has a bound given in advance."""
    code, t = int(piece.codes[i]), 2 * i
    if not allowed & FREE:
        return None if IS_FREE[code] else []
    senses = {int(SENSE[s]) for s in range(1, 7) if allowed >> s & 1}
    if len(senses) == 1:
        return [_Row(t, equal=True)] if senses == {int(SENSE[code])} else None
    if len(senses) == 2 and 0 in senses:
        k = _one_way(piece, i, max(senses, key=abs), ub)
        return None if k is None else [_Row(t, k1=k[0], k2=k[1])]
    plus, minus = (float(s.low[i]) for s in piece.slacks)
    if IS_FREE[code]:
        return _slip(piece, i, ub)
    if plus < 0 or minus < 0:
        return None
    return [_Row(t, k1=min(_ratio(plus, ub[0]), _ratio(minus, ub[1])))]
