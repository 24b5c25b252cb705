# SPDX-License-Identifier: LGPL-3.0-or-later
"""MPI: errors on all ranks, comparison of arguments, shared values, and the lifetime of meshes.

A few numbers are sent through MPI's buffers: the lower-case methods of mpi4py pickle arrays, which
takes twenty times as long, as much as the evaluation of a law at a few contact points.
"""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import sys
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import wraps
from inspect import signature
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Mask

if TYPE_CHECKING:
    from dolfinx import common, la, mesh

__all__ = [
    "Arguments",
    "SharedValues",
    "all_ranks",
    "any_rank",
    "anywhere",
    "collective",
    "count_of",
    "everywhere",
    "keep",
    "largest",
    "maximum",
    "minimum",
    "on_root",
    "require",
    "same_everywhere",
    "sorted_rows",
    "total",
]

P = ParamSpec("P")
R = TypeVar("R")

_PATIENCE = 45.0  # seconds that a rank with an error waits for the others
_SHOWN = 100  # characters of a value that differs between ranks


# -- errors on all ranks ---------------------------------------------------------------------------


def require(comm: MPI.Comm, ok: bool, message: str) -> None:
    """Raise ``ValueError(message)`` on every rank if ``ok`` is false on any rank. Collective.

    All ranks raise the message of the lowest failed rank.
    """
    messages = comm.allgather(None if ok else message)
    failed = [m for m in messages if m is not None]
    if failed:
        raise ValueError(failed[0])


@contextmanager
def everywhere(comm: MPI.Comm, what: str = "") -> Iterator[None]:
    """Context manager that raises an error of one rank on every rank. Collective on exit.

    It is used for the user's code and for local work that may fail. All ranks raise the error of
    the lowest failed rank, with its traceback as a note; KeyboardInterrupt and SystemExit are
    included. If the other ranks wait inside the context for communication with the failed rank, the
    failed rank prints the traceback after some time and aborts the run.

    Args:
        comm: communicator.
        what: description of the work for the note; default: none.
    """
    failure: BaseException | None = None
    try:
        yield
    except BaseException as error:
        failure = error
    fails = np.array([int(failure is not None)])
    failed = np.zeros(1, dtype=int)
    request = comm.Iallreduce(fails, failed, op=MPI.MAX)
    end = time.monotonic() + _PATIENCE
    while failure is not None and not request.Test():
        if time.monotonic() > end:
            traceback.print_exception(failure)
            print(
                f"rank {comm.rank} failed{f' in {what}' if what else ''} (above) while other ranks "
                "wait for it in a collective call: the run is aborted",
                file=sys.stderr,
                flush=True,
            )
            comm.Abort(1)
        time.sleep(1e-3)
    request.Wait()
    if failed[0]:
        first = _first(comm, failure, what)
        raise first from (failure if failure is not first else first.__cause__)


def _first(comm: MPI.Comm, failure: BaseException | None, what: str) -> BaseException:
    """Return the error of the lowest failed rank; on that rank, it is the same object.

    On other ranks it is a copy with the traceback as a note. Collective.
    """
    sent = None
    if failure is not None:
        where = f"on rank {comm.rank}{f', in {what}' if what else ''}:\n"
        note = where + "".join(traceback.format_exception(failure))
        try:
            sent = pickle.dumps(failure), note
            pickle.loads(sent[0])
        except Exception:  # an exception of a user's class need not be picklable
            sent = pickle.dumps(RuntimeError(f"{type(failure).__name__}: {failure}")), note
    failures = comm.allgather(sent)
    rank, first = next((i, f) for i, f in enumerate(failures) if f is not None)
    if rank == comm.rank and failure is not None:
        return failure
    error: BaseException = pickle.loads(first[0])
    error.add_note(first[1])
    return error


def on_root(comm: MPI.Comm, do: Callable[[], R]) -> R:
    """Call ``do`` on rank 0; return its value, or raise its error, on every rank. Collective.

    Rank 0 raises the error itself, with its traceback; on other ranks the traceback is a note.
    """
    if comm.size == 1:
        return do()
    result: R | None = None
    with everywhere(comm):
        if comm.rank == 0:
            result = do()
    return comm.bcast(result)  # type: ignore[no-any-return]


# -- comparison of arguments -----------------------------------------------------------------------

