# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Evolutions of a contact problem, run by run.

A run goes from an accepted state to the next one, x_0 -> x_1 -> x_2 ..., by a rule (`run.Rule`)
that takes steps with a stepper (`step.Stepper`). It starts from a given `State`, from the end of
the last run, or, in the first run, from the Functions with virgin memory. An evolution stores the
state at the end of its last run, `Runnable.put` replaces it, and `Runnable.go_on` continues an
interrupted run. `Evolution` is the base of histories and motions; paths by arc length have no time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import ufl
from dolfinx import fem

from dolfinx_contact._mpi import collective, everywhere, require
from dolfinx_contact._validate import ReadOnly
from dolfinx_contact.equations.data import Datum
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.history import History, NoContinuation
from dolfinx_contact.evolution.run import Listeners, Run, RunState
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.evolution.through_times import HistoryTask, ThroughTimes
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem

__all__ = ["Evolution", "Runnable"]

T = TypeVar("T")
S = TypeVar("S", bound=RunState)
H = TypeVar("H", bound=History)


class Runnable(ReadOnly, Generic[T, S, H]):
    """An evolution of a contact problem; each run starts where the last one has ended.

    Attributes:
        problem: contact problem, whose Functions follow the accepted steps.
        account: class of the energies.
        method: parameters of the method in words, for the manifest of a record.
        data: Functions and Constants in addition to those of the problem, such as a density.
        forms: forms in addition to those of the problem, such as damping.
        driven: expressions by which a load drives Dirichlet data.
    """

    account: type[Energies] = Energies
    method: Sequence[str] = ()
    data: Sequence[Datum] = ()
    forms: Sequence[ufl.Form] = ()
    driven: Sequence[Any] = ()
    problem: ContactProblem
    #: Class of the records, for messages.
    _record: ClassVar[str]
    #: State of the last run at its end; None before the first run.
    _run_state: S | None = None

    @collective(
        "a run that continues",
        lambda a: a.listeners.check(a.self._record),
        local=("task", "run_state", "listeners"),
    )
    def go_on(self, task: T, run_state: S, listeners: Listeners) -> H:
        """Continue an interrupted run, as a record does. Collective.

        Args:
            task: task of the run.
            run_state: state of the run where it was interrupted.
            listeners: listeners of the remaining steps.

        Returns:
            History of the remaining steps. Errors are those of a run.
        """
        self._has_begun()
        return self._run(task, run_state, listeners)

    def put(self, run_state: S) -> None:
        """Put the end of a run into the problem; the next run starts from it. Collective."""
        self._has_begun()
        self._run_state = run_state
        self.stepper(None).put(run_state.accepted)

    @property
    def memory(self) -> tuple[Memory | None, ...]:
        """Memory from which the next step starts, one per surface; None before the first run."""
        return self.problem.equations.memory if self._accepted is None else self._accepted.memory

    @property
    def _accepted(self) -> AcceptedState | None:
        """Last accepted state; None before the first run."""
        return None if self._run_state is None else self._run_state.accepted

    def _require_start(self, start: State | None) -> None:
        """Raise ``ValueError`` if a first run must name its start and does not. Collective.

        Bonds would heal silently if an evolution began with virgin memory where another has ended.
        """
        require(
            self.problem.comm,
            start is not None or not self.problem.evolved,
            "the problem has had another evolution: pass start=history.steps[-1].state to continue "
            "from the end of that one, or start=problem.snapshot() to start from the Functions as "
            "they are with virgin memory",
        )

    def _has_begun(self) -> None:
        """Record in the problem that it has an evolution. Not collective."""
        self.problem.evolved.append(type(self).__name__)

    def stepper(self, progress: bool | None) -> Stepper:
        """Return a stepper of the problem; ``progress`` is that of its solves."""
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


class Evolution(Runnable[HistoryTask, RunState, History]):
    """A contact problem in time, the base of quasi-static histories and motions.

    Args:
        problem: contact problem.
        load: function of the time, called on every rank before each step, that sets Constants and
            Functions of the data to their values at that time.

    Attributes:
        problem: contact problem as given.
        load: load as given; it may be replaced between two runs.
        kept: Functions of a state in addition to those of the problem, by name.

    Raises:
        ValueError: on every rank, if an argument is not admissible.
    """

    _may_be_set = ("load",)
    _instead: ClassVar[Mapping[str, str]] = {
        "": "the load sets values of Constants and Functions in time; for other changes make "
        "another evolution"
    }
    _record = "a records.EvolutionRecord"
    kept: Mapping[str, fem.Function] = {}

    def __init__(self, problem: ContactProblem, load: Callable[[float], object]):
        if not isinstance(problem, ContactProblem):
            raise ValueError(f"a ContactProblem is needed, got {type(problem).__name__}")
        with everywhere(problem.comm, "an evolution"):
            if not callable(load):
                raise ValueError(f"the load must be a function of the time, got {load!r}")
            for s in problem.surfaces:
                lack = s.law.lacks(history=True)
                if lack:
                    raise ValueError(f"{s.name}: the law {s.law.name} lacks {lack}")
        self.problem = problem
        self.load = load

    def stepper(self, progress: bool | None) -> Stepper:
        return Stepper(self.problem, self.load, False if progress is False else None)

    def _begin(self, task: HistoryTask, listeners: Listeners, start: State | None) -> History:
        """Run from a given state, the end of the last run, or the Functions. Collective.

        Args:
            task: task of the run.
            listeners: listeners of the run; like the task they are checked.
            start: state at the start, if given.
        """
        stepper = self.stepper(listeners.progress)
        before = self._run_state if start is None else None
        if before is None:
            self._require_start(start)
        try:
            stepper.require_repeatable(task.times[0], task.times[-1])
            if before is None:
                run_state = RunState(stepper.start(task.times[0], start), task.longest)
            else:
                accepted = stepper.continued(before.accepted)
                run_state = RunState(accepted, task.longest, before.rate, before.number)
        except BaseException:
            if before is not None:
                stepper.put(before.accepted)
            raise
        self._has_begun()
        return self._run(task, run_state, listeners)

    def _run(self, task: HistoryTask, run_state: RunState, listeners: Listeners) -> History:
        stepper = self.stepper(listeners.progress)
        rule = ThroughTimes(stepper, task, run_state)
        history = History(run_state.accepted.time, run_state.accepted.energies)
        self._follow(Run(stepper, rule, listeners, history))
        if rule.failed and task.at_jump != "stop":
            raise NoContinuation(history.reason, history) from rule.failure
        return history
