# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Weights for which a weighted sum of quadratic inequalities is positive definite.

The inequalities compare two solutions (`Differences` and `SpaceDifferences` in `check_proof`).
After elimination of the vanishing rows and scaling to a unit diagonal, the smallest eigenvalue of
the sum is maximised over the logarithms of the weights, in 2D also over the multiples theta of a
second row added to each row. The objective is the soft minimum -tau log sum exp(-lambda / tau) of
the eigenvalues lambda, with tau > 0, which is differentiable. The checker verifies the weights.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact.proofs.check_proof import FAMILIES, Differences, SpaceDifferences

__all__ = ["Weights", "find_weights", "maximise"]

#: Function of the variables: eigenvalues (n,), eigenvectors (n, n), and a function returning the
#: gradient of a weighted sum of the eigenvalues.
Eigenvalues = Callable[[Array], tuple[Array, Array, Callable[[Array], Array]]]

#: tau of each search, and the least eigenvalue below which no further search follows.
_IN_PLANE = ((0.05, -0.06), (0.01, -0.02), (0.003, 0.0))
_IN_SPACE = ((0.1, -np.inf), (0.02, -np.inf), (0.005, -np.inf))
_MUS = 10.0 ** np.array([1, 2, 3, 4, 5, 6, 0])
#: Initial logarithms of the weights in 3D, and whether they refer to forms scaled to norm 1.
_FIRST = {"T": (0, False), "N": (0, False), "H": (-6, False), "P": (-1, False)}
_FIRST |= {"A": (-4, True), "Q": (-4, True)}


class _Stop(Exception):
    """Exception that ends a search for weights: it has succeeded, or the time limit is reached."""


def maximise(
    eigenvalues: Eigenvalues,
    x: Array,
    *,
    limits: Sequence[tuple[float, float]],
    stages: Sequence[tuple[float, float]],
    effort: int,
    enough: float,
    until: float = np.inf,
) -> tuple[float, Array, Array]:
    """Maximise the smallest eigenvalue by L-BFGS-B on the soft minimum of all eigenvalues.

    The soft minimum -tau log sum exp(-lambda / tau) tends to the smallest lambda for small tau.

    Args:
        eigenvalues: function of the variables (`Eigenvalues`).
        x: initial values of the k variables, shape (k,).
        limits: lower and upper bounds of the variables.
        stages: tau of each stage, and the smallest eigenvalue below which later stages are skipped.
        effort: largest number of iterations of each stage.
        enough: smallest eigenvalue above which the search ends.
        until: value of `time.monotonic` at which the search ends.

    Returns:
        Largest value found of the smallest eigenvalue; its variables, shape (k,); its eigenvector,
        shape (n,).
    """
    best: tuple[float, Array, Array] = (-np.inf, x, np.zeros(0))

    def value(x: Array, tau: float) -> tuple[float, Array]:
        nonlocal best
        if time.monotonic() > until:
            raise _Stop
        values, vectors, gradient = eigenvalues(x)
        if values[0] > best[0]:
            best = (float(values[0]), x.copy(), vectors[:, 0])
        if values[0] > enough:
            raise _Stop
        part = np.exp(-(values - values[0]) / tau)
        total = part.sum()
        return float(tau * np.log(total) - values[0]), -gradient(part / total)

    options = {"maxiter": effort}
    try:
        for tau, stop in stages:
            x = minimize(
                value, x, (tau,), jac=True, method="L-BFGS-B", bounds=limits, options=options
            ).x
            if best[0] < stop:
                break
    except _Stop:
        pass
    return best


@dataclass(frozen=True, eq=False)
class Weights:
    """Result of a search for weights of quadratic inequalities.

    Attributes:
        proof: weights, theta (in 2D) and weight mu of the equations for an ``only`` step of a
            proof; None if none were found.
        least: smallest eigenvalue of the scaled weighted sum.
        bad: in 2D, contribution of each point to the eigenvector of `least`, shape (m,).
    """

    proof: dict[str, Any] | None
    least: float
    bad: Array


def find_weights(
    d: Differences | SpaceDifferences, *, effort: int, until: float = np.inf
) -> Weights:
    """Search for weights of quadratic inequalities that prove uniqueness.

    Args:
        d: inequalities for the difference of two solutions.
        effort: largest number of iterations of each of three stages.
        until: value of `time.monotonic` at which the search in 3D ends.
    """
    return _in_plane(d, effort) if isinstance(d, Differences) else _in_space(d, effort, until)


