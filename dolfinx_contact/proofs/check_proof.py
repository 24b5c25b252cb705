# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checker of stored proofs, the only code that a reader of a proof has to trust.

    python3 check_proof.py PROOF
    python3 -m dolfinx_contact check PROOF

Both commands print the statements that a stored proof (`Certificate.save`) proves, and a summary of
its data. They run the same code; the first one needs only Python and numpy. The exit status is

- 0 if the proof holds,
- 1 if the file is not a proof, was changed, contains a wrong step or leaves regions open,
- 2 if the file or numpy is missing.

The search (`search.py`) proposes steps using optimisers and linear programs, which may be wrong.
This file checks every step with rigorous bounds of all round-off errors and uses only the numbers
stored in the steps. A single step that does not prove its statement invalidates the whole proof.
This file can be read on its own: it repeats the definitions of statuses and of Coulomb's law from
other modules. It imports no other module of the package; other modules may import it.

A proof concerns the numbers in the file, for all values within their errors: stiffness matrix S,
load vector p, friction coefficients F and prescribed friction bounds g (`ReducedProblem`). It does
not cover the assembly of these numbers from a body, a mesh and a load.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

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
    "Ball",
    "Certificate",
    "Differences",
    "InvalidCertificate",
    "Masks",
    "PieceSolution",
    "ProofRegion",
    "Proved",
    "ReducedProblem",
    "StatusRegion",
    "Verdict",
    "check",
    "differences",
    "flexibility",
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

#: Format of stored proofs, and names of the stored data (attributes of `ReducedProblem`).
_FORMAT = "dolfinx_contact proof 1"
_DATA = ("S", "p", "friction", "bound", "S_error", "p_error")


# -- rounded arithmetic ----------------------------------------------------------------------------
#
# Rigorous bounds in floating-point arithmetic.
#
# With the unit round-off u = 2^-53 and gamma_n = n u / (1 - n u), the error of a matrix product
# with inner dimension n is at most gamma_n |A| |B| for any order of summation (Higham, Accuracy and
# Stability of Numerical Algorithms, section 3.5). Bounds are sums of nonnegative numbers. Computed
# with fewer than 10^6 rounded operations, such a sum is too small by a relative error of less than
# 2^-30, for which `up` compensates. Numbers are expected to be scaled, so that underflow errors are
# below `TINY`.


_U = 2.0**-53
TINY = 1e-290
_SLACK = 2.0**-30


def gamma(n: int) -> float:
    """Return the relative error bound of a sum of n products and up to four more operations.

    It is gamma_{n+4}, where gamma_k = k u / (1 - k u) with the unit round-off u = 2^-53.
    """
    return (n + 4) * _U / (1 - (n + 4) * _U)


def up(bound: Array) -> Array:
    """Return an upper bound of a sum of nonnegative numbers from its rounded value."""
    return np.asarray(np.asarray(bound) * (1 + _SLACK) + TINY)


def down(bound: Array | np.float64) -> Array:
    """Return a lower bound of a nonnegative number from its rounded value."""
    return np.asarray(np.asarray(bound) * (1 - _SLACK))


def above(bound: float) -> float:
    """Return an upper bound of a nonnegative number from its rounded value; scalar `up`."""
    return float(bound) * (1 + _SLACK) + TINY


def below(bound: float) -> float:
    """Return a lower bound of a nonnegative number from its rounded value; scalar `down`."""
    return float(bound) * (1 - _SLACK)


