# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Renard's criterion: friction below which a solution is unique.

At every contact point of a solution, let xi be the direction of the slip (xi = u_t/|u_t| where u_t
does not vanish) or of the shear (r_t = -F r_n xi, |xi| <= 1). For another solution, let a be the
difference of the jumps and r = S a the difference of the forces. Since u_t -> u_t/|u_t| is
monotone, a_n r_n <= 0 and a_t.(r_t + F r_n xi) <= 0 at every point. Hence the solution is unique if

    a.S a + F sum_i (a_t.xi)_i (S a)_n,i > 0    for all a != 0,

the discrete form of Y. Renard, A uniqueness criterion for the Signorini problem with Coulomb
friction, SIAM J. Math. Anal. 38 (2006) 452-467. The criterion holds up to a coefficient F_R, which
follows from an eigenproblem. For one point with the stiffness [[k_t, k], [k, k_n]] and |xi| = 1,
F_R = 2 sqrt(k_t k_n - k^2)/k_n.

In terms of the forces r, the form is r.A r + F (A r).X r. A = B K^{-1} B^T is the flexibility, with
the stiffness K and the jumps B u, and X = xi in the entries (tangent, normal) of every point; the
largest eigenvalue mu of -sym(A X) r = mu A r is 1/F_R.

**Weights.** The solution is also unique if *some* sum of the inequalities with positive weights is
positive,

    sum_i [ beta_i a_n r_n + alpha_i a_t.(r_t + F r_n xi) ]_i  >  0    for all a != 0.

Renard's criterion has unit weights. For the point above with k > 0, optimal weights prove
uniqueness for F < k_t/k if xi = -1 (beyond, some loads have several solutions) and for every F if
xi = 1. One set of weights is valid on an interval of F; the range of F is covered by overlapping
intervals. The least eigenvalue of the sum, scaled to a unit diagonal, is maximised over the
logarithms of the weights, using a soft minimum of several small eigenvalues as in `proofs.weights`.
The search solves many dense eigenproblems.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective, everywhere, maximum, minimum, require
from dolfinx_contact._petsc import Entries, destroy, matrix_of, stacked, staged
from dolfinx_contact.analysis.rows import (
    Problem,
    component_rows,
    free_tangents,
    is_free,
    matrix_of_product,
    on_gathered,
    point_normals,
    require_nodes,
    solve_eigenproblem,
    split,
    static_equations,
    unit,
)
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import require_solution
from dolfinx_contact.proofs.weights import maximise
from dolfinx_contact.reduced.constrained_body import (
    ConstrainedBody,
    ConstrainedField,
    columns_of,
    with_dirichlet_rows,
)
from dolfinx_contact.results.indicators import small_sliding_violated

__all__ = ["Renard", "WeightedForm", "criterion_at", "renard_criterion"]

#: Directions of slip (n, dim) at positions (n, dim).
Field = Callable[[Array], npt.ArrayLike]

_DENSE = 1200  # components of jumps up to which the eigenproblem is dense
_EFFORT = 60  # iterations of a search for weights
_NOTHING = 1e-9  # slip or force that counts as zero, relative to body size and largest force
_DEFAULTS = {"eps_type": "krylovschur", "eps_tol": 1e-10, "eps_max_it": 500}
_ENOUGH = 1e-7  # least eigenvalue, relative to a unit diagonal, at which a search ends
_SPREAD = 12.0  # largest magnitude of the logarithm of a weight
_TAUS = 0.05, 0.01, 0.003  # widths of the soft minimum, one stage each
#: Steps of the friction factor, by multiplication; each is repeated as long as weights are found.
_STEPS = (2.0, 1.3, 1.1, 1.03, 1.01, 1.003, 1.001)
_MOST = 1e3  # largest friction factor


