# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The bordered system: H(x, gamma) = 0 with one more row, regular where gamma turns back.

    [ H_x  H_gamma ] [ dx     ]
    [ w^T  w_gamma ] [ dgamma ]

Its matrix is assembled and factorised (`Factorised`), or, where the system brings a preconditioner
of H_x, solved with by a Krylov method (`Krylov`).
"""

from __future__ import annotations

from functools import cached_property

from petsc4py import PETSc

from dolfinx_contact.continuation.factorised import Factorised
from dolfinx_contact.continuation.krylov import Krylov
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.linear import BorderedSolver
from dolfinx_contact.continuation.system import System

__all__ = ["Bordered"]

_STILL = 1e-13  # of the size of x, by which it moves where it does not


class Bordered(Layout):
    """Vectors, inner product and linear algebra of y = (x, gamma).

    Args:
        system: what is followed.
        gamma_scale: size of gamma that counts as 1.
        prefix: of PETSc options.

    Attributes:
        x_scale: square of the length of x that counts as 1; 0 until a tangent moves x.
        x_scale_is_new: set when `x_scale` is; whoever notices resets it.
        sense: sign by which the determinant of the matrix differs from that with the tangent as its
            last row: exchanging rows multiplies it by their inner product.
    """

    def __init__(self, system: System, *, gamma_scale: float, prefix: str = "continuation_"):
        super().__init__(system)
        self.prefix = prefix
        self.gamma_scale = gamma_scale
        self.x_scale = 0.0
        self.x_scale_is_new = False
        self.sense = 1.0
        self._w = system.create_vector()

    @cached_property
    def solver(self) -> BorderedSolver:
        """Of the matrix; made when it is first needed. Collective."""
        P = self.system.preconditioner
        return Factorised(self, self.prefix) if P is None else Krylov(self, self.prefix, P)

    @property
    def work(self) -> tuple[int, int]:
        """Matrices factorised and right-hand sides solved for so far; none without a solver."""
        solver = vars(self).get("solver")
        return (0, 0) if solver is None else (solver.factorisations, solver.solves)

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

    def set_scale(self, t: PETSc.Vec, y: PETSc.Vec) -> None:
        """Take the scale of x from the first tangent ``t`` that moves it, at ``y``. Collective.

        Then x and gamma have equal shares in the length of ``t``, and neither units nor the
        numbers of unknowns and ranks matter for the lengths of steps. A motion that is round-off of
        x over the whole scale of gamma is none: lengths would be those of round-off.
        """
        if self.x_scale > 0.0:
            return
        x, _ = self.split(y)
        self.system.metric(x, self._w)
        size = float(self._w.dot(x))
        x, gamma = self.split(t)
        self.system.metric(x, self._w)
        length = float(self._w.dot(x))
        noise = (100 * self.solver.precision) ** 2 * float(x.dot(x)) / self.size
        noise = max(noise, (_STILL * gamma / self.gamma_scale) ** 2 * size)
        if length > noise and gamma != 0:
            self.x_scale = length * (self.gamma_scale / gamma) ** 2
            self.x_scale_is_new = True

    def require_scale(self) -> None:
        """See that x has a scale: 1 in the metric of the system if no tangent has moved it yet."""
        if self.x_scale == 0.0:
            self.x_scale = 1.0
            self.x_scale_is_new = True

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if "solver" in vars(self):
            self.solver.destroy()
        for v in (self._w, self.x):
            v.destroy()
