# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solve a contact problem: Newton's method with full steps, then fallback strategies.

Full steps converge in a few iterations from nearly everywhere, but they can cycle between statuses.
Newton's method begins at extrapolated unknowns if the caller has them. Then the first step may use
expected statuses, such as those of the previous step of an evolution: at the start of a step every
slipping point is at the border of stick, so that the unknowns do not determine its status. The
strategies, in this order and each from the caller's state:

1. Full Newton steps.
2. Full steps with the automatic augmentation parameter, if the caller forced another one; then, for
   surfaces with weakening bonds, all bonds are frozen and released in turn (`bonds`).
3. Pivoting: the pieces of H are solved successively, and if the number of points with a wrong
   status stops shrinking only one point changes at a time (`block_pivoting`). For bodies that are
   not linear it comes last but one, because every piece then takes a Newton solve.
4. A backtracking line search on the norm of H.
5. Lemke's method on the reduced problem (`classical`), which terminates in a solution for any
   friction: in 2D, for linear bodies fixed by Dirichlet data with contact at nodes.
6. The load in increments that shrink and grow; before the line search for bodies that are not
   linear.
7. The branch of solutions while the load grows, followed through its folds (`load_following`); not
   if a rigid motion is free under the full load and under increments.

The modules of the other strategies are loaded when full steps fail.

A brief trial (`Trial.brief`) ends after the first strategy; it is used for steps that may be
shortened. Each strategy but the first has a budget in Newton steps. A solution in which a
hyperelastic body is turned inside out (det F <= 0) is only accepted if load increments find no
other.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import everywhere
from dolfinx_contact._petsc import destroy, staged
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, Statuses
from dolfinx_contact.equations.measures import diverged, inverted
from dolfinx_contact.equations.touching import bring_together
from dolfinx_contact.equations.validation import validate
from dolfinx_contact.solvers.attempts import (
    Attempt,
    ConvergenceError,
    FloatingBodyError,
    SolveProgress,
    Step,
    unsolved,
)
from dolfinx_contact.solvers.linear import LinearSolverChoice
from dolfinx_contact.solvers.newton import Newton

__all__ = ["Trial", "solve"]

logger = logging.getLogger(__name__)

_EXTRAPOLATED = "extrapolation"
_INCREMENTS = "load increments"
_FOLLOWING = "load following"
_SMALLEST = 1e-4  # smallest increment of the load, relative to the first one


@dataclass(frozen=True, eq=False)
class Trial:
    """Starting points of a solve, and whether it may use all strategies.

    Attributes:
        expected: expected statuses, most likely first.
        extrapolated: owned unknowns from which Newton's method starts first; None if there are
            none.
        brief: whether to try only Newton's method with full steps, from these starting points and
            from the state of the caller; used for steps that may be shortened.
    """

    expected: Sequence[Statuses] = ()
    extrapolated: Array | None = None
    brief: bool = False


@staged("ContactSolve")
def solve(
    equations: ContactEquations,
    linear: LinearSolverChoice,
    x0: PETSc.Vec,
    *,
    increments: int,
    progress: SolveProgress,
    trial: Trial,
) -> tuple[PETSc.Vec, list[Attempt]]:
    """Solve a contact problem, trying one strategy after another. Collective.

    Args:
        equations: contact problem.
        linear: linear solver of the problem, created when it is first needed.
        x0: unknowns at the start.
        increments: initial number of load increments.
        progress: monitor and progress line.
        trial: starting points of the solve, and whether only full Newton steps are tried.

    Returns:
        Unknowns of the solution, and attempts of the strategies, of which the last one succeeded.

    Raises:
        ValueError: on every rank, if data are not admissible (a load that is not finite, a negative
            friction field, a clamped node inside the obstacle).
        ConvergenceError: if no strategy converges.
    """
    start = validate(equations, x0)
    with everywhere(equations.comm, "PETSc options"):
        equations.options.check()
    bring_together(equations, x0)
    attempts: list[Attempt] = []
    x = x0.duplicate()
    # the last solution in which the body is turned inside out, and its attempt
    turned: PETSc.Vec | None = None
    inverting: Attempt | None = None
    solution: PETSc.Vec | None = None
    failed = False  # whether an iterative solver chosen by options failed
    try:
        for strategy in strategies(equations, trial, increments, start):
            name = strategy.name
            if _would_fail(name, attempts, inverting):
                continue
            # run the strategy from the start
            attempt = Attempt(name, limit=strategy.limit)
            attempts.append(attempt)
            progress.strategy = name
            x0.copy(x)
            with suppress(FloatingBodyError):
                attempt.converged = strategy.solve(equations, linear, progress.step, x, attempt)
            # refuse a body that has drifted away, and inverted cells
            if attempt.converged:
                drift = diverged(equations, x)
                objection = drift or inverted(equations, x)
                if not objection:
                    solution = x
                    return solution, attempts
                attempt.converged = False
                attempt.reason = objection
                if not drift:
                    inverting = attempt
                    destroy(turned)
                    turned = x.copy()
            progress.clear()
            failed = attempt.linear_solver_failed and linear().iterates_on_request
            if failed:
                break  # systems of other strategies are like these
            if equations.comm.rank == 0:
                # The error of a failed solve lists all attempts; a later success is not doubtful.
                logger.info("%s failed: %s", name, attempt.reason)
        if inverting and not trial.brief:
            # No other solution was found; the result contains a warning.
            attempts.append(Attempt(inverting.strategy, inverting.reason, converged=True))
            solution = turned
            return solution, attempts
        if attempts[0].floats:
            raise FloatingBodyError(attempts[0].reason, attempts)
        causes = _causes(equations, failed=failed)
        raise ConvergenceError(unsolved(attempts, causes), attempts)
    finally:
        destroy(*(v for v in (x, turned) if v is not solution))


