# SPDX-License-Identifier: LGPL-3.0-or-later
"""Who looks on while a branch is followed, and what is needed to go on from one of its points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from dolfinx_contact.continuation.branch import BranchPoint, SpecialPoint
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.continuation.parameters import StepControl

__all__ = ["Observer", "Observers", "Seen", "Stepping", "Task", "as_observer"]


@dataclass(frozen=True)
class Task:
    """How a branch is followed.

    Attributes:
        gamma_range: the branch ends where gamma reaches either end.
        gamma_scale: size of gamma that counts as 1.
        control: step lengths.
        max_steps: budget of steps from the first point of the branch.
        to_node: whether it ends at its first bifurcation.
    """

    gamma_range: tuple[float, float]
    gamma_scale: float
    control: StepControl
    max_steps: int
    to_node: bool = False


@dataclass(frozen=True)
class Stepping:
    """What a follower knows at a point beside the point: with it, it goes on as if never stopped.

    Attributes:
        index: of the point on its branch.
        next_step: length of the next step.
        x_scale: square of the length of x that counts as 1; 0 if no tangent has moved x yet.
        largest_distance: of all events so far.
        ending: how the branch ends at the point; None if it goes on, or ends without another point.
        reason: why, in words.
    """

    index: int
    next_step: float
    x_scale: float
    largest_distance: float
    ending: Ending | None = None
    reason: str = ""


class Observer:
    """Is called while branches are followed; every call is collective. Does nothing by itself.

    The problem is in the state of a point when the observer is called with it, and while a branch
    begins (its
    first point) and ends (its last one): of a `ParametricContact` the displacement, the
    multipliers, the statuses, gamma and what it drives, so that ``problem.table``,
    ``problem.support_forces`` and assembled forms are those of the point. What the observer does to
    them is lost at the next point. That costs no assembly.

    An exception that it raises on every rank ends the run.
    """

    def begin(self, branch: int, task: Task) -> None:
        """A branch is about to be followed, from its start or from a point reached before."""

    def point(
        self,
        branch: int,
        index: int,
        point: BranchPoint,
        special: Sequence[SpecialPoint],
        stepping: Stepping,
    ) -> None:
        """A point has been accepted.

        Args:
            branch: number of the branch.
            index: of the point on it, from 0.
            point: start and end of the branch included.
            special: special points on the way to it.
            stepping: what is needed to go on from it.
        """

    def end(self, branch: int, ended: Ends) -> None:
        """The branch has ended, how and why is in ``ended``; with its budget it may go on later."""


#: An observer, or a function that is called with every accepted point, start and end of the branch
#: included, and the special points on the way to it: with what `Stop` is called with.
Seen: TypeAlias = Observer | Callable[[BranchPoint, Sequence[SpecialPoint]], object]


def is_observer(given: Any) -> bool:
    """Whether something has the methods of an observer."""
    return all(callable(getattr(given, name, None)) for name in ("begin", "point", "end"))


def as_observer(given: Any) -> Observer:
    """An observer as it is, or one that calls a function at every point.

    Raises:
        ValueError: if it is neither.
    """
    if is_observer(given):
        found: Observer = given
        return found
    if callable(given):
        return _Calls(given)
    raise ValueError(
        "the observer must be an Observer, whose methods begin, point and end are called, or a "
        f"function of a point and its special points; got {given!r}"
    )


class _Calls(Observer):
    """Calls a function at every point."""

    def __init__(self, function: Callable[[BranchPoint, Sequence[SpecialPoint]], object]):
        self._function = function

    def point(
        self,
        branch: int,
        index: int,
        point: BranchPoint,
        special: Sequence[SpecialPoint],
        stepping: Stepping,
    ) -> None:
        self._function(point, special)


class Observers(Observer):
    """Several observers as one, called in this order."""

    def __init__(self, *observers: Seen):
        self._observers = [as_observer(o) for o in observers]

    def begin(self, branch: int, task: Task) -> None:
        for o in self._observers:
            o.begin(branch, task)

    def point(
        self,
        branch: int,
        index: int,
        point: BranchPoint,
        special: Sequence[SpecialPoint],
        stepping: Stepping,
    ) -> None:
        for o in self._observers:
            o.point(branch, index, point, special, stepping)

    def end(self, branch: int, ended: Ends) -> None:
        for o in self._observers:
            o.end(branch, ended)
