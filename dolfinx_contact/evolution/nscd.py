# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonsmooth contact dynamics (NSCD): bodies with mass, impacts and Coulomb friction.

The equation of motion is an equation of measures, in which impacts are impulses (Moreau, CISM
Lectures 302, 1988; Jean, CMAME 177, 1999). With mass M, damping C, internal forces minus loads R,
the operator B of relative motions, and contact impulses dr,

    M dv + (R(u) + C v) dt = B^T dr,        du = v dt,

with Signorini's and Coulomb's laws at every contact point. Steps are implicit; their schemes are
defined in `body.moving`, the laws in `motion`, the energies in `energy`. Each step is a
static contact problem (`ContactProblem.step_from`).

Choice of the method. The impact of a node with mass on an obstacle causes oscillations of the
contact force. Therefore the default is redistributed mass, without mass at the nodes that may come
into contact, theta = 1/2, and Signorini's law for the gap: the energy of a linear body is
conserved, and the contact force follows the elastic waves. With mass at these nodes, theta = 1/2
makes the force alternate from step to step; larger theta and theta-Euler dissipate energy. At the
velocity level every node must have mass.

Choice of the step. The schemes are implicit, so that no step is unstable for a linear body; the
step h follows from the motion to be resolved. With the scheme "theta", a vibration v' = -w^2 u,
u' = v has the factor

    z = (1 + (1 - theta) i w h)/(1 - theta i w h),    arg z = w h (1 - (w h)^2/12 + ...) at 1/2,
    abs(z) = 1 - (theta - 1/2) (w h)^2 + ...,

in a step: with theta = 1/2 its period is too long by (w h)^2/12, 0.8 % for 20 steps per period; a
larger theta damps it at the rate (theta - 1/2) w^2 h. Impact forces follow waves of the speed c =
((lambda + 2 mu)/rho)^(1/2), with Lame's constants lambda and mu and the density rho. A mesh of cell
size dx has no waves shorter than a few cells, so that steps much shorter than dx/c resolve nothing
more: with h = 4, 2, 1, 1/2 and 1/4 dx/c the force of `demo_bouncing_bar` is wrong by 14, 11, 7, 5
and 10 %.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from typing import Any

import ufl
from dolfinx import fem

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._ufl import described, refuse_other_mesh
from dolfinx_contact._validate import instance, is_number, positive
from dolfinx_contact.body.inertia import Mass
from dolfinx_contact.body.moving import Scheme, TimeStep
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import MotionEnergies
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.mass_and_damping import Matrices
from dolfinx_contact.evolution.motion import HeldNodes, Level, Method, MotionStepper
from dolfinx_contact.evolution.quasi_static import Evolution, check_run
from dolfinx_contact.evolution.run import Listeners
from dolfinx_contact.evolution.through_times import HistoryTask
from dolfinx_contact.problem import ContactProblem

__all__ = ["NSCD"]

logger = logging.getLogger(__name__)

_SHORTEST = 2.0**-10  # shortest step, relative to dt


def _check(a: Arguments) -> None:
    """Check the arguments of `NSCD`."""
    problem = instance(a.problem, "problem", ContactProblem)
    a.dt = positive(a.dt, "dt", "a positive time")
    Method(a.scheme, a.theta, a.level, a.restitution, a.mass)
    if a.velocity is not None and getattr(a.velocity, "function_space", None) != problem.V:
        raise ValueError("velocity must be a Function of the space of the displacement")
    density = ufl.as_ufl(a.density)
    refuse_other_mesh(density, problem.V.mesh, "the density")
    coefficients = ufl.algorithms.extract_coefficients(density)
    if any(f is moving for f in coefficients for moving in (problem.u, a.velocity)):
        raise ValueError(
            "the density depends on the displacement or the velocity: it must refer to the "
            "undeformed body"
        )
    if isinstance(a.density, int | float) and not (math.isfinite(a.density) and a.density > 0):
        raise ValueError(f"the density must be positive, got {a.density!r}")
    if not problem.equations.rigid.fixed.all():
        raise ValueError("rigid bodies have no mass in a motion: prescribe their whole motion")
    for s in problem.surfaces if a.level == "velocity" else ():
        for what, present in (
            ("a compliant law", s.law.compliant),
            ("adhesion", s.law_at_points.compiled.bonded),
            ("large sliding on a curved obstacle", s.displaced is not None),
            ("large sliding between bodies", s.slides),
        ):
            if present:
                raise ValueError(f"{s.name}: {what} is about positions; use level='position'")