def _would_fail(name: str, attempts: Sequence[Attempt], inverting: Attempt | None) -> bool:
    """Return whether a strategy would fail for the same reason as an earlier one.

    Args:
        name: name of the strategy.
        attempts: attempts of the strategies before it.
        inverting: attempt whose solution turns the body inside out; None if there is none.
    """
    if name == _FOLLOWING:  # its branch begins where nothing holds the body
        increments = any(a.floats for a in attempts if a.strategy == _INCREMENTS)
        if increments and attempts[0].floats:
            return True
    inverted_again = inverting is not None and inverting.strategy != _EXTRAPOLATED
    return inverted_again and name != _INCREMENTS


def _causes(eq: ContactEquations, *, failed: bool) -> list[str]:
    """Return possible causes of a failed solve. Collective.

    ``failed`` indicates a failure of an iterative solver chosen by options, which ended the solve.
    """
    lines = []
    if eq.bulk.linear:
        diagonal = eq.bulk.stiffness(eq.bulk.displacement.x.array).getDiagonal()
        (_, least), (_, largest) = diagonal.min(), diagonal.max()
        diagonal.destroy()
        if least < -1e-12 * max(abs(least), abs(largest)):
            lines.append(
                f"the stiffness of the body has negative diagonal entries (the least is "
                f"{least:.3g}): its energy falls with a strain, look at its sign and its moduli"
            )
    if eq.bulk.kinks:
        lines.append(
            f"the bulk has kinks in u, by {eq.bulk.kinks}: if its residual jumps there, it has in "
            "general no root, and friction or a threshold on a face must be a law of a contact "
            "surface instead, such as Tresca"
        )
    if failed:
        lines.append(
            "the iterative solver chosen by the options failed, and no further strategy was tried: "
            "the Jacobian is indefinite and not symmetric; leave out ksp_type and pc_type, or use "
            "linear_solver='amg'"
        )
    return lines


# -- strategies ------------------------------------------------------------------------------------


#: Function of Newton's method, unknowns and attempt that changes the unknowns and returns whether
#: they are a solution. `Newton.run` is one of them.
_Method: TypeAlias = Callable[[Newton, PETSc.Vec, Attempt], bool]


@dataclass(frozen=True, eq=False)
class _Strategy:
    """Strategy of a solve: a function, and settings of its call.

    Attributes:
        name: name of the strategy.
        run: function that carries out the strategy.
        line_search: name of the line search of PETSc.
        is_newton: whether it is Newton's method, which may continue with the direct solver.
        automatic: whether the automatic augmentation parameter replaces one chosen by the caller.
        limit: cost in Newton steps at which the strategy gives up; default: no limit.
    """

    name: str
    run: _Method
    line_search: str = "none"
    is_newton: bool = False
    automatic: bool = False
    limit: float = math.inf

    def solve(
        self,
        eq: ContactEquations,
        linear: LinearSolverChoice,
        monitor: Callable[[Step], None],
        x: PETSc.Vec,
        attempt: Attempt,
    ) -> bool:
        """Apply the strategy from ``x``, which is overwritten; return success. Collective."""
        run = self.run
        with eq.scaling.automatic() if self.automatic else nullcontext():
            while True:
                with Newton(eq, linear(), self.line_search, monitor) as solver:
                    done = run(solver, x, attempt)
                failed = self.is_newton and attempt.linear_solver_failed
                if not (failed and linear.fall_back_to_direct()):
                    break
                run = Newton.run
        if self.automatic:
            attempt.evaluation = None  # evaluated with another r
        return done


