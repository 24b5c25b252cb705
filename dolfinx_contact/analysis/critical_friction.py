# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Critical friction: coefficients with continua of slipping solutions.

All contact points are closed and slip along unit tangents d; transverse slip is prevented. With the
stiffness S condensed onto the contact points, slips v d, one factor v per point, cause the shears
r_t = S_tt v along d and the pressures r_n = S_nt v. If

    S_tt v = F S_nt v,

a real v can be added to a sliding solution with this F as long as all points remain in contact and
the slip keeps its direction (Hassani, Hild, Ionescu and Sakki, A mixed finite element method and
solution multiplicity for Coulomb frictional contact, Comput. Methods Appl. Mech. Engrg. 192, 2003;
Hassani, Hild and Ionescu, Sufficient conditions of non-uniqueness for the Coulomb friction problem,
Math. Methods Appl. Sci. 27, 2004). F > 0 belongs to sliding in the direction -d (r_t = F r_n),
F < 0 to sliding in the direction d: mirroring the body changes the sign of F.

A slip v of one sign can be added to every state at the friction bound, even without previous slip,
as long as all points remain in contact. A slip v of both signs can be added only if all points have
slipped, up to the smallest of these slips; sliding states under load then also form continua. A
complex pair gives no continuum.

With the shear f = S_tt v as the unknown, the equation is T f = f/F. T f is the pressure caused by a
shear f at contact points that stay closed: one solve with the stiffness of the held body. The
largest eigenvalues of T are the smallest coefficients. If only these are computed, a second search,
from another start and outside the first subspace, determines the magnitude of F up to which the
list is complete. SLEPc is used with a factorisation. With multigrid, Davidson's method
(`davidson`) takes one cycle per step, whereas SLEPc would need about twenty for each solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._petsc import destroy, staged
from dolfinx_contact._validate import count, one_of
from dolfinx_contact.analysis.constrained_multigrid import ConstrainedMultigrid, have_own_nodes
from dolfinx_contact.analysis.davidson import Davidson
from dolfinx_contact.analysis.rows import (
    Problem,
    matrix_of_product,
    on_gathered,
    solve_eigenproblem,
    static_equations,
)
from dolfinx_contact.analysis.slip import Direction, Slip
from dolfinx_contact.analysis.slip_modes import SlipModes
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.measures import require_solution
from dolfinx_contact.reduced.constrained_body import (
    ConstrainedBody,
    ConstrainedField,
    columns_of,
    with_dirichlet_rows,
)

__all__ = [
    "CriticalFriction",
    "check_request",
    "constrained_body",
    "critical_friction",
    "softness_of",
    "solver_of_body",
    "takes_all",
]

#: Points up to which all eigenvalues are computed; multigrid needs one solve per point.
_DENSE = {"direct": 512, "amg": 64}
_LARGEST_DIRECT = {2: 400_000, 3: 60_000}  # unknowns of the body, estimates
_TIGHT = 1e-10  # relative residual of the eigenvectors found by multigrid
_ROUGH = 3e-3  # relative error of the next eigenvalue
_UNSEEN = 2e-2  # relative amount by which the next eigenvalue may be larger than its estimate
_SMALL = 1e-3  # eigenvalues below this fraction of the largest are not searched
_NOTHING = 1e-11  # eigenvalue that counts as zero
_WIDEST = 16  # largest factor of the number of eigenvalues while no slip has one sign
_FAR = 1e-6  # relative margin of the size up to which coefficients are known
_DEFAULTS: dict[str, dict[str, Any]] = {
    "direct": {"eps_type": "krylovschur", "eps_tol": 1e-12, "eps_max_it": 500},
    "amg": {"eps_type": "krylovschur", "eps_tol": 1e-8, "eps_max_it": 500},
}
#: Solver of the body: a factorisation, multigrid, or by size.
BodySolverKind = Literal["auto", "direct", "amg"]


