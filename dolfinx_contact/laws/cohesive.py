# SPDX-License-Identifier: LGPL-3.0-or-later
"""Predefined interface laws (`interface`): bilinear cohesive bond and Maxwell layer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import ufl

from dolfinx_contact.laws.interface import Interface, InterfaceState, Rates
from dolfinx_contact.laws.law import Internal, Scalar, Sign, constant_law

__all__ = ["BilinearCohesive", "MaxwellLayer"]


@constant_law
@dataclass(frozen=True)
class BilinearCohesive(Interface):
    r"""Cohesive bond: the traction rises linearly, then falls linearly to zero.

    For the size d = ([u_n]^2 + |[u_t]|^2)^(1/2) of the jump and the contact pressure p, the surface
    energy Psi and the dissipation potential Phi (`Interface`) are

        Psi = (1 - D) k d^2/2,    Phi = k K(D)^2/2 D' + mu D p |[u_t]'|,    0 <= D <= 1,  D' >= 0,

    where k = strength/elastic, and K(D) is the jump at which the traction starts to decrease. For d
    between a and a + b the traction is strength (a + b - d)/b, with a = elastic and b = softening.
    Unloading follows the secant. Breaking the bond dissipates the energy strength (a + b)/2 per
    area. Friction increases with the damage.

    Every field is a number, a Constant, a Function or a UFL expression.

    Attributes:
        strength: largest traction, > 0.
        elastic: jump a > 0 at the largest traction, a length.
        softening: increase b > 0 of the jump from the largest traction to failure, a length.
        friction: friction coefficient mu >= 0 of the broken bond.
        damage: initial damage D, from 0 to 1.
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
        """Return the jump at which the traction starts to decrease, for the present damage."""
        a = self.elastic
        b = self.softening
        return a * (a + b) / (a + b - state["damage"] * b)


@constant_law
@dataclass(frozen=True)
class MaxwellLayer(Interface):
    r"""Thin viscoelastic layer: spring and dashpot in series, in parallel with another spring.

    With the viscous part y of the jump [u], both vectors, and the contact pressure p, the surface
    energy Psi and the dissipation potential Phi (`Interface`) are

        Psi = k |[u] - y|^2/2 + c |[u]|^2/2,    Phi = b |y'|^2/2 + mu p |[u_t]'|,

    At a constant jump, the traction relaxes to c [u] with the relaxation time b/k.

    Every field is a number, a Constant, a Function or a UFL expression.

    Attributes:
        stiffness: stiffness k > 0 of the spring in series with the dashpot, traction per length.
        viscosity: viscosity b > 0 of the dashpot, traction times time per length; ignored in static
            problems.
        lasting: stiffness c >= 0 of the parallel spring, which remains after relaxation, traction
            per length.
        friction: friction coefficient mu >= 0.
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
