# SPDX-License-Identifier: LGPL-3.0-or-later
"""What energies and dissipations of interfaces are functions of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

__all__ = ["InterfaceState", "Internal", "Rates"]

#: How a variable may change.
Change: TypeAlias = Literal["any", "falls", "grows"]


@dataclass(frozen=True)
class Internal:
    """An internal variable of an interface.

    Attributes:
        name: of a scalar that of the field of the law that has its value at the start.
        change: ``"any"``; or ``"falls"``, ``"grows"``, of one scalar at most.
        end: number beyond which it does not fall or grow; None for no end.
        vector: whether it is one, of as many components as the jump; 0 at the start.

    Raises:
        ValueError: if something of this does not fit the rest.
    """

    name: str
    change: Change = "any"
    end: float | None = None
    vector: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ValueError(f"an internal variable needs a name, got {self.name!r}")
        if self.change not in get_args(Change):
            known = ", ".join(map(repr, get_args(Change)))
            raise ValueError(f"{self.name} may change by one of {known}, not {self.change!r}")
        one_way = self.change != "any"
        if one_way and self.vector:
            raise ValueError(f"{self.name} is a vector: it neither falls nor grows")
        end: Any = self.end
        number = isinstance(end, int | float | np.number) and not isinstance(end, bool)
        good = one_way and number and bool(np.isfinite(end))
        if end is not None and not good:
            raise ValueError(
                f"the end of {self.name} must be a number, of a variable that falls or grows; "
                f"got {end!r}"
            )

    @property
    def sense(self) -> int:
        """1 if it only grows, -1 if it only falls, else 0."""
        return {"any": 0, "falls": -1, "grows": 1}[self.change]

    def components(self, dim: int) -> list[str]:
        """Names of the components of a vector in memory."""
        return [f".{self.name}_{i}" for i in range(dim)]


@dataclass(frozen=True)
class InterfaceState:
    """What an interface is in, UFL.

    Attributes:
        opening: [u_n] >= 0.
        moved: [u_t], a vector along the surface, since the start of the history.
        n: unit normal, from the body into the obstacle.
        internal: variables by name; ``state[name]`` is the same.
        pressure: p of contact, 0 where it is open. For the dissipation alone.
        reaction: pressure of contact and adhesion together, 0 where they pull. For the dissipation
            alone.
    """

    opening: Any
    moved: Any
    n: Any
    internal: Mapping[str, Any]
    pressure: Any = None
    reaction: Any = None

    @property
    def jump(self) -> Any:
        """[u], of the body to the obstacle, a vector."""
        return self.moved - self.opening * self.n

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]


@dataclass(frozen=True)
class Rates:
    """How fast it changes, UFL.

    Attributes:
        slip: speed |[u_t]'| >= 0.
        internal: rates of the variables by name; ``rates[name]`` is the same.
    """

    slip: Any
    internal: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]
