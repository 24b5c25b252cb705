# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives by the parameter gamma of forms, Dirichlet data, obstacles and laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._affine import dependence, has_branches, is_affine
from dolfinx_contact._compat import interpolation_points
from dolfinx_contact._forms import compiled_expression, compiled_form
from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.points.contact_points import Given
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Driven", "Rate", "RigidRates", "SurfaceRates", "depends_on"]

Array = npt.NDArray[np.float64]


def depends_on(gamma: fem.Constant, *expressions: Any) -> bool:
    """Whether UFL expressions contain gamma."""
    return any(gamma in extract_constants(ufl.as_ufl(e)) for e in expressions)


@dataclass(frozen=True)
class Rate:
    """Differentiation by gamma.

    Attributes:
        gamma: the Constant of the user's forms.
    """

    gamma: fem.Constant

    def of(self, e: Any) -> Any:
        """The derivative of a UFL expression or form."""
        variable = ufl.variable(self.gamma)
        return ufl.diff(ufl.replace(e, {self.gamma: variable}), variable)

    def of_expression(self, e: Any) -> Any:
        """The derivative of an expression of any shape, expanded; zero where gamma is not in it."""
        e = ufl.as_ufl(e)
        if not depends_on(self.gamma, e):
            return 0.0 * e
        return ufl.algorithms.expand_derivatives(self.of(e))

    def of_form(self, form: ufl.Form) -> fem.Form | None:
        """The derivative of a form, compiled; None if it vanishes."""
        if self.gamma not in form.constants():
            return None
        rate = ufl.algorithms.expand_derivatives(self.of(form))
        return None if rate.empty() else compiled_form(rate)

    def constants_of(self, e: Any) -> list[fem.Constant]:
        """Constants in the derivative of a form or an expression."""
        if isinstance(e, ufl.Form):
            if self.gamma not in e.constants():
                return []
            return list(ufl.algorithms.expand_derivatives(self.of(e)).constants())
        return list(extract_constants(self.of_expression(e)))

    def not_affine(self, e: Any) -> str:
        """What makes a form or an expression not affine in gamma, in words; "" if it is affine."""
        if isinstance(e, ufl.Form) and is_affine(e, self.gamma):
            return ""
        found = dependence(e, self.gamma)
        return "" if found.is_affine else found.text

    def kinks(self, e: Any) -> str:
        """Where a form or an expression has kinks or jumps in gamma, in words; "" if nowhere."""
        if isinstance(e, ufl.Form):
            present = self.gamma in e.constants() and has_branches(e)
        else:
            present = depends_on(self.gamma, e)
        return dependence(e, self.gamma).text_of_kinks if present else ""


class Driven:
    """A Function of Dirichlet data with its value and rate as interpolable expressions."""

    def __init__(self, function: fem.Function, expression: Any, rate: Rate):
        points = interpolation_points(function.function_space)
        expression = ufl.as_ufl(expression)
        domain = function.function_space.mesh
        x = ufl.SpatialCoordinate(domain)
        # FFCx compiles no expression in which nothing but constants occurs.
        nothing = fem.Constant(domain, 0.0) * (x if expression.ufl_shape else x[0])
        self.expression = expression
        self.function = function
        slope = rate.of_expression(expression)
        #: What makes it not affine in gamma; "" if it is.
        self.not_affine = rate.not_affine(expression)
        #: Where it has kinks or jumps in gamma; "" if nowhere.
        self.kinks = rate.kinks(expression)
        self._value = compiled_expression(expression + nothing, points)
        self._rate = compiled_expression(slope + nothing, points)

    def set(self) -> None:
        """Give the Function its value. Collective."""
        self.function.interpolate(self._value)

    def add_rate(self) -> None:
        """Add the rate to the Function. Collective."""
        value = self.function.x.array.copy()
        self.function.interpolate(self._rate)
        self.function.x.array[:] += value


class SurfaceRates:
    """Rate of the answer of the law of a surface whose obstacle or law depends on gamma."""

    def __init__(self, s: DiscreteSurface, rate: Rate):
        self._surface = s
        given = s.given if s.displaced is None else s.displaced.given
        self.moves = depends_on(rate.gamma, given.gap, given.normal)
        self.law_changes = depends_on(rate.gamma, *given.fields.values())
        self.kinks = ""
        if not self.applies:
            return
        every = given.gap, given.normal, *given.fields.values()
        #: Where the obstacle or the law has kinks or jumps in gamma; "" if nowhere.
        self.kinks = next(filter(None, map(rate.kinks, every)), "")
        fields = {name: rate.of_expression(e) for name, e in given.fields.items()}
        normal = rate.of_expression(given.normal)
        self._rates = Given(rate.of_expression(given.gap), normal, fields)
        offset = rate.of_expression(given.gap * given.normal)
        if s.displaced is None:
            self._evaluators = s.points.evaluators(self._rates, offset)
        else:
            seen = {"seen": rate.of_expression(s.displaced.seen)}
            self._evaluators = s.points.evaluator({**self._rates.at_points, **seen}), None

    @property
    def applies(self) -> bool:
        """Whether anything depends on gamma."""
        return self.moves or self.law_changes

    def __call__(self, state: ContactState) -> Array | None:
        """The rate at held unknowns (n, dim); None if gamma is not in it. Collective."""
        if not self.applies:
            return None
        s = self._surface
        data = state.data
        at = state.kinematics
        moved = None
        if s.displaced is not None:
            assert at.place is not None
            seen = self._evaluators[0], at.place, at.memory, at.frame
            rates, moved = s.displaced.rates(*seen)
        else:
            rates, aside = s.points.rates(self._evaluators)
            if at.memory is not None:
                aside = aside + at.memory.reference_rate(data.n, rates.n)
        if at.memory is not None:
            given = {k: v for k, v in rates.fields.items() if k not in at.memory.fields}
            rates = replace(rates, fields=given)
        args = state.jump, state.traction, data, rates, state.statuses
        rate = s.law_at_points.rate(*args, moved)
        return rate if s.displaced is not None else rate - state.along(aside)


def dirichlet_rates(constraints: Any, driven: Sequence[Driven]) -> Array:
    """Derivatives of Dirichlet values by gamma on the local displacement dofs, 0 elsewhere."""
    fixed = constraints.values(fill=0.0)
    kept = [d.function.x.array.copy() for d in driven]
    for d in driven:
        d.add_rate()
    moved = constraints.values(fill=0.0)
    for d, values in zip(driven, kept, strict=True):
        d.function.x.array[:] = values
    return np.asarray(moved - fixed).reshape(-1)


class RigidRates:
    """Rates of loads and prescribed motions of rigid bodies."""

    def __init__(self, bodies: RigidBodies, rate: Rate):
        self._bodies = bodies
        given = [e for b in bodies.bodies for e in b.expressions]
        self._rates = [rate.of_expression(e) for e in given]
        #: Whether anything depends on gamma.
        self.applies = depends_on(rate.gamma, *given)
        self.kinks = next(filter(None, map(rate.kinks, given)), "")
        #: What makes one of them not affine in gamma; "" if all are.
        self.not_affine = next(filter(None, map(rate.not_affine, given)), "")

    def __call__(self) -> tuple[Array, Array]:
        return self._bodies.rates(self._rates)
