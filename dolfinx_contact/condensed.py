# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact condensed onto its points: the bulk is eliminated once.

With contact nodes C, inner nodes I and w = (ut, un, rt, rn) at every contact point, equilibrium

    K_II du_I + K_IC du_C + c_I dgamma + b_I = 0
    K_CI du_I + K_CC du_C + c_C dgamma + b_C = dr_C

becomes S a - r = p + gamma q with the Schur complement S = K_CC - K_CI K_II^{-1} K_IC, which is
dense and small: the same on every rank. Where the bulk is linear and gamma enters the data linearly
this is the whole problem; else it is its linearisation, which decides how branches leave a point.

It holds for contact at the nodes in 2D without friction or with Coulomb's, whose statuses are
polyhedral cones (`laws.cones`).
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._petsc import options_in_database, staged
from dolfinx_contact.continuation import Piece
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.laws import Coulomb, Frictionless
from dolfinx_contact.laws.cones import classify_points, coulomb_cones
from dolfinx_contact.result import by_coordinates

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["CondensedContact", "can_condense"]

Array = npt.NDArray[np.float64]
_MOST_POINTS = 1024
_DEFINITE = 1e-10  # least eigenvalue of the condensed stiffness, whose mean diagonal entry is 1
_BATCH = 128  # right-hand sides solved at once
_DEFAULTS = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 80,
}


def can_condense(parametric: ParametricContact, *, partly: bool = False) -> bool:
    """Whether a problem has affine pieces at its contact points. Collective.

    Args:
        parametric: the problem.
        partly: whether tangential displacements of contact points may be prescribed: the statuses
            of such points are not those of the problem.
    """
    problem = parametric.problem
    points = problem.comm.allreduce(int((~parametric.clamped).sum()))
    if problem.surfaces[0].dim != 2 or not 0 < points <= _MOST_POINTS:
        return False
    nodes = []
    for s in problem.surfaces:
        if s.method != "nodal" or not isinstance(s.law, Coulomb | Frictionless):
            return False
        if s in parametric.moving or parametric.depends_on_gamma(s.law.bound(s.gap)):
            return False
        nodes.append(s.vertex_trace_dofs)
    mixed = False
    for s, n, clamped in zip(problem.surfaces, nodes, problem.constraints.clamped, strict=True):
        fixed = problem.constraints.fixed[n]
        some = fixed.any(axis=1) & ~fixed.all(axis=1)
        if partly:
            # Of a normal that is not along an axis a part would be prescribed.
            along = np.abs(np.where(fixed, s.vertex_normals, 0.0)).max(axis=1, initial=0.0)
            some &= ~clamped & (along > 1e-6)
        mixed = mixed or bool(some.any())
    flat = np.concatenate(nodes)
    shared = len(np.unique(flat)) < len(flat)
    return not problem.comm.allreduce(mixed or shared, op=_any)


