# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors y = (x, gamma): x distributed as in the system, gamma as the last entry.

Temporary vectors are freed by reference counting. On several ranks PETSc delays this until
`PETSc.garbage_cleanup`, which `Corrector` calls.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import any_rank, maximum, minimum
from dolfinx_contact.continuation.system import Events, Piece, System, matched_distances

__all__ = ["PROBE", "Layout"]

PROBE = 1e-6  # length of finite differences


class Layout:
    """Parallel layout of vectors y = (x, gamma). Methods are collective.

    Args:
        system: system with the unknowns x.

    Attributes:
        local: number of entries of x on this rank.
        size: number of entries of x on all ranks.
        last: whether this rank is the last one, which stores gamma.
    """

    def __init__(self, system: System):
        self.system = system
        self.comm = system.comm
        self.last = self.comm.rank == self.comm.size - 1
        self.x = system.create_vector()
        self.local, self.size = self.x.getLocalSize(), self.x.getSize()

    def vector(self) -> PETSc.Vec:
        """Create a vector y = (x, gamma)."""
        return PETSc.Vec().createMPI((self.local + int(self.last), self.size + 1), comm=self.comm)

    def gamma(self, y: PETSc.Vec) -> float:
        """Return gamma of ``y`` on every rank."""
        gamma = float(y.array_r[-1]) if self.last else 0.0
        return float(self.comm.bcast(gamma, root=self.comm.size - 1))

    def split(self, y: PETSc.Vec) -> tuple[PETSc.Vec, float]:
        """Return x and gamma of ``y``; x is a work vector that the next call overwrites."""
        self.x.array[:] = y.array_r[: self.local]
        return self.x, self.gamma(y)

    def join(self, x: PETSc.Vec, gamma: float, y: PETSc.Vec) -> None:
        """Write x and gamma into ``y``."""
        y.array[: self.local] = x.array_r
        if self.last:
            y.array[-1] = gamma

    def joined(self, x: PETSc.Vec, gamma: float) -> PETSc.Vec:
        """Create a vector y with the values of x and gamma."""
        y = self.vector()
        self.join(x, gamma, y)
        return y

    def moved(self, y: PETSc.Vec, distance: float, t: PETSc.Vec) -> PETSc.Vec:
        """Create the vector ``y + distance t``."""
        moved = y.copy()
        moved.axpy(distance, t)
        return moved

    def events(self, y: PETSc.Vec, piece: Piece) -> Events:
        """Return the distances of a point y = (x, gamma) from the next change of a status."""
        return self.system.events(*self.split(y), piece)

    def events_along(self, y: PETSc.Vec, piece: Piece, t: PETSc.Vec) -> tuple[Events, Array]:
        """Return the distances of ``y`` to the borders of a piece, and their rates along ``t``."""
        events = self.events(y, piece)
        ahead = matched_distances(events, self.events(self.moved(y, PROBE, t), piece))
        return events, np.asarray((ahead - events.distance) / PROBE, dtype=np.float64)

    def piece_at(self, y: PETSc.Vec) -> Piece:
        """Return the piece of H, i.e. the statuses of all points, determined by ``y``."""
        return self.system.piece_at(*self.split(y))

    def last_unit(self, gamma: float = 1.0) -> PETSc.Vec:
        """Create the vector (0, gamma), whose only nonzero entry is the last one."""
        e = self.vector()
        e.set(0.0)
        if self.last:
            e.array[-1] = gamma
        return e

    # -- all ranks -------------------------------------------------------------------------------

    def anywhere(self, flags: Any) -> bool:
        """Return True if a flag is set on any rank."""
        return any_rank(self.comm, flags)

    def largest(self, values: Any) -> float:
        """Return the largest absolute value on all ranks; 0 without values."""
        return maximum(self.comm, np.abs(values))

    def least(self, values: Any) -> float:
        """Return the smallest value on all ranks; infinity without values."""
        return minimum(self.comm, values, np.inf)

    def is_same_piece(self, a: Piece, c: Piece) -> bool:
        """Return True if two pieces, each a choice of statuses, are the same on all ranks."""
        return not self.anywhere(not np.array_equal(a.codes, c.codes))
