# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Condensation of the body onto its contact points, in 2D and 3D.

For increments du of the body displacement, dj of the jumps at the contact points, dr of the forces
on the body there, and dgamma of the load parameter, equilibrium reads

    [ K  -B^T ] [ du ]   [ -b_u - c_u dgamma ]
    [ B    0  ] [ dr ] = [        dj         ]

with the stiffness K, the matrix B from displacements to jumps, the residual b_u of the body and its
derivative c_u with respect to gamma. (With rigid bodies, u also contains their motions, without
stiffness, and B is [B, -Phi], where Phi maps these motions to displacements of the points.)
Responses to unit jumps give the small dense stiffness S of the points, equal on every rank. In the
local frames of the points, with the tangential displacements and gaps a = (ut, un) and the
tangential and normal forces r = (rt, rn),

    S a - r = p + gamma q

with the load p and its rate q. This is the `PointProblem` of algorithms and certificates and, with
the statuses of the points as cones of w = (a, r), the `AffineSystem` of pivoting. If the body is
linear and gamma enters the data linearly, the reduction is exact. Otherwise it is the
linearisation, which determines how branches leave a point.

The residuals of the linear systems bound the errors of S, p and q. Let X_i be the computed response
to a unit jump i, and R_i its residual. Up to signs, X_i also solves the transposed system for a
unit force. Hence the error of S_ij is X_i.R_j, at most |X_i| |R_j| up to products of two residuals;
|R_j| includes the round-off of R_j. Assembled matrices are treated as exact.

