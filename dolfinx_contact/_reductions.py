# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sums and extremes of a few numbers over all ranks, and what holds anywhere, by MPI's buffers.

The same methods of mpi4py in small letters pickle arrays, which takes twenty times as long: as long
as an evaluation of everything at some contact points. What is wanted together comes in one call.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

__all__ = ["anywhere", "largest", "total"]

Array = npt.NDArray[np.float64]


def total(comm: MPI.Comm, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Sums over all ranks of numbers of one type, of any shape. Collective."""
    mine = np.ascontiguousarray(values)
    found = np.empty_like(mine)
    comm.Allreduce(mine, found)
    return found.reshape(np.shape(values))


def largest(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """The largest over all ranks, each for itself; NaN where a rank has that. Collective."""
    mine = np.ascontiguousarray(values, dtype=np.float64)
    found = np.empty_like(mine)
    comm.Allreduce(mine, found, op=_LARGEST)
    return found.reshape(np.shape(values))


def anywhere(comm: MPI.Comm, *here: bool) -> list[bool]:
    """Whether each of several things holds on any rank. Collective."""
    mine = np.array(here, dtype=bool)
    found = np.empty_like(mine)
    comm.Allreduce(mine, found, op=MPI.LOR)
    return [bool(there) for there in found]


def _larger(one: MPI.buffer, other: MPI.buffer, _: MPI.Datatype) -> None:
    """MPI's own maximum may lose what is no number."""
    both = np.frombuffer(other, dtype=np.float64)
    np.maximum(np.frombuffer(one, dtype=np.float64), both, out=both)


_LARGEST = MPI.Op.Create(_larger, commute=True)
