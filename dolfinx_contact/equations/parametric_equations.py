# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problem H(x, gamma) = 0 with a parameter gamma, as a `System` of the continuation."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._compat import dirichlet_value, is_value_of
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._geometry import Gathered, in_space, node_positions
from dolfinx_contact._mpi import require
from dolfinx_contact._petsc import destroy, product
from dolfinx_contact._validate import located
from dolfinx_contact.body.bulk import checksum
from dolfinx_contact.continuation import Events, Piece, Preconditioner, System
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import (
    data_within,
    placed_data,
)
from dolfinx_contact.equations.evaluation import Evaluation, Statuses
from dolfinx_contact.equations.jacobian import JacobianSolver
from dolfinx_contact.equations.measures import measure
from dolfinx_contact.equations.rates import (
    Driven,
    Rate,
    RigidRates,
    SurfaceRates,
    depends_on,
    dirichlet_rates,
)
from dolfinx_contact.equations.validation import check_moduli, check_surface
from dolfinx_contact.laws.status import OPEN
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["ParametricEquations"]

logger = logging.getLogger(__name__)

_MANY_POINTS = 50  # contact points in 3D above which kinks are passed in batches


def _no_solver() -> JacobianSolver:
    raise AssertionError("these equations have no linear solver")


class ParametricEquations(System):
    """Residual H(x, gamma) of a contact problem with a parameter gamma, for the continuation.

    H is piecewise smooth; each piece corresponds to one combination of statuses of the contact
    points (`laws.status`). Evaluations set the Constant gamma and the driven Functions.

    Args:
        equations: contact problem.
        gamma: parameter, a scalar Constant in the bulk, a law, an obstacle, or the load or motion
            of a rigid body. Default: a Constant that does not occur.
        linear: function returning the linear solver of the problem; not needed for a `Reduction`,
            which has its own factorisation.
        driven: pairs of a Function used in a Dirichlet condition and its value, a UFL expression of
            gamma and the position.

    Attributes:
        clamped: mask of the owned points that Dirichlet data clamp; they have no status.
        not_affine: description of the loads and motions that are not affine in gamma; "" if all are
            affine.
        is_linear: whether the body is linear in u with a stiffness that does not depend on gamma,
            and loads and motions are affine in gamma.
    """

    def __init__(
        self,
        equations: ContactEquations,
        gamma: fem.Constant | None = None,
        linear: Callable[[], JacobianSolver] = _no_solver,
        *,
        driven: Sequence[tuple[fem.Function, Any]] = (),
    ):
        if gamma is None:
            gamma = fem.Constant(equations.V.mesh, 0.0)
        self.equations = equations
        self.constant = gamma
        self.comm = equations.comm
        self._linear = linear
        #: Linear solvers of the branches that are being followed, the present one last; shared with
        #: the copies of this system that have another memory.
        self._solvers: list[JacobianSolver] = []
        rate = Rate(gamma)
        self._body_rate = rate.of_form(equations.bulk.residual)
        self._driven = [Driven(f, expression, rate) for f, expression in driven]
        self._rates = [SurfaceRates(s, rate) for s in equations.surfaces]
        self._rigid_rates = RigidRates(equations.rigid, rate)
        self._metric: PETSc.Mat | None = None
        counts = [s.points.number for s in equations.surfaces]
        self.clamped = np.concatenate([c.clamped_points for c in equations.constraints.surfaces])
        self._offsets = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        body = equations.bulk
        driven_by = [d.not_affine for d in self._driven]
        curved = [rate.not_affine(body.residual), *driven_by, self._rigid_rates.not_affine]
        self.not_affine = next(filter(None, curved), "")
        self.is_linear = (
            equations.linear and gamma not in body.jacobian_constants and not self.not_affine
        )
        if self.not_affine and self.comm.rank == 0:
            logger.info("the data are not affine in gamma: %s", self.not_affine)
        self._data = self._given()
        #: Gamma of the driven Functions, in a context in which nothing else changes them.
        self._driven_at: float | None = None
        self._is_undisturbed = False

    # -- data ------------------------------------------------------------------------------------

    def _given(self) -> list[Any]:
        """Return the Functions and Constants of the data, except gamma and the driven Functions.

        Data in the expressions of driven Functions are included.
        """
        driven = [
            dirichlet_value(bc)
            for bc in self.equations.bcs
            if any(is_value_of(d.function, bc) for d in self._driven)
        ]
        ours = (*driven, self.constant)
        driving = [d.value for d in data_within(self._driven_expressions)]
        data = [*(d.value for d in placed_data(self.equations)), *driving]
        return [f for f in data if not any(f is other for other in ours)]

    @property
    def _driven_expressions(self) -> list[Any]:
        """UFL expressions that determine the values of the driven Functions."""
        return [d.expression for d in self._driven]

    def not_affine_in(self, other: fem.Constant) -> str:
        """Return the reason why the data are not affine in another parameter; "" if they are.

        Loads, gaps and fields of the laws must be affine in this parameter. The stiffness, the
        normals and the derivatives with respect to gamma must not contain it.
        """
        eq = self.equations
        rate = Rate(other)
        by_gamma = Rate(self.constant)
        if other in eq.bulk.jacobian_constants:
            return "the stiffness depends on it"
        loads = [eq.bulk.residual, *(d.expression for d in self._driven)]
        loads += [e for b in eq.rigid.bodies for e in b.expressions]
        if any(c is other for e in loads for c in by_gamma.constants_of(e)):
            return "a derivative with respect to the first depends on it"
        if any(depends_on(other, s.given.normal) for s in eq.surfaces):
            return "a normal depends on it"
        laws = [e for s in eq.surfaces for e in (s.given.gap, *s.given.fields.values())]
        return next(filter(None, map(rate.not_affine, [*loads, *laws])), "")

    def _data_mark(self) -> int:
        """Return a checksum of the data on this rank."""
        return checksum(self._data)

    def _set(self, gamma: float) -> None:
        """Set the Constant gamma and the driven Functions to a value of gamma. Collective."""
        self.constant.value = gamma
        if self._driven_at == gamma:
            return
        for d in self._driven:
            d.set()
        self._driven_at = gamma if self._is_undisturbed else None

    def _equations_at(self, gamma: float) -> ContactEquations:
        """Set gamma, read the data, and return the equations at this gamma. Collective."""
        self._set(gamma)
        self.equations.read_data()
        return self.equations

    @contextmanager
    def restored(self, *, always: bool = False) -> Iterator[None]:
        functions = [d.function for d in self._driven]
        before = [f.x.array.copy() for f in functions]
        gamma = self.constant.value.copy()
        done = False
        try:
            yield
            done = not always
        finally:
            if not done:
                for f, values in zip(functions, before, strict=True):
                    f.x.array[:] = values
                self.constant.value = gamma
                self._driven_at = None

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        self._is_undisturbed = True
        try:
            self.equations.require_same_mesh()
            yield
        finally:
            self._is_undisturbed = False
            self._driven_at = None

    def check_parameter(self, gammas: Sequence[float]) -> None:
        eq = self.equations
        eq.require_same_mesh()
        eq.read_data()
        surfaces = eq.surfaces
        varying = [s for s, rate in zip(surfaces, self._rates, strict=True) if rate.applies]
        changing = bool(self._driven or varying or self._rigid_rates.applies)
        with self.restored(always=True):
            for gamma in gammas:
                self._set(gamma)
                with located(f"at gamma = {gamma:g}"):
                    check_moduli(eq)
                    for s, memory in zip(surfaces, eq.memory, strict=True):
                        # The test of a pair searches its faces: at the ends only if it is constant.
                        ends = gammas[:1] if not s.between_bodies else (gammas[0], gammas[-1])
                        if s in varying or gamma in ends:
                            s.update_geometry()
                            check_surface(s, memory)
                    if changing or gamma == gammas[0]:
                        eq.constraints.check_values(surfaces, eq.body_size)

    @property
    def has_many_pieces(self) -> bool:  # type: ignore[override]
        """Whether kinks are passed in batches by default: in 3D with many contact points."""
        points = sum(s.points.number_everywhere for s in self.equations.surfaces)
        return self.equations.dim == 3 and points > _MANY_POINTS

    @property
    def _fixed_laws(self) -> bool:
        """Whether obstacles and laws are independent of gamma."""
        return not any(rates.applies for rates in self._rates)

    # -- System ----------------------------------------------------------------------------------

    @property
    def kinks(self) -> str:  # type: ignore[override]
        """Description of kinks of the bulk form in u, which no status represents; "" if none."""
        text = self.equations.bulk.kinks
        return f"the bulk has kinks in u: {text}" if text else ""

    def begin_solves(self) -> None:
        self._solvers.append(self._linear().shared())

    def end_solves(self) -> None:
        self._solvers.pop().release()

    @property
    def _jacobian_solver(self) -> JacobianSolver:
        return self._solvers[-1] if self._solvers else self._linear()

    @property
    def preconditioner(self) -> Preconditioner | None:  # type: ignore[override]
        """Preconditioner of the linear solver; None for a direct solver. Collective."""
        return self._jacobian_solver.preconditioner

    @property
    def matrix(self) -> PETSc.Mat:  # type: ignore[override]
        """Derivative of H with respect to x, an assembled or a matrix-free Mat. Collective."""
        return self._jacobian_solver.matrix

    def create_vector(self) -> PETSc.Vec:
        return self.equations.unknowns.create_vector()

    def evaluate_contact(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> Evaluation:
        """Evaluate the contact points, without the rows of H. Collective.

        Args:
            x: unknowns.
            gamma: parameter.
            piece: statuses of all contact points; None: determined by the unknowns.
        """
        return self._equations_at(gamma).evaluate_contact(x, self.statuses_of(piece))

    def residual(self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None) -> float:
        return self.measure(x, gamma, b, piece, ())[0]

    def measure(
        self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None, scales: Sequence[float]
    ) -> tuple[float, tuple[float, ...]]:
        evaluation = self._equations_at(gamma).residual(x, b, self.statuses_of(piece))
        measures, grown = measure(self.equations, evaluation, scales)
        return measures.worst, grown

    def jacobian(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> None:
        linear = self._jacobian_solver
        before = linear.matrix
        linear.update(self.evaluate_contact(x, gamma, piece))
        # a branch keeps its matrix
        require(
            self.comm,
            linear.matrix is before,
            "sliding faces have reached facets for which the Jacobian has no entries, which is not "
            "supported on a branch; use a history",
        )

    def correct(
        self,
        x: PETSc.Vec,
        gamma: float,
        residual: PETSc.Vec,
        correction: PETSc.Vec,
        piece: Piece | None,
    ) -> bool:
        linear = self._jacobian_solver
        if not linear.corrects:
            return False
        return linear.correct(self.evaluate_contact(x, gamma, piece), residual, correction)

    def contact_rows(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> Array | None:
        return self._equations_at(gamma).contact_rows(x, self.statuses_of(piece))

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        evaluation = self.evaluate_contact(x, gamma, piece)
        body = np.zeros(self.equations.owned_sizes[0])
        if self._body_rate is not None:
            body = self.equations.bulk.assembled(self._body_rate, evaluation.u)
        answers = [r(s) for r, s in zip(self._rates, evaluation.surfaces, strict=True)]
        c.array[:] = self.equations.rates(evaluation, body, answers, *self._data_rates())

    def _data_rates(self) -> tuple[Array, Array, Array]:
        """Return derivatives with respect to gamma of Dirichlet data, and of loads and motions.

        Returns:
            Derivatives of the Dirichlet values at the local displacement dofs (0 at free dofs), of
            the loads on rigid bodies, and of their prescribed motions.
        """
        dirichlet = np.zeros_like(self.equations.bulk.displacement.x.array)
        if self._driven:
            dirichlet = dirichlet_rates(self.equations.constraints, self._driven)
        return dirichlet, *self._rigid_rates()

    def metric(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        if self._metric is None:
            self._metric = self._mass()
        dim = self.equations.dim
        out.set(0.0)
        for component in range(dim):
            part = slice(component, self.equations.owned_sizes[0], dim)
            out.array[part] = product(self._metric, x.array_r[part])
        rigid = out.getLocalSize() - self.equations.rigid.owned
        out.array[rigid:] = x.array_r[rigid:] / self.equations.body_size**2

    def _mass(self) -> PETSc.Mat:
        """Mass matrix of one displacement component, over the volume and the squared body size."""
        V = self.equations.V
        u = ufl.TrialFunction(V)
        v = ufl.TestFunction(V)
        whole = dolfinx.fem.petsc.assemble_matrix(compiled_form(ufl.inner(u, v) * ufl.dx))
        whole.assemble()
        start, end = whole.getOwnershipRange()
        dim = self.equations.dim
        first = PETSc.IS().createStride((end - start) // dim, start, dim, comm=self.comm)
        mass = whole.createSubMatrix(first, first)
        ones, volume = mass.createVecs()
        ones.set(1.0)
        mass.mult(ones, volume)
        mass.scale(1.0 / (volume.sum() * self.equations.body_size**2))
        destroy(whole, first, ones, volume)
        return mass

    def piece_at(self, x: PETSc.Vec, gamma: float) -> Piece:
        return self.piece(self.evaluate_contact(x, gamma, None).statuses)

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        evaluation = self.evaluate_contact(x, gamma, piece)
        distance = []
        point = []
        target = []
        for (s, a, _), contact in zip(self.parts(), evaluation.surfaces, strict=True):
            borders = contact.answers.borders(contact.statuses)
            i, k = np.nonzero(np.isfinite(borders.distance))
            distance.append(borders.distance[i, k] / s.points.mean_augmentation)
            point.append((i + a).astype(np.int32))
            target.append(borders.target[i, k])
        points = np.concatenate(point)
        free = ~self.clamped[points]
        return Events(np.concatenate(distance)[free], points[free], np.concatenate(target)[free])

    def probe(self, seed: int) -> PETSc.Vec:
        parts = []
        eq = self.equations
        for V in (eq.V, *(s.points.Q for s in eq.surfaces)):
            bs = V.dofmap.index_map_bs
            n = V.dofmap.index_map.size_local
            # functions of the coordinates depend neither on numbering nor on ranks
            places = in_space(node_positions(V)[:n]) / eq.body_size
            phase = places @ np.array([12.9898, 78.233, 37.719]) + seed
            parts.append(np.sin(43.7585 * (phase[:, None] + np.arange(bs))).reshape(-1))
        parts.append(np.sin(43.7585 * (seed + np.arange(eq.rigid.owned))))
        x = self.create_vector()
        x.array[:] = np.concatenate(parts)
        return x

    def statuses(self, point: int) -> Sequence[int]:
        number = int(np.searchsorted(self._offsets, point, side="right")) - 1
        return sorted(self.equations.surfaces[number].law_at_points.codes)

    # -- pieces ----------------------------------------------------------------------------------

    def parts(self) -> Iterator[tuple[DiscreteSurface, int, int]]:
        """Yield each surface with the index range of its points among all points of this rank."""
        ends = self._offsets[1:]
        return zip(self.equations.surfaces, self._offsets[:-1], ends, strict=True)

    def statuses_of(self, piece: Piece | None) -> Statuses | None:
        """Return the statuses of a piece of H, one array per surface; None for None."""
        return None if piece is None else [piece.codes[a:b] for _, a, b in self.parts()]

    def piece(self, statuses: Statuses) -> Piece:
        """Return H with given, fixed statuses of each surface; clamped points are set to open."""
        codes = np.concatenate(statuses)
        return Piece(np.where(self.clamped, OPEN, codes).astype(np.int8))

    @property
    def positions(self) -> Array:
        """Positions of the owned points of all surfaces in the order of a piece, shape (n, dim)."""
        return np.concatenate([s.points.positions for s in self.equations.surfaces])

    @property
    def _ids(self) -> Ints:
        """Keys distinguishing contact points even with equal coordinates, shape (n, k).

        The first of the k integers of a key is the index of the surface.
        """
        surfaces = enumerate(self.equations.surfaces)
        parts = [np.insert(s.points.ids, 0, i, axis=1) for i, s in surfaces]
        return np.concatenate(parts)

    def order(self) -> npt.NDArray[np.intp]:
        return Gathered(self.comm, self.positions, self._ids).mine

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self._metric)
        self._metric = None
