# SPDX-License-Identifier: LGPL-3.0-or-later
"""Input of surface facets from STL files (ASCII or binary) and gmsh files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._install import optional
from dolfinx_contact.meshing.gmsh import empty_model

__all__ = ["facets_in"]


_HEAD = 84  # bytes before the facets of a binary STL file: header (80) and number of facets
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
#: Local nodes of the facets of linear gmsh elements: lines, triangles, halves of quadrilaterals.
_PARTS = {1: [[0, 1]], 2: [[0, 1, 2]], 3: [[0, 1, 2], [0, 2, 3]]}
_PLANE = 1e-10  # relative to the extent: range of z of a plane curve


def facets_in(path: Path, group: str | int | None) -> tuple[Array, Ints]:
    """Read a surface: points, shape (m, dim), and point indices of facets, shape (k, dim).

    Facets from an STL file do not share points.

    Args:
        path: path of a .stl or .msh file.
        group: physical group of a .msh file, by name or tag; None for all facets.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if the file has another format or no facets, or if the group does not exist.
    """
    kind = path.suffix.lower()
    if kind not in (".stl", ".msh"):
        raise ValueError(f"{path}: a surface is read from a file .stl or .msh")
    if kind == ".msh":
        path.open("rb").close()  # raises OSError if the file cannot be read
        return _of_gmsh(path, group)
    if group is not None:
        raise ValueError(f"{path}: an STL file has no groups, got group={group!r}")
    corners = _of_stl(path)
    if not len(corners):
        raise ValueError(f"{path} has no facets")
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3)


def _of_stl(path: Path) -> Array:
    """Return the corners of the triangles in a binary or ASCII STL file, shape (k, 3, 3).

    A file counts as binary if its length matches its number of facets, because the header of a
    binary file may also begin with "solid".
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
        f"{path} is not a complete STL file: an ASCII file begins with 'solid', and a binary file "
        f"with {count} facets has {length} bytes; got {len(content)} bytes"
    )


def _of_text(path: Path, text: str) -> Array:
    """Return the corners of the k triangles of all solids in ASCII STL text, shape (k, 3, 3)."""
    lines = [line.split() for line in text.lower().splitlines() if line.strip()]
    if lines[-1][0] != "endsolid":
        raise ValueError(f"{path} is truncated: an ASCII STL file ends with 'endsolid'")
    try:
        corners = [line[1:] for line in lines if line[0] == "vertex"]
        return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise ValueError(f"{path} is not a complete ASCII STL file: {error}") from None


def _of_gmsh(path: Path, group: str | int | None) -> tuple[Array, Ints]:
    """Return points and facets of a group of curves (2D) or surfaces (3D) in a gmsh file.

    Without a group, all surfaces are read, or all curves if the file has no surfaces.
    """
    gmsh = optional("gmsh", "gmsh")
    with empty_model(gmsh) as model:
        try:
            gmsh.merge(str(path))
        except Exception as error:  # gmsh raises no other exception type
            raise ValueError(f"gmsh cannot read {path}: {error}") from error
        dim, entities = _entities(model, path, group)
        found: list[Ints] = [np.zeros((0, dim + 1), dtype=np.int64)]
        for entity in entities:
            kinds, _, nodes = model.mesh.getElements(dim, entity)
            for kind, flat in zip(kinds, nodes, strict=True):
                if kind not in _PARTS:
                    name = model.mesh.getElementProperties(kind)[0]
                    where = f"{path}: the group {group!r}"
                    raise ValueError(f"{where} has curved or unsupported elements ({name})")
                each = np.asarray(flat, dtype=np.int64).reshape(-1, 1 + np.max(_PARTS[kind]))
                found += [each[:, part] for part in _PARTS[kind]]
        tags, places, _ = model.mesh.getNodes()
    cells = np.concatenate(found)
    if not len(cells):
        what = "no facets" if group is None else f"no facets in the group {group!r}"
        raise ValueError(f"{path} has {what}: gmsh saves only meshed entities in physical groups")
    order = np.argsort(tags)
    used, numbers = np.unique(cells, return_inverse=True)
    rows = order[np.searchsorted(tags, used, sorter=order)]
    x = np.asarray(places, dtype=np.float64).reshape(-1, 3)[rows]
    if dim == 1 and np.ptp(x[:, 2]) > _PLANE * np.ptp(x, axis=0).max():
        raise ValueError(f"{path}: a surface of curves must be in a plane of constant z")
    return x[:, : dim + 1].copy(), numbers.reshape(cells.shape).astype(np.int64)


def _entities(model: Any, path: Path, group: str | int | None) -> tuple[int, list[int]]:
    """Return the dimension of a physical group, and the tags of its gmsh entities.

    Without a group, all surfaces are returned, or all curves if there are no meshed surfaces.
    """
    if group is None:
        dim = 2 if any(len(model.mesh.getElements(2, e)[0]) for _, e in model.getEntities(2)) else 1
        return dim, [e for _, e in model.getEntities(dim)]
    known = [
        (d, tag, model.getPhysicalName(d, tag))
        for d in (1, 2)
        for _, tag in model.getPhysicalGroups(d)
    ]
    found = [g for g in known if group in g[1:]]
    if len(found) != 1:
        listed = ", ".join(f"{tag} ({name!r}, {d}D)" for d, tag, name in known) or "none"
        which = "no group" if not found else f"{len(found)} groups"
        raise ValueError(f"{path}: {which} {group!r} of curves or surfaces; there are: {listed}")
    dim, tag, _ = found[0]
    return dim, list(model.getEntitiesForPhysicalGroup(dim, tag))
