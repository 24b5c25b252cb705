# SPDX-License-Identifier: LGPL-3.0-or-later
"""The order of points, blind to numbering and ranks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["by_coordinates"]


def by_coordinates(x: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Order by x, then y, then z, blind to round-off."""
    size = np.ptp(x, axis=0).max(initial=0.0) or 1.0
    rounded = np.round((x - x.min(axis=0)) / size, 9)
    return np.lexsort(rounded.T[::-1])
