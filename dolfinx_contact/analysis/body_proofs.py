# SPDX-License-Identifier: LGPL-3.0-or-later
"""Proofs of uniqueness and completeness for problems condensed onto their contact points.

Where no certificate applies, theorems decide. They require a stiffness K that is symmetric and
positive definite on the free displacements, gaps that are linear in the displacement (small
sliding), and a contact law that holds node by node:

- Without friction, and for a prescribed friction bound (Tresca), there is exactly one solution, the
  minimiser of a strictly convex energy (Lions and Stampacchia, Comm. Pure Appl. Math. 20, 1967;
  Duvaut and Lions, Les inequations en mecanique et en physique, 1972, chapter 3).
- With Coulomb friction, there is at least one solution for any coefficient: the pressure of
  Tresca's solution depends continuously on its friction bound, which yields a fixed point by
  Brouwer's theorem (Haslinger, Math. Methods Appl. Sci. 5, 1983). The solution is unique below a
  coefficient that depends on the mesh and is not computable; uniqueness therefore requires a
  certificate.

Definiteness is decided by the signs of the pivots of K, up to round-off.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from petsc4py import PETSc

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact._mpi import any_rank, on_root
from dolfinx_contact.analysis.renard import criterion_at
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.equations.state import State
from dolfinx_contact.laws import Coulomb, Frictionless, Tresca, status
from dolfinx_contact.proofs.check_proof import ReducedProblem
from dolfinx_contact.proofs.only_solution import is_only
from dolfinx_contact.proofs.rays import ProvedRays, apex_problem, prove_rays
from dolfinx_contact.proofs.solutions import ProvedSolutions, prove_solutions
from dolfinx_contact.reduced.constrained_body import is_positive_definite
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import why_not_reducible
from dolfinx_contact.results.uniqueness import Theory, Uniqueness

__all__ = [
    "proved",
    "proved_rays",
    "theory_of",
    "uniqueness",
    "why_not_provable",
]


logger = logging.getLogger(__name__)

_LAWS = (Coulomb, Frictionless, Tresca)
_MOST_PROVED = 128  # largest number of points in 3D for the certificate of one point
_MOST_POINTS = 300  # largest number of points in 3D for Renard's criterion by default
_EFFORT = 60  # iterations of a search for weights in 3D
_ENOUGH = 1.0 + 1e-6  # factor at which this search ends
_NONE = "no computable theorem applies: "


def why_not_provable(equations: ContactEquations, condensed: Reduction | None) -> str:
    """Return the reason why nothing can be proved about a problem; "" if proofs are possible.

    Args:
        equations: equations of the problem.
        condensed: reduction of the problem to its contact points; None if the problem has no
            reduction.
    """
    if not all(type(s.law) in _LAWS for s in equations.surfaces):
        return "proofs are for the laws of Coulomb and Tresca and contact without friction"
    if condensed is None or not condensed.exact:
        return (
            "the problem cannot be condensed exactly; apart from the contact law, "
            "it must be linear, with nodal or mixed contact"
        )
    if not condensed.always_solvable:
        return "the stiffness of the body at its contact points is not positive definite"
    return ""


def _reduced(condensed: Reduction, gamma: float) -> ReducedProblem | None:
    """Return the reduced problem with error bounds, for proofs.

    None if these bounds do not prove that the stiffness is positive definite.
    """
    try:
        points = condensed.problem(gamma, unit=condensed.force_unit)
        errors = points.S_error, points.p_error
        return ReducedProblem(points.S, points.p, points.friction, points.bound, *errors)
    except ValueError as error:  # S is not positive definite beyond its error
        if condensed.comm.rank == 0:
            logger.info("nothing can be proved: %s", error)
        return None


def proved(condensed: Reduction, gamma: float, seconds: float) -> ProvedSolutions | None:
    """Find all solutions and prove that there are no others. Call it on one rank.

    The solutions are in the units of the reduced problem.

    Args:
        condensed: exact reduction of a provable problem (`why_not_provable` returns "").
        gamma: load parameter.
        seconds: time limit of the proof.

    Returns:
        Solutions and proof; None if the factorisation errors are too large for a proof.
    """
    problem = _reduced(condensed, gamma)
    if problem is None:
        return None
    found = prove_solutions(problem, proof_seconds=seconds)
    found.certificate.force_unit = condensed.force_unit
    return found


def proved_rays(
    condensed: Reduction,
    cone: AffineSystem,
    known: Sequence[tuple[Codes, float]],
    seconds: float,
) -> ProvedRays:
    """Find all rays of a tangent cone and prove that there are no others.

    Call it on one rank. Along a ray (`proofs.rays`) solutions leave the state, with dgamma = 1 or
    -1.

    Args:
        condensed: reduction at the state, with Coulomb friction or without friction.
        cone: tangent cone of the contact laws at the state.
        known: known rays: statuses of the m points, shape (m,), and dgamma.
        seconds: time limit for each sign of dgamma.
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


