# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solution of contact problems by the classical algorithms.

The body is condensed onto its contact points once (`reduced.Reduction`). Rank 0 runs the algorithm,
starting from the tractions in the caller's Functions. The solution is accepted if its relative
residuals meet the tolerance of Newton's method, but is not corrected by Newton steps.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._mpi import on_root
from dolfinx_contact._petsc import staged
from dolfinx_contact.algorithms import (
    ALGORITHMS,
    Algorithm,
    Penalty,
    RayTermination,
    coulomb_by_lemke,
)
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.measures import Scales, diverged, measure
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.reduced.reduction import Reduction, scaled, scales_at
from dolfinx_contact.reduced.scope import can_condense
from dolfinx_contact.solvers.attempts import (
    Attempt,
    ConvergenceError,
    SolveProgress,
    Step,
    unsolved,
)

__all__ = ["algorithm_named", "solve_by", "start_by_lemke"]

logger = logging.getLogger(__name__)

_TOLERANCE = 1e-10
_GATHERED = 10.0  # accepted measure of the body after a reduced solve, relative to the tolerance


def algorithm_named(wanted: object) -> Algorithm:
    """Return the algorithm with a given name and default options; return an `Algorithm` unchanged.

    Raises:
        ValueError: if ``wanted`` is neither a known name nor an `Algorithm`.
    """
    if isinstance(wanted, Algorithm):
        return wanted
    if not isinstance(wanted, str) or wanted not in ALGORITHMS:
        names = ", ".join(("newton", *ALGORITHMS))
        raise ValueError(f"unknown algorithm {wanted!r}; known: {names}")
    return ALGORITHMS[wanted]


@staged("ContactSolve")
def solve_by(
    algorithm: Algorithm,
    equations: ContactEquations,
    x0: PETSc.Vec,
    *,
    progress: SolveProgress,
) -> tuple[PETSc.Vec, list[Attempt]]:
    """Solve a contact problem. Collective.

    Args:
        algorithm: algorithm with its options.
        equations: contact problem.
        x0: initial unknowns.
        progress: monitor and progress line.

    Returns:
        Vector of unknowns at the solution, and a list that contains the record of the attempt.

    Raises:
        ValueError: on every rank, if the algorithm does not support the problem.
        ConvergenceError: if the algorithm does not converge; it contains the record of the attempt.
    """
    _require_scope(equations)
    attempt = Attempt(algorithm.described())
    progress.strategy = algorithm.name
    x = x0.copy()
    try:
        reduction = Reduction.of(equations)
    except RuntimeError as error:
        attempt.reason = str(error)
    else:
        with reduction:
            _on_points(algorithm, reduction, equations, x, attempt)
    for step in attempt.steps:
        progress.clear()
        if equations.comm.rank == 0:
            logger.info("%s, %s", attempt.strategy, step)
        progress.step(step)
    if attempt.converged and (reason := diverged(equations, x)):
        attempt.converged = False
        attempt.reason = reason
    if not attempt.converged:
        x.destroy()
        raise ConvergenceError(unsolved([attempt]), [attempt])
    return x, [attempt]


def _require_scope(eq: ContactEquations) -> None:
    """Raise `ValueError` on every rank unless classical algorithms support the problem."""
    for s in eq.surfaces:
        if s.slides:
            raise ValueError(
                f'{s.name}: this algorithm needs small sliding; use algorithm="newton"'
            )
    if not eq.linear or len(eq.scaling.loose):
        raise ValueError(
            'this algorithm needs a linear body without free rigid motions; use algorithm="newton"'
        )


def _on_points(
    algorithm: Algorithm,
    reduction: Reduction,
    equations: ContactEquations,
    x: PETSc.Vec,
    attempt: Attempt,
) -> None:
    """Solve the reduced problem on rank 0 and write the solution into ``x``. Collective.

    The forces in ``x`` are the initial guess; the record ``attempt`` is completed.
    """
    tolerance = float(equations.options.value("snes_rtol") or _TOLERANCE)
    scales = scales_at(equations, x)
    contact = scaled(reduction.problem(), scales)
    start = reduction.contract(x)[:, contact.dim :] * reduction.force_unit
    # Measure the body with the scales of the reduced problem.
    scales = Scales(max(scales.force, contact.force), max(scales.length, contact.length))
    outcome = on_root(
        equations.comm, lambda: algorithm.run(contact, tolerance=tolerance, start=start)
    )
    attempt.steps = [Step(i, m, 0, 1.0) for i, m in enumerate(outcome.measures)]
    attempt.series = outcome.series
    attempt.converged = outcome.converged
    attempt.reason = outcome.reason
    a = contact.displacements(outcome.r)
    reduction.expand(np.hstack([a, outcome.r / reduction.force_unit]), 0.0, x)
    reduction.relax(x)
    if not outcome.converged:
        return
    measures, _ = measure(equations, equations.evaluate(x), scales)
    attempt.steps[-1] = replace(attempt.steps[-1], measures=measures)
    accuracy = algorithm.accuracy if isinstance(algorithm, Penalty) else tolerance
    if not measures.worst <= _GATHERED * accuracy:
        attempt.converged = False
        attempt.reason = f"the points are in equilibrium, the body is not: {measures.worst:.1e}"


def start_by_lemke(equations: ContactEquations, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Condense the body at ``x`` and replace ``x`` by a solution of Lemke's method. Collective.

    Lemke's method finds a solution for every friction coefficient if the reduced stiffness is
    positive definite (`algorithms.lemke`). If no solution is found, the reason is stored in
    ``attempt``.

    Returns:
        Whether a solution was found.
    """
    if not all(s.law.bound_kind == "proportional" for s in equations.surfaces):
        attempt.reason = "needs Coulomb's law or contact without friction"
        return False
    system = ParametricEquations(equations)
    if not can_condense(system, partly=True):
        attempt.reason = "the body cannot be condensed onto its contact points"
        return False
    try:
        with Reduction(system, x, 0.0, exact=True) as reduction:
            problem = reduction.problem(unit=reduction.force_unit)
            w, _ = on_root(
                equations.comm, lambda: coulomb_by_lemke(problem.S, problem.p, problem.friction)
            )
            reduction.expand(w, 0.0, x)
    except (RayTermination, ValueError, RuntimeError) as error:
        attempt.reason = str(error)
        return False
    return True
