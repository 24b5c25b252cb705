# SPDX-License-Identifier: LGPL-3.0-or-later
"""Approximate solutions in 3D for given statuses, and choices of statuses in a region.

The unknowns are defined in `check_proof.SpacePiece`. `check_proof` proves the solutions found here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact.proofs.check_proof import (
    IN_CLOSED,
    IN_OPEN,
    IN_SLIP,
    IN_STICK,
    IS_OPEN,
    ReducedProblem,
    SpacePiece,
    solve_in_space,
    space_jacobian,
    space_state,
)

__all__ = ["codes_of", "piece_at", "relaxed", "rounded", "solved_piece", "unknowns"]

Kinds = Sequence[frozenset[int]]

_ITERATIONS = 30
_ROUNDS = 12
_TURN = 0.7  # largest rotation of a slip direction in one step, in radians
_CLOSE = 1e-11  # relative residual of a solution


def _slips(problem: ReducedProblem, codes: Codes) -> Mask:
    """Return the mask of the points, closed or open, that slip with friction, shape (m,)."""
    return ((codes == 2) | (codes == 5)) & ((problem.friction > 0) | (problem.g > 0))


def _directions(slips: Mask, z: Array) -> Array:
    """Return slip directions for the unknowns z, 0 at points that do not slip, shape (m, 2)."""
    e = np.stack([np.cos(z[:, 1]), np.sin(z[:, 1])], axis=1)
    return np.where(slips[:, None], e, 0.0)


def unknowns(problem: ReducedProblem, codes: Codes, a: Array, r: Array) -> Array:
    """Return the unknowns (`check_proof.SpacePiece`) for given statuses, shape (m, 3).

    Args:
        problem: reduced problem with m points.
        codes: statuses, shape (m,).
        a: displacements, shape (m, 3).
        r: forces, shape (m, 3).
    """
    opened = IS_OPEN[codes]
    stuck = (codes == 1) | (codes == 4)
    slips = _slips(problem, codes)
    z = np.where(stuck[:, None], r, a)
    z[:, 2] = np.where(opened, a[:, 2], r[:, 2])
    pull = np.where(np.hypot(a[:, 0], a[:, 1])[:, None] > 1e-9, a[:, :2], -r[:, :2])
    z[slips, 0] = np.hypot(a[slips, 0], a[slips, 1])
    z[slips, 1] = np.arctan2(pull[slips, 1], pull[slips, 0])
    return z


def solved_piece(problem: ReducedProblem, codes: Codes, z: Array) -> Array | None:
    """Solve the equations for given statuses by Newton's method; None without convergence.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        codes: statuses of the points, shape (m,).
        z: initial guess of the unknowns (`check_proof.SpacePiece`), shape (m, 3).

    Returns:
        Unknowns of the solution, shape (m, 3).
    """
    z = z.copy()
    slips = _slips(problem, codes)
    size = 1.0 + float(np.abs(problem.p).max())
    for _ in range(_ITERATIONS):
        e = _directions(slips, z)
        state = space_state(problem, codes, z, e).value
        f = problem.S @ state[:, :3].reshape(-1) - state[:, 3:].reshape(-1) - problem.p
        if np.abs(f).max() < 1e-14 * size:
            break
        try:
            step = np.linalg.solve(space_jacobian(problem, codes, z, e).value, -f).reshape(-1, 3)
        except np.linalg.LinAlgError:
            return None
        if not np.abs(step).max() < 1e8:
            return None
        turn = float(np.abs(step[slips, 1]).max(initial=0.0))
        z += step * min(1.0, _TURN / turn if turn > 0 else 1.0)
    return z if np.abs(f).max() < _CLOSE * size else None


def state_of(problem: ReducedProblem, codes: Codes, z: Array) -> tuple[Array, Array]:
    """Return displacements and forces for unknowns z (`SpacePiece`), shape (m, 3) each."""
    e = _directions(_slips(problem, codes), z)
    state = space_state(problem, codes, z, e).value
    return state[:, :3], state[:, 3:]


def codes_of(problem: ReducedProblem, a: Array, r: Array, small: float = 1e-9) -> Codes:
    """Return the statuses of the m points at a solution, shape (m,).

    Args:
        problem: reduced problem, scaled by `ReducedProblem.scaled`.
        a: displacements, shape (m, 3).
        r: forces, shape (m, 3).
        small: largest normal force of open points and slip of sticking points; by default 1e-9.
    """
    closed = r[:, 2] >= small
    still = np.hypot(a[:, 0], a[:, 1]) < small
    codes = np.where(closed, np.where(still, 1, 2), 0)
    codes = np.where(problem.g > 0, np.where(still, 1, 2) + np.where(closed, 0, 3), codes)
    without = (problem.friction == 0) & (problem.g == 0)
    return np.where(without, np.where(closed, 2, 0), codes).astype(np.int8)


def piece_at(problem: ReducedProblem, a: Array, r: Array) -> SpacePiece | None:
    """Return the exact solution near an approximate one, with error bounds.

    None if no solution with the same statuses is proved to exist there.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        a: approximate displacements, shape (m, 3).
        r: approximate forces, shape (m, 3).
    """
    codes = codes_of(problem, a, r)
    z = solved_piece(problem, codes, unknowns(problem, codes, a, r))
    return None if z is None else solve_in_space(problem, codes, z)


def rounded(problem: ReducedProblem, kinds: Kinds, a: Array, r: Array) -> Codes:
    """Return the allowed status closest to the state of each of m points, shape (m,).

    Args:
        problem: reduced problem, scaled by `ReducedProblem.scaled`.
        kinds: allowed kinds of cells (`check_proof.Cells`) of each point.
        a: displacements, shape (m, 3).
        r: forces, shape (m, 3).
    """
    codes = np.zeros(problem.points, dtype=np.int8)
    for i, allowed in enumerate(kinds):
        ut, rt = float(np.hypot(*a[i, :2])), float(np.hypot(*r[i, :2]))
        un, rn = float(a[i, 2]), float(r[i, 2])
        F = float(problem.friction[i])
        if F == 0:
            codes[i] = _given_code(problem, i, allowed, rn - un, ut < 1e-12 or rt < problem.g[i])
            continue
        rub = min(rt, F * rn) / max(F, 1e-9)
        score = {IN_OPEN: un - rn, IN_STICK: rn - un - ut, IN_SLIP: min(rn - un, ut) + 0.5 * rub}
        best = max(sorted(allowed), key=lambda kind: score[kind])
        codes[i] = {IN_OPEN: 0, IN_STICK: 1, IN_SLIP: 2}[best]
    return codes


def _given_code(
    problem: ReducedProblem, i: int, allowed: frozenset[int], push: float, sticks: bool
) -> int:
    """Return the status of point ``i`` without Coulomb friction; it closes if ``push`` > 0."""
    closed = IN_CLOSED in allowed and (IN_OPEN not in allowed or push > 0)
    if problem.g[i] == 0:
        return 2 if closed else 0
    return (1 if sticks else 2) + (0 if closed else 3)


def relaxed(
    problem: ReducedProblem, kinds: Kinds, codes: Codes, z: Array | None
) -> tuple[Codes, Array | None]:
    """Search a region for statuses at which all undecided points satisfy the law.

    The statuses of undecided points, whose cells have several kinds, are updated as required by
    their displacements and forces until they do not change. Decided points may violate the
    inequalities.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        kinds: kinds of the cells (`check_proof.Cells`) of each point.
        codes: initial statuses, shape (m,).
        z: unknowns (`check_proof.SpacePiece`) for them, shape (m, 3); None without a solution.

    Returns:
        Statuses, shape (m,), and unknowns, shape (m, 3); None instead of the unknowns if the
        equations were not solved.
    """
    seen: set[bytes] = set()
    for _ in range(_ROUNDS):
        if z is None:
            return codes, None
        a, r = state_of(problem, codes, z)
        new = np.array(
            [_required(problem, i, k, a[i], r[i], int(codes[i])) for i, k in enumerate(kinds)],
            dtype=np.int8,
        )
        if np.array_equal(new, codes) or new.tobytes() in seen:
            return codes, z
        seen.add(new.tobytes())
        stays = (new == codes)[:, None]
        start = np.where(stays, z, unknowns(problem, new, a, r))
        codes, z = new, solved_piece(problem, new, start)
    return codes, z


def _required(
    problem: ReducedProblem, i: int, kinds: frozenset[int], a: Array, r: Array, code: int
) -> int:
    """Return the status that displacement and force of point ``i`` require, among ``kinds``."""
    push = float(r[2] - a[2])
    pull = float(np.hypot(*(r[:2] - a[:2])))
    F = float(problem.friction[i])
    if F == 0:
        return _given_code(problem, i, kinds, push, pull <= problem.g[i])
    if len(kinds) == 1:
        return code
    if IN_OPEN in kinds and push <= 0:
        return 0
    force = push if IN_OPEN in kinds else float(r[2])
    left = kinds - {IN_OPEN}
    if len(left) == 1:
        return 1 if IN_STICK in left else 2
    return 1 if pull <= F * abs(force) else 2