@dataclass(frozen=True)
class Renard:
    """Result of Renard's criterion for a solution.

    Attributes:
        factor: factor on the friction coefficients below which a solution with these directions of
            slip and shear is unique; infinite without friction, or if no point slips or is in
            contact.
        friction: coefficient below which the solution is unique, `factor` times the friction
            coefficient; None if it varies between points.
        definite: whether the stiffness is symmetric and positive definite, a condition of the
            criterion.
        doubt: description of slips too large for the criterion, which requires small sliding; empty
            if sliding is small.
        unique: whether the solution is proved unique at its present friction.
    """

    factor: float
    friction: float | None
    definite: bool = True
    doubt: str = ""

    @property
    def unique(self) -> bool:
        """Whether the solution is proved to be unique; False means undecided."""
        return self.definite and self.factor > 1.0 + 1e-9 and not self.doubt


def _check(a: Arguments) -> None:
    if a.weights and a.dense is False:
        raise ValueError("weights require the dense eigenproblem")
    if a.directions is not None and not callable(a.directions):
        raise ValueError(f"directions must be a function of positions, got {a.directions!r}")


@collective("Renard's criterion", _check)
@staged("ContactUniqueness")
def renard_criterion(
    problem: Problem,
    directions: Field | None = None,
    *,
    dense: bool | None = None,
    weights: bool = False,
) -> Renard:
    """Compute Renard's bound on the friction below which the solution is unique. Collective.

    The solution is the one in the Functions, unless ``directions`` are given.

    Args:
        problem: solved contact problem, nodal or mixed, with a linear bulk and Coulomb's law, or a
            law whose solution is always unique (Tresca, no friction).
        directions: function mapping positions of shape (n, dim) to tangential vectors xi of shape
            (n, dim) with lengths up to 1; for solutions that are not known. Default: the directions
            of the solution in the Functions.
        dense: whether to use dense matrices. Default: for up to 1200 components of jumps, and with
            ``weights``.
        weights: whether to search for weights that increase `Renard.factor`; needs dense matrices.
            Default: False.

    Returns:
        Factor on the friction coefficients below which the solution is unique, with the conditions
        of the criterion.

    Raises:
        ValueError: on every rank, for another law or bulk, invalid directions, or weights without
            a dense eigenproblem.
        RuntimeError: if SLEPc does not converge.
    """
    eq = static_equations(problem)
    require_nodes(eq)
    require(eq.comm, eq.bulk.linear, "the criterion needs a bulk that is linear in u")
    evaluation = problem.evaluate()
    if directions is None:
        require_solution(problem)
    effort = _EFFORT if weights else 0
    found = criterion_at(
        eq, evaluation, directions=directions, dense=dense or (weights or None), effort=effort
    )
    # Given directions belong to no state whose sliding could be measured.
    if directions is not None:
        return found
    return replace(found, doubt=small_sliding_violated(eq, evaluation))


def criterion_at(
    eq: ContactEquations,
    evaluation: Evaluation,
    *,
    directions: Field | None = None,
    dense: bool | None = None,
    effort: int = 0,
    enough: float = np.inf,
    seconds: float = np.inf,
) -> Renard:
    """Evaluate Renard's criterion at a state of a problem to which it applies. Collective.

    Args:
        eq: contact problem.
        evaluation: evaluation of the state.
        directions: function that maps positions to tangential vectors, as for `renard_criterion`;
            default: the directions of slip and shear at the state.
        dense: whether to use dense matrices. Default: for up to 1200 components of jumps.
        effort: largest number of iterations in each search for weights (`WeightedForm.largest`),
            which requires dense matrices; 0 for no search.
        enough: friction factor at which the search for weights ends.
        seconds: time limit of the search for weights in seconds.
    """
    slope = _slopes(eq, evaluation)
    xi = _of_solution(eq, evaluation, slope) if directions is None else _given(eq, directions)
    largest = maximum(eq.comm, slope)
    least = minimum(eq.comm, slope, np.inf)
    factor = np.inf
    definite = True
    if len(eq.scaling.loose):
        factor = 0.0  # the form vanishes for rigid motions
        definite = False
    elif largest > 0:
        form = _Form(eq, slope[:, None] * xi)
        definite = form.definite
        try:
            small = form.number <= _DENSE if dense is None else dense
            if definite and small:
                factor = form.by_factorisation(effort, enough, seconds)
            else:
                factor = form.by_slepc() if definite else 0.0
        finally:
            form.destroy()
    same = least >= (1 - _NOTHING) * largest
    return Renard(factor, factor * largest if same else None, definite)


