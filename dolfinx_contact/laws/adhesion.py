# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Adhesion with damage, friction and unilateral contact: the RCCM law.

In the law of Raous, Cangemi and Cocou (CMAME 177, 1999, section 3), the springs of a bond with the
intensity beta (1 if intact, 0 if broken) resist the total opening [u_n] >= 0 and the total
tangential jump [u_t]. Friction increases as bonds break:

    t_adh = -beta^2 (-C_N [u_n] n + C_T [u_t]),       |t_t - t_adh,t| <= mu (1 - beta) p,
    b beta' = -(w - (C_N [u_n]^2 + C_T |[u_t]|^2) beta)^-,

with Signorini's conditions on the pressure p, which does not include adhesion. Here t_adh is the
adhesive part of the traction on the body, t_t the shear, n the normal into the obstacle, C_N and
C_T the stiffnesses of the springs, mu the friction coefficient, b the viscosity, w the work of
decohesion, and x^- = max(-x, 0). Broken bonds do not heal. Time integration has first or second
order (`DamageStep`); for b = 0 it is exact as long as the jumps grow. The status records whether a
bond is being damaged (`status.DAMAGING`).

*Recoverable* bonds grow at closed points: b beta' = w - E beta with E = C_N [u_n]^2 + C_T |[u_t]|^2
and 0 <= beta <= 1. Growth is restricted to points that were closed at the start of the step,
because beta would otherwise jump when a point closes within a step. The tangential reference of a
broken bond is the current jump until it grows again, so that it heals as a new bond.

The law is not implemented as an `Interface`. For the first-order law on a rigid surface, a subclass
of `Interface` with 18 lines gives equal statuses, tractions and Newton counts
(`tests/physics/test_interfaces.py`), but evaluation takes 2.7 times as long (20,000 points in 3D).
Second order and recovery cannot be expressed by an energy and a dissipation of one step. The closed
formula is also smooth beyond the borders of its statuses, as required by solves with fixed
statuses, whereas equations solved point by point have no solution there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import ufl

from dolfinx_contact._validate import flag, one_of
from dolfinx_contact.laws.friction import Coulomb
from dolfinx_contact.laws.law import (
    Bond,
    Border,
    ContactPoint,
    Internal,
    Law,
    Scalar,
    Sign,
    StatusPiece,
    constant_law,
)
from dolfinx_contact.laws.status import DAMAGING, OPEN, PLUS

__all__ = ["RCCM", "DamageStep"]

_STEP = "rate", "length", "rest"  # data of the previous step, used by the second order
_LEAST = 0.25  # energy relative to w, below which no bond of intensity at most 1 is damaged
_TINY = 1e-100
_LONGEST = 2.0  # ratio of consecutive steps; BDF2 is stable up to 1 + sqrt(2)
_CLOSED = Internal("closed", hidden=True)
_ORIGIN = Internal("origin", vector=True, hidden=True)


