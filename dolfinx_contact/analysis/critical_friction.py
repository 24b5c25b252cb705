# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Critical friction: coefficients at which slipping solutions come in continua.

With all contact points closed and slipping along unit tangents d (transverse slip held), S the
stiffness of the contact points, a slip v d takes the shear r_t = S_tt v and the pressure
r_n = S_nt v. Where

    S_tt v = F S_nt v

v may be added to a solution that slips with this F, as long as v is real, pressure is left and
slip continues the same way (Hassani, Hild, Ionescu and Sakki, A mixed finite element method and
solution multiplicity for Coulomb frictional contact, Comput. Methods Appl. Mech. Engrg. 192, 2003;
Hassani, Hild and Ionescu, Sufficient conditions of non-uniqueness for the Coulomb friction problem,
Math. Methods Appl. Sci. 27, 2004). F > 0 belongs to slip against d (r_t = F r_n), F < 0 to slip
along d: mirroring the body changes the sign.

A slip of one sign may be added to every state at the bound of friction, also where nothing has
slipped yet, and as far as pressure is left. A slip of both signs may be added where all points have
slipped already and are pressed, as far as the smallest of these slips allows: sliding states under
load come in continua there too. A complex pair brings none.

With the shear f = S_tt v as the unknown this is T f = f/F, where T f is the pressure that a shear f
brings about at contact points that stay closed: one solve with the stiffness of the body held so,
and the largest eigenvalues of T are the smallest coefficients. Where only these are computed, a
second search, from another start and among what the first has left, shows how far it has come. A
factorised body is searched by SLEPc. By multigrid T is only applied to what is found: the search is
Davidson's (`solvers.davidson`), which takes a cycle where SLEPc takes a solve of twenty.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._install import slepc
from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._petsc import as_raised, options_in_database, staged
from dolfinx_contact._validate import is_count
from dolfinx_contact.analysis.rows import Problem, static_equations
from dolfinx_contact.analysis.slip import Direction, Slip, SlipPattern
from dolfinx_contact.analysis.slip_modes import SlipModes
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.measures import require_solution
from dolfinx_contact.reduced.held_body import HeldBody, HeldField, columns_of, with_dirichlet_rows
from dolfinx_contact.solvers.davidson import Davidson
from dolfinx_contact.solvers.held_multigrid import HeldMultigrid, have_own_nodes

__all__ = [
    "CriticalFriction",
    "check_request",
    "critical_friction",
    "held_body",
    "softness_of",
    "solver_of_body",
    "takes_all",
]

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

#: Points up to which all eigenvalues are computed; by multigrid that takes one solve a point.
_DENSE = {"direct": 512, "amg": 64}
_LARGEST_DIRECT = {2: 400_000, 3: 60_000}  # unknowns of the body, estimates
_TIGHT = 1e-10  # residual of the vectors that multigrid finds, over their eigenvalues
_ROUGH = 3e-3  # relative error of the one beyond,
_UNSEEN = 2e-2  # and by how much one that the search takes for it may be smaller
_SMALL = 1e-3  # of the largest, eigenvalues that it does not look for
_NOTHING = 1e-11  # that is none at all
_WIDEST = 16  # times as many eigenvalues where none of the first is of one sign
_FAR = 1e-6  # relative margin of the size up to which coefficients are known
_DEFAULTS: dict[str, dict[str, Any]] = {
    "direct": {"eps_type": "krylovschur", "eps_tol": 1e-12, "eps_max_it": 500},
    "amg": {"eps_type": "krylovschur", "eps_tol": 1e-8, "eps_max_it": 500},
}
_SOLVERS = ("auto", "direct", "amg")
#: How the body is solved: by a factorisation, by multigrid, or by size.
BodySolverKind = Literal["auto", "direct", "amg"]


