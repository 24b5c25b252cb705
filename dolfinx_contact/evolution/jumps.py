# SPDX-License-Identifier: LGPL-3.0-or-later
"""Detection of jumps of the state under a load that continues smoothly.

Where a branch of the rate problem folds or ends (Klarbring, Ing.-Arch. 60, 1990: one node, friction
beyond a bound), the solver finds a solution that no path of solutions leads to. Such a jump differs
from a large change in one step: halving the step does not reduce it. Changes with the load, and
faster changes after kinks, shrink with the step.

A change that does not shrink is not a proof, because the solver may have passed over a solution. So
in the end the branch of solutions is followed from the state (`step_branch`). A step that was not
solved is not a proof either: then shorter steps are tried from the same state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.data import data_of_surface
from dolfinx_contact.evolution.changes import changes
from dolfinx_contact.evolution.step import AcceptedState, SolvedStep, Stepper
from dolfinx_contact.evolution.step_branch import StepBranch, branch_of_step
from dolfinx_contact.laws.status import letters
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["Found", "find_jump", "where_it_changes"]

Array = npt.NDArray[np.float64]

_SMALL = 0.1  # of the change in a step: no jump that is looked for
_ROUND_OFF = 1e-6  # of the largest change: none
_EVEN = 0.55  # of the change of a part, at most, that of its half where it is even
_NEAR = 0.5  # of a jump, at most, the change in a step that leads on instead
_SAME = 1e-4  # of a step, between two solutions of it: the same
_SHORTER = 0.25  # of a step that was not solved, the next
_SHOWN = 5  # places


@dataclass(frozen=True)
class Found:
    """Result of the search within a step.

    Attributes:
        steps: steps that continue the evolution from the start of the step.
        far: step from the end of these whose end stays far however short it is; None if the
            evolution continues there.
        proved: whether it is proved that no path of solutions leads through that step.
        failure: error of shorter steps from there; None if they were solved.
        why: facts about the solutions beyond, in words.
    """

    steps: Sequence[SolvedStep]
    far: SolvedStep | None = None
    proved: bool = False
    failure: ConvergenceError | None = None
    why: str = ""


def find_jump(stepper: Stepper, step: SolvedStep, slow: Array, least: float) -> Found | None:
    """Search for a jump in a step that changes the state suddenly. Collective.

    Halves are examined in turn, the earlier one first. One is left alone if the state changes in
    it slowly, by a small share of the change in the step, along a straight line, or evenly (by as
    much in each of its halves, and in theirs if they can be halved). A jump is what none of these
    become true of.

    Args:
        stepper: stepper of the problem; the Functions are left in any state.
        step: step that is searched.
        slow: rates of `changes` up to which nothing jumps.
        least: shortest length of a step.

    Returns:
        None if the change of state is spread over the step.
    """
    return _Search(stepper, step, slow, least).look([], step)


class _Search:
    """The search for a jump in a step."""

    def __init__(self, stepper: Stepper, step: SolvedStep, slow: Array, least: float):
        self._stepper = stepper
        self._slow = slow
        self._least = least
        self._end = step.after.statuses
        self._aim = step.after.time
        whole = self._change(step)
        self._small = np.maximum(_SMALL * whole, _ROUND_OFF * whole.max())
        equations = stepper.problem.equations
        self._linear = equations.linear and all(
            s.law_at_points.compiled.is_piecewise_linear for s in equations.surfaces
        )
        at_points = [d.value for s in equations.surfaces for d in data_of_surface(s)]
        self._kept = [*equations.bulk.stiffness_data, *at_points]

    def look(
        self, path: Sequence[SolvedStep], step: SolvedStep, even: bool = False
    ) -> Found | None:
        """Examine a part of the step, which follows others; even: it is a half of an even one."""
        a = step.before.time
        b = step.after.time
        size = self._change(step)
        slow = size <= np.maximum(self._small, self._slow * (b - a))
        if slow.all() or self._is_straight(step):
            return None
        middle = 0.5 * (a + b)
        if b - a < 2 * self._least or not a < middle < b:
            return None if even else self._at_last(path, step)
        first = self._first(step.before, middle)
        if isinstance(first, ConvergenceError):
            return None if self._leads_to_end(step) else Found(path, step, failure=first)
        before = [*path, first]
        uneven = bool((self._change(first) > _EVEN * size)[~slow].any())
        found = self.look(path, first) if uneven else None
        if found is not None:
            return found
        if first.after.time < middle:
            return Found(before)
        second = self._first(first.after, b)
        if isinstance(second, ConvergenceError):
            return None if self._leads_to_end(step) else Found(path, step, failure=second)
        halves = not uneven and bool((self._change(second) <= _EVEN * size)[~slow].all())
        if halves and even:
            return None
        if not uneven:
            found = self.look(path, first, halves)
        if found is None:
            found = self.look(before, second, halves)
        if found is None and (second.after.time < b or self._is_elsewhere(second, step)):
            return Found([*before, second])
        return found

    def _is_elsewhere(self, second: SolvedStep, step: SolvedStep) -> bool:
        """Whether two halves lead to another state than the whole, and so do solutions. Collective.

        The path of friction and damage depends on the steps: where the branch of the whole step
        leads to its end, that is a solution as good as that of the halves.
        """
        comm = self._stepper.problem.comm
        much = np.maximum(_NEAR * self._change(step), self._small)
        if (changes(comm, second.after, step.after) <= much).all():
            return False
        return not self._leads_to_end(step)

    def _leads_to_end(self, step: SolvedStep) -> bool:
        """Whether the branch of solutions from the start of a step is at its end. Collective."""
        branch = branch_of_step(self._stepper, step.before, step.after.time)
        return branch.reaches_end and self._is_at(branch, step)

    def _change(self, step: SolvedStep) -> Array:
        return changes(self._stepper.problem.comm, step.before, step.after)

    def _is_straight(self, step: SolvedStep) -> bool:
        """Whether the states between are solutions under the loads between. Collective.

        The statuses of both ends are the same, all is linear in them, and neither the stiffness nor
        a law or obstacle has changed its data.
        """
        a = step.before
        b = step.after
        if not self._linear:
            return False
        mine = a.statuses is not None and b.statuses is not None
        mine = mine and all(map(np.array_equal, a.statuses or (), b.statuses or ()))
        if not self._stepper.problem.comm.allreduce(int(mine), op=MPI.MIN):
            return False
        return self._stepper.keeps(self._kept, a.time, b.time)

    def _first(self, before: AcceptedState, time: float) -> SolvedStep | ConvergenceError:
        """The longest step towards a time that is solved; why none is, down to the least length."""
        while True:
            try:
                return self._stepper.take(before, time, likely=(before.statuses, self._end))
            except ConvergenceError as error:
                failure = error
            length = _SHORTER * (time - before.time)
            if length < self._least or not before.time < before.time + length < time:
                return failure
            time = before.time + length

    def _at_last(self, path: Sequence[SolvedStep], step: SolvedStep) -> Found | None:
        """Decide a step of the shortest length by the branch of solutions from its start.

        If the branch leads to the end of the step, the state does not jump. If it leads elsewhere,
        it is followed, up to the end of the searched step if possible.
        """
        stepper = self._stepper
        far = self._change(step)
        why = ""
        ends = False
        for time in dict.fromkeys((self._aim, step.after.time)):
            branch = branch_of_step(stepper, step.before, time)
            why = branch.why
            ends = branch.ends
            if not branch.reaches_end:
                continue
            if time == step.after.time and self._is_at(branch, step):
                return None
            try:
                near = stepper.take(step.before, time, likely=(branch.statuses,))
            except ConvergenceError as error:
                return Found(path, step, failure=error)
            if (self._change(near) <= np.maximum(_NEAR * far, self._small)).all():
                return Found([*path, near])
            why = "solutions lead on from the state, but no step led to them"
        return Found(path, step, ends, why=why)

    def _is_at(self, branch: StepBranch, step: SolvedStep) -> bool:
        """Whether a branch leads to the end of a step. Collective."""
        assert branch.unknowns is not None
        off = branch.unknowns - step.after.unknowns
        way = step.after.unknowns - step.before.unknowns
        mine = np.array([np.dot(off, off), np.dot(way, way)])
        found = np.sqrt(self._stepper.problem.comm.allreduce(mine))
        return bool(found[0] <= _SAME * found[1])


def where_it_changes(stepper: Stepper, before: AcceptedState, after: AcceptedState) -> str:
    """Places whose status differs between two states, in words. Collective."""
    words: list[str] = []
    for s, old, new in zip(stepper.problem.surfaces, before.shown, after.shown, strict=True):
        names = letters(s.dim)
        here = old != new
        mine = [
            (tuple(x), str(names[a]), str(names[b]))
            for x, a, b in zip(s.positions[here].tolist(), old[here], new[here], strict=True)
        ]
        found: Sequence[tuple[tuple[float, ...], str, str]] = sorted(
            at for part in s.comm.allgather(mine) for at in part
        )
        shown = ", ".join(
            f"({', '.join(f'{c:.4g}' for c in x)}) {a} to {b}" for x, a, b in found[:_SHOWN]
        )
        more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
        if found:
            words.append(f"{s.name}: {shown}{more}")
    return "; ".join(words) or "all statuses are the same"
