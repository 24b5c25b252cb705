# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Rigid bodies as contact partners: obstacles moved by forces, moments or prescribed motions.

A rigid body has a few unknowns of its own, a displacement d and a rotation theta about a reference
point X_0. Where both are small a material point X of it moves by

    Phi(X) q = d + theta x (X - X_0),    q = (d, theta).

In large sliding (`displaced`) it moves to X_0 + d + Q(theta) (X - X_0), in which Q is the rotation
of any angle with the rotation vector theta. While theta changes it turns at the rate

    w = L(theta) dtheta,    L = I + (1 - cos a)/a^2 S + (a - sin a)/a^3 S^2,    a = |theta|,

with S v = theta x v; in the plane L = 1 (Simo and Vu-Quoc, CMAME 58, 1986, section 3). Rotations
are prescribed there.

Jumps are those of the deformable body relative to it, B (u - Phi q), and what is transmitted at the
contact points with tractions t balances the loads F on it, F = Phi^T B^T W t, in the components of
q that are not prescribed (Wriggers, Computational Contact Mechanics, 2006, section 5.1: contact
with a rigid body whose motion is unknown).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import scipy

import ufl
from dolfinx import fem, mesh
from ufl.algorithms.analysis import extract_constants
from ufl.utils.stacks import StackDict

from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import ReadOnly, listed, scalar, vector, word
from dolfinx_contact.obstacles import Obstacle, Outline, gap_at, has_ufl

__all__ = ["COMPONENTS", "RigidBody", "number"]

Array = npt.NDArray[np.float64]

#: Names of the components of a rigid motion, by dimension.
COMPONENTS = {2: ("x", "y", "rz"), 3: ("x", "y", "z", "rx", "ry", "rz")}


