# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The contact points alone: equilibrium of a body condensed onto them, and the laws there.

With the stiffness S of a body condensed onto its m contact points, a point's displacement
a = (ut, un) (one or two tangents, then the gap) and force r = (rt, rn) on the body,

    S a = r + p,    0 <= un  against  rn >= 0,    |rt| <= F rn + g,    rt = -(F rn + g) ut/|ut|.

F is Coulomb's coefficient, g a friction bound that is given in advance (Tresca). un is 0 where a
point touches: the gap of the body where nothing moves is in p. With augmentation k (stiffness of a
point) the laws are the equations of `laws.coulomb`; what is left of these is measured as Newton's
method measures it (`equations.measures`).

`reduced.Reduction` makes it of a body; algorithms solve it, and certificates are about it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._validate import is_number
from dolfinx_contact.equations.measures import Measures
from dolfinx_contact.laws import coulomb

__all__ = ["PointProblem"]

Array = npt.NDArray[np.float64]
#: Eigenvalues that are round-off, over the largest entry and the size.
_SINGULAR = 10 * 2.0**-52
_HALVED = 5 * 2.0**-53 / (1 - 5 * 2.0**-53)  # of the round-off of a mean
_ORTHOGONAL = 1e-8
_ROUND_OFF = 1e-4  # of stiffness times displacement, forces beside which none is checked


