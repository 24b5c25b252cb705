# SPDX-License-Identifier: LGPL-3.0-or-later
"""The borders of one piece at two states: which are the same, and where they are reached.

Borders of some laws exist in some states alone: those of stick where there is friction, those of a
bond. So the events of two states of one piece need not be of the same number.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.system import Events

__all__ = ["again", "reached"]

Array = npt.NDArray[np.float64]


def again(here: Events, there: Events, missing: Array | None = None) -> Array:
    """Distances of the events ``here`` as they are ``there``. Not collective.

    Where the same points have as many as before they are the same, also where one leads to another
    status by now.

    Args:
        here: of a piece, at one state.
        there: of the same piece, at another.
        missing: what those have that are not there (n,), by default their distances here.
    """
    if np.array_equal(here.point, there.point):
        return there.distance
    known: dict[tuple[int, int], list[float]] = {}
    for point, target, distance in zip(there.point, there.target, there.distance, strict=True):
        known.setdefault((int(point), int(target)), []).append(float(distance))
    found = np.array(here.distance if missing is None else missing)
    for i, (point, target) in enumerate(zip(here.point, here.target, strict=True)):
        if known.get(key := (int(point), int(target))):
            found[i] = known[key].pop(0)
    return found


def reached(low: Events, high: Events, weights: tuple[float, float] = (1.0, 1.0)) -> Array:
    """Where between two states the events ``high`` vanish if all are linear. Not collective.

    Args:
        low: of a piece, at a state inside it.
        high: of the same piece, at another state.
        weights: by which the distances at the two are multiplied.

    Returns:
        Fractions of the way, one for each event of ``high``: inf where that is inside, 1/2 where
        it is not and there is no such border at ``low``.
    """
    distance = weights[1] * high.distance
    falling = distance < 0
    before = again(high, low, np.full_like(distance, np.inf))
    begins = falling & np.isinf(before)
    above = np.where(falling & ~begins, weights[0] * np.maximum(before, 0.0), 0.0)
    fraction = np.where(falling, above / np.where(falling, above - distance, 1.0), np.inf)
    return np.where(begins, 0.5, fraction)
