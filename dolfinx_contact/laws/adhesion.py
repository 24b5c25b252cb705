# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Adhesion that damage weakens, with friction and unilateral contact: the RCCM law.

Raous, Cangemi and Cocou (CMAME 177, 1999, section 3): a bond of the intensity beta, 1 where it is
intact and 0 where it is broken, holds the opening [u_n] >= 0 and the tangential jump [u_t], both
total, by springs; friction grows where they break:

    t_adh = -beta^2 (-C_N [u_n] n + C_T [u_t]),       |t_t - t_adh,t| <= mu (1 - beta) p,
    b |beta'|^p = (w - (C_N [u_n]^2 + C_T |[u_t]|^2) beta)^-,

with Signorini's conditions on the pressure p, in which adhesion has no part. What breaks does not
heal. Steps in time, of first and second order, are those of `damage`; for b = 0 they are exact, as
long as the jumps grow. A bond holds or *changes*: these are statuses, beside open, stick and slip
(`status.DAMAGING`).

*Recoverable* bonds grow at closed points: b beta' = w - E beta with E = C_N [u_n]^2 + C_T |[u_t]|^2
and 0 <= beta <= 1, at points that were closed at the start of a step (so that no step has a jump
where a point closes). A bond that is broken takes the jump as its tangential reference until it has
grown again: it is a new one.

*A surface that gives way* (`contact`): p is that of `NormalCompliance`. As the energy of the model
is written, springs act on [u_n] of either sign, so that they resist penetration too.

The friction bound has two forms in print: mu (1 - beta) |R_n^-|, of the whole normal traction, and
mu (1 - beta) |R_n - C_N [u_n] beta^2|, of the contact pressure alone (`threshold`). Under
Signorini's conditions they are one, for adhesion pulls open points alone; with compliance the first
has beta^2 C_N [u_n] more.

It is no `Interface`, though its first order could be written as one: here the intensity is a
formula, smooth beyond the borders of its statuses, where equations that are solved point by point
end at them, so that a state with statuses that are held has other answers. Formulas also compile
and evaluate several times faster; and growing bonds, the step before and the pressure of a surface
that gives way have no place in an energy and a dissipation of one step.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np

import ufl

from dolfinx_contact.laws.compliant import NormalCompliance
from dolfinx_contact.laws.damage import DamageStep, least_energy
from dolfinx_contact.laws.friction import Coulomb, Frictionless
from dolfinx_contact.laws.law import (
    Bond,
    Border,
    ContactPoint,
    Internal,
    Law,
    Scalar,
    Sign,
    StatusPiece,
)
from dolfinx_contact.laws.status import DAMAGING, OPEN, PLUS

__all__ = ["RCCM"]

_STEP = "rate", "length", "rest"  # what the second order remembers of the step before
_CLOSED = Internal("closed", hidden=True)
_ORIGIN = Internal("origin", vector=True, hidden=True)
_STIFFNESS = "stiffness"  # of a surface that gives way

