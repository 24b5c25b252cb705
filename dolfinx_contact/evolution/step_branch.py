# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Solutions within a quasi-static step, while its load is applied.

The data of a step change from its start (gamma = 0) to its end (gamma = 1) along a straight line,
with the memory m_n of the start:

    H(x, gamma; m_n) = 0,        0 <= gamma <= 1.

`rays_of_step` solves the rate problem at gamma = 0, a problem of polyhedral cones
(`continuation.rays`). Every slipping point is at the border of stick there. Several rays with
growing gamma may exist: with large friction a point can stick or slip under the same rate of the
load (Klarbring, Ing.-Arch. 60, 1990). If all pieces were tried and none exists, the state jumps.

`branch_of_step` follows the branch that begins at gamma = 0 from kink to kink. A step that ends far
from its start is no proof of a jump, because the solver may have missed a solution. If the branch
leads to gamma = 1, a solution continues the evolution. If gamma turns back at a smooth fold, or at
a kink all of whose pieces were tried, on this branch and on all that leave it towards larger gamma,
no solution continues the evolution. Otherwise nothing is proved, and the reason is given.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation import BranchStep, Follower, StepControl
from dolfinx_contact.continuation.branch import BranchPoint, FoundRays, Ray, SpecialPoint
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.ray_finder import KinkRays
from dolfinx_contact.continuation.rays import outgoing
from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense
from dolfinx_contact.solvers.following import Loaded

__all__ = ["StepBranch", "branch_of_step", "rays_of_step"]

_AT_BORDER = 1e-8  # fraction of the largest distance to a border that counts as zero
_IDLE = 1e-9  # rate of gamma along a unit ray that counts as zero
_MOST_STEPS = 400  # largest number of steps on a branch
_MOST_PIECES = 256  # largest number of pieces that are enumerated
_MOST_TURNS = 16  # largest number of turning points
_TURNS = ("fold", "bifurcation")


@dataclass(frozen=True)
class StepBranch:
    """Result of following a branch within a step.

    Attributes:
        reaches_end: whether the branch leads to the load of the end of the step.
        statuses: statuses there, on this rank; None if it does not lead there.
        unknowns: owned unknowns there, as in `AcceptedState`; None if it does not lead there.
        ends: whether it is proved that no branch leads there.
        why: reason for the end of the branch.
    """

    reaches_end: bool = False
    statuses: Statuses | None = None
    unknowns: npt.NDArray[np.float64] | None = None
    ends: bool = False
    why: str = ""


def rays_of_step(problem: ContactProblem) -> FoundRays[Statuses] | None:
    """Return the statuses of all solutions of the rate problem at the start of a step. Collective.

    Args:
        problem: problem of the step (`ContactProblem.step_from`), with the start of the step in its
            Functions and the data of its end.

    Returns:
        Statuses of the rays with growing load, surface by surface on this rank. None if the pieces
        of H are not polyhedral cones (`reduced.scope`), data of the surfaces change in the step, or
        the body is singular although its contact points are held.
    """
    with _loaded(problem) as (system, x):
        if not can_condense(system) or not system.leaves_surfaces_alone():
            return None
        try:
            condensed = Reduction(system, x, 0.0, exact=False)
        except RuntimeError:
            return None
        try:
            w = condensed.contract(x)
            cone = condensed.system.tangent_cone(w, _AT_BORDER * float(np.abs(w).max()))
            found = outgoing(cone)
            pieces = [condensed.piece(ray.codes) for ray in found.rays if ray.rate > 0]
        finally:
            condensed.destroy()
        statuses = [system.statuses_of(piece) for piece in pieces]
        rays = tuple(s for s in statuses if s is not None)
        return FoundRays(rays, found.complete, found.method)


def branch_of_step(stepper: Stepper, accepted: AcceptedState, time: float) -> StepBranch:
    """Follow the solutions of a step from its start to its end. Collective.

    Args:
        stepper: stepper of the problem.
        accepted: state at the start.
        time: time at the end.
    """
    with _loaded(stepper.begin(accepted, time)) as (system, x):
        try:
            with Follower(system, StepControl(kinks="exact"), gamma_scale=1.0) as follower:
                return _followed(follower, system, x)
        except ValueError as error:
            return StepBranch(why=f"the solutions were not followed in the step: {error}")


