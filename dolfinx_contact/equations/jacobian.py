# SPDX-License-Identifier: LGPL-3.0-or-later
"""The Jacobian of H: the stiffness K of the body, and contact terms S that depend on statuses.

    J = [ K  0 ] + S,    S = [ 0               -B^T W E        ]
        [ 0  0 ]             [ -E^T W D_j B     E^T W (I - D_t) E ]

The blocks belong to displacements u and multipliers l. Contact points have jumps j = B u, tractions
t = E l and areas W; D_j and D_t are the derivatives of the traction tau(j, t) required by the law.

S has nonzero rows only at contact nodes, multipliers and rigid bodies. Rows and columns of
Dirichlet dofs are empty in S; rows of removed multipliers have a typical stiffness on the diagonal.
The pattern of S never changes, so new statuses change only its values. For sliding faces it changes
with each search for opposing facets (`sliding`).

With a rigid body, the jump is B (u - Phi q), where Phi maps its unknowns q to nodal displacements,
and S has the additional blocks

    [ .                    (B Phi)^T W E ]
    [ E^T W D_j B Phi      .             ]

in the rows and columns of q and of the multipliers (`_RigidTerms`).

For a nonlocal law tau(j, t; N s), where N averages a quantity s(j, t) over neighbouring points, the
contact rows contain the additional term

    -E^T W D_s N (s_j B, s_t E),

which couples different points (`_SpreadTerms`). D_s is the derivative of tau with respect to N s,
and s_j and s_t are the derivatives of s. N and the pattern of the product are constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._petsc import Entries, destroy, logged, matrix_of, triplets
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, RigidTerm, SurfaceEvaluation
from dolfinx_contact.points.jump_operators import ConstantOperator
from dolfinx_contact.points.neighbours import LawAmongPoints
from dolfinx_contact.points.trace import at_global_places

if TYPE_CHECKING:
    from dolfinx_contact.continuation import Preconditioner
    from dolfinx_contact.equations.sliding import SlidingTerms

__all__ = ["ContactTerms", "Jacobian", "JacobianSolver"]


class JacobianSolver:
    """Linear solver of a contact problem: its Jacobian and preconditioner. Methods are collective.

    The problem owns the solver, and so does a branch while being traced. The solver is freed when
    its last owner releases it.

    Attributes:
        matrix: Jacobian, for SNES.
        corrects: whether `correct` is implemented.
    """

    matrix: PETSc.Mat
    corrects = False
    _owners = 1

    def shared(self) -> Self:
        """Add an owner, who must `release` the solver, and return the solver."""
        self._owners += 1
        return self

    def release(self) -> None:
        """Remove an owner; free the solver if this was the last one."""
        self._owners -= 1
        if self._owners == 0:
            self.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects, for all owners."""

    @property
    def preconditioner(self) -> Preconditioner | None:
        """Preconditioner for systems that contain the Jacobian; None if they must be factorised."""
        return None

    def update(self, evaluation: Evaluation) -> None:
        """Assemble the Jacobian at an evaluation."""
        raise NotImplementedError

    def correct(self, evaluation: Evaluation, residual: PETSc.Vec, correction: PETSc.Vec) -> bool:
        """Solve the rows of H on the contact surface for the unknowns of the surface.

        Args:
            evaluation: evaluation of H.
            residual: residual H.
            correction: vector that receives the correction, to be subtracted from the unknowns;
                zero off the surface.

        Returns:
            Whether a correction was computed.
        """
        return False


@dataclass(frozen=True)
class _Dofs:
    """Indices of the unknowns of one surface among all unknowns, for each group of points.

    Attributes:
        operator: operator from displacements to jumps, whose stencils list groups of points with
            common nodes.
        unit: factor from the unknowns of the multipliers to the multipliers, which are tractions.
        bodies: indices of the displacements among all unknowns, -1 if fixed, shape (groups, k, dim)
            for k nodes per group.
        multipliers: indices of the multipliers among all unknowns, -1 if removed, shape
            (groups, l, dim) for l multiplier nodes per group.
    """

    operator: ConstantOperator
    unit: float
    bodies: Ints
    multipliers: Ints

    @cached_property
    def weighted(self) -> Array:
        """Products of areas and weights of the l multiplier nodes, shape (groups, points, l)."""
        stencils = self.operator.stencils
        return self.operator.areas[stencils.points][..., None] * stencils.multiplier_weights


def _flat(*blocks: tuple[Ints, Ints]) -> tuple[Ints, Ints]:
    """Return row and column indices of all entries of given blocks as two flat arrays."""
    pairs = [np.broadcast_arrays(*block) for block in blocks]
    rows = np.concatenate([row.reshape(-1) for row, _ in pairs])
    return rows, np.concatenate([column.reshape(-1) for _, column in pairs])