@constant_law
@dataclass(frozen=True)
class RCCM(Law):
    """Adhesion, friction and unilateral contact (Raous, Cangemi and Cocou).

    Every field is a number, a Constant, a Function or a UFL expression. A static problem ignores
    the viscosity, and ``beta`` is the intensity before the load is applied.

    Attributes:
        normal: stiffness C_N >= 0 of the springs against opening, traction per length.
        tangential: stiffness C_T >= 0 of the springs against the tangential jump, traction per
            length.
        work: work of decohesion w > 0, energy per area.
        friction: friction coefficient mu >= 0 of a broken bond; an intact bond has no friction.
        viscosity: viscosity b >= 0 of damage, energy per area times time.
        beta: initial intensity, from 0 to 1.
        broken: intensity below which a bond counts as broken.
        order: order of the time integration, 1 or 2.
        recovers: whether bonds grow at closed points.

    Raises:
        ValueError: if an attribute is not admissible.
    """

    normal: Scalar
    tangential: Scalar
    work: Scalar
    friction: Scalar = 0.0
    viscosity: Scalar = 0.0
    beta: Scalar = 1.0
    broken: Scalar = 1e-6
    order: int = 1
    recovers: bool = False
    options = ("order", "recovers")
    needs_time = ("viscosity",)
    signs: ClassVar[Mapping[str, Sign]] = {
        "normal": "nonnegative",
        "tangential": "nonnegative",
        "work": "positive",
        "friction": "nonnegative",
        "viscosity": "nonnegative",
        "beta": "fraction",
        "broken": "fraction",
    }

    def __post_init__(self) -> None:
        one_of(self.order, "the order of RCCM in time", (1, 2))
        flag(self.recovers, "recovers of RCCM")
        super().__post_init__()

    @property
    def internal(self) -> tuple[Internal, ...]:  # type: ignore[override]
        steps = [Internal(name, hidden=True) for name in _STEP] if self.order == 2 else []
        bonds = [_CLOSED, _ORIGIN] if self.recovers else []
        return (Internal("beta", "falls"), *steps, *bonds)

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self._friction(self._now(a)).bound(a, p)

    def bond(self, a: ContactPoint) -> Bond:
        opening = self._opening(a)
        moved = self._moved(a)
        energy = self._energy(opening, moved)
        beta = self._now(a)
        lost = self.beta - beta
        moves = ufl.gt(a.step, 0.0)
        time = ufl.conditional(moves, a.step, 1.0)
        viscous = ufl.And(moves, ufl.And(ufl.gt(self.viscosity, 0.0), ufl.gt(lost, 0.0)))
        pace = ufl.conditional(viscous, lost, 1.0) / time
        resisted = ufl.conditional(viscous, self.viscosity * pace * lost, 0.0)
        after = {"beta": beta}
        if self.order == 2:
            holds = ufl.lt(beta * energy, self.work)
            after |= {
                ".rate": ufl.conditional(moves, lost / time, 0.0),
                ".length": ufl.conditional(moves, a.step, 0.0),
                ".rest": ufl.conditional(holds, beta, self.work / _least_energy(energy, self.work)),
            }
        spent = self.work * lost + resisted
        if self.recovers:
            # Viscosity dissipates the energy of recovery, except the energy of the springs.
            springs = 0.5 * energy * (self.beta + beta) * lost
            spent = ufl.conditional(ufl.lt(lost, 0.0), springs, spent)
            after[".closed"] = ufl.conditional(ufl.gt(a.p, 0.0), 1.0, 0.0)
            for i, name in enumerate(_ORIGIN.components(a.dim)):
                jump = a.jump[i] + a.before[i] - ufl.dot(a.before, a.n) * a.n[i]
                after[name] = ufl.conditional(self._is_new, jump, self._origin(a)[i])
            given_up = _along(a.before - self._origin(a), a.n)
            spent += ufl.conditional(
                self._is_new,
                0.5 * self.beta**2 * self.tangential * ufl.dot(given_up, given_up),
                0.0,
            )
        traction = self._traction(beta, opening, moved, a.n)
        broken = ufl.conditional(ufl.lt(beta, self.broken), 1.0, 0.0)
        return Bond(after, traction, 0.5 * beta**2 * energy, spent, broken)

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        found = {}
        step = self._step(a)
        moved = self._moved(a)
        scale = ufl.sqrt(self.work * (self.normal + self.tangential))
        for is_open in (True, False):
            opening = -a.u_n if is_open else 0.0
            energy = self._energy(opening, moved)
            slack = scale * step.slack(energy)
            for damage, beta in ((0, step.cap), (DAMAGING, step.intensity(energy))):
                adhesion = self._traction(beta, opening, moved, a.n)
                for code, piece in self._contact(a, beta).items():
                    if (code == OPEN) != is_open:
                        continue
                    borders = [Border(d, k + damage, where) for d, k, where in piece.borders]
                    if damage:
                        borders += self._to_unchanged_bond(code, -slack, step.cap)
                    else:
                        borders.append(Border(slack, code + DAMAGING))
                    answer = piece.answer + adhesion
                    found[code + damage] = StatusPiece(answer, borders, piece.exists)
        return dict(sorted(found.items()))

    def _contact(self, a: ContactPoint, beta: Any) -> Mapping[int, StatusPiece]:
        """Return the law of contact and friction without the springs of the bond, by status.

        The spring force due to the tangential increment of the step would act like additional
        augmentation and is omitted. ``beta`` is the bond intensity.
        """
        along = _along(a.before - self._origin(a), a.n)
        if self.recovers:
            along = ufl.conditional(self._is_new, 0.0, 1.0) * along
        shear = a.s + beta**2 * self.tangential * along
        return self._friction(beta).pieces(replace(a, shear=shear))

    def _friction(self, beta: Any) -> Coulomb:
        """Return Coulomb's law for a bond of intensity ``beta``, whose friction is reduced."""
        return Coulomb(self.friction * (1.0 - beta))

    def _to_unchanged_bond(self, code: int, distance: Any, cap: Any) -> list[Border]:
        """Return the borders to the statuses in which the bond does not change.

        Without friction, closed points slip.
        """
        if code in (OPEN, PLUS):
            return [Border(distance, code)]
        grips = ufl.And(ufl.gt(self.friction, 0.0), ufl.lt(cap, 1.0))
        return [Border(distance, code, grips), Border(distance, PLUS, ufl.Not(grips))]

    def _energy(self, opening: Any, moved: Any) -> Any:
        """Return C_N [u_n]^2 + C_T |[u_t]|^2, twice the spring energy per area if intact."""
        return self.normal * opening**2 + self.tangential * ufl.dot(moved, moved)

    def _traction(self, beta: Any, opening: Any, moved: Any, n: Any) -> Any:
        return beta**2 * (self.normal * opening * n - self.tangential * moved)

    def _step(self, a: ContactPoint) -> DamageStep:
        """Return the time step of the bond intensity, for the memory at the last accepted state."""
        before = {name: a.kept[f".{name}"] for name in _STEP} if self.order == 2 else None
        grows = None
        if self.recovers:
            grows = ufl.And(ufl.gt(a.kept[".closed"], 0.5), ufl.gt(a.step, 0.0))
        return DamageStep(self.beta, self.work, self.viscosity, a.step, before, grows)

    def _now(self, a: ContactPoint) -> Any:
        """Return the bond intensity beta at the current state."""
        return self._step(a).now(self._energy(self._opening(a), self._moved(a)))

    @property
    def _is_new(self) -> Any:
        """UFL condition that a recovering bond was broken before the step."""
        return ufl.lt(self.beta, self.broken)

    def _origin(self, a: ContactPoint) -> Any:
        """Return the tangential jump at which the springs are relaxed."""
        if not self.recovers:
            return 0.0 * a.n
        return ufl.as_vector([a.kept[name] for name in _ORIGIN.components(a.dim)])

    def _opening(self, a: ContactPoint) -> Any:
        """Return the opening [u_n] >= 0, the extension of the normal springs."""
        return ufl.conditional(ufl.lt(a.u_n, 0.0), -a.u_n, 0.0)

    def _moved(self, a: ContactPoint) -> Any:
        """Return the part of the tangential jump that stretches the springs."""
        moved = a.u_t + _along(a.before - self._origin(a), a.n)
        return ufl.conditional(self._is_new, 0.0, 1.0) * moved if self.recovers else moved


