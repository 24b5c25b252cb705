# SPDX-License-Identifier: LGPL-3.0-or-later
"""Layout of the unknowns in PETSc vectors.

The unknowns of a rank are its displacements, its multipliers surface by surface, and, on rank 0,
the motions of rigid bodies (`rigid_bodies`). Every unknown in a vector is a length: multipliers are
divided by a typical stiffness per area. Thus the relative sizes of unknowns do not depend on the
user's units.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.equations.rigid_bodies import RigidBodies

__all__ = ["Unknowns"]

Array = npt.NDArray[np.float64]


class Unknowns:
    """Places and units of displacement, multipliers and motions of rigid bodies.

    Args:
        displacement: Function that receives displacements to update their ghosts.
        multipliers: spaces of the multipliers, surface by surface.
        rigid: rigid bodies.
        stiffness_per_area: units of the multipliers, surface by surface.

    Attributes:
        sizes: numbers of owned unknowns: displacement, multipliers by surface, rigid bodies.
        global_sizes: the same over all ranks.
        units: factors from the unknowns of the PETSc vectors to the user's units, one per field; 1
            for the rigid bodies, which have units of their own (`RigidBodies.units`).
    """

    def __init__(
        self,
        displacement: fem.Function,
        multipliers: Sequence[fem.FunctionSpace],
        rigid: RigidBodies,
        stiffness_per_area: Sequence[float],
    ):
        self.comm = displacement.function_space.mesh.comm
        self._displacement = displacement
        self._rigid = rigid
        spaces = [displacement.function_space, *multipliers]
        maps = [(W.dofmap.index_map, W.dofmap.index_map_bs) for W in spaces]
        self.sizes = [*(m.size_local * bs for m, bs in maps), rigid.owned]
        self.global_sizes = [*(int(m.size_global) * bs for m, bs in maps), rigid.size]
        self.units = [1.0, *stiffness_per_area, 1.0]
        ends = np.cumsum(self.sizes).tolist()
        self._slices = [slice(b - n, b) for b, n in zip(ends, self.sizes, strict=True)]

    def create_vector(self) -> PETSc.Vec:
        """Create a vector of all unknowns. Collective."""
        return PETSc.Vec().createMPI((sum(self.sizes), None), comm=self.comm)

    def blocks(self, x: PETSc.Vec) -> list[Array]:
        """Return copies of the owned parts of ``x``, one array per field."""
        values = x.array_r.copy()
        return [values[part] for part in self._slices]

    def fields(self, x: PETSc.Vec) -> list[Array]:
        """Return the owned values of displacement and multipliers, in the user's units."""
        return [unit * part for unit, part in zip(self.units, self.blocks(x), strict=True)][:-1]

    def displacement(self, x: PETSc.Vec) -> Array:
        """Return the displacement at all local dofs, including ghosts. Collective."""
        f = self._displacement
        n = self.sizes[0]
        f.x.array[:n] = x.array_r[:n]
        f.x.scatter_forward()
        return f.x.array.copy()

    def motions(self, x: PETSc.Vec) -> Array:
        """Return the unknowns of the rigid bodies, on every rank. Collective."""
        return self._rigid.everywhere(x.array_r[self._slices[-1]])

    def write(self, fields: Sequence[Array], q: Array, x: PETSc.Vec) -> None:
        """Write values into ``x``.

        Args:
            fields: displacement and multipliers at least at the owned dofs, in the user's units.
            q: unknowns of the rigid bodies.
            x: vector of unknowns.
        """
        parts = zip([*fields, self._rigid.here(q)], self.units, self.sizes, strict=True)
        x.array[:] = np.concatenate([values[:n] / unit for values, unit, n in parts])
