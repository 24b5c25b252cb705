# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factorisation of the block of the Jacobian on the contact nodes and all multipliers.

With the displacements u of the contact nodes c and the multipliers l, the block reads

    K_cc u + J_cl l = r_c,    J_lc u + J_ll l = r_l,

with the stiffness K_cc of the contact nodes, the right-hand sides r_c and r_l, and the contact
terms J_cl = -B^T W E, J_lc = -E^T W D_j B and J_ll = E^T W (I - D_t) E (`equations.jacobian`).
`SurfaceBlock` factorises it without changes. In nodal contact J_cl is diagonal, so that l = J_cl^-1
(r_c - K_cc u) is cheap, and `CondensedBlock` factorises the condensed system of the displacements:

    (J_lc - J_ll J_cl^-1 K_cc) u = r_l - J_ll J_cl^-1 r_c

in the rows of dofs with a multiplier, and K_cc u = r_c in the others. If the 0-1 matrix T maps each
multiplier to its dof, P = J_cl^-1 (0 for dofs without a multiplier), and Q = I - J_cl P - T J_ll P,
the system is

    (T J_lc + Q K_cc) u = T r_l + Q r_c.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Indices
from dolfinx_contact._mpi import SharedValues, all_ranks
from dolfinx_contact._petsc import Factor, destroy, triplet_matrix, triplets
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.points.trace import at_global_places, facet_closures, owned_exterior
from dolfinx_contact.solvers.attempts import LinearSolverError
from dolfinx_contact.solvers.matrix_free import ContactOperator

__all__ = ["CondensedBlock", "SurfaceBlock", "SurfaceSet"]

_ROOM = 50  # percent beyond what MUMPS expects to need
_STRUCTURE = PETSc.Mat.Structure


class SurfaceSet:
    """Unknowns s of the contact surfaces: displacement dofs of their nodes, then all multipliers.

    Attributes:
        local: local indices of s.
        displacement_count: number of displacement dofs in s.
        on_slave: mask of the displacement dofs on the slave side, which may have a multiplier of
            their own.
        fixed: indices in s of the displacement dofs with Dirichlet data.
        of_all: index set of the unknowns s in the numbering of all unknowns.
        of_body: index set of the displacement dofs of s in the numbering of the stiffness.
        displacements: index set of the displacement dofs of s in the numbering of all unknowns.
        multipliers: index set of the multipliers in the numbering of all unknowns.
    """

    def __init__(self, operator: ContactOperator):
        eq = operator.equations
        self.comm = operator.comm
        dofs = _contact_dofs(eq)
        surfaces = _contact_dofs(eq, opposite=False)
        self.on_slave = np.isin(dofs, surfaces)
        rest = np.arange(operator.size, sum(eq.owned_sizes), dtype=np.int32)
        self.local = np.concatenate([dofs, rest])
        self.displacement_count = len(dofs)
        self.fixed = np.flatnonzero(np.isin(dofs, operator.fixed)).astype(np.int32)
        first = operator.first
        first_u = operator.stiffness.getOwnershipRange()[0]
        self.of_all = PETSc.IS().createGeneral(self.local + first, comm=self.comm)
        self.of_body = PETSc.IS().createGeneral(dofs + first_u, comm=self.comm)
        self.displacements = PETSc.IS().createGeneral(dofs + first, comm=self.comm)
        self.multipliers = PETSc.IS().createGeneral(rest + first, comm=self.comm)

    def destroy(self) -> None:
        """Free the index sets."""
        destroy(self.of_all, self.of_body, self.displacements, self.multipliers)


