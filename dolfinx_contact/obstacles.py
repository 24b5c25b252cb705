# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid obstacles: regions that the body must not enter.

At a point x an obstacle defines, in UFL, the gap (the signed distance, positive outside) and the
unit normal n from the body into the obstacle. In small sliding, gap and n are evaluated at the
contact point in the reference configuration, and a point with the displacement u has the current
gap ``gap - u.n``. This is exact for a flat obstacle, and correct to first order in u for a curved
one. In large sliding, gap and normal are evaluated at the displaced point (`points.displaced`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import fem, mesh
from ufl.algorithms import expand_derivatives
from ufl.corealg.traversal import traverse_unique_terminals

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import number, positive, vector

__all__ = [
    "Cylinder",
    "HalfSpace",
    "LevelSet",
    "Measured",
    "Obstacle",
    "Outline",
    "Sphere",
    "Start",
    "has_ufl",
    "is_uniform",
    "known_displaced",
]


def has_ufl(value: Any) -> bool:
    """Return whether a tuple, list or array contains UFL expressions."""
    listed = isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.ndim == 1)
    return listed and any(isinstance(v, ufl.core.expr.Expr) and v.ufl_shape == () for v in value)


def is_uniform(value: Any) -> bool:
    """Return whether a number, a UFL expression or a list of these is the same at every point."""
    if not isinstance(value, ufl.core.expr.Expr):
        return not has_ufl(value) or all(map(is_uniform, value))
    varies = ufl.classes.GeometricQuantity | ufl.classes.Coefficient
    return not any(isinstance(part, varies) for part in traverse_unique_terminals(value))


def _require_uniform(value: Any, what: str) -> None:
    """Raise `ValueError` if data of an obstacle depend on the position on the mesh.

    A Function is evaluated at material points of the body, and UFL does not differentiate it with
    respect to the displaced position. The normal would therefore be wrong.
    """
    if not is_uniform(value):
        raise ValueError(
            f"{what} must be the same at every point of the body: use numbers and Constants, "
            "neither Functions nor the position on the mesh"
        )


def _components(value: Any, what: str, *, zero: bool = True) -> Any:
    """Return a vector of 2 or 3 components, as a UFL expression or an array of numbers."""
    if has_ufl(value):
        # Constants are kept: float() would fix their present value.
        parts = [v if isinstance(v, ufl.core.expr.Expr) else number(v, what) for v in value]
        value = ufl.as_vector(parts)
    if not isinstance(value, ufl.core.expr.Expr):
        return vector(value, what, zero=zero)
    if value.ufl_shape not in ((2,), (3,)):
        raise ValueError(f"{what} must have 2 or 3 components, got shape {value.ufl_shape}")
    return value


def _vector(domain: mesh.Mesh, value: Any, what: str, *, uniform: bool = True) -> Any:
    """Return ``value`` as a UFL vector of the dimension of the mesh; numbers become a Constant."""
    dim = domain.geometry.dim
    found = _components(value, what)
    if len(found) != dim:
        raise ValueError(f"{what} must have {dim} components on this mesh, got {len(found)}")
    if not isinstance(found, ufl.core.expr.Expr):
        return fem.Constant(domain, found)
    refuse_other_mesh(found, domain, what)
    if uniform:
        _require_uniform(found, what)
    return found


def _direction(domain: mesh.Mesh, value: Any, what: str, *, uniform: bool = True) -> Any:
    """Return ``value``, divided by its norm, as a UFL unit vector."""
    direction = _vector(domain, value, what, uniform=uniform)
    if direction is not value and isinstance(direction, fem.Constant):
        direction.value /= np.linalg.norm(direction.value)
        return direction
    return direction / ufl.sqrt(ufl.dot(direction, direction))


