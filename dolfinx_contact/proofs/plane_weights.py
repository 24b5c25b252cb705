# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Weights of the inequalities of differences that make their sum positive definite.

With the rows f = 0 eliminated and the form scaled to a unit diagonal, the least eigenvalue of the
weighted sum is maximised over the logarithms of the weights, and over theta; of several small
eigenvalues the soft minimum -tau log sum exp(-lambda / tau), whose derivatives are those of the
eigenvalues. Nothing is proved here (`check_proof.Differences`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from dolfinx_contact.proofs.check_proof import Differences

__all__ = ["Weights", "find_weights"]

Array = npt.NDArray[np.float64]

_ENOUGH = 1e-7  # least eigenvalue, relative to a unit diagonal, at which the search ends
_SPREAD = 14.0  # of the logarithms of the weights


@dataclass(frozen=True)
class Weights:
    """Weights and theta of the rows (n,), mu, and what they achieve.

    Attributes:
        weights, theta, mu: of `Differences.prove`.
        proves: whether that succeeds with them.
        least: the least eigenvalue, scaled.
        bad: weights of the points in its eigenvector (m,).
    """

    weights: Array
    theta: Array
    mu: float
    proves: bool
    least: float
    bad: Array


class _Found(Exception):
    """The search has come to its end."""


def find_weights(d: Differences, *, effort: int = 80) -> Weights:
    """Weights for a proof, or the best that were found.

    Args:
        d: the inequalities.
        effort: iterations of each of three searches with smaller and smaller tau.
    """
    n = len(d.unknown)
    free = ~d.equal
    points = d.piece.problem.points
    none = Weights(np.ones(n), np.zeros(n), 0.0, False, -np.inf, np.zeros(points))
    if not free.any():
        return _with_mu(d, none)
    A = d.R[np.ix_(free, free)]
    B = d.T[np.ix_(free, free)]
    if d.equal.any():
        E = d.R[np.ix_(d.equal, d.equal)]
        if np.linalg.cond(E) > 1e10:
            return none
        out = np.linalg.solve(E, d.R[np.ix_(d.equal, free)])
        A = A - d.R[np.ix_(free, d.equal)] @ out
        B = B - d.T[np.ix_(free, d.equal)] @ out
    search = _Search(d, A, B, free)
    if search.impossible.any():
        np.add.at(none.bad, d.unknown[free][search.impossible] // 2, 1.0)
        return none
    weights, theta, least, vector = search.run(effort)
    bad = np.zeros(points)
    np.add.at(bad, d.unknown[free] // 2, vector**2)
    whole = np.ones(n)
    tilt = np.zeros(n)
    whole[free] = weights
    tilt[free] = theta
    best = Weights(whole, tilt, 0.0, False, least, bad)
    return _with_mu(d, best) if least > 0 else best


def _with_mu(d: Differences, w: Weights) -> Weights:
    """With the first mu, large enough for the rows f = 0, that makes a proof."""
    scale = float(np.max(w.weights))
    for mu in scale * 10.0 ** np.array([1, 2, 3, 4, 5, 6, 0]) if d.equal.any() else [0.0]:
        if d.prove(w.weights, w.theta, float(mu)):
            return Weights(w.weights, w.theta, float(mu), True, w.least, w.bad)
    return w


class _Search:
    """The least eigenvalue as a function of log weights and F theta."""

    def __init__(self, d: Differences, A: Array, B: Array, free: npt.NDArray[np.bool_]):
        k1 = d.k1[free]
        k2 = d.k2[free]
        diagonal = np.diag(A) + k1 + k2 * np.diag(A) ** 2
        self.impossible = diagonal <= 0
        s = 1 / np.sqrt(np.where(self.impossible, 1.0, diagonal))
        self.A = s[:, None] * A * s
        self.c1 = k1 * s * s
        self.c2 = k2 / (s * s)
        # theta counts where it does something.
        B = s[:, None] * B * s
        self.tilted = np.flatnonzero(d.tilted[free] & np.any(B != 0, axis=1))
        self.B = B[self.tilted]
        self.F = d.piece.problem.friction[d.unknown[free] // 2]
        self.n = len(A)
        self.s = s
        nothing = np.zeros(self.n + len(self.tilted))
        self.best: tuple[float, Array, Array] = (-np.inf, nothing, np.zeros(self.n))
        self.tau = 0.1

    def run(self, effort: int) -> tuple[Array, Array, float, Array]:
        """Weights, theta, the least eigenvalue and its eigenvector."""
        n = self.n
        x: Array = np.zeros(n + len(self.tilted))
        limits = [(-_SPREAD, _SPREAD)] * n + [(-1.0, 1.0)] * len(self.tilted)
        try:
            self._value(x)  # most often enough
            for self.tau, stop in ((0.05, -0.06), (0.01, -0.02), (0.003, 0.0)):
                x = minimize(
                    self._value,
                    x,
                    jac=True,
                    method="L-BFGS-B",
                    bounds=limits,
                    options={"maxiter": effort},
                ).x
                if self.best[0] < stop:
                    break
        except _Found:
            pass
        least, x, vector = self.best
        theta = np.zeros(n)
        theta[self.tilted] = x[n:] / self.F[self.tilted]
        # The scaled inequalities are s_v^2 times the others.
        return np.exp(x[:n]), (1 - 1e-12) * theta, least, vector

    def _value(self, x: Array) -> tuple[float, Array]:
        n = self.n
        tilted = self.tilted
        alpha = np.exp(x[:n])
        omega = x[n:]
        keeps = np.ones(n)
        keeps[tilted] -= np.abs(omega)
        Q = self.A.copy()
        Q[tilted] += (omega / self.F[tilted])[:, None] * self.B
        X = alpha[:, None] * Q
        X = 0.5 * (X + X.T) + np.diag(alpha * self.c1 * keeps)
        if self.c2.any():
            X += self.A.T @ ((alpha * self.c2 * keeps)[:, None] * self.A)
        r = 1 / np.sqrt(alpha)
        X = X * r[:, None] * r
        values, V = np.linalg.eigh(X)
        if values[0] > self.best[0]:
            self.best = (float(values[0]), x.copy(), V[:, 0])
        if values[0] > _ENOUGH:
            raise _Found
        e = np.exp(-(values - values[0]) / self.tau)
        Z = e.sum()
        part = e / Z
        Y = V * r[:, None]
        AY = self.A @ Y
        QY = Q @ Y if len(tilted) else AY
        squares = self.c1[:, None] * Y**2 + self.c2[:, None] * AY**2
        by_alpha = (part * (Y * QY + keeps[:, None] * squares)).sum(axis=1)
        by_alpha = alpha * (by_alpha - ((part * values) * Y**2).sum(axis=1))
        F = self.F[tilted, None]
        tilt = Y[tilted] * (self.B @ Y) / F - np.sign(omega)[:, None] * squares[tilted]
        by_omega = (part * tilt).sum(axis=1) * alpha[tilted]
        value = -(values[0] - self.tau * np.log(Z))
        return float(value), -np.concatenate([by_alpha, by_omega])