class SurfaceBlock:
    """Direct solver of the block of the Jacobian on the unknowns of the contact surfaces.

    Displacements and multipliers may be coupled in any way. If each multiplier acts on one dof
    only, `CondensedBlock` solves a system of half the size.

    Args:
        operator: Jacobian.
        s: unknowns of the contact surfaces.
        prefix: prefix of the PETSc options of the direct solver.

    Attributes:
        factor: factorisation.
    """

    def __init__(self, operator: ContactOperator, s: SurfaceSet, prefix: str):
        self._operator = operator
        self._s = s
        self._comm = operator.comm
        self.factor = Factor(operator.comm, prefix, determinant=True, room=_ROOM)
        self._contact = operator.contact
        #: Matrices by their formula; most of them are recomputed with their patterns.
        self._made: dict[str, PETSc.Mat] = {}

    def set_stiffness(self, square: PETSc.Mat) -> None:
        """Set the stiffness of the contact nodes. Collective.

        Args:
            square: rows and columns of these nodes, in the order of the surface unknowns.
        """
        rows, columns, values = triplets(square)
        n = len(self._s.local)
        places = (self._comm.exscan(n) or 0) + np.arange(self._s.displacement_count)
        rows = places[rows - square.getOwnershipRange()[0]]
        columns = at_global_places(self._comm, places.astype(np.float64), columns).astype(np.int64)
        whole = triplet_matrix(self._comm, (n, n), rows, columns, values)
        self._copy("K", whole)
        whole.destroy()

    def update(self) -> None:
        """Assemble and factorise the block for the current values of the Jacobian. Collective."""
        A = self._operator
        made = self._made
        if A.contact is not self._contact:  # another pattern
            destroy(made.pop("S", None), made.pop("block", None))
            self._contact = A.contact
        s = self._s.of_all
        made["S"] = A.contact.createSubMatrix(s, s, made.get("S"))
        self._add("block", "K", 1.0, "S")
        # The pattern contains all pairs of facets that may touch; most entries are zero.
        present = _without_zeros(self._without_dirichlet("block"))
        try:
            self._factorise(present)
        finally:
            present.destroy()

    def solve(self, residual: Array) -> Array:
        """Solve the block for the unknowns of the contact surfaces. Collective.

        Args:
            residual: local part of the right-hand side in the rows of these unknowns.

        Returns:
            Local part of the solution.
        """
        x, b = self._made["block"].createVecs()
        b.array[:] = residual
        self.factor.solve(b, x)
        found = x.array_r.copy()
        destroy(x, b)
        return found

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self.factor, *self._made.values())

    def _copy(self, name: str, A: PETSc.Mat) -> None:
        """Store a copy of a matrix under a name, reusing its storage. Collective."""
        if name in self._made:
            A.copy(self._made[name], structure=_STRUCTURE.SAME_NONZERO_PATTERN)
        else:
            self._made[name] = _keeping_pattern(A.copy())

    def _add(self, name: str, first: str, a: float, second: str) -> None:
        """Store A + a B of two stored matrices under a name, reusing its storage. Collective."""
        A = self._made[first]
        B = self._made[second]
        if name not in self._made:
            self._made[name] = A.copy()
            self._made[name].axpy(a, B, structure=_STRUCTURE.DIFFERENT_NONZERO_PATTERN)
            _keeping_pattern(self._made[name])
            return
        out = self._made[name]
        out.zeroEntries()
        out.axpy(1.0, A, structure=_STRUCTURE.SUBSET_NONZERO_PATTERN)
        out.axpy(a, B, structure=_STRUCTURE.SUBSET_NONZERO_PATTERN)

    def _without_dirichlet(self, name: str) -> PETSc.Mat:
        """Return a matrix after eliminating Dirichlet rows and columns in place. Collective."""
        A = self._made[name]
        A.zeroRowsColumns(self._s.fixed + A.getOwnershipRange()[0], diag=self._operator.diagonal)
        return A

    def _factorise(self, A: PETSc.Mat) -> None:
        # The second attempt repeats the analysis.
        if not (self.factor.factorise(A) or self.factor.factorise(A)):
            raise LinearSolverError(
                "the contact block of the Jacobian is singular: contact conditions contradict one "
                "another or the Dirichlet data, or a contact node has no stiffness"
            )


