# SPDX-License-Identifier: LGPL-3.0-or-later
"""A checksum of the nodes of a mesh, by which it is noticed that the user has moved it.

Everything that is kept from one evaluation to the next depends on it. Where nobody can move the
mesh, as within a solve, it is found once.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dolfinx import mesh

__all__ = ["mesh_mark", "mesh_stays"]

_depth = 0  # of contexts in which meshes stay
_marks: dict[int, int] = {}  # found there, by the address of the nodes


def mesh_mark(domain: mesh.Mesh) -> int:
    """A checksum of the nodes of a mesh, on this rank. Not collective."""
    x = domain.geometry.x
    if not _depth:
        return zlib.crc32(np.ascontiguousarray(x))
    address = int(x.ctypes.data)
    if address not in _marks:
        _marks[address] = zlib.crc32(np.ascontiguousarray(x))
    return _marks[address]


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