class _PointTerms:
    """Entries of the Jacobian from forces, jumps and the law at single points of one surface."""

    def __init__(self, dofs: _Dofs):
        self._dofs = dofs
        stencils = dofs.operator.stencils
        weighted = dofs.operator.areas[stencils.points][:, :, None] * stencils.weights
        #: Sums over the points p of W_p b_pk e_pl, shape (groups, k, l).
        self._coupling = np.einsum("gpk,gpl->gkl", weighted, stencils.multiplier_weights)

    def entries(self) -> tuple[Ints, Ints]:
        """Return row and column indices of the entries, in the order of `values`."""
        u, m = self._dofs.bodies, self._dofs.multipliers
        force = u[:, :, None], m[:, None]
        jump = m[..., None, None], u[:, None, None]
        traction = m[..., None, None], m[:, None, None]
        return _flat(force, jump, traction)

    def values(self, contact: SurfaceEvaluation) -> Array:
        """Return the values of the entries at an evaluation."""
        stencils = self._dofs.operator.stencils
        unit, weighted = self._dofs.unit, self._dofs.weighted
        at = stencils.points
        e = stencils.multiplier_weights
        dim = self._dofs.bodies.shape[2]
        by_jump = contact.by_jump
        if self._dofs.operator.fixed is not None:
            by_jump = np.where(self._dofs.operator.fixed[:, None], 0.0, by_jump)
        by_jump = by_jump[at]
        by_traction = np.eye(dim) - contact.by_traction[at]
        if stencils.identity:  # one point a group, e = 1
            jump = (
                -weighted[:, 0, :, None, None, None]
                * np.einsum("gk,gij->gikj", stencils.weights[:, 0], by_jump[:, 0])[:, None]
            )
            traction = weighted[:, 0, :, None, None, None] * by_traction[:, 0, None, :, None, :]
        else:
            jump = -np.einsum(
                "gpl,gpk,gpij->glikj", weighted, stencils.weights, by_jump, optimize=True
            )
            traction = np.einsum("gpl,gpm,gpij->glimj", weighted, e, by_traction, optimize=True)
        force = -unit * np.repeat(self._coupling[..., None], dim, axis=3)
        return np.concatenate([force.reshape(-1), jump.reshape(-1), unit * traction.reshape(-1)])


class _RigidTerms:
    """Entries of the Jacobian that couple a surface with the rigid body that it touches.

    Args:
        dofs: unknowns of the surface.
        motions: indices of the k unknowns of the rigid body among all unknowns, -1 if prescribed,
            shape (k,).
        at_points: displacement of each point per unknown of the rigid body, shape (n, dim, k).
    """

    def __init__(self, dofs: _Dofs, motions: Ints, at_points: Array):
        self._dofs = dofs
        self._motions = motions
        self._at_points = at_points

    def entries(self) -> tuple[Ints, Ints]:
        """Return row and column indices of the entries, in the order of `values`."""
        m, q = self._dofs.multipliers[..., None], self._motions
        return _flat((q, m), (m, q))

    def values(self, contact: SurfaceEvaluation) -> Array:
        """Return the values of the entries at an evaluation. Collective."""
        at = self._dofs.operator.stencils.points
        weighted = self._dofs.weighted
        force = np.einsum("gpl,gpia->glia", weighted, self._at_points[at])
        columns = np.moveaxis(self._at_points, 2, 0)
        answers = np.stack([contact.along(column) for column in columns], axis=2)
        jump = np.einsum("gpl,gpia->glia", weighted, answers[at])
        return np.concatenate([self._dofs.unit * force.reshape(-1), jump.reshape(-1)])


