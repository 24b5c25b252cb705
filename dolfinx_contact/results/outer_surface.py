# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outer surface of the bodies as arrays, for records and pictures. Needs NumPy only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote, unquote

import numpy.typing as npt

from dolfinx_contact._arrays import Array, Ints

__all__ = ["Arrays", "Cells", "OuterSurface", "SurfaceState", "flat", "nested"]

Arrays = dict[str, npt.NDArray[Any]]
Cells = Ints


@dataclass(frozen=True, eq=False)
class OuterSurface:
    """Undeformed outer surface of the bodies.

    Attributes:
        x: coordinates of the vertices, shape (n, 3).
        nodes: increasing numbers of the vertices in the input mesh, shape (n,).
        cells: vertices of the boundary facets in 3D, or of all cells in 2D, one row each.
        contact: vertices of the facets of each contact surface, by name.
        opposite: vertices of the facets of the master of each pair, by name.
        obstacles: facets of the obstacle of each surface that is not a pair, by name: rows of
            indices of vertices in `SurfaceState.obstacles`.
    """

    x: Array
    nodes: Ints
    cells: Cells
    contact: dict[str, Cells] = field(default_factory=dict)
    opposite: dict[str, Cells] = field(default_factory=dict)
    obstacles: dict[str, Cells] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SurfaceState:
    """State of the outer surface and of obstacles, with the contact tables.

    Attributes:
        u: displacement of the vertices, shape (n, dim).
        strain: equivalent strain at the vertices, shape (n,); see `io.outside.Outside`.
        obstacles: for each surface that is not a pair, by name: positions, displacements and
            normals of the m vertices of its obstacle, shape (3, m, dim).
        tables: columns of the `ContactTable` of each contact surface, by name.
    """

    u: npt.NDArray[Any]
    strain: npt.NDArray[Any]
    obstacles: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    tables: dict[str, Arrays] = field(default_factory=dict)


def flat(data: Mapping[str, Any], start: str = "") -> Arrays:
    """Flatten nested dictionaries of arrays into one dictionary, for a file.

    Keys are joined by slashes; special characters in keys are percent-encoded.
    """
    found: Arrays = {}
    for key, value in data.items():
        name = start + quote(key, safe="")
        found |= flat(value, f"{name}/") if isinstance(value, Mapping) else {name: value}
    return found


def nested(arrays: Arrays) -> dict[str, Any]:
    """Return the nested dictionaries that `flat` has flattened; empty dictionaries are lost."""
    found: dict[str, Any] = {}
    for name, values in arrays.items():
        *parents, key = map(unquote, name.split("/"))
        place = found
        for parent in parents:
            place = place.setdefault(parent, {})
        place[key] = values
    return found
