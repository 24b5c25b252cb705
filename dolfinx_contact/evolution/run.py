# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of histories, motions and paths: the loop over their accepted steps.

A run proceeds from one accepted state to the next, x_0 -> x_1 -> x_2 ... A `Rule` chooses the steps
(through given times, to rest, or by arc length) and a `step.Stepper` takes them. `Run.go` handles
each accepted step in this order:

    step = next(rule.steps())            the rule takes a step and accepts it
    stop(step)                           the user may end the run
    record.step, observer.step           the step is recorded first
    warnings, progress

The accepted state is put into the problem before each user function is called, so that values
written to the Functions affect neither other listeners nor the next step. After an error the
problem is in the last accepted state. `Runnable` is the base of the user-facing classes. A run
starts from a given `State`, from the end of the last run, or, in the first run, from the Functions
with virgin memory (no slip, intact bonds).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, TypeVar

import ufl

from dolfinx_contact._arrays import Array
from dolfinx_contact._ending import Ending
from dolfinx_contact._mpi import Arguments, collective, require
from dolfinx_contact._progress import Progress
from dolfinx_contact._validate import ReadOnly
from dolfinx_contact.continuation.arguments import check_listeners, reason_to_stop
from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.observer import (
    CollectiveObserver,
    Observer,
    ObserverLike,
    Stop,
)
from dolfinx_contact.equations.data import Datum
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem

__all__ = ["Ended", "Listeners", "Rule", "Run", "RunState", "Runnable"]

T = TypeVar("T")
H = TypeVar("H", bound=History)


@dataclass(frozen=True, eq=False)
class RunState:
    """State of a run between two steps, with all data required by the next step.

    Attributes:
        accepted: last accepted state.
        length: length of the next step, or an upper bound of it.
        number: number of the last step, over all runs; 0 before the first.
        settled: whether the run can be resumed from the state; False between the steps of one
            search for a jump.
        ending: kind of the end of the run at the state (`Ending`); None if the run continues.
        reason: reason for the end of the run, as a sentence.
        rate: rates of change in the last step of a history or motion (`jumps.StateChanges`); None
            before the first step and on paths.
        arrived: accepted state of a path as a branch point, with the statuses and the tangent of
            the step that ended there; None at the start.
        known: scales and signs that the steps of a path have determined (`ArcSteps.known`).
        passed: arc lengths of all points of a path in this run, including the start of the run.
    """

    accepted: AcceptedState
    length: float = 0.0
    number: int = 0
    settled: bool = True
    ending: Ending | None = None
    reason: str = ""
    rate: Array | None = None
    arrived: BranchPoint | None = None
    known: Mapping[str, Any] = field(default_factory=dict)
    passed: Sequence[float] = ()


class Ended(Exception):
    """Exception that ends a run if no step continues it; its text is the reason.

    Attributes:
        ending: why the run ends (`Ending`).
    """

    def __init__(self, ending: Ending, reason: str):
        super().__init__(reason)
        self.ending = ending


class Rule(ABC, Generic[T]):
    """Rule that chooses the next step of a run.

    Args:
        task: arguments of the run.
        state: state of the run at its start or where it is resumed.

    Attributes:
        task: arguments of the run.
        start: initial state of the run.
        state: state of the run after the last step.
        stuck: reason why no step continues the run; None otherwise.
    """

    #: Nouns for the run and for its steps, for messages.
    what: ClassVar[str]
    units: ClassVar[str]

    def __init__(self, task: T, state: RunState):
        self.task = task
        self.start = state
        self.state = state
        self.stuck: Ended | None = None

    def end(self, ending: Ending, reason: str = "") -> None:
        """End the run in its present state. The default reason is the text of the `Ending`."""
        self.state = replace(self.state, ending=ending, reason=reason or ending.value)

    def begin(self) -> None:
        """Check the start, which is in the Functions, before it is recorded. Collective.

        Raises:
            ValueError: on every rank, if a run cannot start from this state.
        """

    @abstractmethod
    def steps(self) -> Iterator[EvolutionStep]:
        """Yield the accepted steps until the run ends. Collective.

        After each step, `state` is the state at its end, with an `Ending` if the run ends there.
        The Functions may contain another state.

        Raises:
            Ended: on every rank, if no step continues the run.
        """

    @abstractmethod
    def where(self, step: EvolutionStep) -> str:
        """Describe the position of the run after a step, for the progress line."""

    def part(self, step: EvolutionStep) -> float | None:
        """Return the fraction of the run that is complete after a step; None if it is unknown."""

    def close(self) -> None:
        """Free matrices and solvers of the rule. Collective."""

    def require_continuation(self, history: History) -> None:
        """Raise `NoContinuation` if the run ended with an error. Not collective."""


