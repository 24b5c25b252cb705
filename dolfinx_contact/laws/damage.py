# SPDX-License-Identifier: LGPL-3.0-or-later
r"""One step in time of the intensity beta of a bond, in UFL, by the energy of its springs.

The law is b |beta'|^p = (w - E beta)^-, where E is twice the energy per area of the springs of an
intact bond. Where the bond recovers, b beta' = w - E beta (p = 1), up to beta = 1. In a step from
beta_n,

    b ((s - beta)/tau)^p = E beta - w   as long as beta < c,   else beta = c,

with s, tau and c that only memory knows: a step has one kink in E, at the end of the *cap* c.

- First order, implicit Euler: s = beta_n and tau = dt.
- Second order, the backward differentiation formula of two steps (BDF2; Hairer, Norsett and Wanner,
  Solving Ordinary Differential Equations I, section III.5), with r_n = (beta_n-1 - beta_n)/dt_n,
  x = dt/dt_n and a = x/(1 + 2 x):  s = beta_n - a dt r_n and tau = (1 - a) dt. It is L-stable, so
  that its order does not depend on how small b is. x counts as 2 at most: with longer steps the
  formula is no longer stable, and the order falls.

The cap is beta_n, or 1 where the bond may recover. The formula of two steps may let a bond continue
to weaken when the load has stopped, by what it still is above w/E_n: c = max(s, min(beta_n,
w/E_n)).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import ufl

__all__ = ["DamageStep", "least_energy"]

_LEAST = 0.25  # of w, an energy below which no bond of intensity 1 or less can damage
_TINY = 1e-100
_LONGEST = 2.0  # step over the one before, beyond which BDF2 is not stable (1 + sqrt(2))
_DEGREE = 12


def _solved(log: Any, exponent: float) -> Any:
    """The y of y + k y^p = 1, by the logarithm of k > 0, differentiable.

    With y = exp(-x) it is the zero of ln(exp(-x) + k exp(-p x)), which is convex and between two
    lines that cross at k = 1. What x has more than the zeros of these is a function of k below, of
    k^(-1/p) beyond: polynomials of them, and a step of Newton's method. (UFL is slow with more of
    these, for x is in each several times.) To 1e-11 for p from 1/4 to 5, 1e-7 from 1/10 to 10.
    """
    p = exponent
    below, beyond = _starts(p)
    small = ufl.lt(log, 0.0)
    k = ufl.exp(ufl.conditional(small, log, -log / p))
    x = ufl.conditional(small, _horner(below, k), log / p + _horner(beyond, k))
    one = ufl.exp(-x)
    other = ufl.exp(log - p * x)
    x = x + ufl.ln(one + other) * (one + other) / (one + p * other)
    return ufl.exp(-x)


def _starts(p: float) -> tuple[list[float], list[float]]:
    """Coefficients of both polynomials, from zeros at Chebyshev's points."""
    at = 0.5 + 0.5 * np.cos((2 * np.arange(_DEGREE + 1) + 1) * np.pi / (2 * _DEGREE + 2))
    found = []
    for log, line in ((np.log(at), 0.0 * at), (-p * np.log(at), -np.log(at))):
        x = np.maximum(log / p, 0.0)
        for _ in range(50):
            one = np.exp(-x)
            other = np.exp(log - p * x)
            x = x + np.log(one + other) * (one + other) / (one + p * other)
        fitted = np.polynomial.Polynomial.fit(at, x - line, _DEGREE).convert().coef
        found.append([round(float(c), 9) for c in fitted])  # the same on every machine
    return found[0], found[1]


def _horner(coefficients: Sequence[float], x: Any) -> Any:
    found: Any = 0.0
    for c in reversed(coefficients):
        found = found * x + c
    return found


class DamageStep:
    """A step of beta: beta in the memory, and beta by the energy of the springs.

    Args:
        beta: at the start.
        work: w, energy per area.
        viscosity: b >= 0.
        exponent: p > 0, a number.
        step: dt; there is no viscosity where it is negative.
        before: "rate" r_n, "length" dt_n and "rest" min(beta_n, w/E_n) of the step before, for the
            second order; None for the first.
        recovers: UFL condition under which beta may grow; None if it never does.

    Attributes:
        cap: c.
    """

    def __init__(
        self,
        beta: Any,
        work: Any,
        viscosity: Any,
        exponent: float,
        step: Any,
        before: dict[str, Any] | None = None,
        recovers: Any | None = None,
    ):
        self._work = work
        self._viscosity = viscosity
        self._exponent = exponent
        self._viscous = ufl.And(ufl.gt(viscosity, 0.0), ufl.ge(step, 0.0))
        most = beta if recovers is None else ufl.conditional(recovers, 1.0, beta)
        self._start = beta
        self._time = step
        self.cap = most
        if before is not None:
            length = before["length"]
            known = ufl.And(ufl.gt(length, 0.0), ufl.gt(step, 0.0))
            ratio = step / ufl.conditional(known, length, 1.0)
            x = ufl.conditional(ufl.lt(ratio, _LONGEST), ratio, _LONGEST)
            a = ufl.conditional(known, x / (1.0 + 2.0 * x), 0.0)
            start = beta - a * step * before["rate"]
            self._start = ufl.conditional(ufl.lt(start, most), start, most)
            self._time = (1.0 - a) * step
            rest = before["rest"]
            cap = ufl.conditional(ufl.gt(self._start, rest), self._start, rest)
            self.cap = cap if recovers is None else ufl.conditional(recovers, 1.0, cap)

    def slack(self, energy: Any) -> Any:
        """(w - E c - b ((c - s)/tau)^p)/w, positive where beta is the cap."""
        free = 1.0 - self.cap * energy / self._work
        if self.cap is self._start:
            return free
        missing = self.cap - self._start
        pace = _positive(missing, _TINY) / _positive(self._time, _TINY)
        held = self._viscosity * pace**self._exponent / self._work
        acts = ufl.And(self._viscous, ufl.gt(missing, 0.0))
        return free - ufl.conditional(acts, held, 0.0)

    def intensity(self, energy: Any) -> Any:
        """The intensity below the cap."""
        p, w, b, s, time = (
            *(self._exponent, self._work, self._viscosity),
            *(self._start, self._time),
        )
        e = least_energy(energy, w)
        b_ = ufl.conditional(ufl.gt(b, 0.0), b, 1.0)
        if p == 1:
            slow = (b_ * s + time * w) / (b_ + time * energy)
        else:
            most = s - w / e  # by which beta falls without viscosity
            size = _positive(ufl.conditional(ufl.gt(most, 0.0), most, -most), _TINY)
            log = ufl.ln(b_ / e) + (p - 1.0) * ufl.ln(size) - p * ufl.ln(_positive(time, _TINY))
            slow = s - most * _solved(log, p)
        return ufl.conditional(self._viscous, slow, w / e)

    def now(self, energy: Any) -> Any:
        """The intensity at an energy of the springs."""
        return ufl.conditional(ufl.lt(self.slack(energy), 0.0), self.intensity(energy), self.cap)


def least_energy(energy: Any, work: Any) -> Any:
    """The energy E, or one at which no bond damages."""
    return ufl.conditional(ufl.gt(energy, _LEAST * work), energy, _LEAST * work)


def _positive(value: Any, least: float) -> Any:
    return ufl.conditional(ufl.gt(value, least), value, least)
