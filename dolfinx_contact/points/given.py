# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is given on a contact surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Given"]


@dataclass(frozen=True)
class Given:
    """What is given on the surface, in UFL on the body.

    Attributes:
        gap: signed distance to the obstacle.
        normal: unit normal, from the body into the obstacle.
        fields: of the law, by name.
    """

    gap: Any
    normal: Any
    fields: Mapping[str, Any]

    @property
    def all(self) -> tuple[Any, ...]:
        """All of it."""
        return self.gap, self.normal, *self.fields.values()

    @property
    def at_points(self) -> dict[str, Any]:
        """Everything by name; the fields of the law with a colon before theirs."""
        fields = {f":{name}": e for name, e in self.fields.items()}
        return {"gap": self.gap, "normal": self.normal, **fields}
