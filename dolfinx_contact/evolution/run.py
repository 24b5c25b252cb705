# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The loop over the accepted steps of histories, motions and paths.

A `Rule` finds the steps: through given times, to rest, or by arc length. `Run.go` is the only place
that handles accepted steps, in this order:

    step = next(rule.steps())            the rule takes a step and accepts it
    stop(step)                           the user may end the run
    record.step, observer.step           the step is recorded first
    warnings, progress

The accepted state is put into the problem before each call of the user, so that values written to
the Functions reach neither the other listeners nor the next step. After an error the problem is at
the last accepted state.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import Arguments
from dolfinx_contact._progress import Progress
from dolfinx_contact.continuation.arguments import (
    check_listeners,
    reason_to_stop,
)
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.continuation.observer import (
    CollectiveObserver,
    Observer,
    ObserverLike,
    Stop,
)
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.step import AcceptedState, Stepper

__all__ = ["Listeners", "Rule", "Run", "RunState"]


@dataclass(frozen=True, eq=False)
class RunState:
    """State of a run between two steps: everything that the next step depends on.

    Attributes:
        accepted: last accepted state.
        length: length of the next step, or an upper bound of it.
        rate: rates of the state in the last step through times (`jumps.rates`); None before the
            first step and by arc length.
        number: number of the last step, over all runs; 0 before the first.
        settled: whether the run can be resumed from the state; False between the steps of a search
            for a jump, which belong together.
        ending: ending of the run at the state; None if it continues.
        reason: reason of the ending, as a sentence.
    """

    accepted: AcceptedState
    length: float
    rate: npt.NDArray[np.float64] | None = None
    number: int = 0
    settled: bool = True
    ending: Ending | None = None
    reason: str = ""


T = TypeVar("T")
S = TypeVar("S", bound=RunState)
H = TypeVar("H", bound=History)


class Rule(Ends, ABC, Generic[T, S]):
    """Rule by which a run finds its next step.

    Args:
        task: task of the run.
        run_state: state of the run where it starts or continues.

    Attributes:
        task: task as given.
        start: state of the run as given.
        ending: ending of the run; None while it continues.
        reason: reason of the ending, as a sentence.
    """

    #: Nouns for the run and for its steps, for messages.
    what: ClassVar[str]
    units: ClassVar[str]

    def __init__(self, task: T, run_state: S):
        self.task = task
        self.start = run_state
        self.ending: Ending | None = run_state.ending
        self.reason = run_state.reason

    @property
    @abstractmethod
    def run_state(self) -> S:
        """State of the run after the last step."""

    def begin(self) -> None:
        """Check the start, which is in the problem, before it is recorded. Collective.

        Raises:
            ValueError: on every rank, if no run can begin there.
        """

    @abstractmethod
    def steps(self) -> Iterator[EvolutionStep]:
        """Yield the accepted steps until the run ends. Collective.

        After each of them `run_state` is the state at its end, and `ending` is set if the run ends
        there. The Functions are left in any state.
        """

    @abstractmethod
    def where(self, step: EvolutionStep) -> str:
        """Return the position of the run after a step, for the line of progress."""

    def part(self, step: EvolutionStep) -> float | None:
        """Return the completed part of the run after a step, up to 1; None if it is unknown."""


@dataclass(frozen=True)
class Listeners:
    """Functions and observers that users pass to a run; see `QuasiStatic.run`.

    Attributes:
        stop: function of an accepted step that returns the reason to end the run there, or "".
        observer: observer of every accepted step.
        record: record that stores every accepted step.
        progress: whether rank 0 shows the progress of the run.
    """

    stop: Stop[Any] | None = None
    observer: ObserverLike[Any] | None = None
    record: Observer | None = None
    progress: bool | None = None

    @classmethod
    def of(cls, a: Arguments) -> Listeners:
        """Collect the listeners from the arguments of a run."""
        return cls(a.stop, a.observer, a.record, a.progress)

    def check(self, record: str) -> None:
        """Raise ``ValueError`` if one of them has a wrong type. Not collective.

        Args:
            record: name of the class of the records, for the message.
        """
        check_listeners(
            observer=self.observer,
            record=self.record,
            progress=self.progress,
            stop=self.stop,
            of=record,
        )


class Run(Generic[T, S, H]):
    """Loop over the accepted steps of a run.

    Args:
        stepper: stepper that puts states into the problem.
        rule: rule that finds the steps.
        listeners: listeners of the user, checked.
        history: history to which steps and the ending are added.

    Attributes:
        run_state: state of the run after the last accepted step; None before it has begun.
    """

    def __init__(self, stepper: Stepper, rule: Rule[T, S], listeners: Listeners, history: H):
        self.run_state: S | None = None
        self._stepper = stepper
        self._rule = rule
        self._stop = listeners.stop
        self._history = history
        comm = stepper.problem.comm
        self._record = CollectiveObserver(comm, listeners.record, self._put)
        self._observer = CollectiveObserver(comm, listeners.observer, self._put)
        self._progress = Progress(comm, listeners.progress)

    def go(self) -> H:
        """Continue to the end. Collective; the problem is left at the last accepted state.

        Raises:
            ValueError: on every rank, if the run cannot begin. Errors of listeners are raised on
                every rank.
        """
        rule = self._rule
        history = self._history
        try:
            self._put()
            rule.begin()
            self._record.begin(rule.task, rule.start)
            self._observer.begin(rule.task, rule.start)
            self.run_state = rule.start
            if rule.ending is None:
                with self._stepper.problem.warning_once():
                    for step in rule.steps():
                        self._handle(step)
                        if rule.ending is not None:
                            break
            assert rule.ending is not None
            history.end(rule.ending, rule.reason)
        finally:
            self._put()
            number = len(history.steps)
            self._progress.close(f"{rule.what}: {number} {rule.units}, {history.reason}")
        self._record.end(history)
        try:
            self._observer.end(history)
        finally:
            self._put()
        return history

    def _put(self) -> None:
        """Put the last accepted state into the problem. Collective."""
        self._stepper.put((self.run_state or self._rule.start).accepted)

    def _handle(self, step: EvolutionStep) -> None:
        """Add an accepted step to the history and call the listeners. Collective."""
        rule = self._rule
        problem = self._stepper.problem
        self._history.steps.append(step)
        self.run_state = rule.run_state
        if self._stop is not None and rule.ending is None:
            self._put()
            reason = reason_to_stop(problem.comm, rule.what, self._stop, step)
            if reason:
                rule.end(Ending.STOPPED, reason)
                self.run_state = rule.run_state
        self._record.step(step, self.run_state)
        self._observer.step(step, self.run_state)
        self._put()
        problem.log_warnings(step.result)
        self._show(step)

    def _show(self, step: EvolutionStep) -> None:
        """Show position of the run, statuses, elapsed and remaining wall time."""
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
