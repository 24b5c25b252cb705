# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Scalar conditions phi = 0 of special points of branches, with their gradients.

- Change of a status: the pieces H_0 and H_1 on either side agree there, so that on H_0 = 0

      phi = w . (H_1 - H_0)(x, gamma)

  vanishes for one fixed w. The gradient is (J_1 - J_0)^T w.
- Smooth fold: H_x is singular, and phi = g in

      [ H_x  b ] [ v ]   [ 0 ]          [ H_x^T  c ] [ psi ]   [ 0 ]
      [ c^T  0 ] [ g ] = [ 1 ],         [ b^T    0 ] [ g   ] = [ 1 ]

  vanishes, with fixed b and c (Govaerts, Numerical Methods for Bifurcations of Dynamical
  Equilibria, SIAM 2000, ch. 4). The derivative in any direction is - psi . (H_x)' v. The derivative
  of H_x v by x is the transposed derivative of H_x along v, computed by central differences.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.branch import Change
from dolfinx_contact.continuation.factorised import Factorised
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.system import Piece, System

__all__ = ["Condition", "SmoothFold", "StatusChange", "with_status"]

_STEP = 1e-5  # step of central differences, relative to the size of x

#: Function (x, piece, out) that writes the derivative of H by a parameter into a vector.
Derivative = Callable[[PETSc.Vec, Piece, PETSc.Vec], None]


class Condition(Protocol):
    """A condition phi(x, gamma) = 0. Like H, phi may depend on other parameters. Collective."""

    def value(self, x: PETSc.Vec, gamma: float, piece: Piece) -> tuple[float, float]:
        """Return phi and its relative size."""

    def gradient(self, x: PETSc.Vec, gamma: float, piece: Piece, row: PETSc.Vec) -> None:
        """Write the derivative of phi by x into ``row``."""

    def derivative(
        self, x: PETSc.Vec, gamma: float, piece: Piece, by_parameter: Derivative
    ) -> float:
        """Return the derivative of phi by a parameter.

        Args:
            x: state.
            gamma: parameter of the branch.
            piece: piece of H.
            by_parameter: derivative of H by the parameter.
        """

    def destroy(self) -> None:
        """Free the PETSc objects."""


def with_status(comm: MPI.Comm, piece: Piece, change: Change, code: int) -> Piece:
    """Return the piece in which the point of a change has the status ``code``. Not collective."""
    if comm.rank != change.rank:
        return piece
    return piece.with_codes(np.array([change.point], dtype=np.int32), [code])


class StatusChange:
    """Condition of the border between two statuses of a point.

    Args:
        system: system H.
        change: point and statuses on both sides.
        x: state with H = 0 on the first side, away from the border.
        gamma: parameter at the state.
        piece: piece of the first side.

    Raises:
        ValueError: on every rank, if the two pieces do not differ at the state.
    """

    def __init__(
        self,
        system: System,
        change: Change,
        x: PETSc.Vec,
        gamma: float,
        piece: Piece,
    ):
        self.system = system
        self._change = change
        self._here, self._there, self._row = (system.create_vector() for _ in range(3))
        self.w = system.create_vector()
        self._difference(x, gamma, piece)
        self._there.copy(self.w)
        size = self.w.norm()
        if not size > 0:
            raise ValueError("the pieces on either side of the border do not differ at the state")
        self.w.scale(1.0 / size)

    def _other(self, piece: Piece) -> Piece:
        """Piece beyond the border."""
        return with_status(self.system.comm, piece, self._change, self._change.after)

    def _difference(self, x: PETSc.Vec, gamma: float, piece: Piece) -> float:
        """Compute H_1 - H_0, and return the relative size of H_1."""
        self.system.residual(x, gamma, self._here, piece)
        size = self.system.residual(x, gamma, self._there, self._other(piece))
        self._there.axpy(-1.0, self._here)
        return size

    def value(self, x: PETSc.Vec, gamma: float, piece: Piece) -> tuple[float, float]:
        size = self._difference(x, gamma, piece)
        return float(self.w.dot(self._there)), size

    def gradient(self, x: PETSc.Vec, gamma: float, piece: Piece, row: PETSc.Vec) -> None:
        self.system.jacobian(x, gamma, self._other(piece))
        self.system.matrix.multTranspose(self.w, row)
        self.system.jacobian(x, gamma, piece)
        self.system.matrix.multTranspose(self.w, self._row)
        row.axpy(-1.0, self._row)

    def derivative(
        self, x: PETSc.Vec, gamma: float, piece: Piece, by_parameter: Derivative
    ) -> float:
        by_parameter(x, self._other(piece), self._there)
        by_parameter(x, piece, self._here)
        return float(self.w.dot(self._there) - self.w.dot(self._here))

    def destroy(self) -> None:
        for v in (self._here, self._there, self._row, self.w):
            v.destroy()


