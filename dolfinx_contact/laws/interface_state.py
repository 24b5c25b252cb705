# SPDX-License-Identifier: LGPL-3.0-or-later
"""What energies and dissipations of interfaces are functions of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["InterfaceState", "Rates"]


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
