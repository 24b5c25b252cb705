# SPDX-License-Identifier: LGPL-3.0-or-later
"""Auxiliary contact problems that differ in the answers of the law at contact points.

Tresca's problem has given friction bounds instead of Coulomb's. In the problem of compliant contact
the law answers to given tractions. In the problem of held bonds, bonds neither weaken nor heal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import ContactState, Statuses
from dolfinx_contact.laws import Answers, HeldAnswers, LawAtPoints, Tresca
from dolfinx_contact.laws.status import OPEN, PLUS, WHERE_OPEN

__all__ = ["GivenBounds", "HeldBonds", "YieldingContact"]

Array = npt.NDArray[np.float64]


class _Substitute(ContactEquations):
    """Contact problem that shares everything with another one except the answers of the law.

    Args:
        equations: other contact problem.
        answers: function of the number of a surface and its evaluation that returns the answers.
        kind: class of the evaluations.
    """

    def __init__(
        self,
        equations: ContactEquations,
        answers: Callable[[int, ContactState], Answers],
        kind: type[ContactState],
    ):
        self.__dict__.update(equations.__dict__)
        self._answers = answers
        self._kind = kind

    def _contact(
        self, x: PETSc.Vec, u: Array, q: Array, statuses: Statuses | None
    ) -> list[ContactState]:
        found = []
        for i, state in enumerate(super()._contact(x, u, q, statuses)):
            answers = self._answers(i, state)
            codes = answers.required if statuses is None else statuses[i]
            found.append(self._kind(state.kinematics, state.traction, codes, answers))
        return found


class GivenBounds(_Substitute):
    """Tresca's problem with given friction bounds.

    Args:
        equations: contact problem.
        bounds: friction bounds at the points of each surface, stresses, shape (n,).
    """

    def __init__(self, equations: ContactEquations, bounds: list[Array]):
        laws = [
            LawAtPoints(Tresca(0.0), s.dim, s.points.number, s.comm) for s in equations.surfaces
        ]

        def answers(i: int, state: ContactState) -> Answers:
            given = replace(state.data, fields={"threshold": bounds[i]})
            return laws[i](state.jump, state.traction, given)

        super().__init__(equations, answers, ContactState)

    def as_possible(self, statuses: Statuses) -> Statuses:
        # A given friction bound also acts on open points.
        return [np.where(c == OPEN, PLUS + WHERE_OPEN, c).astype(np.int8) for c in statuses]


class HeldBonds(_Substitute):
    """Contact problem whose bonds have a given strength.

    Args:
        equations: contact problem.
        strengths: strengths of the bonds (`Law.weakening`) of each surface, shape (n,); None for
            laws without bonds.
    """

    def __init__(self, equations: ContactEquations, strengths: list[Array | None]):
        def answers(i: int, state: ContactState) -> Answers:
            s = equations.surfaces[i]
            strength = strengths[i]
            if strength is None:
                return state.answers
            assert s.law.weakening is not None
            fields = {**state.data.fields, s.law.weakening.name: strength}
            data = replace(state.data, fields=fields)
            return HeldAnswers(s.law_at_points(state.jump, state.traction, data))

        super().__init__(equations, answers, ContactState)


class YieldingContact(_Substitute):
    """Compliant contact, with the compliance 1 / r, relative to given tractions.

    Args:
        equations: contact problem.
        tractions: given tractions of each surface, shape (n, dim); zero for a penalty method.
    """

    def __init__(self, equations: ContactEquations, tractions: list[Array]):
        def answers(i: int, state: ContactState) -> Answers:
            law = equations.surfaces[i].law_at_points
            return law(state.jump, tractions[i], state.data)

        super().__init__(equations, answers, _YieldingState)


class _YieldingState(ContactState):
    """Evaluation of a surface whose answers do not depend on its tractions."""

    @cached_property
    def by_traction(self) -> Array:
        """Zero."""
        return np.zeros_like(self.by_jump)

    @property
    def spread_by(self) -> tuple[Array, Array]:
        by_jump, by_traction = super().spread_by
        return by_jump, np.zeros_like(by_traction)
