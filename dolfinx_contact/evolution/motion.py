# SPDX-License-Identifier: LGPL-3.0-or-later
r"""One time step of a body in motion.

It has the three parts of `step`, with the problem of a body with mass. The contact laws of a step
are evaluated at the displacement w of `body.moving`. Friction acts on h a (B v_1 - v_obstacle), the
motion along the surface since w_0. The velocity of a node without mass may turn from step to step
about that of the body, and friction with it: there friction acts on the displacement in the step, B
(u_1 - u_0) - h v_obstacle, over the derivative of u_1 by w.

position
    Signorini's law is about the gap at w.
velocity
    A point whose gap forecast for the middle of the step, un_0 + h/2 un'_0, is open answers
    nothing. At the others the law is about un'_1 + e un'_0, e the coefficient of restitution
    (Moreau 1988; Jean, CMAME 177, 1999), put into a gap of w.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact._geometry import node_positions
from dolfinx_contact.body.moving import MovingBody, Scheme, TimeStep
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, Statuses
from dolfinx_contact.equations.state import State
from dolfinx_contact.equations.validation import require_obstacles
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.mass_and_damping import Matrices
from dolfinx_contact.evolution.motion_energy import Motion, MotionEnergies, account, motion_at
from dolfinx_contact.evolution.step import AcceptedState, SolvedStep, Stepper
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.results.balance import support_at_nodes
from dolfinx_contact.results.indicators import indicators_of
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.tables import contact_table
from dolfinx_contact.solvers.strategies import Trial

__all__ = ["Level", "Method", "MotionStepper", "MovingState"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
#: What Signorini's law is about.
Level: TypeAlias = Literal["position", "velocity"]

_ROUND_OFF = 1e-9  # of a step, by which it differs from an equal one
_FAR = 1e6  # of the size of the body, a gap that is never closed
_PENETRATION = 1e-9  # of the size of the body, a gap that counts as closed
_AGAINST = 1e-6  # of the largest displacement or velocity, off what is prescribed
_LASTING = 0.51  # theta, below which velocities that turn keep their size
_TURNS = 0.1  # of what is off, by which it is not the same with the other sign
_PERCENT = 0.01  # of the velocities, what is off and matters
_MOST_TURNS = 3  # changes of sign, after which the log warns


@dataclass(frozen=True)
class Method:
    """Method of the time steps of a body in motion.

    Attributes:
        scheme: scheme of the equation of motion.
        theta: weight of the end of a step.
        level: level of Signorini's law.
        restitution: coefficient of restitution e, at the velocity level.
        massless: whether nodes that may touch have no mass.
    """

    scheme: Scheme
    theta: float
    level: Level
    restitution: float
    massless: bool

    @property
    def alternates(self) -> bool:
        """Whether forces of contact turn about their mean from step to step."""
        plain = self.scheme == "theta" and self.theta == 0.5
        return plain and self.level == "position" and not self.massless

    @property
    def ends_within(self) -> bool:
        """Whether points may come to be within the obstacle, by the way of a step."""
        return self.level == "velocity" or self.scheme == "modified-theta"


@dataclass(frozen=True, eq=False)
class MovingState(AcceptedState):
    """An accepted state of a body in motion.

    Attributes:
        motion: displacement, velocity and the forces and energies there.
        turns: velocities of held nodes less their mean in the step that led here (owned), and in
            how many steps these have changed their sign; None at a start.
    """

    motion: Motion
    turns: tuple[Array, int] | None = None


class MotionStepper(Stepper):
    """Takes steps of a body in motion.

    Args:
        problem: contact problem of a time step, with a `MovingBody`.
        velocity: Function of the velocity, which follows the states that are taken or put.
        load: function of the time that sets Constants and Functions of the data.
        method: method of the steps.
        matrices: mass and damping of the body.
        progress: progress of the solves.
    """

    def __init__(
        self,
        problem: ContactProblem,
        velocity: fem.Function,
        load: Callable[[float], object],
        method: Method,
        matrices: Matrices,
        progress: bool | None,
    ):
        super().__init__(problem, load, progress)
        body = problem.equations.bulk
        assert isinstance(body, MovingBody)
        self._body = body
        self._velocity = velocity
        self._method = method
        self._matrices = matrices
        self._warned = False

    # -- one step --------------------------------------------------------------------------------

    def _taken(
        self,
        accepted: AcceptedState,
        time: float,
        likely: Sequence[Statuses | None],
        guess: AcceptedState | None,
        trial: Trial,
    ) -> SolvedStep:
        """The step from a state. Guess and statuses are those of free flight. Collective."""
        assert isinstance(accepted, MovingState)
        assert isinstance(accepted.energies, MotionEnergies)
        self._restore(accepted)
        self._set(time)
        self._matrices.require_constant(time)
        problem = self.problem
        eq = problem.equations
        body = self._body
        a = accepted.motion
        length = time - accepted.time
        if abs(length - body.step.length) <= _ROUND_OFF * length:
            length = body.step.length  # the same steps have the same matrices
        step = TimeStep(length, self._method.theta, self._method.scheme)
        eq.refresh()
        if accepted.statuses is None:
            self._require_speed(a)
        body.begin(step, a.u, a.v, a.rows)
        eq.prescribed.unknowns = lambda values: step.seen(values, body.origin)
        try:
            # 1. solve the problem of the step for the displacement w that contact sees
            motion = np.where(eq.rigid.fixed, eq.prescribed_motions() - eq.rigid.given, 0.0)
            contact = problem.with_memory(self._seen(accepted, step, motion))
            problem.u.x.array[:] = self._guess(a, step)
            result, end = contact.solve_step(progress=self._progress)
            u, v = (f(end.u, body.origin) for f in (step.displacement, step.velocity))
            problem.u.x.array[:] = u
            self._velocity.x.array[:] = v
            # 2. advance the memory, with the contact of the end at its own displacement
            law = problem.step_from(accepted.state, step=step.length)
            shown = self._at(law.equations, end, u)
            memory = law.equations.advanced(shown)
            # 3. account for the energies
            b = motion_at(law.equations, shown, u, v)
            energies = account(accepted.energies, law.equations, end, a, b, motion)
            lost = energies.dissipated - accepted.energies.dissipated
            result = self._shown(law.equations, result, shown, lost)
        finally:
            eq.prescribed.unknowns = None
        turns = self._turns(accepted, b, step)
        after = self._moving(law, end.statuses, memory, time, energies, b, turns=turns)
        return SolvedStep(accepted, after, result)

    def _restore(self, accepted: AcceptedState) -> None:
        super()._restore(accepted)
        assert isinstance(accepted, MovingState)
        self._velocity.x.array[:] = accepted.motion.v

    # -- the start of a run ----------------------------------------------------------------------

    def start(self, time: float, given: State | None = None) -> AcceptedState:
        """The start of a motion under the load of its time, which has been set. Collective.

        Raises:
            ValueError: on every rank, if a point is within an obstacle, the state is not finite or
                differs from Dirichlet data, or these are such that a solve refuses them.
        """
        self._matrices.update(self._body)
        with self.problem.restored():
            law, evaluation, memory = self._begun(given)
            # Under laws of velocities points come to rest within the obstacle.
            ended = given is not None and all(m is not None for m in given.previous)
            if not (ended and self._method.ends_within):
                self._require_no_penetration(evaluation)
        motion = self._motion(law, evaluation)
        energies = MotionEnergies(kinetic=motion.kinetic, at_start=motion.kinetic)
        return self._moving(law, evaluation.statuses, memory, time, energies, motion, known=False)

    def _take_start(self, given: State) -> None:
        super()._take_start(given)
        if given.velocity is not None:
            self._velocity.x.array[:] = given.velocity

    def _evaluated(self, law: ContactProblem) -> Evaluation:
        """The contact of a start, without the rows of H. Collective."""
        x = law.create_vector()
        law.write(x)
        found = law.equations.contact(x, law.written_statuses)
        x.destroy()
        return found

    def continued(self, accepted: AcceptedState) -> AcceptedState:
        assert isinstance(accepted, MovingState)
        self.put(accepted)
        self._matrices.update(self._body)
        motion = accepted.motion
        rows = self._body.forces(motion.u, motion.v)
        return replace(accepted, motion=replace(motion, rows=rows, load=self._body.load()))

    def recalled(
        self, time: float, memory: Sequence[Memory], energies: Energies, *, first: bool
    ) -> AcceptedState:
        self._set(time)
        self._matrices.update(self._body)
        law = self.problem.with_memory(memory)
        found = self._evaluated(law)
        motion = self._motion(law, found)
        memory = tuple(memory)
        return self._moving(law, found.statuses, memory, time, energies, motion, known=not first)

    def _guess(self, a: Motion, step: TimeStep) -> Array:
        """Where contact is looked for first: free flight, which gives good statuses. Collective.

        Nodes without mass have any velocity, which may turn cells inside out: the body stays then.
        """
        origin = self._body.origin
        flight = origin + step.gain * step.length * a.v
        rows = self._body.forces(step.displacement(flight, origin), a.v)
        comm = self.problem.equations.comm
        if comm.allreduce(int(np.isfinite(rows).all()), op=MPI.MIN):
            return np.asarray(flight)
        return step.seen(a.u, origin)

    # -- what contact sees -----------------------------------------------------------------------

    def _seen(self, accepted: MovingState, step: TimeStep, motion: Array) -> list[Memory]:
        """The memory with which the laws are evaluated in a step. Collective.

        Args:
            accepted: state at the start.
            step: time step.
            motion: change of the unknowns of the rigid bodies in the step.
        """
        a = accepted.motion
        # Faces that slide over each other have their slips from where they were.
        pairs = zip(self.problem.surfaces, accepted.memory, strict=True)
        eq = self.problem.with_memory([m if s.slides else None for s, m in pairs]).equations
        origin = self._body.origin
        gain = step.gain
        if self._method.massless:
            origin = step.seen(a.u, origin)
            gain = 1.0 / step.share
        q = eq.rigid.given + (1.0 - gain) * motion
        found = []
        for i, (s, memory) in enumerate(zip(eq.surfaces, accepted.memory, strict=True)):
            at = eq.kinematics(s, origin, q)
            gap = None
            if self._method.level == "velocity":
                moved = at.operator.rate(eq.relative(s, step.length * a.v, motion))
                n = s.points.data.n
                risen = s.points.data.gap - a.gaps[i]
                opening = risen - np.sum(moved * n, axis=1)  # h un'_0
                back = self._method.restitution * step.gain * opening
                closes = np.sum(at.jump * n, axis=1) + step.gain * risen + back
                active = a.un[i] + 0.5 * opening <= 0
                gap = np.where(active, closes, closes + _FAR * eq.body_size)
            # For a velocity friction gets the motion along the surface, which is h a v_1.
            passed = step.length * (gain if s.law.creeps else 1.0)
            was = origin[: eq.owned_sizes[0]].reshape(-1, eq.dim) if s.slides else None
            found.append(Memory(at.whole, memory.fields, passed, gap, was, at.place, at.motion))
        return found

    def _at(self, eq: ContactEquations, state: Evaluation, u: Array) -> Evaluation:
        """The contact of a step's end at its displacement, as tables show it. Collective."""
        surfaces = []
        for s, found in zip(eq.surfaces, state.surfaces, strict=True):
            surfaces.append(replace(found, kinematics=eq.kinematics(s, u, state.q)))
        return replace(state, u=u, surfaces=surfaces)

    def _shown(
        self, eq: ContactEquations, result: Result, shown: Evaluation, lost: float
    ) -> Result:
        """A result with tables and checks of the step's end, and the frictional dissipation."""
        supports = support_at_nodes(eq, shown)
        tables = {s.name: contact_table(eq, i, shown, supports) for i, s in enumerate(eq.surfaces)}
        energies = result.energies | {"friction": lost}
        return replace(
            result, tables=tables, energies=energies, indicators=indicators_of(eq, shown)
        )

    # -- accepted states -------------------------------------------------------------------------

    def _motion(self, law: ContactProblem, evaluation: Evaluation) -> Motion:
        """The motion in the Functions. Collective."""
        for f in (law.u, self._velocity):
            f.x.scatter_forward()  # values given by the user may be those of the owners alone
        u, v = (f.x.array.copy() for f in (law.u, self._velocity))
        return motion_at(law.equations, evaluation, u, v)

    def _moving(
        self,
        law: ContactProblem,
        statuses: Statuses,
        memory: Sequence[Memory],
        time: float,
        energies: Energies,
        motion: Motion,
        *,
        known: bool = True,
        turns: tuple[Array, int] | None = None,
    ) -> MovingState:
        """The motion in the Functions as an accepted state. Collective."""
        state = replace(self._state(law, statuses, memory, time, energies), velocity=motion.v)
        held = state.statuses if known else None
        return MovingState(state, self._unknowns(), energies, held, True, motion, turns)

    # -- what is held ----------------------------------------------------------------------------

    def _held(self) -> npt.NDArray[np.bool_]:
        """Which of the owned dofs Dirichlet data hold."""
        eq = self.problem.equations
        return np.asarray(eq.fixed[: eq.owned_sizes[0]])

    def _require_held(self) -> None:
        """Refuse a start at which the displacement is not what is prescribed. Collective."""
        eq = self.problem.equations
        held = self._held()
        n = len(held)
        given = eq.prescribed.values().reshape(-1)[:n]
        u = self.problem.u.x.array[:n]
        size = eq.comm.allreduce(
            max(float(np.max(np.abs(v), initial=0.0)) for v in (given, u)), op=max
        )
        off = np.where(held, np.abs(u - given), 0.0)
        words = self._worst(off, _AGAINST * size + _PENETRATION * eq.body_size, u, given)
        message = (
            f"at the start the displacement is not what Dirichlet data prescribe: {words}; solve() "
            "first, or put into the displacement what is prescribed"
        )
        require(eq.comm, not words, message)

    def _require_speed(self, a: Motion) -> None:
        """Refuse a start with a velocity where Dirichlet data do not move. Collective."""
        eq = self.problem.equations
        held = self._held()
        n = len(held)
        given = eq.prescribed.values().reshape(-1)[:n]
        size = eq.comm.allreduce(float(np.max(np.abs(a.v), initial=0.0)), op=max)
        still = held & (np.abs(given - a.u[:n]) <= _PENETRATION * eq.body_size)
        speed = np.where(still, np.abs(a.v[:n]), 0.0)
        words = self._worst(speed, _AGAINST * size, a.v[:n], np.zeros(n))
        message = (
            "the velocity at the start is against Dirichlet data, which do not move in the first "
            f"step: {words}; it would change its sign in every step: set the velocity to that of "
            "the data where they hold the body"
        )
        require(eq.comm, not words, message)

    def _worst(self, off: Array, tolerance: float, is_: Array, prescribed: Array) -> str:
        """Where owned values are furthest off, in words; "" where none is. Collective."""
        V = self.problem.V
        comm = self.problem.equations.comm
        worst = comm.allreduce(float(np.max(off, initial=0.0)), op=max)
        if worst <= tolerance:
            return ""
        # Of several that are as far off the first in the order of their places.
        bs = V.dofmap.index_map_bs
        nodes = node_positions(V)
        mine = []
        size = self.problem.equations.body_size
        for i in np.flatnonzero(off >= (1 - _ROUND_OFF) * worst):
            x = np.round(nodes[i // bs, : V.mesh.geometry.dim] / size, 9) * size + 0.0
            mine.append((x.tolist(), int(i % bs), float(is_[i]), float(prescribed[i])))
        x, component, found, wanted = min(place for part in comm.allgather(mine) for place in part)
        return (
            f"component {'xyz'[component]} at the node ({', '.join(f'{c:.6g}' for c in x)}) is "
            f"{found:.6g}, prescribed is {wanted:.6g}"
        )

    def _turns(self, accepted: MovingState, b: Motion, step: TimeStep) -> tuple[Array, int]:
        """Deviations of the velocities of held nodes from their mean, and their changes of sign.

        With theta = 1/2 the end of a step has twice the mean velocity less that of the start, so
        that a velocity which was not that of the data once turns about it for ever. Collective.
        """
        held = self._held()
        a = accepted.motion
        n = len(held)
        mean: Array = np.asarray((b.u - a.u)[:n] / step.length)
        off = np.where(held, b.v[:n] - mean, 0.0)
        lasts = step.scheme != "theta-euler" and step.theta < _LASTING
        if not lasts or accepted.turns is None or len(accepted.turns[0]) != n:
            return off, 0
        before, times = accepted.turns
        comm = self.problem.equations.comm
        sizes = [float(np.max(np.abs(v), initial=0.0)) for v in (off, off + before, mean, b.v)]
        turned = comm.allreduce(np.array(sizes), op=np.maximum)
        again = turned[1] < _TURNS * turned[0] and turned[0] > _PERCENT * max(turned[2:])
        times = times + 1 if again else 0
        if times == _MOST_TURNS and not self._warned:
            self._warned = True
            words = self._worst(np.abs(off), 0.5 * turned[0], b.v[:n], mean)
            if comm.rank == 0:
                logger.warning(
                    "velocities of nodes that Dirichlet data hold change from step to step about "
                    "those of the data (%s by the data's increment): the motion began with another "
                    "velocity than the data, or these have a kink in time; theta > 1/2 damps it",
                    words,
                )
        return off, times

    def _check_start(self) -> None:
        super()._check_start()
        eq = self.problem.equations
        finite = bool(np.isfinite(self._velocity.x.array).all())
        require(eq.comm, finite, "the velocity at the start is not finite")
        require_obstacles(eq)
        self._require_held()

    def _require_no_penetration(self, state: Evaluation) -> None:
        """Refuse a start within an obstacle. Collective."""
        eq = self.problem.equations
        for s, found in zip(eq.surfaces, state.surfaces, strict=True):
            if s.law.compliant:
                continue
            gap = found.kinematics.gap
            least = eq.comm.allreduce(float(np.min(gap, initial=np.inf)), op=min)
            require(
                eq.comm,
                least >= -_PENETRATION * eq.body_size,
                f"{s.name}: at the start points are within the obstacle, by up to {-least:.3g}",
            )
