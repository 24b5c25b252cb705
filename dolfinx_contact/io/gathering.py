# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of all ranks with what is known at their nodes, on rank 0."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

__all__ = ["Arrays", "gather_cells"]

Arrays = dict[str, npt.NDArray[Any]]


def gather_cells(
    comm: MPI.Comm, V: fem.FunctionSpace, cells: npt.NDArray[np.int32], values: Mapping[str, Any]
) -> Arrays:
    """Owned ``cells`` of all ranks with coordinates and values at their nodes, on rank 0 only."""
    nodes, local = np.unique(cells, return_inverse=True)
    mine = {
        "cells": V.dofmap.index_map.local_to_global(nodes.astype(np.int32))[local].reshape(
            cells.shape
        ),
        "nodes": V.dofmap.index_map.local_to_global(nodes.astype(np.int32)),
        "x": V.tabulate_dof_coordinates()[nodes],
        **{k: v[nodes] for k, v in values.items()},
    }
    parts = comm.gather(mine)
    if parts is None:
        return {}
    parts = [p for p in parts if len(p["nodes"])]
    joined = {k: np.concatenate([p[k] for p in parts]) for k in mine}
    number, first = np.unique(joined.pop("nodes"), return_index=True)
    cells = joined.pop("cells")
    return {"cells": np.searchsorted(number, cells), **{k: v[first] for k, v in joined.items()}}
