# SPDX-License-Identifier: LGPL-3.0-or-later
"""The loop over accepted steps of histories, motions and paths.

A `Rule` finds the next step, through times or by arc length, and a `Stepper` puts its end into the
problem. Only this module handles accepted steps, in this order: ``stop`` decides whether the run
ends there, the record stores the step, the observer is called, progress is shown. The accepted
state is put into the problem before each of these calls, so that values written to the Functions by
one of them reach neither the others nor the next step. After an error the problem is at the last
accepted state.
"""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from mpi4py import MPI

from dolfinx_contact._progress import Progress
from dolfinx_contact.continuation.arguments import reason_to_stop
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.continuation.observer import CollectiveObserver, Observer
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.listeners import Listeners
from dolfinx_contact.evolution.rule import Advance, Rule
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.evolution.step import Stepper

__all__ = ["Run"]

T = TypeVar("T")
S = TypeVar("S", bound=RunState)
H = TypeVar("H", bound=History)


class Run(Generic[T, S, H]):
    """A run: the loop over its accepted steps.

    Args:
        stepper: stepper that puts states into the problem.
        rule: rule that finds the steps.
        listeners: observers of the user, checked.
        history: history to which steps and the ending are added.

    Attributes:
        run_state: state of the run after the last accepted step; None before it has begun.
    """

    def __init__(self, stepper: Stepper, rule: Rule[T, S], listeners: Listeners, history: H):
        self.run_state: S | None = None
        self._stepper = stepper
        self._rule = rule
        self._listeners = listeners
        self._history = history
        comm = stepper.problem.comm
        self._record = CollectiveObserver(comm, listeners.record, self._put)
        self._observer = CollectiveObserver(comm, listeners.observer, self._put)
        self._progress = _RunProgress(comm, listeners.progress, rule)

    def go(self) -> H:
        """Continue to the end. Collective; the problem is left at the last accepted state.

        Raises:
            ValueError: on every rank, if the run cannot begin. Errors of listeners are raised on
                every rank.
        """
        rule = self._rule
        problem = self._stepper.problem
        start = rule.start
        try:
            self._put()
            rule.begin()
            self._record.begin(rule.task, start)
            self._observer.begin(rule.task, start)
            self.run_state = start
            if rule.ending is None:
                with problem.warning_once():
                    for advance in rule.advances():
                        self._accept(advance)
                        if rule.ending is not None:
                            break
            assert rule.ending is not None
            self._history.end(rule.ending, rule.reason)
        finally:
            self._put()
            self._progress.end(self._history)
        self._record.end(self._history)
        try:
            self._observer.end(self._history)
        finally:
            self._put()
        return self._history

    def _put(self) -> None:
        """Put the last accepted state into the problem. Collective."""
        self._stepper.put((self.run_state or self._rule.start).accepted)

    def _accept(self, advance: Advance) -> None:
        """Add a step to the history and call the listeners. Collective."""
        step = advance.step
        self._history.steps.append(step)
        self.run_state = self._rule.run_state
        self._ask_for_the_end(step)
        self._record.step(step, self._rule.run_state)
        self._observer.step(step, self._rule.run_state)
        self._put()
        self._stepper.problem.log_warnings(step.result)
        self._progress.step(step, self._rule.run_state)

    def _ask_for_the_end(self, step: EvolutionStep) -> None:
        """End the run after a step if the user's ``stop`` returns a reason. Collective."""
        rule = self._rule
        stop = self._listeners.stop
        if stop is None or rule.ending is not None:
            return
        self._put()
        reason = reason_to_stop(self._stepper.problem.comm, rule.what, stop, step)
        if reason:
            rule.end(Ending.STOPPED, reason)
            self.run_state = rule.run_state


class _RunProgress(Observer):
    """Line of progress: position of the run, statuses, elapsed and remaining wall time.

    Args:
        comm: communicator; only rank 0 writes.
        wanted: argument ``progress`` of `QuasiStatic.run`.
        rule: rule of the run.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None, rule: Rule[Any, Any]):
        self._progress = Progress(comm, wanted)
        self._rule = rule

    def step(self, step: EvolutionStep, state: RunState) -> None:
        if not self._progress.due:
            return
        rule = self._rule
        passed = self._progress.seconds
        counts = ", ".join(f"{n} {k}" for k, n in step.result.counts.items() if n)
        time = f"{passed:.0f} s"
        done = rule.part(step)
        if done:
            time += f", about {passed * (1 - done) / done:.0f} s left"
        if step.jump:
            self._progress.write(f"{rule.what}: the state jumps at the time {step.start:.10g}")
        self._progress.update(f"{rule.what}: {rule.where(step)}  {counts}  {time}")

    def end(self, ended: Ends) -> None:
        assert isinstance(ended, History)
        self._progress.close(
            f"{self._rule.what}: {len(ended.steps)} {self._rule.units}, {ended.reason}"
        )
