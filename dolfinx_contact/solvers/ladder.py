# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solve a contact problem: Newton's method with full steps, then fallback strategies.

Full steps converge in a few iterations from nearly everywhere, but they can cycle between statuses.
Newton's method begins at extrapolated unknowns if the caller has them. Then the first step may hold
expected statuses, such as those of the previous step of an evolution: at the start of a step every
slipping point is at the border of stick, and its own state does not determine its status. The
strategies, in this order and each from the caller's state:

1. Full Newton steps.
2. Full steps with the automatic augmentation parameter, if the caller forced another one; for
   surfaces with weakening bonds then all bonds held and released in turn (`bonds`).
3. Pivoting: the pieces of H are solved one after the other, and if the number of points with a
   wrong status stops shrinking only one point changes at a time (`pivoting`). For bodies that are
   not linear it comes last but one, because every piece then takes a Newton solve.
4. A backtracking line search on the norm of H.
5. Lemke's method on the reduced problem (`classical`), which terminates in a solution for any
   friction: in 2D, for linear bodies held by Dirichlet data with contact at nodes.
6. The load in increments that shrink and grow; before the line search for bodies that are not
   linear.
7. The branch of solutions under a growing load, followed through its folds (`following`).

A brief trial, for steps that may be shortened, ends with the first strategy. Each strategy but the
first has a budget in Newton steps. A solution in which a hyperelastic body is turned inside out
(det F <= 0) is only accepted if load increments find no other.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

from petsc4py import PETSc

from dolfinx_contact._petsc import staged
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.touching import bring_together
from dolfinx_contact.equations.validation import diverged, inverted, validate
from dolfinx_contact.solvers.choice import LinearSolverChoice
from dolfinx_contact.solvers.history import (
    Attempt,
    ConvergenceError,
    FloatingBodyError,
    SolveProgress,
    Step,
)
from dolfinx_contact.solvers.strategies import (
    BONDS,
    EXTRAPOLATED,
    INCREMENTS,
    STARTS,
    Trial,
    strategies,
)

__all__ = ["solve"]

logger = logging.getLogger(__name__)

#: Budgets of the strategies, in Newton steps.
_LIMITS = {BONDS: 2000.0, "pivoting": 500.0, "line search": 80.0, INCREMENTS: 400.0}
_LATE = 2.0  # ratio of the elapsed to the predicted time from which it is logged,
_SHORT = 1.0  # if the elapsed time exceeds so many seconds


@staged("ContactSolve")
def solve(
    equations: ContactEquations,
    linear: LinearSolverChoice,
    x0: PETSc.Vec,
    *,
    monitor: Callable[[Step], None] | None,
    increments: int,
    progress: SolveProgress,
    trial: Trial,
) -> tuple[PETSc.Vec, list[Attempt]]:
    """Solve a contact problem. Collective.

    Args:
        equations: contact problem.
        linear: choice of its linear solver.
        x0: start.
        monitor: function called with every Newton iterate, on every rank.
        increments: initial number of load increments.
        progress: progress line.
        trial: starts of the solve, and its extent.

    Returns:
        Solution, and attempts of the strategies, of which the last one succeeded.

    Raises:
        ValueError: on every rank, if data are not admissible (a load that is not finite, a negative
            friction field, a clamped node inside the obstacle).
        ConvergenceError: if no strategy converges.
    """
    start = validate(equations, x0)
    bring_together(equations, x0)
    attempts: list[Attempt] = []
    floating: FloatingBodyError | None = None
    x = x0.duplicate()
    turned = x0.duplicate()
    objection = ""
    inverting = ""
    for strategy, run in strategies(equations, linear, increments, trial, start):
        if objection and strategy != INCREMENTS and inverting != EXTRAPOLATED:
            continue
        attempt = Attempt(strategy, limit=_LIMITS.get(strategy, math.inf))
        attempts.append(attempt)
        progress.strategy = strategy
        floated = False
        x0.copy(x)
        try:
            attempt.converged = run(x, attempt, _with_progress(progress, monitor))
        except FloatingBodyError as error:
            floated = floating is not None
            attempt.reason = str(error)
            floating = error
        if attempt.converged and (reason := diverged(equations, x)):
            attempt.converged = False
            attempt.reason = reason
        if attempt.converged:
            objection = inverted(equations, x)
            if not objection:
                _compare_with_prediction(linear, progress.seconds)
                return x, attempts
            attempt.converged = False
            attempt.reason = objection
            inverting = strategy
            x.copy(turned)
        progress.clear()
        if equations.comm.rank == 0:
            _log_failure(attempt, floated=floated, brief=trial.brief)
    if objection and not trial.brief:
        # No other solution was found; the result contains a warning.
        attempts.append(Attempt(inverting, objection, converged=True))
        return turned, attempts
    if floating is not None and attempts[0].reason == str(floating):
        raise FloatingBodyError(str(floating), attempts)
    raise ConvergenceError(_diagnosis(equations, attempts), attempts)


