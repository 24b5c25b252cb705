# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors that are the same on every rank."""

from __future__ import annotations

from mpi4py import MPI

__all__ = ["require"]


def require(comm: MPI.Comm, ok: bool, message: str) -> None:
    """Raise ``ValueError(message)`` on every rank if ``ok`` is false on any rank. Collective.

    The message raised is that of the lowest rank which failed, so that it does not depend on the
    rank that prints it.
    """
    messages = comm.allgather(None if ok else message)
    failed = [m for m in messages if m is not None]
    if failed:
        raise ValueError(failed[0])
