# SPDX-License-Identifier: LGPL-3.0-or-later
"""The door of public collective calls: arguments are checked, and the same on every rank."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import wraps
from inspect import BoundArguments, Parameter, signature
from types import SimpleNamespace
from typing import Any, ParamSpec, TypeAlias, TypeVar

from mpi4py import MPI

import numpy as np

from dolfinx_contact._errors import everywhere, same_everywhere

__all__ = ["Arguments", "collective"]

#: Of a call, by their names.
Arguments: TypeAlias = SimpleNamespace

P = ParamSpec("P")
R = TypeVar("R")

#: Listeners may be given on some ranks only; each rank has its own part of a state.
_MAY_DIFFER = ("self", "observer", "monitor", "progress", "state")
_WHERE = ("comm", "mesh", "function_space", "problem", "equations")  # a communicator is found


def collective(
    what: str,
    check: Callable[[Arguments], None] | None = None,
    *,
    compare: Callable[[Arguments], Mapping[str, Any]] | None = None,
    local: Collection[str] = (),
    where: str = "",
    otherwise: MPI.Comm | None = None,
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator for functions that all ranks call together.

    Before the function is called its arguments are checked, and compared between ranks. What one
    rank raises is raised on all, and arguments that differ raise ``ValueError`` on all. Numbers,
    words, paths and what is made of them (arrays, sequences, dictionaries, frozen dataclasses) are
    compared by value; of anything else only whether it is given. Listeners (``observer``,
    ``monitor``, ``progress``) may be given on some ranks only.

    Args:
        what: is done, for notes of errors.
        check: is called on each rank alone with the arguments by their names, and raises
            ``ValueError`` for what does not fit. It may set them, as to a list for an iterator.
        compare: gives values to compare, by name, of the arguments as they are after the check:
            in the place of arguments of these names, or beside them. Of functions it is what they
            return. It is called where there are several ranks.
        local: names of arguments that may differ between ranks, as indices of facets.
        where: the argument that names what the others belong to: it is compared first, and the
            messages on the others begin with it.
        otherwise: the communicator where no argument has one.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        form = signature(function)

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            bound = form.bind(*args, **kwargs)
            bound.apply_defaults()
            given = bound.arguments
            comm = _communicator(bound) or otherwise

            def look() -> None:
                if check is not None:
                    named = Arguments(**given)
                    check(named)
                    given.update(vars(named))

            if comm is None:  # of something else than what is meant, which is refused alike
                look()
            else:
                with everywhere(comm, what):
                    look()
            if comm is not None and comm.size > 1:
                compared = {n: v for n, v in given.items() if n not in (*_MAY_DIFFER, *local)}
                values = {n: _comparable(v) for n, v in compared.items()}
                if where:
                    same_everywhere(comm, **{where: values.pop(where)})
                if compare is not None:
                    values |= compare(Arguments(**given))
                same_everywhere(comm, str(given[where]) if where else "", **values)
            return function(*bound.args, **bound.kwargs)

        return call

    return decorate


def _communicator(bound: BoundArguments) -> MPI.Comm | None:
    """Of the first argument that has one, itself or the first thing in it."""
    for name, value in bound.arguments.items():
        if bound.signature.parameters[name].kind is Parameter.VAR_KEYWORD:
            continue
        found = _communicator_of(value)
        if found is not None:
            return found
    return None


def _communicator_of(value: Any) -> MPI.Comm | None:
    if isinstance(value, MPI.Comm):
        return value
    for name in _WHERE:
        inner = getattr(value, name, None)
        found = None if inner is None else _communicator_of(inner)
        if found is not None:
            return found
    if isinstance(value, list | tuple) and value:
        return _communicator_of(value[0])
    return None


class _Words:
    """Stand for a value in messages."""

    def __init__(self, words: str):
        self._words = words

    def __repr__(self) -> str:
        return self._words


_GIVEN = _Words("given")


def _comparable(value: Any) -> Any:
    """What an argument is compared by: its value, or that there is one."""
    if isinstance(value, float):
        return value + 0.0  # -0.0 is 0.0
    if value is None or isinstance(value, bool | int | complex | str | bytes):
        return value
    if isinstance(value, Enum):
        return _Words(str(value))
    if isinstance(value, set | frozenset):
        return sorted(repr(_comparable(v)) for v in value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype != object else _GIVEN
    if isinstance(value, Mapping):
        return {_comparable(k): _comparable(v) for k, v in value.items()}
    if isinstance(value, Sequence):
        parts = tuple(_comparable(v) for v in value)
        unknown = bool(parts) and all(part is _GIVEN for part in parts)
        return _Words(f"{len(parts)} of them") if unknown else parts
    if is_dataclass(value) and not isinstance(value, type) and _is_frozen(value):
        return _described(value)
    return _GIVEN


def _described(value: Any) -> _Words:
    """A dataclass by its numbers and words; arrays in it may be those of a rank."""
    found = {f.name: getattr(value, f.name) for f in fields(value)}
    parts = {k: _GIVEN if isinstance(v, np.ndarray) else _comparable(v) for k, v in found.items()}
    inner = ", ".join(f"{name}={part!r}" for name, part in parts.items())
    return _Words(f"{type(value).__name__}({inner})")


def _is_frozen(value: Any) -> bool:
    return bool(type(value).__dataclass_params__.frozen)