@dataclass(frozen=True)
class CriticalFriction:
    """Critical friction coefficients F of a body whose points slip parallel to unit vectors d.

    At a critical coefficient, slips v d can be added to a sliding solution. They satisfy
    S_tt v = F S_nt v, where S_tt v are the shears and S_nt v the pressures caused by v.

    Attributes:
        friction: coefficient of smallest magnitude with a real slip of one sign: positive if points
            slip in the direction -d, negative in the direction d. None if there is none up to
            `known_up_to`.
        slips: nonnegative slips v of the m slipping points at the coefficient `friction`, scaled to
            a maximum of 1, shape (m,); empty if `friction` is None. If coefficients are equal up to
            1e-9 (or a larger `residual`), v is a combination of their slips.
        positions: positions of the slipping points, shape (m, dim), ordered by coordinates.
        one_signed: coefficients with real slips of one sign, ordered by magnitude.
        mixed: coefficients with real slips of both signs, ordered by magnitude; they give continua
            of loaded states in which all points have slipped.
        unreal: complex coefficients, ordered by magnitude; they give no continua.
        known_up_to: magnitude below which the lists are complete; infinite if all coefficients were
            computed. A finite value comes from a second search, which is a check and not a proof.
            With multigrid the search is rough, and the value is reduced by two per cent.
        complete: whether all coefficients were computed.
        displacement: displacement of the body in which the points have the slips `slips`.
        residual: error bound of 1/F relative to 1/|F_1| of the smallest coefficient F_1: largest |T
            f - f/F| |F_1|/|f| in the lists, where T maps the shears f = S_tt v to pressures.
        solver: solver of the body, ``direct`` or ``amg``.
        solves: number of solves with the body; counted with multigrid only.
        iterations: number of multigrid cycles in the solves and in the search for eigenvalues.
    """

    friction: float | None
    slips: Array
    positions: Array
    one_signed: list[float]
    mixed: list[float]
    unreal: list[complex]
    known_up_to: float
    complete: bool
    displacement: fem.Function
    residual: float = 0.0
    solver: str = "direct"
    solves: int = 0
    iterations: int = 0

    @property
    def others(self) -> list[complex]:
        """Complex coefficients, and those with slips of both signs, ordered by magnitude."""
        # The positive one of two mirrored coefficients comes first, as in the lists.
        others = [*map(complex, self.mixed), *self.unreal]
        return sorted(others, key=lambda F: (float(f"{abs(F):.9e}"), -F.real, -F.imag))


def check_request(a: Arguments) -> None:
    """Raise `ValueError` if ``count`` or ``solver`` is not valid."""
    a.count = count(a.count, "count")
    one_of(_requested(a.solver), "solver", get_args(BodySolverKind))


def _requested(solver: str) -> str:
    """Return the requested solver; the option ``-analysis_linear_solver`` takes precedence."""
    return str(PETSc.Options().getString("analysis_linear_solver", solver))


@collective("critical friction", check_request)
@staged("ContactCriticalFriction")
def critical_friction(
    problem: Problem,
    direction: Direction = None,
    *,
    count: int = 1,
    dense: bool | None = None,
    solver: BodySolverKind = "auto",
) -> CriticalFriction:
    """Compute the critical friction coefficients of a body in contact. Collective.

    The friction coefficient of the law does not matter: all slipping points have the same
    coefficient F. Points of `Frictionless` surfaces, and slipping points with a prescribed bound
    (Tresca), count as frictionless: they stay closed and move freely along the surface. A nonlinear
    bulk is linearised at the displacement in the Functions. With more than 512 points, only the
    coefficients of smallest magnitude are computed, and the lists are complete up to
    `CriticalFriction.known_up_to`. Increase ``count`` for a larger range, or compute all
    coefficients with ``dense=True``.

    Args:
        problem: contact problem, nodal or mixed.
        direction: slip direction d. With a vector, all contact points are closed and d is its
            normalised tangential part; the default in 2D is (-n_y, n_x) for the normal n. With
            ``"solution"``, points slip, stick or are open as in the solution in the Functions.
        count: number of eigenvalues if not all are computed; default 1. If none of them has a real
            slip of one sign, up to 16 times as many are computed. Further eigenvalues are often
            close together and slow to compute. Multigrid does not search for coefficients above a
            thousand times the first.
        dense: whether all eigenvalues are computed; by default up to 512 points, 64 with multigrid.
        solver: linear solver of the body: ``direct``, or ``amg`` (multigrid) for contact at nodes.
            The default is multigrid above 4 10^5 unknowns in 2D and 6 10^4 in 3D.
            ``-analysis_linear_solver`` takes precedence.

    Raises:
        ValueError: on every rank, if the direction or the solver is not valid, contact is integral,
            no point can slip, the body slides freely, or, with multigrid, a point has no node of
            its own.
        RuntimeError: if SLEPc or multigrid does not converge, or, with multigrid, if the body is
            not stable with its contact points held.
    """
    eq = static_equations(problem)
    evaluation = problem.evaluate()
    if isinstance(direction, str):
        require_solution(problem)
    slip = Slip(eq, direction, evaluation)
    slip.require_held()
    operator = _PressureByShear(eq, slip, evaluation.u, solver)
    try:
        complete = takes_all(dense, slip.number, operator.solver)
        modes = operator.all() if complete else operator.smallest(count)
        return _collected(problem, operator, slip, modes, complete)
    finally:
        operator.destroy()
        slip.destroy()