class RigidBody(ReadOnly, Obstacle):
    """A rigid body that moves: by loads, or as prescribed, component by component.

    The components of its motion are the displacements ``x``, ``y`` (``z``) of the reference point
    and the rotations ``rz`` (``rx``, ``ry``, ``rz``) about it. Each is either free, and has a load
    (a force, or a moment about the reference point), or prescribed, and has a motion. Values are
    numbers, scalar Constants or UFL of these, which may be changed later. In small sliding both are
    small, and gap and normal are those of the shape where it is given. In large sliding the shape
    moves with the body, by displacements of any size and rotations that are prescribed, in 3D the
    components of the rotation vector; a rotation that is free is small.

    Several contact surfaces may touch one rigid body. Problems with rigid bodies are solved by the
    direct solver; there is no multigrid for them.

    Args:
        shape: any obstacle, where it is before it moves.
        about: the reference point.
        load: forces and moments by component, which are free.
        motion: displacements and rotations (radians) by component.
        free: components that are free, without a load.
        held: components whose motion is zero.
        name: used in messages and results.

    Attributes:
        shape, name: as given.
        about: reference point (dim,).
        components: names of all components.
        given: by component its load or motion.
        fixed: which components are prescribed (3,) or (6,).
        values: displacement and rotation that were found last, where a solve begins (3,) or (6,).
            Of a body in several problems they are those of the last solve of any, and tables that
            another makes then are of no state of it: give each problem a body of its own. They may
            be set, all else is read-only: loads and motions that are to change are
            Constants.

    Raises:
        ValueError: if a component is given twice or not at all, or a value is no finite
            number and no UFL scalar.
        AttributeError: where attributes are set afterwards.
    """

    _may_be_set = ("values",)
    _instead: ClassVar[Mapping[str, str]] = {
        "": "loads and motions that are to change are Constants of the mesh, load={'y': force} "
        "and force.value = -2.0; else make another rigid body, surface and problem"
    }

    def __init__(
        self,
        shape: Obstacle,
        *,
        about: npt.ArrayLike,
        load: Mapping[str, Any] | None = None,
        motion: Mapping[str, Any] | None = None,
        free: Sequence[str] = (),
        held: Sequence[str] = (),
        name: str = "rigid body",
    ):
        word(name, "the name of a rigid body")
        if not isinstance(shape, Obstacle) or isinstance(shape, RigidBody) or shape.opposite:
            raise ValueError(
                f"{name}: its shape must be a HalfSpace, Sphere, Cylinder, LevelSet or RigidSurface"
            )
        self.shape = shape
        self.mark = shape.mark
        self.name = name
        self.about = _point(about, name)
        self.dim = len(self.about)
        self.components = COMPONENTS[self.dim]
        known: dict[str, Any] = {}
        loads, motions = (_mapping(m, name) for m in (load, motion))
        zeros = [dict.fromkeys(_names(words, name), 0.0) for words in (free, held)]
        for part in (loads, zeros[0], motions, zeros[1]):
            for component, value in part.items():
                if component not in self.components:
                    names = ", ".join(self.components)
                    raise ValueError(f"{name}: unknown component {component!r}; known: {names}")
                if component in known:
                    raise ValueError(f"{name}: the component {component} is given twice")
                known[component] = _scalar(value, f"{name}: what is given for {component}")
        missing = [c for c in self.components if c not in known]
        if missing:
            raise ValueError(
                f"{name}: not given: {', '.join(missing)}: a component has a load or a "
                "motion, or is named in free or held"
            )
        prescribed = {**motions, **zeros[1]}
        self.given: Mapping[str, Any] = MappingProxyType(known)
        self.fixed = np.array([c in prescribed for c in self.components])
        for array in (self.about, self.fixed):
            array.flags.writeable = False
        self.values: Array = np.zeros(len(self.components))
        self._places: list[tuple[fem.Constant, fem.Constant]] = []
        self._expressions: list[
            tuple[Any, Any]
        ] = []  # loads and motions, given and without derivatives

    @property
    def displacement(self) -> Array:
        """Displacement of the reference point (dim,)."""
        return self.values[: self.dim]

    @property
    def rotation(self) -> Array:
        """Rotation about the reference point: (1,) in 2D, (3,) in 3D."""
        return self.values[self.dim :]

    @property
    def expressions(self) -> list[Any]:
        """Loads and motions in UFL, component by component."""
        return [self.given[c] for c in self.components]

    # -- obstacle --------------------------------------------------------------------------------

    @property
    def flat(self) -> bool:
        return bool(self.shape.flat and not self.turns)

    @property
    def outline(self) -> Outline | None:
        return self.shape.outline

    @property
    def turns(self) -> bool:
        """Whether it may turn."""
        given = self.expressions[self.dim :]
        held = all(isinstance(e, ufl.constantvalue.Zero) for e in given)
        return not (held and self.fixed[self.dim :].all())

    @property
    def turns_freely(self) -> bool:
        """Whether a rotation of it is found, not prescribed."""
        return not bool(self.fixed[self.dim :].all())

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        self._check(domain)
        return self.shape.at(domain, x)

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        self._check(domain)
        return self.shape.on(domain)

    def fields(self, domain: mesh.Mesh) -> list[Any]:
        return self.shape.fields(domain)

    @property
    def radius_given(self) -> Any:
        return self.shape.radius_given

    def _check(self, domain: mesh.Mesh) -> None:
        """Raise ``ValueError`` if the body does not fit a mesh. Not collective."""
        if domain.geometry.dim != self.dim:
            raise ValueError(
                f"{self.name}: the reference point has {self.dim} components, the mesh "
                f"{domain.geometry.dim}"
            )
        for component, e in self.given.items():
            refuse_other_mesh(e, domain, f"{self.name}: what is given for {component}")

    def gap_of(self, shape: Obstacle, domain: mesh.Mesh, x: Any) -> Any | None:
        """UFL gap at a UFL point where the body is since `place`; None if the shape has none.

        The rotation is that of a finite angle.

        Args:
            shape: of the body, as it is to what is at the point.
            domain: mesh of the deformable body.
            x: the point.
        """
        shift, turn = (fem.Constant(domain, m) for m in (np.zeros(self.dim), np.eye(self.dim)))
        about = ufl.as_vector(self.about.tolist())
        gap = gap_at(shape, domain, about + turn * (x - about - shift))
        if gap is not None:
            self._places.append((shift, turn))
        return gap

    def place(self) -> None:
        """Let the gaps of `gap_of` follow `values`."""
        turned = self.frame(self.values).T
        for shift, turn in self._places:
            shift.value = self.displacement
            turn.value = turned

    # -- motions of any size ---------------------------------------------------------------------

    def frame(self, values: Array) -> Array:
        """Q (dim, dim) of displacement and rotation (k,); of several of these (n, k) likewise."""
        rotation = values[..., self.dim :]
        vector = np.zeros((*rotation.shape[:-1], 3))
        if not vector.size:
            return np.zeros((0, self.dim, self.dim))
        vector[..., 3 - rotation.shape[-1] :] = rotation
        turned = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
        return np.asarray(turned[..., : self.dim, : self.dim])

    def seen(self, x: Array, values: Array) -> Array:
        """Places (n, dim) in the frame of the body, which has moved, of points that are at x.

        Args:
            x: (n, dim).
            values: displacement and rotation (k,), or those of each point (n, k).
        """
        arm = x - self.about - values[..., : self.dim]
        turned = self.frame(values)
        if values.ndim == 1:
            return np.asarray(self.about + arm @ turned)
        return np.asarray(self.about + np.einsum("ni,nij->nj", arm, turned))

    def carried(self, x: Array, values: Array) -> Array:
        """Displacements (n, dim) of material points that were at x, by a motion of any size."""
        arm = x - self.about
        return np.asarray(values[: self.dim] + arm @ self.frame(values).T - arm)

    def spin(self, values: Array) -> Array:
        """L (k, k), from rates of the rotation to those at which the body turns."""
        if self.dim == 2:
            return np.eye(1)
        vector = values[self.dim :]
        angle = float(np.linalg.norm(vector))
        S = np.cross(np.eye(3), vector)
        if angle < _SMALL_ANGLE:
            return np.eye(3) + S / 2 + S @ S / 6
        first = (1 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
        return np.asarray(np.eye(3) + first * S + second * S @ S)

    def rate(self, x: Array, values: Array, change: Array) -> Array:
        """Velocities (n, dim) of material points that are at x now, as the motion changes."""
        turning = self.spin(values) @ change[self.dim :]
        arm = x - self.about - values[: self.dim]
        return np.asarray(change[: self.dim] + self.crossed(turning, arm))

    def crossed(self, turning: Array, v: Array) -> Array:
        """The products w x v with vectors (n, dim)."""
        if self.dim == 2:
            return np.asarray(turning * np.stack([-v[:, 1], v[:, 0]], axis=1))
        return np.asarray(np.cross(turning, v))

    # -- rigid motions ---------------------------------------------------------------------------

    def field(self, x: Array, values: Array) -> Array:
        """Phi q: displacements (n, dim) at points (n, dim) of a motion q."""
        arm = x - self.about
        return np.asarray(values[: self.dim] + self.crossed(values[self.dim :], arm))

    def resultant(self, x: Array, forces: Array, moved: Array | None = None) -> Array:
        """Phi^T f: force, and moment about the reference point, of forces (n, dim) at points.

        Args:
            x: where they act (n, dim).
            forces: (n, dim).
            moved: displacement of the reference point (dim,); None for zero.
        """
        arm = x - (self.about if moved is None else self.about + moved)
        if self.dim == 2:
            moments: Array = (arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0])[:, None]
        else:
            moments = np.asarray(np.cross(arm, forces), dtype=np.float64)
        return np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])

    def moves(self, x: Array) -> npt.NDArray[np.bool_]:
        """Components of the displacement at points (n, dim) that a free component moves."""
        arm = np.linalg.norm(x - self.about, axis=1)
        size = float(np.max(arm, initial=0.0)) or 1.0
        found = np.zeros(x.shape, dtype=bool)
        for i in np.flatnonzero(~self.fixed):
            unit = np.zeros(len(self.values))
            unit[i] = 1.0 if i < self.dim else 1.0 / size
            found |= np.abs(self.field(x, unit)) > _TOLERANCE
        return found

    def numbers(self) -> Array:
        """Loads and motions as they are now, component by component."""
        return np.array([number(e) for e in self._plain()])

    def _plain(self) -> list[Any]:
        """Loads and motions without derivatives, which take time and are taken once."""
        given = self.expressions
        same = len(self._expressions) == len(given) and all(
            e is known for e, (known, _) in zip(given, self._expressions, strict=True)
        )
        if not same:
            self._expressions = [(e, ufl.algorithms.expand_derivatives(e)) for e in given]
        return [plain for _, plain in self._expressions]

    def described(self) -> str:
        """What is to be the same on every rank."""
        given = {c: float(v) for c, v in zip(self.components, self.numbers(), strict=True)}
        return f"{self.name} about {self.about.tolist()}, {given}, held {self.fixed.tolist()}"


