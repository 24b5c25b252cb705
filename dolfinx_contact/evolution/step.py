# SPDX-License-Identifier: LGPL-3.0-or-later
"""One step of an evolution, from an accepted state to the next.

A state x_n at the time t_n has the memory m_n: the jumps of the contact points and the internal
variables of their laws (`points.memory`). A step to t_n+1 = t_n + h sets the load at t_n+1. With
the equations H, the update A of the memory and the energies E it

    1. solves        H(x_n+1; m_n, h) = 0            static, friction opposes the slip increment
                                                     since x_n (`ContactProblem.step_from`),
    2. advances      m_n+1 = A(x_n+1; m_n, h)        the memory (`ContactEquations.memory_after`),
    3. accounts for  E_n+1 = E_n + work and dissipation between x_n and x_n+1 (`energy`).

`Stepper.take` does this at rest. Motions (`motion`) and paths (`arc_length`) override its parts.
All steppers have the same methods:

    take      take the step to a time, or raise       start      state at the start of a run
    put       put a state into the problem            continued  end of a run, start of the next
    accept    accept the state in the Functions       recalled   earlier state, from a record

A step reads only the accepted state and the load, and writes only the Functions, which the next
step overwrites. Hence a rejected step has no side effects.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import all_ranks, anywhere, everywhere, require
from dolfinx_contact._validate import located
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Datum, placed_data
from dolfinx_contact.equations.evaluation import Evaluation, Statuses
from dolfinx_contact.equations.measures import least_scales, measure
from dolfinx_contact.equations.state import State
from dolfinx_contact.equations.validation import check_turn
from dolfinx_contact.evolution.constancy import Constancy
from dolfinx_contact.evolution.energy import Energies, Forces, Motion, forces_at
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.results.result import Result
from dolfinx_contact.solvers.strategies import Trial

__all__ = ["AcceptedState", "Stepper"]

logger = logging.getLogger(__name__)

_SOLVED = 1e-6  # largest relative residual of a start that counts as a solution


@dataclass(frozen=True, eq=False)
class AcceptedState:
    """Accepted end of a step, or start of a run, with all data required by the next step.

    Attributes:
        state: state; the next step starts from its memory.
        unknowns: owned unknowns as lengths, shape (n,).
        energies: energies since the start of the evolution.
        statuses: statuses with which the solve of the next step starts; None at a start.
        solved: whether the state is a solution under its load; a start need not be a solution.
        forces: forces at the state, for the energies of the next step; in dynamics the motion.
        result: tables, resultants and checks of the step that ended there; None at a start.
        directions: number of computed directions in which the evolution could continue at the start
            of that step (solutions of the rate problem); None if they were not computed.
    """

    state: State
    unknowns: Array
    energies: Energies
    statuses: Statuses | None
    solved: bool
    forces: Forces | Motion
    result: Result | None = None
    directions: int | None = None

    @property
    def time(self) -> float:
        """Time of the state."""
        assert self.state.time is not None
        return self.state.time

    @property
    def gamma(self) -> float:
        """Load parameter of a state on a path."""
        assert self.state.gamma is not None
        return self.state.gamma

    @property
    def memory(self) -> tuple[Memory, ...]:
        """Memory from which the next step starts, one per surface."""
        return self.state.memory


class Stepper:
    """Stepper of a quasi-static evolution, which takes the steps from state to state.

    Args:
        problem: contact problem; its Functions contain the last state.
        load: function of the time that sets Constants and Functions of the data.
        progress: whether solves show their progress, as in `ContactProblem.solve`.

    Attributes:
        problem: contact problem with the static law.
    """

    def __init__(
        self, problem: ContactProblem, load: Callable[[float], object], progress: bool | None
    ):
        self.problem = problem
        self._load = load
        self._progress = progress
        #: Time of the data; None before a load has been set.
        self._time: float | None = None

    # -- one step --------------------------------------------------------------------------------

    def take(
        self,
        accepted: AcceptedState,
        time: float,
        *,
        likely: Sequence[Statuses | None] = (),
        guess: AcceptedState | None = None,
        trial: Trial | None = None,
    ) -> AcceptedState:
        """Step from an accepted state to a time, and write the result to the Functions. Collective.

        Args:
            accepted: state at the start of the step.
            time: time at its end.
            likely: guesses of the statuses at the end, in the order in which they are tried;
                default: statuses of the start.
            guess: state that the solver uses as the initial guess; default: start of the step.
            trial: strategies of the solver; default: all. Motions ignore it and choose their own.

        Raises:
            ConvergenceError: if no strategy solves the step. After any error the start of the step
                is in the Functions.
        """
        try:
            expected = tuple(s for s in likely or (accepted.statuses,) if s is not None)
            return self._taken(accepted, time, replace(trial or Trial(), expected=expected), guess)
        except BaseException:
            self._restore(accepted)
            raise

    def _taken(
        self, accepted: AcceptedState, time: float, trial: Trial, guess: AcceptedState | None
    ) -> AcceptedState:
        """Take a step; see `take`. Collective."""
        assert isinstance(accepted.forces, Forces)
        step = self.begin(accepted, time)
        if guess is not None:
            self.problem.restore(guess.state)
        # 1. solve the static problem of the increment
        result, end = step.solve_step(trial, progress=self._progress)
        # 2. advance the memory
        memory = step.equations.memory_after(end)
        # 3. account for the energies
        forces = forces_at(step.equations, end)
        lost = result.energies["friction"]
        energies = accepted.energies.advanced(accepted.forces, forces, lost)
        return self.accept(step, end.statuses, memory, time, energies, forces, result=result)

    def begin(self, accepted: AcceptedState, time: float) -> ContactProblem:
        """Put a state into the Functions, set the data of a step; return its problem. Collective.

        Args:
            accepted: state at the start of the step.
            time: time at its end, whose load is set.
        """
        self._restore(accepted)
        self._set(time)
        for body, motion in zip(self.problem.rigid_bodies, accepted.state.motions, strict=True):
            for s in self.problem.surfaces:
                if s.rigid_body is body:
                    check_turn(s, motion)
        return self.problem.step_from(accepted.state, step=time - accepted.time)

    def put(self, accepted: AcceptedState) -> None:
        """Put a state into the Functions, and the load at its time into the data. Collective."""
        self._restore(accepted)
        if self._time != accepted.time:
            self._set(accepted.time)

    def _restore(self, accepted: AcceptedState) -> None:
        """Put a state into the Functions, without its load. Collective."""
        self.problem.show(accepted.state)
        self._show_more(accepted.state)

    def keeps(self, data: Sequence[Datum], start: float, end: float) -> bool:
        """Return whether data have equal values under the loads at two times. Collective.

        Args:
            data: data of the problem.
            start: first time.
            end: second time, whose load remains set.
        """
        self._set(start)
        before = [d.values.copy() for d in data]
        self._set(end)
        same = all(np.array_equal(d.values, v) for d, v in zip(data, before, strict=True))
        return all_ranks(self.problem.comm, same)

    def _set(self, time: float) -> None:
        """Set the data of the problem to their values under the load at a time. Collective."""
        self._time = None
        with everywhere(self.problem.comm, f"the load at the time {time:g}"):
            self._load(time)
        self._time = time

    # -- the start of a run ----------------------------------------------------------------------

    def require_repeatable(self, time: float, later: float) -> bool:
        """Raise an error if the load depends on earlier calls. Collective.

        Shortened steps call the load with times in any order. The load at ``time`` is set on
        return.

        Args:
            time: time at the start of a run.
            later: a later time.

        Returns:
            Whether the loads of the two times differ.

        Raises:
            ValueError: on every rank, if the load sets other data the second time.
        """
        self._set(time)
        comm = self.problem.comm
        data = placed_data(self.problem.equations)
        # the start or the solve reports values that are not finite
        bad = anywhere(comm, *(not np.isfinite(d.values).all() for d in data))
        before = Constancy(comm, [d for d, wrong in zip(data, bad, strict=True) if not wrong])
        self._set(later)
        varies = bool(before.changed())
        self._set(time)
        changed = before.changed()
        require(
            comm,
            not changed,
            f"the load at the time {time:g} depends on earlier calls: {changed} differs after the "
            f"load of {later:g}. Steps are tried with several lengths, so the load must set "
            "everything that it changes, as a function of the time only",
        )
        return varies

    def warn_of_constant_load(self, accepted: AcceptedState, times: Sequence[float]) -> None:
        """Log a warning if the load is constant during a run. Collective.

        Args:
            accepted: state at the start of the run, whose load is set.
            times: times of the run; the loads at the first and the last are equal.
        """
        varies = not accepted.solved or isinstance(accepted.forces, Motion)
        laws = [s.law_at_points.compiled for s in self.problem.surfaces]
        varies = varies or any(law.needs_time(0.0) for law in laws)
        comm = self.problem.comm
        first = Constancy(comm, placed_data(self.problem.equations))
        for time in () if varies else times[1:-1]:
            self._set(time)
            if first.changed():
                varies = True
                break
        self.put(accepted)
        if not varies and comm.rank == 0:
            logger.warning(
                "the load changes no data of the problem between the times %g and %g, so that "
                "every step repeats the start: load= must be a function that assigns values to "
                "Constants or Functions of the problem, such as top.value[:] = t",
                times[0],
                times[-1],
            )

    def start(self, time: float, given: State | None = None) -> AcceptedState:
        """Return the start of an evolution; the load at this time must be set. Collective.

        Args:
            time: time of the start.
            given: state at the start; default: present values of the Functions with virgin memory
                (zero slip, intact bonds).

        Raises:
            ValueError: on every rank, if the state or the Dirichlet data are not admissible.
        """
        law = self.problem
        with self.problem.restored():
            if given is not None:
                law.restore(given)
                self._show_more(given)
                law = law.with_memory(given.previous)
            law.equations.read_data()
            self._check_start()
            evaluation = self._evaluated(law)
            memory = law.equations.memory_after(evaluation) if given is None else given.memory
        residual = self._residual_of_start(law, evaluation, memory)
        solved = residual <= _SOLVED
        if not solved and law.comm.rank == 0:
            logger.warning(
                "the start of the evolution is not a solution under the load at the time %g "
                "(residual %.1e): the energies of this run are not meaningful; "
                "call solve() first",
                time,
                residual,
            )
        energies, forces = self._first_energies(law, evaluation)
        statuses = evaluation.statuses
        return self.accept(
            law, statuses, memory, time, energies, forces, known=False, solved=solved
        )

    def continued(self, accepted: AcceptedState) -> AcceptedState:
        """Return the end of a run as start of a later run with the present data. Collective."""
        self.put(accepted)
        law = self.problem.with_memory(accepted.memory)
        solved = _residual(law.equations, law.evaluate()) <= _SOLVED
        return accepted if solved == accepted.solved else replace(accepted, solved=solved)

    def recalled(
        self, time: float, memory: Sequence[Memory], energies: Energies, *, first: bool
    ) -> AcceptedState:
        """Return the state in the Functions, at a given time, as an accepted state. Collective.

        Args:
            time: time of the state.
            memory: memory from which the next step starts, one per surface.
            energies: energies since the start.
            first: whether the state is the start of an evolution, for which no statuses are stored.
        """
        self._set(time)
        law = self.problem.with_memory(memory)
        evaluation = self._evaluated(law)
        solved = not first or self._residual_of_start(law, evaluation, memory) <= _SOLVED
        _, forces = self._first_energies(law, evaluation)
        statuses = evaluation.statuses
        return self.accept(
            law, statuses, memory, time, energies, forces, known=not first, solved=solved
        )

    def _residual_of_start(
        self, law: ContactProblem, evaluation: Evaluation, memory: Sequence[Memory]
    ) -> float:
        """Return the relative residual of a start. Collective.

        A start counts as a solution if it satisfies the law with which it was computed, or the law
        of a step without increment (equilibrium with friction within its bound).

        Args:
            law: problem with the contact law (and memory) with which the state was computed.
            evaluation: evaluation of the state.
            memory: memory from which the first step starts.
        """
        residual = _residual(law.equations, evaluation)
        timed = any(s.law_at_points.compiled.needs_time(0.0) for s in law.surfaces)
        if residual > _SOLVED and not timed:
            still = law.with_memory(memory)
            residual = min(residual, _residual(still.equations, still.evaluate()))
        return residual

    # -- parts that motions and paths override ---------------------------------------------------

    def _check_start(self) -> None:
        """Raise ``ValueError`` if a start or its Dirichlet data are not admissible. Collective."""
        eq = self.problem.equations
        finite = bool(np.isfinite(self.problem.u.x.array).all())
        require(eq.comm, finite, "the displacement at the start is not finite")
        with located("at the start"):
            eq.constraints.check_values(eq.surfaces, eq.body_size)

    def _evaluated(self, law: ContactProblem) -> Evaluation:
        """Evaluate the equations at the start of an evolution. Collective."""
        return law.evaluate()

    def _first_energies(
        self, law: ContactProblem, evaluation: Evaluation
    ) -> tuple[Energies, Forces | Motion]:
        """Return the energies at the start of an evolution, and the forces there. Collective."""
        return Energies(), forces_at(law.equations, evaluation)

    def _more(self) -> dict[str, Any]:
        """Return more items of a state, such as its velocity, as keywords of `State`."""
        return {}

    def _show_more(self, state: State) -> None:
        """Put additional items of a state, such as a velocity, into the Functions. Collective."""

    # -- accepted states -------------------------------------------------------------------------

    def accept(
        self,
        law: ContactProblem,
        statuses: Statuses,
        memory: Sequence[Memory],
        time: float,
        energies: Energies,
        forces: Forces | Motion,
        *,
        known: bool = True,
        solved: bool = True,
        result: Result | None = None,
    ) -> AcceptedState:
        """Return the state in the Functions as an accepted state. Collective.

        Args:
            law: problem with the contact law (and memory) with which the state was computed.
            statuses: statuses of the contact points.
            memory: memory from which the next step starts, one per surface.
            time: time of the state.
            energies: energies since the start.
            forces: forces at the state.
            known: whether the solver uses these statuses as initial guess of the next step.
            solved: whether the state is a solution under its load.
            result: result of the step; None at a start.
        """
        problem = self.problem
        displacement, *multipliers = (f.x.array for f in problem.fields)
        state = State(
            displacement,
            tuple(multipliers),
            tuple(statuses),
            tuple(body.values for body in problem.rigid_bodies),
            tuple(memory),
            law.equations.memory,
            time=time,
            energies=asdict(energies),
            signature=problem.signature,
            **self._more(),
        )
        x = problem.create_vector()
        problem.write(x)
        unknowns = x.array_r.copy()
        x.destroy()
        likely = state.statuses if known else None
        return AcceptedState(state, unknowns, energies, likely, solved, forces, result)


def _residual(eq: ContactEquations, evaluation: Evaluation) -> float:
    """Return the relative residual of a state; 0 if all forces are below round-off. Collective.

    A state without displacements and forces defines no scale of forces. In this case forces count
    as zero if they move a node by less than 1e-12 of the body size.
    """
    measures, scales = measure(eq, evaluation, settled=True)
    least = least_scales(eq, 0.0)
    unloaded = scales.force <= least.force and scales.length <= least.length
    return 0.0 if unloaded else measures.worst