def _log_failure(attempt: Attempt, *, floated: bool, brief: bool) -> None:
    """Log the failure of a strategy; ``floated``: an earlier one failed by the same motion."""
    if floated:
        logger.info("%s failed: a rigid motion is free there too", attempt.strategy)
    elif brief or attempt.strategy in STARTS:
        logger.info("%s failed: %s", attempt.strategy, attempt.reason)
    else:
        logger.warning("%s failed: %s", attempt.strategy, attempt.reason)


def _with_progress(
    progress: SolveProgress, monitor: Callable[[Step], None] | None
) -> Callable[[Step], None]:
    """Combine the monitor of the caller, which may write to the terminal, and the progress line."""

    def tell(step: Step) -> None:
        progress.clear()
        if monitor is not None:
            monitor(step)
        progress.step(step)

    return tell


def _compare_with_prediction(linear: LinearSolverChoice, seconds: float) -> None:
    """Log if a solve took much longer than predicted."""
    solver = linear()
    root = solver.matrix.comm.tompi4py().rank == 0
    if root and seconds > max(_LATE * solver.predicted, _SHORT):
        logger.info("the solve took %.2g s; %.2g s were predicted", seconds, solver.predicted)


def _suspicious_stiffness(eq: ContactEquations) -> str:
    """Return a message if the energy of a linear body decreases with a strain. Collective."""
    if not eq.bulk.linear:
        return ""
    diagonal = eq.bulk.stiffness(eq.bulk.displacement.x.array).getDiagonal()
    _, least = diagonal.min()
    _, largest = diagonal.max()
    diagonal.destroy()
    if not least < -1e-12 * max(abs(least), abs(largest)):
        return ""
    return (
        f"the stiffness of the body has negative diagonal entries (the least is {least:.3g}): its "
        "energy falls with a strain, look at its sign and its moduli"
    )


def _suspicious_kinks(eq: ContactEquations) -> str:
    """Return a message if the bulk has kinks, at which its residual may jump."""
    if not eq.bulk.kinks:
        return ""
    return (
        f"the bulk has kinks in u, by {eq.bulk.kinks}: if its residual jumps there, it has in "
        "general no root, and friction or a threshold on a face must be a law of a contact surface "
        "instead, such as Tresca"
    )


def _diagnosis(eq: ContactEquations, attempts: list[Attempt]) -> str:
    """Return the message of a failed solve: possible causes, and the attempts. Collective."""
    causes = [_suspicious_stiffness(eq), _suspicious_kinks(eq)]
    lines = ["the contact problem was not solved:", *filter(None, causes)]
    for a in attempts:
        worst = f", residual {a.steps[-1].measures.worst:.2g}" if a.steps else ""
        lines.append(f"- {a.strategy}: {a.reason} ({a.iterations} iterations{worst})")
        for name, places in a.restless.items():
            shown = "; ".join("(" + ", ".join(f"{c:.6g}" for c in x) + ")" for x in places)
            lines.append(f"  points of {name} that keep changing status, among them {shown}")
    lines.append("The displacement and the multipliers are as they were before the solve.")
    return "\n".join(lines)
