# SPDX-License-Identifier: LGPL-3.0-or-later
"""The branch of solutions on which a quasi-static step begins, followed while its load continues.

A step that ends far from its start proves no jump: the solver may have passed over a solution that
is near. So the branch is followed with the memory of the start, from kink to kink. Either it leads
to the load of the end, and then a solution continues the evolution; or the load turns back on it,
at a smooth fold, or at a kink at which all pieces that meet were tried: those that lead to more
load are followed likewise, and where the load turns back on all of them no solution continues.
Where a branch ends otherwise nothing is proved, and the reason is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation import BranchStep, Follower, StepControl
from dolfinx_contact.continuation.branch import BranchPoint, FoundRays, Ray, SpecialPoint
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.ray_finder import finder_at, kinks_at
from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.solvers.following import Loaded

__all__ = ["StepBranch", "branch_of_step"]

_MOST_STEPS = 400
_MOST_PIECES = 256  # that are tried
_MOST_TURNS = 16
_AT_BORDER = 1e-8  # of the largest distance to a border: at it
_NO_MORE = 1e-9  # of the load of a step, along a unit ray: not more


@dataclass(frozen=True)
class StepBranch:
    """Result of following a branch within a step.

    Attributes:
        reaches_end: whether it leads to the load of the end of the step.
        statuses: statuses there, on this rank; None if it does not.
        unknowns: owned unknowns there, as in `AcceptedState`; None if it does not.
        ends: whether it is proved that the load turns back before, and nothing else leads on.
        why: reason for its end, in words.
    """

    reaches_end: bool = False
    statuses: Statuses | None = None
    unknowns: npt.NDArray[np.float64] | None = None
    ends: bool = False
    why: str = ""


def branch_of_step(stepper: Stepper, accepted: AcceptedState, time: float) -> StepBranch:
    """Follow the solutions of a step from a state to the load of a time. Collective."""
    problem = stepper.begin(accepted, time)
    equations = problem.equations
    x = problem.create_vector()
    try:
        problem.write(x)
        with equations.ramped(x):
            equations.prescribed.part = 0.0
            system = Loaded(equations, lambda: problem.linear_solver, x)
            control = StepControl(kinks="exact")
            try:
                with Follower(system, control, gamma_scale=1.0) as follower:
                    return _followed(follower, system, x)
            except ValueError as error:
                return StepBranch(why=f"the solutions were not followed in the step: {error}")
            finally:
                system.destroy()
    finally:
        x.destroy()


def _followed(follower: Follower, system: Loaded, x: PETSc.Vec) -> StepBranch:
    """Follow the branches from a start, and those that leave where they turn. Collective."""
    found = follower.departures(x, 0.0)
    starts = _with_more(follower, x, found)
    turns = 0
    why = f"the load turns back at the start, by {found.method}"
    unknown = "" if found.complete else f"rays out of the start may be missing, {found.method}"
    while starts:
        branch = follower.run(
            starts.pop(), gamma_range=(0.0, 1.0), max_steps=_MOST_STEPS, stop=_turned
        )
        last = branch.points[-1]
        if last.gamma >= 1.0:
            x, _ = follower.bordered.split(last.y)
            return StepBranch(True, system.statuses_of(last.piece), x.array_r.copy())
        special = [s for s in branch.special if s.kind in ("fold", "bifurcation")]
        if branch.ending is not Ending.STOPPED or not special:
            unknown = f"the solutions were followed in the step: {branch.reason}"
            continue
        turn = _at_turn(follower, special[-1])
        why = f"{turn.why}, at {special[-1].gamma:.4g} of its change"
        turns = turns + 1
        if not turn.known:
            unknown = turn.why
        elif turns > _MOST_TURNS:
            return StepBranch(why=f"the load turns back on more than {_MOST_TURNS} branches")
        for ray in turn.rays:
            try:
                starts.append(follower.branch_off(special[-1], ray))
            except ValueError as error:
                unknown = f"other solutions with more load meet there, {turn.method}: {error}"
    return StepBranch(ends=not unknown, why=unknown or why)


def _with_more(
    follower: Follower, x: PETSc.Vec, found: FoundRays[BranchPoint]
) -> list[BranchPoint]:
    """The rays out of a start along which the load grows, the straightest last. Collective.

    If there are none, those along which it does not change; and where rays may be missing and there
    are neither, the start itself, whose first step looks for a direction.
    """
    b = follower.bordered
    rates = [b.gamma(point.tangent) for point in found.rays]
    chosen = [p for p, rate in zip(found.rays, rates, strict=True) if rate > _NO_MORE]
    if not chosen:
        chosen = [p for p, rate in zip(found.rays, rates, strict=True) if abs(rate) <= _NO_MORE]
    if len(chosen) == 1 or (not chosen and found.complete):
        return chosen
    start = follower.start(x, 0.0)
    chosen.sort(key=lambda point: b.inner(point.tangent, start.tangent))
    return chosen or [start]


def _turned(step: BranchStep) -> str:
    turns = any(s.kind in ("fold", "bifurcation") for s in step.special)
    return "the load turns back" if turns else ""


@dataclass(frozen=True)
class _Turn:
    """A point at which the load turns back on a branch.

    Attributes:
        why: evidence that it turns back, or the reason why that is unknown.
        known: whether all rays to more load from there are known.
        rays: rays to more load.
        method: method by which they were found.
    """

    why: str
    known: bool = False
    rays: Sequence[Ray] = ()
    method: str = ""


def _at_turn(follower: Follower, special: SpecialPoint) -> _Turn:
    """Find the rays to more load from a fold or a point where branches meet. Collective."""
    if special.kind == "fold" and special.smooth:
        return _Turn("the load turns back while all statuses stay", known=True)
    b = follower.bordered
    onwards = special.onwards
    if special.smooth or onwards is None:
        return _Turn("branches of solutions meet there")
    if special.complete:
        rays = [onwards, *special.others]
        method = special.method
    else:
        incoming = onwards if special.incoming is None else special.incoming
        events = b.system.events(*b.split(special.y), incoming.piece)
        largest = float(np.max(np.abs(events.distance), initial=0.0))
        tolerance = _AT_BORDER * b.comm.allreduce(largest, op=max)
        kinks = kinks_at(follower.corrector, special.y, incoming.piece, tolerance)
        finder = finder_at(follower.corrector, special.y, kinks)
        found = finder.enumerated(incoming.piece, kinks, incoming.tangent, most=_MOST_PIECES)
        if not found.complete:
            return _Turn(found.method)
        rays = list(found.rays)
        method = found.method
    more = [ray for ray in rays if b.gamma(ray.tangent) > _NO_MORE]
    return _Turn(f"the load turns back, by {method}", True, more, f"by {method}")
