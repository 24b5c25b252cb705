# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strategies for solving a contact problem, in the order in which the `ladder` tries them.

A strategy changes the unknowns and returns whether they are a solution; its arguments are always
unknowns, attempt and monitor. Modules that full steps, a line search and load increments do not
need are loaded when they are used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluated, Statuses
from dolfinx_contact.equations.validation import inverted
from dolfinx_contact.solvers.choice import LinearSolverChoice
from dolfinx_contact.solvers.history import Attempt, Step
from dolfinx_contact.solvers.newton import Newton

__all__ = ["BONDS", "EXTRAPOLATED", "INCREMENTS", "STARTS", "Trial", "raise_load", "strategies"]

EXTRAPOLATED = "extrapolation"
EXPECTED = "expected statuses"
#: Strategies that only begin elsewhere than at the state of the caller, and may well fail.
STARTS = (EXTRAPOLATED, EXPECTED)
BONDS = "bonds released in turn"
INCREMENTS = "load increments"

_HELD = 1  # Newton steps in which expected statuses are held
_SMALLEST = 1e-4  # smallest increment of the load, relative to the first one

Monitor: TypeAlias = Callable[[Step], None] | None
#: Function of unknowns, attempt and monitor that returns whether the unknowns are a solution.
Strategy: TypeAlias = Callable[[PETSc.Vec, Attempt, Monitor], bool]


@dataclass(frozen=True, eq=False)
class Trial:
    """Starts of a solve, and its extent.

    Attributes:
        expected: expected statuses, the likeliest first.
        extrapolated: owned unknowns at which Newton's method begins first; None: none.
        brief: whether to try only Newton's method with full steps, from these starts and from the
            state of the caller; for steps that may be shortened.
    """

    expected: Sequence[Statuses] = ()
    extrapolated: npt.NDArray[np.float64] | None = None
    brief: bool = False


def strategies(
    eq: ContactEquations,
    linear: LinearSolverChoice,
    increments: int,
    trial: Trial,
    start: Evaluated | None,
) -> list[tuple[str, Strategy]]:
    """Return names and strategies in the order in which they are tried.

    Args:
        eq: contact problem.
        linear: choice of its linear solver.
        increments: initial number of load increments.
        trial: starts of the solve, and its extent.
        start: evaluation at the state of the caller, if available.
    """
    ways = _Strategies(eq, linear, increments)
    listed: list[tuple[str, Strategy]] = []
    if trial.extrapolated is not None:
        listed.append((EXTRAPOLATED, ways.from_unknowns(trial.extrapolated)))
    listed += [(EXPECTED, ways.from_statuses(statuses)) for statuses in trial.expected]
    # An earlier strategy may have changed the candidates of sliding faces since ``start``.
    listed.append(("full steps", ways.newton("none", None if listed else start)))
    if trial.brief:
        return listed
    # In the integral method r is part of the discretisation, and a forced r is kept.
    weak = any(s.points.E is not None for s in eq.surfaces)
    fallbacks: list[tuple[str, Strategy]] = []
    if eq.forced_r is not None and not weak:
        fallbacks.append(("full steps with the automatic r", ways.newton("none")))
    if _have_bonds(eq):
        fallbacks.append((BONDS, ways.releasing_bonds))
    pivoting, line_search = ("pivoting", ways.pivoting), ("line search", ways.newton("bt"))
    load: list[tuple[str, Strategy]] = [
        (INCREMENTS, ways.load_increments),
        ("load following", ways.load_following),
    ]
    if not eq.linear:
        fallbacks += [load[0], line_search, pivoting, load[1]]
    else:
        fallbacks += [pivoting, line_search]
        fallbacks += [("Lemke's method", ways.lemke)] if eq.dim == 2 else []
        fallbacks += load
    if weak:
        return listed + fallbacks
    return listed + [(name, ways.with_automatic_r(strategy)) for name, strategy in fallbacks]


