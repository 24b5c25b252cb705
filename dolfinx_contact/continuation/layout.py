# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors y = (x, gamma): x as the system lays it out, gamma the last entry, on the last rank."""

from __future__ import annotations

from petsc4py import PETSc

from dolfinx_contact.continuation.system import System

__all__ = ["Layout"]


class Layout:
    """Makes vectors y and takes them apart.

    Args:
        system: whose x it is.

    Attributes:
        local: number of entries of x on this rank.
        size: and on all ranks.
        last: whether gamma lives on this rank.
    """

    def __init__(self, system: System):
        self.system = system
        self.comm = system.comm
        self.last = self.comm.rank == self.comm.size - 1
        self.x = system.create_vector()
        self.local, self.size = self.x.getLocalSize(), self.x.getSize()

    def vector(self) -> PETSc.Vec:
        """A vector for y."""
        return PETSc.Vec().createMPI((self.local + int(self.last), self.size + 1), comm=self.comm)

    def gamma(self, y: PETSc.Vec) -> float:
        """Gamma of ``y``, on every rank."""
        mine = float(y.array_r[-1]) if self.last else 0.0
        return float(self.comm.bcast(mine, root=self.comm.size - 1))

    def split(self, y: PETSc.Vec) -> tuple[PETSc.Vec, float]:
        """X (in a vector that is reused) and gamma of ``y``."""
        self.x.array[:] = y.array_r[: self.local]
        return self.x, self.gamma(y)

    def join(self, x: PETSc.Vec, gamma: float, y: PETSc.Vec) -> None:
        """Put x and gamma into ``y``."""
        y.array[: self.local] = x.array_r
        if self.last:
            y.array[-1] = gamma

    def joined(self, x: PETSc.Vec, gamma: float) -> PETSc.Vec:
        """A new vector y of x and gamma."""
        y = self.vector()
        self.join(x, gamma, y)
        return y

    def last_unit(self) -> PETSc.Vec:
        """The right-hand side (0, 1) of tangents."""
        e = self.vector()
        e.set(0.0)
        if self.last:
            e.array[-1] = 1.0
        return e