def _along(v: Any, n: Any) -> Any:
    return v - ufl.dot(v, n) * n


class DamageStep:
    r"""Time step of the bond intensity beta in UFL, for a given spring energy.

    The law is b beta' = -(w - E beta)^-, where E is twice the spring energy per area of an intact
    bond. If the bond recovers, b beta' = w - E beta up to beta = 1. A step from beta_n satisfies

        b (s - beta)/tau = E beta - w   as long as beta < c,   otherwise beta = c,

    where s, tau and the *cap* c depend on the memory only. A step thus has a single kink in E,
    where beta reaches c.

    - First order (implicit Euler): s = beta_n and tau = dt.
    - Second order (BDF2, the two-step backward differentiation formula; Hairer, Norsett and
      Wanner, Solving Ordinary Differential Equations I, section III.5): with r_n = (beta_n-1 -
      beta_n)/dt_n, x = dt/dt_n and a = x/(1 + 2 x), s = beta_n - a dt r_n and tau = (1 - a) dt.
      The formula is L-stable, so its order does not depend on b. x is limited to 2, because the
      formula is unstable for longer steps; the order is then lower.

    The cap is beta_n, or 1 if the bond may recover. With the two-step formula a bond could weaken
    further after the load has stopped, by the excess over w/E_n, where E_n is E at the start of the
    step; c = max(s, min(beta_n, w/E_n)) prevents this.

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
        """Return (w - E c - b (c - s)/tau)/w, which is nonnegative if the bond keeps the cap c.

        E is the spring energy ``energy``; `DamageStep` explains the other symbols.
        """
        free = 1.0 - self.cap * energy / self._work
        if self.cap is self._start:
            return free
        missing = self.cap - self._start
        pace = _positive(missing, _TINY) / _positive(self._time, _TINY)
        acts = ufl.And(self._viscous, ufl.gt(missing, 0.0))
        return free - ufl.conditional(acts, self._viscosity * pace / self._work, 0.0)

    def intensity(self, energy: Any) -> Any:
        """Return the intensity below the cap, the solution of b (s - beta)/tau = E beta - w.

        E is the spring energy ``energy``; `DamageStep` explains the other symbols.
        """
        w = self._work
        b = ufl.conditional(ufl.gt(self._viscosity, 0.0), self._viscosity, 1.0)
        slow = (b * self._start + self._time * w) / (b + self._time * energy)
        return ufl.conditional(self._viscous, slow, w / _least_energy(energy, w))

    def now(self, energy: Any) -> Any:
        """Return the intensity at the end of the step, for the spring energy E = ``energy``."""
        return ufl.conditional(ufl.lt(self.slack(energy), 0.0), self.intensity(energy), self.cap)


def _least_energy(energy: Any, work: Any) -> Any:
    """Return the spring energy E, bounded from below to avoid division by zero."""
    return ufl.conditional(ufl.gt(energy, _LEAST * work), energy, _LEAST * work)


def _positive(value: Any, least: float) -> Any:
    return ufl.conditional(ufl.gt(value, least), value, least)
