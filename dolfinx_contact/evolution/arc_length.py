# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Paths by arc length: a quasi-static evolution under a load that is unknown beforehand.

A state x_n under the load gamma_n leaves the memory m_n (slip, intensity of bonds). The next point
lies on the curve

    H(x, gamma; m_n) = 0,        <(x - x_n, gamma - gamma_n), t_n> = h,

at arc length h, where t_n is a solution of the rate problem at x_n (`rate_problem`). Once accepted,
it leaves the memory m_n+1. This is a quasi-static evolution whose load, or imposed displacement,
rises and falls such that the state changes slowly, for example where a structure snaps back:
friction opposes the slip as it happens, and damage is irreversible. The constraint was
introduced by Riks (Int. J. Solids Struct. 15, 1979); here it is used on the pieces of H.

Time has no meaning on a path: laws must not depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from dolfinx_contact._mpi import Arguments, collective, require
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
from dolfinx_contact.evolution.evolution import Runnable
from dolfinx_contact.evolution.path import (
    Known,
    PathDirection,
    PathHistory,
    PathState,
    PathStep,
    PathStepper,
    PathTask,
    begun,
)
from dolfinx_contact.evolution.run import Listeners, Run
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["ArcLength", "PathDirection"]

_LONGEST = 0.005  # default step length, relative to the range of gamma and the first tangent


def _check_run(a: Arguments) -> None:
    """Check the arguments of a run and insert defaults."""
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
    is_first = a.start is not None or path._run_state is None or path._run_state.arrived is None
    known = ("increasing", "decreasing") if is_first else ("onwards", "back")
    a.direction = a.direction or known[0]
    if a.direction not in known:
        run = "the first run" if is_first else "a later run"
        raise ValueError(f"the direction of {run} must be one of {known}: {a.direction!r}")


class ArcLength(Runnable[PathTask, PathState, PathHistory]):
    """Path of a contact problem with memory, under a load that is unknown beforehand.

    The first run starts from the state in the Functions of the problem, which must be a solution
    under the present value of the parameter, or from ``start=``. A later run starts where the
    previous one ended. Another evolution of the same problem needs ``start=``. Functions and
    parameter follow the accepted points. The state of each point is stored, as
    ``history.steps[-1].state``.

    Args:
        parametric: contact problem with its load or imposed displacement gamma.

    Attributes:
        parametric: parametric problem as given.
        problem: contact problem.

    Raises:
        ValueError: on every rank, if a law depends on the time, on the length of a step or on the
            distance slipped, or the bulk form has kinks in u.

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
        self.driven = parametric._driven_expressions
        require_smooth(parametric)
        self._require_no_time()

    def _require_no_time(self) -> None:
        """Raise ``ValueError`` if a law depends on time or on the distance slipped. Collective."""
        check_times(self.problem.equations)
        for s in self.problem.surfaces:
            s.update_geometry()
            obstacle_to_path = _dependence(s)
            message = f"{s.name}: the law {s.law.name} {obstacle_to_path}"
            require(self.problem.comm, not obstacle_to_path, message)

    @collective(
        "a path by arc length",
        _check_run,
        local=("start",),
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
        """Follow the path until the load reaches an end of its range. Collective.

        Args:
            gamma_range: range of the load, (lowest, highest).
            start: state at which the path starts, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``, under its ``gamma`` or the present value of the parameter;
                default: end of the previous run, in a first run the Functions as they are with
                virgin memory. Required in the first run if the problem has had another evolution.
            direction: direction in which the path leaves its start: in the first run
                ``"increasing"`` (default) or ``"decreasing"`` load; in a later run ``"onwards"``
                (default) or ``"back"``, in which the state unloads without recovery.
            control: step lengths, in units in which the first tangent and the range of gamma have
                size 1; default: up to 0.005. Longer steps may miss a fold of many bonds.
            max_steps: largest number of points.
            rays: whether all solutions of the rate problem are computed and counted in
                `PathStep.directions`: True: at every kink and nonsmooth fold, by all statuses that
                meet there, up to 256 pieces; False or None (default): only if no direction is found
                otherwise.
            stop: condition that ends the run, see `QuasiStatic.run`.
            observer: observer of the accepted points, see `QuasiStatic.run`.
            record: record of the accepted points, such as `records.PathRecord`.
            progress: whether rank 0 shows the progress, see `QuasiStatic.run`.

        Returns:
            History with the accepted points and the reason why the path ended. A path never jumps:
            if no continuation is found, or no step is solved, it ends, and ``complete`` is False.

        Raises:
            ValueError: on every rank, if arguments are not admissible, a law depends on the time,
                the start is not a solution, or the load leaves its range immediately. Errors of
                ``stop`` and ``observer`` on one rank are raised on every rank.
            OSError: on every rank, if a point cannot be recorded.
        """
        assert control is not None
        assert direction is not None
        self._require_no_time()
        self.parametric.check_parameter(samples_of(*gamma_range))
        run_state = self._run_state if start is None else None
        if run_state is None:
            self._require_start(start)
            accepted = self.stepper(None).start(0.0, start)
            run_state = PathState(accepted, 0.0, known=Known(scales=self.parametric.scales))
        self._has_begun()
        task = PathTask(gamma_range, direction, control, max_steps, bool(rays))
        listeners = Listeners(stop, observer, record, progress)
        return self._run(task, begun(task, run_state), listeners)

    @property
    def _gamma(self) -> float:
        """Load at the last accepted state; before the first run, the value of the parameter."""
        value = self.parametric.constant.value
        return float(value) if self._run_state is None else self._run_state.gamma

    def stepper(self, progress: bool | None) -> PathStepper:
        return PathStepper(self.parametric)

    def _run(self, task: PathTask, run_state: PathState, listeners: Listeners) -> PathHistory:
        low, high = task.gamma_range
        accepted = run_state.accepted
        bordered = Bordered(self.parametric, gamma_scale=high - low)
        steps = ArcSteps(Corrector(bordered, task.control, chords=False))
        stepper = self.stepper(listeners.progress)
        rule = ByArcLength(self.parametric, stepper, steps, task, run_state)
        history = PathHistory(accepted.time, accepted.energies, gamma=accepted.gamma)
        try:
            self._follow(Run(stepper, rule, listeners, history))
        finally:
            bordered.destroy()
        return history


def _dependence(s: DiscreteSurface) -> str:
    """Return the reason why a law has no path by arc length; "" if it has one.

    The reason is a predicate, to which the name of the law is the subject.
    """
    rates = [name for name in s.law.needs_time if np.any(s.points.data.fields[name] != 0)]
    if rates:
        return (
            f"answers to the time or length of a step, by its {' and '.join(rates)}; a path by arc "
            "length has no time: use QuasiStatic"
        )
    compiled = s.law_at_points.compiled
    if not s.law.needs_time and compiled.needs_time(0.0):
        return (
            "depends on the time of a step (a.step); a path by arc length has none: use QuasiStatic"
        )
    if compiled.knows_slip:
        return (
            "has friction that depends on the distance slipped (a.slid), of which a path by arc "
            "length has no memory"
        )
    return ""