#: Arguments of a call, by name.
Arguments: TypeAlias = SimpleNamespace
#: Listeners may be present on some ranks only; each rank has its own part of a state.
_MAY_DIFFER = ("self", "observer", "monitor", "progress", "state")
#: Attributes through which a communicator is found.
_WHERE = ("comm", "mesh", "function_space", "problem", "equations")


def same_everywhere(comm: MPI.Comm, where: str = "", /, **values: Any) -> None:
    """Raise ``ValueError`` on every rank if values differ between ranks. Collective.

    Args:
        comm: communicator.
        where: beginning of the message; default: none.
        values: values by name (underscores are shown as blanks), compared by their `repr`. If a
            value is a function, its return value is compared; it is called only if there are
            several ranks.
    """
    if comm.size == 1:
        return
    texts = {name: repr(v() if callable(v) else v) for name, v in values.items()}
    texts_of_ranks = comm.allgather(texts)
    for rank, others in enumerate(texts_of_ranks):
        for name, text in texts_of_ranks[0].items():
            if text != others.get(name):
                here, there = _differing_parts(text, str(others.get(name)))
                raise ValueError(
                    f"{where and f'{where}: '}{name.replace('_', ' ')} differs between ranks: "
                    f"{here} on rank 0, {there} on rank {rank}"
                )


