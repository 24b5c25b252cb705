# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Weights of the quadratic inequalities in space that make their sum positive definite.

As in the plane (`proofs.plane_weights`): with what vanishes eliminated and the form scaled to a
unit diagonal, its least eigenvalue is maximised over the logarithms of the weights, by the soft
minimum -tau log sum exp(-lambda / tau). The forms act on (d, e) of a point, six numbers, so that
neither the sum nor its derivatives take more than products of matrices. Nothing is proved here
(`check_proof.SpaceDifferences`).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from dolfinx_contact.proofs.check_proof import FAMILIES, SpaceDifferences

__all__ = ["SpaceWeights", "find_space_weights"]

Array = npt.NDArray[np.float64]

_ENOUGH = 1e-6  # least eigenvalue, relative to a unit diagonal, at which a search ends
_LIMITS = (-25.0, 20.0)  # of the logarithms of the weights
_TAUS = 0.1, 0.02, 0.005
#: Logarithms to begin with, and whether they are those of weights of forms scaled to 1.
_FIRST = {"T": (0, False), "N": (0, False), "H": (-6, False), "P": (-1, False)}
_FIRST |= {"A": (-4, True), "Q": (-4, True)}


@dataclass(frozen=True, eq=False)
class SpaceWeights:
    """Weights and what they achieve.

    Attributes:
        weights, mu: of `SpaceDifferences.prove`.
        proves: whether that succeeds with them.
        least: the least eigenvalue, scaled.
    """

    weights: Array
    mu: float
    proves: bool
    least: float


class _Found(Exception):
    """The search has come to its end."""


def find_space_weights(
    d: SpaceDifferences, *, effort: int = 80, until: float = np.inf
) -> SpaceWeights:
    """Weights for a proof, or the best that were found.

    Args:
        d: the inequalities.
        effort: iterations of each of three searches with smaller and smaller tau.
        until: monotonic time at which to end.
    """
    zero = np.zeros(d.has.shape)
    none = SpaceWeights(zero, 0.0, False, -np.inf)
    search = _Search(d, until)
    if not search.possible:
        return none
    if search.rows.shape[2]:
        if not d.has.any():
            return none
        search.run(effort)
        if not search.best[0] > _ENOUGH:
            return SpaceWeights(zero, 0.0, False, search.best[0])
    weights = search.weights(search.best[1])
    scale = float(weights.max(initial=0.0)) or 1.0
    some = bool(d.vanishing.any())
    for mu in scale * 10.0 ** np.array([1, 2, 3, 4, 5, 6, 0]) if some else [0.0]:
        if d.prove(weights, float(mu)):
            return SpaceWeights(weights, float(mu), True, search.best[0])
    return SpaceWeights(weights, 0.0, False, search.best[0])


class _Search:
    """The least eigenvalue as a function of the logarithms of the weights that there are."""

    def __init__(self, d: SpaceDifferences, until: float):
        self.d = d
        self.until = until
        self.at = np.nonzero(d.has)
        self.possible = True
        self.rows = self._free_rows()
        self.forms = d.forms[self.at]
        norms = self._norms()
        first, scaled = (
            np.array([_FIRST[FAMILIES[f]][k] for f in self.at[0]], dtype=float) for k in (0, 1)
        )
        self.norms = np.where(norms > 0, norms, 1.0)
        self.x0 = first + np.where(scaled > 0, 0.0, np.log(self.norms))
        self.best: tuple[float, Array] = (-np.inf, self.x0)

    def _free_rows(self) -> Array:
        """The d and e of the points by components of d that are left when e vanishes (m, 6, n)."""
        d = self.d
        gone = d.vanishing[d.unknown]
        rows = d.rows
        if not gone.any():
            return rows
        v, k = d.unknown[gone], d.unknown[~gone]
        S = d.problem.S
        try:
            out = -np.linalg.solve(S[np.ix_(v, v)], S[np.ix_(v, k)])
        except np.linalg.LinAlgError:
            self.possible = False
            return rows[:, :, ~gone]
        return rows[:, :, ~gone] + rows[:, :, gone] @ out

    def _norms(self) -> Array:
        """About the largest entries of the forms."""
        size = np.abs(self.rows).max(axis=2, initial=0.0)[self.at[1]]
        found = np.abs(self.forms) * size[:, :, None] * size[:, None, :]
        return np.asarray(found.max(axis=(1, 2), initial=0.0))

    def weights(self, x: Array) -> Array:
        """All weights (9, m)."""
        found = np.zeros(self.d.has.shape)
        found[self.at] = np.exp(x) / self.norms
        return found

    def run(self, effort: int) -> None:
        """Maximise; `best` is what was found."""
        x = self.x0
        limits = [_LIMITS] * len(x)
        try:
            for tau in _TAUS:
                options = dict(jac=True, method="L-BFGS-B", bounds=limits)
                x = minimize(self._value, x, (tau,), options={"maxiter": effort}, **options).x
        except _Found:
            pass

    def _value(self, x: Array, tau: float) -> tuple[float, Array]:
        if time.monotonic() > self.until:
            raise _Found
        rows = self.rows
        n = rows.shape[2]
        w = np.exp(x) / self.norms
        W = np.zeros((len(rows), 6, 6))
        np.add.at(W, self.at[1], w[:, None, None] * self.forms)
        flat = rows.reshape(-1, n)
        M = flat.T @ (W @ rows).reshape(-1, n)
        diagonal = np.diag(M).copy()
        positive = diagonal > 0
        if not positive.all():
            diagonal = np.maximum(diagonal, 1e-3 * float(np.abs(M).max()) + 1e-300)
        q = 1 / np.sqrt(diagonal)
        values, V = np.linalg.eigh(q[:, None] * M * q)
        if values[0] > self.best[0]:
            self.best = (float(values[0]), x.copy())
        if values[0] > _ENOUGH:
            raise _Found
        part = np.exp(-(values - values[0]) / tau)
        total = part.sum()
        part /= total
        Y = q[:, None] * V
        A = (Y * part) @ Y.T
        A[np.arange(n), np.arange(n)] -= np.where(positive, (Y**2) @ (part * values), 0.0)
        inner = rows @ A @ rows.transpose(0, 2, 1)
        slope = np.einsum("kab,kab->k", self.forms, inner[self.at[1]]) * w
        return float(-(values[0] - tau * np.log(total))), -slope
