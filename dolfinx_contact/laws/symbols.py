# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL symbols for the data of a contact point, used to compile laws.

For laws depending on time, `known_step` evaluates conditions on the duration of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from operator import eq, ge, gt, le, lt, ne
from typing import Any, NamedTuple

import ufl
from ufl.algorithms import expand_derivatives
from ufl.classes import EQ, GE, GT, LE, LT, NE, NotCondition, OrCondition, Variable
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._forms import point_data
from dolfinx_contact.laws.law import ContactPoint, Equations, Law

__all__ = [
    "AROUND",
    "SLID",
    "STEP",
    "Solved",
    "Symbols",
    "before",
    "known_step",
    "variable",
]

#: Field of a nonlocal law: the average over neighbouring points.
AROUND = ".around"
#: Time since the last accepted state, and slip distance at that state.
STEP = ".step"
SLID = ".slid"
_FIRST_LABEL = 10**9  # larger than the labels assigned by UFL
_FIRST_SOLVED = 1000  # offset from the first label


class Solved(NamedTuple):
    """Symbols for the solution of a system of equations of a law.

    Attributes:
        first: column of the first unknown in the data of a point.
        numbers: symbols of the scalar unknowns.
        inverse: symbols of the inverse of the Jacobian matrix, by row and column.
    """

    first: int
    numbers: tuple[Any, ...]
    inverse: list[list[Any]]


def before(dim: int) -> list[str]:
    """Return the names of the components of the jump at the last accepted state."""
    return [f".before_{i}" for i in range(dim)]


def variable(e: Any, number: int) -> Any:
    """Return ``e`` as a UFL variable for differentiation.

    ``number`` determines its label, which enters the signature of the expression. Labels counted by
    UFL would cause every program to compile the expression again.
    """
    return ufl.classes.Variable(e, ufl.classes.Label(_FIRST_LABEL + number))


