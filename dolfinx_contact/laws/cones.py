# SPDX-License-Identifier: LGPL-3.0-or-later
"""The statuses of a contact point in 2D as polyhedral cones of w = (ut, un, rt, rn).

Tangential displacement, gap, and the nodal forces on the body (in units of a stiffness times a
length, so that all four are lengths). Statuses are those of `status`: 0 open, 1 stick, 2 slip with
ut > 0, 3 slip with ut < 0. Signorini's conditions and |rt| <= F rn hold in each of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK

__all__ = ["classify_points", "coulomb_cones"]


def coulomb_cones(
    friction: npt.NDArray[np.float64], grips: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Cones {B z : C B z >= 0} of points with Coulomb friction.

    Args:
        friction: coefficients F, (m,).
        grips: points that know stick and two senses of slip, (m,); the others are frictionless,
            with the one closed status 2.

    Returns:
        Bases B (m, 4, 4, 2), inequalities C (m, 4, 2, 4), and which statuses there are (m, 4).
        Bases are oriented as the rows of the augmented law: for all statuses det (M B) has the
        sign, up to a common one, of the determinant of the equations M w = p with those rows.
    """
    m = len(friction)
    ut, un, rt, rn = np.eye(4)
    B, C = np.zeros((m, 4, 4, 2)), np.zeros((m, 4, 2, 4))
    B[:, OPEN] = np.stack([ut, un], axis=1)
    B[:, STICK] = np.stack([rt, rn], axis=1)
    C[:, OPEN, 0] = un
    for row, sense in enumerate((1.0, -1.0)):
        C[:, STICK, row] = friction[:, None] * rn + sense * rt
    for status, sense in ((PLUS, 1.0), (MINUS, -1.0)):
        B[:, status, :, 0] = ut
        B[:, status, :, 1] = -(rn - sense * friction[:, None] * rt)
        C[:, status, 0] = rn
        C[:, status, 1] = np.where(grips[:, None], sense * ut, 0.0)
    exists = np.ones((m, 4), dtype=bool)
    exists[:, [STICK, MINUS]] = grips[:, None]
    return B, C, exists


def classify_points(
    w: npt.NDArray[np.float64],
    friction: npt.NDArray[np.float64],
    grips: npt.NDArray[np.bool_],
    r: npt.NDArray[np.float64],
) -> npt.NDArray[np.int8]:
    """Statuses that a state (m, 4) asks for by the augmented law with the parameters ``r``."""
    ut, un, rt, rn = np.moveaxis(np.asarray(w), 1, 0)
    p, s = rn - r * un, rt - r * ut
    slip: Any = np.where((s > 0) & grips, MINUS, PLUS)
    closed = np.where((np.abs(s) <= friction * p) & grips, STICK, slip)
    return np.where(p > 0, closed, OPEN).astype(np.int8)