def solver_of_body(eq: ContactEquations, rows: list[PETSc.Mat], solver: str) -> str:
    """Return ``direct`` or ``amg``, as requested or chosen by size. Collective.

    Multigrid is chosen for large bodies if each row has its own node (`constrained_multigrid`).
    """
    kind = _requested(solver)
    if kind != "auto":
        return kind
    large = sum(eq.unknowns.global_sizes) > _LARGEST_DIRECT[eq.dim]
    return "amg" if large and have_own_nodes(rows, eq.dim) else "direct"


def constrained_body(
    eq: ContactEquations, u: Array, rows: list[PETSc.Mat], kind: str
) -> ConstrainedBody | ConstrainedMultigrid:
    """Return a solver of the body with some jump components held at zero. Collective.

    Args:
        eq: contact problem.
        u: displacement at which the stiffness is evaluated.
        rows: matrices of the held jump components.
        kind: ``direct`` or ``amg``, as chosen by `solver_of_body`.
    """
    if kind == "amg":
        return ConstrainedMultigrid(eq, u, rows, "analysis_")
    K = with_dirichlet_rows(eq.bulk.stiffness(u), eq, eq.scaling.stiffness)
    body = ConstrainedBody(eq.comm, [ConstrainedField(K, rows)], eq.scaling.stiffness)
    K.destroy()
    return body


def takes_all(dense: bool | None, number: int, kind: str) -> bool:
    """Return whether all coefficients are computed, rather than only the smallest.

    Args:
        dense: the user's choice; if None, the number of points decides.
        number: number of slipping points.
        kind: solver of the body, ``direct`` or ``amg``.
    """
    return number <= _DENSE[kind] if dense is None else bool(dense)


