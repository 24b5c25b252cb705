# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Unilateral contact with friction at a point, by augmented multipliers with explicit status.

With n the unit normal from the body into the obstacle, u_n = u.n - g, u_t the tangential
displacement and lambda the traction on the body, the augmented pressure and shear are

    p = -(lambda_n - r u_n),    s = lambda_t - r u_t,

and Signorini's conditions with a friction disc of radius b(p) read (Alart and Curnier, CMAME 92,
1991, eq. 3.7)

    lambda_n + max(p, 0) = 0,    lambda_t = projection of s on the disc of radius b(max(p, 0)).

The three cases of each projection are written with status coefficients instead of conditionals:
held, they give one smooth piece of the equation; recomputed from the solution (`classify`), they
give the nonsmooth equation, and `ufl.derivative` an element of its generalised Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact.laws.friction import FrictionLaw

__all__ = ["Augmented", "Status", "augment", "classify", "projection"]


@dataclass(frozen=True)
class Augmented:
    """UFL quantities at a contact point on which everything else rests.

    Attributes:
        n: unit normal, from the body into the obstacle.
        t: unit tangent (-n_y, n_x) in 2D, None in 3D.
        u_n: penetration u.n - g (the negative gap).
        u_t: tangential displacement, a vector.
        p: augmented pressure.
        s: augmented shear, a vector.
    """

    n: Any
    t: Any
    u_n: Any
    u_t: Any
    p: Any
    s: Any


@dataclass(frozen=True)
class Status:
    """Status of a set of contact points, one entry a point.

    Attributes:
        active: 1.0 where the point is in contact, else 0.0.
        stick: 1.0 where the tangential displacement is held, else 0.0.
        slip: where the tangential traction is at its bound, the sign of s.t in 2D and 1.0 in 3D;
            else 0.0. A slip with u_t > 0 has s.t < 0.
    """

    active: npt.NDArray[np.float64]
    stick: npt.NDArray[np.float64]
    slip: npt.NDArray[np.float64]

    def letters(self, dim: int) -> npt.NDArray[np.str_]:
        """One letter a point: ``o`` open, ``k`` stick, ``+``/``-`` slip (2D), ``s`` slip (3D).

        ``+`` is a slip with u_t > 0. A closed point that nothing grips counts as slipping.
        """
        sliding = np.where(self.slip > 0, "-", "+") if dim == 2 else "s"
        return np.where(self.active > 0, np.where(self.stick > 0, "k", sliding), "o")

    def differs(self, other: Status) -> npt.NDArray[np.bool_]:
        """Points whose status is not that of ``other``."""
        return (
            (self.active != other.active) | (self.stick != other.stick) | (self.slip != other.slip)
        )

    def where(self, mask: npt.NDArray[np.bool_], other: Status) -> Status:
        """This status where ``mask`` is true, ``other`` elsewhere."""
        return Status(
            np.where(mask, self.active, other.active),
            np.where(mask, self.stick, other.stick),
            np.where(mask, self.slip, other.slip),
        )


def augment(lmbda: Any, jump: Any, gap: Any, n: Any, r: Any, dim: int) -> Augmented:
    """Augmented pressure and shear of the traction ``lmbda`` and the displacement ``jump``."""
    u_n = ufl.dot(jump, n) - gap
    u_t = jump - ufl.dot(jump, n) * n
    lambda_n = ufl.dot(lmbda, n)
    lambda_t = lmbda - lambda_n * n
    t = ufl.as_vector([-n[1], n[0]]) if dim == 2 else None
    return Augmented(n, t, u_n, u_t, p=-(lambda_n - r * u_n), s=lambda_t - r * u_t)


def projection(a: Augmented, law: FrictionLaw, active: Any, stick: Any, slip: Any) -> Any:
    """UFL traction on the body that the law answers to ``a``, for a given status."""
    pressure = active * a.p
    bound = law.bound(pressure)
    if a.t is not None:
        direction = slip * a.t
    else:
        # Regular where the point does not slip, and exact where it does.
        direction = slip * a.s / ufl.sqrt(ufl.dot(a.s, a.s) + (1.0 - slip))
    return -pressure * a.n + stick * a.s + bound * direction


def classify(
    p: npt.NDArray[np.float64],
    s: npt.NDArray[np.float64],
    bound: npt.NDArray[np.float64],
    law: FrictionLaw,
    dim: int,
) -> Status:
    """Status of contact points from the values of p, s and b(p) there.

    Args:
        p: augmented pressures.
        s: augmented shears, s.t in 2D and |s| in 3D.
        bound: radii b(p) of the friction disc.
        law: the friction law.
        dim: 2 or 3.

    At p = 0 a point is open; where the radius vanishes nothing is held.
    """
    active = p > 0
    grips = active if law.needs_pressure else np.ones_like(active)
    stick = grips & (np.abs(s) <= bound) & (bound > 0)
    slip = grips & ~stick
    sign = np.sign(s) if dim == 2 else (np.abs(s) > 0).astype(float)
    return Status(active.astype(float), stick.astype(float), np.where(slip, sign, 0.0))
