# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quasi-static evolution: equilibrium at every time, friction opposing the slip rates.

The unknowns x_n+1 at the time t_n+1 solve the contact problem H = 0 in which friction opposes the
slip since t_n (`step`),

    H(x_n+1; m_n, t_n+1 - t_n) = 0,        m_n the memory of x_n.

At the start of a step every slipping point is at the border of stick. Therefore a solve starts with
the statuses of the previous step. If this fails, the strategies of the static problem are tried
(`solvers.strategies`). The last of these strategies trace the solution from the load at t_n to that
at t_n+1, with the memory m_n.

In rate-independent friction, time only orders the loads. Regularised friction depends on the
velocity, the slip divided by t_n+1 - t_n.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from dolfinx import fem

from dolfinx_contact._mpi import Arguments, collective, everywhere
from dolfinx_contact._validate import instance
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.evolution.run import Listeners, Runnable, RunState
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.evolution.through_times import (
    AtJump,
    HistoryTask,
    ThroughTimes,
    ToRest,
    checked_times,
)
from dolfinx_contact.problem import ContactProblem

__all__ = ["Evolution", "QuasiStatic", "check_run"]

_HALVINGS = 20  # halvings from the whole time to the default shortest step


class Evolution(Runnable[HistoryTask, History]):
    """Contact problem in time: base class of quasi-static histories and motions.

    Args:
        problem: contact problem.
        load: function of the time, called on every rank before each step, that sets Constants and
            Functions of the data to their values at that time.

    Attributes:
        problem: contact problem.
        load: function of the time; it may be replaced between two runs.
        kept: additional Functions whose values are stored in each state, by name.

    Raises:
        ValueError: on every rank, if an argument is not admissible.
    """

    _may_be_set = ("load",)
    _advice = (
        "the load sets values of Constants and Functions in time; for other changes make another "
        "evolution"
    )
    _record = "a records.EvolutionRecord"
    kept: Mapping[str, fem.Function] = {}

    def __init__(self, problem: ContactProblem, load: Callable[[float], object]):
        instance(problem, "problem", ContactProblem)
        with everywhere(problem.comm, "an evolution"):
            if not callable(load):
                raise ValueError(f"the load must be a function of the time, got {load!r}")
            for s in problem.surfaces:
                lack = s.law.lacks(history=True)
                if lack:
                    raise ValueError(f"{s.name}: the law {s.law.name} lacks {lack}")
        self.problem = problem
        self.load = load

    def stepper(self, progress: bool | None) -> Stepper:
        return Stepper(self.problem, self.load, False if progress is False else None)

    def history(self, run_state: RunState) -> History:
        return History(run_state.accepted.time, run_state.accepted.energies)

    def begun(self, task: HistoryTask, run_state: RunState) -> RunState:
        return replace(run_state, length=task.longest, settled=True, ending=None, reason="")

    def _rule(self, stepper: Stepper, task: HistoryTask, run_state: RunState) -> ThroughTimes:
        return (ToRest if task.rest else ThroughTimes)(stepper, task, run_state)

    def _accepted_start(
        self, stepper: Stepper, task: HistoryTask, start: State | None
    ) -> AcceptedState:
        varies = stepper.require_repeatable(task.times[0], task.times[-1])
        if start is None and self._accepted is not None:
            accepted = stepper.continued(self._accepted)
        else:
            accepted = stepper.start(task.times[0], start)
        if not varies:
            stepper.warn_of_constant_load(accepted, task.times)
        return accepted


def check_run(a: Arguments) -> None:
    """Check the times and `Listeners` of a run; convert the times to numbers."""
    a.times = checked_times(a.times, None if a.start is not None else a.self._accepted)
    Listeners.of(a).check(a.self._record)


def _check_run(a: Arguments) -> None:
    if a.shortest is not None and a.halve_steps is False and not a.locate_jumps:
        raise ValueError("shortest has no effect without halve_steps or locate_jumps")
    if a.extrapolate and not any(s.slides for s in a.self.problem.surfaces):
        raise ValueError("extrapolate=True has no effect without bodies that slide over each other")
    check_run(a)


