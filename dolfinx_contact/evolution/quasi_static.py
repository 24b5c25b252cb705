# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Quasi-static evolution with friction: equilibrium at every time, friction against slip rates.

Implicit steps: the state at t_n+1 is a solution of the contact problem whose law sees the slip
since t_n (`points.memory`). At a step's start every point that slips is at the border of stick, so
that a solve begins with the statuses of the step before; where these do not hold the rate problem
may have several solutions, or other ones (`forks`). If no step is found so the ladder of the static
problem follows (`solvers.ladder`), whose last strategies follow the load from t_n to t_n+1 with the
memory of t_n. Rate-independent friction does not know the time: it orders the loads; regularised
friction resists the velocity, the slip over t_n+1 - t_n.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact.continuation.observer import Observer, ObserverLike, Stop
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.evolution.evolution import Evolution
from dolfinx_contact.evolution.history import EvolutionStep, History, NoContinuation
from dolfinx_contact.evolution.listeners import NOT_BY_VALUE, Listeners, compared_arguments
from dolfinx_contact.evolution.nscd import NSCD
from dolfinx_contact.evolution.through_times import (
    Accept,
    AtJump,
    HistoryTask,
    checked_times,
)

__all__ = ["QuasiStatic"]

_HALVINGS = 20  # of the whole time, to the least step


def _check_jump(a: Arguments) -> None:
    before = a.self._run_state
    if before is None or not a.time >= before.accepted.time:
        raise ValueError("a jump begins where a run has ended, at its time or later")
    if a.motion.problem.u is not a.self.problem.u:
        raise ValueError("the motion is that of another body")


def _check_run(a: Arguments) -> None:
    a.times = checked_times(a.times, None if a.start is not None else a.self._accepted)
    if a.shortest is None:
        a.shortest = (a.times[-1] - a.times[0]) / 2**_HALVINGS
    a.follow_rays = bool(a.follow_rays)
    a.extrapolate = bool(a.extrapolate)
    task = HistoryTask(
        a.times,
        a.longest,
        a.shortest,
        a.at_jump,
        a.sudden,
        rays=a.rays,
        follow_rays=a.follow_rays,
        extrapolate=a.extrapolate,
    )
    for name in ("longest", "shortest", "sudden"):  # as numbers
        setattr(a, name, getattr(task, name))
    Listeners.of(a).check(a.self._record)


