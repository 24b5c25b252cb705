# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Arc length with memory: an evolution whose load is unknown, as where a structure snaps back.

A state x_n under the load gamma_n has left a memory m_n (slip so far, intensity of bonds). The next
one is a point (x, gamma) of the curve

    H(x, gamma; m_n) = 0,        <(x - x_n, gamma - gamma_n), t_n> = h,

of given arc length h beyond it, t_n a solution of the rate problem at x_n. Once it is accepted it
makes a new memory m_n+1, and the next step begins there. So the path is that of a quasi-static
evolution whose load (or imposed displacement) rises and falls as it must for the state to change
slowly: friction acts against slip as it happens, and what is damaged stays damaged. The control is
that of Riks (Int. J. Solids Struct. 15, 1979), on the pieces of H.

Time has no meaning on such a path: laws must not depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, get_args

import numpy as np

from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact._frozen import ReadOnly
from dolfinx_contact.continuation.arguments import check_steps, checked_range, require_smooth
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.observer import Observer, Seen, Stop
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.equations.given_data import check_times
from dolfinx_contact.evolution.arc_steps import ArcSteps
from dolfinx_contact.evolution.by_arc_length import ByArcLength
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.listeners import Listeners
from dolfinx_contact.evolution.path import PathHistory, PathStep
from dolfinx_contact.evolution.path_state import (
    Known,
    PathDirection,
    PathState,
    PathTask,
    begun,
)
from dolfinx_contact.evolution.path_stepper import OnPath, PathStepper
from dolfinx_contact.evolution.run import Run
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory

__all__ = ["ArcLength", "PathDirection"]

_LONGEST = 0.005  # of the range of gamma and the first tangent


