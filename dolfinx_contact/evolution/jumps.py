# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Changes of the state in a step, and jumps under a load that continues smoothly.

The change from a state a to a state b consists of

    moved      largest displacement of a node
    unknowns   |x_b - x_a| with all unknowns x as lengths
    means      mean change |j_b - j_a| of the jump at the points of each surface
    bonds      mean change of the softening variable of the bonds of each surface.

Where a branch of the rate problem folds or ends (Klarbring, Ing.-Arch. 60, 1990: one node, friction
beyond a bound), the solver finds a solution to which no path of solutions leads. Halving the step
does not reduce such a jump, whereas changes with the load, and faster changes after kinks, shrink
with the step. `find_jump` bisects a step to find a jump.

A change that does not shrink does not prove a jump, because the solver may have missed a solution.
Therefore the branch of solutions H(x, gamma; m_n) = 0 from the start of the step (gamma = 0,
`rate_problem`) is finally followed from kink to kink. If it reaches gamma = 1, the end of the step,
a solution continues the evolution. If gamma turns back at a smooth fold, or at a kink of which all
pieces were tried, on this branch and on all branches that leave it towards larger gamma, no
solution continues the evolution. Otherwise nothing is proved, and the reason is reported. A step
that was not solved proves nothing either; shorter steps are tried from the same state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._ending import Ending
from dolfinx_contact._mpi import all_ranks, largest, total
from dolfinx_contact.continuation import BranchStep, Follower, StepControl
from dolfinx_contact.continuation.branch import BranchPoint, FoundRays, Ray, SpecialPoint
from dolfinx_contact.continuation.ray_finder import KinkRayFinder
from dolfinx_contact.equations.data import Datum, data_of_surface
from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.evolution.energy import Forces
from dolfinx_contact.evolution.rate_problem import loaded
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.laws.status import letters
from dolfinx_contact.solvers import ConvergenceError
from dolfinx_contact.solvers.load_following import Loaded

__all__ = ["MOVED", "UNKNOWNS", "Found", "StateChanges", "changes", "find_jump", "where_it_changes"]


_SMALL = 0.1  # fraction of the change in a step below which a jump is not searched
_ROUND_OFF = 1e-6  # fraction of the largest change that counts as zero
_EVEN = 0.55  # largest fraction of the change of an even part that occurs in one of its halves
_NEAR = 0.5  # largest change, relative to the jump, in a step that continues the evolution
_SAME = 1e-4  # largest distance of equal solutions, relative to the change in a step
_SHORTER = 0.25  # length of the next step after a failed one, relative to the failed one
_SHOWN = 5  # largest number of places in a message
# on the branch of solutions within a step:
_AT_BORDER = 1e-8  # fraction of the largest distance to a border that counts as zero
_IDLE = 1e-9  # rate of gamma along a unit ray that counts as zero
_MOST_STEPS = 400  # largest number of steps on a branch
_MOST_PIECES = 256  # largest number of pieces that are enumerated
_MOST_TURNS = 16  # largest number of turning points
_TURNS = ("fold", "bifurcation")

#: Positions of the first two parts of `StateChanges.parts`.
MOVED, UNKNOWNS = 0, 1


# -- changes ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StateChanges:
    """Changes from one state to another, as defined in the module.

    Attributes:
        parts: changes "moved" and "unknowns" (indices `MOVED` and `UNKNOWNS`); between states of
            equilibrium also "means" and then "bonds" of the n surfaces; shape (2 + 2 n,).
        largest: largest change of the jump at a point of each surface, shape (n,).
        broken: largest weakening of a bond of each surface, relative to the remaining strength of
            its strongest bond; 0 if this strength is unknown; shape (n,).
    """

    parts: Array
    largest: Array
    broken: Array

    @property
    def unknowns(self) -> float:
        """Norm of the change of all unknowns, in the unit of length."""
        return float(self.parts[UNKNOWNS])

    def rates(self, duration: float) -> Array:
        """Return `parts`, then `largest`, divided by the duration, shape (2 + 3 n,)."""
        return np.asarray(np.concatenate([self.parts, self.largest]) / duration)


