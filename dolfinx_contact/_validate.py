# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of arguments at entry points.

Validators return the value, or raise a ``ValueError`` that names the argument. They are not
collective; `_collective.collective` raises the error of one rank on every rank.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from contextlib import suppress
from typing import Any, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = [
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
