# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces with held bonds, which neither weaken nor heal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.surface_term import SurfaceTerm
from dolfinx_contact.laws import Answers, HeldAnswers
from dolfinx_contact.points.kinematics import Kinematics

__all__ = ["HeldBonds"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeldBonds(SurfaceTerm):
    """Term of a contact surface whose bonds have a given strength.

    Attributes:
        strength: strength of the bonds (`Law.weakening`), shape (n,).
    """

    strength: Array | None = None

    def _answers(
        self, at: Kinematics, traction: Array, held: npt.NDArray[np.int8] | None
    ) -> Answers:
        weakening = self.surface.law.weakening
        assert weakening is not None
        assert self.strength is not None
        fields = {**at.data.fields, weakening.name: self.strength}
        data = replace(at.data, fields=fields)
        return HeldAnswers(self.surface.law_at_points(at.jump, traction, data))
