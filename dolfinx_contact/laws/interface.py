# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Interfaces defined by a surface energy and a dissipation potential.

The framework of generalised standard materials (Halphen and Nguyen, J. Mec. 14, 1975) was extended
to interfaces by Del Piero and Raous (Eur. J. Mech. A/Solids 29, 2010). The state consists of the
jump, split into opening [u_n] >= 0 and tangential jump [u_t], and of internal variables a. The
surface energy is Psi([u_n], [u_t], a). The dissipation potential Phi(|[u_t]'|, a'; state, chi) is
convex in the rates, with the minimum 0 at zero rates. The forces on the body have a normal
component R_n and a tangential part R_t, whose irreversible (frictional) part is R_t^ir. The laws of
state and evolution are

    R_n = dPsi/d[u_n] - p,   0 <= p, [u_n] >= 0, p [u_n] = 0,       R_t = dPsi/d[u_t] + R_t^ir,
    R_t^ir in dPhi/d[u_t]',        -dPsi/da in dPhi/da'.

chi denotes the normal data on which the dissipation may depend: pressure p and opening. Phi
describes isotropic friction: it depends on the slip speed |[u_t]'| >= 0, and its derivative at zero
speed is the friction bound.

A time step of duration dt from the internal variables a_n uses the implicit Euler method,

    dPsi/da(a) + dPhi/da'((a - a_n)/dt) = 0,

which is solved point by point (`roots`). A monotone variable remains constant while its driving
force -dPsi/da is below the threshold dPhi/da'(0); otherwise it changes until it reaches its final
value. These cases are part of the status (`status.DAMAGING`, `status.BROKEN`). In a static problem
all rates are zero, and only the rate-independent part of the dissipation remains.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import ufl

from dolfinx_contact.laws.interface_point import InterfacePoint, InterfaceState, Potentials, Rates
from dolfinx_contact.laws.law import (
    Bond,
    Border,
    ContactPoint,
    Equations,
    StatusPiece,
)
from dolfinx_contact.laws.status import BROKEN, DAMAGING, OPEN, PLUS, WHERE_OPEN

__all__ = ["Interface", "InterfaceState", "Rates"]


