# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Time stepping of load cycles on contact points until the response comes to rest or repeats.

Each step is implicit. With the slips w at the start of a step, the displacements a and forces r at
its end solve S a = r + p with the stiffness S and the load p, the unilateral conditions, and the
friction law with the slip increment ut - w (a shifted `PointProblem`). Newton's method starts from
the previous step. If it fails, Lemke's method is used in the plane and Gauss-Seidel in space.

After a cycle in which no point with friction has slipped, and no point has opened or closed, the
points remain at rest: the same states satisfy the equations in the next cycle, by convexity also
between the corners of the cycle. Sliding of frictionless points does not count as slip. If
displacements repeat with slip, friction dissipates the same work in every cycle (alternating slip).
If they grow by the same amount in each cycle, the response is ratcheting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.algorithms.gauss_seidel import GaussSeidel
from dolfinx_contact.algorithms.lemke import coulomb_by_lemke
from dolfinx_contact.algorithms.semismooth import newton_step
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["CycleEnding", "LoadCycles", "one_solution", "step_cycles"]

#: Displacements and forces, each of shape (m, dim).
State = tuple[Array, Array]
CycleEnding: TypeAlias = Literal["rest", "alternating slip", "ratcheting", "not decided"]

_SOLVED = 1e-11  # measure of a converged step
_NEWTON = 20  # largest number of Newton steps
_NOTHING = 1e-9  # normal force that counts as zero, relative to the force
_STILL = 1e-9  # slip in a cycle that counts as zero, relative to the length
_REPEATS = 1e-8  # relative difference of repeating cycles


@dataclass(frozen=True, eq=False)
class LoadCycles:
    """Result of load cycles from one initial state.

    Attributes:
        start: name of the initial state.
        factor: load factor.
        ending: behaviour found after the last cycle: "rest", "alternating slip", "ratcheting" or
            "not decided".
        dissipation: frictional dissipation of every cycle.
        slid: largest slip increment of a step in the last cycle, at points with friction.
        lifts: whether a point opened or closed in the last cycle.
        displacements: displacements of the m points after each of the n steps of the last cycle,
            shape (n, m, dim).
        forces: forces after each step of the last cycle, shape (n, m, dim).
    """

    start: str
    factor: float
    ending: CycleEnding
    dissipation: Array
    slid: float
    lifts: bool
    displacements: Array
    forces: Array

    @property
    def number(self) -> int:
        """Number of cycles."""
        return len(self.dissipation)

    def __str__(self) -> str:
        """Return the initial state, `ending`, and the frictional dissipation of the last cycle."""
        work = f"{self.dissipation[-1]:.4g} dissipated in the last"
        lifts = ", points open and close" if self.lifts else ""
        ends = f"{self.ending} in cycle {self.number}"
        return f"{self.start}: {ends}, {work}{lifts}"


def step_cycles(
    points: PointProblem, loads: Array, first: State, *, start: str, factor: float, cycles: int
) -> LoadCycles:
    """Step through load cycles until the response comes to rest or repeats.

    Args:
        points: contact points with their stiffness and laws.
        loads: loads at the n steps of a cycle on m points, shape (n, dim m); the last one is also
            the load at the start of the cycle.
        first: displacements and forces at the start, shape (m, dim) each.
        start: name of the initial state, stored in the result.
        factor: load factor, stored in the result.
        cycles: largest number of cycles.

    Raises:
        RuntimeError: if no solution of a step is found.
    """
    stepper = _Stepper(points, loads)
    state = first
    change = np.full_like(first[0], np.inf)
    work: list[float] = []
    ending: CycleEnding = "not decided"
    while len(work) < cycles and ending == "not decided":
        before = state[0]
        states, dissipated, slid, lifts = stepper.cycle(state)
        work.append(dissipated)
        state = states[-1]
        moved = state[0] - before
        if slid <= _STILL * stepper.length:
            ending = "rest"
        elif np.abs(moved).max() <= _REPEATS * slid:
            ending = "alternating slip"
        elif np.abs(moved - change).max() <= _REPEATS * np.abs(moved).max():
            ending = "ratcheting"
        change = moved
    displacements, forces = (np.array(v) for v in zip(*states, strict=True))
    return LoadCycles(
        start,
        factor,
        ending,
        np.array(work),
        slid,
        lifts,
        displacements,
        forces,
    )


class _Stepper:
    """Time stepper for load cycles, with scales of force and length."""

    def __init__(self, points: PointProblem, loads: Array):
        self.points = points
        self.loads = loads
        self.length = max(float(np.abs(np.linalg.solve(points.S, p)).max()) for p in loads)
        self.force = float(np.abs(loads).max())

    def cycle(self, state: State) -> tuple[list[State], float, float, bool]:
        """Step through one cycle.

        Returns:
            States after each step, frictional dissipation, largest slip increment, and whether a
            point opened or closed.
        """
        points = self.points
        states = []
        dissipated = slid = 0.0
        lifts = False
        was = state[1][:, -1] > _NOTHING * self.force
        last = np.zeros_like(state[0])
        for p in self.loads:
            before = state[0]
            state, last = self._step(p, state, last)
            a, r = state
            slip = (a - before)[:, :-1]
            now = r[:, -1] > _NOTHING * self.force
            rubs = (now & (points.friction > 0)) | (points.bound > 0)
            dissipated -= float(np.sum(r[:, :-1] * slip))
            slid = max(slid, float(np.abs(slip[rubs]).max(initial=0.0)))
            lifts |= bool((now != was).any())
            was = now
            states.append(state)
        return states, dissipated, slid, lifts

    def _step(self, p: Array, state: State, last: Array) -> tuple[State, Array]:
        """Return the state at the end of a step, and its slip increments and gaps, shape (m, dim).

        Args:
            p: load, shape (dim m,).
            state: state at the start of the step.
            last: slip increments and gaps of the previous step, shape (m, dim).
        """
        slips = state[0].copy()
        slips[:, -1] = 0.0
        shifted = replace(
            self.points,
            p=p - self.points.S @ slips.reshape(-1),
            S_error=None,
            p_error=None,
            force=self.force,
            length=self.length,
        )
        a, r = self._by_newton(shifted, last, state[1]) or one_solution(
            shifted, "a step of a load cycle has no solution", state[1]
        )
        return (a + slips, r), a

    def _by_newton(self, shifted: PointProblem, a: Array, r: Array) -> State | None:
        for _ in range(_NEWTON):
            try:
                a, r = newton_step(shifted, a, r)
            except np.linalg.LinAlgError:
                return None
            if shifted.measure(a, r, self.force, self.length).worst <= _SOLVED:
                return a, r
        return None


def one_solution(problem: PointProblem, message: str, start: Array | None = None) -> State:
    """Return displacements and forces by Lemke's method (2D) or Gauss-Seidel (3D).

    Args:
        problem: reduced problem.
        message: beginning of the error message.
        start: initial forces for Gauss-Seidel, shape (m, dim); zero by default.

    Raises:
        RuntimeError: if Gauss-Seidel does not converge.
    """
    if problem.dim == 2:
        w, _ = coulomb_by_lemke(problem.S, problem.p, problem.friction, bound=problem.bound)
        return w[:, :2], w[:, 2:]
    outcome = GaussSeidel(max_iterations=20_000).run(problem, tolerance=_SOLVED, start=start)
    if not outcome.converged:
        raise RuntimeError(f"{message}: {outcome.reason}")
    return outcome.a, outcome.r
