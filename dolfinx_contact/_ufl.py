# SPDX-License-Identifier: LGPL-3.0-or-later
r"""UFL of the user: its dependence on a terminal, its Functions, Constants and meshes, its content.

*Dependence* of UFL on a Function, a Constant or a variable v is classified symbolically. After
lowering algebra and expanding derivatives, an expression E is traversed from its terminals
upwards. Every node is independent of v (absent), a polynomial in v of some degree, kinked
(continuous, like |v|), jumping (like the sign of v), or other:

    sums                      worst of their terms
    products                  degrees add up; a kinked or jumping factor dominates
    quotients                 as the numerator if the denominator does not contain v
    powers                    the degree is multiplied by an integer exponent >= 1
    abs, max_value, min_value kinked if an argument contains v
    sign, conditional         jumping if the condition contains v
    components, sums over indices, gradients, restrictions: as their operand

*Affine* means of degree 1 at most. A vanishing second derivative is not a valid test, because it
vanishes on both sides of a kink; neither are samples.

The classification is symbolic: max_value(v, 0)**2 has the derivative 2 max_value(v, 0) c with a
condition c, which is classified as jumping although its values are continuous.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl import classes
from ufl.algorithms import expand_derivatives, expand_indices
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
from ufl.corealg.traversal import unique_post_traversal, unique_pre_traversal

from dolfinx_contact._compat import dirichlet_value, domains_of, is_mesh_of
from dolfinx_contact._validate import is_number

__all__ = [
    "Dependence",
    "Kind",
    "data_of",
    "dependence",
    "described",
    "has_branches",
    "is_affine",
    "refuse_displacement",
    "refuse_other_condition",
    "refuse_other_mesh",
]


class Kind(IntEnum):
    """Kinds of dependence, ordered from best to worst."""

    ABSENT = 0
    POLYNOMIAL = 1
    KINKED = 2
    JUMPING = 3
    OTHER = 4


@dataclass(frozen=True)
class Dependence:
    """Dependence of an expression on given terminals.

    Attributes:
        kind: kind of the dependence.
        degree: degree of a polynomial; 0 if absent.
        node: first node of that kind, unless it is a polynomial.
        kinks: all nodes that are kinked or jumping themselves.
    """

    kind: Kind
    degree: int = 0
    node: Any = None
    kinks: tuple[Any, ...] = ()

    @property
    def is_affine(self) -> bool:
        """Whether the expression is a polynomial of degree 1 at most."""
        return self.kind <= Kind.POLYNOMIAL and self.degree <= 1

    @property
    def text(self) -> str:
        """Text of the decisive node, for messages."""
        if self.kind == Kind.POLYNOMIAL:
            return "" if self.degree <= 1 else f"degree {self.degree}"
        return "" if self.node is None else _text(self.node)

    @property
    def text_of_kinks(self) -> str:
        """Text of the outermost kinks, for messages; "" if there are none."""
        shown: list[Any] = []
        for node in reversed(self.kinks):
            if not any(node in set(unique_pre_traversal(other)) for other in shown):
                shown.append(node)
        return " and ".join(dict.fromkeys(_text(node) for node in shown[:_SHOWN]))


def dependence(e: Any, *terminals: Any) -> Dependence:
    """Return the joint dependence of an expression or a form on terminals.

    Args:
        e: UFL expression of any shape, or form.
        terminals: Functions, Constants, their components, or ``ufl.variable`` objects.
    """
    labels = {t.ufl_operands[1] for t in terminals if isinstance(t, classes.Variable)}
    wanted = {t for t in terminals if not isinstance(t, classes.Variable)}
    found = Dependence(Kind.ABSENT)
    for integrand in _integrands(expand_derivatives(_as_ufl(e))):
        part = _walked(integrand, wanted, labels)
        if part.kinks and not labels:
            # Classify by components, because only some may be used.
            part = Dependence(Kind.ABSENT)
            for component in _components(remove_complex_nodes(integrand)):
                part = _joined(part, _walked(expand_indices(component), wanted, labels))
        found = _joined(found, part)
    return found


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
        _known[key] = dependence(form, terminal).is_affine
    return _known[key]


def has_branches(form: ufl.Form) -> bool:
    """Return whether a form contains operators that may have kinks or jumps."""
    return any(
        isinstance(node, _BRANCHING)
        for integral in form.integrals()
        for node in unique_pre_traversal(integral.integrand())
    )


_BRANCHING = classes.Conditional | classes.Abs | classes.MaxValue | classes.MinValue
#: Results of `is_affine` by signature, kind of terminal and its place.
_known: dict[tuple[str, bool, int], bool] = {}


def _as_ufl(e: Any) -> Any:
    return e if isinstance(e, ufl.Form) else ufl.as_ufl(e)


def _integrands(e: Any) -> list[Any]:
    return [i.integrand() for i in e.integrals()] if isinstance(e, ufl.Form) else [e]


def _components(e: Any) -> list[Any]:
    """Return the scalar components of an expression."""
    return [e[index] if index else e for index in np.ndindex(e.ufl_shape)]


def _text(node: Any) -> str:
    """Return a node as users write it, shortened."""
    words = str(node)
    if isinstance(node, classes.Conditional) and isinstance(node.ufl_operands[0], classes.EQ):
        of = node.ufl_operands[0].ufl_operands[0]
        if node == ufl.sign(of):
            words = f"sign({of})"
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}..."


_SHOWN = 2  # largest number of kinks in a message
_LONGEST = 120  # largest number of characters of a node in a message


# -- traversal -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """Classification of a node: kind, degree, and decisive node."""

    kind: Kind
    degree: int = 0
    node: Any = None


_ABSENT = _Part(Kind.ABSENT)
_THROUGH = (
    classes.Sum,
    classes.Indexed,
    classes.ListTensor,
    classes.ComponentTensor,
    classes.IndexSum,
    classes.Variable,
    classes.Restricted,
    classes.CellAvg,
    classes.FacetAvg,
    classes.Grad,
    classes.ReferenceGrad,
    classes.ReferenceValue,
    classes.Conj,
    classes.Real,
    classes.Imag,
)


def _joined(a: Dependence, b: Dependence) -> Dependence:
    """Return the dependence of a sum."""
    worst = max(a, b, key=lambda d: (d.kind, d.degree))
    return Dependence(worst.kind, worst.degree, worst.node, (*a.kinks, *b.kinks))


def _order(part: _Part) -> tuple[int, int]:
    return part.kind, part.degree


def _walked(e: Any, terminals: set[Any], labels: set[Any]) -> Dependence:
    """Return the dependence of an expression with derivatives of terminals only."""
    known: dict[Any, _Part] = {}
    kinks: list[Any] = []
    for node in unique_post_traversal(e):
        if (
            isinstance(node, classes.Variable) and node.ufl_operands[1] in labels
        ) or node in terminals:
            known[node] = _Part(Kind.POLYNOMIAL, 1)
        elif not node.ufl_operands:
            known[node] = _ABSENT
        else:
            known[node] = part = _combined(node, [known[o] for o in node.ufl_operands])
            if part.node is node and part.kind in (Kind.KINKED, Kind.JUMPING):
                kinks.append(node)
    part = known[e]
    return Dependence(part.kind, part.degree, part.node, tuple(kinks))


def _combined(node: Any, parts: list[_Part]) -> _Part:
    """Classify a node from its operands."""
    if all(p.kind == Kind.ABSENT for p in parts):
        return _ABSENT
    if isinstance(node, _THROUGH):
        return max(parts, key=_order)
    if isinstance(node, classes.Product | classes.Inner | classes.Dot | classes.Outer):
        worst = max(parts, key=_order)
        if worst.kind > Kind.POLYNOMIAL:
            return worst
        return _Part(Kind.POLYNOMIAL, sum(p.degree for p in parts))
    if isinstance(node, classes.Division):
        numerator, denominator = parts
        return numerator if denominator.kind == Kind.ABSENT else _Part(Kind.OTHER, node=node)
    if isinstance(node, classes.Power):
        return _power(node, parts[0])
    if isinstance(node, classes.Conditional):
        condition, *arms = parts
        if condition.kind == Kind.ABSENT:
            return max(arms, key=_order)
        return _Part(Kind.JUMPING, node=node)
    if isinstance(node, classes.Condition):
        return max(parts, key=_order)  # decided by its conditional
    if isinstance(node, classes.Abs | classes.MaxValue | classes.MinValue):
        worst = max(parts, key=_order)
        return worst if worst.kind > Kind.KINKED else _Part(Kind.KINKED, node=node)
    return _Part(Kind.OTHER, node=node)


def _power(node: Any, base: _Part) -> _Part:
    """Classify a power whose base or exponent contains v."""
    exponent = node.ufl_operands[1]
    if not isinstance(exponent, classes.RealValue):
        return _Part(Kind.OTHER, node=node)
    number = float(exponent)
    if number != round(number) or number < 1:
        return _Part(Kind.OTHER, node=node)
    if base.kind > Kind.POLYNOMIAL:
        return base
    return _Part(Kind.POLYNOMIAL, base.degree * round(number))


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
        raise ValueError(
            f"{what} depends on the displacement: its gap and normal are those of the reference "
            "configuration, to which the displacement is added (the gap is then gap - u.n)"
        )


def refuse_other_condition(bc: fem.DirichletBC, domain: mesh.Mesh) -> None:
    """Raise ``ValueError`` if a Dirichlet condition or its Function belongs to another mesh."""
    value = dirichlet_value(bc)
    spaces = [bc.function_space, getattr(value, "function_space", bc.function_space)]
    if not all(is_mesh_of(domain, space) for space in spaces):
        raise ValueError("a Dirichlet condition, or its value, is on a space of another mesh")


def described(value: Any, domain: mesh.Mesh) -> str:
    """Return the content of an argument as text, equal on ranks that pass the same argument.

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
