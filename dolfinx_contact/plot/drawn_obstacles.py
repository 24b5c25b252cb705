# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid obstacles as they are drawn.

A plane is drawn as a rectangle below the bodies. Obstacles with facets are drawn as they are. Any
other obstacle with a formula is drawn as the contour gap = 0 on a grid: the whole of it if it is
not much larger than the bodies, otherwise the part around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import null_space

import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives
from ufl.algorithms.analysis import extract_constants, extract_type

from dolfinx_contact._geometry import unit
from dolfinx_contact.obstacles import known_displaced
from dolfinx_contact.points.evaluators import ScatteredEvaluator
from dolfinx_contact.points.rigid_body import shape_of

if TYPE_CHECKING:
    from dolfinx import mesh

    from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["DrawnObstacle", "Formula", "formula_of"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

_NUMBER = {2: 201, 3: 49}  # of grid points along an axis
_SLIVER = 5e-4  # gap at a grid point that counts as positive, relative to the size of the grid
_PLANE_RIM = 0.1  # width of the rim of a plane around the bodies, relative to their size
_RIM = 0.2  # the same for an obstacle of which a part is drawn
_WHOLE = 1.0  # an obstacle that ends within this distance is drawn whole, relative to the size


@dataclass(frozen=True)
class DrawnObstacle:
    """A rigid obstacle, as it is drawn.

    Attributes:
        x: coordinates of its vertices, shape (m, dim).
        cells: vertices of its facets.
        n: normals at the vertices, into the obstacle, shape (m, dim).
        is_plane: True if the obstacle is a plane that is still to be extended below the bodies.
        formula: formula from which it is still to be extracted, if there is one.
        inside: in 2D its inside, as points and codes of matplotlib paths; () for a thin band.
    """

    x: Array
    cells: Cells
    n: Array
    is_plane: bool = False
    formula: Formula | None = None
    inside: Sequence[tuple[Array, npt.NDArray[np.uint8]]] = ()

    def around(self, points: Array) -> DrawnObstacle:
        """Return the obstacle as it is drawn around points (n, dim). Not collective."""
        if self.is_plane:
            return self._plane_below(points)
        if self.formula is None:
            return self
        low, high = points.min(axis=0), points.max(axis=0)
        size = float(np.max(high - low))
        first, last = low - _WHOLE * size, high + _WHOLE * size
        whole = self.formula.surface(first, last)
        if whole is None:
            return self
        # all of it along the axes on which it ends, along others the part near the bodies
        step = (last - first) / _NUMBER[len(low)]
        begin, end = whole.x.min(axis=0), whole.x.max(axis=0)
        ends = (begin > first + step) & (end < last - step)
        low = np.where(ends, begin - step, low - _RIM * size)
        high = np.where(ends, end + step, high + _RIM * size)
        return self.formula.surface(low, high) or whole

    def _plane_below(self, points: Array) -> DrawnObstacle:
        """Return a plane as the rectangle, in 2D the segment, below points (n, dim)."""
        n = self.n[0]
        axes = null_space(n[None])
        along = points @ axes
        low, high = along.min(axis=0), along.max(axis=0)
        rim = _PLANE_RIM * float(np.max(high - low))
        corners = np.array(list(product(*zip(low - rim, high + rim, strict=True))))
        x = corners @ axes.T + (self.x[0] @ n) * n
        return DrawnObstacle(x, np.arange(len(x))[None], np.tile(n, (len(x), 1)))


class Formula:
    """Gap and normal of an obstacle at any point, at the present data. Collective.

    Args:
        domain: mesh of the bodies.
        gap_and_normal: UFL vector without Functions.
        motion: displacements of the obstacle at the origin and at the ends of the unit vectors.
        axisymmetric: whether the obstacle is drawn for x >= 0 only.
    """

    def __init__(
        self, domain: mesh.Mesh, gap_and_normal: Any, motion: Array, *, axisymmetric: bool
    ):
        dim = domain.geometry.dim
        constants = extract_constants(gap_and_normal)
        now = {c: fem.Constant(domain, np.copy(c.value)) for c in constants}
        data = {"both": ufl.replace(gap_and_normal, now)}
        none, nowhere = np.zeros(0), np.zeros((0, dim))
        self._values = ScatteredEvaluator(domain, none.astype(np.int32), nowhere, none, data)
        self._least = np.array([0.0 if axisymmetric else -np.inf, *[-np.inf] * (dim - 1)])
        # the present place of X is X @ turned + moved
        self._moved = motion[0]
        self._turned = np.eye(dim) + motion[1:] - motion[0]

    def _at(self, x: Array) -> tuple[Array, Array]:
        """Return gaps (n,) and unit normals (n, dim) at points (n, dim)."""
        self._values.x = (x - self._moved) @ np.linalg.pinv(self._turned)
        found = self._values()["both"]
        return found[:, 0], unit(found[:, 1:] @ self._turned)

    def surface(self, low: Array, high: Array) -> DrawnObstacle | None:
        """Return the part of the surface in a box; None if there is none."""
        dim = len(low)
        axes = np.linspace(np.maximum(low, self._least), high, _NUMBER[dim])
        grid = np.stack(np.meshgrid(*axes.T, indexing="ij"), axis=-1)
        gap, _ = self._at(grid.reshape(-1, dim))
        # where its gradient is zero, a level set has no finite gap; zeros would give sliver facets
        size = float(np.max(high - low))
        gap = np.clip(np.nan_to_num(gap, nan=size), -size, size).reshape(grid.shape[:-1])
        gap[np.abs(gap) < _SLIVER * size] = _SLIVER * size
        found = (_curves if dim == 2 else _triangles)(axes, gap)
        if not len(found.x):
            return None
        # move the vertices from the interpolated surface to the surface
        distance, n = self._at(found.x)
        return replace(found, x=found.x + distance[:, None] * n, n=n)


def formula_of(domain: mesh.Mesh, s: DiscreteSurface, scale: float) -> Formula | None:
    """Return the formula of an obstacle; None if it is flat, has facets or is not known everywhere.

    Collective.

    Args:
        domain: mesh of the bodies.
        s: contact surface.
        scale: factor of the motion of the obstacle.
    """
    shape = shape_of(s.obstacle)
    if shape.flat or shape.outline is not None or not known_displaced(shape):
        return None
    x = ufl.SpatialCoordinate(domain)
    gap, normal = shape.at(domain, x)
    both = expand_derivatives(ufl.as_vector([gap, *normal]))
    if extract_type(both, (ufl.classes.Coefficient, ufl.classes.GeometricQuantity)) - {x}:
        return None
    ends = np.concatenate([np.zeros((1, s.dim)), np.eye(s.dim)])
    motion = scale * s.partner.dragged(ends)
    return Formula(domain, both, motion, axisymmetric=s.axisymmetric)


def _curves(axes: Array, gap: Array) -> DrawnObstacle:
    """Return the curves gap = 0 on a grid in 2D, and the inside gap < 0."""
    from contourpy import contour_generator

    contours: Any = contour_generator(axes[:, 0], axes[:, 1], gap.T, fill_type="OuterCode")
    lines: list[Array] = contours.lines(0.0)
    x = np.concatenate([np.zeros((0, 2)), *lines])
    ends = np.cumsum([0, *map(len, lines)])
    first = np.delete(np.arange(len(x)), ends[1:] - 1)
    inside = list(zip(*contours.filled(-np.inf, 0.0), strict=True))
    return DrawnObstacle(x, np.stack([first, first + 1], axis=1), np.zeros_like(x), inside=inside)


def _triangles(axes: Array, gap: Array) -> DrawnObstacle:
    """Return the surface gap = 0 on a grid in 3D."""
    import pyvista as pv

    grid = pv.ImageData(dimensions=gap.shape, spacing=axes[1] - axes[0], origin=axes[0])
    surface = grid.contour([0.0], scalars=gap.ravel(order="F"))
    x = np.asarray(surface.points, dtype=np.float64)
    return DrawnObstacle(x, surface.faces.reshape(-1, 4)[:, 1:], np.zeros_like(x))
