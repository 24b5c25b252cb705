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

__all__ = ["mesh_mark", "mesh_may_move", "mesh_stays"]

_depth = 0  # of contexts in which meshes stay
_marks: dict[mesh.Mesh, int] = {}  # found there


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
