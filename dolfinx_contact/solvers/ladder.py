# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solving a contact problem: Newton's method, and what is tried when full steps fail.

Full steps converge in a few iterations from nearly everywhere, but they can cycle between statuses.
Where the caller has unknowns that were extrapolated Newton's method begins there first. Where the
caller expects statuses, as those of the step before, the first Newton step is taken with these
held, and Newton's method continues from there: at the start of a step of an evolution every point
that slips is at the border of stick, and its own state does not tell. The
strategies, cheap ones first and each from the caller's state:

1. full Newton steps;
2. full steps with the automatic augmentation parameter, if the caller forced another;
   of surfaces with bonds that weaken then all these held in turn and released (`bonds.py`);
3. pivoting: the pieces of H are solved one after the other, and when the number of points with a
   wrong status stops shrinking only one point changes at a time (`pivoting.py`); last but one where
   the body is not linear, since every piece then takes a Newton solve of its own;
4. a backtracking line search on the norm of H;
5. Lemke's method on the reduced problem (`classical.py`), which ends in a solution whatever the
   friction: in 2D, for linear bodies held by Dirichlet data and contact at the nodes;
6. the load applied in increments that shrink and grow; before the line search where the body is
   not linear;
7. the branch of solutions under a growing load followed through its folds (`following.py`).

A trial that is brief, of a step that may be shorter, ends with the first of them. Each strategy but
the first has a budget, counted in Newton steps. A solution in which a hyperelastic body is turned
inside out (det F <= 0) is no answer as long as increments of the load find another.
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

#: Cost at which a strategy gives up, in Newton steps.
_LIMITS = {BONDS: 2000.0, "pivoting": 500.0, "line search": 80.0, INCREMENTS: 400.0}
_LATE = 2.0  # times the time that was predicted are worth a word in the log,
_SHORT = 1.0  # if they are more than so many seconds


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
        equations: the contact problem.
        linear: its linear solver.
        x0: start.
        monitor: called with every Newton iterate, on every rank.
        increments: of the load in the strategy of increments, to begin with.
        progress: shows where the solve is.
        trial: how it begins, and how far it goes.

    Returns:
        A solution, and the strategies that were tried, of which the last one found it.

    Raises:
        ValueError: on every rank, for data that cannot be solved with (a load that is not finite, a
            negative friction field, a clamped node inside the obstacle).
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
        # Nothing else was found: the result warns of it.
        attempts.append(Attempt(inverting, objection, converged=True))
        return turned, attempts
    if floating is not None and attempts[0].reason == str(floating):
        raise FloatingBodyError(str(floating), attempts)
    doubts = [_doubt_of_stiffness(equations), _doubt_of_kinks(equations)]
    raise ConvergenceError(_diagnosis(attempts, [d for d in doubts if d]), attempts)


def _log_failure(attempt: Attempt, *, floated: bool, brief: bool) -> None:
    """Log why a strategy failed; ``floated``: for the same rigid motion as one before."""
    if floated:
        logger.info("%s failed: a rigid motion is free there too", attempt.strategy)
    elif brief or attempt.strategy in STARTS:
        logger.info("%s failed: %s", attempt.strategy, attempt.reason)
    else:
        logger.warning("%s failed: %s", attempt.strategy, attempt.reason)


def _with_progress(
    progress: SolveProgress, monitor: Callable[[Step], None] | None
) -> Callable[[Step], None]:
    """The monitor of the caller, which may write where the line of progress was, and that line."""

    def tell(step: Step) -> None:
        progress.clear()
        if monitor is not None:
            monitor(step)
        progress.step(step)

    return tell


def _compare_with_prediction(linear: LinearSolverChoice, seconds: float) -> None:
    """Say in the log if a solve took much longer than was predicted."""
    solver = linear()
    root = solver.matrix.comm.tompi4py().rank == 0
    if root and seconds > max(_LATE * solver.predicted, _SHORT):
        logger.info("the solve took %.2g s; %.2g s were predicted", seconds, solver.predicted)


def _doubt_of_stiffness(eq: ContactEquations) -> str:
    """What is wrong with a linear body if its energy decreases with a strain. Collective."""
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


def _doubt_of_kinks(eq: ContactEquations) -> str:
    """A possible cause of non-convergence: a bulk that jumps where a kink changes sides."""
    if not eq.bulk.kinks:
        return ""
    return (
        f"the bulk has kinks in u, by {eq.bulk.kinks}: if its residual jumps there, it has in "
        "general no root, and friction or a threshold on a face must be a law of a contact surface "
        "instead, such as Tresca"
    )


def _diagnosis(attempts: list[Attempt], doubts: list[str]) -> str:
    lines = ["the contact problem was not solved:", *doubts]
    for a in attempts:
        worst = f", residual {a.steps[-1].measures.worst:.2g}" if a.steps else ""
        lines.append(f"- {a.strategy}: {a.reason} ({a.iterations} iterations{worst})")
        for name, places in a.restless.items():
            shown = "; ".join("(" + ", ".join(f"{c:.6g}" for c in x) + ")" for x in places)
            lines.append(f"  points of {name} that keep changing status, among them {shown}")
    lines.append("The displacement and the multipliers are as they were before the solve.")
    return "\n".join(lines)
