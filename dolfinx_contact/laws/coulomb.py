# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Laws of Coulomb and Tresca at the points of a reduced problem, on NumPy arrays.

A point has the displacement a = (ut, un), with tangential components first, and the force r = (rt,
rn) on the body. The laws are

    0 <= un, 0 <= rn, un rn = 0,    |rt| <= F rn + g,    rt = -(F rn + g) ut/|ut|.

F is Coulomb's coefficient and g a prescribed bound (Tresca); the last equation applies to slip.
With an augmentation parameter k, force per length, they are equivalent to r = P(r - k a), where P
projects onto rn >= 0 and then onto the disc of radius F rn + g (Alart and Curnier, CMAME 92, 1991).
`friction` contains the same laws in UFL, for any coefficient and status by status. The checker of
proofs (`proofs.check_proof`) is self-contained and repeats them.

In 2D with g = 0 the statuses are cones of w = (ut, un, rt, rn) that depend on F: w = (B_0 + F B_1)
z with (C_0 + F C_1) w >= 0, where z has two components, and the matrices B_0, B_1, C_0 and C_1 of a
status are constant. On the *border* between two statuses one unknown remains: between open and slip
only ut is nonzero; between stick and slip rt is determined by rn.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN

__all__ = [
    "BASES",
    "BORDERS",
    "FIRST_BORDER",
    "INSIDE",
    "WITHOUT_FRICTION",
    "allowed",
    "closed",
    "derivative",
    "project",
    "radius",
    "statuses",
    "stuck",
    "violation",
]

Array = npt.NDArray[np.float64]
_TINY = 1e-300


def radius(rn: Array, friction: Array, bound: Array) -> Array:
    """Return radii F rn + g of friction discs, shape (m,); a negative normal force counts as 0."""
    return np.asarray(friction * np.maximum(rn, 0.0) + bound)


def project(s: Array, radius: Array) -> Array:
    """Project m vectors, shape (m, d), onto discs (intervals if d = 1) with given radii."""
    size = np.linalg.norm(s, axis=1)
    return np.asarray(s * np.minimum(1.0, radius / np.maximum(size, _TINY))[:, None])


def allowed(r: Array, friction: Array, bound: Array) -> Array:
    """Project forces, shape (m, dim), onto normal forces >= 0, then onto the friction disc."""
    rn = np.maximum(r[:, -1], 0.0)
    return np.column_stack([project(r[:, :-1], radius(rn, friction, bound)), rn])


def derivative(s: Array, friction: Array, bound: Array) -> Array:
    """Return a generalised derivative of `allowed` at augmented forces s, shape (m, dim, dim)."""
    m, d = s.shape
    D = np.zeros((m, d, d))
    pushes = s[:, -1] > 0
    D[pushes, -1, -1] = 1.0
    discs = radius(s[:, -1], friction, bound)
    size = np.linalg.norm(s[:, :-1], axis=1)
    inside = size <= discs
    D[inside, :-1, :-1] = np.eye(d - 1) * (discs[inside] > 0)[:, None, None]
    out = ~inside
    e = s[out, :-1] / size[out, None]
    across = np.eye(d - 1) - e[:, :, None] * e[:, None, :]
    D[out, :-1, :-1] = (discs[out] / size[out])[:, None, None] * across
    D[out, :-1, -1] = (friction[out] * pushes[out])[:, None] * e
    return D


def closed(s: Array) -> npt.NDArray[np.bool_]:
    """Return a mask of the closed points, shape (m,), for augmented forces s, shape (m, dim)."""
    return np.asarray(s[:, -1] >= 0)


def stuck(s: Array, friction: Array, bound: Array) -> npt.NDArray[np.bool_]:
    """Return a mask of sticking points, shape (m,), for augmented forces s, shape (m, dim)."""
    pressure = s[:, -1]
    grips = (bound > 0) | ((friction > 0) & (pressure >= 0))
    size = np.linalg.norm(s[:, :-1], axis=1)
    return np.asarray(grips & (size <= radius(pressure, friction, bound)))


def statuses(s: Array, friction: Array, bound: Array) -> npt.NDArray[np.int8]:
    """Return status codes (`laws.status`), shape (m,), for augmented forces s, shape (m, dim)."""
    back = (s[:, 0] > 0) & (s.shape[1] == 2)
    codes = np.where(stuck(s, friction, bound), STICK, np.where(back, MINUS, PLUS))
    rubbing = np.where(bound > 0, codes + WHERE_OPEN, OPEN)
    return np.where(closed(s), codes, rubbing).astype(np.int8)


def violation(ut: Array, un: Array, rt: Array, rn: Array, friction: Array, bound: Array) -> float:
    """Return the largest violation of the laws at m points in 2D, scaled to a unit load."""
    size = max(1.0, float(np.abs(rn).max()), float(np.abs(rt).max()))
    most = friction * rn + bound
    parts = [
        -un,
        -rn / size,
        np.minimum(np.abs(un), np.abs(rn) / size),
        (np.abs(rt) - most) / size,
        np.minimum(np.abs(ut), np.abs(rt + np.sign(ut) * most) / size),
    ]
    return float(max(v.max(initial=0.0) for v in parts))


# -- cones in the plane ----------------------------------------------------------------------------

#: The two statuses at each border, indexed by code minus `FIRST_BORDER`.
BORDERS = ((OPEN, PLUS), (OPEN, MINUS), (STICK, PLUS), (STICK, MINUS))
FIRST_BORDER = 4

_UT, _UN, _RT, _RN = np.eye(4)
_NO = np.zeros(4)
#: Columns of B_0 and B_1 for each status and border.
BASES: list[tuple[list[Array], list[Array]]] = [
    ([_UT, _UN], [_NO, _NO]),
    ([_RT, _RN], [_NO, _NO]),
    ([_UT, _RN], [_NO, -_RT]),
    ([_UT, _RN], [_NO, _RT]),
    ([_UT], [_NO]),
    ([_UT], [_NO]),
    ([_RN], [-_RT]),
    ([_RN], [_RT]),
]
#: Rows of C_0 and C_1 for each status and border, with the status code beyond each row.
INSIDE: list[list[tuple[Array, Array, int]]] = [
    [(_UN, _NO, PLUS)],
    [(_RT, _RN, PLUS), (-_RT, _RN, MINUS)],
    [(_UT, _NO, STICK), (_RN, _NO, OPEN)],
    [(-_UT, _NO, STICK), (_RN, _NO, OPEN)],
    [(_UT, _NO, FIRST_BORDER + 1)],
    [(-_UT, _NO, FIRST_BORDER)],
    [(_RN, _NO, OPEN)],
    [(_RN, _NO, OPEN)],
]
#: Inequalities in place of `INSIDE` for a frictionless point, whose slip may have either sign.
WITHOUT_FRICTION: list[list[tuple[Array, Array, int]]] = [
    [(C_0, _NO, code) for C_0, _, code in rows if C_0 is _UN or C_0 is _RN] for rows in INSIDE
]