@contextmanager
def _loaded(problem: ContactProblem) -> Iterator[tuple[Loaded, PETSc.Vec]]:
    """Provide the system H(x, gamma) of a step and the unknowns of its start. Collective."""
    equations = problem.equations
    x = problem.create_vector()
    problem.write(x)
    try:
        with equations.ramped(x):
            equations.prescribed.part = 0.0
            system = Loaded(equations, lambda: problem.linear_solver, x)
            try:
                yield system, x
            finally:
                system.destroy()
    finally:
        x.destroy()


def _followed(follower: Follower, system: Loaded, x: PETSc.Vec) -> StepBranch:
    """Follow the branches from the start and from their turning points. Collective."""
    departures = follower.departures(x, 0.0)
    starts = _with_growing_load(follower, x, departures)
    why = f"the load turns back at the start, by {departures.method}"
    unknown = ""
    if not departures.complete:
        unknown = f"rays out of the start may be missing, {departures.method}"
    turns = 0
    while starts:
        branch = follower.run(
            starts.pop(), gamma_range=(0.0, 1.0), max_steps=_MOST_STEPS, stop=_turned
        )
        last = branch.points[-1]
        if last.gamma >= 1.0:
            x, _ = follower.bordered.split(last.y)
            return StepBranch(True, system.statuses_of(last.piece), x.array_r.copy())
        special = [s for s in branch.special if s.kind in _TURNS]
        if branch.ending is not Ending.STOPPED or not special:
            unknown = f"the solutions were followed in the step: {branch.reason}"
            continue
        turn = special[-1]
        more = _rays_at_turn(follower, turn)
        why = f"{more.method}, at {turn.gamma:.4g} of its change"
        turns += 1
        if not more.complete:
            unknown = more.method
        elif turns > _MOST_TURNS:
            return StepBranch(why=f"the load turns back on more than {_MOST_TURNS} branches")
        for ray in more.rays:
            try:
                starts.append(follower.branch_off(turn, ray))
            except ValueError as error:
                unknown = f"other solutions with more load meet there: {error}"
    return StepBranch(ends=not unknown, why=unknown or why)


def _with_growing_load(
    follower: Follower, x: PETSc.Vec, departures: FoundRays[BranchPoint]
) -> list[BranchPoint]:
    """Return the rays out of the start to follow, the straightest last. Collective.

    These are the rays along which gamma grows, or, if there are none, the rays along which gamma is
    constant. If there are none either and rays may be missing, the result is the start itself, and
    its first step searches for a direction.
    """
    b = follower.bordered
    rates = [(point, b.gamma(point.tangent)) for point in departures.rays]
    chosen = [point for point, rate in rates if rate > _IDLE]
    chosen = chosen or [point for point, rate in rates if abs(rate) <= _IDLE]
    if len(chosen) == 1 or (not chosen and departures.complete):
        return chosen
    start = follower.start(x, 0.0)
    chosen.sort(key=lambda point: b.inner(point.tangent, start.tangent))
    return chosen or [start]


def _turned(step: BranchStep) -> str:
    """Return a reason to end a branch at a fold or bifurcation; "" elsewhere."""
    return "the load turns back" if any(s.kind in _TURNS for s in step.special) else ""


def _rays_at_turn(follower: Follower, turn: SpecialPoint) -> FoundRays[Ray]:
    """Return the rays with growing gamma out of a fold or a bifurcation. Collective.

    The method of the result states why the load turns back, or why this is unknown.
    """
    if turn.kind == "fold" and turn.smooth:
        return FoundRays((), True, "the load turns back while all statuses stay")
    if turn.smooth or turn.onwards is None:
        return FoundRays((), False, "branches of solutions meet there")
    b = follower.bordered
    if turn.complete:
        found = FoundRays((turn.onwards, *turn.others), True, turn.method)
    else:
        incoming = turn.incoming or turn.onwards
        events = b.events(turn.y, incoming.piece)
        largest = float(np.max(np.abs(events.distance), initial=0.0))
        tolerance = _AT_BORDER * b.comm.allreduce(largest, op=max)
        finder = KinkRays(follower.corrector, turn.y, incoming.piece, tolerance)
        found = finder.enumerated(incoming.piece, finder.kinks, incoming.tangent, most=_MOST_PIECES)
        if not found.complete:
            return found
    rays = tuple(ray for ray in found.rays if b.gamma(ray.tangent) > _IDLE)
    return FoundRays(rays, True, f"the load turns back, by {found.method}")
