# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a state jumps under a load that goes on smoothly.

A step may end in a solution that no path of solutions leads to: where a branch of the rate problem
folds or ends (Klarbring, Ing.-Arch. 60, 1990: one node, friction beyond a bound), the solver finds
the next one. What tells it from a step in which much happens is that the change does not shrink
with the step: halving after halving it is as large, in steps of no length.
"""

from __future__ import annotations

from collections.abc import Sequence

from dolfinx_contact.evolution.moment import Moment, Stepper, Taken, change
from dolfinx_contact.laws.status import letters
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["find_jump", "where_it_changes"]

_SPREAD = 0.5  # of the change of a step, at most, where it is no jump
_SHOWN = 5  # places


def find_jump(stepper: Stepper, step: Taken, least: float) -> list[Taken] | None:
    """The steps up to a jump within a step, the last of which is the jump. Collective.

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
    whole = change(comm, step.before, step.after)
    while change(comm, step.before, step.after) > _SPREAD * whole:
        a, b = step.before.time, step.after.time
        middle = 0.5 * (a + b)
        if b - a <= least or not a < middle < b:
            return [*path, step]
        try:
            first = stepper.take(step.before, middle, likely=(step.before.statuses, end))
            # The one half in which more happens.
            if 2 * change(comm, first.before, first.after) < change(comm, step.before, step.after):
                second = stepper.take(first.after, b, likely=(first.after.statuses, end))
                path.append(first)
                step = second
            else:
                step = first
        except ConvergenceError:
            return [*path, step]
    return None


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
