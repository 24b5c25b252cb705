# SPDX-License-Identifier: LGPL-3.0-or-later
r"""One time step of a body in motion, by nonsmooth contact dynamics.

The step from (u_0, v_0) at t_0 to (u_1, v_1) at t_1 = t_0 + h is a static contact problem for the
displacement w at which the contact laws are evaluated. With the factors a and s of the scheme
(`body.moving`), mass M, damping C, and internal forces minus loads R,

    w = w_0 + a h v_1,        u_1 = w_0 + s (w - w_0),        w_0 known,
    M (v_1 - v_0)/h + theta (R(u_1) + C v_1) + (1 - theta) (R(u_0) + C v_0) = contact forces.

With the gap un and its rate un', the operator B of relative motions, the velocity v_o of the
obstacle and the coefficient of restitution e, its laws are (Moreau 1988; Jean, CMAME 177, 1999)

    Signorini, position level    0 <= un(w)           perpendicular to  rn >= 0
    Signorini, velocity level    0 <= un'_1 + e un'_0 perpendicular to  rn >= 0   if the forecast
                                 un_0 + h/2 un'_0 is closed, otherwise rn = 0
    Coulomb                      friction opposes  a h (B v_1 - v_o)
    Coulomb, nodes without mass  friction opposes  (B (u_1 - u_0) - h v_o)/s

The velocity of a node without mass may oscillate about the velocity of the body; therefore friction
of such a node opposes its displacement increment. A step has the three parts of a step at rest
(`step`): solve, advance the memory, account for the energies (`energy`).

Dirichlet data prescribe the displacement u_1 at the end of a step. With theta = 1/2 the velocity of
a held node is

    v_1 = 2 (u_1 - u_0)/h - v_0,

so that an initial velocity v_0 that differs from the velocity of the data oscillates in all later
steps (`HeldNodes`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import all_ranks, largest, minimum, require
from dolfinx_contact._validate import is_number, one_of
from dolfinx_contact.body.inertia import Mass
from dolfinx_contact.body.moving import MovingBody, Scheme, TimeStep
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, SurfaceTerm
from dolfinx_contact.equations.state import State
from dolfinx_contact.equations.validation import check_obstacle
from dolfinx_contact.evolution.energy import Motion, MotionEnergies, account, motion_at
from dolfinx_contact.evolution.mass_and_damping import Matrices
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.solvers.strategies import Trial

__all__ = ["HeldNodes", "Level", "Method", "MotionStepper"]

logger = logging.getLogger(__name__)

#: Quantity in Signorini's law: the gap or its rate.
Level: TypeAlias = Literal["position", "velocity"]

_ROUND_OFF = 1e-9  # relative difference of equal step lengths; displacement that counts as zero
_FAR = 1e6  # gap that never closes, relative to the body size
_PENETRATION = 1e-9  # penetration that counts as zero, relative to the body size
_SAME = 1e-6  # fraction of the largest displacement or velocity that counts as no deviation
_DAMPED = 0.51  # theta above which an oscillation decays
_REVERSED = 0.1  # relative change of a deviation with reversed sign
_VISIBLE = 0.01  # fraction of the velocities above which an oscillation is reported
_REVERSALS = 3  # number of successive reversals after which an oscillation is reported


@dataclass(frozen=True)
class Method:
    """Parameters of the time integration; `NSCD` explains their values.

    Attributes:
        scheme: time integration of the equation of motion, see `body.moving`.
        theta: weight of the forces at the end of a step, 1/2 to 1.
        level: "position" or "velocity", the level at which Signorini's law holds.
        restitution: coefficient of restitution e at the velocity level, 0 to 1.
        mass: kind of the mass matrix.

    Raises:
        ValueError: if a value is not admissible or the values cannot be combined.
    """

    scheme: Scheme
    theta: float
    level: Level
    restitution: float
    mass: Mass

    def __post_init__(self) -> None:
        for name, kinds in (("scheme", Scheme), ("level", Level), ("mass", Mass)):
            one_of(getattr(self, name), name, get_args(kinds))
        for name, least in (("theta", 0.5), ("restitution", 0.0)):
            value = getattr(self, name)
            if not (is_number(value) and least <= value <= 1.0):
                raise ValueError(f"{name} must be between {least:g} and 1, got {value!r}")
            object.__setattr__(self, name, float(value))
        if self.level == "position" and self.restitution > 0:
            raise ValueError(
                "a coefficient of restitution requires level='velocity': at the position level "
                "only elastic deformation reverses the velocity of a body"
            )
        if self.level == "velocity" and self.massless:
            raise ValueError(
                "at the velocity level a node needs mass: otherwise it has no velocity to reverse "
                "and the energy grows without bound; use mass='lumped' or 'consistent'"
            )

    @property
    def massless(self) -> bool:
        """Whether nodes that may come into contact have no mass."""
        return self.mass == "redistributed"

    @property
    def alternates(self) -> bool:
        """Whether contact forces oscillate about their mean from step to step."""
        trapezoidal = self.scheme == "theta" and self.theta == 0.5
        return trapezoidal and self.level == "position" and not self.massless

    @property
    def penetrates(self) -> bool:
        """Whether points may come to rest inside the obstacle, as deep as they move in one step."""
        return self.level == "velocity" or self.scheme == "modified-theta"


class MotionStepper(Stepper):
    """Stepper of a body in motion, which takes the time steps.

    Args:
        problem: contact problem of a time step, with a `MovingBody`.
        velocity: Function of the velocity, which follows the accepted states.
        load: function of the time that sets Constants and Functions of the data.
        method: parameters of the time integration.
        matrices: mass and damping of the body.
        held: comparison of the motion with the Dirichlet data.
        progress: whether the progress of the solves is shown, as in `ContactProblem.solve`.
    """

    def __init__(
        self,
        problem: ContactProblem,
        velocity: fem.Function,
        load: Callable[[float], object],
        method: Method,
        matrices: Matrices,
        held: HeldNodes,
        progress: bool | None,
    ):
        super().__init__(problem, load, progress)
        body = problem.equations.bulk
        assert isinstance(body, MovingBody)
        self._body = body
        self._velocity = velocity
        self._method = method
        self._matrices = matrices
        self._held = held

    # -- one step --------------------------------------------------------------------------------

    def _taken(
        self, accepted: AcceptedState, time: float, trial: Trial, guess: AcceptedState | None
    ) -> AcceptedState:
        """Solve a step, with the motion without contact forces as initial guess. Collective."""
        assert isinstance(accepted.energies, MotionEnergies)
        problem = self.problem
        eq = problem.equations
        body = self._body
        a = _motion(accepted)
        step = self._begin(accepted, time)
        # increment of the prescribed motions of rigid bodies
        dq = np.where(eq.rigid.fixed, eq.constraints.motions() - eq.rigid.given, 0.0)
        law = problem.step_from(accepted.state, step=step.length)
        at_end: Evaluation | None = None

        def end_of_step(solution: Evaluation) -> tuple[ContactEquations, Evaluation]:
            """Write the end of the step into the Functions, and evaluate contact there."""
            nonlocal at_end
            u = step.displacement(solution.u, body.origin)
            problem.u.x.array[:] = u
            self._velocity.x.array[:] = step.velocity(solution.u, body.origin)
            at_end = _evaluation_at(law.equations, solution, u)
            return law.equations, at_end

        # Dirichlet data prescribe u_1, the unknown is w
        eq.constraints.to_unknowns = lambda values: step.seen(values, body.origin)
        try:
            # 1. solve the static problem for w
            contact = problem.with_memory(self._memory_of_laws(accepted, step, dq))
            problem.u.x.array[:] = self._free_flight(a, step)
            result, solution = contact.solve_step(progress=self._progress, shown=end_of_step)
            assert at_end is not None
            # 2. advance the memory
            memory = law.equations.memory_after(at_end)
            # 3. account for the energies
            b = motion_at(law.equations, at_end, at_end.u, self._velocity.x.array.copy())
            energies = account(accepted.energies, law.equations, solution, a, b, dq)
        finally:
            eq.constraints.to_unknowns = None
        friction = energies.dissipated - accepted.energies.dissipated
        result = replace(result, energies=result.energies | {"friction": friction})
        self._held.watch(a, b, step)
        return self.accept(law, solution.statuses, memory, time, energies, b, result=result)

    def _begin(self, accepted: AcceptedState, time: float) -> TimeStep:
        """Write the state at the start of a step into the Functions and the body. Collective."""
        self._restore(accepted)
        self._set(time)
        self._matrices.require_constant(time)
        length = time - accepted.time
        if abs(length - self._body.step.length) <= _ROUND_OFF * length:
            length = self._body.step.length  # equal steps share their matrices
        step = TimeStep(length, self._method.theta, self._method.scheme)
        self.problem.equations.read_data()
        a = _motion(accepted)
        if accepted.statuses is None:
            self._held.require_velocity(a.v)
        self._body.begin(step, a.u, a.v, a.rows)
        return step

    def _free_flight(self, a: Motion, step: TimeStep) -> Array:
        """Return the unknown displacement of a step without contact forces, as an initial guess.

        Collective. Velocities of nodes without mass are arbitrary and may invert cells. If this
        happens, the displacement of a body at rest is returned.
        """
        origin = self._body.origin
        flight = origin + step.gain * step.length * a.v
        rows = self._body.forces(step.displacement(flight, origin), a.v)
        if all_ranks(self.problem.comm, np.isfinite(rows)):
            return np.asarray(flight)
        return step.seen(a.u, origin)

    def _memory_of_laws(self, accepted: AcceptedState, step: TimeStep, dq: Array) -> list[Memory]:
        """Return the memory with which the contact laws are evaluated in a step. Collective.

        Args:
            accepted: state at the start of the step.
            step: time step.
            dq: increment of the unknowns of the rigid bodies.
        """
        a = _motion(accepted)
        # sliding pairs keep the memory of the opposing points
        pairs = zip(self.problem.surfaces, accepted.memory, strict=True)
        eq = self.problem.with_memory([m if s.slides else None for s, m in pairs]).equations
        # friction acts on the difference of w to this reference, during a part of the step
        reference = self._body.origin
        part = step.gain
        if self._method.massless:
            reference = step.seen(a.u, reference)
            part = 1.0 / step.share
        q = eq.rigid.given + (1.0 - part) * dq
        memories = []
        for term, memory in zip(eq.terms, accepted.memory, strict=True):
            s = term.surface
            at = term.kinematics(reference, q)
            gap = None
            if self._method.level == "velocity":
                gap = self._gap_of_impact(eq, term, at, a, step, dq)
            nodes = reference[: eq.owned_sizes[0]].reshape(-1, eq.dim) if s.slides else None
            memories.append(
                Memory(
                    jump=at.whole,
                    fields=memory.fields,
                    # a law of the slip rate needs the time of the increment, a h
                    step=step.length * (part if s.law.creeps else 1.0),
                    gap=gap,
                    displacement=nodes,
                    place=at.place,
                    motion=at.motion,
                )
            )
        return memories

    def _gap_of_impact(
        self,
        eq: ContactEquations,
        term: SurfaceTerm,
        at: Kinematics,
        a: Motion,
        step: TimeStep,
        dq: Array,
    ) -> Array:
        """Return initial gaps that turn the law for the gap into Moreau's law for velocities.

        The gap of the step then has the sign of un'_1 + e un'_0, with the gap rates un' at both
        ends of the step and the coefficient of restitution e. At points that are not forecast to
        close, it is large, so that the contact force vanishes.

        Args:
            eq: equations of the step.
            term: contribution of the surface to the equations (`SurfaceTerm`).
            at: kinematics at the reference configuration of friction; the law subtracts n . (jump -
                jump at this configuration) from the gap, with the normal n.
            a: motion at the start of the step.
            step: time step.
            dq: increment of the unknowns of the rigid bodies.
        """
        s = term.surface
        before = a.surfaces[term.number]
        n = s.points.data.n
        risen = s.points.data.gap - before.obstacle
        moved = at.operator.rate(term.relative(step.length * a.v, dq)[: s.owned_nodes])
        opening = risen - np.sum(moved * n, axis=1)  # h un'_0
        rebound = self._method.restitution * step.gain * opening
        gap = np.sum(at.jump * n, axis=1) + step.gain * risen + rebound
        active = before.un + 0.5 * opening <= 0
        return np.where(active, gap, gap + _FAR * eq.body_size)

    # -- the start of a run ----------------------------------------------------------------------

    def start(self, time: float, given: State | None = None) -> AcceptedState:
        self._matrices.update(self._body)
        with self.problem.restored():
            accepted = super().start(time, given)
            continues = given is not None and all(m is not None for m in given.previous)
            if not (continues and self._method.penetrates):
                self._require_no_penetration(_motion(accepted))
        return accepted

    def _check_start(self) -> None:
        super()._check_start()
        finite = bool(np.isfinite(self._velocity.x.array).all())
        require(self.problem.comm, finite, "the velocity at the start is not finite")
        for s in self.problem.surfaces:
            check_obstacle(s)
        self._held.require_displacement()

    def _require_no_penetration(self, motion: Motion) -> None:
        """Raise `ValueError` if a point is inside an obstacle at the start. Collective."""
        eq = self.problem.equations
        for s, at in zip(eq.surfaces, motion.surfaces, strict=True):
            if s.law.compliant:
                continue
            least = minimum(eq.comm, at.un, np.inf)
            require(
                eq.comm,
                least >= -_PENETRATION * eq.body_size,
                f"{s.name}: at the start points are within the obstacle, by up to {-least:.3g}",
            )

    def _evaluated(self, law: ContactProblem) -> Evaluation:
        """Evaluate contact in the Functions, without the equation of motion. Collective."""
        law.equations.read_data()
        x = law.create_vector()
        law.write(x)
        evaluation = law.equations.evaluate_contact(x, law.written_statuses)
        x.destroy()
        return evaluation

    def _residual_of_start(
        self, law: ContactProblem, evaluation: Evaluation, memory: Sequence[Memory]
    ) -> float:
        return 0.0  # a motion may start from any state

    def _first_energies(
        self, law: ContactProblem, evaluation: Evaluation
    ) -> tuple[MotionEnergies, Motion]:
        self._matrices.update(self._body)
        for f in (law.u, self._velocity):
            f.x.scatter_forward()  # users may have set owned values only
        u, v = law.u.x.array.copy(), self._velocity.x.array.copy()
        motion = motion_at(law.equations, evaluation, u, v)
        return MotionEnergies(kinetic=motion.kinetic, at_start=motion.kinetic), motion

    def continued(self, accepted: AcceptedState) -> AcceptedState:
        self.put(accepted)
        self.problem.equations.read_data()
        self._matrices.update(self._body)
        a = _motion(accepted)
        rows, load = self._body.forces(a.u, a.v), self._body.load()
        return replace(accepted, forces=replace(a, rows=rows, load=load))

    def _more(self) -> dict[str, Any]:
        return {"velocity": self._velocity.x.array}

    def _show_more(self, state: State) -> None:
        if state.velocity is not None:
            self._velocity.x.array[:] = state.velocity


def _motion(accepted: AcceptedState) -> Motion:
    """Return displacement, velocity and forces (`Motion`) of an accepted state."""
    assert isinstance(accepted.forces, Motion)
    return accepted.forces


def _evaluation_at(eq: ContactEquations, solution: Evaluation, u: Array) -> Evaluation:
    """Return the contact forces of a step with the kinematics at the end of the step. Collective.

    Args:
        eq: equations with the memory of the start of the step.
        solution: evaluation of the solution of the step.
        u: displacement at the end of the step, owned and ghost values.
    """
    surfaces = [
        replace(contact, kinematics=term.kinematics(u, solution.q))
        for term, contact in zip(eq.terms, solution.surfaces, strict=True)
    ]
    return replace(solution, u=u, surfaces=surfaces)


# -- Dirichlet data --------------------------------------------------------------------------------


class HeldNodes:
    """Comparison of the motion of nodes held by Dirichlet data with these data.

    Args:
        problem: contact problem of a time step.
    """

    def __init__(self, problem: ContactProblem):
        eq = problem.equations
        self._problem = problem
        self._comm = problem.comm
        self._held = np.asarray(eq.fixed[: eq.owned_sizes[0]])  # owned dofs with Dirichlet data
        self._zero = _ROUND_OFF * eq.body_size
        #: Velocity at the end of the last step, and its deviation from the mean velocity in it.
        self._velocity: Array | None = None
        self._oscillation: Array = np.zeros(0)
        #: Number of successive steps in which the deviation has changed its sign.
        self._reversals = 0

    def require_displacement(self) -> None:
        """Raise `ValueError` if the displacement differs from the Dirichlet data. Collective."""
        u, data = self._displacement_and_data()
        (size,) = largest(self._comm, [max(_size(u), _size(data))])
        place = self._deviation(u, data, self._held, _SAME * size + self._zero)
        require(
            self._comm,
            not place,
            f"at the start the displacement differs from the Dirichlet data: {place}; solve() "
            "first, or copy the prescribed values into the displacement",
        )

    def require_velocity(self, v: Array) -> None:
        """Raise ``ValueError`` if a node fixed by Dirichlet data has a velocity. Collective.

        A node is fixed if its Dirichlet data are constant in the first step. Before the call, the
        Functions must contain the state at the start of the first step, and the data must have
        their values at its end.

        Args:
            v: initial velocity, owned and ghost values.
        """
        u, data = self._displacement_and_data()
        fixed = self._held & (np.abs(data - u) <= self._zero)
        (size,) = largest(self._comm, [_size(v)])
        place = self._deviation(v[: len(u)], np.zeros_like(u), fixed, _SAME * size)
        require(
            self._comm,
            not place,
            "the velocity at the start contradicts Dirichlet data that are constant in the first "
            f"step: {place}; the velocity would change its sign in every step: set the velocity of "
            "held nodes to the velocity of the data",
        )

    def watch(self, a: Motion, b: Motion, step: TimeStep) -> None:
        """Log a warning on rank 0 if velocities at nodes with Dirichlet data oscillate. Collective.

        Velocities oscillate if their deviations from the mean velocities in the step keep their
        magnitude and alternate in sign over three successive steps.

        Args:
            a: motion at the start of the step.
            b: motion at the end of the step.
            step: time step.
        """
        if step.scheme == "theta-euler" or step.theta >= _DAMPED:
            return
        n = len(self._held)
        mean: Array = np.asarray((b.u - a.u)[:n] / step.length)
        deviation = np.where(self._held, b.v[:n] - mean, 0.0)
        if self._velocity is not a.v:  # the last step was rejected
            self._oscillation = deviation
            self._reversals = 0
        sizes = [_size(v) for v in (deviation, deviation + self._oscillation, mean, b.v)]
        size, change, *speeds = largest(self._comm, sizes)
        reverses = change < _REVERSED * size and size > _VISIBLE * max(speeds)
        self._reversals = self._reversals + 1 if reverses else 0
        self._velocity = b.v
        self._oscillation = deviation
        if self._reversals == _REVERSALS:
            place = self._deviation(b.v[:n], mean, self._held, 0.5 * size)
            if self._comm.rank == 0:
                logger.warning(
                    "velocities of nodes held by Dirichlet data change from step to step about the "
                    "velocity of the data (%s according to the data): the motion started with "
                    "another velocity than the data, or these have a kink in time; theta > 1/2 "
                    "damps the oscillation",
                    place,
                )

    def _displacement_and_data(self) -> tuple[Array, Array]:
        """Return the owned values of the displacement and of the Dirichlet data."""
        eq = self._problem.equations
        n = len(self._held)
        return self._problem.u.x.array[:n], eq.constraints.displacement()[:n]

    def _deviation(self, values: Array, data: Array, which: Mask, tolerance: float) -> str:
        """Describe the largest deviation of values from data; "" if it is small. Collective.

        If deviations are equal, the first one in the order of coordinates is described.

        Args:
            values: owned values.
            data: owned values prescribed by the data.
            which: mask of the compared dofs.
            tolerance: deviation that counts as small.
        """
        off = np.where(which, np.abs(values - data), 0.0)
        (worst,) = largest(self._comm, [_size(off)])
        if worst <= tolerance:
            return ""
        V = self._problem.V
        bs = V.dofmap.index_map_bs
        size = self._problem.equations.body_size
        nodes = np.round(node_positions(V) / size, 9) * size + 0.0
        local = [
            (nodes[i // bs].tolist(), int(i % bs), float(values[i]), float(data[i]))
            for i in np.flatnonzero(off == worst)
        ]
        x, component, value, wanted = min(p for part in self._comm.allgather(local) for p in part)
        return (
            f"component {'xyz'[component]} at the node ({', '.join(f'{c:.6g}' for c in x)}) is "
            f"{value:.6g} instead of the prescribed value {wanted:.6g}"
        )


def _size(values: Array) -> float:
    """Return the largest absolute value on this rank."""
    return float(np.max(np.abs(values), initial=0.0))