def positive_definite(Q: Array, error: Array) -> bool:
    """Return whether all symmetric matrices within ``error`` of ``Q`` are positive definite.

    The matrix is scaled by powers of two, without rounding, to a diagonal between 1/2 and 2. A
    symmetric perturbation changes eigenvalues by at most the largest absolute row sum of its
    entries. Rump's theorem (BIT 46, 2006, theorem 2.3): a symmetric matrix A is positive definite
    if the floating-point Cholesky factorisation of A - c I succeeds for some c >= gamma_{n+1} / (1
    - gamma_{n+1}) tr A, with gamma_k = k u / (1 - k u) and the unit round-off u = 2^-53.

    Args:
        Q: exactly symmetric matrix, shape (n, n).
        error: nonnegative error bounds of the entries, shape (n, n).
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
    """Return a positive lower bound of the eigenvalues of all matrices within ``error`` of ``S``.

    Returns 0 if no positive bound is proved.

    Args:
        S: exactly symmetric matrix, shape (n, n).
        error: nonnegative, symmetric error bounds of the entries, shape (n, n).
    """
    guess = 0.9 * float(np.linalg.eigvalsh(S)[0])
    if not guess > 0:
        return 0.0
    shifted = S - guess * np.eye(len(S))
    rounded = error + np.diag(np.abs(np.diag(S)) + guess) * gamma(1)
    return guess if positive_definite(shifted, rounded) else 0.0


@dataclass(frozen=True, eq=False)
class Ball:
    """Array of real numbers with error bounds, |x - value| <= radius in every entry.

    The operators return a Ball containing the exact results for all numbers in their operands.
    Operands that are arrays or numbers are exact. With the unit round-off u = 2^-53, a single
    operation has a rounding error of at most u |value|, and a matrix product A B with inner
    dimension n an error of at most n u / (1 - n u) |A| |B| in any order of summation (Higham,
    Accuracy and Stability of Numerical Algorithms, section 3.5). Errors of the operands are
    propagated including the second-order term: for x within dx of X and y within dy of Y,

        |xy - XY| <= |X| dy + dx (|Y| + dy).

    The radius is a sum of nonnegative numbers, rounded upwards by `up`; `TINY` covers underflow.
    This is midpoint-radius arithmetic (Rump, BIT 39, 1999) without directed rounding.

    Attributes:
        value: midpoints, an array of any shape.
        radius: error bounds of the same shape.
    """

    value: Array
    radius: Array

    #: Make operators of NumPy arrays defer to the operators of this class.
    __array_ufunc__ = None

    @classmethod
    def of(cls, numbers: Ball | npt.ArrayLike) -> Ball:
        """Return balls unchanged, and exact numbers as a ball of radius zero."""
        if isinstance(numbers, Ball):
            return numbers
        value = np.asarray(numbers, dtype=np.float64)
        return cls(value, np.zeros_like(value))

    @classmethod
    def _rounded(cls, value: Any, radius: Any) -> Ball:
        """Return the result of one operation, with its rounding error added to the radius."""
        value = np.asarray(value)
        return cls(value, up(radius + _U * np.abs(value)))

    def __neg__(self) -> Ball:
        return Ball(-self.value, self.radius)

    def __add__(self, other: Ball | npt.ArrayLike) -> Ball:
        b = Ball.of(other)
        return Ball._rounded(self.value + b.value, self.radius + b.radius)

    def __sub__(self, other: Ball | npt.ArrayLike) -> Ball:
        return self + -Ball.of(other)

    def __mul__(self, other: Ball | npt.ArrayLike) -> Ball:
        b = Ball.of(other)
        off = np.abs(self.value) * b.radius + self.radius * b.size
        return Ball._rounded(self.value * b.value, off)

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: npt.ArrayLike) -> Ball:
        return Ball.of(other) - self

    def __truediv__(self, other: Ball | npt.ArrayLike) -> Ball:
        """Return the quotient; its radius is infinite if the denominator may be zero."""
        b = Ball.of(other)
        least = down(np.maximum(np.abs(b.value) - b.radius * (1 + gamma(0)), 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            value = self.value / b.value
            off = (self.radius + np.abs(value) * b.radius) / least
        return Ball._rounded(value, np.where(least > 0, off, np.inf))

    def __matmul__(self, other: Ball | npt.ArrayLike) -> Ball:
        b = Ball.of(other)
        size = np.abs(self.value)
        off = gamma(len(b.value)) * (size @ np.abs(b.value))
        off = off + size @ b.radius + self.radius @ b.size
        return Ball(np.asarray(self.value @ b.value), up(off))

    def __rmatmul__(self, other: npt.ArrayLike) -> Ball:
        return Ball.of(other) @ self

    def __getitem__(self, index: Any) -> Ball:
        return Ball(np.asarray(self.value[index]), np.asarray(self.radius[index]))

    def put(self, index: Any, numbers: Ball | npt.ArrayLike) -> None:
        """Assign numbers with their errors to the entries ``index``."""
        other = Ball.of(numbers)
        self.value[index], self.radius[index] = other.value, other.radius

    @property
    def T(self) -> Ball:
        """Ball with its arrays transposed."""
        return Ball(self.value.T, self.radius.T)

    def reshape(self, *shape: int) -> Ball:
        """Return the ball with its arrays reshaped."""
        return Ball(self.value.reshape(*shape), self.radius.reshape(*shape))

    @property
    def size(self) -> Array:
        """Upper bounds of the absolute values of the numbers."""
        return up(np.abs(self.value) + self.radius)

    @cached_property
    def low(self) -> Array:
        """Lower bounds of the numbers; the rounding error of value - radius is included."""
        return np.asarray(self.value - self.radius * (1 + gamma(4)) - gamma(0) * np.abs(self.value))

    @cached_property
    def high(self) -> Array:
        """Upper bounds of the numbers; the rounding error of value + radius is included."""
        return np.asarray(self.value + self.radius * (1 + gamma(4)) + gamma(0) * np.abs(self.value))


def where(condition: Any, a: Ball | npt.ArrayLike, b: Ball | npt.ArrayLike) -> Ball:
    """Select the entries of ``a`` where the condition holds and of ``b`` elsewhere."""
    x, y = Ball.of(a), Ball.of(b)
    return Ball(*(np.where(condition, v, w) for v, w in zip(_parts(x), _parts(y), strict=True)))


def stack(balls: Sequence[Ball]) -> Ball:
    """Stack balls along a new last axis."""
    return Ball(*(np.stack(parts, axis=-1) for parts in zip(*map(_parts, balls), strict=True)))


def hypot(a: Ball, b: Ball) -> Ball:
    """Return (a^2 + b^2)^(1/2); its error is at most the norm of both errors."""
    value = np.hypot(a.value, b.value)
    return Ball(value, up(np.hypot(a.radius, b.radius) + gamma(4) * value))


def _parts(ball: Ball) -> tuple[Array, Array]:
    return ball.value, ball.radius


def solved(A: Ball, b: Ball) -> Ball | None:
    """Return a ball containing the solutions of A z = b for all A and b in their balls.

    Returns None if one of the matrices may be singular. Let z be an approximate solution, C an
    approximate inverse of A, and G >= |I - C A| entrywise for all A in the ball. If the maximum
    norm |G| is below 1, every A is regular. The exact solution z* satisfies z* - z = C (b - A z) +
    (I - C A) (z* - z). For v >= |C (b - A z)| and the vector e of ones, this implies

        |z* - z| <= v + G e |v| / (1 - |G|)

    (Rump, Acta Numerica 19, 2010).
    """
    try:
        C = np.linalg.inv(A.value)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(C).all():
        return None
    z = C @ b.value
    z = z + C @ (b.value - A.value @ z)
    rows = up((np.eye(len(z)) - C @ A).size.sum(axis=1))
    norm = float(rows.max())
    if not norm < 0.5:
        return None
    v = up(np.abs(C) @ (b - A @ z).size)
    return Ball(z, up(v + rows * (v.max() / (1 - norm))))


# -- the problem -----------------------------------------------------------------------------------
#
# The reduced problem, whose solutions are counted, in the plane and in space.
#
# At m contact points, displacements a = (ut, un) and forces r = (rt, rn) on the body satisfy
#
#     S a = r + p,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn + g,  rt = -(F rn + g) sign(ut)
#
# where the last equation applies if ut is not 0. In space ut and rt have two components, and
# sign(ut) is ut/|ut|. S is symmetric and positive definite; initial gaps are included in p. A point
# has either Coulomb friction (F > 0, g = 0), a prescribed friction bound (F = 0, g > 0), or no
# friction. All proved statements hold for every S and p whose entries differ from the stored ones
# by at most `S_error` and `p_error`.
#
# Statuses are numbered as in `laws.status`: 0 open, 1 stick, 2 and 3 slip with ut > 0 and ut < 0,
# and 4 to 6 stick and slip of open points with a prescribed friction bound. Sets of statuses are
# bit masks.


#: For every status: whether ut is free, whether un is free, and the sense of the slip.
IS_FREE = np.array([True, False, True, True, False, True, True])
IS_OPEN = np.array([True, False, False, False, True, True, True])
SENSE = np.array([0, 0, 1, -1, 0, 1, -1])
#: Bit masks of the statuses with free ut, of the open ones and of the closed ones.
FREE = sum(1 << s for s in range(7) if IS_FREE[s])
OPENED = sum(1 << s for s in range(7) if IS_OPEN[s])
CLOSED = 0b1110


def has_status(allowed: Masks) -> npt.NDArray[np.bool_]:
    """Return a mask of the statuses in the bit mask of each of m points, shape (m, 7)."""
    return np.asarray((allowed[:, None] >> np.arange(7)) & 1 > 0)


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """Contact problem with friction, reduced to m contact points.

    The displacements a = (ut, un) and the forces r = (rt, rn) on the body, with tangential and
    normal components at each point, satisfy

        S a = r + p,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn + g,

    and rt = -(F rn + g) ut/|ut| where ut is not 0. Initial gaps are included in the load p.

    Args:
        S: symmetric stiffness matrix, ordered (ut, un) point by point, shape (dim m, dim m) with
            dim 2 or 3. An unsymmetric part is added to its error bounds.
        p: load vector, shape (dim m,).
        friction: friction coefficients F >= 0, shape (m,).
        bound: prescribed friction bounds g >= 0 as forces, 0 where F > 0, shape (m,); by default 0.
        S_error: error bounds of the entries of S, shape (dim m, dim m); by default 0.
        p_error: error bounds of the entries of p, shape (dim m,); by default 0.

    Raises:
        ValueError: if shapes do not match, a number is not finite, a coefficient or bound is
            negative, a point has both F and g, or S is not proved to be positive definite.
    """

    S: Array
    p: Array
    friction: Array
    bound: Array | None = None
    S_error: Array | None = None
    p_error: Array | None = None

    def __post_init__(self) -> None:
        m = len(self.friction)
        n = (3 if np.size(self.p) == 3 * m else 2) * m
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
        """Prescribed friction bounds of the m points, shape (m,)."""
        assert self.bound is not None
        return self.bound

    @property
    def dS(self) -> Array:
        """Error bounds of the stiffness matrix S, shape (dim m, dim m) for m points."""
        assert self.S_error is not None
        return self.S_error

    @property
    def dp(self) -> Array:
        """Error bounds of the load vector p, shape (dim m,) for m points."""
        assert self.p_error is not None
        return self.p_error

    @cached_property
    def stiffness(self) -> Ball:
        """Stiffness matrix S with its error bounds."""
        return Ball(self.S, self.dS)

    @cached_property
    def load(self) -> Ball:
        """Load vector p with its error bounds."""
        return Ball(self.p, self.dp)

    @property
    def data(self) -> dict[str, Array]:
        """Arguments with which the problem can be constructed again, as arrays by name."""
        return {name: np.asarray(getattr(self, name)) for name in _DATA}

    @property
    def digest(self) -> str:
        """Hexadecimal SHA-256 hash of all data, including error bounds; identifies the problem."""
        return _digest(self.data)

    @property
    def points(self) -> int:
        """Number m of contact points."""
        return len(self.friction)

    @property
    def dim(self) -> int:
        """Spatial dimension, 2 or 3."""
        return len(self.p) // self.points

    @cached_property
    def least(self) -> float:
        """Positive lower bound of the eigenvalues of the stiffness matrix; 0 if none is proved."""
        return least_eigenvalue(self.S, self.dS)

    @cached_property
    def statuses(self) -> Masks:
        """Statuses that the contact law admits at each of m points, as bit masks, shape (m,)."""
        masks = np.full(self.points, 0b1111, dtype=np.int64)
        masks[self.friction == 0] = 0b0101
        masks[self.g > 0] = 0b1111110
        # In space there is only one slip status, 2 (or 5), without a sense.
        return masks if self.dim == 2 else masks & 0b0110111

    @cached_property
    def units(self) -> tuple[float, float]:
        """Units of displacements and forces: powers of two close to their typical magnitudes."""
        force = max(float(np.abs(self.p).max()), float(self.g.max()), 1e-290)
        force = 2.0 ** round(float(np.log2(force)))
        return force / self._stiffness_unit, force

    @property
    def _stiffness_unit(self) -> float:
        return float(2.0 ** round(float(np.log2(np.diag(self.S).mean()))))

    @cached_property
    def scaled(self) -> ReducedProblem:
        """The same problem in its `units` of displacements and forces.

        Scaling by powers of two is exact except for underflow. Underflow errors of the stiffness
        and the load are included in their error bounds.

        Raises:
            ValueError: if a friction bound underflows.
        """
        k = self._stiffness_unit
        force = self.units[1]
        found = object.__new__(ReducedProblem)
        parts = {"friction": self.friction, "bound": np.asarray(self.g / force, np.float64)}
        for name, value, error, unit in (
            ("S", self.S, self.dS, k),
            ("p", self.p, self.dp, force),
        ):
            scaled, off = np.asarray(value / unit), np.asarray(error / unit, dtype=np.float64)
            exact = (scaled * unit == value) & (off * unit == error)
            parts |= {name: scaled, f"{name}_error": np.where(exact, off, up(off))}
        if (parts["bound"] * force != self.g).any():
            raise ValueError("the friction bounds differ too much in size from the load")
        for name, value in parts.items():
            object.__setattr__(found, name, value)
        found.__dict__["least"] = self.least / k
        return found


# -- energy bounds ---------------------------------------------------------------------------------
#
# Bounds of all solutions from an energy estimate.
#
# Contact does no work and friction dissipates energy. Hence r.a <= 0 at every solution, and a lies
# in the ellipsoid a.S a <= p.a. With c = S^-1 p / 2 and rho^2 = p.S^-1 p / 4, a linear functional
# l.a of the displacements is at most l.c + rho (l.S^-1 l)^(1/2) in the ellipsoid, and a linear
# functional of the forces, l.r = S l.a - l.p, is at most -l.p / 2 + rho (l.S l)^(1/2).
#
# Six nonnegative quantities are bounded at every point, in this order (``slot`` 0 to 5 of a step):
# the positive and negative parts ut+ and ut- of ut = ut+ - ut-, un, the slacks s+ = F rn + g + rt
# and s- = F rn + g - rt of the friction bound, and rn. A status determines which of them may be
# nonzero; s+ and s- do not count at points without friction.


#: Quantities that may be positive in each status, at points with friction and without.
_USED = np.zeros((7, 6), dtype=bool)
for _status, _slots in enumerate(["012", "345", "045", "135", "234", "024", "123"]):
    _USED[_status, [int(k) for k in _slots]] = True
_USED_FREE = _USED.copy()
_USED_FREE[2] = [True, True, False, False, False, True]


@dataclass(frozen=True, eq=False)
class _Ellipsoid:
    """Ellipsoid a.S a <= p.a of all solutions, enlarged by round-off and errors of the data.

    Attributes:
        twice: approximation of S^-1 p, twice the centre, shape (n,) with n = dim m.
        shift: bound of the Euclidean norm of the error of ``twice``.
        inverse: approximation of S^-1, shape (n, n).
        inverse_off: error bounds of the columns of ``inverse``, in the Euclidean norm, shape (n,).
        diagonal: upper bounds of the diagonal of S^-1, shape (n,).
        rho: upper bound of (p.S^-1 p)^(1/2) / 2.
    """

    twice: Array
    shift: float
    inverse: Array
    inverse_off: Array
    diagonal: Array
    rho: float


def _ellipsoid(problem: ReducedProblem) -> _Ellipsoid:
    S = problem.stiffness
    n = len(problem.p)
    least = problem.least
    G = np.asarray(np.linalg.inv(problem.S), dtype=np.float64)
    # The error of an approximate solution is at most its residual over the least eigenvalue.
    column_off = np.sqrt(up(((np.eye(n) - S @ G).size ** 2).sum(axis=0))) / least
    twice = G @ problem.p
    residual = (problem.load - S @ twice).size
    shift = float(np.sqrt(up((residual**2).sum()))) / least
    work = problem.load @ Ball(twice, np.full(n, above(shift)))
    rho = float(np.sqrt(up(np.maximum(work.high, 0)))) / 2
    diagonal = np.maximum(np.diag(G), 0) + column_off
    return _Ellipsoid(twice, shift, G, column_off, diagonal, rho)


def flexibility(problem: ReducedProblem) -> tuple[Array, Array]:
    """Return an approximate inverse G of the stiffness matrix S, and its error bounds.

    Both have the shape (n, n) with n = dim m for m points.

    Let E >= |I - S G| for all S within their errors, with the identity matrix I and a maximum norm
    e < 1 of E. Then |S^-1 - G| <= |G| (E + E^2 + ...). In each column, entries of E^2 are at most e
    times the largest entry of E. The error bounds are infinite if e >= 1/2.
    """
    G = np.asarray(np.linalg.inv(problem.S), dtype=np.float64)
    n = len(G)
    E = (np.eye(n) - problem.stiffness @ G).size
    norm = float(up(E.sum(axis=1)).max())
    if not norm < 0.5:
        return G, np.full((n, n), np.inf)
    return G, up(np.abs(G) @ up(E + norm / (1 - norm) * E.max(axis=0)))


def bounded(problem: ReducedProblem) -> Array:
    """Return upper bounds of six quantities of m points at every solution in 2D, shape (6, m).

    These nonnegative quantities are the parts ut+ and ut- of the tangential displacement ut = ut+ -
    ut-, the normal displacement un, the slacks s+ = F rn + g + rt and s- = F rn + g - rt of the
    friction bound (friction coefficient F, prescribed bound g), and the normal force rn.
    """
    m = problem.points
    e = _ellipsoid(problem)
    center = Ball(e.twice, np.full(2 * m, above(e.shift)))
    # Round up before adding numbers that may be negative: `up` needs nonnegative ones.
    reach = up(e.rho * np.sqrt(up(e.diagonal)))
    t = np.arange(0, 2 * m, 2)
    k = np.arange(1, 2 * m, 2)
    F = problem.friction
    g = problem.g
    S = problem.stiffness
    ub: Array = np.zeros((6, m))
    for slot, sign, i in ((0, 1.0, t), (1, -1.0, t), (2, 1.0, k)):
        ub[slot] = (sign * center[i]).high / 2 + reach[i]
    for slot, sign, normal in ((3, 1.0, F), (4, -1.0, F), (5, 0.0, np.ones(m))):
        form = Ball.of(normal) * normal * S[k, k] + abs(sign) * S[t, t]
        form = form + 2 * sign * Ball.of(normal) * S[t, k]
        load = normal * problem.load[k] + sign * problem.load[t]
        ub[slot] = (abs(sign) * g - 0.5 * load).high
        ub[slot] += up(e.rho * np.sqrt(up(np.maximum(form.high, 0))))
    ub = up(np.maximum(ub, 0))
    given = g > 0
    ub[3:5, given] = np.minimum(ub[3:5, given], up(2 * g[given]))
    ub[3:5, (F == 0) & ~given] = 0.0
    return ub


def used(problem: ReducedProblem) -> npt.NDArray[np.bool_]:
    """Return a mask of the six quantities of `bounded` that may be positive in each status.

    Its axes are point, status and quantity, shape (m, 7, 6) for m points.
    """
    free = (problem.friction == 0) & (problem.g == 0)
    return np.where(free[:, None, None], _USED_FREE, _USED)


def restricted(problem: ReducedProblem, allowed: Masks, ub: Array) -> Array:
    """Return the bounds ``ub``, set to 0 for quantities that vanish in all allowed statuses.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        allowed: allowed statuses of the points as bit masks, shape (m,).
        ub: upper bounds of the six quantities of `bounded`, shape (6, m).
    """
    has = has_status(allowed)
    return np.where((has[:, :, None] & used(problem)).any(axis=1).T, ub, 0.0)


# -- multipliers -----------------------------------------------------------------------------------
#
# Exclusion of statuses by a vector of multipliers, using weak duality.
#
# At every solution, 0 = y.(S a - r - p) for any y. At each point, the bounded quantities lie in the
# box of one of the allowed statuses. Therefore
#
#     0 >= L(y) = sum_i min_s h_is(y) - y.p,    h_is = sum_j min(0, c_ij) ub_ij
#
# with the coefficients c_ij of the quantities in y.(S a - r) and the sum over the quantities j of
# status s. If L > 0, there is no solution. If L > 0 with point i restricted to status s, this
# status is impossible at point i. The minimum over the statuses equals the minimum over the convex
# hull of their boxes, so that L is as sharp as the linear program from which y comes. The proof
# does not depend on how y was computed.


@dataclass(frozen=True, eq=False)
class Dual:
    """Multipliers of the equilibrium equations in 2D, which exclude statuses by weak duality.

    With the stiffness matrix S, displacements a, forces r and load p (`ReducedProblem`), every
    solution satisfies 0 = y.(S a - r - p) for any multipliers y. At the point i, each quantity j of
    `bounded` lies between 0 and its bound ub_ij. Therefore

        0 >= L = sum_i min_s h_is - y.p,    h_is = sum_j min(0, c_ij) ub_ij

    with the coefficients c_ij of the quantities in y.(S a - r), the allowed statuses s of the point
    i, and the quantities j that may be positive in the status s. A prescribed friction bound adds
    the least contribution of the tangential force to h_is. There is no solution if L > 0.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        y: multipliers, shape (2 m,).
    """

    problem: ReducedProblem
    y: Array

    @cached_property
    def _of_a(self) -> Array:
        return self.problem.S @ self.y

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients c_ij (`Dual`), excluding prescribed friction bounds, shape (6, m)."""
        a = self._of_a
        rt = -self._shear
        rn = -self._pressure
        return np.stack([a[0::2], -a[0::2], a[1::2], rt + rn, rn - rt, -self.y[1::2]])

    @property
    def _shear(self) -> Array:
        """Coefficients of the slack difference s+ - s- = 2 rt (`bounded`) in y.r (`Dual`)."""
        return np.where(self.problem.g > 0, 0.0, self.y[0::2] / 2)

    @property
    def _pressure(self) -> Array:
        """Coefficients of the slack sum s+ + s- = 2 F rn (`bounded`) in y.r (`Dual`)."""
        F = self.problem.friction
        return np.divide(self.y[1::2], 2 * F, out=np.zeros_like(F), where=F > 0)

    @property
    def _counted(self) -> npt.NDArray[np.bool_]:
        """Mask of the bounded quantities in the sum y.(S a - r) at each of m points, shape (m, 6).

        Where F > 0, the normal force is expressed by the slacks s+ and s- of the friction cone, as
        (s+ + s-)/(2 F). Where F = 0, the shear is bounded by g, without slacks.
        """
        F = self.problem.friction
        found = np.ones((len(F), 6), dtype=bool)
        found[F > 0, 5] = False
        found[F == 0, 3:5] = False
        return found

    @cached_property
    def _given(self) -> Array:
        """Least -yt rt (multiplier yt, tangential force |rt| <= g) by status, shape (m, 7)."""
        most = (self.problem.g * self.y[0::2])[:, None]
        return np.where(SENSE == 0, -np.abs(most), SENSE * most)

    def least(self, ub: Array, less: tuple[int, int] | None = None) -> Array:
        """Return the least contribution h_is (`Dual`) of each point i and status s, shape (m, 7).

        Args:
            ub: bounds of the quantities (`bounded`), shape (6, m).
            less: indices of the quantity and the point whose coefficient is reduced by 1; None for
                no change.
        """
        c = self.coefficients
        if less is not None:
            c = c.copy()
            c[less] -= 1.0
        uses = used(self.problem) & self._counted[:, None, :]
        per_slot = (np.minimum(c, 0) * ub).T
        return np.einsum("msj,mj->ms", uses, per_slot) + self._given

    def round_off(self, ub: Array) -> float:
        """Return an error bound of L (`Dual`): round-off and errors of stiffness and load."""
        problem = self.problem
        y = np.abs(self.y)
        n = len(y)
        reach = np.empty(n)
        reach[0::2] = np.maximum(ub[0], ub[1])
        reach[1::2] = ub[2]
        data = reach @ (gamma(n) * (np.abs(problem.S) @ y) + problem.dS @ y)
        data += problem.dp @ y
        size = np.abs(self.coefficients)
        # These coefficients are differences; their rounding errors scale with their terms.
        size[3:5] = np.abs(self._shear) + np.abs(self._pressure)
        sums = (size * ub).sum() + np.abs(problem.p) @ y
        sums += 2 * problem.g @ y[0::2]
        return float(up(data + gamma(8 * n) * sums))

    def impossible(self, allowed: Masks, ub: Array, margin: float) -> npt.NDArray[np.bool_]:
        """Return a mask of the allowed statuses that the multipliers exclude, shape (m, 7).

        Args:
            allowed: allowed statuses of the m points as bit masks, shape (m,).
            ub: upper bounds of the six quantities of `bounded`, shape (6, m).
            margin: required ratio of the lower bound L of `Dual` to its error bound.
        """
        has = has_status(allowed)
        h = self.least(ub)
        lowest = np.where(has, h, np.inf).min(axis=1)
        rest = lowest.sum() - lowest - self.y @ self.problem.p
        return np.asarray(has & (rest[:, None] + h > margin * self.round_off(ub)))

    def most(self, allowed: Masks, ub: Array, slot: int, point: int) -> float:
        """Return an upper bound of a quantity of `bounded` at all solutions with allowed statuses.

        For the quantity x it follows from x = x - y.(S a - r - p), see `Dual`. It is infinite if x
        does not appear in L.

        Args:
            allowed: allowed statuses of the m points as bit masks, shape (m,).
            ub: upper bounds of the six quantities, shape (6, m).
            slot: index of the quantity.
            point: index of the point.
        """
        if not self._counted[point, slot]:
            return np.inf
        has = has_status(allowed)
        h = np.where(has, self.least(ub, (slot, point)), np.inf).min(axis=1)
        bound = -h.sum() + self.y @ self.problem.p
        return float(bound + self.round_off(ub) + gamma(8 * len(self.y)) * ub[slot, point])


# -- pieces ----------------------------------------------------------------------------------------
#
# A *piece* prescribes one status at every point. It is a linear problem; its solution is computed
# with error bounds, and the inequalities of the law are checked.
#
# If ut is free, rt = -sense (F rn + g), otherwise ut = 0. If un is free, rn = 0, otherwise un = 0.
# Two unknowns per point remain.


class _Piece:
    """Solution in 2D or 3D of the equations with one prescribed status per point (a *piece*).

    Attributes:
        numbers: displacements and forces of the m points with error bounds, shape (m, 2 dim).
        inequalities: quantities that the law requires to be nonnegative, with error bounds.
    """

    @property
    def numbers(self) -> Ball:
        raise NotImplementedError

    @property
    def inequalities(self) -> Ball:
        raise NotImplementedError

    @property
    def verdict(self) -> Literal["inside", "outside", "border"]:
        """Inequalities of the law: all certainly hold, one is certainly violated, or undecided."""
        if (self.inequalities.high < 0).any():
            return "outside"
        return "inside" if (self.inequalities.low > 0).all() else "border"

    @property
    def state(self) -> Array:
        """Displacements and forces of the m points, shape (m, 2 dim)."""
        return self.numbers.value

    @property
    def away(self) -> Array:
        """Error bounds of the displacements and forces of the m points, shape (m, 2 dim)."""
        return self.numbers.radius