def _compared(a: Arguments) -> dict[str, Any]:
    """Return the arguments of `NSCD` that must be the same on all ranks."""
    V = a.problem.V
    return {
        "theta": float(a.theta),
        "restitution": float(a.restitution),
        "damping": _described(a.damping, V),
        "density": lambda: described(ufl.as_ufl(a.density), V.mesh),
    }


def _check_run(a: Arguments) -> None:
    """Check the arguments of `NSCD.run`."""
    if a.locate is not None:
        a.locate = positive(a.locate, "locate", "a positive time")
        if a.locate > a.self._dt:
            raise ValueError(f"locate must not be longer than dt, got {a.locate!r}")
    check_run(a)


def _check_settle(a: Arguments) -> None:
    """Check the arguments of `NSCD.settle`."""
    a.max_time = positive(a.max_time, "max_time", "a positive time")
    if not (is_number(a.rest) and 0 < a.rest < 1):
        raise ValueError(f"rest must be between 0 and 1, got {a.rest!r}")
    Listeners(observer=a.observer, progress=a.progress).check(a.self._record)


class NSCD(Evolution):
    """Motion of a body with contact and friction, computed by nonsmooth contact dynamics.

    The first run starts from the displacement in the Functions of the problem and from `velocity`,
    or from ``start=``. A later run starts where the previous one ended. Another evolution of the
    same problem requires ``start=``. Functions, `velocity` and data follow the accepted steps. The
    multipliers are means over the step: impulses divided by areas and the length of the step.

    Dirichlet data prescribe the displacement at the ends of the steps. At the start, displacement
    and velocity must agree with the data: a different displacement, or a velocity where the data
    are constant, is an error. If theta is 1/2 and the data have another velocity or a kink in time,
    the velocity of the held nodes oscillates from step to step, and a warning is logged.

    Args:
        problem: contact problem with loads and Dirichlet data, without inertia.
        density: mass per volume (in 2D per area, for unit thickness): a number, Constant, Function
            or UFL expression of the coordinates. It must not change during a run; mass and damping
            are assembled when a run starts.
        dt: largest duration of a step. Recommended: at most 1/20 of the shortest period of
            interest, so that this period is at most 0.8 % too long. If contact forces follow waves,
            also at most the time dx/c of a wave across a cell (see the module).
        load: function of the time, called on every rank before each step, that sets Constants and
            Functions of the data to their values at that time; default: data are constant. It must
            not depend on earlier calls.
        velocity: Function of the velocity, with its initial values; default: at rest. Initial
            values at held nodes must agree with the Dirichlet data.
        scheme: time integration, ``"theta"``, ``"theta-euler"`` or ``"modified-theta"`` (see
            `body.moving`).
        theta: weight of the forces at the end of a step, 1/2 to 1.
        level: ``"position"`` for Signorini's law in terms of the gap, or ``"velocity"`` for
            Moreau's impact law in terms of velocities, with which points may come to rest inside
            the obstacle, as deep as they move in one step (see `motion`).
        mass: kind of the mass matrix, ``"consistent"``, ``"lumped"`` or ``"redistributed"``,
            without mass at the nodes that may come into contact (see `body.inertia`).
            Redistribution conserves the mass, but moves its centre by a fraction of a cell, so that
            a floating body rotates slightly under a uniform force; a warning is logged for errors
            above one per cent. The velocity of a node without mass has no physical meaning: to
            compute momentum, use contact impulses or another kind of mass.
        damping: forces affine in the velocity: a UFL form in ``velocity`` and a test function, a
            UFL form in a trial and a test function, or a pair (a, b) of numbers for Rayleigh
            damping a M + b K, a an inverse time, b a time, with K of the undeformed body and M
            consistent. The value of a form at zero velocity, such as the wind w in c (v - w), is a
            load. Forms containing the displacement or having kinks in the velocity (dry friction)
            are an error. The coefficients, and for b > 0 the stiffness, must not change during a
            run. For an axisymmetric body, integrands are given per volume or area, as in the bulk
            form. Default: no damping.
        restitution: coefficient of restitution at the velocity level, 0 (default) to 1.

    Attributes:
        velocity: Function of the velocity.
        problem: contact problem of a time step, with the Functions and surfaces of ``problem``.

    Raises:
        ValueError: on every rank, if arguments are not admissible or cannot be combined.

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
        V = problem.V
        method = Method(scheme, theta, level, restitution, mass)
        if method.alternates and problem.comm.rank == 0:
            logger.warning(
                "theta = 1/2 with mass at the nodes that may touch: contact forces alternate from "
                "step to step, but their mean is correct; mass='redistributed' avoids this, except "
                "for laws that weaken with the speed, which need mass at these nodes"
            )
        self._dt = dt
        self._method = method
        self.velocity = fem.Function(V, name="velocity") if velocity is None else velocity
        self._matrices = Matrices(problem, self.velocity, density, mass, damping)
        body = self._matrices.body(TimeStep(dt, method.theta, scheme))
        super().__init__(problem.moving(body), load or (lambda _: None))
        self._held = HeldNodes(self.problem)
        # for the manifest of a record
        self.kept = {"velocity": self.velocity}
        self.data = self._matrices.data
        self.forms = [damping] if isinstance(damping, ufl.Form) else []
        self.method = (
            f"density {described(ufl.as_ufl(density), V.mesh)}",
            f"scheme {scheme}",
            f"theta {method.theta!r}",
            f"level {level}",
            f"mass {mass}",
            f"restitution {method.restitution!r}",
            f"damping {_described(damping, V)}",
        )

    @collective(
        "the times of a motion",
        _check_run,
        local=("start",),
    )
    def run(
        self,
        times: Sequence[float],
        *,
        start: State | None = None,
        locate: float | None = None,
        stop: Stop[EvolutionStep] | None = None,
        observer: ObserverLike[EvolutionStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> History:
        """Compute the motion through the given times. Collective.

        Args:
            times: increasing times: the start, then times at which steps end. Intervals are divided
                into equal steps of at most dt.
            start: state at the first time, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``. Default: end of the previous run; in a first run the present
                Functions with virgin memory (no slip, intact bonds). Required in the first run if
                the problem has had another evolution.
            locate: time resolution of first contacts: a step in which a point closes is repeated
                with half the length, down to ``locate``; by default contacts are not located. A
                step that is not solved is repeated with a quarter of its length, down to ``locate``
                or by default dt/1024; the first such step logs a warning.
            stop: function that returns a reason to end the run, see `QuasiStatic.run`.
            observer: function or observer called with each accepted step, see `QuasiStatic.run`.
            record: record of the accepted steps, see `QuasiStatic.run`.
            progress: whether rank 0 shows the progress, see `QuasiStatic.run`.

        Returns:
            History with the accepted steps of this run and the reason why it ended. Forces in the
            tables are means over the step, gaps and displacements refer to its end.

        Raises:
            NoContinuation: if a step is not solved, down to the shortest length; the problem is at
                the last accepted state.
            ValueError: on every rank, if arguments or data are not admissible, or if a point is
                inside an obstacle at the start. Errors of ``load``, ``stop`` and ``observer`` on
                one rank are raised on every rank.
            OSError: on every rank, if a step cannot be recorded.
        """
        shortest = self._dt * _SHORTEST if locate is None else locate
        task = HistoryTask(tuple(times), self._dt, shortest, locate=locate is not None)
        return self._begin(task, Listeners(stop, observer, record, progress), start)

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
        """Run until the body is at rest. Collective.

        Args:
            max_time: upper bound of the duration of the run.
            start: state at the start, as in `run`; its time counts as 0.
            rest: fraction of the largest kinetic energy so far. The body counts as at rest if the
                kinetic energy has been below this fraction for ten steps and for 4 sqrt(rest) of
                the time since the start. At a reversal of the velocity, for example at the top of a
                throw, the energy is small for a shorter time. Default 1e-6.
            observer: see `run`.
            progress: see `run`.

        Returns:
            History with the accepted steps; ``complete`` is False if the body is not at rest.

        Raises:
            NoContinuation: see `run`.
            ValueError: on every rank, if arguments are not admissible; see also `run`.
        """
        time = 0.0 if start is not None or self._accepted is None else self._accepted.time
        times = (time, time + max_time)
        task = HistoryTask(times, self._dt, self._dt * _SHORTEST, rest=float(rest))
        return self._begin(task, Listeners(observer=observer, progress=progress), start)

    def stepper(self, progress: bool | None) -> MotionStepper:
        return MotionStepper(
            self.problem,
            self.velocity,
            self.load,
            self._method,
            self._matrices,
            self._held,
            False if progress is False else None,
        )


def _described(damping: Any, V: fem.FunctionSpace) -> str:
    """Describe damping as text, for records and for the comparison between ranks."""
    return described(damping, V.mesh) if isinstance(damping, ufl.Form) else repr(damping)
