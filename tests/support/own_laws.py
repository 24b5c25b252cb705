"""Friction weakening with slip or speed, and orthotropic friction, as users write them."""

from dataclasses import dataclass
from typing import Any

import ufl

from dolfinx_contact.laws import OPEN, PLUS, STICK, Border, FrictionLaw, Law, StatusPiece


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        drop = self.static - self.kinetic
        return (self.kinetic + drop * ufl.exp(-a.slid / self.distance)) * p


@dataclass(frozen=True)
class SpeedWeakening(FrictionLaw):
    static: Any
    kinetic: Any
    speed: Any

    def bound(self, a, p):
        moving = ufl.gt(a.step, 0.0)
        v = ufl.conditional(moving, (a.slid - a.slid_before) / a.step, 0.0)
        return (self.kinetic + (self.static - self.kinetic) * ufl.exp(-v / self.speed)) * p


@dataclass(frozen=True)
class Orthotropic(Law):
    along: Any
    across: Any
    angle: Any  # of the grain with the x axis

    def pieces(self, a):
        grain = ufl.as_vector([ufl.cos(self.angle), ufl.sin(self.angle), 0.0])
        grain = grain - ufl.dot(grain, a.n) * a.n
        e = grain / ufl.sqrt(ufl.dot(grain, grain))
        f = ufl.cross(a.n, e)

        def projected(coefficient, axis):
            traction = ufl.dot(a.traction, axis)
            slip = ufl.dot(a.u_t, axis)
            return traction / coefficient - a.r * coefficient * slip

        q_along = projected(self.along, e)
        q_across = projected(self.across, f)
        size = ufl.sqrt(q_along**2 + q_across**2)
        pressure = -a.p * a.n
        shear = self.along * q_along * e + self.across * q_across * f
        largest = a.p * shear / size

        closes = Border(-a.p, PLUS)
        opens = Border(a.p, OPEN)
        slips = Border(a.p - size, PLUS)
        sticks = Border(size - a.p, STICK)
        return {
            OPEN: StatusPiece(0.0 * a.n, [closes]),
            STICK: StatusPiece(pressure + shear, [opens, slips]),
            PLUS: StatusPiece(pressure + largest, [opens, sticks]),
        }