def strategies(
    eq: ContactEquations, trial: Trial, increments: int, start: Evaluation | None
) -> Iterator[_Strategy]:
    """Yield the strategies of a nonlinear solve in the order in which they are tried.

    Args:
        eq: contact problem.
        trial: starting points of the solve, and whether only full Newton steps are tried.
        increments: initial number of load increments.
        start: evaluation at the state of the caller, if available.
    """
    if trial.extrapolated is not None:
        start = None  # it may change the candidates of sliding faces
        run = partial(_from_unknowns, unknowns=trial.extrapolated)
        yield _Strategy(_EXTRAPOLATED, run, is_newton=True)
    for statuses in trial.expected:
        start = None
        run = partial(Newton.run_from_statuses, statuses=statuses)
        yield _Strategy("expected statuses", run)
    yield _Strategy("full steps", partial(Newton.run, start=start), is_newton=True)
    if trial.brief:
        return
    from dolfinx_contact.solvers.block_pivoting import pivot
    from dolfinx_contact.solvers.bonds import release_bonds
    from dolfinx_contact.solvers.load_following import follow_load

    # In the integral method r is part of the discretisation, and a forced r is kept.
    made = partial(_Strategy, automatic=not eq.is_weak)
    if eq.forced_r is not None and not eq.is_weak:
        yield made("full steps with the automatic r", Newton.run, is_newton=True)
    if any([s.law.weakens for s in eq.surfaces]):
        yield made("bonds released in turn", release_bonds, limit=2000.0)
    pivoting = made("pivoting", pivot, limit=500.0)
    line_search = made("line search", Newton.run, "bt", is_newton=True, limit=80.0)
    loading = made(_INCREMENTS, partial(raise_load, increments=increments), limit=400.0)
    following = made(_FOLLOWING, follow_load)
    if not eq.linear:
        yield from (loading, line_search, pivoting, following)
        return
    yield from (pivoting, line_search)
    if eq.dim == 2:
        yield made("Lemke's method", _lemke)
    yield from (loading, following)


def _from_unknowns(solver: Newton, x: PETSc.Vec, attempt: Attempt, unknowns: Array) -> bool:
    """Run Newton's method from given unknowns, and return success.

    Unknowns that turn the body inside out, or have a non-finite residual, are rejected.
    """
    eq = solver.equations
    x.array[:] = unknowns
    attempt.reason = inverted(eq, x)
    if attempt.reason:
        return False
    b = x.duplicate()
    start = eq.residual(x, b)
    finite = np.isfinite(b.norm())
    b.destroy()
    if not finite:
        attempt.reason = "the residual is not finite there"
        return False
    return solver.run(x, attempt, start)


def _lemke(solver: Newton, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Run Lemke's method on the condensed problem, then Newton's method from its solution."""
    from dolfinx_contact.algorithms.classical import start_by_lemke

    if solver.max_iterations < 1:
        attempt.reason = "no convergence in 0 iterations"
        return False
    found = start_by_lemke(solver.equations, x, attempt)
    return found and solver.run(x, attempt)


def raise_load(solver: Newton, x: PETSc.Vec, attempt: Attempt, increments: int) -> bool:
    """Apply the load in increments (`ContactEquations.ramped`); return success. Collective.

    An increment that fails or turns the body inside out is quartered; the increment after a
    successful one is doubled.

    Args:
        solver: Newton's method.
        x: start; receives the solution.
        attempt: attempt recording the iterates.
        increments: initial number of increments.
    """
    eq = solver.equations
    first = step = 1.0 / increments
    done = 0.0
    good = x.copy()
    with eq.ramped(x) as ramp:
        while done < 1.0:
            ramp.fraction = min(1.0, done + step)
            solved = solver.run(x, attempt)
            if solved and (objection := inverted(eq, x)):
                solved = False
                attempt.reason = objection
            if solved:
                x.copy(good)
                done = ramp.fraction
                step = 2 * step
                continue
            good.copy(x)
            step /= 4
            if step < _SMALLEST * first or attempt.gives_up():
                attempt.reason = f"stuck at {done:.4g} of the load: {attempt.reason}"
                break
    good.destroy()
    attempt.evaluation = None  # evaluated with ramped Dirichlet data
    return done == 1.0
