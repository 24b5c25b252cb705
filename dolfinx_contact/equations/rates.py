# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of forms, Dirichlet data, obstacles, laws and rigid bodies with respect to gamma.

With the residual R(u) of the body, the Dirichlet values g, and the traction tau required by the
law, dH/dgamma at fixed unknowns is computed from

    dR/dgamma + (dR/du) dg/dgamma    and    (dtau/dd) . (dd/dgamma),

with the data d of the law: gap, normal and fields. UFL differentiates all data; the derivatives are
evaluated like the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._arrays import Array
from dolfinx_contact._compat import interpolation_points
from dolfinx_contact._forms import compiled_expression, compiled_form
from dolfinx_contact._ufl import derivative, not_affine
from dolfinx_contact.equations.constraints import Constraints
from dolfinx_contact.equations.evaluation import SurfaceEvaluation
from dolfinx_contact.equations.unknowns import RigidBodies
from dolfinx_contact.points.evaluators import Given
from dolfinx_contact.points.rigid_body import number
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Driven", "Rate", "RigidRates", "SurfaceRates", "depends_on", "dirichlet_rates"]


def depends_on(gamma: fem.Constant, *expressions: Any) -> bool:
    """Return whether UFL forms or expressions contain gamma."""
    return any(gamma in extract_constants(_as_ufl(e)) for e in expressions)


def _as_ufl(e: Any) -> Any:
    return e if isinstance(e, ufl.Form) else ufl.as_ufl(e)


@dataclass(frozen=True)
class Rate:
    """Differentiation of UFL forms and expressions with respect to gamma.

    Attributes:
        gamma: Constant in the user's forms.
    """

    gamma: fem.Constant

    def of_expression(self, e: Any) -> Any:
        """Return the expanded derivative of a UFL expression of any shape; zero without gamma."""
        e = ufl.as_ufl(e)
        return derivative(e, self.gamma) if depends_on(self.gamma, e) else 0.0 * e

    def of_form(self, form: ufl.Form) -> fem.Form | None:
        """Return the compiled derivative of a form; None if the derivative vanishes."""
        if not depends_on(self.gamma, form):
            return None
        rate = derivative(form, self.gamma)
        return None if rate.empty() else compiled_form(rate)

    def constants_of(self, e: Any) -> list[fem.Constant]:
        """Return the Constants in the derivative of a form or expression with respect to gamma."""
        present = depends_on(self.gamma, e)
        return list(extract_constants(derivative(_as_ufl(e), self.gamma))) if present else []

    def not_affine(self, e: Any) -> str:
        """Return a description of the part that is not affine in gamma; "" if all is affine.

        Args:
            e: UFL form or expression.
        """
        return not_affine(_as_ufl(e), self.gamma)


class Driven:
    """Function in a Dirichlet condition whose value is a UFL expression of gamma.

    Args:
        function: Function in a Dirichlet condition.
        expression: value of the Function, a UFL expression of gamma and the position.
        rate: differentiation with respect to gamma.

    Attributes:
        function: Function whose values are set.
        expression: value of the Function in UFL.
        not_affine: description of the part that is not affine in gamma; "" if all is affine.
    """

    def __init__(self, function: fem.Function, expression: Any, rate: Rate):
        self.function = function
        self.expression = ufl.as_ufl(expression)
        self.not_affine = rate.not_affine(self.expression)
        points = interpolation_points(function.function_space)
        domain = function.function_space.mesh
        x = ufl.SpatialCoordinate(domain)
        # FFCx does not compile expressions that contain only Constants.
        zero = fem.Constant(domain, 0.0) * (x if self.expression.ufl_shape else x[0])
        self._value = compiled_expression(self.expression + zero, points)
        self._rate = compiled_expression(rate.of_expression(self.expression) + zero, points)

    def set(self) -> None:
        """Interpolate the expression into the Function. Collective."""
        self.function.interpolate(self._value)

    def set_rate(self) -> None:
        """Interpolate the derivative with respect to gamma into the Function. Collective."""
        self.function.interpolate(self._rate)