@dataclass(frozen=True, eq=False)
class PointProblem:
    """S a = r + p with Signorini's conditions and friction at m points, in 2D or 3D.

    Args:
        S: stiffness (dim m, dim m), ordered point by point, tangents before the normal; symmetric
            and positive definite.
        p: load (dim m,).
        friction: coefficients F >= 0 (m,).
        bound: friction bounds g >= 0 beside F rn, forces (m,); by default none.
        augmentation: k (m,), force by length; by default from the diagonal of S.
        force: that counts as 1 in measures, if no contact force is larger.
        length: the same; by default the largest displacement that the load causes.
        positions: of the points (m, any), for the two-level scheme.
        gap: un where nothing moves (m,), lengths; known of a body, whose p has it in it.
        frames: T of Cartesian displacements T a and forces T r on the body, the tangents, then
            minus the outward normal (m, dim, dim); known of a body.
        S_error: by which entries of S may be off (dim m, dim m); None: not known. What S is off
            from its transpose is added.
        p_error: the same of p (dim m,).
        rate: derivative of p by a parameter (dim m,), of a body that has one.
        rate_error: by which entries of it may be off (dim m,).

    Raises:
        ValueError: for what is no array of numbers, shapes that do not fit, numbers that are not
            finite, negative friction, bounds or errors, an augmentation that is not positive, or a
            stiffness that is not positive definite beyond round-off.
    """

    S: Array
    p: Array
    friction: Array
    bound: Array = field(default_factory=lambda: np.zeros(0))
    augmentation: Array = field(default_factory=lambda: np.zeros(0))
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
            raise ValueError("a point problem needs a point; friction has none")
        if not np.size(self.bound):
            put(self, "bound", np.zeros(m))
        for name, shape in self._shapes(m).items():
            if self._is_given(name):
                put(self, name, _numbers(name, getattr(self, name), shape))
        self._check_values()
        if self.S_error is not None:
            away = np.abs(self.S - self.S.T) + _HALVED * np.abs(self.S) * (self.S != self.S.T)
            put(self, "S_error", np.maximum(self.S_error, self.S_error.T) + away)
        put(self, "S", 0.5 * (self.S + self.S.T))
        # Of a body that nothing holds S is singular, and its least eigenvalues are round-off.
        round_off = _SINGULAR * len(self.S) * float(np.abs(np.diag(self.S)).max())
        try:
            np.linalg.cholesky(self.S - round_off * np.eye(len(self.S)))
        except np.linalg.LinAlgError:
            raise ValueError("the reduced stiffness is not positive definite") from None
        if not self._is_given("augmentation"):
            put(self, "augmentation", np.diag(self.S).reshape(m, -1).mean(axis=1))
        put(self, "force", self.force or float(np.abs(self.p).max()) or 1.0)
        free = float(np.abs(self.free).max()) or self.force / float(np.diag(self.S).mean())
        put(self, "length", self.length or free)

    def _shapes(self, m: int) -> dict[str, tuple[int | None, ...]]:
        """Of all arrays by their names; None is any number."""
        dim = 2 if np.size(self.p) == 2 * m else 3
        size = dim * m
        return {
            "friction": (m,),
            "p": (size,),
            "S": (size, size),
            "bound": (m,),
            "augmentation": (m,),
            "positions": (m, None),
            "gap": (m,),
            "frames": (m, dim, dim),
            "S_error": (size, size),
            "p_error": (size,),
            "rate": (size,),
            "rate_error": (size,),
        }

    def _check_values(self) -> None:
        for name in ("friction", "bound", "S_error", "p_error", "rate_error"):
            if self._is_given(name) and (getattr(self, name) < 0).any():
                raise ValueError(f"{name} must not be negative")
        if self._is_given("augmentation") and not (self.augmentation > 0).all():
            raise ValueError("augmentation must be positive")
        for name in ("force", "length"):
            value = getattr(self, name)
            if not is_number(value) or not 0 <= value < np.inf:
                raise ValueError(f"{name} must be a number that is not negative, got {value!r}")
        if self.frames is not None:
            away = self.frames @ self.frames.transpose(0, 2, 1) - np.eye(self.dim)
            if np.abs(away).max() > _ORTHOGONAL:
                raise ValueError("frames must be orthogonal matrices")

    def _is_given(self, name: str) -> bool:
        value = getattr(self, name)
        return value is not None and not (name == "augmentation" and np.size(value) == 0)

    @property
    def number(self) -> int:
        """Of points, m."""
        return len(self.friction)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(self.p) // self.number

    @cached_property
    def A(self) -> Array:
        """The compliance, S^-1."""
        inverse = np.linalg.inv(self.S)
        return np.asarray(0.5 * (inverse + inverse.T))

    @cached_property
    def longest(self) -> float:
        """The largest eigenvalue of the compliance."""
        return float(1.0 / np.linalg.eigvalsh(self.S)[0])

    @cached_property
    def free(self) -> Array:
        """Displacements without contact, (m, dim)."""
        return np.asarray(np.linalg.solve(self.S, self.p).reshape(self.number, -1), np.float64)

    @cached_property
    def blocks(self) -> Array:
        """Stiffness of every point alone (m, dim, dim)."""
        m = self.number
        d = self.dim
        every = np.arange(m)
        return np.asarray(self.S.reshape(m, d, m, d)[every, :, every])

    def forces(self, a: Array) -> Array:
        """The forces r = S a - p at displacements (m, dim)."""
        return (self.S @ a.reshape(-1) - self.p).reshape(a.shape)

    def displacements(self, r: Array) -> Array:
        """The displacements S^-1 (r + p) under forces (m, dim)."""
        return np.asarray((self.A @ r.reshape(-1)).reshape(r.shape) + self.free)

    def given(self, bound: Array) -> PointProblem:
        """Tresca's problem: friction bounds given in advance (m,) and no others."""
        found = object.__new__(PointProblem)
        found.__dict__.update(self.__dict__)
        found.__dict__.update(friction=np.zeros(self.number), bound=bound)
        return found

    # -- the laws --------------------------------------------------------------------------------

    def radius(self, rn: Array) -> Array:
        """Radii of the friction discs at normal forces (m,)."""
        return coulomb.radius(rn, self.friction, self.bound)

    def allowed(self, r: Array) -> Array:
        """Forces (m, dim) projected: rn >= 0, and rt on the disc of that rn."""
        return coulomb.allowed(r, self.friction, self.bound)

    def derivative(self, s: Array) -> Array:
        """Of these by forces s (m, dim), one of a kink where it has several (m, dim, dim)."""
        return coulomb.derivative(s, self.friction, self.bound)

    def augmented(self, a: Array, r: Array) -> Array:
        """The forces r - k a at which the laws are evaluated, (m, dim)."""
        return r - self.augmentation[:, None] * a

    def answer(self, a: Array, r: Array, k: Array | None = None) -> Array:
        """The forces that the laws answer to r - k a, (m, dim)."""
        k = self.augmentation if k is None else k
        return self.allowed(r - k[:, None] * a)

    def closed(self, a: Array, r: Array) -> npt.NDArray[np.bool_]:
        """Which points are closed (m,)."""
        return coulomb.closed(self.augmented(a, r))

    def stuck(self, a: Array, r: Array) -> npt.NDArray[np.bool_]:
        """Which points friction holds (m,)."""
        return coulomb.stuck(self.augmented(a, r), self.friction, self.bound)

    def statuses(self, a: Array, r: Array) -> npt.NDArray[np.int8]:
        """Numbers of the statuses (`laws.status`) of a state (m,)."""
        return coulomb.statuses(self.augmented(a, r), self.friction, self.bound)

    def measure(self, a: Array, r: Array, force: float, length: float) -> Measures:
        """What is left of the equations, over a force and a length."""
        # Where the load moves what hardly resists, forces are small differences of large products.
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

    def energy(self, a: Array) -> float:
        """The energy of Tresca's problem, a.S a/2 - p.a + sum g |ut|, for un >= 0."""
        flat = a.reshape(-1)
        rubbing = float(self.bound @ np.linalg.norm(a[:, :-1], axis=1))
        return float(0.5 * flat @ (self.S @ flat) - self.p @ flat) + rubbing

    def scaled(self) -> tuple[PointProblem, float, float]:
        """The problem with stiffnesses and loads near 1, and its units of stiffness and length."""
        stiffness = float(np.diag(self.S).mean())
        length = float(np.abs(self.free).max()) or 1.0
        force = stiffness * length
        changed = replace(
            self,
            S=np.asarray(self.S / stiffness, np.float64),
            p=np.asarray(self.p / force, np.float64),
            bound=np.asarray(self.bound / force, np.float64),
            augmentation=np.asarray(self.augmentation / stiffness, np.float64),
            force=self.force / force,
            length=self.length / length,
            gap=None,
            S_error=None,
            p_error=None,
            rate=None,
            rate_error=None,
        )
        return changed, stiffness, length


def _numbers(name: str, values: Any, shape: tuple[int | None, ...]) -> Array:
    """An array of finite numbers of a shape, None for any length, or ``ValueError``."""
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
