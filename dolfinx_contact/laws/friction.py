# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Unilateral contact with friction, defined by a friction bound.

A friction law is defined by the radius b of its friction disc (interval in 2D) as a function of the
contact pressure. With the normal n, the augmented pressure p and the augmented shear s, the
traction is -max(p, 0) n plus the projection of s onto the disc. The module writes this law status
by status.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeAlias

import ufl

from dolfinx_contact.laws.law import (
    Border,
    BoundKind,
    ContactPoint,
    Law,
    Scalar,
    Sign,
    StatusPiece,
    constant_law,
)
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN

__all__ = ["Coulomb", "FrictionLaw", "Frictionless", "Tresca"]

_ROUND_OFF = 1e-9  # ratio of the augmented pressure to r, a length

#: Function from the slip distance to the radius of the friction disc at the augmented pressure.
Radius: TypeAlias = Callable[[Any], Any]


class FrictionLaw(Law):
    """Unilateral contact with isotropic friction; subclasses define `bound`."""

    bound_kind: BoundKind | None = "other"

    def bound(self, a: ContactPoint, p: Any) -> Any:
        """Return the radius of the friction disc at the pressure ``p`` as a UFL scalar.

        Args:
            a: contact point; the radius may depend on its slip distance ``a.slid``.
            p: pressure, positive in contact. If friction also acts on open points
                (``needs_pressure = False``), ``p`` may be negative there, and the radius must not
                depend on it.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method bound(a, p)")

    def grips(self, a: ContactPoint) -> Any | None:
        """Return the UFL condition under which friction acts; default: None (always).

        The condition depends only on fields of the law, such as a positive friction coefficient.
        """
        return None

    def holds(self, a: ContactPoint) -> Any | None:
        """Return the UFL condition under which a point can stick; default: `grips`.

        The condition may depend on the averaged pressure: no point sticks where it vanishes.
        """
        return self.grips(a)

    def shears(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        """Return the shear traction and the borders of closed points, by status code."""
        in_ = _in_plane if a.dim == 2 else _in_space
        return in_(a, partial(self.disc, a), self.grips(a), self.holds(a))

    def disc(self, a: ContactPoint, slid: Any) -> Any:
        """Return the UFL friction-disc radius after a step with the slip distance ``slid``."""
        return self.bound(replace(a, slid=a.slid_before + slid), a.p)

    def entered(self, a: ContactPoint) -> Mapping[int, Any]:
        """Return UFL conditions of the statuses that an open point may have after closing.

        The condition None means that the status is always possible.
        """
        if a.dim == 3:
            return {PLUS: None}
        # The point slips against its displacement.
        grips = self.grips(a)
        back = ufl.gt(ufl.dot(a.s, a.t), 0.0)
        back = back if grips is None else ufl.And(back, grips)
        return {PLUS: ufl.Not(back), MINUS: back}

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        nothing = 0.0 * a.n
        if isinstance(ufl.as_ufl(self.bound(a, a.p)), ufl.constantvalue.Zero):
            return {
                OPEN: StatusPiece(nothing, [Border(-a.touch, PLUS)]),
                PLUS: StatusPiece(-a.p * a.n, [Border(a.touch, OPEN)]),
            }
        friction = self.shears(a)
        pieces = {}
        if self.needs_pressure:
            closing = [Border(-a.touch, code, where) for code, where in self.entered(a).items()]
            pieces[OPEN] = StatusPiece(nothing, closing)
        else:
            for code, piece in friction.items():
                borders = [Border(d, k + WHERE_OPEN, where) for d, k, where in piece.borders]
                borders.insert(0, Border(-a.touch, code))
                pieces[code + WHERE_OPEN] = StatusPiece(piece.answer, borders, piece.exists)
        for code, piece in friction.items():
            opens = Border(a.touch, OPEN if self.needs_pressure else code + WHERE_OPEN)
            answer = -a.p * a.n + piece.answer
            pieces[code] = StatusPiece(answer, [opens, *piece.borders], piece.exists)
        return pieces


class _Slip:
    """Friction disc and border of slip, where a negative slip distance counts as 0.

    Thus stick and slip have one common border for every jump and traction, and friction always
    opposes the slip. The radius is extended smoothly to slip distances that are negative by
    round-off.
    """

    def __init__(self, a: ContactPoint, radius: Radius, slid: Any):
        least = -_ROUND_OFF * a.p / a.r
        self._forward = ufl.ge(slid, least)
        self._back = a.r * slid
        self.radius = radius(ufl.conditional(self._forward, slid, least))
        self._knows = radius(slid) != radius(2.0 * slid)

    def border(self, excess: Any) -> Any:
        """Return the distance to the border of slip; ``excess`` is shear minus disc radius."""
        return ufl.conditional(self._forward, excess, self._back) if self._knows else excess


def _in_plane(a: ContactPoint, radius: Radius, grips: Any, holds: Any) -> dict[int, StatusPiece]:
    """Return the shear traction and the borders of closed points in 2D, by status code.

    Slip with u_t.t > 0 has s.t < 0 for the unit tangent t and the augmented shear s. Friction acts
    under the UFL condition ``grips``, and stick is possible under ``holds``.
    """
    s = ufl.dot(a.s, a.t)
    u = ufl.dot(a.u_t, a.t)
    right = _Slip(a, radius, u)
    left = _Slip(a, radius, -u)
    b = right.radius
    c = left.radius
    return {
        STICK: StatusPiece(s * a.t, [Border(c - s, MINUS), Border(b + s, PLUS)], holds),
        MINUS: StatusPiece(c * a.t, [Border(left.border(s - c), STICK)], grips),
        PLUS: StatusPiece(-b * a.t, [Border(right.border(-s - b), STICK, grips)]),
    }


def _in_space(a: ContactPoint, radius: Radius, grips: Any, holds: Any) -> dict[int, StatusPiece]:
    """Return shear traction and borders of closed points in 3D by status code (`_in_plane`)."""
    size = ufl.sqrt(ufl.dot(a.s, a.s))
    along = ufl.conditional(ufl.gt(size, 0.0), -ufl.dot(a.u_t, a.s) / size, 0.0)
    slip = _Slip(a, radius, along)
    b = slip.radius
    moves = ufl.gt(size, 0.0)
    slides = ufl.as_vector([ufl.conditional(moves, b * a.s[i] / size, 0.0) for i in range(3)])
    return {
        STICK: StatusPiece(a.s, [Border(b - size, PLUS)], holds),
        PLUS: StatusPiece(slides, [Border(slip.border(size - b), STICK, grips)]),
    }


@dataclass(frozen=True)
class Frictionless(FrictionLaw):
    """Frictionless unilateral contact (Signorini): the tangential traction is zero."""

    bound_kind = "proportional"

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return 0.0 * p


@constant_law
@dataclass(frozen=True)
class Coulomb(FrictionLaw):
    """Coulomb friction: the shear is at most F times the pressure.

    A contact surface converts numbers of its law to Constants: after ``surface =
    ContactSurface(..., law=Coulomb(0.3))``, ``surface.law.friction.value = 0.5`` changes the
    coefficient between two solves.

    Attributes:
        friction: friction coefficient F >= 0, a number, a Constant, a Function or a UFL expression.

    Raises:
        ValueError: if the coefficient is not a scalar, or a negative or infinite number.
    """

    friction: Scalar
    signs: ClassVar[Mapping[str, Sign]] = {"friction": "nonnegative"}
    bound_kind = "proportional"

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.friction * p

    def grips(self, a: ContactPoint) -> Any:
        return ufl.gt(self.friction, 0.0)


@constant_law
@dataclass(frozen=True)
class Tresca(FrictionLaw):
    """Tresca friction: the shear is at most a prescribed bound g, on the whole surface.

    As in the mathematical literature, friction also acts on open parts of the surface. To avoid
    friction there, multiply the bound by a field that vanishes there.

    Attributes:
        threshold: friction bound g >= 0, a traction; same types as `Coulomb.friction`.

    Raises:
        ValueError: if the bound is not a scalar, or a negative or infinite number.
    """

    threshold: Scalar
    needs_pressure = False
    signs: ClassVar[Mapping[str, Sign]] = {"threshold": "nonnegative"}
    bound_kind = "given"

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.threshold

    def grips(self, a: ContactPoint) -> Any:
        return ufl.gt(self.threshold, 0.0)
