# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Analysis of UFL expressions: dependence on terminals, coefficients, meshes and content.

The *dependence* of UFL on a Function, a Constant or a variable v is decided symbolically, after
derivatives have been expanded. UFL has a kink or a jump in v if abs, max_value or min_value contain
v, or the condition of a conditional does. It is affine in v if it has neither and its derivative
does not contain v. A vanishing second derivative alone is not a valid test, because it vanishes on
both sides of a kink; neither are samples.

max_value(v, 0)**2 has the derivative 2 max_value(v, 0) c with a condition c, which counts as a kink
although its values are continuous.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl import classes
from ufl.algorithms import expand_derivatives, expand_indices
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
from ufl.corealg.multifunction import MultiFunction
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._compat import dirichlet_value, domains_of, is_mesh_of
from dolfinx_contact._validate import is_number

__all__ = [
    "data_of",
    "depends_on",
    "derivative",
    "described",
    "has_branches",
    "is_affine",
    "kinks_of",
    "not_affine",
    "refuse_displacement",
    "refuse_other_condition",
    "refuse_other_mesh",
]

_BRANCHING = classes.Conditional | classes.Abs | classes.MaxValue | classes.MinValue
_SHOWN = 2  # largest number of kinks in a message
_LONGEST = 120  # largest number of characters of a node in a message
#: Results of `is_affine` by signature, kind of terminal and its place.
_known: dict[tuple[str, bool, int], bool] = {}


def depends_on(e: Any, *terminals: Any) -> bool:
    """Return whether a form or expression, with expanded derivatives, contains a terminal.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, or ``ufl.variable`` objects.
    """
    return any(_contains(integrand, terminals) for integrand in _integrands(e))


def kinks_of(e: Any, *terminals: Any) -> str:
    """Return the text of the outermost kinks or jumps in terminals, for messages; "" if none.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, or ``ufl.variable`` objects.
    """
    outermost: list[Any] = []
    for integrand in _integrands(e):
        if not any(True for _ in _kinks(integrand, terminals)):
            continue
        # Only some components may be used.
        for index in np.ndindex(integrand.ufl_shape):
            component = remove_complex_nodes(integrand[index] if index else integrand)
            for node in _kinks(expand_indices(component), terminals):
                if not any(node in set(unique_pre_traversal(other)) for other in outermost):
                    outermost.append(node)
    return " and ".join(dict.fromkeys(_text(node) for node in outermost[:_SHOWN]))


def not_affine(e: Any, *terminals: Any) -> str:
    """Return the text of the part that is not affine in terminals; "" if there is none.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, or ``ufl.variable`` objects; jointly.
    """
    kinks = kinks_of(e, *terminals)
    if kinks or not any(depends_on(derivative(e, t), *terminals) for t in terminals):
        return kinks
    return "a nonlinear term"


def is_affine(form: ufl.Form, terminal: Any) -> bool:
    """Return whether a form is affine in a Function or Constant; results are cached.

    Args:
        form: form of any rank.
        terminal: Function or Constant, which need not occur in the form.
    """
    constants = isinstance(terminal, fem.Constant)
    among = form.constants() if constants else form.coefficients()
    places = [i for i, t in enumerate(among) if t == terminal]
    if not places:
        return True
    key = form.signature(), constants, places[0]
    if key not in _known:
        _known[key] = not not_affine(form, terminal)
    return _known[key]


def has_branches(form: ufl.Form) -> bool:
    """Return whether a form contains operators that may have kinks or jumps."""
    return any(
        isinstance(node, _BRANCHING)
        for integral in form.integrals()
        for node in unique_pre_traversal(integral.integrand())
    )


def derivative(e: Any, terminal: Any) -> Any:
    """Return the expanded derivative of a form or expression by a terminal.

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
    """Map that replaces a Constant or the component of a Function by a variable."""

    def __init__(self, terminal: Any):
        super().__init__()
        self._terminal = terminal
        self.variable = ufl.variable(terminal)

    def expr(self, o: Any, *operands: Any) -> Any:
        """Return the variable for the terminal, otherwise the node with mapped operands."""
        return self.variable if o == self._terminal else self.reuse_if_untouched(o, *operands)


def _integrands(e: Any) -> list[Any]:
    """Return the integrands of a form, or the expression, with expanded derivatives."""
    if isinstance(e, ufl.Form):
        return [i.integrand() for i in expand_derivatives(e).integrals()]
    return [expand_derivatives(ufl.as_ufl(e))]


def _contains(e: Any, terminals: tuple[Any, ...]) -> bool:
    labels = {t.ufl_operands[1] if isinstance(t, classes.Variable) else t for t in terminals}
    return any(node in labels for node in unique_pre_traversal(e))


def _kinks(e: Any, terminals: tuple[Any, ...]) -> Iterator[Any]:
    """Yield the nodes with a kink or jump in terminals, outer nodes first."""
    for node in unique_pre_traversal(e):
        if isinstance(node, _BRANCHING):
            conditional = isinstance(node, classes.Conditional)
            if _contains(node.ufl_operands[0] if conditional else node, terminals):
                yield node


def _text(node: Any) -> str:
    """Return a node as users write it, shortened."""
    words = str(node)
    if isinstance(node, classes.Conditional) and isinstance(node.ufl_operands[0], classes.EQ):
        operand = node.ufl_operands[0].ufl_operands[0]
        if node == ufl.sign(operand):
            words = f"sign({operand})"
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}..."


# -- data and content ------------------------------------------------------------------------------


def data_of(expression: Any) -> tuple[list[Any], list[Any], set[Any]]:
    """Return the Functions and Constants of a UFL expression, in UFL's order, and its meshes."""
    functions = set[Any]()
    constants = set[Any]()
    domains = set[Any]()
    for part in unique_pre_traversal(expression):
        if part._ufl_is_terminal_:
            domains.update(domains_of(part))
            if isinstance(part, ufl.Coefficient):
                functions.add(part)
            elif isinstance(part, ufl.Constant):
                constants.add(part)
    return (
        sorted(functions, key=lambda f: f.count()),
        sorted(constants, key=lambda c: c.count()),
        domains - {None},
    )


def refuse_other_mesh(expression: Any, domain: mesh.Mesh, what: str) -> None:
    """Raise ``ValueError`` if a UFL expression or form belongs to another mesh.

    Args:
        expression: UFL expression of any shape, or form.
        domain: required mesh.
        what: name of the expression in the message.
    """
    if isinstance(expression, ufl.Form):
        functions, constants = expression.coefficients(), expression.constants()
        domains = set(expression.ufl_domains())
    else:
        functions, constants, domains = data_of(expression)
    required = domain.ufl_domain()
    for kind, data in (("Function", functions), ("Constant", constants)):
        for d in data:
            if set(domains_of(d)) != {required}:
                verb = "is" if d is expression else "contains"
                raise ValueError(f"{what} {verb} a {kind} of another mesh")
    if domains - {required}:
        raise ValueError(f"{what} belongs to another mesh")


def refuse_displacement(u: fem.Function, what: str, *functions: Any) -> None:
    """Raise ``ValueError`` if the displacement is among the Functions of an obstacle or a law.

    Args:
        u: displacement.
        what: name of the obstacle or law in the message.
        functions: Functions in its UFL.
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
    """Return the content of an argument as text, equal on ranks passing the same argument.

    UFL is described by the values of its Constants and by its signature, which contains neither the
    counts of UFL's objects nor the values of Functions, which are distributed over the ranks.

    Args:
        value: number, UFL expression or form on ``domain``, Dirichlet condition, or any object with
            a `repr`.
        domain: mesh.
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
