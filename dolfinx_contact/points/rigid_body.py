# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies as contact partners: obstacles moved by forces, moments or prescribed motions.

A rigid body has a few unknowns, a displacement d and a rotation theta about a reference point X_0.
If both are small, its material point X moves by

    Phi(X) q = d + theta x (X - X_0),    q = (d, theta).

In large sliding (`displaced`), where rotations are prescribed, X moves to
X_0 + d + Q(theta) (X - X_0), where Q is the rotation by any angle with the rotation vector theta.
If theta changes at the rate dtheta, the spin (angular velocity) is

    w = L(theta) dtheta,    L = I + (1 - cos a)/a^2 S + (a - sin a)/a^3 S^2,    a = |theta|,

with S v = theta x v, and L = 1 in 2D (Simo and Vu-Quoc, CMAME 58, 1986, section 3).

Jumps B (u - Phi q) are relative to the rigid body, where u is the displacement of the deformable
body and B maps displacements to jumps at the contact points. In the components of q that are not
prescribed, the tractions t at the contact points with the areas W balance the loads F on the rigid
body, F = Phi^T B^T W t (Wriggers, Computational Contact Mechanics, 2006, section 5.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

import ufl
from dolfinx import mesh
from ufl.algorithms.analysis import extract_constants
from ufl.utils.stacks import StackDict

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import along_tangent, plane_tangents
from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import ReadOnly, listed, scalar, vector, word, word_in_history
from dolfinx_contact.obstacles import Obstacle, Outline, has_ufl, is_uniform

__all__ = ["COMPONENTS", "Partner", "RigidBody", "RigidKinematics", "number", "shape_of"]

_SMALL_ANGLE = 1e-4  # angle up to which L is a series
_TOLERANCE = 1e-9  # displacement by a unit motion below which a point does not move
#: Names of the components of a rigid motion, by dimension.
COMPONENTS = {2: ("x", "y", "rz"), 3: ("x", "y", "z", "rx", "ry", "rz")}


@dataclass(frozen=True, eq=False)
class RigidKinematics:
    """Motions of a rigid body about a reference point.

    A motion is an array of the displacement of the reference point and the rotation about it, shape
    (k,), with k = 3 in 2D and k = 6 in 3D.

    Attributes:
        about: reference point, shape (dim,).
    """

    about: Array

    @property
    def dim(self) -> int:
        """Spatial dimension, 2 or 3."""
        return len(self.about)

    # -- motions of any size ---------------------------------------------------------------------

    def rotation(self, motion: Array) -> Array:
        """Return the rotation matrix of a motion, shape (dim, dim).

        Args:
            motion: motion of the body, shape (k,), or n motions, shape (n, k), for a result of
                shape (n, dim, dim).
        """
        angles = motion[..., self.dim :]
        vector = np.zeros((*angles.shape[:-1], 3))
        if not vector.size:
            return np.zeros((0, self.dim, self.dim))
        vector[..., 3 - angles.shape[-1] :] = angles
        turned = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
        return turned[..., : self.dim, : self.dim]

    def seen(self, x: Array, motion: Array) -> Array:
        """Return positions in the frame that moves with the body, shape (n, dim).

        Args:
            x: positions in space, shape (n, dim).
            motion: motion of the body, shape (k,), or one for each point, shape (n, k).
        """
        arm = x - self.about - motion[..., : self.dim]
        return self.about + (arm[:, None] @ self.rotation(motion))[:, 0]

    def carried(self, x: Array, motion: Array) -> Array:
        """Return displacements of material points due to a motion of any size, shape (n, dim).

        Args:
            x: initial positions of the material points, shape (n, dim).
            motion: motion of the body, shape (k,).
        """
        arm = x - self.about
        return motion[: self.dim] + arm @ self.rotation(motion).T - arm

    def spin(self, motion: Array) -> Array:
        """Return the matrix from rates of the rotation vector to the spin, shape (1, 1) or (3, 3).

        Args:
            motion: motion of the body, shape (k,).
        """
        if self.dim == 2:
            return np.eye(1)
        vector = motion[self.dim :]
        angle = float(np.linalg.norm(vector))
        S = np.cross(np.eye(3), vector)
        if angle < _SMALL_ANGLE:
            return np.eye(3) + S / 2 + S @ S / 6
        first = (1 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
        return np.eye(3) + first * S + second * S @ S

    def velocity(self, x: Array, motion: Array, rate: Array) -> Array:
        """Return velocities of the points of the moving body at given positions, shape (n, dim).

        Args:
            x: positions in space, shape (n, dim).
            motion: motion of the body, shape (k,).
            rate: rate of the motion, shape (k,).
        """
        turning = self.spin(motion) @ rate[self.dim :]
        arm = x - self.about - motion[: self.dim]
        return rate[: self.dim] + self.crossed(turning, arm)

    def crossed(self, turning: Array, v: Array) -> Array:
        """Return the cross products w x v of a spin w with vectors v, shape (n, dim).

        Args:
            turning: spin w, shape (1,) in 2D and (3,) in 3D.
            v: vectors, shape (n, dim).
        """
        if self.dim == 2:
            return turning * plane_tangents(v)
        return np.asarray(np.cross(turning, v))

    # -- small motions and forces ----------------------------------------------------------------

    def field(self, x: Array, motion: Array) -> Array:
        """Return displacements of points due to a small motion of the body, shape (n, dim).

        Args:
            x: points, shape (n, dim).
            motion: small motion, shape (k,).
        """
        return motion[: self.dim] + self.crossed(motion[self.dim :], x - self.about)

    def resultant(self, x: Array, forces: Array, moved: Array | None = None) -> Array:
        """Return resultant force and moment about the reference point, shape (k,).

        Args:
            x: points of action, shape (n, dim).
            forces: forces, shape (n, dim).
            moved: displacement of the reference point, shape (dim,); None for zero.
        """
        arm = x - (self.about if moved is None else self.about + moved)
        if self.dim == 2:
            moments = along_tangent(forces, arm)[:, None]
        else:
            moments = np.asarray(np.cross(arm, forces), dtype=np.float64)
        return np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])


