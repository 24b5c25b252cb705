# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far a body enters an obstacle, or another body, that gives way."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.results.tables import ContactTable

__all__ = ["Penetration", "penetrations"]

logger = logging.getLogger(__name__)

_LARGEST = 0.1  # of the size of a facet, above which there is a warning


@dataclass(frozen=True)
class Penetration:
    """Of a compliant surface.

    Attributes:
        largest: a length, 0 where nothing touches.
        mean: over the area that touches, a length.
        where: position of the point with the largest (dim,).
    """

    largest: float
    mean: float
    where: npt.NDArray[np.float64]


def penetrations(eq: ContactEquations, tables: dict[str, ContactTable]) -> dict[str, Penetration]:
    """By name of the surfaces whose law is compliant. Collective.

    Logs a warning if one is beyond a tenth of the size of a facet.
    """
    found = {}
    for s in eq.surfaces:
        if not s.law.compliant:
            continue
        size = s.points.mean_width
        table = tables[s.name]
        depth = np.nan_to_num(np.maximum(-table.un, 0.0), nan=0.0)
        area = table.area[depth > 0]
        # Of points with the same depth, up to round-off, the first in the table.
        i = int(np.flatnonzero(depth >= (1 - 1e-9) * depth.max())[0])
        mean = float(depth[depth > 0] @ area / area.sum()) if len(area) else 0.0
        found[s.name] = Penetration(float(depth[i]), mean, table.x[i])
        if depth[i] > _LARGEST * size and eq.comm.rank == 0:
            logger.warning(
                "%s: the surface gives way by %.3g at (%s), %.2g of the size of a facet: a small "
                "stiffness of its NormalCompliance",
                s.name,
                depth[i],
                ", ".join(f"{c:.6g}" for c in table.x[i]),
                depth[i] / size,
            )
    return found
