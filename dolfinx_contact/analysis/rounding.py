# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What can be said for certain with numbers that are rounded.

With the unit round-off u = 2^-53 and gamma_n = n u / (1 - n u), a product of matrices over n terms
is off by at most gamma_n |A| |B|, in whatever order it is summed (Higham, Accuracy and Stability of
Numerical Algorithms, section 3.5). Bounds are sums of nonnegative numbers; rounded, these are too
small by less than 2^-30 of themselves as long as fewer than 10^6 operations lie behind them, which
`up` makes good. Numbers are expected to be scaled: what underflows is below `TINY`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["TINY", "down", "gamma", "least_eigenvalue", "positive_definite", "solved", "up"]

Array = npt.NDArray[np.float64]

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
    n, d = len(Q), np.diag(Q)
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
    z, size = C @ b, np.abs(C)
    z = z + C @ (b - A @ z)
    products = size @ (gamma(n) * np.abs(A) + A_error)
    G = up(np.abs(np.eye(n) - C @ A) + products + gamma(n) * np.eye(n))
    norm = float(up(G.sum(axis=1)).max())
    if not norm < 0.5:
        return None
    residual = np.abs(b - A @ z) + gamma(n) * (np.abs(b) + np.abs(A) @ np.abs(z))
    v = up(size @ (residual + A_error @ np.abs(z) + b_error))
    return z, up(v + G.sum(axis=1) * (v.max() / (1 - norm)))
