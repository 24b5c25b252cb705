# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Entries of the Jacobian in rows and columns of rigid bodies.

The jump is B u - Phi q, so that the contact terms of a surface are bordered by

    [ .                      Phi^T W E ]
    [ E^T W D_j Phi          .         ]

in the rows and columns of q and of the multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.state import ContactState
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["RigidTerms"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class RigidTerms:
    """Entries of one surface that touches a rigid body.

    Attributes:
        surface: it.
        unit: of its multipliers.
        motions: places of the body's unknowns, -1 where they are prescribed (k,).
        multipliers: places (groups, l, dim), -1 where there are none.
        at_points: Phi (n, dim, k).
    """

    surface: ContactSurface
    unit: float
    motions: Indices
    multipliers: Indices
    at_points: Array

    def entries(self) -> tuple[Indices, Indices]:
        """Rows and columns, in the order of `values`."""
        m = np.broadcast_to(
            self.multipliers[..., None], (*self.multipliers.shape, len(self.motions))
        )
        q = np.broadcast_to(self.motions, m.shape)
        rows, columns = (np.stack(pair).reshape(-1) for pair in ((q, m), (m, q)))
        return rows, columns

    def values(self, state: ContactState) -> Array:
        """The entries at a state. Collective."""
        stencils = self.surface._constant_operator("the Jacobian of a rigid body").stencils
        areas = self.surface.points.areas
        at = stencils.points
        weighted = areas[at][..., None] * stencils.multiplier_weights
        force = np.einsum("gpl,gpia->glia", weighted, self.at_points[at])
        columns = range(self.at_points.shape[2])
        answers = np.stack([state.along(self.at_points[:, :, a]) for a in columns], axis=2)
        jump = np.einsum("gpl,gpia->glia", weighted, answers[at])
        return np.concatenate([self.unit * force.reshape(-1), jump.reshape(-1)])
