# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface at a point: energy, dissipation and their derivatives in UFL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import ufl
from ufl.algorithms import expand_derivatives
from ufl.classes import Variable, Zero
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from dolfinx_contact._ufl import depends_on
from dolfinx_contact.laws.friction import FrictionLaw
from dolfinx_contact.laws.law import ContactPoint, Internal, Law
from dolfinx_contact.laws.symbols import variable

__all__ = ["InterfacePoint", "InterfaceState", "Potentials", "Rates"]


@dataclass(frozen=True)
class InterfaceState:
    """State of an interface in UFL.

    Attributes:
        opening: opening [u_n] >= 0.
        moved: tangential jump [u_t] since the start of the history, a vector.
        n: unit normal, from the body into the obstacle.
        internal: internal variables by name; also available as ``state[name]``.
        pressure: contact pressure p, 0 at open points; available to the dissipation only.
    """

    opening: Any
    moved: Any
    n: Any
    internal: Mapping[str, Any]
    pressure: Any = None

    @property
    def jump(self) -> Any:
        """Jump vector [u]: displacement of the body minus displacement of the obstacle."""
        return self.moved - self.opening * self.n

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]


@dataclass(frozen=True)
class Rates:
    """Rates of the state of an interface in UFL.

    Attributes:
        slip: slip speed |[u_t]'| >= 0.
        internal: rates of the internal variables by name; also available as ``rates[name]``.
    """

    slip: Any
    internal: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]


_FIRST = 5000  # label offset of variables of differentiation
_PER_LEVEL = 100
_POINTS = 4  # number of quadrature points
_SHORTEST = 1e-60
_NO_PACE = 1e-290


class Potentials(Law):
    """Law defined by a surface energy and a dissipation potential (abstract)."""

    def energy(self, state: InterfaceState) -> Any:
        """Return the surface energy per area Psi of a state, in UFL."""
        return 0.0

    def dissipation(self, rates: Rates, state: InterfaceState) -> Any:
        """Return the dissipation potential Phi, UFL power per area.

        Phi is differentiated with respect to the rates only.
        """
        return 0.0

    def cost(self, start: InterfaceState, end: InterfaceState) -> Any:
        """Return the UFL energy per area dissipated by internal variables a between two states.

        If it is None, the derivative dPhi/da' of the dissipation potential is integrated between
        both values of a by the four-point Gauss rule. This is inaccurate if dPhi/da' grows by a
        large factor within a step.
        """
        return None


