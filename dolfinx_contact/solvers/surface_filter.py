# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surface filter: preconditioner of a multigrid cycle and exact solves on the contact surface.

Let s denote the displacement dofs of the contact nodes and all multipliers, E their inclusion in
all unknowns, and J the Jacobian. The preconditioner maps a residual r to z in three steps:

    z = E A_ss^-1 E^T r,   z += M (r - J z)_u,   z += E A_ss^-1 E^T (r - J z),

where A_ss is the block of J on s, factorised by a sparse LU, the index u selects the displacement
dofs, and M is a multigrid cycle of the stiffness, independent of the statuses (compare the AMG with
filtering of Petrides, Hartland, Kolev et al., arXiv:2505.18576). Afterwards the residual r - J z
vanishes on s, as if the multipliers were condensed exactly. If a Krylov method starts from one
application (``-ksp_knoll``), all later residuals vanish on s as well, so that the first step is
skipped.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import total
from dolfinx_contact._petsc import destroy, logged
from dolfinx_contact.solvers.matrix_free import ContactOperator
from dolfinx_contact.solvers.surface_block import CondensedBlock, SurfaceBlock, SurfaceSet

__all__ = ["SurfaceFilter"]

_NEGLIGIBLE = 1e-8  # share of a residual on the surface that needs no solve before the cycle


class SurfaceFilter:
    """Preconditioner of a `ContactOperator`: multigrid between exact solves on the surface.

    Args:
        operator: Jacobian.
        prefix: prefix of PETSc options, to which the surface solve appends ``surface_``.

    Attributes:
        cycle: PC of the displacement that approximates the inverse of the stiffness.
        surface: displacement dofs and multipliers of the contact surfaces.
        block: factorised block of the Jacobian on these unknowns, with condensed multipliers if
            possible and not disabled by ``<prefix>surface_condensed 0``.
    """

    def __init__(self, operator: ContactOperator, prefix: str):
        self.operator = operator
        self.comm = operator.comm
        self.cycle: PETSc.PC | None = None
        self.block: SurfaceBlock | None = None
        self._prefix = prefix + "surface_"
        self.surface = SurfaceSet(operator)
        first = operator.stiffness.getOwnershipRange()[0]
        self._columns = PETSc.IS().createStride(operator.size, first, 1, comm=self.comm)
        self._rows: PETSc.Mat | None = None
        self._assemblies = -1
        self._t, self._e = (operator.equations.unknowns.create_vector() for _ in range(2))
        self._tu, self._zu = operator.stiffness.createVecs()

    # -- set-up ----------------------------------------------------------------------------------

    def update(self) -> None:
        """Factorise the surface block for the current values of the Jacobian. Collective.

        Raises:
            LinearSolverError: if the block is singular.
        """
        with logged("ContactSurfaceLU"):
            if self.block is None:
                self.block = self._choose_block()
            assemblies = self.operator.equations.bulk.assemblies
            if self._assemblies != assemblies:
                K = self.operator.stiffness
                nodes = self.surface.of_body
                self._rows = K.createSubMatrix(nodes, self._columns, self._rows)
                square = K.createSubMatrix(nodes, nodes)
                self.block.set_stiffness(square)
                square.destroy()
                self._assemblies = assemblies
            self.block.update()

    def _choose_block(self) -> SurfaceBlock:
        # In finite sliding each multiplier couples to several dofs.
        slides = any(s.slides for s in self.operator.equations.surfaces)
        if not slides and PETSc.Options().getBool(self._prefix + "condensed", True):
            condensed = CondensedBlock(self.operator, self.surface, self._prefix)
            if condensed.applies:
                return condensed
            condensed.destroy()
        return SurfaceBlock(self.operator, self.surface, self._prefix)

    # -- application -----------------------------------------------------------------------------

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Apply the preconditioner to ``r`` and write the result into ``z``. Collective."""
        A = self.operator
        n = self.operator.size
        s = self.surface.local
        t = self._t
        r.copy(t)
        z.set(0.0)
        if self.is_on_surface(r, _NEGLIGIBLE):
            z.array[s] += self.solve(t.array_r[s])
            A.mult(z, self._e)
            t.axpy(-1.0, self._e)
        tu = self._tu.array
        tu[:] = t.array_r[:n]
        tu[A.fixed] = 0.0
        assert self.cycle is not None
        assert self._rows is not None
        self.cycle.apply(self._tu, self._zu)
        zu = self._zu.array
        zu[A.fixed] = 0.0
        e = self._e.array
        e[:n] = zu
        e[n:] = 0.0
        z.array[:] += e
        z.array[A.fixed] += t.array_r[A.fixed] / A.diagonal
        # Update the residual on the surface rows only, without a product with all of K.
        rest = t.array_r[s].copy()
        A.contact.mult(self._e, t)
        rest -= t.array_r[s]
        Kz = self._rows.createVecLeft()
        self._rows.mult(self._zu, Kz)
        rest[: self.surface.displacement_count] -= Kz.array_r
        Kz.destroy()
        rest[self.surface.fixed] = 0.0
        z.array[s] += self.solve(rest)

    def is_on_surface(self, r: PETSc.Vec, share: float) -> bool:
        """Return whether a residual's norm on the contact surface exceeds a fraction. Collective.

        Args:
            r: residual; for NaN the result is False.
            share: fraction of the norm of the whole residual.
        """
        squares = np.array([np.sum(r.array_r[self.surface.local] ** 2), np.sum(r.array_r**2)])
        on_surface, whole = total(self.comm, squares)
        return bool(on_surface > share**2 * whole)

    def solve(self, residual: Array) -> Array:
        """Solve the surface block for the unknowns of the contact surfaces. Collective.

        Args:
            residual: local part of the right-hand side in the rows of these unknowns.

        Returns:
            Local part of the solution.
        """
        assert self.block is not None
        with logged("ContactSurface"):
            return self.block.solve(residual)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self._columns, self._t, self._e, self._tu, self._zu, self._rows)
        destroy(self.surface, self.block)
