# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Reduced problem: a body condensed onto its contact points, with the contact laws.

Each of the m contact points has the unknown displacement a = (ut, un), with one or two tangential
components ut and the gap un, and the unknown force r = (rt, rn) on the body, with the tangential
force rt and the normal force rn. With the stiffness S condensed onto these points and the load p,

    S a = r + p,    0 <= un, 0 <= rn, un rn = 0,    |rt| <= F rn + g,    rt = -(F rn + g) ut/|ut|.

F is Coulomb's coefficient and g a prescribed friction bound (Tresca). un = 0 means that the point
is in contact; the initial gap is contained in p. With an augmentation parameter k (the stiffness of
a point), the laws are equations (`laws.coulomb`), whose residual is measured as in Newton's method
(`equations.measures`). `reduced.Reduction` condenses a body to a `PointProblem`; algorithms solve
it, and certificates refer to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact._validate import nonnegative
from dolfinx_contact.equations.measures import Measures
from dolfinx_contact.laws import coulomb

__all__ = ["PointProblem"]

#: Eigenvalues that count as zero, relative to the largest diagonal entry times the size.
_SINGULAR = 10 * 2.0**-52
_HALVED = 5 * 2.0**-53 / (1 - 5 * 2.0**-53)  # relative round-off of a mean of two numbers
_ORTHOGONAL = 1e-8
_ROUND_OFF = 1e-4  # smallest scale of forces, relative to stiffness times displacement