class _SpreadTerms:
    """Entries of the Jacobian that couple different points of a surface by a nonlocal law.

    They form the product of three matrices: a matrix from points to multipliers, the averaging
    matrix N of the law, and a matrix from unknowns to points. All methods are collective.

    Args:
        dofs: unknowns of the surface.
        law: law of the surface, with its averaging matrix N.
        comm: communicator of the problem.
        unknowns: number of unknowns of this rank.
    """

    def __init__(self, dofs: _Dofs, law: LawAmongPoints, comm: MPI.Comm, unknowns: int):
        self._dofs = dofs
        self._N = law.neighbours.matrix
        stencils = dofs.operator.stencils
        n = len(dofs.operator.areas)
        point = (comm.exscan(n) or 0) + stencils.points[:, :, None, None]
        u, m = dofs.bodies[:, None], dofs.multipliers[:, None]
        self._left_entries = Entries(*_flat((m, point)))
        self._left = matrix_of(comm, (unknowns, n), self._left_entries)
        self._right_entries = Entries(*_flat((point, u), (point, m)))
        self._right = matrix_of(comm, (n, unknowns), self._right_entries)
        self._first = self._left.matMult(self._N)
        self._product = self._first.matMult(self._right)
        self._rows, self._columns, _ = triplets(self._product)

    def entries(self) -> tuple[Ints, Ints]:
        """Return row and column indices of the entries, in the order of `values`."""
        return self._rows, self._columns

    def values(self, contact: SurfaceEvaluation) -> Array:
        """Return the entries at an evaluation; zeros if it used a local law. Collective."""
        if contact.answers.spreading is None:
            return np.zeros(len(self._rows))
        stencils = self._dofs.operator.stencils
        at = stencils.points
        e = stencils.multiplier_weights
        by_jump, by_traction = contact.spread_by
        weighted = (self._dofs.operator.areas[:, None] * contact.by_around)[at]
        left = e[..., None] * weighted[:, :, None, :]
        jump = stencils.weights[..., None] * by_jump[at][:, :, None, :]
        traction = self._dofs.unit * e[..., None] * by_traction[at][:, :, None, :]
        self._left.zeroEntries()
        self._right.zeroEntries()
        self._left_entries.add(left.reshape(-1), self._left)
        right = np.concatenate([jump.reshape(-1), traction.reshape(-1)])
        self._right_entries.add(right, self._right)
        self._left.matMult(self._N, self._first)
        self._first.matMult(self._right, self._product)
        return -np.asarray(self._product.getValuesCSR()[2])

    def destroy(self) -> None:
        """Free the matrices."""
        destroy(self._left, self._right, self._first, self._product)


class ContactTerms:
    """Entries of the contact terms S of the Jacobian on this rank."""

    def __init__(self, equations: ContactEquations):
        self._equations = equations
        eq = equations
        #: Numbering of the unknowns, also used for the entries of the body.
        self.numbering = numbering = _Numbering(eq)
        removed = np.concatenate([c.removed_multipliers for c in eq.constraints.surfaces])
        absent = np.flatnonzero(removed) + numbering.first + eq.owned_sizes[0]
        mine = eq.rigid.here(numbering.rigid)
        # Diagonal of removed and prescribed unknowns, to be multiplied by a typical stiffness.
        self._diagonal = np.concatenate([np.ones(len(absent)), eq.rigid.here(eq.rigid.fixed)])
        self._blocks: list[tuple[int, _PointTerms | _RigidTerms | _SpreadTerms]] = []
        self._sliding: list[tuple[int, SlidingTerms]] = []
        for i, term in enumerate(eq.terms):
            s = term.surface
            if s.slides:
                from dolfinx_contact.equations.sliding import SlidingTerms

                self._sliding.append((i, SlidingTerms(eq, i, numbering)))
                continue
            operator = s.constant_operator("the Jacobian, whose pattern never changes,")
            bodies = numbering.places(0, operator.stencils.nodes)
            multipliers = numbering.places(i + 1, operator.stencils.multiplier_nodes)
            dofs = _Dofs(operator, eq.unknowns.units[i + 1], bodies, multipliers)
            self._blocks.append((i, _PointTerms(dofs)))
            if isinstance(term, RigidTerm):
                motions = np.where(eq.rigid.fixed, -1, numbering.rigid)[term.motion_slice]
                at_points = term.motions_at_points()
                self._blocks.append((i, _RigidTerms(dofs, motions, at_points)))
            law = s.law_at_points
            if isinstance(law, LawAmongPoints):
                n = sum(eq.owned_sizes)
                self._blocks.append((i, _SpreadTerms(dofs, law, eq.comm, n)))
        places = [(absent, absent), (mine, mine), *(block.entries() for _, block in self._blocks)]
        rows, columns = zip(*places, strict=True)
        self._entries = Entries(np.concatenate(rows), np.concatenate(columns))

    @property
    def changed(self) -> bool:
        """Whether the sparsity pattern has changed since `set_up`, requiring new matrices."""
        return any([terms.changed for _, terms in self._sliding])

    def set_up(self) -> list[Entries]:
        """Return the global row and column indices of all entries. Collective."""
        sliding = [part for _, terms in self._sliding for part in terms.set_up()]
        return [self._entries, *sliding]

    def create_matrix(self) -> PETSc.Mat:
        """Return a zero matrix on all unknowns with the pattern of the contact terms.

        Collective.
        """
        n = sum(self._equations.owned_sizes)
        return matrix_of(self._equations.comm, (n, n), *self.set_up())

    def add(self, evaluation: Evaluation, A: PETSc.Mat) -> None:
        """Add the contact terms at an evaluation to a matrix. Collective."""
        parts = [block.values(evaluation.surfaces[i]) for i, block in self._blocks]
        diagonal = self._equations.scaling.stiffness * self._diagonal
        self._entries.add(np.concatenate([diagonal, *parts]), A)
        for i, terms in self._sliding:
            terms.add(evaluation.surfaces[i], A)

    def destroy(self) -> None:
        """Free the matrices."""
        spread = [block for _, block in self._blocks if isinstance(block, _SpreadTerms)]
        destroy(*(terms for _, terms in self._sliding), *spread)


