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

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import require
from dolfinx_contact.continuation.arguments import (
    check_rays,
    check_steps,
    checked_range,
    require_smooth,
    samples_of,
)
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.equations.state import State
from dolfinx_contact.equations.validation import check_times
from dolfinx_contact.evolution.arc_steps import ArcSteps
from dolfinx_contact.evolution.by_arc_length import ByArcLength
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.evolution import Runnable
from dolfinx_contact.evolution.path import PathHistory, PathStep
from dolfinx_contact.evolution.path_state import (
    Known,
    PathDirection,
    PathState,
    PathTask,
    begun,
)
from dolfinx_contact.evolution.path_stepper import OnPath, PathStepper
from dolfinx_contact.evolution.run import NOT_BY_VALUE, Listeners, Run, compared_arguments
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory

__all__ = ["ArcLength", "PathDirection"]

_LONGEST = 0.005  # of the range of gamma and the first tangent


def _check_run(a: Arguments) -> None:
    path: ArcLength = a.self
    gamma = path._gamma if a.start is None else getattr(a.start, "gamma", None)
    value = float(path.parametric.constant.value) if gamma is None else gamma
    a.gamma_range = checked_range(a.gamma_range, [value])
    check_steps(a.control, a.max_steps)
    check_rays(a.rays)
    a.rays = bool(a.rays)
    Listeners.of(a).check(path._record)
    a.control = a.control or StepControl(kinks="exact", initial=_LONGEST, maximum=_LONGEST)
    if a.control.kinks not in (None, "exact"):
        raise ValueError(f"a path with memory passes kinks exactly, not {a.control.kinks!r}")
    first = a.start is not None or path._run_state is None or path._run_state.arrived is None
    a.direction = a.direction or ("increasing" if first else "onwards")
    known = get_args(PathDirection)[:2] if first else get_args(PathDirection)[2:]
    if a.direction not in known:
        run = "the first run" if first else "a later run"
        raise ValueError(f"the direction of {run} must be one of {known}: {a.direction!r}")


class ArcLength(Runnable[PathTask, PathState, PathHistory]):
    """The path of a contact problem with a memory under a load that is unknown.

    Its first run starts from the state in the problem's Functions, a solution under the present
    value of the parameter, or from ``start=``. A later run starts where the last one has ended.
    Another evolution of the same problem needs ``start=``. Functions and parameter follow the
    accepted points; the state of each is kept, as ``history.steps[-1].state``.

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
    _record = "a records.PathRecord"

    def __init__(self, parametric: ParametricContact):
        if not isinstance(parametric, ParametricContact):
            raise ValueError(f"a ParametricContact is needed, got {type(parametric).__name__}")
        self.parametric = parametric
        self.problem = parametric.problem
        require_smooth(parametric)
        self._require_no_time()

    def _require_no_time(self) -> None:
        check_times(self.problem.equations)
        for s in self.problem.surfaces:
            s.update_geometry()
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
                f"{s.name}: the law {s.law.name} depends on the time of a step (a.step); a path "
                "by arc length has none: use QuasiStatic",
            )
            slip = s.law_at_points.compiled.knows_slip
            require(
                self.problem.comm,
                not slip,
                f"{s.name}: friction of the law {s.law.name} depends on the distance slipped "
                "(a.slid), of which an evolution has no memory yet",
            )

    @collective(
        "a path by arc length",
        _check_run,
        compare=compared_arguments,
        local=NOT_BY_VALUE,
    )
    def run(
        self,
        *,
        gamma_range: tuple[float, float],
        start: State | None = None,
        direction: PathDirection | None = None,
        control: StepControl | None = None,
        max_steps: int = 1000,
        rays: bool | None = None,
        stop: Stop[PathStep] | None = None,
        observer: ObserverLike[PathStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> PathHistory:
        """Follow the path until the load leaves a range. Collective.

        Args:
            gamma_range: the path ends where the load reaches either end.
            start: state at which the path starts, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``, under its ``gamma`` or the present value of the parameter;
                by default the end of the last run, in a first run the Functions as they are with
                virgin memory. Required in the first run if the problem has had another evolution.
            direction: of the first run ``"increasing"``, the default, or ``"decreasing"``, the load
                at the start; of a later one ``"onwards"``, the default, or ``"back"``, by which the
                state unloads and nothing heals.
            control: step lengths, in units in which the first tangent and the range of gamma have
                size 1; by default up to 0.005. Longer ones may pass a fold of many bonds unseen.
            max_steps: budget.
            rays: whether all solutions of the rate problem are looked for, and counted in
                `PathStep.directions`: True at every kink and nonsmooth fold, by all statuses that
                meet there, up to 256; False or None, the default, no more than it takes to
                continue: they are tried where no direction is found otherwise.
            stop: called with every accepted point, on every rank; the reason for which the path
                ends there, or "" to continue.
            observer: called with every accepted point while it is in the problem.
            record: keeps every accepted point before the observer is called, as
                `records.PathRecord` does.
            progress: whether rank 0 reports on the standard error stream where it is; by default
                once it takes more than some seconds.

        Returns:
            The accepted points, and in words why the path ended. It never jumps: where no
            continuation is found, or no step is solved, it ends, and `complete` is False.

        Raises:
            ValueError: on every rank, for arguments that do not fit, a law that depends on the
                time, a start that is no solution, or a load that leaves its range at once; what
                ``stop`` or ``observer`` raises.
            OSError: on every rank, if a point cannot be recorded.
        """
        assert control is not None
        assert direction is not None
        self._require_no_time()
        self.parametric.check_parameter(samples_of(*gamma_range))
        run_state = self._run_state if start is None else None
        if run_state is None:
            self._require_start(start)
            accepted = self._stepper(None).start(0.0, start)
            assert isinstance(accepted, OnPath)
            run_state = PathState(accepted, 0.0, known=Known(scales=self.parametric.scales))
        self._has_begun()
        task = PathTask(gamma_range, direction, control, max_steps, bool(rays))
        listeners = Listeners(None, stop, observer, record, progress)
        return self._run(task, begun(task, run_state), listeners)

    def recalled(
        self,
        time: float,
        gamma: float,
        memory: Sequence[Memory],
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
        return self._stepper(None).recalled_under(gamma, time, memory, energies, first=first)

    @property
    def _gamma(self) -> float:
        """The load at the last accepted state, or its value before the first run."""
        value = self.parametric.constant.value
        return float(value) if self._run_state is None else self._run_state.gamma

    def _stepper(self, progress: bool | None) -> PathStepper:
        return PathStepper(self.parametric)

    def _run(self, task: PathTask, run_state: PathState, listeners: Listeners) -> PathHistory:
        """A run from where it is to its end. Collective."""
        low, high = task.gamma_range
        accepted = run_state.accepted
        bordered = Bordered(self.parametric, gamma_scale=high - low)
        steps = ArcSteps(Corrector(bordered, task.control, chords=False))
        stepper = self._stepper(listeners.progress)
        rule = ByArcLength(self.parametric, stepper, steps, task, run_state)
        history = PathHistory(accepted.time, accepted.energies, gamma=accepted.gamma)
        try:
            self._follow(Run(stepper, rule, listeners, history))
        finally:
            for thing in (steps, steps.corrector, bordered):
                thing.destroy()
        return history
