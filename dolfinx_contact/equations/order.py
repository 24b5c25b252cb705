# SPDX-License-Identifier: LGPL-3.0-or-later
"""The order of points, blind to numbering and ranks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["by_coordinates"]

_SAME = 1e-9  # of the size of all, a difference that is round-off


def by_coordinates(x: npt.NDArray[np.float64], ids: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """Order by x, then y, then z, blind to round-off.

    Args:
        x: positions (n, dim).
        ids: what tells points at one place apart, as at the sides of a crack: rows of numbers that
            do not depend on ranks (n, k).
    """
    least = _SAME * np.ptp(x, axis=0).max(initial=0.0)
    keys = [_grouped(column, least) for column in x.T]
    return np.lexsort([*ids.T[::-1], *keys[::-1]])


def _grouped(values: npt.NDArray[np.float64], least: float) -> npt.NDArray[np.int64]:
    """Places in the order of values, the same for those that differ by ``least`` at most."""
    order = np.argsort(values)
    steps = np.diff(values[order]) > least
    places: npt.NDArray[np.int64] = np.zeros(len(values), dtype=np.int64)
    places[order[1:]] = np.cumsum(steps)
    return places
