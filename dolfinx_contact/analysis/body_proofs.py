# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is proved of a body: its problem reduced to the contact points, and where that cannot be."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._mpi import on_root
from dolfinx_contact.analysis.renard import criterion_at
from dolfinx_contact.analysis.theory import theory_of
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.parametric import JacobianSolver, ParametricEquations
from dolfinx_contact.equations.state import State
from dolfinx_contact.laws import Coulomb, Frictionless, Tresca, status
from dolfinx_contact.proofs.check_proof import ReducedProblem
from dolfinx_contact.proofs.only_in_space import is_only_in_space
from dolfinx_contact.proofs.only_solution import OnlySolution, is_only
from dolfinx_contact.proofs.rays import ProvedRays, apex_problem, prove_rays
from dolfinx_contact.proofs.solutions import ProvedSolutions, prove_solutions
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense, obstacle_in_space
from dolfinx_contact.results.uniqueness import Uniqueness

__all__ = [
    "obstacle_to_proof",
    "proved",
    "proved_rays",
    "reduced_problem",
    "uniqueness",
]

Codes = npt.NDArray[np.int8]

logger = logging.getLogger(__name__)

_MOST_PROVED = 128  # in 3D, for the certificate of one point
_MOST_POINTS = 300  # in 3D, for an eigenproblem that is not requested
_EFFORT = 60  # of a search for weights in 3D
_ENOUGH = 1.0 + 1e-6  # the factor it is to reach


def obstacle_to_proof(equations: ContactEquations, condensed: Reduction | None) -> str:
    """Why nothing can be proved of a problem; "" if something can.

    Args:
        equations: of the problem.
        condensed: the problem condensed onto its contact points; None if that cannot be done.
    """
    if not all(type(s.law) in (Coulomb, Frictionless, Tresca) for s in equations.surfaces):
        return "proofs are for the laws of Coulomb and Tresca and contact without friction"
    if condensed is None or not condensed.exact:
        return "the problem is not linear, with contact at nodes, but for the law of contact"
    if not condensed.always_solvable:
        return "the stiffness of the body at its contact points is not positive definite"
    return ""


def reduced_problem(condensed: Reduction, gamma: float) -> ReducedProblem:
    """S, p and friction at ``gamma``, with what the factorisation may be off. Not collective.

    Args:
        condensed: exact, and without an `obstacle_to_proof`.
        gamma: parameter.

    Raises:
        ValueError: if S is not positive definite beyond its error, or a number is not finite.
    """
    known = condensed.problem(gamma, unit=condensed.force_unit)
    errors = known.S_error, known.p_error
    return ReducedProblem(known.S, known.p, known.friction, known.bound, *errors)


def proved(condensed: Reduction, gamma: float, seconds: float) -> ProvedSolutions | None:
    """All solutions with a proof; where it takes its time there is a line of progress.

    None if the errors of the factorisation are too large for any. States are in the units of the
    condensed problem. For one rank alone.
    """
    problem = _within_errors(condensed, gamma)
    if problem is None:
        return None
    return prove_solutions(problem, proof_seconds=seconds)


def proved_rays(
    condensed: Reduction,
    cone: AffineSystem,
    known: Sequence[tuple[Codes, float]],
    seconds: float,
) -> ProvedRays:
    """All rays of a tangent cone, with a proof. For one rank alone.

    Args:
        condensed: at the state; of the laws of Coulomb or without friction.
        cone: its tangent cone.
        known: statuses (m,) and dgamma of rays.
        seconds: for each sense of gamma.
    """
    try:
        points = condensed.problem(unit=condensed.force_unit)
        assert points.rate is not None
        errors = points.S_error, points.rate_error
        whole = ReducedProblem(points.S, points.rate, points.friction, None, *errors)
        apex = apex_problem(whole, condensed.system, cone)
    except ValueError as error:
        return ProvedRays("open", (), f"not proved: {error}")
    if isinstance(apex, str):
        return ProvedRays("open", (), f"not proved: {apex}")
    return prove_rays(apex, known, proof_seconds=seconds)


def _within_errors(condensed: Reduction, gamma: float) -> ReducedProblem | None:
    """The reduced problem; None if it is spoilt by errors."""
    try:
        return reduced_problem(condensed, gamma)
    except ValueError as error:
        logger.info("nothing can be proved: %s", error)
        return None


