# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simplification of time-dependent laws for static problems."""

from __future__ import annotations

from collections.abc import Callable
from operator import eq, ge, gt, le, lt, ne
from typing import Any

import ufl
from ufl.algorithms import expand_derivatives
from ufl.classes import (
    EQ,
    GE,
    GT,
    LE,
    LT,
    NE,
    AndCondition,
    NotCondition,
    OrCondition,
    Variable,
)
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

__all__ = ["known_step"]

_COMPARED: dict[type, Callable[[float, float], bool]] = {
    EQ: eq, GE: ge, GT: gt, LE: le, LT: lt, NE: ne
}  # fmt: skip


def known_step(e: Any, symbol: Variable, step: float) -> Any:
    """Return a UFL expression with all comparisons of the time step and numbers evaluated.

    Args:
        e: scalar UFL expression.
        symbol: symbol for the time step.
        step: 0, or a negative number that represents all negative steps.
    """
    return map_expr_dag(_Decided(symbol, step), expand_derivatives(e))


class _Decided(MultiFunction):  # type: ignore[misc]
    """Replace conditionals by the branch that applies to the given step."""

    def __init__(self, symbol: Variable, step: float):
        super().__init__()
        self._symbol = symbol
        self._step = step

    def expr(self, o: Any, *operands: Any) -> Any:
        return self.reuse_if_untouched(o, *operands)

    def variable(self, o: Any, *operands: Any) -> Any:
        # Preserve the variable of differentiation; elsewhere use the simplified expression.
        return o if o == self._symbol else self.reuse_if_untouched(o, *operands)

    def conditional(self, o: Any, condition: Any, yes: Any, no: Any) -> Any:
        answer = self._answer(condition)
        if answer is None:
            return self.reuse_if_untouched(o, condition, yes, no)
        return yes if answer else no

    def _answer(self, c: Any) -> bool | None:
        """Return the value of a condition; None if it depends on other data."""
        if isinstance(c, NotCondition):
            inside = self._answer(c.ufl_operands[0])
            return None if inside is None else not inside
        if isinstance(c, AndCondition | OrCondition):
            decides = isinstance(c, OrCondition)
            both = [self._answer(part) for part in c.ufl_operands]
            if decides in both:
                return decides
            return None if None in both else not decides
        compare = _COMPARED.get(type(c))
        if compare is None:
            return None
        left, right = (self._number(part) for part in c.ufl_operands)
        if left is None or right is None:
            return None
        # A negative step can only be compared with nonnegative numbers.
        return compare(left, right) if max(left, right) >= 0 else None

    def _number(self, e: Any) -> float | None:
        if e == self._symbol:
            return self._step
        return float(e) if isinstance(e, ufl.constantvalue.ScalarValue | ufl.classes.Zero) else None