@dataclass(frozen=True)
class Listeners:
    """Functions and observers that the user passes to a run; see `QuasiStatic.run`.

    Attributes:
        stop: function of an accepted step that returns the reason to end the run there, or "" to
            continue.
        observer: observer of every accepted step.
        record: record storing every accepted step.
        progress: whether rank 0 shows the progress of the run.
    """

    stop: Stop[Any] | None = None
    observer: ObserverLike[Any] | None = None
    record: Observer | None = None
    progress: bool | None = None

    @classmethod
    def of(cls, a: Arguments) -> Listeners:
        """Return the listeners contained in the arguments of a run."""
        return cls(a.stop, a.observer, a.record, a.progress)

    def check(self, record: str) -> None:
        """Raise `ValueError` if a listener has a wrong type. Not collective.

        Args:
            record: name of the class of the records, for the message.
        """
        check_listeners(**vars(self), of=record)


class Run(Generic[T, H]):
    """Loop over the accepted steps of a run.

    Args:
        stepper: stepper that puts states into the problem.
        rule: rule that chooses the steps.
        listeners: the user's listeners, validated.
        history: history to which the steps, and the reason for the end of the run, are added.

    Attributes:
        state: state of the run after the last accepted step; None before the start.
    """

    def __init__(self, stepper: Stepper, rule: Rule[T], listeners: Listeners, history: H):
        self.state: RunState | None = None
        self._stepper = stepper
        self._rule = rule
        self._stop = listeners.stop
        self._history = history
        self._warned: set[str] = set()  # names of the warnings that this run has logged
        comm = stepper.problem.comm
        self._observers = CollectiveObserver(comm, self._put, listeners.record, listeners.observer)
        self._progress = Progress(comm, listeners.progress)

    def go(self) -> H:
        """Take steps until the run ends. Afterwards the problem is in the last accepted state.

        Collective.

        Raises:
            ValueError: on every rank, if the run cannot begin. Errors of listeners are raised on
                every rank.
        """
        rule = self._rule
        history = self._history
        try:
            self._put()
            rule.begin()
            problem = self._stepper.problem
            history.begin(rule.start.number, problem)
            self._observers.begin(rule.task, rule.start)
            self.state = rule.start
            if rule.state.ending is None:
                self._take_steps()
            assert rule.state.ending is not None
            history.end(rule.state.ending, rule.state.reason)
        finally:
            self._put()
            number = len(history.steps)
            self._progress.close(f"{rule.what}: {number} {rule.units}, {history.reason}")
        try:
            self._observers.end(history)
        finally:
            self._put()
        return history

    def _take_steps(self) -> None:
        """Take and handle steps until the run ends. Collective."""
        rule = self._rule
        try:
            for step in rule.steps():
                self._handle(step)
                if rule.state.ending is not None:
                    return
        except Ended as ended:
            rule.end(ended.ending, str(ended))
            rule.stuck = ended

    def _put(self) -> None:
        """Put the last accepted state into the problem. Collective."""
        self._stepper.put((self.state or self._rule.start).accepted)

    def _handle(self, step: EvolutionStep) -> None:
        """Add an accepted step to the history and call the listeners. Collective."""
        rule = self._rule
        problem = self._stepper.problem
        self._history.steps.append(step)
        self.state = rule.state
        if self._stop is not None and rule.state.ending is None:
            self._put()
            reason = reason_to_stop(problem.comm, rule.what, self._stop, step)
            if reason:
                rule.end(Ending.STOPPED, reason)
                self.state = rule.state
        self._observers.step(step, self.state)
        self._put()
        problem.log_warnings(step.result.warnings, self._warned)
        self._show(step)

    def _show(self, step: EvolutionStep) -> None:
        """Show the position of the run, the numbers of statuses, and elapsed and remaining time."""
        if not self._progress.due:
            return
        rule = self._rule
        seconds = self._progress.seconds
        counts = ", ".join(f"{n} {k}" for k, n in step.result.counts.items() if n)
        time = f"{seconds:.0f} s"
        part = rule.part(step)
        if part:
            time += f", about {seconds * (1 - part) / part:.0f} s left"
        if step.jump:
            self._progress.write(f"{rule.what}: the state jumps at the time {step.start:.10g}")
        self._progress.update(f"{rule.what}: {rule.where(step)}  {counts}  {time}")


