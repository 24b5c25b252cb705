# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments of the energy and the dissipation of an interface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["InterfaceState", "Rates"]


@dataclass(frozen=True)
class InterfaceState:
    """State of an interface in UFL.

    Attributes:
        opening: opening [u_n] >= 0.
        moved: tangential jump [u_t] since the start of the history, a vector.
        n: unit normal, from the body into the obstacle.
        internal: internal variables by name; also available as ``state[name]``.
        pressure: contact pressure p, 0 at open points; available to the dissipation only.
        reaction: positive part of the sum of contact and adhesive pressure; available to the
            dissipation only.
    """

    opening: Any
    moved: Any
    n: Any
    internal: Mapping[str, Any]
    pressure: Any = None
    reaction: Any = None

    @property
    def jump(self) -> Any:
        """Jump [u] of the displacement, body minus obstacle, a vector."""
        return self.moved - self.opening * self.n

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]


@dataclass(frozen=True)
class Rates:
    """Rates of the state of an interface in UFL.

    Attributes:
        slip: slip speed |[u_t]'| >= 0.
        internal: rates of the internal variables by name; also available as ``rates[name]``.
    """

    slip: Any
    internal: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.internal[name]
