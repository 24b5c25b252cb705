# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps at whose start the rate problem has several solutions.

A step is tried with the statuses of the step before first. Where these do not hold, and elsewhere
on request, all directions are enumerated in which the state can continue (`step_branch`). If a step
is not solved, the statuses of these directions are tried.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from dolfinx_contact.continuation.branch import FoundRays
from dolfinx_contact.equations.evaluation import Statuses, differs
from dolfinx_contact.evolution.changes import change
from dolfinx_contact.evolution.step import AcceptedState, SolvedStep, Stepper
from dolfinx_contact.evolution.step_branch import rays_of_step
from dolfinx_contact.solvers import ConvergenceError
from dolfinx_contact.solvers.strategies import Trial

__all__ = ["Forked", "Forks"]

logger = logging.getLogger(__name__)

_FEW = 16  # contact points up to which rays are looked for unless it is forbidden
_SAME = 1e-6  # of the change in a step: the same end


@dataclass(frozen=True)
class Forked:
    """A step with the solutions of the rate problem at its start.

    Attributes:
        solved: the step.
        rays: solutions of the rate problem; None if they were not looked for or cannot be found.
    """

    solved: SolvedStep
    rays: FoundRays[Statuses] | None = None

    @property
    def directions(self) -> int | None:
        """Number of solutions of the rate problem that are known."""
        return None if self.rays is None else len(self.rays.rays)


class Forks:
    """Takes steps and enumerates the solutions of their rate problems. Collective.

    Args:
        stepper: stepper of the problem.
        wanted: whether rays are looked for at every start; None: only where the statuses of the
            step before do not hold, with up to sixteen contact points.
    """

    def __init__(self, stepper: Stepper, wanted: bool | None):
        self._stepper = stepper
        self._wanted = wanted
        points = sum(s.points.number for s in stepper.problem.surfaces)
        self._few = stepper.problem.comm.allreduce(points) <= _FEW

    def take(self, accepted: AcceptedState, time: float, trial: Trial) -> Forked:
        """Step from an accepted state to a time.

        Args:
            accepted: state at the start of the step.
            time: time at its end.
            trial: strategies of the solver; other rays are not tried if it is brief.

        Raises:
            ConvergenceError: if nothing solves the step; the start is then in the Functions.
        """
        try:
            solved = self._stepper.take(accepted, time, trial=trial)
        except ConvergenceError:
            if trial.brief:
                raise
            rays = self._rays(accepted, time)
            for statuses in () if rays is None else rays.rays:
                if self._same(accepted.statuses, statuses):
                    continue  # tried
                try:
                    return Forked(self._stepper.take(accepted, time, likely=(statuses,)), rays)
                except ConvergenceError:
                    continue
            raise
        if not self._wanted and self._same(accepted.statuses, solved.after.statuses):
            return Forked(solved)
        return Forked(solved, self._rays(accepted, time))

    def others(self, forked: Forked) -> list[SolvedStep]:
        """Steps from the same start to the same time along the other rays, to other ends."""
        solved = forked.solved
        found = [forked.solved]
        comm = self._stepper.problem.comm
        whole = change(comm, solved.before, solved.after)
        for statuses in () if forked.rays is None else forked.rays.rays:
            try:
                other = self._stepper.take(solved.before, solved.after.time, likely=(statuses,))
            except ConvergenceError as error:
                if comm.rank == 0:
                    logger.warning(
                        "another way on from the time %.10g is not followed, since its first step "
                        "was not solved: %s",
                        solved.before.time,
                        error,
                    )
                continue
            size = max(whole, change(comm, other.before, other.after))
            if all(change(comm, other.after, t.after) > _SAME * size for t in found):
                found.append(other)
        return found[1:]

    def _rays(self, accepted: AcceptedState, time: float) -> FoundRays[Statuses] | None:
        if self._wanted is False or not (self._wanted or self._few) or accepted.statuses is None:
            return None
        return rays_of_step(self._stepper.begin(accepted, time))

    def _same(self, a: Statuses | None, b: Statuses | None) -> bool:
        """Whether two statuses are the same on all ranks; also if none are known."""
        if a is None or b is None:
            return True
        other = sum(int(np.count_nonzero(d)) for d in differs(a, b))
        return not self._stepper.problem.comm.allreduce(other)
