# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem with held bonds, which neither weaken nor heal."""

from __future__ import annotations

from dataclasses import replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import ContactState, Statuses
from dolfinx_contact.laws import Answers, HeldAnswers

__all__ = ["HeldBonds"]

Array = npt.NDArray[np.float64]


class HeldBonds(ContactEquations):
    """Contact problem whose bonds have a given strength; it shares everything else with another.

    Args:
        equations: other contact problem.
        strengths: strengths of the bonds (`Law.weakening`) of each surface, shape (n,); None for
            laws without bonds.
    """

    def __init__(self, equations: ContactEquations, strengths: list[Array | None]):
        self.__dict__.update(equations.__dict__)
        self._strengths = strengths

    def _contact(
        self, x: PETSc.Vec, u: Array, q: Array, statuses: Statuses | None
    ) -> list[ContactState]:
        states = []
        for i, state in enumerate(super()._contact(x, u, q, statuses)):
            answers = self._answers(i, state)
            codes = answers.required if statuses is None else statuses[i]
            states.append(ContactState(state.kinematics, state.traction, codes, answers))
        return states

    def _answers(self, i: int, state: ContactState) -> Answers:
        """Return the answers of the law with the given strength of the bonds."""
        s = self.surfaces[i]
        strength = self._strengths[i]
        if strength is None:
            return state.answers
        assert s.law.weakening is not None
        fields = {**state.data.fields, s.law.weakening.name: strength}
        return HeldAnswers(
            s.law_at_points(state.jump, state.traction, replace(state.data, fields=fields))
        )