Every multiplier node must be a contact point. Cones are available for laws in 2D with polyhedral
statuses (`laws.cones`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any, Self

from petsc4py import PETSc

import numpy as np
from scipy.sparse import csc_matrix as Columns

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact._mpi import SharedValues, require, total
from dolfinx_contact._petsc import destroy, staged, triplet_matrix
from dolfinx_contact.continuation import Piece
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import RigidTerm, SurfaceTerm
from dolfinx_contact.equations.measures import Scales, measure
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.reduced.constrained_body import (
    ROUND_OFF,
    ConstrainedBody,
    ConstrainedField,
    with_dirichlet_rows,
)
from dolfinx_contact.reduced.gathered import GatheredPoints
from dolfinx_contact.reduced.point_problem import PointProblem
from dolfinx_contact.reduced.scope import check_reducible

__all__ = ["Reduction", "reduced_contact", "scaled", "scales_at"]

_DEFINITE = 1e-10  # least eigenvalue of the condensed stiffness, whose mean diagonal entry is 1
_SYMMETRIC = 1e-8  # asymmetry, relative to the largest entry, that counts as round-off


class Reduction:
    """Contact problem with a parameter, condensed onto its points at a state. Collective.

    A *piece* is the system of equations for fixed statuses of all points. The state w of a point
    contains its tangential displacement, its gap, and the forces on the body.

    Args:
        parametric: contact problem within the `scope`.
        x: state at which the equations are linearised.
        gamma: parameter at the state.
        exact: whether the pieces are affine, so that the linearisation is exact.
        conic: whether the states with a given status form a cone (`can_condense`); otherwise
            `system` contains only the matrix and loads.

    Attributes:
        points: the m contact points in the order of their coordinates.
        system: affine system with the statuses of the points as cones, in 2D only.
        S: stiffness divided by ``force_unit``, point by point, tangents before the normal;
            symmetric up to round-off if the body is symmetric, shape (dim m, dim m).
        load: load of the points divided by ``force_unit``, shape (dim m,).
        rate: derivative of `load` with respect to the parameter, shape (dim m,).
        exact: whether the pieces are affine.
        force_unit: force per length dividing all stiffnesses and forces, for a mean diagonal entry
            of `S` of 1; loads and all entries of w are thus lengths.
    """

    system: AffineSystem

    @staged("ContactCondensation")
    def __init__(
        self,
        parametric: ParametricEquations,
        x: PETSc.Vec,
        gamma: float,
        *,
        exact: bool,
        conic: bool = True,
    ):
        self._parametric = parametric
        self._freed = False
        self.exact = exact
        eq: ContactEquations = parametric.equations
        self.comm = eq.comm
        self._equations = eq
        self._dim = eq.dim
        self._gamma = gamma
        self._scale = eq.scaling.stiffness
        self._nodal = eq.owned_sizes[0]
        self._n = eq.owned_sizes[0] + eq.rigid.owned
        # residual and rate of the rows of the body at the state
        b = parametric.create_vector()
        c = parametric.create_vector()
        piece = parametric.piece_at(x, gamma)
        parametric.residual(x, gamma, b, piece)
        parametric.parameter_derivative(x, gamma, c, piece)
        self._rest, self._rate = (self._displacements(v) for v in (b, c))
        destroy(b, c)
        # stiffness at the points, in their frames
        self.points = GatheredPoints(parametric)
        self._m = self.points.number
        self._body = self._constrained_at_points(parametric.evaluate_contact(x, gamma, piece).u)
        self._x = x.copy()
        T = self.points.frames
        m = self._m
        d = self._dim
        schur, self._sizes_of_jumps, self._residuals_of_jumps = self._reactions_to_jumps()
        k = float(np.abs(np.diag(schur)).mean())
        S = np.einsum("iap,iajb,jbq->ipjq", T, schur.reshape(m, d, m, d), T) / k
        self.S: Array = S.reshape(d * m, d * m)
        self.force_unit = k
        # loads: S a - r = p + gamma q
        none = np.zeros((m, d))
        loads = [self._solve(-load, none) for load in (self._rest, self._rate)]
        rest, rate = (np.einsum("iap,ia->ip", T, f).reshape(-1) / k for _, f, _ in loads)
        self._residuals_of_loads = [residual for _, _, residual in loads]
        self._w = self.contract(x)
        M = np.zeros((d * m, m, 2 * d))
        M[:, :, :d] = self.S.reshape(d * m, m, d)
        M.reshape(m, d, m, 2 * d)[np.arange(m), :, np.arange(m), d:] = -np.eye(d)
        self.load: Array = np.einsum("nmk,mk->n", M, self._w) - rest + gamma * rate
        self.rate: Array = -rate
        # statuses of the points as cones
        if d == 2:
            laws = self.points.laws(k)
            polyhedral = laws if conic else replace(laws, groups=[])
            bases, inequalities, exists = polyhedral.cones()
            cones = bases, inequalities
            self.system = AffineSystem(M, self.load, self.rate, *cones, laws.classify, exists)

    @classmethod
    def of(cls, equations: ContactEquations) -> Self:
        """Condense a linear body with its present data onto its contact points. Collective.

        Args:
            equations: equations of the problem (`ContactProblem.equations`); left unchanged.

        Raises:
            ValueError: on every rank, if the problem cannot be reduced (`scope.check_reducible`) or
                its stiffness or loads are not finite or its stiffness is not symmetric.
        """
        check_reducible(equations)
        system = ParametricEquations(equations)
        nothing = system.create_vector()
        try:
            reduction = cls(system, nothing, 0.0, exact=True, conic=False)
        finally:
            nothing.destroy()
        try:
            reduction.require_finite()
            S = reduction.S
            require(
                equations.comm,
                bool(np.abs(S - S.T).max() <= _SYMMETRIC * np.abs(S).max()),
                'the reduced problem needs a symmetric stiffness; use algorithm="newton"',
            )
        except ValueError:
            reduction.destroy()
            raise
        return reduction

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()

    # -- results ---------------------------------------------------------------------------------

    def problem(self, gamma: float = 0.0, *, unit: float = 1.0) -> PointProblem:
        """Return the point problem at a parameter, with the laws of Coulomb and Tresca.

        Not collective.

        Args:
            gamma: parameter.
            unit: unit of forces; by default the user's unit.

        Raises:
            ValueError: if the stiffness is not positive definite, or a number is not finite.
        """
        points = self.points
        # error bounds of S, of the load p + gamma q, and of q
        of_S, rest, rate = self._errors
        S = np.abs(self.S)
        w = np.abs(self._w[:, : self._dim]).reshape(-1)
        of_load = of_S @ w + len(S) * ROUND_OFF * (S @ w) + rest + abs(gamma - self._gamma) * rate
        sums = np.abs(self.load) + abs(gamma) * np.abs(self.rate)
        of_load = of_load + 64 * ROUND_OFF * sums
        of_rate = rate + 64 * ROUND_OFF * np.abs(self.rate)
        factor = self.force_unit / unit
        return PointProblem(
            self.S * factor,
            (self.load + gamma * self.rate) * factor,
            points.friction,
            points.bound / unit,
            points.augmentation / unit,
            positions=points.positions,
            gap=points.gap,
            frames=points.frames,
            S_error=of_S * factor,
            p_error=of_load * factor,
            rate=self.rate * factor,
            rate_error=of_rate * factor,
        )

    @property
    def guided(self) -> bool:
        """Whether Dirichlet data prescribe the tangential displacement of any point."""
        return self.points.guided

    def require_finite(self) -> None:
        """Raise `ValueError` if the stiffness or a load is not finite."""
        if not all(np.isfinite(a).all() for a in (self.S, self.load, self.rate)):
            raise ValueError(
                "the stiffness or the loads of the condensed problem are not finite: look for NaN "
                "and overflow in loads, material and Dirichlet data, and gamma"
            )

    @cached_property
    def always_solvable(self) -> bool:
        """Whether a solution exists for every value of the parameter.

        This holds if the pieces are affine and the stiffness S is positive definite. The problem
        with a given friction bound then has exactly one solution, which depends continuously on the
        bound. By Brouwer's theorem there is a bound equal to the friction coefficient times the
        normal force of its own solution (Haslinger, Math. Methods Appl. Sci. 5, 1983).
        """
        return self.exact and bool(np.linalg.eigvalsh(self.S + self.S.T)[0] > _DEFINITE)

    def _displacements(self, x: PETSc.Vec) -> Array:
        """Return the entries for displacements and motions of rigid bodies, without multipliers."""
        rigid = x.getLocalSize() - self._equations.rigid.owned
        return np.concatenate([x.array_r[: self._nodal], x.array_r[rigid:]])

    @cached_property
    def _errors(self) -> tuple[Array, Array, Array]:
        """Error bounds of stiffness, load (at the linearised state) and load derivative."""
        k = self.force_unit
        d = self._dim
        # Frames mix the components of a point, and are orthonormal to round-off.
        X, R = (
            np.repeat(np.linalg.norm(v.reshape(-1, d), axis=1), d)
            for v in (self._sizes_of_jumps, self._residuals_of_jumps)
        )
        rest, rate = (np.asarray(X * r / k) for r in self._residuals_of_loads)
        return (np.outer(X, R) + np.outer(R, X)) / k + 64 * ROUND_OFF * np.abs(self.S), rest, rate

    # -- points ----------------------------------------------------------------------------------

    def point(self, i: int) -> tuple[int, int]:
        """Return rank and local index (`GatheredPoints.owner`) of point ``i``. Collective."""
        return self.points.owner(i)

    def codes(self, piece: Piece) -> Codes:
        """Return the statuses of all points in a piece, i.e. a choice of statuses. Collective."""
        return self.points.gathered(piece.codes)

    def piece(self, codes: Codes) -> Piece:
        """Return the piece, as data of this rank, in which the m points have given statuses."""
        new = np.zeros(len(self._parametric.clamped), dtype=np.int8)
        new[self.points.local] = codes[self.points.mine]
        return Piece(new)

    # -- the body --------------------------------------------------------------------------------

    def _constrained_at_points(self, u: Array) -> ConstrainedBody:
        """Return the factorised body at displacements u with prescribed jumps at contact points."""
        eq = self._equations
        first = 0
        K = with_dirichlet_rows(eq.bulk.stiffness(u), eq, self._scale)
        fixed = eq.fixed[: self._nodal] & ~self._dofs_of_guided_points()
        fixed = np.flatnonzero(fixed) + K.getOwnershipRange()[0]
        wanted = self.points.local
        blocks = []
        motions = []
        for term in eq.terms:
            s = term.surface
            inside = wanted[(wanted >= first) & (wanted < first + s.points.number)] - first
            rows = (self._dim * inside[:, None] + np.arange(self._dim)).reshape(-1)
            B = s.constant_operator("the condensed problem").B
            here = PETSc.IS().createGeneral(
                (rows + B.getOwnershipRange()[0]).astype(PETSc.IntType), comm=self.comm
            )
            blocks.append(B.createSubMatrix(here))
            if eq.rigid.size:
                whole = self._jumps_by_motions(term)
                motions.append(whole.createSubMatrix(here))
                whole.destroy()
            here.destroy()
            first += s.points.number
        # All rows of displacements have the unit of a force.
        fields = [ConstrainedField(K, blocks, without_forces=fixed)]
        if eq.rigid.size:
            still = np.flatnonzero(eq.rigid.here(eq.rigid.fixed))
            here = np.arange(eq.rigid.owned)
            prescribed = np.where(eq.rigid.here(eq.rigid.fixed), self._scale, 0.0)
            diagonal = self._matrix(len(here), here, here, prescribed)
            fields.append(ConstrainedField(diagonal, motions, without_forces=still))
        try:
            return ConstrainedBody(
                self.comm, fields, -self._scale, prefix="condensed_", counted=False
            )
        finally:
            for field in fields:
                destroy(field.stiffness, *field.rows)

    def _dofs_of_guided_points(self) -> Mask:
        """Return the mask of the owned dofs of slave nodes with a fixed tangential displacement.

        Contact exerts forces on them, as on free dofs, so that a jump can be prescribed there.
        Collective.
        """
        eq = self._equations
        exchange = SharedValues(eq.V.dofmap.index_map)
        guided: Mask = np.zeros(len(eq.constraints.fixed), dtype=bool)
        for s, constraints in zip(eq.surfaces, eq.constraints.surfaces, strict=True):
            n = s.points.number
            here = constraints.fixed_jumps[:n].any(axis=1) & ~constraints.clamped_points
            guided |= exchange.marked(s.points.vertex_nodes[:n][here])
        return np.repeat(guided, self._dim)[: self._nodal]

    def _jumps_by_motions(self, term: SurfaceTerm) -> PETSc.Mat:
        """Return the matrix from motions of rigid bodies to jumps at the points of a surface."""
        s = term.surface
        n = s.points.number * s.dim
        if not isinstance(term, RigidTerm):
            none = np.zeros(0, dtype=np.int64)
            return self._matrix(n, none, none, np.zeros(0))
        first = s.constant_operator("the condensed problem").B.getOwnershipRange()[0]
        rows = first + np.arange(n)[:, None]
        columns = np.arange(term.motion_slice.start, term.motion_slice.stop)
        moved = -term.motions_at_points().reshape(n, len(columns))
        return self._matrix(n, rows, columns, moved)

    def _matrix(self, n: int, rows: Any, columns: Any, values: Array) -> PETSc.Mat:
        """Return a matrix with n local rows, given its entries, that maps rigid-body motions."""
        shape = n, self._equations.rigid.owned
        return triplet_matrix(self.comm, shape, rows, columns, values)

    def _reactions_to_jumps(self) -> tuple[Array, Array, Array]:
        """Compute the forces at the points caused by unit jumps. Collective.

        Returns:
            Forces, one column for each unit jump, shape (dim m, dim m); norms of the solutions; and
            bounds of the norms of their residuals, shape (dim m,) each.
        """
        d = self._dim
        columns = d * self._m
        rows = (d * self.points.mine[:, None] + np.arange(d)).reshape(-1)
        mine = np.empty((len(rows), columns))
        squares = np.empty((2, columns))
        unit = self._body.unit
        places = self._n + np.arange(len(rows))
        entries = np.full(len(rows), unit), (places, rows)
        jumps = Columns(entries, shape=(self._n + len(rows), columns))
        for here, part, X in self._body.answers(jumps):
            mine[:, here] = -unit * X.getDenseArray(readonly=True)[self._n :]
            product = self._body.matrix.matMult(X)
            i, j = part.nonzero()
            product.getDenseArray()[i, j] -= unit
            for of, v in zip(squares, (X, product), strict=True):
                array = v.getDenseArray(readonly=True)
                of[here] = np.einsum("ij,ij->j", array, array)
            product.destroy()
        S = np.empty((columns, columns))
        for part, theirs in zip(self.comm.allgather(mine), self.comm.allgather(rows), strict=True):
            S[theirs] = part
        sizes, residuals = np.sqrt(total(self.comm, squares))
        return S, sizes, residuals + self._body.round_off(sizes, self._scale)

    def _solve(self, load: Array, jumps: Array) -> tuple[Array, Array, float]:
        """Solve the body for a load and prescribed jumps. Collective.

        Args:
            load: owned entries of the load on the body and on rigid bodies.
            jumps: jumps at the points, shape (m, dim).

        Returns:
            Owned displacements, forces at all points, and bound of the norm of the residual.
        """
        if self._freed:
            raise ValueError("this reduction was freed, by destroy() or by a later reduction")
        u, *holding = self._body.solve(load, jumps[self.points.mine].reshape(-1))
        mine = -np.concatenate(holding).reshape(-1, self._dim)
        forces = np.zeros((self._m, self._dim))
        for places, part in self.comm.allgather((self.points.mine, mine)):
            forces[places] = part
        return u, forces, self._body.left()

    # -- states ----------------------------------------------------------------------------------

    def contract(self, x: PETSc.Vec) -> Array:
        """Return the state w of all points, shape (m, 2 dim). Collective.

        It contains tangential displacement, gap, and forces on the body divided by `force_unit`.
        """
        evaluation = self._equations.evaluate_contact(x)
        jumps, forces = [], []
        for s, found in zip(self._equations.surfaces, evaluation.surfaces, strict=True):
            jumps.append(found.jump - s.points.data.gap[:, None] * s.points.data.n)
            forces.append(found.traction * s.points.areas[:, None] / self.force_unit)
        T = self.points.frames
        parts = [self.points.gathered(np.concatenate(v)) for v in (jumps, forces)]
        return np.concatenate([np.einsum("iap,ia->ip", T, v) for v in parts], axis=1)

    def expand(self, w: Array, gamma: float, x: PETSc.Vec) -> None:
        """Write the unknowns for the state ``w`` of the points (`contract`) at ``gamma`` to ``x``.

        ``w`` has the shape (m, 2 dim). Collective.
        """
        dw = w - self._w
        T = self.points.frames
        d = self._dim
        jumps = np.einsum("iap,ip->ia", T, dw[:, :d])
        forces = np.einsum("iap,ip->ia", T, dw[:, d:]) * self.force_unit
        load = -self._rest - (gamma - self._gamma) * self._rate
        du, _, _ = self._solve(load, jumps)
        self._x.copy(x)
        self._move(x, du)
        # tractions at the points of this rank, in the order of the surfaces
        mine = self.points.mine
        tractions = np.zeros((len(self._parametric.clamped), d))
        tractions[self.points.local] = forces[mine] / self.points.areas[mine][:, None]
        eq = self._equations
        units = np.repeat(eq.unknowns.units[1:-1], [s.points.number for s in eq.surfaces])
        multipliers = slice(self._nodal, self._nodal + tractions.size)
        x.array[multipliers] += (tractions / units[:, None]).reshape(-1)

    def relax(self, x: PETSc.Vec) -> None:
        """Bring a linear body into equilibrium with the contact forces in ``x``. Collective.

        `expand` sets the displacements of the points exactly. The round-off of the equilibrium at
        the points then remains as unbalanced forces, which are large at stiff points. This method
        converts these forces to displacements.
        """
        b = x.duplicate()
        self._equations.residual(x, b)
        load = -self._displacements(b)
        b.destroy()
        T = self.points.frames
        _, forces, _ = self._solve(load, np.zeros((self._m, self._dim)))
        reactions = np.einsum("iap,ia->ip", T, forces) / self.force_unit
        a = -np.linalg.solve(self.S, reactions.reshape(-1)).reshape(reactions.shape)
        du, _, _ = self._solve(load, np.einsum("iap,ip->ia", T, a))
        self._move(x, du)

    def _move(self, x: PETSc.Vec, du: Array) -> None:
        """Add owned increments of displacements, then of rigid motions, to the unknowns ``x``."""
        x.array[: self._nodal] += du[: self._nodal]
        x.array[x.getLocalSize() - self._equations.rigid.owned :] += du[self._nodal :]

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._freed = True
        destroy(self._body, self._x)


def reduced_contact(equations: ContactEquations, x: PETSc.Vec) -> PointProblem:
    """Return the reduced problem with the scales of a state, equal on every rank. Collective.

    Raises:
        ValueError: on every rank, if the problem cannot be reduced.
    """
    with Reduction.of(equations) as reduction:
        return scaled(reduction.problem(), scales_at(equations, x))


def scales_at(equations: ContactEquations, x: PETSc.Vec) -> Scales:
    """Return the force and length scales at a state, for relative residuals. Collective."""
    return measure(equations, equations.evaluate(x))[1]


def scaled(contact: PointProblem, scales: Scales) -> PointProblem:
    """Return a reduced problem with the scales of a state of the body (`scales_at`).

    The displacement without contact replaces the scale of length if it is larger.
    """
    # If all points stick, displacements vanish; the displacement without contact sets the scale.
    length = max(scales.length, float(np.abs(contact.free).max()))
    return replace(contact, force=scales.force, length=length)