class Runnable(ReadOnly, Generic[T, H]):
    """Base class of evolutions; each run starts where the previous one ended.

    Attributes:
        problem: contact problem, whose Functions follow the accepted steps.
        account: class of the energies, `Energies` or a subclass.
        method: lines that describe the parameters of the method, for the manifest of a record.
        data: Functions and Constants in addition to those of the problem, such as a density.
        forms: forms in addition to those of the problem, such as damping.
        driven: expressions that define Dirichlet data as functions of a load.
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
    _run_state: RunState | None = None

    # -- parts that differ between histories, motions and paths ----------------------------------

    def stepper(self, progress: bool | None) -> Stepper:
        """Create a stepper of the problem.

        Args:
            progress: whether solves show their progress, as in `ContactProblem.solve`.
        """
        raise NotImplementedError

    def history(self, run_state: RunState) -> H:
        """Create an empty history that starts from a state of a run."""
        raise NotImplementedError

    def begun(self, task: T, run_state: RunState) -> RunState:
        """Return the initial state of a new run starting where the previous one ended."""
        raise NotImplementedError

    def _rule(self, stepper: Stepper, task: T, run_state: RunState) -> Rule[T]:
        """Return the rule that chooses the steps of a run."""
        raise NotImplementedError

    def _accepted_start(self, stepper: Stepper, task: T, start: State | None) -> AcceptedState:
        """Return the start of a run: a given state, the end of the last run, or the Functions.

        Collective.
        """
        raise NotImplementedError

    # -- runs ------------------------------------------------------------------------------------

    @property
    def memory(self) -> tuple[Memory | None, ...]:
        """Memory from which the next step starts, one per surface; None before the first run."""
        return self.problem.equations.memory if self._accepted is None else self._accepted.memory

    @property
    def _accepted(self) -> AcceptedState | None:
        """Last accepted state; None before the first run."""
        return None if self._run_state is None else self._run_state.accepted

    @collective(
        "a run that continues",
        lambda a: a.listeners.check(a.self._record),
        local=("task", "run_state", "listeners"),
    )
    def go_on(self, task: T, run_state: RunState, listeners: Listeners) -> H:
        """Continue an interrupted run, for example from a record. Collective.

        Args:
            task: arguments of the run.
            run_state: state of the run where it was interrupted.
            listeners: listeners of the remaining steps.

        Returns:
            History of the remaining steps.
        """
        self._has_begun()
        return self._run(task, run_state, listeners)

    def put(self, run_state: RunState) -> None:
        """Put the end of a run into the problem as the start of the next run. Collective."""
        self._has_begun()
        self._run_state = run_state
        self.stepper(None).put(run_state.accepted)

    def _begin(self, task: T, listeners: Listeners, start: State | None) -> H:
        """Run from a given state, the end of the last run, or the Functions. Collective.

        Args:
            task: arguments of the run.
            listeners: listeners of the run, validated like the task.
            start: state at the start, if given.

        Raises:
            ValueError: on every rank, if ``start`` is missing in a first run that requires it,
                because the problem has had another evolution. With virgin memory (no slip, intact
                bonds), bonds broken in that evolution would heal silently.
        """
        before = self._run_state if start is None else None
        require(
            self.problem.comm,
            start is not None or before is not None or not self.problem.evolved,
            "the problem has had another evolution: pass start=history.steps[-1].state to continue "
            "from the end of that one, or start= a state before it, as problem.snapshot() returned "
            "it, to begin again",
        )
        stepper = self.stepper(listeners.progress)
        try:
            accepted = self._accepted_start(stepper, task, start)
        except BaseException:
            if before is not None:
                stepper.put(before.accepted)
            raise
        run_state = RunState(accepted) if before is None else replace(before, accepted=accepted)
        self._has_begun()
        return self._run(task, self.begun(task, run_state), listeners)

    def _has_begun(self) -> None:
        """Record in the problem that an evolution of this class has begun. Not collective."""
        self.problem.evolved.append(type(self).__name__)

    def _run(self, task: T, run_state: RunState, listeners: Listeners) -> H:
        """Run from a given state until the run ends; keep its last accepted state. Collective."""
        stepper = self.stepper(listeners.progress)
        rule = self._rule(stepper, task, run_state)
        run = Run(stepper, rule, listeners, self.history(run_state))
        try:
            history = run.go()
        finally:
            self._run_state = run.state or self._run_state
            rule.close()
        rule.require_continuation(history)
        return history
