# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a state jumps under a load that goes on smoothly.

A step may end in a solution that no path of solutions leads to: where a branch of the rate problem
folds or ends (Klarbring, Ing.-Arch. 60, 1990: one node, friction beyond a bound), the solver finds
the next one. What tells it from a step in which much happens is that the change does not shrink
with the step: halving after halving it is as large, in steps of no length.

That is no proof: the solver may have passed over a solution. So in the end the branch of solutions
is followed from the state (`step_branch`). Nor is it a proof that a step was not solved: then
shorter ones are tried from the same state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dolfinx_contact.equations.state import Statuses
from dolfinx_contact.evolution.moment import Moment, Stepper, Taken, change
from dolfinx_contact.evolution.step_branch import branch_of_step
from dolfinx_contact.laws.status import letters
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["Found", "find_jump", "where_it_changes"]

_SPREAD = 0.5  # of the change of a step, at most, where it is no jump
_SHORTER = 0.25  # of a step that was not solved, the next
_SHOWN = 5  # places


@dataclass(frozen=True)
class Found:
    """What a closer look at a step has found.

    Attributes:
        steps: that lead on from its start.
        far: from the end of these, a step whose end is far however short it is; None if the
            evolution goes on from there as ever.
        proved: whether it is proved that no solution continues the evolution where it begins.
        failure: why shorter steps from there were not solved; None if they were.
        why: what is known of the solutions beyond, in words.
    """

    steps: Sequence[Taken]
    far: Taken | None = None
    proved: bool = False
    failure: ConvergenceError | None = None
    why: str = ""


def find_jump(stepper: Stepper, step: Taken, least: float) -> Found | None:
    """Look closer at a step that changes the state suddenly. Collective.

    Args:
        stepper: takes the steps; the problem is left anywhere.
        step: that is looked at.
        least: length of a step in which the state only jumps.

    Returns:
        None if the change of state is spread over the step.
    """
    path: list[Taken] = []
    end = step.after.statuses
    comm = stepper.problem.comm
    whole, aim = change(comm, step.before, step.after), step.after.time
    while change(comm, step.before, step.after) > _SPREAD * whole:
        a, b = step.before.time, step.after.time
        middle = 0.5 * (a + b)
        if b - a <= least or not a < middle < b:
            return _at_last(stepper, path, step, aim)
        first = _first(stepper, step.before, middle, end, least)
        if isinstance(first, ConvergenceError):
            return Found(path, step, failure=first)
        # The one part in which more happens.
        if 2 * change(comm, first.before, first.after) >= change(comm, step.before, step.after):
            step = first
            continue
        if first.after.time < middle:
            return Found([*path, first])
        second = _first(stepper, first.after, b, end, least)
        if isinstance(second, ConvergenceError):
            return Found(path, step, failure=second)
        path.append(first)
        if second.after.time < b:
            return Found([*path, second])
        step = second
    return None


def _first(
    stepper: Stepper, before: Moment, time: float, end: Statuses | None, least: float
) -> Taken | ConvergenceError:
    """The longest step towards a time that is solved; why none is, down to the least length."""
    while True:
        try:
            return stepper.take(before, time, likely=(before.statuses, end))
        except ConvergenceError as error:
            failure = error
        length = _SHORTER * (time - before.time)
        if length < least or not before.time < before.time + length < time:
            return failure
        time = before.time + length


def _at_last(stepper: Stepper, path: list[Taken], step: Taken, aim: float) -> Found:
    """What the solutions that lead on from the start of a least step say of its end.

    If they lead on they are gone along, as far as the time that was aimed at if that is possible.
    """
    comm, far = stepper.problem.comm, change(stepper.problem.comm, step.before, step.after)
    why, ends = "", False
    for time in dict.fromkeys((aim, step.after.time)):
        branch = branch_of_step(stepper, step.before, time)
        why, ends = branch.why, branch.ends
        if not branch.goes_on:
            continue
        try:
            near = stepper.take(step.before, time, likely=(branch.statuses,))
        except ConvergenceError as error:
            return Found(path, step, failure=error)
        if change(comm, near.before, near.after) <= _SPREAD * far:
            return Found([*path, near])
        why = "solutions lead on from the state, but no step led to them"
    return Found(path, step, ends, why=why)


def where_it_changes(stepper: Stepper, before: Moment, after: Moment) -> str:
    """Places whose status differs between two moments, in words. Collective."""
    words: list[str] = []
    for s, old, new in zip(stepper.problem.surfaces, before.shown, after.shown, strict=True):
        names, here = letters(s.dim), old != new
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
