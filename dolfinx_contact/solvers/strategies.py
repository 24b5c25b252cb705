# SPDX-License-Identifier: LGPL-3.0-or-later
"""The strategies by which a contact problem is solved, in the order of the `ladder`.

What full steps, a line search and increments of the load do not need is loaded when it is tried.
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
#: Where Newton's method begins elsewhere than at the state of the caller: no more than tries.
STARTS = (EXTRAPOLATED, EXPECTED)
BONDS = "bonds released in turn"
INCREMENTS = "load increments"

_HELD = 1  # Newton steps in which expected statuses are held
_SMALLEST = 1e-4  # increment of the load, relative to the first

Monitor: TypeAlias = Callable[[Step], None] | None
#: Changes the unknowns to a solution, and is whether it found one.
Strategy: TypeAlias = Callable[[PETSc.Vec, Attempt, Monitor], bool]


@dataclass(frozen=True, eq=False)
class Trial:
    """How a solve begins, and how far it goes.

    Attributes:
        expected: statuses, the likeliest first.
        extrapolated: unknowns at which Newton's method begins before all else (owned); None:
            nowhere.
        brief: whether no more is tried than Newton's method with full steps, from all these and
            from the state of the caller. For steps that may be shorter.
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
    """Names and strategies in the order in which they are tried.

    Args:
        eq: the contact problem.
        linear: its linear solver.
        increments: of the load, to begin with.
        trial: how the solve begins, and how far it goes.
        start: the state of the caller, where it is known.
    """
    known = _Strategies(eq, linear, increments)
    # In the integral method r is a part of the discretisation: what is forced stays.
    weak = any(s.points.E is not None for s in eq.surfaces)

    def with_automatic_r(run: Strategy) -> Strategy:
        return run if weak else known.with_automatic_r(run)

    found: list[tuple[str, Strategy]] = []
    if trial.extrapolated is not None:
        found.append((EXTRAPOLATED, known.from_unknowns(trial.extrapolated)))
    found += [(EXPECTED, known.from_statuses(statuses)) for statuses in trial.expected]
    # What was tried before may have led elsewhere what is kept of faces that slide.
    found.append(("full steps", known.newton("none", None if found else start)))
    if trial.brief:
        return found
    if eq.forced_r is not None and not weak:
        found.append(("full steps with the automatic r", with_automatic_r(known.newton("none"))))
    if _have_bonds(eq):
        found.append((BONDS, with_automatic_r(known.releasing_bonds)))
    others: dict[str, Strategy] = {
        "pivoting": known.pivoting,
        "line search": known.newton("bt"),
        "Lemke's method": known.lemke,
        INCREMENTS: known.load_increments,
        "load following": known.load_following,
    }
    order = list(others)
    if not eq.linear:
        order = [INCREMENTS, "line search", "pivoting", "load following"]
    elif eq.dim == 3:
        order.remove("Lemke's method")
    return found + [(name, with_automatic_r(others[name])) for name in order]


