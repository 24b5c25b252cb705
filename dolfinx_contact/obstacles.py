# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid foundations: where the body may not go.

An obstacle gives, in UFL and at a point x, the gap (the signed distance to the obstacle, positive
outside) and the unit normal n from the body into the obstacle. With those of a contact point in the
reference configuration the current gap of a point displaced by u is ``gap - u.n``: exact for a flat
obstacle and any displacement, and for a curved one correct to first order in u (small sliding). In
large sliding both are those at the displaced point (`points.displaced`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
import basix.ufl
import ufl
from dolfinx import fem, mesh
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.corealg.traversal import traverse_unique_terminals, unique_pre_traversal

from dolfinx_contact._forms import compiled_expression
from dolfinx_contact._mpi import require
from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import positive

__all__ = [
    "Cylinder",
    "HalfSpace",
    "LevelSet",
    "Measured",
    "Obstacle",
    "Outline",
    "Sphere",
    "Start",
    "fields_within",
    "gap_at",
    "has_ufl",
    "is_uniform",
    "known_displaced",
    "require_uniform",
]


_UNIFORM = 1e-12  # of the largest value of a Function, by which those differ that are one
_VARIES = (
    "{0} contains {1}: what a point of the body has of it goes with that point wherever it is, and "
    "has no slope, so that the normal is not that of the surface that is meant; write a level set "
    "with the position that it is given, and with Constants"
)


def has_ufl(value: Any) -> bool:
    """Whether a tuple, list or array has components in UFL."""
    listed = isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.ndim == 1)
    return listed and any(isinstance(v, ufl.core.expr.Expr) and v.ufl_shape == () for v in value)


def _vector(domain: mesh.Mesh, value: Any, what: str) -> Any:
    """``value`` as a UFL vector of the mesh's dimension; arrays become a Constant."""
    dim = domain.geometry.dim
    if has_ufl(value):
        # A float of a Constant is what it is now: it would not move with it.
        try:
            parts = [v if isinstance(v, ufl.core.expr.Expr) else float(v) for v in value]
            value = ufl.as_vector(parts)
        except (TypeError, ValueError):
            raise ValueError(f"{what} must have {dim} numbers, got {value!r}") from None
    if isinstance(value, ufl.core.expr.Expr):
        if value.ufl_shape != (dim,):
            raise ValueError(f"{what} must have {dim} components, got shape {value.ufl_shape}")
        refuse_other_mesh(value, domain, what)
        return value
    try:
        array = np.array(value, dtype=np.float64, order="C")  # as Constants need it
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (dim,) or not np.isfinite(array).all():
        raise ValueError(f"{what} must have {dim} finite components, got {value!r}")
    return fem.Constant(domain, array)


def _direction(domain: mesh.Mesh, value: Any, what: str) -> Any:
    """``value`` as a UFL unit vector."""
    vector = _vector(domain, value, what)
    if isinstance(vector, fem.Constant):
        length = np.linalg.norm(vector.value)
        if not length > 0:
            raise ValueError(f"{what} is the zero vector")
        if vector is not value:
            vector.value = vector.value / length
            return vector
    return vector / ufl.sqrt(ufl.dot(vector, vector))


def is_uniform(value: Any) -> bool:
    """Whether numbers, Constants or UFL have the same value at every point."""
    if not isinstance(value, ufl.core.expr.Expr):
        return not has_ufl(value) or all(map(is_uniform, value))
    varies = ufl.classes.GeometricQuantity | ufl.classes.Coefficient
    return not any(isinstance(part, varies) for part in traverse_unique_terminals(value))


class Uniform(NamedTuple):
    """A Function that has to be uniform.

    Attributes:
        function: which.
        components: of its values that are used; None for all.
    """

    function: fem.Function
    components: tuple[int, ...] | None


def fields_within(obstacle: Obstacle, domain: mesh.Mesh, what: str) -> list[Uniform]:
    """The Functions in an obstacle, which have to be uniform (`require_uniform`). Not collective.

    Args:
        obstacle: any.
        domain: mesh of the body.
        what: it is, for the message.

    Raises:
        ValueError: if the position on the mesh is in it (`Obstacle.fields`).
    """
    found: dict[fem.Function, tuple[int, ...] | None] = {}
    for value in obstacle.fields(domain):
        parts = list(value) if has_ufl(value) else [value]
        for part in (p for p in parts if isinstance(p, ufl.core.expr.Expr)):
            terminals = list(traverse_unique_terminals(part))
            if any(isinstance(t, ufl.classes.GeometricQuantity) for t in terminals):
                raise ValueError(_VARIES.format(what, "the position on the mesh"))
            for f in (t for t in terminals if isinstance(t, fem.Function)):
                mine, more = _components(part, f), found.get(f, ())
                both = None if mine is None or more is None else tuple(sorted({*mine, *more}))
                found[f] = both
    return sorted((Uniform(*u) for u in found.items()), key=lambda u: u.function.count())


