# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of rigid obstacles in pictures.

If an obstacle has facets, these are drawn. Other obstacles given by a formula are drawn as the
contour gap = 0 on a grid, as a whole if they are not much larger than the bodies, otherwise only
near the bodies. An obstacle whose gap is only defined on the contact surface is drawn as the points
opposite to this surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives
from ufl.algorithms.analysis import extract_constants, extract_type

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import unit
from dolfinx_contact.io.outside import obstacle_facets
from dolfinx_contact.obstacles import known_displaced
from dolfinx_contact.points.evaluators import ScatteredEvaluator
from dolfinx_contact.points.rigid_body import shape_of
from dolfinx_contact.results.outer_surface import Cells

if TYPE_CHECKING:
    from dolfinx import mesh

    from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["DrawnObstacle", "obstacle_of"]

_NUMBER = {2: 201, 3: 49}  # number of grid points along an axis, by dimension
_SLIVER = 5e-4  # gap at a grid point that counts as positive, relative to the size of the grid
_WHOLE = 1.2  # an obstacle that ends within this distance is drawn whole, relative to the size
_RIM = {2: 0.2, 3: 0.1}  # width of the drawn part around the bodies, relative to their size
_DEPTH = 0.1  # depth of the inside of a plane


@dataclass(frozen=True)
class DrawnObstacle:
    """Facets that represent a rigid obstacle in a picture.

    Attributes:
        x: coordinates of the m vertices, shape (m, dim).
        cells: vertices of the facets, one row per facet.
        n: normals at the vertices, into the obstacle, shape (m, dim).
        formula: formula from which `around` extracts the facets; None if the facets are final.
        inside: in 2D the interior of the obstacle, as points and codes of matplotlib paths; () if
            the obstacle is drawn as a thin band.
    """

    x: Array
    cells: Cells
    n: Array
    formula: _Formula | None = None
    inside: Sequence[tuple[Array, npt.NDArray[np.uint8]]] = ()

    def around(self, points: Array) -> DrawnObstacle:
        """Return the obstacle with its facets near points, shape (n, dim). Not collective."""
        if self.formula is None:
            return self
        low, high = points.min(axis=0), points.max(axis=0)
        size = float(np.max(high - low))
        first, last = low - _WHOLE * size, high + _WHOLE * size
        whole = self.formula.surface(first, last)
        if whole is None:
            return self
        # the whole obstacle along axes on which it ends, otherwise the part near the bodies
        begin, end = whole.x.min(axis=0), whole.x.max(axis=0)
        step = (last - first) / _NUMBER[len(low)]
        ends = (begin > first + step) & (end < last - step)
        rim, depth = _RIM[len(low)] * size, _DEPTH * size
        low = np.where(ends, begin - depth, low - rim)
        high = np.where(ends, end + depth, high + rim)
        return self.formula.surface(low, high) or whole


def obstacle_of(s: DiscreteSurface, scale: float) -> DrawnObstacle:
    """Return the obstacle of a contact surface in its present position. Collective.

    Facets of the obstacle are returned on every rank, points opposite to the surface on rank 0.

    Args:
        s: contact surface whose obstacle is drawn.
        scale: factor by which the motion of the obstacle is multiplied.
    """
    face, formula = obstacle_facets(s), _formula_of(s, scale)
    if not face:
        return DrawnObstacle(np.zeros((0, s.dim)), np.zeros((0, s.dim), int), np.zeros((0, s.dim)))
    x = face["floor"][:, : s.dim] + scale * face["moved"]
    return DrawnObstacle(x, face["cells"], unit(face["n"]), formula)


class _Formula:
    """Gap and normal of an obstacle in its present position, at any points.

    Only construction is collective.

    Args:
        domain: mesh of the bodies.
        gap_and_normal: UFL vector of the gap and the normal, without Functions.
        motion: displacements of the rigid obstacle at the origin and at the end points of the unit
            vectors, which define its motion.
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
        """Return gaps, shape (n,), and unit normals, shape (n, dim), at points, shape (n, dim)."""
        self._values.x = (x - self._moved) @ np.linalg.pinv(self._turned)
        both = self._values()["both"]
        return both[:, 0], unit(both[:, 1:] @ self._turned)

    def surface(self, low: Array, high: Array) -> DrawnObstacle | None:
        """Return the part of the obstacle's surface in a box; None if there is none."""
        dim = len(low)
        axes = np.linspace(np.maximum(low, self._least), high, _NUMBER[dim])
        grid = np.stack(np.meshgrid(*axes.T, indexing="ij"), axis=-1)
        gap, _ = self._at(grid.reshape(-1, dim))
        # where its gradient is zero, a level set has no finite gap; zeros would give sliver facets
        size = float(np.max(high - low))
        gap = np.clip(np.nan_to_num(gap, nan=size), -size, size).reshape(grid.shape[:-1])
        gap[np.abs(gap) < _SLIVER * size] = _SLIVER * size
        part = (_curves if dim == 2 else _triangles)(axes, gap)
        if not len(part.x):
            return None
        # move the vertices from the interpolated surface to the surface
        distance, n = self._at(part.x)
        return replace(part, x=part.x + distance[:, None] * n, n=n)


def _formula_of(s: DiscreteSurface, scale: float) -> _Formula | None:
    """Return the formula of an obstacle, with the arguments of `obstacle_of`. Collective.

    None if the obstacle has facets, or its gap is not defined in all of space.
    """
    shape, domain = shape_of(s.obstacle), s.u.function_space.mesh
    if shape.outline is not None or not known_displaced(shape):
        return None
    x = ufl.SpatialCoordinate(domain)
    gap, normal = shape.at(domain, x)
    both = expand_derivatives(ufl.as_vector([gap, *normal]))
    if extract_type(both, (ufl.classes.Coefficient, ufl.classes.GeometricQuantity)) - {x}:
        return None
    motion = scale * s.partner.dragged(np.vstack([np.zeros(s.dim), np.eye(s.dim)]))
    return _Formula(domain, both, motion, axisymmetric=s.axisymmetric)


def _curves(axes: Array, gap: Array) -> DrawnObstacle:
    """Return the curves gap = 0 of an obstacle in 2D, on a grid, and its interior gap < 0."""
    from contourpy import contour_generator

    contours: Any = contour_generator(axes[:, 0], axes[:, 1], gap.T, fill_type="OuterCode")
    lines: list[Array] = contours.lines(0.0)
    x = np.concatenate([np.zeros((0, 2)), *lines])
    ends = np.cumsum([0, *map(len, lines)])
    first = np.delete(np.arange(len(x)), ends[1:] - 1)
    inside = list(zip(*contours.filled(-np.inf, 0.0), strict=True))
    return DrawnObstacle(x, np.stack([first, first + 1], axis=1), np.zeros_like(x), inside=inside)


def _triangles(axes: Array, gap: Array) -> DrawnObstacle:
    """Return the surface gap = 0 of an obstacle in 3D, on a grid, as triangles."""
    import pyvista as pv

    grid = pv.ImageData(dimensions=gap.shape, spacing=axes[1] - axes[0], origin=axes[0])
    surface = grid.contour([0.0], scalars=gap.ravel(order="F"))
    x = np.asarray(surface.points, dtype=np.float64)
    return DrawnObstacle(x, surface.faces.reshape(-1, 4)[:, 1:], np.zeros_like(x))
