# SPDX-License-Identifier: LGPL-3.0-or-later
"""A checksum of the nodes of a mesh, by which it is noticed that the user has moved it.

Everything that is kept from one evaluation to the next depends on it. Where nobody can move the
mesh, as within a solve, it is found once. Kept here are the places of the nodes of a function
space: DOLFINx goes through all cells for them at each call, fifty times as long as the checksum
takes (measured), and the set-up of a problem needs them in several places.
"""

from __future__ import annotations

import weakref
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

__all__ = ["mesh_mark", "mesh_may_move", "mesh_stays", "node_positions"]

_depth = 0  # of contexts in which meshes stay
_marks: dict[mesh.Mesh, int] = {}  # found there

#: Places of the nodes of spaces that live, with the mark of their mesh.
_places: dict[int, tuple[weakref.ref[Any], int, npt.NDArray[np.float64]]] = {}


def mesh_mark(domain: mesh.Mesh) -> int:
    """A checksum of the nodes of a mesh, on this rank. Not collective."""
    known = _marks.get(domain) if _depth else None
    if known is None:
        known = zlib.crc32(np.ascontiguousarray(domain.geometry.x))
        if _depth:
            _marks[domain] = known
    return known


@contextmanager
def mesh_stays() -> Iterator[None]:
    """A context, or a decorator, in which no code of the user runs that could move a mesh."""
    global _depth
    _depth += 1
    try:
        yield
    finally:
        _depth -= 1
        if not _depth:
            _marks.clear()


@contextmanager
def mesh_may_move() -> Iterator[None]:
    """A context, also within `mesh_stays`, in which code of the user runs."""
    global _depth
    before = _depth
    _depth = 0
    _marks.clear()
    try:
        yield
    finally:
        _depth = before
        _marks.clear()


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