class _PressureByShear:
    """Operator T that maps shears at the slipping points to pressures. Collective."""

    def __init__(self, eq: ContactEquations, slip: Slip, u: Array, solver: str):
        self.comm = eq.comm
        self._slip = slip
        self._softness = softness_of(slip.D, eq.bulk.stiffness(u))
        rows = [slip.N, slip.H]
        self.solver = solver_of_body(eq, rows, solver)
        self._body = constrained_body(eq, u, rows, self.solver)
        self._u, self._f = slip.D.createVecs()
        self._cycles = 0

    def solve(self, shear: Array, *start: Array) -> tuple[Array, Array]:
        """Return the displacement and the pressures caused by shears, on this rank.

        Args:
            shear: shears f at the slipping points of this rank.
            start: initial guess of the displacement for multigrid.
        """
        self._f.array[:] = shear
        self._slip.D.multTranspose(self._f, self._u)
        u, pressure, _ = self._body.solve(self._u.array_r, *start)
        return u, pressure

    @property
    def work(self) -> tuple[int, int]:
        """Numbers of multigrid solves and of all multigrid cycles; 0 with a factorisation."""
        body = self._body
        if isinstance(body, ConstrainedMultigrid):
            return body.solves, body.iterations + self._cycles
        return 0, 0

    def _respond(self, shear: Array, *start: Array) -> Array:
        """Return shears, and the slips and pressures caused by them, on this rank, shape (3, m).

        An initial guess ``start`` of the displacement is used by multigrid only.
        """
        shear = shear.copy()
        u, pressure = self.solve(shear, *start)
        self._u.array[:] = u
        self._slip.D.mult(self._u, self._f)
        return np.array([shear, self._f.array_r, pressure])

    def all(self) -> SlipModes:
        """Return all coefficients F, from all eigenvalues 1/F of T, with slips and shears."""
        D = self._slip.D
        slips, pressures = self._body.respond(columns_of(D), D)
        return on_gathered(self.comm, SlipModes.of_matrix, slips, pressures, self._softness)

    def smallest(self, count: int) -> SlipModes:
        """Return at least ``count`` coefficients F of smallest magnitude.

        More are computed if none of them has a slip of one sign.
        """
        body = self._body
        if (
            isinstance(body, ConstrainedMultigrid)
            and body.symmetric
            and body.leaves_alone(self._slip.D)
        ):
            return self._by_davidson(body, count)
        for more in (1, 4, 16):
            modes = self._by_slepc(more * count)
            if modes.smallest <= modes.known_up_to or more * count >= self._slip.number:
                break
        return modes

    # -- Davidson's method ------------------------------------------------------------------------

    def _by_davidson(self, body: ConstrainedMultigrid, count: int) -> SlipModes:
        """Compute the coefficients F of smallest magnitude by Davidson's method.

        More than ``count`` are computed if none of them has a slip of one sign. The eigenvalues 1/F
        of T are found in order of decreasing magnitude. An unfinished search for the next
        eigenvalue still gives an upper bound of the remaining magnitudes. Among close eigenvalues
        it may find one that is not the largest.
        """
        search = body.eigenvalues(self._slip.D, 1.0 / np.sqrt(self._softness))
        seen: list[Array] = []
        most = min(_WIDEST * count, self._slip.number)
        try:
            while True:
                known = self._known_beyond(search)
                small = search.size <= max(_SMALL * search.largest, _NOTHING)
                if small or search.error > _ROUGH * search.size:  # round-off hides the others
                    most = search.number
                if search.number >= min(count, most):
                    modes = self._on_shears(seen, known)
                    if modes.smallest <= known or search.number >= most:
                        return modes
                search.converge(_TIGHT)
                for shear, start in zip(*(columns.T for columns in search.keep()), strict=True):
                    seen.append(self._respond(shear, start))
        finally:
            self._cycles += search.cycles
            search.destroy()

    def _known_beyond(self, search: Davidson) -> float:
        """Estimate the magnitude up to which no F is missing by a rough search for the next 1/F."""
        if search.number >= self._slip.number:
            return np.inf
        search.begin()
        search.converge(_ROUGH)
        largest = search.size + max(search.error, _UNSEEN * search.size)
        return (1.0 - _FAR) / largest if search.size > 0 else np.inf

    def _on_shears(self, seen: list[Array], known: float) -> SlipModes:
        """Return the coefficients F from the eigenvalues 1/F of T on a subspace of shears.

        Let the columns of f be shears that span the subspace, E f the slips and T f the pressures
        caused by these shears. The eigenvalues are those of (f^T E f)^-1 f^T E T f.

        Args:
            seen: shears, slips and pressures of each vector of the basis, shape (3, m) each.
            known: magnitude below which no coefficient F is missing.
        """

        def modes(f: Array, slips: Array, pressures: Array, softness: Array) -> SlipModes:
            values, y = np.linalg.eig(np.linalg.solve(slips.T @ f, slips.T @ pressures))
            return SlipModes.of(values, f @ y, slips @ y, pressures @ y, softness, known)

        columns = np.reshape(seen, (len(seen), 3, len(self._softness)))
        return on_gathered(self.comm, modes, *np.moveaxis(columns, 0, 2), self._softness)

    # -- SLEPc ------------------------------------------------------------------------------------

    def _by_slepc(self, count: int) -> SlipModes:
        """Compute the largest eigenvalues 1/F of T by SLEPc, using products with T only."""
        T = matrix_of_product(self.comm, len(self._slip.places), self._mult)
        solver = self._largest(T, min(count, self._slip.number), [])
        subspace = solver.getInvariantSubspace() if solver.getConverged() else []
        seen = [self._respond(shear.array_r) for shear in subspace]
        known = self._known_up_to(T, subspace) if seen else 0.0
        destroy(solver, *subspace, T)
        if not seen:
            raise RuntimeError("SLEPc found no critical friction: increase -analysis_eps_max_it")
        return self._on_shears(seen, known)

    def _mult(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self.solve(x.array_r)[1]

    def _known_up_to(self, T: PETSc.Mat, subspace: list[PETSc.Vec]) -> float:
        """Return the magnitude up to which no coefficient F is missing.

        The remaining eigenvalues of T are searched for outside the subspace of the computed ones,
        which is invariant. This search starts from another random vector and therefore finds
        eigenvalues missed by the first search. The result is 0 if it finds no eigenvalue.
        """
        if len(subspace) >= self._slip.number:
            return np.inf
        rest = self._largest(T, 1, subspace)
        sizes = [abs(rest.getEigenvalue(i)) for i in range(rest.getConverged())]
        rest.destroy()
        largest = max(sizes, default=np.inf)
        return (1.0 - _FAR) / largest if largest > 0 else np.inf

    def _largest(self, T: PETSc.Mat, count: int, without: list[PETSc.Vec]) -> Any:
        """Search for the eigenvalues of T of largest magnitude outside a subspace.

        Args:
            T: matrix-free operator from shears to pressures.
            count: number of eigenvalues.
            without: basis of the excluded subspace.

        Returns:
            SLEPc's EPS object after the solve.
        """
        SLEPc = optional("slepc4py.SLEPc", "solver")
        solver = SLEPc.EPS().create(self.comm)
        solver.setOperators(T)
        solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
        # Products by multigrid are expensive; vectors at the contact points are cheap.
        room = 2 * count + 30 if self.solver == "amg" else PETSc.DEFAULT
        solver.setDimensions(count, min(room, self._slip.number))
        if without:
            solver.setDeflationSpace(without)
        solve_eigenproblem(solver, _DEFAULTS[self.solver])
        return solver

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._body.destroy()
        destroy(self._u, self._f)


def softness_of(D: PETSc.Mat, K: PETSc.Mat) -> Array:
    """Estimate the slip of each point under a unit force, shape (m,). Collective.

    Only the diagonal of the stiffness is used, as if all other unknowns were held.

    Args:
        D: matrix of the slips, one row per point.
        K: stiffness of the body.
    """
    first, columns, values = D.getValuesCSR()
    squared = PETSc.Mat().createAIJ(D.getSizes(), csr=(first, columns, values**2), comm=D.comm)
    diagonal, slips = squared.createVecs()
    K.getDiagonal(diagonal)
    diagonal.array[:] = 1.0 / np.abs(diagonal.array_r)
    squared.mult(diagonal, slips)
    softness = slips.array_r.copy()
    destroy(squared, diagonal, slips)
    return softness


def _collected(
    problem: Problem, operator: _PressureByShear, slip: Slip, modes: SlipModes, complete: bool
) -> CriticalFriction:
    friction = modes.friction
    chosen = np.flatnonzero(modes.one_signed)
    real = friction.imag == 0
    displacement = fem.Function(problem.equations.V, name="critical_slip")
    first, end = slip.D.getOwnershipRange()
    slips = np.zeros((end - first, 0))
    if len(chosen):
        slips = modes.slips.real[first:end, chosen[:1]]
        u, _ = operator.solve(modes.shears.real[first:end, chosen[0]])
        displacement.x.array[: len(u)] = u
        displacement.x.scatter_forward()
    positions, slips = slip.in_order(slips)
    return CriticalFriction(
        friction=float(friction[chosen[0]].real) if len(chosen) else None,
        slips=slips.reshape(-1),
        positions=positions,
        one_signed=[float(f.real) for f in friction[chosen]],
        mixed=[float(f.real) for f in friction[real & ~modes.one_signed]],
        unreal=[complex(f) for f in friction[~real]],
        known_up_to=modes.known_up_to,
        complete=complete,
        displacement=displacement,
        residual=float(modes.residuals.max(initial=0.0)),
        solver=operator.solver,
        solves=operator.work[0],
        iterations=operator.work[1],
    )