@dataclass(frozen=True, eq=False)
class _Strategies:
    """Strategies for one problem.

    Attributes:
        eq: the contact problem.
        linear: its linear solver.
        increments: of the load, to begin with.
    """

    eq: ContactEquations
    linear: LinearSolverChoice
    increments: int

    def newton(self, line_search: str, start: Evaluated | None = None) -> Strategy:
        """Newton's method with a line search of PETSc, from a start that may be known."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            with Newton(self.eq, self.linear(), line_search, monitor) as solver:
                done = solver.run(x, attempt, start)
                stagnated = solver.stagnated
            if stagnated and self.linear.direct_instead():
                with Newton(self.eq, self.linear(), line_search, monitor) as solver:
                    done = solver.run(x, attempt)
            attempt.state = solver.state_at(x) if done else None
            return done

        return run

    def with_automatic_r(self, strategy: Strategy) -> Strategy:
        """A strategy with the automatic augmentation parameter, whatever is forced."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            with self.eq.scaling.automatic():
                done = strategy(x, attempt, monitor)
            attempt.state = None  # that is of another r
            return done

        return run

    def from_unknowns(self, unknowns: npt.NDArray[np.float64]) -> Strategy:
        """Newton's method from other unknowns."""

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
        """Newton's method whose first steps are taken with statuses held."""

        def run(x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
            start = x.copy()
            with Newton(self.eq, self.linear(), "none", monitor) as solver:
                solver.held = statuses
                solver.most = _HELD
                if not solver.run(x, attempt):
                    start.copy(x)
                solver.held = solver.most = None
                start.destroy()
                done = solver.run(x, attempt)
                attempt.state = solver.state_at(x) if done else None
                return done

        return run

    def load_increments(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """The load in increments that shrink and grow."""
        with Newton(self.eq, self.linear(), "none", monitor) as solver:
            return raise_load(solver, x, attempt, self.increments)

    def load_following(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """The branch of solutions under a growing load, through its folds."""
        from dolfinx_contact.solvers.following import follow_load

        with Newton(self.eq, self.linear(), "none", monitor) as solver:
            most = int(solver.snes.getTolerances()[3])
            followed = follow_load(self.eq, self.linear, x, attempt, most)
            return followed and solver.run(x, attempt)

    def pivoting(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """Piece after piece of H."""
        from dolfinx_contact.solvers.pivoting import pivot

        with Newton(self.eq, self.linear(), "none", monitor) as solver:
            return pivot(solver, x, attempt)

    def lemke(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """Lemke's method on the reduced problem."""
        from dolfinx_contact.solvers.classical import start_by_lemke

        with Newton(self.eq, self.linear(), "none", monitor) as solver:
            if solver.snes.getTolerances()[3] < 1:
                attempt.reason = "no convergence in 0 iterations"
                return False
            return start_by_lemke(self.eq, self.linear, x, attempt) and solver.run(x, attempt)

    def releasing_bonds(self, x: PETSc.Vec, attempt: Attempt, monitor: Monitor) -> bool:
        """Bonds that weaken are all held, and released in turn."""
        from dolfinx_contact.solvers.bonds import release_bonds

        return release_bonds(self.eq, self.linear, x, attempt)


def _have_bonds(eq: ContactEquations) -> bool:
    """Whether bonds of a surface weaken, and none of them can grow again."""
    if all(s.law.weakening is None for s in eq.surfaces):
        return False
    from dolfinx_contact.solvers.bonds import have_bonds

    return have_bonds(eq)


def raise_load(solver: Newton, x: PETSc.Vec, attempt: Attempt, increments: int) -> bool:
    """Apply the load in increments, as one would by hand, starting at ``x``. Collective.

    With s from 0 to 1 Dirichlet data go from the displacement at the start to what is prescribed,
    and what is left of H at the start fades, H(x, s) = (1 - s) H(x_0, 0): forces that nothing
    balances (the loads, from an unloaded body) and the depth of points that begin inside the
    obstacle. An increment that fails, or turns the body inside out, is quartered; one that works is
    doubled.
    """
    eq = solver.equations
    first = 1.0 / increments
    done = 0.0
    step = first
    good = x.duplicate()
    with eq.ramped(x):
        eq.prescribed.part = 0.0
        eq.residual(x, solver.offset)
        try:
            while done < 1.0:
                x.copy(good)
                solver.load = eq.prescribed.part = min(1.0, done + step)
                solved = solver.run(x, attempt)
                if solved and (objection := inverted(eq, x)):
                    solved = False
                    attempt.reason = objection
                if solved:
                    done = solver.load
                    step = 2 * step
                    continue
                good.copy(x)
                step /= 4
                if step < _SMALLEST * first or attempt.gives_up():
                    attempt.reason = f"stuck at {done:.4g} of the load: {attempt.reason}"
                    return False
            return True
        finally:
            good.destroy()
