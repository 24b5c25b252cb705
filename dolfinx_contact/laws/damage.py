# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Time step of the bond intensity beta in UFL, for a given spring energy.

The law is b beta' = -(w - E beta)^-, where E is twice the spring energy per area of an intact bond.
If the bond recovers, b beta' = w - E beta up to beta = 1. A step starting from beta_n satisfies

    b (s - beta)/tau = E beta - w   as long as beta < c,   otherwise beta = c,

where s, tau and the *cap* c depend on the memory only. A step thus has a single kink in E, where
beta reaches c.

- First order (implicit Euler): s = beta_n and tau = dt.
- Second order (BDF2, the two-step backward differentiation formula; Hairer, Norsett and Wanner,
  Solving Ordinary Differential Equations I, section III.5): with r_n = (beta_n-1 - beta_n)/dt_n,
  x = dt/dt_n and a = x/(1 + 2 x), s = beta_n - a dt r_n and tau = (1 - a) dt. The formula is
  L-stable, so its order does not depend on b. x is limited to 2, because the formula is unstable
  for longer steps; the order is then lower.

The cap is beta_n, or 1 if the bond may recover. With the two-step formula a bond could weaken
further after the load has stopped, by the excess over w/E_n; c = max(s, min(beta_n, w/E_n))
prevents this.
"""

from __future__ import annotations

from typing import Any

import ufl

__all__ = ["DamageStep", "least_energy"]

_LEAST = 0.25  # energy relative to w, below which no bond of intensity at most 1 is damaged
_TINY = 1e-100
_LONGEST = 2.0  # ratio of consecutive steps; BDF2 is stable up to 1 + sqrt(2)


class DamageStep:
    """Time step of the bond intensity beta.

    Args:
        beta: intensity at the start of the step.
        work: work of decohesion w, energy per area.
        viscosity: viscosity b >= 0.
        step: duration dt; negative for a step without viscosity (static problem).
        before: "rate" r_n, "length" dt_n and "rest" min(beta_n, w/E_n) of the previous step, for
            the second order; default: None (first order).
        recovers: UFL condition under which beta may grow; default: None (beta never grows).

    Attributes:
        cap: upper bound c of the intensity in the step.
    """

    def __init__(
        self,
        beta: Any,
        work: Any,
        viscosity: Any,
        step: Any,
        before: dict[str, Any] | None = None,
        recovers: Any | None = None,
    ):
        self._work = work
        self._viscosity = viscosity
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
        """Return (w - E c - b (c - s)/tau)/w, which is nonnegative if beta equals the cap."""
        free = 1.0 - self.cap * energy / self._work
        if self.cap is self._start:
            return free
        missing = self.cap - self._start
        pace = _positive(missing, _TINY) / _positive(self._time, _TINY)
        acts = ufl.And(self._viscous, ufl.gt(missing, 0.0))
        return free - ufl.conditional(acts, self._viscosity * pace / self._work, 0.0)

    def intensity(self, energy: Any) -> Any:
        """Return the damaged intensity, the solution of b (s - beta)/tau = E beta - w."""
        w = self._work
        b = ufl.conditional(ufl.gt(self._viscosity, 0.0), self._viscosity, 1.0)
        slow = (b * self._start + self._time * w) / (b + self._time * energy)
        return ufl.conditional(self._viscous, slow, w / least_energy(energy, w))

    def now(self, energy: Any) -> Any:
        """Return the intensity at the end of the step, for the spring energy E = ``energy``."""
        return ufl.conditional(ufl.lt(self.slack(energy), 0.0), self.intensity(energy), self.cap)


def least_energy(energy: Any, work: Any) -> Any:
    """Return the spring energy E, bounded from below to avoid division by zero."""
    return ufl.conditional(ufl.gt(energy, _LEAST * work), energy, _LEAST * work)


def _positive(value: Any, least: float) -> Any:
    return ufl.conditional(ufl.gt(value, least), value, least)