@dataclass(frozen=True, eq=False)
class _Strategies:
    """Strategies for one problem.

    Attributes:
        eq: contact problem.
        linear: choice of its linear solver.
        increments: initial number of load increments.
    """

    eq: ContactEquations
    linear: LinearSolverChoice
    increments: int

    def newton(self, line_search: str, start: Evaluated | None = None) -> Strategy:
        """Newton's method with a line search of PETSc, from an evaluation if available."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            with self._solver(monitor, line_search) as solver:
                done = solver.run(x, attempt, start)
                stagnated = solver.stagnated
            if stagnated and self.linear.direct_instead():
                with self._solver(monitor, line_search) as solver:
                    done = solver.run(x, attempt)
            return done

        return run

    def _solver(self, monitor: Monitor, line_search: str = "none") -> Newton:
        return Newton(self.eq, self.linear(), line_search, monitor)

    def with_automatic_r(self, strategy: Strategy) -> Strategy:
        """A strategy with the automatic augmentation parameter instead of a forced one."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            with self.eq.scaling.automatic():
                done = strategy(x, attempt, monitor)
            attempt.state = None  # evaluated with another r
            return done

        return run

    def from_unknowns(self, unknowns: npt.NDArray[np.float64]) -> Strategy:
        """Newton's method from given unknowns."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            x.array[:] = unknowns
            attempt.reason = inverted(self.eq, x)
            if attempt.reason:
                return False
            b = x.duplicate()
            start = Evaluated(unknowns, self.eq.residual(x, b))
            finite = np.isfinite(b.norm())
            b.destroy()
            if not finite:
                attempt.reason = "the residual is not finite there"
                return False
            return self.newton("none", start)(x, attempt, monitor)

        return run

    def from_statuses(self, statuses: Statuses) -> Strategy:
        """Newton's method whose first step holds given statuses."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            start = x.copy()
            with self._solver(monitor) as solver:
                if not solver.run(x, attempt, held=statuses, most=_HELD):
                    start.copy(x)
                start.destroy()
                return solver.run(x, attempt)

        return run

    def load_increments(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """Newton's method under a load in increments that shrink and grow."""
        with self._solver(monitor) as solver:
            return raise_load(solver, x, attempt, self.increments)

    def load_following(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """The branch of solutions under a growing load, through its folds."""
        from dolfinx_contact.solvers.following import follow_load

        with self._solver(monitor) as solver:
            followed = follow_load(self.eq, self.linear, x, attempt, solver.max_iterations)
            return followed and solver.run(x, attempt)

    def pivoting(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """The pieces of H, one after the other."""
        from dolfinx_contact.solvers.pivoting import pivot

        with self._solver(monitor) as solver:
            return pivot(solver, x, attempt)

    def lemke(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """Lemke's method on the reduced problem."""
        from dolfinx_contact.solvers.classical import start_by_lemke

        with self._solver(monitor) as solver:
            if solver.max_iterations < 1:
                attempt.reason = "no convergence in 0 iterations"
                return False
            return start_by_lemke(self.eq, self.linear, x, attempt) and solver.run(x, attempt)

    def releasing_bonds(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """Weakening bonds, all held and then released in turn."""
        from dolfinx_contact.solvers.bonds import release_bonds

        return release_bonds(self.eq, self.linear, x, attempt)


def _have_bonds(eq: ContactEquations) -> bool:
    """Return whether bonds of a surface weaken and none of them can grow again."""
    if all(s.law.weakening is None for s in eq.surfaces):
        return False
    from dolfinx_contact.solvers.bonds import have_bonds

    return have_bonds(eq)


def raise_load(solver: Newton, x: PETSc.Vec, attempt: Attempt, increments: int) -> bool:
    """Solve under a load in increments, starting at ``x``. Collective.

    With the load s from 0 to 1, Dirichlet data go from the displacement at the start to the data of
    the user, and the residual at the start fades, H(x, s) = (1 - s) H(x_0, 0). The residual
    contains unbalanced forces (the loads on an unloaded body) and the depth of points that begin
    inside the obstacle. An increment that fails or turns the body inside out is quartered; the
    increment after a successful one is doubled.

    Args:
        solver: Newton's method.
        x: start; receives the solution.
        attempt: attempt that records the iterates.
        increments: initial number of increments.
    """
    eq = solver.equations
    first = step = 1.0 / increments
    done = 0.0
    good, offset = x.duplicate(), x.duplicate()
    try:
        with eq.ramped(x):
            eq.prescribed.part = 0.0
            eq.residual(x, offset)
            while done < 1.0:
                x.copy(good)
                load = eq.prescribed.part = min(1.0, done + step)
                solved = solver.run(x, attempt, load=load, offset=offset)
                if solved and (objection := inverted(eq, x)):
                    solved = False
                    attempt.reason = objection
                if solved:
                    done = load
                    step = 2 * step
                    continue
                good.copy(x)
                step /= 4
                if step < _SMALLEST * first or attempt.gives_up():
                    attempt.reason = f"stuck at {done:.4g} of the load: {attempt.reason}"
                    return False
        attempt.state = None  # evaluated with ramped Dirichlet data
        return True
    finally:
        good.destroy(), offset.destroy()