def _in_plane(d: Differences, effort: int) -> Weights:
    n = len(d.unknown)
    free = ~d.equal
    problem = d.piece.problem
    bad = np.zeros(problem.points)
    weights, theta, least = np.ones(n), np.zeros(n), -np.inf
    if free.any():
        A, B = d.R[np.ix_(free, free)], d.T[np.ix_(free, free)]
        if d.equal.any():
            E = d.R[np.ix_(d.equal, d.equal)]
            if np.linalg.cond(E) > 1e10:
                return Weights(None, -np.inf, bad)
            out = np.linalg.solve(E, d.R[np.ix_(d.equal, free)])
            A = A - d.R[np.ix_(free, d.equal)] @ out
            B = B - d.T[np.ix_(free, d.equal)] @ out
        points = d.unknown[free] // 2
        form = _PlaneForm(A, B, d.k1[free], d.k2[free], d.tilted[free], problem.friction[points])
        if form.impossible.any():
            np.add.at(bad, points[form.impossible], 1.0)
            return Weights(None, -np.inf, bad)
        number = form.n + len(form.tilted)
        least, x, vector = maximise(
            form.eigenvalues,
            np.zeros(number),
            limits=[(-14.0, 14.0)] * form.n + [(-1.0, 1.0)] * len(form.tilted),
            stages=_IN_PLANE,
            effort=effort,
            enough=1e-7,
        )
        np.add.at(bad, points, vector**2)
        # The scaled inequalities are the original ones times the squares of the scales.
        weights[free] = np.exp(x[: form.n])
        tilted = np.flatnonzero(free)[form.tilted]
        theta[tilted] = (1 - 1e-12) * x[form.n :] / form.F
        if not least > 0:
            return Weights(None, least, bad)
    scale = float(weights.max(initial=0.0)) or 1.0
    for mu in scale * _MUS if d.equal.any() else [0.0]:
        if d.prove(weights, theta, float(mu)):
            proof = {"weights": weights.tolist(), "theta": theta.tolist(), "mu": float(mu)}
            return Weights(proof, least, bad)
    return Weights(None, least, bad)


class _PlaneForm:
    """Scaled quadratic form in 2D as a function of the logarithms of the weights and F theta.

    Args:
        A, B: rows, and tilts added theta times (`Differences`), of n components, shape (n, n) each.
        k1, k2: coefficients of the squares (`Differences`), shape (n,) each.
        tilted: mask of the rows with a theta, shape (n,).
        friction: friction coefficient F at the point of each row, shape (n,).
    """

    def __init__(
        self,
        A: Array,
        B: Array,
        k1: Array,
        k2: Array,
        tilted: Mask,
        friction: Array,
    ):
        diagonal = np.diag(A) + k1 + k2 * np.diag(A) ** 2
        self.impossible = diagonal <= 0
        s = 1 / np.sqrt(np.where(self.impossible, 1.0, diagonal))
        self.A = s[:, None] * A * s
        self.c1 = k1 * s * s
        self.c2 = k2 / (s * s)
        B = s[:, None] * B * s
        # A theta that has no effect is not a variable.
        self.tilted = np.flatnonzero(tilted & np.any(B != 0, axis=1))
        self.B = B[self.tilted]
        self.F = friction[self.tilted]
        self.n = len(A)

    def eigenvalues(self, x: Array) -> tuple[Array, Array, Callable[[Array], Array]]:
        """Return eigenvalues, eigenvectors and gradients (`Eigenvalues`) at the variables x."""
        n, tilted = self.n, self.tilted
        alpha, omega = np.exp(x[:n]), x[n:]
        keeps = np.ones(n)
        keeps[tilted] -= np.abs(omega)
        Q = self.A.copy()
        Q[tilted] += (omega / self.F)[:, None] * self.B
        X = alpha[:, None] * Q
        X = 0.5 * (X + X.T) + np.diag(alpha * self.c1 * keeps)
        if self.c2.any():
            X += self.A.T @ ((alpha * self.c2 * keeps)[:, None] * self.A)
        r = 1 / np.sqrt(alpha)
        values, V = np.linalg.eigh(X * r[:, None] * r)

        def gradient(part: Array) -> Array:
            Y = V * r[:, None]
            AY = self.A @ Y
            QY = Q @ Y if len(tilted) else AY
            squares = self.c1[:, None] * Y**2 + self.c2[:, None] * AY**2
            by_alpha = (part * (Y * QY + keeps[:, None] * squares)).sum(axis=1)
            by_alpha = alpha * (by_alpha - ((part * values) * Y**2).sum(axis=1))
            tilt = Y[tilted] * (self.B @ Y) / self.F[:, None]
            tilt -= np.sign(omega)[:, None] * squares[tilted]
            return np.concatenate([by_alpha, (part * tilt).sum(axis=1) * alpha[tilted]])

        return values, V, gradient


