# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problem with a parameter, as a system for continuation.

The parameter gamma is a Constant in the data of the problem, such as a load factor, a material or
friction coefficient, or the position of an obstacle. Dirichlet data may depend on it as well. UFL
computes the exact derivative of the residual H(x, gamma) with respect to gamma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Codes
from dolfinx_contact._compat import is_value_of
from dolfinx_contact._mpi import Arguments, all_ranks, any_rank, collective, on_root, require
from dolfinx_contact._petsc import destroy
from dolfinx_contact._ufl import described, refuse_other_mesh
from dolfinx_contact._validate import ReadOnly, copy_with, instance, listed, number
from dolfinx_contact.continuation import BranchPoint, Piece
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.continuation.several_solutions import Solution
from dolfinx_contact.continuation.system import Condensed, Proof, RayProof
from dolfinx_contact.equations.data import Datum, data_within, placed_data
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.equations.state import State
from dolfinx_contact.laws import Coulomb, Frictionless, status
from dolfinx_contact.laws.status import OPEN
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense, why_not_reducible
from dolfinx_contact.results.indicators import (
    Indicators,
    small_sliding_violated,
    surface_indicators,
)
from dolfinx_contact.results.result import Result
from dolfinx_contact.results.uniqueness import checked_seconds
from dolfinx_contact.solvers.attempts import Attempt, ConvergenceError

__all__ = ["ParametricContact"]

_PROOF_SECONDS = 10.0  # default time limit of proofs
_MOST_PROVED = 128  # contact points up to which all solutions are proved by default


def _check_parameter(a: Arguments) -> None:
    a.gamma = number(a.gamma, "gamma")


def _check(a: Arguments) -> None:
    instance(a.problem, "problem", ContactProblem)
    without = a.gamma is None
    if without:
        a.gamma = fem.Constant(a.problem.V.mesh, 0.0)
    a.driven = _checked(a.problem, a.gamma, a.driven)
    data = _require_own(a.problem, a.gamma, a.driven)
    if not without and not any(d.value is a.gamma for d in data):
        raise ValueError(
            "gamma does not occur in the problem or in driven: use this Constant there, or omit "
            "gamma for a problem without a parameter"
        )


def _described(a: Arguments) -> dict[str, Any]:
    domain = a.problem.V.mesh
    driven = [described(expression, domain) for _, expression in a.driven]
    return {"gamma": float(a.gamma.value), "driven": driven}


