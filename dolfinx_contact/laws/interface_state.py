# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments of energies and dissipations of interfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["InterfaceState", "Rates"]


@dataclass(frozen=True)
class InterfaceState:
    """State of an interface, UFL.

    Attributes:
        opening: [u_n] >= 0.
        moved: [u_t] since the start of the history, a tangential vector.
        n: unit normal, from the body into the obstacle.
        internal: variables by name; ``state[name]`` is the same.
        pressure: contact pressure p, 0 at open points. For the dissipation only.
        reaction: sum of the pressures of contact and adhesion, 0 if negative. For the dissipation
            only.
    """

    opening: Any
    moved: Any
    n: Any
    internal: Mapping[str, Any]
    pressure: Any = None
    reaction: Any = None

    @property
    def jump(self) -> Any:
        """[u], displacement of the body relative to the obstacle, a vector."""
        return self.moved - self.opening * self.n

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]


@dataclass(frozen=True)
class Rates:
    """Rates of the state of an interface, UFL.

    Attributes:
        slip: speed |[u_t]'| >= 0.
        internal: rates of the variables by name; ``rates[name]`` is the same.
    """

    slip: Any
    internal: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]