Threshold: TypeAlias = Literal["pressure", "reaction"]


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
        broken: intensity below which a bond is broken.
        exponent: p of the viscosity, a number from 1/10 to 10.
        order: of the steps in time, 1 or 2. With p > 1, where the damage of a bond begins as a root
            of the time, the second is 1 + 1/p in truth.
        recovers: whether bonds grow at closed points (p = 1).
        contact: compliance of the surface, without friction of its own; None: Signorini's
            conditions.
        threshold: what friction is a part of: ``"pressure"`` of contact, or the whole
            ``"reaction"``.

    Raises:
        ValueError: if one of the last five is none of these.
    """

    normal: Scalar
    tangential: Scalar
    work: Scalar
    friction: Scalar = 0.0
    viscosity: Scalar = 0.0
    beta: Scalar = 1.0
    broken: Scalar = 1e-6
    exponent: float = 1.0
    order: int = 1
    recovers: bool = False
    contact: NormalCompliance | None = None
    threshold: Threshold = "pressure"
    needs_time = ("viscosity",)
    signs: ClassVar[Mapping[str, Sign]] = {
        "normal": "nonnegative",
        "tangential": "nonnegative",
        "work": "positive",
        "friction": "nonnegative",
        "viscosity": "nonnegative",
        "beta": "fraction",
        "broken": "fraction",
        _STIFFNESS: "positive",
    }

    def __post_init__(self) -> None:
        p = self.exponent
        number = isinstance(p, int | float | np.number) and not isinstance(p, bool)
        if not (number and 0.1 <= p <= 10):
            raise ValueError(f"the exponent of RCCM must be a number from 1/10 to 10, got {p!r}")
        if isinstance(self.order, bool) or self.order not in (1, 2):
            raise ValueError(f"the order of RCCM in time must be 1 or 2, got {self.order!r}")
        if not isinstance(self.recovers, bool) or (self.recovers and p != 1):
            raise ValueError(
                f"recovers of RCCM must be True or False, and bonds recover with the exponent 1 "
                f"alone; got {self.recovers!r} and {p!r}"
            )
        soft = self.contact
        alone = isinstance(soft, NormalCompliance) and (
            isinstance(soft.friction, Frictionless) and soft.tangential is None
        )
        if not (soft is None or alone):
            raise ValueError(
                "contact of RCCM must be None or a NormalCompliance without friction and "
                f"tangential stiffness, got {soft!r}"
            )
        if self.threshold not in get_args(Threshold):
            raise ValueError(
                f"the threshold of RCCM must be one of {get_args(Threshold)}, "
                f"got {self.threshold!r}"
            )

    @property
    def compliant(self) -> bool:  # type: ignore[override]
        return self.contact is not None

    @property
    def kind(self) -> Hashable | None:
        soft = None if self.contact is None else self.contact.kind
        numbers = float(self.exponent), int(self.order), self.recovers, self.threshold
        return super().kind, *numbers, soft

    @property
    def given(self) -> dict[str, Scalar]:
        mine = {name: getattr(self, name) for name in self.signs if name != _STIFFNESS}
        return mine if self.contact is None else mine | {_STIFFNESS: self.contact.stiffness}

    def having(self, symbols: Mapping[str, Any]) -> Self:
        own = dict(symbols)
        contact = self.contact
        if contact is not None:
            stiffness = own.pop(_STIFFNESS, contact.stiffness)
            contact = replace(contact, stiffness=stiffness)
        return replace(self, contact=contact, **own)

    @property
    def internal(self) -> tuple[Internal, ...]:  # type: ignore[override]
        steps = [Internal(name, hidden=True) for name in _STEP] if self.order == 2 else []
        bonds = [_CLOSED, _ORIGIN] if self.recovers else []
        return (Internal("beta", "falls"), *steps, *bonds)

    def bound(self, a: ContactPoint, p: Any) -> Any:
        beta = self._now(a)
        return self._friction(beta, ufl.conditional(ufl.gt(a.u_n, 0.0), a.u_n, 0.0)).bound(a, p)

    def with_pressure(self, a: ContactPoint) -> ContactPoint:
        return self._soft(a, self._now(a), self._opening(a))

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
        resisted = ufl.conditional(viscous, self.viscosity * pace**self.exponent * lost, 0.0)
        after = {"beta": beta}
        if self.order == 2:
            held = ufl.lt(beta * energy, self.work)
            after |= {
                ".rate": ufl.conditional(moves, lost / time, 0.0),
                ".length": ufl.conditional(moves, a.step, 0.0),
                ".rest": ufl.conditional(held, beta, self.work / least_energy(energy, self.work)),
            }
        spent = self.work * lost + resisted
        if self.recovers:
            # Viscosity takes what growing gives back but for the springs, however fast it is.
            springs = 0.5 * energy * (self.beta + beta) * lost
            spent = ufl.conditional(ufl.lt(lost, 0.0), springs, spent)
            touch = self._soft(a, beta, opening).touch
            after[".closed"] = ufl.conditional(ufl.gt(touch, 0.0), 1.0, 0.0)
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
            opening = -a.u_n if is_open or self.compliant else 0.0
            energy = self._energy(opening, moved)
            slack = scale * step.slack(energy)
            for damage, beta in ((0, step.cap), (DAMAGING, step.intensity(energy))):
                adhesion = self._traction(beta, opening, moved, a.n)
                for code, piece in self._contact(self._soft(a, beta, opening), beta).items():
                    if (code == OPEN) != is_open:
                        continue
                    borders = [Border(d, k + damage, where) for d, k, where in piece.borders]
                    if damage:
                        borders += self._held(code, -slack, step.cap)
                    else:
                        borders.append(Border(slack, code + DAMAGING))
                    answer = piece.answer + adhesion
                    found[code + damage] = StatusPiece(answer, borders, piece.exists)
        return dict(sorted(found.items()))

    def _contact(self, a: ContactPoint, beta: Any) -> Mapping[int, StatusPiece]:
        """Contact and friction, which see the shear that no bond carries.

        Springs that the increment stretches are as good as more augmentation, and left out.
        """
        along = _along(a.before - self._origin(a), a.n)
        if self.recovers:
            along = ufl.conditional(self._is_new, 0.0, 1.0) * along
        shear = a.s + beta**2 * self.tangential * along
        return self._friction(beta, a.u_n).pieces(replace(a, shear=shear))

    def _friction(self, beta: Any, u_n: Any) -> Coulomb:
        """Friction of a bond of an intensity, where springs are pressed together by u_n."""
        friction = self.friction * (1.0 - beta)
        if self.threshold == "pressure":
            return Coulomb(friction)
        return _OfReaction(friction, beta**2 * self.normal * u_n)

    def _held(self, code: int, distance: Any, cap: Any) -> list[Border]:
        """Where a change ends: an intact bond has no friction, and then every point may slip."""
        if code in (OPEN, PLUS):
            return [Border(distance, code)]
        grips = ufl.And(ufl.gt(self.friction, 0.0), ufl.lt(cap, 1.0))
        return [Border(distance, code, grips), Border(distance, PLUS, ufl.Not(grips))]

    def _energy(self, opening: Any, moved: Any) -> Any:
        """Twice that of springs of an intact bond, per area."""
        return self.normal * opening**2 + self.tangential * ufl.dot(moved, moved)

    def _traction(self, beta: Any, opening: Any, moved: Any, n: Any) -> Any:
        return beta**2 * (self.normal * opening * n - self.tangential * moved)

    def _soft(self, a: ContactPoint, beta: Any, opening: Any) -> ContactPoint:
        """The point with the pressure of its surface, in which springs have no part."""
        if self.contact is None:
            return a
        pull = beta**2 * self.normal * opening
        return self.contact.with_pressure(replace(a, traction=a.traction - pull * a.n))

    def _step(self, a: ContactPoint) -> DamageStep:
        """How the intensity continues from memory."""
        b = self.viscosity
        p = float(self.exponent)
        before = {name: a.kept[f".{name}"] for name in _STEP} if self.order == 2 else None
        grows = None
        if self.recovers:
            grows = ufl.And(ufl.gt(a.kept[".closed"], 0.5), ufl.gt(a.step, 0.0))
        return DamageStep(self.beta, self.work, b, p, a.step, before, grows)

    def _now(self, a: ContactPoint) -> Any:
        """The intensity at a state."""
        return self._step(a).now(self._energy(self._opening(a), self._moved(a)))

    @property
    def _is_new(self) -> Any:
        """Whether a bond that recovers was broken, so that it begins where it is."""
        return ufl.lt(self.beta, self.broken)

    def _origin(self, a: ContactPoint) -> Any:
        """The jump at which springs are at rest along the surface."""
        if not self.recovers:
            return 0.0 * a.n
        return ufl.as_vector([a.kept[name] for name in _ORIGIN.components(a.dim)])

    def _opening(self, a: ContactPoint) -> Any:
        """By which springs are drawn; of a surface that gives way they may be pressed."""
        return -a.u_n if self.compliant else ufl.conditional(ufl.lt(a.u_n, 0.0), -a.u_n, 0.0)

    def _moved(self, a: ContactPoint) -> Any:
        """The tangential jump of the springs."""
        moved = a.u_t + _along(a.before - self._origin(a), a.n)
        return ufl.conditional(self._is_new, 0.0, 1.0) * moved if self.recovers else moved


@dataclass(frozen=True)
class _OfReaction(Coulomb):
    """Friction by the whole normal traction.

    Attributes:
        pressed: what springs add to the pressure.
    """

    pressed: Scalar

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.friction * (p + self.pressed)


def _along(v: Any, n: Any) -> Any:
    return v - ufl.dot(v, n) * n
