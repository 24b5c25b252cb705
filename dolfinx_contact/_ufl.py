# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Analysis of UFL expressions: dependence on terminals, coefficients, meshes and content.

The *dependence* of a UFL expression on a Function, a Constant or a variable v is decided
symbolically, after derivatives have been expanded. The expression has a kink or a jump in v if v
occurs in abs, max_value, min_value or the condition of a conditional. It is affine in v if it has
neither and its derivative does not contain v. A vanishing second derivative does not imply this,
because it also vanishes on both sides of a kink; nor do evaluations at sample points.

The derivative of max_value(v, 0)**2 is 2 max_value(v, 0) c with a condition c. It counts as a kink
although its values are continuous.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl import classes
from ufl.algorithms import expand_derivatives, expand_indices, extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
from ufl.corealg.multifunction import MultiFunction
from ufl.corealg.traversal import unique_pre_traversal as _nodes
from ufl.domain import extract_domains

from dolfinx_contact._compat import dirichlet_value, is_mesh_of
from dolfinx_contact._validate import is_number

__all__ = [
    "depends_on",
    "derivative",
    "described",
    "kinks_of",
    "not_affine",
    "refuse_displacement",
    "refuse_other_condition",
    "refuse_other_mesh",
]

_BRANCHING = classes.Conditional | classes.Abs | classes.MaxValue | classes.MinValue
_LONGEST = 120  # largest number of characters of a node in a message


def depends_on(e: Any, *terminals: Any) -> bool:
    """Return whether a form or expression depends on any of the terminals.

    Derivatives are expanded first.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, or ``ufl.variable`` objects.
    """
    return any(_contains(expand_derivatives(part), terminals) for part in _integrands(e))


def kinks_of(e: Any, *terminals: Any) -> str:
    """Describe a kink or jump of an expression in terminals, for messages; "" if none.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, or ``ufl.variable`` objects.
    """
    parts = _integrands(e)
    if not any(isinstance(node, _BRANCHING) for part in parts for node in _nodes(part)):
        return ""
    for integrand in map(expand_derivatives, parts):
        # Only some components may be used.
        for index in np.ndindex(integrand.ufl_shape):
            component = remove_complex_nodes(integrand[index] if index else integrand)
            for node in _nodes(expand_indices(component)):
                if _is_kink(node, terminals):
                    words = str(node)
                    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}..."
    return ""


def not_affine(e: Any, *terminals: Any) -> str:
    """Describe the part of an expression that is not affine in terminals; "" if it is affine.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, or ``ufl.variable`` objects, which vary together.
    """
    kinks = kinks_of(e, *terminals)
    if kinks or not any(depends_on(derivative(e, t), *terminals) for t in terminals):
        return kinks
    return "a nonlinear term"


def derivative(e: Any, terminal: Any) -> Any:
    """Return the expanded derivative of a form or expression with respect to a terminal.

    Args:
        e: UFL expression of any shape, or form.
        terminal: Constant, ``ufl.variable`` object or component of a Function; for forms also a
            Function.
    """
    if isinstance(terminal, fem.Function):
        return expand_derivatives(ufl.derivative(e, terminal))
    if isinstance(terminal, classes.Variable):
        return expand_derivatives(ufl.diff(e, terminal))
    replaced = _Replaced(terminal)
    of_variable = map_integrand_dags(replaced, e)
    return expand_derivatives(ufl.diff(of_variable, replaced.variable))


class _Replaced(MultiFunction):  # type: ignore[misc]
    """UFL mapping that replaces a Constant or a component of a Function by a variable."""

    def __init__(self, terminal: Any):
        super().__init__()
        self._terminal = terminal
        self.variable = ufl.variable(terminal)

    def expr(self, o: Any, *operands: Any) -> Any:
        """Return a node of a UFL expression with the terminal replaced by the variable."""
        return self.variable if o == self._terminal else self.reuse_if_untouched(o, *operands)