class InterfacePoint(FrictionLaw):
    """Interface at a point, for given values of its internal variables.

    Contact and friction are evaluated at the contact point `soft`, from which the traction of the
    surface energy has been subtracted.

    Args:
        law: law with its fields at the point.
        a: contact point with jump, traction and data, in UFL.
        opening: opening [u_n].
        values: values of the internal variables, by name.
        start: their values at the last accepted state, by name.
        unknown: internal variables to be solved for.
        is_open: whether the point is open; None if not yet determined.
        level: index that distinguishes the differentiation variables of nested points. It is larger
            by one than the level of the points from which ``values`` were computed.
    """

    def __init__(
        self,
        law: Potentials,
        a: ContactPoint,
        opening: Any,
        values: Mapping[str, Any],
        start: Mapping[str, Any],
        unknown: Sequence[Internal],
        is_open: bool | None,
        level: int,
    ):
        self._law = law
        self._a = a
        self.needs_pressure = law.needs_pressure
        self.start = dict(start)
        self.unknown = list(unknown)
        self._is_open = is_open
        self._level = level
        self._signs = {x.name: x.sense for x in law.internal}
        n = a.n
        moved = a.u_t + a.before - ufl.dot(a.before, n) * n
        self._moves = [name for name, v in values.items() if v is not start[name]]
        self._opening, self._moved, *mine = self._variables([opening, moved, *values.values()])
        self.values = dict(zip(values, mine, strict=True))
        #: The pressure is available to the dissipation only (`_potential`).
        self.state = InterfaceState(self._opening, self._moved, n, self.values)
        self.energy = ufl.as_ufl(law.energy(self.state))
        # Without time (negative step) all rates are set to nearly zero, because the square root in
        # the speed is not differentiable at 0. In a step of zero length nothing changes.
        time = ufl.conditional(ufl.gt(a.step, _SHORTEST), a.step, _SHORTEST)
        self._pace = ufl.conditional(ufl.ge(a.step, 0.0), 1.0 / time, _NO_PACE)

    def _variables(self, expressions: Sequence[Any], first: int = 0) -> list[Any]:
        """Return the expressions as UFL variables, by which one can differentiate."""
        first += _FIRST + _PER_LEVEL * self._level
        return [variable(e, first + i) for i, e in enumerate(expressions)]

    # -- the energy ------------------------------------------------------------------------------

    @cached_property
    def _pull(self) -> Any:
        """Normal traction: derivative of the surface energy with respect to the opening."""
        return _slope(self.energy, self._opening)

    @cached_property
    def _along(self) -> Any:
        """Derivative dPsi/d[u_t] of the surface energy, a tangential traction."""
        g = _slope(self.energy, self._moved)
        n = self._a.n
        return g - ufl.dot(g, n) * n

    @property
    def traction(self) -> Any:
        """Traction on the body derived from the surface energy."""
        return self._pull * self._a.n - self._along

    def scale(self, name: str) -> Any:
        """Return the factor that converts the driving force of a variable to a traction."""
        law = self._law
        a = self._a
        zero = self._a.n * 0.0
        rest = InterfacePoint(
            law, a, ufl.as_ufl(0.0), self.start, self.start, [], True, self._level
        )
        closed, at_rest = self._variables([ufl.as_ufl(0.0), zero])
        still = InterfaceState(closed, at_rest, a.n, rest.values)
        force = _slope(ufl.as_ufl(law.energy(still)), rest.values[name])
        own = _slope(self.energy, self.values[name])
        level = abs(self._slopes[name]) + abs(force) + abs(own - force)
        return ufl.conditional(ufl.gt(level, 0.0), ufl.sqrt(a.r / level), 0.0)

    # -- the dissipation -------------------------------------------------------------------------

    @property
    def speed(self) -> Any:
        """Slip speed, the norm of the rate of the tangential jump."""
        square = ufl.dot(self._a.u_t, self._a.u_t)
        return ufl.conditional(ufl.gt(square, 0.0), ufl.sqrt(square), 0.0) * self._pace

    @cached_property
    def pressure(self) -> Any:
        if self._is_open:
            return ufl.as_ufl(0.0)
        p = self.soft.p
        return p if self._is_open is False else _positive(p)

    def _potential(
        self, pressure: Any, speed: Any, share: float = 1.0
    ) -> tuple[Any, dict[str, Any]]:
        """Return the dissipation potential and its rates by name ("" for the slip speed).

        The internal variables are evaluated after the fraction ``share`` of the step.
        """
        inner = self.values
        if share < 1.0:
            inner = {k: (1.0 - share) * self.start[k] + share * v for k, v in inner.items()}
        state = replace(self.state, internal=inner, pressure=pressure)
        known = {
            name: (v - self.start[name]) * self._pace if name in self._moves else v * 0.0
            for name, v in self.values.items()
        }
        slip, *mine = self._variables([speed, *known.values()], 50)
        by = dict(zip(known, mine, strict=True))
        phi = ufl.as_ufl(self._law.dissipation(Rates(slip, by), state))
        signed = _Signed({slip: 1} | {by[name]: s for name, s in self._signs.items() if s})
        return map_expr_dag(signed, phi), {"": slip} | by

    @cached_property
    def _slopes(self) -> dict[str, Any]:
        """Resistances dPhi/da' to changes of the internal variables a, by name of the variable."""
        phi, rates = self._potential(self.pressure, self._own_speed)
        return {name: _slope(phi, rate) for name, rate in rates.items() if name}

    @property
    def spent(self) -> Any:
        """Energy per area dissipated by the internal variables a in the step.

        The integral of dPhi/da'(a) . da between their two values, with the dissipation potential
        Phi, is computed by the Gauss rule unless the law defines `cost`.
        """
        known = self._law.cost(replace(self.state, internal=self.start), self.state)
        if known is not None:
            return known
        found: Any = ufl.as_ufl(0.0)
        for at, weight in zip(*np.polynomial.legendre.leggauss(_POINTS), strict=True):
            share = 0.5 + 0.5 * float(at)
            phi, rates = self._potential(self.pressure, self._own_speed, share)
            for name in self._moves:
                moved = self.values[name] - self.start[name]
                lost = ufl.inner(_slope(phi, rates[name]), moved)
                # The resistance of a variable may be infinite at its end.
                some = ufl.ne(ufl.inner(moved, moved), 0.0)
                found += 0.5 * float(weight) * ufl.conditional(some, lost, 0.0)
        return found

    @property
    def _own_speed(self) -> Any:
        """Slip speed on which the dissipation depends; 0 at an open point without friction."""
        return ufl.as_ufl(0.0) if self._is_open and self.needs_pressure else self.speed

    def driven(self, name: str) -> Any:
        """Return the residual dPsi/da + dPhi/da' of a variable a, zero while a changes."""
        return _slope(self.energy, self.values[name]) + self._slopes[name]

    def determines(self, name: str) -> bool:
        """Return whether the residual `driven` of a variable depends on any of the unknowns."""
        force = self.driven(name)
        return not all(isinstance(_slope(force, self.values[x.name]), Zero) for x in self.unknown)

    def resistance(self, pressure: Any, speed: Any) -> Any:
        """Return the friction disc radius: the slip-speed derivative of the dissipation."""
        phi, rates = self._potential(ufl.as_ufl(pressure), ufl.as_ufl(speed))
        return _slope(phi, rates[""])

    @property
    def knows_speed(self) -> bool:
        """Whether the dissipation potential is not 1-homogeneous in the rates."""
        phi, rates = self._potential(self.pressure, self.speed)
        pairs = ((v, w) for v in rates.values() for w in rates.values())
        return any(depends_on(_slope(phi, v), w) for v, w in pairs)

    # -- contact and friction --------------------------------------------------------------------

    @cached_property
    def soft(self) -> ContactPoint:
        """Contact point to which Signorini's conditions and friction apply.

        The traction of the surface energy is subtracted. Its stiffness is added to the
        augmentation, so that for any stiffness pressure and shear decrease when the body moves
        away.
        """
        a = self._a
        pull = self._pull
        if self._is_open:
            pull = pull + _positive(_slope(self._pull, self._opening)) * a.u_n
        H = _slope(_slope(self.energy, self._moved), self._moved)
        n = a.n
        spring = _positive((ufl.tr(H) - ufl.dot(n, ufl.dot(H, n))) / (a.dim - 1))
        return replace(a, traction=a.traction - pull * n, shear=a.s + self._along - spring * a.u_t)

    @cached_property
    def _viscous(self) -> bool:
        """Whether the radius of the friction disc depends on the slip speed."""
        phi, rates = self._potential(ufl.as_ufl(1.0), self.speed)
        return depends_on(_slope(phi, rates[""]), rates[""])

    def _pressing(self, p: Any) -> Any:
        """Return the pressure ``p``, replaced by zero at an open point with friction."""
        return ufl.as_ufl(0.0) if self._is_open and not self.needs_pressure else p

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.resistance(self._pressing(p), self.speed)

    def disc(self, a: ContactPoint, slid: Any) -> Any:
        return self.resistance(self._pressing(a.p), slid * self._pace)

    def grips(self, a: ContactPoint) -> Any:
        if self._viscous:
            return None
        return ufl.gt(self.resistance(self._pressing(1.0), ufl.as_ufl(0.0)), 0.0)


class _Signed(MultiFunction):  # type: ignore[misc]
    """UFL transformation replacing |x|, not differentiable at 0, by x or -x for a known sign."""

    def __init__(self, signs: Mapping[Any, int]):
        super().__init__()
        self._signs = signs

    def expr(self, o: Any, *operands: Any) -> Any:
        return self.reuse_if_untouched(o, *operands)

    def abs(self, o: Any, operand: Any) -> Any:
        sign = self._signs.get(operand)
        return self.reuse_if_untouched(o, operand) if sign is None else sign * operand


def _slope(e: Any, by: Variable) -> Any:
    return expand_derivatives(ufl.diff(e, by))


def _positive(e: Any) -> Any:
    return e if isinstance(e, Zero) else ufl.conditional(ufl.gt(e, 0.0), e, 0.0)
