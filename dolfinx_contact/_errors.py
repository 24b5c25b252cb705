# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors that are the same on every rank."""

from __future__ import annotations

import pickle
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np

__all__ = ["everywhere", "on_root", "require", "same_everywhere"]

_T = TypeVar("_T")
_PATIENCE = 45.0  # seconds that a rank with an error waits for the others


def require(comm: MPI.Comm, ok: bool, message: str) -> None:
    """Raise ``ValueError(message)`` on every rank if ``ok`` is false on any rank. Collective.

    The message is that of the lowest rank that failed, so it does not depend on the printing rank.
    """
    messages = comm.allgather(None if ok else message)
    failed = [m for m in messages if m is not None]
    if failed:
        raise ValueError(failed[0])


def same_everywhere(comm: MPI.Comm, where: str = "", /, **values: Any) -> None:
    """Raise ``ValueError`` on every rank if a value is not the same on all. Collective.

    Args:
        comm: communicator.
        where: beginning of the message; default: none.
        values: values by name (underscores stand for blanks), compared by their `repr`. Functions
            are called and their return values compared, on several ranks only.
    """
    if comm.size == 1:
        return
    mine = {name: repr(v() if callable(v) else v) for name, v in values.items()}
    what = f"{where}: " if where else ""
    for rank, theirs in enumerate(comm.allgather(mine)):
        if rank == 0:
            first = theirs
        for name in first:
            if first[name] != theirs.get(name):
                raise ValueError(
                    f"{what}{name.replace('_', ' ')} differs between ranks: {first[name]} on "
                    f"rank 0, {theirs.get(name)} on rank {rank}"
                )


@contextmanager
def everywhere(comm: MPI.Comm, what: str = "") -> Iterator[None]:
    """Raise an error of one rank in the context on every rank. Collective, at its end.

    Use it for code of the user and for local work that may fail. The error is that of the lowest
    rank that failed, with its traceback as a note; KeyboardInterrupt and SystemExit are included.
    If the code of the failed rank should have communicated, the other ranks wait for it inside the
    context. They cannot be reached, and after some time the run is aborted with the traceback.

    Args:
        comm: communicator.
        what: description of the work for the note; default: none.
    """
    failure: BaseException | None = None
    try:
        yield
    except BaseException as error:
        failure = error
    mine = np.array([int(failure is not None)])
    failed = np.zeros(1, dtype=int)
    request = comm.Iallreduce(mine, failed, op=MPI.MAX)
    if failure is not None and not _done(request):
        traceback.print_exception(failure)
        print(
            f"rank {comm.rank} failed{f' in {what}' if what else ''} (above) while other ranks "
            "wait for it in a collective call: the run is aborted",
            file=sys.stderr,
            flush=True,
        )
        comm.Abort(1)
    request.Wait()
    if failed[0]:
        first = _first(comm, failure, what)
        raise first from (failure if failure is not first else first.__cause__)


def _done(request: MPI.Request) -> bool:
    """Return whether the other ranks arrive in time."""
    end = time.monotonic() + _PATIENCE
    while not request.Test():
        if time.monotonic() > end:
            return False
        time.sleep(1e-3)
    return True


def _first(comm: MPI.Comm, failure: BaseException | None, what: str) -> BaseException:
    """Return the error of the lowest failed rank; on that rank the same object. Collective."""
    sent = None
    if failure is not None:
        where = f"on rank {comm.rank}{f', in {what}' if what else ''}:\n"
        note = where + "".join(traceback.format_exception(failure))
        try:
            sent = pickle.dumps(failure), note
            pickle.loads(sent[0])
        except Exception:  # an exception of a user's class need not be picklable
            sent = pickle.dumps(RuntimeError(f"{type(failure).__name__}: {failure}")), note
    parts = comm.allgather(sent)
    rank, first = next((i, p) for i, p in enumerate(parts) if p is not None)
    if rank == comm.rank and failure is not None:
        return failure
    error: BaseException = pickle.loads(first[0])
    error.add_note(first[1])
    return error


def on_root(comm: MPI.Comm, do: Callable[[], _T]) -> _T:
    """Return what ``do`` returns on rank 0, or raise its error, on every rank. Collective.

    Rank 0 raises the error itself, with its traceback; on other ranks the traceback is a note.
    """
    if comm.size == 1:
        return do()
    result: _T | None = None
    with everywhere(comm):
        if comm.rank == 0:
            result = do()
    return comm.bcast(result)  # type: ignore[no-any-return]