def uniqueness(
    equations: ContactEquations,
    linear: Callable[[], JacobianSolver],
    x: PETSc.Vec,
    state: Evaluation,
    seconds: float,
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """Whether a solution is the only one, with the data as they are. Collective.

    Args:
        equations: contact problem.
        linear: function that returns its linear solver.
        x: solution.
        state: evaluation of the solution.
        seconds: time for more than the certificate of one point: a proof by branch and bound, and
            where the body is not reduced an eigenproblem of any size, with weights if it is dense.
        state_at: function that returns the State of unknowns.
    """
    if not equations.linear:
        return Uniqueness("not proved", "proofs are for linear bodies and small sliding")
    system = ParametricEquations(equations, fem.Constant(equations.V.mesh, 0.0), linear)
    try:
        if equations.dim == 2:
            return _in_plane(system, x, seconds, state_at)
        return _in_space(system, x, state, seconds, state_at)
    finally:
        system.destroy()


def _in_plane(
    system: ParametricEquations,
    x: PETSc.Vec,
    seconds: float,
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """By the certificate of one point. Collective."""
    equations: ContactEquations = system.equations
    condensed: Reduction | None = None
    try:
        if can_condense(system, bounded=True):
            condensed = Reduction(system, x, 0.0, exact=True, conic=False)
        obstacle = obstacle_to_proof(equations, condensed)
        if obstacle or condensed is None:
            return _by_theory(equations, obstacle)
        codes = condensed.codes(system.piece_at(x, 0.0))
        return _among_points(
            condensed, x, lambda problem: is_only(problem, codes, proof_seconds=seconds), state_at
        )
    finally:
        if condensed is not None:
            condensed.destroy()


def _among_points(
    condensed: Reduction,
    x: PETSc.Vec,
    decide: Callable[[ReducedProblem], OnlySolution],
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """Decision on the reduced problem, with another solution if there is one. Collective."""
    problem = _within_errors(condensed, 0.0)
    if problem is None:
        return Uniqueness("not proved", "the errors of the factorisation are too large")
    found = on_root(condensed.comm, lambda: decide(problem))
    if found.other is None:
        return Uniqueness(found.verdict, found.reason)
    y = x.duplicate()
    condensed.expand(found.other[1], 0.0, y)
    other = state_at(y)
    y.destroy()
    letters = status.word(found.other[0], problem.dim)
    if condensed.comm.rank == 0:
        logger.warning("the solution is not the only one: there is another, %s", letters)
    return Uniqueness("others exist", f"{found.reason}, with statuses {letters}", other)


def _in_space(
    system: ParametricEquations,
    x: PETSc.Vec,
    state: Evaluation,
    seconds: float,
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """By the certificate of one point, else by Renard's criterion, else by theorems. Collective."""
    equations: ContactEquations = system.equations
    rubs = any(type(s.law) is Coulomb for s in equations.surfaces)
    if not rubs or obstacle_in_space(system) or _points(equations) > _MOST_PROVED:
        return _by_criterion(equations, state, seconds)
    if not all(type(s.law) in (Coulomb, Frictionless, Tresca) for s in equations.surfaces):
        return _by_criterion(equations, state, seconds)
    condensed = Reduction(system, x, 0.0, exact=True, conic=False)
    try:
        if obstacle_to_proof(equations, condensed):
            return _by_criterion(equations, state, seconds)
        w = condensed.contract(x)
        found = _among_points(
            condensed,
            x,
            lambda problem: is_only_in_space(problem, w, proof_seconds=seconds),
            state_at,
        )
    finally:
        condensed.destroy()
    if found.verdict != "not proved":
        return found
    other = _by_criterion(equations, state, seconds)
    return other if other.verdict == "proved" else found


def _points(equations: ContactEquations) -> int:
    """Contact points of all surfaces and ranks. Collective."""
    return int(sum(s.points.number_everywhere for s in equations.surfaces))


def _by_criterion(equations: ContactEquations, state: Evaluation, seconds: float) -> Uniqueness:
    """By Renard's criterion, which needs the directions of slips and shears. Collective."""
    laws = {type(s.law) for s in equations.surfaces}
    fits = laws <= {Coulomb, Frictionless, Tresca} and all(
        s.points.E is None and s.rigid_body is None for s in equations.surfaces
    )
    if not fits or Coulomb not in laws:
        return _by_theory(equations, "proofs are for contact at nodes and the usual laws")
    if _points(equations) > _MOST_POINTS and not seconds > 0:
        return Uniqueness("not proved", f"more than {_MOST_POINTS} points: only on request")
    effort = _EFFORT if seconds > 0 else 0
    criterion = criterion_at(equations, state, effort=effort, enough=_ENOUGH, seconds=seconds)
    if not criterion.definite:
        return Uniqueness("not proved", "the stiffness is not symmetric and positive definite")
    if not criterion.unique:
        return Uniqueness("not proved", "Renard's criterion does not hold")
    factor = criterion.factor
    return Uniqueness("proved", f"Renard's criterion, up to {factor:.4g} times the friction")


def _by_theory(equations: ContactEquations, obstacle: str) -> Uniqueness:
    """By theorems, where certificates do not apply. Collective."""
    theory = theory_of(equations)
    if theory.exists and theory.unique:
        return Uniqueness("proved", theory.reason)
    return Uniqueness("not proved", obstacle)
