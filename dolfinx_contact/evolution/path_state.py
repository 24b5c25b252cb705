# SPDX-License-Identifier: LGPL-3.0-or-later
"""State of a run by arc length between two points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.evolution.path_stepper import OnPath
from dolfinx_contact.evolution.run import RunState

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
    """Scales and signs that the steps of a run have found.

    Attributes:
        x_scale: square of the length of x that counts as 1 where one unit of gamma does; 0 if no
            tangent has moved x yet.
        largest_distance: largest distance to a border of all events of the run.
        scales: scales of the residuals (`System.scales`).
        signs: signs of the test for bifurcations; empty before the first step of a run.
    """

    x_scale: float = 0.0
    largest_distance: float = 0.0
    scales: Sequence[float] = ()
    signs: Sequence[float] = ()


@dataclass(frozen=True, eq=False)
class PathState(RunState):
    """State of a run between two points: everything that the next step depends on.

    Attributes:
        arrived: point of the path at the accepted state, with the piece and tangent of the step
            that ended there; None at the start.
        known: scales and signs that the steps have found.
        passed: arc lengths of the start of the run and of its accepted points.
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
    """The state of a new run at the start of a path or at the end of the last run."""
    before = run_state.known
    return replace(
        run_state,
        length=task.control.initial,
        known=Known(before.x_scale, scales=before.scales),
        passed=(run_state.accepted.time,),
        ending=None,
        reason="",
    )