@dataclass(frozen=True)
class CriticalFriction:
    """Coefficients of friction F at which slips may be added to a slipping solution.

    Attributes:
        friction: that of smallest size with a real slip of one sign; positive of points that slip
            against the directions d (r_t = F r_n), negative of those that slip along them, also
            with ``direction="solution"``; None if there is none up to `known_up_to`, which shows
            nothing of what is beyond.
        slips: v of `friction`, one value a point, nonnegative, the largest 1; empty if there is
            none. Of coefficients that are equal to 1e-9, or to `residual` if that is more, all
            combinations of their slips are examined.
        positions: of the points that slip (m, dim), in the order of coordinates.
        one_signed: all F found with real slips of one sign, by size.
        mixed: those with real slips of both signs, by size: continua of states in which all points
            have slipped, under load.
        unreal: complex ones, by size: they bring no continua.
        known_up_to: size below which all F are among these; infinite if all were computed. A finite
            one is where a second search found the next, which is a check and no proof; by multigrid
            it is roughly found, and the size is two per cent less.
        complete: whether all F were computed; else those of smallest size were.
        displacement: of the body with `slips`.
        residual: the largest |T f - f/F| |F_1|/|f| of all that are listed, F_1 the smallest, T as
            the solver has it: 1/F is known no better.
        solver: ``direct`` or ``amg``.
        solves: with the body, as far as they are counted: by multigrid alone.
        iterations: cycles of multigrid, in these and in the search for eigenvalues.
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
        """Coefficients that have no slip of one sign, mixed and complex, by size."""
        # Of two that mirror each other the positive one comes first, as in the lists.
        others = [*map(complex, self.mixed), *self.unreal]
        return sorted(others, key=lambda F: (float(f"{abs(F):.9e}"), -F.real, -F.imag))


def check_request(a: Arguments) -> None:
    """Raise ``ValueError`` for a ``count`` or a ``solver`` that is none."""
    if not is_count(a.count):
        raise ValueError(f"the number of eigenvalues must be 1 or more, got {a.count!r}")
    kind = _wanted(a.solver)
    if kind not in _SOLVERS:
        raise ValueError(f"unknown solver of the body {kind!r}; known: {', '.join(_SOLVERS)}")


def _wanted(solver: str) -> str:
    """The required solver: PETSc's options win."""
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
    """Critical coefficients of friction of a body in contact. Collective.

    The friction of the law does not matter: all points that slip rub with one F. Those of
    `Frictionless` surfaces do not, nor those that slip with a bound given in advance (Tresca): they
    stay closed, and move along the surface as they like. A bulk that is not linear is
    taken at the displacement in the Functions. With more than 512 points only the coefficients of
    smallest size are computed, and nothing is known of those beyond `CriticalFriction.known_up_to`:
    raise ``count``, or take all with ``dense=True``.

    Args:
        problem: the contact problem, nodal or mixed.
        direction: of the slip d. A vector, whose tangential part is taken: all contact points are
            in contact and slip; by default t = (-n_y, n_x) in 2D. Or ``"solution"``: the points
            that slip in the solution in the Functions, as they do; others are stuck or open.
        count: of eigenvalues that are computed where there are too many points for all; if none of
            them is real and of one sign, up to 16 times as many. Beyond the first they often lie
            close together, and take long. How far they reach is `CriticalFriction.known_up_to`. By
            multigrid those above a thousand times the first are not looked for.
        dense: whether all are computed; by default with up to 512 points, 64 by multigrid.
        solver: of the body, ``direct`` or ``amg``: multigrid, for contact at nodes. By default,
            multigrid above 4 10^5 unknowns in 2D and 6 10^4 in 3D. ``-analysis_linear_solver``
            wins.

    Raises:
        ValueError: on every rank, for a direction that is none, integral contact, or if no point
            can slip, or the body slides freely; for an unknown solver, and multigrid where a point
            has no node of its own.
        RuntimeError: if SLEPc, or multigrid, does not converge, or by multigrid the body is not
            stable with its contact points held.
    """
    eq = static_equations(problem)
    state = problem.evaluate()
    if isinstance(direction, str):
        require_solution(problem)
    slip = Slip(eq, SlipPattern.of(eq, direction, state, by_law=True), hold_across=True)
    slip.require_held()
    operator = _PressureByShear(eq, slip, state.u, solver)
    try:
        complete = takes_all(dense, slip.number, operator.solver)
        modes = operator.all() if complete else operator.smallest(int(count))
        return _collected(problem, operator, slip, modes, complete)
    finally:
        operator.destroy()
        slip.destroy()


def solver_of_body(eq: ContactEquations, rows: list[PETSc.Mat], solver: str) -> str:
    """``direct`` or ``amg``: PETSc's options win, then the given one, then size. Collective.

    By itself multigrid is for large bodies where each row has a node of its own.
    """
    kind = _wanted(solver)
    if kind != "auto":
        return kind
    large = sum(eq.global_sizes) > _LARGEST_DIRECT[eq.dim]
    return "amg" if large and have_own_nodes(rows, eq.dim) else "direct"


def held_body(
    eq: ContactEquations, u: Array, rows: list[PETSc.Mat], kind: str
) -> HeldBody | HeldMultigrid:
    """The body with rows held, by a solver of `solver_of_body`. Collective."""
    if kind == "amg":
        return HeldMultigrid(eq, u, rows, "analysis_")
    K = with_dirichlet_rows(eq.bulk.stiffness(u), eq, eq.stiffness_scale)
    body = HeldBody(eq.comm, [HeldField(K, rows)], eq.stiffness_scale)
    K.destroy()
    return body