def _components(part: Any, f: fem.Function) -> tuple[int, ...] | None:
    """The components of a Function that UFL has, as those of a mixed space; None for all."""
    taken: set[int] = set()
    if part is f:
        return None
    for node in unique_pre_traversal(part):
        if not any(operand is f for operand in node.ufl_operands):
            continue
        index: Sequence[Any] = ()
        if isinstance(node, ufl.classes.Indexed):
            index = tuple(node.ufl_operands[1])
        if len(index) != 1 or not isinstance(index[0], ufl.classes.FixedIndex):
            return None
        taken.add(int(index[0]))
    return tuple(sorted(taken))


def require_uniform(comm: MPI.Comm, functions: Sequence[Uniform], what: str) -> None:
    """Raise ``ValueError`` if Functions have not one value as they are now. Collective.

    Args:
        comm: communicator.
        functions: of `fields_within`.
        what: they are in, for the message.
    """
    for f, components in functions:
        values = _values(f, components)
        low = comm.allreduce(values.min(axis=0, initial=np.inf), op=np.minimum)
        high = comm.allreduce(values.max(axis=0, initial=-np.inf), op=np.maximum)
        size = max(float(np.max(np.abs([low, high]))), np.finfo(float).tiny)
        same = bool(np.all(high - low <= _UNIFORM * size))
        require(comm, same, _VARIES.format(what, f"the Function {f.name}, which varies"))


def _values(f: fem.Function, components: tuple[int, ...] | None) -> npt.NDArray[Any]:
    """Values that a Function has, all of them if these are one (n, components). Collective.

    Degrees of freedom are values, but for those of vectors along edges and of mixed spaces.
    """
    V = f.function_space
    element = V.ufl_element()
    mixed = element.num_sub_elements not in (0, element.block_size)
    if not mixed and V.element.interpolation_ident:
        values = f.x.array.reshape(-1, V.dofmap.index_map_bs)
        return np.asarray(values if components is None else values[:, components])
    every = range(int(np.prod(f.ufl_shape, dtype=int))) if components is None else components
    degree = max(element.embedded_superdegree, 1)
    points = basix.create_lattice(V.mesh.basix_cell(), degree, basix.LatticeType.equispaced, True)
    e = compiled_expression(ufl.as_vector([f[i] for i in every]), points)
    cells = np.arange(V.mesh.topology.index_map(V.mesh.topology.dim).size_local, dtype=np.int32)
    return np.asarray(e.eval(V.mesh, cells).reshape(-1, len(every)))


def _radius(domain: mesh.Mesh, value: Any) -> Any:
    if isinstance(value, ufl.core.expr.Expr):
        if value.ufl_shape != ():
            raise ValueError(f"the radius must be a number, got shape {value.ufl_shape}")
        refuse_other_mesh(value, domain, "the radius")
        return value
    return fem.Constant(domain, positive(value, "the radius", "positive"))


class Outline(NamedTuple):
    """A surface of facets.

    Attributes:
        points: (m, dim).
        cells: facets by these (k, dim).
        normals: at the points, into the obstacle (m, dim).
    """

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    normals: npt.NDArray[np.float64]


class Start(NamedTuple):
    """Where a face starts on an obstacle that ends.

    Attributes:
        gap: of its points, those past the rim as they leave by degrees (n,).
        height: of what is below the rim and past it, over the surface as if that went on; else the
            gap (n,).
        normal: into the obstacle as if it went on (n, dim).
        held: where the gap is not that of what has left (n,).
    """

    gap: npt.NDArray[np.float64]
    height: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    held: npt.NDArray[np.bool_]