class Interface(Potentials):
    """Contact law defined by an energy and a dissipation potential (abstract).

    A subclass is a frozen dataclass with the parameters as fields (`Law`). Fields listed in
    `internal` are internal variables: they contain initial values at the start, and later the
    values at the last accepted state. With ``needs_pressure = False`` friction also acts at open
    points. If the dissipation is not 1-homogeneous in the rates, results depend on time, and
    ``needs_time`` must list the fields, such as viscosities, that vanish in the rate-independent
    case. In a static problem all rates are zero: friction is evaluated at zero speed, without
    viscous resistance.

    Example:
        A bond with linear softening in the opening, without healing::

            @dataclass(frozen=True)
            class Cohesive(Interface):
                stiffness: Scalar
                elastic: Scalar  # opening at the onset of softening
                last: Scalar  # opening at failure
                damage: Scalar = 0.0
                internal = (Internal("damage", "grows", end=1.0),)

                def energy(self, state):
                    squares = state.opening**2 + ufl.dot(state.moved, state.moved)
                    return (1 - state["damage"]) * self.stiffness / 2 * squares

                def dissipation(self, rates, state):
                    a, b = self.elastic, self.last
                    reached = a * b / (b - state["damage"] * (b - a))
                    return self.stiffness / 2 * reached**2 * rates["damage"]
    """

    def broken(self, state: InterfaceState) -> Any:
        """Return the UFL condition for a broken interface.

        By default, its monotone variable has reached the final value; None if there is no such
        value.
        """
        x = self.weakening
        if x is None or x.end is None:
            return None
        return ufl.le(x.sense * (x.end - state[x.name]), 0.0)

    def unknowns(self, dim: int) -> Mapping[tuple[bool, int], int]:
        if sum(x.change != "any" for x in self.internal) > 1:
            raise ValueError(f"{self.name}: only one variable may be monotone")
        smooth = sum(dim if x.vector else 1 for x in self.internal if x is not self.weakening)
        sizes = {f: smooth + (f == DAMAGING) for f in self._families}
        return {(o, f): n for o in (True, False) for f, n in sizes.items() if n}

    def equations(self, a: ContactPoint) -> Mapping[Hashable, Equations]:
        self._check_time(a)
        found = dict[Hashable, Equations]()
        x = self.weakening
        for is_open, family in self.unknowns(a.dim):
            side = self._side(a, is_open, family, level=0)
            start = [s for v in side.unknown for s in _scalars(side.start[v.name])]
            residual = [f for v in side.unknown for f in _scalars(side.driven(v.name))]
            for v in side.unknown:
                if v is not x and not side.determines(v.name):
                    raise ValueError(
                        f"nothing determines {v.name} of {self.name}: the energy must be nonlinear "
                        "in a variable, or the dissipation nonlinear in its rate"
                    )
            bounds = (x.sense, x.end) if x is not None and x in side.unknown else ()
            found[is_open, family] = Equations(residual, start, *bounds)
        return found

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        found: dict[int, StatusPiece] = {}
        for is_open in (True, False):
            sides = {f: self._side(a, is_open, f) for f in self._families}
            for family, side in sides.items():
                for code, piece in side.pieces(side.soft).items():
                    if (code == OPEN or code > WHERE_OPEN) != is_open:
                        continue
                    borders = [Border(d, k + family, where) for d, k, where in piece.borders]
                    borders += self._outgoing(sides, family, code)
                    exists = _both(piece.exists, None if family == BROKEN else self._can_change)
                    answer = piece.answer + side.traction
                    found[code + family] = StatusPiece(answer, borders, exists)
        return dict(sorted(found.items()))

    def bound(self, a: ContactPoint, p: Any) -> Any:
        now = self._now(a)
        return now.resistance(p, now.speed)

    def with_pressure(self, a: ContactPoint) -> ContactPoint:
        return replace(a, pressure=self._now(a).pressure)

    def bond(self, a: ContactPoint) -> Bond | None:
        if not self.internal and type(self).energy is Potentials.energy:
            return None
        now = self._now(a)
        after = dict[str, Any]()
        for x in self.internal:
            after |= dict(zip(x.components(a.dim), _scalars(now.values[x.name]), strict=True))
        broken = self.broken(now.state)
        counts = 0.0 if broken is None else ufl.conditional(broken, 1.0, 0.0)
        return Bond(after, now.traction, now.energy, now.spent, counts)

    # -- its variables ---------------------------------------------------------------------------

    @property
    def _families(self) -> list[int]:
        x = self.weakening
        if x is None:
            return [OPEN]
        return [OPEN, DAMAGING] if x.end is None else [OPEN, DAMAGING, BROKEN]

    def _check_time(self, a: ContactPoint) -> None:
        """Raise `ValueError` if friction depends on speed although all ``needs_time`` are 0."""
        still = self.having(dict.fromkeys(self.needs_time, ufl.as_ufl(0.0)))
        if still._side(a, False, self._families[-1], level=0).knows_speed:
            raise ValueError(
                f"the dissipation of {self.name} must be 1-homogeneous in the rates unless "
                "needs_time lists the viscosities, the fields that make it rate-dependent"
            )

    # -- at a point ------------------------------------------------------------------------------

    def _side(self, a: ContactPoint, is_open: bool, family: int, level: int = 1) -> InterfacePoint:
        """Return the interface at a point; ``family`` is OPEN (unchanged), DAMAGING or BROKEN."""
        start = self._starts(a)
        unknown = []
        values = dict[str, Any]()
        x = self.weakening
        for v in (*([] if x is None else [x]), *(v for v in self.internal if v is not x)):
            if v is x and family != DAMAGING:
                # Not a constant: UFL would immediately evaluate quotients of such expressions.
                last = ufl.conditional(ufl.gt(a.r, 0.0), float(v.end or 0.0), start[v.name])
                values[v.name] = start[v.name] if family == OPEN else last
            else:
                unknown.append(v)
        numbers = iter(a.solved.get((is_open, family), ()))
        for v in unknown:
            mine = [next(numbers) for _ in range(a.dim if v.vector else 1)]
            values[v.name] = ufl.as_vector(mine) if v.vector else mine[0]
        opening = -a.u_n if is_open else ufl.as_ufl(0.0)
        return InterfacePoint(self, a, opening, values, start, unknown, is_open, level)

    def _starts(self, a: ContactPoint) -> dict[str, Any]:
        """Return the internal variables at the last accepted state, by name."""
        return {
            x.name: ufl.as_vector([a.kept[name] for name in x.components(a.dim)])
            if x.vector
            else ufl.as_ufl(getattr(self, x.name))
            for x in self.internal
        }

    def _now(self, a: ContactPoint) -> InterfacePoint:
        """Return the interface at the current state, with its energy and dissipation."""
        is_open = ufl.lt(a.u_n, 0.0)
        known = [self._values(a, side) for side in (True, False)]
        values = {x.name: _chosen(is_open, *(k[x.name] for k in known)) for x in self.internal}
        opening = ufl.conditional(is_open, -a.u_n, 0.0)
        return InterfacePoint(self, a, opening, values, self._starts(a), [], None, 2)

    def _values(self, a: ContactPoint, is_open: bool) -> dict[str, Any]:
        """Return the current internal variables of an open or closed point, by name."""
        sides = {f: self._side(a, is_open, f) for f in self._families}
        x = self.weakening
        if x is None:
            return sides[OPEN].values
        moves = _both(ufl.lt(self._slack(sides[OPEN]), 0.0), self._can_change)
        found = sides[DAMAGING].values
        if x.end is not None:
            ends = ufl.lt(self._slack(sides[BROKEN]), 0.0)
            last = sides[BROKEN].values
            found = {name: _chosen(ends, last[name], v) for name, v in found.items()}
        return {name: _chosen(moves, v, sides[OPEN].values[name]) for name, v in found.items()}

    # -- statuses of the monotone variable -------------------------------------------------------

    @property
    def _can_change(self) -> Any:
        """UFL condition that the monotone variable has not reached its final value, or None.

        None means that there is no monotone variable with a final value.
        """
        x = self.weakening
        if x is None or x.end is None:
            return None
        return ufl.gt(x.sense * (x.end - getattr(self, x.name)), 0.0)

    def _slack(self, side: InterfacePoint) -> Any:
        """Return the slack of the monotone variable: its threshold minus its driving force."""
        x = self.weakening
        assert x is not None
        return x.sense * side.driven(x.name)

    def _outgoing(
        self, sides: Mapping[int, InterfacePoint], family: int, code: int
    ) -> list[Border]:
        """Return the borders at which the state of the bond, ``family``, changes."""
        x = self.weakening
        if x is None:
            return []
        # family beyond the border, distance to the border, and condition
        scale = sides[OPEN].scale(x.name)
        can = self._can_change
        rests = scale * self._slack(sides[OPEN])
        ways = {OPEN: [(DAMAGING, rests, can)], DAMAGING: [(OPEN, -rests, None)]}
        if x.end is not None:
            goes = scale * self._slack(sides[BROKEN])
            ways[DAMAGING].append((BROKEN, goes, None))
            ways[BROKEN] = [(DAMAGING, -goes, can)]
        return [b for way in ways[family] for b in _borders(sides[way[0]], code, *way)]