class QuasiStatic(Evolution):
    """The quasi-static evolution of a contact problem under a load that depends on time.

    Its first run starts from the state in the problem's Functions, a solution under the load at the
    first time, or from ``start=``. A later run starts where the last one has ended. Another
    evolution of the same problem needs ``start=``.
    Each step is the problem ``problem.step_from(state)``; the state of each step is kept, as
    ``history.steps[-1].state``. Functions and data of the problem follow the accepted steps, and
    ``problem.solve()`` has the static law as ever. If an obstacle is moved through its Constants,
    its tangential velocity does not enter the friction law; another body or a `RigidBody` drags
    what touches it.

    Args:
        problem: the contact problem.
        load: function of the time, called on every rank before each step, that sets Constants and
            Functions of the data to their values at that time. It is called for the same time more
            than once, and is refused if it depends on earlier calls. After a run the data are
            those of the last accepted time.

    Raises:
        ValueError: on every rank, if arguments do not fit.

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
        compare=compared_arguments,
        local=NOT_BY_VALUE,
    )
    def run(
        self,
        times: Sequence[float],
        *,
        start: State | None = None,
        longest: float = math.inf,
        shortest: float | None = None,
        at_jump: AtJump = "raise",
        sudden: float = 2.0,
        rays: bool | None = None,
        follow_rays: bool = False,
        extrapolate: bool = False,
        accept: Accept | None = None,
        stop: Stop[EvolutionStep] | None = None,
        observer: ObserverLike[EvolutionStep] | None = None,
        record: Observer | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go through times. Collective.

        Args:
            times: increasing times. The first is that of the start, every other is the end of a
                step.
            start: state at the first time, such as ``history.steps[-1].state`` or
                ``problem.snapshot()``; by default the end of the last run, in a first run the
                Functions as they are with virgin memory (slips are counted from there, bonds are
                those of the law). Required in the first run of an evolution if the problem has had
                another one.
            longest: no step is longer.
            shortest: no step is shorter, unless two times are; by default the whole time halved
                twenty times.
            at_jump: where no solution continues the evolution, or none is found that does, "raise"
                `NoContinuation`, "stop" with the reason in the history, or "jump" to the solution
                that was found under the load a moment later, which is labelled so. If none was
                found a "jump" raises. It is proved that none continues through a step of the
                shortest length where the load turns back in it along the solutions that lead on
                from its start, and nothing else leads on; the reason states whether it is, and else
                what was tried. A step that was not solved proves nothing: shorter ones are tried
                from the same state. Data that leap in time are no jump: that is one of the state
                under data that change little.
            sudden: a factor, 1 or more: a step is searched for a jump if the state changes in it
                faster than this times its rate in the step before; ``inf`` for never. Rates are
                those of all unknowns, and of the points of each surface (their mean, the farthest
                one), which count if they are more than half as fast as the body was. A step in
                which a bond loses more than a quarter of what the strongest had, and the first
                one, are searched in any case, unless it begins with a state that is no solution.
                A search takes some more steps; if there is no jump they are kept only where shorter
                steps lead to another solution. Not found are jumps that are a tenth or less of the
                change in such a step, and those by which it is no faster than the limit.
            rays: whether all solutions of the rate problem are looked for, and counted in
                `EvolutionStep.directions`: True where every step begins, in 2D with contact at
                nodes; False no more than it takes to continue; None, the default, up to sixteen
                points and where the statuses of the step before do not hold.
            follow_rays: whether the others are followed too, each to the last time
                (`History.others`), up to sixteen. ``observer``, ``stop`` and ``accept`` are not
                called with their steps.
            extrapolate: whether the solver begins, where bodies slide over each other, at what the
                step before leads to; where that fails at the state before, as otherwise. It saves
                iterations in steps up to about a facet. A run that continues from a record does so
                from its second step on.
            accept: called with every step, on every rank; a step that it rejects is tried again
                with half the length. It is an error to reject a step of the shortest length.
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
            The accepted steps of this run, and in words why it ended.

        Raises:
            NoContinuation: see ``at_jump``; the problem is at the last accepted state.
            ValueError: on every rank, for arguments that do not fit, or data that cannot be
                solved with; what ``load``, ``accept``, ``stop`` or ``observer`` raises on any rank.
            OSError: on every rank, if a step cannot be recorded.
        """
        assert shortest is not None
        task = HistoryTask(
            tuple(times),
            longest,
            shortest,
            at_jump,
            sudden,
            rays=rays,
            follow_rays=follow_rays,
            extrapolate=extrapolate,
        )
        return self._begin(task, Listeners(accept, stop, observer, record, progress), start)

    @collective("a jump", _check_jump)
    def jump(self, motion: NSCD, time: float, max_time: float, *, rest: float = 1e-6) -> History:
        """Continue by dynamics where an evolution has come to its end. Collective.

        From the last accepted state the body moves under the load of a time until it is at rest
        again. `run` then continues from there. What motion has dissipated otherwise than by
        friction and damage is in the residue of the energies.

        Args:
            motion: motion of the same body, with damping.
            time: no earlier than the last accepted state.
            max_time: see `NSCD.settle`, as for ``rest``.
            rest: share of the kinetic energy.

        Returns:
            The steps of the motion, over times of its own.

        Raises:
            NoContinuation: if the body is not at rest by then, or a step of the motion fails; the
                problem is at the last accepted state.
            ValueError: on every rank, if there is none, the motion is of something else, and as
                `NSCD.run`.
        """
        before = self._run_state
        assert before is not None
        stepper = self._stepper(None)
        try:
            stepper.begin(before.accepted, time)
            start = before.accepted.state
            history = motion.settle(max_time, start=start, rest=rest, progress=False)
            if not history.complete:
                raise NoContinuation(f"the body moves on: {history.reason}", history)
            a = before.accepted.energies
            b = history.energies
            energies = Energies(
                a.external + b.external,
                a.stored + b.stored,
                a.dissipated + b.dissipated,
                a.damage + b.damage,
            )
            end = history.steps[-1].state
            assert end is not None
            accepted = stepper.recalled(time, end.memory, energies, first=False)
            self.put(replace(before, accepted=accepted, rate=None))
        except BaseException:
            self.put(before)
            raise
        return history