class Obstacle:
    """A rigid foundation, bound to a mesh by `on`.

    Its data are read when a surface is made with it, and are read-only then: data that are to move
    must be Constants or Functions, whose values may be changed between two solves. Numbers and
    arrays are copied. But in planes Functions must have one value everywhere, and the position on
    the mesh is refused (`fields`).

    An obstacle of your own defines `at`, or `on` alone; then nothing is known of it at displaced
    points: sliding has to be small, which is not checked.
    """

    #: What moves with the displacement (`points.opposite.Opposite`); None where nothing does.
    opposite: Any = None
    #: A hash of what it is beside its UFL, by which ranks are compared and records know it.
    mark: str = ""

    @property
    def outline(self) -> Outline | None:
        """Its surface, where that is one of facets; else None."""
        return None

    @property
    def flat(self) -> bool:
        """Whether the normal is the same everywhere, so that no displacement is too large."""
        return False

    def fields(self, domain: mesh.Mesh) -> list[Any]:
        """Data that have to be the same at every point of the body; UFL, numbers or arrays.

        A field of the body among them has the value of a point of the body wherever that is, and
        no slope: the surface that is meant is tilted, and its normal is not. Not collective.
        """
        return []

    @property
    def radius_given(self) -> Any:
        """What it has as its radius, which has to be positive; None of one without."""
        return None

    def ended(self, face: Callable[[], tuple[Any, Any]]) -> Obstacle:
        """What it is to a face that slides: what it leaves by degrees where the obstacle ends.

        Args:
            face: gives the sizes of the facets of the face and the overlap that is removed, in UFL.
        """
        return self

    def starts(self, x: npt.NDArray[np.float64], widths: npt.NDArray[np.float64]) -> Start:
        """Where a face starts on an obstacle that ends; see `ended`. Not collective.

        Args:
            x: points of the face (n, dim).
            widths: sizes of the facets there (n,).
        """
        raise NotImplementedError

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        """UFL gap and unit normal (from the body into the obstacle) at a UFL point.

        Args:
            domain: mesh of the body.
            x: a UFL vector, such as ``ufl.SpatialCoordinate(domain) + u``.

        Raises:
            ValueError: if the obstacle does not fit the dimension of the mesh.
        """
        raise NotImplementedError

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        """UFL gap and unit normal (from the body into the obstacle) on ``domain``. Not collective.

        Raises:
            ValueError: if the obstacle does not fit the dimension of the mesh, or something is of
                another mesh.
        """
        return self.at(domain, ufl.SpatialCoordinate(domain))


class Measured(ufl.Coefficient):  # type: ignore[misc]
    """Gap and normal that are found by numbers, at a UFL point, as functions of it in UFL.

    They are known at the points of a surface alone, where an evaluator measures them
    (`points.evaluation`), with x_0 the value of x there:

        gap = g + dg.(x - x_0),    normal = n + dn (x - x_0),

    so that values and first derivatives are exact, and no others.

    Args:
        domain: mesh of the body.
        x: a UFL vector, the point.
        measure: takes points (n, dim) and returns g (n,), dg (n, dim), n (n, dim), dn (n, dim,
            dim).
        more: UFL scalars, of which it takes the values (n,) too.

    Attributes:
        at: what it takes, a UFL vector.
        gap, normal: in UFL.
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
        dim = domain.geometry.dim
        self._shapes: list[tuple[int, ...]] = [(dim,), (), (dim,), (dim,), (dim, dim)]
        components = 1 + 3 * dim + dim**2
        element = basix.ufl.element("DG", domain.basix_cell(), 0, shape=(components,))
        super().__init__(ufl.FunctionSpace(domain.ufl_domain(), element))
        self.at = ufl.as_vector([*(x[i] for i in range(dim)), *more]) if more else x
        self._measure = measure
        self._last: tuple[Any, Any] | None = None
        there, gap, slope, normal, turn = self._parts()
        self.gap = gap + ufl.dot(slope, x - there)
        self.normal = normal + ufl.dot(turn, x - there)

    def _parts(self) -> list[Any]:
        """x_0, g, dg, n, dn by the components of this."""
        found = []
        first = 0
        for shape in self._shapes:
            size = int(np.prod(shape, dtype=int))
            part = np.array([self[i] for i in range(first, first + size)], dtype=object)
            found.append(ufl.as_tensor(part.reshape(shape).tolist()) if shape else part[0])
            first += size
        return found

    def values(self, taken: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The components where `at` has these values (n, components). Not collective."""
        if self._last is None or not np.array_equal(self._last[0], taken):
            dim = self._shapes[0][0]
            x = taken[:, :dim]
            parts = [x, *self._measure(x, *taken[:, dim:].T)]
            sizes = [int(np.prod(shape, dtype=int)) for shape in self._shapes]
            flat = [np.reshape(p, (len(x), n)) for p, n in zip(parts, sizes, strict=True)]
            self._last = taken.copy(), np.concatenate(flat, axis=1)
        return np.asarray(self._last[1])


def gap_at(obstacle: Obstacle, domain: mesh.Mesh, x: Any) -> Any | None:
    """UFL gap at a UFL point; None if the obstacle is known in the reference configuration only.

    That is so where a class has an `on` of its own and no `at` that goes with it.
    """
    return obstacle.at(domain, x)[0] if known_displaced(obstacle) else None


