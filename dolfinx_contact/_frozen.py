# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is read once and compiled, and refuses to be changed afterwards.

Surfaces, problems, obstacles and laws are made of what is given to them, and what is made does not
read it again. Values of Constants and Functions are read in every solve: they are what may
be changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import fields, is_dataclass
from inspect import Signature, isfunction, signature
from typing import Any, ClassVar, NoReturn, SupportsIndex, TypeVar

import numpy as np

__all__ = ["ReadOnly", "ReadOnlyDict", "ReadOnlyList", "copy_with", "seal"]

_T = TypeVar("_T")
_SEALED = "_sealed"


class _SealedWhenMade(type):
    """Seals what it makes, or leaves that to `seal`, and lists what users call."""

    def __dir__(cls) -> list[str]:
        """What `help` and completion show: of public names those in `_listed`, if that is given."""
        listed: tuple[str, ...] | None = cls._listed  # type: ignore[attr-defined]
        names = super().__dir__()
        return [n for n in names if n.startswith("_") or listed is None or n in listed]

    @property
    def __signature__(cls) -> Signature:
        """That of the class, which documentation shows, and not of `__call__`."""
        whole = signature(cls.__init__)  # type: ignore[misc]
        return whole.replace(parameters=list(whole.parameters.values())[1:])

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        made = super().__call__(*args, **kwargs)
        if _is_frozen(cls):
            # The error of dataclasses does not name what works instead.
            for kind in filter(_is_frozen, cls.__mro__):
                for name in ("__setattr__", "__delattr__"):
                    if name in vars(kind):
                        delattr(kind, name)
            for f in fields(made):
                object.__setattr__(made, f.name, _private(getattr(made, f.name)))
        if _is_frozen(cls) or cls._sealed_when_made:  # type: ignore[attr-defined]
            seal(made)
        return made


class ReadOnly(metaclass=_SealedWhenMade):
    """A base class: public attributes cannot be set once the object is made.

    Names that begin with an underscore, properties that can be set, those in `_may_be_set`, and
    functions in place of methods can. Of frozen dataclasses arrays and lists are kept as private
    copies.

    What users call is in `_listed`; other names without an underscore are for the rooms of the
    package, which may use them as they are.
    """

    #: Public methods and properties that `help`, completion and the reference list; None for all.
    _listed: ClassVar[tuple[str, ...] | None] = None
    #: Whether it is read-only when made, as frozen dataclasses always are; else from `seal` on.
    _sealed_when_made: ClassVar[bool] = True
    #: Attributes that may be set.
    _may_be_set: ClassVar[tuple[str, ...]] = ()
    #: What to do instead of setting an attribute, by its name; under "" for any other.
    _instead: ClassVar[Mapping[str, str]] = {}

    def __dir__(self) -> list[str]:
        return sorted({*dir(type(self)), *vars(self)})

    def __setattr__(self, name: str, value: Any) -> None:
        if not (callable(value) and isfunction(getattr(type(self), name, None))):
            self._refuse(name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        if not isfunction(getattr(type(self), name, None)):
            self._refuse(name)
        super().__delattr__(name)

    def _refuse(self, name: str) -> None:
        """Raise ``AttributeError`` if an attribute is not to be changed."""
        if name.startswith("_") or _SEALED not in vars(self) or name in self._may_be_set:
            return
        if getattr(getattr(type(self), name, None), "fset", None) is not None:
            return
        kind = type(self).__name__
        known = hasattr(self, name)
        what = f"{name} of {kind} cannot be set afterwards" if known else f"{kind} has no {name}"
        instead = self._instead.get(name, self._instead.get("", "make another one"))
        raise AttributeError(f"{what}: {instead.format(name=name)}")


def seal(made: object) -> None:
    """Make an object read-only from now on, if its class is one that can be."""
    if isinstance(made, ReadOnly):
        object.__setattr__(made, _SEALED, True)


def copy_with(made: _T, **attributes: Any) -> _T:
    """A shallow copy with other attributes."""
    new = copy(made)
    for name, value in attributes.items():
        object.__setattr__(new, name, value)
    return new


def _is_frozen(cls: type) -> bool:
    return is_dataclass(cls) and "__dataclass_fields__" in vars(cls) and _parameters(cls).frozen


def _parameters(cls: type) -> Any:
    return cls.__dataclass_params__  # type: ignore[attr-defined]


def _private(value: Any) -> Any:
    """Arrays and lists as copies that nobody changes; anything else as it is."""
    if isinstance(value, list):
        return tuple(value)
    if not isinstance(value, np.ndarray):
        return value
    mine = value.copy()
    mine.flags.writeable = False
    return mine


class ReadOnlyList(list[_T]):
    """A list that refuses changes, with the reason.

    Args:
        values: of it.
        what: it is.
        instead: to reach what a change of it is meant for.
    """

    def __init__(self, values: Any, what: str, instead: str):
        super().__init__(values)
        self._message = f"the {what} cannot be changed afterwards: {instead}"

    def __reduce__(self) -> Any:
        return list, (list(self),)

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise AttributeError(self._message)

    append = extend = insert = remove = pop = clear = sort = reverse = _refuse  # type: ignore[assignment]
    __setitem__ = __delitem__ = __iadd__ = _refuse  # type: ignore[assignment]

    def __imul__(self, value: SupportsIndex) -> NoReturn:
        self._refuse()


class ReadOnlyDict(dict[str, _T]):
    """A dictionary that refuses changes, with the reason; see `ReadOnlyList`."""

    def __init__(self, values: Any, what: str, instead: str):
        super().__init__(values)
        self._message = f"the {what} cannot be changed afterwards: {instead}"

    def __reduce__(self) -> Any:
        return dict, (dict(self),)

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise AttributeError(self._message)

    update = pop = popitem = clear = setdefault = _refuse  # type: ignore[assignment]
    __setitem__ = __delitem__ = __ior__ = _refuse  # type: ignore[assignment]
