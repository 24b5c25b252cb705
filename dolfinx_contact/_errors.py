# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors that are the same on every rank."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

__all__ = ["on_root", "require"]

_T = TypeVar("_T")


def require(comm: MPI.Comm, ok: bool, message: str) -> None:
    """Raise ``ValueError(message)`` on every rank if ``ok`` is false on any rank. Collective.

    The message raised is that of the lowest rank which failed, so that it does not depend on the
    rank that prints it.
    """
    messages = comm.allgather(None if ok else message)
    failed = [m for m in messages if m is not None]
    if failed:
        raise ValueError(failed[0])


def on_root(comm: MPI.Comm, do: Callable[[], _T]) -> _T:
    """What ``do``, called on rank 0, returns or raises, on every rank. Collective."""
    found: _T | None = None
    failure: Exception | None = None
    if comm.rank == 0:
        try:
            found = do()
        except Exception as error:
            failure = error
    found, failure = comm.bcast((found, failure))
    if failure is not None:
        raise failure
    return found  # type: ignore[return-value]