def _integrands(e: Any) -> list[Any]:
    """Return the integrands of a form, or a list with the given expression."""
    is_form = isinstance(e, ufl.Form)
    return [i.integrand() for i in e.integrals()] if is_form else [ufl.as_ufl(e)]


def _contains(e: Any, terminals: tuple[Any, ...]) -> bool:
    labels = {t.ufl_operands[1] if isinstance(t, classes.Variable) else t for t in terminals}
    return any(node in labels for node in _nodes(e))


def _is_kink(node: Any, terminals: tuple[Any, ...]) -> bool:
    """Return whether a UFL node has a kink or jump as a function of the terminals."""
    if not isinstance(node, _BRANCHING):
        return False
    conditional = isinstance(node, classes.Conditional)
    return _contains(node.ufl_operands[0] if conditional else node, terminals)


# -- data and content ------------------------------------------------------------------------------


def refuse_other_mesh(expression: Any, domain: mesh.Mesh, what: str) -> None:
    """Raise ``ValueError`` if a UFL expression or form belongs to another mesh.

    Args:
        expression: UFL expression of any shape, or form.
        domain: mesh to which the expression must belong.
        what: name of the expression in the message.
    """
    required = {domain.ufl_domain()}
    for kind, extract in (("Function", extract_coefficients), ("Constant", extract_constants)):
        for d in extract(expression):
            if set(extract_domains(d)) != required:
                verb = "is" if d is expression else "contains"
                raise ValueError(f"{what} {verb} a {kind} of another mesh")
    is_form = isinstance(expression, ufl.Form)
    domains = expression.ufl_domains() if is_form else extract_domains(expression)
    if set(domains) - required:
        raise ValueError(f"{what} belongs to another mesh")


def refuse_displacement(u: fem.Function, what: str, *functions: Any) -> None:
    """Raise ``ValueError`` if an obstacle or a law depends on the displacement.

    Args:
        u: displacement.
        what: name of the obstacle or law in the message.
        functions: Functions in the UFL expressions of the obstacle or law.
    """
    if any(f is u for f in functions):
        hint = (
            "a coefficient may depend on the position, and the bound of a FrictionLaw on the slip"
            if what.endswith("the law")
            else "its gap and normal are those of the reference configuration, to which the "
            "displacement is added (the gap is then gap - u.n)"
        )
        raise ValueError(f"{what} depends on the displacement: {hint}")


def refuse_other_condition(bc: fem.DirichletBC, domain: mesh.Mesh) -> None:
    """Raise ``ValueError`` if a Dirichlet condition or its Function belongs to another mesh."""
    value = dirichlet_value(bc)
    spaces = [bc.function_space, getattr(value, "function_space", bc.function_space)]
    if not all(is_mesh_of(domain, space) for space in spaces):
        raise ValueError("a Dirichlet condition, or its value, is on a space of another mesh")


def described(value: Any, domain: mesh.Mesh) -> str:
    """Describe an argument by a text that is equal on ranks passing the same argument.

    UFL is described by the values of its Constants and by its signature, which contains neither the
    numbers of UFL's objects nor the values of Functions, which are distributed over the ranks.

    Args:
        value: number, UFL expression or form on ``domain``, Dirichlet condition, or any object with
            a `repr`.
        domain: mesh to which UFL in the value belongs.
    """
    if isinstance(value, fem.DirichletBC):
        value = dirichlet_value(value)
        is_function = hasattr(value, "function_space")
        return "a Function" if is_function else repr(np.asarray(value.value).tolist())
    if is_number(value):
        return repr(float(value))
    if isinstance(value, ufl.constantvalue.Zero):
        return "0"
    if isinstance(value, ufl.core.expr.Expr):
        value = ufl.inner(value, value) * ufl.dx(domain=domain)
    if not isinstance(value, ufl.Form):
        return repr(value)
    values = [np.asarray(c.value).tolist() for c in value.constants()]
    return f"{', '.join(map(repr, values)) or 'an expression'} (form {value.signature()[:12]})"