@dataclass(frozen=True, eq=False)
class PieceSolution(_Piece):
    """Solution in 2D of the linear equations with one prescribed status at each of m points.

    Attributes:
        problem: reduced problem scaled by `ReducedProblem.scaled`.
        codes: prescribed statuses, shape (m,).
        ut: tangential displacements, shape (m,).
        un: normal displacements, shape (m,).
        rt: tangential forces, shape (m,).
        rn: normal forces, shape (m,).
    """

    problem: ReducedProblem
    codes: Codes
    ut: Ball
    un: Ball
    rt: Ball
    rn: Ball

    @cached_property
    def slacks(self) -> tuple[Ball, Ball]:
        """Slacks F rn + g + rt and F rn + g - rt of the friction bound, shape (m,) each.

        F is the friction coefficient, g the prescribed bound, rn the normal and rt the tangential
        force of each of m points.
        """
        limit = self.problem.friction * self.rn + self.problem.g
        return limit + self.rt, limit - self.rt

    @cached_property
    def inequalities(self) -> Ball:  # type: ignore[override]
        """Quantities that the law requires to be nonnegative, padded with ones, shape (m, 3)."""
        is_free = IS_FREE[self.codes]
        rubs = (self.problem.friction > 0) | (self.problem.g > 0)
        sense = np.where(rubs, SENSE[self.codes], 0).astype(np.float64)
        plus, minus = self.slacks
        normal = where(IS_OPEN[self.codes], self.un, self.rn)
        slip = where(sense != 0, sense * self.ut, 1.0)
        return stack([normal, where(is_free, slip, plus), where(is_free, 1.0, minus)])

    @cached_property
    def numbers(self) -> Ball:  # type: ignore[override]
        """Displacements ut, un and forces rt, rn of m points with error bounds, shape (m, 4)."""
        return stack([self.ut, self.un, self.rt, self.rn])


def matrix_of(S: Array, friction: Array, codes: Codes) -> Array:
    """Return the matrix of the equations for given statuses, shape (2 m, 2 m).

    The unknowns of a point are the tangential displacement, or force for stick, and the normal
    displacement, or force for a closed point.

    Args:
        S: stiffness matrix of the reduced problem, shape (2 m, 2 m).
        friction: friction coefficients, shape (m,).
        codes: statuses, shape (m,).
    """
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
    """Solve a 2D problem with one given status per point; None if it may be singular.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        codes: statuses, shape (m,).
    """
    free = IS_FREE[codes]
    opened = IS_OPEN[codes]
    sense = SENSE[codes].astype(np.float64)
    F = problem.friction
    g = problem.g
    columns = np.stack([free, opened], axis=1).reshape(-1)
    A = Ball(matrix_of(problem.S, F, codes), np.where(columns, problem.dS, 0.0))
    shear = np.zeros(len(problem.p))
    shear[0::2] = np.where(free, sense * g, 0.0)
    z = solved(A, problem.load - shear)
    if z is None:
        return None
    z = z.reshape(-1, 2)
    rn = where(opened, 0.0, z[:, 1])
    slip = where(sense == 0, 0.0, -sense * (F * rn + g))
    return PieceSolution(
        problem,
        codes,
        where(free, z[:, 0], 0.0),
        where(opened, z[:, 1], 0.0),
        where(free, slip, z[:, 0]),
        rn,
    )


# -- differences -----------------------------------------------------------------------------------
#
# Quadratic inequalities for the difference of any solution and a known one.
#
# Let b solve a piece, and let xi_b satisfy rt_b = -F xi_b rn_b with xi_b in the set-valued sign of
# ut_b. Let a be any solution whose statuses are in the allowed sets, d = a - b and e = S d. Then at
# every point
#
#     dt (et + F xi_b en) = -F rn_a (xi_a - xi_b) dt <= 0,
#     dn (en + theta et) = -un_a (rn_b + theta rt_b) - un_b (rn_a + theta rt_a) <= 0
#
# with |theta| <= 1/F,
#
# since the graph of the sign is monotone, rn_a >= 0, and gap and pressure are complementary. With a
# prescribed bound g, F is 0 in these inequalities. This is Renard's uniqueness criterion (SIAM J.
# Math. Anal. 38, 2006) with a separate weight for every inequality. Strict complementarity of b and
# the bounds of a (Un, Rn, S and U are upper bounds of quantities of a) strengthen the inequalities:
#
#     dn (en + theta et) <= -(1 - F |theta|) rn_b / Un dn^2        where b is closed,
#                        <= -(1 - F |theta|) un_b / Rn en^2        where b is open,
#     dt f <= -|ut_b| / S f^2     of a slip, f = et +- F en, which is the slack s+- of a (bound S).
#
# If the allowed statuses imply the same equality for a and b (for instance, both slip to the
# right), it is used as a row f = 0. If only stick and one slip are allowed, the product of slack
# and slip vanishes for a and b, which gives dt f <= -s_b / U dt^2 or dt f <= -|ut_b| / S f^2. b
# itself need not be a solution: its inequalities at points with a single allowed status are not
# used.
#
# **If a sum of the left-hand sides with nonnegative weights, plus weighted squares of the rows
# f = 0, is a positive definite quadratic form of d, then d = 0: b is the only possible solution
# with these statuses.**


@dataclass
class _Row:
    """Inequality or equation for one component d_v of the difference d of two solutions.

    With the rows S_v and S_w of the stiffness matrix for d_v and the other component d_w of the
    point, and f = S_v d + x S_w d, the row is the equation f = 0 or the inequality d_v (f + k1 d_v)
    + k2 f^2 <= 0.

    Attributes:
        unknown: index v of the component.
        x: coefficient x of S_w d.
        x_off: error bound of x.
        equal: whether the row is the equation f = 0.
        k1: coefficient of d_v^2.
        k2: coefficient of f^2.
        theta: whether a multiple theta of S_w d may be added to f.
    """

    unknown: int
    x: float = 0.0
    x_off: float = 0.0
    equal: bool = False
    k1: float = 0.0
    k2: float = 0.0
    theta: bool = False


