"""Laws of friction written by a user."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl

from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    """Friction that falls with the distance slipped, from ``static`` to ``kinetic``."""

    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a: Any, p: Any) -> Any:
        """Return the bound of the shear under the pressure ``p``."""
        fade = ufl.exp(-a.slid / self.distance)
        return (self.kinetic + (self.static - self.kinetic) * fade) * p