def _slopes(eq: ContactEquations, evaluation: Evaluation) -> Array:
    """Return the friction coefficients at the points of this rank; 0 for a prescribed bound."""
    slopes = []
    for s, known in zip(eq.surfaces, evaluation.surfaces, strict=True):
        if s.law.bound_kind not in ("proportional", "given"):
            raise ValueError(f"{s.name}: the criterion requires Coulomb's law, got {s.law}")
        slope = known.answers.unit_bound
        slopes.append(slope if s.law.bound_kind == "proportional" else np.zeros_like(slope))
    return np.concatenate(slopes)


def _of_solution(eq: ContactEquations, evaluation: Evaluation, slope: Array) -> Array:
    """Return the directions of slip or shear of a solution, shape (n, dim). Collective.

    They are the vectors xi of the module at the n points of this rank.
    """
    n = point_normals(eq)
    _, ut = split(n, np.concatenate([s.jump for s in evaluation.surfaces]))
    tension, rt = split(n, np.concatenate([s.traction for s in evaluation.surfaces]))
    bound = -slope * tension
    pressed = maximum(eq.comm, bound)
    presses = bound > _NOTHING * pressed
    along = unit(ut, _NOTHING * eq.body_size)
    against = -rt / np.where(presses, bound, np.inf)[:, None]
    xi = np.where(along.any(axis=1, keepdims=True), along, against)
    return xi / np.maximum(np.linalg.norm(xi, axis=1), 1.0)[:, None]


def _given(eq: ContactEquations, directions: Field) -> Array:
    """Return the tangential parts of prescribed directions, shape (n, dim). Collective.

    They are evaluated at the n points of this rank.
    """
    x = np.concatenate([s.positions for s in eq.surfaces])
    n = point_normals(eq)
    with everywhere(eq.comm, "directions"):
        xi = np.asarray(directions(x), dtype=np.float64)
        fits = xi.shape == x.shape and bool(np.isfinite(xi).all())
        if not fits or np.linalg.norm(xi, axis=1).max(initial=0.0) > 1 + 1e-12:
            raise ValueError(f"directions must return vectors of length 1 at most, shape {x.shape}")
    return split(n, xi)[1]


