# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Laws that wrap a friction law: compliant surfaces, and regularised friction.

- *Normal compliance*: the pressure p = C (u_n)_+^m of a spring, with the penetration (u_n)_+ (Oden
  and Martins, CMAME 52, 1985, section 2); m = 1 is the penalisation of Signorini's conditions.
- *Regularised friction*: the shear increases continuously with the slip, t_t = -b phi(|u_t|/eps)
  u_t/|u_t|, with the radius b of the friction disc. The traction is then a function of the
  displacement. In a history friction opposes the slip velocity: in a step dt with the increment
  du_t, u_t is replaced by du_t/dt, and eps is a velocity (implicit Euler). Under a shear below the
  bound, q = |t_t|/b < 1, a point creeps with the velocity eps phi^-1(q), whereas it sticks under
  Coulomb's law.

Both laws deviate from Signorini's and Coulomb's conditions and are meant for comparisons.

For m = 1 the pressure is expressed by the augmented traction q = p + r u_n as p = C/(C + r) q_+.
This is equivalent to p = C (u_n)_+ with the same statuses, and for increasing C Newton's method
approaches Newton's method for Signorini's conditions. Other pressures and shears are functions of
the displacement only. If the regularisation width is far below the displacements, Newton's method
fails from a zero initial guess. Then decrease the width step by step, or trace it as a parameter
(`ParametricContact`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

import ufl

from dolfinx_contact._validate import is_number, one_of
from dolfinx_contact.laws.friction import FrictionLaw, Frictionless
from dolfinx_contact.laws.law import (
    Border,
    ContactPoint,
    Scalar,
    Sign,
    StatusPiece,
    constant_law,
)
from dolfinx_contact.laws.status import MINUS, PLUS, STICK

__all__ = ["NormalCompliance", "Regularised"]

_TINY = 1e-100
_SATURATED = 20.0  # slip/eps beyond which tanh is 1 to round-off, and its derivative overflows
_SERIES = 1e-6  # (slip/eps)^2 below which a series replaces a quotient


class _AroundFriction(FrictionLaw):
    """Law wrapping another friction law, `friction`; its name contains its first option."""

    friction: FrictionLaw
    bound_kind = None

    @property
    def name(self) -> str:
        return f"{type(self).__name__}({getattr(self, self.options[0])}) of {self.friction.name}"

    @property
    def needs_pressure(self) -> bool:  # type: ignore[override]
        return self.friction.needs_pressure

    @property
    def needs_time(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(f"friction.{name}" for name in self.friction.needs_time)

    @property
    def creeps(self) -> bool:  # type: ignore[override]
        return self.friction.creeps

    @property
    def averaging(self) -> float | None:  # type: ignore[override]
        return self.friction.averaging

    def lacks(self, *, history: bool) -> str:
        return self.friction.lacks(history=history)

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.friction.bound(a, p)


@constant_law
@dataclass(frozen=True)
class NormalCompliance(_AroundFriction):
    """Compliant surface, optionally with friction.

    The pressure is p = C (u_n)_+^m, where (u_n)_+ is the penetration. Closed points penetrate, so
    that the gap ``un`` in tables is negative. The indicator ``penetration`` of the surface
    (`Result.indicators`) is the largest depth; a warning is logged above a tenth of the facet size.

    Attributes:
        stiffness: coefficient C > 0, in units of traction per length to the power m; a number, a
            Constant, a Function or a UFL expression.
        exponent: exponent m >= 1, a number.
        friction: friction law evaluated at this pressure; default: frictionless.

    Raises:
        ValueError: if the exponent is below 1, or if ``friction`` is not a friction law.
    """

    stiffness: Scalar
    exponent: float = 1.0
    friction: FrictionLaw = field(default_factory=Frictionless)
    options = ("exponent",)
    compliant = True
    signs: ClassVar[Mapping[str, Sign]] = {"stiffness": "positive"}

    def __post_init__(self) -> None:
        m = self.exponent
        if not (is_number(m) and 1 <= m < np.inf):
            raise ValueError(f"the exponent of NormalCompliance must be at least 1, got {m!r}")
        object.__setattr__(self, "exponent", float(m))
        if not isinstance(self.friction, FrictionLaw) or self.friction.compliant:
            raise ValueError(
                "friction of NormalCompliance must be a friction law such as Coulomb(0.3), got "
                f"{self.friction!r}"
            )
        super().__post_init__()

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        return self.friction.pieces(self.with_pressure(a))

    def with_pressure(self, a: ContactPoint) -> ContactPoint:
        """Return the contact point with the pressure of the springs."""
        C = self.stiffness
        m = self.exponent
        if m == 1:
            return replace(a, pressure=C / (C + a.r) * a.p)
        size = ufl.conditional(ufl.ge(a.u_n, 0.0), a.u_n, -a.u_n)
        # The slope of u |u|^(m - 1) must vanish at zero.
        power = ufl.conditional(ufl.gt(size, _TINY), size, _TINY) ** (m - 1.0)
        return replace(a, pressure=C * a.u_n * power, touches=a.r * a.u_n)


@constant_law
@dataclass(frozen=True)
class Regularised(_AroundFriction):
    """Regularised friction: the shear b phi(x) increases with the scaled slip x.

    With the tangential displacement u_t, the scaled slip is x = |u_t|/eps in a static problem and
    |du_t|/(eps dt) in a step of duration dt of a history. A point with x < 1 counts as stuck
    although it creeps. A static problem requires ``width``, a history requires ``speed``, and a
    history that begins with a static solve requires both.

    Attributes:
        friction: friction law to regularise, with the radius b of its friction disc.
        width: length eps > 0 of the static law; a number, a Constant, a Function or a UFL
            expression.
        shape: name of the function phi: ``"tanh"``, tanh(x); ``"sqrt"``, x/sqrt(1 + x^2), the
            derivative of sqrt(|u_t|^2 + eps^2); ``"polynomial"``, (3 x - x^3)/2 up to x = 1, then
            1; ``"linear"``, x up to 1, then 1.
        speed: velocity eps > 0 of a history; same types as ``width``.

    Raises:
        ValueError: for an unknown shape, if neither ``width`` nor ``speed`` is given, or if
            ``friction`` is not a friction law.
    """

    friction: FrictionLaw
    width: Scalar | None = None
    shape: str = "tanh"
    speed: Scalar | None = None
    options = ("shape",)
    creeps = True
    signs: ClassVar[Mapping[str, Sign]] = {"width": "positive", "speed": "positive"}

    def __post_init__(self) -> None:
        one_of(self.shape, "the shape of Regularised", _SHAPES)
        if self.width is None and self.speed is None:
            raise ValueError("Regularised needs a width, or a speed, or both")
        if not isinstance(self.friction, FrictionLaw) or self.friction.bound_kind is None:
            raise ValueError(
                "friction of Regularised must be a friction law such as Coulomb(0.3), got "
                f"{self.friction!r}; use NormalCompliance(..., friction=Regularised(...))"
            )
        super().__post_init__()

    def lacks(self, *, history: bool) -> str:
        if history and self.speed is None:
            return "a speed: the width is a slip of the static law; Regularised(..., speed=...)"
        if not history and self.width is None:
            return "a width, as it has no velocities: Regularised(..., width=...)"
        return ""

    @property
    def needs_time(self) -> tuple[str, ...]:  # type: ignore[override]
        scales = (name for name in ("width", "speed") if getattr(self, name) is not None)
        return (*scales, *super().needs_time)

    def _eps(self, a: ContactPoint) -> Any:
        """Return the slip of the step at which the scaled slip is 1."""
        if self.speed is None:
            return self.width
        timed = ufl.gt(a.step, 0.0)
        if self.width is None:  # arbitrary value outside a step
            return self.speed * ufl.conditional(timed, a.step, 1.0)
        return ufl.conditional(timed, self.speed * a.step, self.width)

    def shears(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        u = a.u_t
        eps = self._eps(a)
        y = ufl.dot(u, u) / eps**2
        size = eps * _root(y)
        b = self.bound(replace(a, slid=a.slid_before + size), a.p)
        over_x = _SHAPES[self.shape]
        if over_x is None:  # tangential springs
            return self.friction.shears(replace(a, shear=b / (b + a.r * eps) * a.s))
        creeps, slips = (-b * k / eps * u for k in over_x(y))
        if a.dim == 3:
            return {
                STICK: StatusPiece(creeps, [Border(a.r * (eps - size), PLUS)]),
                PLUS: StatusPiece(slips, [Border(a.r * (size - eps), STICK)]),
            }
        along = ufl.dot(u, a.t)
        return {
            STICK: StatusPiece(
                creeps,
                [Border(a.r * (eps + along), MINUS), Border(a.r * (eps - along), PLUS)],
            ),
            MINUS: StatusPiece(slips, [Border(a.r * (-along - eps), STICK)]),
            PLUS: StatusPiece(slips, [Border(a.r * (along - eps), STICK)]),
        }

    def entered(self, a: ContactPoint) -> Mapping[int, Any]:
        eps = self._eps(a)
        y = ufl.dot(a.u_t, a.u_t) / eps**2
        if a.dim == 3:
            return {STICK: ufl.le(y, 1.0), PLUS: ufl.gt(y, 1.0)}
        along = ufl.dot(a.u_t, a.t) / eps
        return {
            STICK: ufl.le(y, 1.0),
            PLUS: ufl.gt(along, 1.0),
            MINUS: ufl.lt(along, -1.0),
        }


def _root(y: Any) -> Any:
    """Return the square root of y, smoothed near zero, where its derivative is unbounded."""
    return ufl.sqrt(ufl.conditional(ufl.gt(y, _SERIES), y, _SERIES))


# phi(x)/x as a function of y = x^2, below and above x = 1.


def _tanh(y: Any) -> tuple[Any, Any]:
    x = _root(y)
    x_ = ufl.conditional(ufl.lt(x, _SATURATED), x, _SATURATED)
    series = 1.0 - y / 3.0 + 2.0 * y**2 / 15.0
    both = ufl.conditional(ufl.gt(y, _SERIES), ufl.tanh(x_) / x, series)
    return both, both


def _sqrt(y: Any) -> tuple[Any, Any]:
    return (1.0 / ufl.sqrt(1.0 + y),) * 2


def _polynomial(y: Any) -> tuple[Any, Any]:
    return (3.0 - y) / 2.0, 1.0 / _root(y)


_SHAPES = {"tanh": _tanh, "sqrt": _sqrt, "polynomial": _polynomial, "linear": None}
