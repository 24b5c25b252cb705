# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Adhesion that damage weakens, with friction and unilateral contact: the RCCM law.

Raous, Cangemi and Cocou (CMAME 177, 1999, section 3): a bond of the intensity beta, 1 where it is
intact and 0 where it is broken, holds the opening [u_n] >= 0 and the tangential jump [u_t], both
total, by springs; friction grows where they break:

    t_adh = -beta^2 (-C_N [u_n] n + C_T [u_t]),       |t_t - t_adh,t| <= mu (1 - beta) p,
    b beta' = -(w - (C_N [u_n]^2 + C_T |[u_t]|^2) beta)^-,

with Signorini's conditions on the pressure p, in which adhesion has no part. What breaks does not
heal. In a step of the length dt from beta_n, by implicit Euler,

    beta = min(beta_n, (b beta_n + dt w)/(b + dt (C_N [u_n]^2 + C_T |[u_t]|^2))),

for b = 0 exactly, with any steps, as long as the jumps grow. A bond holds or *damages*: these are
statuses, beside open, stick and slip (`status.DAMAGING`).

The two forms of the friction bound in print, mu (1 - beta) times the contact pressure and times the
normal traction less its adhesive part, are one under Signorini's conditions, where adhesion pulls
open points alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import ufl

from dolfinx_contact.laws.friction import Coulomb
from dolfinx_contact.laws.law import Bond, Border, ContactPoint, Law, Scalar, Sign, StatusPiece
from dolfinx_contact.laws.status import DAMAGING, OPEN, PLUS

__all__ = ["RCCM"]

_LEAST = 0.25  # of w, an energy below which no bond of intensity 1 or less can damage


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
        viscosity: b >= 0 of damage, energy times time per area.
        beta: intensity at the start, from 0 to 1.
    """

    normal: Scalar
    tangential: Scalar
    work: Scalar
    friction: Scalar = 0.0
    viscosity: Scalar = 0.0
    beta: Scalar = 1.0
    remembers = ("beta",)

    def sign(self, field: str) -> Sign:
        return {"work": "positive", "beta": "fraction"}.get(field, "nonnegative")  # type: ignore

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.friction * (1.0 - self._now(a)) * p

    def bond(self, a: ContactPoint) -> Bond:
        beta, opening, moved = self._now(a), _opening(a), _moved(a)
        lost = self.beta - beta
        viscous = ufl.And(ufl.gt(self.viscosity, 0.0), ufl.gt(a.step, 0.0))
        time = ufl.conditional(ufl.gt(a.step, 0.0), a.step, 1.0)
        resisted = ufl.conditional(viscous, self.viscosity * lost**2 / time, 0.0)
        traction = self._traction(a, beta, opening)
        return Bond(
            {"beta": beta},
            traction,
            0.5 * beta**2 * self._energy(opening, moved),
            self.work * lost + resisted,
        )

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        found = {}
        for damage, beta in (
            (0, lambda energy: self.beta),
            (DAMAGING, self._damaged(a)),
        ):
            for code in self._contact(a, self.beta):
                opening = -a.u_n if code == OPEN else 0.0
                energy = self._energy(opening, _moved(a))
                intensity = beta(energy)
                piece = self._contact(a, intensity)[code]
                answer = piece.answer + self._traction(a, intensity, opening)
                borders = [Border(d, k + damage, where) for d, k, where in piece.borders]
                held = ufl.sqrt(self.work * (self.normal + self.tangential)) * (
                    1.0 - self.beta * energy / self.work
                )
                if damage:
                    borders += self._healed(code, -held)
                else:
                    borders.append(Border(held, code + DAMAGING))
                found[code + damage] = StatusPiece(answer, borders, piece.exists)
        return found

    def _contact(self, a: ContactPoint, beta: Any) -> Mapping[int, StatusPiece]:
        """Contact and friction, which see the shear that no bond carries.

        Springs that the increment stretches are as good as more augmentation, and left out.
        """
        along = a.before - ufl.dot(a.before, a.n) * a.n
        shear = a.s + beta**2 * self.tangential * along
        return Coulomb(self.friction * (1.0 - beta)).pieces(replace(a, shear=shear))

    def _healed(self, code: int, distance: Any) -> list[Border]:
        """Where damage ends: an intact bond has no friction, and then every point may slip."""
        if code in (OPEN, PLUS):
            return [Border(distance, code)]
        grips = ufl.And(ufl.gt(self.friction, 0.0), ufl.lt(self.beta, 1.0))
        return [Border(distance, code, grips), Border(distance, PLUS, ufl.Not(grips))]

    def _energy(self, opening: Any, moved: Any) -> Any:
        """Twice that of springs of an intact bond, per area."""
        return self.normal * opening**2 + self.tangential * ufl.dot(moved, moved)

    def _traction(self, a: ContactPoint, beta: Any, opening: Any) -> Any:
        return beta**2 * (self.normal * opening * a.n - self.tangential * _moved(a))

    def _damaged(self, a: ContactPoint) -> Any:
        """The intensity of a bond that damages, by the energy of its springs."""
        w, b = self.work, self.viscosity
        viscous = ufl.And(ufl.gt(b, 0.0), ufl.ge(a.step, 0.0))
        b_ = ufl.conditional(ufl.gt(b, 0.0), b, 1.0)

        def damaged(energy: Any) -> Any:
            e = ufl.conditional(ufl.gt(energy, _LEAST * w), energy, _LEAST * w)
            slow = (b_ * self.beta + a.step * w) / (b_ + a.step * e)
            return ufl.conditional(viscous, slow, w / e)

        return damaged

    def _now(self, a: ContactPoint) -> Any:
        """The intensity at a state."""
        energy = self._energy(_opening(a), _moved(a))
        damages = ufl.gt(self.beta * energy, self.work)
        return ufl.conditional(damages, self._damaged(a)(energy), self.beta)


def _opening(a: ContactPoint) -> Any:
    return ufl.conditional(ufl.lt(a.u_n, 0.0), -a.u_n, 0.0)


def _moved(a: ContactPoint) -> Any:
    """The whole tangential jump, from the start."""
    return a.u_t + a.before - ufl.dot(a.before, a.n) * a.n
