# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonsmooth contact dynamics: bodies with mass, impacts, and Coulomb's friction.

The equation of motion is one of measures, in which impacts are impulses, and its unknowns are
velocities and impulses (Jean and Moreau). Steps are implicit, by the schemes of `body.moving` and
the levels of `motion`; each is a contact problem of its own, solved as a static one.

Which combination to choose: a node with mass that hits an obstacle stops at once, and its momentum
returns as an oscillation of its force. Without mass at the nodes that may touch, theta = 1/2 and
the gap in Signorini's law, which is the default, the energy of a linear body is kept and the force
follows the waves. With mass there theta = 1/2 makes the force alternate from step to step, and
larger theta, or theta-Euler, dissipate. At the velocity level a node without mass has no velocity
to reflect.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from typing import Any, get_args

import ufl
from dolfinx import fem

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._ufl_data import described, refuse_other_mesh
from dolfinx_contact._validate import is_number
from dolfinx_contact.body.inertia import Mass
from dolfinx_contact.body.moving import Scheme, TimeStep
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.evolution import Evolution
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.mass_and_damping import Matrices, data_of, is_scalar_constant
from dolfinx_contact.evolution.motion import Level, Method, MotionStepper
from dolfinx_contact.evolution.motion_energy import MotionEnergies
from dolfinx_contact.evolution.run import NOT_BY_VALUE, Listeners, RunState, compared_arguments
from dolfinx_contact.evolution.step import Stepper
from dolfinx_contact.evolution.through_times import (
    Accept,
    HistoryTask,
    ThroughTimes,
    checked_times,
)
from dolfinx_contact.evolution.to_rest import RestTask, ToRest
from dolfinx_contact.problem import ContactProblem

__all__ = ["NSCD"]

logger = logging.getLogger(__name__)


def _check(a: Arguments) -> None:
    problem = a.problem
    if not isinstance(problem, ContactProblem):
        raise ValueError(f"a ContactProblem is needed, got {type(problem).__name__}")
    a.dt = _positive("dt", a.dt)
    _method(a.scheme, a.theta, a.level, a.mass, a.restitution)
    _check_problem(problem, a.level)
    if a.velocity is not None and getattr(a.velocity, "function_space", None) != problem.V:
        raise ValueError("velocity must be a Function of the displacement's space")
    refuse_other_mesh(ufl.as_ufl(a.density), problem.V.mesh, "the density")
    _refuse_state(ufl.as_ufl(a.density), problem.u, a.velocity)
    if isinstance(a.density, int | float) and not (math.isfinite(a.density) and a.density > 0):
        raise ValueError(f"the density must be positive, got {a.density!r}")


def _compared(a: Arguments) -> dict[str, Any]:
    V = a.problem.V
    return {
        "theta": float(a.theta),
        "restitution": float(a.restitution),
        "damping": _described(a.damping, V),
        "density": lambda: described(ufl.as_ufl(a.density), V.mesh),
    }


def _check_settle(a: Arguments) -> None:
    a.max_time = _positive("max_time", a.max_time)
    if not (is_number(a.rest) and 0 < a.rest < 1):
        raise ValueError(f"rest must be between 0 and 1, got {a.rest!r}")
    time = a.self._time
    checked_times((time, time + a.self._dt), a.self._accepted)
    Listeners(observer=a.observer, progress=a.progress).check(a.self._record)


def _check_run(a: Arguments) -> None:
    if a.locate is not None:
        a.locate = _positive("locate", a.locate)
        if a.locate > a.self._dt:
            raise ValueError(f"locate must be no longer than dt, got {a.locate!r}")
    a.times = checked_times(a.times, None if a.start is not None else a.self._accepted)
    Listeners.of(a).check(a.self._record)