def _check_radius(radius: Any) -> None:
    """Raise `ValueError` if a radius is neither a positive number nor a UFL scalar."""
    if not isinstance(radius, ufl.core.expr.Expr):
        positive(radius, "the radius", "positive")
    elif radius.ufl_shape != ():
        raise ValueError(f"the radius must be a number, got shape {radius.ufl_shape}")


def _distance(domain: mesh.Mesh, across: Any, radius: Any) -> tuple[Any, Any]:
    """Return gap and normal at a point outside or inside a circle, sphere or cylinder.

    Args:
        domain: mesh of the body.
        across: vector from the centre, or from the nearest point of the axis, to the point.
        radius: radius.
    """
    if not isinstance(radius, ufl.core.expr.Expr):
        radius = fem.Constant(domain, float(radius))
    refuse_other_mesh(radius, domain, "the radius")
    _require_uniform(radius, "the radius")
    distance = ufl.sqrt(ufl.dot(across, across))
    return distance - radius, -across / distance


class Outline(NamedTuple):
    """Surface of facets that bounds an obstacle.

    Attributes:
        points: coordinates of the m points, shape (m, dim).
        cells: indices of the points of each of k facets, shape (k, dim).
        normals: unit normals at the points, pointing into the obstacle, shape (m, dim).
    """

    points: Array
    cells: Ints
    normals: Array


class Start(NamedTuple):
    """Initial position of the points of a face relative to an obstacle that ends at a rim.

    Attributes:
        gap: gaps, which open gradually past the rim, shape (n,).
        height: heights above the extended surface, for points that are past the rim and below it;
            gaps, for other points; shape (n,).
        normal: normals of the extended surface, into the obstacle, shape (n, dim).
        on_obstacle: mask of the points that are still on the obstacle, shape (n,).
    """

    gap: Array
    height: Array
    normal: Array
    on_obstacle: Mask


class Obstacle:
    """Rigid obstacle (base class).

    The data are read when a problem is created. Data that change between two solves must be
    Constants; numbers and arrays are copied. A user-defined obstacle defines `at`. An obstacle that
    defines only `on` has a gap and a normal in the reference configuration only, and is restricted
    to small sliding.
    """

    #: Motion opposite to the nodes (`points.opposite.Opposite`); None for rigid obstacles.
    opposite: Any = None
    #: Hash of the data that are not in UFL, for the comparison of ranks and for records.
    mark: str = ""

    @property
    def outline(self) -> Outline | None:
        """Facets that bound the obstacle; None if the obstacle is given by a formula."""
        return None

    @property
    def flat(self) -> bool:
        """Whether the normal is constant, so that small sliding is exact for any displacement."""
        return False

    def ended(self, face: Callable[[], tuple[Any, Any]]) -> Obstacle:
        """Return this obstacle with a gap that opens gradually beyond its rim.

        A face that slides past the rim of an open surface loses contact over one facet. Obstacles
        without a rim return themselves.

        Args:
            face: function returning two UFL expressions: facet sizes of the sliding face, and
                overlap removed at the start.
        """
        return self

    def starts(self, x: Array, widths: Array) -> Start:
        """Return the initial position of a face relative to this obstacle with a rim; see `ended`.

        Args:
            x: points of the face, shape (n, dim).
            widths: sizes of the facets at the points, shape (n,).
        """
        raise NotImplementedError

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        """Return gap and unit normal (from the body into the obstacle) at a UFL point.

        Args:
            domain: mesh of the body.
            x: UFL vector, such as ``ufl.SpatialCoordinate(domain) + u``.

        Raises:
            ValueError: if the obstacle does not fit the dimension of the mesh.
        """
        raise NotImplementedError

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        """Return gap and unit normal in the reference configuration; see `at`."""
        return self.at(domain, ufl.SpatialCoordinate(domain))


def known_displaced(obstacle: Obstacle) -> bool:
    """Return whether an obstacle defines gap and normal at displaced points (`Obstacle.at`)."""
    return type(obstacle).at is not Obstacle.at