class Symbols:
    """UFL symbols of a contact point: jump, traction, normal, gap, augmentation and named fields.

    Args:
        law: law; its field values are not used.
        dim: dimension, 2 or 3.
        memory: names of the data of the last accepted state that are used, without fields of the
            law; default: None (all).

    Attributes:
        names: names of all fields, in the order of their columns: fields of the law, data of the
            last accepted state, and `AROUND` for a nonlocal law.
        w: Function with the values of all data, one cell per point.
        jump, traction, n: UFL vectors; n is the normal.
        fields: UFL scalars, in the order of `names`.
        solved: for each system of equations, its unknowns and the inverse of its Jacobian matrix in
            row-major order; stored in the last columns.
    """

    def __init__(self, law: Law, dim: int, memory: Sequence[str] | None = None):
        self._dim = dim
        self._given = list(law.given)
        self._kept = [name for name in law.memory(dim) if name not in self._given]
        self._memory = [*before(dim), STEP, SLID, *self._kept]
        around = [] if law.averaging is None else [AROUND]
        self.names = [*self._given, *(self._memory if memory is None else memory), *around]
        unknowns = law.unknowns(dim)
        first = 3 * dim + 2 + len(self.names)
        width = first + sum(n + n * n for n in unknowns.values())
        self.w = w = point_data(width)
        self.jump, self.traction, self.n = (
            variable(ufl.as_vector([w[i * dim + k] for k in range(dim)]), i) for i in range(3)
        )
        columns = range(3 * dim + 2, first)
        self.fields = [variable(w[column], 3 + i) for i, column in enumerate(columns)]
        self._known = dict(zip(self.names, self.fields, strict=True))
        self.solved: dict[Hashable, Solved] = {}
        for name, n in unknowns.items():
            numbers = tuple(variable(w[first + i], _FIRST_SOLVED + first + i) for i in range(n))
            inverse = [[w[first + n + n * i + k] for k in range(n)] for i in range(n)]
            self.solved[name] = Solved(first, numbers, inverse)
            first += n + n * n

    @property
    def of_the_law(self) -> dict[str, Any]:
        """Symbols of the scalar fields of the law, by name."""
        return {name: self._known[name] for name in self._given}

    @property
    def point(self) -> ContactPoint:
        """Contact point made of these symbols, which is passed to the methods of the law."""
        gap = self.w[3 * self._dim]
        r = self.w[3 * self._dim + 1]
        point = ContactPoint(self.jump, self.traction, self.n, gap, r, self._dim)
        # Symbols not used by the law have arbitrary values.
        slid, step = (self._known.get(name, 0.0) for name in (SLID, STEP))
        return replace(
            point,
            slid=slid + ufl.sqrt(ufl.dot(point.u_t, point.u_t)),
            around=self._known.get(AROUND),
            before=ufl.as_vector([self._known.get(name, 0.0) for name in before(self._dim)]),
            step=ufl.as_ufl(step),
            slid_before=slid,
            kept={name: self._known.get(name, ufl.as_ufl(0.0)) for name in self._kept},
            solved={name: of.numbers for name, of in self.solved.items()},
        )

    @property
    def step(self) -> Any | None:
        """Symbol for the duration of the step; None if the law does not use it."""
        return self._known.get(STEP)

    def exact(self, equations: Mapping[Hashable, Equations]) -> dict[Hashable, tuple[Any, ...]]:
        """Return the solutions of equations, differentiable with respect to all data.

        Each expression is one Newton step x - G F with a constant inverse Jacobian G, from the
        solution x of F(x, j) = 0. It equals x, and its derivative with respect to the data j is -G
        dF/dj, as in the implicit function theorem.
        """
        found = {}
        for name, of in self.solved.items():
            F = equations[name].residual
            found[name] = tuple(
                x - sum(g * f for g, f in zip(row, F, strict=True))
                for x, row in zip(of.numbers, of.inverse, strict=True)
            )
        return found

    def used(self, expressions: Iterable[Any]) -> list[str]:
        """Return the names of the data of the last accepted state that occur in expressions.

        If a component of the jump at the last accepted state occurs, all its components are listed.
        """
        nodes = set(unique_pre_traversal(ufl.as_vector(list(expressions))))
        found = {name for name, symbol in self._known.items() if symbol in nodes}
        jump = before(self._dim)
        found |= set(jump) if found & set(jump) else set()
        return [name for name in self._memory if name in found]


# -- laws at a known duration of the step ----------------------------------------------------------

_COMPARED: dict[type, Callable[[float, float], bool]] = {
    EQ: eq, GE: ge, GT: gt, LE: le, LT: lt, NE: ne
}  # fmt: skip


def known_step(e: Any, symbol: Variable, step: float) -> Any:
    """Evaluate all comparisons of the step duration with numbers in a UFL expression.

    Args:
        e: scalar UFL expression.
        symbol: symbol for the duration of the step.
        step: 0, or any number with the sign of the durations for which comparisons are evaluated.
    """
    return map_expr_dag(_Decided(symbol, step), expand_derivatives(e))


class _Decided(MultiFunction):  # type: ignore[misc]
    """UFL transformation that replaces conditionals by the branch that applies to a given step."""

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
        """Return the value of a condition; None if the sign of the step does not determine it."""
        compare = _COMPARED.get(type(c))
        if compare is not None:
            left, right = (self._number(part) for part in c.ufl_operands)
            if left is None or right is None:
                return None
            # A negative step can only be compared with nonnegative numbers.
            return compare(left, right) if max(left, right) >= 0 else None
        answers = [self._answer(part) for part in c.ufl_operands]
        if isinstance(c, NotCondition):
            return None if answers[0] is None else not answers[0]
        decides = isinstance(c, OrCondition)
        if decides in answers:
            return decides
        return None if None in answers else not decides

    def _number(self, e: Any) -> float | None:
        if e == self._symbol:
            return self._step
        return float(e) if isinstance(e, ufl.constantvalue.ScalarValue | ufl.classes.Zero) else None
