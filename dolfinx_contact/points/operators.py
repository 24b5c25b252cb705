# SPDX-License-Identifier: LGPL-3.0-or-later
r"""B at a state: from displacements to jumps at contact points, and from tractions to forces.

Forces do the work of tractions, B^T W t . v = sum W t . (B v), with the areas W of the points. As
long as what is opposite to a point stays opposite B is the same at every state. Where points slide
on to other facets it is not: then the jumps that laws see may change by more than B v, and the
forces of held tractions change with the displacement.

What needs B to be the same everywhere (matrices that are set up once, condensation onto the contact
points, proofs) takes it from `ContactSurface._constant_operator`, which refuses any other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.points.stencils import Stencils, multiplied_transposed

__all__ = ["ConstantOperator", "Operator"]

Array = npt.NDArray[np.float64]


class Operator(ABC):
    """B of a surface at a state. Collective, as all its methods are.

    Displacements are those of the owned nodes (n, dim), seen from the rigid body where there is one
    (`ContactSurface.relative`); tractions and jumps those at the contact points of this rank.
    """

    @abstractmethod
    def apply(self, v: Array) -> Array:
        """B v at the points (n, dim)."""

    @abstractmethod
    def rate(self, v: Array) -> Array:
        """The derivative along v of the jumps that laws see (n, dim)."""

    @abstractmethod
    def transpose(self, tractions: Array) -> Array:
        """B^T W t: forces on the owned displacement dofs, flat."""

    @abstractmethod
    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        """The derivative along v of the forces of held tractions, flat."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the matrices."""


@dataclass(frozen=True, eq=False)
class ConstantOperator(Operator):
    """B that is the same at every state: jumps are B u, but for a constant.

    Attributes:
        stencils: weights of the nodes at the points, of B and of the multipliers.
        areas: W of the points (n,).
        B: the matrix.
    """

    stencils: Stencils
    areas: Array
    B: PETSc.Mat

    def apply(self, v: Array) -> Array:
        x, y = self.B.createVecs()
        x.array[:] = v.reshape(-1)
        self.B.mult(x, y)
        values = y.array_r.reshape(-1, v.shape[1]).copy()
        x.destroy(), y.destroy()
        return np.asarray(values)

    def rate(self, v: Array) -> Array:
        return self.apply(v)

    def transpose(self, tractions: Array) -> Array:
        return multiplied_transposed(self.B, self.areas[:, None] * tractions)

    def transpose_rate(self, tractions: Array, v: Array) -> Array:
        return np.zeros(v.size)

    def destroy(self) -> None:
        self.B.destroy()