@dataclass(frozen=True, eq=False)
class Differences:
    """Inequalities in 2D for the difference d = a - b of the displacements of two solutions.

    With f = R d, each row i is the inequality d_i (f_i + k1_i d_i) + k2_i f_i^2 <= 0 or the
    equation f_i = 0. If a weighted sum of the inequalities and the squared equations is positive
    definite, then d = 0.

    Attributes:
        piece: the solution b, for one given status per point.
        unknown: indices of the n components of d (of 2 m) that may be nonzero, shape (n,).
        rows: matrix R, shape (n, n).
        tilts: matrix T, shape (n, n). A multiple theta_i of row i of T may be added to row i of R.
        equal: mask of the rows that are equations f = 0, shape (n,).
        k1: coefficients of the squares of d, shape (n,).
        k2: coefficients of the squares of f, shape (n,).
    """

    piece: PieceSolution
    unknown: npt.NDArray[np.int64]
    rows: Ball
    tilts: Ball
    equal: npt.NDArray[np.bool_]
    k1: Array
    k2: Array

    @property
    def R(self) -> Array:
        """Midpoints of the matrix `rows`, shape (n, n)."""
        return self.rows.value

    @property
    def T(self) -> Array:
        """Midpoints of the matrix `tilts`, shape (n, n)."""
        return self.tilts.value

    @property
    def tilted(self) -> npt.NDArray[np.bool_]:
        """Mask of the n rows to which a multiple of a row of `tilts` may be added, shape (n,)."""
        return np.any(self.T != 0, axis=1)

    def prove(self, weights: Array, theta: Array, mu: float) -> bool:
        """Return whether the weighted sum of the rows is proved to be positive definite.

        The proof covers all errors of the data and of rounding. It implies that the two compared
        solutions are equal.

        Args:
            weights: nonnegative weights of the inequalities, shape (n,); ignored for equations.
            theta: multiples of the rows of `tilts`, at most 1 / F in absolute value with the
                friction coefficient F, shape (n,); ignored for rows outside `tilted`.
            mu: nonnegative weight of the squares of the equations, dimensionless.
        """
        F = self.piece.problem.friction[self.unknown // 2]
        theta = np.where(self.tilted, theta, 0.0)
        keeps = 1.0 - F * np.abs(theta) - gamma(4)
        if (weights < 0).any() or not mu >= 0 or (keeps[self.tilted] < 0).any():
            return False
        if len(self.unknown) == 0:
            return True
        keeps = np.where(self.tilted, keeps, 1.0)
        w = np.where(self.equal, 0.0, weights)
        # Divide by the diagonal, so that mu is dimensionless.
        size = np.abs(np.diag(self.R))
        square = np.where(self.equal, mu / np.where(size > 0, size, 1.0), down(w * self.k2 * keeps))
        half = w[:, None] * (self.rows + theta[:, None] * self.tilts)
        product = self.rows.T @ (square[:, None] * self.rows)
        form = 0.5 * (half + half.T) + np.diag(down(w * self.k1 * keeps))
        form = form + 0.5 * (product + product.T)
        return positive_definite(form.value, form.radius)


def differences(piece: PieceSolution, allowed: Masks, ub: Array) -> Differences | None:
    """Return inequalities in 2D for the difference of two solutions a and b.

    None if b does not provably satisfy the conditions of the inequalities.

    Args:
        piece: solution b. Where only one status of a is allowed, b must have it too.
        allowed: allowed statuses of a at the m points as bit masks, shape (m,).
        ub: upper bounds of the six quantities of `bounded` at a, shape (6, m).
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
    x = Ball(np.array([r.x for r in rows]), np.array([r.x_off for r in rows]))[:, None]
    tilted = np.array([r.theta for r in rows], dtype=bool)[:, None]
    cross = problem.stiffness[np.ix_(other, v)]
    return Differences(
        piece,
        v,
        problem.stiffness[np.ix_(v, v)] + x * cross,
        where(tilted, cross, 0.0),
        np.array([r.equal for r in rows], dtype=bool),
        np.array([r.k1 for r in rows]),
        np.array([r.k2 for r in rows]),
    )


def _rows_of(piece: PieceSolution, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """Return the inequalities and equations of point ``i`` that compare a solution with ``piece``.

    None if ``piece`` does not provably satisfy the conditions of its status.
    """
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
    """Return a lower bound of the quotient part / most; 0 unless both numbers are positive."""
    return float(down(np.float64(part / most))) if part > 0 and most > 0 else 0.0


def _coulomb(piece: PieceSolution, i: int, allowed: int, ub: Array) -> list[_Row] | None:
    """Return the tangential inequalities of point ``i`` with Coulomb friction (`_rows_of`).

    None if ``piece`` does not provably satisfy the conditions of its status.
    """
    code = int(piece.codes[i])
    F = float(piece.problem.friction[i])
    t = 2 * i
    if allowed == 0b0001:
        return [_Row(t, equal=True)]
    if allowed == 0b0010:
        return [] if code == 1 else None
    for sense, slip in ((1, 0b0100), (-1, 0b1000)):
        if allowed in (slip, slip | 1):
            # Only open and this slip are allowed; both satisfy rt = -sense F rn.
            return [_Row(t, sense * F, equal=True)] if 1 << code & (slip | 1) else None
        if allowed == slip | 2:
            k = _one_way(piece, i, sense, ub)
            return None if k is None else [_Row(t, sense * F, k1=k[0], k2=k[1])]
    plus, minus = (float(s.low[i]) for s in piece.slacks)
    if code == 1:
        rn = piece.rn
        rt = piece.rt
        pressed = plus >= 0 and minus >= 0
        # If the point is certainly closed, b may also have a negative rn: b need not be a solution.
        drawn = not allowed & 1 and max(float(s.high[i]) for s in piece.slacks) <= 0
        least = float(rn.low[i] if pressed else -rn.high[i])
        if not (pressed or drawn) or least <= 0:
            return None
        ratio = -rt[i] / rn[i]
        return [_Row(t, float(ratio.value), float(ratio.radius))]
    return _slip(piece, i, ub)


def _slip(piece: PieceSolution, i: int, ub: Array) -> list[_Row] | None:
    """Return the tangential inequality of point ``i``, open or slipping in ``piece`` (`_rows_of`).

    None if ``piece`` does not provably satisfy the conditions of its status.
    """
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
    """Return k1 and k2 (`_Row`) of a point that may only stick or slip in one direction.

    None if the solution of ``piece`` does not provably satisfy the conditions of its status.
    """
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
    """Return the tangential inequalities of point ``i`` with a prescribed bound (`_rows_of`).

    None if ``piece`` does not provably satisfy the conditions of its status.
    """
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


# -- in space: cells and bounds --------------------------------------------------------------------
#
# In 3D ut and rt have two components and |rt| <= F rn + g. A slip has a direction: ut = s e with a
# unit vector e and s >= 0, and rt = -(F rn + g) e. A region assigns *cells* to every point:
#
#     with Coulomb friction: open (rn = 0), stick (ut = 0), and arcs of slip directions;
#     without Coulomb friction (F = 0): open and closed, with any admissible ut and rt.
#
# An arc is an interval [q0, q1] of *diamond angles*. The diamond angle q denotes the ray through a
# point of the square |x| + |y| = 1, with (1, 0) at q = 0 and (0, 1) at q = 1. The ends of arcs are
# dyadic numbers, so that bisection is exact.
#
# Bounds apply to a point in a cell of the corresponding kind: open, ut in a box and un <= Un;
# stick, rn <= Rk; slip, s and rn in intervals; without Coulomb friction, ut in a box, un <= Un and
# rn in an interval. The initial bounds are the energy bounds. `MOST` quantities are bounded from
# above, in this order: -ut1, ut1, -ut2, ut2, un, -s, s, -rn, rn, and rn of stick.

#: Kinds of cells.
IN_OPEN, IN_STICK, IN_SLIP, IN_CLOSED = range(4)
#: Number of bounded quantities; indices of un, of -s (s follows), of -rn (rn follows), rn of stick.
MOST = 10
OF_UN, OF_S, OF_RN, OF_RK = 4, 5, 7, 9
#: For every quantity, the kinds of cells to which its bound applies.
_BOUNDED_KINDS = [(IN_OPEN, IN_CLOSED)] * 4 + [(IN_OPEN,)] + [(IN_SLIP,)] * 2
_BOUNDED_KINDS += [(IN_SLIP, IN_CLOSED)] * 2 + [(IN_STICK,)]
#: Starts of the eight initial arcs; the axes, along which symmetric bodies slip, are inside arcs.
_ARCS = 11 / 64 + np.arange(8) / 2
#: Arcs of at most this width are not bisected, so that their ends remain exact.
NARROWEST = 2.0**-20
#: Largest number of cells of a region, beyond which a check would take too much memory.
MOST_CELLS = 20000
#: Assumed error bound of computed sines, cosines and arc tangents, far above their true error.
_ANGLES = 2.0**-40


def rays(q: Array) -> Array:
    """Return the points of the square |x| + |y| = 1 at diamond angles, shape (..., 2).

    The diamond angle is 0 at (1, 0), 1 at (0, 1), 2 at (-1, 0) and 3 at (0, -1), and linear between
    these corners. The points are exact for dyadic angles (integers divided by powers of two).
    """
    q = np.asarray(q) % 4.0
    x = np.where(q <= 2, 1 - q, q - 3)
    y = np.where(q <= 1, q, np.where(q <= 3, 2 - q, q - 4))
    return np.stack([x, y], axis=-1)


def directions(q: Array) -> Array:
    """Return unit vectors at diamond angles (`rays`), up to a few round-offs, shape (..., 2)."""
    ray = rays(q)
    return np.asarray(ray / np.sqrt((ray**2).sum(axis=-1, keepdims=True)))


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of all contact points in 3D, k in total, sorted by point.

    A cell is a set of states of a point: open, closed, stick, or slip along an arc of directions.

    Attributes:
        node: index of the point of each cell, in increasing order, shape (k,).
        kind: kind of each cell: `IN_OPEN`, `IN_STICK`, `IN_SLIP` or `IN_CLOSED`, shape (k,).
        ends: diamond angles of both ends of each arc, 0 for other cells, shape (k, 2).
    """

    node: npt.NDArray[np.int64]
    kind: npt.NDArray[np.int64]
    ends: Array

    @classmethod
    def whole(cls, problem: ReducedProblem) -> Cells:
        """Return all cells that the contact law admits."""
        parts = []
        for i, F in enumerate(problem.friction):
            kinds = [IN_OPEN, IN_STICK] + [IN_SLIP] * len(_ARCS) if F > 0 else [IN_OPEN, IN_CLOSED]
            for k, kind in enumerate(kinds):
                start = float(_ARCS[k - 2]) if kind == IN_SLIP else 0.0
                parts.append((i, kind, start, start + 0.5 if kind == IN_SLIP else 0.0))
        table = np.array(parts)
        kinds_of = table[:, :2].astype(np.int64)
        return cls(kinds_of[:, 0], kinds_of[:, 1], table[:, 2:])

    def __len__(self) -> int:
        return len(self.node)

    @cached_property
    def of_kind(self) -> list[npt.NDArray[np.int64]]:
        """Indices of the cells of each kind: open, stick, slip and closed, in this order."""
        return [np.flatnonzero(self.kind == kind) for kind in range(4)]

    @cached_property
    def first(self) -> npt.NDArray[np.int64]:
        """Index of the first cell of each point, for all points that have cells."""
        return np.flatnonzero(np.diff(self.node, prepend=-1))

    @cached_property
    def sides(self) -> tuple[Array, Array]:
        """Unit vectors at the first and at the last ends of all slip arcs, shape (arcs, 2) each."""
        ends = self.ends[self.of_kind[IN_SLIP]]
        return directions(ends[:, 0]), directions(ends[:, 1])

    def kept(self, keep: npt.NDArray[np.bool_]) -> Cells:
        """Return the cells selected by the mask ``keep``, shape (k,)."""
        return Cells(self.node[keep], self.kind[keep], self.ends[keep])

    def halved(self, point: int) -> Cells:
        """Return the cells with all slip arcs of a point bisected.

        Raises:
            InvalidCertificate: if the point has no arc, if an arc is too narrow, or if there would
                be too many cells.
        """
        arcs = (self.node == point) & (self.kind == IN_SLIP)
        width = self.ends[arcs, 1] - self.ends[arcs, 0]
        if not arcs.any() or width.min() <= NARROWEST:
            raise InvalidCertificate("there is no arc to be halved")
        if len(self) + arcs.sum() > MOST_CELLS:
            raise InvalidCertificate(f"a region has more than {MOST_CELLS} cells")
        middle = (self.ends[:, 0] + self.ends[:, 1]) / 2
        copies = np.where(arcs, 2, 1)
        node, kind = (np.repeat(v, copies) for v in (self.node, self.kind))
        ends = np.repeat(self.ends, copies, axis=0)
        at = (np.cumsum(copies) - copies)[arcs]
        ends[at, 1] = middle[arcs]
        ends[at + 1, 0] = middle[arcs]
        return Cells(node, kind, ends)

    def kinds_at(self, point: int) -> frozenset[int]:
        """Return the kinds of the cells of a point."""
        return frozenset(int(kind) for kind in self.kind[self.node == point])

    def hull(self, point: int) -> tuple[float, float] | None:
        """Return the first end and the width of an arc that contains all slip arcs of a point.

        Both are diamond angles (`rays`). None if the point has no arc.
        """
        ends = self.ends[(self.node == point) & (self.kind == IN_SLIP)]
        if len(ends) == 0:
            return None
        if (ends[:, 1] - ends[:, 0]).sum() >= 4:
            return float(ends[0, 0]), 4.0
        ends = ends[np.argsort(ends[:, 0])]
        holes = (np.roll(ends[:, 0], -1) - ends[:, 1]) % 4.0
        k = int(np.argmax(holes))
        start = float(ends[(k + 1) % len(ends), 0])
        width = float(4.0 - holes[k])
        reach = (ends[:, 0] - start) % 4.0 + (ends[:, 1] - ends[:, 0])
        return start, max(width, float(reach.max()))


def bounded_in_space(problem: ReducedProblem) -> Array:
    """Return upper bounds of the `MOST` quantities of m points at every solution in 3D.

    The shape is (MOST, m). The quantities are -ut1, ut1, -ut2, ut2 and un with the tangential
    displacements ut1 and ut2 and the normal displacement un; -s and s with the slip distance s; -rn
    and rn with the normal force rn; and rn of a sticking point.
    """
    e = _ellipsoid(problem)
    m = problem.points
    center = e.twice.reshape(m, 3) / 2
    size = np.abs(e.twice).reshape(m, 3) + e.shift
    reach = up(e.rho * np.sqrt(up(e.diagonal))).reshape(m, 3) + e.shift + gamma(8) * size
    # Largest eigenvalue of the tangential 2 x 2 block of S^-1.
    t, v = np.arange(0, 3 * m, 3), np.arange(1, 3 * m, 3)
    mean = (e.diagonal[t] + e.diagonal[v]) / 2
    across = np.abs(e.inverse[t, v]) + e.inverse_off[v]
    widest = mean + np.sqrt(((e.diagonal[t] - e.diagonal[v]) / 2) ** 2 + across**2)
    p = problem.p[2::3]
    D = np.diag(problem.S)[2::3] + np.diag(problem.dS)[2::3]
    pressed = -p / 2 + problem.dp[2::3] + gamma(8) * np.abs(p) + up(e.rho * np.sqrt(up(D)))
    found = np.zeros((MOST, m))
    for c in (0, 1):
        found[2 * c] = up(np.abs(reach[:, c])) - center[:, c]
        found[2 * c + 1] = up(np.abs(reach[:, c])) + center[:, c]
    found[OF_UN] = up(np.maximum(center[:, 2] + reach[:, 2], 0))
    slip = np.hypot(center[:, 0], center[:, 1]) + e.rho * np.sqrt(up(widest))
    found[OF_S + 1] = up(slip + 2 * e.shift + gamma(16) * size.sum(axis=1))
    found[OF_RN + 1] = found[OF_RK] = up(np.maximum(pressed, 0))
    found[:OF_UN] += gamma(8) * size.max(axis=1)
    return found


# -- in space: multipliers -------------------------------------------------------------------------
#
# As in the plane, 0 >= L(y) = sum_i min_c h_ic(y) - y.p with b = S y and the minima over the cells
#
#     open     sum_k min(b_k lo_k, b_k hi_k) + min(0, b_n Un) - g |y_t|,
#     stick    min(0, Rk (-y_n - F |y_t|)),
#     slip     min over s and rn at their ends of  mu(s b_t + F rn y_t) - rn y_n,
#     closed   sum_t min(b_t lo_t, b_t hi_t) - g |y_t| + min over rn at its ends of -rn y_n,
#
# Here mu(v) is the minimum of v.e over the arc: the smaller one of v.e0 and v.e1, or -|v| if the
# direction of -v lies in the arc. If this is undecided, -|v| is used. mu has the Lipschitz
# constant 1.


@dataclass(frozen=True, eq=False)
class SpaceDual:
    """Multipliers of the equilibrium equations in 3D, which exclude cells by weak duality.

    With the stiffness matrix S, displacements a, forces r and load p (`ReducedProblem`), every
    solution satisfies 0 = y.(S a - r - p) for any multipliers y. Therefore

        0 >= L = sum_i min_c h_ic - y.p

    with the cells c of the point i (`Cells`) and the minimum h_ic, in the cell, of the contribution
    of the point to y.(S a - r). There is no solution if L > 0.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        y: multipliers, shape (3 m,).
    """

    problem: ReducedProblem
    y: Array

    @cached_property
    def _of_a(self) -> Array:
        return np.asarray((self.problem.S @ self.y).reshape(-1, 3))

    @cached_property
    def _of_r(self) -> Array:
        return np.asarray(self.y.reshape(-1, 3))

    @cached_property
    def _given(self) -> Array:
        """Least -yt.rt (multipliers yt, tangential forces |rt| <= g) by point, shape (m,)."""
        y = self._of_r
        return -self.problem.g * np.hypot(y[:, 0], y[:, 1])

    @cached_property
    def _load(self) -> float:
        return float(self.y @ self.problem.p)

    def least(self, cells: Cells, most: Array, less: tuple[int, int] | None = None) -> Array:
        """Return the least value of the terms of each cell in y.(S a - r), shape (k,).

        Args:
            cells: cells of all points.
            most: upper bounds of the quantities, shape (MOST, m).
            less: index of a quantity and index of a point; this quantity is subtracted from the
                sum. At this point, the result is infinite for the kinds of cells in which the
                quantity has no bound. None for no change.
        """
        found = np.empty(len(cells))
        m = self.problem.points
        taken = np.zeros((MOST, m))
        if less is not None:
            taken[less] = 1.0
        b = self._of_a.copy()
        b[:, 0] -= taken[1] - taken[0]
        b[:, 1] -= taken[3] - taken[2]
        b[:, 2] -= taken[OF_UN]
        box = sum(np.minimum(-b[:, c] * most[2 * c], b[:, c] * most[2 * c + 1]) for c in (0, 1))
        box = box + self._given
        lifted = np.minimum(0.0, b[:, 2] * np.maximum(most[OF_UN], 0))
        least, largest = ends_of(most, OF_RN)
        push = -self._of_r[:, 2] - (taken[OF_RN + 1] - taken[OF_RN])
        pressed = np.minimum(push * least, push * largest)
        held = self._stick(most, taken[OF_RK])
        for kind, values in ((0, box + lifted), (1, held), (3, box + pressed)):
            here = cells.of_kind[kind]
            found[here] = values[cells.node[here]]
        found[cells.of_kind[IN_SLIP]] = self._slip(cells, most, taken)
        if less is not None:
            quantity, point = less
            others = ~np.isin(cells.kind, _BOUNDED_KINDS[quantity])
            found[others & (cells.node == point)] = np.inf
        return found

    def _stick(self, most: Array, taken: Array) -> Array:
        y = self._of_r
        push = -y[:, 2] - self.problem.friction * np.hypot(y[:, 0], y[:, 1]) - taken
        return np.minimum(0.0, push * np.maximum(most[OF_RK], 0))

    def _slip(self, cells: Cells, most: Array, taken: Array) -> Array:
        i = cells.node[cells.of_kind[IN_SLIP]]
        first, last = cells.sides
        b = self._of_a[i, :2]
        y = self._of_r[i]
        Fy = self.problem.friction[i, None] * y[:, :2]
        of_s = (taken[OF_S + 1] - taken[OF_S])[i]
        of_rn = y[:, 2] + (taken[OF_RN + 1] - taken[OF_RN])[i]
        best = np.full(len(i), np.inf)
        for s in ends_of(most, OF_S):
            for rn in ends_of(most, OF_RN):
                v = s[i, None] * b + rn[i, None] * Fy
                value = _least_along(v, first, last) - of_rn * rn[i] - of_s * s[i]
                best = np.minimum(best, value)
        return best

    def round_off(self, most: Array) -> float:
        """Return an error bound of L (`SpaceDual`): round-off and errors of stiffness and load."""
        problem = self.problem
        n = len(self.y)
        y = np.abs(self.y)
        slid = np.maximum(most[OF_S + 1], 0)
        a = np.stack(
            [np.maximum(np.abs(most[2 * c : 2 * c + 2]).max(axis=0), slid) for c in (0, 1)]
        )
        reach = np.vstack([a, np.maximum(most[OF_UN], 0)]).T.reshape(-1)
        pressed = np.maximum(np.maximum(most[OF_RN + 1], most[OF_RK]), 0)
        rubbed = problem.friction * pressed + problem.g
        forces = np.stack([rubbed, rubbed, pressed], axis=1).reshape(-1)
        products = np.abs(problem.S) @ y
        data = reach @ (gamma(n) * products + problem.dS @ y) + problem.dp @ y
        sums = 2 * reach @ products + 2 * forces @ y + np.abs(problem.p) @ y
        return float(up(data + gamma(n + 64) * sums))

    def impossible(self, cells: Cells, most: Array, margin: float) -> npt.NDArray[np.bool_]:
        """Return a mask of the k cells that the multipliers exclude, shape (k,).

        If all cells of a point are excluded, there is no solution in the cells.

        Args:
            cells: cells of all points.
            most: bounds of the quantities of `bounded_in_space`, shape (MOST, m).
            margin: required ratio of L (`SpaceDual`) to its error bound.
        """
        h = self.least(cells, most)
        lowest = np.minimum.reduceat(h, cells.first)
        rest = lowest.sum() - lowest - self._load
        count = np.diff(np.append(cells.first, len(cells)))
        return np.asarray(np.repeat(rest, count) + h > margin * self.round_off(most))

    def most(self, cells: Cells, most: Array, quantity: int, point: int) -> float:
        """Return an upper bound of a quantity of `bounded_in_space` at all solutions in the cells.

        For the quantity x it follows from x = x - y.(S a - r - p), see `SpaceDual`. It is -inf if x
        has no bound in any cell of the point.

        Args:
            cells: cells of all points.
            most: upper bounds of the quantities, shape (MOST, m).
            quantity: index of the quantity.
            point: index of the point.
        """
        h = self.least(cells, most, (quantity, point))
        bound = -np.minimum.reduceat(h, cells.first).sum() + self._load
        size = float(np.abs(most[:, point]).max())
        return float(bound + self.round_off(most) + gamma(len(self.y) + 64) * size)


def ends_of(most: Array, quantity: int) -> tuple[Array, Array]:
    """Return nonnegative lower and upper bounds of the slip or normal force, shape (m,) each.

    Args:
        most: upper bounds of the quantities of `bounded_in_space`, shape (MOST, m).
        quantity: `OF_S` for the slip distance, `OF_RN` for the normal force.
    """
    largest = np.maximum(most[quantity + 1], 0.0)
    return np.minimum(np.maximum(-most[quantity], 0.0), largest), largest


def _least_along(v: Array, first: Array, last: Array) -> Array:
    """Return the minimum of v.e over the unit vectors e of each of k arcs, shape (k,).

    Args:
        v: vectors, shape (k, 2).
        first: unit vectors at the first ends of the arcs, shape (k, 2).
        last: unit vectors at the last ends, shape (k, 2); each arc is less than half a circle.
    """
    (x, y), (x0, y0), (x1, y1) = v.T, first.T, last.T
    ends = np.minimum(x * x0 + y * y0, x * x1 + y * y1)
    doubt = _ANGLES * (np.abs(x) + np.abs(y))
    inside = (y0 * x - x0 * y >= -doubt) & (y * x1 - x * y1 >= -doubt)
    return np.where(inside, -np.hypot(x, y), ends)


# -- in space: pieces ------------------------------------------------------------------------------
#
# A piece prescribes one status at every point, numbered as in `laws.status`: 0 open, 1 stick, 2
# slip (closed if F = g = 0), 4 and 5 stick and slip of an open point with a prescribed bound g.
# The unknowns z are ut, or rt for stick, or s and the angle of e for slip; and un or rn. The
# equilibrium f(z) = 0 is nonlinear because of the slip directions. With an approximate inverse C of
# its Jacobian at z and the ball Z = z +- r, Krawczyk's test
#
#     |C f(z)| + max over Z of |I - C J| r  <  r
#
# proves that Z contains exactly one solution. A direction is an approximate unit vector (c, s)
# rotated by an angle in the ball, which changes its components by at most that angle. The proof
# therefore does not rely on the accuracy of computed sines and cosines.

_STUCK = np.array([False, True, False, False, True, False, False])
_WIDER = 10.0 ** np.arange(12, 0, -2)  # enlargement factors of the balls, tried in turn


@dataclass(frozen=True, eq=False)
class SpacePiece(_Piece):
    """Solution in 3D of the equations with one prescribed status at each of m points.

    Attributes:
        problem: reduced problem scaled by `ReducedProblem.scaled`.
        codes: prescribed statuses, shape (m,).
        z: approximate unknowns, shape (m, 3): tangential displacements, tangential forces for
            stick, or slip distance and angle of the slip direction; then the normal displacement,
            or the normal force of a closed point.
        e: approximate slip directions, 0 for other points, shape (m, 2).
        inverse: approximate inverse C of the Jacobian of the equilibrium, shape (3 m, 3 m).
        residual: bounds of |C f| with the equilibrium residual f at z, shape (3 m,).
        radius: radii of the ball around z containing the solution, shape (m, 3).
    """

    problem: ReducedProblem
    codes: Codes
    z: Array
    e: Array
    inverse: Array
    residual: Array
    radius: Array

    @cached_property
    def slips(self) -> npt.NDArray[np.bool_]:
        """Mask of those of the m points that have a slip direction, shape (m,)."""
        return _slipping(self.problem, self.codes)

    @cached_property
    def turn(self) -> Array:
        """Error bounds of the components of the slip directions, 0 without slip, shape (m,)."""
        return np.where(self.slips, up(self.radius[:, 1] + 16 * _U), 0.0)

    @cached_property
    def unknowns(self) -> tuple[Ball, Ball]:
        """Unknowns `z`, shape (m, 3), and slip directions `e`, shape (m, 2), with error bounds."""
        return Ball(self.z, self.radius), Ball(self.e, np.stack([self.turn] * 2, axis=1))

    @cached_property
    def numbers(self) -> Ball:  # type: ignore[override]
        """Displacements and forces (ut1, ut2, un, rt1, rt2, rn) with error bounds, shape (m, 6)."""
        return space_state(self.problem, self.codes, *self.unknowns)

    @cached_property
    def slack(self) -> Ball:
        """Slack F rn + g - |rt| of the friction bound, used at sticking points, shape (m,).

        F is the friction coefficient, g the prescribed bound, rn the normal and rt the tangential
        force of each of m points.
        """
        shear = hypot(self.numbers[:, 3], self.numbers[:, 4])
        return self.problem.friction * self.numbers[:, 5] + self.problem.g - shear

    @cached_property
    def inequalities(self) -> Ball:  # type: ignore[override]
        """Quantities that the law requires to be nonnegative, padded with ones, shape (m, 2)."""
        normal = where(IS_OPEN[self.codes], self.numbers[:, 2], self.numbers[:, 5])
        slid = where(self.slips, self.unknowns[0][:, 0], 1.0)
        return stack([normal, where(_STUCK[self.codes], self.slack, slid)])

    @cached_property
    def _alone(self) -> Array:
        """Largest radii tried around `z` that provably enclose no other solution, shape (m, 3)."""
        for factor in _WIDER:
            wide = factor * self.radius.reshape(-1)
            if (_growth(self, wide.reshape(-1, 3)) < wide).all():
                return wide.reshape(-1, 3)
        return self.radius

    def same(self, other: SpacePiece) -> bool | None:
        """Return whether ``other`` is the same solution; None if this is undecided."""
        if not np.array_equal(self.codes, other.codes):
            return False
        apart = np.abs(self.state - other.state)
        sure = gamma(4) * (np.abs(self.state) + np.abs(other.state))
        if (apart > up(self.away + other.away + sure)).any():
            return False
        off = np.abs(self.z - other.z)
        # The angle between two unit vectors is at most pi/2 times their distance.
        chord = np.hypot(*(self.e - other.e).T)
        off[self.slips, 1] = (1.6 * chord + 64 * _U)[self.slips]
        off = up(off + other.radius + gamma(4) * (np.abs(self.z) + np.abs(other.z)))
        return True if (off <= self._alone).all() else None


def _slipping(problem: ReducedProblem, codes: Codes) -> npt.NDArray[np.bool_]:
    """Return the mask of those of the m points that have a slip direction, shape (m,)."""
    rubs = (problem.friction > 0) | (problem.g > 0)
    return np.asarray(((codes == 2) | (codes == 5)) & rubs)


def space_state(problem: ReducedProblem, codes: Codes, z: Ball | Array, e: Ball | Array) -> Ball:
    """Return displacements ut1, ut2, un and forces rt1, rt2, rn of m points, shape (m, 6).

    Args:
        problem: reduced problem scaled by `ReducedProblem.scaled`.
        codes: statuses, shape (m,).
        z: unknowns, as in `SpacePiece`, shape (m, 3).
        e: slip directions, shape (m, 2).
    """
    z, e = Ball.of(z), Ball.of(e)
    opened = IS_OPEN[codes]
    stuck = _STUCK[codes]
    slips = _slipping(problem, codes)
    rn = where(opened, 0.0, z[:, 2])
    limit = problem.friction * rn + problem.g
    moves, pulls = [], []
    for c in (0, 1):
        moves.append(where(slips, z[:, 0] * e[:, c], where(stuck, 0.0, z[:, c])))
        pulls.append(where(slips, -limit * e[:, c], where(stuck, z[:, c], 0.0)))
    return stack([*moves, where(opened, z[:, 2], 0.0), *pulls, rn])


def space_jacobian(problem: ReducedProblem, codes: Codes, z: Ball | Array, e: Ball | Array) -> Ball:
    """Return the Jacobian of the equilibrium residual S a - r - p, shape (3 m, 3 m).

    Its columns belong to the unknowns ``z`` of `SpacePiece`. The arguments are explained in
    `space_state`.
    """
    z, e = Ball.of(z), Ball.of(e)
    S = problem.stiffness
    m = len(codes)
    opened = IS_OPEN[codes]
    stuck = _STUCK[codes]
    slips = np.flatnonzero(_slipping(problem, codes))
    J = Ball(np.zeros((3 * m, 3 * m)), np.zeros((3 * m, 3 * m)))
    at = 3 * np.arange(m)
    for free, column in ((~stuck, at), (~stuck, at + 1), (opened, at + 2)):
        J.put((slice(None), column[free]), S[:, column[free]])
        J.put((column[~free], column[~free]), -1.0)
    x = at[slips]
    along = [e[slips, c] for c in (0, 1)]
    across = [-along[1], along[0]]
    friction = np.where(opened, 0.0, problem.friction)[slips]
    limit = friction * z[slips, 2] + problem.g[slips]
    J.put((slice(None), x), S[:, x] * along[0] + S[:, x + 1] * along[1])
    turned = S[:, x] * across[0] + S[:, x + 1] * across[1]
    J.put((slice(None), x + 1), z[slips, 0] * turned)
    for c in (0, 1):
        J.put((x + c, x + 1), J[x + c, x + 1] + limit * across[c])
        J.put((x + c, x + 2), J[x + c, x + 2] + friction * along[c])
    return J


def _growth(piece: SpacePiece, radius: Array) -> Array:
    """Return the left-hand side |C f| + |I - C J| r of Krawczyk's test on a ball, shape (3 m,).

    If it is below the radii r, the ball contains exactly one solution. f is the residual, J its
    Jacobian in the ball, C an approximate inverse and I the identity.
    """
    turn = np.where(piece.slips, radius[:, 1] + 16 * _U, 0.0)
    unknowns = Ball(piece.z, radius), Ball(piece.e, np.stack([turn, turn], axis=1))
    J = space_jacobian(piece.problem, piece.codes, *unknowns)
    rest = (np.eye(3 * len(turn)) - piece.inverse @ J).size
    return up(piece.residual + rest @ radius.reshape(-1))


def _residual_of(problem: ReducedProblem, codes: Codes, z: Array, e: Array) -> Ball:
    """Return the equilibrium residual, including the round-off of slip directions, shape (3 m,)."""
    turn = np.where(_slipping(problem, codes), 16 * _U, 0.0)
    state = space_state(problem, codes, z, Ball(e, np.stack([turn, turn], axis=1)))
    a, r = (state[:, columns].reshape(-1) for columns in (slice(0, 3), slice(3, 6)))
    return problem.stiffness @ a - r - problem.load


def solve_in_space(problem: ReducedProblem, codes: Codes, z: Array) -> SpacePiece | None:
    """Solve a 3D problem with one given status per point, near given unknowns.

    None if Krawczyk's test (`_growth`) does not prove a solution.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        codes: statuses, shape (m,).
        z: approximate unknowns (`SpacePiece`), shape (m, 3), improved by up to three Newton steps.
    """
    z = np.array(z, dtype=np.float64)
    slips = _slipping(problem, codes)
    for attempt in range(4):
        e = np.zeros((len(codes), 2))
        e[slips] = np.stack([np.cos(z[slips, 1]), np.sin(z[slips, 1])], axis=1)
        e[slips] /= np.hypot(e[slips, 0], e[slips, 1])[:, None]
        try:
            C = np.linalg.inv(space_jacobian(problem, codes, z, e).value)
        except np.linalg.LinAlgError:
            return None
        f = _residual_of(problem, codes, z, e)
        if not (np.isfinite(C).all() and np.isfinite(f.value).all()):
            return None
        if attempt == 3 or not (np.abs(f.value) > f.radius).any():
            break
        z = z - (C @ f.value).reshape(-1, 3)
    left = up(np.abs(C) @ f.size)
    inverse = np.asarray(C, dtype=np.float64)
    ball: Array = np.asarray(2 * left + TINY, dtype=np.float64).reshape(-1, 3)
    for _ in range(6):
        piece = SpacePiece(problem, codes, z, e, inverse, left, ball)
        grown = _growth(piece, ball).reshape(-1, 3)
        if (grown < ball).all():
            return piece
        ball = np.asarray(2 * grown, dtype=np.float64)
        if not ball.max() < 1.0:
            return None
    return None


# -- in space: uniqueness within cells of one kind -------------------------------------------------
#
# Let every point have cells of a single kind, and let b solve the corresponding piece. Let a be any
# solution in the cells, and phi the angle from the slip direction of b to that of a at a slipping
# point. With the means s and rn of the slips and pressures of a and b, and w = 2 sin(phi / 2),
#
#     D ut = ds m + s w m',    D rt = -F (dr m + rn w m'),    m = (xi_a + xi_b) / 2,
#
# with a unit vector m' perpendicular to m, xi_a - xi_b = w m'. These identities are exact, and
# S D a = D r reads M x = 0 with x = (ds, w, dr) at such a point and M in an interval matrix. If
# |C M - I| <= G for all these M and G v < v for some v > 0, every M is regular and a = b.


def only_one(piece: SpacePiece, cells: Cells, most: Array) -> bool:
    """Return whether the cells provably contain no solution except ``piece``.

    An interval matrix mapping the difference of two solutions to 0 is proved to be regular.

    Args:
        piece: solution for one given status per point.
        cells: cells of all points, at each point only of the kind of its status.
        most: upper bounds of the quantities of `bounded_in_space`, shape (MOST, m).
    """
    problem = piece.problem
    if (problem.g > 0).any():
        return False
    n = 3 * problem.points
    none = np.zeros_like
    M = space_jacobian(problem, piece.codes, none(piece.z), none(piece.e))
    terms: list[_Term] = []
    for i in np.flatnonzero(piece.slips):
        found = _columns_of_slip(piece, cells, most, int(i))
        if found is None:
            return False
        terms += found
        for term in found:
            column = (slice(None), term.column)
            M.put(column, M[column] + term.middle * term.vector)
    try:
        C = np.linalg.inv(M.value)
    except np.linalg.LinAlgError:
        return False
    if not np.isfinite(C).all():
        return False
    G = (np.eye(n) - C @ M).size
    for term in terms:
        G[:, term.column] += (C @ term.vector).size * term.width
    return _contracts(up(G))


@dataclass(frozen=True, eq=False)
class _Term:
    """Contribution (middle +- width) * vector to a column of the interval matrix of `only_one`.

    Attributes:
        column: index of the column.
        vector: direction of the term, shape (3 m,).
        middle: midpoint of the factor.
        width: half-width of the interval of the factor.
    """

    column: int
    vector: Ball
    middle: float
    width: float


def _contracts(G: Array) -> bool:
    """Return whether G v < v is proved for some vector v > 0, with a nonnegative matrix G."""
    if not np.isfinite(G).all():
        return False
    v = np.ones(len(G))
    for _ in range(60):
        w = G @ v + 1e-12
        v = w / w.max()
    return bool((up(G @ v) < v).all())


def angles_of(
    piece: SpacePiece, cells: Cells, point: int, widest: float = 3.5
) -> tuple[float, float] | None:
    """Return the range of angles from the slip direction of ``piece`` to those in the arcs.

    The result is the smallest and the largest angle, in radians. It is None if the arcs of the
    point contain the direction opposite to the slip, or their hull is wider than ``widest``.

    Args:
        piece: solution for one given status per point.
        cells: cells of all points.
        point: index of the point.
        widest: largest width of the hull (`Cells.hull`) of the arcs, in diamond angles.
    """
    hull = cells.hull(point)
    if hull is None or hull[1] > widest:
        return None
    ends = rays(np.array([hull[0], hull[0] + hull[1]]))
    c, s = piece.e[point]
    low, high = np.arctan2(c * ends[:, 1] - s * ends[:, 0], c * ends[:, 0] + s * ends[:, 1])
    (x0, y0), (x1, y1) = ends
    width = np.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1) % (2 * np.pi)
    # If the hull contains the opposite direction, the difference of angles is off by 2 pi.
    if not abs(high - low - width) < 1e-9:
        return None
    more = float(up(piece.turn[point] * 1.6 + _ANGLES))
    return float(low) - more, float(high) + more


