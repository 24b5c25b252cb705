# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checksum of the nodes of a mesh, and node positions of function spaces.

The checksum shows whether the user has moved the mesh. The positions of the nodes of a function
space are kept: DOLFINx visits all cells for them at each call, which takes fifty times as long as
the checksum (measured), and the set-up of a problem needs them in several places.
"""

from __future__ import annotations

import weakref
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

__all__ = ["mesh_mark", "node_positions"]

#: Positions of the nodes of the living spaces, with the checksum of their mesh.
_places: dict[int, tuple[weakref.ref[Any], int, npt.NDArray[np.float64]]] = {}


def mesh_mark(domain: mesh.Mesh) -> int:
    """Checksum of the nodes of a mesh on this rank. Not collective."""
    return zlib.crc32(np.ascontiguousarray(domain.geometry.x))


def node_positions(V: fem.FunctionSpace) -> npt.NDArray[np.float64]:
    """The places of the local nodes of a space, ghosts included (nodes, 3). Not collective.

    The array is kept for the next call, and cannot be written to.
    """
    key = id(V)
    space, mark, x = _places.get(key, (None, 0, np.zeros((0, 3))))
    now = mesh_mark(V.mesh)
    if space is None or space() is not V or mark != now:
        x = V.tabulate_dof_coordinates()
        x.flags.writeable = False
        _places[key] = weakref.ref(V, lambda _: _places.pop(key, None)), now, x
    return x
