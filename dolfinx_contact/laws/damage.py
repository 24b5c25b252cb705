# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Time step of the intensity beta of a bond, in UFL, given the energy of its springs.

The law is b beta' = -(w - E beta)^-, where E is twice the energy per area of the springs of an
intact bond. Where the bond recovers, b beta' = w - E beta, up to beta = 1. In a step from beta_n,

    b (s - beta)/tau = E beta - w   as long as beta < c,   otherwise beta = c,

where s, tau and c depend on the memory only: a step has one kink in E, at the end of the *cap* c.

- First order, implicit Euler: s = beta_n and tau = dt.
- Second order, the backward differentiation formula of two steps (BDF2; Hairer, Norsett and Wanner,
  Solving Ordinary Differential Equations I, section III.5), with r_n = (beta_n-1 - beta_n)/dt_n,
  x = dt/dt_n and a = x/(1 + 2 x):  s = beta_n - a dt r_n and tau = (1 - a) dt. It is L-stable, so
  its order does not depend on b. x counts as 2 at most: with longer steps the formula is no longer
  stable, and the order falls.

The cap is beta_n, or 1 where the bond may recover. The formula of two steps may let a bond continue
to weaken after the load has stopped, by the excess over w/E_n: c = max(s, min(beta_n, w/E_n)).
"""

from __future__ import annotations

from typing import Any

import ufl

__all__ = ["DamageStep", "least_energy"]

_LEAST = 0.25  # energy over w below which no bond of intensity 1 or less can damage
_TINY = 1e-100
_LONGEST = 2.0  # step over the previous one beyond which BDF2 is not stable (1 + sqrt(2))


class DamageStep:
    """Time step of the intensity beta.

    Args:
        beta: intensity at the start.
        work: work of decohesion w, energy per area.
        viscosity: viscosity b >= 0.
        step: duration dt; a negative one means no viscosity.
        before: "rate" r_n, "length" dt_n and "rest" min(beta_n, w/E_n) of the previous step, for
            the second order; default: None, for the first order.
        recovers: UFL condition under which beta may grow; default: None, if it never grows.

    Attributes:
        cap: cap c.
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
        """Return (w - E c - b (c - s)/tau)/w, positive where beta is the cap."""
        free = 1.0 - self.cap * energy / self._work
        if self.cap is self._start:
            return free
        missing = self.cap - self._start
        pace = _positive(missing, _TINY) / _positive(self._time, _TINY)
        acts = ufl.And(self._viscous, ufl.gt(missing, 0.0))
        return free - ufl.conditional(acts, self._viscosity * pace / self._work, 0.0)

    def intensity(self, energy: Any) -> Any:
        """Return the intensity below the cap."""
        w = self._work
        b = ufl.conditional(ufl.gt(self._viscosity, 0.0), self._viscosity, 1.0)
        slow = (b * self._start + self._time * w) / (b + self._time * energy)
        return ufl.conditional(self._viscous, slow, w / least_energy(energy, w))

    def now(self, energy: Any) -> Any:
        """Return the intensity at an energy of the springs."""
        return ufl.conditional(ufl.lt(self.slack(energy), 0.0), self.intensity(energy), self.cap)


def least_energy(energy: Any, work: Any) -> Any:
    """Return the energy E, but at least one below which no bond damages."""
    return ufl.conditional(ufl.gt(energy, _LEAST * work), energy, _LEAST * work)


def _positive(value: Any, least: float) -> Any:
    return ufl.conditional(ufl.gt(value, least), value, least)
