# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Paths in load and state: accepted points, their history, and the state of a run.

A point of a path is an accepted state x_n in equilibrium under a load gamma_n that is unknown
beforehand; its time is the arc length from the start of the path. `arc_length` states the
equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.run import RunState
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.parametric import ParametricContact

__all__ = [
    "Known",
    "PathDirection",
    "PathEvent",
    "PathHistory",
    "PathState",
    "PathStep",
    "PathStepper",
    "PathTask",
    "begun",
]

#: Event at a point of a path.
PathEvent: TypeAlias = Literal["", "kink", "smooth fold", "nonsmooth fold"]
#: Direction in which a run leaves its start: increasing or decreasing load in a first run; onwards
#: or back in a later one.
PathDirection: TypeAlias = Literal["increasing", "decreasing", "onwards", "back"]


# -- history ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PathStep(EvolutionStep):
    """An accepted point of a path; `start` and `time` are arc lengths from the start of the path.

    If `method` says that all statuses that meet at the point were tried, `directions` is the number
    of solutions of the rate problem, without the one that leads back. If a smooth bifurcation lies
    on the step, `directions` counts the path and both senses of the other branch.

    Attributes:
        gamma: load parameter.
        event: ``"smooth fold"`` if the load turns back while all statuses stay, ``"nonsmooth
            fold"`` if it turns back because statuses change, ``"kink"`` if statuses change and the
            load continues; otherwise "".
        before: letters of the statuses on the step to the point, as in `status`, bonds included.
        after: letters of the statuses on the next step.
        method: method by which the direction of the next step was found.
        corrections: Newton steps of the corrector.
    """

    gamma: float = 0.0
    event: PathEvent = ""
    before: str = ""
    after: str = ""
    method: str = ""
    corrections: int = 0

    @property
    def is_fold(self) -> bool:
        """Whether the load turns back at the point."""
        return self.event.endswith("fold")

    def row(self) -> dict[str, Any]:
        """Return the scalars of a table of points."""
        return {
            **super().row(),
            "newton_iterations": self.corrections,
            "gamma": self.gamma,
            "event": self.event,
            "before": self.before,
            "after": self.after,
        }


@dataclass
class PathHistory(History):
    """The accepted points of a run by arc length and its ending; times are arc lengths.

    Attributes:
        gamma: load parameter at the start.
        steps: accepted points.
    """

    gamma: float = 0.0
    steps: list[PathStep] = field(default_factory=list)  # type: ignore[assignment]

    @property
    def folds(self) -> list[PathStep]:
        """Points at which the load turns back."""
        return [p for p in self.steps if p.is_fold]

    @property
    def kinks(self) -> list[PathStep]:
        """Points at which statuses change and the load continues."""
        return [p for p in self.steps if p.event == "kink"]


# -- run -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PathTask:
    """Task of a run by arc length; see `ArcLength.run` for the attributes."""

    gamma_range: tuple[float, float]
    direction: PathDirection
    control: StepControl
    max_steps: int
    rays: bool


@dataclass(frozen=True)
class Known:
    """Scales and signs that the steps of a run have determined.

    Attributes:
        x_scale: square of the length of x that counts as much as one unit of gamma; 0 before a
            tangent has moved x.
        largest_distance: largest distance to a border of a piece so far.
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
        arrived: point of the accepted state, with piece and tangent of the step that ended there;
            None at the start of a path.
        known: scales and signs that the steps have determined.
        passed: arc lengths of the start of the run and of its accepted points.
    """

    arrived: BranchPoint | None = None
    known: Known = field(default_factory=Known)
    passed: Sequence[float] = ()

    @property
    def gamma(self) -> float:
        """Load parameter at the accepted state."""
        return self.accepted.gamma


def begun(task: PathTask, run_state: PathState) -> PathState:
    """Return the state of a new run that starts where another one has ended."""
    return replace(
        run_state,
        length=task.control.initial,
        known=Known(run_state.known.x_scale, scales=run_state.known.scales),
        passed=(run_state.accepted.time,),
        ending=None,
        reason="",
    )


class PathStepper(Stepper):
    """Puts accepted states of a path into the problem, with their load.

    Args:
        system: contact problem with its load parameter.
    """

    def __init__(self, system: ParametricContact):
        super().__init__(system.problem, lambda _: None, None)
        self._system = system

    def start(self, time: float, given: State | None = None) -> AcceptedState:
        accepted = super().start(time, given)
        if given is None or None in given.previous:
            return accepted
        # keep the statuses of the last step: at borders the state does not determine them
        return replace(accepted, statuses=given.statuses)

    def _more(self) -> dict[str, Any]:
        return {"gamma": float(self._system.constant.value)}

    def _show_more(self, state: State) -> None:
        gamma = self._system.constant.value if state.gamma is None else state.gamma
        self._system._set(float(gamma))