def _in_space(d: SpaceDifferences, effort: int, until: float) -> Weights:
    bad = np.zeros(0)
    rows = _free_rows(d)
    family, point = np.nonzero(d.has)
    if rows is None or (rows.shape[2] and not len(family)):
        return Weights(None, -np.inf, bad)
    forms = d.forms[family, point]
    size = np.abs(rows).max(axis=2, initial=0.0)[point]
    norms = (np.abs(forms) * size[:, :, None] * size[:, None, :]).max(axis=(1, 2), initial=0.0)
    norms = np.where(norms > 0, norms, 1.0)
    first, scaled = (
        np.array([_FIRST[FAMILIES[f]][k] for f in family], dtype=float) for k in (0, 1)
    )
    x = first + np.where(scaled > 0, 0.0, np.log(norms))
    least = -np.inf
    if rows.shape[2]:
        least, x, _ = maximise(
            _space_form(rows, forms, norms, point),
            x,
            limits=[(-25.0, 20.0)] * len(x),
            stages=_IN_SPACE,
            effort=effort,
            enough=1e-6,
            until=until,
        )
        if not least > 1e-6:
            return Weights(None, least, bad)
    weights = np.zeros(d.has.shape)
    weights[family, point] = np.exp(x) / norms
    scale = float(weights.max(initial=0.0)) or 1.0
    for mu in scale * _MUS if d.vanishing.any() else [0.0]:
        if d.prove(weights, float(mu)):
            return Weights({"weights": weights.tolist(), "mu": float(mu)}, least, bad)
    return Weights(None, least, bad)


def _free_rows(d: SpaceDifferences) -> Array | None:
    """Return matrices mapping the free components of d to (d, S d) by point, shape (m, 6, n).

    None if the block of the stiffness matrix S for the eliminated components is singular.
    """
    gone = d.vanishing[d.unknown]
    rows = d.rows
    if not gone.any():
        return rows
    v, k = d.unknown[gone], d.unknown[~gone]
    S = d.problem.S
    try:
        out = -np.linalg.solve(S[np.ix_(v, v)], S[np.ix_(v, k)])
    except np.linalg.LinAlgError:
        return None
    return rows[:, :, ~gone] + rows[:, :, gone] @ out


def _space_form(rows: Array, forms: Array, norms: Array, point: Ints) -> Eigenvalues:
    """Return the scaled quadratic form in 3D as a function of the logarithms of the weights.

    Args:
        rows: matrices mapping n free components to (d, e) (`SpaceDifferences`), shape (m, 6, n).
        forms: quadratic forms of (d, e) at single points, shape (k, 6, 6).
        norms: norms by which the weights of the forms are divided, shape (k,).
        point: index of the point of each form, shape (k,).
    """
    n = rows.shape[2]
    flat = rows.reshape(-1, n)

    def eigenvalues(x: Array) -> tuple[Array, Array, Callable[[Array], Array]]:
        w = np.exp(x) / norms
        W = np.zeros((len(rows), 6, 6))
        np.add.at(W, point, w[:, None, None] * forms)
        M = flat.T @ (W @ rows).reshape(-1, n)
        diagonal = np.diag(M).copy()
        positive = diagonal > 0
        if not positive.all():
            diagonal = np.maximum(diagonal, 1e-3 * float(np.abs(M).max()) + 1e-300)
        q = 1 / np.sqrt(diagonal)
        values, V = np.linalg.eigh(q[:, None] * M * q)

        def gradient(part: Array) -> Array:
            Y = q[:, None] * V
            A = (Y * part) @ Y.T
            A[np.arange(n), np.arange(n)] -= np.where(positive, (Y**2) @ (part * values), 0.0)
            inner = rows @ A @ rows.transpose(0, 2, 1)
            return np.einsum("kab,kab->k", forms, inner[point]) * w

        return values, V, gradient

    return eigenvalues