class ArcLength(ReadOnly):
    """The path of a contact problem with a memory under a load that is unknown.

    It begins with the state in the problem's Functions, a solution under the load at which the
    parameter stands, and with the memory that is in the surfaces, as a `QuasiStatic` run leaves
    it; without one, points slip from where they are, and bonds have the intensity of their law.
    Functions, statuses, parameter and memory follow the accepted points.

    Args:
        parametric: the contact problem and its load or imposed displacement gamma.

    Raises:
        ValueError: on every rank, if that is none, or a law depends on the time or length of a
            step, or on the distance slipped, or the bulk has kinks in u.

    Example:
        ::

            path = ArcLength(ParametricContact(problem, lift, driven=[(top, as_vector((0, lift)))]))
            history = path.run(gamma_range=(0.0, 1.0))
            print([(p.gamma, p.event) for p in history.folds], history.reason)
            back = path.run(gamma_range=(0.0, 1.0), direction="back")
    """

    _instead: ClassVar[Mapping[str, str]] = {
        "": "make another ArcLength; what may be changed are values of Constants and Functions"
    }
    account: type[Energies] = Energies

    def __init__(self, parametric: ParametricContact):
        if not isinstance(parametric, ParametricContact):
            raise ValueError(f"a ParametricContact is needed, got {type(parametric).__name__}")
        self.parametric = parametric
        self.problem = parametric.problem
        require_smooth(parametric)
        self._stepper = PathStepper(parametric)
        self._require_no_time()
        self._run_state: PathState | None = None

    def _require_no_time(self) -> None:
        check_times(self.problem.surfaces)
        for s in self.problem.surfaces:
            s._update_geometry()
            fields = s.points.data.fields
            slow = [n for n in s.law.needs_time if np.any(fields[n] != 0)]
            require(
                self.problem.comm,
                not slow,
                f"{s.name}: the law {s.law.name} answers to the time or length of a step, by its "
                f"{' and '.join(slow)}; a path by arc length has none: use QuasiStatic",
            )
            compiled = s.law_at_points.compiled
            require(
                self.problem.comm,
                bool(s.law.needs_time) or not compiled.needs_time(0.0),
                f"{s.name}: the law {s.law.name} looks at the time of a step (a.step); a path "
                "by arc length has none: use QuasiStatic",
            )
            slip = s.law_at_points.compiled.knows_slip
            require(
                self.problem.comm,
                not slip,
                f"{s.name}: friction of the law {s.law.name} depends on the distance slipped "
                "(a.slid), of which an evolution has no memory yet",
            )

    def run(
        self,
        *,
        gamma_range: tuple[float, float],
        direction: PathDirection | None = None,
        control: StepControl | None = None,
        max_steps: int = 1000,
        rays: bool = False,
        stop: Stop[PathStep] | None = None,
        observer: Seen[PathStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> PathHistory:
        """Follow the path until the load leaves a range. Collective.

        Args:
            gamma_range: the path ends where the load reaches either end.
            direction: of the first run ``"increasing"``, the default, or ``"decreasing"``, the load
                at the start; of a later one ``"onwards"``, the default, or ``"back"``, by which the
                state unloads and nothing heals.
            control: step lengths, in units in which the first tangent and the range of gamma have
                size 1; by default up to 0.005. Longer ones may pass a fold of many bonds unseen.
            max_steps: budget.
            rays: whether all statuses that meet are tried at every kink and nonsmooth fold, up to
                256, so that `PathStep.directions` counts the solutions of the rate problem there;
                else they are tried where no direction is found otherwise.
            stop: called with every accepted point, on every rank; the reason for which the path
                ends there, or "" to go on.
            observer: called with every accepted point while it is in the problem.
            record: keeps every accepted point before the observer is called, as
                `records.PathRecord` does.
            progress: whether rank 0 reports on the standard error stream where it is; by default
                once it takes more than some seconds.

        Returns:
            The accepted points, and in words why the path ended. It never jumps: where no way on
            is found, or no step is solved, it ends, and `complete` is False.

        Raises:
            ValueError: on every rank, for arguments that do not fit, a law that depends on the
                time, or a start that is no solution; what ``stop`` or ``observer`` raises.
            OSError: on every rank, if a point cannot be recorded.
        """
        comm = self.problem.comm
        run_state = self._run_state
        first = run_state is None or run_state.arrived is None
        gamma = float(self.parametric.constant.value) if run_state is None else run_state.gamma
        listeners = Listeners(None, stop, observer, record, progress)
        with everywhere(comm, "a path by arc length"):
            limits = checked_range(gamma_range, [gamma])
            check_steps(control, max_steps)
            listeners.check("a records.PathRecord")
            control = control or StepControl(kinks="exact", initial=_LONGEST, maximum=_LONGEST)
            if control.kinks not in (None, "exact"):
                raise ValueError(f"a path with memory passes kinks exactly, not {control.kinks!r}")
            direction = direction or ("increasing" if first else "onwards")
            known = get_args(PathDirection)[:2] if first else get_args(PathDirection)[2:]
            if direction not in known:
                run = "the first run" if first else "a later run"
                raise ValueError(f"the direction of {run} must be one of {known}: {direction!r}")
        same_everywhere(
            comm, gamma_range=limits, direction=direction, control=control, max_steps=max_steps
        )
        same_everywhere(comm, rays=bool(rays))
        listeners.require_same(comm)
        self._require_no_time()
        self.parametric.check_parameter(limits)
        if run_state is None:
            start = self._stepper.start(0.0)
            run_state = PathState(start, 0.0, known=Known(scales=self.parametric.scales))
        task = PathTask(limits, direction, control, max_steps, bool(rays))
        return self._run(task, begun(task, run_state), listeners)

    def go_on(
        self,
        task: PathTask,
        run_state: PathState,
        *,
        stop: Stop[PathStep] | None = None,
        observer: Seen[PathStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> PathHistory:
        """Go on with a run from where it was, as a record does. Collective.

        Args:
            task: what the run is to do.
            run_state: where it was.
            stop: as in the run, as for what follows, the errors and the result.
            observer: called with the points from there on.
            record: keeps them.
            progress: whether to report where it is.
        """
        listeners = Listeners(None, stop, observer, record, progress)
        with everywhere(self.problem.comm, "a path by arc length"):
            listeners.check("a records.PathRecord")
        listeners.require_same(self.problem.comm)
        return self._run(task, run_state, listeners)

    def put(self, run_state: PathState) -> None:
        """Put the path where a run of it ended, from which the next goes on. Collective."""
        self._run_state = run_state
        self._stepper.put(run_state.accepted)

    def recalled(
        self,
        time: float,
        gamma: float,
        memory: Sequence[Memory | None],
        energies: Energies,
        *,
        first: bool,
    ) -> OnPath:
        """The state that is in Functions, statuses and rigid bodies, as one of it. Collective.

        Args:
            time: arc length from the start.
            gamma: the load.
            memory: that it left.
            energies: since the start.
            first: whether it is a start whose statuses are not known.
        """
        return self._stepper.recalled_under(gamma, time, memory, energies, first=first)

    def _run(self, task: PathTask, run_state: PathState, listeners: Listeners) -> PathHistory:
        """A run from where it is to its end. Collective."""
        low, high = task.gamma_range
        accepted = run_state.accepted
        bordered = Bordered(self.parametric, gamma_scale=high - low)
        steps = ArcSteps(Corrector(bordered, task.control))
        rule = ByArcLength(self.parametric, self._stepper, steps, task, run_state)
        history = PathHistory(accepted.time, accepted.energies, gamma=accepted.gamma)
        run = Run(self._stepper, rule, listeners, history)
        try:
            return run.go()
        finally:
            self._run_state = run.run_state or self._run_state
            for thing in (steps, steps.corrector, bordered):
                thing.destroy()
