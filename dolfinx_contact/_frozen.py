# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base class of compiled objects, whose public attributes are read-only.

An assignment such as ``problem.bcs = []`` would be ignored, because attributes are read once. Users
change the values of Constants and Functions instead, which every solve reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from functools import wraps
from inspect import isfunction
from typing import Any, ClassVar, TypeVar

__all__ = ["ReadOnly", "copy_with"]

_T = TypeVar("_T")
_SEALED = "_sealed"


class ReadOnly:
    """Base class whose public attributes cannot be assigned once the constructor has ended.

    Exceptions are names with an underscore, properties with a setter, those in `_may_be_set`, and
    methods, whose replacement on an object is not ignored.
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
