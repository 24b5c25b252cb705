# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solving a contact problem: Newton's method, and what is tried when full steps fail.

Full steps converge in a few iterations from nearly everywhere, but they can cycle between statuses.
The strategies, in this order and each from the caller's state:

1. full Newton steps;
2. full steps with the automatic augmentation parameter, if the caller forced another;
3. pivoting: the pieces of H are solved one after the other, and when the number of points with a
   wrong status stops shrinking only one point changes at a time (`pivoting.py`);
4. a backtracking line search on the norm of H;
5. the load applied in increments that shrink and grow: H(x) = (1 - s) H(x_0), s from 0 to 1;
6. the branch of H(x) = (1 - s) H(x_0) followed from s = 0 through its folds (`following.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._errors import require
from dolfinx_contact._petsc import staged
from dolfinx_contact._progress import SolveProgress
from dolfinx_contact.result import Result, collect
from dolfinx_contact.solvers.errors import ConvergenceError, FloatingBodyError
from dolfinx_contact.solvers.history import Attempt, Step
from dolfinx_contact.solvers.linear import direct_instead
from dolfinx_contact.solvers.newton import Newton
from dolfinx_contact.solvers.pivoting import pivot

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["solve"]

logger = logging.getLogger(__name__)

_LATE = 2.0  # times the time that was predicted are worth a word in the log,
_SHORT = 1.0  # if they are more than so many seconds


def solve(
    problem: ContactProblem,
    *,
    monitor: Callable[[Step], None] | None = None,
    increments: int = 8,
    progress: bool | None = None,
) -> Result:
    """Solve a contact problem from the present values of its Functions.

    Args:
        problem: the contact problem; its Functions receive the solution.
        monitor: called with every Newton iterate, on every rank.
        increments: of the load in the strategy of increments, to begin with.
        progress: whether rank 0 says on the standard error stream where the solve is; by default
            once it takes more than some seconds.

    Returns:
        Statuses, resultants, residual histories and the KKT violation.

    Raises:
        ValueError: on every rank, for data that cannot be solved with (a load that is not finite, a
            negative friction field, a clamped node inside the obstacle).
        ConvergenceError: if no strategy converges; the Functions are as they were.
    """
    said = SolveProgress(problem.comm, progress)
    x0 = problem.create_vector()
    problem.write(x0)
    before, statuses = [f.x.array.copy() for f in problem.fields], problem.statuses
    try:
        return _solve(problem, x0, monitor, increments, said)
    except BaseException:
        for f, values in zip(problem.fields, before, strict=True):
            f.x.array[:] = values
        problem.statuses = statuses
        raise
    finally:
        said.end()
        x0.destroy()


@staged("ContactSolve")
def _solve(
    problem: ContactProblem,
    x0: PETSc.Vec,
    monitor: Callable[[Step], None] | None,
    increments: int,
    progress: SolveProgress,
) -> Result:
    _check_data(problem, x0)
    attempts: list[Attempt] = []
    floating: FloatingBodyError | None = None
    x = x0.duplicate()
    try:
        for strategy, run in _ladder(problem, increments):
            attempt = Attempt(strategy)
            attempts.append(attempt)
            progress.strategy = strategy
            x0.copy(x)
            try:
                attempt.converged = run(x, attempt, _told(progress, monitor))
            except FloatingBodyError as error:
                attempt.reason, floating = str(error), error
            if attempt.converged:
                result = collect(problem, x, attempts)
                progress.end(sum(a.iterations for a in attempts))
                _compare_with_prediction(problem, progress.seconds)
                return result
            progress.clear()
            if problem.comm.rank == 0:
                logger.warning("%s failed: %s", strategy, attempt.reason)
    finally:
        x.destroy()
    if floating is not None and attempts[0].reason == str(floating):
        raise FloatingBodyError(str(floating), attempts)
    raise ConvergenceError(_diagnosis(attempts), attempts)


def _told(
    progress: SolveProgress, monitor: Callable[[Step], None] | None
) -> Callable[[Step], None]:
    """The monitor of the caller, which may write where the line of progress was, and that line."""

    def tell(step: Step) -> None:
        progress.clear()
        if monitor is not None:
            monitor(step)
        progress.step(step)

    return tell


def _compare_with_prediction(problem: ContactProblem, seconds: float) -> None:
    """Say in the log if a solve took much longer than was predicted."""
    predicted = problem.linear_solver.predicted
    if problem.comm.rank == 0 and seconds > max(_LATE * predicted, _SHORT):
        logger.info("the solve took %.2g s; %.2g s were predicted", seconds, predicted)


_Run = Callable[[PETSc.Vec, Attempt, Callable[[Step], None] | None], bool]


def _ladder(problem: ContactProblem, increments: int) -> list[tuple[str, _Run]]:
    """Strategies in the order in which they are tried."""

    def newton(line_search: str) -> _Run:
        def run(x: PETSc.Vec, attempt: Attempt, monitor: Any) -> bool:
            with Newton(problem, line_search, monitor) as solver:
                done, stagnated = solver.run(x, attempt), solver.stagnated
            if stagnated and direct_instead(problem):
                with Newton(problem, line_search, monitor) as solver:
                    done = solver.run(x, attempt)
            return done

        return run

    def with_automatic_r(run: _Run) -> _Run:
        def inner(x: PETSc.Vec, attempt: Attempt, monitor: Any) -> bool:
            with problem.automatic_augmentation():
                return run(x, attempt, monitor)

        return inner

    def by_increments(x: PETSc.Vec, attempt: Attempt, monitor: Any) -> bool:
        with Newton(problem, "none", monitor) as solver:
            return _follow_load(solver, x, attempt, increments)

    def by_following(x: PETSc.Vec, attempt: Attempt, monitor: Any) -> bool:
        from dolfinx_contact.solvers.following import follow_load

        with Newton(problem, "none", monitor) as solver:
            most = int(solver.snes.getTolerances()[3])
            return follow_load(problem, x, attempt, most) and solver.run(x, attempt)

    def by_pivoting(x: PETSc.Vec, attempt: Attempt, monitor: Any) -> bool:
        with Newton(problem, "none", monitor) as solver:
            return pivot(solver, x, attempt)

    ladder: list[tuple[str, _Run]] = [("full steps", newton("none"))]
    if problem.forced_r is not None:
        ladder.append(("full steps with the automatic r", with_automatic_r(newton("none"))))
    ladder.append(("pivoting", with_automatic_r(by_pivoting)))
    ladder.append(("line search", with_automatic_r(newton("bt"))))
    ladder.append(("load increments", with_automatic_r(by_increments)))
    ladder.append(("load following", with_automatic_r(by_following)))
    return ladder


def _follow_load(solver: Newton, x: PETSc.Vec, attempt: Attempt, increments: int) -> bool:
    """Raise the load from 0 to 1; an increment that fails is quartered, one that works doubled."""
    solver.problem.residual(x, solver.offset)
    done, step, good = 0.0, 1.0 / increments, x.duplicate()
    try:
        while done < 1.0:
            x.copy(good)
            solver.load = min(1.0, done + step)
            if solver.run(x, attempt):
                done, step = solver.load, 2 * step
            else:
                good.copy(x)
                step /= 4
                if step < 1e-4 / increments:
                    attempt.reason = f"stuck at {done:.4g} of the load: {attempt.reason}"
                    return False
        return True
    finally:
        good.destroy()


def _check_data(problem: ContactProblem, x0: PETSc.Vec) -> None:
    """Raise ``ValueError`` for data that no solver can work with. Collective."""
    for s in problem.surfaces:
        s.update_geometry()
        s.check_law()
        gaps = bool(np.isfinite(s.vertex_gaps).all() and np.isfinite(s.vertex_normals).all())
        require(problem.comm, gaps, f"{s.name}: the gap or normal of the obstacle is not finite")
    values = problem.constraints.values()
    prescribed = bool(np.isfinite(values[problem.constraints.fixed]).all())
    require(problem.comm, prescribed, "a Dirichlet value is not finite")
    problem.constraints.check_values(problem.surfaces, problem.body_size)
    b = problem.create_vector()
    problem.residual(x0, b)
    finite = bool(np.isfinite(b.array_r).all())
    b.destroy()
    require(
        problem.comm,
        finite,
        "the residual is not finite at the start: look for NaN in loads, material data or the "
        "starting displacement",
    )


def _diagnosis(attempts: list[Attempt]) -> str:
    lines = ["the contact problem was not solved:"]
    for a in attempts:
        worst = f", residual {a.steps[-1].measures.worst:.2g}" if a.steps else ""
        lines.append(f"- {a.strategy}: {a.reason} ({a.iterations} iterations{worst})")
        for name, places in a.restless.items():
            shown = "; ".join("(" + ", ".join(f"{c:.6g}" for c in x) + ")" for x in places)
            lines.append(f"  points of {name} that keep changing status, among them {shown}")
    lines.append("The displacement and the multipliers are as they were before the solve.")
    return "\n".join(lines)