def uniqueness(
    equations: ContactEquations,
    x: PETSc.Vec,
    evaluation: Evaluation,
    seconds: float,
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """Decide whether a solution is unique for the present data. Collective.

    Certificates for the reduced problem are tried first and, in 3D, Renard's criterion, which uses
    the directions of slips and shears. If they do not apply, theorems decide.

    Args:
        equations: equations of the contact problem.
        x: vector of unknowns at the solution.
        evaluation: evaluation of the equations at the solution.
        seconds: time limit of the branch and bound that follows the certificate of one point
            (`proofs.only_solution`). With a positive limit, Renard's criterion is evaluated for any
            number of points, with weights if its eigenproblem is dense.
        state_at: function returning the `State` of a vector of unknowns.
    """
    if not equations.linear:
        return Uniqueness("not proved", "proofs are for linear bodies and small sliding")
    plane = equations.dim == 2
    system = ParametricEquations(equations)
    condensed: Reduction | None = None
    answer: Uniqueness | None = None
    try:
        fits = not why_not_reducible(system)
        if fits and (plane or _is_provable_in_space(equations)):
            condensed = Reduction(system, x, 0.0, exact=True, conic=False)
        obstacle = why_not_provable(equations, condensed)
        if condensed is not None and not obstacle:
            given = condensed.codes(system.piece_at(x, 0.0)) if plane else condensed.contract(x)
            answer = _among_points(condensed, x, given, seconds, state_at)
    finally:
        if condensed is not None:
            condensed.destroy()
    if answer is not None and (plane or answer.verdict != "not proved"):
        return answer
    if plane:
        return _by_theory(equations, obstacle)
    other = _by_criterion(equations, evaluation, seconds)
    return other if answer is None or other.verdict == "proved" else answer


def _is_provable_in_space(equations: ContactEquations) -> bool:
    """Return whether the certificate of one point is tried for a 3D problem. Collective.

    This requires a surface with Coulomb friction, laws that allow proofs, and a small problem.
    """
    laws = {type(s.law) for s in equations.surfaces}
    if Coulomb not in laws or not laws <= set(_LAWS):
        return False
    return _points(equations) <= _MOST_PROVED


def _among_points(
    condensed: Reduction,
    x: PETSc.Vec,
    solution: Codes | Array,
    seconds: float,
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """Decide whether a solution of the reduced problem is unique. Collective.

    The ``solution`` consists of statuses in 2D, of the state of the contact points in 3D. If a
    second solution is found, the result contains its `State`.
    """
    problem = _reduced(condensed, 0.0)
    if problem is None:
        return Uniqueness("not proved", "the errors of the factorisation are too large")
    decided = on_root(condensed.comm, lambda: is_only(problem, solution, proof_seconds=seconds))
    if decided.other is None:
        return Uniqueness(decided.verdict, decided.reason)
    codes, w = decided.other
    y = x.duplicate()
    condensed.expand(w, 0.0, y)
    other = state_at(y)
    y.destroy()
    letters = status.word(codes, problem.dim)
    if condensed.comm.rank == 0:
        logger.warning("the solution is not the only one: there is another, %s", letters)
    return Uniqueness("others exist", f"{decided.reason}, with statuses {letters}", other)


def _points(equations: ContactEquations) -> int:
    """Return the number of contact points on all surfaces and ranks. Collective."""
    return int(sum(s.points.number_everywhere for s in equations.surfaces))


def _by_criterion(
    equations: ContactEquations, evaluation: Evaluation, seconds: float
) -> Uniqueness:
    """Decide uniqueness by Renard's criterion (`renard`). Collective."""
    laws = {type(s.law) for s in equations.surfaces}
    nodal = not equations.is_weak and all(s.rigid_body is None for s in equations.surfaces)
    if not nodal or Coulomb not in laws or not laws <= set(_LAWS):
        return _by_theory(equations, "proofs are for contact at nodes and the usual laws")
    if _points(equations) > _MOST_POINTS and not seconds > 0:
        return Uniqueness(
            "not proved", f"more than {_MOST_POINTS} points: only with proof_seconds="
        )
    effort = _EFFORT if seconds > 0 else 0
    criterion = criterion_at(equations, evaluation, effort=effort, enough=_ENOUGH, seconds=seconds)
    if not criterion.definite:
        return Uniqueness("not proved", "the stiffness is not symmetric and positive definite")
    if not criterion.unique:
        more = "" if seconds > 0 else "; proof_seconds=60 tries more weights"
        return Uniqueness("not proved", f"Renard's criterion does not hold{more}")
    factor = criterion.factor
    return Uniqueness("proved", f"Renard's criterion, up to {factor:.4g} times the friction")


def _by_theory(equations: ContactEquations, obstacle: str) -> Uniqueness:
    """Decide uniqueness by theorems if an obstacle rules out certificates. Collective."""
    theory = theory_of(equations)
    if theory.exists and theory.unique:
        return Uniqueness("proved", theory.reason)
    return Uniqueness("not proved", obstacle)


def theory_of(eq: ContactEquations) -> Theory:
    """Return the theorems that apply to a problem with its current data. Collective."""
    rubs = _coefficients(eq)
    for applies, what in (
        (eq.bulk.linear, "the body is not linear"),
        (eq.linear, "gap and normal depend on the displacement"),
        (rubs is not None, "the law is not Coulomb's, Tresca's or without friction"),
        (not eq.is_weak, "the law does not hold node by node"),
        (eq.rigid.size == 0, "a rigid body moves"),
        (len(eq.scaling.loose) == 0, "a body is not held by Dirichlet data"),
    ):
        if not applies:
            return Theory(False, False, _NONE + what)
    stiffness = eq.bulk.stiffness(eq.bulk.displacement.x.array.copy())
    if not is_positive_definite(eq, stiffness):
        what = "the stiffness is not symmetric and positive definite"
        return Theory(False, False, _NONE + what)
    if not rubs:
        return Theory(True, True, "exactly one solution, the state of least energy")
    return Theory(True, False, "at least one solution for every coefficient of friction")


def _coefficients(eq: ContactEquations) -> bool | None:
    """Return whether any friction coefficient is positive. Collective.

    None if the theorems do not cover a contact law of the problem.
    """
    if not all(s.law.bound_kind in ("proportional", "given") for s in eq.surfaces):
        return None
    x = eq.unknowns.create_vector()
    evaluation = eq.evaluate_contact(x)
    x.destroy()
    mine = any(
        s.law.bound_kind == "proportional" and bool((known.answers.unit_bound > 0).any())
        for s, known in zip(eq.surfaces, evaluation.surfaces, strict=True)
    )
    return any_rank(eq.comm, mine)