def _columns_of_slip(piece: SpacePiece, cells: Cells, most: Array, i: int) -> list[_Term] | None:
    """Return the terms of a slipping point in the interval matrix of `only_one`.

    None if the arcs of the point are too wide.

    The term -dr in the equation of the normal force is not included.
    """
    found = angles_of(piece, cells, i)
    if found is None:
        return None
    low, high = found
    far = max(abs(low), abs(high))
    if far >= 3.0:
        return None
    psi = (low + high) / 4
    swing = (high - low) / 4 + _ANGLES
    cosine = float(np.cos(swing)) - _ANGLES
    least = cosine * (float(np.cos(far / 2)) - _ANGLES)
    tilt = float(np.sin(swing)) + 9 * _ANGLES
    part = (1 + least) / 2, (1 - least) / 2 + 8 * _ANGLES
    # Intervals of the means of s and rn, and of their products with the cosine of the swing.
    slid = _mean(most, OF_S, i, float(piece.z[i, 0]), float(piece.radius[i, 0]))
    pressed = _mean(most, OF_RN, i, float(piece.z[i, 2]), float(piece.radius[i, 2]))
    of_s, of_r = (_between(*ends, cosine) for ends in (slid, pressed))
    s_tilt, r_tilt = (max(map(abs, ends)) * tilt for ends in (slid, pressed))
    c, s = piece.e[i]
    turned = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
    along = turned @ np.array([c, s])
    across = np.array([-along[1], along[0]])
    columns = piece.problem.stiffness[:, 3 * i : 3 * i + 2]
    stiff = [columns @ v for v in (along, across)]
    rubbed = [_force(piece.problem, i, v) for v in (along, across)]
    table = [
        (0, stiff[0], *part),
        (0, stiff[1], 0.0, tilt),
        (1, stiff[1], *of_s),
        (1, stiff[0], 0.0, s_tilt),
        (1, rubbed[1], *of_r),
        (1, rubbed[0], 0.0, r_tilt),
        (2, rubbed[0], *part),
        (2, rubbed[1], 0.0, tilt),
    ]
    return [_Term(3 * i + k, v, middle, above(width)) for k, v, middle, width in table]


