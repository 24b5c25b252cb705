# SPDX-License-Identifier: LGPL-3.0-or-later
"""Observers of branches, histories, motions and paths, and stopping conditions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from mpi4py import MPI

from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact._mpi import everywhere
from dolfinx_contact.continuation.branch import BranchPoint, Diagram, SpecialPoint
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.continuation.system import ResidualScales

__all__ = [
    "BranchStep",
    "CollectiveObserver",
    "Observer",
    "ObserverLike",
    "Observers",
    "Stepping",
    "Stop",
    "Task",
    "as_observer",
    "is_observer",
]


@dataclass(frozen=True)
class Task:
    """Task of tracing one branch.

    Attributes:
        gamma_range: range of gamma; the branch ends where gamma reaches one of its ends.
        gamma_scale: unit of gamma.
        control: step lengths.
        max_steps: largest number of steps from the first point of the branch.
        to_node: whether the branch ends at its first bifurcation.
        branch: number of the branch.
    """

    gamma_range: tuple[float, float]
    gamma_scale: float
    control: StepControl
    max_steps: int
    to_node: bool = False
    branch: int = 0


@dataclass(frozen=True)
class BranchStep:
    """Accepted step of a branch, or its start.

    Attributes:
        branch: number of the branch.
        index: number of the point on the branch, from 0.
        point: point of the branch at the end of the step; the start and the end of the branch are
            also passed as steps.
        special: special points between the previous point and this one.
    """

    branch: int
    index: int
    point: BranchPoint
    special: Sequence[SpecialPoint] = ()


@dataclass(frozen=True)
class Stepping:
    """State of the tracing at a point, from which a branch can be resumed without changes.

    Attributes:
        index: number of the point on its branch, from 0.
        next_step: length of the next step.
        x_scale: square of the unit length of x; 0 if no tangent has moved x yet.
        largest_distance: largest distance of a state to a change of status so far.
        scales: scales of residuals on the branch so far; () for pivoting.
        ending: ending of the branch at this point; None if the branch continues, or ends after it
            without another point.
        reason: description of the ending.
    """

    index: int
    next_step: float
    x_scale: float
    largest_distance: float
    scales: ResidualScales = ()
    ending: Ending | None = None
    reason: str = ""


class Observer:
    """Base class of observers. Calls are collective; the default methods do nothing.

    Types of the arguments of the methods:

    ================== ============ ================= ===============
    process            task         step              state
    ================== ============ ================= ===============
    follow, explore    Task         BranchStep        Stepping
    QuasiStatic, NSCD  HistoryTask  EvolutionStep     RunState
    ArcLength          PathTask     PathStep          RunState
    ================== ============ ================= ===============

    During a call the problem is in the state of the point or step (in ``begin`` the start, in
    ``end`` the last state): displacement, multipliers, statuses, load parameter and driven data, or
    the data at this time. ``problem.table``, ``problem.support_forces`` and assembled forms refer
    to this state.

    Observers must be read-only. The accepted state is restored before the record is written and
    before the next step, so that values written to the Functions are lost. Changes to data, such as
    a friction coefficient, are not detected: they affect all later steps.

    An exception of an observer on any rank ends the run on every rank.
    """

    def begin(self, task: Any, state: Any) -> None:
        """Called when a branch or run begins or is resumed.

        Args:
            task: arguments of the process; for its class see `Observer`.
            state: state of the process; for its class see `Observer`.
        """

    def step(self, step: Any, state: Any) -> None:
        """Called when a step, or the start of a branch, has been accepted.

        Args:
            step: accepted step.
            state: state of the process, from which it can be resumed.
        """

    def end(self, ended: Ends) -> None:
        """Called when the process has ended; ``ended`` contains the ending and the reason."""

    def explored(self, diagram: Diagram) -> None:
        """Called after each branch and at the end of `explore`, with the results so far."""


_METHODS = ("begin", "step", "end", "explored")
S = TypeVar("S")
#: Called with every accepted step; returns the reason to end the branch or run there, or "".
Stop: TypeAlias = Callable[[S], str]
#: An observer, or a function that is called with every accepted step and the start of a branch.
ObserverLike: TypeAlias = Observer | Callable[[S], object]


def is_observer(given: Any) -> bool:
    """Return True if an object has the methods of an observer and is not a class."""
    return not isinstance(given, type) and all(
        callable(getattr(given, name, None)) for name in _METHODS
    )


def as_observer(given: Any) -> Observer:
    """Return an observer unchanged; wrap a function of a step in an observer.

    Raises:
        ValueError: if the argument is neither an observer nor a function.
    """
    if is_observer(given):
        observer: Observer = given
        return observer
    if isinstance(given, type) and issubclass(given, Observer):
        raise ValueError(f"{given.__name__} is a class: the observer must be an object of it")
    if callable(given):
        return _FunctionObserver(given)
    raise ValueError(
        "the observer must be an Observer, with its methods, or a "
        f"function of a step; got {given!r}"
    )


class _FunctionObserver(Observer):
    """Observer that calls a function with every step."""

    def __init__(self, function: Callable[[Any], object]):
        self._function = function

    def step(self, step: Any, state: Any) -> None:
        self._function(step)


class _Forwarding(Observer):
    """Base class of observers that forward every call."""

    def _forward(self, method: str, *what: Any) -> None:
        raise NotImplementedError

    def begin(self, task: Any, state: Any) -> None:
        self._forward("begin", task, state)

    def step(self, step: Any, state: Any) -> None:
        self._forward("step", step, state)

    def end(self, ended: Ends) -> None:
        self._forward("end", ended)

    def explored(self, diagram: Diagram) -> None:
        self._forward("explored", diagram)


class Observers(_Forwarding):
    """Several observers, called in the given order."""

    def __init__(self, *observers: ObserverLike[Any]):
        self._observers = [as_observer(o) for o in observers]

    def _forward(self, method: str, *what: Any) -> None:
        for observer in self._observers:
            getattr(observer, method)(*what)


class CollectiveObserver(_Forwarding):
    """The user's observers, called in the given order; their errors are raised on all ranks.

    The accepted state is put into the problem before every call, so that an observer that writes to
    the Functions cannot disturb other observers.

    Args:
        comm: communicator.
        put: function that puts the accepted state into the problem.
        observers: observers; None on ranks without one.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        put: Callable[[], object],
        *observers: ObserverLike[Any] | None,
    ):
        self._comm = comm
        self._put = put
        self._observers = [
            Observer() if o is None else as_observer(o)
            for o in observers
            if comm.allreduce(int(o is not None))
        ]

    def _forward(self, method: str, *what: Any) -> None:
        for observer in self._observers:
            self._put()
            with everywhere(self._comm, "an observer"):
                getattr(observer, method)(*what)
