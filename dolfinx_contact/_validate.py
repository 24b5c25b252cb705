# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of arguments at entry points, and objects whose attributes are read-only.

Validators return the value, or raise a ``ValueError`` that names the argument. They are not
collective; `_mpi.collective` raises the error of one rank on every rank.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import FrozenInstanceError
from functools import wraps
from inspect import isfunction
from typing import Any, ClassVar, TypeGuard, TypeVar

import numpy as np

from dolfinx_contact._arrays import Array

__all__ = [
    "ReadOnly",
    "copy_with",
    "count",
    "flag",
    "instance",
    "is_number",
    "located",
    "nonnegative",
    "number",
    "one_of",
    "positive",
    "read_only",
    "scalar",
    "vector",
    "word",
    "word_in_history",
]

_T = TypeVar("_T")


# -- numbers and words -----------------------------------------------------------------------------


def is_number(value: Any) -> TypeGuard[float]:
    """Return True for real numbers, including NaN, infinities and 0D arrays, but not for bool."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def number(value: Any, name: str, must: str = "a finite number", *, text: bool = False) -> float:
    """Validate a finite number and return it as a float.

    Args:
        value: value to validate; not a bool.
        name: name of the argument in the message.
        must: description of the required values in the message.
        text: whether a string with a number is accepted, as in PETSc options.
    """
    if text and isinstance(value, str):
        with suppress(ValueError):
            value = float(value)
    if not (is_number(value) and np.isfinite(value)):
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return float(value)


def positive(
    value: Any,
    name: str,
    must: str = "a positive number",
    *,
    text: bool = False,
    infinite: bool = False,
) -> float:
    """Validate a positive number, finite unless ``infinite``; see `number`."""
    if infinite and is_number(value) and value == np.inf:
        return float(value)
    if number(value, name, must, text=text) <= 0:
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return float(value)


def nonnegative(
    value: Any, name: str, must: str = "a nonnegative number", *, infinite: bool = False
) -> float:
    """Validate a non-negative number, finite unless ``infinite``; see `number`."""
    if infinite and is_number(value) and value == np.inf:
        return float(value)
    if number(value, name, must) < 0:
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return float(value)


def count(value: Any, name: str, least: int = 1) -> int:
    """Validate an integer that is at least ``least``, and return it."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least:
        raise ValueError(f"{name} must be a whole number >= {least}, got {value!r}")
    return int(value)


def flag(value: Any, name: str) -> bool:
    """Validate a bool of Python or numpy, and return it as a bool."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def one_of(value: _T, name: str, options: Collection[Any]) -> _T:
    """Validate that a value is one of several options, and return it."""
    if not any(type(value) is type(option) and value == option for option in options):
        shown = ", ".join(str(option) for option in options)
        raise ValueError(f"{name} must be one of {shown}; got {value!r}")
    return value


def instance(value: Any, name: str, kind: type[_T], hint: str = "") -> _T:
    """Validate that a value is an instance of a class.

    Args:
        value: value to validate.
        name: name of the argument in the message.
        kind: required class.
        hint: addition to the name of the class in the message; default: none.
    """
    if not isinstance(value, kind):
        must = f"{'an' if kind.__name__[0] in 'AEIO' else 'a'} {kind.__name__}{hint and ', '}{hint}"
        got = type(value).__name__
        if isinstance(value, type):
            got = f"the class {value.__name__} itself: write {value.__name__}(...)"
        raise ValueError(f"{name} must be {must}, got {got}")
    return value


def listed(values: Any, name: str) -> list[Any]:
    """Validate an iterable other than a string, and return its items as a list."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise ValueError(f"{name} must be a list, got {values!r}")
    return list(values)


def scalar(value: Any, name: str) -> Any:
    """Validate a finite number, returned as a float, or a UFL scalar, returned unchanged."""
    if getattr(value, "ufl_shape", None) == ():
        return value
    return number(value, name, "a finite number or a UFL scalar")


