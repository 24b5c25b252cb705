# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gathering of cells with coordinates and values at their nodes on rank 0."""

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
    """Gather owned cells with coordinates and values at their nodes on rank 0. Collective.

    Args:
        comm: communicator.
        V: scalar space of the nodes.
        cells: local nodes of the cells of this rank, one row each.
        values: values at the local nodes, by name.
        numbers: numbers of the local nodes that determine their order, equal on all ranks with the
            node; by default the global numbers in V, which depend on the number of ranks.

    Returns:
        ``cells``, ``nodes`` (their numbers), ``x`` and the values on rank 0; an empty dictionary on
        other ranks.
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
