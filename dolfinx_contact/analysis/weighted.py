# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Renard's criterion with weights: a bound of the friction for uniqueness of a solution.

The differences a of jumps and e = S a of forces between a solution and any other satisfy, point by
point,

    a_n e_n <= 0,    a_t.(e_t + F e_n xi) <= 0

(`renard.py`). So the solution is the only one if *some* sum of these with positive weights,

    sum_i [ beta_i a_n e_n + alpha_i a_t.(e_t + F e_n xi) ]_i  >  0    for all a other than 0.

Renard's criterion has unit weights. For one point with the stiffness [[k_t, k], [k, k_n]], k > 0,
and |xi| = 1, unit weights give F < 2 sqrt(k_t k_n - k^2)/k_n. Optimal weights give F < k_t/k for
xi = -1, beyond which some loads have several solutions, and every F for xi = 1. One set of weights
is valid on an interval of F; the range of F is covered by overlapping intervals.

The least eigenvalue of the sum, scaled to a unit diagonal, is maximised over the logarithms of the
weights, with a soft minimum of several small eigenvalues as in `proofs.weights`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact.proofs.weights import maximise

__all__ = ["WeightedForm"]


_ENOUGH = 1e-7  # least eigenvalue, relative to a unit diagonal, at which a search ends
_SPREAD = 12.0  # of the logarithms of the weights
_TAUS = 0.05, 0.01, 0.003  # of the soft minimum
#: Factors by which the friction is raised, each as long as weights are found.
_STEPS = (2.0, 1.3, 1.1, 1.03, 1.01, 1.003, 1.001)
_MOST = 1e3  # largest factor


@dataclass(frozen=True, eq=False)
class WeightedForm:
    """The inequalities of a solution.

    Attributes:
        S: stiffness of the components of jumps, symmetric and positive definite (n, n).
        G: rows F xi of the normal forces, S_n, at tangential components; else 0 (n, n).
        groups: numbers of the weights of the components, equal for the tangents of a point (n,).
    """

    S: Array
    G: Array
    groups: Ints

    def interval(self, weights: Array, factor: float) -> tuple[float, float]:
        """Return the interval around a friction factor in which the sum is positive definite.

        Args:
            weights: weights of the groups.
            factor: friction factor; if the sum is not definite there, the interval is empty.
        """
        w = weights[self.groups][:, None]
        at, slope = (w * M + (w * M).T for M in (self.S + factor * self.G, self.G))
        unit = 1 / np.sqrt(np.abs(np.diag(at)))
        last = len(at) - 1
        at, slope = (unit[:, None] * M * unit for M in (at, slope))
        if np.linalg.eigvalsh(at)[0] <= _ENOUGH / 2:
            return factor, factor
        values = eigh(slope, at, eigvals_only=True, subset_by_index=(0, last))
        down, up = (1 / max(value, 1 / _MOST) for value in (values[-1], -values[0]))
        return factor - down, factor + up

    def largest(self, *, enough: float = _MOST, effort: int = 60, seconds: float = np.inf) -> float:
        """Return a friction factor up to which some weights prove uniqueness.

        Args:
            enough: factor that need not be surpassed.
            effort: iterations of each search.
            seconds: time of the search.
        """
        end = time.monotonic() + seconds
        logs: Array = np.zeros(int(self.groups.max(initial=-1)) + 1)
        _, best = self.interval(np.exp(logs), 0.0)
        for step in _STEPS:
            while best < enough and time.monotonic() < end:
                factor = min(step * best, 1.001 * enough)
                new = self._search(logs, factor, effort, end)
                if new is None:
                    break
                low, high = self.interval(np.exp(new), factor)
                if not low <= best < high:
                    break
                best = high
                logs = new
        return min(best, _MOST)

    def _search(self, logs: Array, factor: float, effort: int, end: float) -> Array | None:
        """Return logarithms of weights that make the sum positive definite at a factor, or None."""
        R = self.S + factor * self.G
        diagonal = np.diag(R)
        if (diagonal <= 0).any():
            return None
        R = R / np.sqrt(diagonal[:, None] * diagonal)

        def eigenvalues(x: Array) -> tuple[Array, Array, Callable[[Array], Array]]:
            # The form w_i R_ij / sqrt(w_i w_j), symmetric part, whose diagonal is 1.
            half = np.exp(x / 2)[self.groups]
            X = half[:, None] * R / half
            values, V = np.linalg.eigh((X + X.T) / 2)

            def gradient(part: Array) -> Array:
                # d of v.X v / d x_i = (v_i (X v)_i - v_i (X^T v)_i) / 2
                by_row = ((V * (X @ V) - V * (X.T @ V)) * part).sum(axis=1) / 2
                slope = np.zeros_like(x)
                np.add.at(slope, self.groups, by_row)
                return slope

            return values, V, gradient

        least, x, _ = maximise(
            eigenvalues,
            logs,
            limits=[(-_SPREAD, _SPREAD)] * len(logs),
            stages=[(tau, -np.inf) for tau in _TAUS],
            effort=effort,
            enough=_ENOUGH,
            until=end,
        )
        return x if least > _ENOUGH else None
