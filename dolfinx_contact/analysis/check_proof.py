# SPDX-License-Identifier: LGPL-3.0-or-later
"""The checker of proofs: all that has to be trusted of them, in one file.

    python3 check_proof.py PROOF
    python3 -m dolfinx_contact check PROOF

say what a stored proof (`Certificate.save`) proves, of which data; the second way is the same code
and needs all that the package needs, the first needs Python and numpy alone. The exit status is 0
only where the proof holds; 1 where the file is no proof, was changed, does not prove what it says
or leaves something open; 2 where there is no file, or no numpy.

The search (`branching.py`) proposes steps, by optimisers and linear programs that may be wrong;
this file follows them, with bounds for all round-off, and takes nothing from them but numbers. A
step that does not prove what it says makes the whole proof worthless. To be read by itself it
repeats on purpose what other modules of the package know as well: statuses, Coulomb's law, its
pieces. It imports none of them; they may import it.

What is proved is about the numbers S, p, F and g that stand in the file, and all within their
errors. That these come from a body, a mesh and a load is not part of the proof.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

try:
    import numpy as np
    import numpy.typing as npt
except ModuleNotFoundError:
    if __name__ != "__main__":
        raise
    print("check_proof needs numpy, which this Python does not have", file=sys.stderr)
    sys.exit(2)

__all__ = [
    "CLOSED",
    "FREE",
    "IS_FREE",
    "IS_OPEN",
    "MOST_PIECES",
    "OPENED",
    "SENSE",
    "Certificate",
    "Differences",
    "Interval",
    "InvalidCertificate",
    "Masks",
    "PieceSolution",
    "Proved",
    "ReducedProblem",
    "StatusRegion",
    "Verdict",
    "check",
    "differences",
    "follow",
    "gamma",
    "has_status",
    "least_eigenvalue",
    "main",
    "matrix_of",
    "restricted",
    "solve_piece",
    "up",
    "used",
]

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]
Masks = npt.NDArray[np.int64]
Verdict = Literal["complete", "degenerate", "open"]

#: Of stored proofs, and the numbers that they are about, by the names of `ReducedProblem`.
_FORMAT = "dolfinx_contact proof 1"
_DATA = ("S", "p", "friction", "bound", "S_error", "p_error")


# -- numbers that are rounded ----------------------------------------------------------------------
#
# What can be said for certain with numbers that are rounded.
#
# With the unit round-off u = 2^-53 and gamma_n = n u / (1 - n u), a product of matrices over n
# terms is off by at most gamma_n |A| |B|, in whatever order it is summed (Higham, Accuracy and
# Stability of Numerical Algorithms, section 3.5). Bounds are sums of nonnegative numbers; rounded,
# these are too small by less than 2^-30 of themselves as long as fewer than 10^6 operations lie
# behind them, which `up` makes good. Numbers are expected to be scaled: what underflows is below
# `TINY`.


_U = 2.0**-53
TINY = 1e-290
_SLACK = 2.0**-30


def gamma(n: int) -> float:
    """gamma_{n + 4}: of a product over n terms, with some operations more."""
    return (n + 4) * _U / (1 - (n + 4) * _U)


def up(bound: Array) -> Array:
    """A rounded sum of nonnegative numbers, and what rounding may have taken from it."""
    return np.asarray(np.asarray(bound) * (1 + _SLACK) + TINY)


def down(bound: Array | np.float64) -> Array:
    """A lower bound of a nonnegative number whose rounded value is given."""
    return np.asarray(np.asarray(bound) * (1 - _SLACK))


def positive_definite(Q: Array, error: Array) -> bool:
    """Whether every symmetric matrix within ``error`` of ``Q``, entry by entry, is p. definite.

    The matrix is scaled to a diagonal between 1/2 and 2 by powers of two, which is exact. A
    symmetric perturbation moves eigenvalues by no more than the largest row sum of its absolute
    values; and if Cholesky's method runs to its end on A - c I with c >= gamma_{n+1} / (1 -
    gamma_{n+1}) tr A, then A is positive definite (Rump, BIT 46, 2006, theorem 2.3).

    Args:
        Q: symmetric to the last bit, (n, n).
        error: nonnegative, (n, n).
    """
    n = len(Q)
    d = np.diag(Q)
    if n == 0:
        return True
    if not (np.isfinite(Q).all() and np.isfinite(error).all() and (d > TINY).all()):
        return False
    scale = 2.0 ** (-np.round(0.5 * np.log2(d)))
    A = Q * scale[:, None] * scale
    away = up(((error + error.T) / 2 * scale[:, None] * scale).sum(axis=1)).max()
    A[np.arange(n), np.arange(n)] -= up(away + 2 * gamma(n) * np.trace(A))
    try:
        np.linalg.cholesky(A)
    except np.linalg.LinAlgError:
        return False
    return True


def least_eigenvalue(S: Array, error: Array) -> float:
    """A lower bound of the eigenvalues of all matrices within ``error`` of ``S``; 0 if not known.

    Args:
        S: symmetric to the last bit, (n, n).
        error: nonnegative, symmetric (n, n).
    """
    guess = 0.9 * float(np.linalg.eigvalsh(S)[0])
    if not guess > 0:
        return 0.0
    shifted = S - guess * np.eye(len(S))
    rounded = error + np.diag(np.abs(np.diag(S)) + guess) * gamma(1)
    return guess if positive_definite(shifted, rounded) else 0.0


def solved(A: Array, b: Array, A_error: Array, b_error: Array) -> tuple[Array, Array] | None:
    """The solution of A z = b, and by how much it may be off; None if A may be singular.

    With an approximate inverse C and G >= |I - C A| over all A in question, of norm below 1, A is
    regular, and z* - z = C (b - A z) + (I - C A) (z* - z) gives |z* - z| <= v + G e |v| / (1 - |G|)
    for v >= |C (b - A z)| and the vector e of ones (maximum norms).

    Args:
        A: (n, n).
        b: (n,).
        A_error: by which entries of A may be off (n, n).
        b_error: the same of b (n,).
    """
    n = len(b)
    try:
        C = np.linalg.inv(A)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(C).all():
        return None
    z = C @ b
    size = np.abs(C)
    z = z + C @ (b - A @ z)
    products = size @ (gamma(n) * np.abs(A) + A_error)
    G = up(np.abs(np.eye(n) - C @ A) + products + gamma(n) * np.eye(n))
    norm = float(up(G.sum(axis=1)).max())
    if not norm < 0.5:
        return None
    residual = np.abs(b - A @ z) + gamma(n) * (np.abs(b) + np.abs(A) @ np.abs(z))
    v = up(size @ (residual + A_error @ np.abs(z) + b_error))
    return z, up(v + G.sum(axis=1) * (v.max() / (1 - norm)))


# -- the problem -----------------------------------------------------------------------------------
#
# The reduced problem in the plane, whose solutions are to be counted.
#
# At m contact points live a = (ut, un) and the forces r = (rt, rn) on the body, with
#
#     S a = r + p,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn + g,  rt = -(F rn + g) sign(ut)
#
# where ut is not 0. S is symmetric and positive definite; initial gaps are in p. A point has either
# Coulomb friction (F > 0, g = 0), a friction bound given in advance (F = 0, g > 0), or none. What
# is proved holds for all S and p within `S_error` and `p_error` of those given, entry by entry.
#
# Statuses are those of `laws.status`: 0 open, 1 stick, 2 and 3 slip with ut > 0 and < 0, and 4 to 6
# the same at open points under a bound given in advance. Sets of statuses are bit masks.


#: Of every status: whether ut is free, whether un is, and the sense of the slip.
IS_FREE = np.array([True, False, True, True, False, True, True])
IS_OPEN = np.array([True, False, False, False, True, True, True])
SENSE = np.array([0, 0, 1, -1, 0, 1, -1])
#: Sets of statuses: with ut free, open and closed.
FREE = sum(1 << s for s in range(7) if IS_FREE[s])
OPENED = sum(1 << s for s in range(7) if IS_OPEN[s])
CLOSED = 0b1110


def has_status(allowed: Masks) -> npt.NDArray[np.bool_]:
    """Which statuses are in the sets, by point and status (m, 7)."""
    return np.asarray((allowed[:, None] >> np.arange(7)) & 1 > 0)


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """S a = r + p with contact and friction at m points, as above.

    Args:
        S: stiffness, symmetric (2 m, 2 m), ordered ut, un point by point. What it is off from its
            transpose is added to its error.
        p: load (2 m,).
        friction: coefficients F >= 0 (m,).
        bound: forces g >= 0, where F = 0 (m,).
        S_error: by which entries of S may be off (2 m, 2 m).
        p_error: the same of p (2 m,).

    Raises:
        ValueError: if shapes do not fit, a number is not finite or negative that must not be, a
            point has both F and g, or S is not certainly positive definite.
    """

    S: Array
    p: Array
    friction: Array
    bound: Array | None = None
    S_error: Array | None = None
    p_error: Array | None = None

    def __post_init__(self) -> None:
        m = len(self.friction)
        n = 2 * m
        none = np.zeros
        parts = {
            "S": (self.S, (n, n)),
            "p": (self.p, (n,)),
            "friction": (self.friction, (m,)),
            "bound": (none(m) if self.bound is None else self.bound, (m,)),
            "S_error": (none((n, n)) if self.S_error is None else self.S_error, (n, n)),
            "p_error": (none(n) if self.p_error is None else self.p_error, (n,)),
        }
        for name, (given, shape) in parts.items():
            value = np.asarray(given, dtype=np.float64)
            if m == 0 or value.shape != shape:
                raise ValueError(f"{name} must have the shape {shape}, got {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} is not finite")
            if name not in ("S", "p") and (value < 0).any():
                raise ValueError(f"{name} must not be negative")
            object.__setattr__(self, name, value)
        if ((self.friction > 0) & (self.g > 0)).any():
            raise ValueError("a point has either a coefficient of friction or a bound")
        away = np.abs(self.S - self.S.T) + gamma(1) * np.abs(self.S) * (self.S != self.S.T)
        object.__setattr__(self, "S_error", np.maximum(self.dS, self.dS.T) + away)
        object.__setattr__(self, "S", (self.S + self.S.T) / 2)
        if not self.least > 0:
            raise ValueError("the reduced stiffness is not positive definite beyond its error")

    @property
    def g(self) -> Array:
        """Bounds of the shear given in advance (m,)."""
        assert self.bound is not None
        return self.bound

    @property
    def dS(self) -> Array:
        """Errors of S."""
        assert self.S_error is not None
        return self.S_error

    @property
    def dp(self) -> Array:
        """Errors of p."""
        assert self.p_error is not None
        return self.p_error

    @property
    def data(self) -> dict[str, Array]:
        """The numbers that a proof is about, by the names of the arguments."""
        return {name: np.asarray(getattr(self, name)) for name in _DATA}

    @property
    def digest(self) -> str:
        """SHA-256 of S, p, F, g and the errors, hexadecimal: what a proof is about."""
        return _digest(self.data)

    @property
    def points(self) -> int:
        """Number m of contact points."""
        return len(self.friction)

    @cached_property
    def least(self) -> float:
        """A lower bound of the eigenvalues of S; 0 if there is none."""
        return least_eigenvalue(self.S, self.dS)

    @cached_property
    def statuses(self) -> Masks:
        """All statuses that the points can have, as masks (m,)."""
        masks = np.full(self.points, 0b1111, dtype=np.int64)
        masks[self.friction == 0] = 0b0101
        masks[self.g > 0] = 0b1111110
        return masks

    @cached_property
    def units(self) -> tuple[float, float]:
        """Powers of two that are typical of displacements and forces."""
        force = max(float(np.abs(self.p).max()), float(self.g.max()), 1e-290)
        stiffness = 2.0 ** round(float(np.log2(np.diag(self.S).mean())))
        force = 2.0 ** round(float(np.log2(force)))
        return force / stiffness, force

    @cached_property
    def scaled(self) -> ReducedProblem:
        """The same problem in its `units`: powers of two are exact."""
        length, force = self.units
        k = force / length
        S, dS = (np.asarray(v / k) for v in (self.S, self.dS))
        p, g, dp = (np.asarray(v / force) for v in (self.p, self.g, self.dp))
        return replace(self, S=S, p=p, bound=g, S_error=dS, p_error=dp)


# -- bounds by energy ------------------------------------------------------------------------------
#
# Bounds of all solutions by their energy.
#
# Contact does no work and friction dissipates: r.a <= 0 at a solution, so that a.S a <= p.a, an
# ellipsoid. With c = S^-1 p / 2 and rho^2 = p.S^-1 p / 4, a linear functional of a is at most l.c +
# rho (l.S^-1 l)^(1/2) on it, and one of the forces, l.r = S l.a - l.p, at most -l.p / 2 + rho (l.S
# l)^(1/2).
#
# At every point six nonnegative quantities are bounded, the slots, in this order: the parts ut+ and
# ut- of ut = ut+ - ut-, un, the slacks s+ = F rn + g + rt and s- = F rn + g - rt of the friction
# bound, and rn. A status is which of them may differ from zero, where s+ and s- of a point without
# friction do not count.


#: Slots that may be positive, by status: with friction, and without.
_USED = np.zeros((7, 6), dtype=bool)
for _status, _slots in enumerate(["012", "345", "045", "135", "234", "024", "123"]):
    _USED[_status, [int(k) for k in _slots]] = True
_USED_FREE = _USED.copy()
_USED_FREE[2] = [True, True, False, False, False, True]


def bounded(problem: ReducedProblem) -> Array:
    """Upper bounds of the slots of all points, at every solution (6, m)."""
    S = problem.S
    p = problem.p
    m = problem.points
    n = 2 * m
    least = problem.least
    G = np.asarray(np.linalg.inv(S), dtype=np.float64)
    # S x = b is off by no more than its residual over the least eigenvalue.
    off = _residuals(problem, G, np.eye(n), np.zeros((n, n)))
    diagonal = np.maximum(np.diag(G), 0) + np.sqrt(up((off**2).sum(axis=0))) / least
    twice = G @ p
    away = _residuals(problem, twice[:, None], p[:, None], problem.dp[:, None])[:, 0]
    shift = float(np.sqrt(up((away**2).sum()))) / least
    work = p @ twice + gamma(n) * np.abs(p) @ np.abs(twice)
    work += float(np.abs(p).sum() * shift + problem.dp @ (np.abs(twice) + shift))
    rho = float(np.sqrt(up(np.maximum(work, 0)))) / 2
    reach = rho * np.sqrt(up(diagonal))
    t = np.arange(0, n, 2)
    k = np.arange(1, n, 2)
    F = problem.friction
    g = problem.g
    ub: Array = np.zeros((6, m))
    size = np.abs(twice) + shift
    ub[0], ub[1], ub[2] = (
        sign * twice[i] / 2 + reach[i] + 2 * gamma(4) * size[i] + shift
        for sign, i in ((1, t), (-1, t), (1, k))
    )
    D = np.diag(S) + np.diag(problem.dS)
    for slot, sign, normal in ((3, 1.0, F), (4, -1.0, F), (5, 0.0, np.ones(m))):
        form = normal**2 * D[k] + abs(sign) * D[t]
        form += 2 * sign * normal * S[t, k] + 2 * abs(sign) * normal * problem.dS[t, k]
        load = np.abs(p) * gamma(8) + problem.dp
        ub[slot] = -(normal * p[k] + sign * p[t]) / 2 + abs(sign) * g
        ub[slot] += normal * load[k] + abs(sign) * (load[t] + g * gamma(8))
        ub[slot] += rho * np.sqrt(up(np.maximum(form, 0) + gamma(16) * (F**2 * D[k] + D[t])))
    ub = up(np.maximum(ub, 0))
    given = g > 0
    ub[3:5, given] = np.minimum(ub[3:5, given], up(2 * g[given]))
    ub[3:5, (F == 0) & ~given] = 0.0
    return ub


def _residuals(problem: ReducedProblem, x: Array, b: Array, b_error: Array) -> Array:
    """Bounds of |b - S x|, column by column."""
    size = np.abs(x)
    rounded = gamma(len(x)) * (np.abs(b) + np.abs(problem.S) @ size)
    return up(np.abs(b - problem.S @ x) + rounded + problem.dS @ size + b_error)


def used(problem: ReducedProblem) -> npt.NDArray[np.bool_]:
    """Which slots may be positive, by point and status (m, 7, 6)."""
    free = (problem.friction == 0) & (problem.g == 0)
    return np.where(free[:, None, None], _USED_FREE, _USED)


def restricted(problem: ReducedProblem, allowed: Masks, ub: Array) -> Array:
    """The bounds, 0 where no allowed status uses a slot (6, m)."""
    has = has_status(allowed)
    return np.where((has[:, :, None] & used(problem)).any(axis=1).T, ub, 0.0)


# -- multipliers -----------------------------------------------------------------------------------
#
# What a vector of multipliers proves about statuses, by weak duality.
#
# At every solution 0 = y.(S a - r - p) for any y. Point by point the slots lie in the boxes of the
# statuses that are still allowed, so that
#
#     0 >= L(y) = sum_i min_s h_is(y) - y.p,    h_is = sum over the slots of s of min(0, c_ij) ub_ij
#
# with the coefficients c of the slots in y.(S a - r). Where L > 0 there is no solution; where L > 0
# with point i held in status s, that status is impossible there. The minimum over the statuses is
# that over the convex hull of their boxes, so nothing is lost against the linear program from which
# y comes; and nothing depends on how y was found.


@dataclass(frozen=True, eq=False)
class Dual:
    """A vector of multipliers y of the rows S a - r = p.

    Args:
        problem: scaled.
        y: multipliers (2 m,).
    """

    problem: ReducedProblem
    y: Array

    @cached_property
    def _of_a(self) -> Array:
        return self.problem.S @ self.y

    @cached_property
    def coefficients(self) -> Array:
        """Of the slots in y.(S a - r), without what g contributes (6, m)."""
        a = self._of_a
        rt = -self._shear
        rn = -self._pressure
        return np.stack([a[0::2], -a[0::2], a[1::2], rt + rn, rn - rt, -self.y[1::2]])

    @property
    def _shear(self) -> Array:
        """What y counts of s+ - s- (m,)."""
        return np.where(self.problem.g > 0, 0.0, self.y[0::2] / 2)

    @property
    def _pressure(self) -> Array:
        """What y counts of s+ + s-, which is 2 F rn (m,)."""
        F = self.problem.friction
        return np.divide(self.y[1::2], 2 * F, out=np.zeros_like(F), where=F > 0)

    @cached_property
    def _given(self) -> Array:
        """Minima of -yt rt over shears of a bound given in advance, by point and status."""
        most = (self.problem.g * self.y[0::2])[:, None]
        return np.where(SENSE == 0, -np.abs(most), SENSE * most)

    def least(self, ub: Array, less: tuple[int, int] | None = None) -> Array:
        """The h by point and status (m, 7).

        Args:
            ub: bounds of the slots (6, m).
            less: slot and point from whose coefficient 1 is taken.
        """
        c = self.coefficients
        if less is not None:
            c = c.copy()
            c[less] -= 1.0
        uses = used(self.problem).copy()
        F = self.problem.friction
        # rn is (s+ + s-) / 2 F where F > 0, and s+, s- are in g where that is given.
        uses[F > 0, :, 5] = False
        uses[F == 0, :, 3:5] = False
        per_slot = (np.minimum(c, 0) * ub).T
        return np.einsum("msj,mj->ms", uses, per_slot) + self._given

    def round_off(self, ub: Array) -> float:
        """By how much sums of these may be off, and what errors of S and p do to them."""
        problem = self.problem
        y = np.abs(self.y)
        n = len(y)
        reach = np.empty(n)
        reach[0::2] = np.maximum(ub[0], ub[1])
        reach[1::2] = ub[2]
        data = reach @ (gamma(n) * (np.abs(problem.S) @ y) + problem.dS @ y)
        data += problem.dp @ y
        size = np.abs(self.coefficients)
        # These are differences, rounded as their terms are.
        size[3:5] = np.abs(self._shear) + np.abs(self._pressure)
        sums = (size * ub).sum() + np.abs(problem.p) @ y
        sums += 2 * problem.g @ y[0::2]
        return float(up(data + gamma(8 * n) * sums))

    def impossible(self, allowed: Masks, ub: Array, margin: float) -> npt.NDArray[np.bool_]:
        """Which of the allowed statuses y excludes, by point and status (m, 7).

        Args:
            allowed: statuses, masks (m,).
            ub: bounds of the slots (6, m).
            margin: times the round-off that must be left.
        """
        has = has_status(allowed)
        h = self.least(ub)
        lowest = np.where(has, h, np.inf).min(axis=1)
        rest = lowest.sum() - lowest - self.y @ self.problem.p
        return np.asarray(has & (rest[:, None] + h > margin * self.round_off(ub)))

    def most(self, allowed: Masks, ub: Array, slot: int, point: int) -> float:
        """An upper bound of a slot: x = x - y.(S a - r - p)."""
        has = has_status(allowed)
        h = np.where(has, self.least(ub, (slot, point)), np.inf).min(axis=1)
        bound = -h.sum() + self.y @ self.problem.p
        return float(bound + self.round_off(ub) + gamma(8 * len(self.y)) * ub[slot, point])


# -- pieces ----------------------------------------------------------------------------------------
#
# One status at every point: a linear problem, its solution with error bounds, and the law there.
#
# Where ut is free rt = -sense (F rn + g), else ut = 0; where un is free rn = 0, else un = 0. What
# remains are two unknowns at every point.


@dataclass(frozen=True)
class Interval:
    """Numbers, and by how much they may be off."""

    value: Array
    away: Array

    @cached_property
    def low(self) -> Array:
        """Lower ends; a difference of two numbers is rounded to its nearest."""
        return np.asarray(self.value - self.away * (1 + gamma(4)) - gamma(0) * np.abs(self.value))

    @cached_property
    def high(self) -> Array:
        """Upper ends."""
        return np.asarray(self.value + self.away * (1 + gamma(4)) + gamma(0) * np.abs(self.value))


@dataclass(frozen=True, eq=False)
class PieceSolution:
    """The solution of a piece.

    Attributes:
        problem: scaled.
        codes: statuses (m,).
        ut, un, rt, rn: numbers at the points (m,).
    """

    problem: ReducedProblem
    codes: Codes
    ut: Interval
    un: Interval
    rt: Interval
    rn: Interval

    @cached_property
    def slacks(self) -> tuple[Interval, Interval]:
        """s+ and s-, F rn + g plus and minus rt."""
        F = self.problem.friction
        g = self.problem.g
        size = F * np.abs(self.rn.value) + g + np.abs(self.rt.value)
        away = up(F * self.rn.away + self.rt.away + gamma(2) * size)
        found = (F * self.rn.value + g + sign * self.rt.value for sign in (1, -1))
        plus, minus = (Interval(v, away) for v in found)
        return plus, minus

    @cached_property
    def inequalities(self) -> Interval:
        """What must not be negative for the law to hold (m, 3); 1 fills up."""
        is_open = IS_OPEN[self.codes]
        is_free = IS_FREE[self.codes]
        rubs = (self.problem.friction > 0) | (self.problem.g > 0)
        sense = np.where(rubs, SENSE[self.codes], 0)
        plus, minus = self.slacks
        rows = []
        for part in ("value", "away"):
            ut, un, rn, s, z = (getattr(v, part) for v in (self.ut, self.un, self.rn, plus, minus))
            slip = sense * ut if part == "value" else ut
            nothing = np.full(len(un), 1.0 if part == "value" else 0.0)
            first = np.where(is_free, np.where(sense != 0, slip, nothing), s)
            second = np.where(is_free, nothing, z)
            rows.append(np.stack([np.where(is_open, un, rn), first, second], axis=1))
        return Interval(rows[0], rows[1])

    @property
    def verdict(self) -> Literal["inside", "outside", "border"]:
        """Whether the law certainly holds beyond its borders, certainly does not, or neither."""
        if (self.inequalities.high < 0).any():
            return "outside"
        return "inside" if (self.inequalities.low > 0).all() else "border"

    @property
    def state(self) -> Array:
        """(ut, un, rt, rn) of the points (m, 4)."""
        return np.stack([v.value for v in (self.ut, self.un, self.rt, self.rn)], axis=1)

    @property
    def away(self) -> Array:
        """By how much the state may be off (m, 4)."""
        return np.stack([v.away for v in (self.ut, self.un, self.rt, self.rn)], axis=1)


def matrix_of(S: Array, friction: Array, codes: Codes) -> Array:
    """Of the equations of a piece; unknowns ut or rt, un or rn point by point (2 m, 2 m)."""
    n = len(S)
    t = np.arange(0, n, 2)
    k = np.arange(1, n, 2)
    A = np.zeros((n, n))
    free = IS_FREE[codes]
    opened = IS_OPEN[codes]
    A[:, t[free]] = S[:, t[free]]
    A[:, k[opened]] = S[:, k[opened]]
    stuck = t[~free]
    closed = k[~opened]
    A[stuck, stuck] = -1.0
    A[closed, closed] = -1.0
    slips = free & ~opened
    A[t[slips], k[slips]] = (SENSE[codes] * friction)[slips]
    return A


def solve_piece(problem: ReducedProblem, codes: Codes) -> PieceSolution | None:
    """The solution of a piece; None if the piece may be singular.

    Args:
        problem: scaled.
        codes: statuses (m,).
    """
    free = IS_FREE[codes]
    opened = IS_OPEN[codes]
    sense = SENSE[codes]
    F = problem.friction
    g = problem.g
    n = len(problem.p)
    load = problem.p.copy()
    load[0::2] -= np.where(free, sense * g, 0.0)
    off = problem.dp + gamma(1) * np.abs(load)
    dA = np.zeros((n, n))
    columns = np.stack([free, opened], axis=1).reshape(-1)
    dA[:, columns] = problem.dS[:, columns]
    found = solved(matrix_of(problem.S, F, codes), load, dA, off)
    if found is None:
        return None
    z, e = (v.reshape(-1, 2) for v in found)
    zero = np.zeros(len(F))
    rn = Interval(np.where(opened, zero, z[:, 1]), np.where(opened, zero, e[:, 1]))
    slip = -sense * (F * rn.value + g)
    slip_off = np.where(sense == 0, 0, up(F * rn.away + gamma(2) * (F * np.abs(rn.value) + g)))
    return PieceSolution(
        problem,
        codes,
        Interval(np.where(free, z[:, 0], zero), np.where(free, e[:, 0], zero)),
        Interval(np.where(opened, z[:, 1], zero), np.where(opened, e[:, 1], zero)),
        Interval(np.where(free, slip, z[:, 0]), np.where(free, slip_off, e[:, 0])),
        rn,
    )


# -- differences -----------------------------------------------------------------------------------
#
# Which quadratic inequalities a solution satisfies beside a known one.
#
# Let b solve a piece, xi_b be such that rt_b = -F xi_b rn_b with xi_b in the sign of ut_b, and a be
# any solution whose statuses are in given sets; d = a - b, e = S d. Then, point by point,
#
#     dt (et + F xi_b en) = -F rn_a (xi_a - xi_b) dt <= 0,
#     dn (en + theta et) = -un_a (rn_b + theta rt_b) - un_b (rn_a + theta rt_a) <= 0
#
# with |theta| <= 1/F,
#
# since the graph of the sign is monotone, rn_a >= 0, and gap and force exclude each other; with a
# bound g given in advance F is 0 in them. This is Renard's criterion of uniqueness (SIAM J. Math.
# Anal. 38, 2006), with a weight of its own for every inequality. Strict complementarity of b and
# the bounds of a strengthen them:
#
#     dn (en + theta et) <= -(1 - F |theta|) rn_b / Un dn^2        where b is closed,
#                        <= -(1 - F |theta|) un_b / Rn en^2        where b is open,
#     dt f <= -|ut_b| / S f^2     of a slip, f = et +- F en, which is the slack s+- of a (bound S).
#
# Where sets of statuses hold equalities for a and b alike (both slip to the right, say) these are
# rows f = 0; of stick and one slip the product of slack and slip vanishes for a and b, and gives dt
# f <= -s_b / U dt^2 or -|ut_b| / S f^2. In no case is b itself required to be a solution: its
# inequalities at points whose statuses are decided are not used.
#
# **If a weighted sum of the left sides, with any weights of the squares of the rows f = 0, is a
# positive definite form of d, then d = 0: no solution with these statuses is other than b.**


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

    piece: PieceSolution
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


def differences(piece: PieceSolution, allowed: Masks, ub: Array) -> Differences | None:
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
    x = np.array([r.x for r in rows])
    x_off = np.array([r.x_off for r in rows])
    S = problem.S[np.ix_(v, v)]
    dS = problem.dS[np.ix_(v, v)]
    cross = problem.S[np.ix_(other, v)]
    dcross = problem.dS[np.ix_(other, v)]
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


def _rows_of(piece: PieceSolution, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """The rows of one point; None if b does not fit."""
    code = int(piece.codes[i])
    opens = bool(allowed & OPENED)
    closes = bool(allowed & CLOSED)
    if (IS_OPEN[code] and not opens) or (not IS_OPEN[code] and not closes):
        return None
    F = float(piece.problem.friction[i])
    g = float(piece.problem.g[i])
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
        gap = float(piece.un.low[i])
        force = float(piece.rn.low[i])
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


def _coulomb(piece: PieceSolution, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """Of a point with a coefficient of friction."""
    code = int(piece.codes[i])
    F = float(piece.problem.friction[i])
    t = 2 * i
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
        rn = piece.rn
        rt = piece.rt
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


def _slip(piece: PieceSolution, i: int, ub: Array) -> list[_Row] | None:
    """Of a point that slips in b, or is open."""
    ut = piece.ut
    sense = int(SENSE[piece.codes[i]])
    F = float(piece.problem.friction[i])
    right = float(ut.low[i])
    left = float(-ut.high[i])
    for way, slid, slack in ((1, right, ub[3]), (-1, left, ub[4])):
        if sense in (0, way) and slid >= 0:
            return [_Row(2 * i, way * F, k2=_ratio(slid, slack))]
    return None


def _one_way(piece: PieceSolution, i: int, sense: int, ub: Array) -> tuple[float, float] | None:
    """k1 and k2 where only stick and the slip of one sense are left; None if b does not fit."""
    code = int(piece.codes[i])
    k = 0 if sense > 0 else 1
    slack = float(piece.slacks[k].low[i])
    slid = float(piece.ut.low[i] if sense > 0 else -piece.ut.high[i])
    if not IS_FREE[code]:
        return (_ratio(slack, ub[k]), 0.0) if slack >= 0 else None
    if SENSE[code] != sense or not slid >= 0:
        return None
    return 0.0, _ratio(slid, ub[3 + k])


def _bounded(piece: PieceSolution, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """Of a point whose shear has a bound given in advance."""
    code = int(piece.codes[i])
    t = 2 * i
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


# -- the proof as data -----------------------------------------------------------------------------
#
# A proof as data: the problem, and a tree of steps that `check` follows.
#
# Steps are those of a walk through the tree, children after their parent, and act on the sets of
# statuses that are left and on the bounds of the slots. Numbers of vectors refer to
# `Certificate.vectors`.
#
# - ``exclude``: the vector ``y`` excludes ``what``, pairs of a point and a status.
# - ``bound``: the vector ``y`` bounds a slot at a point by ``value``.
# - ``empty``: the vector ``y`` proves that there is no solution; a leaf.
# - ``only``: none but that of the piece ``codes``, by weights, theta and mu (differences, above); a
#   leaf.
# - ``pieces``: every piece that is left is solved; a leaf. Of those in ``singular`` a vector may
#   prove that they hold nothing.
# - ``branch``: of a point, into the sets ``parts``; the subtrees follow.
# - ``rest``: there is no load, and so no solution but a = 0; a leaf.
# - ``open``: nothing is proved; a leaf.


class InvalidCertificate(ValueError):
    """A file is no proof or was changed, or a step does not prove what it says."""


@dataclass
class Certificate:
    """A proof of what the solutions of a reduced problem are.

    Attributes:
        problem: as it was given.
        steps: as above.
        vectors: multipliers of the rows of S, in scaled units, (2 m,) each.
    """

    problem: ReducedProblem
    steps: list[dict[str, Any]] = field(default_factory=list)
    vectors: list[Array] = field(default_factory=list)

    def vector(self, y: Array) -> int:
        """Keep a vector; its number."""
        if not self.vectors or self.vectors[-1] is not y:
            self.vectors.append(y)
        return len(self.vectors) - 1

    def __str__(self) -> str:
        steps = _number(len(self.steps), "step")
        points = _number(self.problem.points, "contact point")
        return f"a proof of {steps} about {points}, to be checked"

    @property
    def digest(self) -> str:
        """SHA-256 of the steps and vectors, hexadecimal."""
        return _digest({"vectors": self._table}, json.dumps(self.steps))

    @property
    def _table(self) -> Array:
        return np.array(self.vectors, dtype=float).reshape(len(self.vectors), len(self.problem.p))

    def save(self, path: str | Path) -> None:
        """Write a ``.npz`` file, from one rank, that `main` checks."""
        p = self.problem
        np.savez_compressed(
            path,
            S=p.S,
            p=p.p,
            friction=p.friction,
            bound=p.g,
            S_error=p.dS,
            p_error=p.dp,
            steps=np.array(json.dumps(self.steps)),
            vectors=self._table,
            format=np.array(_FORMAT),
            digests=np.array([self.problem.digest, self.digest]),
        )

    @classmethod
    def load(cls, path: str | Path) -> Certificate:
        """Read what `save` wrote; what it wrote before there were digests too.

        Raises:
            FileNotFoundError: if there is no such file.
            InvalidCertificate: if it is no proof, one of another format, or was changed; a
                ``ValueError``.
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"there is no file {path}")
        if not zipfile.is_zipfile(path):
            raise InvalidCertificate(f"{path} is no proof: it is no npz file")
        try:
            with np.load(path, allow_pickle=False) as archive:
                found = {name: archive[name] for name in archive.files}
        except Exception as error:  # whatever a file that is not one of numpy's brings about
            raise InvalidCertificate(f"{path} is no proof: {error}") from error
        if not {*_DATA, "steps", "vectors"} <= set(found):
            raise InvalidCertificate(f"{path} is no certificate: parts are missing")
        kind = str(found.get("format", _FORMAT))
        if kind != _FORMAT:
            raise InvalidCertificate(f"{path} is of the format {kind!r}; {_FORMAT!r} is known")
        if any(found[name].dtype != np.float64 for name in (*_DATA, "vectors")):
            raise InvalidCertificate(f"{path} is no certificate: a part holds no double numbers")
        try:
            problem = ReducedProblem(**{name: found[name] for name in _DATA})
            proof = cls(problem, json.loads(str(found["steps"])), list(found["vectors"]))
            digests = [problem.digest, proof.digest]
        except (ValueError, TypeError, IndexError, RecursionError) as error:
            raise InvalidCertificate(f"{path} is no proof: {error}") from error
        if "format" in found or "digests" in found:
            stated = found.get("digests", np.zeros(0)).tolist()
            for what, now, then in zip(("data", "steps"), digests, [*stated, "", ""], strict=False):
                if now != then:
                    raise InvalidCertificate(f"{path} was changed: the {what} are not those stored")
        return proof