def _force(problem: ReducedProblem, i: int, direction: Array) -> Ball:
    """Return a vector with F times a direction at point ``i`` and 0 elsewhere, shape (3 m,)."""
    found = Ball(np.zeros(len(problem.p)), np.zeros(len(problem.p)))
    found.put(slice(3 * i, 3 * i + 2), problem.friction[i] * Ball.of(direction))
    return found


def _between(low: float, high: float, cosine: float) -> tuple[float, float]:
    """Return the midpoint and the half-width of the products of [low, high] and [cosine, 1]."""
    low, high = min(low, low * cosine), max(high, high * cosine)
    return (low + high) / 2, (high - low) / 2 + 8 * _ANGLES * max(abs(low), abs(high))


def _mean(most: Array, quantity: int, i: int, value: float, off: float) -> tuple[float, float]:
    """Return lower and upper bounds of the mean of a quantity in two solutions a and b.

    Args:
        most: upper bounds of the quantities of `bounded_in_space` at a, shape (MOST, m).
        quantity: `OF_S` for the slip distance, `OF_RN` for the normal force.
        i: index of the point.
        value: value in b.
        off: error bound of this value.
    """
    least, largest = (float(v[i]) for v in ends_of(most, quantity))
    more = above(off + gamma(4) * (abs(value) + largest))
    return (least + value) / 2 - more, (largest + value) / 2 + more


# -- in space: differences -------------------------------------------------------------------------
#
# As in the plane, b is the solution of a piece, a is any solution in the cells, d = a - b, and e =
# S d. xi_b is the slip direction at a slipping point, -rt_b / (F rn_b) at a sticking point, and
# ut_b / |ut_b| at an open point. With f = e_t + F xi_b e_n = -F rn_a (xi_a - xi_b), the following
# expressions are not positive:
#
#     T   d_t.f + s_b / (2 F R) |f|^2                 b slips or is open; rn_a <= R
#         d_t.f + F r (1 - |xi_b|) / s |d_t|^2        b sticks; rn_a >= r, s_a <= s
#     N   d_n e_n + rn_b / Un d_n^2, or un_b / R e_n^2
#     H   d_n (e_n + theta.e_t),  |theta| <= 1 / F, along each axis
#     A   f_1^2 - tan(far / 2)^2 f_2^2                b slips; f_1 along xi_b and f_2 across; the
#                                                     angle between xi_a and xi_b is at most far
#     Q   (f_2 + k d_2) (f_2 + K d_2)                 f_2 = -c d_2, k <= c = F rn_a / s_a <= K
#     P   f_2 d_2 + k d_2^2                           the same without K
#
# They follow from the monotonicity of the graphs and from 2 (1 - xi_a.xi_b) >= |xi_a - xi_b|^2.
# A, Q and P require that neither a nor b sticks; Q and P also require that no cell is open. Where
# F = 0, T is d_t.e_t + s_b / (2 g) |e_t|^2, and without friction e_t = 0. Points with only open
# cells have e = 0 (with g > 0 only e_n = 0), points without open cells have d_n = 0, and points
# with only stick cells have d = 0. *b has to satisfy only the hypotheses of the expressions used.*
#
# **If a sum of these expressions with nonnegative weights, plus nonnegative multiples of the
# squares of the vanishing components, is a positive definite quadratic form of d, then d = 0: b is
# the only possible solution in the cells.**

#: The inequalities, in the order of the weights: T, N, four of H, A, Q, P.
FAMILIES = ("T", "N", "H", "H", "H", "H", "A", "Q", "P")
_ROWS = 6  # (d_1, d_2, d_n, e_1, e_2, e_n) of a point


