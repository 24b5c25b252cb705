# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The bordered system: H(x, gamma) = 0 with an additional row, regular at folds of gamma.

    J = [ H_x  H_gamma ]
        [ w^T  w_gamma ]

J is factorised (`factorised`). If the system has a preconditioner of H_x, a Krylov method is used
instead (`krylov`). Lengths are defined by the inner product

    <y, z> = x_y . M x_z / (2 x_scale) + gamma_y gamma_z / (2 gamma_scale^2),

with the metric M of the system, y = (x_y, gamma_y) and z = (x_z, gamma_z). The last row of J is the
vector <t, .> for an approximate tangent t.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.factorised import Factorised
from dolfinx_contact.continuation.krylov import Krylov
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.system import System

__all__ = ["Bordered"]

_STILL = 1e-13  # change of x per scale of gamma, relative to its size, that is round-off


class Bordered(Layout):
    """Vectors, inner product and linear solver of y = (x, gamma). Methods are collective.

    Args:
        system: system to follow.
        gamma_scale: unit of gamma.
        prefix: prefix of PETSc options.

    Attributes:
        prefix: prefix of PETSc options.
        solver: solver for J. Its method ``assemble`` sets the state, last row and piece of J;
            ``solve`` and ``probe`` solve with J, ``determinant_sign`` returns the sign of det J,
            and ``row`` is the last row. ``is_direct`` indicates whether every further right-hand
            side is cheap; otherwise solves are iterative, and their cost grows with the accuracy.
        x_scale: square of the unit length of x; 0 until a tangent moves x.
        x_scale_is_new: flag set together with `x_scale`; the reader of the flag resets it.
    """

    solver: Factorised | Krylov

    def __init__(self, system: System, *, gamma_scale: float, prefix: str = "continuation_"):
        super().__init__(system)
        self.gamma_scale = gamma_scale
        self.prefix = prefix
        self.x_scale = 0.0
        self.x_scale_is_new = False
        self._w = system.create_vector()
        system.begin_solves()
        P = system.preconditioner
        self.solver = Factorised(self, prefix) if P is None else Krylov(self, prefix, P)

    def dual(self, y: PETSc.Vec) -> PETSc.Vec:
        """Create the row vector that maps z to the inner product <y, z> with the given vector y."""
        x, gamma = self.split(y)
        self.system.metric(x, self._w)
        if self.x_scale > 0:
            self._w.scale(0.5 / self.x_scale)
        else:
            self._w.set(0.0)
        return self.joined(self._w, 0.5 * gamma / self.gamma_scale**2)

    def inner(self, y: PETSc.Vec, z: PETSc.Vec) -> float:
        """Return the inner product of two vectors (x, gamma), defined in the module."""
        return float(self.dual(y).dot(z))

    def length(self, y: PETSc.Vec) -> float:
        """Return the length of a vector (x, gamma), its norm in the inner product of `inner`."""
        return float(np.sqrt(self.inner(y, y)))

    def orientation(self, t: PETSc.Vec) -> float:
        """Return the sign of det [grad H; t^T] for the tangent ``t`` at the state of J.

        Along a branch this sign changes only at bifurcations. It is the sign of det J times the
        product of t with the last row of J, because t spans the kernel of the other rows.
        """
        return self.solver.determinant_sign() * float(np.sign(self.solver.row.dot(t)))

    def set_scale(self, t: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set `x_scale`, the squared unit of x, from the first tangent ``t`` that moves x.

        x and gamma then contribute equally to the length of the tangent. Tangents that move x by
        less than round-off at the point ``y`` do not count.
        """
        if self.x_scale > 0.0:
            return
        size = self._square(y)
        square = self._square(t)
        x, gamma = self.split(t)
        noise = (100 * self.solver.precision) ** 2 * float(x.dot(x)) / self.size
        noise = max(noise, (_STILL * gamma / self.gamma_scale) ** 2 * size)
        if square > noise and gamma != 0:
            self.x_scale = square * (self.gamma_scale / gamma) ** 2
            self.x_scale_is_new = True

    def _square(self, y: PETSc.Vec) -> float:
        """Return the squared length x . M x of the unknowns x of ``y``, with the metric M."""
        x, _ = self.split(y)
        self.system.metric(x, self._w)
        return float(self._w.dot(x))

    def require_scale(self) -> None:
        """Set `x_scale`, the squared unit of x, to 1 if no tangent has moved x yet."""
        if self.x_scale == 0.0:
            self.x_scale = 1.0
            self.x_scale_is_new = True

    def destroy(self) -> None:
        """Free the linear solver, and release the solver of the system."""
        self.solver.destroy()
        self.system.end_solves()
