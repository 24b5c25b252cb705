# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The Jacobian of a contact problem as a product, its bulk and contact terms kept apart.

    J = [ K  0 ] + S,    S = [ 0  B ]
        [ 0  0 ]             [ C  L ]

K is the stiffness, which for a linear body is assembled once; S has rows at the contact nodes and
multipliers alone and is assembled on the contact facets at every change of status. Dirichlet rows
are the identity times a typical stiffness, their columns are zero.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._compat import assemble_block_matrix, create_block_matrix

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["ContactOperator"]


class ContactOperator:
    """Context of a PETSc Mat of type python: the Jacobian of ``problem``.

    Attributes:
        matrix: the Mat; its vectors are those of the problem.
        stiffness: K, on the displacement alone.
        contact: S, on all unknowns, without Dirichlet rows of the displacement.
        fixed: local indices of the owned displacement dofs with Dirichlet data.
        diagonal: of the Dirichlet rows.
        first: global index of the first unknown of this rank.
    """

    def __init__(self, problem: ContactProblem):
        self.problem, self.comm = problem, problem.comm
        self.size = problem.owned_sizes[0]
        self.diagonal = problem.stiffness_scale
        self.fixed = np.flatnonzero(problem.constraints.fixed.reshape(-1)[: self.size])
        self.contact = create_block_matrix(problem.contact_jacobian)
        self.stiffness = problem.bulk.stiffness()
        n = sum(problem.owned_sizes)
        self.matrix = PETSc.Mat().createPython(((n, None), (n, None)), self, comm=self.comm)
        self.matrix.setUp()
        self._x = problem.create_vector()
        self.first = self._x.getOwnershipRange()[0]
        self._xu, self._yu = self.stiffness.createVecRight(), self.stiffness.createVecLeft()

    def update(self) -> None:
        """Assemble at the Functions and the status of the problem as they are. Collective."""
        self.stiffness = self.problem.bulk.stiffness()
        self.update_contact()

    def update_contact(self) -> None:
        """Assemble S alone, which for a body that is not linear leaves K behind. Collective."""
        p = self.problem
        removed = p.constraints.multiplier_bcs
        assemble_block_matrix(self.contact, p.contact_jacobian, removed, self.diagonal)

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Y = J x."""
        values = x.array_r
        free = self._x.array
        free[:] = values
        free[self.fixed] = 0.0
        self._xu.array[:] = free[: self.size]
        self.contact.mult(self._x, y)
        self.problem.bulk.for_products.mult(self._xu, self._yu)
        result = y.array
        result[: self.size] += self._yu.array_r
        result[self.fixed] = self.diagonal * values[self.fixed]

    def release(self) -> None:
        """Free the PETSc objects."""
        for thing in (self.matrix, self.contact, self._x, self._xu, self._yu):
            thing.destroy()