@dataclass(frozen=True, eq=False)
class SpaceDifferences:
    """Inequalities of all points as quadratic forms of a difference d of solutions and e = S d.

    Attributes:
        problem: scaled reduced problem.
        unknown: indices of the n components of d that may be nonzero, among 3 m, shape (n,).
        forms: quadratic form of each of the nine `FAMILIES` at each point, 0 if there is none,
            shape (9, m, 6, 6).
        sizes: sums of the absolute values of the terms of the forms, shape (9, m, 6, 6).
        errors: error bounds of the forms, shape (9, m, 6, 6).
        has: mask of the families and points with a form, shape (9, m).
        vanishing: mask of the components of e that are 0, shape (3 m,).
    """

    problem: ReducedProblem
    unknown: npt.NDArray[np.int64]
    forms: Array
    sizes: Array
    errors: Array
    has: npt.NDArray[np.bool_]
    vanishing: npt.NDArray[np.bool_]

    @cached_property
    def rows(self) -> Array:
        """Matrices mapping the n free components of d to d and S d, shape (m, 6, n).

        d is the difference of two solutions and S the stiffness matrix.
        """
        m = self.problem.points
        found = np.zeros((m, _ROWS, len(self.unknown)))
        found[self.unknown // 3, self.unknown % 3, np.arange(len(self.unknown))] = 1.0
        found[:, 3:] = self.problem.S[:, self.unknown].reshape(m, 3, -1)
        return found

    def prove(self, weights: Array, mu: float) -> bool:
        """Return whether the weighted sum of the forms is proved to be positive definite.

        The proof covers all errors of the data and of rounding. It implies that the two compared
        solutions are equal.

        Args:
            weights: nonnegative weights of the forms, ignored where a form is absent, shape (9, m).
            mu: nonnegative weight of the squares of the vanishing components.
        """
        if not ((weights >= 0).all() and np.isfinite(weights).all() and 0 <= mu < np.inf):
            return False
        if len(self.unknown) == 0:
            return True
        w = np.where(self.has, weights, 0.0)
        W, size, error = (
            np.einsum("fi,fiab->iab", w, v) for v in (self.forms, self.sizes, self.errors)
        )
        m = self.problem.points
        i, c = np.nonzero(self.vanishing.reshape(m, 3))
        square = mu / np.diag(self.problem.S).reshape(m, 3)[i, c]
        for v in (W, size):
            v[i, 3 + c, 3 + c] += square
        B = self.rows.reshape(-1, len(self.unknown))
        n = len(B)
        product = B.T @ np.einsum("iab,ibk->iak", W, self.rows).reshape(n, -1)
        big = np.abs(self.rows)
        data = np.zeros_like(big)
        data[:, 3:] = self.problem.dS[:, self.unknown].reshape(m, 3, -1)
        flat = np.abs(B)
        spread = np.einsum("iab,ibk->iak", error + gamma(n + 32) * size, big).reshape(n, -1)
        away = flat.T @ spread
        if data.any():
            other = np.einsum("iab,ibk->iak", size + error, data).reshape(n, -1)
            moved = flat.T @ other
            away += moved + moved.T + data.reshape(n, -1).T @ other
        form = (product + product.T) / 2
        return positive_definite(form, up(away + gamma(4) * np.abs(form)))


def space_differences(piece: SpacePiece, cells: Cells, most: Array) -> SpaceDifferences | None:
    """Return inequalities in 3D for the difference of two solutions a and b.

    None if b does not provably satisfy the conditions of the inequalities.

    Args:
        piece: solution b for one given status per point.
        cells: cells that contain a.
        most: upper bounds of the quantities of `bounded_in_space` at a, shape (MOST, m).
    """
    problem = piece.problem
    m = problem.points
    made = _Forms(m)
    unknown = np.zeros((m, 3), dtype=bool)
    vanishing = np.zeros((m, 3), dtype=bool)
    for i in range(m):
        kinds = cells.kinds_at(i)
        one = next(iter(kinds)) if len(kinds) == 1 else None
        if one == IN_STICK:
            if piece.codes[i] != 1:
                return None
            continue
        unknown[i, :2] = True
        unknown[i, 2] = IN_OPEN in kinds
        fits = (
            _forms_of_coulomb(piece, cells, most, i, kinds, made)
            if problem.friction[i] > 0
            else _forms_of_given(piece, most, i, kinds, made)
        )
        if not fits:
            return None
        if one == IN_OPEN:
            vanishing[i] = [problem.g[i] == 0, problem.g[i] == 0, True]
        elif problem.friction[i] == 0 and problem.g[i] == 0:
            vanishing[i, :2] = True
    known = np.flatnonzero(unknown.reshape(-1))
    return SpaceDifferences(problem, known, *made.summed(), vanishing.reshape(-1))


class _Forms:
    """Sums of products of linear forms: the quadratic forms of `SpaceDifferences`."""

    def __init__(self, m: int):
        self.shape = (len(FAMILIES), m)
        self.places: list[tuple[int, int]] = []
        self.factors: list[float] = []
        self.parts: list[tuple[Array, Array, Array, Array]] = []

    def add(self, family: int, i: int, factor: float, x: Ball, y: Ball) -> None:
        """Add factor x y, with linear forms x and y of (d, e), to a family at point ``i``.

        The factor must be exact or a safe bound.
        """
        self.places.append((family, i))
        self.factors.append(factor)
        self.parts.append((x.value, x.radius, y.value, y.radius))

    def summed(self) -> tuple[Array, Array, Array, npt.NDArray[np.bool_]]:
        """Return `forms`, `sizes`, `errors` and `has` of `SpaceDifferences`."""
        found = [np.zeros((*self.shape, _ROWS, _ROWS)) for _ in range(3)]
        has = np.zeros(self.shape, dtype=bool)
        if self.places:
            family, i = np.array(self.places).T
            has[family, i] = True
            factor = np.array(self.factors)[:, None, None]
            x, dx, y, dy = np.array(self.parts).transpose(1, 0, 2)
            size = np.abs(x)[:, :, None] * np.abs(y)[:, None, :]
            off = (np.abs(x) + dx)[:, :, None] * (np.abs(y) + dy)[:, None, :] - size
            off = np.abs(factor) * (np.maximum(off, 0) + gamma(8) * size)
            product = factor * (x[:, :, None] * y[:, None, :])
            for whole, part in zip(found, (product, np.abs(factor) * size, up(off)), strict=True):
                np.add.at(whole, (family, i), (part + part.transpose(0, 2, 1)) / 2)
        return found[0], found[1], up(found[2]), has


def _linear(**parts: tuple[float, float]) -> Ball:
    """Return a linear form of d and e with the given (coefficient, error bound) pairs."""
    names = ("d1", "d2", "dn", "e1", "e2", "en")
    value = np.zeros(_ROWS)
    away = np.zeros(_ROWS)
    for name, (number, off) in parts.items():
        value[names.index(name)] = number
        away[names.index(name)] = off
    return Ball(value, away)


_ONE = (1.0, 0.0)
_D = (_linear(d1=_ONE), _linear(d2=_ONE), _linear(dn=_ONE))
_E = (_linear(e1=_ONE), _linear(e2=_ONE), _linear(en=_ONE))


def _direction(piece: SpacePiece, i: int) -> tuple[Array, float, float] | None:
    """Return the slip direction at point ``i``, its error bound, and a lower bound of the slip.

    At a sticking point the direction is -rt / (F rn). None if no error bound is available, because
    the forces or the displacement may be zero.
    """
    F = float(piece.problem.friction[i])
    state, away = piece.state[i], piece.away[i]
    if piece.slips[i]:
        return piece.e[i], float(piece.turn[i]), float(piece.z[i, 0] - piece.radius[i, 0])
    if piece.codes[i] == 1:
        least = F * (state[5] - away[5]) * (1 - gamma(4))
        if not least > 0:
            return None
        xi = -state[3:5] / (F * state[5])
        off = (away[3:5].max() + F * away[5]) / least
        return xi, above(off + gamma(8)), 0.0
    size = float(np.hypot(state[0], state[1]))
    off = float(np.hypot(away[0], away[1]))
    if not size > 4 * off:
        return None
    return state[:2] / size, above(4 * off / size + gamma(8)), size - 2 * off


def _forms_of_coulomb(
    piece: SpacePiece, cells: Cells, most: Array, i: int, kinds: frozenset[int], made: _Forms
) -> bool:
    """Add the forms (`SpaceDifferences`) of point ``i``, which has Coulomb friction.

    Return whether the solution of ``piece`` provably satisfies the conditions of its status.
    """
    code = int(piece.codes[i])
    kind = {0: IN_OPEN, 1: IN_STICK, 2: IN_SLIP}.get(code)
    if kind not in kinds:
        return False
    if kinds == {IN_OPEN}:
        return True
    if code == 1 and not piece.slack.low[i] >= 0:
        return False
    found = _direction(piece, i)
    if found is None:
        return False
    xi, turn, slid = found
    F = float(piece.problem.friction[i])
    Fxi = [(F * float(x), above(F * turn + gamma(4) * F)) for x in xi]
    f = (_linear(e1=_ONE, en=Fxi[0]), _linear(e2=_ONE, en=Fxi[1]))
    _tangential(piece, most, i, kinds, made, f, slid)
    if IN_OPEN in kinds and not _normal(piece, most, i, kinds, made):
        return False
    if IN_STICK not in kinds and code == 2:
        _of_arcs(piece, cells, most, i, made, IN_OPEN in kinds)
    return True


def _tangential(
    piece: SpacePiece,
    most: Array,
    i: int,
    kinds: frozenset[int],
    made: _Forms,
    f: tuple[Ball, Ball],
    slid: float,
) -> None:
    """Add the form T (`FAMILIES`) of a point with Coulomb friction."""
    if slid < 0:
        return
    F = float(piece.problem.friction[i])
    pressed = _largest_pressure(most, i, kinds)
    for c in (0, 1):
        made.add(0, i, 1.0, _D[c], f[c])
        if slid > 0:
            made.add(0, i, _ratio(slid, above(2 * F * pressed)), f[c], f[c])
    least = float(ends_of(most, OF_RN)[0][i])
    if piece.codes[i] == 1 and IN_OPEN not in kinds and IN_SLIP in kinds and least > 0:
        share = float(piece.slack.low[i]) / float(F * (piece.state[i, 5] + piece.away[i, 5]))
        largest = float(ends_of(most, OF_S)[1][i])
        for c in (0, 1):
            made.add(0, i, _ratio(F * least * share * (1 - 2 * _SLACK), largest), _D[c], _D[c])


def _largest_pressure(most: Array, i: int, kinds: frozenset[int]) -> float:
    """Return an upper bound of the normal force at a point with cells of these kinds."""
    slides = ends_of(most, OF_RN)[1][i] if kinds & {IN_SLIP, IN_CLOSED} else 0.0
    sticks = max(float(most[OF_RK, i]), 0.0) if IN_STICK in kinds else 0.0
    return float(max(slides, sticks))


def _normal(piece: SpacePiece, most: Array, i: int, kinds: frozenset[int], made: _Forms) -> bool:
    """Add the forms N and H (`FAMILIES`) of a point with open and closed cells.

    Return whether b provably satisfies the conditions of its status.
    """
    opened = bool(IS_OPEN[piece.codes[i]])
    column = 2 if opened else 5
    part = float(piece.state[i, column] - piece.away[i, column] * (1 + gamma(4)))
    if not part >= 0:
        return False
    made.add(1, i, 1.0, _D[2], _E[2])
    if opened:
        made.add(1, i, _ratio(part, _largest_pressure(most, i, kinds)), _E[2], _E[2])
    else:
        made.add(1, i, _ratio(part, float(most[OF_UN, i])), _D[2], _D[2])
    F = float(piece.problem.friction[i])
    if F > 0:
        for k, (c, sign) in enumerate(((0, 1), (0, -1), (1, 1), (1, -1))):
            made.add(2 + k, i, 1.0, _D[2], _E[2])
            made.add(2 + k, i, sign * below(1 / F), _D[2], _E[c])
    return True


def _of_arcs(
    piece: SpacePiece, cells: Cells, most: Array, i: int, made: _Forms, opens: bool
) -> None:
    """Add the forms A, Q and P (`FAMILIES`) of a point that slips in b and has no stick cell."""
    found = angles_of(piece, cells, i)
    far = np.inf if found is None else max(abs(found[0]), abs(found[1]))
    if far >= 2.8:
        return
    F = float(piece.problem.friction[i])
    c, s = (float(v) for v in piece.e[i])
    off = float(piece.turn[i])
    # The coefficients F and 0 of e_n are exact for any unit vector xi.
    one = _linear(e1=(c, off), e2=(s, off), en=(F, 0.0))
    two = _linear(e1=(-s, off), e2=(c, off))
    across = _linear(d1=(-s, off), d2=(c, off))
    tangent = above(np.tan(far / 2 + _ANGLES) + _ANGLES)
    made.add(6, i, 1.0, one, one)
    made.add(6, i, -above(tangent**2), two, two)
    if opens:
        return
    (s_low, s_high), (r_low, r_high) = (
        (float(v[i]) for v in ends_of(most, quantity)) for quantity in (OF_S, OF_RN)
    )
    k = _ratio(F * r_low, s_high) * (1 - 2 * _SLACK)
    made.add(8, i, 1.0, two, across)
    made.add(8, i, k, across, across)
    if s_low > 0:
        most_k = above(above(F * r_high) / s_low)
        made.add(7, i, 1.0, two, two)
        made.add(7, i, k + most_k, two, across)
        made.add(7, i, k * most_k, across, across)


def _forms_of_given(
    piece: SpacePiece, most: Array, i: int, kinds: frozenset[int], made: _Forms
) -> bool:
    """Add the forms (`SpaceDifferences`) of point ``i``, which has no Coulomb friction.

    Return whether the solution of ``piece`` provably satisfies the conditions of its status.
    """
    code = int(piece.codes[i])
    g = float(piece.problem.g[i])
    if (IN_OPEN if IS_OPEN[code] else IN_CLOSED) not in kinds:
        return False
    if g > 0:
        slid = float(piece.z[i, 0] - piece.radius[i, 0]) if piece.slips[i] else 0.0
        if slid < 0 or (_STUCK[code] and not piece.slack.low[i] >= 0):
            return False
        for c in (0, 1):
            made.add(0, i, 1.0, _D[c], _E[c])
            made.add(0, i, _ratio(slid, 2 * g), _E[c], _E[c])
    if len(kinds) > 1:
        return _normal(piece, most, i, kinds, made)
    return True


# -- the proof as data -----------------------------------------------------------------------------
#
# A proof is stored as the problem and a tree of steps, which `check` verifies.
#
# The steps are listed in depth-first order, parents before children. They act on the remaining sets
# of statuses and on the bounds of the six quantities. ``y`` is an index into `Certificate.vectors`.
# Leaves close a region.
#
# - ``exclude``: the vector ``y`` excludes the pairs ``what`` of a point and a status.
# - ``bound``: the vector ``y`` bounds the quantity ``slot`` of a ``point`` by ``value``.
# - ``empty``: the vector ``y`` proves that the region contains no solution; a leaf.
# - ``only``: only the solution of the piece ``codes`` is possible, proved by ``weights``, ``theta``
#   and ``mu`` (differences, above); a leaf.
# - ``pieces``: every remaining piece is solved; a leaf. ``singular`` lists pieces that may be
#   singular, with vectors that prove them empty.
# - ``branch``: the statuses of a ``point`` are divided into the sets ``parts``; subtrees follow.
# - ``rest``: without a load, a = 0 is the only solution; a leaf.
# - ``open``: nothing is proved; a leaf.
#
# In space the steps act on the remaining cells, referenced by their indices, and on the bounds:
#
# - ``exclude``: the vector ``y`` excludes the cells ``what``; a leaf if no cell of a point remains.
# - ``bound``: the vector ``y`` bounds a ``quantity`` of a ``point`` by ``value``.
# - ``empty``, ``rest``, ``open``: as above; ``open`` contains the reason ``why``.
# - ``halve``: all arcs of a ``point`` are bisected.
# - ``branch``: the cells of a ``point`` are divided into the lists ``parts``; subtrees follow.
# - ``leaf``: only the solution of the piece ``codes`` near ``z`` is possible, proved by an interval
#   matrix; a leaf.
# - ``only``: the same, proved by ``weights`` and ``mu`` (differences in space, above); a leaf.


class InvalidCertificate(ValueError):
    """Error raised if a file is not a proof, was changed, or contains an invalid step."""


@dataclass
class Certificate:
    """Proof of statements about the solutions of a reduced problem.

    Attributes:
        problem: reduced problem in the units of the user.
        steps: steps of the proof in depth-first order, as dictionaries; by default empty.
        vectors: multipliers of the equations S a - r = p, in scaled units, shape (dim m,) each;
            by default empty.
        force_unit: value of one unit of p in the user's unit of force, by which printed forces are
            multiplied; by default 1. The proof does not depend on it.
    """

    problem: ReducedProblem
    steps: list[dict[str, Any]] = field(default_factory=list)
    vectors: list[Array] = field(default_factory=list)
    force_unit: float = 1.0

    def vector(self, y: Array) -> int:
        """Store a vector of multipliers, shape (dim m,), and return its index in `vectors`."""
        if not self.vectors or self.vectors[-1] is not y:
            self.vectors.append(y)
        return len(self.vectors) - 1

    def __str__(self) -> str:
        steps = _number(len(self.steps), "step")
        points = _number(self.problem.points, "contact point")
        return f"a proof of {steps} about {points}, to be checked"

    @property
    def digest(self) -> str:
        """SHA-256 hash of the steps, the vectors and, if not 1, `force_unit`, hexadecimal."""
        unit = {} if self.force_unit == 1.0 else {"force_unit": np.array(self.force_unit)}
        return _digest({"vectors": self._table} | unit, json.dumps(self.steps))

    @property
    def _table(self) -> Array:
        return np.array(self.vectors, dtype=float).reshape(len(self.vectors), len(self.problem.p))

    def save(self, path: str | Path) -> None:
        """Write the proof to a ``.npz`` file, which `main` can check. Call it on one rank only."""
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
            force_unit=np.array(self.force_unit),
            format=np.array(_FORMAT),
            digests=np.array([self.problem.digest, self.digest]),
        )

    @classmethod
    def load(cls, path: str | Path) -> Certificate:
        """Read a proof written by `save`. Files of older versions without a hash are accepted.

        Args:
            path: ``.npz`` file.

        Raises:
            FileNotFoundError: if the file does not exist.
            InvalidCertificate: if the file is not a proof, has another format, or was changed; a
                subclass of ``ValueError``.
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"there is no file {path}")
        try:
            if not zipfile.is_zipfile(path):
                raise ValueError("it is not an npz file")
            with np.load(path, allow_pickle=False) as archive:
                found = {name: archive[name] for name in archive.files}
            missing = {*_DATA, "steps", "vectors"} - set(found)
            if missing:
                raise ValueError(
                    f"it is not a certificate: parts are missing: {', '.join(sorted(missing))}"
                )
            kind = str(found.get("format", _FORMAT))
            if kind != _FORMAT:
                raise ValueError(f"it is of the format {kind!r}; {_FORMAT!r} is known")
            if any(found[name].dtype != np.float64 for name in (*_DATA, "vectors")):
                raise ValueError("a part holds no double numbers")
            problem = ReducedProblem(**{name: found[name] for name in _DATA})
            unit = float(found.get("force_unit", 1.0))
            if not (np.isfinite(unit) and unit > 0):
                raise ValueError(f"its unit of forces is {unit}")
            proof = cls(problem, json.loads(str(found["steps"])), list(found["vectors"]), unit)
            digests = [problem.digest, proof.digest]
        except Exception as error:  # a file that is not a proof may cause any error
            raise InvalidCertificate(f"{path} is not a proof: {error}") from error
        if "format" in found or "digests" in found:
            stated = found.get("digests", np.zeros(0)).tolist()
            for what, now, then in zip(("data", "steps"), digests, [*stated, "", ""], strict=False):
                if now != then:
                    raise InvalidCertificate(f"{path} was changed: the {what} are not those stored")
        return proof


def _digest(arrays: dict[str, Array], text: str = "") -> str:
    """Return the SHA-256 hash of a text and of the names, shapes and values of arrays.

    It does not depend on the machine.
    """
    found = hashlib.sha256(text.encode())
    for name, values in arrays.items():
        found.update(f"{name}{values.shape}".encode())
        # Adding 0.0 maps -0.0 to 0.0, so that both have the same hash.
        found.update((values + 0.0).astype("<f8").tobytes())
    return found.hexdigest()


# -- the check -------------------------------------------------------------------------------------


MOST_PIECES = 256


def in_words(solutions: int, border: int, singular: int, regions: int) -> str:
    """Describe the number of proved solutions and the undecided cases.

    Args:
        solutions: number of proved solutions.
        border: number of states that satisfy an inequality only within the error bounds.
        singular: number of choices of statuses for which the equations may be singular.
        regions: number of regions about which nothing is proved.
    """
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
    """Statements about the solutions that the steps of a proof have proved.

    Attributes:
        inside: solutions that strictly satisfy all inequalities of the law.
        border: states that satisfy an inequality only within the error bounds; each may or may not
            be a solution.
        singular: statuses of the m points, shape (m,) each, for which the equations may be
            singular; each may have one solution, none or a continuum.
        open_regions: sets of statuses (in 3D, cells) about which nothing is proved.
        at_rest: whether the load vanishes, so that zero displacement is the only solution.
    """

    inside: list[PieceSolution | SpacePiece] = field(default_factory=list)
    border: list[PieceSolution | SpacePiece] = field(default_factory=list)
    singular: list[npt.NDArray[np.int8]] = field(default_factory=list)
    open_regions: list[Masks | OpenCells] = field(default_factory=list)
    at_rest: bool = False

    @property
    def verdict(self) -> Verdict:
        """Completeness of the proved solutions.

        ``"complete"``: no other solution exists. ``"degenerate"``: other solutions are possible
        only in `border` and `singular`. ``"open"``: other solutions are possible in `open_regions`.
        """
        if self.open_regions:
            return "open"
        return "degenerate" if self.border or self.singular else "complete"

    def __str__(self) -> str:
        number = len(self.inside) + int(self.at_rest)
        return in_words(number, len(self.border), len(self.singular), len(self.open_regions))

    def add(self, piece: PieceSolution | SpacePiece) -> None:
        """Add a solution to `inside` or `border`, unless included or certainly violating the law.

        Raises:
            InvalidCertificate: if two solutions in 3D cannot be distinguished.
        """
        kind = piece.verdict
        if kind == "outside":
            return
        known = self.inside if kind == "inside" else self.border
        same = [_is_same(other, piece) for other in known]
        if True in same:
            return
        if None in same and kind == "inside":
            raise InvalidCertificate("two solutions cannot be distinguished")
        known.append(piece)


def _is_same(a: PieceSolution | SpacePiece, b: PieceSolution | SpacePiece) -> bool | None:
    """Return whether two solutions are the same; None if this is undecided."""
    if isinstance(a, SpacePiece) and isinstance(b, SpacePiece):
        return a.same(b)
    return bool(np.array_equal(a.codes, b.codes))


class _Region:
    """Node of the search tree: remaining statuses or cells, with bounds of the solutions."""

    def dual(self, y: Array) -> Any:
        """Return the `Dual` (2D) or `SpaceDual` (3D) with the multipliers ``y``."""
        raise NotImplementedError

    @property
    def limits(self) -> tuple[Any, Array]:
        """Remaining statuses or cells, and bounds: first arguments of `impossible` of the dual."""
        raise NotImplementedError

    def excluded(self, y: Array, margin: float = 1.0) -> npt.NDArray[np.bool_]:
        """Return a mask of the excluded statuses, shape (m, 7), or cells, shape (k,).

        Args:
            y: multipliers (`Dual`, `SpaceDual`), shape (dim m,).
            margin: required ratio of the dual bound L to its error bound; by default 1.
        """
        return np.asarray(self.dual(y).impossible(*self.limits, margin))


@dataclass(eq=False)
class StatusRegion(_Region):
    """Region of the search in 2D: allowed statuses, and bounds of the solutions with them.

    Attributes:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        allowed: allowed statuses of the points as bit masks, shape (m,).
        ub: upper bounds of the six quantities of `bounded`, shape (6, m).
    """

    problem: ReducedProblem
    allowed: Masks
    ub: Array

    QUANTITY = ("slot", 6)

    @classmethod
    def whole(cls, problem: ReducedProblem) -> StatusRegion:
        """Return the region with all statuses that the law admits, and the bounds of `bounded`."""
        return cls(problem, problem.statuses.copy(), bounded(problem))

    def held(self, allowed: Masks) -> StatusRegion:
        """Return a copy of the region with other allowed statuses, bit masks of shape (m,).

        The bounds of quantities that vanish in all of these statuses are set to 0.
        """
        return StatusRegion(self.problem, allowed, restricted(self.problem, allowed, self.ub))

    @property
    def choices(self) -> list[list[int]]:
        """Remaining statuses of every point."""
        return [[int(s) for s in np.flatnonzero(has)] for has in has_status(self.allowed)]

    @property
    def pieces(self) -> float:
        """Number of choices of one remaining status per point."""
        return float(np.prod([float(len(c)) for c in self.choices]))

    def dual(self, y: Array) -> Dual:
        return Dual(self.problem, y)

    @property
    def limits(self) -> tuple[Masks, Array]:
        return self.allowed, self.ub

    def empties(self, excluded: npt.NDArray[np.bool_]) -> bool:
        """Return whether a mask, shape (m, 7), excludes all remaining statuses of some point."""
        return bool((excluded == has_status(self.allowed)).all(axis=1).any())

    def limit(self, slot: int, point: int, value: float) -> None:
        """Lower the bound of the quantity with the index ``slot`` (`bounded`) at a point."""
        self.ub = self.ub.copy()
        self.ub[slot, point] = max(min(self.ub[slot, point], value), 0.0)

    def without(self, what: list[Any], excluded: npt.NDArray[np.bool_]) -> list[StatusRegion]:
        """Return the region without some statuses, as a list of one region.

        Args:
            what: pairs of a point and a status to be excluded.
            excluded: mask of the statuses whose exclusion is proved, shape (m, 7) for m points.

        Raises:
            InvalidCertificate: if the exclusion of a status is not proved.
        """
        allowed = self.allowed.copy()
        for point, status in what:
            if not excluded[_index(point, len(excluded)), _index(status, 7)]:
                raise InvalidCertificate("an exclusion is not proved")
            allowed[point] &= ~(1 << status)
        return [self.held(allowed)]

    def branched(self, step: dict[str, Any]) -> list[StatusRegion]:
        """Return the parts into which a ``branch`` step divides the region, the last part first.

        Raises:
            InvalidCertificate: if the parts do not cover all remaining statuses of the point.
        """
        point = _index(step["point"], len(self.allowed))
        whole = int(self.allowed[point])
        if int(np.bitwise_or.reduce([0, *step["parts"]])) & whole != whole:
            raise InvalidCertificate("a branch leaves statuses out")
        parts = []
        for mask in reversed(step["parts"]):
            allowed = self.allowed.copy()
            allowed[point] = mask & whole
            parts.append(self.held(allowed))
        return parts

    def opened(self, _: dict[str, Any]) -> Masks:
        """Return the allowed statuses, about which nothing is proved, as bit masks, shape (m,)."""
        return self.allowed

    def only(self, step: dict[str, Any]) -> PieceSolution:
        """Return the only possible solution in an ``only`` step, after proving this.

        The inequalities of the law are not checked, so that it need not be a solution itself.

        Raises:
            InvalidCertificate: if uniqueness is not proved.
        """
        codes = _codes(self.problem, step)
        piece = solve_piece(self.problem, codes)
        d = None if piece is None else differences(piece, self.allowed, self.ub)
        weights, theta = (np.array(step[k], dtype=float) for k in ("weights", "theta"))
        fits = d is not None and weights.shape == theta.shape == d.unknown.shape
        if piece is None or d is None or not fits:
            raise InvalidCertificate("a uniqueness is not proved")
        if not d.prove(weights, theta, float(step["mu"])):
            raise InvalidCertificate("a uniqueness is not proved")
        return piece


@dataclass(frozen=True, eq=False)
class OpenCells:
    """Cells in 3D about which nothing is proved.

    Attributes:
        cells: cells of all points.
        most: scaled bounds of the quantities of `bounded_in_space` in the cells, shape (MOST, m).
        why: reason why nothing is proved, human-readable.
    """

    cells: Cells
    most: Array
    why: str

    @property
    def statuses(self) -> Masks:
        """Remaining statuses of the m points as bit masks, shape (m,).

        Status 2 denotes slip, or contact of a point without Coulomb friction.
        """
        masks = np.zeros(self.most.shape[1], dtype=np.int64)
        np.bitwise_or.at(masks, self.cells.node, np.array([1, 2, 4, 4])[self.cells.kind])
        return masks


@dataclass(eq=False)
class SpaceRegion(_Region):
    """Region of the search in 3D: cells of the points, and bounds of the solutions in them.

    Attributes:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        cells: remaining cells, at least one at every point.
        most: upper bounds of the quantities of `bounded_in_space`, shape (MOST, m).
    """

    problem: ReducedProblem
    cells: Cells
    most: Array

    QUANTITY = ("quantity", MOST)

    @classmethod
    def whole(cls, problem: ReducedProblem) -> SpaceRegion:
        """Return the region with all cells, and the bounds of `bounded_in_space`."""
        return cls(problem, Cells.whole(problem), bounded_in_space(problem))

    def part(self, keep: npt.NDArray[np.bool_]) -> SpaceRegion:
        """Return the region restricted to the cells selected by a mask, shape (k,)."""
        return SpaceRegion(self.problem, self.cells.kept(keep), self.most)

    @property
    def kinds(self) -> list[frozenset[int]]:
        """Kinds of the remaining cells of every point."""
        return [self.cells.kinds_at(i) for i in range(self.problem.points)]

    def dual(self, y: Array) -> SpaceDual:
        return SpaceDual(self.problem, y)

    @property
    def limits(self) -> tuple[Cells, Array]:
        return self.cells, self.most

    def empties(self, excluded: npt.NDArray[np.bool_]) -> bool:
        """Return whether a mask, shape (k,), excludes all cells of some point."""
        return bool(np.logical_and.reduceat(excluded, self.cells.first).any())

    def limit(self, quantity: int, point: int, value: float) -> None:
        """Lower the bound of a quantity of `bounded_in_space` at a point to ``value``."""
        self.most = self.most.copy()
        self.most[quantity, point] = min(self.most[quantity, point], value)

    def without(self, what: list[Any], excluded: npt.NDArray[np.bool_]) -> list[SpaceRegion]:
        """Return the region without some cells, as a list of one region.

        The list is empty if no cell of a point remains.

        Args:
            what: indices of the cells to be excluded.
            excluded: mask of the k cells whose exclusion is proved, shape (k,).

        Raises:
            InvalidCertificate: if the exclusion of a cell is not proved.
        """
        keep = np.ones(len(self.cells), dtype=bool)
        for number in what:
            if not excluded[_index(number, len(excluded))]:
                raise InvalidCertificate("an exclusion is not proved")
            keep[number] = False
        left = self.part(keep)
        return [left] if len(left.cells.first) == self.problem.points else []

    def branched(self, step: dict[str, Any]) -> list[SpaceRegion]:
        """Return the parts into which a ``branch`` step divides the region, the last part first.

        Raises:
            InvalidCertificate: if the parts miss a cell of the point, or a part has no cell.
        """
        here = self.cells.node == _index(step["point"], self.problem.points)
        left = here.copy()
        parts = []
        for numbers in reversed(step["parts"]):
            keep = ~here
            for number in numbers:
                keep[_index(number, len(self.cells))] = True
                left[number] = False
            if not (keep & here).any():
                raise InvalidCertificate("a part of a branch has no cell")
            parts.append(self.part(keep))
        if left.any():
            raise InvalidCertificate("a branch leaves cells out")
        return parts

    def opened(self, step: dict[str, Any]) -> OpenCells:
        """Return the remaining cells and the reason why nothing is proved about them."""
        return OpenCells(self.cells, self.most, str(step["why"]))

    def only(self, step: dict[str, Any]) -> SpacePiece:
        """Return the only possible solution in an ``only`` or ``leaf`` step, after proving this.

        The inequalities of the law are not checked, so that it need not be a solution itself.

        Raises:
            InvalidCertificate: if uniqueness is not proved.
        """
        problem = self.problem
        codes, z = _codes(problem, step), np.array(step["z"], dtype=np.float64)
        if z.shape != (problem.points, 3):
            raise InvalidCertificate("statuses do not fit")
        piece = solve_in_space(problem, codes, z)
        if piece is None:
            raise InvalidCertificate("no solution of a piece is proved")
        if step["do"] == "leaf":
            closed = np.where(problem.friction > 0, IN_SLIP, IN_CLOSED)
            kinds = np.where(codes == 2, closed, np.where(codes == 1, IN_STICK, IN_OPEN))
            if (self.cells.kind != kinds[self.cells.node]).any():
                raise InvalidCertificate("statuses are not those of the cells")
            sure = only_one(piece, self.cells, self.most)
        else:
            d = space_differences(piece, self.cells, self.most)
            weights = np.array(step["weights"], dtype=np.float64)
            fits = d is not None and weights.shape == d.has.shape
            sure = d is not None and fits and d.prove(weights, float(step["mu"]))
        if not sure:
            raise InvalidCertificate("a uniqueness is not proved")
        return piece


ProofRegion: TypeAlias = StatusRegion | SpaceRegion


def whole_region(problem: ReducedProblem) -> ProofRegion:
    """Return the root of the search tree: all statuses (in 3D, cells) and the energy bounds.

    Args:
        problem: reduced problem scaled by `ReducedProblem.scaled`.
    """
    return (SpaceRegion if problem.dim == 3 else StatusRegion).whole(problem)


def check(certificate: Certificate) -> Proved:
    """Check all steps of a proof and return the proved statements.

    Args:
        certificate: proof to be checked.

    Raises:
        InvalidCertificate: if a step does not prove its statement, cannot be read, or is missing.
    """
    proved = Proved()
    try:
        waiting = [whole_region(certificate.problem.scaled)]
        # Overflow yields inf or nan, for which the comparisons of a proof fail; no warnings needed.
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
    certificate: Certificate, step: dict[str, Any], region: ProofRegion, proved: Proved
) -> Sequence[ProofRegion]:
    """Check one step of a proof.

    Args:
        certificate: proof containing the step.
        step: step of the proof.
        region: region on which the step acts; changed by the step ``bound``.
        proved: container to which the proved statements are added.

    Returns:
        Remaining parts of the region, last part first.

    Raises:
        InvalidCertificate: if the step does not prove its statement.
    """
    kind = step["do"]
    if kind == "branch":
        return region.branched(step)
    if kind == "open":
        proved.open_regions.append(region.opened(step))
        return []
    if kind == "rest":
        # Without a load, a.S a <= p.a implies a = 0.
        if certificate.problem.p.any() or certificate.problem.dp.any():
            raise InvalidCertificate("there is a load")
        proved.at_rest = True
        return []
    if kind == "only" or (kind == "leaf" and isinstance(region, SpaceRegion)):
        proved.add(region.only(step))
        return []
    if kind == "pieces" and isinstance(region, StatusRegion):
        _all_pieces(certificate, step["singular"], region, proved)
        return []
    if kind == "halve" and isinstance(region, SpaceRegion):
        cells = region.cells.halved(_index(step["point"], region.problem.points))
        return [SpaceRegion(region.problem, cells, region.most)]
    if kind not in ("bound", "empty", "exclude"):
        raise InvalidCertificate(f"there is no step {kind!r}")
    y = certificate.vectors[_index(step["y"], len(certificate.vectors))]
    if y.shape != region.problem.p.shape or not np.isfinite(y).all():
        raise InvalidCertificate("a vector of multipliers does not fit")
    if kind == "bound":
        dual: Any = region.dual(y)
        name, size = region.QUANTITY
        quantity = _index(step[name], size)
        point = _index(step["point"], region.problem.points)
        bound = dual.most(*region.limits, quantity, point)
        region.limit(quantity, point, _proved_bound(step, bound, dual.round_off(region.limits[1])))
        return [region]
    excluded = region.excluded(y)
    if kind == "exclude":
        return region.without(step["what"], excluded)
    if not region.empties(excluded):
        raise InvalidCertificate("a region is not proved empty")
    return []


def _all_pieces(
    certificate: Certificate, singular: list[Any], region: StatusRegion, proved: Proved
) -> None:
    """Solve the equations of a region for every choice of one allowed status per point.

    This checks a ``pieces`` step. ``singular`` contains pairs of a choice with singular equations
    and the index of the vector of multipliers proving that they have no solution.
    """
    if region.pieces > MOST_PIECES:
        raise InvalidCertificate("a leaf has too many pieces")
    vectors = {tuple(codes): number for codes, number in singular}
    for choice in itertools.product(*region.choices):
        codes = np.array(choice, dtype=np.int8)
        piece = solve_piece(region.problem, codes)
        if piece is not None:
            proved.add(piece)
            continue
        number = vectors.get(choice)
        if number is not None:
            y = certificate.vectors[_index(number, len(certificate.vectors))]
            if region.held(1 << codes.astype(np.int64)).excluded(y).any():
                continue
        proved.singular.append(codes)


def _codes(problem: ReducedProblem, step: dict[str, Any]) -> Codes:
    """Return the statuses in a step, shape (m,), after checking that the law admits them."""
    codes = step["codes"]
    if len(codes) != problem.points:
        raise InvalidCertificate("statuses do not fit")
    if not all(
        int(mask) >> _index(s, 7) & 1 for mask, s in zip(problem.statuses, codes, strict=True)
    ):
        raise InvalidCertificate("a point cannot have this status")
    return np.array(codes, dtype=np.int8)


def _proved_bound(step: dict[str, Any], bound: float, round_off: float) -> float:
    """Return the upper bound that a ``bound`` step of a proof proves.

    Sums are rounded differently on different processors. The bound stored in the step may therefore
    be smaller than the bound proved on this machine, by at most the error bound that both include.
    The larger of the two is valid on either machine.

    Args:
        step: step of the proof.
        bound: upper bound proved by the multipliers of the step.
        round_off: error bound included in ``bound``.

    Raises:
        InvalidCertificate: if ``bound`` exceeds the stored bound by more than ``round_off``.
    """
    value = step["value"]
    if not bound <= value + round_off:
        raise InvalidCertificate("a bound is not proved")
    return max(bound, float(value))


def _index(value: Any, size: int) -> int:
    if not isinstance(value, int) or not 0 <= value < size:
        raise InvalidCertificate(f"there is no number {value!r}")
    return value


# -- the command -----------------------------------------------------------------------------------

#: Letters of the statuses: open, stick, slips, and stick and slips of open points with a prescribed
#: friction bound; in the plane, in space, and for points without friction (open, closed).
_WITH = "ok+-KPM"
_IN_SPACE = "oks-KS-"
_WITHOUT = "o-c----"
_STATEMENT = {
    "complete": "they are all there are",
    "degenerate": "every other one is at a border, or in a singular piece, of these",
    "open": "whether there are others is not decided",
}


def _letters(problem: ReducedProblem, codes: Codes) -> str:
    free = (problem.friction == 0) & (problem.g == 0)
    both = zip(codes, free, strict=True)
    known = _WITH if problem.dim == 2 else _IN_SPACE
    return "".join((_WITHOUT if without else known)[int(code)] for code, without in both)


def _forces(piece: PieceSolution | SpacePiece) -> list[tuple[str, Ball]]:
    """Return the names and values of the forces that can be summed over the points.

    In 3D only normal forces are included, because the tangential axes differ from point to point.
    """
    if isinstance(piece, SpacePiece):
        return [("rn", piece.numbers[:, 5])]
    return [("rt", piece.rt), ("rn", piece.rn)]


def _sum_of(forces: Ball, unit: float) -> str:
    """Return the sum of forces, times ``unit``, and its error bound as text.

    The error bound includes the rounding to 12 digits.
    """
    total = np.ones(len(forces.value)) @ forces
    value = unit * float(total.value)
    shown = f"{value:.12g}"
    off = unit * float(total.radius) + abs(float(shown) - value) * (1 + _SLACK)
    off += 3 * _U * abs(value)  # rounding of the unit and of its product with the sum
    # Rounding the error bound to three digits changes it by at most 0.5 %.
    return f"{shown} +- {1.006 * above(off):.3g}"


def report(certificate: Certificate, proved: Proved) -> list[str]:
    """Return the proved statements and the data of the problem, as lines of text."""
    problem = certificate.problem
    force = problem.units[1] * certificate.force_unit
    S, p = (float(np.abs(v).max()) for v in (problem.S, problem.p))
    lines = [
        f"data: {problem.points} contact points{' in 3D' if problem.dim == 3 else ''};"
        " SHA-256 of S, p, F, g and the errors of S and p:",
        f"  {problem.digest}",
        f"  the errors are at most {problem.dS.max():.3g} (S up to {S:.6g}) and"
        f" {problem.dp.max():.3g} (p up to {p:.6g})",
        f"proof: {len(certificate.steps)} steps, {len(certificate.vectors)} vectors; SHA-256:",
        f"  {certificate.digest}",
    ]
    if certificate.force_unit != 1.0:
        unit = f"{certificate.force_unit:.6g}"
        lines.append(f"forces below are in the units of the input: those of p, times {unit}")
    number = len(proved.inside) + int(proved.at_rest)
    many = _number(number, "solution")
    lines.append(f"for all S and p within these errors there are {many} as follows, and")
    lines.append(f"{_STATEMENT[proved.verdict]}:")
    if proved.at_rest:
        lines.append("  rest, without forces")
    for piece in proved.inside:
        sums = ", ".join(f"sum {name} = {_sum_of(v, force)}" for name, v in _forces(piece))
        lines.append(f"  {_letters(problem, piece.codes)}  {sums}")
    lines += [f"border: {_letters(problem, q.codes)}" for q in proved.border]
    lines += [f"singular: {_letters(problem, codes)}" for codes in proved.singular]
    if proved.open_regions:
        lines.append(f"not decided: {len(proved.open_regions)} sets of statuses")
        reasons = {r.why for r in proved.open_regions if isinstance(r, OpenCells)}
        lines += [f"  {why}" for why in sorted(reasons)]
    lines.append("that these numbers are those of a body, mesh and load is not part of the proof")
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Check a stored proof and print its statements (command line).

    Args:
        argv: command-line arguments; by default the arguments of the process.

    Returns:
        Exit status: 0 if the proof holds, 1 if it does not hold or leaves regions open, 2 if the
        file is missing or cannot be read.
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