def _digest(arrays: dict[str, Array], text: str = "") -> str:
    """SHA-256 of names, shapes and values, whatever the machine, and of a text."""
    found = hashlib.sha256(text.encode())
    for name, values in arrays.items():
        found.update(f"{name}{values.shape}".encode())
        # One zero for both.
        found.update((values + 0.0).astype("<f8").tobytes())
    return found.hexdigest()


# -- the check -------------------------------------------------------------------------------------


MOST_PIECES = 256


def in_words(solutions: int, border: int, singular: int, regions: int) -> str:
    """How many solutions are proved, and what is not; numbers are those of `Proved`."""
    known = f"{_number(solutions, 'solution')}, proved"
    if not border + singular + regions:
        return f"{known} to be all there are"
    if regions:
        return f"{known}; not decided: {_number(regions, 'set')} of statuses"
    parts = [
        f"{_number(number, word)} of statuses"
        for number, word in ((border, "border"), (singular, "singular piece"))
        if number
    ]
    return f"{known}; others, if any, are at {' and in '.join(parts)}"


def _number(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


@dataclass(eq=False)
class Proved:
    """What is known of the solutions.

    Attributes:
        inside: pieces that hold one solution each, inside their borders.
        border: pieces whose solution is at a border: one within their errors, or none.
        singular: pieces that may hold one solution, none or a continuum.
        at_rest: without load nothing but a = 0 is a solution.
        open_regions: sets of statuses about which nothing is proved.
    """

    inside: list[PieceSolution] = field(default_factory=list)
    border: list[PieceSolution] = field(default_factory=list)
    singular: list[npt.NDArray[np.int8]] = field(default_factory=list)
    open_regions: list[Masks] = field(default_factory=list)
    at_rest: bool = False

    @property
    def verdict(self) -> Verdict:
        """Whether `inside`, or the state of rest, is all there is."""
        if self.open_regions:
            return "open"
        return "degenerate" if self.border or self.singular else "complete"

    def __str__(self) -> str:
        number = len(self.inside) + int(self.at_rest)
        return in_words(number, len(self.border), len(self.singular), len(self.open_regions))

    def add(self, piece: PieceSolution) -> None:
        """Take the solution of a piece, whose errors decide whether it is one."""
        kind = piece.verdict
        known = self.inside if kind == "inside" else self.border
        if kind != "outside" and not any(np.array_equal(q.codes, piece.codes) for q in known):
            known.append(piece)


@dataclass(eq=False)
class StatusRegion:
    """Sets of statuses, and bounds of the slots of the solutions with such statuses.

    Attributes:
        problem: scaled.
        allowed: masks (m,).
        ub: (6, m).
    """

    problem: ReducedProblem
    allowed: Masks
    ub: Array

    @classmethod
    def whole(cls, problem: ReducedProblem) -> StatusRegion:
        """All statuses, with the bounds by energy."""
        return cls(problem, problem.statuses.copy(), bounded(problem))

    def part(self, point: int, mask: int) -> StatusRegion:
        """The statuses ``mask`` at one point."""
        new = StatusRegion(self.problem, self.allowed.copy(), self.ub)
        new.allowed[point] = mask
        new.ub = restricted(self.problem, new.allowed, self.ub)
        return new

    @property
    def choices(self) -> list[list[int]]:
        """Statuses that are left, point by point."""
        return [[int(s) for s in np.flatnonzero(has)] for has in has_status(self.allowed)]

    @property
    def pieces(self) -> float:
        """Their number."""
        return float(np.prod([float(len(c)) for c in self.choices]))

    def excluded(self, y: Array, *, margin: float = 1.0) -> npt.NDArray[np.bool_]:
        """Statuses that the vector ``y`` excludes (m, 7)."""
        return Dual(self.problem, y).impossible(self.allowed, self.ub, margin)

    def exclude(self, point: int, status: int) -> None:
        """Take a status out."""
        self.allowed[point] &= ~(1 << status)
        self.ub = restricted(self.problem, self.allowed, self.ub)

    def most(self, y: Array, slot: int, point: int) -> float:
        """The bound of a slot by the vector ``y``."""
        return Dual(self.problem, y).most(self.allowed, self.ub, slot, point)


def check(certificate: Certificate) -> Proved:
    """Follow a certificate.

    Raises:
        InvalidCertificate: if a step does not prove what it says, or steps are missing.
    """
    proved = Proved()
    problem = certificate.problem.scaled
    waiting = [StatusRegion.whole(problem)]
    try:
        # What overflows proves nothing, and says so by comparisons that fail.
        with np.errstate(all="ignore"):
            for step in certificate.steps:
                if not waiting:
                    raise InvalidCertificate("there are steps after the last leaf")
                waiting += follow(certificate, step, waiting.pop(), proved)
    except InvalidCertificate:
        raise
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise InvalidCertificate(f"a step cannot be read: {error}") from error
    if waiting:
        raise InvalidCertificate("steps are missing")
    return proved


def follow(
    certificate: Certificate, step: dict[str, Any], region: StatusRegion, proved: Proved
) -> list[StatusRegion]:
    """Take one step.

    Args:
        certificate: that the step is of.
        step: one of those above.
        region: changed.
        proved: receives what the step proves.

    Returns:
        What is left of the region, last part first.

    Raises:
        InvalidCertificate: if the step does not prove what it says.
    """
    kind = step["do"]
    if kind == "branch":
        point = _index(step["point"], len(region.allowed))
        parts = step["parts"]
        whole = int(region.allowed[point])
        if int(np.bitwise_or.reduce([0, *parts])) & whole != whole:
            raise InvalidCertificate("a branch leaves statuses out")
        return [region.part(point, mask & whole) for mask in reversed(parts)]
    if kind == "open":
        proved.open_regions.append(region.allowed)
        return []
    if kind == "rest":
        # a.S a <= p.a, with no load and no error of it.
        if region.problem.p.any() or region.problem.dp.any():
            raise InvalidCertificate("there is a load")
        proved.at_rest = True
        return []
    if kind == "pieces":
        _all_pieces(certificate, step["singular"], region, proved)
        return []
    if kind == "only":
        piece = _piece(region.problem, step["codes"])
        found = None if piece is None else differences(piece, region.allowed, region.ub)
        weights, theta = (np.array(step[k], dtype=float) for k in ("weights", "theta"))
        fits = found is not None and weights.shape == theta.shape == found.unknown.shape
        if found is None or not fits or not found.prove(weights, theta, float(step["mu"])):
            raise InvalidCertificate("a uniqueness is not proved")
        assert piece is not None
        proved.add(piece)
        return []
    y = certificate.vectors[_index(step["y"], len(certificate.vectors))]
    if y.shape != region.problem.p.shape or not np.isfinite(y).all():
        raise InvalidCertificate("a vector of multipliers does not fit")
    if kind == "bound":
        slot = _index(step["slot"], 6)
        point = _index(step["point"], len(region.allowed))
        if not region.most(y, slot, point) <= step["value"]:
            raise InvalidCertificate("a bound is not proved")
        region.ub = region.ub.copy()
        region.ub[slot, point] = max(min(region.ub[slot, point], step["value"]), 0.0)
        return [region]
    excluded = region.excluded(y)
    if kind == "empty":
        if not (excluded == has_status(region.allowed)).all(axis=1).any():
            raise InvalidCertificate("a region is not proved empty")
        return []
    if kind != "exclude":
        raise InvalidCertificate(f"there is no step {kind!r}")
    for point, status in step["what"]:
        if not excluded[_index(point, len(excluded)), _index(status, 7)]:
            raise InvalidCertificate("an exclusion is not proved")
    for point, status in step["what"]:
        region.exclude(point, status)
    return [region]


def _all_pieces(
    certificate: Certificate, singular: list[Any], region: StatusRegion, proved: Proved
) -> None:
    if region.pieces > MOST_PIECES:
        raise InvalidCertificate("a leaf has too many pieces")
    known = {tuple(codes): number for codes, number in singular}
    for codes in itertools.product(*region.choices):
        piece = solve_piece(region.problem, np.array(codes, dtype=np.int8))
        if piece is not None:
            proved.add(piece)
        elif not _holds_nothing(certificate, known.get(codes), region, codes):
            proved.singular.append(np.array(codes, dtype=np.int8))


def _holds_nothing(
    certificate: Certificate, number: int | None, region: StatusRegion, codes: tuple[int, ...]
) -> bool:
    """Whether a vector proves that a singular piece holds no solution."""
    if number is None:
        return False
    held = StatusRegion(
        region.problem, np.array([1 << s for s in codes], dtype=np.int64), region.ub
    )
    held.ub = restricted(region.problem, held.allowed, region.ub)
    y = certificate.vectors[_index(number, len(certificate.vectors))]
    return bool(held.excluded(y).any())


def _piece(problem: ReducedProblem, codes: list[int]) -> PieceSolution | None:
    if len(codes) != problem.points or not all(0 <= s < 7 for s in codes):
        raise InvalidCertificate("statuses do not fit")
    allowed = problem.statuses
    if not all(int(allowed[i]) >> s & 1 for i, s in enumerate(codes)):
        raise InvalidCertificate("a point cannot have this status")
    return solve_piece(problem, np.array(codes, dtype=np.int8))


def _index(value: Any, size: int) -> int:
    if not isinstance(value, int) or not 0 <= value < size:
        raise InvalidCertificate(f"there is no number {value!r}")
    return value


# -- the command -----------------------------------------------------------------------------------

#: Of a status: open, stick, slip to either side, and these at an open point under a bound given in
#: advance; of a point without friction, open and closed.
_WITH = "ok+-KPM"
_WITHOUT = "o-c----"
_STATEMENT = {
    "complete": "they are all there are",
    "degenerate": "every other one is at a border, or in a singular piece, of these",
    "open": "whether there are others is not decided",
}


def _letters(problem: ReducedProblem, codes: Codes) -> str:
    free = (problem.friction == 0) & (problem.g == 0)
    both = zip(codes, free, strict=True)
    return "".join((_WITHOUT if without else _WITH)[int(code)] for code, without in both)


def report(certificate: Certificate, proved: Proved) -> list[str]:
    """What is proved, and of which data, in lines."""
    problem = certificate.problem
    force = problem.units[1]
    S, p = (float(np.abs(v).max()) for v in (problem.S, problem.p))
    lines = [
        f"data: {problem.points} contact points; SHA-256 of S, p, F, g and the errors of S and p:",
        f"  {problem.digest}",
        f"  the errors are at most {problem.dS.max():.3g} (S up to {S:.6g}) and"
        f" {problem.dp.max():.3g} (p up to {p:.6g})",
        f"proof: {len(certificate.steps)} steps, {len(certificate.vectors)} vectors; SHA-256:",
        f"  {certificate.digest}",
    ]
    number = len(proved.inside) + int(proved.at_rest)
    many = _number(number, "solution")
    lines.append(f"for all S and p within these errors there are {many} as follows, and")
    lines.append(f"{_STATEMENT[proved.verdict]}:")
    if proved.at_rest:
        lines.append("  rest, without forces")
    for piece in proved.inside:
        sums = ", ".join(
            f"sum {name} = {force * v.value.sum():.12g} +- {force * 1.01 * v.away.sum():.2g}"
            for name, v in (("rt", piece.rt), ("rn", piece.rn))
        )
        lines.append(f"  {_letters(problem, piece.codes)}  {sums}")
    lines += [f"border: {_letters(problem, q.codes)}" for q in proved.border]
    lines += [f"singular: {_letters(problem, codes)}" for codes in proved.singular]
    if proved.open_regions:
        lines.append(f"not decided: {len(proved.open_regions)} sets of statuses")
    lines.append("that these numbers are those of a body, mesh and load is not part of the proof")
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Check a stored proof and say what it proves.

    Returns:
        0 if the proof holds, 1 if it does not or leaves something open, 2 if there is no file.
    """
    parser = argparse.ArgumentParser(
        prog="check_proof",
        description="Check a stored proof about the solutions of a contact problem with friction.",
        epilog="exit status: 0 the proof holds; 1 it does not, or is open; 2 there is no file",
    )
    parser.add_argument("proof", help="a file that Certificate.save has written (.npz)")
    path = parser.parse_args(argv).proof
    try:
        certificate = Certificate.load(path)
        proved = check(certificate)
    except OSError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    except InvalidCertificate as error:
        print(f"refused: {error}", file=sys.stderr)
        return 1
    print("\n".join(report(certificate, proved)))
    print("not decided" if proved.open_regions else "the proof holds")
    return 1 if proved.open_regions else 0


if __name__ == "__main__":
    sys.exit(main())
