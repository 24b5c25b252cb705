# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dictionaries by the names of surfaces and bodies."""

from __future__ import annotations

from typing import NoReturn, TypeVar

__all__ = ["Named"]

_T = TypeVar("_T")


class Named(dict[str, _T]):
    """A dictionary whose errors say which names there are."""

    def __missing__(self, name: object) -> NoReturn:
        known = ", ".join(map(repr, self)) or "none"
        raise KeyError(f"nothing is named {name!r} here; names: {known}")
