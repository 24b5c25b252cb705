# SPDX-License-Identifier: LGPL-3.0-or-later
"""States of a path by arc length: states of equilibrium under a load that is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.evolution.accepted import AcceptedState, AtRest, Stepper
from dolfinx_contact.evolution.energy import Energies, Forces, forces_at
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory

__all__ = ["OnPath", "PathStepper"]


@dataclass(frozen=True, eq=False)
class OnPath(AtRest):
    """A state of a path; its time is the arc length.

    Attributes:
        gamma: the load there.
    """

    gamma: float


class PathStepper(Stepper):
    """Accepts states of a path, and puts them back with their load.

    Args:
        system: the contact problem and its load.
    """

    kind = "ArcLength"

    def __init__(self, system: ParametricContact):
        super().__init__(system.problem, lambda _: None, None)
        self._system = system

    def start(self, time: float) -> OnPath:
        """The state in the Functions, with the memory that is in the surfaces. Collective."""
        eq = self.problem.equations
        self._system._set(float(self._system.constant.value))
        if all(m is None for m in eq.memory):
            accepted = super().start(time)
            assert isinstance(accepted, OnPath)
            return accepted
        state = self.problem.evaluate()
        return self.accepted(time, state.statuses, eq.memory, forces_at(eq, state), Energies())

    def recalled_under(
        self,
        gamma: float,
        time: float,
        memory: Sequence[Memory | None],
        energies: Energies,
        *,
        first: bool,
    ) -> OnPath:
        """An accepted state of before, under its load; see `Stepper.recalled`. Collective."""
        with self._system.restored():
            self._system._set(gamma)
            accepted = self.recalled(time, memory, energies, first=first)
        assert isinstance(accepted, OnPath)
        return accepted

    def put(self, accepted: AcceptedState) -> None:
        assert isinstance(accepted, OnPath)
        super().put(accepted)
        self._system._set(accepted.gamma)

    def accepted(
        self,
        time: float,
        statuses: Statuses | None,
        memory: tuple[Memory | None, ...],
        forces: Forces,
        energies: Energies,
        *,
        solved: bool = True,
    ) -> OnPath:
        gamma = float(self._system.constant.value)
        return self._accepted(
            OnPath, time, statuses, memory, energies, solved=solved, forces=forces, gamma=gamma
        )