def vector(value: Any, name: str, length: int | None = None, *, zero: bool = True) -> Array:
    """Validate a vector of finite numbers, and return a copy as an array.

    Args:
        value: value to validate.
        name: name of the argument in the message.
        length: number of components; default: None, which allows 2 or 3.
        zero: whether the zero vector is accepted.
    """
    try:
        found = np.empty(0) if np.iscomplexobj(value) else np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    shapes = [(2,), (3,)] if length is None else [(length,)]
    if found.shape not in shapes or not np.isfinite(found).all() or not (zero or found.any()):
        size = "2 or 3" if length is None else length
        must = f"{size} finite numbers{'' if zero else ', not all 0'}"
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return found


def word(value: Any, name: str) -> str:
    """Validate a non-empty string, and return it."""
    if not isinstance(value, str) or not value:
        raise ValueError(f"{name} must be a word, got {value!r}")
    return value


def word_in_history(value: Any, name: str) -> str:
    """Validate a name of a surface or body in tables of steps, which reserve ``"support_0"``."""
    if re.fullmatch(r"support_\d+", word(value, name)):
        raise ValueError(f"{name} must not be {value!r}, the name of a support in tables of steps")
    return str(value)


@contextmanager
def located(where: str) -> Iterator[None]:
    """Context manager that prefixes the message of a ``ValueError`` with ``where``."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


# -- compiled objects ------------------------------------------------------------------------------

_SEALED = "_sealed"


def read_only(advice: str) -> Callable[[type[_T]], type[_T]]:
    """Return a decorator for frozen dataclasses whose error on assignment includes advice.

    Args:
        advice: text for the message, in which ``{name}`` is replaced by the attribute name.
    """

    def decorate(cls: type[_T]) -> type[_T]:
        def refuse(self: Any, name: str, value: Any) -> None:
            known = f"{name} of {type(self).__name__} cannot be set"
            raise FrozenInstanceError(f"{known}: {advice.format(name=name)}")

        setattr(cls, "__setattr__", refuse)  # noqa: B010
        return cls

    return decorate


class ReadOnly:
    """Base class whose public attributes are read-only after construction.

    An assignment such as ``problem.bcs = []`` would have no effect, because attributes are read
    only once. It therefore raises an error. Users should instead change the values of Constants and
    Functions, which every solve reads. The following can be assigned: names with a leading
    underscore, properties with a setter, names in `_may_be_set`, and methods, because the
    replacement of a method takes effect.
    """

    #: Members that the reference lists; None for all.
    _listed: ClassVar[tuple[str, ...] | None] = None
    #: Attributes that may be assigned.
    _may_be_set: ClassVar[tuple[str, ...]] = ()
    #: Advice instead of an assignment.
    _advice: ClassVar[str] = "make another one"

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        if "__init__" not in vars(cls):
            return
        construct = cls.__init__

        @wraps(construct)
        def init(self: Any, *args: Any, **kwargs: Any) -> None:
            construct(self, *args, **kwargs)
            # The constructor of a subclass may still assign attributes.
            if type(self).__init__ is init:
                object.__setattr__(self, _SEALED, True)

        cls.__init__ = init  # type: ignore[method-assign]

    def __setattr__(self, name: str, value: Any) -> None:
        can_be_set = (
            name.startswith("_")
            or _SEALED not in vars(self)
            or name in self._may_be_set
            or getattr(getattr(type(self), name, None), "fset", None) is not None
            or isfunction(getattr(type(self), name, None))
        )
        if not can_be_set:
            kind = type(self).__name__
            known = hasattr(self, name)
            what = f"{name} of {kind} cannot be set" if known else f"{kind} has no {name}"
            raise AttributeError(f"{what}: {self._advice}")
        super().__setattr__(name, value)


def copy_with(made: _T, **attributes: Any) -> _T:
    """Return a shallow copy of an object with some attributes replaced."""
    new = copy(made)
    for name, value in attributes.items():
        object.__setattr__(new, name, value)
    return new
