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

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._affine import dependence
from dolfinx_contact._agreement import described, refuse_other_mesh
from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import everywhere
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._numbers import is_number
from dolfinx_contact.body.inertia import Mass, mass_matrix, rigid_errors
from dolfinx_contact.body.moving import MovingBody, Scheme, TimeStep
from dolfinx_contact.body.weighting import circumference, weighted
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.given_data import Constancy, Datum, data_in, placed_data
from dolfinx_contact.evolution.accepted import Stepper
from dolfinx_contact.evolution.evolution import Evolution
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.listeners import NOT_BY_VALUE, Listeners
from dolfinx_contact.evolution.motion import Level, Method, MotionStepper
from dolfinx_contact.evolution.motion_energy import MotionEnergies
from dolfinx_contact.evolution.run_state import RunState
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
    a.times = checked_times(a.times, a.self._accepted)
    Listeners.of(a).check(a.self._record)


class NSCD(Evolution):
    """The motion of a body with contact and friction, by nonsmooth contact dynamics.

    It begins with the displacement and statuses in the problem's Functions, at the first time, and
    with `velocity`, and with bonds as `QuasiStatic` has them. A later run begins where the last one
    has ended; where displacement or velocity have been set between, that is refused: another motion
    begins from what is there. They follow the accepted steps, as do data and memory of the
    problem. The memory stays in the surfaces afterwards: ``surface.memory = None``
    makes the law of the problem that was given static again. The multipliers are means over the
    step: impulses over areas and the length of the step.
    Dirichlet data prescribe the displacement at the ends of steps; what they prescribe begins with
    the displacement and velocity that the body has there. A start that is elsewhere than they
    prescribe, or moves where they do not, is refused. Where they have another velocity, or a kink
    in time, velocities turn about theirs from step to step if theta is 1/2; of that the log warns.

    Args:
        problem: the contact problem, with loads and Dirichlet data, without inertia.
        density: mass per volume (per area in 2D, of unit thickness): a number, Constant, Function
            or UFL expression of the coordinates. Of a body of revolution that of its volume. It
            must not change: a run in which it does is refused.
        dt: length of a step, a time.
        load: called with a time, on every rank, sets Constants and Functions of the problem's data
            to their values at that time; by default they stay. One that depends on earlier calls is
            refused, of one that depends on the solution the log warns.
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
            Like the density its factors stay: a run in which a Constant or Function in them (for
            b > 0 in the stiffness) changes is refused.
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
        body = _moving_body(problem, self.velocity, step, density, mass, damping)
        super().__init__(problem.moving(body), load or _constant)
        self.kept = {"velocity": self.velocity}
        self.data = _data(density, damping, self.velocity)
        self.forms = [damping] if isinstance(damping, ufl.Form) else []
        stay = _of_matrices(density, damping, self.velocity) + _of_stiffness(problem, damping)
        self._constancy = Constancy(comm, stay)
        words = (f"scheme {scheme}", f"theta {method.theta!r}", f"level {level}", f"mass {mass}")
        restores = f"restitution {method.restitution!r}"
        of = f"density {described(ufl.as_ufl(density), V.mesh)}"
        self.method = (of, *words, restores, f"damping {_described(damping, V)}")

    @collective(
        "the times of a motion",
        _check_run,
        compare=lambda a: Listeners.of(a).compared(),
        local=NOT_BY_VALUE,
    )
    def run(
        self,
        times: Sequence[float],
        *,
        locate: float | None = None,
        accept: Accept | None = None,
        stop: Stop[EvolutionStep] | None = None,
        observer: ObserverLike[EvolutionStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go through times. Collective.

        Args:
            times: increasing. The first is that of the state in the Functions or, in a later run,
                of the last accepted state; every other is the end of a step. Between two there are
                equal steps no longer than dt.
            locate: a time, to which begins of contact are located: steps in which a point closes
                are tried again with half the length as long as that is no shorter.
            accept: called with every step, on every rank; one that is not accepted is tried again
                with half the length, down to ``locate`` or dt halved twenty times, where it is
                accepted.
            stop: called with every accepted step, on every rank, while its end is in the problem;
                the reason for which the run ends there, or "" to continue. A later run continues
                from there.
            observer: called with every accepted step while its end is in the problem. It may look:
                data or a state that it has changed, and the load does not set, are refused.
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
        return self._begin(task, Listeners(accept, stop, observer, record, progress))

    @collective("settling", _check_settle)
    def settle(
        self,
        max_time: float,
        *,
        rest: float = 1e-6,
        observer: ObserverLike[EvolutionStep] | None = None,
        progress: bool | None = None,
    ) -> History:
        """Continue until the body is at rest, as a damped one comes to be. Collective.

        Args:
            max_time: after which this ends in any case.
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
        task = RestTask((self._time,), self._dt, self._least, max_time=max_time, rest=float(rest))
        return self._begin(task, Listeners(observer=observer, progress=progress))

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
        stepper = self.problem, self.velocity, self.load, self._method, self._constancy
        return MotionStepper(*stepper, wanted)


