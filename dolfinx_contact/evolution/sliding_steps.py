# SPDX-License-Identifier: LGPL-3.0-or-later
"""Step lengths of bodies that slide over each other.

Newton's method solves a step of about one facet of the master in a few iterations. Where it fails,
shorter steps cost less than the further strategies of the `ladder`, and end in the same states. So
steps are halved down to a sixteenth of the step of the user before these strategies are tried. In
longer steps Newton's method may find solutions that do not continue the state, in which a cell is
folded: there the smallest det F falls at once, however short the step is.
"""

from __future__ import annotations

import bisect
import math

import numpy as np
import numpy.typing as npt

from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.evolution.step import AcceptedState, AtRest, SolvedStep
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.solvers import ConvergenceError
from dolfinx_contact.solvers.strategies import Trial

__all__ = ["SlidingSteps"]


_PARTS = 16  # of a step of the user, down to which Newton's method alone is tried
_FOLDS = 0.5  # of the smallest det F before, or of 1: less is no continuation


class SlidingSteps:
    """Limits of the steps of a run; there are none in motions or without sliding surfaces.

    Args:
        problem: contact problem.
        times: times of the user.
        longest: longest length of a step.
        shortest: shortest length of a step.
        extrapolate: whether solves start from the extrapolated last step.
        halve: whether steps that are not solved are halved.
        start: state at the start of the run.
    """

    def __init__(
        self,
        problem: ContactProblem,
        times: tuple[float, ...],
        *,
        longest: float,
        shortest: float,
        extrapolate: bool,
        halve: bool,
        start: AcceptedState,
    ):
        self._problem = problem
        self._times = times
        self._longest = longest
        self._shortest = shortest
        self._extrapolate = extrapolate
        self._halve = halve
        self._slide = isinstance(start, AtRest) and any(s.slides for s in problem.surfaces)
        self._folds = self._slide and not problem.equations.bulk.linear
        self._known: tuple[AcceptedState, float] | None = None
        self._last: SolvedStep | None = None

    def trial(self, accepted: AcceptedState, time: float, end: float) -> Trial:
        """Strategies for a step to a time. Not collective.

        Args:
            accepted: state at the start of the step.
            time: time at its end.
            end: time of the user to which it leads.
        """
        if not self._slide:
            return Trial()
        before = self._times[max(bisect.bisect_left(self._times, end) - 1, 0)]
        least = max(min(end - before, self._longest) / _PARTS, self._shortest)
        # Sums of steps of the same length are off by round-off.
        brief = self._halve and (time - accepted.time) / 2 >= least * (1 - 1e-9)
        return Trial(extrapolated=self._extrapolated(accepted, time), brief=brief)

    def requested(self, time: float) -> float:
        """Length of the equal steps that were requested around a time. Not collective."""
        k = bisect.bisect_left(self._times, time)
        if not 0 < k < len(self._times):
            return 0.0
        whole = self._times[k] - self._times[k - 1]
        return whole / max(math.ceil(whole / self._longest * (1 - 1e-12)), 1)

    def _extrapolated(self, accepted: AcceptedState, time: float) -> npt.NDArray[np.float64] | None:
        """Unknowns at a time if they continue as in the last step; None if that is not known."""
        last = self._last
        if not self._extrapolate or last is None or last.after is not accepted:
            return None
        part = (time - accepted.time) / (accepted.time - last.before.time)
        return accepted.unknowns + part * (accepted.unknowns - last.before.unknowns)

    def accept(self, solved: SolvedStep, *, jump: bool) -> None:
        """Remember a step. Not collective."""
        if not self._slide:
            return
        continues = solved.before.solved and not jump
        self._last = solved if self._extrapolate and continues else None

    def require_unfolded(self, solved: SolvedStep) -> None:
        """Raise `ConvergenceError` if the smallest det F falls suddenly in a step. Collective."""
        if not (self._folds and solved.before.solved):
            return
        before = self._smallest(solved.before)
        after = self._smallest(solved.after)
        if before <= 0 or after >= _FOLDS * min(before, 1.0):
            self._known = solved.after, after
            return
        raise ConvergenceError(
            f"the smallest det F falls from {before:.3g} to {after:.3g} in one step: the solution "
            "that was found is folded, and does not continue the state"
        )

    def _smallest(self, state: AcceptedState) -> float:
        """The smallest det F at a state. Collective."""
        if self._known is not None and self._known[0] is state:
            return self._known[1]
        eq = self._problem.equations
        u = state.state.displacement
        return smallest_jacobian(eq.V, u, vertices=False, axisymmetric=eq.axisymmetric)[0]
