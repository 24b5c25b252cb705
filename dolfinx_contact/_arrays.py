# SPDX-License-Identifier: LGPL-3.0-or-later
"""Types of arrays by their entries."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Codes", "Indices", "Ints", "Mask"]

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
