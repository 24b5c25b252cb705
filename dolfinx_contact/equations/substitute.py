# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem with other answers at its points, for methods that lead to it by others.

A friction bound that is given (Tresca's problem) in the place of Coulomb's, or contact that yields:
the law answers to tractions that are held in the place of those that it answers with; or bonds that
are held as they are.
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
    """A contact problem that shares all with another but what is answered at its points.

    Args:
        equations: the other.
        answers: to a state of a surface, by its number.
        kind: of the states.
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
    """Tresca's problem with friction bounds given at the points.

    Args:
        equations: the contact problem.
        bounds: tractions (n,), surface by surface.
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
        # A friction bound rubs on open points too.
        return [np.where(c == OPEN, PLUS + WHERE_OPEN, c).astype(np.int8) for c in statuses]


class HeldBonds(_Substitute):
    """Bonds of a strength that is given, which neither weaken nor heal.

    Args:
        equations: the contact problem.
        strengths: what memory has of the bonds (n,), surface by surface (`Law.weakening`); None
            where a law has none.
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
    """Contact that yields by the augmentation r about tractions that are held.

    Args:
        equations: the contact problem.
        tractions: held (n, dim), surface by surface; of a penalty zero.
    """

    def __init__(self, equations: ContactEquations, tractions: list[Array]):
        def answers(i: int, state: ContactState) -> Answers:
            law = equations.surfaces[i].law_at_points
            return law(state.jump, tractions[i], state.data)

        super().__init__(equations, answers, _YieldingState)


class _YieldingState(ContactState):
    """A surface whose answers do not depend on its tractions."""

    @cached_property
    def by_traction(self) -> Array:
        """Zero."""
        return np.zeros_like(self.by_jump)

    @property
    def spread_by(self) -> tuple[Array, Array]:
        by_jump, by_traction = super().spread_by
        return by_jump, np.zeros_like(by_traction)
