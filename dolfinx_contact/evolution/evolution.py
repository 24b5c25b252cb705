# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problems in time: what quasi-static evolutions and motions have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import ufl
from dolfinx import fem

from dolfinx_contact._errors import everywhere
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.equations.given_data import Datum
from dolfinx_contact.evolution.accepted import AcceptedState, SolvedStep, Stepper
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.history import History, NoContinuation
from dolfinx_contact.evolution.listeners import Listeners
from dolfinx_contact.evolution.run import Run
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.evolution.runnable import Runnable
from dolfinx_contact.evolution.through_times import Accept, HistoryTask, ThroughTimes
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem

__all__ = ["Evolution"]

_MOST_FORKS = 16  # evolutions along other rays


class Evolution(Runnable[HistoryTask, RunState, History]):
    """A contact problem in time: runs through times, step by step, which a `Stepper` takes.

    Args:
        problem: the contact problem.
        load: called with a time, on every rank, sets Constants and Functions of the problem's data
            to what they are then.

    Attributes:
        problem: as given.
        load: as given; it may be set between two runs, all else is read-only.
        method: what it is known by beside the problem, in words.
        kept: Functions that a state has beside those of the problem, by name.
        data: Functions and Constants beside those of the problem, as in a density.
        forms: beside those of the problem, as one of damping.

    Raises:
        ValueError: on every rank, if arguments do not fit.
    """

    _may_be_set = ("load",)
    _instead: ClassVar[Mapping[str, str]] = {
        "": "what changes in time are values of Constants and Functions, which the load sets; else "
        "make another evolution"
    }
    _record = "a records.EvolutionRecord"
    method: Sequence[str] = ()
    kept: Mapping[str, fem.Function] = {}
    data: Sequence[Datum] = ()
    forms: Sequence[ufl.Form] = ()
    #: The load that has been asked whether it knows more than the time.
    _asked: Callable[[float], object] | None = None

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

    def recalled(
        self, time: float, memory: Sequence[Memory | None], energies: Energies, *, first: bool
    ) -> AcceptedState:
        """The state that is in Functions, statuses and rigid bodies, as one of it. Collective.

        Args:
            time: of the state.
            memory: that it left.
            energies: since the start.
            first: whether it is the start of the evolution, whose statuses are not known.
        """
        return self._stepper(None).recalled(time, memory, energies, first=first)

    def _stepper(self, progress: bool | None) -> Stepper:
        return Stepper(self.problem, self.load, False if progress is False else None)

    def _begin(self, task: HistoryTask, listeners: Listeners) -> History:
        """A new run, from the last accepted state if there is one. Collective.

        Args:
            task: of the run, whose times begin at that state.
            listeners: checked, as the task is, and the same on every rank.
        """
        stepper = self._stepper(listeners.progress)
        before = self._run_state
        if before is None:
            accepted = stepper.start(task.times[0])
            return self._run(task, RunState(accepted, task.longest), listeners)
        stepper.require_untouched(before.accepted)
        # Data that were changed between two runs, and the load if it was, are those of the next.
        accepted = stepper.renewed(before.accepted)
        run_state = RunState(accepted, task.longest, before.rate, before.number)
        return self._run(task, run_state, listeners)

    def _rule(
        self, stepper: Stepper, task: HistoryTask, run_state: RunState, accept: Accept | None
    ) -> ThroughTimes:
        """What finds the steps of a run."""
        return ThroughTimes(stepper, task, run_state, accept)

    def _run(self, task: HistoryTask, run_state: RunState, listeners: Listeners) -> History:
        """A run from where it is to its end. Collective."""
        stepper = self._stepper(listeners.progress)
        stepper.asks = self.load is not self._asked
        rule = self._rule(stepper, task, run_state, listeners.accept)
        history = _history_from(run_state.accepted)
        self._follow(Run(stepper, rule, listeners, history))
        history.others = _followed(rule.forks, stepper, task)
        stepper.put(rule.run_state.accepted)
        if rule.failed and task.at_jump != "stop":
            raise NoContinuation(history.reason, history) from rule.failure
        if self.load is not self._asked and not rule.failed:
            stepper.ask_at_end(run_state.accepted, rule.run_state.accepted)
            self._asked = self.load
        return history


def _history_from(accepted: AcceptedState) -> History:
    """A history that begins at a state."""
    return History(accepted.time, accepted.energies)


def _followed(forks: Sequence[SolvedStep], stepper: Stepper, task: HistoryTask) -> list[History]:
    """Evolutions along the rays that a run did not take, and along theirs. Collective."""
    found: list[History] = []
    left = list(forks)
    while left and len(found) < _MOST_FORKS:
        first = left.pop(0)
        rule = ThroughTimes(stepper, task, RunState(first.before, task.longest), first=first)
        run = Run(stepper, rule, Listeners(progress=False), _history_from(first.before))
        found.append(run.go())
        left += rule.forks
    for rest in left:
        found.append(_history_from(rest.before))
        found[-1].end(Ending.BUDGET, f"not followed: more than {_MOST_FORKS} evolutions")
    return found
