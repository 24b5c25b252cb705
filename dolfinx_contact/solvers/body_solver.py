# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solves with the stiffness of the body alone, for algorithms that treat contact as a load.

The solver is a direct factorisation or conjugate gradients with a multigrid hierarchy. It is kept
until the stiffness changes.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._petsc import Factor
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.reduced.held_body import with_dirichlet_rows
from dolfinx_contact.solvers.hierarchy import Hierarchy
from dolfinx_contact.solvers.history import LinearSolverError
from dolfinx_contact.solvers.linear import reasons_of

__all__ = ["BodySolver"]

Array = npt.NDArray[np.float64]
_EXACT = 1e-13  # relative residual of an iterative solve that counts as exact
_MOST = 500  # iterations


class BodySolver:
    """Solver of a linear body with Dirichlet rows. All methods are collective.

    Args:
        equations: contact problem.
        direct: whether to factorise the stiffness; otherwise multigrid is used.
    """

    def __init__(self, equations: ContactEquations, *, direct: bool):
        self._equations = equations
        self.comm = equations.comm
        self.direct = direct
        self._n = equations.owned_sizes[0]
        self.fixed = np.flatnonzero(equations.fixed[: self._n])
        self._assemblies = -1
        self._factor: Factor | None = None
        self._ksp: PETSc.KSP | None = None
        self._matrix: PETSc.Mat | None = None
        self._hierarchy: Hierarchy | None = None
        #: Solves so far, and Krylov iterations of these.
        self.solves = self.krylov = 0

    def update(self) -> None:
        """Factorise, or build the hierarchy, if the stiffness has changed."""
        eq = self._equations
        K = eq.bulk.stiffness(eq.bulk.displacement.x.array.copy())
        if self._assemblies == eq.bulk.assemblies:
            return
        self.destroy()
        self._matrix = with_dirichlet_rows(K, eq, eq.stiffness_scale)
        prefix = eq.options.prefix + "body_"
        if self.direct:
            self._factor = Factor(self.comm, prefix)
            self._ksp = self._factor.ksp
            if not self._factor.factorise(self._matrix):
                raise LinearSolverError("the stiffness of the body is singular: nothing holds it")
        else:
            self._ksp = self._gradients(K, prefix)
        self._assemblies = eq.bulk.assemblies

    def _gradients(self, K: PETSc.Mat, prefix: str) -> PETSc.KSP:
        """Return conjugate gradients with a multigrid hierarchy of the stiffness ``K``."""
        eq = self._equations
        symmetric = eq.bulk.is_energy
        self._hierarchy = Hierarchy(eq.V, eq.options.prefix, symmetric=symmetric)
        ksp = PETSc.KSP().create(self.comm)
        ksp.setOperators(self._matrix)
        ksp.setOptionsPrefix(prefix)
        ksp.setPC(self._hierarchy.build(K, self.fixed.astype(np.int32), eq.stiffness_scale))
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        return ksp

    def __call__(self, load: Array, *, tolerance: float = _EXACT) -> Array:
        """Return the owned displacement under a load.

        Args:
            load: owned load vector; Dirichlet rows contain prescribed values times the diagonal.
            tolerance: relative residual of an iterative solve.
        """
        assert self._ksp is not None
        b, x = self._matrix.createVecs()  # type: ignore[union-attr]
        b.array[:] = load
        if not self.direct:
            self._ksp.setTolerances(rtol=tolerance, max_it=_MOST)
        self._ksp.solve(b, x)
        self.solves += 1
        self.krylov += self._ksp.getIterationNumber()
        if self._ksp.getConvergedReason() < 0:
            raise LinearSolverError(f"the body was not solved ({reasons_of(self._ksp)})")
        found = x.array_r.copy()
        b.destroy(), x.destroy()
        return found

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if self._hierarchy is not None:
            self._hierarchy.release()
        for thing in (self._ksp, self._matrix):
            if thing is not None:
                thing.destroy()
        self._factor = self._ksp = self._matrix = self._hierarchy = None
        self._assemblies = -1