@dataclass(frozen=True, eq=False)
class PointProblem:
    """Reduced contact problem S a = r + p with Signorini's conditions and friction, 2D or 3D.

    For m points, a contains the tangential displacements ut and the gaps un, and r the tangential
    and normal forces rt and rn on the body.

    Args:
        S: stiffness, ordered point by point, tangents before the normal; symmetric and positive
            definite, shape (dim m, dim m).
        p: load, shape (dim m,).
        friction: friction coefficients F >= 0, shape (m,).
        bound: prescribed friction bounds g >= 0, added to F rn; forces, shape (m,); default zero.
        augmentation: augmentation parameters, force per length, shape (m,); by default the mean
            diagonal entry of S at each point.
        force: scale of forces in relative residuals if no contact force is larger; by default the
            largest entry of p.
        length: scale of lengths in relative residuals if no displacement is larger; by default the
            largest displacement without contact.
        positions: coordinates of the points, shape (m, any); optional.
        gap: initial gaps, contained in p, lengths, shape (m,); None if not condensed from a body.
        frames: orthogonal matrices, shape (m, dim, dim), whose columns are the tangents and minus
            the outward normal, mapping a and r at a point to Cartesian components. None as for
            ``gap``.
        S_error: error bounds of the entries of S, shape (dim m, dim m), or None if unknown. The
            asymmetry of S is added.
        p_error: error bounds of the entries of p, shape (dim m,), or None if unknown.
        rate: derivative of p with respect to the load parameter, shape (dim m,), or None.
        rate_error: error bounds of the entries of ``rate``, shape (dim m,), or None if unknown.

    Raises:
        ValueError: if an argument is not an array of finite numbers of the required shape; if
            friction, a bound or an error is negative; if the augmentation is not positive; if a
            frame is not orthogonal; or if the stiffness is not positive definite beyond round-off.
    """

    S: Array
    p: Array
    friction: Array
    bound: Array = None  # type: ignore[assignment]
    augmentation: Array = None  # type: ignore[assignment]
    force: float = 0.0
    length: float = 0.0
    positions: Array | None = None
    gap: Array | None = None
    frames: Array | None = None
    S_error: Array | None = None
    p_error: Array | None = None
    rate: Array | None = None
    rate_error: Array | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        m = np.size(self.friction)
        if m == 0:
            raise ValueError("a point problem needs a point, but friction is empty")
        dim = 2 if np.size(self.p) == 2 * m else 3
        vector, matrix = (dim * m,), (dim * m, dim * m)
        shapes: dict[str, tuple[int | None, ...]] = {
            **dict.fromkeys(("friction", "bound", "augmentation", "gap"), (m,)),
            **dict.fromkeys(("p", "p_error", "rate", "rate_error"), vector),
            **dict.fromkeys(("S", "S_error"), matrix),
            "positions": (m, None),
            "frames": (m, dim, dim),
        }
        for name, shape in shapes.items():
            if getattr(self, name) is not None:
                put(self, name, _numbers(name, getattr(self, name), shape))
        if self.bound is None:
            put(self, "bound", np.zeros(m))
        for name in ("friction", "bound", "S_error", "p_error", "rate_error"):
            value = getattr(self, name)
            if value is not None and (value < 0).any():
                raise ValueError(f"{name} must not be negative")
        if self.augmentation is not None and not (self.augmentation > 0).all():
            raise ValueError("augmentation must be positive")
        for name in ("force", "length"):
            nonnegative(getattr(self, name), name)
        if self.frames is not None:
            away = self.frames @ self.frames.transpose(0, 2, 1) - np.eye(dim)
            if np.abs(away).max() > _ORTHOGONAL:
                raise ValueError("frames must be orthogonal matrices")
        if self.S_error is not None:
            away = np.abs(self.S - self.S.T) + _HALVED * np.abs(self.S) * (self.S != self.S.T)
            put(self, "S_error", np.maximum(self.S_error, self.S_error.T) + away)
        put(self, "S", 0.5 * (self.S + self.S.T))
        # S is singular for a body without supports; its smallest eigenvalues are then round-off.
        round_off = _SINGULAR * len(self.S) * float(np.abs(np.diag(self.S)).max())
        try:
            np.linalg.cholesky(self.S - round_off * np.eye(len(self.S)))
        except np.linalg.LinAlgError:
            raise ValueError("the reduced stiffness is not positive definite") from None
        if self.augmentation is None:
            put(self, "augmentation", np.diag(self.S).reshape(m, -1).mean(axis=1))
        put(self, "force", self.force or float(np.abs(self.p).max()) or 1.0)
        free = float(np.abs(self.free).max()) or self.force / float(np.diag(self.S).mean())
        put(self, "length", self.length or free)

    @property
    def number(self) -> int:
        """Number m of contact points."""
        return len(self.friction)

    @property
    def dim(self) -> int:
        """Spatial dimension, 2 or 3."""
        return len(self.p) // self.number

    @cached_property
    def A(self) -> Array:
        """Compliance, the inverse of the stiffness, shape (dim m, dim m) for m points."""
        inverse = np.linalg.inv(self.S)
        return np.asarray(0.5 * (inverse + inverse.T))

    @cached_property
    def longest(self) -> float:
        """Largest eigenvalue of the compliance matrix, in units of length per force."""
        return float(1.0 / np.linalg.eigvalsh(self.S)[0])

    @cached_property
    def free(self) -> Array:
        """Displacements of the points without contact forces, shape (m, dim)."""
        return np.asarray(np.linalg.solve(self.S, self.p).reshape(self.number, -1), np.float64)

    @cached_property
    def blocks(self) -> Array:
        """Diagonal block of the stiffness for each point, shape (m, dim, dim)."""
        m = self.number
        d = self.dim
        every = np.arange(m)
        return np.asarray(self.S.reshape(m, d, m, d)[every, :, every])

    def forces(self, a: Array) -> Array:
        """Return the forces S a - p that cause displacements a, both of shape (m, dim).

        S is the stiffness and p the load.
        """
        return (self.S @ a.reshape(-1) - self.p).reshape(a.shape)

    def displacements(self, r: Array) -> Array:
        """Return the displacements S^-1 (r + p) under forces r, both of shape (m, dim).

        S is the stiffness and p the load.
        """
        return np.asarray((self.A @ r.reshape(-1)).reshape(r.shape) + self.free)

    def given(self, bound: Array) -> PointProblem:
        """Return the same problem with Tresca friction, i.e. with prescribed friction bounds.

        Args:
            bound: friction bounds, forces, shape (m,).
        """
        found = object.__new__(PointProblem)
        found.__dict__.update(self.__dict__)
        found.__dict__.update(friction=np.zeros(self.number), bound=bound)
        return found

    # -- the laws --------------------------------------------------------------------------------

    def radius(self, rn: Array) -> Array:
        """Return the friction bounds of the points at normal forces rn, both of shape (m,)."""
        return coulomb.radius(rn, self.friction, self.bound)

    def allowed(self, r: Array) -> Array:
        """Project the normal force onto rn >= 0, then the tangential force onto its friction disc.

        Args:
            r: forces, shape (m, dim).
        """
        return coulomb.allowed(r, self.friction, self.bound)

    def derivative(self, s: Array) -> Array:
        """Return generalised derivatives of `allowed` at forces s, shape (m, dim, dim)."""
        return coulomb.derivative(s, self.friction, self.bound)

    def augmented(self, a: Array, r: Array) -> Array:
        """Return the augmented forces r - k a for which laws are evaluated, shape (m, dim).

        k is the parameter `augmentation`, a the displacements and r the forces on the body.
        """
        return r - self.augmentation[:, None] * a

    def answer(self, a: Array, r: Array, k: Array | None = None) -> Array:
        """Return the admissible forces (`allowed`) for augmented forces r - k a, shape (m, dim).

        They are equal to r at a solution.

        Args:
            a: displacements, shape (m, dim).
            r: forces on the body, shape (m, dim).
            k: augmentation parameters, force per length, shape (m,); default: `augmentation`.
        """
        k = self.augmentation if k is None else k
        return self.allowed(r - k[:, None] * a)

    def closed(self, a: Array, r: Array) -> Mask:
        """Return a mask of the points in contact, shape (m,), at displacements a and forces r."""
        return coulomb.closed(self.augmented(a, r))

    def stuck(self, a: Array, r: Array) -> Mask:
        """Return a mask of sticking points, shape (m,), at displacements a and forces r."""
        return coulomb.stuck(self.augmented(a, r), self.friction, self.bound)

    def statuses(self, a: Array, r: Array) -> Codes:
        """Return status codes (`laws.status`), shape (m,), at displacements a and forces r."""
        return coulomb.statuses(self.augmented(a, r), self.friction, self.bound)

    def measure(self, a: Array, r: Array, force: float, length: float) -> Measures:
        """Return the residuals of a state relative to scales of force and length (`Measures`)."""
        # In soft directions, forces are small differences of large products.
        force = max(force, _ROUND_OFF * float(self.S.diagonal().mean()) * length)
        off = r - self.answer(a, r)
        closed = self.closed(a, r)
        stuck = self.stuck(a, r)
        along = np.abs(off[:, -1])
        across = np.linalg.norm(off[:, :-1], axis=1)
        lengths = np.where(closed, along, 0.0), np.where(closed | stuck, across, 0.0)
        sizes = np.where(closed, 0.0, along), np.where(stuck, 0.0, across)
        balance = np.abs(self.forces(a) - r)
        return Measures(
            float(balance.max()) / force,
            float(np.max(np.maximum(*lengths) / self.augmentation)) / length,
            float(np.max(np.maximum(*sizes))) / force,
        )

    def scaled(self) -> tuple[PointProblem, float, float]:
        """Return the problem in dimensionless form, and its units of stiffness and length."""
        stiffness = float(np.diag(self.S).mean())
        length = float(np.abs(self.free).max()) or 1.0
        force = stiffness * length
        changed = PointProblem(
            np.asarray(self.S / stiffness, np.float64),
            np.asarray(self.p / force, np.float64),
            self.friction,
            np.asarray(self.bound / force, np.float64),
            np.asarray(self.augmentation / stiffness, np.float64),
            self.force / force,
            self.length / length,
        )
        return changed, stiffness, length


def _numbers(name: str, values: Any, shape: tuple[int | None, ...]) -> Array:
    """Return ``values`` as a finite float64 array; raise ``ValueError`` for another shape.

    Args:
        name: name of the argument, for the message.
        values: value of the argument.
        shape: required shape; an entry None admits any length along its axis.
    """
    try:
        found = np.asarray(values).astype(np.float64, casting="same_kind")
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be an array of numbers, got {values!r}") from None
    fits = found.ndim == len(shape) and all(
        k is None or n == k for n, k in zip(found.shape, shape, strict=True)
    )
    if not fits:
        wanted = str(shape).replace("None", "any")
        raise ValueError(f"{name} must have the shape {wanted}, not {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} is not finite")
    return found