class Measured(ufl.Coefficient):  # type: ignore[misc]
    """Gap and normal that are computed numerically, as UFL functions of a UFL point.

    An evaluator (`points.evaluators`) computes the gap g and the normal n at the position x_0 of
    each contact point, and their derivatives dg and dn with respect to the position. The UFL
    functions of the point x are

        gap = g + dg.(x - x_0),    normal = n + dn (x - x_0),

    so that values and first derivatives are exact at x = x_0; second derivatives are not available.

    Args:
        domain: mesh of the body.
        x: UFL vector, the point.
        measure: function mapping m points, shape (m, dim), to gaps, their derivatives, normals, and
            their derivatives, with the shapes (m,), (m, dim), (m, dim) and (m, dim, dim).
        more: UFL scalars whose values, shape (m,), are additional arguments of ``measure``.

    Attributes:
        at: UFL vector of the point and ``more``.
        gap: gap at ``x``, a UFL scalar.
        normal: normal at ``x``, a UFL vector.
    """

    def __new__(cls, *_: Any) -> Measured:
        made: Measured = object.__new__(cls)
        return made

    def __init__(
        self,
        domain: mesh.Mesh,
        x: Any,
        measure: Callable[..., tuple[Any, ...]],
        more: Sequence[Any] = (),
    ):
        dim = self._dim = domain.geometry.dim
        shapes = ((dim,), (), (dim,), (dim,), (dim, dim))  # x_0, g, dg, n, dn
        ends = np.cumsum([int(np.prod(shape, dtype=int)) for shape in shapes])
        element = basix.ufl.element("DG", domain.basix_cell(), 0, shape=(int(ends[-1]),))
        super().__init__(ufl.FunctionSpace(domain.ufl_domain(), element))
        self.at = ufl.as_vector([*(x[i] for i in range(dim)), *more]) if more else x
        self._measure = measure
        self._last: tuple[Any, Any] | None = None
        components = np.array([self[i] for i in range(int(ends[-1]))], dtype=object)
        there, gap, slope, normal, turn = (
            ufl.as_tensor(part.reshape(shape).tolist()) if shape else part[0]
            for part, shape in zip(np.split(components, ends[:-1]), shapes, strict=True)
        )
        self.gap = gap + ufl.dot(slope, x - there)
        self.normal = normal + ufl.dot(turn, x - there)

    def values(self, taken: Array) -> Array:
        """Return position, gap, normal and their derivatives at m points. Not collective.

        Args:
            taken: values of the components of `at` at the points, shape (m, components of `at`).

        Returns:
            Components of position, gap, derivative of the gap, normal, and derivative of the
            normal, in this order, one row per point.
        """
        if self._last is None or not np.array_equal(self._last[0], taken):
            x, more = np.split(taken, [self._dim], axis=1)
            parts = [x, *self._measure(x, *more.T)]
            flat = [np.reshape(p, (len(x), int(np.prod(p.shape[1:], dtype=int)))) for p in parts]
            self._last = taken.copy(), np.concatenate(flat, axis=1)
        return np.asarray(self._last[1])


@dataclass(frozen=True)
class HalfSpace(Obstacle):
    """Half-space behind a plane (a line in 2D) of any orientation.

    Both attributes may depend on the position or on Functions. Each point of the body then has its
    own plane with the given normal, which differs from the normal of the envelope of these planes.

    Attributes:
        point: point of the plane; numbers, which are copied, or a vector Constant, whose value may
            be changed later.
        normal: normal of the plane, pointing out of the obstacle towards the body, of any length;
            numbers or a vector Constant, as for `point`.

    Raises:
        ValueError: if a vector does not have 2 or 3 finite components, or the normal is zero.
    """

    point: npt.ArrayLike | fem.Constant
    normal: npt.ArrayLike | fem.Constant

    def __post_init__(self) -> None:
        _components(self.point, "the point of the half-space")
        _components(self.normal, "the normal of the half-space", zero=False)

    @property
    def flat(self) -> bool:
        return type(self).at is HalfSpace.at and is_uniform(self.point) and is_uniform(self.normal)

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        normal = _direction(domain, self.normal, "the normal of the half-space", uniform=False)
        point = _vector(domain, self.point, "the point of the half-space", uniform=False)
        return ufl.dot(x - point, normal), -normal