_HALVINGS = 20  # of dt, to the least step
_WRONG_INERTIA = 0.01  # of an acceleration, from which the log warns


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


def _touching(eq: ContactEquations) -> npt.NDArray[np.bool_]:
    """Owned dofs of nodes that may touch, of either body. Collective."""
    marks = np.zeros(eq.owned_sizes[0])
    slide = np.zeros(eq.owned_sizes[0] // eq.dim, dtype=bool)
    for s in eq.surfaces:
        if s.slides:  # any two points of the faces may meet
            slide |= np.any(s.obstacle.opposite.sides, axis=0)[: len(slide)]
            continue
        B = s.constant_operator("a motion").B
        weights = B.copy()
        indptr, indices, values = weights.getValuesCSR()
        weights.setValuesCSR(indptr, indices, np.abs(values))
        weights.assemble()
        ones = weights.createVecLeft()
        sums = weights.createVecRight()
        ones.set(1.0)
        weights.multTranspose(ones, sums)
        marks += sums.array_r
        for thing in (weights, ones, sums):
            thing.destroy()
    nodes = (marks.reshape(-1, eq.dim).sum(axis=1) > 0) | slide
    return np.repeat(nodes, eq.dim)


def _refuse_state(density: Any, *state: fem.Function | None) -> None:
    """Raise ``ValueError`` if a density depends on what moves."""
    known = ufl.algorithms.extract_coefficients(density)
    if any(f is given for f in known for given in state):
        raise ValueError(
            "the density depends on the displacement or the velocity: it is that of the undeformed "
            "body, and stays"
        )


def _moving_body(
    problem: ContactProblem,
    velocity: fem.Function,
    step: TimeStep,
    density: Any,
    mass: Mass,
    damping: ufl.Form | tuple[Any, Any] | None,
) -> MovingBody:
    """The body of a problem with its mass and damping, in a step of time. Collective.

    Raises:
        ValueError: on every rank, as `_damping`.
    """
    V = problem.V
    for given in (ufl.as_ufl(density), damping):
        for d in data_in(given, "") if isinstance(given, ufl.Form | ufl.core.expr.Expr) else ():
            if isinstance(d.value, fem.Function):  # its ghosts follow their owners
                d.value.x.scatter_forward()
    around = problem.equations.axisymmetric
    mass_of = density * circumference(V.mesh) if around else density
    M = mass_matrix(V, mass_of, mass, _touching(problem.equations))
    if mass == "redistributed":
        _warn_of_inertia(problem, M, mass_of)
    C, wind = _damping(problem, velocity, mass_of, damping)
    body = problem.equations.bulk
    if isinstance(body, MovingBody):
        body = body.body
    if wind is not None:
        body = body.loaded(wind)
    return MovingBody(body, M, C, step)


def _warn_of_inertia(problem: ContactProblem, M: PETSc.Mat, density: Any) -> None:
    """Warn where a mass that was moved lies elsewhere than that of the body. Collective."""
    eq = problem.equations
    V = problem.V
    consistent = mass_matrix(V, density, "consistent", np.zeros(eq.owned_sizes[0], dtype=bool))
    fixed = eq.constraints.fixed
    share, falls = rigid_errors(V, M, consistent, fixed, axisymmetric=eq.axisymmetric)
    consistent.destroy()
    if max([share, *falls.values()]) > _WRONG_INERTIA and problem.comm.rank == 0:
        turning = ", ".join(f"{100 * v:.2g} % along {axis}" for axis, v in falls.items())
        logger.warning(
            "mass='redistributed' has its centre and moments elsewhere than the body on this mesh: "
            "motions that nothing holds are accelerated by up to %.2g %% otherwise than they "
            "should be%s; take a finer mesh, mass='consistent', or mass='lumped', which keeps the "
            "centre",
            100 * share,
            f", and a body that falls turns by shares of its fall ({turning})" if falls else "",
        )


def _damping(
    problem: ContactProblem,
    velocity: fem.Function,
    density: Any,
    damping: ufl.Form | tuple[Any, Any] | None,
) -> tuple[PETSc.Mat | None, ufl.Form | None]:
    """The matrix C, and the form of what acts at no velocity. Collective.

    Raises:
        ValueError: on every rank, if that is neither a pair nor a form affine in the velocity.
    """
    if damping is None:
        return None, None
    V = problem.V
    body = problem.equations.bulk
    with everywhere(problem.comm, "damping"):
        if isinstance(damping, ufl.Form):
            form = weighted(damping, axisymmetric=problem.equations.axisymmetric)
            form, wind = _damping_form(problem.u, velocity, form)
        else:
            a, b = _rayleigh(damping)
    if isinstance(damping, ufl.Form):
        C = dolfinx.fem.petsc.assemble_matrix(compiled_form(form))
        C.assemble()
        return C, wind
    C = body.stiffness(np.zeros_like(velocity.x.array)).copy()
    C.scale(b)
    M = mass_matrix(V, density, "consistent", np.zeros(C.getLocalSize()[0], dtype=bool))
    C.axpy(a, M, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    M.destroy()
    return C, None


def _damping_form(
    u: fem.Function, velocity: fem.Function, form: ufl.Form
) -> tuple[ufl.Form, ufl.Form | None]:
    """The derivative of damping by the velocity, and what is left at none, if anything is."""
    V = u.function_space
    arguments = form.arguments()
    given = form.coefficients()
    if not arguments or any(a.ufl_function_space() != V for a in arguments):
        raise ValueError("damping must have a test function of the displacement's space")
    if u in given:
        raise ValueError(
            "damping depends on the displacement: it is that of the undeformed body; what depends "
            "on the displacement alone belongs into the bulk"
        )
    if len(arguments) == 2:
        if velocity in given:
            raise ValueError("damping in a trial and a test function must not hold the velocity")
        return form, None
    if velocity not in given:
        raise ValueError("damping must be a form in the Function that is given as velocity")
    found = dependence(form, velocity)
    if not found.is_affine:
        what = found.text_of_kinks or found.text
        raise ValueError(
            f"damping must be affine in the velocity, and is not by {what}; dry friction is a law "
            "of a contact surface"
        )
    at_rest = ufl.replace(form, {velocity: ufl.zero(velocity.ufl_shape)})
    wind = ufl.algorithms.expand_derivatives(at_rest)
    C = ufl.derivative(form, velocity, ufl.TrialFunction(V))
    return C, None if wind.empty() else wind


def _data(density: Any, damping: Any, velocity: fem.Function) -> list[Datum]:
    """Functions and Constants in density and damping."""
    found = list(data_in(ufl.as_ufl(density), "the density"))
    if isinstance(damping, ufl.Form):
        found += data_in(damping, "the damping")
    elif damping is not None:
        for name, factor in zip("ab", damping, strict=True):
            if isinstance(factor, fem.Constant):
                found.append(Datum(f"the factor {name} of Rayleigh's damping", factor))
    return [d for d in found if d.value is not velocity]


def _of_matrices(density: Any, damping: Any, velocity: fem.Function) -> list[Datum]:
    """What mass and the factors of velocities in damping depend on; not a wind, which is a load."""
    factors = damping
    if isinstance(damping, ufl.Form) and len(damping.arguments()) == 1:
        trial = ufl.TrialFunction(velocity.function_space)
        factors = ufl.algorithms.expand_derivatives(ufl.derivative(damping, velocity, trial))
    return _data(density, factors, velocity)


def _of_stiffness(problem: ContactProblem, damping: Any) -> list[Datum]:
    """What the stiffness in Rayleigh's damping depends on."""
    if damping is None or isinstance(damping, ufl.Form) or _rayleigh(damping)[1] == 0:
        return []
    mine = problem.equations.bulk.stiffness_data
    placed = placed_data(problem.equations, conditions=False)
    return [
        Datum(f"{d.place}, whose stiffness is in the damping,", d.value)
        for d in placed
        if any(d.value is f for f in mine)
    ]


def _described(damping: Any, V: fem.FunctionSpace) -> str:
    """Damping in words, by which records and ranks know it."""
    if isinstance(damping, ufl.Form):
        return described(damping, V.mesh)
    if isinstance(damping, tuple | list):
        words = [repr(float(v) if _is_scalar_constant(v) else v) for v in damping]
        return f"({', '.join(words)})"
    return repr(damping)


def _rayleigh(damping: Any) -> tuple[float, float]:
    """Its factors as they are now; `_of_matrices` has the Constants among them."""
    try:
        a, b = damping
    except (TypeError, ValueError):
        a = b = None
    if not all(is_number(v) or _is_scalar_constant(v) for v in (a, b)):
        raise ValueError(
            f"damping must be a form or a pair of numbers or scalar Constants, got {damping!r}; "
            "what varies over the body is to be a form"
        )
    a = float(a)
    b = float(b)
    if not (math.isfinite(a) and math.isfinite(b) and min(a, b) >= 0):
        raise ValueError(f"the factors of damping must not be negative, got {(a, b)!r}")
    return a, b


def _is_scalar_constant(value: Any) -> bool:
    return isinstance(value, fem.Constant) and value.ufl_shape == ()
