# SPDX-License-Identifier: LGPL-3.0-or-later
"""The common base of histories, motions and paths: evolutions that continue run by run."""

from __future__ import annotations

from typing import ClassVar, Generic, TypeVar

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import require
from dolfinx_contact._frozen import ReadOnly
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.history import History
from dolfinx_contact.evolution.listeners import Listeners
from dolfinx_contact.evolution.run import Run
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem

__all__ = ["Runnable"]

T = TypeVar("T")
S = TypeVar("S", bound=RunState)
H = TypeVar("H", bound=History)


def _check(a: Arguments) -> None:
    a.listeners.check(a.self._record)


class Runnable(ReadOnly, Generic[T, S, H]):
    """An evolution of a contact problem; each run starts where the one before has ended.

    Attributes:
        problem: contact problem, whose Functions follow the accepted steps.
        account: class of the energies.
    """

    account: type[Energies] = Energies
    problem: ContactProblem
    #: Name of the class of its records, for messages.
    _record: ClassVar[str]
    #: State of the last run at its end; None before the first run.
    _run_state: S | None = None

    @collective(
        "a run that continues",
        _check,
        compare=lambda a: a.listeners.compared(),
        local=("task", "run_state", "listeners"),
    )
    def go_on(self, task: T, run_state: S, listeners: Listeners) -> H:
        """Continue an interrupted run, as a record does. Collective.

        Args:
            task: task of the run.
            run_state: state of the run where it was interrupted.
            listeners: observers of the remaining steps.

        Returns:
            The history of the remaining steps. Errors are those of a run.
        """
        self._has_begun()
        return self._run(task, run_state, listeners)

    def put(self, run_state: S) -> None:
        """Put the end of a run into the problem, from which the next run continues. Collective."""
        self._has_begun()
        self._run_state = run_state
        self._stepper(None).put(run_state.accepted)

    @property
    def memory(self) -> tuple[Memory | None, ...]:
        """Memory from which the next step starts, one per surface; None before the first run."""
        return self.problem.equations.memory if self._accepted is None else self._accepted.memory

    @property
    def _accepted(self) -> AcceptedState | None:
        """The last accepted state; None before the first run."""
        return None if self._run_state is None else self._run_state.accepted

    def _require_start(self, start: State | None) -> None:
        """Raise ``ValueError`` if a first run does not say where it starts but must. Collective.

        Bonds would heal silently if an evolution began with virgin memory where another has ended.

        Args:
            start: state at the start, if given.
        """
        require(
            self.problem.comm,
            start is not None or not self.problem.evolved,
            "the problem has had another evolution: pass start=history.steps[-1].state to continue "
            "from the end of that one, or start=problem.snapshot() to start from the Functions as "
            "they are with virgin memory",
        )

    def _has_begun(self) -> None:
        """Note that the problem has an evolution. Not collective."""
        self.problem.evolved.append(type(self).__name__)

    def _stepper(self, progress: bool | None) -> Stepper:
        """A stepper of the problem.

        Args:
            progress: whether solves show their progress; see `QuasiStatic.run`.
        """
        raise NotImplementedError

    def _run(self, task: T, run_state: S, listeners: Listeners) -> H:
        """Run from a state of a run to its end. Collective."""
        raise NotImplementedError

    def _follow(self, run: Run[T, S, H]) -> None:
        """Run to the end and store the last accepted state, also after an error. Collective."""
        try:
            run.go()
        finally:
            self._run_state = run.run_state or self._run_state