class CondensedBlock(SurfaceBlock):
    """Direct solver of the block on the surface unknowns that eliminates the multipliers first.

    Attributes:
        applies: whether every multiplier acts on a single slave dof or was removed, so that the
            multipliers can be eliminated.
    """

    def __init__(self, operator: ContactOperator, s: SurfaceSet, prefix: str):
        super().__init__(operator, s, prefix)
        J_cl = operator.contact.createSubMatrix(s.displacements, s.multipliers)
        indptr, columns, values = J_cl.getValuesCSR()
        rows = np.repeat(np.arange(s.displacement_count), np.diff(indptr))
        kept = np.flatnonzero((values != 0) & s.on_slave[rows] & ~np.isin(rows, s.fixed))
        one_each = all_ranks(self._comm, len(np.unique(rows[kept])) == len(kept))
        if not one_each:
            kept = kept[:0]
        n = s.displacement_count
        m = len(s.local) - s.displacement_count
        starts = np.searchsorted(rows[kept], np.arange(n + 1)).astype(np.int32)
        T, inverse = (
            PETSc.Mat().createAIJ(
                ((n, None), (m, None)), csr=(starts, columns[kept], v), comm=self._comm
            )
            for v in (np.ones(len(kept)), 1.0 / values[kept])
        )
        P = inverse.transpose(PETSc.Mat())
        number, ones = T.createVecs()  # number of dofs of each multiplier
        ones.set(1.0)
        T.multTranspose(ones, number)
        self._alone = number.array_r == 0
        surfaces = operator.equations.constraints.surfaces
        removed = np.concatenate([c.removed_multipliers for c in surfaces])
        fits = bool(((number.array_r == 1) | (self._alone & removed)).all())
        self.applies = one_each and all_ranks(self._comm, fits)
        # I - J_cl P: without the rows of dependent dofs, and with their contributions to others.
        identity = PETSc.Mat().createAIJ(((n, None), (n, None)), nnz=(1, 0), comm=self._comm)
        identity.setUp()
        identity.setDiagonal(ones)
        identity.assemble()
        self._made |= {"T": T, "P": P, "I": identity, "J_cl P": J_cl.matMult(P)}
        self._add("I - J_cl P", "I", -1.0, "J_cl P")
        destroy(J_cl, inverse, number, ones)

    def set_stiffness(self, square: PETSc.Mat) -> None:
        """See `SurfaceBlock.set_stiffness`. Collective."""
        self._copy("K", square)
        # Dirichlet columns are zero, and Dirichlet rows are used as identities.
        self._without_dirichlet("K")

    def update(self) -> None:
        """Condense and factorise the block for the current values of the Jacobian. Collective.

        Sparsity patterns never change: products, sums and symbolic factorisation are set up once.
        """
        contact = self._operator.contact
        s = self._s
        made = self._made
        for name, columns in (("J_lc", s.displacements), ("J_ll", s.multipliers)):
            made[name] = contact.createSubMatrix(s.multipliers, columns, made.get(name))
        self._multiply("J_ll P", "J_ll", "P")
        self._multiply("T J_ll P", "T", "J_ll P")
        self._add("Q", "I - J_cl P", -1.0, "T J_ll P")
        self._multiply("Q K", "Q", "K")
        self._multiply("T J_lc", "T", "J_lc")
        self._add("block", "Q K", 1.0, "T J_lc")
        self._factorise(self._without_dirichlet("block"))  # also with Dirichlet columns of J_lc

    def _multiply(self, name: str, first: str, second: str) -> None:
        """Store the product of stored matrices under a name, reusing its storage. Collective."""
        A = self._made[first]
        self._made[name] = A.matMult(self._made[second], self._made.get(name))

    def solve(self, residual: Array) -> Array:
        """Solve the block for the unknowns of the contact surfaces. Collective.

        Args:
            residual: local part of the right-hand side in the rows of these unknowns.

        Returns:
            Local part of the solution.
        """
        made = self._made
        r_l, r_c = made["T"].createVecs()
        b = r_c.duplicate()
        n = self._s.displacement_count
        r_c.array[:], r_l.array[:] = residual[:n], residual[n:]
        made["Q"].mult(r_c, b)
        made["T"].multAdd(r_l, b, b)
        u = r_c.duplicate()
        self.factor.solve(b, u)
        # multipliers P (r_c - K u)
        made["K"].mult(u, b)
        b.aypx(-1.0, r_c)
        made["P"].mult(b, r_l)
        multipliers = r_l.array_r.copy()
        multipliers[self._alone] = residual[n:][self._alone] / self._operator.diagonal
        found = np.concatenate([u.array_r, multipliers])
        destroy(r_l, r_c, b, u)
        return found


def _keeping_pattern(A: PETSc.Mat) -> PETSc.Mat:
    A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    return A


def _without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """Return a matrix without stored zeros, which makes its factors sparser. Collective."""
    indptr, columns, values = A.getValuesCSR()
    kept = values != 0
    before = np.concatenate([[0], np.cumsum(kept)])
    csr = (before[indptr].astype(PETSc.IntType), columns[kept], values[kept])
    return PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=A.comm)


def _contact_dofs(equations: ContactEquations, *, opposite: bool = True) -> Indices:
    """Return local indices of the owned displacement dofs of all contact facets. Collective."""
    V = equations.V
    sides = [s.submesh.parent_facets for s in equations.surfaces]
    if opposite:
        masters = [s.obstacle.opposite for s in equations.surfaces]
        sides += [m.master_facets for m in masters if m is not None]
    touching = [facet_closures(V, owned_exterior(V.mesh, side)).reshape(-1) for side in sides]
    marks = SharedValues(V.dofmap.index_map).marked(np.concatenate(touching))
    nodes = np.flatnonzero(marks[: V.dofmap.index_map.size_local])
    bs = V.dofmap.index_map_bs
    return (bs * nodes[:, None] + np.arange(bs)).reshape(-1).astype(np.int32)