class RigidBody(ReadOnly, Obstacle):
    """A rigid body moved by loads or by prescribed motions, component by component.

    The components of its motion are the displacements ``x``, ``y`` (``z``) of the reference point
    and the rotations ``rz`` (``rx``, ``ry``, ``rz``) about it. Each component is either free, with
    a load (a force, or a moment about the reference point), or prescribed, with a motion. Values
    are numbers, scalar Constants, or UFL expressions of Constants, which may be changed later. In
    small sliding, the motion is small, and gap and normal belong to the shape in its initial
    position. In large sliding, the shape moves with the body, by displacements of any size and
    prescribed rotations (in 3D, components of the rotation vector); free rotations are small.

    Several contact surfaces may touch one rigid body. Problems with rigid bodies are solved by the
    direct solver; multigrid does not support them.

    Args:
        shape: obstacle in its initial position.
        about: reference point.
        load: forces and moments of free components.
        motion: displacements and rotations (radians) of prescribed components.
        free: names of free components without a load.
        held: names of components whose motion is prescribed as zero.
        name: name in messages and results.

    Attributes:
        shape: obstacle in its initial position.
        name: name in messages and results.
        about: reference point, shape (dim,).
        kinematics: motion of the points of the body.
        components: names of all components.
        given: prescribed load or motion of each component, by name.
        fixed: mask of the prescribed components, shape (3,) or (6,).
        values: displacement and rotation of the last solution, the start of the next solve, shape
            (3,) or (6,). Each problem should have a rigid body of its own, because the last solve
            of any problem sets the values. All other attributes are read-only; use Constants for
            loads and motions that are to change.

    Raises:
        ValueError: if a component is missing, repeated or unknown, or a value is neither a finite
            number nor a UFL scalar.
        AttributeError: if an attribute is set afterwards.
    """

    _may_be_set = ("values",)
    _advice = (
        "loads and motions that are to change are Constants of the mesh, load={'y': force} and "
        "force.value = -2.0; otherwise make another rigid body, surface and problem"
    )

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
        word_in_history(name, "the name of a rigid body")
        if not isinstance(shape, Obstacle) or isinstance(shape, RigidBody) or shape.opposite:
            raise ValueError(
                f"{name}: its shape must be a HalfSpace, Sphere, Cylinder, LevelSet or RigidSurface"
            )
        self.shape = shape
        self.mark = shape.mark
        self.name = name
        if isinstance(about, ufl.core.expr.Expr) or has_ufl(about):
            raise ValueError(
                f"{name}: the reference point is copied and must be given as numbers, got "
                f"{about!r}; prescribe a motion to move the body"
            )
        self.about = vector(about, f"{name}: the reference point")
        self.dim = len(self.about)
        self.components = COMPONENTS[self.dim]
        prescribed = _by_component(motion, held, name)
        data = (*_by_component(load, free, name), *prescribed)
        names = [word(component, f"{name}: a component") for component, _ in data]
        if sorted(names) != sorted(self.components):
            raise ValueError(
                f"{name}: each of the components {', '.join(self.components)} needs one load or "
                "motion, or its name in free or held; got " + (", ".join(names) or "none")
            )
        self.given: Mapping[str, Any] = MappingProxyType(
            {c: _scalar(value, f"{name}: the load or motion {c}") for c, value in data}
        )
        fixed = {component for component, _ in prescribed}
        self.fixed = np.array([c in fixed for c in self.components])
        for array in (self.about, self.fixed):
            array.flags.writeable = False
        self.kinematics = RigidKinematics(self.about)
        self.values: Array = np.zeros(len(self.components))
        # derivatives are expanded once, which takes time
        self._plain = [ufl.algorithms.expand_derivatives(e) for e in self.expressions]

    @property
    def displacement(self) -> Array:
        """Displacement of the reference point, shape (dim,)."""
        return self.values[: self.dim]

    @property
    def rotation(self) -> Array:
        """Rotation about the reference point in radians, shape (1,) in 2D and (3,) in 3D."""
        return self.values[self.dim :]

    @property
    def expressions(self) -> list[Any]:
        """Loads and prescribed motions in UFL, one per component."""
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
        """Whether the body may rotate."""
        given = self.expressions[self.dim :]
        still = all(isinstance(e, ufl.constantvalue.Zero) for e in given)
        return not (still and self.fixed[self.dim :].all())

    @property
    def fixed_across_axis(self) -> bool:
        """Whether the body can move only along the axis of revolution x = 0."""
        zero = [isinstance(e, ufl.constantvalue.Zero) for e in self.expressions]
        return bool(self.fixed[0] and zero[0] and self.fixed[2] and zero[2])

    @property
    def turns_freely(self) -> bool:
        """Whether a rotation component of the body is free."""
        return not bool(self.fixed[self.dim :].all())

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        return self.shape.at(domain, x)

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        self._check(domain)
        return self.shape.on(domain)

    def _check(self, domain: mesh.Mesh) -> None:
        """Raise ``ValueError`` if the body does not fit a mesh. Not collective."""
        if domain.geometry.dim != self.dim:
            raise ValueError(
                f"{self.name}: the reference point has {self.dim} components, the mesh "
                f"{domain.geometry.dim}"
            )
        for component, e in self.given.items():
            refuse_other_mesh(e, domain, f"{self.name}: the load or motion {component}")

    # -- motions ---------------------------------------------------------------------------------

    def moves(self, x: Array) -> Mask:
        """Return the mask of components in which free motions can displace points, shape (n, dim).

        Args:
            x: points, shape (n, dim).
        """
        arm = np.linalg.norm(x - self.about, axis=1)
        size = float(np.max(arm, initial=0.0)) or 1.0
        found = np.zeros(x.shape, dtype=bool)
        for i in np.flatnonzero(~self.fixed):
            unit = np.zeros(len(self.values))
            unit[i] = 1.0 if i < self.dim else 1.0 / size
            found |= np.abs(self.kinematics.field(x, unit)) > _TOLERANCE
        return found

    def numbers(self) -> Array:
        """Return the current values of the loads and prescribed motions, one per component."""
        return np.array([number(e) for e in self._plain])

    def described(self) -> str:
        """Return a text with the data of the body that must be the same on every rank."""
        given = {c: float(v) for c, v in zip(self.components, self.numbers(), strict=True)}
        return f"{self.name} about {self.about.tolist()}, {given}, held {self.fixed.tolist()}"