class ParametricContact(ReadOnly, ParametricEquations):
    """Contact problem H(x, gamma) = 0 with a parameter, as a system for continuation.

    H is piecewise smooth, and each piece corresponds to one combination of statuses of the contact
    points. The status codes (`laws.status`) are 0 open, 1 stick, 2 slip with u_t > 0 and 3 slip
    with u_t < 0 for the tangential slip u_t; in 3D, 2 is slip. With a prescribed friction bound,
    codes 4 to 6 are the tangential statuses 1 to 3 at open points.

    Evaluations (`residual`, `piece_at`) set the Constant gamma and the driven Functions. Call
    `set_parameter` before `ContactProblem.solve`. The remaining methods are documented in
    `continuation.System`.

    Args:
        problem: contact problem. Its Functions contain the current point of a branch while
            observers are called, and the last point after a branch has been followed.
        gamma: parameter, a scalar Constant in the bulk, a law, an obstacle, or the load or motion
            of a rigid body. Dirichlet data depend on it through ``driven`` only. Default: None, for
            the solutions of a problem without a parameter (`find_solutions`).
        driven: pairs of a Function used in a Dirichlet condition and its value, a UFL expression of
            gamma and the position. The Function must not occur in other data of the problem.

    Attributes:
        proof_seconds: time limit in seconds for the proof that all solution rays out of a point
            have been found. It applies separately to increasing and decreasing gamma; 0 disables
            the proof. Default: 10. The attribute is writable.

    Raises:
        ValueError: on every rank, if ``gamma`` is not a scalar Constant of the mesh, does not occur
            in the data, or is the value of a Dirichlet condition; if a driven Function or its
            expression belongs to another mesh, has another shape, is not in a Dirichlet condition
            or also occurs in other data; or if arguments differ between ranks.
    """

    _listed = (
        "condensed",
        "create_vector",
        "destroy",
        "events",
        "is_piecewise_affine",
        "letters",
        "piece",
        "piece_at",
        "piece_of",
        "positions",
        "put",
        "residual",
        "restore",
        "restored",
        "result_at",
        "set_parameter",
        "state_at",
        "statuses_of",
    )
    _may_be_set = ("proof_seconds",)
    _advice = (
        "set_parameter(gamma) sets the parameter; for another one, other driven Functions or "
        "another problem make another ParametricContact"
    )

    @collective("a contact problem with a parameter", _check, compare=_described)
    def __init__(
        self,
        problem: ContactProblem,
        gamma: fem.Constant | None = None,
        *,
        driven: Sequence[tuple[fem.Function, Any]] = (),
    ):
        self.problem = problem
        self.proof_seconds = _PROOF_SECONDS
        super().__init__(problem.equations, gamma, lambda: problem.linear_solver, driven=driven)
        self._condensed: Reduction | None = None
        self._condensed_from = 0  # checksum of the data
        self._condensed_at_gamma: Reduction | None = None
        self._reason_at_gamma = ""
        #: Names of the warnings that have been logged.
        self._warned: set[str] = set()
        #: Piece and gamma of the last point whose indicators were evaluated.
        self._judged: tuple[Piece | None, float] = None, 0.0

    @collective("set_parameter", _check_parameter)
    def set_parameter(self, gamma: float) -> None:
        """Set gamma and Dirichlet data depending on it, before a solve at this value. Collective.

        Raises:
            ValueError: on every rank, if gamma is not a finite number or differs between ranks.
        """
        self._set(gamma)

    def with_memory(self, memory: Sequence[Memory | None]) -> ParametricContact:
        """Return the same system with a different memory of the contact points. Collective.

        The copy is shallow, see `ContactProblem.with_memory`.

        Args:
            memory: memory of the points of each surface at the beginning of the step; None for the
                static law.
        """
        problem = self.problem.with_memory(memory)
        none = {"_condensed": None, "_condensed_at_gamma": None}
        return copy_with(self, problem=problem, equations=problem.equations, **none)

    def put(self, x: PETSc.Vec, gamma: float, piece: Piece) -> None:
        """Write a point of a branch and its statuses into the problem, and set gamma. Collective.

        A warning is logged once for each validity indicator of a surface above its threshold.

        Args:
            x: unknowns.
            gamma: parameter.
            piece: statuses of all contact points.
        """
        self._put(x, gamma, piece)
        self.equations.read_data()
        # records and observers put the same point several times
        before, at = self._judged
        if all_ranks(self.comm, piece is before and gamma == at):
            return
        self._judged = piece, gamma
        found = surface_indicators(self.equations, self.evaluate_contact(x, gamma, piece))
        warnings = Indicators(found).warnings
        self.problem.log_warnings(warnings, self._warned, f"at gamma = {gamma:.6g} ")

    def _put(self, x: PETSc.Vec, gamma: float, piece: Piece) -> None:
        """Write a point of a branch into the problem, without warnings. Collective."""
        self._set(gamma)
        statuses = self.statuses_of(piece)
        assert statuses is not None
        self.problem.read(x, statuses)

    def solution_from(self, x: PETSc.Vec, gamma: float) -> tuple[PETSc.Vec | None, str]:
        """Solve at gamma, starting from unknowns ``x``, with `ContactProblem.solve`. Collective.

        Returns:
            Unknowns of the solution, None if none was found; and a description of the solve.
        """
        with self.restored(always=True):
            self._set(gamma)
            self.problem.read(x)
            try:
                result, _ = self.problem.solve_step(progress=False)
            except ConvergenceError as error:
                tried = "; ".join(f"{a.strategy}: {a.reason}" for a in error.attempts)
                return None, f"solve() found no solution ({tried})"
            solution = self.create_vector()
            self.problem.write(solution)
        return solution, f"solve() by {result.reason}"

    def validity_warning(self, x: PETSc.Vec, gamma: float, piece: Piece) -> str:
        """Return a message if a point of a branch violates small sliding, else "". Collective."""
        with self.restored(always=True):
            self._put(x, gamma, piece)
            return small_sliding_violated(self.equations, self.evaluate_contact(x, gamma, piece))

    def result_at(self, point: BranchPoint | Solution) -> Result:
        """Write a point to the Functions, and return its result. Collective.

        The stored statuses of the point are used, even on a kink, where the unknowns do not
        determine them. Warnings that were not yet logged for another point of this system are
        logged.

        Args:
            point: point of a branch, or one of `Solutions.found`.
        """
        result = self.collect(point)
        self.problem.log_warnings(result.warnings, self._warned)
        return result

    def collect(self, point: BranchPoint | Solution) -> Result:
        """Like `result_at`, write a point and return its result, without warnings. Collective."""
        x = self._unknowns(point)
        equations = self._equations_at(point.gamma)
        evaluation = equations.evaluate(x, self.statuses_of(point.piece))
        attempt = Attempt("continuation", "a point of a branch", converged=True)
        result = self.problem.collect(x, [attempt], evaluation)
        # a branch may lead out of contact
        return replace(result, indicators=replace(result.indicators, apart=None))

    def state_at(self, point: BranchPoint | Solution) -> State:
        """Return the state at a point of a branch or at a solution, with its gamma. Collective.

        The Functions, gamma and the driven Functions are not changed.

        Args:
            point: point of a branch, or one of `Solutions.found`.
        """
        x = self._unknowns(point)
        with self.restored(always=True):
            self._set(point.gamma)
            state = self.problem.state_at(x, self.statuses_of(point.piece))
        return replace(state, gamma=point.gamma)

    def _unknowns(self, point: BranchPoint | Solution) -> PETSc.Vec:
        """Return a copy of the unknowns at a point of a branch or at a solution, without gamma."""
        x = self.create_vector()
        y = point.x if isinstance(point, Solution) else point.y  # y also has gamma
        x.array[:] = y.array_r[: x.getLocalSize()]
        return x

    def restore(self, state: State) -> None:
        """Write a state into the Functions, and set gamma to the value in the state. Collective.

        Raises:
            ValueError: on every rank, if the state does not belong to this problem.
        """
        self.problem.restore(state)
        if state.gamma is not None:
            self._set(state.gamma)

    @contextmanager
    def restored(self, *, always: bool = False) -> Iterator[None]:
        """Context manager that restores Functions, statuses, gamma and Dirichlet data.

        Args:
            always: whether to restore them on every exit; default: only after an error.
        """
        with self.problem.restored(always=always), super().restored(always=always):
            yield

    # -- affine pieces ---------------------------------------------------------------------------

    def condensed(self, x: PETSc.Vec, gamma: float, *, conic: bool = True) -> Reduction | None:
        """Condense the problem, linearised at (x, gamma), onto its contact points. Collective.

        The result is None if the bulk has kinks in u, there are too many points, or the statuses
        are not polyhedral cones (3D friction, integral contact, gamma in the law or in the
        obstacle). With ``conic=False``, 3D friction is accepted; the result is then a linear
        problem.

        Args:
            x: unknowns at which the problem is linearised.
            gamma: parameter at which the problem is linearised.
            conic: whether the sets of jumps and tractions of each status must be polyhedral cones;
                if so, the result is also None for a prescribed friction bound.
        """
        if self.kinks:
            return None
        if not conic and not (self.is_linear and self._fixed_laws):
            return self._condensed_at(gamma)
        cones = can_condense(self)
        if not cones and (conic or why_not_reducible(self)):
            return None
        if not self.is_linear:
            return Reduction(self, x, gamma, exact=False)
        mark = self._data_mark()
        if self._condensed is None or any_rank(self.comm, mark != self._condensed_from):
            # at x = 0, so that round-off of a state does not perturb a degenerate problem
            destroy(self._condensed)
            self._condensed = None
            zero = self.create_vector()
            with super().restored(always=True):
                self._condensed = Reduction(self, zero, 0.0, exact=True, conic=cones)
            zero.destroy()
            self._condensed_from = mark
        return self._condensed

    def _condensed_at(self, gamma: float) -> Reduction | None:
        """Condense the problem at a fixed gamma onto its contact points. Collective.

        The data may depend on gamma in any way. None if the body is not linear, or the problem
        cannot be condensed.
        """
        eq = self.equations
        if not eq.linear:
            return None
        destroy(self._condensed_at_gamma)
        self._condensed_at_gamma = None
        with super().restored(always=True):
            self._set(gamma)
            fixed = ParametricEquations(eq)
            self._reason_at_gamma = why_not_reducible(fixed)
            if not self._reason_at_gamma:
                x = fixed.create_vector()
                self._condensed_at_gamma = Reduction(fixed, x, 0.0, exact=True, conic=False)
                x.destroy()
        return self._condensed_at_gamma

    @property
    def is_piecewise_affine(self) -> bool:  # type: ignore[override]
        """Whether H is affine in (x, gamma) for fixed statuses. Collective."""
        return self.is_linear and can_condense(self)

    def prove(self, condensed: Condensed, gamma: float, seconds: float) -> Proof | None:
        """Compute all solutions at a fixed gamma, with a proof of completeness. Collective.

        The result is None if no certificate applies (`analysis.body_proofs.why_not_provable`) or
        the problem has more than 128 contact points.
        """
        from dolfinx_contact.analysis.body_proofs import proved, why_not_provable

        assert isinstance(condensed, Reduction)
        if condensed.points.number > _MOST_PROVED or why_not_provable(self.equations, condensed):
            return None
        return on_root(self.comm, lambda: proved(condensed, gamma, seconds))

    def why_not_provable(self) -> str:
        """Return the reason why no proof is available in 3D, else "". Collective."""
        from dolfinx_contact.analysis.body_proofs import why_not_provable

        if self.equations.dim == 2:
            return ""
        if self.kinks:
            return self.kinks
        condensed, obstacle = self._condensed, why_not_reducible(self)
        if self.equations.linear and not (self.is_linear and self._fixed_laws):
            # a proof concerns one value of gamma
            condensed, obstacle = self._condensed_at_gamma, self._reason_at_gamma
        if obstacle:
            return obstacle
        if condensed is not None and condensed.points.number > _MOST_PROVED:
            return f"there are more than {_MOST_PROVED} contact points"
        return why_not_provable(self.equations, condensed)

    def prove_rays(
        self,
        condensed: Condensed,
        cone: AffineSystem,
        known: Sequence[tuple[Codes, float]],
    ) -> RayProof | None:
        """Compute all solution rays out of a point, with a proof of completeness. Collective.

        They solve the problem linearised at the point (`proofs.rays`). None for laws other than
        frictionless contact and Coulomb friction, for more than 128 contact points, and if
        `proof_seconds` is 0.

        Args:
            condensed: problem condensed onto its contact points.
            cone: problem linearised at the point (tangent cone).
            known: statuses, shape (n,), and rate of gamma of each ray computed so far.
        """
        from dolfinx_contact.analysis.body_proofs import proved_rays

        assert isinstance(condensed, Reduction)
        known_laws = all(type(s.law) in (Coulomb, Frictionless) for s in self.equations.surfaces)
        seconds = checked_seconds(self.comm, self.proof_seconds)
        if seconds == 0 or not known_laws or condensed.system.points > _MOST_PROVED:
            return None
        return on_root(self.comm, lambda: proved_rays(condensed, cone, known, seconds))

    # -- pieces ----------------------------------------------------------------------------------

    def letters(self, piece: Piece) -> str:
        """Return the status letters of all contact points, in the order of tables. Collective.

        Clamped points have the letter d.
        """
        words: list[str] = []
        for s, a, b in self.parts():
            letters = np.where(self.clamped[a:b], "d", status.letters(s.dim)[piece.codes[a:b]])
            words += list(s.in_order(letters))
        return "".join(words)

    def piece_of(self, letters: str) -> Piece:
        """Return the piece of H whose statuses are given by letters, as in `letters`. Collective.

        Raises:
            ValueError: on every rank, if the letters do not match the contact points and laws.
        """
        parts = []
        fits = isinstance(letters, str)
        left = list(letters) if fits else []
        for s, a, b in self.parts():
            number = len(s.in_order)
            word, left = np.array(left[:number]), left[number:]
            codes = {str(status.letters(s.dim)[code]): code for code in s.law_at_points.codes}
            fits = fits and len(word) == number and set(word) <= {*codes, "d"}
            if fits:
                own = word[s.in_order.mine]
                fits = bool(np.array_equal(own == "d", self.clamped[a:b]))
                parts.append([codes.get(c, OPEN) for c in own])
        objection = "the letters of a piece must be the statuses of all points, as in `letters`"
        require(self.comm, fits and not left, objection)
        return Piece(np.concatenate(parts).astype(np.int8))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        super().destroy()
        destroy(self._condensed, self._condensed_at_gamma)
        self._condensed = self._condensed_at_gamma = None