class NSCD(Evolution):
    """The motion of a body with contact and friction, by nonsmooth contact dynamics.

    Its first run starts from the displacement in the problem's Functions and from `velocity`, or
    from ``start=``. A later run starts where the last one has ended. Another evolution of the same
    problem needs ``start=``. Functions, `velocity` and data follow the accepted steps. The
    multipliers are means over the step: impulses over areas and the length of the step.
    Dirichlet data prescribe the displacement at the ends of steps; what they prescribe begins with
    the displacement and velocity that the body has there. A start that is elsewhere than they
    prescribe, or moves where they do not, is refused. Where they have another velocity, or a kink
    in time, velocities turn about theirs from step to step if theta is 1/2; of that the log warns.

    Args:
        problem: the contact problem, with loads and Dirichlet data, without inertia.
        density: mass per volume (per area in 2D, of unit thickness): a number, Constant, Function
            or UFL expression of the coordinates. Of a body of revolution that of its volume. It
            must not change within a run; mass and damping are assembled when a run starts.
        dt: length of a step, a time.
        load: function of the time, called on every rank before each step, that sets Constants and
            Functions of the data to their values at that time; by default they stay. It is refused
            if it depends on earlier calls.
        velocity: at the first time, a Function of the displacement's space; by default at rest. It
            is to be that of the Dirichlet data where these hold the body: 0 where they stay.
        scheme: ``"theta"``, ``"theta-euler"`` or ``"modified-theta"`` (`body.moving`).
        theta: weight of the end of a step, 1/2 to 1.
        level: ``"position"``, Signorini's law of the gap, or ``"velocity"``, Moreau's law of impact
            of velocities, under which points come to rest within the obstacle by up to the
            distance of a step (`motion`).
        mass: ``"consistent"``, ``"lumped"`` or ``"redistributed"``, without mass at the nodes that
            may touch (`body.inertia`). That keeps the whole mass and moves its centre by a part of
            a cell, so that a body that floats turns a little under a uniform force, less on finer
            meshes; beyond a percent the log warns, with the figure. The velocity of nodes without
            mass means nothing by itself, and no momentum is to be taken from `velocity` there: use
            the impulses of contact, or take another mass.
        damping: forces affine in the velocity, as of a viscoelastic body: a UFL form in
            ``velocity`` and a test function, or in a trial and a test function; or a pair (a, b)
            of numbers or scalar Constants for Rayleigh's a M + b K, a per time, b a time. K is
            that of the undeformed body, M consistent. The part of a form at zero velocity, as that
            of a wind, c (v - w), is a load.
            A form that holds the displacement is refused, and one with kinks or jumps in the
            velocity (dry friction, which is a law of a contact surface).
            Like the density its factors (for b > 0 also the stiffness) must not change within a
            run.
            In a body of revolution, per volume or per area, like the bulk.
        restitution: coefficient e, 0 to 1, at the velocity level.

    Attributes:
        velocity: as given, or made; a Function.
        problem: of a step of time, on the Functions and surfaces of that given.

    Raises:
        ValueError: on every rank, if arguments do not fit or cannot work together.

    Example:
        ::

            motion = NSCD(problem, density=1.0, dt=0.01, velocity=velocity)
            history = motion.run([0.0, 2.0])
            print(history.energies.kinetic, history.energies.dissipated)
    """

    account = MotionEnergies

    @collective("a motion", _check, compare=_compared)
    def __init__(
        self,
        problem: ContactProblem,
        density: Any,
        *,
        dt: float,
        load: Callable[[float], object] | None = None,
        velocity: fem.Function | None = None,
        scheme: Scheme = "theta",
        theta: float = 0.5,
        level: Level = "position",
        mass: Mass = "redistributed",
        damping: ufl.Form | tuple[Any, Any] | None = None,
        restitution: float = 0.0,
    ):
        comm = problem.comm
        V = problem.V
        self._dt = dt
        method = _method(scheme, theta, level, mass, restitution)
        if method.alternates and comm.rank == 0:
            logger.warning(
                "theta = 1/2 with mass at the nodes that may touch: contact forces alternate from "
                "step to step, their mean is right; mass='redistributed' has none there"
            )
        self.velocity = fem.Function(V, name="velocity") if velocity is None else velocity
        self._method = method
        step = TimeStep(self._dt, method.theta, method.scheme)
        self._matrices = Matrices(problem, self.velocity, density, mass, damping)
        super().__init__(problem.moving(self._matrices.body(step)), load or _constant)
        self.kept = {"velocity": self.velocity}
        self.data = data_of(density, damping, self.velocity)
        self.forms = [damping] if isinstance(damping, ufl.Form) else []
        words = (f"scheme {scheme}", f"theta {method.theta!r}", f"level {level}", f"mass {mass}")
        restores = f"restitution {method.restitution!r}"
        of = f"density {described(ufl.as_ufl(density), V.mesh)}"
        self.method = (of, *words, restores, f"damping {_described(damping, V)}")

    @collective(
        "the times of a motion",
        _check_run,
        compare=compared_arguments,
        local=NOT_BY_VALUE,
    )
    def run(
        self,
        times: Sequence[float],
        *,
        start: State | None = None,
        locate: float | None = None,
        accept: Accept | None = None,
        stop: Stop[EvolutionStep] | None = None,
        observer: ObserverLike[EvolutionStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go through times. Collective.

        Args:
            times: increasing times. The first is that of the start, every other is the end of a
                step. Between two there are equal steps no longer than dt.
            start: state at the first time, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``; by default the end of the last run, in a first run the
                Functions as they are with virgin memory (slips are counted from there, bonds are
                those of the law). Required in the first run of an evolution if the problem has had
                another one.
            locate: a time, to which begins of contact are located: steps in which a point closes
                are tried again with half the length as long as that is no shorter.
            accept: called with every step, on every rank; a step that it rejects is tried again
                with half the length, down to ``locate`` or dt halved twenty times. It is an error
                to reject a step of that length.
            stop: called with every accepted step, on every rank, while its end is in the problem;
                the reason for which the run ends there, or "" to continue. A later run continues
                from there.
            observer: called with every accepted step while its end is in the problem. Observers
                must be read-only: the run restores the accepted state before the next step.
            record: keeps every accepted step before the observer is called, as
                `records.EvolutionRecord` does.
            progress: whether rank 0 reports on the standard error stream where it is; by default
                once it takes more than some seconds.

        Returns:
            The accepted steps of this run, and in words why it ended. The forces of their tables
            are means over the step, gaps and displacements those of its end.

        Raises:
            NoContinuation: if a step is not solved, however short; the problem is at the last
                accepted state.
            ValueError: on every rank, for arguments that do not fit, a point that is within an
                obstacle at the start, or data that cannot be solved with; what ``load``,
                ``accept``, ``stop`` or ``observer`` raises on any rank.
            OSError: on every rank, if a step cannot be recorded.
        """
        least = self._least if locate is None else locate
        task = HistoryTask(tuple(times), self._dt, least, locate=locate is not None)
        return self._begin(task, Listeners(accept, stop, observer, record, progress), start)

    @collective("settling", _check_settle, local=("start",))
    def settle(
        self,
        max_time: float,
        *,
        start: State | None = None,
        rest: float = 1e-6,
        observer: ObserverLike[EvolutionStep] | None = None,
        progress: bool | None = None,
    ) -> History:
        """Continue until the body is at rest, as a damped one comes to be. Collective.

        Args:
            max_time: after which this ends in any case.
            start: state at the start, as in `run`.
            rest: share of the largest kinetic energy so far. The body is at rest when its energy
                has stayed below that for ten steps, and for 4 sqrt(rest) of the time since the
                start, which is longer than a body stays below it that turns back, as one thrown up.
            observer: called with every accepted step.
            progress: see `run`.

        Returns:
            The steps; not ``complete`` if the body is not at rest.

        Raises:
            NoContinuation: as `run`.
            ValueError: on every rank, for arguments that do not fit, and as `run`.
        """
        time = 0.0 if start is not None else self._time
        task = RestTask((time,), self._dt, self._least, max_time=max_time, rest=float(rest))
        return self._begin(task, Listeners(observer=observer, progress=progress), start)

    def _later_time(self, task: HistoryTask) -> float:
        return task.times[0] + self._dt if isinstance(task, RestTask) else super()._later_time(task)

    @property
    def _time(self) -> float:
        """Of the last accepted state, or of the start, if no run gives it another."""
        return 0.0 if self._accepted is None else self._accepted.time

    @property
    def _least(self) -> float:
        """Length of the shortest step."""
        return self._dt / 2**_HALVINGS

    def _rule(
        self, stepper: Stepper, task: HistoryTask, run_state: RunState, accept: Accept | None
    ) -> ThroughTimes:
        if isinstance(task, RestTask):
            return ToRest(stepper, task, run_state)
        return super()._rule(stepper, task, run_state, accept)

    def _stepper(self, progress: bool | None) -> MotionStepper:
        wanted = False if progress is False else None
        stepper = self.problem, self.velocity, self.load, self._method, self._matrices
        return MotionStepper(*stepper, wanted)


_HALVINGS = 20  # of dt, to the least step


def _constant(_: float) -> None:
    """A load that stays."""


def _positive(name: str, value: Any) -> float:
    """A length of time, or ``ValueError``."""
    if not (is_number(value) and math.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be a positive time, got {value!r}")
    return float(value)


def _method(scheme: Any, theta: Any, level: Any, mass: Any, restitution: Any) -> Method:
    """The task, or ``ValueError`` if it cannot work."""
    for name, value, known in (
        ("scheme", scheme, get_args(Scheme)),
        ("level", level, get_args(Level)),
        ("mass", mass, get_args(Mass)),
    ):
        if value not in known:
            raise ValueError(f"{name} is {value!r}: known are {', '.join(map(repr, known))}")
    for name, value, low in (("theta", theta, 0.5), ("restitution", restitution, 0.0)):
        if not (is_number(value) and low <= value <= 1.0):
            raise ValueError(f"{name} must be between {low:g} and 1, got {value!r}")
    if level == "position" and restitution > 0:
        raise ValueError(
            "a coefficient of restitution is about velocities, level='velocity': at the level of "
            "positions what is elastic alone throws a body back"
        )
    if level == "velocity" and mass == "redistributed":
        raise ValueError(
            "at the level of velocities a node needs mass: one without has no velocity to reflect, "
            "and the energy grows without bound; take mass='lumped' or 'consistent'"
        )
    return Method(scheme, float(theta), level, float(restitution), mass == "redistributed")


def _check_problem(problem: ContactProblem, level: Level) -> None:
    """Raise ``ValueError`` for what a motion cannot have. Not collective."""
    eq = problem.equations
    if not eq.rigid.fixed.all():
        raise ValueError("a rigid body has no mass here: prescribe all of its motion")
    if level == "position":
        return
    for s in problem.surfaces:
        for what, wrong in (
            ("a compliant law", s.law.compliant),
            ("adhesion", s.law_at_points.compiled.bonded),
            ("large sliding on a curved obstacle", s.displaced is not None),
            ("large sliding between bodies", s.slides),
        ):
            if wrong:
                raise ValueError(f"{s.name}: {what} is about positions; take level='position'")


def _refuse_state(density: Any, *state: fem.Function | None) -> None:
    """Raise ``ValueError`` if a density depends on what moves."""
    known = ufl.algorithms.extract_coefficients(density)
    if any(f is given for f in known for given in state):
        raise ValueError(
            "the density depends on the displacement or the velocity: it is that of the undeformed "
            "body, and stays"
        )


def _described(damping: Any, V: fem.FunctionSpace) -> str:
    """Damping in words, by which records and ranks know it."""
    if isinstance(damping, ufl.Form):
        return described(damping, V.mesh)
    if isinstance(damping, tuple | list):
        words = [repr(float(v) if is_scalar_constant(v) else v) for v in damping]
        return f"({', '.join(words)})"
    return repr(damping)