def changes(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> StateChanges:
    """Return the changes from state ``a`` to state ``b``. Collective."""
    d = b.unknowns - a.unknowns
    if not (isinstance(a.forces, Forces) and isinstance(b.forces, Forces)):
        unknowns = np.sqrt(total(comm, np.dot(d, d)))
        return StateChanges(np.array([0.0, unknowns]), np.zeros(0), np.zeros(0))
    if a.forces.covered is not None and b.forces.covered is not None:
        d = d * np.minimum(a.forces.covered, b.forces.covered)
    moved = largest(comm, np.abs(b.forces.u - a.forces.u).max(initial=0.0))
    unknowns = np.sqrt(total(comm, np.dot(d, d)))
    # means and maxima over the points of each surface
    points = [_at_points(a, b, k) for k in range(len(b.forces.surfaces))]
    sums = [(jumps.sum(), losses.sum(), len(jumps)) for jumps, losses, _ in points]
    jump_sum, loss_sum, number = total(comm, sums).T
    maxima = [[values.max(initial=0.0) for values in surface] for surface in points]
    jump, loss, strength = largest(comm, maxima).T
    number = np.maximum(number, 1.0)
    parts = np.concatenate([[moved, unknowns], jump_sum / number, loss_sum / number])
    broken = np.divide(loss, strength, out=np.zeros_like(loss), where=strength > 0)
    return StateChanges(parts, jump, broken)


def _at_points(a: AcceptedState, b: AcceptedState, k: int) -> tuple[Array, Array, Array]:
    """Return the changes at the points of surface ``k`` on this rank, without clamped points.

    Returns:
        Changes of the jump of the displacement, lengths; changes of the softening variable of
        bonds; and remaining strengths of bonds in the first state, as distances of the softening
        variable to its final value.
    """
    assert isinstance(a.forces, Forces)
    assert isinstance(b.forces, Forces)
    eq = a.forces.equations
    s = eq.surfaces[k]
    jumps = np.linalg.norm(b.forces.surfaces[k].jump - a.forces.surfaces[k].jump, axis=1)
    losses = strengths = np.zeros_like(jumps)
    bond = s.law.weakening
    if bond is not None:
        before = a.memory[k].fields[bond.name]
        end = bond.end
        if end is None:
            end = 0.0 if bond.sense < 0 else math.nan
        losses = np.abs(b.memory[k].fields[bond.name] - before)
        strengths = np.nan_to_num(np.abs(end - before))
    if s.method == "integral":
        return jumps, losses, strengths
    free = ~eq.constraints.surfaces[k].clamped[: len(jumps)]
    return jumps[free], losses[free], strengths[free]


def where_it_changes(stepper: Stepper, before: AcceptedState, after: AcceptedState) -> str:
    """Describe the points whose status differs between two states. Collective."""
    words: list[str] = []
    states = zip(before.state.statuses, after.state.statuses, strict=True)
    for s, (old, new) in zip(stepper.problem.surfaces, states, strict=True):
        names = letters(s.dim)
        local = [
            (s.positions[i].tolist(), f"{names[old[i]]} to {names[new[i]]}")
            for i in np.flatnonzero(old != new)
        ]
        places = sorted(place for part in s.comm.allgather(local) for place in part)
        shown = ", ".join(
            f"({', '.join(f'{c:.4g}' for c in x)}) {change}" for x, change in places[:_SHOWN]
        )
        more = f" and {len(places) - _SHOWN} more" if len(places) > _SHOWN else ""
        if places:
            words.append(f"{s.name}: {shown}{more}")
    return "; ".join(words) or "all statuses are the same"


# -- jumps -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Found:
    """Result of the search for a jump in a step.

    Attributes:
        steps: accepted ends of shorter steps that continue the evolution from the start of the
            searched step.
        far: state beyond the jump: end of a step from the last of `steps` in which the change of
            the state does not decrease with the step length; None if the evolution continues.
        proved: whether it is proved that no path of solutions leads to `far`.
        failure: error of the shorter steps tried after the last of `steps`; None if they were
            solved.
        why: description of the solutions beyond the last of `steps`, for the message.
    """

    steps: Sequence[AcceptedState]
    far: AcceptedState | None = None
    proved: bool = False
    failure: ConvergenceError | None = None
    why: str = ""


def find_jump(
    stepper: Stepper, before: AcceptedState, after: AcceptedState, slow: Array, least: float
) -> Found | None:
    """Search for a jump in a step in which the state changes suddenly. Collective.

    Halves of the step are examined recursively, the earlier half first. A part of the step contains
    no jump if the state changes slowly in it, by a small fraction of the change in the step, along
    a straight line, or evenly (equally in both halves, and in the quarters if they are long
    enough). If a part of the shortest length remains, the solutions within it are followed to
    decide whether the state jumps.

    Args:
        stepper: stepper of the problem; the state of the Functions is undefined afterwards.
        before: state at the start of the step.
        after: state at its end.
        slow: rates of `StateChanges.parts` up to which the state is assumed not to jump.
        least: shortest length of a step.

    Returns:
        Shorter steps and the jump; None if the state changes without a jump.
    """
    return _Search(stepper, before, after, slow, least).look([before], after)


class _Search:
    """Recursive search of a step for a jump, with the arguments of `find_jump`."""

    def __init__(
        self,
        stepper: Stepper,
        before: AcceptedState,
        after: AcceptedState,
        slow: Array,
        least: float,
    ):
        self._stepper = stepper
        self._comm = stepper.problem.comm
        self._slow = slow
        self._least = least
        self._end = after
        whole = self._change(before, after)
        self._small = np.maximum(_SMALL * whole, _ROUND_OFF * whole.max())
        eq = stepper.problem.equations
        laws = [s.law_at_points.compiled for s in eq.surfaces]
        self._linear = eq.linear and all(law.is_piecewise_linear for law in laws)
        self._data = [Datum("the body", f) for f in eq.bulk.stiffness_data]
        self._data += [d for s in eq.surfaces for d in data_of_surface(s)]

    def look(
        self, path: Sequence[AcceptedState], end: AcceptedState, even: bool = False
    ) -> Found | None:
        """Examine a part of the step.

        Args:
            path: accepted states from the start of the whole step to the start of the part.
            end: state at the end of the part.
            even: whether the part is one half of a part in whose halves the state changes equally.
        """
        start = path[-1]
        a, b = start.time, end.time
        size = self._change(start, end)
        fast = size > np.maximum(self._small, self._slow * (b - a))
        if not fast.any() or self._is_straight(start, end):
            return None
        middle = 0.5 * (a + b)
        if b - a < 2 * self._least or not a < middle < b:
            return None if even else self._decide(path, end)
        # halve the part
        first = self._first(start, middle)
        if isinstance(first, ConvergenceError):
            return self._unsolved(path, end, first)
        uneven = bool((self._change(start, first) > _EVEN * size)[fast].any())
        found = self.look(path, first) if uneven else None
        if found is not None:
            return found
        if first.time < middle:
            return Found([*path, first][1:])
        second = self._first(first, b)
        if isinstance(second, ConvergenceError):
            return self._unsolved(path, end, second)
        halves = not uneven and bool((self._change(first, second) <= _EVEN * size)[fast].all())
        if halves and even:
            return None
        # examine the halves
        if not uneven:
            found = self.look(path, first, halves)
        if found is None:
            found = self.look([*path, first], second, halves)
        if found is None and (second.time < b or self._is_elsewhere(second, start, end)):
            return Found([*path, first, second][1:])
        return found

    def _unsolved(
        self, path: Sequence[AcceptedState], end: AcceptedState, failure: ConvergenceError
    ) -> Found | None:
        """Return the result of the search if a step to half of a part failed. Collective."""
        if self._leads_to_end(path[-1], end):
            return None
        return Found(path[1:], end, failure=failure)

    def _change(self, before: AcceptedState, after: AcceptedState) -> Array:
        return changes(self._comm, before, after).parts

    def _is_elsewhere(
        self, second: AcceptedState, start: AcceptedState, end: AcceptedState
    ) -> bool:
        """Return whether two half steps lead to another solution than the whole step. Collective.

        This requires that their ends differ, and that the branch of solutions from the start does
        not lead to the end of the whole step. Otherwise both ends are equally valid, because
        friction and damage depend on the steps.

        Args:
            second: end of the second half step.
            start: start of the whole step.
            end: end of the whole step.
        """
        much = np.maximum(_NEAR * self._change(start, end), self._small)
        different = self._change(second, end) > much
        return bool(different.any()) and not self._leads_to_end(start, end)

    def _leads_to_end(self, start: AcceptedState, end: AcceptedState) -> bool:
        """Return whether solutions followed from the start of a step lead to the given end."""
        branch = branch_of_step(self._stepper, start, end.time)
        return branch.unknowns is not None and self._is_at(branch.unknowns, start, end)

    def _is_at(self, unknowns: Array, start: AcceptedState, end: AcceptedState) -> bool:
        """Return whether unknowns agree with ``end``, relative to the change from ``start``."""
        off = unknowns - end.unknowns
        way = end.unknowns - start.unknowns
        squares = self._comm.allreduce(np.array([np.dot(off, off), np.dot(way, way)]))
        return bool(np.sqrt(squares[0]) <= _SAME * np.sqrt(squares[1]))

    def _is_straight(self, start: AcceptedState, end: AcceptedState) -> bool:
        """Return whether all states on the line between the ends are solutions. Collective.

        This is the case if the statuses of both ends are the same, the problem is linear for fixed
        statuses, and the data of stiffness, laws and obstacles are constant in the step.
        """
        if not self._linear:
            return False
        a, b = start.statuses, end.statuses
        same = a is not None and b is not None and all(map(np.array_equal, a, b))
        if not all_ranks(self._comm, same):
            return False
        return self._stepper.keeps(self._data, start.time, end.time)

    def _first(self, before: AcceptedState, time: float) -> AcceptedState | ConvergenceError:
        """Take the longest step towards a time that is solved; return the last error if none is."""
        likely = before.statuses, self._end.statuses
        while True:
            try:
                return self._stepper.take(before, time, likely=likely)
            except ConvergenceError as error:
                failure = error
            length = _SHORTER * (time - before.time)
            if length < self._least or not before.time < before.time + length < time:
                return failure
            time = before.time + length

    def _decide(self, path: Sequence[AcceptedState], end: AcceptedState) -> Found | None:
        """Decide by following the solutions within a shortest step whether the state jumps.

        It does not jump if they lead to the end of this step. If they lead to the end of the
        searched step, or to another state at the end of this step, the evolution continues there.
        """
        start = path[-1]
        size = self._change(start, end)
        why = ""
        ends = False
        for time in dict.fromkeys((self._end.time, end.time)):
            branch = branch_of_step(self._stepper, start, time)
            why = branch.why
            ends = branch.ends
            if branch.unknowns is None:
                continue
            if time == end.time and self._is_at(branch.unknowns, start, end):
                return None
            try:
                near = self._stepper.take(start, time, likely=(branch.statuses,))
            except ConvergenceError as error:
                return Found(path[1:], end, failure=error)
            if (self._change(start, near) <= np.maximum(_NEAR * size, self._small)).all():
                return Found([*path[1:], near])
            why = "solutions continue from the state, but no step led to them"
        return Found(path[1:], end, ends, why=why)


# -- solutions within a step -----------------------------------------------------------------------


@dataclass(frozen=True)
class StepBranch:
    """Result of following the solutions within a step, up to the load at the end of the step.

    Attributes:
        unknowns: owned unknowns under the load at the end, as in `AcceptedState`; None if this load
            is not reached.
        statuses: statuses under this load on this rank; None if it is not reached.
        ends: whether it is proved that no branch of solutions reaches this load.
        why: reason why this load is not reached.
    """

    unknowns: Array | None = None
    statuses: Statuses | None = None
    ends: bool = False
    why: str = ""


def branch_of_step(stepper: Stepper, accepted: AcceptedState, time: float) -> StepBranch:
    """Follow the solutions from the start to the end of a step. Collective.

    Args:
        stepper: stepper of the problem.
        accepted: state at the start.
        time: time at the end.
    """
    with loaded(stepper.begin(accepted, time)) as (system, x):
        try:
            with Follower(system, StepControl(kinks="exact"), gamma_scale=1.0) as follower:
                return _followed(follower, system, x)
        except ValueError as error:
            return StepBranch(why=f"the solutions were not followed in the step: {error}")


def _followed(follower: Follower, system: Loaded, x: PETSc.Vec) -> StepBranch:
    """Follow the solutions of a step, along all rays with growing load. Collective."""
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
            return StepBranch(x.array_r.copy(), system.statuses_of(last.piece))
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
    """Return the rays to be followed from the start of a step. Collective.

    These are the rays along which the load gamma grows or, if none exist, those with constant
    gamma. The ray closest to the tangent at the start is the last. If no ray was found, but rays
    may be missing, the start itself is returned; the first step searches for a direction there.
    """
    chosen = follower.rays_with_gamma(departures, 1.0)
    if len(chosen) == 1 or (not chosen and departures.complete):
        return chosen
    start = follower.start(x, 0.0)
    chosen.sort(key=lambda point: follower.bordered.inner(point.tangent, start.tangent))
    return chosen or [start]


def _turned(step: BranchStep) -> str:
    """Return the reason to stop following a branch at a fold or bifurcation, otherwise ""."""
    return "the load turns back" if any(s.kind in _TURNS for s in step.special) else ""


def _rays_at_turn(follower: Follower, turn: SpecialPoint) -> FoundRays[Ray]:
    """Return the rays from a fold or bifurcation along which the load grows. Collective.

    `FoundRays.method` of the result states why the load turns back, or why this is unknown.
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
        tolerance = _AT_BORDER * b.largest(b.events(turn.y, incoming.piece).distance)
        finder = KinkRayFinder(follower.corrector, turn.y, incoming.piece, tolerance)
        found = finder.enumerated(incoming.piece, finder.kinks, incoming.tangent, most=_MOST_PIECES)
        if not found.complete:
            return found
    rays = tuple(ray for ray in found.rays if b.gamma(ray.tangent) > _IDLE)
    return FoundRays(rays, True, f"the load turns back, by {found.method}")
