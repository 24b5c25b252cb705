# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Cycles of loads on contact points, step by step, until they come to rest or repeat.

Implicit steps: with the slips w at their start, the displacements a and forces r at their end
solve S a = r + p, un >= 0 against rn >= 0, and friction's law with the slip ut - w of the step
(`PointProblem`, shifted). A step begins with the statuses of the one before; where these do not
lead to a solution Lemke's method finds one in the plane, and Gauss-Seidel's in space.

A cycle in which no closed point has slipped, opened or closed is one of rest, for ever: at its
corners the same state holds again, and between them everything is convex. (Points may also open and
close without a slip, which is rest as far as steps tell; points without friction slide freely,
which is no slip.) If displacements repeat, with slip,
friction dissipates the same work in every cycle (alternating slip); if they grow by the same in
each, it is ratcheting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.gauss_seidel import GaussSeidel
from dolfinx_contact.algorithms.lemke import coulomb_by_lemke
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.algorithms.semismooth import newton_step

__all__ = ["CycleEnding", "LoadCycles", "step_cycles"]

Array = npt.NDArray[np.float64]
CycleEnding: TypeAlias = Literal["rest", "alternating slip", "ratcheting", "not decided"]

_SOLVED = 1e-11  # measure of a step
_NEWTON = 20  # steps of Newton's method
_NOTHING = 1e-9  # of the force, normal forces that are none
_STILL = 1e-9  # of the length, slips in a cycle that are none
_REPEATS = 1e-8  # of the change in a cycle, by which the next may differ


@dataclass(frozen=True, eq=False)
class LoadCycles:
    """What became of cycles from one start.

    Attributes:
        start: in words.
        factor: of the loads.
        ending: "rest", "alternating slip", "ratcheting", or "not decided" after the last cycle.
        dissipation: work of friction in every cycle.
        slid: the largest slip of a step in the last cycle, of points with friction.
        lifts: whether a point opened or closed in the last cycle.
        loads: of the steps of the last cycle (n, dim m).
        before: displacements at which it begins (m, dim).
        displacements: at the ends of its steps (n, m, dim).
        forces: the same.
    """

    start: str
    factor: float
    ending: CycleEnding
    dissipation: Array
    slid: float
    lifts: bool
    loads: Array
    before: Array
    displacements: Array
    forces: Array

    @property
    def number(self) -> int:
        """Of cycles that were stepped through."""
        return len(self.dissipation)

    def __str__(self) -> str:
        """Start, ending, and work of friction in the last cycle."""
        work = f"{self.dissipation[-1]:.4g} dissipated in the last"
        lifts = ", points open and close" if self.lifts else ""
        ends = f"{self.ending} in cycle {self.number}"
        return f"{self.start}: {ends}, {work}{lifts}"


def step_cycles(
    points: PointProblem,
    loads: Array,
    first: tuple[Array, Array],
    *,
    start: str,
    factor: float,
    cycles: int,
) -> LoadCycles:
    """Step through cycles of loads.

    Args:
        points: stiffness and laws.
        loads: of the steps of a cycle (n, dim m), the last the load of its start.
        first: displacements and forces at the start, (m, dim) each.
        start: in words.
        factor: of the loads, for the record.
        cycles: the most.

    Raises:
        RuntimeError: if a step finds no solution.
    """
    length = max(float(np.abs(np.linalg.solve(points.S, p)).max()) for p in loads)
    force = float(np.abs(loads).max())
    a, r = first
    work: list[float] = []
    change = np.full_like(a, np.inf)
    ending: CycleEnding = "not decided"
    while len(work) < cycles and ending == "not decided":
        before = a
        states, dissipated, slid, lifts = _cycle(points, loads, (a, r), force, length)
        work.append(dissipated)
        a, r = states[-1]
        ending = _ending(before, a, change, slid, length)
        change = a - before
    displacements = np.array([state[0] for state in states])
    forces = np.array([state[1] for state in states])
    return LoadCycles(
        start,
        factor,
        ending,
        np.array(work),
        slid,
        lifts,
        loads,
        before,
        displacements,
        forces,
    )


def _ending(before: Array, a: Array, change: Array, slid: float, length: float) -> CycleEnding:
    if slid <= _STILL * length:
        return "rest"
    moved = a - before
    if np.abs(moved).max() <= _REPEATS * slid:
        return "alternating slip"
    if np.abs(moved - change).max() <= _REPEATS * np.abs(moved).max():
        return "ratcheting"
    return "not decided"


def _cycle(
    points: PointProblem, loads: Array, state: tuple[Array, Array], force: float, length: float
) -> tuple[list[tuple[Array, Array]], float, float, bool]:
    """States of the steps, the work of friction, the largest slip, and whether contact changed."""
    states = []
    dissipated = 0.0
    slid = 0.0
    none = _NOTHING * force
    was = state[1][:, -1] > none
    lifts = False
    last = np.zeros_like(state[0])
    for p in loads:
        a0, r0 = state
        state, last = _step(points, p, a0, r0, last, force, length)
        a, r = state
        slip = (a - a0)[:, :-1]
        now = r[:, -1] > none
        rubs = (now & (points.friction > 0)) | (points.bound > 0)
        dissipated -= float(np.sum(r[:, :-1] * slip))
        slid = max(slid, float(np.abs(slip[rubs]).max(initial=0.0)))
        lifts |= bool((now != was).any())
        was = now
        states.append(state)
    return states, dissipated, slid, lifts


def _step(
    points: PointProblem,
    p: Array,
    a0: Array,
    r0: Array,
    last: Array,
    force: float,
    length: float,
) -> tuple[tuple[Array, Array], Array]:
    """The state under a load, and what its points have slipped, beside their gaps (m, dim)."""
    slips = a0.copy()
    slips[:, -1] = 0.0
    shifted = replace(
        points,
        p=p - points.S @ slips.reshape(-1),
        S_error=None,
        p_error=None,
        force=force,
        length=length,
    )
    found = _by_newton(shifted, last, r0, force, length) or _by_algorithm(
        shifted, r0, force, length
    )
    a, r = found
    return (a + slips, r), a


def _by_newton(
    shifted: PointProblem, a: Array, r: Array, force: float, length: float
) -> tuple[Array, Array] | None:
    for _ in range(_NEWTON):
        try:
            a, r = newton_step(shifted, a, r)
        except np.linalg.LinAlgError:
            return None
        if shifted.measure(a, r, force, length).worst <= _SOLVED:
            return a, r
    return None


def _by_algorithm(
    shifted: PointProblem, r: Array, force: float, length: float
) -> tuple[Array, Array]:
    if shifted.dim == 2:
        state, _ = coulomb_by_lemke(shifted.S, shifted.p, shifted.friction, bound=shifted.bound)
        return state[:, :2], state[:, 2:]
    found = GaussSeidel(max_iterations=20_000).run(shifted, tolerance=_SOLVED, start=r)
    if not found.converged:
        raise RuntimeError(f"a step of a load cycle has no solution: {found.reason}")
    return found.a, found.r
