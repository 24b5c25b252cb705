# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Adhesion that damage weakens, with friction and unilateral contact: the RCCM law.

Raous, Cangemi and Cocou (CMAME 177, 1999, section 3): a bond of the intensity beta, 1 where it is
intact and 0 where it is broken, holds the opening [u_n] >= 0 and the tangential jump [u_t], both
total, by springs; friction grows where they break:

    t_adh = -beta^2 (-C_N [u_n] n + C_T [u_t]),       |t_t - t_adh,t| <= mu (1 - beta) p,
    b |beta'|^p = (w - (C_N [u_n]^2 + C_T |[u_t]|^2) beta)^-,

with Signorini's conditions on the pressure, in which adhesion has no part. What breaks does not
heal. Steps in time, of first and second order, are those of `damage`; for b = 0 they are exact, as
long as the jumps grow. A bond holds or *damages*: these are statuses, beside open, stick and slip
(`status.DAMAGING`).

The two forms of the friction bound in print, mu (1 - beta) times the contact pressure and times the
normal traction less its adhesive part, are one under Signorini's conditions, where adhesion pulls
open points alone.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import ufl

from dolfinx_contact.laws.damage import DamageStep, least_energy
from dolfinx_contact.laws.friction import Coulomb
from dolfinx_contact.laws.law import Bond, Border, ContactPoint, Law, Scalar, Sign, StatusPiece
from dolfinx_contact.laws.status import DAMAGING, OPEN, PLUS

__all__ = ["RCCM"]

_RATE, _LENGTH, _REST = ".rate", ".length", ".rest"