class SurfaceRates:
    """Derivative of the contact law of a surface with respect to gamma.

    It results from gap, normal and fields of the law that contain gamma.

    Args:
        s: contact surface.
        rate: differentiation with respect to gamma.

    Attributes:
        applies: whether the obstacle or the law depends on gamma.
    """

    def __init__(self, s: DiscreteSurface, rate: Rate):
        self._surface = s
        given = s.given if s.displaced is None else s.displaced.given
        data = (given.gap, given.normal, *given.fields.values())
        self.applies = depends_on(rate.gamma, *data)
        if not self.applies:
            return
        gap, normal = rate.of_expression(given.gap), rate.of_expression(given.normal)
        fields = {name: rate.of_expression(e) for name, e in given.fields.items()}
        rates = Given(gap, normal, fields)
        if s.displaced is None:
            offset = rate.of_expression(given.gap * given.normal)
            self._evaluators = s.points.evaluators(rates, offset)
        else:
            seen = {"seen": rate.of_expression(s.displaced.seen)}
            self._evaluate = s.points.evaluator({**rates.at_points, **seen})

    def __call__(self, contact: SurfaceEvaluation) -> Array | None:
        """Return the derivative of the required traction at fixed unknowns, shape (n, dim).

        None if the law does not depend on gamma. Collective.
        """
        if not self.applies:
            return None
        s = self._surface
        data = contact.data
        at = contact.kinematics
        moved = None
        if s.displaced is not None:
            assert at.place is not None
            rates, moved = s.displaced.rates(self._evaluate, at.place, at.memory, at.frame)
        else:
            rates, aside = s.points.rates(self._evaluators)
            if at.memory is not None:
                aside = aside + at.memory.reference_rate(data.n, rates.n)
        if at.memory is not None:
            # fields in the memory are constant during a step
            fields = {k: v for k, v in rates.fields.items() if k not in at.memory.fields}
            rates = replace(rates, fields=fields)
        law = s.law_at_points
        given = contact.law_traction
        rate = law.rate(contact.jump, given, data, rates, contact.statuses, moved)
        rate = contact.complete(rate)
        return rate if s.displaced is not None else rate - contact.along(aside)


class RigidRates:
    """Derivatives of loads and prescribed motions of rigid bodies with respect to gamma.

    Args:
        bodies: rigid bodies.
        rate: differentiation with respect to gamma.

    Attributes:
        applies: whether a load or a prescribed motion depends on gamma.
        not_affine: description of the part that is not affine in gamma; "" if all is affine.
    """

    def __init__(self, bodies: RigidBodies, rate: Rate):
        self._bodies = bodies
        expressions = [e for b in bodies.bodies for e in b.expressions]
        self._rates = [rate.of_expression(e) for e in expressions]
        self.applies = depends_on(rate.gamma, *expressions)
        self.not_affine = next(filter(None, map(rate.not_affine, expressions)), "")

    def __call__(self) -> tuple[Array, Array]:
        """Return the derivatives of loads and of prescribed motions, one array each.

        Arrays have one entry per unknown of the rigid bodies, in the units of the rows of H for
        loads and of the unknowns for motions.
        """
        values = np.array([number(e) for e in self._rates])
        fixed, units = self._bodies.fixed, self._bodies.units
        return np.where(fixed, 0.0, values / units), np.where(fixed, values * units, 0.0)


def dirichlet_rates(constraints: Constraints, driven: Sequence[Driven]) -> Array:
    """Return derivatives of Dirichlet values with respect to gamma. Collective.

    The result has one entry per local displacement dof, which is 0 for data that do not depend on
    gamma.

    Args:
        constraints: Dirichlet conditions.
        driven: Functions in these conditions that depend on gamma.
    """
    values = [d.function.x.array.copy() for d in driven]
    for d in driven:
        d.set_rate()
    rates = constraints.values_of([d.function for d in driven])
    for d, value in zip(driven, values, strict=True):
        d.function.x.array[:] = value
    return rates
