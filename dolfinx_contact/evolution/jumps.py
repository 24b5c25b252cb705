# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Changes of the state in a step, and jumps under a load that continues smoothly.

The change from a state a to a state b consists of

    moved      largest displacement of a node, a length
    unknowns   |x_b - x_a|, x all unknowns as lengths
    means      mean change |j_b - j_a| of the jump at the points of each surface, a length
    bonds      mean change of the variable by which the bonds of each surface weaken.

Where points move one after the other, such a mean over a time is the sum over its parts.

Where a branch of the rate problem folds or ends (Klarbring, Ing.-Arch. 60, 1990: one node, friction
beyond a bound), the solver finds a solution to which no path of solutions leads. Such a jump
differs from a large change in one step: halving the step does not reduce it. Changes with the load,
and faster changes after kinks, shrink with the step. `find_jump` searches a step by halves.

A change that does not shrink is not a proof, because the solver may have passed over a solution.
Therefore the branch of solutions is finally followed from the state (`step_branch`). A step that
was not solved is not a proof either: shorter steps are tried from the same state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import anywhere
from dolfinx_contact.equations.data import data_of_surface
from dolfinx_contact.evolution.energy import Forces
from dolfinx_contact.evolution.step import AcceptedState, Stepper
from dolfinx_contact.evolution.step_branch import StepBranch, branch_of_step
from dolfinx_contact.laws.status import letters
from dolfinx_contact.solvers import ConvergenceError

__all__ = ["Found", "StateChanges", "changes", "find_jump", "where_it_changes"]

Array = npt.NDArray[np.float64]

_SMALL = 0.1  # fraction of the change in a step below which a jump is not searched
_ROUND_OFF = 1e-6  # fraction of the largest change that counts as zero
_EVEN = 0.55  # largest fraction of the change of an even part that occurs in one of its halves
_NEAR = 0.5  # largest change, relative to the jump, in a step that continues the evolution
_SAME = 1e-4  # largest distance of equal solutions, relative to the change in a step
_SHORTER = 0.25  # length of the next step after a failed one, relative to the failed one
_SHOWN = 5  # largest number of places in a message


# -- changes ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StateChanges:
    """Changes from one state to another, see the top of the module.

    Attributes:
        parts: moved, unknowns, and, between states of equilibrium, the means and the bonds of all
            n surfaces, shape (2 + 2 n,).
        largest: largest change of the jump at a point of each surface, a length, shape (n,).
        broken: largest weakening of a bond of each surface, relative to the strength that the
            strongest bond had left; 0 where that is unknown, shape (n,).
    """

    parts: Array
    largest: Array
    broken: Array

    @property
    def unknowns(self) -> float:
        """Change of all unknowns, a length."""
        return float(self.parts[1])

    def rates(self, duration: float) -> Array:
        """Return the rates of the parts and the largest changes, shape (2 + 3 n,)."""
        return np.asarray(np.concatenate([self.parts, self.largest]) / duration)