def takes_all(dense: bool | None, number: int, kind: str) -> bool:
    """Whether all coefficients of so many points are computed."""
    return number <= _DENSE[kind] if dense is None else bool(dense)


class _PressureByShear:
    """T: shears at the points that slip to the pressures there, forces."""

    def __init__(self, eq: ContactEquations, slip: Slip, u: Array, solver: str):
        self.comm = eq.comm
        self._slip = slip
        self._softness = softness_of(slip.D, eq.bulk.stiffness(u))
        rows = [slip.N, slip.H]
        self.solver = solver_of_body(eq, rows, solver)
        self._body = held_body(eq, u, rows, self.solver)
        self._u, self._f = slip.D.createVecs()
        self._cycles = 0

    def solve(self, shear: Array, *start: Array) -> tuple[Array, Array]:
        """Displacement and pressures, owned, for the shears of this rank.

        Args:
            shear: f.
            start: of multigrid, if there is one.
        """
        self._f.array[:] = shear
        self._slip.D.multTranspose(self._f, self._u)
        u, pressure, _ = self._body.solve(self._u.array_r, *start)
        return u, pressure

    def _answer(self, shear: PETSc.Vec) -> tuple[Array, Array]:
        """What `solve` finds, without a solve where there is no shear."""
        if shear.norm() > 0:
            return self.solve(shear.array_r)
        return np.zeros(self._u.getLocalSize()), np.zeros(shear.getLocalSize())

    @property
    def work(self) -> tuple[int, int]:
        """Solves by multigrid, and cycles in these and in the search for eigenvalues."""
        body = self._body
        if isinstance(body, HeldMultigrid):
            return body.solves, body.iterations + self._cycles
        return 0, 0

    def slips(self, u: Array) -> Array:
        """D u."""
        self._u.array[:] = u
        self._slip.D.mult(self._u, self._f)
        return self._f.array_r.copy()

    def all(self) -> SlipModes:
        """All eigenvalues of T, and the slips and shears of their vectors."""
        D = self._slip.D
        softness = np.concatenate(self.comm.allgather(self._softness))
        parts = self.comm.gather(self._body.respond(columns_of(D), D))

        def modes() -> SlipModes:
            flexibility, T = (np.concatenate(p) for p in zip(*parts, strict=True))
            return SlipModes.of_matrix(T, flexibility, softness)

        return on_root(self.comm, modes)

    def smallest(self, count: int) -> SlipModes:
        """The smallest F, and more of them if none is of one sign."""
        body = self._body
        if isinstance(body, HeldMultigrid) and body.symmetric and body.leaves_alone(self._slip.D):
            return self._by_davidson(body, count)
        for more in (1, 4, 16):
            modes = self._by_slepc(more * count)
            first = np.abs(modes.friction[modes.one_signed]).min(initial=np.inf)
            if first <= modes.known_up_to or more * count >= self._slip.number:
                break
        return modes

    def _by_davidson(self, body: HeldMultigrid, count: int) -> SlipModes:
        """Eigenvalues of T of largest size, one after the other, without products with T.

        With those that are kept the search for the next shows how far they are known, roughly at
        first: among eigenvalues that are close together it may see one that is not the largest. T
        on the shears f that are kept says what their eigenvalues are: from f, the slips E f and T f
        these are those of (f^T E f)^-1 f^T E T f.
        """
        search = body.eigenvalues(self._slip.D, 1.0 / np.sqrt(self._softness))
        seen: list[tuple[Array, Array, Array]] = []
        most = min(_WIDEST * count, self._slip.number)
        try:
            while True:
                known = self._known_beyond(search)
                small = search.size <= max(_SMALL * search.largest, _NOTHING)
                if small or search.error > _ROUGH * search.size:  # no residual, and yet unknown
                    most = search.number
                if search.number >= min(count, most):
                    modes = self._on_shears(seen, known)
                    first = np.abs(modes.friction[modes.one_signed]).min(initial=np.inf)
                    if first <= known or search.number >= most:
                        return modes
                search.converge(_TIGHT)
                for shear, start in zip(*(columns.T for columns in search.keep()), strict=True):
                    u, pressure = self.solve(shear, start)
                    seen.append((shear, self.slips(u), pressure))
        finally:
            self._cycles += search.cycles
            search.destroy()

    def _known_beyond(self, search: Davidson) -> float:
        """Size of the smallest F that the next search may find."""
        if search.number >= self._slip.number:
            return np.inf
        search.begin()
        search.converge(_ROUGH)
        largest = search.size + max(search.error, _UNSEEN * search.size)
        return (1.0 - _FAR) / largest if search.size > 0 else np.inf

    def _on_shears(self, seen: list[tuple[Array, Array, Array]], known: float) -> SlipModes:
        """Eigenvalues of T on a subspace: shears, the slips they bring, and pressures."""
        m = len(self._softness)
        parts = [np.array([row[i] for row in seen]).reshape(len(seen), m).T for i in range(3)]
        gathered = self.comm.gather([*parts, self._softness])

        def modes() -> SlipModes:
            f, slips, pressures, softness = map(np.concatenate, zip(*gathered, strict=True))
            values, y = np.linalg.eig(np.linalg.solve(f.T @ slips, slips.T @ pressures))
            off = np.linalg.norm(pressures @ y - values * (f @ y), axis=0)
            return SlipModes.of(values, slips @ y, f @ y, known, off, softness)

        return on_root(self.comm, modes)

    def _by_slepc(self, count: int) -> SlipModes:
        """Eigenvalues of T of largest size; SLEPc applies T alone."""
        size = (len(self._slip.places), None)
        T = PETSc.Mat().createPython((size, size), _Product(self), comm=self.comm)
        T.setUp()
        solver = self._largest(T, min(count, self._slip.number), [])
        # SLEPc gives its subspace away before it computes eigenvectors.
        found = solver.getInvariantSubspace() if solver.getConverged() else []
        values = []
        slips = []
        shears = []
        off = []
        real, imaginary = T.createVecs()
        for i in range(solver.getConverged()):
            values.append(solver.getEigenpair(i, real, imaginary))
            shears.append(real.array_r + 1j * imaginary.array_r)
            (a, p), (b, q) = (self._answer(v) for v in (real, imaginary))
            slips.append(self.slips(a) + 1j * self.slips(b))
            residual = p + 1j * q - values[-1] * shears[-1]
            off.append(np.sum(np.abs(residual) ** 2))
        known = self._known_up_to(T, found) if values else 0.0
        for thing in (real, imaginary, solver, *found, T):
            thing.destroy()
        if not values:
            raise RuntimeError("SLEPc found no critical friction: raise analysis_eps_max_it")
        slip, shear = (np.concatenate(self.comm.allgather(np.array(v).T)) for v in (slips, shears))
        residuals = np.sqrt(self.comm.allreduce(np.array(off)))
        softness = np.concatenate(self.comm.allgather(self._softness))
        everything = np.array(values), slip, shear, known, residuals, softness
        return on_root(self.comm, lambda: SlipModes.of(*everything))

    def _known_up_to(self, T: PETSc.Mat, found: list[PETSc.Vec]) -> float:
        """Size of the smallest F that belongs to none of the vectors found; 0 if it is not found.

        In what an invariant subspace leaves T has its other eigenvalues. The search begins anew,
        with a random vector of its own, so that it meets what the first has missed.
        """
        if len(found) >= self._slip.number:
            return np.inf
        rest = self._largest(T, 1, found)
        sizes = [abs(rest.getEigenvalue(i)) for i in range(rest.getConverged())]
        rest.destroy()
        largest = max(sizes, default=np.inf)
        return (1.0 - _FAR) / largest if largest > 0 else np.inf

    def _largest(self, T: PETSc.Mat, count: int, without: list[PETSc.Vec]) -> Any:
        """The solver that has looked for the largest eigenvalues outside of a subspace."""
        SLEPc = slepc()
        solver = SLEPc.EPS().create(self.comm)
        solver.setOperators(T)
        solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
        # Products by multigrid are dear, and vectors of the contact points are not.
        room = 2 * count + 30 if self.solver == "amg" else PETSc.DEFAULT
        solver.setDimensions(count, min(room, self._slip.number))
        if without:
            solver.setDeflationSpace(without)
        solver.setOptionsPrefix("analysis_")
        with options_in_database("analysis_", _DEFAULTS[self.solver]), as_raised():
            solver.setFromOptions()
            solver.solve()
        return solver

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._body.destroy()
        self._u.destroy(), self._f.destroy()


def softness_of(D: PETSc.Mat, K: PETSc.Mat) -> Array:
    """Slip of each point of this rank by a force where all else is held (m,). Collective."""
    first, columns, values = D.getValuesCSR()
    squared = PETSc.Mat().createAIJ(D.getSizes(), csr=(first, columns, values**2), comm=D.comm)
    diagonal, slips = squared.createVecs()
    K.getDiagonal(diagonal)
    diagonal.array[:] = 1.0 / np.abs(diagonal.array_r)
    squared.mult(diagonal, slips)
    softness = slips.array_r.copy()
    for thing in (squared, diagonal, slips):
        thing.destroy()
    return softness


class _Product:
    """The methods of T that PETSc requires."""

    def __init__(self, operator: _PressureByShear):
        self._operator = operator

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self._operator.solve(x.array_r)[1]


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