def _chosen(condition: Any, yes: Any, no: Any) -> Any:
    """Return a UFL conditional of two scalars or, component by component, of two vectors."""
    if not yes.ufl_shape:
        return ufl.conditional(condition, yes, no)
    pairs = zip(_scalars(yes), _scalars(no), strict=True)
    return ufl.as_vector([ufl.conditional(condition, *pair) for pair in pairs])


def _scalars(e: Any) -> list[Any]:
    return [e[i] for i in range(e.ufl_shape[0])] if e.ufl_shape else [e]


def _both(one: Any, other: Any) -> Any:
    """Return the UFL conjunction of two conditions, where None denotes a true condition."""
    if one is None or other is None:
        return other if one is None else one
    return ufl.And(one, other)


def _borders(
    side: InterfacePoint, code: int, family: int, distance: Any, where: Any
) -> Iterator[Border]:
    """Yield the borders to statuses that differ only in the state of the bond.

    If there is no friction beyond the border, the target status is slip. ``code`` is the status
    without the state of the bond, and ``family`` the state beyond the border.
    """
    grips = None if code in (OPEN, PLUS, PLUS + WHERE_OPEN) else side.grips(side.soft)
    yield Border(distance, code + family, _both(where, grips))
    if grips is not None:
        slips = PLUS + (WHERE_OPEN if code > WHERE_OPEN else 0)
        yield Border(distance, slips + family, _both(where, ufl.Not(grips)))
