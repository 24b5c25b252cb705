# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of all ranks with what is known at their nodes, on rank 0."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._geometry import node_positions

__all__ = ["Arrays", "gather_cells"]

Arrays = dict[str, npt.NDArray[Any]]


def gather_cells(
    comm: MPI.Comm,
    V: fem.FunctionSpace,
    cells: npt.NDArray[np.int32],
    values: Mapping[str, Any],
    numbers: npt.NDArray[np.int64] | None = None,
) -> Arrays:
    """Owned cells of all ranks with coordinates and values at their nodes, on rank 0 only.

    Args:
        comm: the ranks.
        V: scalar space whose nodes they are.
        cells: local nodes of the cells of this rank, one row each.
        values: at the local nodes, by name.
        numbers: of the local nodes, by which they are put in order, the same on every rank that
            has a node; by default those of V, which are others on other ranks.

    Returns:
        On rank 0 ``cells``, ``nodes`` (their numbers), ``x`` and the values, else nothing.
    """
    if numbers is None:
        index_map = V.dofmap.index_map
        every = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        numbers = index_map.local_to_global(every)
    nodes, local = np.unique(cells, return_inverse=True)
    mine = {
        "cells": numbers[nodes][local].reshape(cells.shape),
        "nodes": numbers[nodes],
        "x": node_positions(V)[nodes],
        **{k: v[nodes] for k, v in values.items()},
    }
    parts = comm.gather(mine)
    if parts is None:
        return {}
    parts = [p for p in parts if len(p["nodes"])]
    joined = {k: np.concatenate([p[k] for p in parts]) for k in mine}
    number, first = np.unique(joined.pop("nodes"), return_index=True)
    places = np.searchsorted(number, joined.pop("cells"))
    at_nodes = {k: v[first] for k, v in joined.items()}
    return {"cells": places, "nodes": number, **at_nodes}
