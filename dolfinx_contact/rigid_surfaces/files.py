# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets of a surface from a file: STL (ASCII or binary) or gmsh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from dolfinx_contact.rigid_surfaces.gmsh_group import group_of

__all__ = ["facets_in"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_HEAD = 84  # bytes before the facets of a binary STL file: a line of 80, and their number
#: Words of a facet in an ASCII STL file, with "" for a number.
_WORDS = ("facet", "normal", *3 * [""], "outer", "loop")
_WORDS += (*3 * ["vertex", *3 * [""]], "endloop", "endfacet")
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
    """Return the corners (k, 3, 3) of a binary or ASCII STL file.

    A file is binary if it has the length that its number of facets requires: the header of a binary
    file may begin with "solid" too.
    """
    content = path.read_bytes()
    text = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little") if len(content) >= _HEAD else 0
    length = _HEAD + count * _FACET.itemsize
    if len(content) == length:
        facets = np.frombuffer(content, _FACET, count, _HEAD)
        return np.asarray(facets["corners"], dtype=np.float64)
    if text[:5].lower() == b"solid":
        return _of_text(path, text.decode(errors="replace"))
    raise ValueError(
        f"{path} is no complete STL file: an ASCII file begins with 'solid', and a binary file "
        f"with {count} facets has {length} bytes; got {len(content)} bytes"
    )


def _of_text(path: Path, text: str) -> Array:
    """Return the corners (k, 3, 3) of an ASCII STL file, of one or several solids."""
    lines = [line.split() for line in text.lower().splitlines() if line.strip()]
    if lines[-1][0] != "endsolid":
        raise ValueError(f"{path} is truncated: an ASCII STL file ends with 'endsolid'")
    # The names of solids are free text.
    words = [w for line in lines if line[0] not in ("solid", "endsolid") for w in line]
    try:
        facets = np.array(words, dtype=str).reshape(-1, len(_WORDS))
        numbers = np.array([word == "" for word in _WORDS])
        if (facets[:, ~numbers] != np.array(_WORDS)[~numbers]).any():
            raise ValueError("keywords differ")
        return facets[:, numbers].astype(np.float64)[:, 3:].reshape(-1, 3, 3)
    except ValueError as error:
        raise ValueError(f"{path} is no complete ASCII STL file: {error}") from None
