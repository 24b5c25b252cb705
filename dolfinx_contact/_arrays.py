# SPDX-License-Identifier: LGPL-3.0-or-later
"""Aliases for array types, and formatting of numbers."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Codes", "Indices", "Ints", "Mask", "as_text"]

#: Real numbers.
Array: TypeAlias = npt.NDArray[np.float64]
#: Truth values.
Mask: TypeAlias = npt.NDArray[np.bool_]
#: Global numbers, and numbers of rows.
Ints: TypeAlias = npt.NDArray[np.int64]
#: Local numbers of entities, nodes or dofs in DOLFINx.
Indices: TypeAlias = npt.NDArray[np.int32]
#: Status codes of contact points.
Codes: TypeAlias = npt.NDArray[np.int8]

_ROUND_OFF = 1e-12  # numbers relative to their scale that are printed as 0


def as_text(value: float, scale: float, digits: int = 6) -> str:
    """Return a number as text; numbers that are round-off of ``scale`` are printed as 0.

    Args:
        value: number to print.
        scale: magnitude of the data, such as the largest magnitude in a column.
        digits: number of significant digits.
    """
    return f"{value if abs(value) > _ROUND_OFF * scale else 0:.{digits}g}"
