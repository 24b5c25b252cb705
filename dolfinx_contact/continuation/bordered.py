# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The bordered system: H(x, gamma) = 0 with one more row, regular where gamma turns back.

    [ H_x  H_gamma ] [ dx     ]
    [ w^T  w_gamma ] [ dgamma ]

Vectors y = (x, gamma) are PETSc vectors whose last entry, on the last rank, is gamma. The matrix is
assembled and factorised by MUMPS; one factorisation serves every right-hand side, and the matrices
that come after it as well: from one state and piece to the next they differ by little and by the
rows of the points that change their status, so that GMRES, preconditioned with the factorisation,
solves with the new matrix to round-off in a few iterations. When it needs many, the matrix is
factorised anew.
"""

from __future__ import annotations

from contextlib import AbstractContextManager

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import options_in_database
from dolfinx_contact.continuation.system import Piece, System

__all__ = ["Bordered"]

_DEFAULTS = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 80,
    "mat_mumps_icntl_33": 1,  # the determinant, for its sign
}

_LARGE = 2000  # unknowns from which on a factorisation is reused
_ROUND_OFF = 1e-13  # relative, of GMRES
_MOST_ITERATIONS = 40  # of GMRES; beyond, the matrix is factorised
_WORN = 20  # iterations after which the next matrix is factorised


class Bordered:
    """Vectors, inner product and linear algebra of y = (x, gamma).

    Args:
        system: what is followed.
        gamma_scale: size of gamma that counts as 1.
        prefix: of PETSc options.
        reuse: whether a factorisation also serves the matrices after it; by default it does where
            factorising takes many times as long as solving.
    """

    def __init__(
        self,
        system: System,
        *,
        gamma_scale: float,
        prefix: str = "continuation_",
        reuse: bool | None = None,
    ):
        self.system, self.comm, self.prefix = system, system.comm, prefix
        self._last = self.comm.rank == self.comm.size - 1
        self.x, self._c, self._w = (system.create_vector() for _ in range(3))
        self._local, self._size = self.x.getLocalSize(), self.x.getSize()
        self.reuse = self._size >= _LARGE if reuse is None else reuse
        self.gamma_scale = gamma_scale
        #: Square of the length of x that counts as 1; 0 until a tangent moves x.
        self.x_scale = 0.0
        #: Set when `x_scale` is; whoever notices resets it.
        self.x_scale_is_new = False
        #: Factorisations and their applications so far.
        self.factorisations = self.solves = 0
        one = int(self._last)
        n, N = self._local, self._size
        comm = self.comm
        self._column = PETSc.Mat().createAIJ([[n, N], [one, 1]], nnz=(1, 1), comm=comm)
        self._row = PETSc.Mat().createAIJ([[one, 1], [n, N]], nnz=(max(n, 1), N), comm=comm)
        self._corner = PETSc.Mat().createAIJ([[one, 1], [one, 1]], nnz=(1, 0), comm=comm)
        self._nest: PETSc.Mat | None = None
        self.matrix = PETSc.Mat()
        self.ksp = PETSc.KSP().create(comm)
        self.ksp.setOptionsPrefix(prefix)
        with self.options():
            self.ksp.setFromOptions()
        self.ksp.getPC().setReusePreconditioner(True)
        self._krylov = PETSc.KSP().create(comm)
        self._krylov.setType(PETSc.KSP.Type.GMRES)
        self._krylov.setPC(self.ksp.getPC())
        self._krylov.setGMRESRestart(_MOST_ITERATIONS)
        self._krylov.setTolerances(rtol=_ROUND_OFF, max_it=_MOST_ITERATIONS)
        #: Whether there is a factorisation, whether it is that of `matrix`, and whether it is old.
        self._factorised = self._current = self._worn = False

    def options(self) -> AbstractContextManager[None]:
        """The options of the linear solver; MUMPS reads its own at every set-up."""
        return options_in_database(self.prefix, _DEFAULTS)

    # -- vectors ---------------------------------------------------------------------------------

    def vector(self) -> PETSc.Vec:
        """A vector for y."""
        local = self._local + int(self._last)
        return PETSc.Vec().createMPI((local, self._size + 1), comm=self.comm)

    def gamma(self, y: PETSc.Vec) -> float:
        """Gamma of ``y``, on every rank."""
        mine = float(y.array_r[-1]) if self._last else 0.0
        return float(self.comm.bcast(mine, root=self.comm.size - 1))

    def split(self, y: PETSc.Vec) -> tuple[PETSc.Vec, float]:
        """X (in a vector that is reused) and gamma of ``y``."""
        self.x.array[:] = y.array_r[: self._local]
        return self.x, self.gamma(y)

    def join(self, x: PETSc.Vec, gamma: float, y: PETSc.Vec) -> None:
        """Put x and gamma into ``y``."""
        y.array[: self._local] = x.array_r
        if self._last:
            y.array[-1] = gamma

    def dual(self, y: PETSc.Vec, out: PETSc.Vec) -> None:
        """The row vector of the inner product with ``y`` into ``out``."""
        x, gamma = self.split(y)
        self.system.metric(x, self._w)
        if self.x_scale > 0:
            self._w.scale(0.5 / self.x_scale)
        else:
            self._w.set(0.0)
        self.join(self._w, 0.5 * gamma / self.gamma_scale**2, out)

    def inner(self, y: PETSc.Vec, z: PETSc.Vec) -> float:
        """Inner product: half from x, half from gamma, each over its scale."""
        w = y.duplicate()
        self.dual(y, w)
        value = float(w.dot(z))
        w.destroy()
        return value

    def set_scale(self, t: PETSc.Vec) -> None:
        """Take the scale of x from the first tangent ``t`` that moves it. Collective.

        Then x and gamma have equal shares in the length of ``t``, and neither units nor the
        numbers of unknowns and ranks matter for the lengths of steps.
        """
        x, gamma = self.split(t)
        self.system.metric(x, self._w)
        length, noise = float(self._w.dot(x)), 1e-20 * float(x.dot(x)) / self._size
        if self.x_scale == 0.0 and length > noise and gamma != 0:
            self.x_scale = length * (self.gamma_scale / gamma) ** 2
            self.x_scale_is_new = True

    def require_scale(self) -> None:
        """See that x has a scale: 1 in the metric of the system if no tangent has moved it yet."""
        if self.x_scale == 0.0:
            self.x_scale, self.x_scale_is_new = 1.0, True

    # -- linear algebra --------------------------------------------------------------------------

    def assemble(self, y: PETSc.Vec, row: PETSc.Vec, piece: Piece | None) -> None:
        """Fill the matrix at ``y`` with the dual vector ``row`` as its last row."""
        x, gamma = self.split(y)
        self.system.jacobian(x, gamma, piece)
        self.system.parameter_derivative(x, gamma, self._c, piece)
        start = self._c.getOwnershipRange()[0]
        rows = np.arange(start, start + self._local, dtype=np.int32)
        self._column.setValues(rows, [0], self._c.array_r)
        parts = self.comm.gather(row.array_r[: self._local].copy(), root=self.comm.size - 1)
        if self._last:
            columns = np.arange(self._size, dtype=np.int32)
            self._row.setValues([0], columns, np.concatenate(parts))
            self._corner.setValue(0, 0, row.array_r[-1])
        for block in (self._column, self._row, self._corner):
            block.assemble()
        if self._nest is None:
            blocks = [[self.system.matrix, self._column], [self._row, self._corner]]
            self._nest = PETSc.Mat().createNest(blocks, comm=self.comm)
            self._nest.assemble()
            self._nest.convert("aij", self.matrix)
        else:
            self._nest.assemble()
            self._nest.convert("aij", self.matrix)
        self._current = False

    def factorise(self) -> bool:
        """Factorise the matrix that was assembled; False if it is singular."""
        self.ksp.setOperators(self.matrix)
        self.ksp.getPC().setReusePreconditioner(False)
        with self.options():
            self.ksp.setUp()
        self.ksp.getPC().setReusePreconditioner(True)
        self.factorisations += 1
        ok = bool(self.ksp.getPC().getFailedReason() == PETSc.PC.FailedReason.NOERROR)
        if not ok:
            self.ksp.reset()  # MUMPS does not recover from a singular matrix
        self._factorised = self._current = ok
        self._worn = False
        return ok

    def solve(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        """Solve with the matrix that was assembled; False if that failed."""
        if not self._current:
            again = self.reuse and self._factorised and not self._worn
            if again and self._solve_by_krylov(rhs, out):
                return True
            if not self.factorise():
                return False
        self.ksp.solve(rhs, out)
        self.solves += 1
        return bool(self.ksp.getConvergedReason() > 0 and np.isfinite(out.norm()))

    def _solve_by_krylov(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        self._krylov.setOperators(self.matrix)
        self._krylov.solve(rhs, out)
        iterations = self._krylov.getIterationNumber()
        self.solves += iterations + 1
        self._worn = iterations > _WORN
        return bool(self._krylov.getConvergedReason() > 0 and np.isfinite(out.norm()))

    def last_unit(self) -> PETSc.Vec:
        """The right-hand side (0, 1) of tangents."""
        e = self.vector()
        e.set(0.0)
        if self._last:
            e.array[-1] = 1.0
        return e

    def determinant_sign(self) -> float:
        """Sign of the determinant of the last factorisation, by MUMPS.

        Of the matrix that was assembled last, which is factorised if it has not been yet.
        """
        if not self._current and not self.factorise():
            return 0.0
        return float(np.sign(self.ksp.getPC().getFactorMatrix().getMumpsRinfog(12)))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for thing in (
            self._krylov,
            self.ksp,
            self.matrix,
            self._column,
            self._row,
            self._corner,
            self._nest,
        ):
            if thing is not None:
                thing.destroy()
