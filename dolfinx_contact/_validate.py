# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of arguments at entry points, and objects whose attributes are read-only.

Validators return the value, or raise a ``ValueError`` that names the argument. They are not
collective; `_mpi.collective` raises the error of one rank on every rank.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from copy import copy
from functools import wraps
from inspect import isfunction
from typing import Any, ClassVar, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = [
    "ReadOnly",
    "copy_with",
    "count",
    "flag",
    "instance",
    "is_count",
    "is_number",
    "nonnegative",
    "number",
    "one_of",
    "positive",
    "scalar",
    "vector",
    "word",
]

_T = TypeVar("_T")


# -- numbers and words -----------------------------------------------------------------------------


def is_number(value: Any) -> TypeGuard[float]:
    """Return True for real numbers, including NaN and infinities, but not for bool."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | complex)


def is_count(value: Any) -> TypeGuard[int]:
    """Return True for integers larger than 0, but not for bool."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and value >= 1


def number(value: Any, name: str, must: str = "a finite number", *, text: bool = False) -> float:
    """A finite number.

    Args:
        value: value to validate; not a bool.
        name: name of the argument in the message.
        must: description of the required values in the message.
        text: whether a string that holds a number is accepted, as in PETSc options.
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
    """A number larger than 0, finite unless ``infinite``; see `number`."""
    if infinite and is_number(value) and value == np.inf:
        return float(value)
    if number(value, name, must, text=text) <= 0:
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return float(value)


def nonnegative(value: Any, name: str, must: str = "a nonnegative number") -> float:
    """A finite number that is not smaller than 0; see `number`."""
    if number(value, name, must) < 0:
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return float(value)


def count(value: Any, name: str, least: int = 1) -> int:
    """A whole number that is not smaller than ``least``."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least:
        raise ValueError(f"{name} must be a whole number >= {least}, got {value!r}")
    return int(value)


def flag(value: Any, name: str) -> bool:
    """True or False, of Python or numpy."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def one_of(value: _T, name: str, options: Collection[Any]) -> _T:
    """One of some values."""
    if not any(type(value) is type(option) and value == option for option in options):
        shown = ", ".join(str(option) for option in options)
        raise ValueError(f"{name} must be one of {shown}; got {value!r}")
    return value


def instance(value: Any, name: str, kind: type[_T], hint: str = "") -> _T:
    """An instance of a class.

    Args:
        value: value to validate.
        name: name of the argument in the message.
        kind: class.
        hint: addition to the name of the class in the message; default: none.
    """
    if not isinstance(value, kind):
        must = f"{'an' if kind.__name__[0] in 'AEIO' else 'a'} {kind.__name__}{hint and ', '}{hint}"
        raise ValueError(f"{name} must be {must}, got {type(value).__name__}")
    return value


def listed(values: Any, name: str) -> list[Any]:
    """The items of an iterable that is not a string, as a list."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise ValueError(f"{name} must be a list, got {values!r}")
    return list(values)


def scalar(value: Any, name: str) -> Any:
    """A finite number as a float, or a UFL scalar as it is."""
    if getattr(value, "ufl_shape", None) == ():
        return value
    return number(value, name, "a finite number or a UFL scalar")


def vector(value: Any, name: str, length: int, *, zero: bool = True) -> npt.NDArray[np.float64]:
    """Finite numbers, shape (length,), as a copy.

    Args:
        value: value to validate.
        name: name of the argument in the message.
        length: number of components.
        zero: whether all of them may be 0.
    """
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != (length,) or not np.isfinite(found).all() or not (zero or found.any()):
        must = f"{length} finite numbers{'' if zero else ', not all 0'}"
        raise ValueError(f"{name} must be {must}, got {value!r}")
    return found


def word(value: Any, name: str) -> str:
    """A string that is not empty."""
    if not isinstance(value, str) or not value:
        raise ValueError(f"{name} must be a word, got {value!r}")
    return value


# -- compiled objects ------------------------------------------------------------------------------

_SEALED = "_sealed"


class ReadOnly:
    """Base class whose public attributes cannot be assigned once the constructor has ended.

    An assignment such as ``problem.bcs = []`` would be ignored, because attributes are read once.
    Users change the values of Constants and Functions instead, which every solve reads. Exceptions
    are names with an underscore, properties with a setter, those in `_may_be_set`, and methods,
    whose replacement on an object is not ignored.
    """

    #: Members that the reference lists; None for all.
    _listed: ClassVar[tuple[str, ...] | None] = None
    #: Attributes that may be assigned.
    _may_be_set: ClassVar[tuple[str, ...]] = ()
    #: Advice instead of an assignment, by the name of the attribute; under "" for any other.
    _instead: ClassVar[Mapping[str, str]] = {}

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
            instead = self._instead.get(name, self._instead.get("", "make another one"))
            raise AttributeError(f"{what}: {instead}")
        super().__setattr__(name, value)


def copy_with(made: _T, **attributes: Any) -> _T:
    """Return a shallow copy with other attributes."""
    new = copy(made)
    for name, value in attributes.items():
        object.__setattr__(new, name, value)
    return new