def _checked(problem: ContactProblem, gamma: Any, driven: Any) -> list[tuple[fem.Function, Any]]:
    """Validate arguments of `ParametricContact`; return ``driven`` as a list. Not collective."""
    domain = problem.V.mesh
    if not isinstance(gamma, fem.Constant) or gamma.ufl_shape != ():
        raise ValueError("gamma must be a scalar Constant")
    refuse_other_mesh(gamma, domain, "gamma")
    pairs = []
    for pair in listed(driven, "driven"):
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise ValueError("driven must be a list of pairs: a Function and its UFL expression")
        f = instance(pair[0], "a driven Function", fem.Function)
        refuse_other_mesh(f, domain, f"the driven Function {f.name}")
        expression = ufl.as_ufl(pair[1])
        if expression.ufl_shape != f.ufl_shape:
            raise ValueError(
                f"the driven Function {f.name} has shape {f.ufl_shape}, its expression "
                f"{expression.ufl_shape}"
            )
        refuse_other_mesh(expression, domain, f"the expression that drives {f.name}")
        if not any(is_value_of(f, bc) for bc in problem.bcs):
            raise ValueError(f"the driven Function {f.name} is not in a Dirichlet condition")
        pairs.append((f, expression))
    return pairs


def _require_own(problem: ContactProblem, gamma: fem.Constant, driven: Any) -> list[Datum]:
    """Return the data of the problem and of ``driven`` after checking gamma and driven Functions.

    Values of Dirichlet conditions are not included.

    Raises:
        ValueError: if gamma is the value of a Dirichlet condition, which is not differentiated; if
            a Function is driven twice or occurs in the data; or if an unknown occurs in ``driven``.
    """
    if any(is_value_of(gamma, bc) for bc in problem.bcs):
        raise ValueError(
            "gamma is the value of a Dirichlet condition itself: use a Function there and pass the "
            "pair of this Function and gamma in driven"
        )
    driving = data_within([e for _, e in driven])
    data = [*placed_data(problem.equations, conditions=False), *driving]
    for i, (f, _) in enumerate(driven):
        if any(_share(f, other) for other, _ in driven[:i]):
            raise ValueError(f"the Function {f.name} is driven twice: pass one expression for it")
        for d in data:
            if _share(f, d.value):
                raise ValueError(
                    f"{d.place} is a driven Function, whose change with gamma has no effect there: "
                    "use its expression of gamma instead"
                )
    for d in driving:
        if any(_share(f, d.value) for f in problem.fields):
            raise ValueError(f"{d.place} is an unknown, which must not drive Dirichlet data")
    return data


def _share(f: fem.Function, other: Any) -> bool:
    """Return whether two Functions share the memory of their values."""
    return hasattr(other, "x") and np.shares_memory(f.x.array, other.x.array)