@dataclass(frozen=True)
class Sphere(Obstacle):
    """Rigid ball; a rigid disc in 2D.

    Contact is enforced at contact points. A ball smaller than a facet can pass between contact
    points. A warning is then logged, and the facets near the ball should be refined.

    Attributes:
        centre: centre; numbers, which are copied, or a Constant.
        radius: radius, a positive number or a Constant.

    Raises:
        ValueError: if the centre does not have 2 or 3 finite components, or the radius is not
            positive.
    """

    centre: npt.ArrayLike | fem.Constant
    radius: float | fem.Constant

    def __post_init__(self) -> None:
        _components(self.centre, "the centre of the sphere")
        _check_radius(self.radius)

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        centre = _vector(domain, self.centre, "the centre of the sphere")
        return _distance(domain, x - centre, self.radius)


@dataclass(frozen=True)
class Cylinder(Obstacle):
    """Rigid circular cylinder of infinite length, in 3D.

    Attributes:
        point: point of the axis; 3 numbers, which are copied, or a Constant.
        axis: direction of the axis, of any length; same types as `point`.
        radius: radius, a positive number or a Constant.

    Raises:
        ValueError: if a vector does not have 2 or 3 finite components, the axis is zero, or the
            radius is not positive.
    """

    point: npt.ArrayLike | fem.Constant
    axis: npt.ArrayLike | fem.Constant
    radius: float | fem.Constant

    def __post_init__(self) -> None:
        _components(self.point, "the point of the axis of the cylinder")
        _components(self.axis, "the axis of the cylinder", zero=False)
        _check_radius(self.radius)

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        if domain.geometry.dim != 3:
            raise ValueError("a Cylinder needs a 3D mesh; in 2D a Sphere is a disc")
        axis = _direction(domain, self.axis, "the axis of the cylinder")
        d = x - _vector(domain, self.point, "the point of the axis of the cylinder")
        return _distance(domain, d - ufl.dot(d, axis) * axis, self.radius)


@dataclass(frozen=True)
class LevelSet(Obstacle):
    """Obstacle given by a UFL function phi of position, negative inside and positive outside.

    The gap is phi/|grad phi|, the distance to first order; it is exact if phi is a signed distance.

    Attributes:
        phi: function mapping the UFL position vector to a UFL scalar. Numbers in the function are
            fixed when a problem is created; data that change must be Constants.

    Raises:
        ValueError: if ``phi`` is not callable.
    """

    phi: Callable[[Any], Any]

    def __post_init__(self) -> None:
        if not callable(self.phi):
            raise ValueError(f"the level set must be a function of position, got {self.phi!r}")

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        x = ufl.variable(x)
        phi = self.phi(x)
        if not isinstance(phi, ufl.core.expr.Expr) or phi.ufl_shape != ():
            raise ValueError("the level set must return a scalar UFL expression")
        slope = ufl.diff(phi, x)
        if isinstance(expand_derivatives(slope), ufl.constantvalue.Zero):
            raise ValueError(
                "the level set must depend on the position passed to it; its gradient vanishes"
            )
        # data without the position, which may belong to points on a submesh
        data = self.phi(ufl.variable(ufl.Constant(domain.ufl_domain(), shape=x.ufl_shape)))
        refuse_other_mesh(data, domain, "the level set")
        _require_uniform(data, "the data of the level set")
        steepness = ufl.sqrt(ufl.dot(slope, slope))
        return phi / steepness, -slope / steepness
