# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrix-free Jacobian of a contact problem with separate bulk and contact terms.

    J = [ K  0 ] + S,    S = [ 0  B ]
        [ 0  0 ]             [ C  L ]

The blocks belong to displacements and multipliers. K is the stiffness of the body; for a linear
body it is assembled once. S contains the forces B of the multipliers, and the derivatives C and L
of the contact laws (`equations.jacobian`). It has nonzero rows only at contact nodes and
multipliers, and is assembled on the contact facets at every change of status. In large sliding its
sparsity pattern changes with each search for opposing facets. Dirichlet rows of J are rows of the
identity times a typical stiffness; Dirichlet columns are zero off the diagonal.
"""

from __future__ import annotations

import weakref

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import destroy
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.jacobian import ContactTerms

__all__ = ["ContactOperator"]


class ContactOperator:
    """Matrix-free Jacobian of a contact problem, as a PETSc Mat.

    Attributes:
        matrix: PETSc Mat of type python, in the layout of the equations.
        stiffness: stiffness K of the displacement dofs.
        contact: contact terms S of all unknowns, without Dirichlet rows and columns.
        fixed: local indices of the owned displacement dofs with Dirichlet data.
        first: global index of the first unknown of this rank.
    """

    def __init__(self, equations: ContactEquations):
        self.equations = equations
        self.comm = equations.comm
        self.size = equations.owned_sizes[0]
        self.fixed = np.flatnonzero(equations.fixed[: self.size])
        self._terms = ContactTerms(equations)
        self.contact = self._terms.create_matrix()
        bulk = equations.bulk
        self.stiffness = bulk.stiffness(bulk.displacement.x.array.copy())
        n = sum(equations.owned_sizes)
        product = _Product(self)
        self.matrix = PETSc.Mat().createPython(((n, None), (n, None)), product, comm=self.comm)
        self.matrix.setUp()
        self._x = equations.unknowns.create_vector()
        self.first = self._x.getOwnershipRange()[0]
        self._xu, self._yu = self.stiffness.createVecRight(), self.stiffness.createVecLeft()

    @property
    def diagonal(self) -> float:
        """Typical stiffness, the diagonal entry of the Dirichlet rows."""
        return self.equations.scaling.stiffness

    def update(self, evaluation: Evaluation) -> None:
        """Assemble stiffness and contact terms at an evaluation. Collective."""
        self.stiffness = self.equations.bulk.stiffness(evaluation.u)
        self.update_contact(evaluation)

    def update_contact(self, evaluation: Evaluation) -> None:
        """Assemble only the contact terms; the stiffness of a nonlinear body is then out of date.

        In large sliding, `contact` may be a new matrix after this call. Collective.
        """
        if self._terms.changed:
            self.contact.destroy()
            self.contact = self._terms.create_matrix()
        self.contact.zeroEntries()
        self._terms.add(evaluation, self.contact)

    def mult(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Compute y = J x with the Jacobian J."""
        values = x.array_r
        free = self._x.array
        free[:] = values
        free[self.fixed] = 0.0
        self._xu.array[:] = free[: self.size]
        self.contact.mult(self._x, y)
        self.equations.bulk.for_products.mult(self._xu, self._yu)
        result = y.array
        result[: self.size] += self._yu.array_r
        result[self.fixed] = self.diagonal * values[self.fixed]

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self.matrix, self._terms, self.contact, self._x, self._xu, self._yu)


class _Product:
    """Python context of the matrix-free Mat of a `ContactOperator`.

    It holds only a weak reference to the operator, which owns the Mat. Python's garbage collector
    does not see references held by PETSc, so a cycle of references would never be freed.
    """

    def __init__(self, operator: ContactOperator):
        self._operator = weakref.ref(operator)

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Compute y = J x with the Jacobian J."""
        operator = self._operator()
        assert operator is not None
        operator.mult(x, y)