_SMALL_ANGLE = 1e-4  # up to which L is a series
_TOLERANCE = 1e-9  # of a unit motion, below which a point is where it was


def number(e: Any) -> float:
    """The value of a UFL scalar of Constants, in which no derivative is left to be taken."""
    if isinstance(e, ufl.constantvalue.ScalarValue | ufl.constantvalue.Zero):
        return float(e)
    known = {c: _value(c) for c in extract_constants(e)}
    return float(e.evaluate(None, known, (), StackDict()))


def _value(c: fem.Constant) -> Any:
    values = np.asarray(c.value, dtype=np.float64)
    return float(values) if values.shape == () else _nested(values.tolist())


def _nested(values: Any) -> Any:
    return tuple(_nested(v) for v in values) if isinstance(values, list) else values


def _point(about: Any, name: str) -> Array:
    if isinstance(about, ufl.core.expr.Expr) or has_ufl(about):
        raise ValueError(
            f"{name}: the reference point is copied, and must be numbers, got {about!r}; what is "
            "to move the body is its motion"
        )
    return vector(about, f"{name}: the reference point", 3 if np.size(about) == 3 else 2)


def _mapping(given: Any, name: str) -> dict[str, Any]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ValueError(f"{name}: loads and motions go by component, {{'y': -1.0}}; got {given!r}")
    return dict(given)


def _names(given: Any, name: str) -> list[str]:
    words = [word(w, f"{name}: a component") for w in listed(given, f"{name}: free and held")]
    if len(set(words)) < len(words):
        raise ValueError(f"{name}: a component is named twice in {given!r}")
    return words


def _scalar(value: Any, what: str) -> Any:
    """A load or motion as a UFL scalar of Constants, or ``ValueError``."""
    value = ufl.as_ufl(scalar(value, what))
    position = any(isinstance(t, ufl.geometry.GeometricQuantity) for t in _terminals(value))
    if ufl.algorithms.extract_coefficients(value) or position:
        raise ValueError(f"{what} may contain Constants, but neither Functions nor the position")
    return value


def _terminals(e: Any) -> list[Any]:
    return [t for t in ufl.corealg.traversal.unique_pre_traversal(e) if not t.ufl_operands]