def known_displaced(obstacle: Obstacle) -> bool:
    """Whether gap and normal are known at any point, not in the reference configuration alone."""
    for kind in type(obstacle).__mro__:
        if "at" in vars(kind) and kind is not Obstacle:
            return True
        if "on" in vars(kind):
            return False
    return False


@dataclass(frozen=True)
class HalfSpace(Obstacle):
    """The half-space behind a plane (in 2D, a line) of any orientation.

    Attributes:
        point: a point of the plane; numbers, of which a copy is kept, or a vector Constant, whose
            value may be changed later.
        normal: of the plane, out of the obstacle towards the body; of any length, given like
            `point`.

    Both may be UFL of the position or of Functions: each point of the body has its own plane then,
    whose normal is what is given, not that of the surface that these planes envelop.
    """

    point: npt.ArrayLike | fem.Constant
    normal: npt.ArrayLike | fem.Constant

    @property
    def flat(self) -> bool:
        return type(self).at is HalfSpace.at and is_uniform(self.point) and is_uniform(self.normal)

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        normal = _direction(domain, self.normal, "the normal of the half-space")
        return ufl.dot(
            x - _vector(domain, self.point, "the point of the half-space"), normal
        ), -normal


@dataclass(frozen=True)
class Sphere(Obstacle):
    """A rigid ball; in 2D a rigid disc (a cylinder across the plane).

    Contact is checked at contact points alone. A ball smaller than a facet passes between them,
    of which there is a warning: refine the face there.

    Attributes:
        centre: its centre; numbers, of which a copy is kept, or a Constant.
        radius: its radius, a positive number or a Constant.
    """

    centre: npt.ArrayLike | fem.Constant
    radius: float | fem.Constant

    def fields(self, domain: mesh.Mesh) -> list[Any]:
        return [self.centre, self.radius]

    @property
    def radius_given(self) -> Any:
        return self.radius

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        d = x - _vector(domain, self.centre, "the centre of the sphere")
        distance = ufl.sqrt(ufl.dot(d, d))
        return distance - _radius(domain, self.radius), -d / distance


@dataclass(frozen=True)
class Cylinder(Obstacle):
    """A rigid circular cylinder of infinite length, in 3D.

    Attributes:
        point: a point of the axis.
        axis: direction of the axis.
        radius: its radius.
    """

    point: npt.ArrayLike | fem.Constant
    axis: npt.ArrayLike | fem.Constant
    radius: float | fem.Constant

    def fields(self, domain: mesh.Mesh) -> list[Any]:
        return [self.point, self.axis, self.radius]

    @property
    def radius_given(self) -> Any:
        return self.radius

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        if domain.geometry.dim != 3:
            raise ValueError("a Cylinder needs a 3D mesh; in 2D a Sphere is a disc")
        axis = _direction(domain, self.axis, "the axis of the cylinder")
        d = x - _vector(domain, self.point, "the point of the axis")
        d = d - ufl.dot(d, axis) * axis
        distance = ufl.sqrt(ufl.dot(d, d))
        return distance - _radius(domain, self.radius), -d / distance


@dataclass(frozen=True)
class LevelSet(Obstacle):
    """Any obstacle given by a UFL function of position, negative inside and positive outside.

    The gap is phi/|grad phi|, the distance to first order; it is exact where phi is a signed
    distance.

    Attributes:
        phi: takes the UFL position vector and returns a UFL scalar. Numbers in it keep the
            values that they have when a surface is made; data that are to move must be Constants.
            Another position is refused, and so are Functions that vary.
    """

    phi: Callable[[Any], Any]

    def fields(self, domain: mesh.Mesh) -> list[Any]:
        # A variable, as in `at`, by which it may differentiate.
        x = ufl.variable(ufl.Constant(domain.ufl_domain(), shape=(domain.geometry.dim,)))
        return [self.phi(x)]

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        x = ufl.variable(x)
        if not callable(self.phi):
            raise ValueError(f"the level set must be a function of position, got {self.phi!r}")
        phi = self.phi(x)
        if not isinstance(phi, ufl.core.expr.Expr) or phi.ufl_shape != ():
            raise ValueError("the level set must return a scalar UFL expression")
        slope = ufl.diff(phi, x)
        if isinstance(apply_derivatives(apply_algebra_lowering(slope)), ufl.constantvalue.Zero):
            raise ValueError(
                "the level set does not depend on the position that it is given: it has no gradient"
            )
        steepness = ufl.sqrt(ufl.dot(slope, slope))
        return phi / steepness, -slope / steepness

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        gap, normal = super().on(domain)
        refuse_other_mesh(gap, domain, "the level set")
        return gap, normal
