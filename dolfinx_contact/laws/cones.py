# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Statuses of contact points in 2D as polyhedral cones of w = (ut, un, rt, rn).

The variables w of a point are tangential displacement, gap, and nodal forces on the body, divided
by a stiffness so that all four are lengths. If the answers of a law are linear in the jump j and
the traction t, with the derivatives D_j and D_t, a status is the set of all w on the plane t = D_j
j + D_t t that are inside the borders of the status. It is the cone {B z : C B z >= 0}, where the
columns of B span the plane, z has two components, and each row of C belongs to a border.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact.laws.answers import LawAtPoints, PointData

__all__ = ["cones", "is_polyhedral"]

_ROUND_OFF = 1e-9
_STATUSES = 4


def is_polyhedral(law: LawAtPoints, data: PointData) -> bool:
    """Return whether the statuses of a law are polyhedral cones at the points of this rank."""
    local = law.law.averaging is None
    if not local or max(law.codes) >= _STATUSES or not law.compiled.is_piecewise_linear:
        return False
    at_rest = np.zeros((law.number, law.dim))
    found = law(at_rest, at_rest, replace(data, gap=np.zeros(law.number)))
    return not any(
        np.any(values != 0)
        for code in law.codes
        for values in (
            found.traction(np.full(law.number, code, dtype=np.int8)),
            found.every_distance(code),
        )
    )


def cones(
    law: LawAtPoints, data: PointData, frames: Array, scale: Array
) -> tuple[Array, Array, Mask]:
    """Return the cones {B z : C B z >= 0} of the statuses of n points, in terms of w.

    w = (ut, un, rt, rn) are tangential and normal displacements and forces.

    Args:
        law: polyhedral law at the points.
        data: data of the points without gaps, which are included in w.
        frames: matrices T with j = T (ut, un) and t = scale T (rt, rn) for the jump j and the
            traction t, shape (n, 2, 2).
        scale: factors from forces in w, which are lengths, to tractions, shape (n,).

    Returns:
        Bases B, shape (n, 4, 4, 2); inequalities C padded by zero rows, shape (n, 4, 3, 4); and a
        mask of the existing statuses, shape (n, 4). Bases are oriented consistently with the law t
        = tau(j, t): for any linear equations M w = p of a body, and up to a sign common to all
        statuses, det (M B) has the sign of the determinant of M w = p together with t - tau(j, t) =
        0.
    """
    n = law.number
    B = np.zeros((n, _STATUSES, 4, 2))
    C = np.zeros((n, _STATUSES, 3, 4))
    exists = np.zeros((n, _STATUSES), dtype=bool)
    nothing = np.zeros((n, 2))
    answers = law(nothing, nothing, data)
    lengths = np.zeros((n, 4, 4))  # maps w to (j, t)
    lengths[:, :2, :2] = frames
    lengths[:, 2:, 2:] = frames * scale[:, None, None]
    for i, code in enumerate(law.codes):
        codes = np.full(n, code, dtype=np.int8)
        exists[:, code] = answers.exists[:, i]
        by_jump = answers.by_jump(codes)
        by_traction = answers.by_traction(codes)
        rows = np.concatenate([-by_jump, np.eye(2) - by_traction], axis=2) @ lengths
        rows /= scale[:, None, None]
        plane, free = _plane(rows, exists[:, code])
        slopes = law.slopes(code, nothing, nothing, data) @ lengths
        C[:, code] = _bounds(slopes @ plane, free, answers.borders(codes).distance < np.inf)
        # Orient the basis as the rows.
        whole = np.concatenate([plane, np.transpose(rows, (0, 2, 1))], axis=2)
        plane[np.linalg.det(whole) < 0, :, 1] *= -1.0
        B[:, code] = plane
    return B, C, exists


def _plane(rows: Array, used: Mask) -> tuple[Array, list[int]]:
    """Return bases of the planes ``rows`` w = 0, and the indices of their two coordinates.

    The bases have the shape (n, 4, 2); the coordinates are two of the four components of w, the
    same for all points.
    """
    best = -1.0
    chosen = (0, 1)
    size = np.abs(rows).max(axis=(1, 2))
    for pivots in combinations(range(4), 2):
        determinant = np.abs(np.linalg.det(rows[:, :, list(pivots)])) / size**2
        least = float(determinant[used].min(initial=np.inf))
        if least > best * (1 + _ROUND_OFF):
            best = least
            chosen = pivots
    held = list(chosen)
    free = [k for k in range(4) if k not in held]
    B = np.zeros((len(rows), 4, 2))
    B[:, free] = np.eye(2)
    if used.any():
        B[np.ix_(np.flatnonzero(used), np.array(held))] = -np.linalg.solve(
            rows[used][:, :, held], rows[used][:, :, free]
        )
    return B, free


def _bounds(slopes: Array, free: list[int], there: Mask) -> Array:
    """Return the border inequalities without redundant ones, shape (n, 3, 4).

    Only the coefficients of the coordinates ``free`` are nonzero.
    """
    n, borders, _ = slopes.shape
    size = np.abs(slopes).max(axis=2, initial=0.0)
    counts = there[:, :borders] & (size > 0)
    rows = np.where(counts[:, :, None], slopes / np.where(size > 0, size, 1.0)[:, :, None], 0.0)
    C = np.zeros((n, 3, 4))
    for i in range(n):
        kept = _needed(rows[i][counts[i]])
        C[i, : len(kept)][:, free] = kept
    return C


def _needed(rows: Array) -> Array:
    """Return the rows of the inequalities ``rows`` z >= 0 that are not implied by two others."""
    kept = list(range(len(rows)))
    for i in range(len(rows)):
        others = [k for k in kept if k != i]
        for pair in combinations(others, 2):
            A = rows[list(pair)].T
            if (
                abs(np.linalg.det(A)) > _ROUND_OFF
                and (np.linalg.solve(A, rows[i]) >= -_ROUND_OFF).all()
            ):
                kept.remove(i)
                break
        else:
            if any(np.abs(rows[i] - rows[k]).max() < _ROUND_OFF for k in others):
                kept.remove(i)
    return rows[kept]