class SmoothFold:
    """Condition of a fold of one piece.

    Args:
        system: system H.
        x: state near the fold.
        gamma: parameter at the state.
        piece: piece that the fold belongs to.

    Raises:
        ValueError: on every rank, if the bordered matrix is singular at the state.
    """

    def __init__(self, system: System, x: PETSc.Vec, gamma: float, piece: Piece):
        self.system = system
        self._bordered = _WithColumn(system)
        self._layout = Layout(self._bordered)
        self._solver = Factorised(self._layout, "fold_", reuse=False)
        self._y, self._row, self._unit = (self._layout.vector() for _ in range(3))
        self._unit = self._layout.last_unit()
        self.v, self.psi, self._shifted, self._a = (system.create_vector() for _ in range(4))
        self._c = system.probe(5)
        probe = system.probe(7)
        probe.copy(self._bordered.column)
        for vector in (self._c, self._bordered.column):
            vector.scale(1.0 / vector.norm())
        # borders in the kernels make the bordered matrix as regular as possible
        self._solve(x, gamma, piece)
        for vector, kernel in ((self._c, self.v), (self._bordered.column, self.psi)):
            kernel.copy(vector)
            vector.scale(1.0 / vector.norm())
        probe.destroy()
        row = system.create_vector()
        self.gradient(x, gamma, piece, row)
        steep = float(row.norm(PETSc.NormType.NORM_1))
        row.pointwiseMult(row, x)
        #: Change of g if every entry of x changes by its own size.
        self._size = float(row.norm(PETSc.NormType.NORM_1)) or steep
        row.destroy()
        if not self._size > 0:
            raise ValueError("the Jacobian does not depend on x here: this is not a smooth fold")

    def _solve(self, x: PETSc.Vec, gamma: float, piece: Piece) -> float:
        """Compute v and psi, and return g. Collective."""
        self._layout.join(x, gamma, self._y)
        self._layout.join(self._c, 0.0, self._row)
        self._solver.assemble(self._y, self._row, piece)
        if not self._solver.factorise():
            raise ValueError("the bordered matrix is singular: this is not a simple fold")
        self._solver.factor.solve_transposed(self._unit, self._y)
        self.psi.array[:] = self._y.array_r[: self._layout.local]
        self._solver.factor.solve(self._unit, self._y)
        self.v.array[:] = self._y.array_r[: self._layout.local]
        return self._layout.gamma(self._y)

    def value(self, x: PETSc.Vec, gamma: float, piece: Piece) -> tuple[float, float]:
        g = self._solve(x, gamma, piece)
        return g, abs(g) / self._size

    def _central(self, x: PETSc.Vec, evaluate: Callable[[PETSc.Vec, PETSc.Vec], None],
                 out: PETSc.Vec) -> None:  # fmt: skip
        """Write the derivative of ``evaluate`` along v into ``out``."""
        step = _STEP * (x.norm() or 1.0) / self.v.norm()
        for sign in (-1.0, 1.0):
            x.copy(self._shifted)
            self._shifted.axpy(sign * step, self.v)
            evaluate(self._shifted, self._a)
            if sign < 0:
                self._a.copy(out)
                out.scale(-1.0)
            else:
                out.axpy(1.0, self._a)
        out.scale(0.5 / step)

    def gradient(self, x: PETSc.Vec, gamma: float, piece: Piece, row: PETSc.Vec) -> None:
        self._solve(x, gamma, piece)

        def transposed(at: PETSc.Vec, out: PETSc.Vec) -> None:
            self.system.jacobian(at, gamma, piece)
            self.system.matrix.multTranspose(self.psi, out)

        self._central(x, transposed, row)
        row.scale(-1.0)

    def derivative(
        self, x: PETSc.Vec, gamma: float, piece: Piece, by_parameter: Derivative
    ) -> float:
        self._solve(x, gamma, piece)
        change = self.system.create_vector()
        self._central(x, lambda state, out: by_parameter(state, piece, out), change)
        value = -float(self.psi.dot(change))
        change.destroy()
        return value

    def destroy(self) -> None:
        self._solver.destroy()
        own = (self._y, self._row, self._unit, self.v, self.psi, self._shifted, self._a, self._c)
        for vector in (*own, self._bordered.column, self._layout.x):
            vector.destroy()


class _WithColumn(System):
    """A system whose parameter derivative is a prescribed column b."""

    def __init__(self, system: System):
        self.comm = system.comm
        self._system = system
        self.column = system.create_vector()

    @property
    def matrix(self) -> PETSc.Mat:  # type: ignore[override]
        return self._system.matrix

    def create_vector(self) -> PETSc.Vec:
        return self._system.create_vector()

    def jacobian(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> None:
        self._system.jacobian(x, gamma, piece)

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        self.column.copy(c)
