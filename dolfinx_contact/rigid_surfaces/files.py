# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a surface in a file: of STL, with words or binary, and of gmsh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from dolfinx_contact.rigid_surfaces.gmsh_group import group_of

__all__ = ["facets_in"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_HEAD = 84  # bytes before the facets of a binary STL file: a line of 80, and their number
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


def facets_in(path: Path, group: str | int | None) -> tuple[Array, Ints]:
    """Points (m, dim) and facets by these (k, dim); those of STL share no points yet.

    Args:
        path: of a file .stl or .msh.
        group: physical group of the latter, by name or tag; None for all of its facets.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if its content is none of these, or has no facets or no such group.
    """
    kind = path.suffix.lower()
    if kind not in (".stl", ".msh"):
        raise ValueError(f"{path}: a surface is read from a file .stl or .msh")
    if kind == ".msh":
        path.open("rb").close()  # an error of the system if it cannot be read
        return group_of(path, group)
    if group is not None:
        raise ValueError(f"{path}: an STL file has no groups, and {group!r} was asked for")
    corners = _of_stl(path)
    if not len(corners):
        raise ValueError(f"{path} has no facets")
    if not np.isfinite(corners).all():
        raise ValueError(f"{path} has coordinates that are not finite")
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3)


def _of_stl(path: Path) -> Array:
    """Corners (k, 3, 3). A binary file is as long as the number of its facets says."""
    content = path.read_bytes()
    count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little") if len(content) >= _HEAD else -1
    if len(content) == _HEAD + count * _FACET.itemsize:
        facets = np.frombuffer(content, _FACET, count, _HEAD)
        return np.asarray(facets["corners"], dtype=np.float64)
    broken = f"{path} is no STL file: neither binary ({len(content)} bytes) nor facets in words"
    if not content.lstrip().startswith(b"solid"):
        raise ValueError(broken)
    words = content.split()
    try:
        places = [i for i, word in enumerate(words) if word == b"vertex"]
        flat = [float(w) for i in places for w in words[i + 1 : i + 4]]
        return np.array(flat, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError:
        raise ValueError(broken) from None
