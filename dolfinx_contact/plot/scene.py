# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes: bodies and obstacles in one state, as pictures and films draw them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import unit

__all__ = ["DrawnObstacle", "Scene"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]


@dataclass(frozen=True)
class DrawnObstacle:
    """An obstacle, as it is drawn.

    Attributes:
        x: coordinates of its vertices (m, 3).
        cells: vertices of its facets.
        n: normals at the vertices, into the obstacle (m, 3).
        is_plane: True if the obstacle is a plane that is still to be replaced by a rectangle.
    """

    x: Array
    cells: Cells
    n: Array
    is_plane: bool

    def below(self, points: Array) -> DrawnObstacle:
        """Replace a plane by a rectangle, in 2D a segment, below points (n, 3)."""
        if not self.is_plane:
            return self
        n = self.n[0]
        is_flat = not points[:, 2].any()
        first = np.eye(3)[2] if is_flat else np.eye(3)[np.argmin(np.abs(n))]
        first = unit(np.cross(n, first))
        axes = np.array([first] if is_flat else [first, np.cross(n, first)])
        along = points @ axes.T
        rim = 0.1 * float(np.ptp(along, axis=0).max())
        ends = np.stack([along.min(axis=0) - rim, along.max(axis=0) + rim], axis=1)
        grid = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(axes))
        corners = grid @ axes + (self.x[0] @ n) * n
        cells = np.arange(len(corners))[None]
        return DrawnObstacle(corners, cells, np.tile(n, (len(corners), 1)), False)


@dataclass(frozen=True)
class Scene:
    """Bodies and obstacles in one state, as they are drawn.

    Attributes:
        rest: coordinates of the vertices of the outer surface without displacement (n, 3).
        x: coordinates of the displaced vertices (n, 3).
        cells: vertices of the cells of a body in 2D, of the facets of the boundary in 3D.
        slaves: vertices of the facets of each contact surface.
        masters: vertices of the facets of each opposite surface of a pair.
        obstacles: rigid obstacles.
        values: fields at the vertices by name.
        inside: coordinates, cells, and fields by name of the whole body, for a section.
        title: title of the picture.
    """

    rest: Array
    x: Array
    cells: Cells
    slaves: list[Cells]
    masters: list[Cells]
    obstacles: list[DrawnObstacle]
    values: dict[str, Array] = field(default_factory=dict)
    inside: tuple[Array, Cells, dict[str, Array]] | None = None
    title: str = ""

    @property
    def coloured(self) -> dict[str, Array]:
        """Fields of the drawn part, the interior in a section."""
        return self.values if self.inside is None else self.inside[2]