class _Numbering:
    """Global indices of all unknowns, -1 for fixed dofs and removed multipliers.

    Unknowns are ordered by rank and then by field.

    Attributes:
        first: index of the first unknown of this rank.
        rigid: indices of the unknowns of rigid bodies, which rank 0 owns.
    """

    def __init__(self, eq: ContactEquations):
        self._comm = eq.comm
        self._dim = eq.dim
        n = sum(eq.owned_sizes)
        self.first: int = eq.comm.exscan(n) or 0
        places = self.first + np.arange(n, dtype=np.int64)
        self.rigid: Ints = eq.comm.bcast(places[n - eq.rigid.owned :])
        removed = [c.removed_multipliers for c in eq.constraints.surfaces]
        absent = np.concatenate([eq.fixed[: eq.owned_sizes[0]], *removed])
        places[: len(absent)][absent] = -1
        #: Indices of the owned dofs, by field.
        self._owned = np.split(places, np.cumsum(eq.owned_sizes)[:-1])

    def places(self, field: int, nodes: Ints) -> Ints:
        """Return the global indices of the unknowns at nodes, shape (..., dim). Collective.

        Args:
            field: 0 for the displacement, i + 1 for the multipliers of surface i.
            nodes: global nodes of this field, shape (...).
        """
        return self.dof_places(field, self._dim * nodes[..., None] + np.arange(self._dim))

    def dof_places(self, field: int, dofs: Ints) -> Ints:
        """Return the global indices of the unknowns at dofs of a field. Collective.

        Args:
            field: 0 for the displacement, i + 1 for the multipliers of surface i.
            dofs: global dofs of this field.
        """
        owned = self._owned[field].astype(np.float64)
        return at_global_places(self._comm, owned, dofs).astype(np.int64)


class Jacobian:
    """Assembled Jacobian. The stiffness of a linear body is inserted only once.

    Args:
        equations: contact problem.

    Attributes:
        matrix: AIJ matrix on all unknowns.
    """

    def __init__(self, equations: ContactEquations):
        self._equations = equations
        self._terms = ContactTerms(equations)
        eq = equations
        numbering = self._terms.numbering
        n = eq.owned_sizes[0]
        K = eq.bulk.stiffness(eq.bulk.displacement.x.array.copy())
        indptr, columns, _ = K.getValuesCSR()
        mine = numbering.first + np.arange(n, dtype=np.int64)
        rows = np.repeat(np.where(eq.fixed[:n], -1, mine), np.diff(indptr))
        places = numbering.dof_places(0, columns)
        fixed = mine[eq.fixed[:n]]
        self._fixed = Entries(fixed, fixed)
        self._body = Entries(rows, places)
        self.matrix = self._created()
        #: Previous matrix, which SNES may use until it has received the new one.
        self._replaced: PETSc.Mat | None = None

    def _created(self) -> PETSc.Mat:
        """Return a new unassembled matrix with the current sparsity pattern. Collective."""
        size = sum(self._equations.owned_sizes)
        parts = self._fixed, self._body, *self._terms.set_up()
        matrix = matrix_of(self._equations.comm, (size, size), *parts)
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATIONS, False)
        self._assemblies = -1
        return matrix

    def update(self, evaluation: Evaluation) -> None:
        """Assemble the Jacobian at an evaluation. Collective.

        For sliding faces, `matrix` may be a new object afterwards.
        """
        with logged("ContactJacobian"):
            bulk = self._equations.bulk
            K = bulk.stiffness(evaluation.u)
            if self._terms.changed:
                destroy(self._replaced)
                self._replaced, self.matrix = self.matrix, self._created()
            if self._assemblies == bulk.assemblies:
                self.matrix.retrieveValues()
            else:
                self.matrix.zeroEntries()
                _, _, values = K.getValuesCSR()
                self._body.insert(values, self.matrix)
                diagonal = np.full(self._fixed.number, self._equations.scaling.stiffness)
                self._fixed.add(diagonal, self.matrix)
                self.matrix.storeValues()
                self._assemblies = bulk.assemblies
            self._terms.add(evaluation, self.matrix)

    def destroy(self) -> None:
        """Free the matrices."""
        destroy(self.matrix, self._replaced, self._terms)
