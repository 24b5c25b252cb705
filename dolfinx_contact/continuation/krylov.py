# SPDX-License-Identifier: LGPL-3.0-or-later
"""Krylov method for the bordered matrix, for systems that are too large to factorise.

The matrix is J = [A c; w^T w_gamma] with A = H_x and c = H_gamma. Let P^-1 be an approximate
inverse of A, v an approximation of A^-1 c, and s = w_gamma - w^T v. For a right-hand side (f, g)
the block elimination

    x_0 = P^-1 f,   gamma = (g - w^T x_0) / s,   x = x_0 - gamma v

is the exact inverse of [P P v; w^T w_gamma] and preconditions J. Each elimination applies P^-1
once. The first one satisfies the last row of J exactly; the subsequent iterations omit this row.

If (t_x, t_gamma) approximates the tangent of the branch, v = -t_x / t_gamma is used if A v - c is
small, corrected in the rows in which P is exact. Otherwise, as near folds, v = P^-1 c applies P^-1
once more. At folds the elimination is regular although A is not.

The sign of det J is a by-product of a solve whose right-hand side has components along all
eigenvectors. With the number n of negative real Ritz values of the preconditioned matrix

    sign det J = sign det P  sign s  (-1)^n.

A converged solve can only miss an eigenvalue close to other eigenvalues; an eigenvalue near zero
would prevent convergence. A singular J is detected if the right-hand side is outside its range.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._inexact import Forcing
from dolfinx_contact._petsc import logged, options_in_database
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.system import Piece, Preconditioner

__all__ = ["Krylov"]

logger = logging.getLogger(__name__)

_PRECISE = 1e-9  # default relative residual of a solve
# The relative residual of solves that determine the sign of the determinant is the smaller of
# _SIGN and _BELOW / sqrt(N), which is well below the component of a random right-hand side along
# one of N eigenvectors.
_SIGN = 1e-4
_BELOW = 1e-2
_DEFAULTS = {"ksp_type": "fgmres", "ksp_gmres_restart": 200, "ksp_max_it": 200}
_NEAR = 0.5  # largest |A v - c| / |c| of a v from a tangent; measured for v = P^-1 c: 0.15


#: Rule by which a linear solve ends when its residual is below the error of linearisation, and
#: function of a correction returning the norm of H after it, in the rows in which the linear model
#: is inexact.
ModelTest: TypeAlias = tuple[Forcing, Callable[[PETSc.Vec], float]]


class Krylov:
    """Solves with the bordered matrix J by a preconditioned Krylov method; see `Bordered.solver`.

    Args:
        layout: layout of vectors y = (x, gamma).
        prefix: prefix of PETSc options.
        preconditioner: approximate inverse of the derivative H_x of the system.
    """

    row: PETSc.Vec
    precision = 1e-8
    is_direct = False
    factorisations = 0

    def __init__(self, layout: Layout, prefix: str, preconditioner: Preconditioner):
        self._layout = layout
        self._P = preconditioner
        self.solves = 0
        create = layout.system.create_vector
        self._c, self._v, self._w, self._f, self._x = (create() for _ in range(5))
        self._r, self._d, self._work = (layout.vector() for _ in range(3))
        self._corner = self._s = 0.0
        n = self._r.getLocalSize()
        self.matrix = PETSc.Mat().createPython(
            ((n, None), (n, None)), SimpleNamespace(mult=self.mult), layout.comm
        )
        self.matrix.setUp()
        self.ksp = PETSc.KSP().create(layout.comm)
        self.ksp.setOptionsPrefix(prefix)
        with options_in_database(prefix, _DEFAULTS):
            self.ksp.setFromOptions()
        self.ksp.setPCSide(PETSc.PC.Side.RIGHT)
        self.ksp.setComputeEigenvalues(True)
        self.ksp.setOperators(self.matrix)
        self.ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        self.ksp.getPC().setPythonContext(SimpleNamespace(apply=self.apply))
        self.ksp.addConvergenceTest(self._test)
        #: Model test, size of the right-hand side and first iterate of the running solve.
        self._asked: tuple[ModelTest, float, PETSc.Vec] | None = None
        self._most = self.ksp.getTolerances()[3]
        self._regular = False
        self._sign: float | None = None

    # -- J and its approximate inverse -----------------------------------------------------------

    def assemble(
        self, y: PETSc.Vec, row: PETSc.Vec, piece: Piece | None, *, along: PETSc.Vec | None = None
    ) -> None:
        """Set the bordered matrix J for the following solves.

        Args:
            y: point (x, gamma).
            row: last row of J.
            piece: fixed statuses of all points; None to determine them from the state.
            along: approximate tangent; default: unknown.
        """
        layout = self._layout
        x, gamma = layout.split(y)
        self._sign = None
        self.row = row
        self._w.array[:] = row.array_r[: layout.local]
        self._corner = layout.gamma(row)
        self._layout.system.parameter_derivative(x, gamma, self._c, piece)
        try:
            self._layout.system.jacobian(x, gamma, piece)
        except ArithmeticError as error:
            if layout.comm.rank == 0:
                logger.debug("no preconditioner: %s", error)
            self._regular = False
            return
        if along is None or not self._takes_from(along):
            self._apply(self._c, self._v)
        self._s = self._corner - float(self._w.dot(self._v))
        self._regular = bool(np.isfinite(self._s) and self._s != 0)

    def _takes_from(self, tangent: PETSc.Vec) -> bool:
        """Compute v = -t_x / t_gamma from a tangent; return False if inaccurate. Collective."""
        x, gamma = self._layout.split(tangent)
        if gamma == 0:
            return False
        x.copy(self._v)
        self._v.scale(-1.0 / gamma)
        self._layout.system.matrix.mult(self._v, self._f)
        self._f.axpy(-1.0, self._c)
        if not self._f.norm() <= _NEAR * self._c.norm():
            return False
        # Make the residual vanish in the rows in which P is exact, as for v = P^-1 c. The block
        # elimination then leaves no residual there.
        self._P.apply_exact(self._f, self._x)
        self._v.axpy(-1.0, self._x)
        return True

    def _apply(self, f: PETSc.Vec, x: PETSc.Vec) -> None:
        self._P.apply(f, x)
        self.solves += 1

    def apply(self, _pc: PETSc.PC | None, b: PETSc.Vec, y: PETSc.Vec) -> None:
        """Apply the block elimination to a right-hand side b = (f, g); also called by PETSc."""
        f, g = self._layout.split(b)
        self._apply(f, self._x)
        gamma = (g - float(self._w.dot(self._x))) / self._s
        self._x.axpy(-gamma, self._v)
        self._layout.join(self._x, gamma, y)

    def mult(self, _mat: PETSc.Mat | None, y: PETSc.Vec, b: PETSc.Vec) -> None:
        """Multiply by the bordered matrix with its last row set to 0; also called by PETSc."""
        x, gamma = self._layout.split(y)
        self._layout.system.matrix.mult(x, self._f)
        self._f.axpy(gamma, self._c)
        self._layout.join(self._f, 0.0, b)

    # -- solves ----------------------------------------------------------------------------------

    def prepare(self) -> bool:
        """Return True if the preconditioner of the bordered matrix could be set up."""
        return self._regular

    def solve(
        self,
        rhs: PETSc.Vec,
        out: PETSc.Vec,
        *,
        rtol: float = 0.0,
        near: PETSc.Vec | None = None,
        model: ModelTest | None = None,
    ) -> bool:
        """Solve a linear system with the bordered matrix; return whether this succeeded.

        Args:
            rhs: right-hand side.
            out: receives the solution.
            rtol: sufficient relative residual.
            near: initial guess; default: the result of the block elimination.
            model: pair of a `Forcing` rule and a function returning the nonlinear residual after a
                step; it may end the solve earlier. Default: none.
        """
        if not self._regular:
            return False
        r, layout = self._r, self._layout
        if near is None:
            self.apply(None, rhs, out)
        else:
            # The elimination satisfies the last row, which the iterations leave out.
            self.mult(None, near, r)
            r.aypx(-1.0, rhs)
            before = r.norm()
            x, gamma = layout.split(near)
            g = layout.gamma(rhs) - float(self._w.dot(x)) - self._corner * gamma
            if layout.last:
                r.array[-1] = g
            self.apply(None, r, out)
            out.axpy(1.0, near)
        self.mult(None, out, r)
        r.aypx(-1.0, rhs)
        if layout.last:
            r.array[-1] = 0.0
        # The residual is relative to f and gamma c: f is zero for tangents.
        size = max(layout.split(rhs)[0].norm(), abs(layout.gamma(out)) * self._c.norm())
        start = r.norm()
        before = size if near is None else before
        least = max(rtol, _PRECISE) * size
        if not np.isfinite(start):
            return False
        if start > least:
            self.ksp.setTolerances(rtol=0.0, atol=least, divtol=1e10, max_it=self._most)
            self._asked = None if model is None else (model, size, out)
            with logged("ContinuationKrylov"):
                self.ksp.solve(r, self._d)
            self._asked = None
            out.axpy(1.0, self._d)
            iterations = self.ksp.getIterationNumber()
            end = self.ksp.getResidualNorm()
            self._P.age(iterations, float(np.log10(max(before / max(end, 1e-300), 1.0))))
            if self.ksp.getConvergedReason() <= 0:
                if layout.comm.rank == 0:
                    logger.info("%d Krylov iterations: from %.2e to %.2e", iterations, start, end)
                return False
        return bool(np.isfinite(out.norm()))

    def _test(self, ksp: PETSc.KSP, _iteration: int, norm: float) -> int:
        """End the iteration if the nonlinear rows are accurate; called by PETSc. Collective."""
        if self._asked is None:
            return 0
        (forcing, remainder), size, start = self._asked

        def left() -> float:
            return remainder(start + ksp.buildSolution(self._work)) / size

        done = forcing.suffices(norm / size, left)
        return int(PETSc.KSP.ConvergedReason.CONVERGED_ITS) if done else 0

    def probe(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        """Solve with a right-hand side that has components along all eigenvectors.

        The sign of the determinant of the bordered matrix is determined from this solve.
        """
        before = self.solves
        if not self.solve(rhs, out, rtol=min(_SIGN, _BELOW / float(np.sqrt(self._layout.size)))):
            return False
        values = self.ksp.computeEigenvalues() if self.solves > before + 1 else np.zeros(0)
        negative = int(np.sum((values.imag == 0) & (values.real < 0)))
        sign = self._P.determinant_sign() * np.sign(self._s) * (-1.0) ** negative
        self._sign = float(self._layout.comm.bcast(sign, root=0))
        return True

    def determinant_sign(self) -> float:
        """Return the sign of the bordered determinant up to a constant factor; 0 if it vanishes."""
        if self._sign is None:
            self._sign = 0.0
            probe = self._layout.joined(self._layout.system.probe(0), 0.0)
            self.probe(probe, self._layout.vector())
        return self._sign

    def destroy(self) -> None:
        """Free the PETSc objects that refer to this object."""
        self.ksp.destroy()
        self.matrix.destroy()