class CondensedContact:
    """A contact problem with a parameter, condensed at a state. Collective.

    Args:
        parametric: the problem; `can_condense` must hold.
        x: state at which H is linearised.
        gamma: parameter there.
        exact: whether the pieces are affine, so that the linearisation is the problem.

    Attributes:
        system: the affine system of the contact points, in the order of their coordinates.
        exact: as given.
        friction: coefficients of the points, (m,); 0 without friction.
    """

    friction: Array

    _m: int  # points
    _nodes: npt.NDArray[np.int64]  # their displacement's global block numbers
    _frames: Array  # (m, 2, 2), u - g n = T (ut, un)
    _areas: Array
    _grips: npt.NDArray[np.bool_]  # points with friction
    _r: Array  # augmentation times area
    _b_points: Array  # condensed residual and load, (m, 2)
    _c_points: Array

    @staged("ContactCondensation")
    def __init__(self, parametric: ParametricContact, x: PETSc.Vec, gamma: float, *, exact: bool):
        self.parametric, self.problem, self.exact = parametric, parametric.problem, exact
        self.comm, self._gamma, self._x = self.problem.comm, gamma, x.copy()
        self._n = self.problem.owned_sizes[0]
        self._b, self._c = parametric.create_vector(), parametric.create_vector()
        piece = parametric.piece_at(x, gamma)
        parametric.residual(x, gamma, self._b, piece)
        parametric.parameter_derivative(x, gamma, self._c, piece)
        self._gather_points()
        self._factorise()
        schur = self._schur_complement()
        self._loads()
        T, m, k = self._frames, self._m, float(np.abs(np.diag(schur)).mean())
        S = np.einsum("iap,iajb,jbq->ipjq", T, schur.reshape(m, 2, m, 2), T) / k
        self._force_unit = k
        M = np.zeros((2 * m, m, 4))
        M[:, :, :2] = S.reshape(2 * m, m, 2)
        M.reshape(m, 2, m, 4)[np.arange(m), :, np.arange(m), 2:] = -np.eye(2)
        rate = -np.einsum("iap,ia->ip", T, self._c_points).reshape(-1) / k
        rest = np.einsum("iap,ia->ip", T, self._b_points).reshape(-1) / k
        self._w = self.contract(x)
        load = np.einsum("nmk,mk->n", M, self._w) - rest - gamma * rate
        bases, inequalities, exists = coulomb_cones(self.friction, self._grips)
        classify = partial(
            classify_points, friction=self.friction, grips=self._grips, r=np.asarray(self._r / k)
        )
        self.system = AffineSystem(M, load, rate, bases, inequalities, classify, exists)

    @cached_property
    def always_solvable(self) -> bool:
        """Whether there is a solution at every gamma: S is positive definite, and H affine.

        Then the problem with a friction bound given in advance has one solution, which depends
        continuously on the bound, and Brouwer's theorem gives a bound that is F times its pressure
        (Haslinger, Math. Methods Appl. Sci. 5, 1983).
        """
        n = 2 * self._m
        S = self.system.matrix[:, :, :2].reshape(n, n)
        return self.exact and bool(np.linalg.eigvalsh(S + S.T)[0] > _DEFINITE)

    # -- points ----------------------------------------------------------------------------------

    def _gather_points(self) -> None:
        """Where the contact points are, what holds there, and who owns their displacement."""
        problem = self.problem
        columns: list[list[Any]] = []
        index_map = problem.V.dofmap.index_map
        for s, clamped, _offset in self.parametric.surface_parts():
            free = np.flatnonzero(~clamped)
            state, friction = s.state(), s.friction_slope()
            nodes = index_map.local_to_global(s.vertex_trace_dofs.astype(np.int32))
            held = self.problem.constraints.fixed[s.vertex_trace_dofs].any(axis=1)
            grips = isinstance(s.law, Coulomb) & ~held
            r = s.r.x.array * s.vertex_areas
            what = nodes, state["n"], state["area"], friction, grips, r, state["x"]
            columns.append([values[free] for values in what])
        mine = [np.concatenate(c) for c in zip(*columns, strict=True)]
        parts = self.comm.allgather(mine)
        all_points = [np.concatenate(c) for c in zip(*parts, strict=True)]
        # In the order of coordinates, so that neither numbering nor ranks matter.
        self._sorted = by_coordinates(all_points[-1])
        nodes, normals, self._areas, friction, grips, self._r, _ = (
            values[self._sorted] for values in all_points
        )
        self.friction, self._grips = np.where(grips, friction, 0.0), grips.astype(bool)
        self._nodes, self._m = nodes.astype(np.int64), len(nodes)
        tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        self._frames = np.stack([tangents, -normals], axis=2)
        self._starts = np.concatenate([[0], np.cumsum([len(p[0]) for p in parts])])
        self._free = np.flatnonzero(~self.parametric.clamped)
        first = self._starts[self.comm.rank]
        #: The places of the points of this rank.
        self._mine = np.argsort(self._sorted)[first : first + len(self._free)]
        a, e = index_map.local_range
        #: Contact points whose displacement this rank owns, and its local degrees of freedom.
        self._here = np.flatnonzero((self._nodes >= a) & (self._nodes < e))
        local = 2 * (self._nodes[self._here] - a)
        self._contact = (local[:, None] + np.arange(2)).reshape(-1)

    def point(self, i: int) -> tuple[int, int]:
        """The rank that owns point ``i``, and its local number there. Collective."""
        place = int(self._sorted[i])
        rank = int(np.searchsorted(self._starts, place, side="right") - 1)
        mine = int(self._free[place - self._starts[rank]]) if self.comm.rank == rank else None
        return rank, int(self.comm.bcast(mine, root=rank))

    def codes(self, piece: Piece) -> npt.NDArray[np.int8]:
        """Statuses of all points. Collective."""
        return np.concatenate(self.comm.allgather(piece.codes[self._free]))[self._sorted]

    def piece(self, codes: npt.NDArray[np.int8]) -> Piece:
        """The piece in which the points have these statuses."""
        new = np.zeros(len(self.parametric.clamped), dtype=np.int8)
        new[self._free] = codes[self._mine]
        return Piece(new)

    # -- bulk ------------------------------------------------------------------------------------

    def _factorise(self) -> None:
        K = self.problem.bulk.stiffness()
        start = K.getOwnershipRange()[0]
        fixed = self.problem.constraints.fixed.reshape(-1)[: self._n].copy()
        prescribed = start + self._contact[fixed[self._contact]]
        several = self.comm.allreduce(len(prescribed)) > 0
        if several:  # displacements of contact points that are not free have rows of their own
            K = K.copy()
            K.zeroRowsColumns(prescribed.astype(np.int32), self.problem.stiffness_scale)
        inner = ~fixed
        inner[self._contact] = fixed[self._contact] = False
        self._inner, self._fixed = np.flatnonzero(inner), np.flatnonzero(fixed)
        inside, contact = (
            PETSc.IS().createGeneral((start + part).astype(np.int32), comm=self.comm)
            for part in (self._inner, self._contact)
        )
        self._K_IC, self._K_CI = (
            K.createSubMatrix(inside, contact),
            K.createSubMatrix(contact, inside),
        )
        self._K_CC, K_II = (
            K.createSubMatrix(contact, contact),
            K.createSubMatrix(inside, inside),
        )
        if several:
            K.destroy()
        self._ksp = PETSc.KSP().create(self.comm)
        self._ksp.setOptionsPrefix("condensed_")
        self._ksp.setOperators(K_II)
        with options_in_database("condensed_", _DEFAULTS):
            self._ksp.setFromOptions()
            self._ksp.setUp()
        if self._ksp.getPC().getFailedReason() != PETSc.PC.FailedReason.NOERROR:
            raise RuntimeError(
                "the bulk held at its contact nodes is singular: it cannot be solved"
            )

    def _order(self) -> npt.NDArray[np.int64]:
        """For each degree of freedom of the points its place among those of C."""
        owned = np.concatenate(self.comm.allgather(self._here))
        place = np.empty(self._m, dtype=np.int64)
        place[owned] = np.arange(self._m)
        return (2 * place[:, None] + np.arange(2)).reshape(-1)

    def _schur_complement(self) -> Array:
        N, columns = self._K_IC.getLocalSize()[0], 2 * self._m
        B = self._K_IC.convert("dense", PETSc.Mat())
        G, factor = np.empty((N, columns)), self._ksp.getPC().getFactorMatrix()
        right = B.getDenseArray()
        for a in range(0, columns, _BATCH):
            width = min(_BATCH, columns - a)
            rhs, out = (
                PETSc.Mat().createDense(((N, None), (None, width)), comm=self.comm) for _ in "bx"
            )
            rhs.setUp(), out.setUp()
            rhs.getDenseArray()[:, :] = right[:, a : a + width]
            rhs.assemble(), out.assemble()
            factor.matSolve(rhs, out)
            G[:, a : a + width] = out.getDenseArray(readonly=True)
            rhs.destroy(), out.destroy()
        dense = PETSc.Mat().createDense(
            (self._K_CI.getSizes()[1], self._K_CC.getSizes()[1]), array=G, comm=self.comm
        )
        dense.assemble()
        product = self._K_CI.matMult(dense)
        full = self._K_CC.convert("dense", PETSc.Mat())
        mine = full.getDenseArray(readonly=True) - product.getDenseArray(readonly=True)
        S = np.concatenate(self.comm.allgather(np.asarray(mine)))
        for thing in (B, dense, product, full):
            thing.destroy()
        order = self._order()
        return np.asarray(S[np.ix_(order, order)])

    def _loads(self) -> None:
        """Condensed residual and load, and the displacements of inner nodes under them."""
        order = self._order()
        self._inner_parts, condensed = [], []
        for v in (self._b, self._c):
            right, left = self._K_IC.createVecLeft(), self._K_IC.createVecLeft()
            right.array[:] = v.array_r[self._inner]
            self._ksp.solve(right, left)
            forces = self._K_CI.createVecLeft()
            self._K_CI.mult(left, forces)
            mine = v.array_r[self._contact] - forces.array_r
            condensed.append(np.concatenate(self.comm.allgather(mine))[order].reshape(-1, 2))
            self._inner_parts.append(left)
            right.destroy(), forces.destroy()
        self._b_points, self._c_points = condensed

    # -- states ----------------------------------------------------------------------------------

    def contract(self, x: PETSc.Vec) -> Array:
        """The state w of all points, (m, 4). Collective."""
        self.problem.read(x)
        parts = []
        for s, clamped, _offset in self.parametric.surface_parts():
            free, state = np.flatnonzero(~clamped), s.state()
            n = state["n"]
            t = np.stack([-n[:, 1], n[:, 0]], axis=1)
            force = state["area"] / self._force_unit
            parts.append(
                np.stack(
                    [
                        np.sum(state["ut"] * t, axis=1),
                        state["un"],
                        np.sum(state["shear"] * t, axis=1) * force,
                        state["pressure"] * force,
                    ],
                    axis=1,
                )[free]
            )
        return np.concatenate(self.comm.allgather(np.concatenate(parts)))[self._sorted]

    def expand(self, w: Array, gamma: float, x: PETSc.Vec) -> None:
        """Put the unknowns of the state ``w`` at ``gamma`` into ``x``. Collective."""
        dw, dgamma = w - self._w, gamma - self._gamma
        du = np.einsum("iap,ip->ia", self._frames, dw[:, :2])
        dr = np.einsum("iap,ip->ia", self._frames, dw[:, 2:]) * self._force_unit
        right, inner = self._K_IC.createVecLeft(), self._K_IC.createVecLeft()
        contact = self._K_IC.createVecRight()
        contact.array[:] = du[self._here].reshape(-1)
        self._K_IC.mult(contact, right)
        self._ksp.solve(right, inner)
        inner.axpy(1.0, self._inner_parts[0])
        inner.axpy(dgamma, self._inner_parts[1])
        self._x.copy(x)
        u = x.array[: self._n]
        u[self._inner] -= inner.array_r
        u[self._contact] += contact.array_r
        rest = self._b.array_r[self._fixed] + dgamma * self._c.array_r[self._fixed]
        u[self._fixed] -= rest / self.problem.stiffness_scale
        tractions = (dr / self._areas[:, None])[self._mine]
        self.parametric.add_tractions(x, self._free, tractions)
        for thing in (right, inner, contact):
            thing.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._ksp.destroy()
        for thing in (self._K_IC, self._K_CI, self._K_CC, self._x, self._b, self._c):
            thing.destroy()
        for v in self._inner_parts:
            v.destroy()


def _any(a: bool, b: bool) -> bool:
    return a or b
