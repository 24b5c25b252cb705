# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a run by arc length is between two points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.evolution.path_stepper import OnPath
from dolfinx_contact.evolution.run_state import RunState

__all__ = ["Known", "PathDirection", "PathState", "PathTask", "begun"]

#: The direction in which a path leaves its state: that with more load or less, or, later, on or
#: back.
PathDirection: TypeAlias = Literal["increasing", "decreasing", "onwards", "back"]


@dataclass(frozen=True)
class PathTask:
    """The task of a run; see `ArcLength.run`."""

    gamma_range: tuple[float, float]
    direction: PathDirection
    control: StepControl
    max_steps: int
    rays: bool


@dataclass(frozen=True)
class Known:
    """What steps have found out on their way, and judge by.

    Attributes:
        x_scale: square of the length of x that counts as 1 where one unit of gamma does; 0 if no
            tangent has moved x yet.
        largest_distance: of all events of the run.
        scales: what residuals are measured by (`System.scales`).
        signs: of the test for bifurcations; none before the first step of a run.
    """

    x_scale: float = 0.0
    largest_distance: float = 0.0
    scales: Sequence[float] = ()
    signs: Sequence[float] = ()


@dataclass(frozen=True, eq=False)
class PathState(RunState):
    """All that the next step of a run depends on.

    Attributes:
        arrived: the point of the path at the accepted state, with piece and tangent by which it was
            come to; None at the start.
        known: to the steps.
        passed: arc lengths of the start of the run and of the points that it has accepted.
    """

    accepted: OnPath
    arrived: BranchPoint | None = None
    known: Known = field(default_factory=Known)
    passed: Sequence[float] = ()

    @property
    def gamma(self) -> float:
        """The load at the accepted state."""
        return self.accepted.gamma


def begun(task: PathTask, run_state: PathState) -> PathState:
    """A new run, where another one has ended or nothing has been followed yet."""
    before = run_state.known
    return replace(
        run_state,
        length=task.control.initial,
        known=Known(before.x_scale, scales=before.scales),
        passed=(run_state.accepted.time,),
        ending=None,
        reason="",
    )
