# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two interfaces by energy and dissipation (`interface`): bilinear cohesion, a Maxwell layer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import ufl

from dolfinx_contact.laws.interface import Interface, InterfaceState, Rates
from dolfinx_contact.laws.law import Internal, Scalar, Sign

__all__ = ["BilinearCohesive", "MaxwellLayer"]


@dataclass(frozen=True)
class BilinearCohesive(Interface):
    r"""A bond whose traction rises linearly and then falls linearly to zero.

    With the size d = ([u_n]^2 + |[u_t]|^2)^(1/2) of the jump, normal or tangential,

        Psi = (1 - D) k d^2/2,    Phi = k K(D)^2/2 D' + mu D p |[u_t]'|,    0 <= D <= 1,  D' >= 0,

    where k = strength/elastic and K(D) is the size at which the traction begins to fall. Beyond
    d = a it is strength (a + b - d)/b, with a = elastic and b = softening. Unloading follows the
    secant. Breaking a bond costs the energy strength (a + b)/2 per area. Friction grows with the
    damage.

    Every field is a number, a Constant, a Function or a UFL expression.

    Attributes:
        strength: largest traction, > 0.
        elastic: size a > 0 of the jump at the largest traction.
        softening: further growth b > 0 of the jump until the bond is broken.
        friction: coefficient mu >= 0 of the broken bond.
        damage: D at the start, from 0 to 1.
    """

    strength: Scalar
    elastic: Scalar
    softening: Scalar
    friction: Scalar = 0.0
    damage: Scalar = 0.0
    internal = (Internal("damage", "grows", end=1.0),)

    signs: ClassVar[Mapping[str, Sign]] = {
        "strength": "positive",
        "elastic": "positive",
        "softening": "positive",
        "friction": "nonnegative",
        "damage": "fraction",
    }

    def energy(self, state: InterfaceState) -> Any:
        size = state.opening**2 + ufl.dot(state.moved, state.moved)
        return (1.0 - state["damage"]) * self.strength / self.elastic * size / 2.0

    def dissipation(self, rates: Rates, state: InterfaceState) -> Any:
        breaking = self.strength / self.elastic * self._reached(state) ** 2 / 2.0 * rates["damage"]
        return breaking + self.friction * state["damage"] * state.pressure * rates.slip

    def cost(self, start: InterfaceState, end: InterfaceState) -> Any:
        k = self.strength / self.elastic
        lost = end["damage"] - start["damage"]
        return k * self._reached(start) * self._reached(end) * lost / 2.0

    def _reached(self, state: InterfaceState) -> Any:
        """Return K, the size of the jump at which the traction begins to fall."""
        a = self.elastic
        b = self.softening
        return a * (a + b) / (a + b - state["damage"] * b)


@dataclass(frozen=True)
class MaxwellLayer(Interface):
    r"""A thin viscoelastic layer: a spring and a dashpot in series, parallel to another spring.

    With the viscous part y of the jump [u], a vector,

        Psi = k |[u] - y|^2/2 + c |[u]|^2/2,    Phi = b |y'|^2/2 + mu p |[u_t]'|,

    so that the traction at a constant jump relaxes to c [u] within the time b/k.

    Every field is a number, a Constant, a Function or a UFL expression.

    Attributes:
        stiffness: stiffness k > 0 of the spring in series with the dashpot, traction per length.
        viscosity: b > 0, traction times time per length; ignored in static problems.
        lasting: stiffness c >= 0 of the parallel spring, traction per length.
        friction: coefficient mu >= 0.
    """

    stiffness: Scalar
    viscosity: Scalar
    lasting: Scalar = 0.0
    friction: Scalar = 0.0
    internal = (Internal("flow", vector=True),)
    needs_time = ("viscosity",)

    signs: ClassVar[Mapping[str, Sign]] = {
        "stiffness": "positive",
        "viscosity": "positive",
        "lasting": "nonnegative",
        "friction": "nonnegative",
    }

    def energy(self, state: InterfaceState) -> Any:
        elastic = state.jump - state["flow"]
        lasts = self.lasting * ufl.dot(state.jump, state.jump)
        return (self.stiffness * ufl.dot(elastic, elastic) + lasts) / 2.0

    def dissipation(self, rates: Rates, state: InterfaceState) -> Any:
        flows = self.viscosity * ufl.dot(rates["flow"], rates["flow"]) / 2.0
        return flows + self.friction * state.pressure * rates.slip