class QuasiStatic(Evolution):
    """Quasi-static evolution of a contact problem under a time-dependent load.

    The first run starts from the state in the Functions, which should be a solution under the load
    at the first time, or from ``start=``. A later run starts where the previous one ended. Another
    evolution of the same problem requires ``start=``.

    Each step is the problem ``problem.step_from(state)``; ``history.steps[k].state`` is the state
    at its end. Functions and data of the problem follow the accepted steps; ``problem.solve()``
    still uses the static law. If an obstacle is moved through its Constants, its tangential
    velocity does not enter the friction law; a moving second body or `RigidBody` drags the surfaces
    in contact with it.

    Args:
        problem: contact problem with the static law.
        load: function of the time, called on every rank before each step, that sets Constants and
            Functions of the data to their values at that time. It may be called several times for
            the same time and must not depend on earlier calls. After a run the data have their
            values at the last accepted time. A load that changes no data during a run causes a
            warning, unless a law depends on time or the start is not a solution.

    Raises:
        ValueError: on every rank, if arguments are not valid.

    Example:
        ::

            def load(t):
                top.value[:] = 0.01 * t, -0.01

            evolution = QuasiStatic(problem, load)
            history = evolution.run(np.linspace(0.0, 1.0, 11))
            print(history.steps[-1].status, history.energies.dissipated)
    """

    @collective(
        "the times of an evolution",
        _check_run,
        local=("start",),
    )
    def run(
        self,
        times: Sequence[float],
        *,
        start: State | None = None,
        longest: float = math.inf,
        shortest: float | None = None,
        halve_steps: bool | None = None,
        locate_jumps: bool = False,
        at_jump: AtJump = "raise",
        rays: bool | None = None,
        extrapolate: bool = False,
        stop: Stop[EvolutionStep] | None = None,
        observer: ObserverLike[EvolutionStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> History:
        """Step through the given times. Collective.

        By default the steps end exactly at the given times. ``longest`` divides long intervals into
        equal steps. ``halve_steps`` and ``locate_jumps`` insert steps, which are marked
        (`EvolutionStep.inserted`). Shorter steps change the results of laws depending on time.
        Indicators of a jump within a step are stored in ``result.indicators.step``, together with
        one warning.

        In a jump the state changes suddenly although the load changes little. If a run cannot
        continue, ``history.reason`` or the error states whether this is proved. The proof shows
        that the load would have to decrease along every solution leading out of the state. The
        proof applies to a step of the shortest length. A step that was not solved proves nothing.
        Discontinuities of the data do not count as jumps.

        Args:
            times: increasing times: the time of the start, then the ends of the steps.
            start: state at the first time, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``. Default: end of the last run; in a first run the present
                Functions with virgin memory (slip is counted from there, bonds are intact).
                Required in the first run if the problem has had another evolution.
            longest: upper bound of the length of a step. Default: one step from each of ``times``
                to the next.
            shortest: lower bound of the length of a halved step. Default: duration of the run
                divided by 2^20.
            halve_steps: whether a step that was not solved is repeated with half or a quarter of
                its length, down to ``shortest``. Do not use it for velocity-weakening laws, which
                become steeper in shorter steps. Default: True if ``shortest`` or ``locate_jumps``
                is given.
            locate_jumps: whether steps with sudden changes of the state are searched for a jump,
                using additional solves. A jump is located to ``shortest``. Without a jump, the
                additional steps are kept only if they lead to another solution. Jumps of less than
                a tenth of the change in the step are missed. A step is searched if the state
                changes more than twice as fast as in the previous step. The rate of all unknowns is
                compared, and also the rates of the points of each surface (mean and maximum) if
                they exceed half the rate of the body. The first step and steps in which a bond
                loses more than a quarter of the largest strength are always searched, unless they
                start in a state that is not a solution. Do not use it for velocity-weakening laws,
                which have several solutions in short steps. Default: False.
            at_jump: action if no solution continues the evolution. ``"raise"`` (default) raises
                `NoContinuation`. ``"stop"`` ends the run before the jump. ``"jump"``, with
                ``locate_jumps``, continues from the solution beyond the jump, or from a solution at
                a slightly later time, marked by `EvolutionStep.jump`; it raises `NoContinuation` if
                no such solution is found.
            rays: whether all solutions of the rate problem, the directions in which the evolution
                can continue, are computed and counted in `EvolutionStep.directions`. True: at the
                start of every step, in 2D with nodal contact. False: never. None (default): only
                with ``locate_jumps``, for up to sixteen points, in steps in which statuses change.
            extrapolate: whether the solver starts from the extrapolation of the previous step, and
                from the previous state if that fails; only for bodies sliding over each other.
                Extrapolation saves iterations in steps up to about one facet. A resumed run
                extrapolates from its second step. Default: False.
            stop: function called with every accepted step on every rank, while its end is in the
                problem; it returns the reason to end the run there, or "" to continue. A later run
                continues from there.
            observer: function called with every accepted step while its end is in the problem, or a
                `continuation.Observer`. It must be read-only: the run restores the accepted state
                before the next step.
            record: record of every accepted step, such as `records.EvolutionRecord`; it is written
                before the observer is called.
            progress: whether rank 0 shows the progress on the standard error stream; default: only
                if the run takes longer than a few seconds.

        Returns:
            History with the accepted steps of this run and the reason why it ended.

        Raises:
            NoContinuation: see ``at_jump``; the problem is at the last accepted state.
            ValueError: on every rank, if arguments or data are not admissible. Errors of ``load``,
                ``stop`` and ``observer`` on one rank are raised on every rank.
            OSError: on every rank, if a step cannot be recorded.
        """
        if halve_steps is None:
            halve_steps = locate_jumps or shortest is not None
        if shortest is None:
            shortest = (times[-1] - times[0]) / 2**_HALVINGS
        if rays is None and not locate_jumps:
            rays = False
        task = HistoryTask(
            tuple(times),
            longest,
            shortest,
            at_jump,
            locate_jumps=bool(locate_jumps),
            halve=bool(halve_steps),
            rays=rays,
            extrapolate=bool(extrapolate),
        )
        return self._begin(task, Listeners(stop, observer, record, progress), start)
