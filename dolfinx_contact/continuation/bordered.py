# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The bordered system: H(x, gamma) = 0 with an additional row, regular at folds of gamma.

Its matrix J (`layout`) is factorised (`factorised`), or, if the system has a preconditioner of H_x,
used in a Krylov method (`krylov`). Lengths are those of the inner product

    <y, z> = x_y . M x_z / (2 x_scale) + gamma_y gamma_z / (2 gamma_scale^2),

with the metric M of the system.
"""

from __future__ import annotations

from functools import cached_property

from petsc4py import PETSc

from dolfinx_contact.continuation.factorised import Factorised
from dolfinx_contact.continuation.krylov import Krylov
from dolfinx_contact.continuation.layout import BorderedSolver, Layout
from dolfinx_contact.continuation.system import System

__all__ = ["Bordered"]

_STILL = 1e-13  # change of x per scale of gamma, relative to its size, that is round-off


class Bordered(Layout):
    """Vectors, inner product and linear solver of y = (x, gamma).

    Args:
        system: system to follow.
        gamma_scale: unit of gamma.
        prefix: prefix of PETSc options.

    Attributes:
        x_scale: square of the unit length of x; 0 until a tangent moves x.
        x_scale_is_new: set together with `x_scale`; the reader resets it.
        sense: sign of det J with the last tangent as last row, divided by the sign of det J with
            the actual last row. Exchanging the rows multiplies the determinant by their inner
            product.
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
        """Solver for J, created when it is first used. Collective."""
        P = self.system.preconditioner
        return Factorised(self, self.prefix) if P is None else Krylov(self, self.prefix, P)

    @property
    def work(self) -> tuple[int, int]:
        """Numbers of factorised matrices and of solves so far."""
        solver = vars(self).get("solver")
        return (0, 0) if solver is None else (solver.factorisations, solver.solves)

    def dual(self, y: PETSc.Vec, out: PETSc.Vec) -> None:
        """Write the row vector <y, .> into ``out``."""
        x, gamma = self.split(y)
        self.system.metric(x, self._w)
        if self.x_scale > 0:
            self._w.scale(0.5 / self.x_scale)
        else:
            self._w.set(0.0)
        self.join(self._w, 0.5 * gamma / self.gamma_scale**2, out)

    def inner(self, y: PETSc.Vec, z: PETSc.Vec) -> float:
        """Return <y, z>."""
        w = y.duplicate()
        self.dual(y, w)
        value = float(w.dot(z))
        w.destroy()
        return value

    def set_scale(self, t: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set `x_scale` by the first tangent ``t`` at ``y`` that moves x. Collective.

        x and gamma then contribute equally to the length of ``t``. A motion that is round-off of x
        over the whole scale of gamma does not count.
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
        """Set `x_scale` to 1 if no tangent has moved x yet."""
        if self.x_scale == 0.0:
            self.x_scale = 1.0
            self.x_scale_is_new = True

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if "solver" in vars(self):
            self.solver.destroy()
        for v in (self._w, self.x):
            v.destroy()