@dataclass(frozen=True)
class RCCM(Law):
    """Adhesion, friction and unilateral contact (Raous, Cangemi and Cocou).

    Every field is a number, a Constant, a Function or a UFL expression. In a static problem, which
    knows no time, the viscosity does not matter, and ``beta`` is the intensity before the load.

    Attributes:
        normal: C_N >= 0 of springs that act on the opening, traction per length.
        tangential: C_T >= 0 of those that act on the tangential jump, traction per length.
        work: w > 0, of decohesion, energy per area.
        friction: coefficient mu >= 0, of a broken bond; an intact one has none.
        viscosity: b >= 0 of damage, energy per area times time to the power p.
        beta: intensity at the start, from 0 to 1.
        exponent: p of the viscosity, a number from 1/10 to 10.
        order: of the steps in time, 1 or 2. With p > 1, where the damage of a bond begins as a root
            of the time, the second is 1 + 1/p in truth.

    Raises:
        ValueError: if the exponent or the order is none of these.
    """

    normal: Scalar
    tangential: Scalar
    work: Scalar
    friction: Scalar = 0.0
    viscosity: Scalar = 0.0
    beta: Scalar = 1.0
    exponent: float = 1.0
    order: int = 1
    remembers = ("beta",)

    def __post_init__(self) -> None:
        p = self.exponent
        number = isinstance(p, int | float | np.number) and not isinstance(p, bool)
        if not (number and 0.1 <= p <= 10):
            raise ValueError(f"the exponent of RCCM must be a number from 1/10 to 10, got {p!r}")
        if isinstance(self.order, bool) or self.order not in (1, 2):
            raise ValueError(f"the order of RCCM in time must be 1 or 2, got {self.order!r}")

    @property
    def kind(self) -> Hashable | None:
        return super().kind, float(self.exponent), int(self.order)

    @property
    def given(self) -> dict[str, Scalar]:
        names = "normal", "tangential", "work", "friction", "viscosity", "beta"
        return {name: getattr(self, name) for name in names}

    def sign(self, field: str) -> Sign:
        return {"work": "positive", "beta": "fraction"}.get(field, "nonnegative")  # type: ignore

    def keeps(self, dim: int) -> tuple[str, ...]:
        return (_RATE, _LENGTH, _REST) if self.order == 2 else ()

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.friction * (1.0 - self._now(a)) * p

    def bond(self, a: ContactPoint) -> Bond:
        opening = _opening(a)
        energy, beta = self._energy(opening, _moved(a)), self._now(a)
        lost, moves = self.beta - beta, ufl.gt(a.step, 0.0)
        time = ufl.conditional(moves, a.step, 1.0)
        viscous = ufl.And(moves, ufl.And(ufl.gt(self.viscosity, 0.0), ufl.gt(lost, 0.0)))
        pace = ufl.conditional(viscous, lost, 1.0) / time
        resisted = ufl.conditional(viscous, self.viscosity * pace**self.exponent * lost, 0.0)
        after = {"beta": beta}
        if self.order == 2:
            held = ufl.lt(beta * energy, self.work)
            after |= {
                _RATE: ufl.conditional(moves, lost / time, 0.0),
                _LENGTH: ufl.conditional(moves, a.step, 0.0),
                _REST: ufl.conditional(held, beta, self.work / least_energy(energy, self.work)),
            }
        return Bond(
            after,
            self._traction(a, beta, opening),
            0.5 * beta**2 * energy,
            self.work * lost + resisted,
        )

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        found, step = {}, self._step(a)
        scale = ufl.sqrt(self.work * (self.normal + self.tangential))
        for is_open in (True, False):
            opening = -a.u_n if is_open else 0.0
            energy = self._energy(opening, _moved(a))
            slack = scale * step.slack(energy)
            for damage, beta in ((0, step.cap), (DAMAGING, step.intensity(energy))):
                adhesion = self._traction(a, beta, opening)
                for code, piece in self._contact(a, beta).items():
                    if (code == OPEN) != is_open:
                        continue
                    borders = [Border(d, k + damage, where) for d, k, where in piece.borders]
                    if damage:
                        borders += self._healed(code, -slack, step.cap)
                    else:
                        borders.append(Border(slack, code + DAMAGING))
                    answer = piece.answer + adhesion
                    found[code + damage] = StatusPiece(answer, borders, piece.exists)
        return dict(sorted(found.items()))

    def _contact(self, a: ContactPoint, beta: Any) -> Mapping[int, StatusPiece]:
        """Contact and friction, which see the shear that no bond carries.

        Springs that the increment stretches are as good as more augmentation, and left out.
        """
        along = a.before - ufl.dot(a.before, a.n) * a.n
        shear = a.s + beta**2 * self.tangential * along
        return Coulomb(self.friction * (1.0 - beta)).pieces(replace(a, shear=shear))

    def _healed(self, code: int, distance: Any, cap: Any) -> list[Border]:
        """Where damage ends: an intact bond has no friction, and then every point may slip."""
        if code in (OPEN, PLUS):
            return [Border(distance, code)]
        grips = ufl.And(ufl.gt(self.friction, 0.0), ufl.lt(cap, 1.0))
        return [Border(distance, code, grips), Border(distance, PLUS, ufl.Not(grips))]

    def _energy(self, opening: Any, moved: Any) -> Any:
        """Twice that of springs of an intact bond, per area."""
        return self.normal * opening**2 + self.tangential * ufl.dot(moved, moved)

    def _traction(self, a: ContactPoint, beta: Any, opening: Any) -> Any:
        return beta**2 * (self.normal * opening * a.n - self.tangential * _moved(a))

    def _step(self, a: ContactPoint) -> DamageStep:
        """How the intensity goes on from memory."""
        b, p = self.viscosity, float(self.exponent)
        before = {k.removeprefix("."): a.kept[k] for k in self.keeps(a.dim)} or None
        return DamageStep(self.beta, self.work, b, p, a.step, before)

    def _now(self, a: ContactPoint) -> Any:
        """The intensity at a state."""
        return self._step(a).now(self._energy(_opening(a), _moved(a)))


def _opening(a: ContactPoint) -> Any:
    return ufl.conditional(ufl.lt(a.u_n, 0.0), -a.u_n, 0.0)


def _moved(a: ContactPoint) -> Any:
    """The whole tangential jump, from the start."""
    return a.u_t + a.before - ufl.dot(a.before, a.n) * a.n