def _differing_parts(*texts: str) -> list[str]:
    """Return excerpts of long texts around their first difference."""
    same = len(os.path.commonprefix(texts))  # noqa: RUF071 (of characters, not of folders)
    begin = max(0, same - _SHOWN // 2)
    return [
        f"{'... ' * (begin > 0)}{text[begin : begin + _SHOWN]}"
        f"{' ...' * (begin + _SHOWN < len(text))}"
        for text in texts
    ]


def collective(
    what: str,
    check: Callable[[Arguments], None] | None = None,
    *,
    compare: Callable[[Arguments], Mapping[str, Any]] | None = None,
    local: Collection[str] = (),
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for functions that all ranks call together.

    Before a call, arguments are validated and compared between ranks. An error on one rank is
    raised on all ranks, and arguments that differ raise ``ValueError`` on all ranks. Numbers,
    strings, paths and their containers (arrays, sequences, dictionaries, frozen dataclasses) are
    compared by value; for other objects only their presence is compared. Listeners (``observer``,
    ``monitor``, ``progress``) may be present on some ranks only.

    Args:
        what: description of the call for notes of errors.
        check: function of the arguments by name, called on each rank, that raises ``ValueError``.
            It may replace arguments, for example an iterator by a list. Default: none.
        compare: function that maps the validated arguments to a dictionary of values to compare. A
            value replaces the argument of the same name, or is compared in addition to the
            arguments. If a value is a function, it is called. Used only if there are several ranks.
            Default: none.
        local: names of arguments that may differ between ranks, such as indices of facets.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        form = signature(function)

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                bound = form.bind(*args, **kwargs)
            except TypeError:
                return function(*args, **kwargs)  # Python's own error names the function
            bound.apply_defaults()
            arguments = bound.arguments
            named = Arguments(**arguments)
            comm = next(filter(None, map(_communicator_of, arguments.values())), None)
            if check is not None and comm is not None:
                with everywhere(comm, what):
                    check(named)
            elif check is not None:  # an argument of the wrong type, which every rank refuses
                check(named)
            arguments.update(vars(named))
            if comm is not None and comm.size > 1:
                skipped = (*_MAY_DIFFER, *local)
                values = {n: _comparable(v) for n, v in arguments.items() if n not in skipped}
                if compare is not None:
                    values |= compare(named)
                same_everywhere(comm, **values)
            return function(*bound.args, **bound.kwargs)

        return call

    return decorate


def _communicator_of(value: Any) -> MPI.Comm | None:
    """Return the communicator of an argument or of its first item; None if it has none."""
    if isinstance(value, MPI.Comm):
        return value
    for name in _WHERE:
        inner = getattr(value, name, None)
        comm = None if inner is None else _communicator_of(inner)
        if comm is not None:
            return comm
    return _communicator_of(value[0]) if isinstance(value, list | tuple) and value else None


class _Words(str):
    """Text that is shown in messages in place of the `repr` of an argument."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


_GIVEN = _Words("given")


def _comparable(value: Any) -> Any:
    """Return the value by which an argument is compared, or a marker that it is present."""
    if isinstance(value, np.generic | np.ndarray) and value.dtype != object:
        value = value.tolist()
    if isinstance(value, float):
        return value + 0.0  # -0.0 is 0.0
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if value is None or isinstance(value, bool | int | complex | str | bytes | Enum):
        return value
    if isinstance(value, set | frozenset):
        return sorted(repr(_comparable(v)) for v in value)
    if isinstance(value, Mapping):
        return {_comparable(k): _comparable(v) for k, v in value.items()}
    if isinstance(value, Sequence):
        return [_comparable(v) for v in value]
    frozen = is_dataclass(value) and getattr(value, "__dataclass_params__").frozen  # noqa: B009
    if not frozen or isinstance(value, type):
        return _GIVEN
    # Arrays in a dataclass may belong to one rank.
    members = {f.name: getattr(value, f.name) for f in fields(value)}
    entries = [
        f"{name}={_GIVEN if isinstance(v, np.ndarray) else _comparable(v)!r}"
        for name, v in members.items()
    ]
    return _Words(f"{type(value).__name__}({', '.join(entries)})")


# -- values ----------------------------------------------------------------------------------------


class SharedValues:
    """Exchange of values at the local indices of an index map, owned indices first.

    DOLFINx creates neighbourhood communicators for every vector, a collective call of a millisecond
    or more. This object is therefore reused: it creates one vector for each number of entries.

    Args:
        index_map: index map, for example of nodes.
    """

    def __init__(self, index_map: common.IndexMap):
        from dolfinx import la  # `continuation` uses this module without DOLFINx

        self._la = la
        self.index_map = index_map
        self._size: int = index_map.size_local + index_map.num_ghosts
        self._vectors: dict[int, la.Vector] = {}

    def zeros(self, width: int) -> la.Vector:
        """Return the cached vector with ``width`` entries per index, set to 0.

        Collective at the first call for a width; the next call with this width overwrites it.
        """
        vector = self._vectors.get(width)
        if vector is None:
            vector = self._vectors[width] = self._la.vector(self.index_map, width)
        vector.array[:] = 0.0
        return vector

    def sums(self, places: npt.NDArray[np.integer], parts: Array) -> Array:
        """Return the sums of contributions of all ranks. Collective.

        Args:
            places: local indices of the index map at which values are added, any shape.
            parts: contributions at these indices, shape (*places.shape, *s) with any shape s.

        Returns:
            Sums at all local indices, shape (n, *s).
        """
        shape = parts.shape[places.ndim :]
        v, rows = self._rows(shape)
        np.add.at(rows, places.reshape(-1), parts.reshape(places.size, rows.shape[1]))
        v.scatter_reverse(self._la.InsertMode.add)
        v.scatter_forward()
        return rows.reshape(self._size, *shape).copy()

    def marked(self, places: npt.NDArray[np.integer]) -> Mask:
        """Return a mask of the n local indices listed on at least one rank. Collective."""
        return self.sums(places, np.ones(places.shape)) > 0

    def from_owners(self, values: Array) -> Array:
        """Return values at all n local indices, given the values at owned ones. Collective.

        A value may have any shape s: (owned indices, *s) is extended to (n, *s).
        """
        shape = values.shape[1:]
        v, rows = self._rows(shape)
        owned = self.index_map.size_local
        rows[:owned] = values[:owned].reshape(owned, rows.shape[1])
        v.scatter_forward()
        return rows.reshape(self._size, *shape).copy()

    def _rows(self, shape: tuple[int, ...]) -> tuple[la.Vector, Array]:
        """Return the cached vector for values of a shape, and its array, one row per index."""
        width = int(np.prod(shape, dtype=int))
        v = self.zeros(width)
        return v, v.array.reshape(self._size, width)


def total(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """Return the sums over all ranks, for each entry of an array, as floats. Collective.

    Values are converted to floats, because sums of empty arrays may be integers on some ranks, and
    MPI would mix the types.
    """
    local = np.ascontiguousarray(values, dtype=np.float64)
    sums = np.empty_like(local)
    comm.Allreduce(local, sums)
    return sums.reshape(np.shape(values))


def largest(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """Return entrywise maxima over all ranks; NaN where any rank has NaN. Collective."""
    local = np.ascontiguousarray(values, dtype=np.float64)
    maxima = np.empty_like(local)
    comm.Allreduce(local, maxima, op=_LARGEST)
    return maxima.reshape(np.shape(values))


def sorted_rows(comm: MPI.Comm, rows: Array) -> list[list[float]]:
    """Return the rows of arrays on all ranks, sorted lexicographically. Collective."""
    return sorted(row for part in comm.allgather(rows.tolist()) for row in part)


def maximum(comm: MPI.Comm, values: npt.ArrayLike, initial: float = 0.0) -> float:
    """Return the largest number on all ranks, or ``initial`` if that is larger. Collective."""
    return float(comm.allreduce(float(np.max(values, initial=initial)), op=max))


def minimum(comm: MPI.Comm, values: npt.ArrayLike, initial: float = 0.0) -> float:
    """Return the smallest number on all ranks, or ``initial`` if that is smaller. Collective."""
    return float(comm.allreduce(float(np.min(values, initial=initial)), op=min))


def count_of(comm: MPI.Comm, mask: npt.ArrayLike) -> int:
    """Return the number of true entries in the masks of all ranks. Collective."""
    return int(comm.allreduce(int(np.count_nonzero(mask))))


def any_rank(comm: MPI.Comm, flags: npt.ArrayLike) -> bool:
    """Return whether at least one flag is set on at least one rank. Collective."""
    return anywhere(comm, bool(np.any(flags)))[0]


def all_ranks(comm: MPI.Comm, flags: npt.ArrayLike) -> bool:
    """Return whether every flag is set on every rank. Collective."""
    return not anywhere(comm, not np.all(flags))[0]


def anywhere(comm: MPI.Comm, *flags: bool) -> list[bool]:
    """Return, for each of several flags, whether it is set on at least one rank. Collective."""
    local = np.array(flags, dtype=bool)
    anywhere_set = np.empty_like(local)
    comm.Allreduce(local, anywhere_set, op=MPI.LOR)
    return [bool(flag) for flag in anywhere_set]


def _larger(one: MPI.buffer, other: MPI.buffer, _: MPI.Datatype) -> None:
    """MPI operation for the entrywise maximum; unlike ``MPI.MAX``, it propagates NaN."""
    target = np.frombuffer(other, dtype=np.float64)
    np.maximum(np.frombuffer(one, dtype=np.float64), target, out=target)


_LARGEST = MPI.Op.Create(_larger, commute=True)


# -- the life of meshes ----------------------------------------------------------------------------
# DOLFINx frees the communicator of a mesh together with the mesh. mpi4py keeps a lock for every
# communicator on which objects were sent, and acquires a global lock to discard it. If that happens
# while an exception propagates, for example when `make_problem().solve(wrong)` drops the problem,
# the global lock is never released: the next collective call of mpi4py on any communicator hangs. A
# kept mesh is freed when a later one is kept, or after garbage collection, when no exception
# propagates.

#: C++ meshes, each with an index set that keeps the duplicate of its communicator in PETSc.
_kept: list[tuple[Any, PETSc.IS]] = []
_freeing = False
_ALONE = 2  # references to a mesh that nothing else uses: this list, and the call that counts


def keep(domain: mesh.Mesh) -> None:
    """Keep a mesh alive until all ranks can free it together after its last use. Collective."""
    if _collected not in gc.callbacks:
        gc.callbacks.append(_collected)
    _free()
    held = domain._cpp_object
    if not any(other is held for other, _ in list(_kept)):
        _kept.append((held, PETSc.IS().createGeneral([], comm=domain.comm)))


def _free() -> None:
    """Free the kept meshes to which no other reference exists.

    Python's garbage collection may run at any point of the loop and call this function again.
    """
    global _freeing
    if _freeing:
        return
    _freeing = True
    try:
        for k in reversed(range(len(_kept))):
            if sys.getrefcount(_kept[k][0]) <= _ALONE:
                held, of_petsc = _kept.pop(k)
                of_petsc.destroy()
                del held
    finally:
        _freeing = False


def _collected(phase: str, info: dict[str, int]) -> None:
    if phase == "stop":
        _free()


@atexit.register
def _end() -> None:
    _kept.clear()
    if _collected in gc.callbacks:
        gc.callbacks.remove(_collected)
