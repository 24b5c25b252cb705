# SPDX-License-Identifier: LGPL-3.0-or-later
"""Decorator of public collective calls: validates arguments and compares them between ranks."""

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

#: Arguments of a call, by name.
Arguments: TypeAlias = SimpleNamespace

P = ParamSpec("P")
R = TypeVar("R")

#: Listeners may be present on some ranks only; each rank has its own part of a state.
_MAY_DIFFER = ("self", "observer", "monitor", "progress", "state")
#: Attributes through which a communicator is found.
_WHERE = ("comm", "mesh", "function_space", "problem", "equations")


def collective(
    what: str,
    check: Callable[[Arguments], None] | None = None,
    *,
    compare: Callable[[Arguments], Mapping[str, Any]] | None = None,
    local: Collection[str] = (),
    where: str = "",
    otherwise: MPI.Comm | None = None,
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
        compare: function of the validated arguments that returns values to compare, by name,
            instead of arguments of these names or in addition to them. Functions among the values
            are called. It is used on several ranks only. Default: none.
        local: names of arguments that may differ between ranks, such as indices of facets.
        where: name of the argument that names the object; it is compared first, and messages on
            other arguments begin with it. Default: none.
        otherwise: communicator if no argument has one; default: none, and nothing is compared.
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

            if comm is None:  # an argument of the wrong type, which every rank refuses
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
    """Return the communicator of the first argument that has one, or None."""
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
    """Text in the place of a value in messages."""

    def __init__(self, words: str):
        self._words = words

    def __repr__(self) -> str:
        return self._words


_GIVEN = _Words("given")


def _comparable(value: Any) -> Any:
    """Return the value by which an argument is compared, or a sign of its presence."""
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
    """Describe a dataclass by its numbers and strings; arrays in it may belong to one rank."""
    found = {f.name: getattr(value, f.name) for f in fields(value)}
    parts = {k: _GIVEN if isinstance(v, np.ndarray) else _comparable(v) for k, v in found.items()}
    inner = ", ".join(f"{name}={part!r}" for name, part in parts.items())
    return _Words(f"{type(value).__name__}({inner})")


def _is_frozen(value: Any) -> bool:
    return bool(type(value).__dataclass_params__.frozen)