@dataclass(frozen=True, eq=False)
class Partner:
    """Obstacle of a surface as the frame of reference for displacements of the body.

    Attributes:
        body: rigid body; None if the obstacle is not a rigid body.
        x: positions of the local nodes of the displacement, shape (nodes, dim).
        turns: whether the frame rotates with the rigid body, by any angle.
    """

    body: RigidBody | None
    x: Array
    turns: bool

    def relative(self, u: Array, motion: Array | None) -> Array:
        """Return displacements relative to the rigid body; unchanged without a rigid body.

        Args:
            u: displacement at the first n local nodes, shape (n, dim).
            motion: motion of the rigid body, shape (k,).
        """
        if self.body is None:
            return u
        assert motion is not None
        x = self.x[: len(u)]
        rigid = self.body.kinematics
        return rigid.seen(x + u, motion) - x if self.turns else u - rigid.field(x, motion)

    def relative_rate(
        self, u: Array, motion: Array | None, du: Array, change: Array | None
    ) -> Array:
        """Return the derivative of `relative` along a motion of both bodies, shape (n, dim).

        It does not include the rotation of the frame.

        Args:
            u: displacement at the first n local nodes, shape (n, dim).
            motion: motion of the rigid body, shape (k,).
            du: direction of the derivative with respect to the displacement, shape (n, dim).
            change: direction of the derivative with respect to the motion, shape (k,).
        """
        if self.body is None or not self.turns:
            return self.relative(du, change)
        assert motion is not None
        assert change is not None
        x = self.x[: len(u)] + u
        return du - self.body.kinematics.velocity(x, motion, change)

    def rotation(self, motion: Array | None) -> Array | None:
        """Return the rotation of the frame, shape (dim, dim); None if it does not rotate."""
        if self.body is None or motion is None or not self.turns:
            return None
        return self.body.kinematics.rotation(motion)

    def dragged(self, x: Array) -> Array:
        """Return current displacements of the rigid body at points, 0 without one, shape (n, dim).

        Args:
            x: points, shape (n, dim).
        """
        if self.body is None:
            return np.zeros_like(x)
        rigid, motion = self.body.kinematics, self.body.values
        return rigid.carried(x, motion) if self.turns else rigid.field(x, motion)


