# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How UFL depends on a Function, a Constant or a variable: by what it is made of, not by samples.

An expression E is walked from its terminals up, once its algebra is lowered and its derivatives are
taken. Every node is absent of v, a polynomial in v of some degree, kinked (continuous, as |v|),
jumping (as the sign of v), or anything else:

    sums                      the worst of their terms
    products                  degrees add up; a kinked or jumping factor makes them that
    quotients                 as the numerator where the denominator is absent of v
    powers                    degrees are multiplied by a whole exponent >= 1
    abs, max_value, min_value of what holds v are kinked
    sign, and a conditional   whose condition holds v, whatever its arms, are jumping
    parts, sums over indices, gradients, restrictions pass through; else it is anything else

*Affine* is of degree 1 at most. A second derivative that vanishes is not the test: it vanishes on
both sides of a kink. Nor are samples, between which anything may be.

The classification is one of forms: max_value(v, 0)**2 has the derivative 2 max_value(v, 0) c with a
condition c, which is jumping by its form and continuous by its values.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

import ufl
from dolfinx import fem
from ufl import classes
from ufl.algorithms import expand_derivatives, expand_indices
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
from ufl.corealg.traversal import unique_post_traversal, unique_pre_traversal

__all__ = ["Dependence", "Kind", "dependence", "has_branches", "is_affine"]


class Kind(IntEnum):
    """Kinds of dependence, the worse the larger."""

    ABSENT = 0
    POLYNOMIAL = 1
    KINKED = 2
    JUMPING = 3
    OTHER = 4


@dataclass(frozen=True)
class Dependence:
    """How an expression depends on something.

    Attributes:
        kind: of the whole.
        degree: of a polynomial; 0 of what is absent.
        node: the first part of it that is of the kind, where it is no polynomial.
        kinks: all parts that are kinked or jumping by themselves, whatever the whole is.
    """

    kind: Kind
    degree: int = 0
    node: Any = None
    kinks: tuple[Any, ...] = ()

    @property
    def is_affine(self) -> bool:
        """Whether it is a polynomial of degree 1 at most."""
        return self.kind <= Kind.POLYNOMIAL and self.degree <= 1

    @property
    def text(self) -> str:
        """The node that made it so, for messages."""
        if self.kind == Kind.POLYNOMIAL:
            return "" if self.degree <= 1 else f"degree {self.degree}"
        return "" if self.node is None else _text(self.node)

    @property
    def text_of_kinks(self) -> str:
        """The outermost kinks, for messages; "" if there are none."""
        shown: list[Any] = []
        for node in reversed(self.kinks):
            if not any(node in set(unique_pre_traversal(other)) for other in shown):
                shown.append(node)
        return " and ".join(dict.fromkeys(_text(node) for node in shown[:_SHOWN]))


def dependence(e: Any, *terminals: Any) -> Dependence:
    """How an expression or a form depends on Functions, Constants or variables, taken together.

    Args:
        e: UFL expression of any shape, or form.
        terminals: what may change, or components of it; a ``ufl.variable`` counts as a whole.
    """
    labels = {t.ufl_operands[1] for t in terminals if isinstance(t, classes.Variable)}
    wanted = {t for t in terminals if not isinstance(t, classes.Variable)}
    found = Dependence(Kind.ABSENT)
    for integrand in _integrands(expand_derivatives(_as_ufl(e))):
        part = _walked(integrand, wanted, labels)
        if part.kinks and not labels:
            # Of a vector or tensor only some components may be used.
            part = Dependence(Kind.ABSENT)
            for component in _components(remove_complex_nodes(integrand)):
                part = _joined(part, _walked(expand_indices(component), wanted, labels))
        found = _joined(found, part)
    return found


def is_affine(form: ufl.Form, terminal: Any) -> bool:
    """Whether a form is affine in one of its Functions or Constants; forms are known again.

    Args:
        form: of any rank.
        terminal: a Function or a Constant, which need not be in the form.
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
    """Whether anything in a form may have kinks or jump: without that its derivatives have none."""
    return any(
        isinstance(node, _BRANCHING)
        for integral in form.integrals()
        for node in unique_pre_traversal(integral.integrand())
    )


_BRANCHING = classes.Conditional | classes.Abs | classes.MaxValue | classes.MinValue
#: By signature, kind of terminal and its place.
_known: dict[tuple[str, bool, int], bool] = {}


def _as_ufl(e: Any) -> Any:
    return e if isinstance(e, ufl.Form) else ufl.as_ufl(e)


def _integrands(e: Any) -> list[Any]:
    return [i.integrand() for i in e.integrals()] if isinstance(e, ufl.Form) else [e]


def _components(e: Any) -> list[Any]:
    """The components of an expression; one that is a scalar itself."""
    return [e[index] if index else e for index in np.ndindex(e.ufl_shape)]


def _text(node: Any) -> str:
    """A node as users write it, where that is short."""
    words = str(node)
    if isinstance(node, classes.Conditional) and isinstance(node.ufl_operands[0], classes.EQ):
        of = node.ufl_operands[0].ufl_operands[0]
        if node == ufl.sign(of):
            words = f"sign({of})"
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}..."


_SHOWN = 2  # kinks in a message
_LONGEST = 120  # letters of a node in a message


# -- the walk --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """What is known of a node: kind, degree, and the node that made it so."""

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
    """That of a sum."""
    worst = max(a, b, key=lambda d: (d.kind, d.degree))
    return Dependence(worst.kind, worst.degree, worst.node, (*a.kinks, *b.kinks))


def _order(part: _Part) -> tuple[int, int]:
    return part.kind, part.degree


def _walked(e: Any, terminals: set[Any], labels: set[Any]) -> Dependence:
    """The dependence of an expression without derivatives but those of terminals."""
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
    """What a node is, of what its operands are."""
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
        return max(parts, key=_order)  # its conditional shows what it makes of it
    if isinstance(node, classes.Abs | classes.MaxValue | classes.MinValue):
        worst = max(parts, key=_order)
        return worst if worst.kind > Kind.KINKED else _Part(Kind.KINKED, node=node)
    return _Part(Kind.OTHER, node=node)


def _power(node: Any, base: _Part) -> _Part:
    """A power of which the base or the exponent hold v."""
    exponent = node.ufl_operands[1]
    if not isinstance(exponent, classes.RealValue):
        return _Part(Kind.OTHER, node=node)
    number = float(exponent)
    if number != round(number) or number < 1:
        return _Part(Kind.OTHER, node=node)
    if base.kind > Kind.POLYNOMIAL:
        return base
    return _Part(Kind.POLYNOMIAL, base.degree * round(number))
