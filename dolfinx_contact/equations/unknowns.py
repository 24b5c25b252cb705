# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unknowns of a contact problem: their layout in PETSc vectors, and motions of rigid bodies.

The unknowns of a rigid body are its displacement, and its rotation times a length: the largest
distance of a contact point from the reference point. Thus all unknowns are lengths, and all rows of
the residual are forces. Rank 0 owns the unknowns of rigid bodies; they follow its other unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import maximum, require
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["RigidBodies", "Unknowns"]

T = TypeVar("T", bound=np.generic)


class Unknowns:
    """Layout of the unknowns in PETSc vectors.

    The unknowns of a rank are its displacements; the multipliers of each surface, divided by a
    typical stiffness per area; and, on rank 0, the motions of rigid bodies (`RigidBodies`).

    Args:
        displacement: Function used as a buffer in which ghosts of displacements are updated.
        multipliers: space of the multiplier of each surface.
        rigid: rigid bodies.
        stiffness_per_area: typical stiffness per area of each surface, the unit of its multipliers.

    Attributes:
        sizes: numbers of owned unknowns: displacement, multipliers by surface, rigid bodies.
        global_sizes: the same numbers summed over all ranks.
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
        """Return copies of the owned parts of a vector of unknowns, one array per field."""
        values = x.array_r.copy()
        return [values[part] for part in self._slices]

    def fields(self, x: PETSc.Vec) -> list[Array]:
        """Return owned displacements and multipliers in the user's units, one array per field."""
        return [unit * part for unit, part in zip(self.units, self.blocks(x), strict=True)][:-1]

    def displacement(self, x: PETSc.Vec) -> Array:
        """Return the displacement in a vector of unknowns, at all local dofs. Collective."""
        f = self._displacement
        n = self.sizes[0]
        f.x.array[:n] = x.array_r[:n]
        f.x.scatter_forward()
        return f.x.array.copy()

    def motions(self, x: PETSc.Vec) -> Array:
        """Return the unknowns of the rigid bodies on every rank. Collective."""
        return self._rigid.everywhere(x.array_r[self._slices[-1]])

    def write(self, fields: Sequence[Array], q: Array, x: PETSc.Vec) -> None:
        """Write displacement, multipliers and motions into a vector of unknowns.

        Args:
            fields: displacement and multipliers at least at the owned dofs, in the user's units.
            q: unknowns of the rigid bodies.
            x: vector of unknowns.
        """
        parts = zip([*fields, self._rigid.here(q)], self.units, self.sizes, strict=True)
        x.array[:] = np.concatenate([values[:n] / unit for values, unit, n in parts])


class RigidBodies:
    """Rigid bodies that surfaces touch. Their values are the same on every rank.

    Args:
        V: space of the displacement.
        surfaces: discretisations of the contact surfaces.
        body_size: size of the deformable bodies, the length that scales rotations if no contact
            point provides one.

    Attributes:
        bodies: rigid bodies, in the order of the surfaces.
        slices: index range of the unknowns of each body.
        size: number of unknowns.
        owned: number of unknowns on this rank.
        fixed: mask of the prescribed unknowns, shape (size,).
        units: factors from displacements and rotations to unknowns, shape (size,).
        numbers: loads and motions prescribed by the user, as read by `read_data`, shape (size,).
        loads: loads L in the units of their rows, 0 where the motion is prescribed, shape (size,).

    Raises:
        ValueError: on every rank, if two bodies have the same name.
    """

    def __init__(self, V: fem.FunctionSpace, surfaces: Sequence[DiscreteSurface], body_size: float):
        self.comm = V.mesh.comm
        self.surfaces = list(surfaces)
        touched = [s.rigid_body for s in surfaces if s.rigid_body is not None]
        self.bodies = list(dict.fromkeys(touched))
        names = [b.name for b in self.bodies]
        unique = len(set(names)) == len(names)
        require(self.comm, unique, f"rigid bodies need different names, got {names}")
        ends = list(accumulate((len(b.components) for b in self.bodies), initial=0))
        self.slices = {b: slice(*c) for b, c in zip(self.bodies, pairwise(ends), strict=True)}
        self.size = ends[-1]
        self.owned = self.size if self.comm.rank == 0 else 0
        none = np.zeros(0, dtype=bool)
        self.fixed = np.concatenate([none, *(b.fixed for b in self.bodies)])
        self.units = np.ones(self.size)
        for b, part in self.slices.items():
            self.units[part][b.dim :] = self._reach(b) or body_size
        self.read_data()

    def _reach(self, body: RigidBody) -> float:
        """Return the largest distance of a contact point from the reference point. Collective."""
        touching = [s.positions for s in self.surfaces if s.rigid_body is body]
        return maximum(self.comm, np.linalg.norm(np.concatenate(touching) - body.about, axis=1))

    # -- values ----------------------------------------------------------------------------------

    @property
    def given(self) -> Array:
        """Unknowns of the rigid bodies for their stored values (`RigidBody.values`)."""
        return self.units * np.concatenate([np.zeros(0), *(b.values for b in self.bodies)])

    def show(self, q: Array) -> None:
        """Store the displacements and rotations for the unknowns ``q`` in the rigid bodies."""
        for b, part in self.slices.items():
            b.values = (q / self.units)[part].copy()

    def everywhere(self, mine: Array) -> Array:
        """Broadcast the unknowns of the rigid bodies from their owner, rank 0. Collective."""
        if not self.size:
            return np.zeros(0)
        return np.asarray(self.comm.bcast(np.array(mine) if self.owned else None))

    def here(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Return the entries owned by this rank: all on rank 0, none on other ranks."""
        return values[: self.owned]

    def of_body(self, q: Array, body: RigidBody) -> Array:
        """Return displacement and rotation of one body from the unknowns of all rigid bodies."""
        return np.asarray((q / self.units)[self.slices[body]])

    def forces_of_body(self, rows: Array, body: RigidBody) -> Array:
        """Return force and moment on one body from the rows of all rigid bodies."""
        return np.asarray((rows * self.units)[self.slices[body]])

    def conjugate(self, q: Array, pushes: Array) -> Array:
        """Return the generalised forces conjugate to the unknowns of the rigid bodies.

        For large rotations, moments are transformed to components conjugate to the rotation vector.

        Args:
            q: unknowns of the rigid bodies.
            pushes: forces and moments on the bodies, in the units of the rows.
        """
        forces = pushes.copy()
        for b, part in self.slices.items():
            if any(s.partner.turns and s.rigid_body is b for s in self.surfaces):
                forces[part][b.dim :] = (
                    b.kinematics.spin(self.of_body(q, b)).T @ pushes[part][b.dim :]
                )
        return forces

    # -- data ------------------------------------------------------------------------------------

    def read_data(self) -> None:
        """Read the current loads and prescribed motions of the rigid bodies."""
        self.numbers = np.concatenate([np.zeros(0), *(b.numbers() for b in self.bodies)])
        self.loads = np.where(self.fixed, 0.0, self.numbers / self.units)

    def names(self, motions: Array) -> str:
        """Return the names of motion components that are nonzero in any of k motions.

        Args:
            motions: motions of all rigid bodies, shape (k, size).
        """
        size = np.abs(motions).max(axis=0, initial=0.0)
        words = [
            f"{'translation' if len(c) == 1 else 'rotation about'} {c[-1]} of {b.name}"
            for b in self.bodies
            for c in b.components
        ]
        return ", ".join(w for w, v in zip(words, size, strict=True) if v > 1e-6)
