# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accepted states of a path by arc length: equilibria under a load that is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies, Forces
from dolfinx_contact.evolution.step import AcceptedState, AtRest, Stepper
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem

__all__ = ["OnPath", "PathStepper"]


@dataclass(frozen=True, eq=False)
class OnPath(AtRest):
    """An accepted state of a path; its time is the arc length."""

    @property
    def gamma(self) -> float:
        """Load parameter at the state."""
        assert self.state.gamma is not None
        return self.state.gamma


class PathStepper(Stepper):
    """Accepts states of a path, and puts them back with their load.

    Args:
        system: contact problem with its load parameter.
    """

    def __init__(self, system: ParametricContact):
        super().__init__(system.problem, lambda _: None, None)
        self._system = system

    def start(self, time: float, given: State | None = None) -> AcceptedState:
        accepted = super().start(time, given)
        if given is None or None in given.previous:
            return accepted
        # The statuses of a step, which its end does not determine where points are at a border.
        return replace(accepted, statuses=given.statuses)

    def _take_start(self, given: State) -> None:
        super()._take_start(given)
        gamma = self._system.constant.value if given.gamma is None else given.gamma
        self._system._set(float(gamma))

    def recalled_under(
        self,
        gamma: float,
        time: float,
        memory: Sequence[Memory],
        energies: Energies,
        *,
        first: bool,
    ) -> OnPath:
        """An earlier accepted state under its load; see `Stepper.recalled`. Collective."""
        with self._system.restored():
            self._system._set(gamma)
            accepted = self.recalled(time, memory, energies, first=first)
        assert isinstance(accepted, OnPath)
        return accepted

    def _restore(self, accepted: AcceptedState) -> None:
        assert isinstance(accepted, OnPath)
        super()._restore(accepted)
        self._system._set(accepted.gamma)

    def at_rest(
        self,
        law: ContactProblem,
        evaluation: Evaluation,
        memory: Sequence[Memory],
        time: float,
        energies: Energies,
        forces: Forces,
        *,
        known: bool = True,
        solved: bool = True,
    ) -> OnPath:
        found = super().at_rest(
            law, evaluation, memory, time, energies, forces, known=known, solved=solved
        )
        state = replace(found.state, gamma=float(self._system.constant.value))
        return OnPath(**vars(found) | {"state": state})