def shape_of(obstacle: Obstacle) -> Obstacle:
    """Return the shape of a rigid body; return any other obstacle unchanged."""
    return obstacle.shape if isinstance(obstacle, RigidBody) else obstacle


def number(e: Any) -> float:
    """Return the value of a UFL scalar that contains only Constants and no derivatives."""
    if isinstance(e, ufl.constantvalue.ScalarValue | ufl.constantvalue.Zero):
        return float(e)
    known = {c: np.asarray(c.value, dtype=np.float64)[()] for c in extract_constants(e)}
    return float(e.evaluate(None, known, (), StackDict()))


def _by_component(values: Any, zeros: Any, name: str) -> list[tuple[str, Any]]:
    """Return the names of components and their loads or motions, 0 for the names in ``zeros``."""
    if values is not None and not isinstance(values, Mapping):
        raise ValueError(
            f"{name}: loads and motions go by component, {{'y': -1.0}}; got {values!r}"
        )
    return [
        *dict(values or {}).items(),
        *((c, 0.0) for c in listed(zeros, f"{name}: free and held")),
    ]


def _scalar(value: Any, what: str) -> Any:
    """Return a load or motion as a UFL scalar of Constants.

    Raises:
        ValueError: if the value is neither a finite number nor such a scalar.
    """
    value = ufl.as_ufl(scalar(value, what))
    if not is_uniform(value):
        raise ValueError(f"{what} may contain Constants, but neither Functions nor the position")
    return value
