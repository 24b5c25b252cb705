# SPDX-License-Identifier: LGPL-3.0-or-later
"""Segments or triangles of a physical group of a file of gmsh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._install import optional
from dolfinx_contact.meshing.gmsh import empty_model

__all__ = ["group_of"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_LINES, _TRIANGLES, _QUADRILATERALS = 1, 2, 3  # of degree 1, as gmsh numbers kinds of elements
_PLANE = 1e-10  # of the extent, up to which z is one


def group_of(path: Path, group: str | int | None) -> tuple[Array, Ints]:
    """Points and facets of a group of curves (2D) or surfaces (3D). Quadrilaterals are halved.

    Args:
        path: of the file.
        group: its name or tag; None for all surfaces, or all curves where there are none.

    Raises:
        ValueError: if gmsh cannot read the file, there is no such group, it has no facets, has
            facets that are bent, or is one of curves that are not in a plane of constant z.
    """
    gmsh = optional("gmsh", "gmsh")
    with empty_model(gmsh) as model:
        try:
            gmsh.merge(str(path))
        except Exception as error:  # gmsh raises no other kind
            raise ValueError(f"gmsh cannot read {path}: {error}") from error
        dim, entities = _entities(model, path, group)
        cells = _cells(model, dim, entities, f"{path}: the group {group!r}")
        tags, flat, _ = model.mesh.getNodes()
    if not len(cells):
        what = "no facets" if group is None else f"no facets in the group {group!r}"
        raise ValueError(f"{path} has {what}: gmsh saves what is in physical groups, and meshed")
    order = np.argsort(tags)
    x = np.asarray(flat, dtype=np.float64).reshape(-1, 3)[order]
    used, places = np.unique(cells, return_inverse=True)
    x = x[np.searchsorted(np.asarray(tags)[order], used)]
    if dim == 1 and np.ptp(x[:, 2]) > _PLANE * np.ptp(x, axis=0).max():
        raise ValueError(f"{path}: a surface of curves must be in a plane of constant z")
    return x[:, : dim + 1].copy(), places.reshape(cells.shape).astype(np.int64)


def _entities(model: Any, path: Path, group: str | int | None) -> tuple[int, list[int]]:
    """Dimension and entities of a group."""
    if group is None:
        dim = 2 if any(len(model.mesh.getElements(2, e)[0]) for _, e in model.getEntities(2)) else 1
        return dim, [e for _, e in model.getEntities(dim)]
    known = [g for g in model.getPhysicalGroups() if g[0] in (1, 2)]
    names = {g: model.getPhysicalName(*g) for g in known}
    found = [g for g in known if group in (g[1], names[g])]
    if len(found) != 1:
        listed = ", ".join(f"{tag} ({names[d, tag]!r}, {d}D)" for d, tag in known) or "none"
        which = "no group" if not found else f"{len(found)} groups"
        raise ValueError(f"{path}: {which} {group!r} of curves or surfaces; there are: {listed}")
    ((dim, tag),) = found
    return int(dim), [int(e) for e in model.getEntitiesForPhysicalGroup(dim, tag)]


def _cells(model: Any, dim: int, entities: list[int], where: str) -> Ints:
    """Nodes of facets, by gmsh's numbers (k, dim + 1)."""
    found: list[Ints] = [np.zeros((0, dim + 1), dtype=np.int64)]
    for entity in entities:
        kinds, _, nodes = model.mesh.getElements(dim, entity)
        for kind, flat in zip(kinds, nodes, strict=True):
            if kind not in (_LINES, _TRIANGLES, _QUADRILATERALS):
                name = model.mesh.getElementProperties(kind)[0]
                raise ValueError(f"{where} has elements that are bent or unknown ({name})")
            width = {_LINES: 2, _TRIANGLES: 3, _QUADRILATERALS: 4}[kind]
            each: Ints = np.asarray(flat, dtype=np.int64).reshape(-1, width)
            found += [each] if kind != _QUADRILATERALS else [each[:, :3], each[:, [0, 2, 3]]]
    return np.concatenate(found)