class _Form:
    """Matrices A (flexibility) and F X of the module, for the free components of the jumps.

    Args:
        eq: contact problem.
        friction: friction coefficients times directions, F xi, at the n points of this rank, shape
            (n, dim).

    Attributes:
        number: number of free components on all ranks.
        definite: whether the stiffness of the body is positive definite.
    """

    def __init__(self, eq: ContactEquations, friction: Array):
        self._eq = eq
        self.comm = eq.comm
        n = point_normals(eq)
        pressed = np.flatnonzero(is_free(eq, n))
        point, tangents = free_tangents(eq)
        N = component_rows(eq, pressed, n[pressed])
        T = component_rows(eq, point, tangents)
        self._R = stacked([N, T])
        destroy(N, T)
        self.number = self._R.getSize()[0]
        # One weight for the normal of each point, and one for all its tangents.
        offset = 2 * (self.comm.exscan(len(n)) or 0)
        self._groups = np.concatenate([offset + 2 * pressed, offset + 2 * point + 1])
        column = np.full(len(n), -1, dtype=np.int64)
        first = self._R.getOwnershipRange()[0]
        column[pressed] = first + np.arange(len(pressed))
        rows = first + len(pressed) + np.arange(len(point), dtype=np.int64)
        entries = Entries(rows, column[point])
        size = self._R.getLocalSize()[0]
        self._X = matrix_of(self.comm, (size, size), entries)
        # Rows are along n; a pressure acts on the body along -n.
        entries.add(-np.sum(friction[point] * tangents, axis=1), self._X)
        u = eq.bulk.displacement.x.array.copy()
        self._K = with_dirichlet_rows(eq.bulk.stiffness(u), eq, eq.scaling.stiffness)
        self._free = ConstrainedBody(eq.comm, [ConstrainedField(self._K, [])], eq.scaling.stiffness)
        self.definite = self._free.definite

    def by_factorisation(self, effort: int, enough: float, seconds: float) -> float:
        """Compute `Renard.factor` using dense matrices.

        Args:
            effort: largest number of iterations in each search for weights that increase the
                factor; 0 for no search.
            enough: factor at which this search ends.
            seconds: time limit of this search.
        """
        A, _ = self._free.respond(columns_of(self._R), self._R)
        X = self._X.convert("dense", PETSc.Mat())
        mine = X.getDenseArray(readonly=True).copy()
        X.destroy()

        def solved(A: Array, X: Array, groups: Ints) -> float:
            form = -(A @ X + (A @ X).T) / 2
            last = self.number - 1
            values = eigh(form, (A + A.T) / 2, eigvals_only=True, subset_by_index=(last, last))
            factor = _over(float(values[0]))
            if effort > 0 and factor < enough:
                S = np.linalg.inv((A + A.T) / 2)
                numbers = np.unique(groups, return_inverse=True)[1]
                weighted = WeightedForm((S + S.T) / 2, X @ S, numbers)
                found = weighted.largest(enough=enough, effort=effort, seconds=seconds)
                factor = max(factor, found)
            return factor

        return on_gathered(self.comm, solved, A, mine, self._groups)

    def by_slepc(self) -> float:
        """Compute `Renard.factor` by SLEPc, using products with A and with its inverse."""
        SLEPc = optional("slepc4py.SLEPc", "solver")
        R, X = self._R, self._X
        held = ConstrainedBody(
            self.comm, [ConstrainedField(self._K, [R])], self._eq.scaling.stiffness
        )

        def product(x: PETSc.Vec, y: PETSc.Vec) -> None:
            """Multiply by -(X + S X^T A)/2, whose largest eigenvalue is 1/F_R (S: stiffness)."""
            u, a = R.createVecs()
            R.multTranspose(x, u)
            u.array[:] = self._free.solve(u.array_r)[0]
            R.mult(u, a)
            turned = a.duplicate()
            X.multTranspose(a, turned)
            X.mult(x, y)
            # The forces that cause the jumps are the negative multipliers.
            y.array[:] -= held.solve(np.zeros(0), turned.array_r)[1]
            y.scale(-0.5)
            destroy(u, a, turned)

        M = matrix_of_product(self.comm, R.getLocalSize()[0], product)
        solver = SLEPc.EPS().create(self.comm)
        solver.setOperators(M)
        solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
        solve_eigenproblem(solver, _DEFAULTS)
        found = solver.getConverged()
        largest = solver.getEigenvalue(0).real if found else np.nan
        destroy(solver, M, held)
        if not found:
            raise RuntimeError("SLEPc found no eigenvalue: increase -analysis_eps_max_it")
        return _over(float(largest))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self._R, self._X, self._K, self._free)


def _over(largest: float) -> float:
    """Return the friction factor 1/largest; infinite if the eigenvalue is not positive."""
    return 1.0 / largest if largest > 0 else np.inf