def changes(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> StateChanges:
    """Measure the changes from one state to another. Collective."""
    d = b.unknowns - a.unknowns
    if not (isinstance(a.forces, Forces) and isinstance(b.forces, Forces)):
        size = math.sqrt(comm.allreduce(float(np.dot(d, d))))
        return StateChanges(np.array([0.0, size]), np.zeros(0), np.zeros(0))
    if a.forces.covered is not None and b.forces.covered is not None:
        d = d * np.minimum(a.forces.covered, b.forces.covered)
    n = len(b.forces.surfaces)
    sums = [np.array([np.dot(d, d)])]
    maxima = [np.array([np.abs(b.forces.u - a.forces.u).max(initial=0.0)])]
    for k in range(n):
        points = _at_points(a, b, k)
        sums.append(np.array([*points[:2].sum(axis=1), points.shape[1]]))
        maxima.append(points.max(axis=1, initial=0.0))
    square, *totals = comm.allreduce(np.concatenate(sums))
    moved, *most = comm.allreduce(np.concatenate(maxima), op=np.maximum)
    distances, weakened, number = np.reshape(totals, (n, 3)).T
    means = np.array([distances, weakened]) / np.maximum(number, 1.0)
    largest, lost, left = np.reshape(most, (n, 3)).T
    broken = np.divide(lost, left, out=np.zeros_like(left), where=left > 0)
    return StateChanges(np.array([moved, math.sqrt(square), *means.ravel()]), largest, broken)


def _at_points(a: AcceptedState, b: AcceptedState, k: int) -> Array:
    """Changes at the points of a surface that are not clamped, on this rank, shape (3, points).

    Rows: change of the jump; change of the variable by which bonds weaken; its distance to its end
    at the first state, which is the strength left.
    """
    assert isinstance(a.forces, Forces)
    assert isinstance(b.forces, Forces)
    eq = a.forces.equations
    s = eq.surfaces[k]
    distances = np.linalg.norm(b.forces.surfaces[k].jump - a.forces.surfaces[k].jump, axis=1)
    rows = np.zeros((3, len(distances)))
    rows[0] = distances
    bond = s.law.weakening
    if bond is not None:
        before = a.memory[k].fields[bond.name]
        end = bond.end
        if end is None:
            end = 0.0 if bond.sense < 0 else math.nan
        rows[1] = np.abs(b.memory[k].fields[bond.name] - before)
        rows[2] = np.nan_to_num(np.abs(end - before))
    return rows if s.method == "integral" else rows[:, ~eq.constraints.clamped[k][: rows.shape[1]]]


def where_it_changes(stepper: Stepper, before: AcceptedState, after: AcceptedState) -> str:
    """Name the places whose status differs between two states. Collective."""
    words: list[str] = []
    states = zip(before.shown, after.shown, strict=True)
    for s, (old, new) in zip(stepper.problem.surfaces, states, strict=True):
        names = letters(s.dim)
        differs = old != new
        local = [
            (tuple(x), str(names[a]), str(names[b]))
            for x, a, b in zip(
                s.positions[differs].tolist(), old[differs], new[differs], strict=True
            )
        ]
        places: list[tuple[tuple[float, ...], str, str]] = sorted(
            place for part in s.comm.allgather(local) for place in part
        )
        shown = ", ".join(
            f"({', '.join(f'{c:.4g}' for c in x)}) {a} to {b}" for x, a, b in places[:_SHOWN]
        )
        more = f" and {len(places) - _SHOWN} more" if len(places) > _SHOWN else ""
        if places:
            words.append(f"{s.name}: {shown}{more}")
    return "; ".join(words) or "all statuses are the same"


# -- jumps -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Found:
    """Result of the search of a step.

    Attributes:
        steps: ends of the steps that continue the evolution from the start of the step.
        far: end of a step from the last of `steps` in which the state jumps, so that its end does
            not approach its start as the step shrinks; None if the evolution continues.
        proved: whether it is proved that no path of solutions leads to `far`.
        failure: error of shorter steps from there; None if they were solved.
        why: facts about the solutions beyond the last of `steps`, for the message.
    """

    steps: Sequence[AcceptedState]
    far: AcceptedState | None = None
    proved: bool = False
    failure: ConvergenceError | None = None
    why: str = ""


def find_jump(
    stepper: Stepper, before: AcceptedState, after: AcceptedState, slow: Array, least: float
) -> Found | None:
    """Search a step in which the state changes suddenly for a jump. Collective.

    Halves are examined in turn, the earlier one first. A part does not contain a jump if the state
    changes in it slowly, by a small share of the change in the step, along a straight line, or
    evenly: by the same amount in each of its halves, and in the quarters if these are long enough.
    If a part of the shortest length remains, the branch of solutions decides.

    Args:
        stepper: stepper of the problem; the Functions are left in any state.
        before: state at the start of the step.
        after: state at its end.
        slow: rates of the parts of `StateChanges` up to which the state does not jump.
        least: shortest length of a step.

    Returns:
        None if the change of state is spread over the step.
    """
    return _Search(stepper, before, after, slow, least).look([before], after)


class _Search:
    """Search of a step; the arguments are those of `find_jump`."""

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
        at_points = [d.value for s in eq.surfaces for d in data_of_surface(s)]
        self._data = [*eq.bulk.stiffness_data, *at_points]

    def look(
        self, path: Sequence[AcceptedState], end: AcceptedState, even: bool = False
    ) -> Found | None:
        """Examine a part of the step.

        Args:
            path: solved states from the start of the whole step to the start of the part.
            end: state at the end of the part.
            even: whether the part is a half of an even part.
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
        """Return the result of a part one of whose halves was not solved. Collective."""
        if self._leads_to_end(path[-1], end):
            return None
        return Found(path[1:], end, failure=failure)

    def _change(self, before: AcceptedState, after: AcceptedState) -> Array:
        return changes(self._comm, before, after).parts

    def _is_elsewhere(
        self, second: AcceptedState, start: AcceptedState, end: AcceptedState
    ) -> bool:
        """Return whether the end of two halves replaces the end of the whole step. Collective.

        This is the case if the ends differ and the branch of the whole step does not lead to its
        end. Otherwise both ends are equally valid, because the path of friction and damage depends
        on the steps.

        Args:
            second: end of the second half.
            start: start of the whole step.
            end: its end.
        """
        much = np.maximum(_NEAR * self._change(start, end), self._small)
        different = self._change(second, end) > much
        return bool(different.any()) and not self._leads_to_end(start, end)

    def _leads_to_end(self, start: AcceptedState, end: AcceptedState) -> bool:
        """Return whether the branch of solutions from the start of a step leads to its end."""
        branch = branch_of_step(self._stepper, start, end.time)
        return branch.reaches_end and self._is_at(branch, start, end)

    def _is_at(self, branch: StepBranch, start: AcceptedState, end: AcceptedState) -> bool:
        """Return whether a branch leads to the end of a step. Collective."""
        assert branch.unknowns is not None
        off = branch.unknowns - end.unknowns
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
        if anywhere(self._comm, not same)[0]:
            return False
        return self._stepper.keeps(self._data, start.time, end.time)

    def _first(self, before: AcceptedState, time: float) -> AcceptedState | ConvergenceError:
        """Take the longest step towards a time that is solved; return the error if none is."""
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
        """Decide a step of the shortest length by the branch of solutions from its start.

        If the branch leads to the end of the step, the state does not jump. If it leads elsewhere,
        it is followed, up to the end of the searched step if possible.
        """
        start = path[-1]
        size = self._change(start, end)
        why = ""
        ends = False
        for time in dict.fromkeys((self._end.time, end.time)):
            branch = branch_of_step(self._stepper, start, time)
            why = branch.why
            ends = branch.ends
            if not branch.reaches_end:
                continue
            if time == end.time and self._is_at(branch, start, end):
                return None
            try:
                near = self._stepper.take(start, time, likely=(branch.statuses,))
            except ConvergenceError as error:
                return Found(path[1:], end, failure=error)
            if (self._change(start, near) <= np.maximum(_NEAR * size, self._small)).all():
                return Found([*path[1:], near])
            why = "solutions continue from the state, but no step led to them"
        return Found(path[1:], end, ends, why=why)