@dataclass(frozen=True, eq=False)
class WeightedForm:
    """Weighted sum of the inequalities at a solution (see the module).

    The sum is the quadratic form of S + f G with the friction factor f, after each row is
    multiplied by its weight.

    Attributes:
        S: stiffness of the n free components of the jumps, symmetric positive definite, shape
            (n, n).
        G: matrix of friction: the row of a tangential component is the friction coefficient times
            this component of the direction xi, times the row of S of the normal force at the point;
            other rows are 0; shape (n, n).
        groups: index of the weight of each component, shape (n,); all tangents of a point have
            the same weight.
    """

    S: Array
    G: Array
    groups: Ints

    def interval(self, weights: Array, factor: float) -> tuple[float, float]:
        """Return friction factors between which the weighted sum is positive definite.

        Args:
            weights: positive weights, shape (number of groups,).
            factor: factor inside the interval, which is empty if the sum is not definite there.
        """
        w = weights[self.groups][:, None]
        form, slope = (w * M + (w * M).T for M in (self.S + factor * self.G, self.G))
        unit = 1 / np.sqrt(np.abs(np.diag(form)))
        last = len(form) - 1
        form, slope = (unit[:, None] * M * unit for M in (form, slope))
        if np.linalg.eigvalsh(form)[0] <= _ENOUGH / 2:
            return factor, factor
        values = eigh(slope, form, eigvals_only=True, subset_by_index=(0, last))
        down, up = (1 / max(value, 1 / _MOST) for value in (values[-1], -values[0]))
        return factor - down, factor + up

    def largest(self, *, enough: float = _MOST, effort: int = 60, seconds: float = np.inf) -> float:
        """Search for weights; return the friction factor up to which they prove uniqueness.

        Args:
            enough: factor at which the search ends; default: 1000.
            effort: largest number of iterations of each search; default: 60.
            seconds: time limit of all searches; default: none.
        """
        end = time.monotonic() + seconds
        logs: Array = np.zeros(int(self.groups.max(initial=-1)) + 1)
        _, best = self.interval(np.exp(logs), 0.0)
        for step in _STEPS:
            while best < enough and time.monotonic() < end:
                factor = min(step * best, 1.001 * enough)
                new = self._search(logs, factor, effort, end)
                if new is None:
                    break
                low, high = self.interval(np.exp(new), factor)
                if not low <= best < high:
                    break
                best = high
                logs = new
        return min(best, _MOST)

    def _search(self, logs: Array, factor: float, effort: int, end: float) -> Array | None:
        """Return logarithms of weights for which the weighted sum is positive definite.

        Args:
            logs: initial logarithms of the weights.
            factor: friction factor.
            effort: largest number of iterations.
            end: value of `time.monotonic` at which the search ends.
        """
        R = self.S + factor * self.G
        diagonal = np.diag(R)
        if (diagonal <= 0).any():
            return None
        R = R / np.sqrt(diagonal[:, None] * diagonal)

        def eigenvalues(x: Array) -> tuple[Array, Array, Callable[[Array], Array]]:
            # The form w_i R_ij / sqrt(w_i w_j), symmetric part, whose diagonal is 1.
            half = np.exp(x / 2)[self.groups]
            X = half[:, None] * R / half
            values, V = np.linalg.eigh((X + X.T) / 2)

            def gradient(part: Array) -> Array:
                # d of v.X v / d x_i = (v_i (X v)_i - v_i (X^T v)_i) / 2
                by_row = ((V * (X @ V) - V * (X.T @ V)) * part).sum(axis=1) / 2
                slope = np.zeros_like(x)
                np.add.at(slope, self.groups, by_row)
                return slope

            return values, V, gradient

        least, x, _ = maximise(
            eigenvalues,
            logs,
            limits=[(-_SPREAD, _SPREAD)] * len(logs),
            stages=[(tau, -np.inf) for tau in _TAUS],
            effort=effort,
            enough=_ENOUGH,
            until=end,
        )
        return x if least > _ENOUGH else None
